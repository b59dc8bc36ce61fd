//! What our tensors are called in the released PyTorch model. All names of the file format are in the two tables here.

/// Part of our network → module of the released one. Decoder 1 is the value map, decoder 2 the obstacle map.
const PLACES: [(&str, &str); 26] = [
    ("encoder.conv1", "Conv1.conv"),
    ("encoder.conv2", "Conv2.conv"),
    ("encoder.conv3", "Conv3.conv"),
    ("encoder.conv4", "Conv4.conv"),
    ("encoder.conv5", "Conv5.conv"),
    ("value.stage5.up", "Up5_1.up"),
    ("value.stage5.gate", "Att5_1"),
    ("value.stage5.merge", "Up_conv5_1.conv"),
    ("value.stage4.up", "Up4_1.up"),
    ("value.stage4.gate", "Att4_1"),
    ("value.stage4.merge", "Up_conv4_1.conv"),
    ("value.head", "Final1"),
    ("obstacle.stage5.up", "Up5_2.up"),
    ("obstacle.stage5.gate", "Att5_2"),
    ("obstacle.stage5.merge", "Up_conv5_2.conv"),
    ("obstacle.stage4.up", "Up4_2.up"),
    ("obstacle.stage4.gate", "Att4_2"),
    ("obstacle.stage4.merge", "Up_conv4_2.conv"),
    ("obstacle.stage3.up", "Up3_2.up"),
    ("obstacle.stage3.gate", "Att3_2"),
    ("obstacle.stage3.merge", "Up_conv3_2.conv"),
    ("obstacle.stage2.up", "Up2_2.up"),
    ("obstacle.stage2.gate", "Att2_2"),
    ("obstacle.stage2.merge", "Up_conv2_2.conv"),
    ("obstacle.head", "Final2.0"),
    ("log_vars", "log_vars"),
];

/// Layer of a part → its place in the released module, where layers without weights take up numbers too.
const LAYERS: [(&str, &str); 12] = [
    ("conv_a", "0"),
    ("norm_a", "1"),
    ("conv_b", "3"),
    ("norm_b", "4"),
    ("conv", "1"),
    ("norm", "2"),
    ("conv_g", "W_g.0"),
    ("norm_g", "W_g.1"),
    ("conv_x", "W_x.0"),
    ("norm_x", "W_x.1"),
    ("conv_psi", "psi.0"),
    ("norm_psi", "psi.1"),
];

/// A tensor that every file of this architecture has; its shape is `[base, in, 3, 3]`.
pub(super) const FIRST: &str = "Conv1.conv.0.weight";

/// PyTorch's count of training batches in each batch norm: an integer that neither code uses.
pub(super) const COUNTER: &str = "num_batches_tracked";

/// The released name of the tensor at a path of our network, `None` for a path that the tables do not know.
pub(super) fn released(path: &str) -> Option<String> {
    let (ours, place) = PLACES.iter().find(|(ours, _)| path.strip_prefix(ours).is_some_and(is_end))?;
    let rest = path[ours.len()..].trim_start_matches('.');
    match rest.rsplit_once('.') {
        None if rest.is_empty() => Some((*place).to_owned()),
        None => Some(format!("{place}.{rest}")),
        Some((layer, leaf)) => {
            let (_, layer) = LAYERS.iter().find(|(ours, _)| *ours == layer)?;
            Some(format!("{place}.{layer}.{leaf}"))
        }
    }
}

/// [`released`], or the path itself where the tables do not know it, so that it shows up as missing rather than being lost.
pub(super) fn naming(path: &str) -> String {
    released(path).unwrap_or_else(|| path.to_owned())
}

/// Whether what follows a prefix starts a new name.
fn is_end(rest: &str) -> bool {
    rest.is_empty() || rest.starts_with('.')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_become_released_names() {
        for (ours, theirs) in [
            ("encoder.conv1.conv_a.weight", FIRST),
            ("encoder.conv5.norm_b.running_var", "Conv5.conv.4.running_var"),
            ("value.stage5.up.conv.bias", "Up5_1.up.1.bias"),
            ("value.stage4.gate.conv_psi.weight", "Att4_1.psi.0.weight"),
            ("obstacle.stage2.gate.norm_g.weight", "Att2_2.W_g.1.weight"),
            ("obstacle.stage3.merge.conv_b.weight", "Up_conv3_2.conv.3.weight"),
            ("value.head.bias", "Final1.bias"),
            ("obstacle.head.weight", "Final2.0.weight"),
            ("log_vars", "log_vars"),
        ] {
            assert_eq!(released(ours).as_deref(), Some(theirs));
        }
        assert_eq!(released("encoder.conv6.conv_a.weight"), None);
        assert_eq!(released("encoder.conv1.conv_z.weight"), None);
    }
}

use super::*;
use crate::tensorize::tests::input;
use crate::tensorize::{self};

const WINDOW: WindowSize = WindowSize { pixels: 32, metres: 40.0 };

fn config() -> CheckpointConfig {
    CheckpointConfig::new(NetConfig { base: 4, ..NetConfig::default() }, WINDOW)
}

fn net() -> Nbp {
    Nbp::new(&config().net, 5, &Device::flex()).unwrap()
}

fn answer(net: &Nbp) -> Vec<f32> {
    let x_bchw = tensorize::inputs(&[input(32, 5, 1)], &config().net, &Device::flex()).unwrap();
    net.forward(x_bchw).value_bkhw.into_data().try_to_vec().unwrap()
}

#[test]
fn weights_come_back_bit_for_bit_with_their_notes() {
    let dir = tempfile::tempdir().unwrap();
    let mut config = config();
    config.meta.insert("layers".into(), serde_json::json!({"height": 2.5}));
    save(dir.path(), &net(), &config).unwrap();
    let loaded = load(dir.path(), &Device::flex()).unwrap();
    assert_eq!(loaded.config, config);
    assert_eq!(answer(&loaded.net), answer(&net()));
    let names: Vec<_> = fs::read_dir(dir.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 2, "temporary files are left: {names:?}");

    let first = fs::read(dir.path().join(WEIGHTS_FILE)).unwrap();
    save(dir.path(), &loaded.net, &config).unwrap();
    assert_eq!(first, fs::read(dir.path().join(WEIGHTS_FILE)).unwrap());
}

#[test]
fn a_training_network_is_saved_with_its_newest_statistics() {
    let dir = tempfile::tempdir().unwrap();
    let device = Device::flex().autodiff();
    let training = Nbp::new(&config().net, 5, &device).unwrap();
    let x_bchw = tensorize::inputs(&[input(32, 5, 1), input(32, 5, 2)], &config().net, &device).unwrap();
    let _ = training.forward(x_bchw);
    save(dir.path(), &training, &config()).unwrap();
    let plain = load(dir.path(), &Device::flex()).unwrap().net;
    assert_ne!(answer(&plain), answer(&net()), "the running statistics did not move");
    assert_eq!(answer(&plain), answer(&training.valid()));
    assert!(load(dir.path(), &device).unwrap().net.log_vars.val().is_require_grad());
}

#[test]
fn files_hold_every_tensor_that_pytorch_expects() {
    let bytes = file::to_safetensors(&tensors::collect(&net(), names::naming)).unwrap();
    let file = safetensors::SafeTensors::deserialize(&bytes).unwrap();
    // 37 convolutions with 2 tensors, 35 batch norms with 5, log_vars.
    let count = |end: &str| file.names().iter().filter(|name| name.ends_with(end)).count();
    assert_eq!(count("running_mean"), count("num_batches_tracked"));
    assert_eq!(file.tensor("Conv1.conv.0.weight").unwrap().shape(), [4, 5, 3, 3]);
    assert_eq!(file.tensor("Att2_2.psi.1.num_batches_tracked").unwrap().shape(), [0usize; 0]);
    let trainable: usize = file
        .iter()
        .filter(|(name, _)| !name.contains("running_") && !name.contains("num_batches"))
        .map(|(_, view)| view.shape().iter().product::<usize>())
        .sum();
    assert_eq!(trainable, config().net.parameters());
}

#[test]
fn damage_is_explained() {
    let dir = tempfile::tempdir().unwrap();
    let fails = |what: &str| {
        let error = load(dir.path(), &Device::flex()).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    };
    fails("cannot read");
    save(dir.path(), &net(), &config()).unwrap();
    let (weights, json) = (dir.path().join(WEIGHTS_FILE), dir.path().join(CONFIG_FILE));
    let (good_weights, good_json) = (fs::read(&weights).unwrap(), fs::read_to_string(&json).unwrap());

    fs::write(&weights, &good_weights[..good_weights.len() / 2]).unwrap();
    fails("cut short");
    fs::write(&weights, good_weights).unwrap();

    for (from, to, what) in [
        ("\"base\": 4", "\"base\": 8", "Att2_2.W_g.0.bias [2] instead of [4]"),
        ("\"nbp\"", "\"unet\"", "another architecture (unet), not the nbp network"),
        ("\"version\": 1", "\"version\": 9", "version 9"),
        ("\"base\": 4", "\"base\": 5", "even number"),
        ("\"window\"", "\"widow\"", "unknown field `widow`"),
    ] {
        assert!(good_json.contains(from), "{good_json}");
        fs::write(&json, good_json.replace(from, to)).unwrap();
        fails(what);
    }
    fs::write(&json, good_json).unwrap();

    let mut tensors = tensors::collect(&net(), names::naming);
    let taken = tensors.remove("Final1.bias").unwrap();
    tensors.insert("Final9.bias".into(), taken);
    fs::write(&weights, file::to_safetensors(&tensors).unwrap()).unwrap();
    fails("1 missing: Final1.bias; 1 unknown: Final9.bias");
    fs::write(&weights, file::to_safetensors(&Tensors::new()).unwrap()).unwrap();
    fails("another architecture");
}

#[test]
fn files_that_are_not_pytorchs_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.pth");
    let fails = |what: &str| {
        let error = import_pth(&path, WINDOW, &Device::flex()).unwrap_err().to_string();
        assert!(error.contains(what), "{error}");
    };
    fails("cannot read");
    fs::write(&path, b"no pickle at all").unwrap();
    fails("cannot make sense");
}

#[test]
fn half_the_bits_are_half_the_file_and_nearly_the_same_answer() {
    let size = |dir: &Path| fs::metadata(dir.join(WEIGHTS_FILE)).unwrap().len();
    let (full, half) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let config = CheckpointConfig::new(NetConfig { base: 16, ..NetConfig::default() }, WINDOW);
    let net = Nbp::new(&config.net, 5, &Device::flex()).unwrap();
    let x_bchw = tensorize::inputs(&[input(32, 5, 1)], &config.net, &Device::flex()).unwrap();
    let answer = |net: &Nbp| net.forward(x_bchw.clone()).value_bkhw.into_data().try_to_vec::<f32>().unwrap();
    let want = answer(&net);
    let largest = want.iter().fold(0.0f32, |largest, x| largest.max(x.abs()));
    save(full.path(), &net, &config).unwrap();
    for (precision, bound) in [(Precision::F16, 2e-3), (Precision::Bf16, 2e-2)] {
        save_as(half.path(), &net, &config, precision).unwrap();
        assert!(2 * size(half.path()) < size(full.path()) + 200_000, "{precision}: {}", size(half.path()));
        let loaded = load(half.path(), &Device::flex()).unwrap();
        assert_eq!(loaded.config, config);
        let got = answer(&loaded.net);
        let error = got.iter().zip(&want).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(error > 0.0 && error < bound * largest, "{precision}: off by {error} of {largest}");
        // What was rounded once is not rounded again.
        let first = fs::read(half.path().join(WEIGHTS_FILE)).unwrap();
        save_as(half.path(), &loaded.net, &config, precision).unwrap();
        assert_eq!(first, fs::read(half.path().join(WEIGHTS_FILE)).unwrap());
    }
}

#[test]
fn weights_too_large_for_half_precision_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let mut tensors = tensors::collect(&net(), names::naming);
    let shape = tensors["Final1.weight"].shape().as_slice().to_vec();
    let large = burn::tensor::TensorData::new(vec![1e5f32; shape.iter().product()], shape);
    tensors.insert("Final1.weight".into(), large);
    let net = tensors::apply(net(), names::naming, tensors);
    let error = save_as(dir.path(), &net, &config(), Precision::F16).unwrap_err().to_string();
    assert!(error.contains("Final1.weight") && error.contains("bf16"), "{error}");
    save_as(dir.path(), &net, &config(), Precision::Bf16).unwrap();
}

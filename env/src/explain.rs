//! One line for an error and its causes, for the programs of the workspace.

/// Joins the messages of an error and its causes, outermost first, leaving out what the one before already said.
pub fn told_once(messages: impl IntoIterator<Item = String>) -> String {
    messages.into_iter().fold(String::new(), |told, cause| match told.as_str() {
        "" => cause,
        before if before.contains(&cause) => told,
        before => format!("{before}: {cause}"),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_said_twice() {
        let chain = ["loading a.obj", "cannot read a.obj: no such file", "no such file"].map(String::from);
        assert_eq!(told_once(chain), "loading a.obj: cannot read a.obj: no such file");
    }
}

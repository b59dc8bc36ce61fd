//! How the programs of the workspace talk: results, remarks, and one line for an error and its causes.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write as _};

/// Writes a line of results to standard output. A reader who has closed it wants no more, which is no error.
///
/// # Errors
/// When it cannot be written, as on a full disk.
pub fn show(line: impl Display) -> io::Result<()> {
    match writeln!(io::stdout(), "{line}") {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        Err(error) => {
            Err(io::Error::new(error.kind(), format!("cannot write the results to standard output: {error}")))
        }
        Ok(()) => Ok(()),
    }
}

/// Writes a line to standard error, where what nobody reads is lost.
pub fn tell(line: impl Display) {
    drop(writeln!(io::stderr(), "{line}"));
}

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

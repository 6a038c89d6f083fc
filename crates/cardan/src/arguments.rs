//! Options as arguments: of child processes, and of command lines that are shown.

use std::ffi::{OsStr, OsString};

/// Arguments in their order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Arguments(Vec<OsString>);

impl Arguments {
    /// Adds an option with its value.
    pub(crate) fn give(&mut self, name: &str, value: impl AsRef<OsStr>) {
        let value = value.as_ref();
        if value.as_encoded_bytes().starts_with(b"-") {
            // Alone it would be taken for an option.
            let mut joined = OsString::from(name);
            joined.push("=");
            joined.push(value);
            self.0.push(joined);
        } else {
            self.0.extend([name.into(), value.into()]);
        }
    }

    /// The same, if there is a value.
    pub(crate) fn give_some(&mut self, name: &str, value: Option<impl AsRef<OsStr>>) {
        if let Some(value) = value {
            self.give(name, value);
        }
    }

    /// Adds an option without a value.
    pub(crate) fn switch(&mut self, name: &str) {
        self.0.push(name.into());
    }

    /// As they are typed, behind a blank each; what a shell would take apart is quoted.
    pub(crate) fn typed(&self) -> String {
        let word = |argument: &OsString| format!(" {}", quoted(&argument.to_string_lossy()));
        self.0.iter().map(word).collect()
    }
}

impl IntoIterator for Arguments {
    type Item = OsString;
    type IntoIter = std::vec::IntoIter<OsString>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_alphanumeric() || "-_./=:,+@%".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_that_looks_like_an_option_stays_a_value() {
        let mut arguments = Arguments::default();
        arguments.give("--report", "-inf");
        arguments.give("--seed", "1");
        arguments.switch("--json");
        arguments.give_some("--dump", None::<&str>);
        let words: Vec<OsString> = arguments.into_iter().collect();
        assert_eq!(words, ["--report=-inf", "--seed", "1", "--json"]);
    }

    #[test]
    fn what_is_shown_is_what_a_shell_takes() {
        let mut arguments = Arguments::default();
        arguments.give("--recording", "my walk's.csv");
        arguments.give("--set", "tolerance.truth.rms_deg=2");
        arguments.give("--out", "");
        let typed = r"--recording 'my walk'\''s.csv' --set tolerance.truth.rms_deg=2 --out ''";
        assert_eq!(arguments.typed(), format!(" {typed}"));
    }
}

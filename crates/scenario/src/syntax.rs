//! Turns errors of the TOML reader and of range checks into messages with place and remedy.

use toml::de::DeTable;

use crate::error::Error;

/// Line and column, both from 1, of a byte offset.
fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = &text[..text.floor_char_boundary(offset)];
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    (
        before.matches('\n').count() + 1,
        before[line_start..].chars().count() + 1,
    )
}

/// The TOML reader's error with place and, for an unknown key, the nearest known one.
pub(crate) fn explain(error: &toml::de::Error, text: &str, file: &str) -> Error {
    let (line, column) = position(text, error.span().map_or(0, |span| span.start));
    let message = match suggestion(error.message()) {
        Some(suggestion) => suggestion,
        None => error.message().trim().to_string(),
    };
    Error::Syntax {
        file: file.into(),
        line,
        column,
        message,
    }
}

/// For serde's "unknown field `x`, expected one of `a`, `b`": a message that names the nearest.
fn suggestion(message: &str) -> Option<String> {
    let kind = ["unknown field", "unknown variant"]
        .into_iter()
        .find(|k| message.starts_with(k))?;
    let quoted: Vec<&str> = message.split('`').skip(1).step_by(2).collect();
    let (found, known) = quoted.split_first()?;
    let what = if kind == "unknown field" {
        "key"
    } else {
        "value"
    };
    let hint =
        nearest(found, known).map_or(String::new(), |near| format!("did you mean '{near}'? "));
    Some(format!(
        "unknown {what} '{found}'; {hint}known here: {}",
        known.join(", ")
    ))
}

/// The known word most like `found`, if any is like it at all.
pub(crate) fn nearest<'a>(found: &str, known: &[&'a str]) -> Option<&'a str> {
    let likeness = |word: &&str| strsim::jaro_winkler(found, word);
    known
        .iter()
        .map(|word| (likeness(word), *word))
        .filter(|(likeness, _)| *likeness > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, word)| word)
}

/// The known dotted key most like `found`: as a whole, or in its last word where the tables are left out or
/// others.
pub(crate) fn nearest_key<'a>(found: &str, known: &[&'a str]) -> Option<&'a str> {
    let last = |key: &str| key.rsplit('.').next().unwrap_or_default().to_owned();
    let likeness = |key: &str| {
        let whole = strsim::normalized_levenshtein(found, key);
        let word = strsim::normalized_levenshtein(&last(found), &last(key));
        // The same word in another table is as near as a slip or two in the whole key.
        whole.max(0.85 * word)
    };
    known
        .iter()
        .map(|key| (likeness(key), *key))
        .filter(|(likeness, _)| *likeness > 0.6)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, key)| key)
}

/// Fills the place of an error with file and line of its key.
pub(crate) fn place(error: Error, text: &str, file: &str) -> Error {
    placed(error, file, |key| line_of(text, key))
}

/// Puts a file before the place of an error, and the line where its key can be found.
fn placed(error: Error, file: &str, line_of: impl Fn(&str) -> Option<usize>) -> Error {
    let of = |key: &str| match line_of(key) {
        Some(line) => format!("{file}, line {line}"),
        None => file.to_owned(),
    };
    match error {
        Error::Range {
            key,
            value,
            expected,
            ..
        } => Error::Range {
            place: of(&key),
            key,
            value,
            expected,
        },
        Error::UnknownKey { key, hint, .. } => Error::UnknownKey {
            place: of(&key),
            key,
            hint,
        },
        other => other,
    }
}

/// The line on which the dotted `key` is set.
fn line_of(text: &str, key: &str) -> Option<usize> {
    let document = DeTable::parse(text).ok()?;
    let mut table = document.get_ref();
    let mut offset = None;
    for part in key.split('.') {
        let (name, value) = table.iter().find(|(name, _)| name.get_ref() == part)?;
        offset = Some(name.span().start);
        match value.get_ref().as_table() {
            Some(inner) => table = inner,
            None => break,
        }
    }
    offset.map(|offset| position(text, offset).0)
}

/// The same where keys are quoted and stand in tables of their own: the line that holds the key's text.
pub(crate) fn in_file(error: Error, text: &str, file: &str) -> Error {
    placed(error, file, |key| {
        let last = key.strip_prefix("spread.").unwrap_or(key);
        let at = text.lines().position(|line| line.contains(last));
        at.map(|at| at + 1)
    })
}

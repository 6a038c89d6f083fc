//! A result put into a word-length file that people keep: order, comments and whatever else is in it stay.

use cardan_datapath::NodeInfo;
use toml_edit::{Decor, DocumentMut, Item, Table, TableLike, Value};

use crate::outcome::Outcome;
use crate::output::{header, range_comment, share_comment, tuned_table};

/// `text`, the word-length file `file`, with the formats of `outcome` and its table `[tuned]`. Only values
/// that change are written anew. Comments are kept, except those that an earlier result left beside its
/// values: they become this result's.
///
/// # Errors
/// Broken TOML, or a file that lacks a node.
pub fn rewritten(
    text: &str,
    file: &str,
    outcome: &Outcome,
    nodes: &[NodeInfo],
    command: &str,
) -> Result<String, String> {
    let broken = |error: toml_edit::TomlError| format!("{file}: {error}");
    let mut document: DocumentMut = text.parse().map_err(broken)?;
    let tables = document.get_mut("node").map(tables).unwrap_or_default();
    let mut left: Vec<&str> = nodes.iter().map(|node| node.name).collect();
    for table in tables {
        let name = table.get("name").and_then(Item::as_str).map(str::to_owned);
        let Some(at) = nodes
            .iter()
            .position(|node| Some(node.name) == name.as_deref())
        else {
            continue;
        };
        left.retain(|left| *left != nodes[at].name);
        put(table, outcome, at, nodes[at].name);
    }
    if let Some(missing) = left.first() {
        return Err(format!(
            "{file}: node '{missing}' is missing; add a [[node]] table for it"
        ));
    }
    replace_tuned(&mut document, &tuned_table(outcome, command)).map_err(broken)?;
    let mut out = document.to_string();
    if let Some(rest) = without_header(&out) {
        out = format!("{}{rest}", header(outcome, command));
    }
    // The parser takes both kinds of line ends; written is the one that the file has.
    Ok(if text.contains("\r\n") {
        out.replace("\r\n", "\n").replace('\n', "\r\n")
    } else {
        out
    })
}

/// The tables of `node`, in either notation.
fn tables(item: &mut Item) -> Vec<&mut dyn TableLike> {
    match item {
        Item::ArrayOfTables(tables) => tables
            .iter_mut()
            .map(|table| table as &mut dyn TableLike)
            .collect(),
        Item::Value(Value::Array(values)) => values
            .iter_mut()
            .filter_map(Value::as_inline_table_mut)
            .map(|table| table as &mut dyn TableLike)
            .collect(),
        _ => Vec::new(),
    }
}

/// Puts a node's format into its table.
fn put(table: &mut dyn TableLike, outcome: &Outcome, at: usize, name: &str) {
    let Some((_, format)) = outcome.best.formats.0.get(at) else {
        return;
    };
    put_value(table, "word", i64::from(format.word).into());
    put_value(table, "frac", i64::from(format.frac).into());
    put_value(table, "rounding", format.rounding.name().into());
    put_value(table, "overflow", format.overflow.name().into());
    put_comment(table, "word", &range_comment(outcome, at, *format));
    put_comment(table, "frac", &share_comment(outcome, name));
}

/// Puts a value in place of another, with the same comment; one that is there already stays as it is
/// written.
fn put_value(table: &mut dyn TableLike, key: &str, value: Value) {
    let Some(old) = table.get_mut(key).and_then(Item::as_value_mut) else {
        table.insert(key, Item::Value(value));
        return;
    };
    let same = match (&*old, &value) {
        (Value::Integer(old), Value::Integer(new)) => old.value() == new.value(),
        (Value::String(old), Value::String(new)) => old.value() == new.value(),
        _ => false,
    };
    if !same {
        let decor = old.decor().clone();
        *old = value;
        *old.decor_mut() = decor;
    }
}

/// Replaces a comment that an earlier result left behind a value; those of people stay.
fn put_comment(table: &mut dyn TableLike, key: &str, comment: &str) {
    let Some(value) = table.get_mut(key).and_then(Item::as_value_mut) else {
        return;
    };
    let said = suffix(value.decor());
    if said.starts_with("# range ") || said.contains(" % of the error of ") {
        value.decor_mut().set_suffix(comment);
    }
}

fn suffix(decor: &Decor) -> &str {
    let raw = decor.suffix().and_then(|suffix| suffix.as_str());
    raw.unwrap_or_default().trim()
}

/// Puts the new `[tuned]` where the old one stands, or at the end.
fn replace_tuned(document: &mut DocumentMut, text: &str) -> Result<(), toml_edit::TomlError> {
    let mut parsed: DocumentMut = text.parse()?;
    let Some(Item::Table(mut new)) = parsed.remove("tuned") else {
        return Ok(());
    };
    // Without places of their own, tables follow the one before them.
    unplace(&mut new);
    match document.get("tuned").and_then(Item::as_table) {
        Some(old) => {
            new.set_position(old.position());
            *new.decor_mut() = old.decor().clone();
        }
        None => new.decor_mut().set_prefix("\n"),
    }
    document.insert("tuned", Item::Table(new));
    Ok(())
}

fn unplace(table: &mut Table) {
    table.set_position(None);
    for (_, item) in table.iter_mut() {
        match item {
            Item::Table(inner) => unplace(inner),
            Item::ArrayOfTables(inner) => inner.iter_mut().for_each(unplace),
            _ => {}
        }
    }
}

/// What follows the first lines that an earlier result wrote; none where they are people's.
fn without_header(text: &str) -> Option<&str> {
    if !text.starts_with("# Word lengths tuned with: ") {
        return None;
    }
    let is_ours = |line: &str| {
        let starts = [
            "# Word lengths tuned with: ",
            "# NOT VERIFIED: ",
            "# proven: no inputs",
        ];
        let parts = [": reached ", " bits in all; uniform 32 bit: "];
        starts.iter().any(|start| line.starts_with(start))
            || (line.starts_with('#') && parts.iter().any(|part| line.contains(part)))
    };
    let lines = text.split_inclusive('\n').take_while(|line| is_ours(line));
    Some(&text[lines.map(str::len).sum()..])
}

//! Writes `firmware/c/nodes.h`: the firmware's node table as C firmware reads it.

use std::fmt::Write as _;
use std::fs;
use std::path::PathBuf;

use cardan_datapath::{NodeInfo, table_hash};
use cardan_firmware::nodes::NODES;

use crate::shell::root;

/// The header, in the workspace.
const HEADER: &str = "firmware/c/nodes.h";

const HEAD: &str = "\
/* nodes.h: written by `cargo xtask c-header` from firmware/wordlengths.toml; edit that.
 *
 * FNV-1a over the nodes' names and formats in order, and the nodes as
 * X(NAME, word length, fractional bits, rounding, overflow). cardan_tap.h says how they are used.
 */
#ifndef CARDAN_NODES_H
#define CARDAN_NODES_H
";

/// Writes the header into the workspace.
pub(crate) fn write() -> Result<bool, String> {
    fs::write(file(), header(&NODES)).map_err(|error| format!("{HEADER}: {error}"))?;
    println!("{HEADER} written from firmware/wordlengths.toml");
    Ok(true)
}

fn file() -> PathBuf {
    root().join(HEADER)
}

fn header(nodes: &[NodeInfo]) -> String {
    let rows: Vec<String> = nodes.iter().map(row).collect();
    let mut out = String::from(HEAD);
    let _ = write!(
        out,
        "\n#define CARDAN_FORMATS_HASH 0x{:016x}ULL\n\n#define CARDAN_NODES(X) \\\n{}\n\n#endif\n",
        table_hash(nodes),
        rows.join(" \\\n")
    );
    out
}

fn row(node: &NodeInfo) -> String {
    let format = node.format;
    let [name, rounding, overflow] =
        [node.name, format.rounding.name(), format.overflow.name()].map(str::to_uppercase);
    let (word, frac) = (format.word, format.frac);
    format!("    X({name}, {word}, {frac}, {rounding}, {overflow})")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checked_in_header_is_current() {
        let found = fs::read_to_string(file()).expect("the header is there");
        assert!(
            found == header(&NODES),
            "{HEADER} is not what firmware/wordlengths.toml says: run `cargo xtask c-header`"
        );
    }

    #[test]
    fn another_format_gives_another_row_and_another_hash() {
        let mut node = NODES[3];
        let before = header(&[node]);
        node.format.frac -= 1;
        let after = header(&[node]);
        let differing = before
            .lines()
            .zip(after.lines())
            .filter(|(before, after)| before != after);
        assert_eq!(differing.count(), 2);
    }
}

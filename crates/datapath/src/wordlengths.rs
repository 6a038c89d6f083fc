//! Word-length files: the nodes of an algorithm with their units and formats, as TOML.
//!
//! ```toml
//! [[node]]
//! name = "tilt_x"
//! unit = "g"
//! meaning = "gravity along body x" # one line for people; may be left out
//! word = 16               # bits with the sign, 1..64
//! frac = 14               # fractional bits, 0..=container (8, 16, 32 or 64 bits)
//! rounding = "nearest_up" # floor, ceil, zero, nearest_up, nearest_away, nearest_even
//! overflow = "saturate"   # wrap, saturate, trap
//! ```
//!
//! A file that was tuned also says to what, in a table `[tuned]`: see [`Tuned`].

use std::collections::BTreeMap;
use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use crate::{Format, Overflow, Rounding};

/// A node as its file declares it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DeclaredNode {
    /// Name, `snake_case`.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// What it is, in one line; empty where the file does not say.
    pub meaning: String,
    /// Format.
    pub format: Format,
}

/// A whole word-length file.
#[derive(Clone, Debug, PartialEq)]
pub struct WordLengths {
    /// The nodes in the order of the file.
    pub nodes: Vec<DeclaredNode>,
    /// What they were tuned to; none for formats chosen by hand.
    pub tuned: Option<Tuned>,
}

/// What formats were tuned to, and on what: the table `[tuned]`. Whatever judges the formats judges
/// by this.
#[derive(Clone, Debug, Default, PartialEq, serde::Deserialize, serde::Serialize)]
#[serde(deny_unknown_fields)]
pub struct Tuned {
    /// The command that finds the same again.
    #[serde(default)]
    pub command: String,
    /// Budget expressions, implied ones included.
    pub budget: Vec<String>,
    /// Per budget expression, the largest value reached on the runs tuned on; not a number where it
    /// was not measured.
    #[serde(default)]
    pub reached: Vec<f64>,
    /// Names of the runs tuned on: scenario and seed.
    #[serde(default)]
    pub tuned_on: Vec<String>,
    /// Names of the runs that the result was verified on.
    #[serde(default)]
    pub verified_on: Vec<String>,
    /// Every budget expression holds on all of them, and with `confidence` where it is given.
    pub verified: bool,
    /// With this confidence at least the share `content` of all runs like the fresh ones holds every
    /// budget expression; 0 where no fresh runs told.
    #[serde(default)]
    pub confidence: f64,
    /// See `confidence`.
    #[serde(default)]
    pub content: f64,
    /// What the proofs of nodes assume of the inputs.
    #[serde(default)]
    pub assumptions: Vec<String>,
    /// Errors of nodes against the algorithm on real numbers.
    #[serde(default)]
    pub tolerance: Vec<TunedTolerance>,
}

/// What a tuned node may differ from the algorithm on real numbers, in the node's unit and in
/// solutions without status flags: twice the largest found on any run tuned or verified on.
#[derive(Clone, Debug, Default, PartialEq, serde::Deserialize, serde::Serialize)]
#[serde(deny_unknown_fields)]
pub struct TunedTolerance {
    /// The node.
    pub node: String,
    /// Largest size of the error.
    pub max: f64,
    /// Root mean square of a run's errors.
    pub rms: f64,
    /// Size of the mean of a run's errors.
    pub bias: f64,
}

/// Why a word-length file was refused; says file, place, expectation and mend.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WordlengthsError(String);

impl core::fmt::Display for WordlengthsError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for WordlengthsError {}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    tuned: Option<Tuned>,
    node: Vec<Entry>,
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct Entry {
    name: String,
    unit: String,
    #[serde(default)]
    meaning: String,
    word: u32,
    frac: u32,
    rounding: String,
    overflow: String,
}

/// Reads the nodes of word-length file `file` from its text.
///
/// # Errors
/// As [`parse_all`].
pub fn parse(text: &str, file: &str) -> Result<Vec<DeclaredNode>, WordlengthsError> {
    parse_all(text, file).map(|all| all.nodes)
}

/// Reads the text of word-length file `file`.
///
/// # Errors
/// Broken TOML, unknown keys, repeated or badly formed names, formats out of range, a table `[tuned]`
/// that speaks of nodes that are not in the file.
pub fn parse_all(text: &str, file: &str) -> Result<WordLengths, WordlengthsError> {
    let mut parsed: File =
        toml::from_str(text).map_err(|error| WordlengthsError(format!("{file}: {error}")))?;
    let tuned = parsed.tuned.take();
    let nodes = declared(parsed, file)?;
    if let Some(tuned) = &tuned {
        check(tuned, &nodes)
            .map_err(|what| WordlengthsError(format!("{file}: [tuned]: {what}")))?;
    }
    Ok(WordLengths { nodes, tuned })
}

/// The table agrees with itself and with the nodes.
fn check(tuned: &Tuned, nodes: &[DeclaredNode]) -> Result<(), String> {
    if tuned.budget.is_empty() {
        return Err("budget: expected the expressions that the formats were tuned to".to_string());
    }
    if !tuned.reached.is_empty() && tuned.reached.len() != tuned.budget.len() {
        return Err(format!(
            "reached: {} values for {} budget expressions; give one for each, or none",
            tuned.reached.len(),
            tuned.budget.len()
        ));
    }
    for (key, share) in [("confidence", tuned.confidence), ("content", tuned.content)] {
        if !(0.0..1.0).contains(&share) {
            return Err(format!(
                "{key} = {share}: expected 0 up to, not including, 1"
            ));
        }
    }
    for tolerance in &tuned.tolerance {
        let name = &tolerance.node;
        if !nodes.iter().any(|node| node.name == *name) {
            return Err(format!("tolerance: node '{name}' is not in this file"));
        }
        for (key, value) in [
            ("max", tolerance.max),
            ("rms", tolerance.rms),
            ("bias", tolerance.bias),
        ] {
            if !(value.is_finite() && value >= 0.0) {
                return Err(format!(
                    "tolerance of node '{name}': {key} = {value}: expected a number from 0 up"
                ));
            }
        }
    }
    Ok(())
}

fn declared(parsed: File, file: &str) -> Result<Vec<DeclaredNode>, WordlengthsError> {
    if parsed.node.is_empty() {
        return Err(WordlengthsError(format!(
            "{file}: no nodes; add a [[node]] table for each node"
        )));
    }
    let mut types = BTreeMap::new();
    let mut nodes = Vec::new();
    for entry in parsed.node {
        let fail =
            |what: String| WordlengthsError(format!("{file}: node '{}': {what}", entry.name));
        if !well_formed(&entry.name) {
            return Err(fail(
                "a name starts with a lower case letter and has lower case letters and digits, \
                 in words joined by one '_' each"
                    .to_string(),
            ));
        }
        if entry.name == "self" {
            return Err(fail("Rust reserves this name; choose another".to_string()));
        }
        match types.insert(type_name(&entry.name), entry.name.clone()) {
            None => {}
            Some(before) if before == entry.name => {
                return Err(fail("declared twice; remove one".to_string()));
            }
            Some(before) => {
                return Err(fail(format!(
                    "its type would be named as that of node '{before}': rename one"
                )));
            }
        }
        if entry.unit.is_empty() || entry.unit.contains(char::is_control) {
            return Err(fail(
                "unit: expected one line of text, \"1\" for a pure number".to_string(),
            ));
        }
        if entry.meaning.contains(char::is_control) {
            return Err(fail("meaning: expected one line of text".to_string()));
        }
        let rounding = mode(&Rounding::ALL, "rounding", &entry.rounding).map_err(&fail)?;
        let overflow = mode(&Overflow::ALL, "overflow", &entry.overflow).map_err(&fail)?;
        if !(1..=64).contains(&entry.word) {
            return Err(fail(format!(
                "word = {}: expected 1 to 64 bits",
                entry.word
            )));
        }
        let container = container_bits(entry.word);
        if entry.frac > container {
            return Err(fail(format!(
                "frac = {}: a {}-bit word lives in {container} bits; expected 0 to {container}",
                entry.frac, entry.word
            )));
        }
        let format = Format::new(entry.word, entry.frac, rounding, overflow);
        nodes.push(DeclaredNode {
            name: entry.name,
            unit: entry.unit,
            meaning: entry.meaning,
            format,
        });
    }
    Ok(nodes)
}

fn well_formed(name: &str) -> bool {
    let word = |word: &str| {
        !word.is_empty()
            && word
                .chars()
                .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit())
    };
    name.starts_with(|c: char| c.is_ascii_lowercase()) && name.split('_').all(word)
}

/// Name of the type that [`crate::codegen`] makes of a node: `tilt_x` becomes `TiltX`.
pub(crate) fn type_name(name: &str) -> String {
    name.split('_')
        .map(|part| {
            let mut chars = part.chars();
            chars.next().map_or_else(String::new, |first| {
                first.to_uppercase().to_string() + chars.as_str()
            })
        })
        .collect()
}

fn mode<T: Copy>(all: &[(T, &'static str)], key: &str, name: &str) -> Result<T, String> {
    all.iter()
        .find(|(_, known)| *known == name)
        .map(|(mode, _)| *mode)
        .ok_or_else(|| {
            let names: Vec<&str> = all.iter().map(|(_, known)| *known).collect();
            format!("{key} = \"{name}\": expected one of {}", names.join(", "))
        })
}

/// Bits of the smallest container that holds a word.
#[must_use]
pub const fn container_bits(word: u32) -> u32 {
    match word {
        0..=8 => 8,
        9..=16 => 16,
        17..=32 => 32,
        _ => 64,
    }
}

/// Brings the formats of `given` into the order of `deployed`.
///
/// # Errors
/// A node that is missing or unknown, or a unit that differs.
pub fn align(
    given: &[DeclaredNode],
    deployed: &[crate::NodeInfo],
    file: &str,
) -> Result<Vec<Format>, WordlengthsError> {
    for node in given {
        if !deployed.iter().any(|known| known.name == node.name) {
            return Err(WordlengthsError(format!(
                "{file}: node '{}' is not a node of this firmware; its nodes are: {}",
                node.name,
                deployed
                    .iter()
                    .map(|known| known.name)
                    .collect::<Vec<_>>()
                    .join(", ")
            )));
        }
    }
    deployed
        .iter()
        .map(|known| {
            let node = given
                .iter()
                .find(|node| node.name == known.name)
                .ok_or_else(|| {
                    WordlengthsError(format!(
                        "{file}: node '{}' is missing; add a [[node]] table for it",
                        known.name
                    ))
                })?;
            if node.unit != known.unit {
                return Err(WordlengthsError(format!(
                    "{file}: node '{}': unit \"{}\", but the firmware has \"{}\"",
                    node.name, node.unit, known.unit
                )));
            }
            Ok(node.format)
        })
        .collect()
}

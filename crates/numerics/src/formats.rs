//! The formats of a run: per node one, or none for a node that stays real.

use cardan_datapath::wordlengths::{self, WordlengthsError};
use cardan_datapath::{Format, NodeInfo};

/// Bits of the widest exact intermediate.
const INTERMEDIATE_BITS: i32 = 128;

/// Longest word, and most fractional bits.
const LONGEST_WORD: u32 = 64;

/// Why formats were refused. Nodes are given by their names where these are known, else by number.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FormatsError {
    /// The word-length file was refused.
    #[error(transparent)]
    File(#[from] WordlengthsError),
    /// As many formats as nodes are needed.
    #[error("{formats} formats for {nodes} nodes: give one (or none) for each node in order")]
    Count {
        /// Number of nodes.
        nodes: usize,
        /// Number of formats given.
        formats: usize,
    },
    /// Outside what a word may be.
    #[error(
        "node '{node}': word = {word}, frac = {frac}: expected a word of 1 to 64 bits and 0 to 64 fractional bits"
    )]
    Range {
        /// The node.
        node: String,
        /// Its word length in bits.
        word: u32,
        /// Its fractional bits.
        frac: u32,
    },
    /// A sum of the two nodes would not fit the widest intermediate.
    #[error(
        "nodes '{coarse}' ({integer} integer bits) and '{fine}' ({frac} fractional bits): their sum \
         needs {bits} bits, at most 128 are computed with; narrow one of them"
    )]
    Span {
        /// The node with the most integer bits.
        coarse: String,
        /// Its integer bits with the sign.
        integer: i32,
        /// The node with the most fractional bits.
        fine: String,
        /// Its fractional bits.
        frac: u32,
        /// Bits that their sum needs, with the carry and one for rounding.
        bits: i32,
    },
}

/// Per node, in the order of the node table, its format or `None` (real, never rounded).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Formats(Vec<Option<Format>>);

impl Formats {
    /// Any mixture.
    ///
    /// # Errors
    /// Not one entry per node, or formats that cannot be computed with exactly.
    pub fn new(nodes: &[NodeInfo], formats: Vec<Option<Format>>) -> Result<Self, FormatsError> {
        if formats.len() != nodes.len() {
            return Err(FormatsError::Count {
                nodes: nodes.len(),
                formats: formats.len(),
            });
        }
        check(nodes, &formats)?;
        Ok(Self(formats))
    }

    /// The formats that the node table carries.
    ///
    /// # Errors
    /// Formats that cannot be computed with exactly.
    pub fn deployed(nodes: &[NodeInfo]) -> Result<Self, FormatsError> {
        Self::new(nodes, nodes.iter().map(|node| Some(node.format)).collect())
    }

    /// The formats in the text of word-length file `file`, in the order of `nodes`.
    ///
    /// # Errors
    /// A file that is refused, or does not have exactly the nodes of `nodes`.
    pub fn from_wordlengths(
        text: &str,
        file: &str,
        nodes: &[NodeInfo],
    ) -> Result<Self, FormatsError> {
        let declared = wordlengths::parse(text, file)?;
        let formats = wordlengths::align(&declared, nodes, file)?;
        Self::new(nodes, formats.into_iter().map(Some).collect())
    }

    /// `nodes` real nodes.
    #[must_use]
    pub fn real(nodes: usize) -> Self {
        Self(vec![None; nodes])
    }

    /// The first `count` nodes as they are, the others real.
    #[must_use]
    pub fn prefix(&self, count: usize) -> Self {
        let kept = |(index, format): (usize, &Option<Format>)| format.filter(|_| index < count);
        Self(self.0.iter().enumerate().map(kept).collect())
    }

    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// True for an algorithm without nodes.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Per node its format or `None`.
    #[must_use]
    pub fn as_slice(&self) -> &[Option<Format>] {
        &self.0
    }

    /// The node table with these formats in place of the deployed ones, for
    /// [`cardan_datapath::table_hash`]; `None` if a node is real.
    #[must_use]
    pub fn table(&self, nodes: &[NodeInfo]) -> Option<Vec<NodeInfo>> {
        let row = |(node, format): (&NodeInfo, &Option<Format>)| {
            format.map(|format| NodeInfo { format, ..*node })
        };
        nodes.iter().zip(&self.0).map(row).collect()
    }
}

/// Every operation on the formats can be computed exactly.
fn check(nodes: &[NodeInfo], formats: &[Option<Format>]) -> Result<(), FormatsError> {
    let quantised = || {
        nodes
            .iter()
            .zip(formats)
            .filter_map(|(node, format)| format.map(|format| (node.name, format)))
    };
    for (name, format) in quantised() {
        if !(1..=LONGEST_WORD).contains(&format.word) || format.frac > LONGEST_WORD {
            return Err(FormatsError::Range {
                node: name.to_string(),
                word: format.word,
                frac: format.frac,
            });
        }
    }
    let integer = |format: Format| format.word.cast_signed() - format.frac.cast_signed();
    let coarse = quantised().max_by_key(|(_, format)| integer(*format));
    let fine = quantised().max_by_key(|(_, format)| format.frac);
    if let (Some((coarse, wide)), Some((fine, deep))) = (coarse, fine) {
        let bits = integer(wide) + deep.frac.cast_signed() + 2;
        if bits > INTERMEDIATE_BITS {
            return Err(FormatsError::Span {
                coarse: coarse.to_string(),
                integer: integer(wide),
                fine: fine.to_string(),
                frac: deep.frac,
                bits,
            });
        }
    }
    Ok(())
}

//! Fixed-point formats as values: word length, fractional bits, rounding and overflow of a node.

/// What happens to bits under the last place.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Rounding {
    /// Toward minus infinity: bits are dropped. Costs nothing in hardware or firmware.
    Floor = 0,
    /// Toward plus infinity.
    Ceil = 1,
    /// Toward zero.
    Zero = 2,
    /// To nearest, ties toward plus infinity.
    NearestUp = 3,
    /// To nearest, ties away from zero.
    NearestAway = 4,
    /// To nearest, ties to the even neighbour.
    NearestEven = 5,
}

/// What happens to values outside the word.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum Overflow {
    /// Modulo two to the word length; right for angles.
    Wrap = 0,
    /// To the nearest representable value.
    Saturate = 1,
    /// As saturate, and the run is an error: the node and its first occurrence are reported.
    Trap = 2,
}

impl Rounding {
    /// All modes with their names in word-length files.
    pub const ALL: [(Rounding, &'static str); 6] = [
        (Rounding::Floor, "floor"),
        (Rounding::Ceil, "ceil"),
        (Rounding::Zero, "zero"),
        (Rounding::NearestUp, "nearest_up"),
        (Rounding::NearestAway, "nearest_away"),
        (Rounding::NearestEven, "nearest_even"),
    ];

    /// The name in word-length files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

impl Overflow {
    /// All modes with their names in word-length files.
    pub const ALL: [(Overflow, &'static str); 3] = [
        (Overflow::Wrap, "wrap"),
        (Overflow::Saturate, "saturate"),
        (Overflow::Trap, "trap"),
    ];

    /// The name in word-length files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        Self::ALL[self as usize].1
    }
}

/// A signed two's complement format: the value is raw / 2^frac, raw in `word` bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Format {
    /// Word length in bits with the sign, 1..=64.
    pub word: u32,
    /// Fractional bits.
    pub frac: u32,
    /// Rounding when a value enters the node.
    pub rounding: Rounding,
    /// Overflow when a value enters the node.
    pub overflow: Overflow,
}

impl Format {
    /// A format of `word` bits, `frac` of them fractional.
    #[must_use]
    pub const fn new(word: u32, frac: u32, rounding: Rounding, overflow: Overflow) -> Self {
        assert!(word >= 1 && word <= 64, "a word length is 1..=64 bits");
        Self {
            word,
            frac,
            rounding,
            overflow,
        }
    }

    /// Largest raw value.
    #[must_use]
    pub const fn max_raw(self) -> i64 {
        ((1i128 << (self.word - 1)) - 1) as i64
    }

    /// Smallest raw value.
    #[must_use]
    pub const fn min_raw(self) -> i64 {
        (-(1i128 << (self.word - 1))) as i64
    }

    /// Weight of the last place: 2^-frac.
    #[must_use]
    pub const fn lsb(self) -> f64 {
        let mut lsb = 1.0;
        let mut bit = 0;
        while bit < self.frac {
            lsb /= 2.0;
            bit += 1;
        }
        lsb
    }

    /// A raw value as a real number (exact up to 53 bits).
    #[must_use]
    pub const fn real(self, raw: i64) -> f64 {
        raw as f64 * self.lsb()
    }

    /// The raw word nearest to `value` (ties away from zero), saturated: constants and coefficients,
    /// evaluated at compile time so that no floating point reaches the target.
    #[must_use]
    pub const fn constant(self, value: f64) -> i64 {
        let scaled = value / self.lsb();
        // Truncation and the rest are exact; adding one half to `scaled` would not be.
        let whole = scaled as i64;
        let rest = scaled - whole as f64;
        let nearest = if rest >= 0.5 {
            whole.saturating_add(1)
        } else if rest <= -0.5 {
            whole.saturating_sub(1)
        } else {
            whole
        };
        if nearest > self.max_raw() {
            self.max_raw()
        } else if nearest < self.min_raw() {
            self.min_raw()
        } else {
            nearest
        }
    }
}

/// Name, unit and format of a node: a row of the table that an image carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeInfo {
    /// Name.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// What it is, in one line; empty where the word-length file does not say.
    pub meaning: &'static str,
    /// Deployed format.
    pub format: Format,
}

/// FNV-1a over names and formats in order: two images with the same hash compute in the same
/// formats.
#[must_use]
pub const fn table_hash(nodes: &[NodeInfo]) -> u64 {
    let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
    let mut index = 0;
    while index < nodes.len() {
        let node = &nodes[index];
        hash = fnv1a(hash, node.name.as_bytes());
        let f = node.format;
        hash = fnv1a(
            hash,
            &[
                0,
                f.word as u8,
                f.frac as u8,
                f.rounding as u8,
                f.overflow as u8,
                0xff,
            ],
        );
        index += 1;
    }
    hash
}

/// Bytes of the format table of so many nodes.
#[must_use]
pub const fn format_table_len(nodes: usize) -> usize {
    FORMAT_TABLE_HEADER + 4 * nodes
}

/// Bytes of a format table before the first node: hash and count.
const FORMAT_TABLE_HEADER: usize = 10;

/// The format table that an image carries, little-endian: [`table_hash`] (8 bytes), number of nodes
/// (2), then word length, fractional bits, rounding and overflow of each. `LEN` is
/// [`format_table_len`] of their number.
#[must_use]
pub const fn format_table<const LEN: usize>(nodes: &[NodeInfo]) -> [u8; LEN] {
    assert!(
        LEN == format_table_len(nodes.len()),
        "LEN is format_table_len"
    );
    let mut table = [0; LEN];
    let (hash, count) = (
        table_hash(nodes).to_le_bytes(),
        (nodes.len() as u16).to_le_bytes(),
    );
    let mut index = 0;
    while index < FORMAT_TABLE_HEADER {
        table[index] = if index < 8 {
            hash[index]
        } else {
            count[index - 8]
        };
        index += 1;
    }
    let mut node = 0;
    while node < nodes.len() {
        let f = nodes[node].format;
        let at = format_table_len(node);
        table[at] = f.word as u8;
        table[at + 1] = f.frac as u8;
        table[at + 2] = f.rounding as u8;
        table[at + 3] = f.overflow as u8;
        node += 1;
    }
    table
}

const fn fnv1a(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut index = 0;
    while index < bytes.len() {
        hash = (hash ^ bytes[index] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        index += 1;
    }
    hash
}

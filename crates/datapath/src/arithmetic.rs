//! The seam: one algorithm, many arithmetics.

use crate::Format;
use crate::container::Container;

/// A named intermediate value of an algorithm. Usually generated from a word-length file.
pub trait Node: Copy + 'static {
    /// Position in the algorithm's node table.
    const INDEX: usize;
    /// Name in reports, word-length files and taps.
    const NAME: &'static str;
    /// Unit of the value.
    const UNIT: &'static str;
    /// Deployed format.
    const FORMAT: Format;
    /// The `fixed` type of the deployed format; its container is the smallest of 8, 16, 32, 64 bits
    /// that holds the word.
    type Word: fixed::traits::Fixed<Bits: Container> + Copy;
}

/// A value of node `N` in arithmetic `M`. The wrapper lets the compiler infer nodes from arguments.
pub struct Value<M: Arithmetic + ?Sized, N: Node>(pub(crate) M::Word<N>);

impl<M: Arithmetic + ?Sized, N: Node> Value<M, N> {
    /// Wraps an arithmetic's own representation.
    pub const fn new(word: M::Word<N>) -> Self {
        Self(word)
    }

    /// The arithmetic's own representation.
    pub const fn word(self) -> M::Word<N> {
        self.0
    }
}

impl<M: Arithmetic + ?Sized, N: Node> Clone for Value<M, N> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<M: Arithmetic + ?Sized, N: Node> Copy for Value<M, N> {}

/// A real constant of an algorithm; quantised at compile time into the node that uses it.
pub trait Constant {
    /// The exact value.
    const VALUE: f64;
}

/// A table of real constants (coefficients, CORDIC angles).
pub trait Table {
    /// The exact values.
    const VALUES: &'static [f64];
}

/// What an algorithm may do with values. Every operation writes its result node: it computes
/// exactly, then rounds and limits to the node's format (in arithmetics that have formats), and the
/// arithmetic may record the write. Every operation is total.
///
/// An algorithm branches only through [`Arithmetic::select`] and loops a fixed number of times, so
/// that bounds and batches of candidates can follow the same path.
pub trait Arithmetic {
    /// Representation of a value of node `N`.
    type Word<N: Node>: Copy;
    /// Result of a comparison.
    type Bool: Copy;

    /// A number from outside: raw / 2^F.
    fn input<N: Node, const F: u32>(&self, raw: i32) -> Value<Self, N>;
    /// A setting from outside, raw / 2^F. Not recorded: it stays for the run.
    fn parameter<N: Node, const F: u32>(&self, raw: i32) -> Value<Self, N>;
    /// A constant. Not recorded: it never changes.
    fn constant<N: Node, C: Constant>(&self) -> Value<Self, N>;
    /// Entry `index` of a table, the last one if it is too large. Not recorded.
    fn entry<N: Node, T: Table>(&self, index: usize) -> Value<Self, N>;
    /// The table entry at the integer part (floor) of `index`, limited to the table.
    fn lookup<N: Node, I: Node, T: Table>(&self, index: Value<Self, I>) -> Value<Self, N>;

    /// a + b.
    fn add<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N>;
    /// a - b.
    fn sub<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N>;
    /// a * b.
    fn mul<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N>;
    /// a / b; a zero divisor gives the end of the range on a's side and raises the domain status.
    fn div<N: Node, A: Node, B: Node>(
        &self,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N>;
    /// Square root; a negative argument gives 0 and raises the domain status.
    fn sqrt<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N>;
    /// a * 2^POWER.
    fn shift<N: Node, A: Node, const POWER: i32>(&self, a: Value<Self, A>) -> Value<Self, N>;
    /// a * 2^power, where the power is known when the algorithm starts and stays. It is limited to
    /// LEAST..=MOST, from which the intermediate is chosen.
    fn scale<N: Node, A: Node, const LEAST: i32, const MOST: i32>(
        &self,
        a: Value<Self, A>,
        power: i32,
    ) -> Value<Self, N>;
    /// -a.
    fn neg<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N>;
    /// |a|.
    fn abs<N: Node, A: Node>(&self, a: Value<Self, A>) -> Value<Self, N>;

    /// a < b, exactly.
    fn less<A: Node, B: Node>(&self, a: Value<Self, A>, b: Value<Self, B>) -> Self::Bool;
    /// a < 0.
    fn negative<A: Node>(&self, a: Value<Self, A>) -> Self::Bool;
    /// A truth value known beforehand.
    fn truth(&self, value: bool) -> Self::Bool;
    /// Not a.
    fn not(&self, a: Self::Bool) -> Self::Bool;
    /// a or b.
    fn or(&self, a: Self::Bool, b: Self::Bool) -> Self::Bool;
    /// Exactly one of a and b.
    fn xor(&self, a: Self::Bool, b: Self::Bool) -> Self::Bool;
    /// a if `condition`, else b.
    fn either(&self, condition: Self::Bool, a: Self::Bool, b: Self::Bool) -> Self::Bool;
    /// a if `condition`, else b.
    fn select<N: Node, A: Node, B: Node>(
        &self,
        condition: Self::Bool,
        a: Value<Self, A>,
        b: Value<Self, B>,
    ) -> Value<Self, N>;

    /// Sets the status bits `flags` if `condition` holds (or may hold).
    fn raise(&self, flags: u16, condition: Self::Bool);
    /// The status bits raised since the last call.
    fn take_status(&self) -> u16;
}

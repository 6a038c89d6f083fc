//! Tables of constants as words.

use crate::{Format, Node, Table};

/// A table quantised into a node's format at compile time.
pub(crate) struct Quantised<N: Node, C: Table>(core::marker::PhantomData<(N, C)>);

/// Longest table.
const TABLE_LEN: usize = 64;

impl<N: Node, C: Table> Quantised<N, C> {
    /// The words, the unused ones 0.
    pub(crate) const RAW: [i64; TABLE_LEN] = {
        assert!(
            C::VALUES.len() <= TABLE_LEN && !C::VALUES.is_empty(),
            "tables hold 1..=64 values"
        );
        let format: Format = N::FORMAT;
        let mut raw = [0; TABLE_LEN];
        let mut index = 0;
        while index < C::VALUES.len() {
            raw[index] = format.constant(C::VALUES[index]);
            index += 1;
        }
        raw
    };
}

//! What the deployed arithmetic shows of itself.

/// Sees every write of a node. The silent one vanishes at compile time.
pub trait Tap {
    /// Whether [`Tap::overflow`] matters. Without it 16-bit words take faster kernels.
    const SEES_OVERFLOWS: bool = true;

    /// Node `index` takes the raw word `raw`.
    fn write(&self, index: usize, raw: i64);
    /// The value did not fit node `index`'s word.
    fn overflow(&self, index: usize);
}

/// No observation: plain firmware.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Tap for Silent {
    const SEES_OVERFLOWS: bool = false;

    #[inline(always)]
    fn write(&self, _index: usize, _raw: i64) {}
    #[inline(always)]
    fn overflow(&self, _index: usize) {}
}

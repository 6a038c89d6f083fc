//! Taps and the format table: how an image tells what it computes (layout: `cardan_spec::taps`).

use core::cell::RefCell;

use cardan_datapath::Tap;
use cardan_firmware::nodes::FORMAT_TABLE;
#[cfg(feature = "taps")]
use cardan_firmware::nodes::NODE_COUNT;

use crate::output::Output;

/// Publishes node values in tapped builds, nothing in plain ones.
#[derive(Clone, Copy)]
pub struct BoardTap<'a> {
    #[cfg_attr(not(feature = "taps"), expect(dead_code, reason = "no taps"))]
    output: &'a RefCell<Output>,
}

impl<'a> BoardTap<'a> {
    /// Publishes into `output`.
    pub fn new(output: &'a RefCell<Output>) -> Self {
        Self { output }
    }
}

/// The last word of every node, for a debugger.
#[cfg(feature = "taps")]
#[unsafe(no_mangle)]
static CARDAN_TAPS: [core::sync::atomic::AtomicI32; NODE_COUNT] =
    [const { core::sync::atomic::AtomicI32::new(0) }; NODE_COUNT];

impl Tap for BoardTap<'_> {
    const SEES_OVERFLOWS: bool = false;

    #[cfg(feature = "taps")]
    fn write(&self, index: usize, raw: i64) {
        let raw = raw as i32;
        if let Some(slot) = CARDAN_TAPS.get(index) {
            slot.store(raw, core::sync::atomic::Ordering::Relaxed);
        }
        self.output.borrow_mut().node(index, raw);
    }

    #[cfg(not(feature = "taps"))]
    #[inline(always)]
    fn write(&self, _index: usize, _raw: i64) {}

    #[inline(always)]
    fn overflow(&self, _index: usize) {}
}

/// How an image tells its formats.
#[used]
#[unsafe(no_mangle)]
static CARDAN_FORMATS: [u8; FORMAT_TABLE.len()] = FORMAT_TABLE;

//! Taps and the format table: how an image tells what it computes (layout: `cardan_spec::taps`).

use core::cell::RefCell;

use cardan_datapath::Tap;
use cardan_firmware::nodes::{NODE_COUNT, NODES};

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

const HEADER: usize = 10;

/// Hash, number of nodes, and per node word length, fractional bits, rounding, overflow.
#[used]
#[unsafe(no_mangle)]
static CARDAN_FORMATS: [u8; HEADER + 4 * NODE_COUNT] = {
    let mut table = [0; HEADER + 4 * NODE_COUNT];
    let hash = cardan_firmware::FORMATS_HASH.to_le_bytes();
    let mut index = 0;
    while index < 8 {
        table[index] = hash[index];
        index += 1;
    }
    table[8] = NODE_COUNT as u8;
    table[9] = (NODE_COUNT >> 8) as u8;
    let mut node = 0;
    while node < NODE_COUNT {
        let format = NODES[node].format;
        let at = HEADER + 4 * node;
        table[at] = format.word as u8;
        table[at + 1] = format.frac as u8;
        table[at + 2] = format.rounding as u8;
        table[at + 3] = format.overflow as u8;
        node += 1;
    }
    table
};

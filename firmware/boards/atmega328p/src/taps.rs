//! Taps and the format table: how an image tells what it computes (layout: `cardan_spec::taps`).

use cardan_datapath::{Deployed, Tap};
use cardan_firmware::nodes::{NODE_COUNT, NODES};

/// The arithmetic of the sample interrupt.
pub const ARITHMETIC: Deployed<BoardTap> = Deployed::new(BoardTap);

/// Publishes node values in tapped builds, nothing in plain ones.
#[derive(Clone, Copy)]
pub struct BoardTap;

#[cfg(feature = "taps")]
#[unsafe(no_mangle)]
static mut CARDAN_TAPS: [i32; NODE_COUNT] = [0; NODE_COUNT];

impl Tap for BoardTap {
    const SEES_OVERFLOWS: bool = false;

    #[cfg(feature = "taps")]
    #[inline(always)]
    fn write(&self, index: usize, raw: i64) {
        // SAFETY: every node has a slot of its own and is written either by the interrupt or by the
        // main loop, never by both; GPIOR0 belongs to the taps.
        unsafe {
            let slot = (&raw mut CARDAN_TAPS).cast::<i32>().add(index);
            slot.write_volatile(raw as i32);
            (0x3e as *mut u8).write_volatile(index as u8);
        }
    }

    #[cfg(not(feature = "taps"))]
    #[inline(always)]
    fn write(&self, _index: usize, _raw: i64) {}

    #[inline(always)]
    fn overflow(&self, _index: usize) {}
}

const HEADER: usize = 10;

/// Hash, number of nodes, and per node word length, fractional bits, rounding, overflow; in flash.
#[used]
#[unsafe(no_mangle)]
#[unsafe(link_section = ".progmem.data.cardan")]
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

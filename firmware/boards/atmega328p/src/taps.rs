//! Taps and the format table: how an image tells what it computes (layout: `cardan_spec::taps`).

use cardan_datapath::{Deployed, Tap};
use cardan_firmware::nodes::FORMAT_TABLE;
#[cfg(feature = "taps")]
use cardan_firmware::nodes::NODE_COUNT;

cardan_firmware::format_section!(FORMAT_TABLE);

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

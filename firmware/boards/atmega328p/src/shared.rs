//! What the sample interrupt and the main loop share.

use core::mem::MaybeUninit;

use cardan_datapath::Deployed;
use cardan_firmware::averaging::{Averager, Sums};
use cardan_spec::timing::Averaging;

use crate::taps::{ARITHMETIC, BoardTap};

type Arithmetic = Deployed<BoardTap>;

static mut AVERAGER: MaybeUninit<Averager<Arithmetic>> = MaybeUninit::uninit();

/// Call once, before interrupts are enabled.
pub fn initialise(averaging: Averaging) {
    // SAFETY: no interrupt is enabled yet, and the main function calls this once.
    unsafe { (*(&raw mut AVERAGER)).write(Averager::new(&ARITHMETIC, averaging)) };
}

/// The averager.
///
/// # Safety
/// Only after [`initialise`], and only one view at a time: the ADC interrupt's (interrupts do not
/// nest), or the main loop's with interrupts disabled.
#[inline(always)]
pub unsafe fn averager() -> &'static mut Averager<Arithmetic> {
    unsafe { (*(&raw mut AVERAGER)).assume_init_mut() }
}

/// Sleeps until a block's sums are complete and takes them.
pub fn wait() -> Sums<Arithmetic> {
    loop {
        avr_device::interrupt::disable();
        // SAFETY: interrupts are disabled, so this is the only view.
        let taken = unsafe { averager() }.take(&ARITHMETIC);
        // SAFETY: the view is not used below. SEI lets one more instruction run: SLEEP, before any
        // interrupt is taken.
        unsafe { avr_device::interrupt::enable() };
        match taken {
            Some(taken) => return taken,
            None => avr_device::asm::sleep(),
        }
    }
}

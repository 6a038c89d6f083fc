//! What the sample interrupt and the main loop share.

use core::mem::MaybeUninit;

use cardan_datapath::Deployed;
use cardan_firmware::averaging::{Averager, Sums};

use crate::taps::{ARITHMETIC, BoardTap};

type Arithmetic = Deployed<BoardTap>;

/// State of the sample interrupt, and its mailbox to the main loop.
pub struct Shared {
    averager: Averager<Arithmetic>,
    sums: Sums<Arithmetic>,
    full: bool,
    late: bool,
}

static mut SHARED: MaybeUninit<Shared> = MaybeUninit::uninit();

impl Shared {
    /// Call once, before interrupts are enabled.
    pub fn initialise() {
        let shared = Shared {
            averager: Averager::new(&ARITHMETIC),
            sums: Sums::zero(&ARITHMETIC),
            full: false,
            late: false,
        };
        // SAFETY: no interrupt is enabled yet, and the main function calls this once.
        unsafe { (*(&raw mut SHARED)).write(shared) };
    }

    /// The interrupt's view.
    ///
    /// # Safety
    /// Only from the ADC interrupt, after [`Shared::initialise`]: interrupts do not nest, and the
    /// main loop takes its view with interrupts disabled only.
    #[inline(always)]
    pub unsafe fn from_interrupt() -> &'static mut Shared {
        unsafe { (*(&raw mut SHARED)).assume_init_mut() }
    }

    #[inline(always)]
    pub fn averager(&mut self) -> &mut Averager<Arithmetic> {
        &mut self.averager
    }

    /// Posts finished sums; a mailbox that is still full means that the main loop is late.
    #[inline(always)]
    pub fn publish(&mut self, sums: Option<Sums<Arithmetic>>, late: bool) {
        self.late |= late;
        if let Some(sums) = sums {
            self.late |= self.full;
            self.sums = sums;
            self.full = true;
        }
    }

    /// Sleeps until sums are posted and takes them.
    pub fn wait() -> (Sums<Arithmetic>, bool) {
        loop {
            avr_device::interrupt::disable();
            // SAFETY: interrupts are disabled, so this is the only view.
            let shared = unsafe { (*(&raw mut SHARED)).assume_init_mut() };
            if shared.full {
                shared.full = false;
                let taken = (shared.sums, core::mem::take(&mut shared.late));
                // SAFETY: the view is not used below.
                unsafe { avr_device::interrupt::enable() };
                return taken;
            }
            // SEI lets one more instruction run: SLEEP, before any interrupt is taken.
            // SAFETY: as above.
            unsafe { avr_device::interrupt::enable() };
            avr_device::asm::sleep();
        }
    }
}

//! The converter, triggered by Timer1 compare match B.

use avr_device::atmega328p::{ADC, TC1};
use cardan_firmware::hal::TriggeredAdc;
use cardan_spec::timing;
use cardan_units::AdcCode;

/// Reference AVCC, right adjusted: REFS = 01.
const REFERENCE_AVCC: u8 = 1 << 6;

/// Half the Timer1 counts at which the trigger is re-armed too late: a conversion ends 231 counts
/// after its match (1731 cycles = 3 periods and 231), and the next match that may trigger follows at
/// count 249 of the next period. A count after it, and before the period in which the interrupt
/// should have come, means that it has passed. (Halves fit one byte.)
const PASSED_HALVES: core::ops::Range<u8> = (timing::STROBE_COUNT as u8 + 1) / 2..240;

/// Enables the converter on channel 0; Timer1 compare match B triggers. The first conversion takes
/// 25 clocks instead of 13.5; it lies in the warm-up.
pub fn initialise(adc: &ADC) {
    adc.admux().write(|w| unsafe { w.bits(REFERENCE_AVCC) });
    // Digital input buffers off on the analog pins, a third tilt axis's among them.
    adc.didr0().write(|w| unsafe { w.bits(0x1f) });
    adc.adcsrb().write(|w| w.adts().set(0b101));
    adc.adcsra().write(|w| {
        w.aden().set_bit().adate().set_bit().adie().set_bit().adps().prescaler_128()
    });
}

/// The converter as its interrupt sees it.
pub struct TimerTriggeredAdc {
    adc: ADC,
    timer: TC1,
}

impl TimerTriggeredAdc {
    #[inline(always)]
    pub fn from_interrupt() -> Self {
        // SAFETY: only the ADC interrupt touches ADC data, ADMUX, TIFR1 and TCNT1 after start-up.
        unsafe { Self { adc: ADC::steal(), timer: TC1::steal() } }
    }
}

impl TriggeredAdc for TimerTriggeredAdc {
    #[inline(always)]
    fn result(&mut self) -> AdcCode {
        AdcCode(self.adc.adc().read().bits())
    }

    #[inline(always)]
    fn select(&mut self, channel: u8) {
        self.adc.admux().write(|w| unsafe { w.bits(REFERENCE_AVCC | channel) });
    }

    #[inline(always)]
    fn rearm(&mut self) -> bool {
        self.timer.tifr1().write(|w| w.ocf1b().set_bit());
        !PASSED_HALVES.contains(&((self.timer.tcnt1().read().bits() >> 1) as u8))
    }
}

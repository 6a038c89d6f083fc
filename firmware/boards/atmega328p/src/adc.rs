//! The converter, triggered by Timer1 compare match B.

use avr_device::atmega328p::{ADC, Peripherals};
use cardan_firmware::hal::TriggeredAdc;
use cardan_spec::timing;
use cardan_units::AdcCode;

/// Reference AVCC, right adjusted: REFS = 01.
const REFERENCE_AVCC: u8 = 1 << 6;

/// Timer1 counts at which the trigger is re-armed in time: a conversion ends 231 counts after its
/// match (1731 cycles = 3 periods and 231), and the next match that may trigger follows at count
/// 249 of the next period. A count in between means that it has passed.
const PASSED: core::ops::Range<u16> = timing::STROBE_COUNT + 1..480;

/// Enables the converter on channel 0; Timer1 compare match B triggers. The first conversion takes
/// 25 clocks instead of 13.5; it lies in the warm-up.
pub fn initialise(adc: &ADC) {
    adc.admux().write(|w| unsafe { w.bits(REFERENCE_AVCC) });
    // Digital input buffers off on the four analog pins.
    adc.didr0().write(|w| unsafe { w.bits(0x0f) });
    adc.adcsrb().write(|w| w.adts().set(0b101));
    adc.adcsra().write(|w| {
        w.aden().set_bit().adate().set_bit().adie().set_bit().adps().prescaler_128()
    });
}

/// The converter as its interrupt sees it.
pub struct TimerTriggeredAdc {
    peripherals: Peripherals,
}

impl TimerTriggeredAdc {
    pub fn from_interrupt() -> Self {
        // SAFETY: only the ADC interrupt touches ADC data, ADMUX, TIFR1 and TCNT1 after start-up.
        Self { peripherals: unsafe { Peripherals::steal() } }
    }
}

impl TriggeredAdc for TimerTriggeredAdc {
    #[inline(always)]
    fn result(&mut self) -> AdcCode {
        AdcCode(self.peripherals.ADC.adc().read().bits())
    }

    #[inline(always)]
    fn select(&mut self, channel: u8) {
        self.peripherals.ADC.admux().write(|w| unsafe { w.bits(REFERENCE_AVCC | channel) });
    }

    #[inline(always)]
    fn rearm(&mut self) -> bool {
        let timer = &self.peripherals.TC1;
        timer.tifr1().write(|w| w.ocf1b().set_bit());
        !PASSED.contains(&timer.tcnt1().read().bits())
    }
}

//! The design's schedule, by which the emulated pins, conversions and bytes are checked to the
//! cycle: a wrong phase shows in no node, because native works on the codes that it caused.

use cardan_spec::timing::{
    ADC_HOLD_CYCLES, BYTE_CYCLES, CARRIER_COUNT, HALF_CARRIER_CYCLES, STROBE_COUNT,
};

/// The strobe follows the carrier by a quarter period: counts from CARRIER_COUNT's match, at which
/// the timer starts over, to STROBE_COUNT's.
const STROBE_LAG_CYCLES: u64 =
    HALF_CARRIER_CYCLES - 1 - CARRIER_COUNT as u64 + STROBE_COUNT as u64 + 1;

/// Watches for deviations.
#[derive(Debug, Default)]
pub(super) struct Schedule {
    carrier: Option<u64>,
    strobe: Option<u64>,
    byte: Option<u64>,
    violations: u64,
    first: Option<String>,
}

impl Schedule {
    /// An edge of the carrier: half a period after its predecessor.
    pub(super) fn carrier(&mut self, cycle: u64) {
        let last = self.carrier.replace(cycle);
        self.expect(
            "carrier edge",
            cycle,
            last.map(|last| last + HALF_CARRIER_CYCLES),
        );
    }

    /// An edge of the strobe: a quarter period after the carrier's, half one after its predecessor.
    pub(super) fn strobe(&mut self, cycle: u64) {
        let expected = match (self.carrier, self.strobe.replace(cycle)) {
            (Some(carrier), _) => Some(carrier + STROBE_LAG_CYCLES),
            (None, Some(last)) => Some(last + HALF_CARRIER_CYCLES),
            (None, None) => None,
        };
        self.expect("strobe edge", cycle, expected);
    }

    /// The converter holds: a fixed time after the strobe edge that triggered it.
    pub(super) fn hold(&mut self, cycle: u64) {
        let expected = self.strobe.map(|strobe| strobe + ADC_HOLD_CYCLES);
        // A conversion without any strobe is off the schedule as well.
        self.expect("hold instant", cycle, Some(expected.unwrap_or(0)));
    }

    /// A byte left the serial line: a byte's time after its predecessor in the message.
    pub(super) fn byte(&mut self, cycle: u64, first: bool) {
        let last = self.byte.replace(cycle);
        self.expect(
            "serial byte",
            cycle,
            last.filter(|_| !first).map(|last| last + BYTE_CYCLES),
        );
    }

    /// How often the device left the schedule.
    pub(super) fn violations(&self) -> u64 {
        self.violations
    }

    /// The first time.
    pub(super) fn first_violation(&self) -> Option<String> {
        self.first.clone()
    }

    fn expect(&mut self, what: &str, cycle: u64, expected: Option<u64>) {
        let Some(expected) = expected.filter(|&expected| expected != cycle) else {
            return;
        };
        self.violations += 1;
        self.first
            .get_or_insert_with(|| format!("{what} at cycle {cycle}, due at {expected}"));
    }
}

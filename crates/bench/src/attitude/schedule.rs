//! The design's schedule, by which the emulated pins, conversions and bytes are checked to the
//! cycle: a wrong phase shows in no node, because native works on the codes that it caused.

use std::collections::VecDeque;

use cardan_emulator::Pin;
use cardan_spec::timing::{
    ADC_HOLD_CYCLES, BYTE_CYCLES, CARRIER_COUNT, CPU_HZ, HALF_CARRIER_CYCLES, MOST_SEND_LAG_CYCLES,
    MOST_TURN_LAG_CYCLES, SETTLING_CYCLES, STROBE_COUNT, TURN_CYCLES,
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
    /// The multiplexer's last switching; before the first, the carrier's first edge.
    turn: Option<u64>,
    settled: Option<u64>,
    /// Levels of select and settled.
    levels: [bool; 2],
    byte: Option<u64>,
    /// Ends of solutions whose messages have not begun.
    solved: VecDeque<u64>,
    violations: u64,
    first: Option<String>,
}

impl Schedule {
    /// An edge of the carrier: half a period after its predecessor.
    pub(super) fn carrier(&mut self, cycle: u64) {
        let last = self.carrier.replace(cycle);
        self.turn.get_or_insert(cycle);
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

    /// The multiplexer switches: with an edge of the carrier or little later, a turn after the last
    /// time, and a fixed time after it was told that the band-pass has settled.
    pub(super) fn select(&mut self, cycle: u64, level: bool) {
        let lag = self.carrier.map(|carrier| cycle - carrier);
        if lag.is_none_or(|lag| lag % HALF_CARRIER_CYCLES > MOST_TURN_LAG_CYCLES) {
            self.violate(format!(
                "select edge at cycle {cycle}, due at most {MOST_TURN_LAG_CYCLES} cycles after the \
                 carrier's"
            ));
        }
        let settled = self
            .settled
            .map_or(0, |at| at + TURN_CYCLES - SETTLING_CYCLES);
        self.expect("select edge", cycle, Some(settled));
        self.turn = Some(cycle);
        self.levels[0] = level;
    }

    /// The band-pass has settled to the selected channel: a fixed time after the select edge. The first
    /// one comes before any, so the next select edge is held against it. From here the pins differ.
    pub(super) fn settled(&mut self, cycle: u64, level: bool) {
        let first = self.settled.is_none();
        let expected = self
            .turn
            .filter(|_| !first)
            .map(|turn| turn + SETTLING_CYCLES);
        self.expect("settled edge", cycle, expected);
        self.settled = Some(cycle);
        self.levels[1] = level;
        if self.levels[0] == self.levels[1] {
            self.violate(format!(
                "settled edge at cycle {cycle} to the level of select, due to the other one"
            ));
        }
    }

    /// The converter holds: a fixed time after the strobe edge that triggered it. The multiplexer must
    /// have switched within a turn (a carrier edge is the first one's yardstick).
    pub(super) fn hold(&mut self, cycle: u64) {
        let due = self
            .turn
            .map_or(0, |turn| turn + TURN_CYCLES + MOST_TURN_LAG_CYCLES);
        if cycle > due {
            self.violate(format!("no select edge up to cycle {cycle}, due at {due}"));
        }
        let expected = self.strobe.map(|strobe| strobe + ADC_HOLD_CYCLES);
        // A conversion without any strobe is off the schedule as well.
        self.expect("hold instant", cycle, Some(expected.unwrap_or(0)));
    }

    /// A solution is computed: its message begins.
    pub(super) fn solved(&mut self, cycle: u64) {
        self.solved.push_back(cycle);
    }

    /// A byte has left the serial line at `cycle`: the first one of a message soon after its solution was
    /// computed, the others a byte's time after their predecessors.
    pub(super) fn byte(&mut self, cycle: u64, first: bool) {
        let last = self.byte.replace(cycle);
        if !first {
            return self.expect("serial byte", cycle, last.map(|last| last + BYTE_CYCLES));
        }
        match self.solved.pop_front() {
            None => self.violate(format!(
                "message up to cycle {cycle} before its solution was computed"
            )),
            Some(solved) => {
                let due = solved + MOST_SEND_LAG_CYCLES + BYTE_CYCLES;
                if cycle > due {
                    self.violate(format!(
                        "first byte of a message at cycle {cycle}, due at most at {due}: its solution was \
                         computed at {solved}"
                    ));
                }
            }
        }
    }

    /// The processor's clock changes: nothing in the design asks for that.
    pub(super) fn clock(&mut self, cycle: u64, hz: u64) {
        self.violate(format!(
            "the processor's clock changes to {hz} Hz at cycle {cycle}, due: {CPU_HZ} Hz throughout"
        ));
    }

    /// A pin that the design does not use changes.
    pub(super) fn unused(&mut self, cycle: u64, pin: Pin) {
        self.violate(format!(
            "pin {pin} changes at cycle {cycle}, which the design does not use"
        ));
    }

    /// A byte of the settings in the EEPROM is another at the end of the run.
    pub(super) fn settings(&mut self, at: usize) {
        self.violate(format!(
            "byte {at} of the EEPROM has changed by the end of the run, due: the unit's settings as they were"
        ));
    }

    /// A port drives, or pulls up, an analog input.
    pub(super) fn driven(&mut self, cycle: u64, input: &str, by: &str) {
        self.violate(format!(
            "{input} sampled at cycle {cycle} while its port {by}, due: an input"
        ));
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
        self.violate(format!("{what} at cycle {cycle}, due at {expected}"));
    }

    fn violate(&mut self, message: String) {
        self.violations += 1;
        self.first.get_or_insert(message);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cardan_frontend::Pin;
    use cardan_frontend::design::nominal_edges;
    use cardan_frontend::switching::Edge;

    /// Three periods of the multiplexer, with hold instants, each edge changed by `change`.
    fn first_violation(change: impl Fn(Edge) -> Option<Edge>) -> Option<String> {
        let mut schedule = Schedule::default();
        let mut strobes = 0_u64;
        for edge in nominal_edges()
            .take_while(|edge| edge.cycle <= 6 * TURN_CYCLES)
            .filter_map(change)
        {
            match edge.pin {
                Pin::Carrier => schedule.carrier(edge.cycle),
                Pin::Strobe => {
                    schedule.strobe(edge.cycle);
                    strobes += 1;
                }
                Pin::Select => schedule.select(edge.cycle, edge.high),
                Pin::Settled => schedule.settled(edge.cycle, edge.high),
            }
            if edge.pin == Pin::Strobe && strobes.is_multiple_of(4) {
                schedule.hold(edge.cycle + ADC_HOLD_CYCLES);
            }
        }
        assert_eq!(
            schedule.violations() > 0,
            schedule.first_violation().is_some()
        );
        schedule.first_violation()
    }

    fn later(edge: Edge, by: u64) -> Edge {
        let cycle = edge.cycle + by;
        Edge { cycle, ..edge }
    }

    #[test]
    fn the_design_s_edges_keep_the_schedule_also_when_every_turn_lags_as_much_as_it_may() {
        assert_eq!(first_violation(Some), None);
        let lagging = |edge: Edge| match edge.pin {
            Pin::Select | Pin::Settled => Some(later(edge, MOST_TURN_LAG_CYCLES)),
            _ => Some(edge),
        };
        assert_eq!(first_violation(lagging), None);
    }

    #[test]
    fn a_multiplexer_off_its_schedule_is_noticed() {
        let told = |change: &dyn Fn(Edge) -> Option<Edge>, expected: &str| {
            let message = first_violation(change).expect("noticed");
            assert!(message.starts_with(expected), "{expected}: {message}");
        };
        let select = |edge: &Edge| edge.pin == Pin::Select;
        let turns = |edge: &Edge| matches!(edge.pin, Pin::Select | Pin::Settled);
        let once = |edge: Edge| select(&edge) && edge.cycle == 3 * TURN_CYCLES;
        told(
            &|edge| Some(later(edge, u64::from(once(edge)))),
            "select edge at cycle 48001, due at 48000",
        );
        told(
            &|edge| Some(later(edge, if turns(&edge) { 33 } else { 0 })),
            "select edge at cycle 16033, due at most 32 cycles after",
        );
        told(
            &|edge| (!select(&edge)).then_some(edge),
            "no select edge up to cycle 18009, due at 16532",
        );
        let late = |edge: Edge| edge.pin == Pin::Settled && edge.cycle == 28_032;
        told(
            &|edge| Some(later(edge, if late(edge) { 128 } else { 0 })),
            "settled edge at cycle 28160, due at 28032",
        );
        told(
            &|edge| (!turns(&edge)).then_some(edge),
            "no select edge up to cycle",
        );
        told(
            &|edge| (edge.pin != Pin::Settled).then_some(edge),
            "select edge at cycle 16000, due at 0",
        );
        let inverted = |edge: Edge| Edge {
            high: edge.high != (edge.pin == Pin::Settled),
            ..edge
        };
        told(
            &|edge| Some(inverted(edge)),
            "settled edge at cycle 12032 to the level of select",
        );
    }
}

//! The board's switches: what each edge of the controller's pins does to one channel.
//!
//! Wiring. The carrier pin (PB1) high biases the tilt bridges positively and drives the
//! magnetometers' current forwards; low reverses both. Every edge of a channel's strobe pin fires a
//! monostable: a falling edge closes the H+ switch for the aperture, a rising edge the H- switch;
//! another edge of the same sense meanwhile starts the aperture anew. The tilt channels are strobed
//! by PB2, a quarter period after the carrier, where the band-passed bridge signal peaks; the
//! magnetometers by the carrier itself, because a resonator's displacement peaks a quarter period
//! after its force. Falling edges meet the positive peak in both cases, so that a positive specific
//! force or field gives a voltage above mid supply. After reset all pins are low.
//!
//! The tilt channels share a band-pass. PB3 low connects it to the first amplifier of x, high to that
//! of y. PD3 toggles when the band-pass has forgotten the other channel, so the two pins are equal
//! until then and differ for the rest of a turn. The monostables of x run while PB3 is low and PD3
//! high, those of y while it is the other way round (their reset inputs): otherwise no edge closes a
//! switch, and a closed one opens.

use std::collections::VecDeque;

use cardan_spec::Channel;

use crate::chain::{CARRIER_HIGH, CLOSED};
use crate::pattern::Segment;

/// A pin of the controller that drives the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pin {
    /// PB1: bridge bias, drive current, and strobe of the magnetometers' track-and-hold.
    Carrier,
    /// PB2: strobe of the tilt channels' track-and-hold.
    Strobe,
    /// PB3: which tilt channel has the band-pass, low x, high y.
    Select,
    /// PD3: differs from PB3 while the band-pass has settled to the selected channel.
    Settled,
}

/// Number of driven pins.
pub const PINS: usize = 4;

impl Pin {
    /// The pin of that name on the reference board (`PB1`, `PB2`, `PB3`, `PD3`).
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        use cardan_spec::timing::pins;
        [
            (pins::CARRIER, Pin::Carrier),
            (pins::STROBE, Pin::Strobe),
            (pins::SELECT, Pin::Select),
            (pins::SETTLED, Pin::Settled),
        ]
        .into_iter()
        .find_map(|(known, pin)| (known == name).then_some(pin))
    }
}

/// How the board wires a channel's switches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Wiring {
    /// Pin whose edges fire the monostables.
    strobe: Pin,
    /// Level of [`Pin::Select`] that gives this channel the shared band-pass; none if it has its own.
    turn: Option<bool>,
}

impl Wiring {
    /// The wiring of a channel.
    #[must_use]
    pub fn of(channel: Channel) -> Self {
        let (strobe, turn) = match channel {
            Channel::TiltX => (Pin::Strobe, Some(false)),
            Channel::TiltY => (Pin::Strobe, Some(true)),
            Channel::FieldX | Channel::FieldY => (Pin::Carrier, None),
            // Strobed like the others, with a band-pass of its own.
            Channel::TiltZ => (Pin::Strobe, None),
        };
        Self { strobe, turn }
    }

    /// Whether the band-pass is shared.
    #[must_use]
    pub fn shares_band_pass(self) -> bool {
        self.turn.is_some()
    }
}

/// A change of a pin's level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Edge {
    /// Clock cycle at which the new level appears.
    pub cycle: u64,
    /// The pin.
    pub pin: Pin,
    /// The new level.
    pub high: bool,
}

/// Edges not yet seen by every channel.
#[derive(Clone, Debug, Default)]
pub struct EdgeQueue {
    edges: VecDeque<Edge>,
    /// Number of edges already dropped.
    dropped: u64,
}

impl EdgeQueue {
    /// Adds the next edge.
    pub fn push(&mut self, edge: Edge) {
        self.edges.push_back(edge);
    }

    /// Edges waiting.
    #[must_use]
    pub fn waiting(&self) -> usize {
        self.edges.len()
    }

    /// Drops all edges before number `index`.
    pub fn drop_before(&mut self, index: u64) {
        let seen = (index - self.dropped) as usize;
        self.edges.drain(..seen);
        self.dropped = index;
    }

    fn get(&self, index: u64) -> Option<&Edge> {
        self.edges.get((index - self.dropped) as usize)
    }
}

/// No closing is under way.
const OPEN: u64 = u64::MAX;

/// The switches of one channel at one instant.
#[derive(Clone, Debug)]
pub struct Switching {
    wiring: Wiring,
    aperture_cycles: u64,
    now: u64,
    switches: u8,
    /// Levels of [`Pin::Select`] and [`Pin::Settled`].
    select: bool,
    settled: bool,
    /// When each hold switch opens.
    opens: [u64; 2],
    next_edge: u64,
}

impl Switching {
    /// A channel of that wiring, as after reset.
    #[must_use]
    pub fn new(wiring: Wiring, aperture_cycles: u64) -> Self {
        Self {
            wiring,
            aperture_cycles,
            now: 0,
            switches: 0,
            select: false,
            settled: false,
            opens: [OPEN; 2],
            next_edge: 0,
        }
    }

    /// The present cycle.
    #[must_use]
    pub fn now(&self) -> u64 {
        self.now
    }

    /// The present switch set.
    #[must_use]
    pub fn switches(&self) -> u8 {
        self.switches
    }

    /// Number of the next edge that this channel has not seen.
    #[must_use]
    pub fn next_edge(&self) -> u64 {
        self.next_edge
    }

    /// Whether this channel has the band-pass.
    #[must_use]
    pub fn has_band_pass(&self) -> bool {
        self.wiring.turn.is_none_or(|turn| turn == self.select)
    }

    /// Whether the monostables run.
    fn runs(&self) -> bool {
        match self.wiring.turn {
            Some(turn) => self.select == turn && self.settled != turn,
            None => true,
        }
    }

    /// Goes on to cycle `until` and appends the segments passed, events at `until` included.
    pub fn collect(&mut self, until: u64, edges: &EdgeQueue, segments: &mut Vec<Segment>) {
        loop {
            // Twice: an aperture that ends with the edge of the next, and one that an edge ends.
            self.open_due(segments);
            let next_edge = self.take_due(edges);
            self.open_due(segments);
            if self.now >= until {
                return;
            }
            let next = until.min(next_edge).min(self.opens[0]).min(self.opens[1]);
            segments.push(Segment::held(self.switches, next - self.now));
            self.now = next;
        }
    }

    fn open_due(&mut self, segments: &mut Vec<Segment>) {
        for (side, closed) in CLOSED.iter().enumerate() {
            if self.opens[side] <= self.now {
                self.opens[side] = OPEN;
                self.switches &= !closed;
                segments.push(Segment::opened(side as u8));
            }
        }
    }

    /// Applies the edges due and returns the cycle of the next one that matters to this channel.
    fn take_due(&mut self, edges: &EdgeQueue) -> u64 {
        while let Some(edge) = edges.get(self.next_edge) {
            let matters = self.heeds(edge.pin);
            if matters && edge.cycle > self.now {
                return edge.cycle;
            }
            self.next_edge += 1;
            if matters {
                self.apply(*edge);
            }
        }
        u64::MAX
    }

    /// Whether an edge of `pin`, the next one, changes anything.
    fn heeds(&self, pin: Pin) -> bool {
        match pin {
            Pin::Select | Pin::Settled => self.wiring.turn.is_some(),
            Pin::Carrier => true,
            Pin::Strobe => self.wiring.strobe == pin && self.runs(),
        }
    }

    fn apply(&mut self, edge: Edge) {
        match edge.pin {
            Pin::Carrier => {
                self.switches &= !CARRIER_HIGH;
                self.switches |= if edge.high { CARRIER_HIGH } else { 0 };
            }
            Pin::Strobe => {}
            Pin::Select => self.select = edge.high,
            Pin::Settled => self.settled = edge.high,
        }
        if !self.runs() {
            // What is closed opens now.
            self.opens = self
                .opens
                .map(|at| if at == OPEN { OPEN } else { self.now });
        } else if edge.pin == self.wiring.strobe {
            let side = usize::from(edge.high);
            self.switches |= CLOSED[side];
            self.opens[side] = edge.cycle + self.aperture_cycles;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn queue(edges: &[(u64, Pin, bool)]) -> EdgeQueue {
        let mut queue = EdgeQueue::default();
        for &(cycle, pin, high) in edges {
            queue.push(Edge { cycle, pin, high });
        }
        queue
    }

    /// What a channel passes up to `until`.
    fn passed(
        channel: Channel,
        aperture: u64,
        edges: &[(u64, Pin, bool)],
        until: u64,
    ) -> Vec<Segment> {
        let mut segments = Vec::new();
        Switching::new(Wiring::of(channel), aperture).collect(until, &queue(edges), &mut segments);
        segments
    }

    #[test]
    fn a_falling_edge_closes_h_plus_and_a_rising_one_h_minus_for_the_aperture() {
        let edges = [
            (0, Pin::Settled, true),
            (10, Pin::Carrier, true),
            (20, Pin::Strobe, true),
            (40, Pin::Strobe, false),
        ];
        let expected = [
            Segment::held(0, 10),
            Segment::held(1, 10),
            Segment::held(1 | 4, 16),
            Segment::opened(1),
            Segment::held(1, 4),
            Segment::held(1 | 2, 16),
            Segment::opened(0),
            Segment::held(1, 4),
        ];
        assert_eq!(passed(Channel::TiltX, 16, &edges, 60), expected);
        let expected = [
            Segment::held(0, 10),
            Segment::held(1 | 4, 16),
            Segment::opened(1),
            Segment::held(1, 4),
        ];
        assert_eq!(passed(Channel::FieldX, 16, &edges, 30), expected);
    }

    #[test]
    fn an_edge_of_the_same_sense_during_the_aperture_starts_it_anew() {
        let edges = [
            (0, Pin::Carrier, true),
            (4, Pin::Carrier, false),
            (8, Pin::Carrier, true),
        ];
        let expected = [
            Segment::held(1 | 4, 4),
            Segment::held(2 | 4, 4),
            Segment::held(1 | 2 | 4, 6),
            Segment::opened(0),
            Segment::held(1 | 4, 4),
            Segment::opened(1),
            Segment::held(1, 12),
        ];
        assert_eq!(passed(Channel::FieldX, 10, &edges, 30), expected);
    }

    #[test]
    fn a_tilt_channel_is_strobed_only_in_its_turn_once_settled_and_a_turns_end_opens_its_switch() {
        let edges = [
            (10, Pin::Strobe, true),
            (20, Pin::Settled, true),
            (30, Pin::Strobe, false),
            (36, Pin::Select, true),
            (40, Pin::Strobe, true),
            (50, Pin::Settled, false),
            (60, Pin::Strobe, false),
        ];
        let x = [
            Segment::held(0, 30),
            Segment::held(2, 6),
            Segment::opened(0),
            Segment::held(0, 64),
        ];
        let y = [
            Segment::held(0, 60),
            Segment::held(2, 16),
            Segment::opened(0),
            Segment::held(0, 24),
        ];
        // Edges without effect part what is held.
        let joined = |channel| {
            let mut out: Vec<Segment> = Vec::new();
            for segment in passed(channel, 16, &edges, 100) {
                use crate::pattern::Meaning::Held;
                match (out.last().map(|last| last.meaning()), segment.meaning()) {
                    (Some(Held(set, cycles)), Held(same, more)) if set == same => {
                        out.pop();
                        out.push(Segment::held(set, cycles + more));
                    }
                    _ => out.push(segment),
                }
            }
            out
        };
        assert_eq!(joined(Channel::TiltX), x);
        assert_eq!(joined(Channel::TiltY), y);
    }
}

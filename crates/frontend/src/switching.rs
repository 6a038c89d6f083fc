//! The board's switches: what each edge of the controller's pins does to one channel.
//!
//! Wiring. The carrier pin (PB1) high biases the tilt bridges positively and drives the
//! magnetometers' current forwards; low reverses both. Every edge of a channel's strobe pin fires a
//! monostable: a falling edge closes the H+ switch for the aperture, a rising edge the H- switch;
//! another edge of the same sense meanwhile starts the aperture anew. The tilt channels are strobed
//! by PB2, a quarter period after the carrier, where the band-passed bridge signal peaks; the
//! magnetometers by the carrier itself, because a resonator's displacement peaks a quarter period
//! after its force. Falling edges meet the positive peak in both cases, so that a positive specific
//! force or field gives a voltage above mid supply. After reset both pins are low.

use std::collections::VecDeque;

use crate::chain::{CARRIER_HIGH, CLOSED};
use crate::pattern::Segment;

/// A pin of the controller that drives the board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pin {
    /// PB1: bridge bias, drive current, and strobe of the magnetometers' track-and-hold.
    Carrier,
    /// PB2: strobe of the tilt channels' track-and-hold.
    Strobe,
}

impl Pin {
    /// The pin of that name on the reference board (`PB1`, `PB2`).
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        use cardan_spec::timing::pins;
        [(pins::CARRIER, Pin::Carrier), (pins::STROBE, Pin::Strobe)]
            .into_iter()
            .find_map(|(known, pin)| (known == name).then_some(pin))
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
    strobe: Pin,
    aperture_cycles: u64,
    now: u64,
    switches: u8,
    /// When each hold switch opens.
    opens: [u64; 2],
    next_edge: u64,
}

impl Switching {
    /// A channel strobed by `strobe`, as after reset.
    #[must_use]
    pub fn new(strobe: Pin, aperture_cycles: u64) -> Self {
        Self {
            strobe,
            aperture_cycles,
            now: 0,
            switches: 0,
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

    /// Goes on to cycle `until` and appends the segments passed, events at `until` included.
    pub fn collect(&mut self, until: u64, edges: &EdgeQueue, segments: &mut Vec<Segment>) {
        loop {
            self.open_due(segments);
            let next_edge = self.take_due(edges);
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
            let matters = edge.pin == Pin::Carrier || edge.pin == self.strobe;
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

    fn apply(&mut self, edge: Edge) {
        if edge.pin == Pin::Carrier {
            self.switches &= !CARRIER_HIGH;
            self.switches |= if edge.high { CARRIER_HIGH } else { 0 };
        }
        if edge.pin == self.strobe {
            let side = usize::from(edge.high);
            self.switches |= CLOSED[side];
            self.opens[side] = edge.cycle + self.aperture_cycles;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_falling_edge_closes_h_plus_and_a_rising_one_h_minus_for_the_aperture() {
        let mut edges = EdgeQueue::default();
        edges.push(Edge {
            cycle: 10,
            pin: Pin::Carrier,
            high: true,
        });
        edges.push(Edge {
            cycle: 20,
            pin: Pin::Strobe,
            high: true,
        });
        edges.push(Edge {
            cycle: 40,
            pin: Pin::Strobe,
            high: false,
        });
        let mut tilt = Switching::new(Pin::Strobe, 16);
        let mut segments = Vec::new();
        tilt.collect(60, &edges, &mut segments);
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
        assert_eq!(segments, expected);
        let mut field = Switching::new(Pin::Carrier, 16);
        segments.clear();
        field.collect(30, &edges, &mut segments);
        assert_eq!(
            segments,
            [
                Segment::held(0, 10),
                Segment::held(1 | 4, 16),
                Segment::opened(1),
                Segment::held(1, 4)
            ]
        );
    }

    #[test]
    fn an_edge_of_the_same_sense_during_the_aperture_starts_it_anew() {
        let mut edges = EdgeQueue::default();
        for (cycle, high) in [(0, true), (4, false), (8, true)] {
            edges.push(Edge {
                cycle,
                pin: Pin::Carrier,
                high,
            });
        }
        let mut field = Switching::new(Pin::Carrier, 10);
        let mut segments = Vec::new();
        field.collect(30, &edges, &mut segments);
        let expected = [
            Segment::held(1 | 4, 4),
            Segment::held(2 | 4, 4),
            Segment::held(1 | 2 | 4, 6),
            Segment::opened(0),
            Segment::held(1 | 4, 4),
            Segment::opened(1),
            Segment::held(1, 12),
        ];
        assert_eq!(segments, expected);
    }
}

//! Recurring sequences of switch positions as one exact step each.
//!
//! Between two instants at which its state is needed a channel passes a few segments, each a switch
//! set held for a whole number of clock cycles, with charge injected where a hold switch opens.
//! While the controller's timer runs, the same few sequences recur thousands of times a second: each
//! is composed once from the steps of its segments and then costs one matrix product.

use rustc_hash::FxHashMap;

use crate::chain::{Chain, HOLD, STATES, SWITCH_SETS};
use crate::matrix::{self, Vector};
use crate::propagate::{INPUTS, Linear, Step};

/// A part of a pattern, in one word so that patterns are compared and hashed quickly.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Segment(u64);

/// What a segment stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// A switch set, held for a number of cycles.
    Held(u8, u64),
    /// Hold switch 0 (H+) or 1 (H-) opens.
    Opened(u8),
}

impl Segment {
    const OPENED: u64 = 0x80;

    /// A switch set, held for a number of cycles under 2^56.
    #[must_use]
    pub fn held(switches: u8, cycles: u64) -> Self {
        Self(cycles << 8 | u64::from(switches))
    }

    /// Hold switch 0 (H+) or 1 (H-) opens.
    #[must_use]
    pub fn opened(side: u8) -> Self {
        Self(Self::OPENED | u64::from(side))
    }

    /// What it stands for.
    #[must_use]
    pub fn meaning(self) -> Meaning {
        let low = (self.0 & 0x7f) as u8;
        if self.0 & Self::OPENED != 0 {
            Meaning::Opened(low)
        } else {
            Meaning::Held(low, self.0 >> 8)
        }
    }
}

/// Patterns kept before all are dropped: a bound for firmware whose edges never recur.
const MOST_PATTERNS: usize = 4096;

/// A composed pattern.
#[derive(Clone, Debug)]
pub struct Composed {
    /// The step.
    pub step: Step<STATES>,
    /// Columns of a factor of its covariance; none without noise.
    pub noise: Vec<Vector<STATES>>,
}

/// Steps of one channel by segment and by pattern.
#[derive(Clone, Debug)]
pub struct Patterns {
    systems: [Linear<STATES>; SWITCH_SETS],
    /// Jump of the capacitors when their switch opens, volts.
    jumps_v: [f64; 2],
    cycle_s: f64,
    segments: FxHashMap<Segment, Step<STATES>>,
    known: FxHashMap<Box<[Segment]>, usize>,
    composed: Vec<Composed>,
    /// The pattern used last, which often comes again.
    last: (Vec<Segment>, usize),
}

impl Patterns {
    /// For `chain` under a clock of `cpu_hz`.
    #[must_use]
    pub fn new(chain: &Chain<'_>, cpu_hz: u64) -> Self {
        let p = chain.parameters;
        Self {
            systems: std::array::from_fn(|set| chain.system(set as u8)),
            jumps_v: [p.injection_plus_pc, p.injection_minus_pc].map(|pc| pc / p.hold_pf),
            cycle_s: 1.0 / cpu_hz as f64,
            segments: FxHashMap::default(),
            known: FxHashMap::default(),
            composed: Vec::new(),
            last: (Vec::new(), 0),
        }
    }

    /// The system under a switch set.
    #[must_use]
    pub fn system(&self, switches: u8) -> &Linear<STATES> {
        &self.systems[usize::from(switches)]
    }

    /// The step of a pattern, composed if new.
    pub fn get(&mut self, pattern: &[Segment]) -> &Composed {
        if self.last.0 != pattern || self.composed.is_empty() {
            let index = match self.known.get(pattern) {
                Some(index) => *index,
                None => self.compose(pattern),
            };
            self.last.0.clear();
            self.last.0.extend_from_slice(pattern);
            self.last.1 = index;
        }
        &self.composed[self.last.1]
    }

    fn compose(&mut self, pattern: &[Segment]) -> usize {
        if self.composed.len() >= MOST_PATTERNS {
            self.known.clear();
            self.composed.clear();
            self.segments.clear();
        }
        let mut step = Step::none();
        for segment in pattern {
            step = step.then(self.segment(*segment));
        }
        let noise = matrix::factor(&step.q);
        let index = self.composed.len();
        self.known.insert(pattern.into(), index);
        self.composed.push(Composed { step, noise });
        index
    }

    fn segment(&mut self, segment: Segment) -> &Step<STATES> {
        let Self {
            systems,
            jumps_v,
            cycle_s,
            segments,
            ..
        } = self;
        segments
            .entry(segment)
            .or_insert_with(|| match segment.meaning() {
                Meaning::Held(set, cycles) => {
                    Step::over(&systems[usize::from(set)], cycles as f64 * *cycle_s)
                }
                Meaning::Opened(side) => {
                    let mut jump = Step::none();
                    let constant = &mut jump.gamma[INPUTS - 1];
                    constant[HOLD + usize::from(side)] = jumps_v[usize::from(side)];
                    jump
                }
            })
    }
}

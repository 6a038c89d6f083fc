//! Recurring sequences of switch positions as one exact step each.
//!
//! Between two instants at which its state is needed a channel passes a few segments, each a switch
//! set held for a whole number of clock cycles, with charge injected where a hold switch opens.
//! While the controller's timer runs, the same few sequences recur thousands of times a second: at
//! its second occurrence each is composed from the steps of its segments, and then costs one matrix
//! product.

use cardan_scenario::random::Random;
use rustc_hash::FxHashMap;

use crate::chain::{Chain, HOLD, STATES, SWITCH_SETS};
use crate::matrix::{self, Vector};
use crate::propagate::{CONSTANT, Linear, Step};

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

/// A step with its noise ready to draw.
#[derive(Clone, Debug)]
pub struct Ready {
    /// The step.
    pub step: Step<STATES>,
    /// Columns of a factor of its covariance; none without noise.
    noise: Vec<Vector<STATES>>,
}

impl Ready {
    fn new(step: Step<STATES>) -> Self {
        let noise = matrix::factor(&step.q);
        Self { step, noise }
    }

    #[inline]
    fn apply(&self, state: &Vector<STATES>, line: Line, random: &mut Random) -> Vector<STATES> {
        let mut next = self.step.mean(state, &[line.start, 1.0, line.per_second]);
        for column in &self.noise {
            matrix::add_scaled(&mut next, column, random.normal());
        }
        next
    }
}

/// The sensor's input during a pattern.
#[derive(Clone, Copy, Debug)]
pub struct Line {
    /// Value at the start.
    pub start: f64,
    /// Slope.
    pub per_second: f64,
}

/// What is known of a pattern.
#[derive(Clone, Copy, Debug)]
enum Known {
    /// It occurred once and was stepped segment by segment: composing costs fifty times as much and
    /// pays only if the pattern recurs.
    Once,
    /// Composed, at this index.
    Composed(usize),
}

/// Steps of one channel by segment and by pattern.
#[derive(Clone, Debug)]
pub struct Patterns {
    systems: [Linear<STATES>; SWITCH_SETS],
    /// Jump of the capacitors when their switch opens, volts.
    jumps_v: [f64; 2],
    cycle_s: f64,
    segments: FxHashMap<Segment, Ready>,
    known: FxHashMap<Box<[Segment]>, Known>,
    composed: Vec<Ready>,
    /// The pattern used last, which often comes again.
    last: (Vec<Segment>, usize),
}

impl Patterns {
    /// For `chain` under a clock of `clock_hz`.
    #[must_use]
    pub fn new(chain: &Chain<'_>, clock_hz: f64) -> Self {
        let p = chain.parameters;
        Self {
            systems: std::array::from_fn(|set| chain.system(set as u8)),
            jumps_v: [p.injection_plus_pc, p.injection_minus_pc].map(|pc| pc / p.hold_pf),
            cycle_s: 1.0 / clock_hz,
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

    /// The state after a pattern.
    pub fn advance(
        &mut self,
        pattern: &[Segment],
        state: &Vector<STATES>,
        line: Line,
        random: &mut Random,
    ) -> Vector<STATES> {
        if self.last.0 == pattern
            && let Some(ready) = self.composed.get(self.last.1)
        {
            return ready.apply(state, line, random);
        }
        let index = match self.known.get(pattern) {
            Some(Known::Composed(index)) => *index,
            Some(Known::Once) => self.compose(pattern),
            None => {
                self.remember(pattern, Known::Once);
                return self.one_by_one(pattern, state, line, random);
            }
        };
        self.last.0.clear();
        self.last.0.extend_from_slice(pattern);
        self.last.1 = index;
        self.composed[index].apply(state, line, random)
    }

    /// The step of a pattern.
    pub fn step(&mut self, pattern: &[Segment]) -> Step<STATES> {
        let join =
            |whole: Step<STATES>, segment: &Segment| whole.then(&self.segment(*segment).step);
        pattern.iter().fold(Step::none(), join)
    }

    fn one_by_one(
        &mut self,
        pattern: &[Segment],
        state: &Vector<STATES>,
        mut line: Line,
        random: &mut Random,
    ) -> Vector<STATES> {
        let mut state = *state;
        for segment in pattern {
            let ready = self.segment(*segment);
            state = ready.apply(&state, line, random);
            line.start += line.per_second * ready.step.span_s;
        }
        state
    }

    fn compose(&mut self, pattern: &[Segment]) -> usize {
        let ready = Ready::new(self.step(pattern));
        self.remember(pattern, Known::Once);
        let index = self.composed.len();
        self.composed.push(ready);
        self.known.insert(pattern.into(), Known::Composed(index));
        index
    }

    /// Notes a pattern; forgets all first if there are too many.
    fn remember(&mut self, pattern: &[Segment], known: Known) {
        if self.known.len() >= MOST_PATTERNS {
            self.known.clear();
            self.composed.clear();
            self.segments.clear();
            self.last.0.clear();
        }
        self.known.insert(pattern.into(), known);
    }

    fn segment(&mut self, segment: Segment) -> &Ready {
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
                Meaning::Held(set, cycles) => Ready::new(Step::over(
                    &systems[usize::from(set)],
                    cycles as f64 * *cycle_s,
                )),
                Meaning::Opened(side) => {
                    let mut jump = Step::none();
                    let constant = &mut jump.gamma[CONSTANT];
                    constant[HOLD + usize::from(side)] = jumps_v[usize::from(side)];
                    Ready::new(jump)
                }
            })
    }
}

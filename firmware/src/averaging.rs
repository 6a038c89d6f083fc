//! Per-channel averaging of interleaved conversions, in the sample interrupt.
//!
//! The interrupt only adds and counts. Two banks of sums: while it fills one, the main loop takes the
//! other, and finds out by the count that a solution is complete.

use cardan_datapath::{Arithmetic, Value};
use cardan_spec::CHANNELS;
use cardan_spec::timing::{CONVERSIONS_PER_SOLUTION, WARM_UP_SOLUTIONS};
use cardan_units::AdcCode;

use crate::nodes::{Accumulator, Sample};

/// Sums of one solution's conversions.
pub struct Sums<M: Arithmetic> {
    /// Sum of the bipolar codes per channel, in conversion order.
    pub sums: [Value<M, Accumulator>; CHANNELS],
    /// A code stood at either end of the scale.
    pub clipped: bool,
}

impl<M: Arithmetic> Clone for Sums<M> {
    fn clone(&self) -> Self {
        *self
    }
}

impl<M: Arithmetic> Copy for Sums<M> {}

impl<M: Arithmetic> Sums<M> {
    /// No conversions yet.
    pub fn zero(m: &M) -> Self {
        Self {
            sums: [m.constant::<Accumulator, Zero>(); CHANNELS],
            clipped: false,
        }
    }
}

struct Zero;
impl cardan_datapath::Constant for Zero {
    const VALUE: f64 = 0.0;
}

const BANKS: u8 = 2;
const SUMS: usize = BANKS as usize * CHANNELS;
const PER_SOLUTION: u8 = CONVERSIONS_PER_SOLUTION as u8;

/// Number of a conversion since the start, modulo 256.
#[derive(Clone, Copy)]
pub struct Turn(u8);

impl Turn {
    /// The channel of the conversion after it.
    #[must_use]
    pub const fn next_channel(self) -> u8 {
        self.0.wrapping_add(1) % CHANNELS as u8
    }

    /// The solution that it belongs to, modulo 256 / [`CONVERSIONS_PER_SOLUTION`].
    const fn solution(self) -> u8 {
        self.0 / PER_SOLUTION
    }

    /// Where its sum is.
    #[inline(always)]
    const fn at(self) -> usize {
        let channel = self.0 % CHANNELS as u8;
        let odd = self.0 & PER_SOLUTION != 0;
        (if odd {
            channel | CHANNELS as u8
        } else {
            channel
        }) as usize
            % SUMS
    }
}

/// Takes conversions in turn from channel 0 to the last, and again.
pub struct Averager<M: Arithmetic> {
    sums: [Value<M, Accumulator>; SUMS],
    /// The last conversion with a code at either end of the scale, or the one after it; 0: none.
    clipped: u8,
    /// Number of the next conversion.
    turn: Turn,
    /// The warm-up is over.
    settled: bool,
    late: bool,
    /// Of the main loop: the solution whose end it waits for, modulo as in [`Turn::solution`].
    awaited: u8,
    /// Of the main loop: solutions' worth of conversions still to be ignored while the analog
    /// filters settle.
    warm_up: u8,
}

impl<M: Arithmetic> Averager<M> {
    /// Starts with the warm-up.
    pub fn new(m: &M) -> Self {
        const {
            // The count wraps with the banks, and tells solutions apart while one is late.
            assert!(CONVERSIONS_PER_SOLUTION.is_power_of_two() && CONVERSIONS_PER_SOLUTION <= 64);
            assert!(CHANNELS.is_power_of_two() && WARM_UP_SOLUTIONS < 256);
        }
        Self {
            sums: [m.constant::<Accumulator, Zero>(); SUMS],
            clipped: 0,
            turn: Turn(0),
            settled: false,
            late: false,
            awaited: 0,
            warm_up: WARM_UP_SOLUTIONS as u8,
        }
    }

    /// The conversion that is to be added next.
    #[inline(always)]
    pub const fn turn(&self) -> Turn {
        self.turn
    }

    /// A conversion was triggered late, or not at all.
    #[inline(always)]
    pub const fn note_late(&mut self) {
        self.late = true;
    }

    /// Adds the conversion of `turn`.
    #[inline(always)]
    pub fn add(&mut self, m: &M, turn: Turn, code: AdcCode) {
        self.turn = Turn(turn.0.wrapping_add(1));
        if !self.settled {
            return;
        }
        // First, so that the interrupt needs the turn no longer when it adds.
        if code.is_clipped() {
            self.clipped = turn.0 | 1;
        }
        let sum = &mut self.sums[turn.at()];
        let sample: Value<M, Sample> = m.input::<Sample, 0>(i32::from(code.bipolar()));
        *sum = m.add(*sum, sample);
    }

    /// The sums of a complete solution, once, and whether something was late since the last. Call at
    /// least once per solution, and not while [`Averager::add`] may interrupt it. (A solution's sums
    /// that nobody takes are added to those of the next but one, which is flagged late.)
    pub fn take(&mut self, m: &M) -> Option<(Sums<M>, bool)> {
        const SOLUTIONS: u8 = (256 / CONVERSIONS_PER_SOLUTION) as u8;
        let ended = self.turn.solution().wrapping_sub(self.awaited) % SOLUTIONS;
        if ended == 0 {
            return None;
        }
        let last = self.turn.solution().wrapping_sub(1) % SOLUTIONS;
        let bank = usize::from(self.awaited % BANKS);
        self.awaited = self.turn.solution();
        if self.warm_up > 0 {
            self.warm_up = self.warm_up.saturating_sub(ended);
            self.settled = self.warm_up == 0;
            // The first conversion after reset takes longer than the others.
            self.late = false;
            return None;
        }
        let mut done = Sums::zero(m);
        let filled = self.sums.chunks_exact_mut(CHANNELS).nth(bank);
        for (sum, into) in filled.into_iter().flatten().zip(&mut done.sums) {
            *into = *sum;
            *sum = m.constant::<Accumulator, Zero>();
        }
        done.clipped = self.clipped != 0;
        if Turn(self.clipped).solution() == last {
            self.clipped = 0;
        }
        let late = core::mem::take(&mut self.late) || ended > 1;
        Some((done, late))
    }

    /// Adds the next conversion; the sums when a solution's conversions are complete.
    pub fn push(&mut self, m: &M, code: AdcCode) -> Option<Sums<M>> {
        self.add(m, self.turn, code);
        self.take(m).map(|(sums, _)| sums)
    }
}

//! Per-channel averaging of interleaved conversions: blocks in the sample interrupt, averages of any
//! power of two in the main loop.
//!
//! The interrupt only adds and counts. It sums the last conversions of each block (all of them, unless
//! fewer are averaged) in two banks: while it fills one, the main loop takes the other, and finds out by
//! the count that a block is complete. The main loop adds the blocks that count to a wide sum.

use cardan_datapath::{Arithmetic, Value};
use cardan_spec::MOST_CHANNELS;
use cardan_spec::timing::{Averaging, BLOCK_ROUNDS, WARM_UP_BLOCKS};
use cardan_units::AdcCode;

use crate::nodes::{Accumulator, Average, Block, Mean, Sample};

/// Sums of a block's conversions.
pub struct Sums<M: Arithmetic> {
    /// Sum of the bipolar codes per channel, in conversion order; 0 where there is no such channel.
    pub sums: [Value<M, Accumulator>; MOST_CHANNELS],
    /// A code stood at either end of the scale.
    pub clipped: bool,
    /// A conversion or a block was late since the last block.
    pub late: bool,
}

/// Averages of a solution's conversions.
pub struct Averages<M: Arithmetic> {
    /// Over full scale, per channel, in conversion order: the last is the third tilt axis where it is
    /// measured, else 0.
    pub values: [Value<M, Average>; MOST_CHANNELS],
    /// A code stood at either end of the scale.
    pub clipped: bool,
    /// A conversion or a block was late since the last solution.
    pub late: bool,
}

struct Zero;
impl cardan_datapath::Constant for Zero {
    const VALUE: f64 = 0.0;
}

/// Places of a round, of which the channels take the first: a power of two, whatever their number.
const ROUND: u8 = 8;
/// Places of a block.
const BLOCK: u8 = ROUND * BLOCK_ROUNDS as u8;
const BANKS: usize = 2;
const SUMS: usize = BANKS * ROUND as usize;

/// Place of a conversion in two blocks: bit 7 tells the block, bits 3 to 6 the round, 0 to 2 the channel.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Turn(u8);

impl Turn {
    /// The channel.
    #[must_use]
    #[inline(always)]
    pub const fn channel(self) -> u8 {
        self.0 % ROUND
    }

    /// Its block's bank.
    const fn bank(self) -> u8 {
        self.0 / BLOCK
    }

    /// Where its sum is.
    #[inline(always)]
    const fn at(self) -> usize {
        let channel = self.channel();
        let odd = self.0 & BLOCK != 0;
        (if odd { channel | ROUND } else { channel }) as usize % SUMS
    }
}

/// Sums conversions, which come in turn from channel 0 to the last, and again, block by block.
pub struct Averager<M: Arithmetic> {
    sums: [Value<M, Accumulator>; SUMS],
    /// The last conversion with a code at either end of the scale, or the one after it; 0: none.
    clipped: u8,
    /// The next conversion.
    turn: Turn,
    /// Channels that are converted.
    channels: u8,
    /// The first place of a block that is summed; none of the warm-up's is.
    first: u8,
    /// Pairs of blocks that have ended, modulo 256.
    pairs: u8,
    late: bool,
    /// Of the main loop: the block whose end it waits for, modulo 256.
    awaited: u8,
    /// Of the main loop: blocks still to be ignored while the analog filters settle.
    warm_up: u8,
    /// Of the main loop: what [`Averager::first`] is after the warm-up.
    first_summed: u8,
}

impl<M: Arithmetic> Averager<M> {
    /// Starts with the warm-up.
    pub fn new(m: &M, averaging: Averaging) -> Self {
        const {
            // The places wrap with the banks.
            assert!(
                BANKS * BLOCK as usize == 256 && BLOCK_ROUNDS * ROUND as usize == BLOCK as usize
            );
            assert!(MOST_CHANNELS <= ROUND as usize && WARM_UP_BLOCKS < 256);
        }
        Self {
            sums: [m.constant::<Accumulator, Zero>(); SUMS],
            clipped: 0,
            turn: Turn(0),
            channels: averaging.channels() as u8,
            first: BLOCK,
            pairs: 0,
            late: false,
            awaited: 0,
            warm_up: WARM_UP_BLOCKS as u8,
            first_summed: BLOCK - ROUND * averaging.summed_rounds() as u8,
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

    /// Goes on to the conversion after `turn`, which is the next one's, and returns it. Its block is
    /// complete with [`Averager::add`], so that [`Averager::take`] must not come between.
    #[inline(always)]
    pub fn advance(&mut self, turn: Turn) -> Turn {
        let mut next = turn.0 + 1;
        if (next ^ self.channels).is_multiple_of(ROUND) {
            next = (next | (ROUND - 1)).wrapping_add(1);
            // In the last round of both blocks. (Looking at `next` costs a register more.)
            if turn.0 >= 0_u8.wrapping_sub(ROUND) {
                self.pairs = self.pairs.wrapping_add(1);
            }
        }
        self.turn = Turn(next);
        self.turn
    }

    /// Adds the conversion of `turn`.
    #[inline(always)]
    pub fn add(&mut self, m: &M, turn: Turn, code: AdcCode) {
        if turn.0 % BLOCK < self.first {
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

    /// The sums of a complete block, once. Call at least once per block, and not while the conversions'
    /// interrupt may come. (Sums that nobody takes are added to those of the next block
    /// but one, which is marked late.)
    pub fn take(&mut self, m: &M) -> Option<Sums<M>> {
        let all = self.pairs.wrapping_mul(BANKS as u8) + self.turn.bank();
        let ended = all.wrapping_sub(self.awaited);
        if ended == 0 {
            return None;
        }
        let bank = usize::from(self.awaited) % BANKS;
        self.awaited = all;
        if self.warm_up > 0 {
            self.warm_up = self.warm_up.saturating_sub(ended);
            if self.warm_up == 0 {
                self.first = self.first_summed;
            }
            // The first conversion after reset takes longer than the others.
            self.late = false;
            return None;
        }
        let mut sums = [m.constant::<Accumulator, Zero>(); MOST_CHANNELS];
        let filled = self.sums.chunks_exact_mut(ROUND.into()).nth(bank);
        for (sum, into) in filled.into_iter().flatten().zip(&mut sums) {
            *into = *sum;
            *sum = m.constant::<Accumulator, Zero>();
        }
        let clipped = self.clipped != 0;
        // Of the block that is being filled now it is not.
        if Turn(self.clipped).bank() != self.turn.bank() {
            self.clipped = 0;
        }
        let late = core::mem::take(&mut self.late) || ended > 1;
        Some(Sums {
            sums,
            clipped,
            late,
        })
    }
}

/// Adds the blocks that count to the averages of a solution. All of it is the main loop's.
pub struct Window<M: Arithmetic> {
    means: [Value<M, Mean>; MOST_CHANNELS],
    channels: u8,
    clipped: bool,
    late: bool,
    /// Blocks to come in this period.
    left: u16,
    period: u16,
    /// Blocks at the end of a period that count.
    counted: u16,
    /// log2 of a sum's part of the average over full scale.
    scale: i8,
}

impl<M: Arithmetic> Window<M> {
    /// Before the first block.
    pub fn new(m: &M, averaging: Averaging) -> Self {
        let period = averaging.blocks() as u16;
        Self {
            means: [m.constant::<Mean, Zero>(); MOST_CHANNELS],
            channels: averaging.channels() as u8,
            clipped: false,
            late: false,
            left: period,
            period,
            counted: averaging.counted_blocks() as u16,
            scale: SCALE - averaging.log2() as i8,
        }
    }

    /// Adds the next block; the averages when a solution's blocks are complete.
    #[inline(never)]
    pub fn add(&mut self, m: &M, block: &Sums<M>) -> Option<Averages<M>> {
        self.late |= block.late;
        let channels = usize::from(self.channels);
        if self.left <= self.counted {
            self.clipped |= block.clipped;
            for (mean, &sum) in self.means.iter_mut().zip(&block.sums).take(channels) {
                let part: Value<M, Block> = m
                    .scale::<Block, Accumulator, LEAST_SCALE, { SCALE as i32 }>(
                        sum,
                        i32::from(self.scale),
                    );
                *mean = m.add(*mean, part);
            }
        }
        self.left -= 1;
        if self.left > 0 {
            return None;
        }
        self.left = self.period;
        let mut values = [m.constant::<Average, Zero>(); MOST_CHANNELS];
        for (average, mean) in values.iter_mut().zip(&mut self.means).take(channels) {
            *average = m.shift::<Average, Mean, 0>(*mean);
            *mean = m.constant::<Mean, Zero>();
        }
        Some(Averages {
            values,
            clipped: core::mem::take(&mut self.clipped),
            late: core::mem::take(&mut self.late),
        })
    }
}

/// log2 of one code over full scale: 512 codes.
const SCALE: i8 = -9;
/// The same of the longest average's part.
const LEAST_SCALE: i32 = SCALE as i32 - Averaging::MOST_LOG2 as i32;

/// Interrupt and main loop in one, for hosts: conversions in, averages out.
pub struct Decimator<M: Arithmetic> {
    averager: Averager<M>,
    window: Window<M>,
}

impl<M: Arithmetic> Decimator<M> {
    /// Starts with the warm-up.
    pub fn new(m: &M, averaging: Averaging) -> Self {
        Self {
            averager: Averager::new(m, averaging),
            window: Window::new(m, averaging),
        }
    }

    /// Adds the next conversion; the averages when a solution's conversions are complete.
    pub fn push(&mut self, m: &M, code: AdcCode) -> Option<Averages<M>> {
        let turn = self.averager.turn();
        self.averager.advance(turn);
        self.averager.add(m, turn, code);
        let block = self.averager.take(m)?;
        self.window.add(m, &block)
    }
}

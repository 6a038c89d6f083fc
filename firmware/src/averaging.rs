//! Per-channel averaging of interleaved conversions, in the sample interrupt.

use cardan_datapath::{Arithmetic, Value};
use cardan_spec::CHANNELS;
use cardan_spec::timing::{AVERAGING, WARM_UP_SOLUTIONS};
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

/// Takes conversions in turn from channel 0 to the last, and again.
pub struct Averager<M: Arithmetic> {
    current: Sums<M>,
    channel: u8,
    round: u16,
    warm_up: u16,
}

impl<M: Arithmetic> Averager<M> {
    /// Starts with the warm-up: conversions that are ignored while the analog filters settle.
    pub fn new(m: &M) -> Self {
        Self {
            current: Sums::zero(m),
            channel: 0,
            round: 0,
            warm_up: (WARM_UP_SOLUTIONS * AVERAGING) as u16,
        }
    }

    /// The channel after the one whose conversion comes next.
    pub const fn next_channel(&self) -> u8 {
        (self.channel + 1) % CHANNELS as u8
    }

    /// True once the warm-up is over.
    pub const fn is_settled(&self) -> bool {
        self.warm_up == 0
    }

    /// Takes the next conversion. Returns the sums when a solution's conversions are complete.
    #[inline(always)]
    pub fn push(&mut self, m: &M, code: AdcCode) -> Option<Sums<M>> {
        let channel = usize::from(self.channel);
        let last = channel + 1 == CHANNELS;
        self.channel = self.next_channel();
        if self.warm_up > 0 {
            self.warm_up -= u16::from(last);
            return None;
        }
        let sample: Value<M, Sample> = m.input::<Sample, 0>(i32::from(code.bipolar()));
        self.current.sums[channel] = m.add(self.current.sums[channel], sample);
        self.current.clipped |= code.is_clipped();
        self.round += u16::from(last);
        if usize::from(self.round) < AVERAGING {
            return None;
        }
        self.round = 0;
        let done = self.current;
        self.current = Sums::zero(m);
        Some(done)
    }
}

//! The golden model of the whole device: conversions in, solutions out.

use cardan_spec::calibration::Calibration;
use cardan_spec::timing::{AVERAGING, CONVERSIONS_PER_SOLUTION, WARM_UP_SOLUTIONS};
use cardan_spec::{CHANNELS, Channel, flags};
use cardan_units::AdcCode;

use crate::node;
use crate::solve::{Memory, Solution, solve};

/// The golden model. It is fed the conversions in the order in which the device makes them.
#[derive(Clone, Debug)]
pub struct Golden {
    calibration: Calibration,
    memory: Memory,
    /// Conversions since reset, warm-up included.
    conversions: usize,
    sums: [f64; CHANNELS],
    clipped: bool,
}

impl Golden {
    /// A device just after reset, with the given calibration.
    #[must_use]
    pub fn new(calibration: &Calibration) -> Self {
        Self {
            calibration: *calibration,
            memory: Memory::default(),
            conversions: 0,
            sums: [0.0; CHANNELS],
            clipped: false,
        }
    }

    /// Takes one conversion: the bipolar code (an integer, code - 512; for a voltage
    /// [`cardan_units::ideal_bipolar_code`]) and whether the converter may have clipped it. The
    /// first [`WARM_UP_SOLUTIONS`] solutions' worth is ignored. `record` takes each node's index in
    /// [`cardan_spec::nodes::SHARED`] and value at each write, in signal order. With the last
    /// conversion of a solution comes the solution.
    pub fn convert(
        &mut self,
        channel: Channel,
        code: f64,
        clipped: bool,
        record: &mut impl FnMut(usize, f64),
    ) -> Option<Solution> {
        self.conversions += 1;
        let published = self
            .conversions
            .checked_sub(WARM_UP_SOLUTIONS * CONVERSIONS_PER_SOLUTION)?;
        if published == 0 {
            return None;
        }
        record(node::SAMPLE, code);
        let sum = &mut self.sums[channel as usize];
        *sum += code;
        record(node::ACCUMULATOR, *sum);
        self.clipped |= clipped;
        (published % CONVERSIONS_PER_SOLUTION == 0).then(|| self.finish(record))
    }

    fn finish(&mut self, record: &mut impl FnMut(usize, f64)) -> Solution {
        let full_scale = f64::from(AdcCode::CENTRE) * AVERAGING as f64;
        let averages = self.sums.map(|sum| sum / full_scale);
        let mut solution = solve(&averages, &self.calibration, &mut self.memory, record);
        if self.clipped {
            solution.flags |= flags::SATURATION;
        }
        self.sums = [0.0; CHANNELS];
        self.clipped = false;
        solution
    }
}

//! The golden model of the whole device: conversions in, solutions out.

use cardan_spec::calibration::Calibration;
use cardan_spec::timing::Averaging;
use cardan_spec::{CHANNELS, Channel, MOST_CHANNELS, flags};
use cardan_units::AdcCode;

use crate::node;
use crate::solve::{Memory, Solution, Third, solve};

/// The golden model. It is fed the conversions in the order in which the device makes them.
#[derive(Clone, Debug)]
pub struct Golden {
    calibration: Calibration,
    averaging: Averaging,
    memory: Memory,
    /// Conversions since reset, warm-up included.
    conversions: usize,
    /// Of this block.
    sums: [f64; MOST_CHANNELS],
    /// Of this solution, over full scale.
    means: [f64; MOST_CHANNELS],
    clipped: bool,
}

impl Golden {
    /// A device just after reset, with the given calibration and [`Averaging::DEFAULT`].
    #[must_use]
    pub fn new(calibration: &Calibration) -> Self {
        Self::with_averaging(calibration, Averaging::DEFAULT)
    }

    /// A device just after reset, with the given calibration and averaging. Five channels are those of a
    /// device that measures its third tilt axis.
    #[must_use]
    pub fn with_averaging(calibration: &Calibration, averaging: Averaging) -> Self {
        Self {
            calibration: *calibration,
            averaging,
            memory: Memory::new(averaging),
            conversions: 0,
            sums: [0.0; MOST_CHANNELS],
            means: [0.0; MOST_CHANNELS],
            clipped: false,
        }
    }

    /// What a third tilt axis at the comparator tells from here on: whether the device is upside down;
    /// `None` (as at first) where none is fitted, or where it is measured.
    pub fn third_tilt(&mut self, upside_down: Option<bool>) {
        self.memory.third = upside_down.map(|upside_down| Third::Sign { upside_down });
    }

    /// Takes one conversion: the bipolar code (an integer, code - 512; for a voltage
    /// [`cardan_units::ideal_bipolar_code`]) and whether the converter may have clipped it. The
    /// first [`cardan_spec::timing::WARM_UP_BLOCKS`] blocks are ignored. `record` takes each node's index in
    /// [`cardan_spec::nodes::SHARED`] and value at each write, in signal order. With the last
    /// conversion of a solution comes the solution.
    pub fn convert(
        &mut self,
        channel: Channel,
        code: f64,
        clipped: bool,
        record: &mut impl FnMut(usize, f64),
    ) -> Option<Solution> {
        let conversion = self.conversions;
        self.conversions += 1;
        let index = conversion.checked_sub(self.averaging.warm_up_conversions())?
            % self.averaging.conversions();
        let counts = self.averaging.counts(index);
        if self.averaging.is_summed(index) {
            record(node::SAMPLE, code);
            let sum = &mut self.sums[channel as usize];
            *sum += code;
            record(node::ACCUMULATOR, *sum);
            self.clipped |= clipped && counts;
        }
        if (index + 1).is_multiple_of(self.averaging.block_conversions()) {
            self.end_block(counts, record);
        }
        (index + 1 == self.averaging.conversions()).then(|| self.finish(record))
    }

    fn end_block(&mut self, counts: bool, record: &mut impl FnMut(usize, f64)) {
        let sums = std::mem::take(&mut self.sums);
        if !counts {
            return;
        }
        let full_scale = f64::from(AdcCode::CENTRE) * self.averaging.length() as f64;
        let channels = self.averaging.channels();
        for (mean, sum) in self.means.iter_mut().zip(sums).take(channels) {
            *mean += sum / full_scale;
            record(node::MEAN, *mean);
        }
    }

    fn finish(&mut self, record: &mut impl FnMut(usize, f64)) -> Solution {
        let [x, y, field_x, field_y, z] = std::mem::take(&mut self.means);
        let averages: [f64; CHANNELS] = [x, y, field_x, field_y];
        let tilt_z = (self.averaging.channels() > CHANNELS).then_some(z);
        let (calibration, memory) = (&self.calibration, &mut self.memory);
        let mut solution = solve(&averages, tilt_z, calibration, memory, record);
        if std::mem::take(&mut self.clipped) {
            solution.flags |= flags::SATURATION;
        }
        solution
    }
}

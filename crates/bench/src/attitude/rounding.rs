//! The attitude with the first nodes rounded as deployed and the rest real: one step of the error
//! budget's rounding after the other.
//!
//! Averaging is most of the work. Its nodes come first, so in all steps from the average on it gives
//! the same words: it is done once for them.

use cardan_datapath::{Node, Silent, Value};
use cardan_firmware::attitude::{State, solve};
use cardan_firmware::averaging::{Averages, Decimator};
use cardan_firmware::calibration::{Calibration, Settings};
use cardan_firmware::nodes::{Accumulator, Average, Block, Mean, Sample};
use cardan_numerics::{Formats, Mixed, Number};
use cardan_spec::MOST_CHANNELS;
use cardan_units::AdcCode;

use crate::app::RoundingSteps;

const _: () = {
    // What precedes the average is all that it depends on.
    let before = [Sample::INDEX, Accumulator::INDEX, Block::INDEX, Mean::INDEX];
    let mut i = 0;
    while i < before.len() {
        assert!(before[i] < Average::INDEX);
        i += 1;
    }
};

type Arithmetic = Mixed<Silent>;

/// A conversion, and what a third tilt axis at the comparator tells with it.
type Input = (AdcCode, i8);

/// What a solution is computed from, whatever the formats behind the averaging.
struct Averaged {
    values: [Number; MOST_CHANNELS],
    clipped: bool,
    late: bool,
    sign: i8,
}

impl Averaged {
    fn new(averages: &Averages<Arithmetic>, sign: i8) -> Self {
        Self {
            values: averages.values.map(Value::word),
            clipped: averages.clipped,
            late: averages.late,
            sign,
        }
    }

    fn averages(&self) -> Averages<Arithmetic> {
        Averages {
            values: self.values.map(Value::new),
            clipped: self.clipped,
            late: self.late,
        }
    }
}

/// The steps of one run.
pub(super) struct Steps {
    formats: Formats,
    settings: Settings,
    inputs: Vec<Input>,
    /// With all of the averaging's nodes rounded.
    averaged: Vec<Averaged>,
}

impl Steps {
    pub(super) fn new(formats: Formats, settings: &Settings, inputs: Vec<Input>) -> Self {
        let averaged = averaged(&formats, settings, &inputs);
        Self {
            formats,
            settings: *settings,
            inputs,
            averaged,
        }
    }
}

fn averaged(formats: &Formats, settings: &Settings, inputs: &[Input]) -> Vec<Averaged> {
    let m = Mixed::new(formats, Silent);
    let mut decimator = Decimator::new(&m, settings.averaging);
    let solutions = inputs.iter().filter_map(|&(code, sign)| {
        let averages = decimator.push(&m, code)?;
        Some(Averaged::new(&averages, sign))
    });
    solutions.collect()
}

impl RoundingSteps for Steps {
    fn attitudes(&self, quantised: usize) -> [Vec<f64>; 3] {
        let formats = self.formats.prefix(quantised);
        let real;
        let solutions = if quantised > Average::INDEX {
            &self.averaged
        } else {
            real = averaged(&formats, &self.settings, &self.inputs);
            &real
        };
        let m = Mixed::new(&formats, Silent);
        let calibration = Calibration::new(&m, &self.settings.words, self.settings.third_tilt);
        let mut state = State::new(&m, self.settings.averaging);
        let mut attitudes = [const { Vec::new() }; 3];
        for solution in solutions {
            let averages = solution.averages();
            let angles = solve(&m, &calibration, &mut state, &averages, solution.sign);
            let angles = [angles.yaw.word(), angles.pitch.word(), angles.roll.word()];
            for (values, angle) in attitudes.iter_mut().zip(angles) {
                values.push(angle.real);
            }
        }
        attitudes
    }
}

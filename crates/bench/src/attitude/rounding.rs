//! The attitude with the first nodes rounded as deployed and the rest real: one step of the error
//! budget's rounding after the other.
//!
//! Averaging is most of the work. Its nodes come first, so in all steps from the average on it gives
//! the same words: it is done once for them.

use cardan_datapath::{Node, Silent};
use cardan_firmware::attitude::{State, solve};
use cardan_firmware::averaging::{Averages, Decimator};
use cardan_firmware::calibration::{Calibration, Settings};
use cardan_firmware::nodes::{Accumulator, Average, Block, Mean, NODE_COUNT, Sample};
use cardan_numerics::{Formats, Mixed};
use cardan_units::AdcCode;

use super::{STAGES, sign};
use crate::engine::{Conversion, Engine, EngineError, Sink};

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

/// The averaging in one arithmetic.
struct Averaging {
    m: Arithmetic,
    decimator: Decimator<Arithmetic>,
}

impl Averaging {
    fn new(formats: &Formats, settings: &Settings) -> Self {
        let m = Mixed::new(formats, Silent);
        let decimator = Decimator::new(&m, settings.averaging);
        Self { m, decimator }
    }
}

/// The solution in one arithmetic.
struct Solution {
    m: Arithmetic,
    calibration: Calibration<Arithmetic>,
    state: State<Arithmetic>,
}

impl Solution {
    fn new(formats: &Formats, settings: &Settings) -> Self {
        let m = Mixed::new(formats, Silent);
        let calibration = Calibration::new(&m, &settings.words, settings.third_tilt);
        let state = State::new(&m, settings.averaging);
        Self {
            m,
            calibration,
            state,
        }
    }

    /// Yaw, pitch and roll in half turns.
    fn solve(&mut self, averages: &Averages<Arithmetic>, sign: i8) -> [f64; 3] {
        let angles = solve(&self.m, &self.calibration, &mut self.state, averages, sign);
        [
            angles.yaw.word().real,
            angles.pitch.word().real,
            angles.roll.word().real,
        ]
    }
}

/// All steps side by side: in the k-th the nodes up to the k-th are rounded.
pub(super) struct Steps {
    /// Steps in which nodes of the averaging are not rounded.
    early: Vec<(Averaging, Solution)>,
    /// The averaging of all others.
    averaging: Averaging,
    late: Vec<Solution>,
}

impl Steps {
    pub(super) fn new(formats: &Formats, settings: &Settings) -> Self {
        let of = |node: usize| formats.prefix(node + 1);
        let early = (0..Average::INDEX).map(|node| {
            let formats = of(node);
            (
                Averaging::new(&formats, settings),
                Solution::new(&formats, settings),
            )
        });
        let late = (Average::INDEX..NODE_COUNT).map(|node| Solution::new(&of(node), settings));
        Self {
            early: early.collect(),
            averaging: Averaging::new(formats, settings),
            late: late.collect(),
        }
    }
}

impl Engine for Steps {
    fn conversion(
        &mut self,
        conversion: &Conversion,
        sink: &mut dyn Sink,
    ) -> Result<(), EngineError> {
        let (code, sign) = (AdcCode(conversion.code), sign(conversion));
        let mut show = |node: usize, angles: [f64; 3]| {
            for (member, angle) in angles.into_iter().enumerate() {
                sink.stage(STAGES.len() + node, member, angle, conversion.cycle)?;
            }
            Ok::<_, EngineError>(())
        };
        for (node, (averaging, solution)) in self.early.iter_mut().enumerate() {
            if let Some(averages) = averaging.decimator.push(&averaging.m, code) {
                show(node, solution.solve(&averages, sign))?;
            }
        }
        let Averaging { m, decimator } = &mut self.averaging;
        if let Some(averages) = decimator.push(m, code) {
            for (node, solution) in self.late.iter_mut().enumerate() {
                show(Average::INDEX + node, solution.solve(&averages, sign))?;
            }
        }
        Ok(())
    }
}

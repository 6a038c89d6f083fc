//! The algorithm in its real interpretation, with what rounding is expected to make of every value
//! and of every status bit.

use cardan_datapath::Format;
use cardan_firmware::calibration::Settings;
use cardan_firmware::nodes::NODES;
use cardan_numerics::tape::{Tape, Uncertainty};
use cardan_spec::flags;

use super::{AttitudeDatapath, step_inputs};
use crate::engine::{Conversion, Conversions, Engine, EngineError, Sink, Summary};

/// The real interpretation beside the rounding of `formats`.
pub(super) struct ExpectationEngine {
    settings: Settings,
    formats: Vec<Format>,
}

impl ExpectationEngine {
    pub(super) fn new(mut formats: Vec<Format>, settings: &Settings) -> Self {
        // What wraps by design (an angle) is the algorithm's affair. A tuned word that wraps because
        // that is cheap stands for a value that does not.
        for (format, node) in formats.iter_mut().zip(&NODES) {
            format.overflow = node.format.overflow;
        }
        Self {
            settings: *settings,
            formats,
        }
    }
}

impl Engine for ExpectationEngine {
    fn run(
        &mut self,
        conversions: Conversions<'_>,
        sink: &mut dyn Sink,
    ) -> Result<Summary, EngineError> {
        let conversions = conversions.collect::<Result<Vec<Conversion>, _>>()?;
        let averaging = self.settings.averaging;
        let settled = conversions.get(averaging.warm_up_conversions()..);
        let solutions = settled
            .unwrap_or_default()
            .chunks_exact(averaging.conversions());
        let steps: Vec<Vec<i32>> = solutions.clone().map(step_inputs).collect();
        if steps.is_empty() {
            return Ok(Summary::default());
        }
        let datapath = AttitudeDatapath {
            words: self.settings.words,
            averaging,
            third_tilt: self.settings.third_tilt,
        };
        let (tape, inputs) = Tape::record(&datapath, &steps)
            .map_err(|error| EngineError::Input(format!("the attitude datapath: {error}")))?;
        let mut uncertainty = Uncertainty::new(&tape, &self.formats, flags::DOMAIN);
        for (at, solution) in solutions.enumerate() {
            let cycle = solution.last().map_or(0, |last| last.cycle);
            let mut result = Ok(());
            let raised = uncertainty.step(&inputs, at, |node, expected| {
                if result.is_ok() {
                    result = sink.expected(node, expected, cycle);
                }
            });
            result?;
            sink.status(raised.status, raised.doubtful, cycle)?;
        }
        Ok(Summary::default())
    }
}

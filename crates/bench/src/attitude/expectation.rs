//! The algorithm in its real interpretation, with what rounding is expected to make of every value
//! and of every status bit.

use std::rc::Rc;

use cardan_datapath::Format;
use cardan_firmware::nodes::NODES;
use cardan_numerics::tape::{Follower, Tape, Uncertainty};
use cardan_spec::flags;

use super::datapath::{AttitudeDatapath, follower};
use super::step_inputs;
use crate::app::Configuration;
use crate::engine::{Conversion, Engine, EngineError, Sink};

/// The real interpretation beside the rounding of the formats.
pub(super) struct ExpectationEngine {
    follower: Follower<AttitudeDatapath>,
    uncertainty: Uncertainty<Rc<Tape>>,
    /// Conversions of the warm-up that are still to come.
    warm_up: usize,
    /// Those of the next solution so far.
    solution: Vec<Conversion>,
    per_solution: usize,
}

impl ExpectationEngine {
    pub(super) fn new(
        mut formats: Vec<Format>,
        configuration: &Configuration,
    ) -> Result<Self, String> {
        // What wraps by design (an angle) is the algorithm's affair. A tuned word that wraps because
        // that is cheap stands for a value that does not.
        for (format, node) in formats.iter_mut().zip(&NODES) {
            format.overflow = node.format.overflow;
        }
        let averaging = configuration.averaging();
        let follower = follower(configuration)?;
        Ok(Self {
            uncertainty: Uncertainty::new(follower.tape(), &formats, flags::DOMAIN),
            follower,
            warm_up: averaging.warm_up_conversions(),
            solution: Vec::new(),
            per_solution: averaging.conversions(),
        })
    }
}

impl Engine for ExpectationEngine {
    fn conversion(
        &mut self,
        conversion: &Conversion,
        sink: &mut dyn Sink,
    ) -> Result<(), EngineError> {
        if self.warm_up > 0 {
            self.warm_up -= 1;
            return Ok(());
        }
        self.solution.push(*conversion);
        if self.solution.len() < self.per_solution {
            return Ok(());
        }
        let inputs = self
            .follower
            .step(&step_inputs(&self.solution))
            .map_err(|error| EngineError::Input(format!("the attitude datapath: {error}")))?;
        self.solution.clear();
        let mut result = Ok(());
        let raised = self.uncertainty.step(inputs, 0, |node, expected| {
            if result.is_ok() {
                result = sink.expected(node, expected, conversion.cycle);
            }
        });
        result?;
        sink.status(raised.status, raised.doubtful, conversion.cycle)?;
        Ok(())
    }
}

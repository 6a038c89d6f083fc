//! One algorithm, several engines: golden, native, emulated. What goes in and comes out.

use std::error::Error;

use cardan_emulator::Pin;
use cardan_frontend::Inner;
use cardan_numerics::tape::Expected;
use serde::{Deserialize, Serialize};

/// One conversion of the emulated converter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conversion {
    /// Position among all conversions, from 0.
    pub sequence: u64,
    /// Cycle of the hold instant.
    pub cycle: u64,
    /// Channel.
    pub channel: u8,
    /// Result, 0..=1023.
    pub code: u16,
    /// Voltage at the pin in that instant, before the converter's own errors.
    pub ideal_volts: f64,
    /// The bipolar code, without steps, that memoryless ideal sensors would have given at that
    /// instant less the nominal group delay; NaN without a true attitude.
    pub direct_code: f64,
    /// The bipolar code, without steps, that memoryless ideal sensors would have given of the true
    /// specific force and field at that instant less the nominal group delay: with what acceleration
    /// and disturbances add.
    pub experienced_code: f64,
    /// It was not triggered in time.
    pub late: bool,
    /// The firmware never saw the result.
    pub lost: bool,
    /// With the last conversion of a solution, where a third tilt axis is fitted.
    pub third_tilt: Option<ThirdTilt>,
}

/// What a third tilt axis tells of a solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ThirdTilt {
    /// The comparator's output when the firmware read it for this solution: upside down. It is that of
    /// the ideal voltage as well, since a comparator has no steps.
    pub upside_down: bool,
    /// The truth at that instant less the nominal group delay; none without a true attitude.
    pub truly_upside_down: Option<bool>,
}

/// The truth at a solution's output instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Cycle at which the solution's inputs were complete.
    pub cycle: u64,
    /// The output instant in seconds after reset: the centre of the conversions less the group
    /// delay.
    pub time_s: f64,
    /// The values of the product's group in their own unit; none where a recording has no reference.
    pub values: Option<Vec<f64>>,
}

/// Why a sink refused: the reader on its other side is gone.
pub type SinkError = Box<dyn Error + Send + Sync>;

/// Sees what an engine does, in order.
pub trait Sink {
    /// A conversion was made.
    fn conversion(&mut self, conversion: &Conversion) -> Result<(), SinkError> {
        let _ = conversion;
        Ok(())
    }

    /// A node took the raw word `raw`.
    fn word(&mut self, node: usize, raw: i64, cycle: u64) -> Result<(), SinkError> {
        let _ = (node, raw, cycle);
        Ok(())
    }

    /// A node took the real value `value`.
    fn real(&mut self, node: usize, value: f64, cycle: u64) -> Result<(), SinkError> {
        let _ = (node, value, cycle);
        Ok(())
    }

    /// The real interpretation of a node, and what rounding is expected to make of it.
    fn expected(&mut self, node: usize, expected: Expected, cycle: u64) -> Result<(), SinkError> {
        let _ = (node, expected, cycle);
        Ok(())
    }

    /// A model's status of the solution that is complete: its bits, and those that rounding decides.
    fn status(&mut self, set: u16, doubtful: u16, cycle: u64) -> Result<(), SinkError> {
        let _ = (set, doubtful, cycle);
        Ok(())
    }

    /// A member of the product's group has this value, in its own unit, at a stage of the chain; steps of the
    /// rounding follow behind the last stage.
    fn stage(
        &mut self,
        stage: usize,
        member: usize,
        value: f64,
        cycle: u64,
    ) -> Result<(), SinkError> {
        let _ = (stage, member, value, cycle);
        Ok(())
    }

    /// A frame left the device; `bytes` with the delimiter.
    fn frame(&mut self, cycle: u64, bytes: &[u8]) -> Result<(), SinkError> {
        let _ = (cycle, bytes);
        Ok(())
    }

    /// A pin of the controller took `level`. (After reset all are low.)
    fn pin(&mut self, cycle: u64, pin: Pin, level: bool) -> Result<(), SinkError> {
        let _ = (cycle, pin, level);
        Ok(())
    }

    /// The voltages inside a channel of the front end at a hold instant.
    fn inner(&mut self, cycle: u64, channel: u8, inner: &Inner) -> Result<(), SinkError> {
        let _ = (cycle, channel, inner);
        Ok(())
    }

    /// A solution's conversions are complete.
    fn truth(&mut self, truth: &Truth) -> Result<(), SinkError> {
        let _ = truth;
        Ok(())
    }
}

/// The conversions that feed an engine.
pub type Conversions<'a> = &'a mut dyn Iterator<Item = Result<Conversion, SinkError>>;

/// What an engine counted.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Overflows per node.
    pub overflows: Vec<u64>,
    /// Cycles of the controller.
    pub cycles: u64,
    /// Instructions executed.
    pub instructions: u64,
    /// Cycles asleep.
    pub sleeping_cycles: u64,
    /// Bytes of stack used at most.
    pub stack_peak: u64,
    /// Conversions that were not triggered in time.
    pub late_conversions: u64,
    /// Conversions whose result the firmware never saw.
    pub lost_conversions: u64,
    /// Solutions that were not finished before the next ones' conversions were complete.
    pub missed_deadlines: u64,
    /// Pin edges, hold instants and serial bytes off the design's schedule.
    pub mistimed: u64,
    /// The first of them, in words.
    pub first_mistimed: Option<String>,
    /// Returns from interrupts whose registers were compared with those at their entry.
    pub checked_returns: u64,
    /// Those that left other registers, or another SREG, than they found.
    pub damaged_returns: u64,
    /// The first vector of them, in words.
    pub first_damage: Option<String>,
    /// Worst interrupt latency in cycles.
    pub isr_latency_max_cycles: u64,
    /// Why the emulated program crashed, with its address and instruction.
    pub crash: Option<String>,
    /// Host seconds spent.
    pub host_seconds: f64,
    /// What is worth saying about the run, such as saturated amplifiers.
    pub remarks: Vec<String>,
}

/// Why an engine could not run to its end.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// The sink refused or a conversion did not arrive.
    #[error(transparent)]
    Link(#[from] SinkError),
    /// The input is not usable.
    #[error("{0}")]
    Input(String),
}

/// An interpretation of an app's algorithm, fed conversion by conversion. It keeps nothing of a run but what
/// the algorithm itself keeps.
pub trait Engine {
    /// Takes the next conversion and shows what it makes of it.
    ///
    /// # Errors
    /// A refusing sink, unusable input.
    fn conversion(
        &mut self,
        conversion: &Conversion,
        sink: &mut dyn Sink,
    ) -> Result<(), EngineError>;

    /// What was counted so far.
    fn summary(&self) -> Summary {
        Summary::default()
    }

    /// Takes all of `conversions`.
    ///
    /// # Errors
    /// A refusing sink, missing conversions, unusable input.
    fn run(
        &mut self,
        conversions: Conversions<'_>,
        sink: &mut dyn Sink,
    ) -> Result<Summary, EngineError> {
        for conversion in conversions {
            self.conversion(&conversion?, sink)?;
        }
        Ok(self.summary())
    }
}

/// The emulated device in its surroundings, which makes the conversions.
pub trait Device {
    /// Runs to the end of the run.
    ///
    /// # Errors
    /// A refusing sink.
    fn run(&mut self, sink: &mut dyn Sink) -> Result<Summary, EngineError>;
}

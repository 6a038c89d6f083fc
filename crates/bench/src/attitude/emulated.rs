//! The emulated chip on its breadboard as an engine.

use std::sync::Arc;
use std::time::Instant;

use cardan_emulator::{ATMEGA328P, Machine, Stop, Supply};
use cardan_firmware::nodes::{Accumulator, Sample};
use cardan_frontend::{AdcErrors, Design, Frontend};
use cardan_scenario::{Scenario, Trajectory};
use cardan_spec::ThirdTilt;
use cardan_spec::calibration::{Calibration, LEN};
use cardan_spec::timing::{Averaging, CPU_HZ};

use super::board::{Board, State};
use super::{calibration_of, settings_of};
use crate::app::Configuration;
use crate::engine::{Device, EngineError, Sink, Summary};
use crate::image::Firmware;

/// The voltage at AREF, where the board has a capacitor and nothing else: the design converts against
/// AVCC, and firmware that takes the pin's voltage instead gives other codes.
const AREF_VOLTS: f64 = 4.5;

/// A machine with its firmware, ready on a board.
pub(super) struct EmulatedDevice {
    machine: Machine,
    firmware: Firmware,
    frontend: Frontend<Arc<Trajectory>>,
    adc: AdcErrors,
    trajectory: Arc<Trajectory>,
    calibration: Calibration,
    /// The settings in the EEPROM.
    settings: Vec<u8>,
    solutions: u64,
    averaging: Averaging,
    third_tilt: ThirdTilt,
}

impl EmulatedDevice {
    pub(super) fn new(
        scenario: &Scenario,
        seed: u64,
        trajectory: Arc<Trajectory>,
        configuration: &Configuration,
        firmware: &Firmware,
    ) -> Result<Self, String> {
        let frontend = Frontend::new(scenario, seed, Arc::clone(&trajectory))
            .map_err(|error| format!("scenario {}: {error}", scenario.name))?;
        let mut machine = Machine::new(&ATMEGA328P, CPU_HZ);
        machine.load(&firmware.image);
        machine.set_supply(Supply {
            aref_volts: AREF_VOLTS,
            ..machine.supply()
        });
        let settings = settings_of(configuration);
        let image = settings.image();
        machine.eeprom_mut()[..LEN].copy_from_slice(&image);
        Ok(Self {
            machine,
            firmware: firmware.clone(),
            frontend,
            adc: AdcErrors::new(scenario, seed),
            trajectory,
            calibration: calibration_of(&settings.words),
            settings: image.to_vec(),
            solutions: configuration.solutions,
            averaging: settings.averaging,
            third_tilt: settings.third_tilt,
        })
    }

    /// The same with another converter.
    pub(super) fn with_converter(self, adc: AdcErrors) -> Self {
        Self { adc, ..self }
    }
}

impl Device for EmulatedDevice {
    fn run(&mut self, sink: &mut dyn Sink) -> Result<Summary, EngineError> {
        let started = Instant::now();
        let mut board = Board {
            frontend: self.frontend.clone(),
            adc: self.adc.clone(),
            trajectory: Arc::clone(&self.trajectory),
            calibration: self.calibration,
            taps: self.firmware.taps,
            per_conversion: [index::<Sample>(), index::<Accumulator>()],
            sink,
            solutions: self.solutions,
            averaging: self.averaging,
            has_comparator: self.third_tilt == ThirdTilt::Comparator,
            state: State::default(),
        };
        // The last frame must be out a block's time after the last solution's conversions: computing takes
        // less, or the deadline is missed, and the frame a quarter of it.
        let limit = self.averaging.warm_up_cycles()
            + self.solutions * self.averaging.cycles()
            + self.averaging.block_cycles();
        let stop = self.machine.run(&mut board, limit);
        board.finish(self.machine.statistics().cycles);
        let stored = self.machine.eeprom_mut()[..LEN].iter().zip(&self.settings);
        if let Some(at) = stored.clone().position(|(now, before)| now != before) {
            board.state.schedule.settings(at);
        }
        if let Some(error) = board.state.error.take() {
            return Err(EngineError::Link(error));
        }
        let state = board.state;
        let mut remarks = vec![residue(board.frontend.design())];
        let saturations = board.frontend.saturations();
        remarks.extend(saturations.iter().map(|stage| format!("{stage:?}")));
        remarks.extend(self.machine.reports().iter().map(ToString::to_string));
        let crash = match stop {
            Stop::Crash(crash) => Some(crash.to_string()),
            Stop::Sleep => Some("the program went to sleep with interrupts disabled".into()),
            Stop::Break => Some("the program executed BREAK".into()),
            Stop::Halt => Some(format!(
                "the program halted at {:#06x}: it panicked",
                self.machine.pc()
            )),
            Stop::Limit | Stop::Requested => None,
        };
        let statistics = self.machine.statistics();
        let top = self.machine.data().len() as u64 - 1;
        Ok(Summary {
            overflows: Vec::new(),
            cycles: statistics.cycles,
            instructions: statistics.instructions,
            sleeping_cycles: statistics.sleeping_cycles,
            stack_peak: top.saturating_sub(u64::from(statistics.lowest_sp)),
            late_conversions: state.late,
            lost_conversions: state.lost,
            missed_deadlines: state.missed_deadlines,
            mistimed: state.schedule.violations(),
            first_mistimed: state.schedule.first_violation(),
            checked_returns: statistics.vectors.iter().map(|vector| vector.returns).sum(),
            damaged_returns: statistics.vectors.iter().map(|vector| vector.damaged).sum(),
            first_damage: self
                .machine
                .interrupt_damage()
                .first()
                .map(ToString::to_string),
            isr_latency_max_cycles: statistics
                .vectors
                .iter()
                .map(|vector| vector.latency_max)
                .max()
                .unwrap_or(0),
            crash,
            host_seconds: started.elapsed().as_secs_f64(),
            remarks,
        })
    }
}

/// What the tilt channels' multiplexer costs.
fn residue(design: &Design) -> String {
    format!(
        "tilt multiplexer: {:.4} LSB of the neighbour's full scale remain in an average, by design",
        design.tilt.residue_lsb
    )
}

const fn index<N: cardan_datapath::Node>() -> usize {
    N::INDEX
}

//! The breadboard of the attitude sensor, wired like its schematic: the chip's pins PB1 (carrier),
//! PB2 (strobe), PB3 and PD3 (the tilt channels' multiplexer) drive the front end, whose four outputs
//! are ADC0..ADC3; PB5 shows when the firmware computes; the serial line ends in the sink. A third tilt
//! axis is on ADC4 where it is measured; where it is compared, it is on AIN0 (PD6), beside mid supply on
//! AIN1 (PD7).
//!
//! The firmware reads the comparator after the last conversion of a solution. That conversion, and what
//! follows it, waits here for the reading, so that it can be published with what belongs to it.

use cardan_emulator::{AnalogInput, Conversion as Converted, Environment, Pin, PortDrive};
use cardan_frontend::{AdcErrors, Frontend, Pin as DrivenPin};
use cardan_golden::{
    Angles, Attitude, EarthField, Readings, angles_of, code_of_tilt_z, codes_of, ideal_readings,
};
use cardan_scenario::{Stimulus, Trajectory};
use cardan_spec::calibration::Calibration;
use cardan_spec::nodes;
use cardan_spec::timing::{Averaging, CONVERSION_CYCLES, CPU_HZ};
use cardan_spec::{Channel, MOST_CHANNELS, REFERENCE_V, frame};
use cardan_units::{Cycles, Volts};

use super::schedule::Schedule;
use crate::engine::{Conversion, Sink, SinkError, ThirdTilt, Truth};
use crate::image::TapTable;
use std::collections::VecDeque;
use std::sync::Arc;

/// Longest message kept while waiting for its delimiter: a text line or a broken frame.
const LONGEST_MESSAGE: usize = 64;

/// What the third tilt channel is compared with.
const MID_SUPPLY_V: f64 = REFERENCE_V / 2.0;

/// The pins by which the firmware drives the board.
const CARRIER: Pin = Pin::b(1);
const STROBE: Pin = Pin::b(2);
const SELECT: Pin = Pin::b(3);
const SETTLED: Pin = Pin::d(3);
const TXD: Pin = Pin::d(1);
const SOLVING: Pin = Pin::b(5);

/// Everything outside the chip.
pub(super) struct Board<'a> {
    pub(super) frontend: Frontend<Arc<Trajectory>>,
    pub(super) adc: AdcErrors,
    pub(super) trajectory: Arc<Trajectory>,
    pub(super) calibration: Calibration,
    pub(super) taps: Option<TapTable>,
    /// Which nodes are written in the sample interrupt, once per conversion.
    pub(super) per_conversion: [usize; 2],
    pub(super) sink: &'a mut dyn Sink,
    /// Solutions of the run.
    pub(super) solutions: u64,
    pub(super) averaging: Averaging,
    /// The firmware knows of a third tilt axis at the comparator.
    pub(super) has_comparator: bool,
    pub(super) state: State,
}

/// What the board has seen so far.
#[derive(Debug, Default)]
pub(super) struct State {
    conversions: u64,
    last_hold: Option<u64>,
    ideal: Option<(u64, f64)>,
    hold_sum: u128,
    sampled_writes: [u64; 2],
    message: Vec<u8>,
    pub(super) frames: u64,
    pub(super) late: u64,
    pub(super) lost: u64,
    pub(super) missed_deadlines: u64,
    pub(super) schedule: Schedule,
    /// Conversions from the last one of a solution on, whose third axis is not read yet.
    waiting: VecDeque<Conversion>,
    third_tilt_read: Option<u64>,
    /// Cycles at which the conversions of the solutions that are not finished were complete.
    pending: VecDeque<u64>,
    pub(super) error: Option<SinkError>,
}

impl Board<'_> {
    /// Conversions of the whole run, warm-up included.
    pub(super) fn last_conversion(&self) -> u64 {
        self.averaging.warm_up_conversions() as u64
            + self.solutions * self.averaging.conversions() as u64
    }

    fn keep(&mut self, result: Result<(), SinkError>) {
        if let Err(error) = result {
            self.state.error.get_or_insert(error);
        }
    }

    /// The instant that a reading taken at `cycle` stands for, in seconds.
    fn instant_s(&self, cycle: u64) -> f64 {
        let delay_s = self.frontend.design().group_delay_s();
        (Cycles(cycle).seconds(CPU_HZ) - delay_s).max(0.0)
    }

    /// The bipolar code of memoryless ideal sensors of the true specific force and field, a group
    /// delay before `cycle`.
    fn experienced_code(&self, cycle: u64, channel: Channel) -> f64 {
        let experience = self.trajectory.at(self.instant_s(cycle));
        let ([fx, fy, fz], [bx, by, _]) = (experience.specific_force_g, experience.field_ut);
        let field = self.trajectory.field();
        let total_ut = libm::hypot(field.horizontal_ut, field.vertical_ut);
        // Gravity is minus the specific force of a device at rest.
        let readings = Readings {
            tilt: [-fx, -fy],
            field: [bx / total_ut, by / total_ut],
        };
        let code = match channel {
            Channel::TiltZ => code_of_tilt_z(-fz, &self.calibration),
            _ => codes_of(&readings, &self.calibration).map(|codes| codes[channel as usize]),
        };
        code.unwrap_or(f64::NAN)
    }

    /// The bipolar code of memoryless ideal sensors at rest in the true attitude, a group delay before
    /// `cycle`.
    fn direct_code(&self, cycle: u64, channel: Channel) -> f64 {
        let earth = EarthField::from(&self.calibration);
        let code = |attitude: Attitude| match channel {
            Channel::TiltZ => code_of_tilt_z(attitude[(2, 2)], &self.calibration),
            _ => codes_of(&ideal_readings(&attitude, earth), &self.calibration)
                .map(|codes| codes[channel as usize]),
        };
        let attitude = self.trajectory.truth_at(self.instant_s(cycle));
        attitude.and_then(code).unwrap_or(f64::NAN)
    }

    /// The voltage of the third tilt channel, mid supply where none is fitted.
    fn third_volts(&mut self, cycle: u64) -> f64 {
        match self.frontend.third_tilt(Cycles(cycle)) {
            Ok(volts) => volts.map_or(MID_SUPPLY_V, |volts| volts.0),
            Err(error) => {
                self.keep(Err(error.into()));
                MID_SUPPLY_V
            }
        }
    }

    /// The third axis is read, for the solution that waits for it, if any.
    fn third_tilt_read(&mut self, cycle: u64, volts: f64) {
        // One look of the program may ask twice.
        if self.state.third_tilt_read.replace(cycle) == Some(cycle) {
            return;
        }
        let Some(mut last) = self.state.waiting.pop_front() else {
            return;
        };
        let t_s = Cycles(cycle).seconds(CPU_HZ) - self.frontend.design().group_delay_s();
        let truth = self.trajectory.truth_at(t_s.max(0.0));
        last.third_tilt = Some(ThirdTilt {
            upside_down: volts > MID_SUPPLY_V,
            // Gravity's component along body z.
            truly_upside_down: truth.map(|attitude| attitude[(2, 2)] < 0.0),
        });
        self.publish(&last);
        while let Some(next) = self.state.waiting.front().copied() {
            if self.completes(&next) {
                return;
            }
            self.state.waiting.pop_front();
            self.publish(&next);
        }
    }

    /// The firmware has not read the third axis for the solution that waits for it: what it would have
    /// read counts as a lost conversion.
    fn third_tilt_missed(&mut self, cycle: u64) {
        if let Some(last) = self.state.waiting.front_mut() {
            last.lost = true;
            self.state.lost += 1;
            let volts = self.third_volts(cycle);
            self.third_tilt_read(cycle, volts);
        }
    }

    /// The run has ended at `cycle`.
    pub(super) fn finish(&mut self, cycle: u64) {
        while !self.state.waiting.is_empty() && self.state.error.is_none() {
            self.third_tilt_missed(cycle);
        }
        // A solution that the solving pin never showed missed its deadline as well.
        self.state.missed_deadlines += self.state.pending.len() as u64;
    }

    /// The channel of a conversion, if this device has it.
    fn converted(&self, input: AnalogInput) -> Option<Channel> {
        match input {
            AnalogInput::Pin(pin) if usize::from(pin) < self.averaging.channels() => {
                Channel::of(pin)
            }
            _ => None,
        }
    }

    /// Bytes of a binary frame.
    fn frame_len(&self) -> usize {
        match self.averaging.channels() {
            MOST_CHANNELS => frame::MOST_WIRE_LEN,
            _ => frame::WIRE_LEN,
        }
    }

    fn publish(&mut self, conversion: &Conversion) {
        let result = self.sink.conversion(conversion);
        self.keep(result);
    }

    /// Position in its period; none in the warm-up.
    fn index(&self, conversion: &Conversion) -> Option<usize> {
        let settled = conversion
            .sequence
            .checked_sub(self.averaging.warm_up_conversions() as u64)?;
        Some(settled as usize % self.averaging.conversions())
    }

    fn completes(&self, conversion: &Conversion) -> bool {
        self.index(conversion) == Some(self.averaging.conversions() - 1)
    }

    /// A solution's conversions are complete: its output instant is the centre of the hold instants
    /// of those that are averaged, less the group delay.
    fn complete(&mut self, done: u64) {
        let conversions = self.averaging.length() * self.averaging.channels();
        let mean = self.state.hold_sum as f64 / conversions as f64;
        self.state.hold_sum = 0;
        self.state.pending.push_back(done);
        let time_s = mean / CPU_HZ as f64 - self.frontend.design().group_delay_s();
        // Half of what is averaged, on either side.
        let reach_s = Cycles(done).seconds(CPU_HZ) - mean / CPU_HZ as f64;
        let is_known = !self
            .trajectory
            .is_bridged(time_s - reach_s, time_s + reach_s);
        let attitude = self.trajectory.truth_at(time_s.max(0.0));
        let attitude = attitude.filter(|_| is_known);
        let values = attitude.map(|m| {
            let Angles { yaw, pitch, roll } = angles_of(&m);
            vec![yaw.0, pitch.0, roll.0]
        });
        let result = self.sink.truth(&Truth {
            cycle: done,
            time_s,
            values,
        });
        self.keep(result);
    }
}

impl Environment for Board<'_> {
    fn clock_changed(&mut self, cycle: u64, hz: u64) {
        self.state.schedule.clock(cycle, hz);
    }

    fn analog_driven(&mut self, cycle: u64, input: AnalogInput, by: PortDrive) {
        let input = match input {
            AnalogInput::Pin(channel) => format!("ADC{channel}"),
            AnalogInput::Ain0 if !self.has_comparator => return,
            other => format!("{other:?}"),
        };
        let by = match by {
            PortDrive::Output(true) => "drives it high",
            PortDrive::Output(false) => "drives it low",
            PortDrive::PullUp => "pulls it up",
        };
        self.state.schedule.driven(cycle, &input, by);
    }

    fn pin_edge(&mut self, cycle: u64, pin: Pin, level: bool) {
        let result = self.sink.pin(cycle, pin, level);
        self.keep(result);
        let driven = match pin {
            CARRIER => DrivenPin::Carrier,
            STROBE => DrivenPin::Strobe,
            SELECT => DrivenPin::Select,
            SETTLED => DrivenPin::Settled,
            SOLVING if !level => {
                self.state.schedule.solved(cycle);
                // The deadline: done before the next block's conversions are complete.
                if let Some(complete) = self.state.pending.pop_front() {
                    self.state.missed_deadlines +=
                        u64::from(cycle > complete + self.averaging.block_cycles());
                }
                return;
            }
            // The serial line is watched byte by byte, a solution by its end.
            TXD | SOLVING => return,
            _ => return self.state.schedule.unused(cycle, pin),
        };
        match driven {
            DrivenPin::Carrier => self.state.schedule.carrier(cycle),
            DrivenPin::Strobe => self.state.schedule.strobe(cycle),
            DrivenPin::Select => self.state.schedule.select(cycle, level),
            DrivenPin::Settled => self.state.schedule.settled(cycle, level),
        }
        let result = self.frontend.pin_edge(Cycles(cycle), driven, level);
        self.keep(result.map_err(Into::into));
    }

    fn analog(&mut self, cycle: u64, input: AnalogInput) -> f64 {
        let channel = match input {
            AnalogInput::Pin(pin) => Channel::of(pin),
            AnalogInput::Ain0 => {
                let volts = self.third_volts(cycle);
                self.third_tilt_read(cycle, volts);
                return volts;
            }
            AnalogInput::Ain1 => return MID_SUPPLY_V,
            _ => None,
        };
        // Unconnected inputs read 0 V.
        let Some(channel) = channel else { return 0.0 };
        match self.frontend.voltage(Cycles(cycle), channel) {
            Ok(Volts(volts)) => {
                // The first conversion after enabling holds later by design.
                if self.state.conversions > 0 {
                    self.state.schedule.hold(cycle);
                }
                self.state.ideal = Some((cycle, volts));
                if self.state.conversions < self.last_conversion() {
                    let inner = self.frontend.inner(channel);
                    let result = self.sink.inner(cycle, channel as u8, &inner);
                    self.keep(result);
                }
                self.adc.apply(Volts(volts), self.state.conversions).0
            }
            Err(error) => {
                self.keep(Err(error.into()));
                0.0
            }
        }
    }

    fn conversion(&mut self, event: Converted) {
        let sequence = self.state.conversions;
        self.state.conversions += 1;
        if sequence >= self.last_conversion() {
            return;
        }
        let converted = self.converted(event.input);
        let (Some(channel), Some((_, ideal_volts))) = (converted, self.state.ideal.take()) else {
            let what = format!(
                "the firmware converted {:?}, where this attitude sensor has only ADC0 to ADC{}",
                event.input,
                self.averaging.channels() - 1
            );
            return self.keep(Err(what.into()));
        };
        // The first conversion after enabling takes longer; from then on each follows its
        // predecessor at exactly the conversion period.
        let late = match self.state.last_hold {
            Some(last) if sequence > 1 => event.hold_cycle != last + CONVERSION_CYCLES,
            _ => false,
        };
        let lost = event.discarded || event.overwrote_unread;
        self.state.last_hold = Some(event.hold_cycle);
        self.state.late += u64::from(late);
        self.state.lost += u64::from(lost);
        let conversion = Conversion {
            sequence,
            cycle: event.hold_cycle,
            channel: channel as u8,
            code: event.code,
            ideal_volts,
            direct_code: self.direct_code(event.hold_cycle, channel),
            experienced_code: self.experienced_code(event.hold_cycle, channel),
            late,
            lost,
            third_tilt: None,
        };
        let waits = self.has_comparator && self.completes(&conversion);
        if waits {
            self.third_tilt_missed(event.done_cycle);
        }
        if waits || !self.state.waiting.is_empty() {
            self.state.waiting.push_back(conversion);
        } else {
            self.publish(&conversion);
        }
        let Some(index) = self.index(&conversion) else {
            return;
        };
        if self.averaging.counts(index) {
            self.state.hold_sum += u128::from(event.hold_cycle);
        }
        if index + 1 == self.averaging.conversions() {
            self.complete(event.done_cycle);
        }
    }

    fn uart_tx(&mut self, cycle: u64, byte: u8) {
        let frame_len = self.frame_len();
        let message = &mut self.state.message;
        self.state.schedule.byte(cycle, message.is_empty());
        message.push(byte);
        if byte == frame::DELIMITER
            || byte == b'\n' && message.len() > frame_len
            || message.len() == LONGEST_MESSAGE
        {
            let bytes = std::mem::take(message);
            if self.state.frames < self.solutions {
                let result = self.sink.frame(cycle, &bytes);
                self.keep(result);
            }
            self.state.frames += 1;
        }
    }

    fn strobe(&mut self, cycle: u64, value: u8, data: &[u8]) {
        let node = usize::from(value);
        let Some(table) = self.taps else { return };
        let start = table.address + 4 * node;
        let word = match data.get(start..start + 4) {
            Some(&[a, b, c, d]) if node < table.len => i32::from_le_bytes([a, b, c, d]),
            _ => {
                let what = format!("the firmware published node {node}, which its table lacks");
                return self.keep(Err(what.into()));
            }
        };
        // The interrupt goes on while the last solution is computed and sent.
        if let Some(slot) = self.per_conversion.iter().position(|&index| index == node) {
            let writes = &mut self.state.sampled_writes[slot];
            *writes += 1;
            let most = self.solutions * nodes::SAMPLE.per_solution(self.averaging) as u64;
            if *writes > most {
                return;
            }
        }
        let result = self.sink.word(node, i64::from(word), cycle);
        self.keep(result);
    }

    fn stop_requested(&self) -> bool {
        self.state.error.is_some() || self.state.frames >= self.solutions
    }
}

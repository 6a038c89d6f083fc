//! The device: what a board runs in its sample interrupt and in its main loop.

use cardan_datapath::fixed::traits::Fixed;
use cardan_datapath::{Arithmetic, Container, Deployed, Node, Tap, Value};
use cardan_spec::{ThirdTilt, flags, frame as layout};
use embedded_hal::digital::OutputPin;

use crate::attitude::{State, solve};
use crate::averaging::{Averager, Averages};
use crate::calibration::{Calibration, Settings};
use crate::frame::Frame;
use crate::hal::{Serial, TriggeredAdc};

/// One sample interrupt: takes the result, re-arms the trigger, selects the next channel, adds.
#[inline(always)]
pub fn sample<M: Arithmetic>(m: &M, averager: &mut Averager<M>, adc: &mut impl TriggeredAdc) {
    let code = adc.result();
    // First what the next trigger waits for: there are 269 cycles from the end of a conversion to
    // it, and other interrupts may have taken some of them.
    if !adc.rearm() {
        averager.note_late();
    }
    let turn = averager.turn();
    let next = averager.advance(turn);
    adc.select(next.channel());
    averager.add(m, turn, code);
}

/// The solver with its state: from averages to frames.
pub struct Solver<T: Tap> {
    m: Deployed<T>,
    calibration: Calibration<Deployed<T>>,
    state: State<Deployed<T>>,
    sequence: u16,
    uncalibrated: bool,
}

impl<T: Tap> Solver<T> {
    /// Starts with these settings.
    #[inline(never)]
    pub fn new(tap: T, settings: &Settings) -> Self {
        let m = Deployed::new(tap);
        let calibration = Calibration::new(&m, &settings.words, settings.third_tilt);
        let state = State::new(&m, settings.averaging);
        Self {
            m,
            calibration,
            state,
            sequence: 0,
            uncalibrated: settings.uncalibrated,
        }
    }

    /// Somebody knows that the device is upright now.
    pub fn set_upright(&mut self) {
        self.state.set_upright(&self.m);
    }

    /// The arithmetic, for its tap.
    pub const fn arithmetic(&self) -> &Deployed<T> {
        &self.m
    }

    /// Computes one solution. `sign` is what the comparator tells of gravity along body z, if the third
    /// tilt axis is there: 1 upright, -1 upside down.
    #[inline(never)]
    pub fn solve(&mut self, averages: &Averages<Deployed<T>>, sign: i8) -> Frame {
        let angles = solve(&self.m, &self.calibration, &mut self.state, averages, sign);
        let mut status = self.m.take_status();
        if averages.late {
            status |= flags::LATE;
        }
        if self.uncalibrated {
            status |= flags::UNCALIBRATED;
        }
        let frame = Frame {
            sequence: self.sequence,
            averages: averages.values.map(word),
            third: self.calibration.third_tilt == ThirdTilt::Measured,
            angles: [word(angles.yaw), word(angles.pitch), word(angles.roll)],
            flags: status,
        };
        self.sequence = self.sequence.wrapping_add(1);
        frame
    }
}

/// A value with the frame's fractional bits, whatever the node's format.
fn word<T: Tap, N: Node>(value: Value<Deployed<T>, N>) -> i16 {
    let raw = value.word().to_bits();
    const { assert!(N::FORMAT.word <= 32, "what frames hold is at most 32 bits") };
    let (frac, wire) = (N::FORMAT.frac, layout::FRAC);
    if frac >= wire {
        (raw.to_i32() >> (frac - wire)) as i16
    } else {
        raw.to_i16() << (wire - frac)
    }
}

/// The main loop's side: solutions out as frames, commands in.
pub struct Device<T: Tap, S: Serial, P: OutputPin> {
    solver: Solver<T>,
    serial: S,
    solving: P,
    text: bool,
}

impl<T: Tap, S: Serial, P: OutputPin> Device<T, S, P> {
    /// A device that sends binary frames on `serial` and shows on `solving` when it computes.
    pub fn new(solver: Solver<T>, serial: S, solving: P) -> Self {
        Self {
            solver,
            serial,
            solving,
            text: false,
        }
    }

    /// Solves and sends; `sign` as for [`Solver::solve`]. Returns false if the line was still busy and
    /// the frame was not sent.
    #[inline(never)]
    pub fn solution(&mut self, averages: &Averages<Deployed<T>>, sign: i8) -> bool {
        match self.serial.receive() {
            Some(layout::COMMAND_TEXT) => self.text = true,
            Some(layout::COMMAND_BINARY) => self.text = false,
            Some(layout::COMMAND_UPRIGHT) => self.solver.set_upright(),
            Some(layout::COMMAND_SETTINGS) => self.serial.take_settings(),
            _ => {}
        }
        // A pin of the reference boards cannot fail.
        let _ = self.solving.set_high();
        let frame = self.solver.solve(averages, sign);
        let _ = self.solving.set_low();
        if self.text {
            self.send_text(&frame)
        } else {
            self.serial.send(&frame.encode())
        }
    }

    /// Not inlined: the line would lie on the stack of frames as well.
    #[inline(never)]
    fn send_text(&mut self, frame: &Frame) -> bool {
        self.serial.send(&frame.text())
    }
}

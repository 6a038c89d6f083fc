//! The device: what a board runs in its sample interrupt and in its main loop.

use cardan_datapath::fixed::traits::Fixed;
use cardan_datapath::{Arithmetic, Container, Deployed, Node, Tap, Value};
use cardan_spec::calibration::{LEN, WORDS};
use cardan_spec::{flags, frame as layout};
use embedded_hal::digital::OutputPin;

use crate::attitude::{State, solve};
use crate::averaging::{Averager, Sums};
use crate::calibration::{Calibration, NOMINAL, decode};
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
    adc.select(turn.next_channel());
    averager.add(m, turn, code);
}

/// The solver with its state: from sums to frames.
pub struct Solver<T: Tap> {
    m: Deployed<T>,
    calibration: Calibration<Deployed<T>>,
    state: State<Deployed<T>>,
    sequence: u16,
    uncalibrated: bool,
}

impl<T: Tap> Solver<T> {
    /// Starts with the calibration image from EEPROM, or with nominal values if it is invalid.
    pub fn new(tap: T, eeprom: &[u8; LEN]) -> Self {
        match decode(eeprom) {
            Some(words) => Self::with_words(tap, &words, false),
            None => Self::with_words(tap, &NOMINAL, true),
        }
    }

    fn with_words(tap: T, words: &[i32; WORDS], uncalibrated: bool) -> Self {
        let m = Deployed::new(tap);
        let calibration = Calibration::new(&m, words);
        let state = State::new(&m);
        Self {
            m,
            calibration,
            state,
            sequence: 0,
            uncalibrated,
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

    /// Computes one solution. `late` says that a conversion or a solution was late.
    #[inline(never)]
    pub fn solve(&mut self, sums: &Sums<Deployed<T>>, late: bool) -> Frame {
        let angles = solve(&self.m, &self.calibration, &mut self.state, sums);
        let mut status = self.m.take_status();
        if late {
            status |= flags::LATE;
        }
        if self.uncalibrated {
            status |= flags::UNCALIBRATED;
        }
        let frame = Frame {
            sequence: self.sequence,
            sums: sums.sums.map(word16),
            angles: [angle(angles.yaw), angle(angles.pitch), angle(angles.roll)],
            flags: status,
        };
        self.sequence = self.sequence.wrapping_add(1);
        frame
    }
}

fn word16<T: Tap, N: Node>(value: Value<Deployed<T>, N>) -> i16 {
    value.word().to_bits().to_i16()
}

/// An angle with the frame's fractional bits, whatever the node's format.
fn angle<T: Tap, N: Node>(value: Value<Deployed<T>, N>) -> i16 {
    let raw = value.word().to_bits();
    const { assert!(N::FORMAT.word <= 32, "angles are at most 32 bits") };
    let (frac, wire) = (N::FORMAT.frac, layout::ANGLE_FRAC);
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

    /// Solves and sends. Returns false if the line was still busy and the frame was not sent.
    pub fn solution(&mut self, sums: &Sums<Deployed<T>>, late: bool) -> bool {
        match self.serial.receive() {
            Some(layout::COMMAND_TEXT) => self.text = true,
            Some(layout::COMMAND_BINARY) => self.text = false,
            Some(layout::COMMAND_UPRIGHT) => self.solver.set_upright(),
            _ => {}
        }
        // A pin of the reference boards cannot fail.
        let _ = self.solving.set_high();
        let frame = self.solver.solve(sums, late);
        let _ = self.solving.set_low();
        if self.text {
            self.serial.send(&frame.text())
        } else {
            self.serial.send(&frame.encode())
        }
    }
}

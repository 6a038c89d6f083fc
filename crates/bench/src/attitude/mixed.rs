//! The firmware's algorithm on run-time formats: the real interpretation, the steps between real
//! and deployed, and native runs of other word lengths.

use std::cell::RefCell;
use std::rc::Rc;

use cardan_datapath::{Arithmetic, Format, Node, Value};
use cardan_firmware::attitude::{Angles, State, solve};
use cardan_firmware::averaging::{Averages, Decimator};
use cardan_firmware::calibration::{Calibration, Settings};
use cardan_firmware::frame::Frame;
use cardan_firmware::nodes::NODE_COUNT;
use cardan_numerics::{Formats, Mixed, Observer};
use cardan_spec::ThirdTilt;
use cardan_spec::frame::FRAC;
use cardan_units::AdcCode;

use super::sign;
use crate::engine::{Conversion, Engine, EngineError, Sink, Summary};

/// A node, its value, and its word where it has one.
type Write = (usize, f64, Option<i64>);

/// Collects writes until the engine passes them on.
#[derive(Clone, Debug, Default)]
struct Buffer {
    writes: Rc<RefCell<Vec<Write>>>,
    overflows: Rc<RefCell<Vec<u64>>>,
}

impl Observer for Buffer {
    fn write(&self, node: usize, value: f64, raw: Option<i64>) {
        self.writes.borrow_mut().push((node, value, raw));
    }

    fn overflow(&self, node: usize) {
        if let Some(count) = self.overflows.borrow_mut().get_mut(node) {
            *count += 1;
        }
    }
}

/// What the engine shows: the values, or the words and frames of a device with these formats.
enum Shows {
    Values,
    Words(Vec<Format>),
}

/// The algorithm in formats chosen at run time.
pub(super) struct MixedEngine {
    buffer: Buffer,
    m: Mixed<Buffer>,
    calibration: Calibration<Mixed<Buffer>>,
    state: State<Mixed<Buffer>>,
    decimator: Decimator<Mixed<Buffer>>,
    third_tilt: ThirdTilt,
    /// Of the next frame.
    sequence: u16,
    shows: Shows,
}

impl MixedEngine {
    /// Shows node values as real numbers.
    pub(super) fn values(formats: &Formats, settings: &Settings) -> Self {
        Self::new(formats, settings, Shows::Values)
    }

    /// Shows words and frames, as the firmware would in `formats`.
    pub(super) fn words(formats: &Formats, settings: &Settings) -> Result<Self, String> {
        let all: Option<Vec<Format>> = formats.as_slice().iter().copied().collect();
        let all = all.ok_or("a device has a format for every node")?;
        Ok(Self::new(formats, settings, Shows::Words(all)))
    }

    fn new(formats: &Formats, settings: &Settings, shows: Shows) -> Self {
        let buffer = Buffer::default();
        buffer.overflows.borrow_mut().resize(NODE_COUNT, 0);
        let m = Mixed::new(formats, buffer.clone());
        Self {
            buffer,
            calibration: Calibration::new(&m, &settings.words, settings.third_tilt),
            state: State::new(&m, settings.averaging),
            decimator: Decimator::new(&m, settings.averaging),
            m,
            third_tilt: settings.third_tilt,
            sequence: 0,
            shows,
        }
    }

    fn pass_on(&self, cycle: u64, sink: &mut dyn Sink) -> Result<(), EngineError> {
        for (node, value, raw) in self.buffer.writes.borrow_mut().drain(..) {
            match (&self.shows, raw) {
                (Shows::Words(_), Some(raw)) => sink.word(node, raw, cycle)?,
                _ => sink.real(node, value, cycle)?,
            }
        }
        Ok(())
    }

    fn frame(
        &self,
        formats: &[Format],
        sequence: u16,
        averages: &Averages<Mixed<Buffer>>,
        angles: &Angles<Mixed<Buffer>>,
        flags: u16,
    ) -> Frame {
        Frame {
            sequence,
            averages: averages.values.map(|average| word(average, formats)),
            third: self.third_tilt == ThirdTilt::Measured,
            angles: [
                word(angles.yaw, formats),
                word(angles.pitch, formats),
                word(angles.roll, formats),
            ],
            flags,
        }
    }
}

/// A value with the frame's fractional bits, whatever the node's format.
fn word<N: Node>(value: Value<Mixed<Buffer>, N>, formats: &[Format]) -> i16 {
    let raw = value.word().raw.unwrap_or_default();
    let frac = formats[N::INDEX].frac;
    if frac >= FRAC {
        (raw >> (frac - FRAC)) as i16
    } else {
        (raw << (FRAC - frac)) as i16
    }
}

impl Engine for MixedEngine {
    fn conversion(
        &mut self,
        conversion: &Conversion,
        sink: &mut dyn Sink,
    ) -> Result<(), EngineError> {
        let m = &self.m;
        let averages = self.decimator.push(m, AdcCode(conversion.code));
        let solved = averages.map(|averages| {
            let sign = sign(conversion);
            let angles = solve(m, &self.calibration, &mut self.state, &averages, sign);
            (averages, angles)
        });
        self.pass_on(conversion.cycle, sink)?;
        if let (Some((averages, angles)), Shows::Words(formats)) = (solved, &self.shows) {
            let flags = self.m.take_status();
            let frame = self.frame(formats, self.sequence, &averages, &angles, flags);
            sink.frame(conversion.cycle, &frame.encode())?;
            self.sequence = self.sequence.wrapping_add(1);
        }
        Ok(())
    }

    fn summary(&self) -> Summary {
        Summary {
            overflows: self.buffer.overflows.borrow().clone(),
            ..Summary::default()
        }
    }
}

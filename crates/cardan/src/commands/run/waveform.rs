//! Pin levels as a value change dump (IEEE 1364, section 18), for waveform viewers.
//!
//! Times are exact: each edge is rounded once, from its cycle to the dump's unit of 1 ps.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use cardan_emulator::Pin;
use vcd::{IdCode, SimulationCommand, TimescaleUnit, Value, Writer};

use crate::failure::Failure;

/// Picoseconds per second.
const PER_SECOND: u128 = 1_000_000_000_000;
/// Pins of ports B, C and D.
const PINS: u8 = 24;

/// A dump being written.
pub(super) struct Waveform {
    writer: Writer<BufWriter<File>>,
    name: PathBuf,
    pins: Vec<IdCode>,
    levels: [bool; PINS as usize],
    clock: Clock,
    /// Time last written, in picoseconds.
    now: u64,
    error: Option<io::Error>,
}

/// Time over cycles: since `cycle`, at which `ps` had passed, the clock runs at `hz`.
#[derive(Clone, Copy)]
struct Clock {
    cycle: u64,
    ps: u64,
    hz: u64,
}

impl Clock {
    fn at(self, cycle: u64) -> u64 {
        let cycles = u128::from(cycle.saturating_sub(self.cycle));
        let hz = u128::from(self.hz.max(1));
        let since = (cycles * PER_SECOND + hz / 2) / hz;
        self.ps
            .saturating_add(u64::try_from(since).unwrap_or(u64::MAX))
    }
}

impl Waveform {
    /// Creates `file` and writes its header; the clock begins at `hz`.
    pub(super) fn create(file: &Path, hz: u64) -> Result<Self, Failure> {
        let created = File::create(file).map_err(|error| failure(file, &error))?;
        let mut writer = Writer::new(BufWriter::new(created));
        let pins = header(&mut writer).map_err(|error| failure(file, &error))?;
        Ok(Self {
            writer,
            name: file.to_owned(),
            pins,
            levels: [false; PINS as usize],
            clock: Clock {
                cycle: 0,
                ps: 0,
                hz,
            },
            now: 0,
            error: None,
        })
    }

    /// An output pin changed to `level`.
    pub(super) fn edge(&mut self, cycle: u64, pin: Pin, level: bool) {
        let before = std::mem::replace(&mut self.levels[pin.index()], level);
        if before != level && self.error.is_none() {
            self.error = self.write(self.clock.at(cycle), pin, level).err();
        }
    }

    fn write(&mut self, time: u64, pin: Pin, level: bool) -> io::Result<()> {
        if time > self.now {
            self.writer.timestamp(time)?;
            self.now = time;
        }
        let value = if level { Value::V1 } else { Value::V0 };
        self.writer.change_scalar(self.pins[pin.index()], value)
    }

    /// From `cycle` on the clock runs at `hz`.
    pub(super) fn clock_changed(&mut self, cycle: u64, hz: u64) {
        let ps = self.clock.at(cycle);
        self.clock = Clock { cycle, ps, hz };
    }

    /// A reset makes all pins inputs, which drive nothing.
    pub(super) fn reset(&mut self, cycle: u64) {
        for index in 0..PINS {
            if let Some(pin) = Pin::new(index / 8, index % 8) {
                self.edge(cycle, pin, false);
            }
        }
    }

    /// Writes the time of the end.
    pub(super) fn finish(mut self, cycle: u64) -> Result<(), Failure> {
        let end = self.clock.at(cycle).max(self.now);
        let written = match self.error.take() {
            Some(error) => Err(error),
            None => self
                .writer
                .timestamp(end)
                .and_then(|()| self.writer.flush()),
        };
        written.map_err(|error| failure(&self.name, &error))
    }
}

fn header(writer: &mut Writer<BufWriter<File>>) -> io::Result<Vec<IdCode>> {
    writer.comment("levels that the chip drives; pins that it does not drive are 0")?;
    writer.timescale(1, TimescaleUnit::PS)?;
    writer.add_module("pins")?;
    let mut pins = Vec::new();
    for index in 0..PINS {
        if let Some(pin) = Pin::new(index / 8, index % 8) {
            pins.push(writer.add_wire(1, &pin.to_string())?);
        }
    }
    writer.upscope()?;
    writer.enddefinitions()?;
    writer.timestamp(0)?;
    writer.begin(SimulationCommand::Dumpvars)?;
    for &pin in &pins {
        writer.change_scalar(pin, Value::V0)?;
    }
    writer.end()?;
    Ok(pins)
}

fn failure(file: &Path, error: &io::Error) -> Failure {
    let what = "cannot be written";
    Failure::input(format!(
        "--vcd {}: {what}: {error}; check the folder",
        file.display()
    ))
}

//! Signals over time as a value change dump (IEEE 1364, section 18), for waveform viewers.
//!
//! The unit is 1 ps, and each change is rounded once, from its cycle to that unit: at most half a
//! picosecond off, at every clock.

use std::io::{self, BufWriter};
use std::path::{Path, PathBuf};

use cardan_emulator::{Pin, Watch, Watched};
use vcd::{IdCode, SimulationCommand, TimescaleUnit, Value, VarType, Writer};

use super::signals::{SCOPES, Signal, Source};
use crate::failure::Failure;
use crate::files::{Whole, unwritten};

/// Picoseconds per second.
const PER_SECOND: u128 = 1_000_000_000_000;
/// Bits of a voltage that nobody has asked for: no number.
const UNKNOWN: u64 = u64::MAX;
/// Changes that are kept before they are written, if nothing else asks for it.
const KEPT: usize = 4096;

/// A dump being written. Changes are put in order first: a pin's edge is known when the machine
/// carries out its event, which may be an instruction after a store that comes later.
pub(super) struct Waveform {
    writer: Writer<BufWriter<Whole>>,
    name: PathBuf,
    signals: Vec<(Signal, IdCode)>,
    /// Signal of each pin, of each analog input, and of each watched value.
    pins: [Option<usize>; 24],
    analog: [Option<usize>; 8],
    values: Vec<usize>,
    pending: Vec<(u64, Change)>,
    /// Last level of each signal with one bit, last bits of each voltage.
    last: Vec<u64>,
    clock: Clock,
    /// Time last written, in picoseconds.
    now: u64,
    error: Option<io::Error>,
}

/// What happens at a cycle.
#[derive(Clone, Copy)]
enum Change {
    /// A signal takes a value: a number, or the bits of a voltage.
    Value { signal: usize, value: u64 },
    /// From here on the clock runs at this frequency.
    Clock { hz: u64 },
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
    /// Creates `file`; the clock begins at `hz`.
    pub(super) fn create(file: &Path, hz: u64, signals: Vec<Signal>) -> Result<Self, Failure> {
        let created = Whole::create(file).map_err(|error| failure(file, &error))?;
        let mut writer = Writer::new(BufWriter::new(created));
        let signals = header(&mut writer, signals).map_err(|error| failure(file, &error))?;
        let mut waveform = Self {
            writer,
            name: file.to_owned(),
            pins: [None; 24],
            analog: [None; 8],
            values: Vec::new(),
            pending: Vec::new(),
            last: vec![0; signals.len()],
            signals,
            clock: Clock {
                cycle: 0,
                ps: 0,
                hz,
            },
            now: 0,
            error: None,
        };
        for (index, (signal, _)) in waveform.signals.iter().enumerate() {
            match signal.source {
                Source::Pin(pin) => waveform.pins[pin.index()] = Some(index),
                Source::Analog(channel) => {
                    waveform.analog[usize::from(channel)] = Some(index);
                    waveform.last[index] = UNKNOWN;
                }
                Source::Value(_) => waveform.values.push(index),
            }
        }
        Ok(waveform)
    }

    /// What a [`Watch`] is to watch for this dump.
    pub(super) fn watched(&self) -> Vec<Watched> {
        let signals = self.values.iter().map(|&index| &self.signals[index].0);
        signals
            .filter_map(|signal| match signal.source {
                Source::Value(watched) => Some(watched),
                _ => None,
            })
            .collect()
    }

    /// Writes the values at the beginning, those of `watch` among them.
    pub(super) fn begin(&mut self, watch: Option<&Watch>) {
        let values = watch.map_or(&[][..], Watch::values);
        for (&signal, &value) in self.values.iter().zip(values) {
            self.last[signal] = value;
        }
        self.error = self.dump_all().err();
    }

    fn dump_all(&mut self) -> io::Result<()> {
        self.writer.timestamp(0)?;
        self.writer.begin(SimulationCommand::Dumpvars)?;
        for signal in 0..self.signals.len() {
            // Of a voltage nothing is known before it is held.
            if !matches!(self.signals[signal].0.source, Source::Analog(_)) {
                self.write_value(signal, self.last[signal])?;
            }
        }
        self.writer.end()
    }

    /// An output pin changed to `level`.
    pub(super) fn edge(&mut self, cycle: u64, pin: Pin, level: bool) {
        if let Some(signal) = self.pins[pin.index()] {
            let value = u64::from(level);
            self.push(cycle, Change::Value { signal, value });
        }
    }

    /// The voltage of a channel is held.
    pub(super) fn held(&mut self, cycle: u64, channel: u8, volts: f64) {
        if let Some(signal) = self.analog[usize::from(channel & 7)] {
            let value = volts.to_bits();
            self.push(cycle, Change::Value { signal, value });
        }
    }

    /// From `cycle` on the clock runs at `hz`.
    pub(super) fn clock_changed(&mut self, cycle: u64, hz: u64) {
        self.push(cycle, Change::Clock { hz });
    }

    /// A reset makes all pins inputs, which drive nothing.
    pub(super) fn reset(&mut self, cycle: u64) {
        for index in 0..self.pins.len() {
            if let Some(signal) = self.pins[index] {
                self.push(cycle, Change::Value { signal, value: 0 });
            }
        }
    }

    fn push(&mut self, cycle: u64, change: Change) {
        self.pending.push((cycle, change));
        // Without watched values everything comes in its order.
        if self.values.is_empty() && self.pending.len() >= KEPT {
            self.flush();
        }
    }

    /// Takes over the changes of watched values, and writes all that has come so far. Nothing that
    /// is still to come is earlier.
    pub(super) fn take(&mut self, watch: Option<&mut Watch>) {
        let changes = watch.map(Watch::take_changes).unwrap_or_default();
        for change in changes {
            let signal = self.values[change.index];
            let value = change.value;
            let change_of_value = Change::Value { signal, value };
            self.pending.push((change.cycle, change_of_value));
        }
        self.flush();
    }

    fn flush(&mut self) {
        let mut pending = std::mem::take(&mut self.pending);
        pending.sort_by_key(|&(cycle, _)| cycle);
        for &(cycle, change) in &pending {
            match change {
                Change::Clock { hz } => {
                    let ps = self.clock.at(cycle);
                    self.clock = Clock { cycle, ps, hz };
                }
                Change::Value { signal, value } => self.change(cycle, signal, value),
            }
        }
        pending.clear();
        self.pending = pending;
    }

    fn change(&mut self, cycle: u64, signal: usize, value: u64) {
        let before = std::mem::replace(&mut self.last[signal], value);
        if before != value && self.error.is_none() {
            let time = self.clock.at(cycle);
            self.error = self.write_change(time, signal, value).err();
        }
    }

    fn write_change(&mut self, time: u64, signal: usize, value: u64) -> io::Result<()> {
        if time > self.now {
            self.writer.timestamp(time)?;
            self.now = time;
        }
        self.write_value(signal, value)
    }

    fn write_value(&mut self, signal: usize, value: u64) -> io::Result<()> {
        let (Signal { source, bits, .. }, id) = &self.signals[signal];
        let bit = |at: u32| {
            if value >> at & 1 != 0 {
                Value::V1
            } else {
                Value::V0
            }
        };
        match source {
            Source::Pin(_) => self.writer.change_scalar(*id, bit(0)),
            Source::Analog(_) => self.writer.change_real(*id, f64::from_bits(value)),
            Source::Value(_) => self.writer.change_vector(*id, (0..*bits).rev().map(bit)),
        }
    }

    /// Writes the rest and the time of the end.
    pub(super) fn finish(mut self, cycle: u64, watch: Option<&mut Watch>) -> Result<(), Failure> {
        self.take(watch);
        let end = self.clock.at(cycle).max(self.now);
        self.check()?;
        let ended = self.writer.timestamp(end);
        ended
            .and_then(|()| self.writer.flush())
            .and_then(|()| self.writer.writer().get_mut().commit())
            .map_err(|error| failure(&self.name, &error))
    }

    /// Fails once something could not be written: the run need not go on then.
    pub(super) fn check(&mut self) -> Result<(), Failure> {
        match self.error.take() {
            Some(error) => Err(failure(&self.name, &error)),
            None => Ok(()),
        }
    }
}

/// Declares the signals, scope by scope.
fn header(
    writer: &mut Writer<BufWriter<Whole>>,
    signals: Vec<Signal>,
) -> io::Result<Vec<(Signal, IdCode)>> {
    writer.comment(
        "pins: levels that the chip drives, 0 where it drives none; values of registers and \
         variables: there at the end of the instruction that writes them",
    )?;
    writer.timescale(1, TimescaleUnit::PS)?;
    let mut declared = Vec::new();
    let mut left = signals;
    for scope in SCOPES {
        let (inside, others): (Vec<_>, Vec<_>) =
            left.into_iter().partition(|signal| signal.scope == scope);
        left = others;
        if inside.is_empty() {
            continue;
        }
        writer.add_module(scope)?;
        for signal in inside {
            let kind = match signal.source {
                Source::Pin(_) => VarType::Wire,
                Source::Analog(_) => VarType::Real,
                Source::Value(_) if signal.is_signed => VarType::Integer,
                Source::Value(_) => VarType::Reg,
            };
            let id = writer.add_var(kind, signal.bits, &signal.name, None)?;
            declared.push((signal, id));
        }
        writer.upscope()?;
    }
    writer.enddefinitions()?;
    Ok(declared)
}

fn failure(file: &Path, error: &io::Error) -> Failure {
    unwritten("--vcd", file, error)
}

//! What the outside applies to the pins over time: volts and levels, each held until it changes.

mod dump;
mod table;

use std::fmt::Display;

use crate::environment::Pin;

/// Number of analog inputs.
const ANALOG_INPUTS: usize = 8;
/// Number of digital pins.
const PINS: usize = 24;

/// What a column or signal sets.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Input {
    /// Voltage of an ADC channel.
    Analog(u8),
    /// Level of a pin.
    Digital(Pin),
}

impl Input {
    /// The input called `adc0_V` to `adc7_V` or `PB0` to `PD7`.
    fn named(name: &str) -> Option<Self> {
        if let Ok(pin) = name.parse() {
            return Some(Self::Digital(pin));
        }
        let channel = name.strip_prefix("adc")?.strip_suffix("_V")?;
        let channel: u8 = channel.parse().ok()?;
        (usize::from(channel) < ANALOG_INPUTS).then_some(Self::Analog(channel))
    }
}

/// A text that is no stimulus: file, place, expectation.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{file}: {what}")]
pub struct StimulusError {
    /// Name of the file.
    pub file: String,
    /// What is wrong, and where.
    pub what: String,
}

impl StimulusError {
    fn new(file: &str, what: impl Display) -> StimulusError {
        StimulusError {
            file: file.to_owned(),
            what: what.to_string(),
        }
    }
}

/// Values of one input: (cycle, value) in the order of the cycles.
#[derive(Clone, Debug)]
struct Track<T>(Vec<(u64, T)>);

impl<T> Default for Track<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T: Copy> Track<T> {
    /// The value at `cycle`: the last one set at or before it.
    fn at(&self, cycle: u64) -> Option<T> {
        let after = self.0.partition_point(|&(set, _)| set <= cycle);
        after.checked_sub(1).map(|index| self.0[index].1)
    }
}

/// All inputs over time.
#[derive(Clone, Debug)]
pub struct Stimulus {
    analog: [Track<f64>; ANALOG_INPUTS],
    /// `None`: driven no longer.
    pins: [Track<Option<bool>>; PINS],
    /// Every cycle at which some input is set.
    instants: Vec<u64>,
}

impl Default for Stimulus {
    /// Nothing connected.
    fn default() -> Self {
        Self {
            analog: Default::default(),
            pins: std::array::from_fn(|_| Track::default()),
            instants: Vec::new(),
        }
    }
}

impl Stimulus {
    /// Reads a stimulus from a file's bytes, CSV or value change dump; `file` is its name in
    /// messages, `hz` the clock that its times refer to.
    ///
    /// # Errors
    /// The text is neither; the message says where, what was expected and how to mend it.
    pub fn parse(file: &str, text: &[u8], hz: u64) -> Result<Stimulus, StimulusError> {
        // Some programs on other systems begin every text with this mark.
        let text = text.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(text);
        // Every declaration of a dump begins with a dollar sign, no header row of a CSV does.
        if text.trim_ascii_start().starts_with(b"$") {
            dump::read(file, text, hz)
        } else {
            table::read(file, text, hz)
        }
    }

    /// Sets an analog input from `cycle` on. Calls come in the order of their cycles.
    pub fn set_analog(&mut self, channel: u8, cycle: u64, volts: f64) {
        self.analog[usize::from(channel)].0.push((cycle, volts));
        self.note(cycle);
    }

    /// Drives a pin, or stops driving it, from `cycle` on. Calls come in the order of their cycles.
    pub fn set_pin(&mut self, pin: Pin, cycle: u64, level: Option<bool>) {
        self.pins[pin.index()].0.push((cycle, level));
        self.note(cycle);
    }

    /// Applies a voltage from the start on; false if the input has values already.
    pub fn start_analog(&mut self, channel: u8, volts: f64) -> bool {
        let track = &mut self.analog[usize::from(channel)];
        let is_free = track.0.is_empty();
        if is_free {
            track.0.push((0, volts));
        }
        is_free
    }

    fn note(&mut self, cycle: u64) {
        if self.instants.last() != Some(&cycle) {
            self.instants.push(cycle);
        }
    }

    /// Volts on an analog input; 0 V if nothing is connected.
    pub fn volts(&self, channel: u8, cycle: u64) -> f64 {
        let track = self.analog.get(usize::from(channel));
        track.and_then(|track| track.at(cycle)).unwrap_or(0.0)
    }

    /// Level that drives a pin; `None` if nothing does.
    pub fn level(&self, pin: Pin, cycle: u64) -> Option<bool> {
        self.pins[pin.index()].at(cycle).flatten()
    }

    /// The next cycle after `cycle` at which an input is set.
    pub fn next_change(&self, cycle: u64) -> Option<u64> {
        let next = self.instants.partition_point(|&instant| instant <= cycle);
        self.instants.get(next).copied()
    }
}

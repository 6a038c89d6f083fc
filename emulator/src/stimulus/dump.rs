//! Reads a stimulus file: value change dump (IEEE 1364, section 18) with signals named like inputs.
//!
//! Other signals of the dump are ignored. A level of `z` or `x` drives nothing.

use std::fmt::Display;
use std::io::Read;

use crate::environment::Pin;
use vcd::{Command, Header, IdCode, Parser, ScopeItem, Value, Var, VarType};

use super::{Input, Stimulus, StimulusError};

/// Latest time accepted, in seconds, as for every other duration.
const LATEST_S: u128 = 1_000_000;

/// Deepest nesting of scopes.
const MOST_SCOPES: usize = 256;

/// Reads `text` of `file`; `hz` is the clock by which times are converted to cycles.
pub(super) fn read(file: &str, text: &[u8], hz: u64) -> Result<Stimulus, StimulusError> {
    check_nesting(file, text)?;
    // The parser wants white space after the last word.
    let mut parser = Parser::new(text.chain(&b"\n"[..]));
    let header = parser
        .parse_header()
        .map_err(|error| failure(file, error))?;
    let clock = Clock::new(&header, hz);
    let clock = clock.ok_or_else(|| failure(file, "no $timescale; expected one such as 1 ns"))?;
    let inputs = inputs(file, &header)?;
    let mut stimulus = Stimulus::default();
    let (mut time, mut cycle) = (0, 0);
    while let Some(command) = parser.next() {
        let command = command.map_err(|error| failure(file, error))?;
        let line = parser.line();
        let fault = |what: String| failure(file, format!("line {line}: {what}"));
        match command {
            Command::Timestamp(now) => {
                if now < time {
                    return Err(fault(format!(
                        "time #{now} comes after #{time}; it must not fall"
                    )));
                }
                time = now;
                cycle = clock
                    .cycle(now)
                    .ok_or_else(|| fault(format!("time #{now} is later than {LATEST_S} s")))?;
            }
            Command::ChangeScalar(code, value) => {
                for pin in pins(&inputs, code) {
                    stimulus.set_pin(pin, cycle, level(value));
                }
            }
            // Some simulators write single bits as vectors.
            Command::ChangeVector(code, bits) => {
                for pin in pins(&inputs, code) {
                    if bits.len() > 1 {
                        let what = format!("{pin} is set to {} bits; a pin has one", bits.len());
                        return Err(fault(what));
                    }
                    let bit = bits.get(0).unwrap_or(Value::X);
                    stimulus.set_pin(pin, cycle, level(bit));
                }
            }
            Command::ChangeReal(code, volts) => {
                for channel in channels(&inputs, code) {
                    if !volts.is_finite() {
                        let what = format!("adc{channel}_V is {volts}; expected a finite number");
                        return Err(fault(what));
                    }
                    stimulus.set_analog(channel, cycle, volts);
                }
            }
            _ => {}
        }
    }
    Ok(stimulus)
}

/// Refuses scopes in scopes without end: the parser descends into each with a call of its own.
fn check_nesting(file: &str, text: &[u8]) -> Result<(), StimulusError> {
    let mut depth = 0_usize;
    for word in text.split(|byte| byte.is_ascii_whitespace()) {
        match word {
            b"$scope" => depth += 1,
            b"$upscope" => depth = depth.saturating_sub(1),
            b"$enddefinitions" => break,
            _ => {}
        }
        if depth > MOST_SCOPES {
            let what = format!(
                "scopes are nested deeper than {MOST_SCOPES}; expected the dump of a design"
            );
            return Err(failure(file, what));
        }
    }
    Ok(())
}

fn level(value: Value) -> Option<bool> {
    match value {
        Value::V0 => Some(false),
        Value::V1 => Some(true),
        Value::X | Value::Z => None,
    }
}

fn pins(inputs: &[(IdCode, Input)], code: IdCode) -> impl Iterator<Item = Pin> {
    let with_code = inputs.iter().filter(move |(known, _)| *known == code);
    with_code.filter_map(|(_, input)| match input {
        Input::Digital(pin) => Some(*pin),
        Input::Analog(_) => None,
    })
}

fn channels(inputs: &[(IdCode, Input)], code: IdCode) -> impl Iterator<Item = u8> {
    let with_code = inputs.iter().filter(move |(known, _)| *known == code);
    with_code.filter_map(|(_, input)| match input {
        Input::Analog(channel) => Some(*channel),
        Input::Digital(_) => None,
    })
}

/// Converts the dump's time to cycles.
struct Clock {
    /// Units of the dump's time per tick, and per second.
    tick: u128,
    per_second: u128,
    hz: u128,
}

impl Clock {
    fn new(header: &Header, hz: u64) -> Option<Self> {
        let (tick, unit) = header.timescale?;
        Some(Self {
            tick: tick.into(),
            per_second: unit.divisor().into(),
            hz: hz.into(),
        })
    }

    /// The nearest cycle to a time, unless it is beyond the latest accepted.
    fn cycle(&self, time: u64) -> Option<u64> {
        let units = u128::from(time) * self.tick;
        if units > LATEST_S * self.per_second {
            return None;
        }
        u64::try_from((units * self.hz + self.per_second / 2) / self.per_second).ok()
    }
}

/// The signals whose names are those of inputs, in all scopes. A signal that a dump lists once more
/// in an inner scope (a port of a module) is the same signal.
fn inputs(file: &str, header: &Header) -> Result<Vec<(IdCode, Input)>, StimulusError> {
    let mut variables = Vec::new();
    collect(&header.items, "", &mut variables);
    let mut found: Vec<(IdCode, Input, String)> = Vec::new();
    for (scope, var) in variables {
        let Some(input) = Input::named(&var.reference) else {
            continue;
        };
        let name = format!("{scope}{}", var.reference);
        match found.iter().find(|(_, known, _)| *known == input) {
            Some((code, ..)) if *code == var.code => continue,
            Some((_, _, other)) => {
                let what = format!(
                    "the signals `{other}` and `{name}` name the same input; expected one: rename \
                     the other"
                );
                return Err(failure(file, what));
            }
            None => {}
        }
        check_kind(input, var).map_err(|what| failure(file, format!("`{name}` {what}")))?;
        found.push((var.code, input, name));
    }
    if found.is_empty() {
        let what =
            "no signal is called like an input: expected adc0_V to adc7_V (real) or PB0 to PD7";
        return Err(failure(file, what));
    }
    let inputs = found.into_iter();
    Ok(inputs.map(|(code, input, _)| (code, input)).collect())
}

/// A pin is one bit, a voltage is real.
fn check_kind(input: Input, var: &Var) -> Result<(), String> {
    let is_real = var.var_type == VarType::Real;
    match input {
        Input::Digital(_) if is_real => Err("is real; expected one bit for a pin".to_owned()),
        Input::Digital(_) if var.size != 1 => Err(format!("has {} bits; a pin has one", var.size)),
        Input::Analog(_) if !is_real => {
            Err("has bits; expected a real variable, in volts".to_owned())
        }
        _ => Ok(()),
    }
}

/// All variables with their scopes, as `outer.inner.`.
fn collect<'a>(items: &'a [ScopeItem], scope: &str, found: &mut Vec<(String, &'a Var)>) {
    for item in items {
        match item {
            ScopeItem::Var(var) => found.push((scope.to_owned(), var)),
            ScopeItem::Scope(inner) => {
                collect(
                    &inner.items,
                    &format!("{scope}{}.", inner.identifier),
                    found,
                );
            }
            _ => {}
        }
    }
}

fn failure(file: &str, what: impl Display) -> StimulusError {
    StimulusError::new(file, what)
}

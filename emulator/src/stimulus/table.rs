//! Reads a stimulus file: CSV, first column time, the others inputs by name.

use std::fmt::Display;

use csv::{ReaderBuilder, StringRecord, Trim};

use super::{Input, Stimulus, StimulusError};

/// Latest time accepted, in seconds, as for every other duration.
const LATEST_S: f64 = 1e6;

/// Unit of the first column.
#[derive(Clone, Copy)]
enum Time {
    Cycle,
    Seconds { hz: f64 },
}

/// Reads `text` of `file`; `hz` is the clock by which `t_s` is converted to cycles.
pub(super) fn read(file: &str, text: &[u8], hz: u64) -> Result<Stimulus, StimulusError> {
    let mut reader = ReaderBuilder::new()
        .flexible(true)
        .trim(Trim::All)
        .from_reader(text);
    let header = reader
        .headers()
        .map_err(|error| csv_failure(file, &error))?
        .clone();
    let time = time(file, &header, hz)?;
    let inputs = inputs(file, &header)?;
    let mut stimulus = Stimulus::default();
    let mut before: Option<f64> = None;
    for record in reader.records() {
        let record = record.map_err(|error| csv_failure(file, &error))?;
        let row = Row {
            file,
            header: &header,
            record: &record,
        };
        row.check_width()?;
        let (cycle, now) = row.time(time)?;
        if before.is_some_and(|before| now <= before) {
            let what = format!("must increase, but \"{}\" does not come later", &record[0]);
            return Err(row.failure(0, what));
        }
        before = Some(now);
        row.apply(&inputs, cycle, &mut stimulus)?;
    }
    if before.is_none() {
        return Err(failure(
            file,
            "has no rows; expected a header row and at least one more",
        ));
    }
    Ok(stimulus)
}

fn time(file: &str, header: &StringRecord, hz: u64) -> Result<Time, StimulusError> {
    match header.get(0).unwrap_or("") {
        "cycle" => Ok(Time::Cycle),
        "t_s" => Ok(Time::Seconds { hz: hz as f64 }),
        "" => Err(failure(
            file,
            "line 1: is empty; expected a header row that begins with t_s",
        )),
        name if name.contains(';') && header.len() == 1 => {
            let what = "line 1: cells are separated by semicolons; expected commas between them";
            Err(failure(file, what))
        }
        name => {
            let what = format!("line 1, column 1: `{name}`; expected `cycle` or `t_s` (seconds)");
            Err(failure(file, what))
        }
    }
}

fn inputs(file: &str, header: &StringRecord) -> Result<Vec<Input>, StimulusError> {
    let mut found = Vec::new();
    for (index, name) in header.iter().enumerate().skip(1) {
        let at = format!("line 1, column {}", index + 1);
        let input = Input::named(name).ok_or_else(|| {
            let expected = "expected adc0_V to adc7_V or a pin, PB0 to PD7";
            failure(file, format!("{at}: `{name}` is no input; {expected}"))
        })?;
        if found.contains(&input) {
            let what = format!("{at}: `{name}` stands there twice; remove one of the columns");
            return Err(failure(file, what));
        }
        found.push(input);
    }
    if found.is_empty() {
        let what = "line 1: no input after the time; add a column such as adc0_V or PB0";
        return Err(failure(file, what));
    }
    Ok(found)
}

/// One row with its place.
struct Row<'a> {
    file: &'a str,
    header: &'a StringRecord,
    record: &'a StringRecord,
}

impl Row<'_> {
    fn check_width(&self) -> Result<(), StimulusError> {
        let (found, expected) = (self.record.len(), self.header.len());
        if found == expected {
            return Ok(());
        }
        let what = format!("line {}: {found} cells; expected {expected}", self.line());
        Err(failure(self.file, what))
    }

    /// The row's cycle, and its time in the file's unit.
    fn time(&self, time: Time) -> Result<(u64, f64), StimulusError> {
        match time {
            Time::Cycle => {
                let cycle: u64 = self.record[0].parse().map_err(|_| {
                    self.failure(
                        0,
                        format!("expected a whole number, found {}", self.shown(0)),
                    )
                })?;
                Ok((cycle, cycle as f64))
            }
            Time::Seconds { hz } => {
                let seconds = self.number(0)?;
                if !(0.0..=LATEST_S).contains(&seconds) {
                    let what = format!("expected 0 to {LATEST_S} s, found {}", self.shown(0));
                    return Err(self.failure(0, what));
                }
                Ok(((seconds * hz).round() as u64, seconds))
            }
        }
    }

    fn apply(
        &self,
        inputs: &[Input],
        cycle: u64,
        stimulus: &mut Stimulus,
    ) -> Result<(), StimulusError> {
        for (index, input) in inputs.iter().enumerate() {
            match *input {
                Input::Analog(channel) => {
                    stimulus.set_analog(channel, cycle, self.number(index + 1)?);
                }
                Input::Digital(pin) => stimulus.set_pin(pin, cycle, Some(self.level(index + 1)?)),
            }
        }
        Ok(())
    }

    fn number(&self, index: usize) -> Result<f64, StimulusError> {
        let number = self.record[index]
            .parse()
            .ok()
            .filter(|n: &f64| n.is_finite());
        number.ok_or_else(|| {
            self.failure(
                index,
                format!("expected a finite number, found {}", self.shown(index)),
            )
        })
    }

    fn level(&self, index: usize) -> Result<bool, StimulusError> {
        match &self.record[index] {
            "0" => Ok(false),
            "1" => Ok(true),
            _ => Err(self.failure(
                index,
                format!("expected 0 or 1, found {}", self.shown(index)),
            )),
        }
    }

    fn shown(&self, index: usize) -> String {
        format!("\"{}\"", &self.record[index])
    }

    fn line(&self) -> u64 {
        self.record.position().map_or(0, csv::Position::line)
    }

    fn failure(&self, index: usize, what: impl Display) -> StimulusError {
        let (line, name) = (self.line(), &self.header[index]);
        failure(
            self.file,
            format!("line {line}, column {} ({name}): {what}", index + 1),
        )
    }
}

fn csv_failure(file: &str, error: &csv::Error) -> StimulusError {
    let at = error
        .position()
        .map_or(String::new(), |at| format!("line {}: ", at.line()));
    match error.kind() {
        csv::ErrorKind::Utf8 { .. } => failure(file, format!("{at}is not text; expected CSV")),
        _ => failure(file, format!("{at}{error}; expected CSV")),
    }
}

fn failure(file: &str, what: impl Display) -> StimulusError {
    StimulusError::new(file, what)
}

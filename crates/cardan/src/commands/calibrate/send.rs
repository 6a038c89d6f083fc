//! A calibration on its way into a device, over its serial line
//! (protocol: `cardan_spec::frame::COMMAND_SETTINGS`).

use std::fmt;
use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

use cardan_bench::App;
use cardan_spec::flags;
use cardan_spec::frame::{COMMAND_SETTINGS, DELIMITER, SETTINGS_PAUSE_MS};
use serde::Serialize;

use crate::failure::Failure;
use crate::output::Output;

/// Bits per second that a serial port offers nearest to the device's.
const BAUD: u32 = 115_200;

/// A damaged image is refused by the device and sent again.
const ATTEMPTS: u32 = 3;

/// A device answers a command when its period of at most two seconds is over.
const ANSWER: Duration = Duration::from_secs(4);

/// It restarts a second later, and its first frame comes after 96 ms and a period.
const RESTART: Duration = Duration::from_millis(SETTINGS_PAUSE_MS as u64 + 4000);

/// How long the port waits for a byte before it looks at the clock.
const GLANCE: Duration = Duration::from_millis(20);

/// What was sent.
#[derive(Serialize)]
pub(super) struct Sent {
    port: String,
    bytes: usize,
    attempts: u32,
    /// Seconds from the command to the first frame with the new settings.
    seconds: f64,
}

impl fmt::Display for Sent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            port,
            bytes,
            attempts,
            seconds,
        } = self;
        let again = match attempts {
            1 => String::new(),
            more => format!(" at the attempt {more}"),
        };
        write!(
            f,
            "{port}: the device stored {bytes} bytes{again} and restarted calibrated, {seconds:.1} s"
        )
    }
}

/// Sends `image` to the device on `port` and waits until it works with it.
pub(super) fn send(
    app: &dyn App,
    port: &str,
    image: &[u8],
    output: Output,
) -> Result<Sent, Failure> {
    let fail = |problem: String| Failure::input(format!("{port}: {problem}"));
    let mut device = serialport::new(port, BAUD)
        .timeout(GLANCE)
        .open()
        .map_err(|error| fail(format!("cannot be opened: {error}; expected a serial port")))?;
    output.note(&format!("sending the calibration to {port}"));
    let started = Instant::now();
    let mut problem = String::new();
    for attempt in 1..=ATTEMPTS {
        match exchange(&mut device, image).and_then(|()| restarted(&mut device, app)) {
            Ok(()) => {
                return Ok(Sent {
                    port: port.to_owned(),
                    bytes: image.len(),
                    attempts: attempt,
                    seconds: started.elapsed().as_secs_f64(),
                });
            }
            Err(found) => problem = found,
        }
    }
    Err(fail(format!("{problem} ({ATTEMPTS} attempts)")))
}

/// One attempt: the device has stored the image.
fn exchange(device: &mut (impl Read + Write), image: &[u8]) -> Result<(), String> {
    write(device, &[COMMAND_SETTINGS])?;
    let mut last = None;
    let is_ready = read_until(device, ANSWER, |byte| {
        last.replace(byte) == Some(DELIMITER) && byte == DELIMITER
    })?;
    if !is_ready {
        return Err(
            "no answer to the command for settings; expected the attitude sensor on this port, at \
             115200 baud, and no other program that reads it"
                .to_owned(),
        );
    }
    // It is silent from here on; what still comes is the rest of the empty frame.
    let end = Instant::now() + ANSWER;
    while read_until(device, GLANCE, |_| true)? {
        if Instant::now() >= end {
            return Err("what is on this port never falls silent: no attitude sensor".to_owned());
        }
    }
    write(device, image)?;
    let mut stored = Vec::with_capacity(image.len());
    let is_whole = read_until(device, ANSWER, |byte| {
        stored.push(byte);
        stored.len() == image.len()
    })?;
    match is_whole {
        true if stored == image => Ok(()),
        true => Err("the device did not store what was sent: the line damages bytes".to_owned()),
        false => Err("the device fell silent before it had stored the settings".to_owned()),
    }
}

/// The device has restarted and sends frames of a calibrated one.
fn restarted(device: &mut impl Read, app: &dyn App) -> Result<(), String> {
    let mut frame = Vec::new();
    let mut told = None;
    read_until(device, RESTART, |byte| {
        frame.push(byte);
        if byte == DELIMITER {
            told = app.decode(&std::mem::take(&mut frame)).ok();
        }
        told.is_some()
    })?;
    match told {
        Some(message) if message.status & u32::from(flags::UNCALIBRATED) == 0 => Ok(()),
        Some(_) => Err("the device restarted uncalibrated".to_owned()),
        None => Err("the device stored the settings and sent no frame since".to_owned()),
    }
}

fn write(device: &mut impl Write, bytes: &[u8]) -> Result<(), String> {
    let written = device.write_all(bytes).and_then(|()| device.flush());
    written.map_err(|error| format!("cannot be written: {error}"))
}

/// Reads bytes until `done` says so of one; false if the time is over before.
fn read_until(
    device: &mut impl Read,
    time: Duration,
    mut done: impl FnMut(u8) -> bool,
) -> Result<bool, String> {
    let end = Instant::now() + time;
    let mut byte = [0];
    while Instant::now() < end {
        match device.read(&mut byte) {
            Ok(0) => return Err("the line was hung up".to_owned()),
            Ok(_) if done(byte[0]) => return Ok(true),
            Ok(_) => {}
            Err(error) if matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::Interrupted) => {}
            Err(error) => return Err(format!("cannot be read: {error}")),
        }
    }
    Ok(false)
}

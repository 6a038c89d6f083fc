//! Runs the firmware on recorded codes, with files of the host for input and output.
//!
//! The processing is that of the reference board: the same averager, solver and frames. In place of
//! the converter stands a file of codes ([`input`]), in place of the serial line a file of results
//! ([`output`]), both in the simulator's working folder and reached by semihosting, so that it runs
//! wherever a simulator or debug probe serves it. Codes in, bits out: no timing is modelled.
//!
//! Exit codes: 0 done, 1 a file could not be used, 101 a panic.
#![no_std]

pub mod input;
pub mod output;
mod stack;
mod taps;

use core::cell::{Cell, RefCell};
use core::convert::Infallible;

use cardan_datapath::Deployed;
use cardan_firmware::averaging::{Averager, Window};
use cardan_firmware::calibration::Settings;
use cardan_firmware::device::{Device, Solver, sample};
use cardan_firmware::hal::{Serial, TriggeredAdc};
use cardan_units::AdcCode;
use embedded_hal::digital::{ErrorType, OutputPin};
use semihosting::{io, process};

use crate::input::{Input, Item};
use crate::output::Output;
use crate::taps::BoardTap;

/// What a board's `main` does: everything.
pub fn run() -> ! {
    stack::paint();
    process::exit(i32::from(replay().is_err()))
}

fn replay() -> io::Result<()> {
    let mut input = Input::open()?;
    let output = RefCell::new(Output::create()?);
    let received = Cell::new(None);
    let tap = BoardTap::new(&output);
    let m = Deployed::new(tap);
    let line = Line {
        output: &output,
        received: &received,
    };
    let settings = Settings::from_image(&input.settings()?);
    let mut averager = Averager::new(&m, settings.averaging);
    let mut window = Window::new(&m, settings.averaging);
    let mut device = Device::new(Solver::new(tap, &settings), line, NoPin);
    let mut sign = 0;
    while let Some(item) = input.next()? {
        match item {
            Item::Received(byte) => received.set(Some(byte)),
            Item::ThirdTilt(told) => sign = told,
            Item::Conversion(mut conversion) => {
                sample(&m, &mut averager, &mut conversion);
                let block = averager.take(&m);
                if let Some(averages) = block.and_then(|block| window.add(&m, &block)) {
                    device.solution(&averages, sign);
                }
            }
        }
    }
    output.borrow_mut().finish(stack::depth())
}

/// A recorded conversion, as the sample interrupt sees the converter.
#[derive(Clone, Copy)]
pub struct Recorded {
    code: u16,
    late: bool,
}

impl TriggeredAdc for Recorded {
    fn result(&mut self) -> AdcCode {
        AdcCode(self.code)
    }

    /// The recording has its channels in order.
    fn select(&mut self, _channel: u8) {}

    fn rearm(&mut self) -> bool {
        !self.late
    }
}

/// The serial line.
struct Line<'a> {
    output: &'a RefCell<Output>,
    received: &'a Cell<Option<u8>>,
}

impl Serial for Line<'_> {
    fn send(&mut self, bytes: &[u8]) -> bool {
        self.output.borrow_mut().sent(bytes);
        true
    }

    fn receive(&mut self) -> Option<u8> {
        self.received.take()
    }
}

/// The solving pin leads nowhere.
struct NoPin;

impl ErrorType for NoPin {
    type Error = Infallible;
}

impl OutputPin for NoPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}

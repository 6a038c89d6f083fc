//! GDB's remote serial protocol: a debugger steers the chip (`avr-gdb`, or any other client).
//!
//! No I/O happens here: bytes from the client go into [`Debugger::receive`], bytes for it come out
//! of [`Debugger::take_output`], and [`Debugger::run`] lets the chip go on while it is to. The
//! chip's cycles are those of a run without a debugger, whatever breakpoints and steps there are.
//!
//! Address spaces are those of the AVR tool chain: program memory at 0, data space at 0x800000,
//! EEPROM at 0x810000, fuses at 0x820000. I/O registers are read without their side effects and
//! written with them.

mod architecture;
mod chip;
mod client;
mod framing;
mod memory;
mod monitor;

use gdbstub::common::Signal;
use gdbstub::conn::Connection;
use gdbstub::stub::state_machine::GdbStubStateMachine;
use gdbstub::stub::{DisconnectReason, GdbStub, SingleThreadStopReason};

use self::chip::Chip;
use self::framing::{Frame, Framing};
use crate::environment::Environment;
use crate::machine::Machine;
use crate::stop::Stop;

/// Longest packet body, in bytes; the client is told.
const PACKET_BYTES: usize = 4096;

/// Where a session stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// The chip is halted; the client has the word.
    Halted,
    /// The chip is to run: call [`Debugger::run`].
    Running,
    /// The client has detached: the chip goes on by itself.
    Detached,
    /// The client has ended the run.
    Killed,
}

/// A session that cannot go on; the text says why.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
#[error("the debugger's session broke: {0}")]
pub struct SessionError(String);

/// Bytes for the client.
#[derive(Debug, Default)]
struct Outbox(Vec<u8>);

impl Connection for Outbox {
    type Error = std::convert::Infallible;

    fn write(&mut self, byte: u8) -> Result<(), Self::Error> {
        self.0.push(byte);
        Ok(())
    }

    fn flush(&mut self) -> Result<(), Self::Error> {
        Ok(())
    }
}

type Stub<E> = GdbStubStateMachine<'static, Chip<E>, Outbox>;
type StopReason = SingleThreadStopReason<u32>;

/// A chip, its environment, and a session with a client.
pub struct Debugger<E: Environment> {
    chip: Chip<E>,
    /// Taken out while it works; absent after the session's end.
    stub: Option<Stub<E>>,
    framing: Framing,
    output: Vec<u8>,
    state: State,
}

impl<E: Environment> Debugger<E> {
    /// A session with a client that has just connected. The chip is halted.
    ///
    /// # Errors
    /// Never in practice: the protocol's machine cannot be set up.
    pub fn new(machine: Machine, environment: E) -> Result<Debugger<E>, SessionError> {
        let mut chip = Chip::new(machine, environment);
        let stub = new_stub(&mut chip)?;
        Ok(Debugger {
            chip,
            stub: Some(stub),
            framing: Framing::default(),
            output: Vec::new(),
            state: State::Halted,
        })
    }

    /// Where the session stands.
    pub fn state(&self) -> State {
        self.state
    }

    /// The chip.
    pub fn machine(&self) -> &Machine {
        &self.chip.machine
    }

    /// What surrounds the chip.
    pub fn environment_mut(&mut self) -> &mut E {
        &mut self.chip.environment
    }

    /// Bytes for the client since the last call.
    pub fn take_output(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.output)
    }

    /// Takes bytes from the client.
    ///
    /// # Errors
    /// The protocol's machine gives up; a packet that it does not understand is no error.
    pub fn receive(&mut self, bytes: &[u8]) -> Result<(), SessionError> {
        for &byte in bytes {
            match self.framing.take(byte) {
                None => {}
                Some(Frame::Good(frame)) => self.deliver(&frame)?,
                Some(Frame::Damaged) => self.output.push(b'-'),
                Some(Frame::Repeat) => self.output.extend(self.framing.last_reply()),
            }
        }
        Ok(())
    }

    /// Lets the chip run on to `until_cycle`, if it is to run. `limit`: the program is over at that
    /// cycle. The client is told when it halts.
    ///
    /// # Errors
    /// As [`Debugger::receive`].
    pub fn run(&mut self, until_cycle: u64, limit: u64) -> Result<(), SessionError> {
        if self.state != State::Running {
            return Ok(());
        }
        match self.chip.advance(until_cycle, limit) {
            Some(reason) => self.report(reason),
            None => Ok(()),
        }
    }

    /// Halts the chip for good: the run is over for a reason that lies outside it.
    ///
    /// # Errors
    /// As [`Debugger::receive`].
    pub fn end(&mut self, stop: Stop) -> Result<(), SessionError> {
        let signal = chip::signal(&stop);
        self.chip.end = Some(stop);
        if self.state == State::Running {
            self.report(StopReason::Signal(signal))?;
        }
        Ok(())
    }

    /// Ends the session: the chip without any trap, its environment, and how the program has ended,
    /// if it has.
    pub fn into_parts(mut self) -> (Machine, E, Option<Stop>) {
        let end = self.chip.finish();
        (self.chip.machine, self.chip.environment, end)
    }

    /// Hands a whole frame to the protocol's machine.
    fn deliver(&mut self, frame: &[u8]) -> Result<(), SessionError> {
        let is_packet = frame.first() == Some(&b'$');
        let mut acknowledged = false;
        for &byte in frame {
            let Some(stub) = self.stub.take() else {
                return Ok(());
            };
            let next = match stub {
                Stub::Idle(idle) => idle.incoming_data(&mut self.chip, byte),
                Stub::Running(running) => running.incoming_data(&mut self.chip, byte),
                other => Ok(other),
            };
            match next {
                Ok(stub) => self.settle(stub, is_packet)?,
                Err(error) if error.is_target_error() || error.is_connection_error() => {
                    return Err(SessionError(error.to_string()));
                }
                Err(_) => {
                    // Not understood: the machine is lost, the session need not be.
                    self.stub = Some(new_stub(&mut self.chip)?);
                    acknowledged = true;
                }
            }
        }
        if acknowledged {
            self.state = State::Halted;
            let reply = self.framing.refusal();
            self.output.extend(reply);
        }
        Ok(())
    }

    /// Tells the client why the chip has halted.
    fn report(&mut self, reason: StopReason) -> Result<(), SessionError> {
        match self.stub.take() {
            Some(Stub::Running(running)) => {
                let next = running.report_stop(&mut self.chip, reason);
                let stub = next.map_err(|error| SessionError(error.to_string()))?;
                self.settle(stub, true)
            }
            other => {
                self.stub = other;
                Ok(())
            }
        }
    }

    /// Takes in the protocol machine's next state and what it has to say.
    fn settle(&mut self, stub: Stub<E>, is_reply: bool) -> Result<(), SessionError> {
        let mut stub = match stub {
            Stub::CtrlCInterrupt(interrupt) => {
                let reason = Some(StopReason::Signal(Signal::SIGINT));
                let is_running = self.state == State::Running;
                let reason = reason.filter(|_| is_running);
                let next = interrupt.interrupt_handled(&mut self.chip, reason);
                next.map_err(|error| SessionError(error.to_string()))?
            }
            other => other,
        };
        let said = match &mut stub {
            Stub::Idle(inner) => std::mem::take(&mut inner.borrow_conn().0),
            Stub::Running(inner) => std::mem::take(&mut inner.borrow_conn().0),
            Stub::CtrlCInterrupt(inner) => std::mem::take(&mut inner.borrow_conn().0),
            Stub::Disconnected(inner) => std::mem::take(&mut inner.borrow_conn().0),
        };
        if is_reply && !said.is_empty() {
            self.framing.keep_reply(&said);
        }
        self.output.extend(said);
        self.state = match &stub {
            Stub::Idle(_) => State::Halted,
            Stub::Running(_) | Stub::CtrlCInterrupt(_) => State::Running,
            Stub::Disconnected(inner) => match inner.get_reason() {
                DisconnectReason::Disconnect => State::Detached,
                _ => State::Killed,
            },
        };
        self.stub = Some(stub);
        Ok(())
    }
}

fn new_stub<E: Environment>(chip: &mut Chip<E>) -> Result<Stub<E>, SessionError> {
    GdbStub::builder(Outbox::default())
        .packet_buffer_size(PACKET_BYTES + framing::OVERHEAD)
        .build()
        .map_err(|error| SessionError(error.to_string()))?
        .run_state_machine(chip)
        .map_err(|error| SessionError(error.to_string()))
}

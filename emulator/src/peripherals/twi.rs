//! Two-wire interface as the only master of its bus (data sheet section 21).
//!
//! Inaccuracies: START and STOP are taken to last one SCL period and a byte nine; the levels of
//! SDA and SCL are not shown on the pins; slave mode and other masters do not occur, so the
//! chip's own address is never called.

const TWINT: u8 = 0x80;
const TWEA: u8 = 0x40;
const TWSTA: u8 = 0x20;
const TWSTO: u8 = 0x10;
const TWWC: u8 = 0x08;
const TWEN: u8 = 0x04;
const TWIE: u8 = 0x01;
/// Status: nothing to report.
const NO_STATE: u8 = 0xF8;

/// What the bus is doing; the machine asks the environment when it is done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Action {
    Start,
    Stop,
    /// Address byte: 7 bits of address, then 1 for reading.
    Address(u8),
    Write(u8),
    /// Read a byte, then answer with ACK (true) or NACK.
    Read(bool),
}

/// TWI registers.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Twi {
    bit_rate: u8,
    prescaler: u8,
    status: u8,
    data: u8,
    control: u8,
    address: u8,
    address_mask: u8,
    flag: bool,
    collision: bool,
    action: Option<(Action, u64)>,
}

impl Twi {
    pub(crate) fn new() -> Twi {
        Twi {
            bit_rate: 0,
            prescaler: 0,
            status: NO_STATE,
            data: 0xFF,
            control: 0,
            address: 0xFE,
            address_mask: 0,
            flag: false,
            collision: false,
            action: None,
        }
    }

    pub(crate) fn requests(&self) -> bool {
        self.flag && self.control & TWIE != 0
    }

    pub(crate) fn is_busy(&self) -> bool {
        self.action.is_some()
    }

    pub(crate) fn next_event(&self) -> Option<u64> {
        self.action.map(|(_, end)| end)
    }

    /// SCL period in cycles: 16 + 2 TWBR 4^TWPS (section 21.5.2).
    fn period(&self) -> u64 {
        16 + 2 * (u64::from(self.bit_rate) << (2 * self.prescaler))
    }

    /// The action that has just ended.
    pub(crate) fn take_action(&mut self) -> Option<Action> {
        self.action.take().map(|(action, _)| action)
    }

    /// Notes the outcome of an action that ended at cycle `at`: `ack` as answered by the slave,
    /// `data` as read.
    pub(crate) fn finish(&mut self, action: Action, ack: bool, data: u8, at: u64) {
        self.status = match action {
            Action::Stop => {
                // TWINT is not set. A START that was asked for has waited for the bus.
                self.status = NO_STATE;
                self.control &= !TWSTO;
                self.begin(at);
                return;
            }
            Action::Start if self.status == NO_STATE => 0x08,
            Action::Start => 0x10,
            Action::Address(byte) if byte & 1 == 0 => {
                if ack {
                    0x18
                } else {
                    0x20
                }
            }
            Action::Address(_) => {
                if ack {
                    0x40
                } else {
                    0x48
                }
            }
            Action::Write(_) => {
                if ack {
                    0x28
                } else {
                    0x30
                }
            }
            Action::Read(answer) => {
                self.data = data;
                if answer { 0x50 } else { 0x58 }
            }
        };
        self.flag = true;
    }

    /// Whether the bus is ours: from START to STOP.
    fn is_master(&self) -> bool {
        self.status != NO_STATE
    }

    /// What the control register asks for while TWINT is clear; how many SCL periods it takes.
    fn requested(&self) -> Option<(Action, u64)> {
        if self.control & TWSTO != 0 {
            return Some((Action::Stop, 1));
        }
        if self.control & TWSTA != 0 {
            return Some((Action::Start, 1));
        }
        match self.status {
            0x08 | 0x10 => Some((Action::Address(self.data), 9)),
            0x18 | 0x20 | 0x28 | 0x30 => Some((Action::Write(self.data), 9)),
            0x40 | 0x50 => Some((Action::Read(self.control & TWEA != 0), 9)),
            _ => None,
        }
    }

    /// Reads the register at offset `register` from TWBR.
    pub(crate) fn read(&self, register: u16) -> u8 {
        match register {
            0 => self.bit_rate,
            1 => self.status | self.prescaler,
            2 => self.address,
            3 => self.data,
            4 => {
                let flag = if self.flag { TWINT } else { 0 };
                let collision = if self.collision { TWWC } else { 0 };
                self.control | flag | collision
            }
            _ => self.address_mask,
        }
    }

    /// Writes the register at offset `register` from TWBR, with effect at cycle `at`.
    pub(crate) fn write(&mut self, register: u16, value: u8, at: u64) {
        match register {
            0 => self.bit_rate = value,
            1 => self.prescaler = value & 3,
            2 => self.address = value,
            // Writable only while TWINT is set, not before the first START either.
            3 if !self.flag => self.collision = true,
            3 => {
                self.data = value;
                self.collision = false;
            }
            4 => self.write_control(value, at),
            _ => self.address_mask = value & 0xFE,
        }
    }

    fn write_control(&mut self, value: u8, at: u64) {
        self.control = value & (TWEA | TWSTA | TWSTO | TWEN | TWIE);
        if value & TWEN == 0 {
            self.action = None;
            self.flag = false;
            self.status = NO_STATE;
            return;
        }
        if value & TWINT != 0 {
            self.flag = false;
        }
        self.begin(at);
    }

    /// Begins what is asked for, unless something is under way or TWINT holds the bus.
    fn begin(&mut self, at: u64) {
        if self.flag || self.is_busy() {
            return;
        }
        if !self.is_master() {
            // Without the bus there is nothing to stop: the interface lets go of the lines.
            self.control &= !TWSTO;
        }
        if let Some((action, periods)) = self.requested() {
            self.action = Some((action, at + periods * self.period()));
        }
    }

    /// The clock stood still for `cycles`.
    pub(crate) fn shift(&mut self, cycles: u64) {
        if let Some((_, end)) = &mut self.action {
            *end += cycles;
        }
    }
}

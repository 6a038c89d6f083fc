//! USART0 in asynchronous and synchronous-master modes (data sheet section 19).
//!
//! The transmitter has one buffer before its shift register. A byte written to an idle
//! transmitter moves on at the next tick of the baud generator; one written before TXEN waits in the
//! buffer for it. Clearing TXEN takes effect when buffer and shift register are empty. The receiver has a FIFO of two
//! behind its shift register; frames from the environment arrive at the receiver's own bit rate.
//!
//! Inaccuracies: a change of the frame format or of U2X within a frame counts from the next frame;
//! frames being received do not notice a change of UBRR;
//! noise and bit-rate mismatch on the receive line are not modelled.

use std::collections::VecDeque;

const RXC: u8 = 0x80;
const TXC: u8 = 0x40;
const UDRE: u8 = 0x20;
const DOR: u8 = 0x08;
const U2X: u8 = 0x02;
const MPCM: u8 = 0x01;
const RXEN: u8 = 0x10;
const TXEN: u8 = 0x08;
const UCSZ2: u8 = 0x04;

/// Interrupt requests of the USART, in the order of their enable bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Requests {
    pub(crate) receive: bool,
    pub(crate) empty: bool,
    pub(crate) transmit: bool,
}

/// A received frame waiting in the FIFO.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Received {
    byte: u8,
    ninth: bool,
}

/// USART state.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Usart {
    status: u8,
    control_b: u8,
    control_c: u8,
    baud: u16,
    /// Cycle at which the baud generator was reloaded.
    origin: u64,
    /// TXEN has been set, and has not taken effect as cleared.
    is_transmitting: bool,
    /// All nine bits as written: the frame format decides when it is loaded.
    buffer: Option<u16>,
    /// Frame in the shift register, its start and its end.
    shifting: Option<(u16, u64, u64)>,
    /// When the buffer moves to the idle shift register.
    load_at: Option<u64>,
    transmitted: bool,
    /// Somebody wants to see the bits on TXD.
    pub(crate) shows_line: bool,
    /// Level of TXD; bits still to come, the first one lowest; their number; when the next begins.
    line: bool,
    bits: (u16, u64, u64),
    fifo: VecDeque<Received>,
    /// A complete third frame that waits in the shift register.
    waiting: Option<Received>,
    overrun: bool,
    /// Cycle at which the stop bits of the last received frame end.
    line_free_at: u64,
    /// Frame being received and the cycle at which it is complete.
    receiving: Option<(Received, u64)>,
}

impl Usart {
    pub(crate) fn new() -> Usart {
        Usart {
            status: 0,
            control_b: 0,
            control_c: 0x06,
            baud: 0,
            origin: 0,
            is_transmitting: false,
            buffer: None,
            shifting: None,
            load_at: None,
            transmitted: false,
            shows_line: false,
            line: true,
            bits: (0, 0, 0),
            fifo: VecDeque::new(),
            waiting: None,
            overrun: false,
            receiving: None,
            line_free_at: 0,
        }
    }

    pub(crate) fn transmits(&self) -> bool {
        self.is_transmitting
    }

    pub(crate) fn receives(&self) -> bool {
        self.control_b & RXEN != 0
    }

    /// Whether a frame or a byte is still to be sent.
    pub(crate) fn is_sending(&self) -> bool {
        self.is_transmitting && (self.shifting.is_some() || self.buffer.is_some())
    }

    pub(crate) fn requests(&self) -> Requests {
        let enabled = |bit: u8| self.control_b & bit != 0;
        Requests {
            receive: enabled(RXC) && !self.fifo.is_empty(),
            empty: enabled(UDRE) && self.buffer.is_none(),
            transmit: enabled(TXC) && self.transmitted,
        }
    }

    pub(crate) fn clear_transmitted(&mut self) {
        self.transmitted = false;
    }

    /// Data bits of a frame, 5 to 9.
    fn data_bits(&self) -> u64 {
        match (self.control_b & UCSZ2 != 0, self.control_c >> 1 & 3) {
            (true, 3) => 9,
            (_, size) => 5 + u64::from(size),
        }
    }

    fn parity_bits(&self) -> u64 {
        u64::from(self.control_c & 0x20 != 0)
    }

    /// Cycles per bit.
    pub(crate) fn bit_cycles(&self) -> u64 {
        let divisor = match (self.control_c & 0xC0, self.status & U2X != 0) {
            (0x40, _) => 2,
            (_, true) => 8,
            _ => 16,
        };
        divisor * (u64::from(self.baud) + 1)
    }

    fn frame_bits(&self) -> u64 {
        let stop = if self.control_c & 0x08 != 0 { 2 } else { 1 };
        1 + self.data_bits() + self.parity_bits() + stop
    }

    /// Cycle of the transmitter's next step.
    pub(crate) fn next_event(&self) -> Option<u64> {
        self.load_at.or(self.shifting.map(|(_, _, end)| end))
    }

    /// Carries out the transmitter's step due at cycle `at`. Returns a frame that has ended.
    pub(crate) fn step(&mut self, at: u64) -> Option<u16> {
        if self.load_at.take().is_some() {
            self.load(at);
            return None;
        }
        let (frame, _, _) = self.shifting.take()?;
        if self.buffer.is_some() {
            self.load(at);
        } else {
            self.transmitted = true;
            self.is_transmitting = self.control_b & TXEN != 0;
        }
        Some(frame)
    }

    fn load(&mut self, at: u64) {
        if let Some(written) = self.buffer.take() {
            let frame = written & ((1 << self.data_bits()) - 1);
            let end = at + self.frame_bits() * self.bit_cycles();
            self.shifting = Some((frame, at, end));
            self.bits = (self.pattern(frame), self.frame_bits(), at);
        }
    }

    /// The bits of a frame on the wire: start, data from the lowest, parity, stop.
    fn pattern(&self, frame: u16) -> u16 {
        let data_bits = self.data_bits();
        let is_odd = self.control_c & 0x10 != 0;
        let parity = (frame.count_ones() % 2 == 1) != is_odd;
        let mut tail = u16::MAX;
        if self.parity_bits() == 1 {
            tail = tail << 1 | u16::from(parity);
        }
        tail << (data_bits + 1) | frame << 1
    }

    /// When TXD takes its next bit, if somebody wants to see it.
    pub(crate) fn line_event(&self) -> Option<u64> {
        let (_, left, next) = self.bits;
        (self.shows_line && left > 0).then_some(next)
    }

    /// TXD takes its next bit.
    pub(crate) fn step_line(&mut self) {
        let (bits, left, next) = self.bits;
        self.line = bits & 1 != 0;
        self.bits = (bits >> 1, left.saturating_sub(1), next + self.bit_cycles());
    }

    /// Level of TXD; high unless the bits are shown.
    pub(crate) fn line(&self) -> bool {
        self.line
    }

    /// First tick of the baud generator after cycle `after`.
    fn baud_tick(&self, after: u64) -> u64 {
        let period = u64::from(self.baud) + 1;
        after + period - (after - self.origin) % period
    }

    pub(crate) fn read_status(&self) -> u8 {
        let mut value = self.status & (U2X | MPCM);
        if !self.fifo.is_empty() {
            value |= RXC;
        }
        if self.transmitted {
            value |= TXC;
        }
        if self.buffer.is_none() {
            value |= UDRE;
        }
        if self.overrun {
            value |= DOR;
        }
        value
    }

    /// UCSR0A: TXC is cleared by one, U2X and MPCM are set, all else is read only.
    pub(crate) fn write_status(&mut self, value: u8) {
        self.status = value & (U2X | MPCM);
        if value & TXC != 0 {
            self.transmitted = false;
        }
    }

    pub(crate) fn read_control_b(&self) -> u8 {
        let ninth = self.fifo.front().is_some_and(|frame| frame.ninth);
        self.control_b & !2 | u8::from(ninth) << 1
    }

    /// UCSR0B, taking effect at cycle `at`.
    pub(crate) fn write_control_b(&mut self, value: u8, at: u64) {
        self.control_b = value;
        if value & TXEN != 0 && !self.is_transmitting {
            self.is_transmitting = true;
            self.plan_load(at);
        } else if value & TXEN == 0 && !self.is_sending() {
            self.is_transmitting = false;
        }
        if value & RXEN == 0 {
            // Disabling the receiver flushes its buffer at once.
            self.fifo.clear();
            self.waiting = None;
            self.receiving = None;
            self.overrun = false;
        }
    }

    pub(crate) fn control_c(&self) -> u8 {
        self.control_c
    }

    pub(crate) fn write_control_c(&mut self, value: u8) {
        self.control_c = value;
    }

    pub(crate) fn baud(&self) -> u16 {
        self.baud
    }

    /// UBRR0H (high = true) or UBRR0L, which reloads the baud generator at cycle `at`: a frame under
    /// way is corrupted.
    pub(crate) fn write_baud(&mut self, high: bool, value: u8, at: u64) {
        let old = u64::from(self.baud) + 1;
        if high {
            self.baud = self.baud & 0x00FF | u16::from(value & 15) << 8;
        } else {
            self.baud = self.baud & 0x0F00 | u16::from(value);
            self.origin = at;
        }
        let new = u64::from(self.baud) + 1;
        // What is under way goes on with as many ticks, each of the new length.
        let moved = |end: u64| at + end.saturating_sub(at).div_ceil(old) * new;
        self.load_at = self.load_at.map(moved);
        self.shifting = self
            .shifting
            .map(|(frame, start, end)| (frame, start, moved(end)));
        if self.bits.1 > 0 {
            self.bits.2 = moved(self.bits.2);
        }
    }

    /// UDR0 written with effect at cycle `at`. Ignored while the buffer is full.
    pub(crate) fn write_data(&mut self, value: u8, at: u64) {
        if self.buffer.is_some() {
            return;
        }
        let ninth = u16::from(self.control_b & 1) << 8;
        self.buffer = Some(u16::from(value) | ninth);
        self.plan_load(at);
    }

    /// The buffer moves to an idle shift register at the next tick, if the transmitter is enabled.
    fn plan_load(&mut self, at: u64) {
        if self.is_transmitting && self.buffer.is_some() && self.shifting.is_none() {
            self.load_at = Some(self.baud_tick(at));
        }
    }

    pub(crate) fn read_data(&mut self) -> u8 {
        let byte = self.fifo.pop_front().map_or(0, |frame| frame.byte);
        self.overrun = false;
        if let Some(frame) = self.waiting.take() {
            self.fifo.push_back(frame);
        }
        byte
    }

    /// Cycle at which the frame being received is complete.
    pub(crate) fn receive_event(&self) -> Option<u64> {
        self.receiving.map(|(_, end)| end)
    }

    /// First cycle at which the next received frame can begin.
    pub(crate) fn line_free_at(&self) -> u64 {
        self.line_free_at
    }

    /// A start bit at cycle `at` of a frame with `byte`. Returns false if the receiver is off.
    pub(crate) fn begin_receive(&mut self, byte: u8, ninth: bool, at: u64) -> bool {
        if !self.receives() {
            return false;
        }
        if self.waiting.take().is_some() {
            // The new frame takes the shift register: the one that waited there is lost.
            self.overrun = true;
        }
        let mask = ((1u16 << self.data_bits().min(8)) - 1) as u8;
        let frame = Received {
            byte: byte & mask,
            ninth: ninth && self.data_bits() == 9,
        };
        self.line_free_at = at + self.frame_bits() * self.bit_cycles();
        let bits_before_stop = 1 + self.data_bits() + self.parity_bits();
        let end = at + bits_before_stop * self.bit_cycles() + self.bit_cycles() / 2;
        self.receiving = Some((frame, end));
        true
    }

    /// The clock stood still for `cycles`.
    pub(crate) fn shift(&mut self, cycles: u64) {
        self.origin += cycles;
        self.line_free_at += cycles;
        self.load_at = self.load_at.map(|at| at + cycles);
        self.bits.2 += cycles;
        self.shifting = self
            .shifting
            .map(|(f, start, end)| (f, start + cycles, end + cycles));
        self.receiving = self.receiving.map(|(frame, end)| (frame, end + cycles));
    }

    /// The frame being received is complete.
    pub(crate) fn end_receive(&mut self) {
        let Some((frame, _)) = self.receiving.take() else {
            return;
        };
        let addressed = self.status & MPCM == 0 || frame.ninth || self.data_bits() < 9;
        if !addressed {
            return;
        }
        if self.fifo.len() < 2 {
            self.fifo.push_back(frame);
        } else {
            self.waiting = Some(frame);
        }
    }
}

//! The desk the chip lies on: what its pins are connected to, and its serial line's two ends.

use std::collections::VecDeque;

use cardan_emulator::{AnalogInput, Environment, Pin, ResetCause, SerialByte, Stimulus};

use super::waveform::Waveform;

/// On-chip temperature sensor at 25 degrees Celsius, in volts (data sheet, table 24-2).
const TEMPERATURE_VOLTS: f64 = 0.314;

/// The environment of a run.
pub(super) struct Desk {
    stimulus: Stimulus,
    /// Bytes that the chip has sent and the host not yet taken.
    pub(super) sent: Vec<u8>,
    /// Bytes from the host that the chip has not yet been offered.
    pub(super) received: VecDeque<u8>,
    /// Start and value of the byte last offered.
    offered: Option<(u64, u8)>,
    /// The reader of what the chip sends has gone: the run ends.
    pub(super) is_closed: bool,
    /// Where pin levels are written.
    pub(super) waveform: Option<Waveform>,
}

impl Desk {
    /// A desk with `stimulus` on the pins.
    pub(super) fn new(stimulus: Stimulus) -> Self {
        Self {
            stimulus,
            sent: Vec::new(),
            received: VecDeque::new(),
            offered: None,
            is_closed: false,
            waveform: None,
        }
    }
}

impl Environment for Desk {
    fn shows_serial_edges(&self) -> bool {
        self.waveform.is_some()
    }

    fn pin_edge(&mut self, cycle: u64, pin: Pin, level: bool) {
        if let Some(waveform) = &mut self.waveform {
            waveform.edge(cycle, pin, level);
        }
    }

    fn pin_level(&mut self, cycle: u64, pin: Pin) -> Option<bool> {
        self.stimulus.level(pin, cycle)
    }

    fn analog(&mut self, cycle: u64, input: AnalogInput) -> f64 {
        match input {
            AnalogInput::Pin(channel) => {
                let volts = self.stimulus.volts(channel, cycle);
                if let Some(waveform) = &mut self.waveform {
                    waveform.held(cycle, channel, volts);
                }
                volts
            }
            AnalogInput::Temperature => TEMPERATURE_VOLTS,
            _ => 0.0,
        }
    }

    fn uart_tx(&mut self, _cycle: u64, byte: u8) {
        self.sent.push(byte);
    }

    /// The next byte for the chip. Asked again in the cycle of the last one's start: the receiver
    /// is off and that byte lost. A host's bytes carry no time of their own, so it comes again
    /// later, at the beginning of the next slice of the run.
    fn uart_rx(&mut self, cycle: u64) -> Option<SerialByte> {
        if let Some((start, byte)) = self.offered.take()
            && start == cycle
        {
            self.received.push_front(byte);
            return None;
        }
        let byte = self.received.pop_front()?;
        self.offered = Some((cycle, byte));
        Some(SerialByte {
            start_cycle: cycle,
            byte,
            ninth: false,
        })
    }

    fn clock_changed(&mut self, cycle: u64, hz: u64) {
        if let Some(waveform) = &mut self.waveform {
            waveform.clock_changed(cycle, hz);
        }
    }

    fn reset(&mut self, cycle: u64, _cause: ResetCause) {
        if let Some(waveform) = &mut self.waveform {
            waveform.reset(cycle);
        }
    }

    fn next_input(&self, cycle: u64) -> Option<u64> {
        self.stimulus.next_change(cycle)
    }
}

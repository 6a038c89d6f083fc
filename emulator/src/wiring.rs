//! The wiring inside the chip: which flag requests which interrupt, which peripheral drives which
//! pin, which flag triggers the converter.

use crate::environment::{AnalogInput, Environment, Pin, PortDrive};
use crate::interrupts::vector;
use crate::machine::Machine;
use crate::peripherals::adc::Step;
use crate::peripherals::port::Override;
use crate::peripherals::prescaler::Prescaler;
use crate::peripherals::timer::{ICF, OCFA, OCFB, OutputChange, TOV};
use crate::schedule::Source;

/// Flag bit and vector of each interrupt of the three timers.
const TIMER_VECTORS: [[(u8, usize); 4]; 3] = [
    [
        (OCFA, vector::TIMER0_COMPA),
        (OCFB, vector::TIMER0_COMPB),
        (TOV, vector::TIMER0_OVF),
        (0, vector::TIMER0_OVF),
    ],
    [
        (OCFA, vector::TIMER1_COMPA),
        (OCFB, vector::TIMER1_COMPB),
        (TOV, vector::TIMER1_OVF),
        (ICF, vector::TIMER1_CAPT),
    ],
    [
        (OCFA, vector::TIMER2_COMPA),
        (OCFB, vector::TIMER2_COMPB),
        (TOV, vector::TIMER2_OVF),
        (0, vector::TIMER2_OVF),
    ],
];

/// Vectors of each timer's interrupts, as bits.
const TIMER_REQUESTS: [u32; 3] = [0x0001_C000, 0x0000_3C00, 0x0000_0380];

/// Pins of the compare outputs by timer, in the order of ports and pins: channel, port, bit.
const COMPARE_PINS: [[(usize, usize, u8); 2]; 3] = [
    [(1, 2, 5), (0, 2, 6)],
    [(0, 0, 1), (1, 0, 2)],
    [(0, 0, 3), (1, 2, 3)],
];

/// The same as masks, by timer and port.
const COMPARE_MASKS: [[u8; 3]; 3] = [[0, 0, 0x60], [0x06, 0, 0], [0x08, 0, 0x08]];

/// Pins of the serial line, both on port D.
const RXD: u8 = 0x01;
const TXD: u8 = 0x02;
/// Pins of the SPI, all on port B.
const MOSI: u8 = 0x08;
const MISO: u8 = 0x10;
const SCK: u8 = 0x20;

impl Machine {
    /// Brings timer `number` forward to cycle `at` and passes on what happened.
    pub(crate) fn sync_timer<E: Environment>(&mut self, number: usize, at: u64, env: &mut E) {
        let prescaler = self.prescaler(number);
        if self.timers[number].advance(at, &prescaler) {
            self.after_timer(number, at, env);
        }
    }

    /// Passes on a timer's flags, outputs and next event after a change at cycle `at`.
    pub(crate) fn after_timer<E: Environment>(&mut self, number: usize, at: u64, env: &mut E) {
        let requests = self.timers[number].requests();
        if requests != 0 || self.interrupts.pending() & TIMER_REQUESTS[number] != 0 {
            for (bit, vector) in TIMER_VECTORS[number] {
                if bit != 0 {
                    self.interrupts.request(vector, requests & bit != 0, at);
                }
            }
        }
        self.plan_timer(number);
        self.update_trigger(at, env);
        let change = self.timers[number].outputs_changed();
        self.show_outputs(number, change, at, env);
    }

    /// Shows a change of a timer's outputs on the pins.
    #[inline]
    fn show_outputs<E: Environment>(
        &mut self,
        number: usize,
        change: OutputChange,
        at: u64,
        env: &mut E,
    ) {
        match change {
            OutputChange::Levels([false, false]) => {}
            // The SPI may drive one of the pins instead.
            OutputChange::Levels(flipped) if !self.spi.is_master() => {
                for (channel, port, bit) in COMPARE_PINS[number] {
                    if flipped[channel] {
                        self.flip_pin(port, bit, at, env);
                    }
                }
            }
            _ => {
                for port in (0..3).filter(|&port| COMPARE_MASKS[number][port] != 0) {
                    self.update_port(port, at, env);
                }
            }
        }
    }

    /// What drives a pin changes its level.
    #[inline]
    fn flip_pin<E: Environment>(&mut self, port: usize, bit: u8, at: u64, env: &mut E) {
        let mask = 1 << bit;
        if !self.ports[port].flip(mask, at) {
            return;
        }
        let pin = Pin::at(port, bit);
        self.statistics.pin_edges[pin.index()] += 1;
        env.pin_edge(at, pin, self.ports[port].level() & mask != 0);
        if self.external.watched()[port] & mask != 0 {
            self.look_at_pins(at, env);
        }
    }

    /// Takes the outputs of timer `number` through their changes up to cycle `to` or the next event
    /// of anybody else. No flag rises meanwhile that anybody waits for.
    pub(crate) fn step_outputs<E: Environment>(&mut self, number: usize, to: u64, env: &mut E) {
        let source = Source::TIMERS[number];
        let last = self.schedule.last_before_others(source).min(to);
        let prescaler = self.prescaler(number);
        while let Some((at, change)) = self.timers[number].next_change(last, &prescaler) {
            self.show_outputs(number, change, at, env);
        }
        let next = self.timers[number].next_output(&prescaler);
        self.schedule.set_quiet(source, next);
    }

    fn prescaler(&self, timer: usize) -> Prescaler {
        match timer {
            2 => self.prescaler_t2,
            _ => self.prescaler_sync,
        }
    }

    /// Plans a timer's next event: a flag that somebody waits for, or a pin. The latter is quiet
    /// unless somebody inside the chip looks at the pin.
    pub(crate) fn plan_timer(&mut self, number: usize) {
        let prescaler = self.prescaler(number);
        let timer = &self.timers[number];
        let (flag, output) = (timer.next_flag(&prescaler), timer.next_output(&prescaler));
        let source = Source::TIMERS[number];
        if self.is_output_watched(number) {
            let either = [flag, output].into_iter().flatten().min();
            self.schedule.set(source, either);
            self.schedule.set_quiet(source, None);
        } else {
            self.schedule.set(source, flag);
            self.schedule.set_quiet(source, output);
        }
    }

    /// Whether anything inside the chip looks at a pin that a timer may drive.
    fn is_output_watched(&self, number: usize) -> bool {
        let watched = self.external.watched();
        let mut ports = watched.iter().zip(COMPARE_MASKS[number]);
        ports.any(|(watched, pins)| watched & pins != 0)
    }

    /// Brings the output stage of a port up to date and reports edges.
    pub(crate) fn update_port<E: Environment>(&mut self, port: usize, at: u64, env: &mut E) {
        let mut over = Override::default();
        for (timer, pins) in self.timers.iter().zip(COMPARE_PINS) {
            for (channel, pin_port, bit) in pins {
                if pin_port == port {
                    over.drive(1 << bit, timer.output(channel));
                }
            }
        }
        if port == 0 && self.spi.is_master() {
            let (clock, data) = self.spi.outputs();
            over.drive(SCK, Some(clock));
            over.drive(MOSI, Some(data));
            over.force_in |= MISO;
        }
        if port == 2 && self.usart.transmits() {
            over.drive(TXD, Some(self.usart.line()));
            over.force_out |= TXD;
        }
        if port == 2 && self.usart.receives() {
            over.force_in |= RXD;
        }
        let (mut edges, touched) = self.ports[port].update(over, at);
        let level = self.ports[port].level();
        while edges != 0 {
            let bit = edges.trailing_zeros() as u8;
            edges &= edges - 1;
            let pin = Pin::at(port, bit);
            self.statistics.pin_edges[pin.index()] += 1;
            env.pin_edge(at, pin, level >> bit & 1 != 0);
        }
        if self.external.watched()[port] & touched != 0 {
            self.look_at_pins(at, env);
        }
    }

    /// Levels of the pins of `mask` of a port during cycle `at`, before the synchroniser.
    pub(crate) fn pin_levels<E: Environment>(
        &self,
        port: usize,
        mask: u8,
        at: u64,
        env: &mut E,
    ) -> u8 {
        let (driven, level) = self.ports[port].outputs(at);
        let pull_ups = self.ports[port].pull_ups(self.system.mcucr & 0x10 != 0);
        let mut levels = level;
        for bit in (0..8).filter(|bit| (mask & !driven) >> bit & 1 != 0) {
            let pulled = pull_ups >> bit & 1 != 0;
            let high = env.pin_level(at, Pin::at(port, bit)).unwrap_or(pulled);
            levels |= u8::from(high) << bit;
        }
        levels
    }

    /// Value of PINx read in cycle `at`: synchronised, and 0 where DIDR disables the buffer.
    pub(crate) fn read_pins<E: Environment>(&self, port: usize, at: u64, env: &mut E) -> u8 {
        let pins = if port == 1 { 0x7F } else { 0xFF };
        let levels = self.pin_levels(port, pins, at.saturating_sub(1), env);
        match port {
            1 => levels & !(self.system.didr[0] & 0x3F),
            2 => levels & !((self.system.didr[1] & 3) << 6),
            _ => levels,
        }
    }

    /// Which timer flags the converter watches.
    pub(crate) fn watch_trigger(&mut self) {
        let source = self.adc.trigger_source();
        self.timers[0].watched = match source {
            Some(3) => OCFA,
            Some(4) => TOV,
            _ => 0,
        };
        self.timers[1].watched = match source {
            Some(5) => OCFB,
            Some(6) => TOV,
            Some(7) => ICF,
            _ => 0,
        };
    }

    /// Starts a conversion if the selected trigger flag has risen.
    pub(crate) fn update_trigger<E: Environment>(&mut self, at: u64, env: &mut E) {
        let level = match self.adc.trigger_source() {
            Some(1) => self.comparator.output(),
            Some(2) => self.external.int_flag(0),
            Some(3) => self.timers[0].flags() & OCFA != 0,
            Some(4) => self.timers[0].flags() & TOV != 0,
            Some(5) => self.timers[1].flags() & OCFB != 0,
            Some(6) => self.timers[1].flags() & TOV != 0,
            Some(7) => self.timers[1].flags() & ICF != 0,
            _ => false,
        };
        let rising = level && !self.trigger_level;
        self.trigger_level = level;
        if !rising || !self.adc.is_enabled() {
            return;
        }
        if self.adc.trigger(at) {
            self.after_adc(at);
        } else {
            self.statistics.triggers_ignored += 1;
            env.trigger_ignored(at);
        }
    }

    pub(crate) fn after_adc(&mut self, at: u64) {
        self.interrupts
            .request(vector::ADC, self.adc.requests(), at);
        // That it starts and samples changes nothing for the program.
        self.schedule.set_quiet(Source::Adc, self.adc.next_event());
        self.schedule.set(Source::Adc, self.adc.end());
    }

    pub(crate) fn step_adc<E: Environment>(&mut self, at: u64, env: &mut E) {
        match self.adc.step() {
            Step::Nothing => {}
            Step::Sample { input, reference } => {
                let (input, volts) = self.analog_input(input, at, env);
                let reference_volts = match reference {
                    0 => self.supply.aref_volts,
                    1 => self.supply.avcc_volts,
                    _ => self.supply.bandgap_volts,
                };
                self.adc.hold(input, volts, reference_volts);
            }
            Step::Complete(conversion) => {
                self.statistics.conversions += 1;
                let lost = conversion.discarded || conversion.overwrote_unread;
                self.statistics.conversions_lost += u64::from(lost);
                env.conversion(conversion);
            }
        }
        self.after_adc(at);
    }

    pub(crate) fn analog_input<E: Environment>(
        &self,
        mux: u8,
        at: u64,
        env: &mut E,
    ) -> (AnalogInput, f64) {
        let input = match mux {
            0..=7 => AnalogInput::Pin(mux),
            8 => AnalogInput::Temperature,
            14 => AnalogInput::Bandgap,
            _ => AnalogInput::Ground,
        };
        let volts = match input {
            AnalogInput::Bandgap => self.supply.bandgap_volts,
            AnalogInput::Ground => 0.0,
            outside => {
                let volts = env.analog(at, outside);
                self.at_pin(outside, volts, at, env)
            }
        };
        (input, volts)
    }

    /// The voltage of an analog pin to which the outside gives `volts`: what the port drives, if it does.
    pub(crate) fn at_pin<E: Environment>(
        &self,
        input: AnalogInput,
        volts: f64,
        at: u64,
        env: &mut E,
    ) -> f64 {
        // ADC0 to ADC5 are port C's, the comparator's inputs PD6 and PD7; ADC6 and ADC7 have no port.
        let (port, bit) = match input {
            AnalogInput::Pin(channel @ 0..=5) => (1, channel),
            AnalogInput::Ain0 => (2, 6),
            AnalogInput::Ain1 => (2, 7),
            _ => return volts,
        };
        let mask = 1 << bit;
        let (driven, level) = self.ports[port].outputs(at);
        if driven & mask != 0 {
            let is_high = level & mask != 0;
            env.analog_driven(at, input, PortDrive::Output(is_high));
            return if is_high { self.supply.avcc_volts } else { 0.0 };
        }
        if self.ports[port].pull_ups(self.system.mcucr & 0x10 != 0) & mask != 0 {
            env.analog_driven(at, input, PortDrive::PullUp);
        }
        volts
    }

    /// Takes notice of what the environment has changed by cycle `at`.
    pub(crate) fn poll_input<E: Environment>(&mut self, at: u64, env: &mut E) {
        self.poll_serial(at, env);
        if !self.is_io_stopped() {
            self.after_usart(at);
        }
        self.look_at_pins(at, env);
        if self.comparator.is_watched() {
            self.compare_inputs(at, env);
        }
        let next = env.next_input(at).map(|next| next.max(at + 1));
        self.schedule.set(Source::Input, next);
    }

    /// Clears the flag of a vector that is being entered, where entry clears it.
    pub(crate) fn acknowledge<E: Environment>(&mut self, vector: usize, at: u64, env: &mut E) {
        for (number, vectors) in TIMER_VECTORS.into_iter().enumerate() {
            if TIMER_REQUESTS[number] >> vector & 1 == 0 {
                continue;
            }
            for (bit, timer_vector) in vectors {
                if bit != 0 && timer_vector == vector {
                    self.sync_timer(number, at, env);
                    self.timers[number].clear_flags(bit);
                    self.after_timer(number, at, env);
                }
            }
        }
        match vector {
            vector::USART_TX => {
                self.usart.clear_transmitted();
                self.after_usart(at);
            }
            vector::ADC => {
                self.adc.clear_flag();
                self.after_adc(at);
            }
            vector::INT0 | vector::INT1 => {
                self.external.clear_int(vector - vector::INT0);
                self.after_external(at, env);
            }
            vector::PCINT0..=vector::PCINT2 => {
                self.external.clear_change(vector - vector::PCINT0);
                self.after_external(at, env);
            }
            vector::WDT => {
                self.watchdog.acknowledge();
                self.after_watchdog(at);
            }
            vector::SPI_STC => {
                self.spi.clear_flag();
                self.after_spi(at, env);
            }
            vector::ANALOG_COMP => {
                self.comparator.clear_flag();
                self.after_comparator(at, env);
            }
            _ => {}
        }
    }
}

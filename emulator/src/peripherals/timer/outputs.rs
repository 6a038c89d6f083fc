//! The waveform generator's outputs OCnA and OCnB (data sheet sections 15.6, 16.8, 18.6).

use super::super::prescaler::Prescaler;
use super::Timer;

/// A change of what drives a timer's pins.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OutputChange {
    /// Which of the connected outputs have changed their level; the same ones are connected.
    Levels([bool; 2]),
    /// Others are connected.
    Drivers,
}

impl Timer {
    /// Level of output `channel` if the waveform generator drives its pin.
    #[inline]
    pub(crate) fn output(&self, channel: usize) -> Option<bool> {
        self.connected[channel].then_some(self.outputs[channel])
    }

    /// How what drives the pins has changed since the last call.
    #[inline]
    pub(crate) fn outputs_changed(&mut self) -> OutputChange {
        let levels = std::array::from_fn(|channel| self.connected[channel] & self.outputs[channel]);
        let (connected, before) = std::mem::replace(&mut self.shown, (self.connected, levels));
        if connected != self.connected {
            return OutputChange::Drivers;
        }
        OutputChange::Levels(std::array::from_fn(|channel| {
            levels[channel] != before[channel]
        }))
    }

    /// The next cycle at which an output that drives its pin may change.
    #[inline]
    pub(crate) fn next_output(&self, prescaler: &Prescaler) -> Option<u64> {
        if self.connected == [false; 2] {
            return None;
        }
        self.next_critical(true, true, prescaler)
    }

    /// Goes on to the next change of what drives the pins, if there is one up to cycle `to`.
    pub(crate) fn next_change(
        &mut self,
        to: u64,
        prescaler: &Prescaler,
    ) -> Option<(u64, OutputChange)> {
        while let Some(at) = self.next_output(prescaler).filter(|&at| at <= to) {
            self.glide(self.distance(true, true) - 1);
            self.tick();
            self.last = at;
            let change = self.outputs_changed();
            if change != OutputChange::Levels([false; 2]) {
                return Some((at, change));
            }
        }
        None
    }

    /// The output action of a compare match.
    #[inline]
    pub(super) fn drive_match(&mut self, channel: usize) {
        // Counting down in phase-correct modes reverses clear and set.
        let set = (self.output_mode(channel) == 3) != (self.mode.is_phase() && self.down);
        match self.output_mode(channel) {
            1 if self.connected[channel] => self.outputs[channel] = !self.outputs[channel],
            2 | 3 => self.outputs[channel] = set,
            _ => {}
        }
    }

    /// Fast PWM at BOTTOM: set in non-inverting mode, clear in inverting mode.
    pub(super) fn drive_all(&mut self, level: bool) {
        for channel in 0..2 {
            match self.output_mode(channel) {
                2 => self.outputs[channel] = level,
                3 => self.outputs[channel] = !level,
                _ => {}
            }
        }
    }

    /// COM bits of a channel.
    #[inline]
    pub(super) fn output_mode(&self, channel: usize) -> u8 {
        self.output_modes[channel]
    }

    pub(super) fn is_connected(&self, channel: usize) -> bool {
        match self.output_mode(channel) {
            0 => false,
            1 => !self.mode.is_pwm() || (channel == 0 && self.mode.toggle_a),
            _ => true,
        }
    }

    /// FOC strobes: an output action without flag or clear, outside PWM modes only.
    pub(super) fn force_outputs(&mut self, value: u8) {
        if self.mode.is_pwm() {
            return;
        }
        for channel in 0..2 {
            if value & 0x80 >> channel != 0 {
                self.drive_match(channel);
            }
        }
    }
}

//! Load over time: how much of each window the processor was awake, and in interrupts.
//!
//! Windows double when they become too many, so that a run of any length has at most
//! [`MOST_WINDOWS`] of them.

/// Most windows kept; even.
const MOST_WINDOWS: usize = 1024;
/// Windows per second at the beginning.
const FIRST_PER_SECOND: u64 = 1000;

/// What the processor does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    Main,
    Interrupt,
    Asleep,
}

/// Cycles of one window; what is left of it was sleep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Window {
    /// Cycles awake, interrupts included.
    pub awake: u64,
    /// Cycles in interrupts, entries included.
    pub interrupts: u64,
}

/// A [`Window`] with its place in time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadWindow {
    /// First cycle, counted from the beginning of the profile.
    pub begin: u64,
    /// Length in cycles; only the last one is shorter than the others.
    pub cycles: u64,
    /// What it holds.
    pub window: Window,
}

#[derive(Clone, Debug)]
pub(super) struct Load {
    begin: u64,
    cycles: u64,
    windows: Vec<Window>,
    state: State,
    since: u64,
}

impl Load {
    pub(super) fn new(begin: u64, hz: u64) -> Load {
        Load {
            begin,
            cycles: (hz / FIRST_PER_SECOND).max(1),
            windows: Vec::new(),
            state: State::Main,
            since: begin,
        }
    }

    /// From `cycle` on the processor is in `state`.
    pub(super) fn enter(&mut self, state: State, cycle: u64) {
        if state != self.state {
            self.settle(cycle);
            self.state = state;
        }
    }

    /// Adds what has passed up to `cycle`.
    pub(super) fn settle(&mut self, cycle: u64) {
        let cycle = cycle.max(self.since);
        let (mut from, to) = (self.since - self.begin, cycle - self.begin);
        self.since = cycle;
        while from < to {
            let index = self.window(from);
            let end = to.min((index as u64 + 1) * self.cycles);
            let window = &mut self.windows[index];
            let part = end - from;
            match self.state {
                State::Main => window.awake += part,
                State::Interrupt => {
                    window.awake += part;
                    window.interrupts += part;
                }
                State::Asleep => {}
            }
            from = end;
        }
    }

    /// Index of the window at `time`, which is made if it is not there.
    fn window(&mut self, time: u64) -> usize {
        while time / self.cycles >= MOST_WINDOWS as u64 {
            self.cycles *= 2;
            let pairs = self.windows.chunks(2).map(|pair| Window {
                awake: pair.iter().map(|window| window.awake).sum(),
                interrupts: pair.iter().map(|window| window.interrupts).sum(),
            });
            self.windows = pairs.collect();
        }
        let index = (time / self.cycles) as usize;
        if self.windows.len() <= index {
            self.windows.resize(index + 1, Window::default());
        }
        index
    }

    /// All windows up to the last settled cycle.
    pub(super) fn windows(&self) -> Vec<LoadWindow> {
        let end = self.since - self.begin;
        let windows = self.windows.iter().enumerate();
        windows
            .map(|(index, &window)| {
                let begin = index as u64 * self.cycles;
                LoadWindow {
                    begin,
                    cycles: self.cycles.min(end - begin),
                    window,
                }
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn windows_hold_what_was_put_in_however_long_the_run(
            parts in prop::collection::vec((0u64..200_000, 0u8..3), 1..60),
        ) {
            let mut load = Load::new(7, 1_000);
            let (mut cycle, mut awake, mut interrupts) = (7, 0, 0);
            for (length, state) in parts {
                let state = [State::Main, State::Interrupt, State::Asleep][usize::from(state)];
                load.enter(state, cycle);
                cycle += length;
                awake += if state == State::Asleep { 0 } else { length };
                interrupts += if state == State::Interrupt { length } else { 0 };
            }
            load.settle(cycle);
            let windows = load.windows();
            prop_assert!(windows.len() <= MOST_WINDOWS);
            prop_assert_eq!(windows.iter().map(|w| w.window.awake).sum::<u64>(), awake);
            prop_assert_eq!(windows.iter().map(|w| w.window.interrupts).sum::<u64>(), interrupts);
            prop_assert_eq!(windows.iter().map(|w| w.cycles).sum::<u64>(), cycle - 7);
            for window in windows {
                prop_assert!(window.window.awake <= window.cycles);
            }
        }
    }
}

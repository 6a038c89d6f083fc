//! The words of one operation in every step.

use std::ops::Range;

use crate::Word;

/// Words up to 32 bits, or wider ones. Truths are narrow: 0 or -1, a mask.
#[derive(Clone, Debug)]
pub enum Column {
    /// Words of at most 32 bits.
    Narrow(Vec<i32>),
    /// Words of up to 64 bits.
    Wide(Vec<i64>),
}

impl Default for Column {
    fn default() -> Self {
        Self::Narrow(Vec::new())
    }
}

impl Column {
    /// Number of steps.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Narrow(words) => words.len(),
            Self::Wide(words) => words.len(),
        }
    }

    /// True before the first trial.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The raw word in `step`; a truth's is 0 or -1.
    #[must_use]
    #[inline]
    pub fn get(&self, step: usize) -> i64 {
        match self {
            Self::Narrow(words) => words[step].into(),
            Self::Wide(words) => words[step],
        }
    }

    /// As an item of a tape: a truth's raw word is 0 or 1 there.
    pub(super) fn item(&self, step: usize, frac: u32, is_truth: bool) -> Word {
        let raw = self.get(step);
        Word {
            raw: if is_truth { raw & 1 } else { raw },
            frac,
        }
    }

    #[inline]
    pub(super) fn set(&mut self, step: usize, raw: i64, is_truth: bool) {
        let raw = if is_truth { -raw } else { raw };
        match self {
            Self::Narrow(words) => words[step] = raw as i32,
            Self::Wide(words) => words[step] = raw,
        }
    }

    /// Becomes a column of `steps` words of that width; words may change.
    pub(super) fn resize(&mut self, is_narrow: bool, steps: usize) {
        match (&mut *self, is_narrow) {
            (Self::Narrow(words), true) => words.resize(steps, 0),
            (Self::Wide(words), false) => words.resize(steps, 0),
            (_, true) => *self = Self::Narrow(vec![0; steps]),
            (_, false) => *self = Self::Wide(vec![0; steps]),
        }
    }

    pub(super) fn fill_range(&mut self, range: Range<usize>, raw: i64) {
        match self {
            Self::Narrow(words) => words[range].fill(raw as i32),
            Self::Wide(words) => words[range].fill(raw),
        }
    }

    /// Adds `flags` to the status of the steps in `range` where this truth holds.
    pub(super) fn raise(&self, flags: u16, status: &mut [u16], range: Range<usize>) {
        if let Self::Narrow(truths) = self {
            for (status, truth) in status[range.clone()].iter_mut().zip(&truths[range]) {
                *status |= flags & *truth as u16;
            }
        }
    }

    pub(super) fn fill(&mut self, raw: i64, is_narrow: bool, steps: usize) {
        self.resize(is_narrow, steps);
        match self {
            Self::Narrow(words) => words.fill(raw as i32),
            Self::Wide(words) => words.fill(raw),
        }
    }
}

//! The size of errors over many solutions, in little memory.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::metrics::larger;

/// Largest errors that are kept for the 99th percentile: enough for runs of 6.5 million solutions; in longer ones
/// it is undefined.
const MOST_KEPT: usize = 1 << 16;

/// The size of an error over many solutions; undefined without samples.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Root mean square.
    pub rms: Option<f64>,
    /// 99th percentile of the absolute error (nearest rank).
    pub p99: Option<f64>,
    /// Largest absolute error.
    pub max: Option<f64>,
    /// Mean.
    pub bias: Option<f64>,
    /// Solutions that count.
    pub samples: u64,
}

/// A size in the order of [`f64::total_cmp`]: what is not a number is the largest.
#[derive(Clone, Copy, Debug)]
struct Size(f64);

impl PartialEq for Size {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Size {}

impl PartialOrd for Size {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Size {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        self.0.total_cmp(&other.0)
    }
}

/// Adds errors up.
#[derive(Clone, Debug, Default)]
pub(crate) struct Errors {
    /// Whether the 99th percentile is wanted.
    keeps: bool,
    max: f64,
    sum: f64,
    square: f64,
    samples: u64,
    /// The largest, the smallest of them on top.
    largest: BinaryHeap<Reverse<Size>>,
}

impl Errors {
    /// With the 99th percentile.
    pub(crate) fn with_percentile() -> Self {
        Self {
            keeps: true,
            ..Self::default()
        }
    }

    /// Adds an error with its sign.
    pub(crate) fn add(&mut self, error: f64) {
        self.max = larger(self.max, error.abs());
        self.sum += error;
        self.square += error * error;
        self.samples += 1;
        if !self.keeps {
            return;
        }
        let size = Size(error.abs());
        if self.largest.len() < MOST_KEPT {
            self.largest.push(Reverse(size));
        } else if let Some(mut least) = self.largest.peek_mut()
            && least.0 < size
        {
            *least = Reverse(size);
        }
    }

    pub(crate) fn spread(&self) -> Spread {
        if self.samples == 0 {
            return Spread::default();
        }
        let count = self.samples as f64;
        let mut sizes: Vec<f64> = self.largest.iter().map(|size| size.0.0).collect();
        sizes.sort_by(f64::total_cmp);
        // Nearest rank: the smallest error that at least 99 % do not exceed. So many lie above it:
        let above = self.samples - (self.samples * 99).div_ceil(100);
        let p99 = usize::try_from(above + 1)
            .ok()
            .and_then(|from_end| sizes.len().checked_sub(from_end))
            .map(|place| sizes[place]);
        Spread {
            rms: Some((self.square / count).sqrt()),
            p99: p99.filter(|_| self.keeps),
            max: Some(self.max),
            bias: Some(self.sum / count),
            samples: self.samples,
        }
    }
}

/// A figure's key: `rms_deg` of `rms` in `deg`.
pub(crate) fn keyed(figure: &str, suffix: &str) -> String {
    if suffix.is_empty() {
        figure.to_owned()
    } else {
        format!("{figure}_{suffix}")
    }
}

/// A spread whose keys carry their unit.
pub(crate) struct Keyed<'a>(
    pub(crate) &'a Spread,
    pub(crate) &'a str,
    pub(crate) Figures,
);

/// Which figures of a spread are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Figures {
    /// rms, p99, max, samples.
    Sizes,
    /// bias, rms, max.
    Signed,
}

impl Serialize for Keyed<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self(spread, suffix, figures) = self;
        let mut map = serializer.serialize_map(None)?;
        let mut entry = |figure, value: Option<f64>| {
            // What is not a number is null.
            let value = value.filter(|value| value.is_finite());
            map.serialize_entry(&keyed(figure, suffix), &value)
        };
        match figures {
            Figures::Sizes => {
                entry("rms", spread.rms)?;
                entry("p99", spread.p99)?;
                entry("max", spread.max)?;
                map.serialize_entry("samples", &spread.samples)?;
            }
            Figures::Signed => {
                entry("bias", spread.bias)?;
                entry("rms", spread.rms)?;
                entry("max", spread.max)?;
            }
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_are_those_of_all_errors() {
        let mut errors = Errors::with_percentile();
        // 1 to 1000 in an order that is none.
        for at in 0..1000u32 {
            let size = f64::from(at * 7919 % 1000 + 1);
            errors.add(if at % 2 == 0 { size } else { -size });
        }
        let found = errors.spread();
        assert_eq!(
            (found.p99, found.max, found.samples),
            (Some(990.0), Some(1000.0), 1000)
        );
        let square: f64 = (1..=1000).map(|size| f64::from(size).powi(2)).sum();
        assert_eq!(found.rms, Some((square / 1000.0).sqrt()));
    }

    #[test]
    fn the_percentile_is_exact_beyond_what_is_kept() {
        let count = 3 * MOST_KEPT as u64;
        let mut errors = Errors::with_percentile();
        // 7919 is prime to 3 * 2^16.
        (0..count).for_each(|at| errors.add((at * 7919 % count + 1) as f64));
        let found = errors.spread();
        assert_eq!(found.p99, Some((count * 99).div_ceil(100) as f64));
        assert_eq!(found.max, Some(count as f64));
    }

    #[test]
    fn what_is_not_a_number_is_the_largest() {
        let mut errors = Errors::default();
        for error in [1.0, f64::NAN, 2.0] {
            errors.add(error);
        }
        assert!(errors.spread().max.is_some_and(f64::is_nan));
        assert_eq!(Errors::default().spread(), Spread::default());
    }
}

//! Distribution of a number of cycles: count, extremes, mean and a histogram.

/// Bins: 0, 1, 2 to 3, 4 to 7, and so on; the last one has no end.
const BINS: usize = 33;

/// How often which number of cycles occurred.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Distribution {
    count: u64,
    least: u64,
    most: u64,
    sum: u64,
    bins: [u64; BINS],
}

impl Default for Distribution {
    fn default() -> Distribution {
        Distribution {
            count: 0,
            least: u64::MAX,
            most: 0,
            sum: 0,
            bins: [0; BINS],
        }
    }
}

impl Distribution {
    pub(super) fn add(&mut self, cycles: u64) {
        self.count += 1;
        self.least = self.least.min(cycles);
        self.most = self.most.max(cycles);
        self.sum = self.sum.saturating_add(cycles);
        let bin = (u64::BITS - cycles.leading_zeros()) as usize;
        self.bins[bin.min(BINS - 1)] += 1;
    }

    /// Number of values.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Least value; `None` without values.
    pub fn least(&self) -> Option<u64> {
        (self.count > 0).then_some(self.least)
    }

    /// Greatest value; `None` without values.
    pub fn most(&self) -> Option<u64> {
        (self.count > 0).then_some(self.most)
    }

    /// Mean; `None` without values.
    pub fn mean(&self) -> Option<f64> {
        (self.count > 0).then(|| self.sum as f64 / self.count as f64)
    }

    /// The bins that hold something: least value, greatest value, count.
    pub fn bins(&self) -> Vec<(u64, u64, u64)> {
        let bins = self.bins.iter().enumerate().filter(|bin| *bin.1 > 0);
        bins.map(|(bin, &count)| match bin {
            0 => (0, 0, count),
            _ if bin == BINS - 1 => (1 << (bin - 1), u64::MAX, count),
            _ => (1 << (bin - 1), (1 << bin) - 1, count),
        })
        .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_value_lies_in_the_bin_that_holds_it() {
        for value in (0..40)
            .map(|bit| 1u64 << bit)
            .flat_map(|v| [v - 1, v, v + 1])
        {
            let mut distribution = Distribution::default();
            distribution.add(value);
            let bins = distribution.bins();
            assert_eq!(bins.len(), 1);
            assert!(
                (bins[0].0..=bins[0].1).contains(&value),
                "{value}: {bins:?}"
            );
            assert_eq!(distribution.least(), Some(value));
            assert_eq!(distribution.most(), Some(value));
        }
        assert_eq!(Distribution::default().mean(), None);
    }
}

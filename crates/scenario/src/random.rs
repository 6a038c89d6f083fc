//! Seeded random streams: one independent ChaCha stream per source of randomness.
//!
//! Bit-reproducible on every host: ChaCha is integer arithmetic, the normal distribution uses
//! exact operations and the `libm` crate only.

use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

/// A source of randomness; its number is the ChaCha stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// Phases of the synthetic tumble.
    Motion,
    /// White noise of one channel's sensor and analog chain.
    Channel(u8),
    /// 1/f noise of one channel's sensor.
    Flicker(u8),
    /// Noise of the converter, by conversion.
    Converter,
    /// Positions of the converter's steps.
    Steps,
}

impl Source {
    fn stream(self) -> u64 {
        match self {
            Source::Motion => 1,
            Source::Converter => 2,
            Source::Steps => 3,
            Source::Channel(index) => 0x100 + u64::from(index),
            Source::Flicker(index) => 0x200 + u64::from(index),
        }
    }
}

/// A stream of uniform and normal numbers.
#[derive(Clone, Debug)]
pub struct Random {
    bits: ChaCha8Rng,
    spare: Option<f64>,
}

impl Random {
    /// The stream of `source` under the run's `seed`.
    #[must_use]
    pub fn new(seed: u64, source: Source) -> Self {
        let mut bits = ChaCha8Rng::seed_from_u64(seed);
        bits.set_stream(source.stream());
        Self { bits, spare: None }
    }

    /// The same stream from the start of its `index`-th block of 16 words: random access.
    #[must_use]
    pub fn at_block(&self, index: u64) -> Self {
        let mut bits = self.bits.clone();
        bits.set_word_pos(u128::from(index) * 16);
        Self { bits, spare: None }
    }

    /// Uniform in [0, 1), 53 bits.
    pub fn uniform(&mut self) -> f64 {
        (self.bits.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normal with mean 0 and variance 1 (Marsaglia's polar method, both values used).
    pub fn normal(&mut self) -> f64 {
        if let Some(value) = self.spare.take() {
            return value;
        }
        loop {
            let (u, v) = (2.0 * self.uniform() - 1.0, 2.0 * self.uniform() - 1.0);
            let s = u * u + v * v;
            if s > 0.0 && s < 1.0 {
                let scale = (-2.0 * libm::log(s) / s).sqrt();
                self.spare = Some(v * scale);
                return u * scale;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_the_moments_of_the_normal_distribution() {
        let mut random = Random::new(7, Source::Channel(0));
        let n = 200_000;
        let mut moments = [0.0; 4];
        for _ in 0..n {
            let x = random.normal();
            for (power, moment) in moments.iter_mut().enumerate() {
                *moment += libm::pow(x, (power + 1) as f64) / f64::from(n);
            }
        }
        // Standard errors are about 0.0022, 0.0032, 0.0087, 0.022; limits are four of them.
        for (moment, (expected, limit)) in
            moments
                .iter()
                .zip([(0.0, 0.009), (1.0, 0.013), (0.0, 0.035), (3.0, 0.09)])
        {
            assert!((moment - expected).abs() < limit, "{moments:?}");
        }
    }

    #[test]
    fn streams_differ_between_sources_and_seeds_and_repeat_otherwise() {
        let first = |seed, source| Random::new(seed, source).normal().to_bits();
        assert_eq!(first(1, Source::Motion), first(1, Source::Motion));
        assert_ne!(first(1, Source::Motion), first(2, Source::Motion));
        assert_ne!(first(1, Source::Channel(0)), first(1, Source::Channel(1)));
        assert_ne!(first(1, Source::Channel(0)), first(1, Source::Flicker(0)));
    }

    #[test]
    fn blocks_are_reached_in_any_order() {
        let stream = Random::new(3, Source::Converter);
        let forward: Vec<f64> = (0..4).map(|i| stream.at_block(i).normal()).collect();
        let backward: Vec<f64> = (0..4).rev().map(|i| stream.at_block(i).normal()).collect();
        assert_eq!(forward, backward.into_iter().rev().collect::<Vec<_>>());
    }
}

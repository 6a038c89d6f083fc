//! Seeded random streams: one independent ChaCha stream per source of randomness.
//!
//! Bit-reproducible on every host: ChaCha is integer arithmetic, the normal distribution uses
//! exact operations and the `libm` crate only. It is Marsaglia and Tsang's ziggurat in Doornik's
//! form (2005): layers of equal area under exp(-x^2/2), most draws cost one comparison.

use std::sync::LazyLock;

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
    /// Parameters of random units.
    Units,
    /// Attitudes in which a unit is calibrated.
    Attitudes,
}

impl Source {
    fn stream(self) -> u64 {
        match self {
            Source::Motion => 1,
            Source::Converter => 2,
            Source::Steps => 3,
            Source::Units => 4,
            Source::Attitudes => 5,
            Source::Channel(index) => 0x100 + u64::from(index),
            Source::Flicker(index) => 0x200 + u64::from(index),
        }
    }
}

/// A stream of uniform and normal numbers.
#[derive(Clone, Debug)]
pub struct Random {
    bits: ChaCha8Rng,
}

/// Layers of the ziggurat.
const LAYERS: usize = 256;
/// Where its tail begins: the edge at which 256 layers of equal area close at the top.
const TAIL: f64 = 3.654_152_885_361_009;

/// Right edges of the layers, the widest first, and the share of each that lies under the next.
static ZIGGURAT: LazyLock<[(f64, f64); LAYERS]> = LazyLock::new(|| {
    let density = |x: f64| libm::exp(-0.5 * x * x);
    let tail_area = (std::f64::consts::PI / 2.0).sqrt() * libm::erfc(TAIL * 0.5_f64.sqrt());
    let area = TAIL * density(TAIL) + tail_area;
    let mut edges = [0.0; LAYERS + 1];
    edges[0] = area / density(TAIL);
    edges[1] = TAIL;
    for i in 2..LAYERS {
        let before = edges[i - 1];
        edges[i] = (-2.0 * libm::log(area / before + density(before))).sqrt();
    }
    std::array::from_fn(|i| (edges[i], edges[i + 1] / edges[i]))
});

impl Random {
    /// The stream of `source` under the run's `seed`.
    #[must_use]
    pub fn new(seed: u64, source: Source) -> Self {
        let mut bits = ChaCha8Rng::seed_from_u64(seed);
        bits.set_stream(source.stream());
        Self { bits }
    }

    /// The same stream from the start of its `index`-th block of 16 words: random access.
    #[must_use]
    pub fn at_block(&self, index: u64) -> Self {
        let mut bits = self.bits.clone();
        bits.set_word_pos(u128::from(index) * 16);
        Self { bits }
    }

    /// Uniform in [0, 1), 53 bits.
    pub fn uniform(&mut self) -> f64 {
        (self.bits.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Normal with mean 0 and variance 1.
    #[inline]
    pub fn normal(&mut self) -> f64 {
        let bits = self.bits.next_u64();
        let layer = (bits & 0xff) as usize;
        let u = signed_unit(bits);
        let (edge, inner) = ZIGGURAT[layer];
        if u.abs() < inner {
            u * edge
        } else {
            self.normal_outside(layer, u)
        }
    }

    /// The rare draws beside the next layer: the tail, or the wedge under the curve.
    #[cold]
    fn normal_outside(&mut self, mut layer: usize, mut u: f64) -> f64 {
        loop {
            let (edge, inner) = ZIGGURAT[layer];
            let x = u * edge;
            if u.abs() < inner {
                return x;
            }
            if layer == 0 {
                return self.tail().copysign(u);
            }
            let next = edge * inner;
            let low = libm::exp(-0.5 * (edge * edge - x * x));
            let high = libm::exp(-0.5 * (next * next - x * x));
            if low + self.uniform() * (high - low) < 1.0 {
                return x;
            }
            let bits = self.bits.next_u64();
            (layer, u) = ((bits & 0xff) as usize, signed_unit(bits));
        }
    }

    /// A normal number beyond the tail's begin.
    fn tail(&mut self) -> f64 {
        loop {
            let x = -libm::log(1.0 - self.uniform()) / TAIL;
            let y = -libm::log(1.0 - self.uniform());
            if 2.0 * y > x * x {
                return TAIL + x;
            }
        }
    }
}

/// The upper 53 bits as a number in [-1, 1).
fn signed_unit(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
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
    fn normal_numbers_fall_into_every_range_as_often_as_the_error_function_says() {
        let mut random = Random::new(21, Source::Channel(1));
        let n = 2_000_000_u32;
        let edges = [0.0, 0.2, 0.5, 1.0, 1.7, 2.5, 3.2, 3.7, 4.5];
        let mut counts = [0_u32; 8];
        for _ in 0..n {
            let x = random.normal().abs();
            if let Some(bin) = edges.windows(2).position(|e| (e[0]..e[1]).contains(&x)) {
                counts[bin] += 1;
            }
        }
        let below = |x: f64| libm::erf(x * 0.5_f64.sqrt());
        for (range, count) in edges.windows(2).zip(counts) {
            let expected = f64::from(n) * (below(range[1]) - below(range[0]));
            let deviations = (f64::from(count) - expected) / expected.sqrt();
            assert!(deviations.abs() < 4.5, "{range:?}: {count} of {expected}");
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
        for at in 1..forward.len() {
            assert!(!forward[..at].contains(&forward[at]), "{forward:?}");
        }
    }
}

//! Exact steps of x' = A x + B u + white noise over an interval in which u is a straight line.
//!
//! A step maps x to Phi x + Gamma u + N(0, Q). Phi = exp(A h), Gamma = int exp(A s) B ds, for a
//! slope of u int exp(A (h - s)) B s ds, and Q = int exp(A s) W exp(A' s) ds come from their series
//! on an interval so short that |A| h is at most 1/2, then by doubling: two equal steps in sequence
//! make one of twice the length. That is scaling and squaring for Phi; for Q it avoids the growing
//! exp(-A h) of Van Loan's block matrix.

use crate::matrix::{self, Matrix, Vector};

/// Number of inputs: the signal and the constant one.
pub const INPUTS: usize = 2;
/// Index of the signal's value at the start of a step, among inputs and responses.
pub const SIGNAL: usize = 0;
/// Index of the constant one.
pub const CONSTANT: usize = 1;
/// Index of the response to the signal's slope.
pub const SLOPE: usize = 2;
/// Number of responses.
pub const RESPONSES: usize = 3;

/// Terms of the series; the first one left out is under 1e-21 of the sum at |A| h = 1/2.
const TERMS: u32 = 20;

/// A linear system with white noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Linear<const N: usize> {
    /// State matrix, 1/s.
    pub a: Matrix<N>,
    /// Input columns.
    pub b: [Vector<N>; INPUTS],
    /// Intensity of the noise (two-sided), units squared per second.
    pub w: Matrix<N>,
}

/// An exact step.
#[derive(Clone, Debug, PartialEq)]
pub struct Step<const N: usize> {
    /// Transition matrix.
    pub phi: Matrix<N>,
    /// Responses to the signal at the start, the constant one, and the signal's slope per second.
    pub gamma: [Vector<N>; RESPONSES],
    /// Covariance that the noise adds.
    pub q: Matrix<N>,
    /// Length in seconds.
    pub span_s: f64,
}

impl<const N: usize> Step<N> {
    /// The step over no time.
    #[must_use]
    pub fn none() -> Self {
        Self::zero(matrix::identity(), 0.0)
    }

    fn zero(phi: Matrix<N>, span_s: f64) -> Self {
        Self {
            phi,
            gamma: [[0.0; N]; RESPONSES],
            q: [[0.0; N]; N],
            span_s,
        }
    }

    /// The step of `system` over `interval_s`.
    #[must_use]
    pub fn over(system: &Linear<N>, interval_s: f64) -> Self {
        let mut doublings = 0;
        let mut short_s = interval_s;
        while matrix::one_norm(&system.a) * short_s > 0.5 {
            short_s *= 0.5;
            doublings += 1;
        }
        let mut step = Self::series(system, short_s);
        for _ in 0..doublings {
            step = step.then(&step);
        }
        step
    }

    fn series(system: &Linear<N>, h: f64) -> Self {
        let Linear { a, b, w } = system;
        // With e = h^k / k! and i = h^(k+1) / (k+1)!: Phi = sum A^k e, Gamma = sum A^k i B
        // (for a slope with i h / (k + 2)),
        // Q = sum D_k i with D_0 = W and D_(k+1) = A D_k + D_k A'.
        let mut power = matrix::identity();
        let mut d = *w;
        let mut out = Self::zero([[0.0; N]; N], h);
        let mut e = 1.0;
        for k in 0..TERMS {
            let i = e * h / f64::from(k + 1);
            out.phi = matrix::sum_scaled(&out.phi, &power, e);
            out.q = matrix::sum_scaled(&out.q, &d, i);
            for (gamma, input) in out.gamma.iter_mut().zip(b) {
                matrix::add_scaled(gamma, &matrix::apply(&power, input), i);
            }
            let signal = matrix::apply(&power, &b[SIGNAL]);
            matrix::add_scaled(&mut out.gamma[SLOPE], &signal, i * h / f64::from(k + 2));
            power = matrix::product(a, &power);
            let half = matrix::product(a, &d);
            d = matrix::sum_scaled(&half, &matrix::transposed(&half), 1.0);
            e = i;
        }
        out
    }

    /// This step, then `next`.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        let gamma = std::array::from_fn(|input| {
            let mut column = matrix::apply(&next.phi, &self.gamma[input]);
            matrix::add_scaled(&mut column, &next.gamma[input], 1.0);
            if input == SLOPE {
                // By the start of the second step the slope has raised the signal.
                matrix::add_scaled(&mut column, &next.gamma[SIGNAL], self.span_s);
            }
            column
        });
        Self {
            phi: matrix::product(&next.phi, &self.phi),
            gamma,
            q: matrix::sum_scaled(&matrix::carried(&next.phi, &self.q), &next.q, 1.0),
            span_s: self.span_s + next.span_s,
        }
    }

    /// The state after this step without noise.
    #[inline]
    #[must_use]
    pub fn mean(&self, x: &Vector<N>, u: &[f64; RESPONSES]) -> Vector<N> {
        let mut y = matrix::apply(&self.phi, x);
        for (column, value) in self.gamma.iter().zip(u) {
            matrix::add_scaled(&mut y, column, *value);
        }
        y
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_rc_follows_its_closed_form_including_its_thermal_noise() {
        // x' = (u - x) / tau with kT/C noise: variance (kT/C)(1 - exp(-2 t / tau)).
        let (tau, variance) = (1e-7, 4.1e-11);
        let system = Linear {
            a: [[-1.0 / tau]],
            b: [[1.0 / tau], [0.0]],
            w: [[2.0 * variance / tau]],
        };
        for t in [1e-9, 1e-8, 3e-7, 1e-6, 1e-3] {
            let step = Step::over(&system, t);
            let decay = libm::exp(-t / tau);
            assert!((step.phi[0][0] - decay).abs() < 1e-14, "{t}");
            assert!((step.gamma[0][0] - (1.0 - decay)).abs() < 1e-13, "{t}");
            let expected = variance * (1.0 - decay * decay);
            assert!((step.q[0][0] - expected).abs() < 1e-13 * variance, "{t}");
        }
    }

    #[test]
    fn a_resonator_follows_its_closed_form_step_response() {
        let (w, quality) = (2.0 * std::f64::consts::PI * 16e3, 100.0);
        let system = Linear {
            a: [[0.0, -w], [w, -w / quality]],
            b: [[0.0, w], [0.0, 0.0]],
            w: [[0.0; 2]; 2],
        };
        let (zeta, start): (f64, _) = (0.5 / quality, [0.0, 0.0]);
        let damped = w * (1.0 - zeta * zeta).sqrt();
        for t in [1e-6, 31.25e-6, 62.5e-6, 1e-3, 1e-2] {
            let x = Step::over(&system, t).mean(&start, &[1.0, 0.0, 0.0])[0];
            let (s, c) = libm::sincos(damped * t);
            let expected = 1.0 - libm::exp(-zeta * w * t) * (c + zeta * w / damped * s);
            assert!((x - expected).abs() < 2e-12, "{t}: {x} {expected}");
        }
    }

    #[test]
    fn an_rc_follows_a_ramp_with_its_lag() {
        let tau = 1e-3;
        let system = Linear {
            a: [[-1.0 / tau]],
            b: [[1.0 / tau], [0.0]],
            w: [[0.0]],
        };
        for t in [1e-6, 1e-4, 1e-3, 7e-3] {
            let x = Step::over(&system, t).mean(&[0.0], &[0.5, 0.0, 20.0])[0];
            let decay = libm::exp(-t / tau);
            let expected = 0.5 * (1.0 - decay) + 20.0 * (t - tau * (1.0 - decay));
            assert!((x - expected).abs() < 1e-15, "{t}: {x} {expected}");
        }
    }

    #[test]
    fn two_steps_in_sequence_are_the_step_over_both() {
        let system = Linear {
            a: [[-3.0, 1.0, 0.0], [0.0, -40.0, 2.0], [5.0, 0.0, -500.0]],
            b: [[1.0, 0.0, 0.0], [0.0, 2.0, 1.0]],
            w: [[1.0, 0.5, 0.0], [0.5, 2.0, 0.0], [0.0, 0.0, 3.0]],
        };
        let whole = Step::over(&system, 0.31);
        let parts = Step::over(&system, 0.1).then(&Step::over(&system, 0.21));
        assert!(matrix::one_norm(&matrix::sum_scaled(&whole.phi, &parts.phi, -1.0)) < 1e-13);
        assert!(matrix::one_norm(&matrix::sum_scaled(&whole.q, &parts.q, -1.0)) < 1e-13);
        for (one, two) in whole
            .gamma
            .iter()
            .flatten()
            .zip(parts.gamma.iter().flatten())
        {
            assert!((one - two).abs() < 1e-14);
        }
    }
}

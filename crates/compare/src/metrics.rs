//! How far one stream of values lies from another.

use serde::Serialize;

use crate::input::Expectation;
use crate::limit::beyond_allowance;

/// The unit whose differences are wrapped.
pub(crate) const WRAPPING_UNIT: &str = "half_turn";

/// A turn in that unit.
const TURN: f64 = 2.0;

/// Statistics of the differences native - reference. Undefined figures are `None` (JSON null).
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Difference {
    /// Largest absolute difference; `None` without samples.
    pub max_abs: Option<f64>,
    /// Root mean square.
    pub rms: Option<f64>,
    /// Mean.
    pub bias: Option<f64>,
    /// Power of the reference over that of the difference, in dB; undefined where either is zero.
    pub sqnr_db: Option<f64>,
    /// `max_abs` in steps of the deployed format.
    pub max_lsb: Option<f64>,
    /// The first difference beyond the tolerance, where this comparison is judged.
    pub first_violation: Option<Violation>,
    /// Values compared: those of solutions without status flags.
    pub samples: u64,
    /// Largest share of its limit that a value takes, where this comparison is judged.
    pub used: Option<f64>,
    /// The limit, scaled to the largest difference: `max_abs` over `used`.
    pub limit: Option<f64>,
    /// The differences over their expected deviations.
    pub normalised: Option<Normalised>,
    /// Values without a limit, since a divisor could be zero.
    pub unbounded: u64,
}

/// Differences over their expected deviations, the expected bias taken off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Normalised {
    /// Root mean square; 1 is expected.
    pub rms: f64,
    /// Mean; 0 is expected.
    pub bias: f64,
    /// Values with a deviation.
    pub samples: u64,
}

/// Where and by what a tolerance was first missed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Violation {
    /// Index of the value in the node's stream.
    pub sample: usize,
    /// Index of the solution.
    pub solution: usize,
    /// The golden model's value, where it is the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub golden: Option<f64>,
    /// The real interpretation's value, where it is the reference.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub real: Option<f64>,
    /// The native participant's value.
    pub native: f64,
}

impl Violation {
    /// The value that native was judged against.
    #[must_use]
    pub fn reference(&self) -> f64 {
        self.golden.or(self.real).unwrap_or(f64::NAN)
    }
}

/// What native is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Against {
    Golden,
    Real,
}

/// One pair of values.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub(crate) sample: usize,
    pub(crate) reference: f64,
    pub(crate) native: f64,
    pub(crate) expectation: Expectation,
}

/// How large differences may be.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Limits {
    /// Not judged.
    None,
    /// One limit for all.
    Absolute(f64),
    /// What rounding is expected to make of each value, `most` deviations of it, and `allowance`.
    Expected { allowance: f64, most: f64 },
}

/// What decides how pairs are compared.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rule {
    pub(crate) against: Against,
    pub(crate) wrap: bool,
    pub(crate) lsb: f64,
    pub(crate) per_solution: usize,
    pub(crate) limit: Limits,
}

/// native - reference; an angle's the short way round.
pub(crate) fn difference(native: f64, reference: f64, wrap: bool) -> f64 {
    let plain = native - reference;
    if wrap && plain.is_finite() && plain.abs() >= 1.0 {
        plain - TURN * (plain / TURN).round()
    } else {
        plain
    }
}

/// Whether a size is beyond its limit; what is not a number is beyond any.
pub(crate) fn exceeds(size: f64, limit: f64) -> bool {
    size.is_nan() || limit.is_nan() || size > limit
}

/// The larger of two sizes; not a number where either is none, so that it cannot be passed over.
pub(crate) fn larger(left: f64, right: f64) -> f64 {
    if left.is_nan() || right.is_nan() {
        f64::NAN
    } else {
        left.max(right)
    }
}

/// Adds pairs up, one after another.
#[derive(Debug)]
pub(crate) struct Differences {
    rule: Rule,
    samples: u64,
    max_abs: f64,
    sum: f64,
    square: f64,
    power: f64,
    first_violation: Option<Violation>,
    judged: Judged,
}

impl Differences {
    pub(crate) fn new(rule: Rule) -> Self {
        Self {
            rule,
            samples: 0,
            max_abs: 0.0,
            sum: 0.0,
            square: 0.0,
            power: 0.0,
            first_violation: None,
            judged: Judged::default(),
        }
    }

    /// Adds a pair and gives the difference. One that is not a number is worse than any limit.
    pub(crate) fn add(&mut self, pair: Pair) -> f64 {
        let difference = difference(pair.native, pair.reference, self.rule.wrap);
        self.samples += 1;
        self.max_abs = larger(self.max_abs, difference.abs());
        self.sum += difference;
        self.square += difference * difference;
        self.power += pair.reference * pair.reference;
        let is_beyond = self.judged.add(difference, pair.expectation, self.rule);
        if is_beyond && self.first_violation.is_none() {
            self.first_violation = Some(violation(pair, self.rule));
        }
        difference
    }

    pub(crate) fn found(&self) -> Difference {
        if self.samples == 0 {
            return Difference::default();
        }
        let (rule, judged) = (self.rule, &self.judged);
        let count = self.samples as f64;
        let (square, power, max_abs) = (self.square, self.power, self.max_abs);
        Difference {
            max_abs: Some(max_abs),
            rms: Some((square / count).sqrt()),
            bias: Some(self.sum / count),
            sqnr_db: (square > 0.0 && power > 0.0).then(|| 10.0 * libm::log10(power / square)),
            max_lsb: (rule.lsb > 0.0).then(|| max_abs / rule.lsb),
            first_violation: self.first_violation.clone(),
            samples: self.samples,
            used: judged.used,
            limit: judged.used.map(|used| match rule.limit {
                Limits::Expected { .. } if used > 0.0 => max_abs / used,
                Limits::Absolute(limit) => limit,
                // Every difference is exactly what was expected: the widest of what is permitted.
                _ => judged.widest,
            }),
            normalised: judged.normalised(),
            unbounded: judged.unbounded,
        }
    }
}

/// What is judged while values pass.
#[derive(Debug, Default)]
struct Judged {
    /// Largest share of its limit that any value takes.
    used: Option<f64>,
    /// Largest difference that any value is permitted, the expected one included.
    widest: f64,
    sum: f64,
    square: f64,
    /// Values with a deviation.
    count: usize,
    unbounded: u64,
}

impl Judged {
    /// Adds a difference; true if it is beyond its limit.
    fn add(&mut self, difference: f64, expectation: Expectation, rule: Rule) -> bool {
        let (size, limit) = match rule.limit {
            Limits::None => return false,
            Limits::Absolute(limit) => (difference.abs(), limit),
            Limits::Expected { allowance, most } => {
                if expectation.deviation == f64::INFINITY {
                    self.unbounded += 1;
                    return false;
                }
                let error = difference - expectation.bias;
                // Where nothing is rounded only f64's own rounding remains.
                let least = LEAST_STEP * rule.lsb;
                if expectation.deviation > least {
                    let deviations = beyond_allowance(error, allowance) / expectation.deviation;
                    self.sum += deviations;
                    self.square += deviations * deviations;
                    self.count += 1;
                }
                let limit = allowance + most * expectation.deviation + least;
                self.widest = larger(self.widest, expectation.bias.abs() + limit);
                (error.abs(), limit)
            }
        };
        let used = if size == 0.0 { 0.0 } else { size / limit };
        self.used = Some(self.used.map_or(used, |before| larger(before, used)));
        exceeds(size, limit)
    }

    fn normalised(&self) -> Option<Normalised> {
        let count = self.count as f64;
        (self.count > 0).then(|| Normalised {
            rms: (self.square / count).sqrt(),
            bias: self.sum / count,
            samples: self.count as u64,
        })
    }
}

/// What f64's own rounding may add, in steps of the deployed format.
const LEAST_STEP: f64 = 1e-3;

fn violation(pair: Pair, rule: Rule) -> Violation {
    let reference = |against| (rule.against == against).then_some(pair.reference);
    Violation {
        sample: pair.sample,
        solution: pair.sample / rule.per_solution,
        golden: reference(Against::Golden),
        real: reference(Against::Real),
        native: pair.native,
    }
}

//! The error budget: the way from truth to the emulated output in steps that add up.
//!
//! Each part is the step from one attitude series to the next, so that per angle and solution the
//! parts sum to the whole error (wrapped); that they do is checked. The rotation of a part is the
//! angle between the two attitudes; rotations do not add, but their sizes can be compared.

use serde::Serialize;

use crate::attitude::{Spread, angle_errors, rotation_error};
use crate::input::{Attitudes, Series};
use crate::metrics::{difference, larger};

/// Root mean square in degrees of each part's rotation, over solutions without status flags.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ErrorBudget {
    /// Sensors and front end: golden on ideal voltages, less golden on ideal readings of the true
    /// specific force and field.
    pub sensor_frontend: Option<f64>,
    /// Latency and channel skew: golden on ideal readings at the sampling instants, less truth.
    pub latency: Option<f64>,
    /// Quantisation by the converter: golden on codes, less golden on ideal voltages.
    pub adc: Option<f64>,
    /// Series and iterations: the algorithm in f64, less golden on the same codes.
    pub algorithm: Option<f64>,
    /// Word lengths: deployed, less the algorithm in f64.
    pub rounding: Option<f64>,
    /// Compiled code: emulated, less deployed. Must be zero.
    pub compiled: Option<f64>,
    /// Motion and environment: golden on ideal readings of the true specific force and field, less
    /// golden on ideal readings at rest in the true attitude. It is the method's own error.
    pub motion: Option<f64>,
}

/// The budget per angle.
#[derive(Clone, Debug, Default, Serialize)]
pub struct BudgetDetail {
    /// The parts in signal order.
    pub parts: Vec<PartDetail>,
    /// What the whole chain errs by, emulated less truth.
    pub whole: Option<PartDetail>,
    /// Largest difference in degrees between the sum of the parts and the whole, over all angles
    /// and all solutions that every part knows; `None` when there is none.
    pub closure_deg: Option<f64>,
    /// Solutions over which the closure was checked.
    pub closure_samples: u64,
    /// Each node's share of the rounding, in signal order; empty when the caller gave no steps.
    pub rounding_shares: Vec<RoundingShare>,
}

/// One part of the budget.
#[derive(Clone, Debug, Default, Serialize)]
pub struct PartDetail {
    /// Name, as in [`ErrorBudget`].
    pub part: String,
    /// Of set 1's yaw.
    pub yaw: AngleSpread,
    /// Of set 1's pitch.
    pub pitch: AngleSpread,
    /// Of set 1's roll.
    pub roll: AngleSpread,
    /// Size of the rotation.
    pub rotation: Spread,
}

/// A signed error over many solutions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct AngleSpread {
    /// Mean, degrees.
    pub bias_deg: Option<f64>,
    /// Root mean square, degrees.
    pub rms_deg: Option<f64>,
    /// Largest absolute value, degrees.
    pub max_deg: Option<f64>,
}

/// A node's share of the rounding.
#[derive(Clone, Debug, Default, Serialize)]
pub struct RoundingShare {
    /// The node; `(rest)` for what the given steps do not explain.
    pub node: String,
    /// Root mean square of the rotation, degrees.
    pub rms_deg: Option<f64>,
    /// Largest rotation, degrees.
    pub max_deg: Option<f64>,
}

/// The parts in signal order with the series at their ends.
fn steps(attitudes: &Attitudes) -> [(&'static str, &Series, &Series); 7] {
    let a = attitudes;
    [
        ("latency", &a.truth, &a.direct),
        ("motion", &a.direct, &a.experienced),
        ("sensor_frontend", &a.experienced, &a.ideal),
        ("adc", &a.ideal, &a.codes),
        ("algorithm", &a.codes, &a.real),
        ("rounding", &a.real, &a.deployed),
        ("compiled", &a.deployed, &a.emulated),
    ]
}

/// The budget over solutions that `counts` admits; `None` for parts whose ends the run lacks.
pub(crate) fn budget(
    attitudes: &Attitudes,
    counts: &impl Fn(usize) -> bool,
) -> (ErrorBudget, BudgetDetail) {
    let steps = steps(attitudes);
    let parts: Vec<PartDetail> = steps
        .iter()
        .filter_map(|(part, from, to)| detail(part, from, to, counts))
        .collect();
    let rms = |name: &str| {
        let part = parts.iter().find(|part| part.part == name)?;
        part.rotation.rms_deg
    };
    let budget = ErrorBudget {
        sensor_frontend: rms("sensor_frontend"),
        latency: rms("latency"),
        adc: rms("adc"),
        algorithm: rms("algorithm"),
        rounding: rms("rounding"),
        compiled: rms("compiled"),
        motion: rms("motion"),
    };
    let (closure_deg, closure_samples) = closure(attitudes, counts);
    let detail = BudgetDetail {
        whole: detail("whole", &attitudes.truth, &attitudes.emulated, counts),
        parts,
        closure_deg,
        closure_samples,
        rounding_shares: rounding_shares(attitudes, counts),
    };
    (budget, detail)
}

fn detail(
    part: &str,
    from: &Series,
    to: &Series,
    counts: &impl Fn(usize) -> bool,
) -> Option<PartDetail> {
    if from.is_absent() || to.is_absent() {
        return None;
    }
    let (mut angles, mut rotation) = ([const { Vec::new() }; 3], Vec::new());
    for solution in (0..from.0.len().min(to.0.len())).filter(|&solution| counts(solution)) {
        if let (Some(from), Some(to)) = (from.at(solution), to.at(solution)) {
            for (all, error) in angles.iter_mut().zip(angle_errors(to, from)) {
                all.push(error);
            }
            rotation.push(rotation_error(to, from));
        }
    }
    let [yaw, pitch, roll] = angles.map(|errors| AngleSpread::of(&errors));
    Some(PartDetail {
        part: part.to_owned(),
        yaw,
        pitch,
        roll,
        rotation: Spread::of(&rotation),
    })
}

impl AngleSpread {
    fn of(errors: &[f64]) -> Self {
        let Spread {
            rms_deg, max_deg, ..
        } = Spread::of(errors);
        let mean = errors.iter().sum::<f64>() / errors.len() as f64;
        Self {
            bias_deg: rms_deg.map(|_| mean),
            rms_deg,
            max_deg,
        }
    }
}

/// How far the parts are from adding up, and over how many solutions that was checked. An error that
/// is not a number is reported as such, not as closed.
fn closure(attitudes: &Attitudes, counts: &impl Fn(usize) -> bool) -> (Option<f64>, u64) {
    let steps = steps(attitudes);
    let (mut worst, mut checked) = (0f64, 0);
    for solution in (0..attitudes.truth.0.len()).filter(|&solution| counts(solution)) {
        let (Some(truth), Some(last)) = (
            attitudes.truth.at(solution),
            attitudes.emulated.at(solution),
        ) else {
            continue;
        };
        let parts: Option<Vec<[f64; 3]>> = steps
            .iter()
            .map(|(_, from, to)| Some(angle_errors(to.at(solution)?, from.at(solution)?)))
            .collect();
        let Some(parts) = parts else { continue };
        checked += 1;
        for (angle, whole) in angle_errors(last, truth).into_iter().enumerate() {
            let sum: f64 = parts.iter().map(|part| part[angle]).sum();
            let open = 180.0 * difference(sum / 180.0, whole / 180.0, true).abs();
            worst = larger(worst, open);
        }
    }
    ((checked > 0).then_some(worst), checked)
}

/// The steps between real and deployed, and what they leave.
fn rounding_shares(attitudes: &Attitudes, counts: &impl Fn(usize) -> bool) -> Vec<RoundingShare> {
    let steps = &attitudes.rounding_steps;
    let mut from = &attitudes.real;
    let mut shares = Vec::new();
    for (node, to) in steps
        .iter()
        .map(|step| (step.node.as_str(), &step.attitudes))
        .chain((!steps.is_empty()).then_some(("(rest)", &attitudes.deployed)))
    {
        if let Some(detail) = detail(node, from, to, counts) {
            shares.push(RoundingShare {
                node: detail.part,
                rms_deg: detail.rotation.rms_deg,
                max_deg: detail.rotation.max_deg,
            });
        }
        from = to;
    }
    shares
}

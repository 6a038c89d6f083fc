//! The attitude as a problem for tuning: recorded runs, their golden references, what budgets name.

use cardan_firmware::attitude::SIGN_FRAC;
use cardan_firmware::nodes::{Accumulator, NODES, Pitch, Roll, Sample, Yaw};
use cardan_golden::{Angles, rotation_angle, set_1_matrix};
use cardan_spec::nodes::SHARED;
use cardan_spec::{ThirdTilt, flags};
use cardan_tune::{Case, Combined, Problem, Quantity};
use cardan_units::{AdcCode, HalfTurns};

use super::{AttitudeDatapath, golden, words_of};
use crate::app::{Feed, RecordedRun};
use crate::engine::{Engine, Sink, SinkError, Truth};

/// Yaw, pitch and roll as nodes.
const OUTPUTS: [(&str, usize); 3] = [
    ("yaw", index::<Yaw>()),
    ("pitch", index::<Pitch>()),
    ("roll", index::<Roll>()),
];

const fn index<N: cardan_datapath::Node>() -> usize {
    N::INDEX
}

/// Degrees per half turn.
const DEGREES: f64 = 180.0;

pub(super) fn problem(tuning: &[RecordedRun], held_out: &[RecordedRun]) -> Result<Problem, String> {
    let quantity = |(name, node): (&str, usize)| Quantity {
        name: name.to_owned(),
        node,
        scale: DEGREES,
        period: Some(2.0),
    };
    let cases = |runs: &[RecordedRun]| runs.iter().map(case).collect::<Result<Vec<_>, _>>();
    Ok(Problem {
        name: "attitude".to_owned(),
        nodes: NODES.to_vec(),
        background: vec![index::<Sample>(), index::<Accumulator>()],
        domain_flag: flags::DOMAIN,
        quantities: OUTPUTS.map(quantity).to_vec(),
        combined: vec![Combined {
            name: "attitude".to_owned(),
            error: rotation_error,
        }],
        tuning: cases(tuning)?,
        held_out: cases(held_out)?,
    })
}

/// The angle of the rotation between two attitudes, in degrees: the total error of a comparison.
pub(super) fn rotation_error(values: &[f64], references: &[f64]) -> f64 {
    let angles = |all: &[f64]| Angles {
        yaw: HalfTurns(all[0]),
        pitch: HalfTurns(all[1]),
        roll: HalfTurns(all[2]),
    };
    let (value, reference) = (angles(values), angles(references));
    if value == reference {
        return 0.0;
    }
    rotation_angle(&set_1_matrix(value), &set_1_matrix(reference)).degrees()
}

fn case(run: &RecordedRun) -> Result<Case, String> {
    let averaging = run.configuration.averaging();
    let third_tilt = run.configuration.third_tilt();
    let settled = averaging.warm_up_conversions();
    let conversions = run.conversions.get(settled..).unwrap_or_default();
    let steps: Vec<Vec<i32>> = conversions
        .chunks_exact(averaging.conversions())
        .map(|solution| {
            let last = solution.last().map_or(0, super::sign);
            let codes = solution.iter().map(|c| i32::from(c.code));
            codes.chain([i32::from(last)]).collect()
        })
        .collect();
    let words = words_of(&run.configuration);
    let datapath = AttitudeDatapath {
        words,
        averaging,
        third_tilt,
    };
    let recorded = Case::record(&run.name, &datapath, &steps);
    let mut case = recorded.map_err(|error| format!("{}: {error}", run.name))?;
    let (lowest, highest) = (AdcCode(0).bipolar(), AdcCode(1023).bipolar());
    case.ports = vec![(lowest.into(), highest.into()); case.ports.len()];
    // The comparator's sign comes last, unless the axis is measured. A device without one must not lose the
    // node that others need.
    if let Some(third) = case.ports.last_mut()
        && third_tilt != ThirdTilt::Measured
    {
        *third = (-(1 << SIGN_FRAC), 1 << SIGN_FRAC);
    }
    case.channels = averaging.channels();
    case.references = golden_angles(run)?;
    case.truths = true_angles(&run.truths, steps.len());
    for series in &case.references {
        if series.len() < steps.len() {
            return Err(format!(
                "{}: the golden model gave {} of {} solutions",
                run.name,
                series.len(),
                steps.len()
            ));
        }
    }
    Ok(case)
}

/// Keeps yaw, pitch and roll of the golden model.
struct Kept {
    shared: [usize; 3],
    values: Vec<Vec<f64>>,
}

impl Sink for Kept {
    fn real(&mut self, node: usize, value: f64, _: u64) -> Result<(), SinkError> {
        if let Some(at) = self.shared.iter().position(|&index| index == node) {
            self.values[at].push(value);
        }
        Ok(())
    }
}

fn golden_angles(run: &RecordedRun) -> Result<Vec<Vec<f64>>, String> {
    let mut engine = golden::GoldenEngine::new(&run.configuration, Feed::Codes);
    let shared = |(name, _): (&str, usize)| {
        let found = SHARED.iter().position(|node| node.name == name);
        found.unwrap_or(usize::MAX)
    };
    let mut kept = Kept {
        shared: OUTPUTS.map(shared),
        values: vec![Vec::new(); OUTPUTS.len()],
    };
    let mut feed = run.conversions.iter().copied().map(Ok);
    engine
        .run(&mut feed, &mut kept)
        .map_err(|error| error.to_string())?;
    Ok(kept.values)
}

/// Per angle, per solution; empty without any reference.
fn true_angles(truths: &[Truth], solutions: usize) -> Vec<Vec<f64>> {
    let known = |truth: &Truth| truth.values.is_some();
    if truths.len() < solutions || !truths.iter().any(known) {
        return Vec::new();
    }
    let angle = |at: usize| {
        let value = |truth: &Truth| truth.values.as_ref().map_or(f64::NAN, |angles| angles[at]);
        truths[..solutions].iter().map(value).collect()
    };
    (0..OUTPUTS.len()).map(angle).collect()
}

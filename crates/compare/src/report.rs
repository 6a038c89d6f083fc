//! The report: the document of `compare --json`, from which the other forms are made.

use cardan_outputs::{Check, StatusBit};
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::attitude::{AttitudeErrors, errors};
use crate::bits::FrameComparison;
use crate::budget::{BudgetDetail, ErrorBudget, budget};
use crate::cause;
use crate::input::{
    Assumed, Comparison, EmulatorStatistics, LinkStatistics, Reproduce, Series, TruthTolerance,
};
use crate::messages::{self, FlagCount, OutputReport};
use crate::nodes::{self, NodeReport};
use crate::reason::Reason;
use crate::verdict::{Verdict, check_chain, check_frames, check_run};

/// Everything that a comparison found. Serialised, it is the document of `compare --json`; figures
/// that are undefined are null.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    /// Pass or fail.
    pub verdict: Verdict,
    /// The application.
    pub app: String,
    /// The scenario.
    pub scenario: String,
    /// The seed.
    pub seed: u64,
    /// The session.
    pub session: String,
    /// Simulated seconds.
    pub seconds: f64,
    /// Conversions, all channels, warm-up included.
    pub samples: u64,
    /// The nodes in signal order.
    pub nodes: Vec<NodeReport>,
    /// The device's attitude against truth, over solutions without status flags.
    pub attitude: Option<AttitudeErrors>,
    /// The same over the solutions with each flag that occurred, by its name.
    #[serde(serialize_with = "as_map")]
    pub attitude_flagged: Vec<(String, AttitudeErrors)>,
    /// Size of each part of the error.
    pub error_budget: ErrorBudget,
    /// Counters of the emulator.
    pub emulator: EmulatorStatistics,
    /// Counters of the link.
    pub link: LinkStatistics,
    /// Why the verdict is fail; empty on pass.
    pub reasons: Vec<Reason>,
    /// Solutions.
    pub solutions: u64,
    /// Solutions without status flags.
    pub unflagged_solutions: u64,
    /// Solutions per status flag.
    pub flags: Vec<FlagCount>,
    /// What the device sends, against golden.
    pub outputs: Vec<OutputReport>,
    /// The stages' own checks.
    pub checks: Vec<Check>,
    /// Frames, native against emulated.
    pub frames: FrameComparison,
    /// The device's attitude against golden on the same codes, without status flags.
    pub attitude_vs_golden: Option<AttitudeErrors>,
    /// The error budget per angle.
    pub error_budget_detail: BudgetDetail,
    /// False for an image without taps, which is compared by its frames alone.
    pub taps: bool,
    /// What the checkout's firmware sources say of the image, where it was made of others.
    pub stale: Option<String>,
    /// The limits by which truth, stages and flagged share were judged.
    pub limits: Limits,
    /// Parameters that are assumed.
    pub assumed: Vec<Assumed>,
    /// How to run it again.
    pub reproduce: Reproduce,
}

/// Limits of truth, stages and flagged share; null where none is set.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Limits {
    /// Of the rotation from the truth.
    pub truth: Option<TruthTolerance>,
    /// Of the rms rotation of parts of the error budget, in degrees.
    #[serde(serialize_with = "as_map")]
    pub stages_deg: Vec<(String, f64)>,
    /// Of the share of solutions with status bits.
    pub most_flagged: Option<f64>,
    /// By which factor those of the scenario are wider than it states, since the run is shorter.
    pub widening: f64,
}

impl Limits {
    fn of(comparison: &Comparison) -> Self {
        let stages = comparison.stage_limits.iter();
        Self {
            truth: comparison.truth_tolerance,
            stages_deg: stages
                .map(|(name, limit)| (name.clone(), limit.most))
                .collect(),
            most_flagged: comparison.most_flagged.as_ref().map(|limit| limit.most),
            widening: comparison.widening,
        }
    }
}

/// Compares the participants and judges.
#[must_use]
pub fn compare(comparison: &Comparison) -> Report {
    let flags = &comparison.flags;
    let attitudes = &comparison.attitudes;
    let unflagged = |solution: usize| flags.get(solution) == Some(&0);
    let (mut reasons, mut unjudged) = (Vec::new(), Vec::new());

    check_chain(comparison, &mut reasons);
    let frames = FrameComparison::of(&comparison.frames.native, &comparison.frames.emulated);
    messages::check_readable(comparison, &frames, &mut reasons);
    let either = messages::either_status(comparison);
    let golden_flags = messages::golden_status(comparison);
    let mut failures = Vec::new();
    let nodes: Vec<NodeReport> = comparison
        .nodes
        .iter()
        .map(|node| {
            let mut own = Vec::new();
            let report = nodes::report(node, &either, &golden_flags, &mut own, &mut unjudged);
            failures.push(own);
            report
        })
        .collect();
    reasons.extend(cause::in_order(&comparison.nodes, &nodes, failures));
    check_frames(&frames, &mut reasons);
    let outputs = messages::judge(comparison, &mut reasons);
    let flag_counts = messages::count_flags(comparison, &mut reasons);
    reasons.append(&mut unjudged);
    let device = attitudes.device();
    let attitude = against(device, &attitudes.truth, unflagged);
    let attitude_vs_golden = against(device, &attitudes.codes, unflagged);
    let (error_budget, error_budget_detail) = budget(attitudes, &unflagged);
    check_run(
        comparison,
        attitude.as_ref(),
        attitude_vs_golden.as_ref(),
        (&error_budget, &error_budget_detail),
        &mut reasons,
    );

    cause::add_unjudged_overflows(&comparison.nodes, &nodes, &mut reasons);
    cause::put_stale_first(comparison, &mut reasons);
    let run = &comparison.run;
    Report {
        verdict: if reasons.is_empty() {
            Verdict::Pass
        } else {
            Verdict::Fail
        },
        app: run.app.clone(),
        scenario: run.scenario.clone(),
        seed: run.seed,
        session: run.session.clone(),
        seconds: run.seconds,
        samples: run.samples,
        taps: nodes.iter().any(|node| node.native_vs_emulated.is_some()),
        nodes,
        attitude,
        attitude_flagged: flagged(device, comparison),
        error_budget,
        emulator: comparison.emulator.clone(),
        link: comparison.link.clone(),
        reasons,
        solutions: flags.len() as u64,
        unflagged_solutions: flags.iter().filter(|&&word| word == 0).count() as u64,
        flags: flag_counts,
        outputs,
        checks: comparison.checks.clone(),
        frames,
        attitude_vs_golden,
        error_budget_detail,
        stale: comparison.stale.clone(),
        limits: Limits::of(comparison),
        assumed: comparison.assumed.clone(),
        reproduce: comparison.reproduce.clone(),
    }
}

fn against(
    device: &Series,
    reference: &Series,
    counts: impl Fn(usize) -> bool,
) -> Option<AttitudeErrors> {
    let known = |series: &Series| series.0.iter().any(Option::is_some);
    (known(device) && known(reference)).then(|| errors(device, reference, counts))
}

/// Errors against truth per status bit that occurred, over the solutions that carry it.
fn flagged(device: &Series, comparison: &Comparison) -> Vec<(String, AttitudeErrors)> {
    let truth = &comparison.attitudes.truth;
    let is_set = |bit: &StatusBit, solution: usize| {
        let word = comparison.flags.get(solution);
        word.is_some_and(|&word| u32::from(word) & bit.mask != 0)
    };
    let occurred = |bit: &&StatusBit| (0..comparison.flags.len()).any(|at| is_set(bit, at));
    comparison
        .outputs
        .status
        .iter()
        .filter(occurred)
        .filter_map(|bit| {
            let errors = against(device, truth, |solution| is_set(bit, solution))?;
            Some((bit.name.clone(), errors))
        })
        .collect()
}

fn as_map<T: Serialize, S: Serializer>(
    entries: &[(String, T)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(entries.len()))?;
    for (name, errors) in entries {
        map.serialize_entry(name, errors)?;
    }
    map.end()
}

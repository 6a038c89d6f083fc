//! The report: the document of `compare --json`, from which the other forms are made.

use cardan_spec::flags::NAMES;
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::attitude::{AttitudeErrors, errors};
use crate::bits::FrameComparison;
use crate::budget::{BudgetDetail, ErrorBudget, budget};
use crate::input::{Assumed, Comparison, EmulatorStatistics, LinkStatistics, Reproduce, Series};
use crate::nodes::{self, NodeReport};
use crate::verdict::{Reason, Verdict, check_run};

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
    /// Frames, native against emulated.
    pub frames: FrameComparison,
    /// The device's attitude against golden on the same codes, without status flags.
    pub attitude_vs_golden: Option<AttitudeErrors>,
    /// The error budget per angle.
    pub error_budget_detail: BudgetDetail,
    /// False for an image without taps, which is compared by its frames alone.
    pub taps: bool,
    /// Parameters that are assumed.
    pub assumed: Vec<Assumed>,
    /// How to run it again.
    pub reproduce: Reproduce,
}

/// How often a status flag was set.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FlagCount {
    /// Its name.
    pub name: String,
    /// Solutions in which native set it.
    pub native: u64,
    /// Solutions in which golden set it; `None` when golden's flags are not known.
    pub golden: Option<u64>,
    /// Solutions in which the two differ.
    pub differ: Option<u64>,
}

/// Compares the participants and judges.
#[must_use]
pub fn compare(comparison: &Comparison) -> Report {
    let flags = &comparison.flags;
    let attitudes = &comparison.attitudes;
    let unflagged = |solution: usize| flags.get(solution) == Some(&0);
    let mut reasons = Vec::new();

    let nodes: Vec<NodeReport> = comparison
        .nodes
        .iter()
        .map(|node| nodes::report(node, flags, &mut reasons))
        .collect();
    let frames = FrameComparison::of(&comparison.frames.native, &comparison.frames.emulated);
    let device = attitudes.device();
    let attitude = against(device, &attitudes.truth, unflagged);
    let (error_budget, error_budget_detail) = budget(attitudes, &unflagged);
    check_run(
        comparison,
        &frames,
        attitude.as_ref(),
        error_budget_detail.closure_deg,
        &mut reasons,
    );

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
        flags: count_flags(comparison),
        frames,
        attitude_vs_golden: against(device, &attitudes.codes, unflagged),
        error_budget_detail,
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

/// Errors against truth per flag that occurred, over the solutions that carry it.
fn flagged(device: &Series, comparison: &Comparison) -> Vec<(String, AttitudeErrors)> {
    let truth = &comparison.attitudes.truth;
    NAMES
        .iter()
        .filter(|(bit, _)| comparison.flags.iter().any(|word| word & bit != 0))
        .filter_map(|&(bit, name)| {
            let set = |solution: usize| {
                comparison
                    .flags
                    .get(solution)
                    .is_some_and(|word| word & bit != 0)
            };
            Some((name.to_owned(), against(device, truth, set)?))
        })
        .collect()
}

fn count_flags(comparison: &Comparison) -> Vec<FlagCount> {
    let (native, golden) = (&comparison.flags, &comparison.golden_flags);
    let count = |words: &[u16], bit: u16| words.iter().filter(|&&word| word & bit != 0).count();
    NAMES
        .iter()
        .map(|&(bit, name)| FlagCount {
            name: name.to_owned(),
            native: count(native, bit) as u64,
            golden: (!golden.is_empty()).then(|| count(golden, bit) as u64),
            differ: (!golden.is_empty()).then(|| {
                let pairs = native.iter().zip(golden);
                pairs
                    .filter(|(left, right)| (*left ^ *right) & bit != 0)
                    .count() as u64
            }),
        })
        .collect()
}

fn as_map<S: Serializer>(
    entries: &[(String, AttitudeErrors)],
    serializer: S,
) -> Result<S::Ok, S::Error> {
    let mut map = serializer.serialize_map(Some(entries.len()))?;
    for (name, errors) in entries {
        map.serialize_entry(name, errors)?;
    }
    map.end()
}

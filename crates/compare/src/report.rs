//! The report: the document of `compare --json`, from which the other forms are made.

use cardan_outputs::{Check, Group};
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::bits::FrameComparison;
use crate::chain::{BudgetDetail, ErrorBudget, GroupErrors};
use crate::input::{
    Assumed, Comparison, EmulatorStatistics, LinkStatistics, Reproduce, TruthTolerance,
};
use crate::messages::{FlagCount, OutputReport};
use crate::nodes::NodeReport;
use crate::reason::Reason;
use crate::spread::keyed;
use crate::verdict::Verdict;

/// The key of the reference application's group, which every document has.
const ALWAYS: &str = "attitude";

/// Everything that a comparison found. Serialised, it is the document of `compare --json`; figures
/// that are undefined are null. The errors of the group stand under its key: `attitude`, `attitude_flagged`
/// and `attitude_vs_golden`, say.
#[derive(Clone, Debug)]
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
    /// The quantities whose error is followed.
    pub group: Group,
    /// The device's values against truth, over solutions without status flags.
    pub truth: Option<GroupErrors>,
    /// The same over the solutions with each flag that occurred, by its name.
    pub flagged: Vec<(String, GroupErrors)>,
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
    /// The device's values against golden on the same inputs, without status flags.
    pub golden: Option<GroupErrors>,
    /// The error budget per member.
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
#[derive(Clone, Debug, Default)]
pub struct Limits {
    /// Of the whole group's error against truth.
    pub truth: Option<TruthTolerance>,
    /// Of the rms of parts of the error budget, in the group's unit.
    pub stages: Vec<(String, f64)>,
    /// Of the share of solutions with status bits.
    pub most_flagged: Option<f64>,
    /// By which factor those of the scenario are wider than it states, since the run is shorter.
    pub widening: f64,
}

impl Limits {
    pub(crate) fn of(comparison: &Comparison) -> Self {
        let stages = comparison.stage_limits.iter();
        Self {
            truth: comparison.truth_tolerance,
            stages: stages
                .map(|(name, limit)| (name.clone(), limit.most))
                .collect(),
            most_flagged: comparison.most_flagged.as_ref().map(|limit| limit.most),
            widening: comparison.widening,
        }
    }
}

impl Serialize for Report {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let key = &self.group.key;
        let is_other = key != ALWAYS;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("verdict", &self.verdict)?;
        map.serialize_entry("app", &self.app)?;
        map.serialize_entry("scenario", &self.scenario)?;
        map.serialize_entry("seed", &self.seed)?;
        map.serialize_entry("session", &self.session)?;
        map.serialize_entry("seconds", &self.seconds)?;
        map.serialize_entry("samples", &self.samples)?;
        map.serialize_entry("nodes", &self.nodes)?;
        if is_other {
            map.serialize_entry(ALWAYS, &None::<()>)?;
        }
        // The outputs of a product have a key of their own, by which they stand below.
        if key != "outputs" {
            map.serialize_entry(key, &self.truth)?;
            map.serialize_entry(&format!("{key}_flagged"), &Map(&self.flagged))?;
        }
        map.serialize_entry("error_budget", &self.error_budget)?;
        map.serialize_entry("emulator", &self.emulator)?;
        map.serialize_entry("link", &self.link)?;
        map.serialize_entry("reasons", &self.reasons)?;
        map.serialize_entry("solutions", &self.solutions)?;
        map.serialize_entry("unflagged_solutions", &self.unflagged_solutions)?;
        map.serialize_entry("flags", &self.flags)?;
        map.serialize_entry("outputs", &self.outputs)?;
        map.serialize_entry("checks", &self.checks)?;
        map.serialize_entry("frames", &self.frames)?;
        if key != "outputs" {
            map.serialize_entry(&format!("{key}_vs_golden"), &self.golden)?;
        }
        map.serialize_entry("error_budget_detail", &self.error_budget_detail)?;
        map.serialize_entry("taps", &self.taps)?;
        map.serialize_entry("stale", &self.stale)?;
        map.serialize_entry(
            "limits",
            &KeyedLimits(&self.limits, &self.group.unit.suffix),
        )?;
        map.serialize_entry("assumed", &self.assumed)?;
        map.serialize_entry("reproduce", &self.reproduce)?;
        map.end()
    }
}

/// Limits whose keys carry their unit.
struct KeyedLimits<'a>(&'a Limits, &'a str);

impl Serialize for KeyedLimits<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self(limits, suffix) = self;
        let truth = limits.truth.map(|truth| {
            vec![
                (keyed("rms", suffix), truth.rms),
                (keyed("p99", suffix), truth.p99),
                (keyed("max", suffix), truth.max),
            ]
        });
        let mut map = serializer.serialize_map(Some(4))?;
        map.serialize_entry("truth", &truth.as_deref().map(Map))?;
        map.serialize_entry(&keyed("stages", suffix), &Map(&limits.stages))?;
        map.serialize_entry("most_flagged", &limits.most_flagged)?;
        map.serialize_entry("widening", &limits.widening)?;
        map.end()
    }
}

/// Entries in their order, as an object.
struct Map<'a, T>(&'a [(String, T)]);

impl<T: Serialize> Serialize for Map<'_, T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, value) in self.0 {
            map.serialize_entry(name, value)?;
        }
        map.end()
    }
}

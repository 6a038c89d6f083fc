//! The chain from truth to device, stage by stage: errors of the group against truth and golden, and the
//! error budget.
//!
//! Each part of the budget is the step from one stage to the next, so that per member and solution the
//! parts sum to the whole error (the short way round where there is a period); that they do is checked. The
//! size of a part is the combined error between its ends; sizes do not add. What does add is each part's
//! share of the whole's mean square, the covariance of part and whole over it.

use cardan_outputs::{Group, Is};
use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};

use crate::metrics::larger;
use crate::series::{Chain, Series};
use crate::spread::{Errors, Figures, Keyed, Spread, keyed};

/// Errors of a group: per member, and of all together.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GroupErrors {
    /// What the keys of figures end in.
    pub suffix: String,
    /// By name, in the order of the members.
    pub members: Vec<(String, Spread)>,
    /// The combined error, where the group has one.
    pub combined: Option<(String, Spread)>,
}

impl GroupErrors {
    /// Of the whole group: the combined error, or that of the only member.
    #[must_use]
    pub fn whole(&self) -> Option<&Spread> {
        match (&self.combined, self.members.as_slice()) {
            (Some((_, spread)), _) => Some(spread),
            (None, [(_, only)]) => Some(only),
            (None, _) => None,
        }
    }

    /// Every member, and what is combined of them last.
    pub fn all(&self) -> impl Iterator<Item = (&str, &Spread)> {
        let named = self.members.iter().chain(&self.combined);
        named.map(|(name, spread)| (name.as_str(), spread))
    }

    /// That of this name.
    #[must_use]
    pub fn named(&self, name: &str) -> Option<&Spread> {
        self.all()
            .find(|(known, _)| *known == name)
            .map(|(_, spread)| spread)
    }
}

impl Serialize for GroupErrors {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for (name, spread) in self.all() {
            map.serialize_entry(name, &Keyed(spread, &self.suffix, Figures::Sizes))?;
        }
        map.end()
    }
}

/// Root mean square of each part, over solutions without status flags: of its combined error, or of the only
/// member. In signal order; `None` for parts whose ends the run lacks, and where several members have no
/// combined error.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ErrorBudget(pub Vec<(String, Option<f64>)>);

impl ErrorBudget {
    /// The size of a part.
    #[must_use]
    pub fn part(&self, name: &str) -> Option<f64> {
        self.0.iter().find(|(part, _)| part == name)?.1
    }
}

impl Serialize for ErrorBudget {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for (name, size) in &self.0 {
            map.serialize_entry(name, &size.filter(|size| size.is_finite()))?;
        }
        map.end()
    }
}

/// The budget per member.
#[derive(Clone, Debug, Default)]
pub struct BudgetDetail {
    /// What the keys of figures end in.
    pub suffix: String,
    /// The parts in signal order.
    pub parts: Vec<PartDetail>,
    /// What the whole chain errs by, device less truth.
    pub whole: Option<PartDetail>,
    /// Largest difference between the sum of the parts and the whole, over all members and all solutions that
    /// every part knows; `None` when there is none.
    pub closure: Option<f64>,
    /// Solutions over which the closure was checked.
    pub closure_samples: u64,
    /// Each node's share of the rounding, in signal order; empty when the caller gave no steps.
    pub rounding_shares: Vec<RoundingShare>,
}

/// One part of the budget.
#[derive(Clone, Debug, Default)]
pub struct PartDetail {
    /// Name, as in [`ErrorBudget`].
    pub part: String,
    /// The same as a title.
    pub title: String,
    /// What it is.
    pub remark: String,
    /// By member, in their order.
    pub members: Vec<(String, Spread)>,
    /// What the combined error is, and its size, where the group has one.
    pub combined: Option<(String, Spread)>,
    /// Share of the whole's mean square over all members, over the solutions that every part knows: the shares
    /// of all parts add to 1. `None` where the whole is not known.
    pub share: Option<f64>,
}

impl PartDetail {
    /// The size of the part: of the combined error, or of the only member.
    #[must_use]
    pub fn size(&self) -> Option<&Spread> {
        match (&self.combined, self.members.as_slice()) {
            (Some((_, spread)), _) => Some(spread),
            (None, [(_, only)]) => Some(only),
            (None, _) => None,
        }
    }
}

/// A node's share of the rounding.
#[derive(Clone, Debug, Default)]
pub struct RoundingShare {
    /// The node; `(rest)` for what the given steps do not explain.
    pub node: String,
    /// The size of what it adds.
    pub size: Spread,
}

struct PartKeyed<'a>(&'a PartDetail, &'a str);

impl Serialize for PartKeyed<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Self(part, suffix) = self;
        let mut map = serializer.serialize_map(None)?;
        map.serialize_entry("part", &part.part)?;
        for (name, spread) in &part.members {
            map.serialize_entry(name, &Keyed(spread, suffix, Figures::Signed))?;
        }
        if let Some((what, spread)) = &part.combined {
            map.serialize_entry(what, &Keyed(spread, suffix, Figures::Sizes))?;
        }
        map.serialize_entry("share", &part.share)?;
        map.end()
    }
}

impl Serialize for BudgetDetail {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let suffix = self.suffix.as_str();
        let parts: Vec<PartKeyed<'_>> = self
            .parts
            .iter()
            .map(|part| PartKeyed(part, suffix))
            .collect();
        let whole = self.whole.as_ref().map(|part| PartKeyed(part, suffix));
        let shares: Vec<serde_share::Share<'_>> = (self.rounding_shares.iter())
            .map(|share| serde_share::Share(share, suffix))
            .collect();
        let mut map = serializer.serialize_map(Some(5))?;
        map.serialize_entry("parts", &parts)?;
        map.serialize_entry("whole", &whole)?;
        let closure = self.closure.filter(|open| open.is_finite());
        map.serialize_entry(&keyed("closure", suffix), &closure)?;
        map.serialize_entry("closure_samples", &self.closure_samples)?;
        map.serialize_entry("rounding_shares", &shares)?;
        map.end()
    }
}

mod serde_share {
    use super::{RoundingShare, SerializeMap, Serializer, keyed};
    use serde::Serialize;

    pub(super) struct Share<'a>(pub(super) &'a RoundingShare, pub(super) &'a str);

    impl Serialize for Share<'_> {
        fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
            let Self(share, suffix) = self;
            let mut map = serializer.serialize_map(Some(3))?;
            map.serialize_entry("node", &share.node)?;
            map.serialize_entry(&keyed("rms", suffix), &share.size.rms)?;
            map.serialize_entry(&keyed("max", suffix), &share.size.max)?;
            map.end()
        }
    }
}

/// Errors between two series.
#[derive(Clone, Debug)]
struct Between {
    members: Vec<Errors>,
    whole: Errors,
}

impl Between {
    fn new(group: &Group) -> Self {
        Self {
            members: vec![Errors::with_percentile(); group.members.len()],
            whole: Errors::with_percentile(),
        }
    }

    /// Without percentiles, which take memory.
    fn small(group: &Group) -> Self {
        Self {
            members: vec![Errors::default(); group.members.len()],
            whole: Errors::default(),
        }
    }

    fn add(&mut self, group: &Group, values: &[f64], references: &[f64]) {
        for (at, (member, errors)) in group.members.iter().zip(&mut self.members).enumerate() {
            errors.add(member.difference(values[at], references[at]));
        }
        if let Some(combined) = &group.combined {
            self.whole.add((combined.error)(values, references));
        }
    }

    fn members(&self, group: &Group) -> Vec<(String, Spread)> {
        let named = group.members.iter().zip(&self.members);
        named
            .map(|(member, errors)| (member.name.clone(), errors.spread()))
            .collect()
    }

    fn errors(&self, group: &Group) -> GroupErrors {
        GroupErrors {
            suffix: group.unit.suffix.to_string(),
            members: self.members(group),
            combined: (group.combined.as_ref())
                .map(|combined| (combined.name.clone(), self.whole.spread())),
        }
    }

    fn part(&self, group: &Group, part: &str, title: &str, remark: &str) -> PartDetail {
        PartDetail {
            part: part.to_owned(),
            title: title.to_owned(),
            remark: remark.to_owned(),
            members: self.members(group),
            combined: (group.combined.as_ref())
                .map(|combined| (combined.what.clone(), self.whole.spread())),
            share: None,
        }
    }
}

/// Looks at one window of solutions after another.
#[derive(Debug)]
pub(crate) struct ChainJudge {
    group: Group,
    /// From stage to stage: one less than there are stages.
    parts: Vec<Between>,
    /// Sum over members and solutions of part times whole, for the shares.
    products: Vec<f64>,
    whole: Between,
    whole_square: f64,
    device_truth: Between,
    device_golden: Between,
    /// By status bit, in the order of the outputs.
    flagged: Vec<Between>,
    steps: Vec<Between>,
    closure: f64,
    closed: u64,
    /// Solutions that each stage had.
    lengths: Vec<usize>,
    step_lengths: Vec<usize>,
    /// Whether any solution of the device, of the truth, of golden was known.
    seen: [bool; 3],
}

/// What of a solution decides where it counts.
#[derive(Clone, Copy)]
pub(crate) struct Counts<'a> {
    /// Whether it has no status bit.
    pub(crate) is_clean: bool,
    /// Status bits that it has, in the order of the outputs.
    pub(crate) bits: &'a [bool],
}

impl ChainJudge {
    pub(crate) fn new(group: &Group, chain: &Chain, bits: usize) -> Self {
        let between = || Between::new(group);
        let parts = chain.stages.len().saturating_sub(1);
        let steps = if chain.steps.is_empty() {
            0
        } else {
            chain.steps.len() + 1
        };
        Self {
            parts: vec![between(); parts],
            products: vec![0.0; parts],
            whole: between(),
            whole_square: 0.0,
            device_truth: between(),
            device_golden: between(),
            flagged: vec![between(); bits],
            steps: vec![Between::small(group); steps],
            closure: 0.0,
            closed: 0,
            lengths: vec![0; chain.stages.len()],
            step_lengths: vec![0; chain.steps.len()],
            seen: [false; 3],
            group: group.clone(),
        }
    }

    /// Counts the solutions of a window.
    pub(crate) fn lengths(&mut self, chain: &Chain) {
        for (length, stage) in self.lengths.iter_mut().zip(&chain.stages) {
            *length += stage.values.len();
        }
        for (length, step) in self.step_lengths.iter_mut().zip(&chain.steps) {
            *length += step.values.len();
        }
    }

    /// Adds a solution of a window.
    pub(crate) fn add(&mut self, chain: &Chain, solution: usize, counts: Counts<'_>) {
        let at = |is: Is| chain.values(is).and_then(|values| values.at(solution));
        let device = self.device(chain).and_then(|found| found.at(solution));
        let (truth, golden) = (at(Is::Truth), at(Is::Golden));
        for (seen, values) in self.seen.iter_mut().zip([device, truth, golden]) {
            *seen |= values.is_some();
        }
        if let (Some(truth), Some(device)) = (truth, device) {
            for (found, set) in self.flagged.iter_mut().zip(counts.bits) {
                if *set {
                    found.add(&self.group, device, truth);
                }
            }
        }
        if !counts.is_clean {
            return;
        }
        if let (Some(truth), Some(device)) = (truth, device) {
            self.device_truth.add(&self.group, device, truth);
        }
        if let (Some(golden), Some(device)) = (golden, device) {
            self.device_golden.add(&self.group, device, golden);
        }
        let stages: Vec<Option<&[f64]>> = (chain.stages.iter())
            .map(|stage| stage.values.at(solution))
            .collect();
        for (part, ends) in self.parts.iter_mut().zip(stages.windows(2)) {
            if let [Some(from), Some(to)] = ends {
                part.add(&self.group, to, from);
            }
        }
        if let (Some(Some(first)), Some(Some(last))) = (stages.first(), stages.last()) {
            self.whole.add(&self.group, last, first);
        }
        self.close(&stages);
        self.add_steps(chain, solution);
    }

    /// Whether the parts of a solution add up, and what each adds to the whole's square.
    fn close(&mut self, stages: &[Option<&[f64]>]) {
        let Some(stages) = stages.iter().copied().collect::<Option<Vec<&[f64]>>>() else {
            return;
        };
        let (Some(first), Some(last)) = (stages.first(), stages.last()) else {
            return;
        };
        self.closed += 1;
        for (at, member) in self.group.members.iter().enumerate() {
            let whole = member.difference(last[at], first[at]);
            let part = |ends: &[&[f64]]| member.difference(ends[1][at], ends[0][at]);
            let sum: f64 = stages.windows(2).map(part).sum();
            for (product, ends) in self.products.iter_mut().zip(stages.windows(2)) {
                // Parts that are together longer than half a period go another way round than the whole.
                *product += part(ends) * sum;
            }
            self.whole_square += sum * sum;
            let open = member
                .difference(sum / member.scale, whole / member.scale)
                .abs();
            self.closure = larger(self.closure, open);
        }
    }

    /// The steps between the real interpretation and native, and what they leave.
    fn add_steps(&mut self, chain: &Chain, solution: usize) {
        if self.steps.is_empty() {
            return;
        }
        let at = |series: Option<&Series>| {
            series.and_then(|series| series.at(solution).map(<[f64]>::to_vec))
        };
        let mut from = at(chain.values(Is::Real));
        let last = std::iter::once(chain.values(Is::Native));
        let ends = chain
            .steps
            .iter()
            .map(|step| Some(&step.values))
            .chain(last);
        for (errors, to) in self.steps.iter_mut().zip(ends) {
            let to = at(to);
            if let (Some(from), Some(to)) = (&from, &to) {
                errors.add(&self.group, to, from);
            }
            from = to;
        }
    }

    /// What each series is of, its name, and how many solutions it had.
    pub(crate) fn all_lengths(&self, chain: &Chain) -> Vec<(String, String, usize)> {
        let stages = chain.stages.iter().zip(&self.lengths);
        let stages = stages.map(|(stage, &length)| {
            (
                "values along the chain".to_owned(),
                stage.stage.name.to_string(),
                length,
            )
        });
        let steps = chain.steps.iter().zip(&self.step_lengths);
        let steps = steps.map(|(step, &length)| {
            (
                format!("values with the rounding of {}", step.node),
                "step".to_owned(),
                length,
            )
        });
        stages.chain(steps).collect()
    }

    /// Whether the run has values of a stage.
    fn has(&self, place: usize) -> bool {
        self.lengths.get(place).is_some_and(|&length| length > 0)
    }

    /// The device against the truth; none where either is not known at all.
    pub(crate) fn against_truth(&self) -> Option<GroupErrors> {
        let is_known = self.seen[0] && self.seen[1];
        is_known.then(|| self.device_truth.errors(&self.group))
    }

    /// The device against golden on the same inputs.
    pub(crate) fn against_golden(&self) -> Option<GroupErrors> {
        let is_known = self.seen[0] && self.seen[2];
        is_known.then(|| self.device_golden.errors(&self.group))
    }

    /// Errors against truth per status bit, over the solutions that carry it.
    pub(crate) fn flagged(&self, at: usize) -> Option<GroupErrors> {
        let found = self.flagged.get(at)?;
        let is_known = self.seen[0] && self.seen[1];
        is_known.then(|| found.errors(&self.group))
    }

    /// What the device says: the emulated values, or native's where the run has none.
    pub(crate) fn device<'a>(&self, chain: &'a Chain) -> Option<&'a Series> {
        let emulated = chain.place(Is::Emulated).filter(|&place| self.has(place));
        let place = emulated.or_else(|| chain.place(Is::Native))?;
        Some(&chain.stages[place].values)
    }

    pub(crate) fn budget(&self, chain: &Chain) -> (ErrorBudget, BudgetDetail) {
        let (mut sizes, mut parts) = (Vec::new(), Vec::new());
        for (at, found) in self.parts.iter().enumerate() {
            let stage = &chain.stages[at + 1].stage;
            let exists = self.has(at) && self.has(at + 1);
            let mut part = found.part(&self.group, &stage.part, &stage.title, &stage.remark);
            part.share = (self.whole_square > 0.0).then(|| self.products[at] / self.whole_square);
            let size = part.size().and_then(|size| size.rms);
            sizes.push((stage.part.to_string(), size.filter(|_| exists)));
            if exists {
                parts.push(part);
            }
        }
        let last = chain.stages.len().saturating_sub(1);
        let whole = (last > 0 && self.has(0) && self.has(last)).then(|| {
            self.whole
                .part(&self.group, "whole", "Whole", "device against truth")
        });
        let detail = BudgetDetail {
            suffix: self.group.unit.suffix.to_string(),
            parts,
            whole,
            closure: (self.closed > 0).then_some(self.closure),
            closure_samples: self.closed,
            rounding_shares: self.shares(chain),
        };
        (ErrorBudget(sizes), detail)
    }

    fn shares(&self, chain: &Chain) -> Vec<RoundingShare> {
        let names = chain
            .steps
            .iter()
            .map(|step| step.node.as_str())
            .chain(["(rest)"]);
        let is_whole = self.group.combined.is_some();
        let shares = self
            .steps
            .iter()
            .zip(names)
            .map(|(found, node)| RoundingShare {
                node: node.to_owned(),
                size: match found.members.as_slice() {
                    [only] if !is_whole => only.spread(),
                    _ => found.whole.spread(),
                },
            });
        shares.collect()
    }
}

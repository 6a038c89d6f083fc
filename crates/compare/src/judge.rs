//! The judge: looks at one window of a run after another, keeps sums and extremes, and reports at the end.
//!
//! What it keeps does not grow with the run. [`compare`] gives it a whole run as one window.

use cardan_outputs::Group;

use crate::bits::FrameBytes;
use crate::cause;
use crate::chain::{ChainJudge, Counts};
use crate::input::Comparison;
use crate::limit::{LEAST_RMS, LEAST_VALUES};
use crate::messages::{self, MessageJudge};
use crate::nodes::{Flags, NodeJudge, NodeReport, NodeStatus};
use crate::plots::Plots;
use crate::reason::Reason;
use crate::report::{Limits, Report};
use crate::verdict::{Verdict, check_chain, check_frames, check_run};

/// How many solutions a run is going to have: limits of single values grow with their number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Planned {
    /// All of them.
    pub solutions: usize,
    /// Those that are judged: without status bits, as far as that is known beforehand.
    pub judged: usize,
}

/// Judges a run window by window.
#[derive(Debug)]
pub struct Judge {
    nodes: Vec<NodeJudge>,
    frames: FrameBytes,
    messages: MessageJudge,
    group: Group,
    chain: ChainJudge,
    plots: Option<Plots>,
    solutions: usize,
}

impl Judge {
    /// For a run of which `facts` tells what does not change: its nodes with the streams that they have (empty
    /// ones), outputs, stages, limits. `with_plots` keeps what the page draws.
    #[must_use]
    pub fn new(facts: &Comparison, planned: Planned, with_plots: bool) -> Self {
        let group = facts.outputs.group.clone().unwrap_or_else(none);
        let bits = facts.outputs.status.len();
        let nodes = facts.nodes.iter();
        Self {
            nodes: nodes
                .map(|node| NodeJudge::new(node, planned.judged))
                .collect(),
            frames: FrameBytes::default(),
            messages: MessageJudge::new(facts, planned.solutions),
            chain: ChainJudge::new(&group, &facts.chain, bits),
            plots: with_plots.then(|| Plots::new(facts, &group)),
            group,
            solutions: 0,
        }
    }

    /// Looks at a window: whole solutions in every stream that has not ended, and with the last one whatever is
    /// left over.
    pub fn add(&mut self, window: &Comparison) {
        self.frames
            .add(&window.frames.native, &window.frames.emulated);
        self.messages.add(window);
        let (either, golden) = (
            messages::either_status(window),
            messages::golden_status(window),
        );
        let flags = Flags {
            either: &either,
            golden: &golden,
        };
        for (index, (judge, node)) in self.nodes.iter_mut().zip(&window.nodes).enumerate() {
            match &mut self.plots {
                Some(plots) => {
                    let mut shown = vec![f64::NAN; node.native.len()];
                    let draw = |at: usize, difference: f64| {
                        // A solution that the device flags is not drawn.
                        let is_clean = window.flags.get(node.solution_of(at)) == Some(&0);
                        shown[at] = if is_clean { difference } else { f64::NAN };
                    };
                    judge.add(node, flags, draw);
                    plots.node(index, &shown);
                }
                None => judge.add(node, flags, |_, _| {}),
            }
        }
        self.chain.lengths(&window.chain);
        let bits = &window.outputs.status;
        let mut set = vec![false; bits.len()];
        for (solution, &word) in window.flags.iter().enumerate() {
            for (set, bit) in set.iter_mut().zip(bits) {
                *set = word & bit.mask != 0;
            }
            let counts = Counts {
                is_clean: word == 0,
                bits: &set,
            };
            self.chain.add(&window.chain, solution, counts);
            if let Some(plots) = &mut self.plots {
                let device = self.chain.device(&window.chain);
                plots.solution(&self.group, &window.chain, device, solution, word == 0);
            }
        }
        self.solutions += window.flags.len();
    }

    /// The report. `facts` tells what became known by the end: checks, counters, overflows.
    #[must_use]
    pub fn finish(self, facts: &Comparison) -> (Report, Option<Plots>) {
        let (mut reasons, mut unjudged) = (Vec::new(), Vec::new());
        check_chain(facts, &mut reasons);
        let frames = self.frames.found();
        if frames.compared == 0 && frames.mismatches == 0 {
            reasons.push(Reason::NoFrames);
        }
        self.messages.check_readable(&mut reasons);
        self.check_solutions(facts, &mut reasons);
        let mut failures = Vec::new();
        let within_range = cause::within_range(&facts.nodes);
        let nodes: Vec<NodeReport> = self
            .nodes
            .iter()
            .zip(facts.nodes.iter().zip(within_range))
            .map(|(judge, (node, is_within))| {
                let mut own = Vec::new();
                let mut report = judge.report(node, self.solutions, &mut own, &mut unjudged);
                if own.is_empty() && is_within && facts.required.is_some() {
                    judge.check_flagged(&report, &mut own);
                    if !own.is_empty() {
                        report.pass = false;
                        report.status = NodeStatus::Fail;
                    }
                }
                failures.push(own);
                report
            })
            .collect();
        reasons.extend(cause::in_order(&facts.nodes, &nodes, failures));
        check_frames(&frames, &mut reasons);
        let truth = self.chain.against_truth();
        let outputs = self.messages.judge(facts, truth.as_ref(), &mut reasons);
        let flags = self.messages.count_flags(facts, &mut reasons);
        reasons.append(&mut unjudged);
        let golden = self.chain.against_golden();
        let (error_budget, error_budget_detail) = self.chain.budget(&facts.chain);
        self.check_lengths(facts, &mut reasons);
        let errors = [truth.as_ref(), golden.as_ref()];
        let budget = (&error_budget, &error_budget_detail);
        let unflagged = self.solutions as u64 - self.messages.flagged();
        check_run(
            facts,
            &self.group,
            errors,
            &outputs,
            budget,
            unflagged,
            &mut reasons,
        );
        self.check_limits(facts, &mut reasons);
        cause::add_unjudged_overflows(&facts.nodes, &nodes, &mut reasons);
        cause::put_stale_first(facts, &mut reasons);
        let run = &facts.run;
        let is_pass = reasons.is_empty();
        let flagged = (facts.outputs.status.iter().enumerate())
            .filter(|(at, _)| self.messages.has_occurred(*at))
            .filter_map(|(at, bit)| Some((bit.name.clone(), self.chain.flagged(at)?)));
        let report = Report {
            verdict: if is_pass {
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
            flagged: flagged.collect(),
            group: self.group,
            truth,
            golden,
            error_budget,
            emulator: facts.emulator.clone(),
            link: facts.link.clone(),
            reasons,
            solutions: self.solutions as u64,
            unflagged_solutions: unflagged,
            flags,
            outputs,
            checks: facts.checks.clone(),
            frames,
            error_budget_detail,
            stale: facts.stale.clone(),
            limits: Limits::of(facts),
            assumed: facts.assumed.clone(),
            reproduce: facts.reproduce.clone(),
        };
        (report, self.plots)
    }

    /// The device went on to the end of the run.
    fn check_solutions(&self, facts: &Comparison, reasons: &mut Vec<Reason>) {
        let found = self.messages.emulated();
        if let Some(required) = facts.required
            && found < required.solutions
        {
            reasons.push(Reason::TooFewSolutions {
                found,
                planned: required.solutions,
            });
        }
    }

    /// What rounding is expected to make of all nodes is what it makes of them, and not far more.
    fn check_limits(&self, facts: &Comparison, reasons: &mut Vec<Reason>) {
        let all = self.nodes.iter().map(NodeJudge::normalised);
        let (count, square) = all.fold((0, 0.0), |(count, square), own| {
            (count + own.0, square + own.1)
        });
        let rms = (square / count.max(1) as f64).sqrt();
        if facts.required.is_some() && count >= LEAST_VALUES && rms < LEAST_RMS {
            let least = LEAST_RMS;
            reasons.push(Reason::LimitsTooWide { rms, least });
        }
    }

    /// Every series that exists, or must, has one entry per solution.
    fn check_lengths(&self, facts: &Comparison, reasons: &mut Vec<Reason>) {
        let is_required = facts.required.is_some();
        let mut check = |what: String, name: String, length: usize| {
            if (is_required || length != 0) && length != self.solutions {
                reasons.push(Reason::LengthsDiffer {
                    what,
                    names: ["native's solutions".into(), name.into()],
                    lengths: [self.solutions, length],
                });
            }
        };
        for (what, name, length) in self.chain.all_lengths(&facts.chain) {
            check(what, name, length);
        }
        if !facts.outputs.status.is_empty() || !is_required {
            let statuses = self.messages.statuses();
            check("status flags".to_owned(), "golden".to_owned(), statuses);
        }
    }
}

/// A product of which nothing is followed along the chain.
fn none() -> Group {
    Group {
        key: "outputs".to_owned(),
        title: "Outputs".to_owned(),
        note: String::new(),
        member: "output".to_owned(),
        unit: cardan_outputs::Shown::default(),
        members: Vec::new(),
        combined: None,
    }
}

/// Compares the participants and judges.
#[must_use]
pub fn compare(comparison: &Comparison) -> Report {
    whole(comparison, false).0
}

/// The same with what the page draws.
#[must_use]
pub fn compare_with_plots(comparison: &Comparison) -> (Report, Plots) {
    let (report, plots) = whole(comparison, true);
    (report, plots.unwrap_or_default())
}

fn whole(comparison: &Comparison, with_plots: bool) -> (Report, Option<Plots>) {
    let either = messages::either_status(comparison);
    let planned = Planned {
        solutions: comparison.flags.len(),
        judged: either.iter().filter(|&&word| word == 0).count(),
    };
    let mut judge = Judge::new(comparison, planned, with_plots);
    judge.add(comparison);
    judge.finish(comparison)
}

//! From what a session publishes to the verdict: facts that hold for the whole run, then one window of
//! solutions after another.

mod limits;
mod nodes;
mod window;

use cardan_bench::app::{Checker, Configuration, Party};
use cardan_compare::{
    Assumed, Comparison, EmulatorStatistics, Judge, LinkStatistics, NOT_JUDGED, Planned, Plots,
    Report, Reproduce, Required, RoundingStep, Run, Series, TruthTolerance,
};
use cardan_scenario::{Trajectory, report};

use self::limits::{most_flagged, stage_limits, tuned_to, widened};
pub(crate) use self::nodes::operations_of;
use crate::dump;
use crate::failure::Failure;
use crate::participants::diff::{Collected, Tail};
use crate::participants::streams::Layout;
use crate::run_options::Setup;

/// Names that a result carries.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Names<'a> {
    /// The session.
    pub(crate) session: &'a str,
    /// The command that gives the same result again.
    pub(crate) command: &'a str,
}

/// What is wanted beside the verdict.
#[derive(Default)]
pub(crate) struct Wanted<'a> {
    /// A dump of the values.
    pub(crate) dump: Option<&'a dump::Plan>,
    /// What the page draws.
    pub(crate) plots: bool,
}

/// A judged session.
pub(crate) struct Outcome {
    /// The document.
    pub(crate) report: Report,
    /// What it was made from, without the values.
    pub(crate) facts: Comparison,
    /// What the page draws, where it was wanted.
    pub(crate) plots: Option<Plots>,
    /// The values, ready to be put in their place.
    pub(crate) dump: Option<dump::Writer>,
    /// How the emulated program crashed.
    pub(crate) crash: Option<String>,
}

/// Judges a session window by window.
pub(crate) struct Session<'a> {
    setup: &'a Setup,
    configuration: Configuration,
    facts: Comparison,
    /// By node of the facts: its index among the application's.
    indices: Vec<usize>,
    /// The same among golden's.
    golden: Vec<Option<usize>>,
    judge: Judge,
    checker: Box<dyn Checker>,
    dump: Option<dump::Writer>,
    /// Sum of the times from output instants to the ends of their frames, in seconds, and their number.
    latency_s: (f64, u64),
}

/// By what windows of the session are cut.
pub(crate) fn layout(
    setup: &Setup,
    configuration: &Configuration,
    (timed, signals): (Vec<usize>, bool),
) -> Result<Layout, Failure> {
    let app = setup.app;
    let per_solution = app
        .values_per_solution(configuration)
        .map_err(Failure::input)?;
    let golden_nodes = app.golden_nodes();
    let golden_per_solution = golden_nodes
        .iter()
        .map(|&node| per_solution.get(node).copied().unwrap_or(0));
    let places = |party| {
        app.models(configuration, party)
            .into_iter()
            .map(|(stage, _)| stage)
    };
    // The truth is the first stage, and the emulated participant's.
    let emulated = std::iter::once(0).chain(places(Party::Emulated)).collect();
    let steps = if configuration.shares {
        app.nodes().len()
    } else {
        0
    };
    let first_step = app.stages().len();
    let group = app.outputs(configuration).group;
    Ok(Layout {
        golden_per_solution: golden_per_solution.collect(),
        per_solution,
        taps: setup.firmware.taps.is_some(),
        stages: [
            emulated,
            places(Party::Golden).collect(),
            (first_step..first_step + steps).collect(),
        ],
        members: group.map_or(0, |group| group.members.len()),
        timed,
        signals,
    })
}

impl<'a> Session<'a> {
    pub(crate) fn new(
        setup: &'a Setup,
        configuration: &Configuration,
        names: Names<'_>,
        wanted: &Wanted<'_>,
    ) -> Result<Self, Failure> {
        let app = setup.app;
        let (nodes, indices) = nodes::facts(setup, configuration)?;
        let golden_nodes = app.golden_nodes();
        let golden = |index: &usize| golden_nodes.iter().position(|node| node == index);
        let outputs = app.outputs(configuration);
        let width = outputs
            .group
            .as_ref()
            .map_or(0, |group| group.members.len());
        let mut chain = cardan_compare::Chain::new(app.stages(), width);
        if configuration.shares {
            let step = |node: &cardan_datapath::NodeInfo| RoundingStep {
                node: node.name.to_owned(),
                values: Series::new(width),
            };
            chain.steps = app.nodes().iter().map(step).collect();
        }
        let widened = widened(setup);
        let facts = Comparison {
            run: Run {
                app: app.name().to_owned(),
                scenario: setup.scenario.name.clone(),
                seed: setup.seed,
                session: names.session.to_owned(),
                solution_seconds: app.solution_seconds(configuration),
                ..Run::default()
            },
            nodes,
            outputs,
            chain,
            stale: setup.stale.clone(),
            stage_limits: stage_limits(&widened),
            most_flagged: most_flagged(&widened),
            tuned: setup.tuned.as_ref().map(tuned_to),
            truth_tolerance: truth_tolerance(&widened.truth),
            widening: setup.scenario.widening(setup.seconds),
            assumed: assumed(setup)?,
            reproduce: Reproduce {
                command: names.command.to_owned(),
                provenance: Vec::new(),
            },
            required: Some(Required {
                solutions: configuration.solutions,
            }),
            ..Comparison::default()
        };
        let solutions = usize::try_from(configuration.solutions).unwrap_or(usize::MAX);
        let planned = Planned {
            solutions,
            judged: solutions,
        };
        let mut scenario = setup.scenario.clone();
        scenario.tolerance = widened;
        let checker = app
            .checker(&scenario, configuration)
            .map_err(Failure::input)?;
        let dump = wanted
            .dump
            .map(|plan| plan.begin(app, &facts))
            .transpose()?;
        Ok(Self {
            setup,
            configuration: configuration.clone(),
            golden: indices.iter().map(golden).collect(),
            judge: Judge::new(&facts, planned, wanted.plots),
            indices,
            checker,
            dump,
            latency_s: (0.0, 0),
            facts,
        })
    }

    /// By what windows are cut.
    pub(crate) fn layout(&self) -> Result<Layout, Failure> {
        let timed = self
            .dump
            .as_ref()
            .map(dump::Writer::timed)
            .unwrap_or_default();
        layout(self.setup, &self.configuration, timed)
    }

    /// The next window.
    pub(crate) fn add(&mut self, collected: &Collected) -> Result<(), Failure> {
        self.facts.run.samples += collected.conversions.len() as u64;
        if self.facts.emulator.first_conversion_cycle.is_none() {
            let first = collected.conversions.first();
            self.facts.emulator.first_conversion_cycle = first.map(|first| first.cycle);
        }
        for conversion in &collected.conversions {
            self.checker.conversion(conversion);
        }
        for instant in &collected.instants {
            self.checker.instant(instant.time_s, instant.cycle);
        }
        let messages = collected.emulated_frames.iter();
        for (bytes, &cycle) in messages.zip(&collected.emulated_frame_cycles) {
            self.checker.message(bytes, cycle);
        }
        let ends = collected.emulated_frame_cycles.iter();
        for (&end, instant) in ends.zip(&collected.instants) {
            self.latency_s.0 += end as f64 / cardan_spec::timing::CPU_HZ as f64 - instant.time_s;
            self.latency_s.1 += 1;
        }
        let window = self.window(collected);
        self.judge.add(&window);
        if let Some(dump) = &mut self.dump {
            dump.add(&window, collected)?;
        }
        Ok(())
    }

    /// The verdict, with what is known at the end.
    pub(crate) fn finish(mut self, tail: &Tail) -> Result<Outcome, Failure> {
        let summary = &tail.emulated;
        let seconds = summary.cycles as f64 / cardan_spec::timing::CPU_HZ as f64;
        self.facts.run.seconds = seconds;
        for (node, &index) in self.facts.nodes.iter_mut().zip(&self.indices) {
            node.overflows = tail.native.overflows.get(index).copied().unwrap_or(0);
        }
        self.facts.checks = self.checker.finish(summary);
        let (sum_s, count) = self.latency_s;
        self.facts.emulator = EmulatorStatistics {
            cycles: summary.cycles,
            instructions: summary.instructions,
            realtime_factor: seconds / summary.host_seconds,
            cpu_load: 1.0 - summary.sleeping_cycles as f64 / (summary.cycles as f64).max(1.0),
            stack_peak: Some(summary.stack_peak),
            late_conversions: summary.late_conversions,
            lost_conversions: summary.lost_conversions,
            isr_latency_max_cycles: summary.isr_latency_max_cycles,
            missed_deadlines: summary.missed_deadlines,
            mistimed: summary.mistimed,
            first_mistimed: summary.first_mistimed.clone(),
            output_latency_ms: (count > 0).then(|| 1e3 * sum_s / count as f64),
            first_conversion_cycle: self.facts.emulator.first_conversion_cycle,
        };
        self.facts.link = LinkStatistics {
            messages: tail.messages,
            bytes: tail.bytes,
            lost: tail.lost,
        };
        self.facts.reproduce.provenance = provenance(self.setup, tail);
        let (report, plots) = self.judge.finish(&self.facts);
        Ok(Outcome {
            report,
            facts: self.facts,
            plots,
            dump: self.dump,
            crash: summary.crash.clone(),
        })
    }
}

fn truth_tolerance(
    tolerance: &cardan_scenario::tolerance::TruthTolerance,
) -> Option<TruthTolerance> {
    let limits = [tolerance.rms_deg, tolerance.p99_deg, tolerance.max_deg];
    let is_set = limits.iter().any(Option::is_some);
    is_set.then_some(TruthTolerance {
        rms: tolerance.rms_deg,
        p99: tolerance.p99_deg,
        max: tolerance.max_deg,
    })
}

/// What else decides the result, and what is to be said of the run.
fn provenance(setup: &Setup, tail: &Tail) -> Vec<(String, String)> {
    let mut provenance = vec![
        ("cardan".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("formats".to_owned(), format!("{:016x}", setup.formats_hash)),
        ("image".to_owned(), setup.firmware.name.clone()),
    ];
    let remark = |text: String| ("remark".to_owned(), text);
    provenance.extend(tail.emulated.remarks.iter().cloned().map(remark));
    let tuned = setup
        .tuned
        .iter()
        .flat_map(|tuned| tuned_to(tuned).unjudged);
    provenance.extend(tuned.map(|text| {
        remark(format!(
            "tuned to {text}, which a comparison does not measure"
        ))
    }));
    if let Some(what) = &setup.not_judged {
        provenance.push((NOT_JUDGED.to_owned(), what.clone()));
    }
    if let Some(crash) = &tail.emulated.crash {
        provenance.push(("crash".to_owned(), crash.clone()));
    }
    provenance
}

/// Everything assumed; a calibration that the user gave is not the scenario's.
fn assumed(setup: &Setup) -> Result<Vec<Assumed>, Failure> {
    let trajectory = Trajectory::new(&setup.scenario, setup.seed).map_err(Failure::input)?;
    let eeprom = setup.firmware.eeprom.as_ref();
    let assumed = report::assumptions(&setup.scenario, &trajectory)
        .into_iter()
        .map(|a| match eeprom {
            Some(image) if a.key == report::CALIBRATION => Assumed {
                name: a.key,
                value: format!("EEPROM image {}", image.name),
                reason: "option --eeprom".to_owned(),
            },
            _ => Assumed {
                name: a.key,
                value: a.value,
                reason: a.source,
            },
        });
    Ok(assumed.collect())
}

/// The verdict of a whole session that was collected before.
pub(crate) fn of_collected(
    setup: &Setup,
    collected: &Collected,
    names: Names<'_>,
) -> Result<Report, Failure> {
    let mut session = Session::new(setup, &collected.configuration, names, &Wanted::default())?;
    session.add(collected)?;
    Ok(session.finish(&collected.tail)?.report)
}

//! A session of `compare` as a library: recorded once, its parts changed, judged as often as wanted.
//!
//! What the participants published lies open in [`Collected`]: whoever plants a fault in one of them
//! changes it there, at the seam between participant and judge. A fault before the firmware is a
//! change of the conversions, from which [`Rig::recompute`] makes what firmware and golden model
//! give.

use cardan_bench::app::{Feed, Party};
use cardan_bench::{Engine, Sink, SinkError};
use cardan_compare::{Expectation, Report};
use cardan_link::Status;
use cardan_numerics::tape::Expected;
use clap::Parser;

use crate::commands::compare::{self, CompareArgs};
use crate::failure::Failure;
use crate::judge::{self, Names};
use crate::run_options::Setup;

pub use crate::participants::diff::{Collected, StageStreams, Streams, Tail};

/// A recorded session.
pub struct Rig {
    setup: Setup,
    /// What the participants published.
    pub collected: Collected,
}

#[derive(Parser)]
struct Arguments {
    #[command(flatten)]
    compare: CompareArgs,
}

impl Rig {
    /// Runs `cardan compare ARGUMENTS` in this process, up to the judge.
    ///
    /// # Errors
    /// Whatever the command would refuse or fail at.
    pub fn record(arguments: &[&str]) -> Result<Self, String> {
        let line = std::iter::once("compare").chain(arguments.iter().copied());
        let arguments = Arguments::try_parse_from(line).map_err(|error| error.to_string())?;
        let told = |failure: Failure| failure.to_string();
        let mut setup = arguments.compare.run.resolve().map_err(told)?;
        // The verdict does not need each node's share of the rounding.
        setup.shares = false;
        let collected = compare::collected(&setup).map_err(told)?;
        Ok(Self { setup, collected })
    }

    /// The same with other values of what the participants published.
    #[must_use]
    pub fn with(&self, change: impl FnOnce(&mut Collected)) -> Self {
        let mut changed = Self {
            setup: self.setup.clone(),
            collected: self.collected.clone(),
        };
        change(&mut changed.collected);
        changed
    }

    /// Runs firmware and golden model again on the conversions; the emulated chip is taken to give
    /// native's bits.
    ///
    /// # Errors
    /// An engine that cannot run.
    pub fn recompute(&mut self) -> Result<(), String> {
        let app = self.setup.app;
        let configuration = self.collected.configuration.clone();
        let formats = self.setup.formats.as_deref();
        let native = self.run(&mut *app.native(&configuration, formats)?)?;
        let real = self.run(&mut *app.expectation(&configuration, formats)?)?;
        let golden = self.run(&mut *app.golden(&configuration, Feed::Codes))?;
        let stages = self.stages(Party::Golden)?;
        let collected = &mut self.collected;
        collected.emulated = native.words.clone();
        collected.native = native.words;
        collected.emulated_frames = native.frames.clone();
        collected.native_frames = native.frames;
        (collected.real, collected.expected) = (real.reals, real.expected);
        (collected.real_status, collected.golden_status) = (real.statuses, golden.statuses);
        collected.golden = golden.reals;
        collected.stages.extend(stages);
        Ok(())
    }

    /// What a participant's models make of the conversions, by stage: per member, per solution.
    fn stages(&self, party: Party) -> Result<StageStreams, String> {
        let (app, configuration) = (self.setup.app, &self.collected.configuration);
        let members = app.outputs(configuration).group.map(|group| group.members);
        let nodes = app.golden_nodes();
        let place = |node: &str| {
            nodes
                .iter()
                .position(|&index| app.nodes()[index].name == node)
        };
        let mut stages = StageStreams::new();
        for (stage, mut engine) in app.models(configuration, party) {
            let kept = self.run(&mut *engine)?;
            let values = members.iter().flatten().map(|member| {
                let values = place(&member.node).and_then(|place| kept.reals.get(&place));
                values.cloned().unwrap_or_default()
            });
            stages.insert(stage, values.collect());
        }
        Ok(stages)
    }

    fn run(&self, engine: &mut dyn Engine) -> Result<Kept, String> {
        let mut kept = Kept::default();
        let mut feed = self.collected.conversions.iter().copied().map(Ok);
        engine
            .run(&mut feed, &mut kept)
            .map_err(|error| error.to_string())?;
        Ok(kept)
    }

    /// The verdict.
    ///
    /// # Errors
    /// A scenario that cannot be judged.
    pub fn judge(&self) -> Result<Report, String> {
        let names = Names {
            session: "auto",
            command: "cardan compare",
        };
        judge::of_collected(&self.setup, &self.collected, names)
            .map_err(|failure| failure.to_string())
    }
}

/// Keeps what an engine shows.
#[derive(Default)]
struct Kept {
    words: Streams<i64>,
    reals: Streams<f64>,
    expected: Streams<Expectation>,
    statuses: Vec<Status>,
    frames: Vec<Vec<u8>>,
}

impl Sink for Kept {
    fn word(&mut self, node: usize, raw: i64, _: u64) -> Result<(), SinkError> {
        self.words.entry(node).or_default().push(raw);
        Ok(())
    }

    fn real(&mut self, node: usize, value: f64, _: u64) -> Result<(), SinkError> {
        self.reals.entry(node).or_default().push(value);
        Ok(())
    }

    fn expected(&mut self, node: usize, expected: Expected, _: u64) -> Result<(), SinkError> {
        self.reals.entry(node).or_default().push(expected.value);
        let Expected {
            bias, deviation, ..
        } = expected;
        let of_node = self.expected.entry(node).or_default();
        of_node.push(Expectation { bias, deviation });
        Ok(())
    }

    fn status(&mut self, set: u16, doubtful: u16, cycle: u64) -> Result<(), SinkError> {
        self.statuses.push(Status {
            cycle,
            set: set.into(),
            doubtful: doubtful.into(),
        });
        Ok(())
    }

    fn frame(&mut self, _: u64, bytes: &[u8]) -> Result<(), SinkError> {
        self.frames.push(bytes.to_vec());
        Ok(())
    }
}

//! The attitude as each stage of the chain leaves it.

use std::thread;

use cardan_bench::app::Feed;
use cardan_bench::{Conversion, Engine, EngineError, Sink, SinkError};
use cardan_compare::{Attitudes, RoundingStep, Series};
use cardan_golden::Angles;
use cardan_units::HalfTurns;

use crate::failure::Failure;
use crate::participants::diff::{Collected, Streams};
use crate::run_options::Setup;

pub(super) fn attitudes(setup: &Setup, collected: &Collected) -> Result<Attitudes, Failure> {
    let app = setup.app;
    let configuration = &collected.configuration;
    let truth = collected.truths.iter().map(|truth| {
        (!truth.yaw_rad.is_nan()).then(|| Angles {
            yaw: HalfTurns::from_radians(truth.yaw_rad),
            pitch: HalfTurns::from_radians(truth.pitch_rad),
            roll: HalfTurns::from_radians(truth.roll_rad),
        })
    });
    let indices = app.attitude_nodes();
    let shared = indices.map(|node| {
        app.golden_nodes()
            .iter()
            .position(|&index| index == node)
            .unwrap_or(usize::MAX)
    });
    let lsb = |node: usize| {
        setup
            .formats
            .as_ref()
            .map_or(app.nodes()[node].format, |formats| formats[node])
            .lsb()
    };
    let word_series = |streams: &Streams<i64>| {
        let scaled = indices.map(|node| {
            let raw = streams.get(&node).cloned().unwrap_or_default();
            raw.iter().map(|&raw| raw as f64 * lsb(node)).collect()
        });
        series(&scaled)
    };
    let from_frames = |frames: &[Vec<u8>]| -> Series {
        frames
            .iter()
            .map(|frame| app.decode_frame(frame).map(|(values, _)| angles(values)))
            .collect()
    };
    let direct = run_attitude(
        app.golden(configuration, Feed::Direct),
        &collected.conversions,
        shared,
    )?;
    let experienced = run_attitude(
        app.golden(configuration, Feed::Experienced),
        &collected.conversions,
        shared,
    )?;
    Ok(Attitudes {
        truth: truth.collect(),
        direct,
        experienced,
        ideal: series(&shared.map(|node| {
            collected
                .golden_ideal
                .get(&node)
                .cloned()
                .unwrap_or_default()
        })),
        codes: series(&shared.map(|node| collected.golden.get(&node).cloned().unwrap_or_default())),
        real: series(&indices.map(|node| collected.real.get(&node).cloned().unwrap_or_default())),
        deployed: word_series(&collected.native),
        emulated: if setup.firmware.taps.is_some() {
            word_series(&collected.emulated)
        } else {
            from_frames(&collected.emulated_frames)
        },
        rounding_steps: Vec::new(),
    })
}

fn angles([yaw, pitch, roll]: [f64; 3]) -> Angles {
    Angles {
        yaw: HalfTurns(yaw),
        pitch: HalfTurns(pitch),
        roll: HalfTurns(roll),
    }
}

/// Yaw, pitch and roll streams side by side; NaN means unknown.
fn series([yaw, pitch, roll]: &[Vec<f64>; 3]) -> Series {
    yaw.iter()
        .zip(pitch)
        .zip(roll)
        .map(|((&yaw, &pitch), &roll)| {
            let known = yaw.is_finite() && pitch.is_finite() && roll.is_finite();
            known.then(|| angles([yaw, pitch, roll]))
        })
        .collect()
}

/// Keeps the three attitude nodes of an engine.
struct AttitudeOf {
    nodes: [usize; 3],
    values: [Vec<f64>; 3],
}

impl Sink for AttitudeOf {
    fn real(&mut self, node: usize, value: f64, _: u64) -> Result<(), SinkError> {
        if let Some(slot) = self.nodes.iter().position(|&index| index == node) {
            self.values[slot].push(value);
        }
        Ok(())
    }
}

fn run_attitude(
    mut engine: Box<dyn Engine>,
    conversions: &[Conversion],
    nodes: [usize; 3],
) -> Result<Series, Failure> {
    let mut sink = AttitudeOf {
        nodes,
        values: Default::default(),
    };
    let mut feed = conversions.iter().copied().map(Ok);
    match engine.run(&mut feed, &mut sink) {
        Ok(_) => Ok(series(&sink.values)),
        Err(EngineError::Input(message)) => Err(Failure::input(message)),
        Err(EngineError::Link(error)) => Err(Failure::participant(error)),
    }
}

/// The attitudes with one more node rounded at each step; steps are independent, so they share the
/// processor's cores.
pub(super) fn rounding_steps(
    setup: &Setup,
    collected: &Collected,
) -> Result<Vec<RoundingStep>, Failure> {
    let app = setup.app;
    let count = app.nodes().len();
    let workers = thread::available_parallelism()
        .map_or(1, usize::from)
        .min(count);
    let steps = app
        .rounding_steps(
            &collected.configuration,
            setup.formats.as_deref(),
            &collected.conversions,
        )
        .map_err(Failure::input)?;
    let step = |node: usize| RoundingStep {
        node: app.nodes()[node].name.to_owned(),
        attitudes: series(&steps.attitudes(node + 1)),
    };
    let step = &step;
    let worker = move |first: usize| -> Vec<(usize, RoundingStep)> {
        let nodes = (first..count).step_by(workers);
        nodes.map(|node| (node, step(node))).collect()
    };
    let mut steps = thread::scope(|scope| {
        let handles: Vec<_> = (0..workers)
            .map(|first| scope.spawn(move || worker(first)))
            .collect();
        let mut all = Vec::new();
        for handle in handles {
            let part = handle
                .join()
                .map_err(|_| Failure::participant("'diff': a rounding step panicked"))?;
            all.extend(part);
        }
        Ok::<_, Failure>(all)
    })?;
    steps.sort_by_key(|(node, _)| *node);
    Ok(steps.into_iter().map(|(_, step)| step).collect())
}

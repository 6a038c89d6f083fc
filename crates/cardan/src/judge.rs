//! From what a session published to the comparison that is judged.

use std::thread;

use cardan_bench::app::Feed;
use cardan_bench::{App, Conversion, Engine, EngineError, Sink, SinkError};
use cardan_compare::{
    Assumed, Attitudes, Comparison, EmulatorStatistics, Format, Frames, LinkStatistics, Node,
    Reproduce, RoundingStep, Run, Series, Tolerance, TruthTolerance,
};
use cardan_datapath::NodeInfo;
use cardan_golden::Angles;
use cardan_scenario::{Trajectory, report};
use cardan_spec::nodes::SHARED;
use cardan_units::HalfTurns;

use crate::failure::Failure;
use crate::participants::diff::{Collected, Streams};
use crate::run_options::Setup;

/// Builds the comparison of a run.
pub(crate) fn comparison(
    setup: &Setup,
    collected: &Collected,
    session: &str,
    command: String,
) -> Result<Comparison, Failure> {
    let app = setup.app;
    let flags = flags(app, &collected.native_frames);
    let trajectory = Trajectory::new(&setup.scenario, setup.seed).map_err(Failure::input)?;
    let summary = &collected.emulated_summary;
    let run = Run {
        app: app.name().to_owned(),
        scenario: setup.scenario.name.clone(),
        seed: setup.seed,
        session: session.to_owned(),
        seconds: summary.cycles as f64 / cardan_spec::timing::CPU_HZ as f64,
        samples: collected.conversions.len() as u64,
        solution_seconds: app.solution_seconds(&collected.configuration),
    };
    let tolerance = &setup.scenario.tolerance.truth;
    let truth_tolerance =
        (tolerance.rms_deg.is_some() || tolerance.max_deg.is_some()).then_some(TruthTolerance {
            rms_deg: tolerance.rms_deg,
            p99_deg: None,
            max_deg: tolerance.max_deg,
        });
    let assumed = assumed(setup, &trajectory);
    let mut provenance = vec![
        ("cardan".to_owned(), env!("CARGO_PKG_VERSION").to_owned()),
        ("formats".to_owned(), format!("{:016x}", setup.formats_hash)),
        ("image".to_owned(), setup.firmware.name.clone()),
    ];
    provenance.extend(
        summary
            .remarks
            .iter()
            .map(|remark| ("remark".to_owned(), remark.clone())),
    );
    if let Some(crash) = &summary.crash {
        provenance.push(("crash".to_owned(), crash.clone()));
    }
    Ok(Comparison {
        run,
        nodes: nodes(setup, collected, flags.len()),
        frames: Frames {
            native: collected.native_frames.clone(),
            emulated: collected.emulated_frames.clone(),
        },
        attitudes: attitudes(setup, collected)?,
        flags,
        golden_flags: Vec::new(),
        truth_tolerance,
        emulator: EmulatorStatistics {
            cycles: summary.cycles,
            instructions: summary.instructions,
            realtime_factor: summary.cycles as f64
                / cardan_spec::timing::CPU_HZ as f64
                / summary.host_seconds,
            cpu_load: 1.0 - summary.sleeping_cycles as f64 / (summary.cycles as f64).max(1.0),
            stack_peak: Some(summary.stack_peak),
            late_conversions: summary.late_conversions,
            lost_conversions: summary.lost_conversions,
            isr_latency_max_cycles: summary.isr_latency_max_cycles,
            missed_deadlines: summary.missed_deadlines,
            mistimed: summary.mistimed,
            first_mistimed: summary.first_mistimed.clone(),
            first_conversion_cycle: collected.conversions.first().map(|first| first.cycle),
        },
        link: LinkStatistics {
            messages: collected.messages,
            bytes: collected.bytes,
            lost: collected.lost,
        },
        assumed,
        reproduce: Reproduce {
            command,
            provenance,
        },
    })
}

/// Everything assumed; a calibration that the user gave is not the scenario's.
fn assumed(setup: &Setup, trajectory: &Trajectory) -> Vec<Assumed> {
    let eeprom = setup.firmware.eeprom.as_ref();
    report::assumptions(&setup.scenario, trajectory)
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
        })
        .collect()
}

/// Native's status word per solution. A frame that cannot be read counts as flagged throughout.
fn flags(app: &dyn App, frames: &[Vec<u8>]) -> Vec<u16> {
    let flags = |frame: &Vec<u8>| app.decode_frame(frame).map_or(u16::MAX, |(_, flags)| flags);
    frames.iter().map(flags).collect()
}

fn nodes(setup: &Setup, collected: &Collected, solutions: usize) -> Vec<Node> {
    let app = setup.app;
    let averaging = collected.configuration.averaging();
    let bundled = app.tolerances(&collected.configuration);
    let golden_of = |node: usize| {
        let shared = app.golden_nodes().iter().position(|&index| index == node)?;
        collected.golden.get(&shared).cloned()
    };
    let listed = |(index, info): (usize, &NodeInfo)| {
        let native = collected.native.get(&index)?.clone();
        let format = setup
            .formats
            .as_ref()
            .map_or(info.format, |formats| formats[index]);
        let per_solution = SHARED
            .iter()
            .find(|shared| shared.name == info.name)
            .map_or(native.len() / solutions.max(1), |shared| {
                shared.per_solution(averaging)
            });
        Some(Node {
            name: info.name.to_owned(),
            unit: info.unit.to_owned(),
            per_solution,
            format: Some(Format {
                word: format.word,
                frac: format.frac as i32,
                rounding: format.rounding.name().to_owned(),
                overflow: format.overflow.name().to_owned(),
            }),
            lsb: format.lsb(),
            native,
            emulated: setup
                .firmware
                .taps
                .map(|_| collected.emulated.get(&index).cloned().unwrap_or_default()),
            real: collected.real.get(&index).cloned(),
            golden: golden_of(index),
            overflows: collected
                .native_summary
                .overflows
                .get(index)
                .copied()
                .unwrap_or(0),
            tolerance: tolerance(setup, &bundled, info.name),
        })
    };
    app.nodes().iter().enumerate().filter_map(listed).collect()
}

/// The scenario's tolerance, else the bundled one.
fn tolerance(
    setup: &Setup,
    bundled: &[cardan_bench::app::Tolerance],
    node: &str,
) -> Option<Tolerance> {
    if let Some(&max_abs) = setup.scenario.tolerance.nodes.get(node) {
        return Some(Tolerance {
            max_abs,
            reason: "set by the scenario".to_owned(),
        });
    }
    let bundled = bundled.iter().find(|tolerance| tolerance.node == node)?;
    Some(Tolerance {
        max_abs: bundled.max_abs,
        reason: bundled.reason.to_owned(),
    })
}

fn attitudes(setup: &Setup, collected: &Collected) -> Result<Attitudes, Failure> {
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
    Ok(Attitudes {
        truth: truth.collect(),
        direct,
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
        rounding_steps: rounding_steps(setup, collected)?,
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
fn rounding_steps(setup: &Setup, collected: &Collected) -> Result<Vec<RoundingStep>, Failure> {
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

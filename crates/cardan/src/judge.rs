//! From what a session published to the comparison that is judged.

use std::thread;

use cardan_bench::app::{Evidence, Feed};
use cardan_bench::{App, Conversion, Engine, EngineError, Sink, SinkError};
use cardan_compare::{
    Assumed, Attitudes, Comparison, EmulatorStatistics, Format, Frames, Limit, LinkStatistics,
    Messages, NOT_JUDGED, Node, NodeInput, Reproduce, RoundingStep, Run, Series, Tolerance,
    TruthTolerance, TunedError, TunedTo,
};
use cardan_datapath::NodeInfo;
use cardan_datapath::wordlengths::Tuned;
use cardan_golden::Angles;
use cardan_numerics::tape::Flow;
use cardan_outputs::{Check, Message, Status};
use cardan_scenario::tolerance::Tolerance as ScenarioTolerance;
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
    let mut comparison = without_shares(setup, collected, session, command)?;
    comparison.attitudes.rounding_steps = rounding_steps(setup, collected)?;
    Ok(comparison)
}

/// The same without each node's share of the rounding, which the verdict does not need.
pub(crate) fn without_shares(
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
    let widened = widened(setup);
    let tolerance = &widened.truth;
    let limits = [tolerance.rms_deg, tolerance.p99_deg, tolerance.max_deg];
    let truth_tolerance = limits
        .iter()
        .any(Option::is_some)
        .then_some(TruthTolerance {
            rms_deg: tolerance.rms_deg,
            p99_deg: tolerance.p99_deg,
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
    for text in setup
        .tuned
        .iter()
        .flat_map(|tuned| tuned_to(tuned).unjudged)
    {
        let remark = format!("tuned to {text}, which a comparison does not measure");
        provenance.push(("remark".to_owned(), remark));
    }
    if let Some(what) = &setup.not_judged {
        provenance.push((NOT_JUDGED.to_owned(), what.clone()));
    }
    if let Some(crash) = &summary.crash {
        provenance.push(("crash".to_owned(), crash.clone()));
    }
    Ok(Comparison {
        run,
        nodes: nodes(setup, collected, flags.len())?,
        frames: Frames {
            native: collected.native_frames.clone(),
            emulated: collected.emulated_frames.clone(),
        },
        attitudes: attitudes(setup, collected)?,
        flags,
        outputs: app.outputs(&collected.configuration),
        messages: Messages {
            native: messages(app, &collected.native_frames),
            emulated: messages(app, &collected.emulated_frames),
        },
        status: status(collected),
        checks: checks(setup, collected)?,
        stale: setup.stale.clone(),
        stage_limits: stage_limits(&widened),
        most_flagged: most_flagged(&widened),
        tuned: setup.tuned.as_ref().map(tuned_to),
        truth_tolerance,
        widening: ScenarioTolerance::widening(setup.seconds, setup.scenario.seconds),
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
            output_latency_ms: output_latency_ms(collected),
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

/// From the output instants to the ends of their frames, on the average.
fn output_latency_ms(collected: &Collected) -> Option<f64> {
    let ends_s = collected.emulated_frame_cycles.iter();
    let ends_s = ends_s.map(|&cycle| cycle as f64 / cardan_spec::timing::CPU_HZ as f64);
    let latencies: Vec<f64> = ends_s
        .zip(&collected.truths)
        .map(|(end_s, truth)| 1e3 * (end_s - truth.time_s))
        .collect();
    let count = latencies.len() as f64;
    (count > 0.0).then(|| latencies.iter().sum::<f64>() / count)
}

/// The scenario's limits, which are stated for its own length, and those stated for this run.
fn widened(setup: &Setup) -> ScenarioTolerance {
    let scenario = &setup.scenario;
    let exact: Vec<&str> = setup.stated.iter().map(String::as_str).collect();
    (scenario.tolerance).of_run(setup.seconds, scenario.seconds, &exact)
}

/// What each stage before the firmware did by itself.
fn checks(setup: &Setup, collected: &Collected) -> Result<Vec<Check>, Failure> {
    let truth_times_s: Vec<f64> = collected.truths.iter().map(|truth| truth.time_s).collect();
    let mut scenario = setup.scenario.clone();
    scenario.tolerance = widened(setup);
    let evidence = Evidence {
        scenario: &scenario,
        configuration: &collected.configuration,
        conversions: &collected.conversions,
        truth_times_s: &truth_times_s,
        summary: &collected.emulated_summary,
    };
    setup.app.checks(&evidence).map_err(Failure::input)
}

fn stage_limits(tolerance: &ScenarioTolerance) -> Vec<(String, Limit)> {
    let stages = &tolerance.stages;
    [
        ("latency", stages.latency_deg),
        ("motion", stages.motion_deg),
        ("sensor_frontend", stages.sensor_frontend_deg),
        ("adc", stages.adc_deg),
    ]
    .into_iter()
    .filter_map(|(name, limit)| {
        let reason = stages.reason.clone();
        Some((
            name.to_owned(),
            Limit {
                most: limit?,
                reason,
            },
        ))
    })
    .collect()
}

fn most_flagged(tolerance: &ScenarioTolerance) -> Option<Limit> {
    Some(Limit {
        most: tolerance.status.most_flagged?,
        reason: tolerance.status.reason.clone(),
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

fn messages(app: &dyn App, frames: &[Vec<u8>]) -> Vec<Result<Message, String>> {
    frames.iter().map(|frame| app.decode(frame)).collect()
}

/// Golden's status of each solution; the real interpretation knows which bits rounding decides.
fn status(collected: &Collected) -> Vec<Status> {
    let doubts = collected.real_status.iter().map(|real| real.doubtful);
    collected
        .golden_status
        .iter()
        .zip(doubts.chain(std::iter::repeat(0)))
        .map(|(golden, doubtful)| Status {
            set: golden.set,
            doubtful,
        })
        .collect()
}

fn nodes(setup: &Setup, collected: &Collected, solutions: usize) -> Result<Vec<Node>, Failure> {
    let app = setup.app;
    let flow = app.flow(&collected.configuration).map_err(Failure::input)?;
    let averaging = collected.configuration.averaging();
    let bundled = app.tolerances();
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
            meaning: info.meaning.to_owned(),
            inputs: inputs_of(&flow, index, app.nodes()),
            operations: operations_of(&flow, index),
            position: flow.position(index),
            writes: flow
                .position(index)
                .map(|at| flow.writes[at].clone())
                .unwrap_or_default(),
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
            expected: collected.expected.get(&index).cloned(),
            golden: golden_of(index),
            overflows: collected
                .native_summary
                .overflows
                .get(index)
                .copied()
                .unwrap_or(0),
            tolerance: set_tolerance(setup, info.name),
            tuned: tuned_tolerance(setup, info.name),
            allowance: allowance(&bundled, info.name),
        })
    };
    Ok(app.nodes().iter().enumerate().filter_map(listed).collect())
}

/// The nodes whose values enter a node.
fn inputs_of(flow: &Flow, node: usize, nodes: &[NodeInfo]) -> Vec<NodeInput> {
    let entering = flow.edges.iter().filter(|edge| edge.to == node);
    let named = entering.filter_map(|edge| {
        Some(NodeInput {
            node: nodes.get(edge.from)?.name.to_owned(),
            earlier: edge.earlier,
        })
    });
    named.collect()
}

/// What writes a node, in words.
pub(crate) fn operations_of(flow: &Flow, node: usize) -> Vec<String> {
    let words = flow.position(node).map(|at| &flow.operations[at]);
    let words = words.into_iter().flatten();
    words.map(|&word| word.to_owned()).collect()
}

/// The tolerance that the scenario sets, in place of what rounding explains.
fn set_tolerance(setup: &Setup, node: &str) -> Option<Tolerance> {
    let max_abs = *setup.scenario.tolerance.nodes.get(node)?;
    Some(Tolerance {
        max_abs,
        reason: "set by the scenario".to_owned(),
    })
}

/// The tolerance that the word-length file states.
fn tuned_tolerance(setup: &Setup, node: &str) -> Option<Tolerance> {
    let all = &setup.tuned.as_ref()?.tolerance;
    let stated = all.iter().find(|stated| stated.node == node)?;
    Some(Tolerance {
        max_abs: stated.max,
        reason: "stated by the word-length file".to_owned(),
    })
}

/// The budget of a word-length file, as far as a comparison measures it.
fn tuned_to(tuned: &Tuned) -> TunedTo {
    let mut to = TunedTo::default();
    for text in &tuned.budget {
        let parsed = text
            .split_once("<=")
            .and_then(|(measure, limit)| Some((measure.trim(), limit.trim().parse::<f64>().ok()?)));
        match parsed {
            Some(("flags", limit)) => to.most_status = limit,
            Some((measure, most_deg)) if !measure.starts_with("truth.") => {
                match measure.split_once('.') {
                    Some((subject, statistic)) => to.errors.push(TunedError {
                        text: text.clone(),
                        subject: subject.to_owned(),
                        statistic: statistic.to_owned(),
                        most_deg,
                    }),
                    None => to.unjudged.push(text.clone()),
                }
            }
            _ => to.unjudged.push(text.clone()),
        }
    }
    to
}

fn allowance(bundled: &[cardan_bench::app::Tolerance], node: &str) -> Option<Tolerance> {
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

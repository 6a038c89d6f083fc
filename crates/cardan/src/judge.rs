//! From what a session published to the comparison that is judged.

mod attitudes;
mod limits;
mod nodes;

use cardan_bench::App;
use cardan_bench::app::Evidence;
use cardan_compare::{
    Assumed, Comparison, EmulatorStatistics, Frames, LinkStatistics, Messages, NOT_JUDGED,
    Reproduce, Run, TruthTolerance,
};
use cardan_outputs::{Check, Message, Status};
use cardan_scenario::{Trajectory, report};

use self::attitudes::{attitudes, rounding_steps};
use self::limits::{most_flagged, stage_limits, tuned_to, widened};
use self::nodes::nodes;
pub(crate) use self::nodes::operations_of;
use crate::failure::Failure;
use crate::participants::diff::Collected;
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
        widening: setup.scenario.widening(setup.seconds),
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

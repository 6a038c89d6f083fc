//! Calibrates a unit: reads it at rest in known attitudes over its serial line, estimates, checks.
//!
//! What a production line has: the attitudes (of a turntable, or of a recording's own instruments),
//! the field at its site, and the device's frames. Taps and codes are not used.

use std::ops::Range;
use std::sync::Arc;

use cardan_calibrate::{Earth, Observation, Working, estimate};
use cardan_firmware::calibration::Settings;
use cardan_golden::{Angles, rotation_angle, set_1_matrix};
use cardan_scenario::field::EarthField;
use cardan_scenario::scenario::MotionKind;
use cardan_scenario::{Poses, Stimulus, Trajectory};
use cardan_spec::flags;
use cardan_spec::timing::{Averaging, BLOCK_CYCLES, CONVERSION_CYCLES, CPU_HZ, WARM_UP_BLOCKS};
use cardan_units::HalfTurns;
use nalgebra::{Matrix3, Vector3};

use super::line::{Told, Unit};
use super::{calibration_of, calibration_words, eeprom};
use crate::calibration::{Accuracy, CalibrateError, Calibrated, HeldOut, Request, Visit};

/// Rest before the first reading that counts: as long as a device of four channels itself waits after
/// reset, more than ten time constants of the slowest filter.
const SETTLE_S: f64 = WARM_UP_BLOCKS as f64 * BLOCK_CYCLES as f64 / CPU_HZ as f64;

/// More than the group delay by which readings come after what they tell, in seconds.
const DELAY_S: f64 = 0.03;

/// Largest tilt in which the calibrated unit works: what the reference design is judged up to
/// (docs/sensors.md, 7.6).
const WORKING_TILT_DEG: f64 = 60.0;

/// Half the span over which a recording's instruments are averaged: about that of the device's own
/// filters, so that the instruments' noise does not look like an attitude.
const REFERENCE_S: f64 = 0.016;

/// Points of that average.
const REFERENCE_POINTS: i32 = 9;

/// Over this time a recording must move all but evenly: less than [`CURVATURE`] off a straight line
/// (g, or |B|). All channels have the same group delay; what is left goes with the curvature, and is
/// then under a hundredth of it.
const EVEN_S: f64 = 0.05;
const CURVATURE: f64 = 0.1;

/// Without acceleration and disturbance the instruments show 1 g and |B|, but for their own errors.
const LENGTH_WITHIN: f64 = 0.1;

/// Visited attitudes and what was left out.
#[derive(Default)]
struct Visits {
    all: Vec<Visit>,
    left_out: usize,
    saturated: usize,
}

/// Runs the unit, estimates its calibration and checks it in other attitudes.
pub(super) fn calibrate(request: &Request<'_>) -> Result<Calibrated, CalibrateError> {
    let Request { scenario, seed, .. } = *request;
    let unit = Unit {
        scenario,
        firmware: request.firmware,
        seed,
    };
    let motion = Trajectory::new(scenario, seed).map_err(input)?;
    let field = motion.field();
    let settings =
        eeprom::settings_for(scenario, &motion, request.firmware).map_err(CalibrateError::Input)?;
    let (visits, mut remarks) = if scenario.motion.kind == MotionKind::Recording {
        recorded(request, &unit, motion, &settings)?
    } else {
        turned(request, &unit, field, &settings)?
    };
    let (horizontal, vertical) = field.inclination();
    let observations: Vec<Observation> = visits.all.iter().map(|visit| visit.observation).collect();
    let earth = Earth {
        horizontal,
        vertical,
    };
    let working = Working {
        cos_tilt: libm::cos(WORKING_TILT_DEG.to_radians()),
    };
    let estimate = estimate(&observations, earth, working)?;
    let calibrated = Settings {
        words: calibration_words(&estimate.calibration),
        ..settings
    };
    let (held_out, said) = check(request, &unit, field, [&settings, &calibrated])?;
    remarks.extend(said);
    remarks.sort();
    remarks.dedup();
    Ok(Calibrated {
        before: calibration_of(&settings.words),
        estimate,
        total_ut: field.total_ut(),
        image: calibrated.image().to_vec(),
        visits: visits.all,
        left_out: visits.left_out,
        saturated: visits.saturated,
        held_out,
        remarks,
    })
}

/// Seconds that `rounds` of conversions of all channels take.
fn seconds_of(rounds: usize, averaging: Averaging) -> f64 {
    (rounds * averaging.channels()) as f64 * CONVERSION_CYCLES as f64 / CPU_HZ as f64
}

/// Seconds from one solution to the next.
fn period_s(averaging: Averaging) -> f64 {
    seconds_of(averaging.period(), averaging)
}

fn input(error: impl std::fmt::Display) -> CalibrateError {
    CalibrateError::Input(error.to_string())
}

/// Attitudes with time for `solutions` readings in each.
fn poses(seed: u64, count: usize, tilt_deg: f64, solutions: usize, averaging: Averaging) -> Poses {
    // One solution more, so that that many whole ones lie inside wherever the first begins.
    let rest_s = SETTLE_S + (solutions + 1) as f64 * period_s(averaging);
    Poses::spread(seed, count, tilt_deg, rest_s)
}

/// What a unit told in each of its attitudes.
struct Tour {
    readings: Vec<Vec<Told>>,
    trajectory: Arc<Trajectory>,
    remarks: Vec<String>,
}

/// Runs the unit through `poses`; the readings of each, those before it has settled taken off.
fn visit(
    unit: &Unit<'_>,
    poses: &Poses,
    field: EarthField,
    settings: &Settings,
    seed: u64,
    solutions: usize,
) -> Result<Tour, CalibrateError> {
    let trajectory = Arc::new(Trajectory::resting(unit.scenario, poses.clone(), field));
    let averaging = settings.averaging;
    let seconds = poses.rest(poses.count() - 1).end + DELAY_S + period_s(averaging);
    let (told, remarks) = unit.run(&trajectory, seconds, settings, seed)?;
    let half_s = seconds_of(averaging.length(), averaging) / 2.0;
    let within = |rest: &Range<f64>, told: &&Told| {
        told.time_s - half_s >= rest.start + SETTLE_S && told.time_s + half_s <= rest.end
    };
    let readings = (0..poses.count())
        .map(|index| {
            let rest = poses.rest(index);
            let settled = told.iter().filter(|told| within(&rest, told));
            settled.take(solutions).copied().collect()
        })
        .collect();
    Ok(Tour {
        readings,
        trajectory,
        remarks,
    })
}

/// Readings on a turntable.
fn turned(
    request: &Request<'_>,
    unit: &Unit<'_>,
    field: EarthField,
    settings: &Settings,
) -> Result<(Visits, Vec<String>), CalibrateError> {
    let Request {
        seed, solutions, ..
    } = *request;
    let poses = poses(
        seed,
        request.attitudes,
        180.0,
        solutions,
        settings.averaging,
    );
    let tour = visit(unit, &poses, field, settings, seed, solutions)?;
    let mut visits = Visits::default();
    let north = Vector3::new(field.horizontal_ut, 0.0, field.vertical_ut) / field.total_ut();
    for (index, told) in tour.readings.iter().enumerate() {
        let attitude = poses.attitude(poses.rest(index).start);
        let known = |_: &Told| (attitude.column(2).into(), (attitude * north).into());
        visits.add(told, known);
    }
    Ok((visits, tour.remarks))
}

/// Readings along a recording where it moves slowly, against the recording's own instruments.
fn recorded(
    request: &Request<'_>,
    unit: &Unit<'_>,
    motion: Trajectory,
    settings: &Settings,
) -> Result<(Visits, Vec<String>), CalibrateError> {
    let seconds = motion
        .duration_s()
        .map_or(request.seconds, |end| end.min(request.seconds));
    let motion = Arc::new(motion);
    let (told, remarks) = unit.run(&motion, seconds, settings, request.seed)?;
    let instruments = Instruments {
        motion: &motion,
        total_ut: motion.field().total_ut(),
    };
    let mut visits = Visits::default();
    for told in told.chunks_exact(request.solutions) {
        let steady: Vec<Told> = told
            .iter()
            .filter(|told| instruments.are_steady(told.time_s))
            .copied()
            .collect();
        if 2 * steady.len() >= told.len() {
            visits.add(&steady, |told| instruments.at(told.time_s));
        }
    }
    if visits.all.is_empty() && visits.left_out == 0 {
        let wanted = request.solutions as f64 * period_s(settings.averaging);
        let name = &unit.scenario.name;
        return Err(CalibrateError::Input(format!(
            "{name}: nowhere does the recording keep 1 g and |B| (within 10 %) and move smoothly for \
             half of {wanted:.2} s, so that nothing can be read against its instruments; give a slower \
             one, or a smaller --solutions"
        )));
    }
    Ok((visits, remarks))
}

/// What a recording's instruments say.
struct Instruments<'a> {
    motion: &'a Trajectory,
    total_ut: f64,
}

impl Instruments<'_> {
    /// Gravity in g and field over |B|, averaged around `t_s`.
    fn at(&self, t_s: f64) -> ([f64; 3], [f64; 3]) {
        let (mut gravity, mut field) = ([0.0; 3], [0.0; 3]);
        let share = 1.0 / f64::from(REFERENCE_POINTS);
        for point in 0..REFERENCE_POINTS {
            let place = 2.0 * f64::from(point) / f64::from(REFERENCE_POINTS - 1) - 1.0;
            let felt = self.motion.at((t_s + place * REFERENCE_S).max(0.0));
            add(&mut gravity, felt.specific_force_g, -share);
            add(&mut field, felt.field_ut, share / self.total_ut);
        }
        (gravity, field)
    }

    /// True if they show 1 g and |B| and move all but evenly around `t_s`.
    fn are_steady(&self, t_s: f64) -> bool {
        let [before, now, after] = [-EVEN_S, 0.0, EVEN_S].map(|shift| self.at(t_s + shift));
        let steady = |before: [f64; 3], now: [f64; 3], after: [f64; 3]| {
            let [before, now, after] = [before, now, after].map(Vector3::from);
            (before - now * 2.0 + after).norm() / 2.0 < CURVATURE
                && (now.norm() - 1.0).abs() < LENGTH_WITHIN
        };
        let span_s = EVEN_S + REFERENCE_S;
        !self.motion.is_bridged(t_s - span_s, t_s + span_s)
            && steady(before.0, now.0, after.0)
            && steady(before.1, now.1, after.1)
    }
}

impl Visits {
    /// Takes the readings of one attitude, `known` being what each should have been. Saturated ones are
    /// left out; of an attitude in which most are, the others are too, being selected by their noise.
    fn add(&mut self, told: &[Told], known: impl Fn(&Told) -> ([f64; 3], [f64; 3])) {
        let usable: Vec<&Told> = told
            .iter()
            .filter(|told| told.flags & flags::SATURATION == 0)
            .collect();
        self.saturated += told.len() - usable.len();
        if 2 * usable.len() <= told.len() {
            self.left_out += 1;
            return;
        }
        let share = 1.0 / usable.len() as f64;
        let mut mean = Observation {
            averages: [0.0; 4],
            tilt_z: usable
                .iter()
                .map(|told| told.tilt_z)
                .sum::<Option<f64>>()
                .map(|sum| share * sum),
            gravity: [0.0; 3],
            field: [0.0; 3],
        };
        for told in &usable {
            let (gravity, field) = known(told);
            add(&mut mean.averages, told.averages, share);
            add(&mut mean.gravity, gravity, share);
            add(&mut mean.field, field, share);
        }
        self.all.push(Visit {
            observation: mean,
            solutions: usable.len(),
        });
    }
}

fn add<const N: usize>(to: &mut [f64; N], what: [f64; N], share: f64) {
    for (sum, part) in to.iter_mut().zip(what) {
        *sum += share * part;
    }
}

/// Attitude errors in other, upright attitudes under the next seed, with both calibrations.
fn check(
    request: &Request<'_>,
    unit: &Unit<'_>,
    field: EarthField,
    settings: [&Settings; 2],
) -> Result<(HeldOut, Vec<String>), CalibrateError> {
    let (seed, solutions) = (request.seed.wrapping_add(1), request.solutions);
    let poses = poses(
        seed,
        request.attitudes,
        WORKING_TILT_DEG,
        solutions,
        settings[0].averaging,
    );
    let mut remarks = Vec::new();
    let mut with = |settings| {
        let tour = visit(unit, &poses, field, settings, seed, solutions)?;
        let found = accuracy(&tour);
        remarks.extend(tour.remarks);
        Ok::<_, CalibrateError>(found)
    };
    let (before, after) = (with(settings[0])?, with(settings[1])?);
    let held_out = HeldOut {
        seed,
        attitudes: request.attitudes,
        tilt_deg: WORKING_TILT_DEG,
        before,
        after,
    };
    Ok((held_out, remarks))
}

/// Errors over all unflagged readings, and their scatter about the mean of each rest.
fn accuracy(tour: &Tour) -> Accuracy {
    let (mut errors, mut scatter, mut freedom) = (Vec::new(), 0.0, 0);
    for told in &tour.readings {
        let turned: Vec<Vector3<f64>> = told
            .iter()
            .filter(|told| told.flags == 0)
            .filter_map(|told| Some(turn(told, &tour.trajectory.truth_at(told.time_s)?)))
            .collect();
        let mean = turned.iter().sum::<Vector3<f64>>() / turned.len().max(1) as f64;
        scatter += turned
            .iter()
            .map(|v| (v - mean).norm_squared())
            .sum::<f64>();
        freedom += turned.len().saturating_sub(1);
        errors.extend(turned.iter().map(|v| v.norm()));
    }
    let degrees = |radians: f64| radians.to_degrees();
    let square: f64 = errors.iter().map(|error| error * error).sum();
    let some = (!errors.is_empty()).then_some(errors.len() as f64);
    let all: usize = tour.readings.iter().map(Vec::len).sum();
    Accuracy {
        rms_deg: some.map(|count| degrees((square / count).sqrt())),
        max_deg: errors.iter().copied().reduce(f64::max).map(degrees),
        noise_rms_deg: (freedom > 0).then(|| degrees((scatter / freedom as f64).sqrt())),
        samples: errors.len(),
        flagged: all - errors.len(),
    }
}

/// The rotation from the true attitude to the told one: its axis times its angle in radians.
fn turn(told: &Told, truth: &Matrix3<f64>) -> Vector3<f64> {
    let [yaw, pitch, roll] = told.angles.map(HalfTurns);
    let attitude = set_1_matrix(Angles { yaw, pitch, roll });
    let r = attitude * truth.transpose();
    let axis = Vector3::new(
        r[(2, 1)] - r[(1, 2)],
        r[(0, 2)] - r[(2, 0)],
        r[(1, 0)] - r[(0, 1)],
    );
    let angle = rotation_angle(&attitude, truth).radians();
    if axis.norm() > 0.0 {
        axis * (angle / axis.norm())
    } else {
        Vector3::new(angle, 0.0, 0.0)
    }
}

//! How accurate the attitude is: random attitudes, one per solution, through the converter and the
//! firmware on the emulated chip, beside the golden model, the maximum-likelihood attitude and the
//! Cramer-Rao bound.
//!
//! The board is simpler than [`crate::attitude`]'s: no sensors and no front end, each conversion sees
//! the ideal voltage of its attitude and white noise of its own. The problem is that of the sensors
//! reference, section 7.6: any heading, down uniform on the cap within the tilt limit, its field.

use cardan_datapath::{Deployed, Silent};
use cardan_emulator::{ATMEGA328P, AnalogInput, Conversion, Environment, Machine, Stop};
use cardan_firmware::averaging::Decimator;
use cardan_firmware::calibration::Settings;
use cardan_firmware::device::Solver;
use cardan_golden::{
    Angles, Attitude, EarthField, Golden, Noise, angles_of, codes_of, cramer_rao, ideal_readings,
    maximum_likelihood, node, rotation_angle, set_1_matrix,
};
use cardan_scenario::random::{Random, Source};
use cardan_spec::calibration::{Calibration, LEN};
use cardan_spec::timing::{
    Averaging, BLOCK_CONVERSIONS, BLOCK_CYCLES, BLOCK_ROUNDS, CPU_HZ, WARM_UP_BLOCKS,
};
use cardan_spec::{
    CHANNELS, Channel, FIELD_FULL_SCALE_UT, REFERENCE_V, TILT_FULL_SCALE_G, ThirdTilt, frame,
};
use cardan_units::{AdcCode, HalfTurns};

use crate::app::App;
use crate::attitude::{Attitude as Application, calibration_of, calibration_words};
use crate::image::Firmware;

/// The reference's site in 2008: horizontal and vertical field in microtesla.
pub const FIELD_UT: [f64; 2] = [23.563, 39.732];
/// A code of the converter in volts.
const LSB_V: f64 = REFERENCE_V / AdcCode::COUNT as f64;
/// Conversions before the first period.
const WARM_UP: usize = WARM_UP_BLOCKS * BLOCK_CONVERSIONS;
/// Cycles after the last conversion in which the last frame must be out.
const LAST_FRAME_CYCLES: u64 = BLOCK_CYCLES;

/// What is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// Random attitudes.
    pub attitudes: usize,
    /// Seed of attitudes and noise.
    pub seed: u64,
    /// Largest tilt in degrees.
    pub most_tilt_deg: f64,
    /// Conversions averaged, a power of two up to 4096.
    pub averaging: usize,
    /// White noise of each conversion, rms, of the tilt and of the field channels, in codes.
    pub noise_lsb: [f64; 2],
}

/// Codes per g and per microtesla.
#[must_use]
pub fn codes_per_unit() -> [f64; 2] {
    [TILT_FULL_SCALE_G, FIELD_FULL_SCALE_UT].map(|full| f64::from(AdcCode::CENTRE) / full)
}

/// Rotation angles in degrees.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Spread {
    /// Root mean square.
    pub rms: f64,
    /// 99th percentile.
    pub p99: f64,
    /// Largest.
    pub max: f64,
}

impl Spread {
    fn of(mut angles: Vec<f64>) -> Self {
        angles.sort_by(f64::total_cmp);
        let squares: f64 = angles.iter().map(|angle| angle * angle).sum();
        let at = (angles.len() * 99).div_ceil(100).saturating_sub(1);
        Self {
            rms: (squares / angles.len().max(1) as f64).sqrt(),
            p99: angles.get(at).copied().unwrap_or(0.0),
            max: angles.last().copied().unwrap_or(0.0),
        }
    }
}

/// Errors against the true attitudes, in degrees of rotation.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Accuracy {
    /// Conversions averaged.
    pub averaging: usize,
    /// The firmware on the emulated chip, from its frames.
    pub emulated: Spread,
    /// Its yaw's error, rms.
    pub yaw_rms: f64,
    /// Its pitch's error, rms: the tilt along one axis.
    pub pitch_rms: f64,
    /// Frames in which the native firmware differs; must be 0.
    pub native_mismatches: usize,
    /// The golden model on the same codes.
    pub golden: Spread,
    /// The same with the yaw of set 1 alone.
    pub set_1: Spread,
    /// The same with the yaw of set 2 alone.
    pub set_2: Spread,
    /// The maximum-likelihood attitude (Gauss-Newton on all four readings).
    pub maximum_likelihood: Spread,
    /// The Cramer-Rao bound: rms.
    pub cramer_rao_rms: f64,
    /// Rotation from the golden model to the emulated chip on the same codes: the share of rounding
    /// and of the algorithm's series.
    pub rounding: Spread,
}

/// Measures a case.
///
/// # Errors
/// An averaging length that the device does not have, or an image that does not run.
pub fn measure(case: &Case) -> Result<Accuracy, String> {
    let averaging = averaging(case.averaging)?;
    let [horizontal, vertical] = FIELD_UT;
    let total = libm::hypot(horizontal, vertical);
    let nominal = Calibration::nominal(total, horizontal / total, vertical / total);
    let settings = Settings {
        words: calibration_words(&nominal),
        averaging,
        third_tilt: ThirdTilt::Comparator,
        uncalibrated: false,
    };
    let calibration = calibration_of(&settings.words);
    let truths = attitudes(case);
    let codes = truths
        .iter()
        .map(|truth| {
            codes_of(
                &ideal_readings(truth, EarthField::from(&calibration)),
                &calibration,
            )
        })
        .collect::<Option<Vec<_>>>()
        .ok_or("the calibration has no inverse")?;
    let run = emulate(case, &settings, &codes)?;
    let models = Models::of(case, &settings, &calibration, &run.codes, &truths);
    let found: Vec<Attitude> = run
        .frames
        .iter()
        .filter_map(|frame| Application.decode_frame(frame))
        .map(|([yaw, pitch, roll], _)| attitude(HalfTurns(yaw), HalfTurns(pitch), HalfTurns(roll)))
        .collect();
    if found.len() != truths.len() || models.golden.len() != truths.len() {
        return Err(format!(
            "{} frames and {} golden solutions for {} attitudes",
            found.len(),
            models.golden.len(),
            truths.len()
        ));
    }
    let native = native(&settings, &run.codes);
    let differs = |(native, emulated): &(&Vec<u8>, &Vec<u8>)| native != emulated;
    Ok(Accuracy {
        averaging: case.averaging,
        emulated: errors(&found, &truths),
        yaw_rms: angle_rms(&found, &truths, |angles| angles.yaw),
        pitch_rms: angle_rms(&found, &truths, |angles| angles.pitch),
        native_mismatches: native.iter().zip(&run.frames).filter(differs).count()
            + native.len().abs_diff(run.frames.len()),
        golden: errors(&models.golden, &truths),
        set_1: errors(&models.set_1, &truths),
        set_2: errors(&models.set_2, &truths),
        maximum_likelihood: errors(&models.likelihood, &truths),
        cramer_rao_rms: models.bound_rms,
        rounding: errors(&found, &models.golden),
    })
}

fn averaging(length: usize) -> Result<Averaging, String> {
    let log2 = length.is_power_of_two().then(|| length.ilog2());
    let found = log2.and_then(|log2| {
        let log2 = u8::try_from(log2).ok()?;
        Averaging::new(log2, log2.max(BLOCK_ROUNDS.ilog2() as u8))
    });
    found.ok_or_else(|| {
        format!(
            "averages of {length}: the device averages powers of two from 1 to 4096 conversions"
        )
    })
}

fn attitude(yaw: HalfTurns, pitch: HalfTurns, roll: HalfTurns) -> Attitude {
    set_1_matrix(Angles { yaw, pitch, roll })
}

fn errors(found: &[Attitude], truths: &[Attitude]) -> Spread {
    let pairs = found.iter().zip(truths);
    Spread::of(pairs.map(|(a, b)| rotation_angle(a, b).degrees()).collect())
}

/// Rms error of one of set 1's angles in degrees.
fn angle_rms(found: &[Attitude], truths: &[Attitude], angle: fn(Angles) -> HalfTurns) -> f64 {
    let error = |(a, b): (&Attitude, &Attitude)| {
        HalfTurns(angle(angles_of(a)).0 - angle(angles_of(b)).0)
            .wrapped()
            .degrees()
    };
    Spread::of(found.iter().zip(truths).map(error).map(f64::abs).collect()).rms
}

/// Any heading, and down uniform on the cap of the sphere within the tilt limit.
fn attitudes(case: &Case) -> Vec<Attitude> {
    let mut random = Random::new(case.seed, Source::Motion);
    let cap = 1.0 - libm::cos(case.most_tilt_deg.to_radians());
    let none = HalfTurns(0.0);
    let mut next = |_| {
        let mut turn = || attitude(HalfTurns(2.0 * random.uniform() - 1.0), none, none);
        let (first, last) = (turn(), turn());
        let tilt = HalfTurns::from_radians(libm::acos(1.0 - cap * random.uniform()));
        last * attitude(none, none, tilt) * first
    };
    (0..case.attitudes).map(&mut next).collect()
}

/// What the comparator says of every attitude. They do not follow from each other, so that nothing
/// could be tracked from one to the next.
const UPRIGHT: i8 = 1;

/// What the chip did.
struct Run {
    codes: Vec<u16>,
    frames: Vec<Vec<u8>>,
}

/// The board: a voltage at each of four pins, a line at the transmitter.
struct Board<'a> {
    /// Ideal bipolar codes of each solution, by channel.
    codes: &'a [[f64; CHANNELS]],
    conversions: usize,
    noise_lsb: [f64; 2],
    noise: Random,
    run: Run,
    message: Vec<u8>,
}

impl Environment for Board<'_> {
    fn analog(&mut self, _: u64, input: AnalogInput) -> f64 {
        let pin = match input {
            AnalogInput::Pin(pin) => pin,
            // The comparator's inputs: under mid supply is upright.
            AnalogInput::Ain1 => return cardan_spec::REFERENCE_V / 2.0,
            _ => return 0.0,
        };
        let channel = usize::from(pin);
        let solution = self.run.codes.len().saturating_sub(WARM_UP) / self.conversions;
        let last = self.codes.len().saturating_sub(1);
        let Some(code) = self
            .codes
            .get(solution.min(last))
            .and_then(|c| c.get(channel))
        else {
            return 0.0;
        };
        let is_field = channel >= Channel::FieldX as usize;
        let noise = self.noise_lsb[usize::from(is_field)] * self.noise.normal();
        // Code n covers n to n + 1 steps.
        (code + noise + f64::from(AdcCode::CENTRE) + 0.5) * LSB_V
    }

    fn conversion(&mut self, event: Conversion) {
        self.run.codes.push(event.code);
    }

    fn uart_tx(&mut self, _: u64, byte: u8) {
        self.message.push(byte);
        if byte == frame::DELIMITER {
            self.run.frames.push(std::mem::take(&mut self.message));
        }
    }

    fn stop_requested(&self) -> bool {
        self.run.frames.len() >= self.codes.len()
    }
}

fn emulate(case: &Case, settings: &Settings, codes: &[[f64; CHANNELS]]) -> Result<Run, String> {
    let image = Application.bundled(false).ok_or("no bundled image")?;
    let firmware = Firmware::parse("plain.elf", image).map_err(|error| error.to_string())?;
    let mut machine = Machine::new(&ATMEGA328P, CPU_HZ);
    machine.load(&firmware.image);
    machine.eeprom_mut()[..LEN].copy_from_slice(&settings.image());
    let mut board = Board {
        codes,
        conversions: settings.averaging.conversions(),
        noise_lsb: case.noise_lsb,
        noise: Random::new(case.seed, Source::Converter),
        run: Run {
            codes: Vec::new(),
            frames: Vec::new(),
        },
        message: Vec::new(),
    };
    let limit = WARM_UP_BLOCKS as u64 * BLOCK_CYCLES
        + codes.len() as u64 * settings.averaging.cycles()
        + LAST_FRAME_CYCLES;
    match machine.run(&mut board, limit) {
        Stop::Requested => {
            let conversions = WARM_UP + codes.len() * settings.averaging.conversions();
            board.run.codes.truncate(conversions);
            Ok(board.run)
        }
        other => Err(format!(
            "plain.elf: the image did not send all frames: {other:?}"
        )),
    }
}

/// Frames of the native firmware.
fn native(settings: &Settings, codes: &[u16]) -> Vec<Vec<u8>> {
    let m = Deployed::new(Silent);
    let mut decimator = Decimator::new(&m, settings.averaging);
    let mut solver = Solver::new(Silent, settings);
    let mut solve = |code: &u16| {
        let averages = decimator.push(&m, AdcCode(*code))?;
        Some(solver.solve(&averages, UPRIGHT).encode().to_vec())
    };
    codes.iter().filter_map(&mut solve).collect()
}

/// Attitudes of the models in f64.
struct Models {
    golden: Vec<Attitude>,
    set_1: Vec<Attitude>,
    set_2: Vec<Attitude>,
    likelihood: Vec<Attitude>,
    bound_rms: f64,
}

impl Models {
    fn of(
        case: &Case,
        settings: &Settings,
        calibration: &Calibration,
        codes: &[u16],
        truths: &[Attitude],
    ) -> Self {
        let mut golden = Golden::with_averaging(calibration, settings.averaging);
        golden.third_tilt(Some(false));
        let mut models = Self {
            golden: Vec::new(),
            set_1: Vec::new(),
            set_2: Vec::new(),
            likelihood: Vec::new(),
            bound_rms: 0.0,
        };
        let earth = EarthField::from(calibration);
        let noise = reading_noise(case, calibration);
        let mut nodes = [0.0; cardan_spec::nodes::SHARED.len()];
        for (at, code) in codes.iter().enumerate() {
            let code = AdcCode(*code);
            let channel = Channel::ALL[at % CHANNELS];
            let solved = golden.convert(
                channel,
                code.bipolar().into(),
                code.is_clipped(),
                &mut |node, value| {
                    nodes[node] = value;
                },
            );
            let Some(solution) = solved else { continue };
            let with = |yaw: f64| attitude(HalfTurns(yaw), solution.pitch, solution.roll);
            let readings = cardan_golden::Readings {
                tilt: [nodes[node::TILT_X], nodes[node::TILT_Y]],
                field: [nodes[node::FIELD_X], nodes[node::FIELD_Y]],
            };
            let likely = maximum_likelihood(&readings, earth, noise, &solution.attitude);
            models.golden.push(solution.attitude);
            models.set_1.push(with(nodes[node::YAW_1]));
            models.set_2.push(with(nodes[node::YAW_2]));
            models.likelihood.push(likely.attitude);
        }
        let bounds = truths
            .iter()
            .filter_map(|truth| cramer_rao(earth, noise, truth));
        let mean = bounds.sum::<f64>() / truths.len().max(1) as f64;
        models.bound_rms = mean.sqrt().to_degrees();
        models
    }
}

/// Noise of an average: that of a conversion and the converter's steps (1/12), independent.
fn reading_noise(case: &Case, calibration: &Calibration) -> Noise {
    let average = |lsb: f64| ((lsb * lsb + 1.0 / 12.0) / case.averaging as f64).sqrt();
    let full_scale = f64::from(AdcCode::CENTRE);
    Noise {
        tilt: average(case.noise_lsb[0]) / full_scale * calibration.tilt_matrix[0][0].abs(),
        field: average(case.noise_lsb[1]) / full_scale * calibration.field_matrix[0][0].abs(),
    }
}

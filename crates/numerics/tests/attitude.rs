//! The firmware's whole attitude algorithm: mixed with the deployed formats equals the deployed
//! firmware in every node and bit; real equals the truth to the algorithm's own error.

use cardan_datapath::{Arithmetic, Deployed, Node, Overflow, Value};
use cardan_firmware::attitude::{State, solve};
use cardan_firmware::averaging::{Averages, Decimator};
use cardan_firmware::calibration::{Calibration, NOMINAL};
use cardan_firmware::nodes::{Average, NODE_COUNT, NODES, Pitch, Roll, Yaw};
use cardan_numerics::{
    Algorithm, DeployedRecorder, Formats, Mixed, Number, Recorder, Recording, record,
};
use cardan_spec::calibration::WORDS;
use cardan_spec::timing::{Averaging, BLOCK_ROUNDS};
use cardan_spec::{CHANNELS, FIELD_FULL_SCALE_UT, TILT_FULL_SCALE_G, ThirdTilt, flags};
use cardan_units::AdcCode;
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

/// The algorithm over a run of conversions; the status of each solution.
struct Attitude<'a> {
    words: &'a [i32; WORDS],
    codes: &'a [AdcCode],
    averaging: Averaging,
    third_tilt: ThirdTilt,
    /// What a comparator tells, from solution to solution and over again.
    signs: &'a [i8],
}

impl Algorithm for Attitude<'_> {
    type Output = Vec<u16>;
    fn run<M: Arithmetic>(&self, m: &M) -> Vec<u16> {
        let calibration = Calibration::new(m, self.words, self.third_tilt);
        let mut state = State::new(m, self.averaging.with(self.third_tilt));
        let mut decimator = Decimator::new(m, self.averaging.with(self.third_tilt));
        let mut signs = self.signs.iter().cycle();
        let mut step = |code: &AdcCode| {
            let averages = decimator.push(m, *code)?;
            let sign = signs.next().copied().unwrap_or(0);
            solve(m, &calibration, &mut state, &averages, sign);
            Some(m.take_status())
        };
        self.codes.iter().filter_map(&mut step).collect()
    }
}

fn deployed(algorithm: &impl Algorithm<Output = Vec<u16>>) -> (Vec<u16>, Recording) {
    let m = Deployed::new(DeployedRecorder::new(NODE_COUNT));
    let status = algorithm.run(&m);
    (status, m.tap().take())
}

/// The codes of some solutions, behind the warm-up.
fn with_warm_up(
    third_tilt: ThirdTilt,
    solutions: impl IntoIterator<Item = AdcCode>,
) -> Vec<AdcCode> {
    let warm_up = Averaging::DEFAULT.with(third_tilt).warm_up_conversions();
    let start = std::iter::repeat_n(AdcCode(512), warm_up);
    start.chain(solutions).collect()
}

fn assert_equal(algorithm: &impl Algorithm<Output = Vec<u16>>) -> Recording {
    let (expected_status, expected) = deployed(algorithm);
    let (status, found) = record(algorithm, &Formats::deployed(&NODES).unwrap());
    assert_eq!(status, expected_status);
    for (index, node) in NODES.iter().enumerate() {
        assert_eq!(found.raws[index], expected.raws[index], "{}", node.name);
        assert_eq!(
            found.overflows[index], expected.overflows[index],
            "{}",
            node.name
        );
        let real = |raw: &i64| node.format.real(*raw);
        assert!(
            found.raws[index]
                .iter()
                .map(real)
                .eq(found.values[index].iter().copied())
        );
    }
    found
}

/// A device with its third tilt axis, and codes of it at rest in some attitude and field, or of anything.
fn any_device() -> impl Strategy<Value = (ThirdTilt, Vec<AdcCode>)> {
    proptest::sample::select(&ThirdTilt::ALL)
        .prop_flat_map(|third_tilt| (Just(third_tilt), any_codes(third_tilt.channels())))
}

fn any_codes(channels: usize) -> impl Strategy<Value = Vec<AdcCode>> {
    let count = BLOCK_ROUNDS * channels;
    let still = (proptest::array::uniform5(0u16..1024), 0u16..8).prop_map(move |(base, noise)| {
        let code = |at: usize| base[at % channels] + (at * 7919 % 8) as u16 % (noise + 1);
        (0..count).map(|at| AdcCode(code(at).min(1023))).collect()
    });
    let wild = proptest::collection::vec((0u16..1024).prop_map(AdcCode), count);
    let solution = prop_oneof![4 => still, 1 => wild];
    proptest::collection::vec(solution, 1..6).prop_map(|all: Vec<Vec<AdcCode>>| all.concat())
}

/// Any length, over periods of which some codes hold one.
fn any_averaging() -> impl Strategy<Value = Averaging> {
    let lengths = (4_u8..7).prop_flat_map(|period| (0..=period, Just(period)));
    lengths.prop_map(|(log2, period)| Averaging::new(log2, period).expect("admissible"))
}

fn any_words() -> impl Strategy<Value = [i32; WORDS]> {
    let near = proptest::array::uniform17(-(1i32 << 22)..1 << 22).prop_map(|moves| {
        let mut words = NOMINAL;
        words
            .iter_mut()
            .zip(moves)
            .for_each(|(word, by)| *word += by);
        words
    });
    prop_oneof![
        near,
        Just(NOMINAL),
        proptest::array::uniform17(any::<i32>())
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4000))]

    #[test]
    fn every_node_equals_the_deployed_firmware(
        words in any_words(), (third_tilt, codes) in any_device(), averaging in any_averaging(),
        signs in proptest::collection::vec(-1_i8..=1, 0..5),
    ) {
        let codes = with_warm_up(third_tilt, codes);
        let (words, codes, signs) = (&words, &codes, &signs);
        assert_equal(&Attitude { words, codes, averaging, third_tilt, signs });
    }

    #[test]
    fn a_prefix_quantises_its_nodes_and_no_other((third_tilt, codes) in any_device(), count in 0..=NODE_COUNT) {
        let codes = with_warm_up(third_tilt, codes);
        let averaging = Averaging::DEFAULT;
        let attitude = Attitude { words: &NOMINAL, codes: &codes, averaging, third_tilt, signs: &[-1] };
        let (_, found) = record(&attitude, &Formats::deployed(&NODES).unwrap().prefix(count));
        for index in 0..NODE_COUNT {
            let words = if index < count { found.values[index].len() } else { 0 };
            prop_assert_eq!(found.raws[index].len(), words);
            prop_assert!(found.values[index].iter().all(|value| value.is_finite()));
        }
    }
}

/// Every corner of the sensors' range: clipped codes, zero divisors, negative radicands.
fn corners(third_tilt: ThirdTilt) -> Recording {
    let channels = third_tilt.channels();
    let mut codes = Vec::new();
    for corner in 0..3usize.pow(channels as u32) {
        let code = |at: usize| [0, 512, 1023][corner / 3usize.pow((at % channels) as u32) % 3];
        codes.extend((0..BLOCK_ROUNDS * channels).map(|at| AdcCode(code(at))));
    }
    let codes = with_warm_up(third_tilt, codes);
    assert_equal(&Attitude {
        words: &NOMINAL,
        codes: &codes,
        averaging: Averaging::DEFAULT,
        third_tilt,
        signs: &[-1, 1],
    })
}

#[test]
fn the_corners_of_the_range_equal_the_deployed_firmware() {
    for third_tilt in ThirdTilt::ALL {
        let found = corners(third_tilt);
        let saturated =
            |(node, overflows): (&cardan_datapath::NodeInfo, &cardan_numerics::Overflows)| {
                node.format.overflow == Overflow::Saturate && overflows.count > 0
            };
        assert!(
            NODES.iter().zip(&found.overflows).any(saturated),
            "the corners do overflow"
        );
    }
}

/// Solutions from the averages that ideal sensors and an infinitely fine converter would give.
struct Ideal(Vec<[f64; 3]>);

/// Cosine and sine of the nominal inclination, as the calibration holds them.
fn inclination() -> [f64; 2] {
    [12, 13].map(|word: usize| f64::from(NOMINAL[word]) / f64::from(1 << 28))
}

impl Ideal {
    /// Averages over full scale for an attitude in degrees: set 1's rotation, gravity and field in the
    /// body's x and y.
    fn averages([yaw, pitch, roll]: [f64; 3]) -> [f64; CHANNELS] {
        let [(sy, cy), (sp, cp), (sr, cr)] = [yaw, pitch, roll].map(|degrees| {
            (
                libm::sin(degrees.to_radians()),
                libm::cos(degrees.to_radians()),
            )
        });
        let [h, v] = inclination();
        let x = [cy * cp, sy * cp, -sp];
        let y = [cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr];
        let field = |axis: [f64; 3]| h * axis[0] + v * axis[2];
        let field_gain = f64::from(NOMINAL[8]) / f64::from(1 << 28);
        let tilt_gain = f64::from(NOMINAL[2]) / f64::from(1 << 28);
        let offset = f64::from(NOMINAL[0]) / f64::from(1 << 28);
        [
            x[2] / tilt_gain,
            y[2] / tilt_gain,
            field(x) / field_gain,
            field(y) / field_gain,
        ]
        .map(|share| share + offset)
    }

    /// The third channel's average over full scale.
    fn tilt_z(down: f64) -> f64 {
        let [offset, gain] =
            [15, 16].map(|word: usize| f64::from(NOMINAL[word]) / f64::from(1 << 28));
        down / gain + offset
    }

    /// Gravity along body z.
    fn down([_, pitch, roll]: [f64; 3]) -> f64 {
        libm::cos(pitch.to_radians()) * libm::cos(roll.to_radians())
    }

    /// Yaw, pitch and roll of every solution, in degrees. `disturb` moves the averages of a solution.
    fn solve(&self, disturb: impl FnMut() -> [f64; CHANNELS]) -> Vec<[f64; 3]> {
        self.solve_as(ThirdTilt::Absent, disturb)
    }

    /// The same; with a third tilt axis each from a cold start, and none may be flagged.
    fn solve_as(
        &self,
        third_tilt: ThirdTilt,
        mut disturb: impl FnMut() -> [f64; CHANNELS],
    ) -> Vec<[f64; 3]> {
        let m = Mixed::new(&Formats::real(NODE_COUNT), Recorder::new(NODE_COUNT));
        let calibration = Calibration::new(&m, &NOMINAL, third_tilt);
        let mut state: State<_>;
        for attitude in &self.0 {
            let average = |real: f64| Value::<_, Average>::new(Number { real, raw: None });
            let (ideal, moved) = (Self::averages(*attitude), disturb());
            let down = Self::down(*attitude);
            let share = |channel: usize| match channel {
                0..CHANNELS => ideal[channel] + moved[channel],
                _ => Self::tilt_z(down),
            };
            let averages = Averages {
                values: std::array::from_fn(|channel| average(share(channel))),
                clipped: false,
                late: false,
            };
            // Attitudes jump: each is a device's first, which is taken for upright without a third axis.
            state = State::new(&m, Averaging::DEFAULT.with(third_tilt));
            let admissible = if third_tilt.is_fitted() {
                0
            } else {
                flags::HALF_SPACE
            };
            let sign = if down < 0.0 { -1 } else { 1 };
            solve(&m, &calibration, &mut state, &averages, sign);
            assert_eq!(m.take_status() & !admissible, 0, "{attitude:?}");
        }
        let recording = m.into_observer().into_recording();
        let angle = |node: usize, at: usize| recording.values[node][at] * 180.0;
        (0..self.0.len())
            .map(|at| [Yaw::INDEX, Pitch::INDEX, Roll::INDEX].map(|node| angle(node, at)))
            .collect()
    }
}

#[test]
fn the_nominal_gains_are_the_full_scales() {
    // What `Ideal` assumes of the calibration: diagonal, and equal offsets.
    let real = |word: usize| f64::from(NOMINAL[word]) / f64::from(1 << 28);
    assert!((real(2) + TILT_FULL_SCALE_G).abs() < 1e-8);
    assert!((real(8) - FIELD_FULL_SCALE_UT / 46.812).abs() < 1e-8);
    assert_eq!([real(2), real(8), real(0)], [real(5), real(11), real(6)]);
    assert_eq!([3, 4, 9, 10].map(|word| NOMINAL[word]), [0; 4]);
}

/// Largest error of yaw, pitch and roll in degrees.
fn worst_errors(truth: &[[f64; 3]], found: &[[f64; 3]]) -> [f64; 3] {
    let error = |at: usize, axis: usize| {
        let difference = found[at][axis] - truth[at][axis];
        ((difference + 540.0).rem_euclid(360.0) - 180.0).abs()
    };
    // What is no number is the worst of all, and nothing at all is no result.
    assert!(!truth.is_empty() && truth.len() == found.len());
    let worse = |worst: f64, error: f64| {
        let is_number = !worst.is_nan() && !error.is_nan();
        if is_number {
            worst.max(error)
        } else {
            f64::NAN
        }
    };
    [0, 1, 2].map(|axis| (0..truth.len()).map(|at| error(at, axis)).fold(0.0, worse))
}

/// The firmware leaves it to wrapping nodes that 1 - x and -1 - x are the same angle: where the
/// cosine changes its sign, or the turn ends, two real yaws of nearly the same direction must not be
/// averaged a turn apart.
#[test]
fn noise_moves_the_real_yaw_everywhere_alike() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    // About one code either way.
    let code = 20.0 / (512.0 * 16.0);
    let mut noise = move || [(); CHANNELS].map(|()| code * (f64::from(rng.next_u32() % 3) - 1.0));
    let mut worst_yaw = |yaw: f64| {
        let attitudes = vec![[yaw, 20.0, 30.0]; 200];
        let solved = Ideal(attitudes.clone()).solve(&mut noise);
        worst_errors(&attitudes, &solved)[0]
    };
    let elsewhere = worst_yaw(135.0);
    assert!(elsewhere > 0.1, "the noise is felt");
    for yaw in [0.0, 90.0, 180.0, -90.0, -179.9] {
        assert!(worst_yaw(yaw) < 2.0 * elsewhere, "at {yaw}");
    }
}

#[test]
fn the_real_attitude_is_the_truth_to_the_polynomials_error() {
    let mut attitudes = Vec::new();
    for yaw in (-180..=180).step_by(6) {
        for pitch in (-70..=70).step_by(14) {
            for roll in (-70..=70).step_by(14) {
                // Off the grid, so that no angle is special; yaw passes through half a turn.
                attitudes.push([
                    f64::from(yaw) + 0.013,
                    f64::from(pitch) + 0.17,
                    f64::from(roll) - 0.29,
                ]);
            }
        }
    }
    let solved = Ideal(attitudes.clone()).solve(|| [0.0; CHANNELS]);
    let worst = worst_errors(&attitudes, &solved);
    // Pitch and roll are one inverse sine each, 1.1e-3 degrees; yaw averages two of them.
    for (axis, name) in ["yaw", "pitch", "roll"].iter().enumerate() {
        assert!(worst[axis] < 1.15e-3, "{name}: {:e} degrees", worst[axis]);
        assert!(
            worst[axis] > 1e-5,
            "{name}: {:e} degrees is too good for the polynomial",
            worst[axis]
        );
    }
}

#[test]
fn with_a_third_axis_every_attitude_off_the_horizon_is_right_from_a_cold_start() {
    let mut attitudes = Vec::new();
    for yaw in (-180..180).step_by(10) {
        for pitch in (-70..=70).step_by(10) {
            for roll in (-180..180).step_by(10) {
                let off = |angle: i32, by: f64| f64::from(angle) + by;
                attitudes.push([off(yaw, 0.013), off(pitch, 0.17), off(roll, 0.29)]);
            }
        }
    }
    attitudes.retain(|attitude| Ideal::down(*attitude).powi(2) > 0.031);
    let upside_down = attitudes.iter().filter(|one| Ideal::down(**one) < 0.0);
    assert!(upside_down.count() > attitudes.len() / 3);
    for third_tilt in [ThirdTilt::Comparator, ThirdTilt::Measured] {
        let solved = Ideal(attitudes.clone()).solve_as(third_tilt, || [0.0; CHANNELS]);
        let worst = worst_errors(&attitudes, &solved);
        assert!(worst.iter().all(|&error| error < 1.15e-3), "{worst:?}");
    }
}

//! Estimation against units whose parameters are known.

use cardan_calibrate::{Earth, Error, Estimate, Observation, Working, estimate};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_core::{RngCore, SeedableRng};

const EARTH: Earth = Earth {
    horizontal: 0.509,
    vertical: 0.8608,
};
const WORKING: Working = Working { cos_tilt: 0.5 };

/// A unit: offset and sensitivity to x, y, z of each channel.
#[derive(Clone, Copy, Debug)]
struct Unit {
    offsets: [f64; 4],
    sensitivities: [[f64; 3]; 4],
    noise: f64,
}

fn normal(random: &mut ChaCha8Rng) -> f64 {
    let uniform = |random: &mut ChaCha8Rng| (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
    let (u, v) = (1.0 - uniform(random), uniform(random));
    (-2.0 * libm::log(u)).sqrt() * libm::cos(2.0 * std::f64::consts::PI * v)
}

/// A random rotation's columns north and down, as vectors along body axes.
fn random_attitude(random: &mut ChaCha8Rng) -> ([f64; 3], [f64; 3]) {
    let q: [f64; 4] = std::array::from_fn(|_| normal(random));
    let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    let [w, x, y, z] = q.map(|value| value / length);
    let north = [
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
    ];
    let down = [
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    ];
    (north, down)
}

fn observe(
    unit: &Unit,
    (north, down): ([f64; 3], [f64; 3]),
    random: &mut ChaCha8Rng,
) -> Observation {
    let field: [f64; 3] =
        std::array::from_fn(|i| EARTH.horizontal * north[i] + EARTH.vertical * down[i]);
    let averages = std::array::from_fn(|channel| {
        let vector = if channel < 2 { down } else { field };
        let felt: f64 = (0..3)
            .map(|i| unit.sensitivities[channel][i] * vector[i])
            .sum();
        unit.offsets[channel] + felt + unit.noise * normal(random)
    });
    Observation {
        averages,
        tilt_z: None,
        gravity: down,
        field,
    }
}

fn observations(unit: &Unit, count: usize, seed: u64) -> Vec<Observation> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    (0..count)
        .map(|_| {
            let attitude = random_attitude(&mut random);
            observe(unit, attitude, &mut random)
        })
        .collect()
}

/// The readings that the estimate makes of averages.
fn readings(estimate: &Estimate, averages: &[f64; 4]) -> [f64; 4] {
    let c = &estimate.calibration;
    let pair = |a: [f64; 2], offset: [f64; 2], m: [[f64; 2]; 2]| {
        [0, 1].map(|k| m[k][0] * (a[0] - offset[0]) + m[k][1] * (a[1] - offset[1]))
    };
    let tilt = pair([averages[0], averages[1]], c.tilt_offset, c.tilt_matrix);
    let field = pair([averages[2], averages[3]], c.field_offset, c.field_matrix);
    [tilt[0], tilt[1], field[0], field[1]]
}

fn unit(noise: f64, z: f64) -> impl Strategy<Value = Unit> {
    let offsets = prop::array::uniform4(-0.1..0.1);
    let own = prop::array::uniform4(0.6..1.0);
    let cross = prop::array::uniform4(-0.1..0.1);
    let to_z = prop::array::uniform4(-z..=z);
    (offsets, own, cross, to_z).prop_map(move |(offsets, own, cross, to_z)| {
        let row = |channel: usize| {
            let sign = if channel < 2 { -1.0 } else { 1.0 };
            let (own, cross) = (sign * own[channel], cross[channel]);
            let [x, y] = if channel.is_multiple_of(2) {
                [own, cross]
            } else {
                [cross, own]
            };
            [x, y, to_z[channel]]
        };
        Unit {
            offsets,
            sensitivities: [0, 1, 2, 3].map(row),
            noise,
        }
    })
}

/// Each value of the image without the field's direction: true ones, estimated ones, errors.
fn compare(unit: &Unit, estimate: &Estimate) -> Vec<(f64, f64, f64)> {
    let mean_gravity = (1.0 + WORKING.cos_tilt) / 2.0;
    let means = [1.0, 1.0, EARTH.vertical, EARTH.vertical].map(|share| share * mean_gravity);
    let offset = |c: usize| unit.offsets[c] + unit.sensitivities[c][2] * means[c];
    let inverse = |c: usize| {
        let ([a, b, _], [p, q, _]) = (unit.sensitivities[c], unit.sensitivities[c + 1]);
        let det = a * q - b * p;
        [q / det, -b / det, -p / det, a / det]
    };
    let (tilt, field) = (inverse(0), inverse(2));
    let truth = [
        &[offset(0), offset(1)][..],
        &tilt,
        &[offset(2), offset(3)],
        &field,
    ]
    .concat();
    let found = estimate.calibration.to_values();
    let errors = estimate.standard_errors.to_values();
    truth
        .into_iter()
        .zip(found)
        .zip(errors)
        .map(|((truth, found), error)| (truth, found, error))
        .collect()
}

proptest! {
    #[test]
    fn without_noise_a_unit_is_recovered_exactly(unit in unit(0.0, 0.05), seed: u64) {
        let seen = observations(&unit, 24, seed);
        let estimate = estimate(&seen, EARTH, WORKING).unwrap();
        for (truth, found, error) in compare(&unit, &estimate) {
            prop_assert!((truth - found).abs() < 1e-11, "{truth} {found}");
            prop_assert!(error < 1e-11);
        }
        for fit in [&estimate.tilt, &estimate.field] {
            prop_assert!(fit.residuals.iter().all(|r| r.max < 1e-13));
        }
    }

    #[test]
    fn without_noise_and_z_every_reading_is_exact(unit in unit(0.0, 0.0), seed: u64) {
        let estimate = estimate(&observations(&unit, 12, seed), EARTH, WORKING).unwrap();
        for seen in observations(&unit, 20, seed ^ 1) {
            let truth = [seen.gravity[0], seen.gravity[1], seen.field[0], seen.field[1]];
            for (read, truth) in readings(&estimate, &seen.averages).into_iter().zip(truth) {
                prop_assert!((read - truth).abs() < 1e-11);
            }
        }
    }

    // Student's t with 20 degrees of freedom exceeds 9 once in 10^8.
    #[test]
    fn with_noise_every_value_is_within_its_standard_errors(unit in unit(1e-3, 0.02), seed: u64) {
        let estimate = estimate(&observations(&unit, 24, seed), EARTH, WORKING).unwrap();
        for (truth, found, error) in compare(&unit, &estimate) {
            prop_assert!((truth - found).abs() < 9.0 * error, "{truth} {found} {error}");
        }
    }
}

#[test]
fn standard_errors_are_as_large_as_the_errors_on_average() {
    let unit = Unit {
        offsets: [0.02, -0.04, 0.01, 0.03],
        sensitivities: [
            [-0.8, 0.02, 0.01],
            [0.01, -0.75, 0.02],
            [0.78, 0.01, 0.02],
            [0.02, 0.8, 0.01],
        ],
        noise: 1e-3,
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for seed in 0..400 {
        let estimate = estimate(&observations(&unit, 24, seed), EARTH, WORKING).unwrap();
        for (truth, found, error) in compare(&unit, &estimate) {
            sum += (truth - found) * (truth - found) / (error * error);
            count += 1.0;
        }
    }
    // The variance of Student's t with 20 degrees of freedom; 4,800 values, 12 at a time dependent.
    let expected = 20.0 / 18.0;
    let found: f64 = sum / count;
    assert!((found - expected).abs() < 0.1, "{found}");
}

#[test]
fn what_a_sensitivity_to_z_leaves_is_what_is_announced() {
    let unit = Unit {
        offsets: [0.0; 4],
        sensitivities: [
            [-0.8, 0.0, 0.03],
            [0.0, -0.8, 0.0],
            [0.75, 0.0, 0.0],
            [0.0, 0.75, 0.04],
        ],
        noise: 0.0,
    };
    let estimate = estimate(&observations(&unit, 24, 7), EARTH, WORKING).unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let (mut squares, mut count) = ([0.0; 2], 0.0);
    while count < 40_000.0 {
        let attitude = random_attitude(&mut random);
        if attitude.1[2] < WORKING.cos_tilt {
            continue;
        }
        let seen = observe(&unit, attitude, &mut random);
        let read = readings(&estimate, &seen.averages);
        let truth = [
            seen.gravity[0],
            seen.gravity[1],
            seen.field[0],
            seen.field[1],
        ];
        for (i, square) in squares.iter_mut().enumerate() {
            let (x, y) = (
                read[2 * i] - truth[2 * i],
                read[2 * i + 1] - truth[2 * i + 1],
            );
            *square += x * x + y * y;
        }
        count += 1.0;
    }
    for (square, announced) in squares
        .into_iter()
        .zip([estimate.tilt.z_left_rms, estimate.field.z_left_rms])
    {
        let found: f64 = (square / count).sqrt();
        assert!(
            (found / announced - 1.0).abs() < 0.02,
            "{found} {announced}"
        );
    }
}

/// Attitudes whose gravity has been changed by `squeeze`.
fn squeezed(squeeze: impl Fn([f64; 3]) -> [f64; 3]) -> Vec<Observation> {
    let unit = Unit {
        offsets: [0.0; 4],
        sensitivities: [
            [-0.8, 0.0, 0.0],
            [0.0, -0.8, 0.0],
            [0.75, 0.0, 0.0],
            [0.0, 0.75, 0.0],
        ],
        noise: 1e-4,
    };
    let mut seen = observations(&unit, 20, 3);
    for observation in &mut seen {
        observation.gravity = squeeze(observation.gravity);
    }
    seen
}

#[test]
fn attitudes_that_leave_something_open_are_refused_with_its_name() {
    type Squeeze = fn([f64; 3]) -> [f64; 3];
    let cases: [(Squeeze, &str); 4] = [
        (|v| [0.1, v[1], v[2]], "body x stays within 0.10 to 0.10"),
        (|v| [v[0], 1e-3 * v[1], v[2]], "body y stays within"),
        (|v| [v[0], v[1], 0.9], "body z stays within 0.90 to 0.90"),
        (|v| [v[0], v[0], v[2]], "body x and y"),
    ];
    for (squeeze, named) in cases {
        let error = estimate(&squeezed(squeeze), EARTH, WORKING).unwrap_err();
        let message = error.to_string();
        assert!(message.contains("gravity along"), "{message}");
        assert!(message.contains(named), "{message}");
    }
}

#[test]
fn an_upright_cone_is_enough() {
    let all = squeezed(|v| v);
    let mut upright = all.clone();
    for observation in &mut upright {
        let [x, y, z] = observation.gravity;
        observation.gravity = [0.87 * x, 0.87 * y, 0.75 + 0.25 * z];
    }
    let (sphere, cone) = (
        estimate(&all, EARTH, WORKING).unwrap(),
        estimate(&upright, EARTH, WORKING).unwrap(),
    );
    assert!(sphere.tilt.condition < 3.0, "{}", sphere.tilt.condition);
    assert!(cone.tilt.condition > 2.0 * sphere.tilt.condition);
}

#[test]
fn too_few_attitudes_and_dead_channels_are_refused() {
    let seen = squeezed(|v| v);
    let few = estimate(&seen[..5], EARTH, WORKING).unwrap_err();
    assert_eq!(few, Error::TooFew { found: 5, least: 6 });
    let mut dead = seen.clone();
    for observation in &mut dead {
        observation.averages[3] = 0.25;
    }
    let error = estimate(&dead, EARTH, WORKING).unwrap_err().to_string();
    assert!(
        error.contains("the field") && error.contains("dead"),
        "{error}"
    );
    let mut weak = seen;
    for observation in &mut weak {
        observation.averages = observation.averages.map(|a| 0.1 * a);
    }
    let error = estimate(&weak, EARTH, WORKING).unwrap_err();
    assert!(matches!(error, Error::OutOfRange { .. }), "{error}");
}

#[test]
fn a_third_axis_is_estimated_within_its_standard_errors_where_every_observation_has_it() {
    let unit = Unit {
        offsets: [0.01, -0.02, 0.0, 0.03],
        sensitivities: [
            [-0.8, 0.0, 0.0],
            [0.0, -0.8, 0.0],
            [0.7, 0.0, 0.0],
            [0.0, 0.7, 0.0],
        ],
        noise: 1e-4,
    };
    let (offset, to_x, to_y, to_z) = (0.021, 0.008, -0.004, -0.79);
    let mut random = ChaCha8Rng::seed_from_u64(11);
    let with_third = |mut one: Observation| {
        let [x, y, z] = one.gravity;
        let felt = to_x * x + to_y * y + to_z * z;
        one.tilt_z = Some(offset + felt + 1e-4 * normal(&mut random));
        one
    };
    let mut all: Vec<Observation> = observations(&unit, 400, 5)
        .into_iter()
        .map(with_third)
        .collect();
    let found = estimate(&all, EARTH, WORKING).expect("a good unit");
    let (values, errors) = (found.calibration, found.standard_errors);
    let off = |value: f64, truth: f64, error: f64| (value - truth).abs() / error;
    assert!(errors.tilt_z_offset > 0.0 && errors.tilt_z_gain > 0.0);
    assert!(off(values.tilt_z_offset, offset, errors.tilt_z_offset) < 4.0);
    assert!(off(values.tilt_z_gain, 1.0 / to_z, errors.tilt_z_gain) < 4.0);
    let quality = found.tilt_z.expect("is measured");
    // Uniform on the cone of 60 degrees: x's mean square is (1 - 7/12) / 2.
    let cross = (to_x * to_x + to_y * to_y).sqrt() * (5.0_f64 / 24.0).sqrt() / 0.79;
    assert!((quality.cross_left_rms - cross).abs() < 1e-4, "{quality:?}");
    assert!(
        (quality.residuals.rms / 1e-4 - 1.0).abs() < 0.15,
        "{quality:?}"
    );

    // One observation without: it is nobody's third axis, and nothing else changes.
    all[7].tilt_z = None;
    let without = estimate(&all, EARTH, WORKING).expect("a good unit");
    assert_eq!(without.tilt_z, None);
    assert_eq!(without.tilt, found.tilt);
    assert_eq!(without.standard_errors.tilt_z_gain, 0.0);

    for one in &mut all {
        one.tilt_z = Some(0.5 * one.gravity[0]);
    }
    let dead = estimate(&all, EARTH, WORKING).expect_err("along x");
    assert!(matches!(dead, Error::InsensitiveToZ { .. }), "{dead}");
}

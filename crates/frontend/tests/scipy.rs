//! The exact stepping and the noise against scipy, on the same equations written anew in Python.

mod oracle;

use cardan_frontend::design::nominal_edges;
use cardan_frontend::propagate::{Linear, Step};
use cardan_frontend::switching::Edge;
use cardan_frontend::{Design, Frontend, Pin};
use cardan_scenario::random::{Random, Source};
use cardan_scenario::{Experience, Scenario, Stimulus};
use cardan_sensors::{BOLTZMANN, Flicker};
use cardan_spec::timing::CPU_HZ;
use cardan_spec::{Channel, FIELD_FULL_SCALE_UT, TILT_FULL_SCALE_G};
use cardan_units::Cycles;
use serde_json::{Value, json};

const N: usize = 8;

/// The front end's inputs run straight over this many cycles.
const SPAN_CYCLES: u64 = 2000;

fn rows<const R: usize, const C: usize>(columns: &[[f64; R]; C]) -> Vec<Vec<f64>> {
    (0..R)
        .map(|r| columns.iter().map(|c| c[r]).collect())
        .collect()
}

/// A stable system with rates over five decades, and an interval.
fn random_system(random: &mut Random) -> (Linear<N>, f64) {
    let mut a = [[0.0; N]; N];
    for (c, column) in a.iter_mut().enumerate() {
        let rate = libm::exp(11.0 * random.uniform());
        // Couplings that the diagonal dominates keep every eigenvalue in the left half plane.
        for value in column.iter_mut() {
            *value = rate * 0.12 * (2.0 * random.uniform() - 1.0);
        }
        column[c] = -rate;
    }
    let b = [(); 2].map(|()| [(); N].map(|()| 10.0 * random.normal()));
    let mut w = [[0.0; N]; N];
    for _ in 0..3 {
        let source: [f64; N] = [(); N].map(|()| random.normal());
        for (c, column) in w.iter_mut().enumerate() {
            for (r, value) in column.iter_mut().enumerate() {
                *value += source[c] * source[r];
            }
        }
    }
    (Linear { a, b, w }, 1e-6 + 2e-4 * random.uniform())
}

fn number(value: &Value, r: usize, c: usize) -> f64 {
    value[r][c].as_f64().expect("a number")
}

/// Largest difference between the oracle's matrix and columns of ours, over its largest element.
fn relative_error<const R: usize, const C: usize>(oracle: &Value, ours: &[[f64; R]; C]) -> f64 {
    let (mut errors, mut sizes) = (Vec::new(), Vec::new());
    for (c, column) in ours.iter().enumerate() {
        for (r, value) in column.iter().enumerate() {
            let exact = number(oracle, r, c);
            errors.push(exact - value);
            sizes.push(exact);
        }
    }
    largest(errors) / largest(sizes)
}

/// The largest size; what is no number is larger than all.
fn largest(values: impl IntoIterator<Item = f64>) -> f64 {
    let sizes = values.into_iter().map(f64::abs);
    sizes.max_by(f64::total_cmp).expect("values")
}

#[test]
fn steps_of_random_stable_systems_agree_with_scipy() {
    let mut random = Random::new(1, Source::Motion);
    let systems: Vec<_> = (0..200).map(|_| random_system(&mut random)).collect();
    let cases: Vec<Value> = systems
        .iter()
        .map(|(s, h)| json!({"a": rows(&s.a), "b": rows(&s.b), "w": rows(&s.w), "h": h}))
        .collect();
    let answers = oracle::ask(&json!({"task": "steps", "cases": cases}));
    let answers = answers.as_array().expect("a list");
    assert_eq!(answers.len(), systems.len());
    let errors: Vec<[f64; 3]> = (systems.iter().zip(answers))
        .map(|((system, h), answer)| {
            let step = Step::over(system, *h);
            [
                relative_error(&answer["phi"], &step.phi),
                relative_error(&answer["gamma"], &[step.gamma[0], step.gamma[1]]),
                relative_error(&answer["q"], &step.q),
            ]
        })
        .collect();
    let worst = [0, 1, 2].map(|part| largest(errors.iter().map(|error| error[part])));
    println!("largest relative errors of phi, gamma, q: {worst:?}");
    // Van Loan's block matrix itself loses digits to exp(-A h) with |A| h up to 12.
    assert!(
        worst[0] < 1e-12 && worst[1] < 1e-12 && worst[2] < 1e-9,
        "{worst:?}"
    );
}

/// Force along body y over that along x.
const FORCE_Y: f64 = -0.6;

/// Force and field along body x as a sine, and a force in proportion along y.
#[derive(Clone, Copy)]
struct Sine {
    offset: f64,
    amplitude: f64,
    hz: f64,
}

impl Stimulus for Sine {
    fn at(&self, t_s: f64) -> Experience {
        let turn = 2.0 * std::f64::consts::PI;
        let value = self.offset + self.amplitude * libm::sin(turn * self.hz * t_s);
        Experience {
            specific_force_g: [value, FORCE_Y * value, 0.0],
            field_ut: [value, 0.0, 0.0],
            ..Experience::default()
        }
    }
}

/// Largest difference in volts between board and oracle at `reads`, under `edges`, and largest signal.
/// Of the tilt channels y is read at every third only, so that it lags behind.
fn difference(
    kind: &str,
    input: Sine,
    edges: &[Edge],
    reads: &[u64],
    continuous: bool,
) -> (f64, f64) {
    let mut scenario = Scenario::default();
    scenario.noise.enabled = false;
    let request = request(&scenario, kind, input, edges, reads, continuous);
    let answer = oracle::ask(&request);
    let channels: &[Channel] = match kind {
        "tilt" => &[Channel::TiltX, Channel::TiltY],
        _ => &[Channel::FieldX],
    };
    let mut board = Frontend::new(&scenario, 1, input).expect("a working design");
    let mut pending = edges.iter().peekable();
    let answer = answer.as_array().expect("a list");
    assert_eq!(answer.len(), reads.len());
    let (mut errors, mut signals) = (Vec::new(), [Vec::new(), Vec::new()]);
    for (number, (read, exact)) in reads.iter().zip(answer).enumerate() {
        while let Some(edge) = pending.next_if(|edge| edge.cycle <= *read) {
            board
                .pin_edge(Cycles(edge.cycle), edge.pin, edge.high)
                .expect("in order");
        }
        for (index, channel) in channels.iter().enumerate() {
            if index == 1 && number % 3 != 0 {
                continue;
            }
            let found = board.voltage(Cycles(*read), *channel).expect("in order").0;
            errors.push(found - exact[index].as_f64().expect("a number"));
            signals[index].push(found - 2.5);
        }
    }
    let signals = signals.into_iter().take(channels.len()).map(largest);
    (
        largest(errors),
        signals.min_by(f64::total_cmp).expect("a channel"),
    )
}

fn request(
    scenario: &Scenario,
    kind: &str,
    input: Sine,
    edges: &[Edge],
    reads: &[u64],
    continuous: bool,
) -> Value {
    let design = Design::new(scenario).expect("a working design");
    let (f, s) = (&scenario.frontend, &scenario.sensors);
    let (chain, sensitivity_v) = match kind {
        "tilt" => (design.tilt, s.accelerometer.sensitivity_mv_per_g * 1e-3),
        _ => (design.field, s.magnetometer.sensitivity_uv_per_ut * 1e-6),
    };
    let edges: Vec<Value> = edges
        .iter()
        .map(|e| json!([e.cycle, format!("{:?}", e.pin), e.high]))
        .collect();
    json!({
        "task": "chain", "kind": kind, "cpu_hz": CPU_HZ, "span_cycles": SPAN_CYCLES, "continuous": continuous,
        "reads": reads, "edges": edges, "input": [input.offset, input.amplitude, input.hz],
        "convection_hz": s.accelerometer.convection_bandwidth_hz,
        "detector_hz": s.accelerometer.detector_bandwidth_hz,
        "resonance_hz": s.magnetometer.resonance_hz, "quality": s.magnetometer.quality,
        "sensitivity_v": sensitivity_v, "lna_gain": f.lna_gain,
        "band_pass_gain": chain.band_pass_gain, "low_pass_hz": chain.low_pass_hz,
        "band_pass_hz": f.band_pass_hz, "band_pass_quality": f.band_pass_quality,
        "hold_f": f.hold_pf * 1e-12, "switch_ohm": f.switch_ohm, "leak_ohm": f.leak_ohm,
        "aperture_cycles": f.aperture_cycles as u64, "output_gain": f.output_gain,
        "force_y": FORCE_Y,
    })
}

fn full_scale(kind: &str) -> f64 {
    if kind == "tilt" {
        TILT_FULL_SCALE_G
    } else {
        FIELD_FULL_SCALE_UT
    }
}

/// Carrier and strobe as designed, and a multiplexer that gives each tilt channel a fifth of its time
/// to settle and much of its neighbour with it; each edge is displaced at random by up to `jitter`.
fn jittered_edges(end: u64, jitter: u64) -> Vec<Edge> {
    const TURN: u64 = 4_000;
    let mut random = Random::new(5, Source::Motion);
    let fast = nominal_edges()
        .take_while(|edge| edge.cycle <= end)
        .filter(|edge| matches!(edge.pin, Pin::Carrier | Pin::Strobe));
    let every_turn = |first: u64, pin: Pin| {
        (0..end / TURN).map(move |number| Edge {
            cycle: first + number * TURN,
            pin,
            high: number % 2 == 0,
        })
    };
    let mut edges: Vec<Edge> = fast
        .chain(every_turn(TURN, Pin::Select))
        .chain(every_turn(2_550, Pin::Settled))
        .map(|edge| {
            let by = (jitter as f64 * random.uniform()) as u64;
            Edge {
                cycle: edge.cycle + by,
                ..edge
            }
        })
        .collect();
    edges.sort_by_key(|edge| edge.cycle);
    edges
}

#[test]
fn chain_and_multiplexed_pair_under_jittered_edges_agree_with_an_integrator_to_1e_9_of_full_scale()
{
    let edges = jittered_edges(60_000, 120);
    let reads: Vec<u64> = (1..=30).map(|k| k * 1_987).collect();
    for kind in ["tilt", "field"] {
        let full = full_scale(kind);
        let input = Sine {
            offset: 0.4 * full,
            amplitude: 0.4 * full,
            hz: 30.0,
        };
        let (worst, signal) = difference(kind, input, &edges, &reads, false);
        assert!(signal > 0.05, "{kind}: nothing to compare, {signal} V");
        println!("{kind}: {worst:e} V");
        assert!(worst < 2.5e-9, "{kind}: {worst:e} V");
    }
}

#[test]
fn straight_inputs_between_exact_values_cost_at_most_a_microvolt() {
    let edges: Vec<Edge> = nominal_edges()
        .take_while(|edge| edge.cycle <= 320_000)
        .collect();
    let reads: Vec<u64> = (1..=40).map(|k| k * 8_000 - 741).collect();
    let inputs = [
        (
            "tilt",
            Sine {
                offset: 0.6,
                amplitude: 0.5,
                hz: 1.0,
            },
        ),
        (
            "field",
            Sine {
                offset: 20.0,
                amplitude: 30.0,
                hz: 1.0,
            },
        ),
    ];
    for (kind, input) in inputs {
        let (worst, signal) = difference(kind, input, &edges, &reads, true);
        assert!(signal > 0.5, "{kind}: nothing to compare, {signal} V");
        println!("{kind}: {worst:e} V");
        assert!(worst < 1e-6, "{kind}: {worst:e} V");
    }
}

/// Samples of a channel at rest, one per carrier period, in its input's unit.
fn samples(scenario: &Scenario, channel: Channel, full_scale: f64, count: u64) -> Vec<f64> {
    let rest = Sine {
        offset: 0.0,
        amplitude: 0.0,
        hz: 1.0,
    };
    let mut board = Frontend::new(scenario, 3, rest).expect("a working design");
    let mut out = Vec::new();
    let mut edges = nominal_edges().peekable();
    for period in 0..count {
        while let Some(edge) = edges.next_if(|edge| edge.cycle <= 1000 * (period + 1)) {
            board
                .pin_edge(Cycles(edge.cycle), edge.pin, edge.high)
                .expect("in order");
        }
        let volts = board
            .voltage(Cycles(1000 * (period + 1)), channel)
            .expect("in order")
            .0;
        out.push((volts / 2.5 - 1.0) * full_scale);
    }
    out.split_off(out.len() / 20)
}

/// Densities by Welch's method over `bands` for samples at the carrier's rate.
fn densities(samples: &[f64], bands: &[[f64; 2]]) -> Vec<f64> {
    let request = json!({
        "task": "welch", "samples": samples, "rate_hz": 16_000.0, "segment": 1 << 16, "bands": bands,
    });
    let answer = oracle::ask(&request);
    answer
        .as_array()
        .expect("a list")
        .iter()
        .map(|v| v.as_f64().expect("a number"))
        .collect()
}

const BANDS: [[f64; 2]; 4] = [[2.0, 8.0], [8.0, 20.0], [20.0, 40.0], [40.0, 80.0]];
/// 60 seconds: at least 14 segments of 6 Hz at 0.24 Hz: 4 % standard error in the lowest band.
const SAMPLES: u64 = 960_000;

fn lag(f: f64, corner_hz: f64) -> f64 {
    1.0 / (1.0 + (f / corner_hz) * (f / corner_hz)).sqrt()
}

fn butterworth(f: f64, corner_hz: f64) -> f64 {
    let r = (f / corner_hz) * (f / corner_hz);
    1.0 / (1.0 + r * r).sqrt()
}

/// Root of the mean square of `density` over a band.
fn band_mean(band: [f64; 2], density: impl Fn(f64) -> f64) -> f64 {
    let n = 200;
    let at = |k: u32| band[0] + (band[1] - band[0]) * (f64::from(k) + 0.5) / f64::from(n);
    ((0..n).map(|k| density(at(k)) * density(at(k))).sum::<f64>() / f64::from(n)).sqrt()
}

/// Allan deviation of samples over averages of `length`.
fn allan_deviation(samples: &[f64], length: usize) -> f64 {
    let mean = |window: &[f64]| window.iter().sum::<f64>() / length as f64;
    let means: Vec<f64> = samples.chunks_exact(length).map(mean).collect();
    let squares: f64 = means
        .windows(2)
        .map(|w| (w[1] - w[0]) * (w[1] - w[0]))
        .sum();
    (squares / (2.0 * (means.len() - 1) as f64)).sqrt()
}

/// Allan deviation that a one-sided density has over averages of `tau_s`:
/// sqrt(2 int S sin^4(pi f tau) / (pi f tau)^2 df).
fn allan_theory(tau_s: f64, density: impl Fn(f64) -> f64) -> f64 {
    let step = 0.01 / tau_s;
    let at = |k: u32| {
        let f = step * (f64::from(k) + 0.5);
        let x = std::f64::consts::PI * f * tau_s;
        let window = libm::sin(x) * libm::sin(x) / x;
        density(f) * density(f) * window * window
    };
    (2.0 * step * (0..100_000).map(at).sum::<f64>()).sqrt()
}

fn check_densities(kind: &str, found: &[f64], theory: impl Fn(f64) -> f64) {
    assert_eq!(found.len(), BANDS.len());
    for (band, found) in BANDS.iter().zip(found) {
        let ratio = found / band_mean(*band, &theory);
        println!("{kind} {band:?} Hz: {found:.4e} per rtHz, {ratio:.3} of theory");
        assert!((0.9..1.1).contains(&ratio), "{kind} {band:?}: {ratio}");
    }
}

/// Input-referred density of white noise at the first amplifier: demodulation by a pair of samples
/// per period keeps the part in phase, sqrt(2) of the density, of a signal whose amplitude is the
/// fundamental of a square wave, 4/pi.
fn electronic_density(ohm: f64, sensitivity_v: f64) -> f64 {
    let f = &Scenario::default().frontend;
    let amplifier = f.lna_noise_nv_per_rthz * 1e-9;
    let flicker = 1.0 + f.lna_flicker_corner_hz / f.band_pass_hz;
    let bridge = 4.0 * BOLTZMANN * 293.15 * ohm;
    let density = (amplifier * amplifier * flicker + bridge).sqrt();
    density * std::f64::consts::SQRT_2 * std::f64::consts::FRAC_PI_4 / sensitivity_v
}

/// Density of a tilt channel's electronic noise over what one pair of samples per carrier period would
/// have: what the hold capacitors carry from turn to turn folds the band-pass's whole width to low
/// frequencies. Sample k of a turn counts for the time until the next of its sense; samples of a
/// turn are correlated by the band-pass's envelope, those of different turns not at all.
fn folding() -> f64 {
    use cardan_spec::timing::{HALF_CARRIER_CYCLES, TURN_CYCLES};
    let f = &Scenario::default().frontend;
    let period = (2 * TURN_CYCLES) as f64;
    let shortest = HALF_CARRIER_CYCLES as f64 / period;
    // Eight samples: until the next of its sense, two half periods on, or one period later.
    let kept = |k: i32| match k {
        0..=5 => 2.0 * shortest,
        _ => 1.0 - 6.0 * shortest,
    };
    let rate = std::f64::consts::PI * f.band_pass_hz / f.band_pass_quality;
    let half_s = HALF_CARRIER_CYCLES as f64 / CPU_HZ as f64;
    let correlation = |a: i32, b: i32| f64::exp(-rate * half_s * f64::from((a - b).abs()));
    let sum: f64 = (0..8)
        .flat_map(|a| (0..8).map(move |b| (a, b)))
        .map(|(a, b)| 0.25 * kept(a) * kept(b) * correlation(a, b))
        .sum();
    // Variance rate/2 per density of one; 2 T of it at low frequencies; a pair per period has 2.
    (2.0 * period / CPU_HZ as f64 * 0.5 * rate * sum / 2.0).sqrt()
}

/// A value held for a multiplexer period.
fn held(f: f64) -> f64 {
    let x = std::f64::consts::PI * f * 2e-3;
    libm::sin(x) / x
}

#[test]
fn the_tilt_channels_noise_has_the_density_of_sensor_bridge_and_amplifier() {
    let scenario = Scenario::default();
    let p = &scenario.sensors.accelerometer;
    let samples = samples(&scenario, Channel::TiltX, TILT_FULL_SCALE_G, SAMPLES);
    let white = p.noise_mg_per_rthz * 1e-3;
    let electronic = folding() * electronic_density(p.bridge_ohm, p.sensitivity_mv_per_g * 1e-3);
    println!(
        "electronic noise {electronic:e} g per rtHz, folded by {}",
        folding()
    );
    let theory = |f: f64| {
        let lags = lag(f, p.convection_bandwidth_hz) * lag(f, p.detector_bandwidth_hz);
        let slow = Flicker::density(white, p.flicker_corner_hz, f);
        let sensor = (white * white + slow * slow).sqrt() * lags;
        (sensor * sensor + electronic * electronic).sqrt()
            * held(f)
            * butterworth(f, scenario.frontend.tilt_low_pass_hz)
    };
    check_densities("tilt", &densities(&samples, &BANDS), theory);
    // 57 s hold 228, 114 and 57 differences: 5, 7 and 10 % standard error.
    for tau_s in [0.25, 0.5, 1.0] {
        let found = allan_deviation(&samples, (16_000.0 * tau_s) as usize);
        let ratio = found / allan_theory(tau_s, theory);
        println!("tilt: Allan deviation over {tau_s} s is {found:.3e} g, {ratio:.3} of theory");
        assert!((0.75..1.25).contains(&ratio), "{tau_s} s: {ratio}");
    }
}

#[test]
fn the_field_channels_noise_has_the_density_of_beam_bridge_and_amplifier() {
    let scenario = Scenario::default();
    let p = &scenario.sensors.magnetometer;
    let found = densities(
        &samples(&scenario, Channel::FieldX, FIELD_FULL_SCALE_UT, SAMPLES),
        &BANDS,
    );
    let electronic = electronic_density(p.bridge_ohm, p.sensitivity_uv_per_ut * 1e-6);
    // Force noise around the carrier meets the drive's fundamental as the bridge's noise does.
    let brownian = p.thermomechanical_nt_per_rthz * 1e-3;
    let brownian = brownian * std::f64::consts::SQRT_2 * std::f64::consts::FRAC_PI_4;
    let corner_hz = Design::new(&scenario)
        .expect("a working design")
        .field
        .low_pass_hz;
    check_densities("field", &found, |f| {
        let beam = brownian * lag(f, p.resonance_hz / (2.0 * p.quality));
        (beam * beam + electronic * electronic).sqrt() * butterworth(f, corner_hz)
    });
}

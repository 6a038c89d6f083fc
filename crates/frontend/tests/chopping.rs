//! The noise that the chopping frequency leaves: the exact covariance against the stepped front end, and
//! against closed forms.

use cardan_frontend::Frontend;
use cardan_frontend::chopping::{chopped, unchopped};
use cardan_frontend::design::nominal_edges;
use cardan_scenario::{Experience, Scenario, Stimulus};
use cardan_spec::timing::{ADC_HOLD_CYCLES, CARRIER_HZ, CONVERSION_CYCLES, STROBE_COUNT};
use cardan_spec::{CHANNELS, Channel, REFERENCE_V, TILT_FULL_SCALE_G};
use cardan_units::Cycles;

/// At rest, level, no field.
#[derive(Clone, Debug)]
struct Rest;

impl Stimulus for Rest {
    fn at(&self, _t_s: f64) -> Experience {
        Experience::default()
    }
}

/// The bundled scenario with white noise only.
fn scenario() -> Scenario {
    let mut scenario = Scenario::load("tumble").expect("bundled");
    scenario.sensors.accelerometer.flicker_corner_hz = 0.0;
    scenario
}

fn deviation(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    let squares: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    (squares / (values.len() - 1) as f64).sqrt()
}

#[test]
fn the_covariance_is_that_of_the_stepped_front_end() {
    const ROUNDS: usize = 60_000; // 30 s
    let scenario = scenario();
    let mut frontend = Frontend::new(&scenario, 5, Rest).expect("the bundled board works");
    let round = CHANNELS as u64 * CONVERSION_CYCLES;
    let first = u64::from(STROBE_COUNT) + 1 + ADC_HOLD_CYCLES;
    let mut edges = nominal_edges().peekable();
    let volts: Vec<f64> = (0..ROUNDS as u64)
        .map(|index| {
            let hold = first + index * round;
            while let Some(edge) = edges.next_if(|edge| edge.cycle <= hold) {
                frontend
                    .pin_edge(Cycles(edge.cycle), edge.pin, edge.high)
                    .expect("in order");
            }
            frontend
                .voltage(Cycles(hold), Channel::TiltX)
                .expect("in order")
                .0
        })
        .collect();
    let settled: Vec<f64> = volts[400..]
        .iter()
        .map(|v| v * TILT_FULL_SCALE_G / (0.5 * REFERENCE_V))
        .collect();
    let windows = [0.0, 0.032];
    let exact = chopped(&scenario, CARRIER_HZ as f64, &windows)
        .expect("designed")
        .noise_g;
    let averages: Vec<f64> = settled
        .chunks_exact(64)
        .map(|chunk| chunk.iter().sum::<f64>() / 64.0)
        .collect();
    // Some 3,000 independent values: the deviation is known to 1.3 %.
    for (exact, seen) in exact
        .iter()
        .zip([deviation(&settled), deviation(&averages)])
    {
        assert!((seen / exact - 1.0).abs() < 0.06, "{seen} {exact}");
    }
}

#[test]
fn a_slower_carrier_meets_more_of_the_amplifiers_noise_and_delays_more() {
    let mut scenario = scenario();
    scenario.sensors.accelerometer.noise_mg_per_rthz = 0.0;
    let at = |hz: f64| chopped(&scenario, hz, &[0.032]).expect("designed");
    let (slow, fast) = (at(2_000.0), at(16_000.0));
    // The turns fold the band-pass's width alike at both, so what differs is the amplifier's 1/f noise,
    // 11 % of everything at the band-pass; holding for 16 ms takes some of it off a 50 Hz low-pass.
    let (p, sensor) = (&scenario.frontend, &scenario.sensors.accelerometer);
    let bridge = 4.0 * 1.380_649e-23 * 293.15 * sensor.bridge_ohm;
    let density = |hz: f64| {
        let lna = p.lna_noise_nv_per_rthz * 1e-9;
        lna * lna * (1.0 + p.lna_flicker_corner_hz / hz) + bridge
    };
    let most = (density(2_000.0) / density(16_000.0)).sqrt();
    let ratio = slow.noise_g[0] / fast.noise_g[0];
    assert!(ratio > 1.03 && ratio < most, "{ratio} {most}");
    assert!(slow.design.group_delay_s > fast.design.group_delay_s + 3e-3);
    assert!(fast.design.residue_lsb < 0.1 && slow.design.residue_lsb < 0.1);
}

#[test]
fn without_chopping_white_noise_has_its_closed_form_and_1_over_f_adds_a_logarithm() {
    let mut scenario = scenario();
    scenario.frontend.lna_flicker_corner_hz = 0.0;
    let white = unchopped(&scenario, 1e4, &[0.0])[0];
    let p = &scenario.frontend;
    let sensor = &scenario.sensors.accelerometer;
    let thermal = 4.0 * 1.380_649e-23 * 293.15 * sensor.bridge_ohm;
    let lna = p.lna_noise_nv_per_rthz * 1e-9;
    let density = (lna * lna + thermal).sqrt() / (sensor.sensitivity_mv_per_g * 1e-3);
    // Equivalent noise bandwidth of a second-order Butterworth low-pass.
    let bandwidth = p.tilt_low_pass_hz * std::f64::consts::PI / (2.0 * std::f64::consts::SQRT_2);
    let expected = density * bandwidth.sqrt();
    assert!((white / expected - 1.0).abs() < 1e-3, "{white} {expected}");

    scenario.frontend.lna_flicker_corner_hz = 1000.0;
    let of = |observed: f64| unchopped(&scenario, observed, &[0.0])[0];
    let more = of(1000.0).powi(2) - of(10.0).powi(2);
    let amplifier = lna / (sensor.sensitivity_mv_per_g * 1e-3);
    let expected = amplifier * amplifier * 1000.0 * 100.0_f64.ln();
    assert!((more / expected - 1.0).abs() < 0.02, "{more} {expected}");
}

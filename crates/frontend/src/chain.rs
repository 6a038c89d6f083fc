//! One channel as a linear system: sensor, band-pass, track-and-hold pair, low-pass.
//!
//! Eight states, all in volts at the band-pass's output level:
//!
//! | index | state |
//! |---|---|
//! | 0, 1 | sensor (its bridge signal times the gain up to the band-pass's output) |
//! | 2, 3 | band-pass: output, and the part in quadrature |
//! | 4, 5 | hold capacitors H+ and H- |
//! | 6, 7 | low-pass: output, and its rate over the corner |
//!
//! Three switches choose the matrices: the carrier's level and the two hold switches. Not modelled:
//! the poles of the amplifiers themselves, and the load that the capacitors put on the band-pass.

use cardan_scenario::experience::REFERENCE_K;
use cardan_scenario::hardware::Frontend as Parameters;
use cardan_sensors::{BOLTZMANN, LinearSensor, Modulation};

use crate::matrix::{Matrix, Vector};
use crate::propagate::Linear;

/// Number of states.
pub const STATES: usize = 8;

/// Index of the band-pass's output.
pub const BAND_PASS: usize = 2;
/// Index of the first hold capacitor, H+; H- follows.
pub const HOLD: usize = 4;
/// Index of the low-pass's output.
pub const OUTPUT: usize = 6;

/// Bit of a switch set: the carrier is high.
pub const CARRIER_HIGH: u8 = 1;
/// Bits of a switch set: H+ closed, H- closed.
pub const CLOSED: [u8; 2] = [2, 4];
/// Number of switch sets.
pub const SWITCH_SETS: usize = 8;

/// What sets one channel apart: its sensor, gain and low-pass corner.
#[derive(Clone, Debug)]
pub struct Chain<'a> {
    /// The linear part of the sensor.
    pub sensor: LinearSensor,
    /// Common parameters.
    pub parameters: &'a Parameters,
    /// Gain from the first amplifier's output to the band-pass's at its centre.
    pub band_pass_gain: f64,
    /// Corner of the low-pass in hertz.
    pub low_pass_hz: f64,
    /// Noise sources present.
    pub noisy: bool,
}

impl Chain<'_> {
    /// The system under a switch set.
    #[must_use]
    pub fn system(&self, switches: u8) -> Linear<STATES> {
        // Rows first, for reading; transposed at the end.
        let mut rows = [[0.0; STATES]; STATES];
        let mut signal = [0.0; STATES];
        let mut constant = [0.0; STATES];
        let mut noise: Vec<Vector<STATES>> = Vec::new();
        let carrier = if switches & CARRIER_HIGH != 0 {
            1.0
        } else {
            -1.0
        };
        self.sensor_rows(&mut rows, &mut signal, &mut noise, carrier);
        self.band_pass_rows(&mut rows, &mut constant, &mut noise, carrier);
        self.hold_rows(&mut rows, &mut noise, switches);
        self.low_pass_rows(&mut rows);
        Linear {
            a: crate::matrix::transposed(&rows),
            b: [signal, constant],
            w: if self.noisy {
                intensity(&noise)
            } else {
                [[0.0; STATES]; STATES]
            },
        }
    }

    /// Gain from the bridge to the band-pass's output.
    fn gain(&self) -> f64 {
        self.parameters.lna_gain * self.band_pass_gain
    }

    fn sensor_rows(
        &self,
        rows: &mut Matrix<STATES>,
        signal: &mut Vector<STATES>,
        noise: &mut Vec<Vector<STATES>>,
        carrier: f64,
    ) {
        let drive = match self.sensor.modulation {
            Modulation::Drive => carrier,
            Modulation::Bias => 1.0,
        };
        let mut brownian = [0.0; STATES];
        for row in 0..2 {
            rows[row][..2].copy_from_slice(&self.sensor.a[row]);
            signal[row] = drive * self.gain() * self.sensor.b[row];
            brownian[row] = self.gain() * self.sensor.b[row] * self.sensor.input_noise;
        }
        noise.push(brownian);
    }

    fn band_pass_rows(
        &self,
        rows: &mut Matrix<STATES>,
        constant: &mut Vector<STATES>,
        noise: &mut Vec<Vector<STATES>>,
        carrier: f64,
    ) {
        let p = self.parameters;
        let w = 2.0 * std::f64::consts::PI * p.band_pass_hz;
        let width = w / p.band_pass_quality;
        let bias = match self.sensor.modulation {
            Modulation::Bias => carrier,
            Modulation::Drive => 1.0,
        };
        for (row, share) in rows[BAND_PASS].iter_mut().zip(self.sensor.c) {
            *row = width * bias * share;
        }
        rows[BAND_PASS][BAND_PASS] = -width;
        rows[BAND_PASS][BAND_PASS + 1] = -w;
        rows[BAND_PASS + 1][BAND_PASS] = w;
        constant[BAND_PASS] = width * self.gain() * carrier * self.sensor.feedthrough_v;
        let mut electronic = [0.0; STATES];
        electronic[BAND_PASS] = width * self.gain() * self.amplifier_noise_v();
        noise.push(electronic);
    }

    /// Noise at the first amplifier's input, one-sided density at the carrier in V/rtHz: bridge and
    /// amplifier, the latter's 1/f part taken as white with its density at the band-pass's centre.
    /// Chopping leaves nothing else of it: over the pass band its slope is odd about the centre, and
    /// at 10 Hz the band-pass lets 10/(Q 16,000) through, of which the pair of samples takes the
    /// difference.
    fn amplifier_noise_v(&self) -> f64 {
        let p = self.parameters;
        let white = p.lna_noise_nv_per_rthz * 1e-9;
        let flicker = 1.0 + p.lna_flicker_corner_hz / p.band_pass_hz;
        let bridge = self.sensor.output_noise_v;
        (white * white * flicker + bridge * bridge).sqrt()
    }

    fn hold_rows(&self, rows: &mut Matrix<STATES>, noise: &mut Vec<Vector<STATES>>, switches: u8) {
        let p = self.parameters;
        let farad = p.hold_pf * 1e-12;
        for (side, closed) in CLOSED.iter().enumerate() {
            let state = HOLD + side;
            rows[state][state] = -1.0 / (p.leak_ohm * farad);
            if switches & closed != 0 {
                let rate = 1.0 / (p.switch_ohm * farad);
                rows[state][state] -= rate;
                rows[state][BAND_PASS] = rate;
                let mut thermal = [0.0; STATES];
                thermal[state] = rate * (4.0 * BOLTZMANN * REFERENCE_K * p.switch_ohm).sqrt();
                noise.push(thermal);
            }
        }
    }

    fn low_pass_rows(&self, rows: &mut Matrix<STATES>) {
        let w = 2.0 * std::f64::consts::PI * self.low_pass_hz;
        rows[OUTPUT][OUTPUT + 1] = w;
        rows[OUTPUT + 1][OUTPUT] = -w;
        rows[OUTPUT + 1][OUTPUT + 1] = -std::f64::consts::SQRT_2 * w;
        rows[OUTPUT + 1][HOLD] = 0.5 * w;
        rows[OUTPUT + 1][HOLD + 1] = -0.5 * w;
    }
}

/// Intensity of independent white sources given as one-sided densities per rtHz: half their square.
fn intensity(sources: &[Vector<STATES>]) -> Matrix<STATES> {
    let mut w = [[0.0; STATES]; STATES];
    for source in sources {
        for (column, part) in w.iter_mut().enumerate() {
            crate::matrix::add_scaled(part, source, 0.5 * source[column]);
        }
    }
    w
}

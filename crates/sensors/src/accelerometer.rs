//! Convective accelerometer: heated gas is displaced, two detector bridges feel the difference.
//!
//! Specific force in g, cubic, scaled by heater power and temperature -> first-order convection lag
//! -> first-order detector lag -> Wheatstone bridge whose bias the carrier reverses (sensors
//! reference, section 1).

use cardan_scenario::experience::{Experience, REFERENCE_K};
use cardan_scenario::hardware::Accelerometer as Parameters;

use crate::{Axis, LinearSensor, Modulation, thermal_noise_v};

/// One accelerometer: of the pair, or the third along body z.
#[derive(Clone, Debug)]
pub struct Accelerometer {
    parameters: Parameters,
    axis: Axis,
}

impl Accelerometer {
    /// The unit as its parameters describe it.
    #[must_use]
    pub fn new(parameters: &Parameters, axis: Axis) -> Self {
        Self {
            parameters: parameters.clone(),
            axis,
        }
    }

    /// The unit as designed: the same dynamics without any deviation of sensitivity or offset.
    #[must_use]
    pub fn as_designed(parameters: &Parameters, axis: Axis) -> Self {
        let designed = Parameters::default();
        let parameters = Parameters {
            convection_bandwidth_hz: parameters.convection_bandwidth_hz,
            detector_bandwidth_hz: parameters.detector_bandwidth_hz,
            sensitivity_mv_per_g: parameters.sensitivity_mv_per_g,
            bridge_ohm: parameters.bridge_ohm,
            ..designed
        };
        Self { parameters, axis }
    }

    /// Input of the linear part in g: what the gas does under `experience`.
    #[must_use]
    pub fn input(&self, experience: &Experience) -> f64 {
        let p = &self.parameters;
        let (own, others) = self.axis.indices();
        let force = experience.specific_force_g;
        let a = force[own] + p.cross_axis * (force[others[0]] + force[others[1]]);
        self.scale(experience.temperature_k) * (a + p.cubic_per_g2 * a * a * a)
            + self.offset_g(experience.temperature_k)
    }

    fn scale(&self, temperature_k: f64) -> f64 {
        let p = &self.parameters;
        let error = match self.axis {
            Axis::X => p.sensitivity_error_x,
            Axis::Y => p.sensitivity_error_y,
            Axis::Z => p.sensitivity_error_z,
        };
        let gas = if temperature_k == REFERENCE_K {
            1.0
        } else {
            libm::pow(REFERENCE_K / temperature_k, p.temperature_exponent)
        };
        (1.0 + error) * p.heater_power * gas
    }

    fn offset_g(&self, temperature_k: f64) -> f64 {
        let p = &self.parameters;
        let offset_mg = match self.axis {
            Axis::X => p.offset_x_mg,
            Axis::Y => p.offset_y_mg,
            Axis::Z => p.offset_z_mg,
        };
        1e-3 * (offset_mg + p.offset_drift_mg_per_k * (temperature_k - REFERENCE_K))
    }

    /// The lags; states are volts of bridge signal at positive bias.
    #[must_use]
    pub fn linear(&self) -> LinearSensor {
        let p = &self.parameters;
        let turn = 2.0 * std::f64::consts::PI;
        let (gas, detector) = (
            turn * p.convection_bandwidth_hz,
            turn * p.detector_bandwidth_hz,
        );
        LinearSensor {
            a: [[-gas, 0.0], [detector, -detector]],
            b: [gas * p.sensitivity_mv_per_g * 1e-3, 0.0],
            c: [0.0, 1.0],
            feedthrough_v: 0.0,
            modulation: Modulation::Bias,
            input_noise: p.noise_mg_per_rthz * 1e-3,
            output_noise_v: thermal_noise_v(p.bridge_ohm, REFERENCE_K),
        }
    }

    /// White density (g/rtHz) and corner (Hz) of the sensor's own 1/f noise.
    #[must_use]
    pub fn flicker(&self) -> (f64, f64) {
        (
            self.parameters.noise_mg_per_rthz * 1e-3,
            self.parameters.flicker_corner_hz,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn level(force: [f64; 3], temperature_k: f64) -> Experience {
        Experience {
            specific_force_g: force,
            temperature_k,
            ..Experience::default()
        }
    }

    #[test]
    fn a_unit_as_designed_feels_the_force_along_its_axis() {
        let x = Accelerometer::new(&Parameters::default(), Axis::X);
        let y = Accelerometer::new(&Parameters::default(), Axis::Y);
        let z = Accelerometer::new(&Parameters::default(), Axis::Z);
        let experience = level([0.25, -0.5, -0.8], REFERENCE_K);
        let felt = [x, y, z].map(|unit| unit.input(&experience));
        assert_eq!(felt, [0.25, -0.5, -0.8]);
    }

    #[test]
    fn heat_weakens_the_sensor_by_the_square_and_drifts_its_offset() {
        let unit = Accelerometer::new(&Parameters::default(), Axis::X);
        let hot = unit.input(&level([1.0, 0.0, 0.0], 2.0 * REFERENCE_K));
        assert!((hot - (0.25 + 1.5e-3 * REFERENCE_K)).abs() < 1e-12, "{hot}");
    }

    #[test]
    fn cubic_cross_axis_and_heater_power_act_as_named() {
        let parameters = Parameters {
            cubic_per_g2: 0.1,
            cross_axis: 0.02,
            heater_power: 2.0,
            offset_x_mg: 50.0,
            ..Parameters::default()
        };
        let unit = Accelerometer::new(&parameters, Axis::X);
        let felt = 0.5 + 0.02 * (0.25 - 0.75);
        let expected = 2.0 * (felt + 0.1 * felt * felt * felt) + 0.05;
        assert!((unit.input(&level([0.5, 0.25, -0.75], REFERENCE_K)) - expected).abs() < 1e-15);
    }
}

//! U-shaped Lorentz cantilever: current times field is a force at the carrier, resonance amplifies
//! the beam's motion, piezoresistive gauges feel it.
//!
//! y'' + (w/Q) y' + w^2 y = w^2 (S/Q) B drive(t), with y in volts of the gauge bridge and S the
//! amplitude per field under a sine drive at resonance (docs/sensors.md, section 2). The
//! displacement lags the force by a quarter period: it peaks at the edges of a square drive.

use cardan_scenario::experience::{Experience, REFERENCE_K};
use cardan_scenario::hardware::Magnetometer as Parameters;

use crate::{Axis, LinearSensor, Modulation, thermal_noise_v};

/// One magnetometer of the pair.
#[derive(Clone, Debug)]
pub struct Magnetometer {
    parameters: Parameters,
    axis: Axis,
    /// Sensitivity to body x, y, z.
    row: [f64; 3],
}

impl Magnetometer {
    /// The unit as its parameters describe it.
    #[must_use]
    pub fn new(parameters: &Parameters, axis: Axis) -> Self {
        let (own, others) = axis.indices();
        let mut row = [0.0; 3];
        row[own] = 1.0;
        if axis == Axis::Y {
            let (s, c) = libm::sincos(parameters.non_orthogonality_deg.to_radians());
            row = [s, c, 0.0];
        }
        for other in others {
            row[other] += parameters.cross_axis;
        }
        Self {
            parameters: parameters.clone(),
            axis,
            row,
        }
    }

    /// The unit as designed: the same dynamics without detuning, errors, offset or feed-through.
    #[must_use]
    pub fn as_designed(parameters: &Parameters, axis: Axis) -> Self {
        let designed = Parameters {
            resonance_hz: parameters.resonance_hz,
            quality: parameters.quality,
            sensitivity_uv_per_ut: parameters.sensitivity_uv_per_ut,
            bridge_ohm: parameters.bridge_ohm,
            ..Parameters::default()
        };
        Self::new(&designed, axis)
    }

    /// Input of the linear part in microtesla: the field along the sensing axis under `experience`.
    #[must_use]
    pub fn input(&self, experience: &Experience) -> f64 {
        let p = &self.parameters;
        let (error, offset) = match self.axis {
            Axis::X => (p.sensitivity_error_x, p.offset_x_ut),
            Axis::Y => (p.sensitivity_error_y, p.offset_y_ut),
            // None is fitted along body z: it would be one as designed.
            Axis::Z => (0.0, 0.0),
        };
        let field = experience.field_ut;
        let along = self.row[0] * field[0] + self.row[1] * field[1] + self.row[2] * field[2];
        (1.0 + error) * (along + offset)
    }

    /// The resonator at `temperature_k`; states are displacement and velocity over resonance, both
    /// in volts of the gauge bridge.
    #[must_use]
    pub fn linear(&self, temperature_k: f64) -> LinearSensor {
        let p = &self.parameters;
        let detuning_ppm = match self.axis {
            Axis::X => p.detuning_x_ppm,
            Axis::Y => p.detuning_y_ppm,
            Axis::Z => 0.0,
        } + p.detuning_drift_ppm_per_k * (temperature_k - REFERENCE_K);
        let w = 2.0 * std::f64::consts::PI * p.resonance_hz * (1.0 + 1e-6 * detuning_ppm);
        let sensitivity_v = p.sensitivity_uv_per_ut * 1e-6;
        LinearSensor {
            a: [[0.0, w], [-w, -w / p.quality]],
            b: [0.0, w * sensitivity_v / p.quality],
            c: [1.0, 0.0],
            feedthrough_v: p.feedthrough_ut * sensitivity_v,
            modulation: Modulation::Drive,
            input_noise: p.thermomechanical_nt_per_rthz * 1e-3,
            output_noise_v: thermal_noise_v(p.bridge_ohm, temperature_k),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_as_designed_feels_the_field_along_its_axis() {
        let field = Experience {
            field_ut: [20.0, -5.0, 40.0],
            ..Experience::default()
        };
        let x = Magnetometer::new(&Parameters::default(), Axis::X);
        let y = Magnetometer::new(&Parameters::default(), Axis::Y);
        assert_eq!((x.input(&field), y.input(&field)), (20.0, -5.0));
    }

    #[test]
    fn a_tilted_y_axis_feels_x() {
        let parameters = Parameters {
            non_orthogonality_deg: 1.0,
            ..Parameters::default()
        };
        let y = Magnetometer::new(&parameters, Axis::Y);
        let field = Experience {
            field_ut: [40.0, 0.0, 0.0],
            ..Experience::default()
        };
        assert!((y.input(&field) - 40.0 * libm::sin(1.0_f64.to_radians())).abs() < 1e-12);
    }

    #[test]
    fn at_resonance_the_response_to_a_sine_drive_is_the_sensitivity() {
        // |c (jw - a)^-1 b| of the two-state resonator at its own w is b1 Q / w.
        let unit = Magnetometer::new(&Parameters::default(), Axis::X).linear(REFERENCE_K);
        let w = unit.a[0][1];
        let quality = -w / unit.a[1][1];
        assert!((unit.b[1] * quality / w - 0.145e-6).abs() < 1e-18);
    }
}

//! What comes on top of any motion: vibration, temperature, magnetic disturbance.

use crate::experience::{Experience, REFERENCE_K};
use crate::parameter::Origin::Setting;
use crate::parameter::parameters;
use crate::sweep::smoother_step;

parameters! {
    /// A sine of specific force along the body axes, all in phase.
    pub struct Vibration at "vibration" {
        /// Amplitude along body x.
        x_g = 0.0, "g", -100.0 => 100.0, Setting;
        /// Amplitude along body y.
        y_g = 0.0, "g", -100.0 => 100.0, Setting;
        /// Amplitude along body z.
        z_g = 0.0, "g", -100.0 => 100.0, Setting;
        /// Frequency.
        frequency_hz = 40.0, "Hz", 0.0 => 2000.0, Setting;
    }
}

parameters! {
    /// Ambient temperature: a ramp that ends. All coefficients count from 293.15 K.
    pub struct Climate at "climate" {
        /// Temperature at reset.
        start_k = 293.15, "K", 200.0 => 450.0, Setting;
        /// Temperature at which the ramp ends.
        end_k = 293.15, "K", 200.0 => 450.0, Setting;
        /// Duration of the ramp from reset on.
        ramp_s = 10.0, "s", 0.001 => 1e6, Setting;
    }
}

parameters! {
    /// A field that moves with the body, as of a magnet brought near, rising and falling smoothly.
    pub struct Disturbance at "disturbance" {
        /// Field along body x.
        x_ut = 0.0, "uT", -1e4 => 1e4, Setting;
        /// Field along body y.
        y_ut = 0.0, "uT", -1e4 => 1e4, Setting;
        /// Field along body z.
        z_ut = 0.0, "uT", -1e4 => 1e4, Setting;
        /// When it begins to rise.
        from_s = 4.0, "s", 0.0 => 1e6, Setting;
        /// When it begins to fall.
        to_s = 8.0, "s", 0.0 => 1e6, Setting;
        /// Time of rise and of fall.
        edge_s = 0.2, "s", 1e-4 => 1e6, Setting;
    }
}

/// The three together; what is absent costs nothing.
#[derive(Clone, Debug)]
pub(crate) struct Overlay {
    vibration: Option<Vibration>,
    climate: Climate,
    disturbance: Option<Disturbance>,
}

impl Overlay {
    pub(crate) fn new(vibration: &Vibration, climate: &Climate, disturbance: &Disturbance) -> Self {
        let v = vibration;
        let d = disturbance;
        Self {
            vibration: ([v.x_g, v.y_g, v.z_g] != [0.0; 3]).then(|| v.clone()),
            climate: climate.clone(),
            disturbance: ([d.x_ut, d.y_ut, d.z_ut] != [0.0; 3]).then(|| d.clone()),
        }
    }

    /// `base` with everything on top.
    pub(crate) fn on(&self, base: Experience, t_s: f64) -> Experience {
        let mut felt = base;
        felt.temperature_k = self.climate.temperature_k(t_s);
        if let Some(v) = &self.vibration {
            let cycles = v.frequency_hz * t_s;
            let share = libm::sin(2.0 * std::f64::consts::PI * (cycles - cycles.floor()));
            add(&mut felt.specific_force_g, [v.x_g, v.y_g, v.z_g], share);
        }
        if let Some(d) = &self.disturbance {
            let risen = smoother_step((t_s - d.from_s) / d.edge_s);
            let fallen = smoother_step((t_s - d.to_s) / d.edge_s);
            add(&mut felt.field_ut, [d.x_ut, d.y_ut, d.z_ut], risen - fallen);
        }
        felt
    }
}

impl Climate {
    /// The temperature `t_s` seconds after reset.
    fn temperature_k(&self, t_s: f64) -> f64 {
        if self.start_k == REFERENCE_K && self.end_k == REFERENCE_K {
            return REFERENCE_K;
        }
        self.start_k + (self.end_k - self.start_k) * (t_s / self.ramp_s).clamp(0.0, 1.0)
    }
}

fn add(to: &mut [f64; 3], what: [f64; 3], share: f64) {
    for (value, part) in to.iter_mut().zip(what) {
        *value += share * part;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn overlay(v: Vibration, c: Climate, d: Disturbance) -> Overlay {
        Overlay::new(&v, &c, &d)
    }

    #[test]
    fn nothing_on_top_changes_nothing() {
        let none = overlay(
            Vibration::default(),
            Climate::default(),
            Disturbance::default(),
        );
        let base = Experience {
            field_ut: [1.0, 2.0, 3.0],
            ..Experience::default()
        };
        assert_eq!(none.on(base, 5.0), base);
    }

    #[test]
    fn vibration_disturbance_and_heat_add_up_and_end_as_named() {
        let all = overlay(
            Vibration {
                z_g: 0.5,
                frequency_hz: 25.0,
                ..Vibration::default()
            },
            Climate {
                start_k: 300.0,
                end_k: 320.0,
                ramp_s: 10.0,
            },
            Disturbance {
                x_ut: 30.0,
                ..Disturbance::default()
            },
        );
        let base = Experience::default();
        let at = |t| all.on(base, t);
        assert!(
            (at(0.01).specific_force_g[2] + 0.5).abs() < 1e-12,
            "quarter period"
        );
        assert_eq!(at(0.0).temperature_k, 300.0);
        assert_eq!(at(5.0).temperature_k, 310.0);
        assert_eq!(at(50.0).temperature_k, 320.0);
        assert_eq!(
            [at(3.9), at(6.0), at(8.3)].map(|e| e.field_ut[0]),
            [0.0, 30.0, 0.0]
        );
    }
}

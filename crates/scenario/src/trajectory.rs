//! A scenario's motion made ready to run: experience and truth at any instant.

use nalgebra::{Matrix3, Vector3};

use crate::error::Error;
use crate::experience::{Experience, REFERENCE_K, Stimulus};
use crate::field::{self, EarthField};
use crate::grid::Grid;
use crate::overlay::Overlay;
use crate::poses::Poses;
use crate::recording::Recording;
use crate::report::Assumption;
use crate::scenario::{MotionKind, Scenario};
use crate::sweep::{Step, Sweep};
use crate::tumble::TumbleMotion;

/// The device's motion in the Earth's field.
#[derive(Clone, Debug)]
pub struct Trajectory {
    motion: Moving,
    field: EarthField,
    overlay: Overlay,
}

#[derive(Clone, Debug)]
enum Moving {
    Tumble(TumbleMotion),
    Static(Grid),
    Sweep(Sweep),
    Step(Step),
    Poses(Poses),
    Recording(Box<Recording>),
}

impl Trajectory {
    /// Draws or reads the scenario's motion.
    ///
    /// # Errors
    /// A value of the scenario that is not admissible, and everything that can be wrong with a
    /// recording.
    pub fn new(scenario: &Scenario, seed: u64) -> Result<Self, Error> {
        scenario.check()?;
        let field = scenario.field.resolve().unwrap_or(field::SITES[0].1);
        let Scenario {
            vibration,
            climate,
            disturbance,
            ..
        } = scenario;
        let overlay = Overlay::new(vibration, climate, disturbance);
        let motion = match (scenario.motion.kind, &scenario.motion.recording.file) {
            (MotionKind::Recording, Some(file)) => {
                let choice = &scenario.motion.recording;
                let explicit = scenario.field.explicit();
                let recording = Recording::open(file, &scenario.mounting, choice, explicit)?;
                let field = recording.field();
                let motion = Moving::Recording(Box::new(recording));
                return Ok(Self {
                    motion,
                    field,
                    overlay,
                });
            }
            (MotionKind::Static, _) => Moving::Static(scenario.motion.grid.clone()),
            (MotionKind::Sweep, _) => Moving::Sweep(scenario.motion.sweep.clone()),
            (MotionKind::Step, _) => Moving::Step(scenario.motion.step.clone()),
            _ => Moving::Tumble(TumbleMotion::new(&scenario.motion.tumble, seed)),
        };
        Ok(Self {
            motion,
            field,
            overlay,
        })
    }

    /// The scenario's vibration, climate and disturbance on a device that rests in `poses`, in `field`.
    #[must_use]
    pub fn resting(scenario: &Scenario, poses: Poses, field: EarthField) -> Self {
        Self {
            motion: Moving::Poses(poses),
            field,
            overlay: Overlay::new(
                &scenario.vibration,
                &scenario.climate,
                &scenario.disturbance,
            ),
        }
    }

    /// True attitude at `t_s`: the matrix M of v_body = M v_ref, reference magnetic NED. None where
    /// a recording has no reference.
    #[must_use]
    pub fn truth_at(&self, t_s: f64) -> Option<Matrix3<f64>> {
        match &self.motion {
            Moving::Tumble(tumble) => Some(tumble.attitude(t_s)),
            Moving::Static(grid) => Some(grid.attitude(t_s)),
            Moving::Sweep(sweep) => Some(sweep.attitude(t_s)),
            Moving::Step(step) => Some(step.attitude(t_s)),
            Moving::Poses(poses) => Some(poses.attitude(t_s)),
            Moving::Recording(recording) => recording.truth_at(t_s),
        }
    }

    /// True if there is a truth to compare with, at least at times.
    #[must_use]
    pub fn has_truth(&self) -> bool {
        match &self.motion {
            Moving::Recording(recording) => recording.has_reference(),
            _ => true,
        }
    }

    /// Seconds after which the motion ends; none for synthetic motions, which go on.
    #[must_use]
    pub fn duration_s(&self) -> Option<f64> {
        match &self.motion {
            Moving::Recording(recording) => Some(recording.duration_s()),
            _ => None,
        }
    }

    /// True if the motion between these instants is not known: a gap of the recording lies there, or
    /// so shortly before that the device has not forgotten it.
    #[must_use]
    pub fn is_bridged(&self, from_s: f64, to_s: f64) -> bool {
        match &self.motion {
            Moving::Recording(recording) => recording.is_bridged(from_s, to_s),
            _ => false,
        }
    }

    /// What the user should know of a recording before it is run, in a line; none if nothing.
    #[must_use]
    pub fn remark(&self) -> Option<String> {
        match &self.motion {
            Moving::Recording(recording) => recording.remark(),
            _ => None,
        }
    }

    /// The Earth's field in which the device moves, as given or estimated.
    #[must_use]
    pub fn field(&self) -> EarthField {
        self.field
    }

    /// What was estimated from the recording.
    #[must_use]
    pub fn assumptions(&self) -> Vec<Assumption> {
        match &self.motion {
            Moving::Recording(recording) => recording
                .notes()
                .iter()
                .map(|(key, value, source)| Assumption {
                    key: (*key).into(),
                    value: value.clone(),
                    source: source.clone(),
                })
                .collect(),
            _ => Vec::new(),
        }
    }

    /// Rotation in place: specific force is minus gravity, the field is the Earth's.
    fn at_rest(&self, attitude: &Matrix3<f64>) -> Experience {
        let EarthField {
            horizontal_ut,
            vertical_ut,
        } = self.field;
        Experience {
            specific_force_g: (-attitude.column(2)).into(),
            field_ut: (attitude * Vector3::new(horizontal_ut, 0.0, vertical_ut)).into(),
            temperature_k: REFERENCE_K,
        }
    }
}

impl Stimulus for Trajectory {
    fn at(&self, t_s: f64) -> Experience {
        let base = match &self.motion {
            Moving::Tumble(tumble) => self.at_rest(&tumble.attitude(t_s)),
            Moving::Static(grid) => self.at_rest(&grid.attitude(t_s)),
            Moving::Sweep(sweep) => self.at_rest(&sweep.attitude(t_s)),
            Moving::Step(step) => self.at_rest(&step.attitude(t_s)),
            Moving::Poses(poses) => self.at_rest(&poses.attitude(t_s)),
            Moving::Recording(recording) => recording.at(t_s),
        };
        self.overlay.on(base, t_s)
    }
}

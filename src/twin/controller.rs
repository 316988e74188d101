//! Controller of the drives: model-based feed-forward plus PD control on the encoder angles.

use crate::dynamics::{Plant, steady_inverse_dynamics};
use crate::kinematics::{JointState, KinematicsError};
use crate::machine::bodies::ARM;
use crate::machine::{Drive, Mechanism, PerAxis, each, every_axis, may_have_telescope};
use crate::model::Model;

/// Gains of the position loop.
#[derive(Clone, Copy, Debug)]
pub struct Gains {
    /// Proportional gain per axis, N·m/rad.
    pub proportional: PerAxis<f64>,
    /// Derivative gain per axis, N·m·s/rad.
    pub derivative: PerAxis<f64>,
    /// Cut-off frequency of the low-pass on the differentiated error, Hz.
    pub cutoff: f64,
}

impl Default for Gains {
    /// About 10 Hz bandwidth for the bare arms and 12 Hz for axis 4.
    fn default() -> Self {
        Self { proportional: [2000.0, 2000.0, 2000.0, 20.0], derivative: [40.0, 40.0, 40.0, 0.3], cutoff: 60.0 }
    }
}

impl Gains {
    /// Gains for a machine; those of a single axis are the gains of an arm scaled by the ratio of inertias.
    pub fn of(model: &Model) -> Self {
        let gains = Self::default();
        match model.mechanism {
            // A fourth arm is an arm; the fourth gains are the telescope's.
            Mechanism::Delta { .. } if !may_have_telescope(model.mechanism.arms()) => {
                Self { proportional: each(gains.proportional[0]), derivative: each(gains.derivative[0]), ..gains }
            }
            Mechanism::Delta { .. } => gains,
            Mechanism::Axis(_) => {
                let share = model.bodies[ARM].tensor[(1, 1)] / ARM_INERTIA;
                Self {
                    proportional: gains.proportional.map(|g| share * g),
                    derivative: gains.derivative.map(|g| share * g),
                    ..gains
                }
            }
        }
    }
}

/// Inertia of an arm about its shaft, kg·m² ([Gnad 2024], Table 3), for which the default gains are chosen.
const ARM_INERTIA: f64 = 0.258;

/// Output of the controller.
#[derive(Clone, Copy, Debug)]
pub struct Command {
    /// Torque at the gear output, within the drive limits, N·m.
    pub torque: PerAxis<f64>,
    /// Feedback part of the torque before limitation, N·m.
    pub feedback: PerAxis<f64>,
}

/// Feed-forward plus PD control at the sample time, with torque limits.
pub struct Controller<'a> {
    plant: &'a Plant,
    drives: PerAxis<Drive>,
    gains: Gains,
    step: f64,
    last_error: Option<PerAxis<f64>>,
    filtered: PerAxis<f64>,
}

impl<'a> Controller<'a> {
    /// Controller with the feed-forward model `plant`, called every `step` seconds.
    pub fn new(plant: &'a Plant, drives: PerAxis<Drive>, gains: Gains, step: f64) -> Self {
        Self { plant, drives, gains, step, last_error: None, filtered: each(0.0) }
    }

    /// Feed-forward torques for a desired motion, N·m at the gear output.
    ///
    /// # Errors
    /// Those of [`Plant::motion`] and [`steady_inverse_dynamics`].
    pub fn feed_forward(&self, desired: &JointState) -> Result<PerAxis<f64>, KinematicsError> {
        let motion = self.plant.motion(desired)?;
        Ok(steady_inverse_dynamics(self.plant, 0.0, &motion, false)?.tau)
    }

    /// Torque for the end of the next period.
    ///
    /// The feedback compares `desired_now` with `encoders` (rad), the feed-forward is that of `ahead`, one period
    /// later.
    ///
    /// # Errors
    /// Those of [`Self::feed_forward`].
    pub fn update(
        &mut self,
        desired_now: &JointState,
        encoders: &PerAxis<f64>,
        ahead: &JointState,
    ) -> Result<Command, KinematicsError> {
        let mut torque = self.feed_forward(ahead)?;
        let mut feedback: PerAxis<f64> = each(0.0);
        let error: PerAxis<f64> = std::array::from_fn(|i| desired_now.q[i] - encoders[i]);
        let last = self.last_error.unwrap_or(error);
        let blend = 1.0 - (-std::f64::consts::TAU * self.gains.cutoff * self.step).exp();
        for i in every_axis() {
            self.filtered[i] += blend * ((error[i] - last[i]) / self.step - self.filtered[i]);
            feedback[i] = self.gains.proportional[i] * error[i] + self.gains.derivative[i] * self.filtered[i];
            let limit = self.drives[i].max_torque;
            torque[i] = (torque[i] + feedback[i]).clamp(-limit, limit);
        }
        self.last_error = Some(error);
        Ok(Command { torque, feedback })
    }
}

/// `angle` (rad) rounded to the encoder increments of `drive`.
pub fn quantised(angle: f64, drive: &Drive) -> f64 {
    let step = drive.encoder_step();
    (angle / step).round() * step
}

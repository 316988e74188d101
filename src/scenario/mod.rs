//! Description of a run: desired motion, payload, surroundings, sockets, supervision and sensors.
//!
//! A [`Scenario`] is data only; `twin` simulates it.

pub mod motion;
pub mod sockets;

pub use motion::fourier::{FourierMotion, MotionLimits};
pub use motion::{Course, DesiredMotion, MotionError};
pub use sockets::SocketSetup;

use std::path::PathBuf;

use nalgebra::Vector3;

use crate::cell::{Object, Shape};
use crate::effects::{ActiveEffect, find};
use crate::machine::{Payload, PerAxis, PerSocket, PerStrut, Setup, each};
use crate::model::Model;

/// Integration steps per sample time where a scenario states none.
pub const SUBSTEPS: usize = 2;

/// Density of air at 20 °C and 1013 hPa, kg/m³.
const AIR_DENSITY: f64 = 1.2;

/// A run of the twin, as described by a scenario file.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name for reports, the file stem.
    pub name: String,
    /// Model file of the machine.
    pub model: PathBuf,
    /// Model file of the feed-forward, also used to plan the motion; `None` means the machine's own.
    pub controller_model: Option<PathBuf>,
    /// Duration, s.
    pub duration: f64,
    /// Seed of the sensor noise and of randomly drawn socket hold forces.
    pub seed: u64,
    /// Whether sensor signals are noisy and quantised.
    pub noise: bool,
    /// Integration steps per sample time, if stated; otherwise [`SUBSTEPS`].
    pub substeps: Option<usize>,
    /// Sample times per control period.
    pub control_period: usize,
    /// Torque between two control instants.
    pub hold_torque: HoldTorque,
    /// How the equations of motion are solved.
    pub formulation: Formulation,
    /// Controller gains that differ from the default.
    pub gains: Gains,
    /// Desired motion.
    pub motion: Course,
    /// Payload and configuration.
    pub setup: Setup,
    /// Payload for which the controller computes its feed-forward; `None` means the one carried.
    pub believed_payload: Option<Payload>,
    /// Drag factor c_w of a payload that is a box; `None` leaves the machine's effect `payload_drag` as it is.
    pub drag_factor: Option<f64>,
    /// Shape of the payload for collisions.
    pub payload_shape: Option<PayloadShape>,
    /// Objects around the robot, with unique names.
    pub objects: Vec<Object>,
    /// Actions of the gripper, in order of time.
    pub actions: Vec<Action>,
    /// Ball sockets.
    pub sockets: SocketSetup,
    /// Conditions under which the drives trip.
    pub supervision: Supervision,
    /// Recorded channels.
    pub sensors: Sensors,
}

/// Torque between two control instants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HoldTorque {
    /// Linear over the period, so that a recorded torque is the one that acts at its time stamp.
    #[default]
    Ramp,
    /// Constant over the period (zero-order hold).
    Hold,
}

/// Formulation of the equations of motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Formulation {
    /// The constraint rows are eliminated in closed form while all sockets are closed.
    #[default]
    Eliminated,
    /// Absolute coordinates: six velocities per body, all joints as constraint rows with multipliers.
    Absolute,
}

impl Formulation {
    /// All formulations by name.
    pub const NAMES: [(&str, Self); 2] = [("eliminated", Self::Eliminated), ("absolute", Self::Absolute)];

    /// Name in scenario files and on the command line.
    pub fn name(self) -> &'static str {
        Self::NAMES[usize::from(self == Self::Absolute)].0
    }
}

impl std::str::FromStr for Formulation {
    type Err = String;

    fn from_str(word: &str) -> Result<Self, String> {
        let found = Self::NAMES.iter().find(|(name, _)| *name == word);
        found.map(|(_, formulation)| *formulation).ok_or_else(|| "expected \"eliminated\" or \"absolute\"".into())
    }
}

/// Controller gains; `None` keeps the default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gains {
    /// Proportional gain per axis, N·m/rad.
    pub proportional: Option<PerAxis<f64>>,
    /// Derivative gain per axis, N·m·s/rad.
    pub derivative: Option<PerAxis<f64>>,
    /// Cut-off frequency of the low-pass on the differentiated error, Hz.
    pub cutoff: Option<f64>,
}

/// Shape of the payload.
#[derive(Clone, Debug, PartialEq)]
pub struct PayloadShape {
    /// Shape with its axes parallel to those of the flange.
    pub shape: Shape,
    /// Its centre, m; origin at the flange centre, z up, rotating with ψ.
    pub centre: Vector3<f64>,
}

/// An action of the gripper.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Action {
    /// Time, s.
    pub t: f64,
    /// Kind.
    pub kind: ActionKind,
}

/// Kinds of gripper actions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActionKind {
    /// Attaches an object, an index into [`Scenario::objects`].
    Pick(usize),
    /// Releases the held object.
    Release,
}

/// Conditions under which the drives trip, and their state afterwards.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Supervision {
    /// Largest feedback torque (without feed-forward) on an arm, N·m; `None` disables the check.
    pub torque: Option<f64>,
    /// Largest difference between desired and measured angle of an arm, rad; `None` disables the check.
    pub tracking: Option<f64>,
    /// State of the drives after a trip.
    pub trip: Trip,
}

/// State of the drives after a trip.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Trip {
    /// Zero torque.
    #[default]
    Coast,
    /// Brakes engaged.
    Brake {
        /// Torque of each brake at the gear output, N·m.
        torque: f64,
    },
}

/// Channels recorded besides time, joint angles and torques.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sensors {
    /// Struts with a force sensor at the elbow.
    pub strut_upper: PerStrut<bool>,
    /// Struts with a force sensor at the platform.
    pub strut_lower: PerStrut<bool>,
    /// Position of the centre of the platform's ball plane.
    pub ee: bool,
    /// Joint rates.
    pub velocity: bool,
    /// Joint accelerations.
    pub acceleration: bool,
    /// Force margins of all sockets.
    pub sockets: bool,
    /// Multipliers of all constraint rows.
    pub multipliers: bool,
    /// Link-side angles and rates of elastic gears.
    pub links: bool,
    /// Load of a single axis.
    pub load: bool,
}

impl Default for Sensors {
    /// Only the platform position.
    fn default() -> Self {
        let none: PerStrut<bool> = each(false);
        Self {
            strut_upper: none,
            strut_lower: none,
            ee: true,
            velocity: false,
            acceleration: false,
            sockets: false,
            multipliers: false,
            links: false,
            load: false,
        }
    }
}

impl Scenario {
    /// The desired motion for a machine like `planning`.
    ///
    /// # Errors
    /// Those of [`Course::on`].
    pub fn motion(&self, planning: &Model) -> Result<DesiredMotion, MotionError> {
        self.motion.on(planning, &self.believed_setup())
    }

    /// The same run in 1/`scale` of the time: motion, duration and actions of the gripper.
    pub fn faster(&self, scale: f64) -> Self {
        let mut run = self.clone();
        run.motion = self.motion.faster(scale);
        run.duration /= scale;
        run.actions.iter_mut().for_each(|action| action.t /= scale);
        run
    }

    /// Setup as the controller believes it to be.
    pub fn believed_setup(&self) -> Setup {
        Setup { payload: self.believed_payload.unwrap_or(self.setup.payload), ..self.setup }
    }

    /// The machine of `model` in this run: with a stated drag factor c_w, its effect `payload_drag` has the coefficient
    /// ½·ρ·c_w·A for the mean area A of the box and air of 1.2 kg/m³.
    pub fn machine(&self, model: &Model) -> Model {
        let mut machine = model.clone();
        if let (Some(factor), Some(effect)) = (self.drag_factor, find("payload_drag")) {
            let coefficient = 0.5 * AIR_DENSITY * factor * self.setup.payload.mean_area();
            machine.effects.retain(|a| a.effect.name() != effect.name());
            machine
                .effects
                .push(ActiveEffect { values: vec![coefficient], ..ActiveEffect::absent_on(effect, model.host()) });
        }
        machine
    }

    /// Dislocation force of each ball socket of `model`, N: one per strut at the elbows, then one per strut at the plate.
    pub fn socket_holds(&self, model: &Model) -> PerSocket<f64> {
        self.sockets.holds(model.sockets.dislocation_force, self.seed, model.mechanism)
    }

    /// Force that presses each cup of `model` on its ball, N, in the same order.
    pub fn socket_preloads(&self, model: &Model) -> PerSocket<f64> {
        self.sockets.preloads(model.sockets.preload, model.mechanism)
    }
}

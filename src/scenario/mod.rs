//! What a run does: desired motion, payload, things around the robot, sockets, supervision and sensors.
//!
//! A [`Scenario`] only describes; `twin` runs it.

pub mod motion;
pub mod sockets;

pub use motion::fourier::{FourierMotion, MotionLimits};
pub use motion::{Course, DesiredMotion, MotionError};
pub use sockets::SocketSetup;

use std::path::PathBuf;

use nalgebra::Vector3;

use crate::cell::{Object, Shape};
use crate::kinematics::motion::SOCKETS;
use crate::machine::{AXES, STRUTS, Setup};
use crate::model::Model;

/// A run of the twin, as described by a scenario file.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name for reports, the file's stem.
    pub name: String,
    /// Model file of the machine.
    pub model: PathBuf,
    /// Model file of the feed-forward, which also plans the motion; the machine's own without it.
    pub controller_model: Option<PathBuf>,
    /// Length, s.
    pub duration: f64,
    /// Seed of the sensor noise and of drawn socket holds.
    pub seed: u64,
    /// Whether sensors are noisy and quantised.
    pub noise: bool,
    /// Integration steps per control period.
    pub substeps: usize,
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
    /// Shape of the payload for collisions.
    pub payload_shape: Option<PayloadShape>,
    /// Things around the robot, each with its own name.
    pub objects: Vec<Object>,
    /// What the gripper does, in order of time.
    pub actions: Vec<Action>,
    /// Ball sockets.
    pub sockets: SocketSetup,
    /// When the drives trip.
    pub supervision: Supervision,
    /// What is recorded.
    pub sensors: Sensors,
}

/// Torque between two control instants.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HoldTorque {
    /// It changes linearly over the period, so that a recorded torque is the one that acts at its time stamp.
    #[default]
    Ramp,
    /// It stays constant over the period (zero-order hold).
    Hold,
}

/// How the twin solves the equations of motion.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Formulation {
    /// The rows of the joints are eliminated in closed form, as long as all sockets hold.
    #[default]
    Eliminated,
    /// Absolute coordinates: all bodies with six velocities each, all joints as rows with their multipliers.
    Absolute,
}

impl Formulation {
    /// All of them by name.
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

/// Controller gains; what is `None` keeps its default.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Gains {
    /// N·m/rad.
    pub proportional: Option<[f64; AXES]>,
    /// N·m·s/rad.
    pub derivative: Option<[f64; AXES]>,
    /// Cut-off of the low-pass on the differentiated error, Hz.
    pub cutoff: Option<f64>,
}

/// Shape of the payload.
#[derive(Clone, Debug, PartialEq)]
pub struct PayloadShape {
    /// Shape with its axes along those of the flange.
    pub shape: Shape,
    /// Its centre, m; origin at the flange centre, z up, turns with ψ.
    pub centre: Vector3<f64>,
}

/// Something the gripper does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Action {
    /// When, s.
    pub t: f64,
    /// What.
    pub kind: ActionKind,
}

/// What the gripper can do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ActionKind {
    /// Attaches an object, an index into [`Scenario::objects`].
    Pick(usize),
    /// Lets go of the object it holds.
    Release,
}

/// When the drives trip and what they do then.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Supervision {
    /// Largest torque of the feedback (not of the feed-forward) on an arm, N·m.
    pub torque: Option<f64>,
    /// Largest distance between desired and measured angle of an arm, rad.
    pub tracking: Option<f64>,
    /// Drives after a trip.
    pub trip: Trip,
}

/// Drives after a trip.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Trip {
    /// No torque.
    #[default]
    Coast,
    /// Brakes resist every motion.
    Brake {
        /// Torque of each brake at the gear output, N·m.
        torque: f64,
    },
}

/// What is recorded beside time, joint angles and torques.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sensors {
    /// Struts that carry a force sensor at the elbow.
    pub strut_upper: [bool; STRUTS],
    /// Struts that carry a force sensor at the platform.
    pub strut_lower: [bool; STRUTS],
    /// Platform ball plane's centre.
    pub ee: bool,
    /// Joint rates.
    pub velocity: bool,
    /// Joint accelerations.
    pub acceleration: bool,
    /// Margins of all sockets.
    pub sockets: bool,
    /// Multipliers of all constraint rows.
    pub multipliers: bool,
    /// Angles and rates of the links behind elastic gears.
    pub links: bool,
}

impl Default for Sensors {
    /// Only the platform's position.
    fn default() -> Self {
        let none = [false; STRUTS];
        Self {
            strut_upper: none,
            strut_lower: none,
            ee: true,
            velocity: false,
            acceleration: false,
            sockets: false,
            multipliers: false,
            links: false,
        }
    }
}

impl Scenario {
    /// The desired motion for a machine like `planning`, refused if it is out of reach.
    pub fn motion(&self, planning: &Model) -> Result<DesiredMotion, MotionError> {
        self.motion.on(planning, &self.setup)
    }

    /// Force at which each ball socket of `model` leaves its ball, N; 0..6 at the elbows, 6..12 at the platform.
    pub fn socket_holds(&self, model: &Model) -> [f64; SOCKETS] {
        self.sockets.holds(model.sockets.dislocation_force, self.seed)
    }

    /// Force that presses each cup of `model` on its ball, N, in the same order.
    pub fn socket_preloads(&self, model: &Model) -> [f64; SOCKETS] {
        self.sockets.preloads(model.sockets.preload)
    }
}

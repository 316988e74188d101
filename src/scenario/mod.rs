//! What a run does: desired motion, payload, things around the robot, sockets, supervision and sensors.
//!
//! A [`Scenario`] only describes; `twin` runs it. Only `read` knows TOML.

pub mod motion;
pub(crate) mod read;
pub mod sockets;
pub mod write;

pub use motion::fourier::{FourierMotion, MotionLimits};
pub use motion::{Course, DesiredMotion, MotionError};
pub use read::ScenarioError;
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

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::kinematics::{PlatformState, Target};

    fn shipped() -> Vec<Scenario> {
        let files = std::fs::read_dir("scenarios").unwrap().map(|e| e.unwrap().path());
        let is_run = |p: &PathBuf| {
            let table: toml::Table = std::fs::read_to_string(p).unwrap().parse().unwrap();
            table.contains_key("motion")
        };
        let files: Vec<PathBuf> = files.filter(|p| p.extension().is_some_and(|e| e == "toml") && is_run(p)).collect();
        assert!(files.len() >= 12, "{files:?}");
        files.iter().map(|f| Scenario::read(f).unwrap_or_else(|e| panic!("{e}"))).collect()
    }

    fn four(position: &Vector3<f64>, psi: f64) -> [f64; 4] {
        [position.x, position.y, position.z, psi]
    }

    /// Value, velocity and acceleration of the coordinates.
    fn derivatives(target: &Target) -> [[f64; 4]; 3] {
        match target {
            Target::Platform(p) => {
                [four(&p.position, p.psi[0]), four(&p.velocity, p.psi[1]), four(&p.acceleration, p.psi[2])]
            }
            Target::Joints(j) => [j.q, j.qd, j.qdd],
        }
    }

    fn platform(target: Target) -> PlatformState {
        let Target::Platform(p) = target else { panic!("{target:?}") };
        p
    }

    #[test]
    fn shipped_motions_are_in_reach_and_their_derivatives_agree() {
        for scenario in shipped() {
            let planning = Model::read(scenario.controller_model.as_ref().unwrap_or(&scenario.model)).unwrap();
            let motion = scenario.motion(&planning).unwrap_or_else(|e| panic!("{}: {e}", scenario.name));
            let h = 1e-6;
            for k in 0..400 {
                let t = 1e-3 + (scenario.duration - 2e-3) * k as f64 / 400.0;
                let [before, now, after] = [t - h, t, t + h].map(|t| derivatives(&motion.at(t)));
                for order in 0..2 {
                    for i in 0..4 {
                        let difference = (after[order][i] - before[order][i]) / (2.0 * h);
                        let error = (difference - now[order + 1][i]).abs();
                        // Half a step over the largest jump of jerk: 20000 m/s³ or rad/s³.
                        let allowed = 1e-5 + 0.02 * order as f64;
                        assert!(error < allowed, "{}: order {order}, coordinate {i} at {t}: {error}", scenario.name);
                    }
                }
            }
        }
    }

    #[test]
    fn shipped_runs_are_short_and_have_what_they_need() {
        let by_name = |name: &str| shipped().into_iter().find(|s| s.name == name).unwrap();
        for name in ["crash", "touch", "pick-and-place", "worn-sockets", "path", "table", "static-poses", "smoke"] {
            let scenario = by_name(name);
            assert!(scenario.duration <= 3.0, "{name} takes {} s", scenario.duration);
        }
        let crash = by_name("crash");
        assert!(crash.sockets.armed && crash.objects.iter().any(|o| o.name == "block"));
        let worn = by_name("worn-sockets");
        let holds = worn.socket_holds(&Model::read(&worn.model).unwrap());
        assert!(holds[6] < 80.0 && holds[7] < 80.0 && holds[0] > 150.0, "{holds:?}");
        // The gripper stands over the can when it picks, and over the block when it lets go.
        let place = by_name("pick-and-place");
        let motion = place.motion(&Model::read(&place.model).unwrap()).unwrap();
        for action in &place.actions {
            let state = platform(motion.at(action.t));
            assert!(state.velocity.norm() == 0.0, "{action:?}: {}", state.velocity);
        }
        let can = place.objects.iter().find(|o| o.name == "can").unwrap();
        let belt = place.objects.iter().find(|o| o.name == "belt").unwrap();
        let crate::cell::Mobility::Conveyor { velocity } = belt.mobility else { panic!("{belt:?}") };
        let brought = can.position + velocity * place.actions[0].t;
        let gripper = platform(motion.at(place.actions[0].t)).position;
        assert!((brought - gripper).xy().norm() < 5e-3, "{brought} {gripper}");
    }

    #[test]
    fn joint_motions_turn_only_their_axis() {
        let text = "model = \"../models/irb360-6-1600.toml\"\n[motion]\nkind = \"constant_speed\"\naxis = 2\n\
                    pose = [0.05, 0, -1, 1]\nbetween = [0.2, 0.6]\nspeeds = [0.5, 2]\nacceleration = 40\n";
        let scenario = Scenario::parse(text, Path::new("scenarios/test.toml")).unwrap();
        let model = Model::read(&scenario.model).unwrap();
        let motion = scenario.motion(&model).unwrap();
        let held = model.geometry.inverse(&Vector3::new(0.05, 0.0, -1.0)).unwrap();
        for k in 0..=100 {
            let joints = motion.at(scenario.duration * k as f64 / 100.0).joints(&model.geometry).unwrap();
            assert!((joints.q[0] - held[0]).abs() < 1e-9 && (joints.q[2] - held[2]).abs() < 1e-9);
            assert!(joints.qd[0].abs() < 1e-9 && joints.qdd[2].abs() < 1e-7 && joints.q[3] == 1.0);
            assert!((0.2 - 1e-9..0.6 + 1e-9).contains(&joints.q[1]));
        }
    }
}

//! The assembled mechanism in closed form: from ten open velocities and six strut spins to every body and joint.
//!
//! All joints but the lengths of the struts hold by construction: the state has three arm angles, the rotor's angle, the
//! platform's pose and the roll of each strut. Struts are rods between two moving points a (elbow) and b (platform): with
//! velocities linear between them their mass matrix ½(m_aa v_a² + 2 m_ab v_a·v_b + m_bb v_b²) is constant, so they
//! leave the equations in closed form and bring no velocity products. What remains couples each drive with the
//! platform only:
//!
//! M̂ ν̇ + Bᵀ T = f̂, B ν̇ = c, ν = (φ̇ of three arms, ψ̇ of the rotor, platform v and ω), T the struts' tensions.
//!
//! B is square in the platform's twist. Rigid struts make the platform follow the arms (null space of B), elastic
//! struts turn T into a force law.

mod chain;
mod closure;
mod energy;
mod equations;
mod frame;
mod pairs;
mod recovery;

use nalgebra::{Quaternion, SMatrix, SVector, Vector3};

pub(super) use equations::Implicit;
use equations::{Equations, Loads};
pub(super) use frame::Frame;

use super::SingularPose;
use super::context::Answer;
use super::rod::{Rod, platform_ball};
use super::wrench::Twist;
use crate::dynamics::Plant;
use crate::effects::{ActiveEffect, StrutSpring};
use crate::kinematics::Reactions;
use crate::kinematics::motion::SOCKETS;
use crate::machine::bodies::{BODIES, END_EFFECTOR, Inertia, PLATFORM};
use crate::machine::{ARMS, AXES, Geometry, STRUTS};

/// Open velocities ν.
pub(super) const OPEN: usize = 10;
/// Where the platform's velocity stands in ν; its angular velocity follows.
pub(super) const PLATFORM_V: usize = 4;

pub(super) type OpenVector = SVector<f64, OPEN>;
type Vector6 = SVector<f64, 6>;
type Matrix6 = SMatrix<f64, 6, 6>;

/// Configuration of the opened mechanism.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// Arm angles, rad.
    pub phi: [f64; ARMS],
    /// Rotor angle with all its turns, rad.
    pub psi: f64,
    /// Platform origin, m.
    pub position: Vector3<f64>,
    /// Platform orientation, body to world; of unit length to rounding.
    pub orientation: Quaternion<f64>,
    /// Roll of each strut about its axis from where its y faces along its pair, rad.
    pub roll: [f64; STRUTS],
}

/// What does not change during a run.
pub(super) struct Mechanism {
    geometry: Geometry,
    rods: [Rod; STRUTS],
    /// Platform with the rods' masses at its balls, platform frame.
    laden_platform: Inertia,
    /// Whether the end effector weighs anything.
    loaded: bool,
    /// Elastic struts; rigid without.
    pub springs: Option<[StrutSpring; STRUTS]>,
}

/// Solution of the equations of motion.
#[derive(Clone, Copy)]
pub(super) struct Solution {
    /// ν̇.
    pub nu_rate: OpenVector,
    /// Angular acceleration of each strut about its axis, rad/s².
    pub spin_rate: [f64; STRUTS],
    /// Axial forces at the balls.
    pub reactions: Reactions,
    /// Force on each strut at its sockets (six upper, six lower), N, world.
    pub socket_force: [Vector3<f64>; SOCKETS],
}

impl Solution {
    /// What laws may read of it.
    pub fn answer(&self) -> Answer {
        let rate = self.nu_rate.as_slice();
        let drives = std::array::from_fn(|axis| rate[axis]);
        Answer { reactions: self.reactions, drives, platform: Vector3::new(rate[4], rate[5], rate[6]) }
    }
}

impl Mechanism {
    pub fn new(plant: &Plant) -> Self {
        let geometry = plant.geometry;
        let rods = Rod::all(plant);
        let mut laden_platform = plant.bodies[PLATFORM];
        for (s, rod) in rods.iter().enumerate() {
            laden_platform += Inertia::point(rod.bb, platform_ball(&geometry, s));
        }
        let end_effector = &plant.bodies[END_EFFECTOR];
        let springs = plant.effects.iter().find_map(ActiveEffect::strut_spring);
        Self { geometry, rods, laden_platform, loaded: *end_effector != Inertia::ZERO, springs }
    }

    /// Solves the equations of motion under wrenches on all bodies (about their origins, world axes) and drive torques.
    ///
    /// # Errors
    /// Where the struts' length rows are linearly dependent.
    pub fn solve(
        &self,
        plant: &Plant,
        frame: &Frame,
        wrenches: &[Twist; BODIES],
        tau: &[f64; AXES],
        implicit: &Implicit,
    ) -> Result<Solution, SingularPose> {
        let loads = Loads { plant, frame, wrenches, tau, implicit, gravity: plant.gravity_vector() };
        let mut equations = Equations::of_platform(self, &loads);
        equations.add_arms(&loads);
        equations.add_struts(self, &loads);
        let (nu_rate, tension) = match &self.springs {
            Some(springs) => equations.solve_elastic(self, springs, &loads)?,
            None => equations.solve_rigid()?,
        };
        if !nu_rate.iter().all(|x| x.is_finite()) {
            return Err(SingularPose);
        }
        Ok(self.recover(&loads, &equations.ends, nu_rate, &tension))
    }
}

fn join(a: &Vector3<f64>, b: &Vector3<f64>) -> Vector6 {
    Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z)
}

fn add(x: &mut Vector6, a: &Vector3<f64>, b: &Vector3<f64>) {
    *x += join(a, b);
}

fn platform_twist(nu: &OpenVector) -> Twist {
    (Vector3::new(nu[4], nu[5], nu[6]), Vector3::new(nu[7], nu[8], nu[9]))
}

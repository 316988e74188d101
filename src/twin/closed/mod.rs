//! Closed-form elimination for the assembled mechanism: all bodies and joints from ten open velocities and six strut
//! spins.
//!
//! All joints except the strut lengths are satisfied by construction: the state consists of three arm angles, the rotor
//! angle, the platform pose and the roll of each strut. Struts are rods between two moving points a (elbow) and b
//! (platform): with velocities linear between them, the mass matrix of ½(m_aa v_a² + 2 m_ab v_a·v_b + m_bb v_b²) is
//! constant, so that they are eliminated in closed form and produce no velocity products. In the remaining equations
//! each drive is coupled with the platform only:
//!
//! M̂ ν̇ + Bᵀ T = f̂, B ν̇ = c, ν = (φ̇ of three arms, ψ̇ of the rotor, platform v and ω), T the strut tensions.
//!
//! The platform part of B is square. With rigid struts the platform follows the arms (null space of B), with elastic
//! struts T is given by a force law.

mod blocks;
mod chain;
mod closure;
mod energy;
mod equations;
mod frame;
mod pairs;
mod recovery;

use nalgebra::{Matrix3, Quaternion, SVector, Vector3};

use equations::Equations;
pub(super) use equations::{Implicit, Loads};
pub(super) use frame::Frame;

use super::SingularPose;
use super::context::Answer;
use super::rod::Rod;
use super::wrench::Twist;
use crate::dynamics::Plant;
use crate::effects::{ActiveEffect, StrutSpring};
use crate::kinematics::Reactions;
use crate::machine::bodies::{self, END_EFFECTOR, Inertia, PLATFORM, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{Geometry, PerSocket, PerStrut, SixStruts, ThreeArms, each};

/// Open velocities ν.
pub(super) const OPEN: usize = 10;
/// Position of the platform velocity in ν; the angular velocity follows.
pub(super) const PLATFORM_V: usize = 4;

pub(super) type OpenVector = SVector<f64, OPEN>;

/// Configuration of the opened mechanism.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pose {
    /// Arm angles, rad.
    pub phi: ThreeArms<f64>,
    /// Rotor angle including full turns, rad.
    pub psi: f64,
    /// Platform origin, m.
    pub position: Vector3<f64>,
    /// Platform orientation, body to inertial axes; a unit quaternion up to rounding.
    pub orientation: Quaternion<f64>,
    /// Roll of each strut about its axis, relative to the orientation in which its y axis faces along the pair, rad.
    pub roll: SixStruts<f64>,
}

/// Data that are constant during a run.
pub(super) struct Mechanism {
    pub geometry: Geometry,
    rods: SixStruts<Rod>,
    /// Lower balls in the platform's frame, m.
    balls: SixStruts<Vector3<f64>>,
    /// Both parts of the telescope about their Hooke joints, in the frame of the telescope, kg·m².
    telescope: Matrix3<f64>,
    /// Platform with the rods' masses at its balls, platform frame.
    laden_platform: Inertia,
    /// Whether the end effector has inertia.
    loaded: bool,
    /// Elastic struts; `None` if they are rigid.
    pub springs: Option<PerStrut<StrutSpring>>,
}

/// Solution of the equations of motion.
#[derive(Clone, Copy)]
pub(super) struct Solution {
    /// ν̇.
    pub nu_rate: OpenVector,
    /// Angular acceleration of each strut about its axis, rad/s².
    pub spin_rate: SixStruts<f64>,
    /// Axial strut forces at the balls.
    pub reactions: Reactions,
    /// Force on each strut at its sockets (six upper, six lower), N, inertial axes.
    pub socket_force: PerSocket<Vector3<f64>>,
}

impl Solution {
    /// A solution without motion and forces.
    pub fn zero() -> Self {
        Self {
            nu_rate: OpenVector::zeros(),
            spin_rate: each(0.0),
            reactions: Reactions::default(),
            socket_force: each(Vector3::zeros()),
        }
    }

    /// Writes the part of the solution on which laws may depend, without the accelerations of the bodies.
    pub fn write(&self, answer: &mut Answer) {
        let rate = self.nu_rate.as_slice();
        answer.reactions = self.reactions;
        answer.drives = std::array::from_fn(|axis| rate[axis]);
        answer.platform = Vector3::new(rate[4], rate[5], rate[6]);
    }
}

impl Mechanism {
    pub fn new(plant: &Plant) -> Self {
        let geometry = plant.geometry;
        let rods = std::array::from_fn(|s| Rod::new(&plant.bodies[bodies::strut(s)], geometry.strut_length(s)));
        let balls = std::array::from_fn(|s| geometry.platform_ball(s));
        let mut laden_platform = plant.bodies[PLATFORM];
        for (rod, ball) in rods.iter().zip(&balls) {
            laden_platform += Inertia::point(rod.bb, *ball);
        }
        let telescope = plant.bodies[TELESCOPE_UPPER].tensor + plant.bodies[TELESCOPE_LOWER].tensor;
        let end_effector = &plant.bodies[END_EFFECTOR];
        let springs = plant.effects.iter().find_map(ActiveEffect::strut_spring);
        Self { geometry, rods, balls, telescope, laden_platform, loaded: *end_effector != Inertia::ZERO, springs }
    }

    /// Writes the solution of the equations of motion under wrenches on all bodies (about their origins, inertial axes)
    /// and drive torques.
    ///
    /// # Errors
    /// [`SingularPose`] if the length rows of the struts are linearly dependent.
    pub fn solve(&self, loads: &Loads, out: &mut Solution) -> Result<(), SingularPose> {
        let mut equations = Equations::of_platform(self, loads);
        equations.add_arms(loads);
        equations.add_struts(self, loads);
        let (nu_rate, tension) = match &self.springs {
            Some(springs) => equations.solve_elastic(self, springs, loads)?,
            None => equations.solve_rigid()?,
        };
        if !nu_rate.iter().all(|x| x.is_finite()) {
            return Err(SingularPose);
        }
        self.recover(loads, &equations.ends, (nu_rate, &tension), out);
        Ok(())
    }
}

fn platform_twist(nu: &OpenVector) -> Twist {
    (Vector3::new(nu[4], nu[5], nu[6]), Vector3::new(nu[7], nu[8], nu[9]))
}

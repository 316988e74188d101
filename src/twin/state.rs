//! State of the twin: pose and twist of every body in absolute coordinates.

use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use crate::kinematics::{BodyMotion, Motion, Telescope};
use crate::model::bodies::{ARM, BODIES, ROTOR, STRUT, TELESCOPE_LOWER};
use crate::model::{ARMS, Geometry, STRUTS};

/// Pose and twist of one body frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyState {
    /// Origin, m, world.
    pub position: Vector3<f64>,
    /// Orientation, body to world; of unit length after every step.
    pub orientation: Quaternion<f64>,
    /// Velocity of the origin, m/s, world.
    pub velocity: Vector3<f64>,
    /// Angular velocity, rad/s, in the *body* frame.
    pub angular_velocity: Vector3<f64>,
}

/// State of the whole mechanism at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// Time, s.
    pub t: f64,
    /// Fourteen bodies.
    pub bodies: [BodyState; BODIES],
    /// Angle of motor 4 at the gear output with all its turns, rad.
    pub psi: f64,
    /// Own states of the effects, in the order of the plant's effects.
    pub own: Vec<f64>,
    /// Work done since the start, J: four drives, strut-spin restraint, then each effect.
    pub work: Vec<f64>,
}

impl State {
    /// State for a motion.
    pub fn from_motion(motion: &Motion, own: Vec<f64>, effects: usize) -> Self {
        Self {
            t: 0.0,
            bodies: motion.bodies.map(|b| BodyState {
                position: b.position,
                orientation: *UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(b.rotation)),
                velocity: b.velocity,
                angular_velocity: b.rotation.tr_mul(&b.angular_velocity),
            }),
            psi: motion.q[3],
            own,
            work: vec![0.0; WORK_EFFECTS + effects],
        }
    }

    /// Motion of all bodies, with zero accelerations.
    pub fn motion(&self, geometry: &Geometry) -> Motion {
        let bodies = self.bodies.map(|b| {
            let rotation = rotation(&b.orientation);
            BodyMotion {
                rotation,
                position: b.position,
                velocity: b.velocity,
                angular_velocity: rotation * b.angular_velocity,
                ..BodyMotion::REST
            }
        });
        let mut q = [0.0, 0.0, 0.0, self.psi + wrapped(heading(&bodies[ROTOR].rotation) - self.psi)];
        let mut qd = [0.0, 0.0, 0.0, self.bodies[ROTOR].angular_velocity.z];
        for i in 0..ARMS {
            let x = bodies[ARM + i].rotation.column(0);
            q[i] = (-x.z).atan2(x.dot(&Geometry::radial(i)));
            qd[i] = self.bodies[ARM + i].angular_velocity.y;
        }
        let bar = geometry.upper_hooke() - bodies[TELESCOPE_LOWER].position;
        let length = bar.norm();
        let axis = bar / length;
        Motion {
            q,
            qd,
            qdd: [0.0; 4],
            strut_axis: std::array::from_fn(|s| bodies[STRUT + s].rotation.column(0).into_owned()),
            strut_length: std::array::from_fn::<_, STRUTS, _>(|s| geometry.strut_length[s / 2]),
            telescope: Telescope { axis, length, rate: -axis.dot(&bodies[TELESCOPE_LOWER].velocity) },
            bodies,
        }
    }
}

/// Where the work of the spin restraint stands in [`State::work`].
pub(super) const WORK_SPIN: usize = 4;
/// Where the work of the effects starts in [`State::work`].
pub(super) const WORK_EFFECTS: usize = 5;

/// Rotation matrix of a quaternion that may be slightly off unit length.
pub(super) fn rotation(q: &Quaternion<f64>) -> Matrix3<f64> {
    UnitQuaternion::new_normalize(*q).to_rotation_matrix().into_inner()
}

/// Angle of a rotation about z.
fn heading(r: &Matrix3<f64>) -> f64 {
    r[(1, 0)].atan2(r[(0, 0)])
}

/// Angle in −π..π.
pub(super) fn wrapped(angle: f64) -> f64 {
    angle - std::f64::consts::TAU * (angle / std::f64::consts::TAU).round()
}

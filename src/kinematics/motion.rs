//! [`Motion`]: pose, twist and acceleration of all bodies and the rates of all joints at one time.

use nalgebra::{Matrix3, Vector3};

use crate::model::bodies::{ARM, BODIES, PLATFORM, ROTOR, STRUT};
use crate::model::{AXES, Geometry, STRUTS};

/// Motion of one body frame in the inertial frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyMotion {
    /// Rotation, maps body to world.
    pub rotation: Matrix3<f64>,
    /// Position of the body frame's origin, m.
    pub position: Vector3<f64>,
    /// Velocity of the origin, m/s.
    pub velocity: Vector3<f64>,
    /// Angular velocity, rad/s, world axes.
    pub angular_velocity: Vector3<f64>,
    /// Acceleration of the origin, m/s².
    pub acceleration: Vector3<f64>,
    /// Angular acceleration, rad/s², world axes.
    pub angular_acceleration: Vector3<f64>,
}

impl BodyMotion {
    /// At rest in the inertial frame's origin.
    pub const REST: Self = Self {
        rotation: Matrix3::new(1., 0., 0., 0., 1., 0., 0., 0., 1.),
        position: Vector3::new(0., 0., 0.),
        velocity: Vector3::new(0., 0., 0.),
        angular_velocity: Vector3::new(0., 0., 0.),
        acceleration: Vector3::new(0., 0., 0.),
        angular_acceleration: Vector3::new(0., 0., 0.),
    };
}

/// The telescope between its two Hooke joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Telescope {
    /// Unit vector up along the bar.
    pub axis: Vector3<f64>,
    /// Distance of the Hooke joints, m.
    pub length: f64,
    /// Its rate, lengthening positive, m/s.
    pub rate: f64,
}

/// Axial forces in the struts, tension positive, N.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reactions {
    /// At the elbow end.
    pub upper: [f64; STRUTS],
    /// At the platform end.
    pub lower: [f64; STRUTS],
}

/// Motion of all joints and bodies at one time.
///
/// Of a disassembled robot only the arms and the rotor move; the other bodies rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Joint angles, rad.
    pub q: [f64; AXES],
    /// Joint rates, rad/s.
    pub qd: [f64; AXES],
    /// Joint accelerations, rad/s².
    pub qdd: [f64; AXES],
    /// Body frames, see [`crate::model::Bodies`].
    pub bodies: [BodyMotion; BODIES],
    /// Unit vector of each strut from the elbow to the platform.
    pub strut_axis: [Vector3<f64>; STRUTS],
    /// Telescope.
    pub telescope: Telescope,
}

/// Number of ball sockets: 0..6 at the elbows (struts 1–6), 6..12 at the platform.
pub const SOCKETS: usize = 2 * STRUTS;

impl Motion {
    /// Body a drive acts on and its axis in the inertial frame.
    pub fn drive(axis: usize) -> (usize, Vector3<f64>) {
        if axis < 3 { (ARM + axis, Geometry::tangential(axis)) } else { (ROTOR, Vector3::z()) }
    }

    /// The strut at `socket` and the body that carries the ball.
    pub fn socket_bodies(socket: usize) -> (usize, usize) {
        let strut = socket % STRUTS;
        (STRUT + strut, if socket < STRUTS { ARM + strut / 2 } else { PLATFORM })
    }

    /// Angular velocity of the strut relative to the ball at `socket`, rad/s.
    pub fn socket_rate(&self, socket: usize) -> Vector3<f64> {
        let (strut, partner) = Self::socket_bodies(socket);
        self.bodies[strut].angular_velocity - self.bodies[partner].angular_velocity
    }
}

//! [`Motion`]: pose, twist and acceleration of all bodies, and the rates of all joints, at one time.

use nalgebra::{Isometry3, Matrix3, Rotation3, UnitQuaternion, Vector3};

use super::arm::{Arm, Screw};
use super::delta::{JointState, KinematicsError, PlatformState};
use super::telescope::{Telescope, telescope_motion};
use crate::machine::bodies::{ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::{ARMS, AXES, Geometry, Joint, Mechanism, STRUTS};

/// Motion of one body frame in the inertial frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyMotion {
    /// Rotation matrix, maps body axes to inertial axes.
    pub rotation: Matrix3<f64>,
    /// Position of the frame origin, m.
    pub position: Vector3<f64>,
    /// Velocity of the origin, m/s.
    pub velocity: Vector3<f64>,
    /// Angular velocity in inertial axes, rad/s.
    pub angular_velocity: Vector3<f64>,
    /// Acceleration of the origin, m/s².
    pub acceleration: Vector3<f64>,
    /// Angular acceleration in inertial axes, rad/s².
    pub angular_acceleration: Vector3<f64>,
}

impl BodyMotion {
    /// Frame at rest, coincident with the inertial frame.
    pub const REST: Self = Self {
        rotation: Matrix3::new(1., 0., 0., 0., 1., 0., 0., 0., 1.),
        position: Vector3::new(0., 0., 0.),
        velocity: Vector3::new(0., 0., 0.),
        angular_velocity: Vector3::new(0., 0., 0.),
        acceleration: Vector3::new(0., 0., 0.),
        angular_acceleration: Vector3::new(0., 0., 0.),
    };
}

impl BodyMotion {
    /// Sets pose and twist; the accelerations are unchanged.
    pub fn place(
        &mut self,
        rotation: Matrix3<f64>,
        position: Vector3<f64>,
        velocity: Vector3<f64>,
        angular_velocity: Vector3<f64>,
    ) {
        self.rotation = rotation;
        self.position = position;
        self.velocity = velocity;
        self.angular_velocity = angular_velocity;
    }
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
/// On a disassembled robot only the arms and the rotor move; the other bodies are at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Joint type of the arms.
    pub arms: Joint,
    /// Joint angles, rad; m for carriages.
    pub q: [f64; AXES],
    /// Joint rates, rad/s.
    pub qd: [f64; AXES],
    /// Joint accelerations, rad/s².
    pub qdd: [f64; AXES],
    /// Body frames, see [`crate::machine::Bodies`].
    pub bodies: [BodyMotion; BODIES],
    /// Unit vector of each strut, from elbow to platform.
    pub strut_axis: [Vector3<f64>; STRUTS],
    /// Distance between the two balls of each strut, m.
    pub strut_length: [f64; STRUTS],
    /// Telescope.
    pub telescope: Telescope,
}

/// Number of ball sockets: 0..6 at the elbows (struts 1–6), 6..12 at the platform.
pub const SOCKETS: usize = 2 * STRUTS;

/// Set of ball sockets.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SocketSet(u16);

impl SocketSet {
    /// All twelve sockets.
    pub const ALL: Self = Self((1 << SOCKETS) - 1);

    /// Whether `socket` (below [`SOCKETS`]) is in the set.
    pub fn contains(self, socket: usize) -> bool {
        self.0 >> socket & 1 == 1
    }

    /// The set without `socket` (below [`SOCKETS`]).
    #[must_use]
    pub fn without(self, socket: usize) -> Self {
        Self(self.0 & !(1 << socket))
    }

    /// Sockets of the set in ascending order.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        (0..SOCKETS).filter(move |&s| self.contains(s))
    }
}

impl Motion {
    /// Poses of the body frames in the inertial frame, translation in m.
    pub fn poses(&self) -> [Isometry3<f64>; BODIES] {
        self.bodies.map(|b| {
            let rotation = Rotation3::from_matrix_unchecked(b.rotation);
            Isometry3::from_parts(b.position.into(), UnitQuaternion::from_rotation_matrix(&rotation))
        })
    }

    /// Poses for display: the moving part of a prismatic axis is translated along x by its coordinate.
    pub fn shown(&self, machine: Mechanism) -> [Isometry3<f64>; BODIES] {
        let mut poses = self.poses();
        if machine.joint() == Joint::Prismatic {
            poses[ARM] = Isometry3::translation(self.q[0], 0.0, 0.0);
        }
        poses
    }

    /// Body on which the drive of `axis` (0..4) acts, and the screw of its joint.
    ///
    /// # Panics
    /// If there is no `axis`.
    #[inline]
    pub fn drive(&self, axis: usize) -> (usize, Screw) {
        let body = Self::driven(axis);
        let screw = match (axis, self.arms) {
            (ARMS.., _) => Screw::turning(Vector3::z()),
            (_, Joint::Revolute) => Screw::turning(Geometry::tangential(axis)),
            (_, Joint::Prismatic) => Screw::sliding(self.bodies[body].rotation.column(0).into_owned()),
        };
        (body, screw)
    }

    /// Body on which the drive of `axis` (0..4) acts.
    pub fn driven(axis: usize) -> usize {
        if axis < ARMS { ARM + axis } else { ROTOR }
    }

    /// Indices of the strut at `socket` and of the body that carries the ball.
    pub fn socket_bodies(socket: usize) -> (usize, usize) {
        let strut = socket % STRUTS;
        (STRUT + strut, if socket < STRUTS { ARM + strut / 2 } else { PLATFORM })
    }

    /// Angular velocity of the strut relative to the body that carries the ball at `socket`, inertial axes, rad/s.
    pub fn socket_rate(&self, socket: usize) -> Vector3<f64> {
        let (strut, partner) = Self::socket_bodies(socket);
        self.bodies[strut].angular_velocity - self.bodies[partner].angular_velocity
    }
}

impl Motion {
    /// Motion of the assembled robot for a joint motion, with the platform in pure translation and struts that do not
    /// spin.
    ///
    /// # Errors
    /// Those of [`Geometry::forward_motion`].
    pub fn assembled(geometry: &Geometry, joints: &JointState) -> Result<Self, KinematicsError> {
        let platform = geometry.forward_motion(joints)?;
        Ok(Self::with_platform(geometry, joints, &platform))
    }

    /// Motion of the arms and the rotor of a disassembled robot.
    pub fn disassembled(geometry: &Geometry, joints: &JointState) -> Self {
        let mut motion = Self {
            arms: geometry.arms.joint(),
            q: joints.q,
            qd: joints.qd,
            qdd: joints.qdd,
            bodies: [BodyMotion::REST; BODIES],
            strut_axis: [Vector3::zeros(); STRUTS],
            strut_length: std::array::from_fn(|s| geometry.strut_length[s / 2]),
            telescope: Telescope { axis: Vector3::z(), length: 0.0, rate: 0.0 },
        };
        for i in 0..ARMS {
            motion.bodies[ARM + i] = arm_motion(geometry, i, joints);
        }
        motion.bodies[ROTOR] = BodyMotion {
            rotation: rotation_z(joints.q[3]),
            position: geometry.upper_hooke(),
            angular_velocity: Vector3::z() * joints.qd[3],
            angular_acceleration: Vector3::z() * joints.qdd[3],
            ..BodyMotion::REST
        };
        motion
    }

    /// Motion of the assembled robot for a joint motion and the platform motion consistent with it.
    pub fn with_platform(geometry: &Geometry, joints: &JointState, platform: &PlatformState) -> Self {
        let mut motion = Self::disassembled(geometry, joints);
        let [psi, psi_rate, psi_acceleration] = platform.psi;
        for strut in 0..STRUTS {
            let limb = strut / 2;
            let (body, axis) = strut_motion(geometry, strut, &motion.bodies[ARM + limb], platform);
            motion.bodies[STRUT + strut] = body;
            motion.strut_axis[strut] = axis;
        }
        motion.bodies[PLATFORM] = BodyMotion {
            position: platform.position,
            velocity: platform.velocity,
            acceleration: platform.acceleration,
            ..BodyMotion::REST
        };
        motion.bodies[END_EFFECTOR] = BodyMotion {
            rotation: rotation_z(psi),
            position: platform.position + Vector3::z() * geometry.flange_height,
            angular_velocity: Vector3::z() * psi_rate,
            angular_acceleration: Vector3::z() * psi_acceleration,
            ..motion.bodies[PLATFORM]
        };
        let lower_hooke = platform.position + Vector3::z() * geometry.lower_hooke_height;
        let (rotor, hooke) = (&motion.bodies[ROTOR], geometry.upper_hooke());
        let (upper, lower, telescope) =
            telescope_motion(hooke, lower_hooke, rotor, platform.velocity, platform.acceleration);
        motion.bodies[TELESCOPE_UPPER] = upper;
        motion.bodies[TELESCOPE_LOWER] = lower;
        motion.telescope = telescope;
        motion
    }

    /// Motion along a path at path speed `speed` (ṡ) and path acceleration `acceleration` (s̈).
    ///
    /// `first` is the motion at (ṡ, s̈) = (1, 0), `second` that at (0, 1).
    pub fn along(first: &Self, second: &Self, speed: f64, acceleration: f64) -> Self {
        let square = speed * speed;
        let mut motion = *first;
        for k in 0..AXES {
            motion.qd[k] *= speed;
            motion.qdd[k] = first.qdd[k] * square + second.qdd[k] * acceleration;
        }
        for (body, unit) in motion.bodies.iter_mut().zip(&second.bodies) {
            body.velocity *= speed;
            body.angular_velocity *= speed;
            body.acceleration = body.acceleration * square + unit.acceleration * acceleration;
            body.angular_acceleration = body.angular_acceleration * square + unit.angular_acceleration * acceleration;
        }
        motion.telescope.rate *= speed;
        motion
    }
}

fn rotation_z(angle: f64) -> Matrix3<f64> {
    let (s, c) = angle.sin_cos();
    Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0)
}

fn arm_motion(geometry: &Geometry, limb: usize, joints: &JointState) -> BodyMotion {
    let arm = Arm::new(geometry, limb, joints.q[limb]);
    let screw = arm.screw(geometry, limb);
    BodyMotion {
        rotation: arm.rotation(limb),
        position: arm.origin,
        velocity: screw.linear * joints.qd[limb],
        angular_velocity: screw.angular * joints.qd[limb],
        acceleration: screw.linear * joints.qdd[limb],
        angular_acceleration: screw.angular * joints.qdd[limb],
    }
}

fn strut_motion(
    geometry: &Geometry,
    strut: usize,
    arm: &BodyMotion,
    platform: &PlatformState,
) -> (BodyMotion, Vector3<f64>) {
    let limb = strut / 2;
    let length = geometry.strut_length[limb];
    let v = Geometry::tangential(limb);
    // The ball pair is parallel to the motor axis, so that only the arm length contributes to the lever.
    let lever = arm.rotation.column(0) * geometry.arm_length;
    let elbow = arm.position + lever;
    let axis = (platform.position + Geometry::radial(limb) * geometry.platform_radius - elbow) / length;
    let velocity = arm.velocity + arm.angular_velocity.cross(&lever);
    let acceleration = arm.acceleration
        + arm.angular_acceleration.cross(&lever)
        + arm.angular_velocity.cross(&arm.angular_velocity.cross(&lever));
    let axis_rate = (platform.velocity - velocity) / length;
    let axis_acceleration = (platform.acceleration - acceleration) / length;
    let body = BodyMotion {
        rotation: strut_rotation(&axis, &v),
        position: elbow + v * geometry.pair_offset(strut),
        velocity,
        angular_velocity: axis.cross(&axis_rate),
        acceleration,
        angular_acceleration: axis.cross(&axis_acceleration),
    };
    (body, axis)
}

/// Strut frame: x along the strut, y the projection of the pair direction `v` normal to x.
fn strut_rotation(axis: &Vector3<f64>, v: &Vector3<f64>) -> Matrix3<f64> {
    let y = (v - axis * axis.dot(v)).normalize();
    Matrix3::from_columns(&[*axis, y, axis.cross(&y)])
}

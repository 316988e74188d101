//! [`Motion`]: pose, twist and acceleration of all bodies, and the rates of all joints, at one time.

use nalgebra::{Isometry3, Matrix3, Matrix6, Rotation3, UnitQuaternion, Vector3};

use super::arm::{Arm, Screw};
use super::closure::Closed;
use super::delta::{JointState, KinematicsError, PlatformState};
use super::telescope::{Telescope, telescope_motion};
use crate::machine::bodies::{
    ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER, arm, strut,
};
use crate::machine::{
    Geometry, Joint, Limb, Mechanism, PerAxis, PerLimb, PerStrut, Plate, TELESCOPE_AXIS, each, every_axis,
    may_have_telescope, six_struts, three_arms,
};

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
    pub upper: PerStrut<f64>,
    /// At the platform end.
    pub lower: PerStrut<f64>,
}

impl Reactions {
    /// No forces.
    pub const ZERO: Self = Self { upper: each(0.0), lower: each(0.0) };

    /// Forces of the first struts at the elbows and at the platform, N.
    ///
    /// # Panics
    /// If there are more than a [`PerStrut`] holds.
    pub fn of(upper: &[f64], lower: &[f64]) -> Self {
        let mut out = Self::ZERO;
        out.upper[..upper.len()].copy_from_slice(upper);
        out.lower[..lower.len()].copy_from_slice(lower);
        out
    }
}

/// Motion of all joints and bodies at one time.
///
/// On a disassembled robot only the arms and the rotor move; the other bodies are at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Joint type of the arms.
    pub arms: Joint,
    /// Number of limbs.
    pub limbs: usize,
    /// Number of limbs whose arm has a drive, the first ones.
    pub driven: usize,
    /// Unit vector along the shaft of each limb.
    pub shaft: PerLimb<Vector3<f64>>,
    /// Joint angles, rad; m for carriages.
    pub q: PerAxis<f64>,
    /// Joint rates, rad/s.
    pub qd: PerAxis<f64>,
    /// Joint accelerations, rad/s².
    pub qdd: PerAxis<f64>,
    /// Body frames, see [`crate::machine::Bodies`].
    pub bodies: [BodyMotion; SLOTS],
    /// Unit vector of each strut, from elbow to platform.
    pub strut_axis: PerStrut<Vector3<f64>>,
    /// Distance between the two balls of each strut, m.
    pub strut_length: PerStrut<f64>,
    /// Body that carries the lower ball of each strut.
    pub carrier: PerStrut<usize>,
    /// Telescope.
    pub telescope: Telescope,
}

/// Twist (velocity of the frame origin, angular velocity) or wrench (force, moment about the origin) of a body,
/// inertial axes.
pub type Twist = (Vector3<f64>, Vector3<f64>);

/// Zero twist or wrench.
pub(crate) const STILL: Twist = (Vector3::new(0., 0., 0.), Vector3::new(0., 0., 0.));

/// Set of ball sockets, at most two per strut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SocketSet(u16);

impl SocketSet {
    /// All twelve sockets of three limbs.
    pub const ALL: Self = Self::of(six_struts().end);

    /// All sockets of a machine with this number of struts.
    pub const fn of(struts: usize) -> Self {
        Self(((1_u32 << (2 * struts)) - 1) as u16)
    }

    /// Whether `socket` is in the set.
    pub fn contains(self, socket: usize) -> bool {
        self.0 >> socket & 1 == 1
    }

    /// The set without `socket`.
    #[must_use]
    pub fn without(self, socket: usize) -> Self {
        Self(self.0 & !(1 << socket))
    }

    /// Sockets of the set in ascending order.
    pub fn iter(self) -> impl Iterator<Item = usize> {
        let mut rest = self.0;
        std::iter::from_fn(move || {
            let first = (rest != 0).then(|| rest.trailing_zeros() as usize);
            rest &= rest.wrapping_sub(1);
            first
        })
    }
}

impl Motion {
    /// Poses of the body frames in the inertial frame, translation in m.
    pub fn poses(&self) -> [Isometry3<f64>; SLOTS] {
        self.bodies.map(|b| {
            let rotation = Rotation3::from_matrix_unchecked(b.rotation);
            Isometry3::from_parts(b.position.into(), UnitQuaternion::from_rotation_matrix(&rotation))
        })
    }

    /// Poses for display: the moving part of a prismatic axis is translated along x by its coordinate.
    pub fn shown(&self, machine: Mechanism) -> [Isometry3<f64>; SLOTS] {
        let mut poses = self.poses();
        if machine.joint() == Joint::Prismatic {
            poses[ARM] = Isometry3::translation(self.q[0], 0.0, 0.0);
        }
        poses
    }

    /// Whether the machine has the three limbs of a delta robot, and place for a telescope.
    #[inline]
    fn has_three_limbs(&self) -> bool {
        self.limbs == three_arms().end
    }

    /// Number of bodies, the first ones, after which the machine has none.
    #[inline]
    pub fn slots(&self) -> usize {
        if self.has_three_limbs() { BODIES } else { SLOTS }
    }

    /// Number of struts.
    #[inline]
    pub fn struts(&self) -> usize {
        2 * self.limbs
    }

    /// Body on which the drive of `axis` acts, and the screw of its joint.
    ///
    /// # Panics
    /// If there is no `axis`.
    #[inline]
    pub fn drive(&self, axis: usize) -> (usize, Screw) {
        if axis < self.limbs { (arm(axis), self.arm_screw(axis)) } else { (ROTOR, Screw::turning(Vector3::z())) }
    }

    /// Axes with a drive: driven arms, and the rotor of three limbs.
    pub fn drives(&self) -> impl Iterator<Item = usize> + use<> {
        (0..self.driven).chain(self.has_three_limbs().then_some(TELESCOPE_AXIS))
    }

    /// Screw of the arm of `limb`, driven or passive.
    ///
    /// # Panics
    /// If there is no `limb`.
    #[inline]
    pub fn arm_screw(&self, limb: usize) -> Screw {
        match self.arms {
            Joint::Revolute => Screw::turning(self.shaft[limb]),
            Joint::Prismatic => Screw::sliding(self.bodies[arm(limb)].rotation.column(0).into_owned()),
        }
    }

    /// The strut at `socket`, and its distance from the upper end of that strut, m.
    #[inline]
    pub fn strut_of(&self, socket: usize) -> (usize, f64) {
        match socket.checked_sub(self.struts()) {
            None => (socket, 0.0),
            Some(s) => (s, self.strut_length[s]),
        }
    }

    /// Indices of the strut at `socket` and of the body that carries the ball.
    #[inline]
    pub fn socket_bodies(&self, socket: usize) -> (usize, usize) {
        match socket.checked_sub(self.struts()) {
            None => (strut(socket), arm(socket / 2)),
            Some(s) => (strut(s), self.carrier[s]),
        }
    }

    /// Origin of an assembled robot's plate in the inertial frame, m.
    pub fn origin(&self, plate: &Plate) -> Vector3<f64> {
        let rotation = &self.bodies[END_EFFECTOR].rotation;
        let part = plate.part(0);
        self.bodies[PLATFORM].position - part.fixed - rotation * part.turning
    }

    /// Angle by which the plate turns the end effector, rad within half a turn.
    #[inline]
    pub(crate) fn plate_angle(&self) -> f64 {
        let rotation = &self.bodies[END_EFFECTOR].rotation;
        rotation[(1, 0)].atan2(rotation[(0, 0)])
    }

    /// Velocity of the upper ball of strut `s` along the strut per rate of its arm, m/rad or 1.
    #[inline]
    pub fn upper_rate(&self, s: usize) -> f64 {
        let (u, limb) = (&self.strut_axis[s], s / 2);
        let lever = self.bodies[strut(s)].position - self.bodies[arm(limb)].position;
        self.arm_screw(limb).effort(&(*u, lever.cross(u)))
    }

    /// Twists of the platform of three limbs per unit elongation of each strut with locked drives (velocity in m/m, angular
    /// velocity in rad/m): inverse of the matrix with rows (uᵀ, (r × u)ᵀ). `None` where the struts do not hold the platform.
    pub fn gap_twists(&self) -> Option<Matrix6<f64>> {
        let mut rows = Matrix6::zeros();
        for s in six_struts() {
            let u = self.strut_axis[s];
            let r = self.lower_ball(s) - self.bodies[PLATFORM].position;
            rows.fixed_view_mut::<1, 3>(s, 0).copy_from(&u.transpose());
            rows.fixed_view_mut::<1, 3>(s, 3).copy_from(&r.cross(&u).transpose());
        }
        rows.try_inverse()
    }

    /// Lower ball of strut `s` in the inertial frame, m.
    #[inline]
    pub fn lower_ball(&self, s: usize) -> Vector3<f64> {
        self.bodies[strut(s)].position + self.strut_axis[s] * self.strut_length[s]
    }

    /// Angular velocity of the strut relative to the body that carries the ball at `socket`, inertial axes, rad/s.
    #[inline]
    pub fn socket_rate(&self, socket: usize) -> Vector3<f64> {
        let (strut, partner) = self.socket_bodies(socket);
        self.bodies[strut].angular_velocity - self.bodies[partner].angular_velocity
    }
}

impl Motion {
    /// Motion without joints and bodies.
    pub const REST: Self = Self {
        arms: Joint::Revolute,
        limbs: 0,
        driven: 0,
        shaft: each(Vector3::new(0., 0., 0.)),
        q: each(0.0),
        qd: each(0.0),
        qdd: each(0.0),
        bodies: [BodyMotion::REST; SLOTS],
        strut_axis: each(Vector3::new(0., 0., 0.)),
        strut_length: each(0.0),
        carrier: each(PLATFORM),
        telescope: Telescope { axis: Vector3::new(0., 0., 1.), length: 0.0, rate: 0.0 },
    };

    /// Motion of the assembled robot for a joint motion, with struts that do not spin. Bodies that carry ball pairs only
    /// translate, unless the struts of a pair differ in length.
    ///
    /// # Errors
    /// Those of [`Geometry::forward_motion`].
    pub fn assembled(geometry: &Geometry, joints: &JointState) -> Result<Self, KinematicsError> {
        let mut motion = Self::REST;
        motion.assemble(geometry, joints, None)?;
        Ok(motion)
    }

    /// Sets this to the motion that [`Self::assembled`] returns; before, it was [`Self::REST`] or one of the same machine.
    /// Plates other than the platform of three limbs stay in the assembly of the pose `near`, if it leads there. Returns the rates
    /// of plate and passive arms.
    ///
    /// # Errors
    /// As [`Self::assembled`].
    #[inline]
    pub(crate) fn assemble(
        &mut self,
        geometry: &Geometry,
        joints: &JointState,
        near: Option<&Closed>,
    ) -> Result<Closed, KinematicsError> {
        let (joints, platform) = geometry.complete_near(joints, near)?;
        if geometry.has_unequal_pairs() {
            *self = Self::tilted(geometry, &joints, &platform)?;
        } else {
            self.place_arms(geometry, &joints);
            self.place_platform(geometry, &platform);
        }
        let passive = geometry.limbs.iter().position(|limb| !limb.driven).map_or(0.0, |first| joints.qd[first]);
        Ok(Closed { position: platform.velocity, psi: platform.psi[1], passive })
    }

    /// Motion of the arms and the rotor of a disassembled robot.
    pub fn disassembled(geometry: &Geometry, joints: &JointState) -> Self {
        let mut motion = Self::REST;
        motion.place_arms(geometry, joints);
        motion
    }

    /// Sets the joints, the arms and the rotor.
    pub(crate) fn place_arms(&mut self, geometry: &Geometry, joints: &JointState) {
        self.arms = geometry.actuator().joint();
        self.limbs = geometry.limbs.len();
        self.driven = geometry.driven();
        JointState { q: self.q, qd: self.qd, qdd: self.qdd } = *joints;
        let plate = geometry.plate.bodies();
        for (i, limb) in geometry.limbs.iter().enumerate() {
            self.bodies[arm(i)] = arm_motion(limb, joints.q[i], joints.qd[i], joints.qdd[i]);
            self.shaft[i] = limb.tangential();
            self.strut_length[2 * i..2 * i + 2].fill(limb.strut_length);
            self.carrier[2 * i..2 * i + 2].fill(plate[limb.part]);
        }
        let [psi, rate, acceleration] = match may_have_telescope(geometry.limbs.len()) {
            true => [joints.q[3], joints.qd[3], joints.qdd[3]],
            false => [0.0; 3],
        };
        self.bodies[ROTOR] = BodyMotion {
            rotation: rotation_z(psi),
            position: geometry.upper_hooke(),
            angular_velocity: Vector3::z() * rate,
            angular_acceleration: Vector3::z() * acceleration,
            ..BodyMotion::REST
        };
    }

    /// Motion of the assembled robot for a joint motion and the platform motion consistent with it; both struts of a pair
    /// have their mean length.
    pub fn with_platform(geometry: &Geometry, joints: &JointState, platform: &PlatformState) -> Self {
        let mut motion = Self::disassembled(geometry, joints);
        motion.place_platform(geometry, platform);
        motion
    }

    /// Sets the plate, the struts and the telescope.
    fn place_platform(&mut self, geometry: &Geometry, platform: &PlatformState) {
        self.place_plate(geometry, platform);
        for (i, limb) in geometry.limbs.iter().enumerate() {
            let ends = StrutEnds { offset: Vector3::zeros(), point: limb.point, length: limb.strut_length };
            let (body, axis) = strut_motion(limb, &self.bodies[arm(i)], &self.bodies[self.carrier[2 * i]], &ends);
            let v = limb.tangential() * (0.5 * limb.pair_distance);
            for (s, offset) in [(2 * i, v), (2 * i + 1, -v)] {
                self.bodies[strut(s)] = BodyMotion { position: body.position + offset, ..body };
                self.strut_axis[s] = axis;
            }
        }
        if !geometry.has_platform_of_three() {
            return;
        }
        let lower_hooke = platform.position + Vector3::z() * geometry.lower_hooke_height;
        let (rotor, hooke) = (&self.bodies[ROTOR], geometry.upper_hooke());
        let (upper, lower, telescope) =
            telescope_motion(hooke, lower_hooke, rotor, platform.velocity, platform.acceleration);
        self.bodies[TELESCOPE_UPPER] = upper;
        self.bodies[TELESCOPE_LOWER] = lower;
        self.telescope = telescope;
    }

    /// Sets the parts of the plate, and the end effector at its flange.
    fn place_plate(&mut self, geometry: &Geometry, platform: &PlatformState) {
        let [psi, psi_rate, psi_acceleration] = platform.psi;
        let plate = &geometry.plate;
        let origin = BodyMotion {
            position: platform.position,
            velocity: platform.velocity,
            acceleration: platform.acceleration,
            ..BodyMotion::REST
        };
        for (k, &body) in plate.bodies().iter().enumerate() {
            let place = plate.part(k).at(psi);
            self.bodies[body] = BodyMotion {
                rotation: place.rotation,
                position: origin.position + place.origin,
                velocity: origin.velocity + place.slope * psi_rate,
                acceleration: origin.acceleration
                    + place.slope * psi_acceleration
                    + place.curvature * (psi_rate * psi_rate),
                angular_velocity: Vector3::z() * (place.turning * psi_rate),
                angular_acceleration: Vector3::z() * (place.turning * psi_acceleration),
            };
        }
        if !plate.turns() {
            self.bodies[END_EFFECTOR] = BodyMotion {
                rotation: rotation_z(psi),
                angular_velocity: Vector3::z() * psi_rate,
                angular_acceleration: Vector3::z() * psi_acceleration,
                ..origin
            };
        }
        self.bodies[END_EFFECTOR].position += Vector3::z() * geometry.flange_height;
    }

    /// Motion along a path at path speed `speed` (ṡ) and path acceleration `acceleration` (s̈).
    ///
    /// `first` is the motion at (ṡ, s̈) = (1, 0), `second` that at (0, 1).
    pub fn along(first: &Self, second: &Self, speed: f64, acceleration: f64) -> Self {
        let square = speed * speed;
        let mut motion = *first;
        for k in every_axis() {
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

fn arm_motion(limb: &Limb, q: f64, qd: f64, qdd: f64) -> BodyMotion {
    let arm = Arm::new(limb, q);
    let screw = arm.screw(limb);
    BodyMotion {
        rotation: arm.rotation(limb),
        position: arm.origin,
        velocity: screw.linear * qd,
        angular_velocity: screw.angular * qd,
        acceleration: screw.linear * qdd,
        angular_acceleration: screw.angular * qdd,
    }
}

/// Where a strut ends, and its length, m.
pub(super) struct StrutEnds {
    /// Upper end from the middle of its pair, along the motor axis, inertial axes.
    pub offset: Vector3<f64>,
    /// Lower end in the frame of the plate's body.
    pub point: Vector3<f64>,
    /// Distance of both.
    pub length: f64,
}

/// Motion of a strut and its axis; `plate` carries its lower end.
///
/// The upper ball pair is parallel to the motor axis, so that only the arm length contributes to the lever.
pub(super) fn strut_motion(
    limb: &Limb,
    arm: &BodyMotion,
    plate: &BodyMotion,
    ends: &StrutEnds,
) -> (BodyMotion, Vector3<f64>) {
    let length = ends.length;
    let lever = arm.rotation.column(0) * limb.arm_length;
    let elbow = arm.position + lever + ends.offset;
    let point = plate.rotation * ends.point;
    let axis = (plate.position + point - elbow) / length;
    let turned = |omega: &Vector3<f64>, lever: &Vector3<f64>| omega.cross(&omega.cross(lever));
    let velocity = arm.velocity + arm.angular_velocity.cross(&lever);
    let acceleration =
        arm.acceleration + arm.angular_acceleration.cross(&lever) + turned(&arm.angular_velocity, &lever);
    let below = plate.velocity + plate.angular_velocity.cross(&point);
    let below_acceleration =
        plate.acceleration + plate.angular_acceleration.cross(&point) + turned(&plate.angular_velocity, &point);
    let axis_rate = (below - velocity) / length;
    let axis_acceleration = (below_acceleration - acceleration) / length;
    let body = BodyMotion {
        rotation: strut_rotation(&axis, &limb.tangential()),
        position: elbow,
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::JointState;
    use crate::model::testing::irb360;

    /// A gap at one strut, with the drives locked, makes this strut longer and no other.
    #[test]
    fn gap_twists_elongate_one_strut_each() {
        let geometry = irb360().geometry;
        let joints = JointState { q: [0.3, -0.2, 0.9, 0.4], qd: [0.0; 4], qdd: [0.0; 4] };
        let motion = Motion::assembled(&geometry, &joints).expect("within reach");
        let twists = motion.gap_twists().expect("not singular");
        for (s, gap) in six_struts().flat_map(|s| six_struts().map(move |gap| (s, gap))) {
            let (v, omega) = (twists.fixed_view::<3, 1>(0, gap), twists.fixed_view::<3, 1>(3, gap));
            let lever = motion.lower_ball(s) - motion.bodies[PLATFORM].position;
            let elongation = motion.strut_axis[s].dot(&(v + omega.cross(&lever)));
            assert!((elongation - f64::from(s == gap)).abs() < 1e-12, "{s} {gap}: {elongation}");
        }
    }
}

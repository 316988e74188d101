//! Arms: where they carry their elbows, and how they move with their drives.

use nalgebra::{Matrix3, Vector3};

use super::motion::BodyMotion;
use crate::machine::{Actuator, Geometry, Inertia, Limb, ThreeArms};

/// Frame and elbow of one arm at one position of its drive, inertial axes.
///
/// The frame's y axis is the limb's tangential one. A revolute arm has x_A = cos φ·u − sin φ·z and the elbow e = s +
/// l₁·x_A with s the shaft's middle; a carriage has x_A along its guide, at the guide's inclination in place of φ, and
/// e = s + (q + l₁)·x_A.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arm {
    /// Unit vector from the shaft to the elbow, or along the guide.
    pub x: Vector3<f64>,
    /// `x × tangential`; of a revolute arm −∂x/∂φ.
    pub z: Vector3<f64>,
    /// Origin of the frame, m.
    pub origin: Vector3<f64>,
    /// Elbow, the middle of the ball pair, m.
    pub elbow: Vector3<f64>,
    /// ∂e/∂q, m/rad or 1.
    pub slope: Vector3<f64>,
    /// ∂²e/∂q², m/rad²; zero for a carriage.
    pub curvature: Vector3<f64>,
}

impl Arm {
    /// The arm of `limb` with its drive at `q` (rad or m).
    #[inline]
    pub fn new(limb: &Limb, q: f64) -> Self {
        Self::by(limb, q, f64::sin_cos)
    }

    /// [`Self::new`] with another function for sine and cosine of an angle.
    #[inline]
    pub fn by(limb: &Limb, q: f64, sin_cos: impl Fn(f64) -> (f64, f64)) -> Self {
        let u = limb.radial();
        let axes = |angle: f64| {
            let (s, c) = sin_cos(angle);
            (Vector3::new(c * u.x, c * u.y, -s), Vector3::new(s * u.x, s * u.y, c))
        };
        match limb.actuator {
            Actuator::Revolute => Self::placed(limb, axes(q), limb.shaft()),
            Actuator::Prismatic { inclination } => {
                let axes = axes(inclination);
                Self::placed(limb, axes, limb.shaft() + axes.0 * q)
            }
        }
    }

    /// The arm of `limb` where its frame moves as `arm`.
    #[inline]
    pub fn of(limb: &Limb, arm: &BodyMotion) -> Self {
        let axis = |k: usize| arm.rotation.column(k).into_owned();
        Self::placed(limb, (axis(0), axis(2)), arm.position)
    }

    /// The arm of `limb` with the axes x and z of its frame and the frame's origin.
    #[inline]
    fn placed(limb: &Limb, (x, z): (Vector3<f64>, Vector3<f64>), origin: Vector3<f64>) -> Self {
        let lever = x * limb.arm_length;
        let (slope, curvature) = match limb.actuator {
            Actuator::Revolute => (z * -limb.arm_length, -lever),
            Actuator::Prismatic { .. } => (x, Vector3::zeros()),
        };
        Self { x, z, origin, elbow: origin + lever, slope, curvature }
    }

    /// Position of the drive of `limb` (rad within half a turn, or m) that places its arm as `arm`.
    pub fn coordinate(limb: &Limb, arm: &BodyMotion) -> f64 {
        let x = arm.rotation.column(0);
        match limb.actuator {
            Actuator::Revolute => (-x.z).atan2(x.dot(&limb.radial())),
            Actuator::Prismatic { .. } => x.dot(&(arm.position - limb.shaft())),
        }
    }

    /// The arms of the first three limbs with their drives at `q`.
    #[inline]
    pub fn three(geometry: &Geometry, q: &[f64]) -> ThreeArms<Self> {
        let limb = |i: usize| Self::new(&geometry.limbs[i], q[i]);
        [limb(0), limb(1), limb(2)]
    }

    /// ∂³e/∂q³, m/rad³.
    pub fn third(&self, actuator: Actuator) -> Vector3<f64> {
        match actuator {
            Actuator::Revolute => -self.slope,
            Actuator::Prismatic { .. } => Vector3::zeros(),
        }
    }

    /// Orientation of the frame.
    pub fn rotation(&self, limb: &Limb) -> Matrix3<f64> {
        Matrix3::from_columns(&[self.x, limb.tangential(), self.z])
    }

    /// Unit screw of the arm's drive.
    #[inline]
    pub fn screw(&self, limb: &Limb) -> Screw {
        match limb.actuator {
            Actuator::Revolute => Screw::turning(limb.tangential()),
            Actuator::Prismatic { .. } => Screw::sliding(self.x),
        }
    }
}

/// Direction in which a drive moves its body: about an axis through the body's origin, or along one; inertial axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Screw {
    /// Velocity of the origin per unit of rate; a unit vector of a prismatic joint, else zero.
    pub linear: Vector3<f64>,
    /// Angular velocity per unit of rate; a unit vector of a revolute joint, else zero.
    pub angular: Vector3<f64>,
}

impl Screw {
    /// Of a revolute joint about the unit vector `axis`.
    pub fn turning(axis: Vector3<f64>) -> Self {
        Self { linear: Vector3::zeros(), angular: axis }
    }

    /// Of a prismatic joint along the unit vector `axis`.
    pub fn sliding(axis: Vector3<f64>) -> Self {
        Self { linear: axis, angular: Vector3::zeros() }
    }

    /// Share of a force (N) and a moment about the body's origin (N·m) along the joint: N·m, or N for a prismatic one.
    #[inline]
    pub fn effort(&self, (force, moment): &(Vector3<f64>, Vector3<f64>)) -> f64 {
        self.linear.dot(force) + self.angular.dot(moment)
    }

    /// Rate of the joint, rad/s or m/s, at which the body has this velocity of its origin and angular velocity, if the
    /// joint admits them; likewise for accelerations.
    #[inline]
    pub fn rate(&self, velocity: &Vector3<f64>, angular: &Vector3<f64>) -> f64 {
        self.linear.dot(velocity) + self.angular.dot(angular)
    }

    /// Inertia along the joint, kg·m² or kg, of a body with this orientation.
    #[inline]
    pub fn inertia(&self, inertia: &Inertia, rotation: &Matrix3<f64>) -> f64 {
        let axis = rotation.tr_mul(&self.angular);
        inertia.mass * self.linear.norm_squared() + axis.dot(&(inertia.tensor * axis))
    }

    /// [`Self::rate`] of the motion of a body.
    #[inline]
    pub fn rate_of(&self, body: &BodyMotion) -> f64 {
        self.rate(&body.velocity, &body.angular_velocity)
    }

    /// Adds the drive's effort (N·m or N) to the force and moment on its body.
    #[inline]
    pub fn push(&self, (force, moment): &mut (Vector3<f64>, Vector3<f64>), effort: f64) {
        *force += self.linear * effort;
        *moment += self.angular * effort;
    }
}

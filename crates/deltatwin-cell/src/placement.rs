//! Pose and twist of a body, and its bounding box.

use deltatwin::kinematics::BodyMotion;
use nalgebra::{Isometry3, Matrix3, Rotation3, Vector3};

/// Pose and twist of a body.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// Rotation from body to inertial axes.
    pub rotation: Matrix3<f64>,
    /// Position of the origin, m.
    pub position: Vector3<f64>,
    /// Velocity of the origin, m/s.
    pub velocity: Vector3<f64>,
    /// Angular velocity in inertial axes, rad/s.
    pub angular_velocity: Vector3<f64>,
}

impl Placement {
    /// A body at rest.
    pub fn at_rest(rotation: Matrix3<f64>, position: Vector3<f64>) -> Self {
        Self { rotation, position, velocity: Vector3::zeros(), angular_velocity: Vector3::zeros() }
    }

    /// Velocity of the material point at `point` (m, inertial frame), m/s.
    pub fn velocity_at(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.velocity + self.angular_velocity.cross(&(point - self.position))
    }

    /// Pose and twist of a frame fixed to this body, given by its rotation and position (m) in the body.
    pub fn offset(&self, rotation: &Matrix3<f64>, position: &Vector3<f64>) -> Self {
        let position = self.to_world(position);
        Self { rotation: self.rotation * rotation, position, velocity: self.velocity_at(&position), ..*self }
    }

    /// Inertial position of a point given in the body's frame, m.
    pub fn to_world(self, point: &Vector3<f64>) -> Vector3<f64> {
        self.position + self.rotation * point
    }

    /// Position in the body's frame of a point given in the inertial frame, m.
    pub fn to_local(self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation.tr_mul(&(point - self.position))
    }

    /// Pose without twist.
    pub fn isometry(&self) -> Isometry3<f64> {
        Isometry3::from_parts(self.position.into(), Rotation3::from_matrix_unchecked(self.rotation).into())
    }

    /// Whether all numbers of the pose are finite.
    pub fn is_finite(&self) -> bool {
        self.rotation.iter().chain(&self.position).all(|x| x.is_finite())
    }

    /// Upper bound (m) of the displacement, since `before`, of a point within `extent` m of the origin.
    pub fn moved(&self, before: &Self, extent: f64) -> f64 {
        // A rotation by θ moves a point at distance ρ by 2ρ sin(θ/2) = ρ‖ΔR‖/√2, Frobenius norm.
        (self.position - before.position).norm()
            + (self.rotation - before.rotation).norm() * extent * std::f64::consts::FRAC_1_SQRT_2
    }

    /// Upper bound of the speed of a point within `extent` m of the origin, m/s.
    pub fn speed(&self, extent: f64) -> f64 {
        self.velocity.norm() + self.angular_velocity.norm() * extent
    }
}

impl From<&BodyMotion> for Placement {
    fn from(b: &BodyMotion) -> Self {
        Self { rotation: b.rotation, position: b.position, velocity: b.velocity, angular_velocity: b.angular_velocity }
    }
}

/// Axis-aligned bounding box in the inertial frame.
#[derive(Clone, Copy, Debug)]
pub struct Bounds {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl Bounds {
    /// An empty box.
    pub fn nothing() -> Self {
        Self { low: Vector3::repeat(f64::INFINITY), high: Vector3::repeat(f64::NEG_INFINITY) }
    }

    /// Extends the box to include a sphere (m).
    pub fn include(&mut self, centre: &Vector3<f64>, radius: f64) {
        self.low = self.low.inf(&centre.add_scalar(-radius));
        self.high = self.high.sup(&centre.add_scalar(radius));
    }

    /// Whether the distance of the two boxes is at most `margin` (m) along every axis.
    pub fn overlap(&self, other: &Self, margin: f64) -> bool {
        (0..3).all(|i| self.low[i] - margin <= other.high[i] && other.low[i] - margin <= self.high[i])
    }
}

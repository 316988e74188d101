//! Pose and twist of a body in absolute coordinates.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Pose and twist of one body frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyState {
    /// Position of the origin in the inertial frame, m.
    pub position: Vector3<f64>,
    /// Orientation, body to inertial axes; a unit quaternion after every step.
    pub orientation: Quaternion<f64>,
    /// Velocity of the origin in inertial axes, m/s.
    pub velocity: Vector3<f64>,
    /// Angular velocity in *body* axes, rad/s.
    pub angular_velocity: Vector3<f64>,
}

impl BodyState {
    /// At rest in the inertial frame.
    pub(super) const REST: Self = Self {
        position: Vector3::new(0.0, 0.0, 0.0),
        orientation: Quaternion::new(1.0, 0.0, 0.0, 0.0),
        velocity: Vector3::new(0.0, 0.0, 0.0),
        angular_velocity: Vector3::new(0.0, 0.0, 0.0),
    };
}

/// Rotation matrix of a quaternion, which is normalised first.
pub(super) fn rotation(q: &Quaternion<f64>) -> Matrix3<f64> {
    UnitQuaternion::new_normalize(*q).to_rotation_matrix().into_inner()
}

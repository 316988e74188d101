//! Pose and twist of a body in absolute coordinates.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

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

/// Rotation matrix of a quaternion that may be slightly off unit length.
pub(super) fn rotation(q: &Quaternion<f64>) -> Matrix3<f64> {
    UnitQuaternion::new_normalize(*q).to_rotation_matrix().into_inner()
}

//! What an implicit integrator adds to the mass matrix: h·γ·D of the damping D of joints.

use nalgebra::Matrix3;

use crate::kinematics::Screw;

/// Addition to the mass matrix of a body, symmetric, inertial axes.
#[derive(Clone, Copy, Debug)]
pub struct Added {
    /// To the block of velocities, kg.
    pub(super) linear: Matrix3<f64>,
    /// To the block of angular velocities, kg·m².
    pub(super) angular: Matrix3<f64>,
}

impl Added {
    /// No addition.
    pub const NONE: Self = Self {
        linear: Matrix3::new(0., 0., 0., 0., 0., 0., 0., 0., 0.),
        angular: Matrix3::new(0., 0., 0., 0., 0., 0., 0., 0., 0.),
    };

    /// Adds `inertia` (kg·m² or kg) along a joint.
    pub fn along(&mut self, screw: &Screw, inertia: f64) {
        self.linear += screw.linear * screw.linear.transpose() * inertia;
        self.angular += screw.angular * screw.angular.transpose() * inertia;
    }
}

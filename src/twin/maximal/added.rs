//! What an implicit integrator adds to the mass matrix: h·γ·D of the damping D of joints, and h·γ·D + h²γ²·K of contacts.

use nalgebra::Matrix3;

use crate::kinematics::Screw;
use crate::twin::contacts::Resistance;

/// Addition to the mass matrix of a body, symmetric, inertial axes.
#[derive(Clone, Copy, Debug)]
pub struct Added {
    /// To the block of velocities, kg.
    pub(super) linear: Matrix3<f64>,
    /// To the block of angular velocities, kg·m².
    pub(super) angular: Matrix3<f64>,
    /// Moments (rows) that velocities (columns) bring about, kg·m.
    pub(super) coupling: Matrix3<f64>,
}

const ZERO: Matrix3<f64> = Matrix3::new(0., 0., 0., 0., 0., 0., 0., 0., 0.);

impl Added {
    /// No addition.
    pub const NONE: Self = Self { linear: ZERO, angular: ZERO, coupling: ZERO };

    /// Adds `inertia` (kg·m² or kg) along a joint.
    pub fn along(&mut self, screw: &Screw, inertia: f64) {
        self.linear += screw.linear * screw.linear.transpose() * inertia;
        self.angular += screw.angular * screw.angular.transpose() * inertia;
    }

    /// Adds g·D + g²·K of contacts, with g = h·γ in s.
    pub fn resisting(&mut self, contacts: &Resistance, g: f64) {
        let Resistance { stiffness, damping } = contacts;
        let at = |i: usize, k: usize| g * (damping[i][k] + g * stiffness[i][k]);
        self.linear += Matrix3::from_fn(at);
        self.angular += Matrix3::from_fn(|i, k| at(3 + i, 3 + k));
        self.coupling += Matrix3::from_fn(|i, k| at(3 + i, k));
    }
}

//! Physical consistency of bodies [Wensing 2018].
//!
//! A body is consistent exactly if its pseudo-inertia is positive semidefinite. Without deviation moments this is an
//! arrow matrix [[D, h], [hᵀ, m]] with D = ½tr(Θ)·1 − Θ diagonal, and the condition is D > 0, m > Σ hₖ²/Dₖ.
//! [`classes`] determines how the parameters enter these entries. Two independent methods give the consistent
//! parameters of least cost: [`log_cholesky`], in which all values of the variables are consistent, and [`cones`], a
//! convex programme. With deviation moments the matrix is full, and a `barrier` method replaces the cones.

mod barrier;
mod class;
pub mod cones;
mod full;
pub mod log_cholesky;

#[cfg(test)]
mod tests;

pub use class::{BodyClass, Owner, classes, complete};

use nalgebra::{DMatrix, DVector};

use crate::machine::Bodies;
use crate::machine::bodies::Inertia;

/// Margin to the boundary of consistency, relative to the body's own entries.
pub(super) const MARGIN: f64 = 1e-6;

/// Smallest eigenvalue of the pseudo-inertia over all bodies with non-zero inertia.
pub fn min_eigenvalue(bodies: &Bodies) -> f64 {
    bodies.0.iter().filter(|b| **b != Inertia::ZERO).map(Inertia::min_eigenvalue).fold(f64::INFINITY, f64::min)
}

/// Quadratic cost ½(x − x₀)ᵀH(x − x₀) of the parameters, with their constraints.
pub struct Cost {
    /// Unconstrained minimiser x₀.
    pub centre: DVector<f64>,
    /// Consistent parameters, start of the search.
    pub start: DVector<f64>,
    /// Curvature H, positive definite.
    pub curvature: DMatrix<f64>,
    /// Own size of each parameter.
    pub size: DVector<f64>,
    /// Range of each parameter that no body class owns.
    pub range: Vec<(f64, f64)>,
    /// Body classes.
    pub classes: Vec<BodyClass>,
}

impl Cost {
    /// The cost of `x`.
    pub fn of(&self, x: &DVector<f64>) -> f64 {
        let d = x - &self.centre;
        0.5 * d.dot(&(&self.curvature * &d))
    }

    /// Whether all bodies are consistent with the margin and all parameters are within their ranges.
    pub fn allows(&self, x: &DVector<f64>) -> bool {
        self.classes.iter().all(|c| c.slack(x) >= 1.0)
            && self.free_of_bodies().all(|i| (self.range[i].0..=self.range[i].1).contains(&x[i]))
    }

    /// Indices of the parameters that no body class owns.
    pub fn free_of_bodies(&self) -> impl Iterator<Item = usize> {
        let owned: Vec<usize> = self.classes.iter().flat_map(BodyClass::variables).collect();
        (0..self.centre.len()).filter(move |i| !owned.contains(i))
    }
}

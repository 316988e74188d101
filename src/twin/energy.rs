//! Energy of the mechanism.

use crate::dynamics::Plant;
use crate::kinematics::{BodyMotion, Motion};
use crate::machine::Inertia;

/// Kinetic plus potential energy, J; the potential is zero in the shaft plane.
pub fn total(plant: &Plant, motion: &Motion) -> f64 {
    let potential: f64 = plant
        .bodies
        .0
        .iter()
        .zip(&motion.bodies)
        .map(|(inertia, m)| inertia.mass * m.position.z + (m.rotation * inertia.first_moment).z)
        .sum();
    kinetic(plant, motion) + plant.gravity * potential
}

/// Kinetic energy, J.
pub fn kinetic(plant: &Plant, motion: &Motion) -> f64 {
    plant.bodies.0.iter().zip(&motion.bodies).map(|(inertia, m)| of_body(inertia, m)).sum()
}

/// Kinetic energy of one body, J.
pub fn of_body(inertia: &Inertia, m: &BodyMotion) -> f64 {
    let h = m.rotation * inertia.first_moment;
    let omega = m.rotation.tr_mul(&m.angular_velocity);
    0.5 * inertia.mass * m.velocity.norm_squared()
        + m.velocity.dot(&m.angular_velocity.cross(&h))
        + 0.5 * omega.dot(&(inertia.tensor * omega))
}

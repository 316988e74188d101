//! Energy of the mechanism.

use crate::dynamics::Plant;
use crate::kinematics::Motion;

/// Kinetic plus potential energy, J; potential zero in the shaft plane.
pub fn total(plant: &Plant, motion: &Motion) -> f64 {
    plant
        .bodies
        .0
        .iter()
        .zip(&motion.bodies)
        .map(|(inertia, m)| {
            let h = m.rotation * inertia.first_moment;
            let omega = m.rotation.tr_mul(&m.angular_velocity);
            let kinetic = 0.5 * inertia.mass * m.velocity.norm_squared()
                + m.velocity.dot(&m.angular_velocity.cross(&h))
                + 0.5 * omega.dot(&(inertia.tensor * omega));
            kinetic + plant.gravity * (inertia.mass * m.position.z + h.z)
        })
        .sum()
}

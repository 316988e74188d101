//! Newton–Euler equations of one body about its frame origin.

use nalgebra::Vector3;

use crate::kinematics::BodyMotion;
use crate::machine::Inertia;

/// Force (N) and moment (N·m) required by the inertia and weight of one body, about its frame origin in inertial axes.
///
/// F = m(a − g) + α × h + ω × (ω × h), M = h × (a − g) + Θα + ω × Θω with h = m·c; `gravity` is the gravitational
/// acceleration g, m/s².
pub fn inertial_wrench(inertia: &Inertia, motion: &BodyMotion, gravity: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let h = motion.rotation * inertia.first_moment;
    let (omega, alpha) = (motion.angular_velocity, motion.angular_acceleration);
    let a = motion.acceleration - gravity;
    let back = motion.rotation.transpose();
    let tensor = |x: &Vector3<f64>| motion.rotation * (inertia.tensor * (back * x));
    let force = a * inertia.mass + alpha.cross(&h) + omega.cross(&omega.cross(&h));
    let moment = h.cross(&a) + tensor(&alpha) + omega.cross(&tensor(&omega));
    (force, moment)
}

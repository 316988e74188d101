//! Newton–Euler equations of one body about its frame origin.

use nalgebra::Vector3;

use crate::kinematics::BodyMotion;
use crate::machine::Inertia;

/// Force (N) and moment (N·m) required by the inertia and weight of one body, about its frame origin in inertial axes.
///
/// F = m(a − g) + α × h + ω × (ω × h), M = h × (a − g) + Θα + ω × Θω with h = m·c; `gravity` is the gravitational
/// acceleration g, m/s².
#[inline]
pub fn inertial_wrench(inertia: &Inertia, motion: &BodyMotion, gravity: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
    accelerated_wrench(inertia, motion, (&motion.acceleration, &motion.angular_acceleration), gravity)
}

/// [`inertial_wrench`] with accelerations (m/s², rad/s²) other than those of `motion`.
#[inline]
pub(crate) fn accelerated_wrench(
    inertia: &Inertia,
    motion: &BodyMotion,
    (linear, alpha): (&Vector3<f64>, &Vector3<f64>),
    gravity: &Vector3<f64>,
) -> (Vector3<f64>, Vector3<f64>) {
    let (rotation, omega) = (&motion.rotation, &motion.angular_velocity);
    let h = rotation * inertia.first_moment;
    let a = linear - gravity;
    let own = rotation.tr_mul(omega);
    let turning = inertia.tensor * rotation.tr_mul(alpha) + own.cross(&(inertia.tensor * own));
    let force = a * inertia.mass + alpha.cross(&h) + omega.cross(&omega.cross(&h));
    (force, h.cross(&a) + rotation * turning)
}

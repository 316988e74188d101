//! Presliding of friction.

/// Rate of the presliding state z, 1/s, and its derivative with respect to z, of Dahl's law ([Dahl 1968]): ż = (q̇ −
/// |q̇|·z)/δ, with q̇ the joint rate, rad/s or m/s, and δ the angle of presliding, rad or m.
///
/// |z| ≤ 1 from every start within; in one direction z approaches ±1 as exp(−|Δq|/δ), independent of speed. |q̇| is not
/// smoothed: ż is continuous without it, and smoothing would violate |z| ≤ 1.
pub fn presliding(z: f64, qd: f64, angle: f64) -> (f64, f64) {
    ((qd - qd.abs() * z) / angle, -qd.abs() / angle)
}

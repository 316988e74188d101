//! Contact law of a compliant stop.

/// Contact force per unit of stiffness, x·max(0, 1 + χ·ẋ) ([Hunt 1975]); zero for x ≤ 0.
///
/// x is the penetration depth in m (or rad), ẋ its rate in m/s (or rad/s), χ the damping in s/m (or s/rad). The factor
/// x makes the force continuous at first contact; it is never tensile. The stiffness k stores ½·k·x², the damping
/// dissipates k·x·χ·ẋ²: after an impact at speed v the rebound speed is about v·(1 − ⅔·χ·v).
pub fn hunt_crossley(depth: f64, rate: f64, damping: f64) -> f64 {
    depth.max(0.0) * (1.0 + damping * rate).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_millimetre_deep_by_hand() {
        approx::assert_relative_eq!(hunt_crossley(1e-3, 0.5, 0.5), 1.25e-3);
        approx::assert_relative_eq!(hunt_crossley(1e-3, -0.5, 0.5), 0.75e-3);
        assert_eq!([hunt_crossley(1e-3, -3.0, 0.5), hunt_crossley(-1e-3, 1.0, 0.5)], [0.0, 0.0]);
    }
}

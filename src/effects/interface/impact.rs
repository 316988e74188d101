//! A body that runs into something that gives way.

/// Push per unit of stiffness, x·max(0, 1 + χ·ẋ): the depth x ≥ 0 in m (or rad), its rate ẋ in m/s (or rad/s) and the
/// damping χ in s/m (or s/rad); zero outside, x ≤ 0.
///
/// Continuous at first touch because of the factor x, and never a pull. The stiffness stores ½·k·x²; what the damping
/// takes, k·x·χ·ẋ², never comes back: a body that hits at v leaves at about v·(1 − ⅔·χ·v).
///
/// K. H. Hunt, F. R. E. Crossley: Coefficient of restitution interpreted as damping in vibroimpact, J. Appl. Mech. 42
/// (1975).
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

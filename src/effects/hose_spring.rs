//! A hose or cable that pulls at the platform.

use nalgebra::Vector3;

use super::{About, Count, Effect, Instant, Parameter, Part, Role, Values, Wrenches};
use crate::model::bodies::PLATFORM;

/// F = f − k·(p − p₀) on the platform's centre p, p₀ = (0, 0, height).
///
/// f in N, inertial axes: the pull at p₀; k in N/m, never negative. The same as a spring of zero length from p to the fixed
/// point p₀ + f/k: preload and fixed point are both free. Stores k·|p − p₀|²/2 − f·(p − p₀).
pub struct HoseSpring;

const STIFFNESS: usize = 0;
const PRELOAD: usize = 1;
const HEIGHT: usize = 2;

impl Effect for HoseSpring {
    fn name(&self) -> &'static str {
        "hose_spring"
    }

    fn acts_on(&self) -> Part {
        Part::Linkage
    }

    fn about(&self) -> About {
        About {
            summary: "a hose pulls at the platform like a spring from a fixed point",
            law: "F = f − k·(p − p₀), p₀ = (0, 0, height): a spring to the fixed point p₀ + f/k",
            shows: "static torque of the arms that grows with the platform's distance from a point",
            source: "vacuum hose or cable, 5–50 N/m and some newtons (estimate)",
        }
    }

    fn parameters(&self) -> &'static [Parameter] {
        &[
            Parameter {
                name: "stiffness",
                unit: "N/m",
                count: Count::One,
                role: Role::Linear,
                default: 10.0,
                range: (0.0, 1e4),
            },
            Parameter {
                name: "preload",
                unit: "N",
                count: Count::Named(&["x", "y", "z"]),
                role: Role::Linear,
                default: 3.0,
                range: (-200.0, 200.0),
            },
            Parameter {
                name: "height",
                unit: "m",
                count: Count::One,
                role: Role::Fixed,
                default: -0.9,
                range: (-10.0, 10.0),
            },
        ]
    }

    fn forces(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let stretch = at.motion.bodies[PLATFORM].position - Vector3::z() * values.one(HEIGHT);
        out.wrench(values.index(STIFFNESS, 0), PLATFORM, -stretch, Vector3::zeros());
        for axis in 0..values.len(PRELOAD) {
            out.wrench(values.index(PRELOAD, axis), PLATFORM, Vector3::ith(axis, 1.0), Vector3::zeros());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    #[test]
    fn pulls_towards_the_fixed_point() {
        // 20 N/m and 10 N along x: fixed point at (0.5, 0, −0.9). From (0.5, 0.2, −1.1) it pulls by 20·(0, −0.2, 0.2).
        let mut motion = testing::still();
        motion.bodies[PLATFORM].position = Vector3::new(0.5, 0.2, -1.1);
        let total = testing::totals(&HoseSpring, &[&[20.0], &[10.0, 0.0, 0.0], &[-0.9]], &motion);
        approx::assert_relative_eq!(total[PLATFORM].0, Vector3::new(0.0, -4.0, 4.0), epsilon = 1e-12);
    }
}

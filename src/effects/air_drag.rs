//! Aerodynamic drag on the platform.

use nalgebra::Vector3;

use super::{About, Effect, Instant, Parameter, Part, Role, Spec, Unit, Values, Wrenches};
use crate::machine::bodies::PLATFORM;

/// Quadratic drag F = −c·|v|·v on the platform; F in N, v in m/s, c in N·s²/m². Dissipates c·|v|³.
pub struct AirDrag;

const PARAMETERS: &[Parameter] = &[Parameter::new("coefficient", Unit::NS2PerM2, Role::Linear, 0.04, (0.0, 50.0))];

static SPEC: Spec = Spec::new(
    "air_drag",
    Part::Linkage,
    About {
        summary: "drag of the air on the platform",
        law: "F = −c·|v|·v on the platform",
        shows: "torque of all arms against the platform's velocity, growing with its square",
        source: "turbulent drag; six struts and a plate of 0.06 m² give 0.02–0.1 N/(m/s)² (estimate)",
    },
    PARAMETERS,
);

impl Effect for AirDrag {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let v = at.motion.bodies[PLATFORM].velocity;
        out.wrench(values.index(0, 0), PLATFORM, -v * v.norm(), Vector3::zeros());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    #[test]
    fn twice_the_speed_is_four_times_the_drag() {
        for (speed, force) in [(5.0, -1.0), (10.0, -4.0)] {
            let mut motion = testing::still();
            motion.bodies[PLATFORM].velocity.x = speed;
            // 0.04·5² = 1 N and 0.04·10² = 4 N, against the motion
            let total = testing::totals(&AirDrag, &[&[0.04]], &motion);
            approx::assert_relative_eq!(total[PLATFORM].0.x, force, epsilon = 1e-12);
        }
    }
}

//! Additional friction of the telescope while it retracts.

use super::{About, Effect, Instant, Parameter, Part, Role, Spec, Unit, Values, Wrenches};

/// Force F = d·v + e·v² for ṡ = −v < 0, zero while the telescope extends.
///
/// F in N along the bar, pushing the parts apart; d in N·s/m and e in N·s²/m², never negative: higher friction of the
/// bush inward, and displaced air. Continuous at ṡ = 0. Dissipates d·v² + e·v³.
pub struct TelescopeRetractFriction;

const VISCOUS: usize = 0;
const QUADRATIC: usize = 1;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("viscous", Unit::NSPerM, Role::Linear, 1.25, (0.0, 100.0)),
    Parameter::new("quadratic", Unit::NS2PerM2, Role::Linear, 2.0, (0.0, 100.0)),
];

static SPEC: Spec = Spec::new(
    "telescope_retract_friction",
    Part::Telescope,
    About {
        summary: "extra friction of the telescope while it shortens, growing with speed",
        law: "F = d·v + e·v², v = max(0, −ṡ), pushing the parts apart",
        shows: "torque of all arms while the platform rises, none while it sinks",
        source: "viscous friction inward up to twice that outward, air cushion 2 (0–5) N/(m/s)² (estimate)",
    },
    PARAMETERS,
);

impl Effect for TelescopeRetractFriction {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let speed = (-at.motion.telescope.rate).max(0.0);
        out.telescope_force(values.index(VISCOUS, 0), at.motion, speed);
        out.telescope_force(values.index(QUADRATIC, 0), at.motion, speed * speed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;
    use crate::machine::bodies::{TELESCOPE_LOWER, TELESCOPE_UPPER};

    #[test]
    fn only_shortening_costs() {
        // 1.5 m/s inward: 2·1.5 + 4·2.25 = 12 N, apart; the axis points up, so the upper part is pushed up.
        for (rate, force) in [(-1.5, 12.0), (1.5, 0.0)] {
            let mut motion = testing::still();
            motion.telescope.rate = rate;
            let total = testing::totals(&TelescopeRetractFriction, &[&[2.0], &[4.0]], &motion);
            approx::assert_relative_eq!(total[TELESCOPE_UPPER].0.z, force);
            approx::assert_relative_eq!(total[TELESCOPE_LOWER].0.z, -force);
        }
    }
}

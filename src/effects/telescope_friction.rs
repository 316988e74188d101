//! Coulomb and viscous friction of the telescope's prismatic joint ([Gnad 2024], Table 4, column P-TB).

use super::{
    About, Effect, Instant, Parameter, Part, Role, STEEPNESS_PARAMETER, Spec, Unit, Values, Wrenches, smooth_sign,
};

/// Friction force F = −F_C·tanh(k·ṡ) − d·ṡ between the two parts of the telescope.
///
/// F in N along the bar, positive when it pushes the parts apart; ṡ in m/s, lengthening positive. F_C in N and d in
/// N·s/m, never negative; k in s/m. Dissipates F_C·ṡ·tanh(k·ṡ) + d·ṡ².
pub struct TelescopeFriction;

const COULOMB: usize = 0;
const VISCOUS: usize = 1;
const STEEPNESS: usize = 2;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("coulomb", Unit::N, Role::Linear, 1.641, (0.0, 100.0)),
    Parameter::new("viscous", Unit::NSPerM, Role::Linear, 1.247, (0.0, 100.0)),
    STEEPNESS_PARAMETER.with_unit(Unit::SPerM),
];

static SPEC: Spec = Spec::new(
    "telescope_friction",
    Part::Telescope,
    About {
        summary: "Coulomb and viscous friction of the telescope's sliding joint",
        law: "F = −F_C·tanh(k·ṡ) − d·ṡ along the telescope, ṡ lengthening positive",
        shows: "small torque jump of all arms when the telescope reverses, none in turning motion",
        source: "Gnad et al. Table 4, column P-TB (printed in N·m, meant in N and N·s/m)",
    },
    PARAMETERS,
);

impl Effect for TelescopeFriction {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let rate = at.motion.telescope.rate;
        let sign = smooth_sign(rate, values.one(STEEPNESS));
        out.telescope_force(values.index(COULOMB, 0), at.motion, -sign);
        out.telescope_force(values.index(VISCOUS, 0), at.motion, -rate);
    }
}

#[cfg(test)]
mod tests {
    use super::TelescopeFriction;
    use crate::effects::testing;
    use crate::machine::bodies::{TELESCOPE_LOWER, TELESCOPE_UPPER};

    #[test]
    fn lengthening_telescope_is_pulled_together() {
        let mut motion = testing::still();
        motion.telescope.rate = 0.5;
        let total = testing::totals(&TelescopeFriction, &[&[1.6], &[1.2], &[100.0]], &motion);
        // 1.6·tanh(50) + 1.2·0.5 = 2.2 N; the axis points up, so the upper part is pulled down
        approx::assert_relative_eq!(total[TELESCOPE_UPPER].0.z, -2.2, epsilon = 1e-12);
        approx::assert_relative_eq!(total[TELESCOPE_LOWER].0.z, 2.2, epsilon = 1e-12);
    }
}

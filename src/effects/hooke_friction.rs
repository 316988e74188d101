//! Friction of the telescope's two Hooke joints.

use super::{
    About, Effect, Instant, Parameter, Part, Role, STEEPNESS_PARAMETER, Spec, Unit, Values, Wrenches, smooth_sign,
};
use crate::machine::bodies::{END_EFFECTOR, ROTOR, TELESCOPE_LOWER, TELESCOPE_UPPER};

/// Moment M = −M_C·tanh(k·ω) − d·ω on the telescope about each of the four cross axes; the reaction is on rotor or end
/// effector.
///
/// ω in rad/s is the relative rate of the telescope about that axis (`Motion::hooke_rates`). M_C in N·m and d in
/// N·m·s/rad, never negative, per axis; k in s/rad. Dissipates Σ ω·(M_C·tanh(k·ω) + d·ω).
pub struct HookeFriction;

const COULOMB: usize = 0;
const VISCOUS: usize = 1;
const STEEPNESS: usize = 2;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("coulomb", Unit::NM, Role::Linear, 0.05, (0.0, 20.0)),
    Parameter::new("viscous", Unit::NMSPerRad, Role::Linear, 0.02, (0.0, 20.0)),
    STEEPNESS_PARAMETER,
];

static SPEC: Spec = Spec::new(
    "hooke_friction",
    Part::Telescope,
    About {
        summary: "Coulomb and viscous friction of the telescope's Hooke joints",
        law: "M = −M_C·tanh(k·ω) − d·ω about each cross axis of both joints",
        shows: "torque of all drives when the telescope swings, also of axis 4 when it turns an inclined telescope",
        source: "needle bearings of a small cardan joint, 0.02–0.1 N·m per axis (estimate)",
    },
    PARAMETERS,
);

impl Effect for HookeFriction {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let rates = at.motion.hooke_rates();
        let bodies = [(ROTOR, TELESCOPE_UPPER), (END_EFFECTOR, TELESCOPE_LOWER)];
        for (((yoke, telescope), joint), rates) in bodies.into_iter().zip(at.motion.hooke_joints()).zip(rates) {
            for (axis, rate) in [joint.yoke, joint.bar].into_iter().zip(rates) {
                let sign = smooth_sign(rate, values.one(STEEPNESS));
                for (block, moment) in [(COULOMB, axis * -sign), (VISCOUS, axis * -rate)] {
                    out.wrench(values.index(block, 0), telescope, nalgebra::Vector3::zeros(), moment);
                    out.wrench(values.index(block, 0), yoke, nalgebra::Vector3::zeros(), -moment);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;
    use nalgebra::Vector3;

    #[test]
    fn swing_about_x_is_braked_at_both_ends() {
        // Telescope swings at 2 rad/s about x against rotor and end effector at rest: 0.1·tanh(200) + 0.05·2 = 0.2 N·m
        // on each part, its reaction on the rotor and on the end effector.
        let mut motion = testing::still();
        for body in [TELESCOPE_UPPER, TELESCOPE_LOWER] {
            motion.bodies[body].angular_velocity = Vector3::x() * 2.0;
        }
        let total = testing::totals(&HookeFriction, &[&[0.1], &[0.05], &[100.0]], &motion);
        for (body, moment) in [(TELESCOPE_UPPER, -0.2), (TELESCOPE_LOWER, -0.2), (ROTOR, 0.2), (END_EFFECTOR, 0.2)] {
            approx::assert_relative_eq!(total[body].1, Vector3::x() * moment, epsilon = 1e-12);
        }
    }
}

//! Difference of the viscous drive friction between the two directions.

use super::{About, Count, Effect, Instant, Parameter, Part, Role, Spec, Unit, Values, Wrenches};

/// Torque τ = −a·|q̇|: the viscous coefficient is p_v + a for q̇ > 0 and p_v − a for q̇ < 0.
///
/// a in N·m·s/rad, either sign. By itself it dissipates in one direction and generates the same power in the other; the
/// sum with `drive_friction` is dissipative for |a| ≤ p_v.
pub struct DriveViscousAsymmetry;

const DIFFERENCE: usize = 0;

const PARAMETERS: &[Parameter] =
    &[Parameter::new("difference", Unit::NMSPerRad, Role::Linear, 0.3, (-20.0, 20.0)).counted(Count::PerArm)];

static SPEC: Spec = Spec::new(
    "drive_viscous_asymmetry",
    Part::Drives,
    About {
        summary: "viscous friction of an arm drive differs between + and − direction",
        law: "τ_i = −a_i·|q̇_i|; viscous friction is p_v + a for q̇ > 0 and p_v − a for q̇ < 0",
        shows: "a torque per arm that grows with speed and has the same sign in both directions",
        source: "usual for geared drives; a few tenths of the viscous coefficient (estimate)",
    },
    PARAMETERS,
)
.drive_friction();

impl Effect for DriveViscousAsymmetry {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for axis in 0..values.len(DIFFERENCE) {
            out.drive_torque(values.index(DIFFERENCE, axis), axis, -at.motion.qd[axis].abs());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    #[test]
    fn same_sign_in_both_directions() {
        for rate in [-2.0, 2.0] {
            let mut motion = testing::still();
            motion.qd[1] = rate;
            let torque = testing::drive_torque(&DriveViscousAsymmetry, &motion, 1);
            approx::assert_relative_eq!(torque, -2.0, epsilon = 1e-12);
        }
    }
}

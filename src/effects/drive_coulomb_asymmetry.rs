//! Difference of the Coulomb drive friction between the two directions.

use super::{
    About, Count, Effect, Instant, Parameter, Part, Role, STEEPNESS_PARAMETER, Spec, Unit, Values, Wrenches,
    as_drive_friction, smooth_sign,
};

/// Torque τ = −a·tanh²(k q̇) (N·m): raises the Coulomb friction in positive direction by a and lowers it by a in
/// negative direction.
pub struct DriveCoulombAsymmetry;

const DIFFERENCE: usize = 0;
const STEEPNESS: usize = 1;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("difference", Unit::NM, Role::Linear, 0.5, (-20.0, 20.0)).counted(Count::PerArm),
    // The transition at standstill is unknown; within less than one sample the effect equals a bias.
    STEEPNESS_PARAMETER.searched((20.0, 1e4)),
];

static SPEC: Spec = Spec::new(
    "drive_coulomb_asymmetry",
    Part::Drives,
    About {
        summary: "Coulomb friction of an arm drive differs between + and − direction",
        law: "τ_i = −a_i·tanh²(k·q̇_i); Coulomb friction is p_C + a for q̇ > 0 and p_C − a for q̇ < 0",
        shows: "a nearly constant torque per arm that vanishes at standstill; close to a base tilt",
        source: "usual for geared drives; magnitude a few tenths of a N·m (estimate)",
    },
    PARAMETERS,
)
.drive_friction()
.constants(as_drive_friction)
.grids(&[&[1.0, 20.0]]);

impl Effect for DriveCoulombAsymmetry {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for axis in 0..values.len(DIFFERENCE) {
            let s = smooth_sign(at.motion.qd[axis], values.one(STEEPNESS));
            out.drive_torque(values.index(DIFFERENCE, axis), axis, -s * s);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    #[test]
    fn same_sign_in_both_directions() {
        for rate in [-1.0, 1.0] {
            let mut motion = testing::still();
            motion.qd[2] = rate;
            // tanh²(100) = 1
            approx::assert_relative_eq!(
                testing::drive_torque(&DriveCoulombAsymmetry, &motion, 2),
                -1.0,
                epsilon = 1e-12
            );
        }
    }
}

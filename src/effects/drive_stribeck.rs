//! Stribeck friction of the drives: additional breakaway friction that decays with speed.

use super::{
    About, Count, Effect, Instant, Parameter, Part, Role, STEEPNESS_PARAMETER, Spec, Unit, Values, Wrenches,
    as_drive_friction, smooth_sign,
};

/// Friction torque τ = −F·exp(−(q̇/v_s)²)·tanh(k q̇) at each arm drive; F in N·m, v_s in rad/s, k in s/rad.
pub struct DriveStribeck;

const BREAKAWAY: usize = 0;
const SPEED: usize = 1;
const STEEPNESS: usize = 2;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("breakaway", Unit::NM, Role::Linear, 0.9, (0.0, 50.0)).counted(Count::PerArm),
    Parameter::new("stribeck_speed", Unit::RadPerS, Role::Shape, 0.1, (0.02, 2.0)),
    STEEPNESS_PARAMETER,
];

static SPEC: Spec = Spec::new(
    "drive_stribeck",
    Part::Drives,
    About {
        summary: "extra breakaway friction of the arm drives at low speed",
        law: "τ_i = −F_i·exp(−(q̇_i/v_s)²)·tanh(k·q̇_i)",
        shows: "peaks on both sides of every reversal",
        source: "Armstrong-Hélouvry 1991; static/Coulomb 1.05–1.5, v_s 0.03–0.3 rad/s (estimate)",
    },
    PARAMETERS,
)
.drive_friction()
.constants(as_drive_friction);

impl Effect for DriveStribeck {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for axis in 0..values.len(BREAKAWAY) {
            let rate = at.motion.qd[axis];
            let decay = (-(rate / values.one(SPEED)).powi(2)).exp();
            let torque = -decay * smooth_sign(rate, values.one(STEEPNESS));
            out.drive_torque(values.index(BREAKAWAY, axis), axis, torque);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;

    #[test]
    fn at_the_stribeck_speed_one_over_e_is_left() {
        let mut motion = testing::still();
        motion.qd[1] = -0.1;
        // exp(−1)·tanh(10) = 0.367879439, against the motion.
        approx::assert_relative_eq!(testing::drive_torque(&DriveStribeck, &motion, 1), 0.367_879_439, epsilon = 1e-8);
        approx::assert_relative_eq!(testing::drive_torque(&DriveStribeck, &motion, 0), 0.0);
    }
}

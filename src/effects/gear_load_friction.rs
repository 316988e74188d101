//! Gear friction proportional to the transmitted torque.

use super::{
    About, Count, Effect, Instant, Parameter, Part, Reads, Role, STEEPNESS_PARAMETER, Spec, Unit, Values, Wrenches,
    smooth_sign,
};

/// Friction torque τ = −μ·|τ_drive|·tanh(k·q̇) at each arm drive.
///
/// μ dimensionless, never negative; τ_drive the total drive torque at the gear output, friction included, or the load at
/// the output of a single axis where it is known; k in s/rad. Dissipates μ·|τ_drive|·q̇·tanh(k·q̇). In the twin τ_drive is known; inverse dynamics iterates with contraction
/// factor μ.
pub struct GearLoadFriction;

const FRICTION: usize = 0;
const STEEPNESS: usize = 1;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("friction", Unit::One, Role::Linear, 0.02, (0.0, 0.5)).counted(Count::PerArm),
    STEEPNESS_PARAMETER,
];

static SPEC: Spec = Spec::new(
    "gear_load_friction",
    Part::Drives,
    About {
        summary: "friction of the arm gears in proportion to the torque they transmit",
        law: "τ_f,i = −μ_i·|τ_i|·tanh(k·q̇_i), τ_i the drive torque at the gear output, or the known load",
        shows: "torque scaled up while a drive works and down while it brakes",
        source: "Bittencourt et al., IROS 2010: about 2 % of the load torque; 1–5 %",
    },
    PARAMETERS,
)
.drive_friction()
.reads(Reads { torque: true, ..Reads::MOTION });

impl Effect for GearLoadFriction {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for axis in 0..values.len(FRICTION) {
            let sign = smooth_sign(at.motion.qd[axis], values.one(STEEPNESS));
            out.drive_torque(values.index(FRICTION, axis), axis, -at.transmitted(axis).abs() * sign);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::{ActiveEffect, testing};

    #[test]
    fn both_signs_of_torque_oppose_the_motion() {
        // 2 % of 50 N·m is 1 N·m, against +1 rad/s for either sign of the torque (tanh(100) = 1).
        let active = ActiveEffect::new(Arc::new(GearLoadFriction), &[&[0.02; 3], &[100.0]]);
        let mut motion = testing::still();
        motion.qd = [1.0, 1.0, -1.0, 0.0];
        let mut torque = [0.0; 3];
        testing::at(&motion, &[], |at| {
            let at = &Instant { torque: [50.0, -50.0, 50.0, 50.0], ..*at };
            GearLoadFriction.wrenches(
                &active.values(),
                at,
                &mut Wrenches::new(at.motion, &mut |k, body, _, m| {
                    torque[body] += active.values[k] * m.dot(&motion.drive(body).1.angular);
                }),
            );
        });
        approx::assert_relative_eq!(torque.as_slice(), [-1.0, -1.0, 1.0].as_slice(), epsilon = 1e-12);
    }
}

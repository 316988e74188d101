//! Gear friction proportional to the transmitted torque.

use super::{
    About, Count, Effect, Instant, InternalStates, Parameter, Part, Reads, Role, STEEPNESS_PARAMETER, Spec, Start,
    Unit, Values, Wrenches, as_drive_friction, presliding, smooth_sign,
};

/// Friction torque τ = −μ·|τ_drive|·z at each arm drive, with z = tanh(k·q̇), or with the internal state z of [`presliding`]
/// over the angle h where h > 0, z(0) = 0.
///
/// μ dimensionless, never negative; τ_drive the total drive torque at the gear output, friction included, or the load at
/// the output of a single axis where it is known; k in s/rad, h in rad. In the twin τ_drive is known; inverse dynamics
/// iterates with contraction factor μ.
///
/// In sliding it dissipates μ·|τ_drive·q̇|. Within h of a reversal it is a spring of stiffness μ·|τ_drive|/h and returns what
/// it stored, μ·|τ_drive|·h·z²/2, under constant load; one that grows while the spring unwinds adds up to
/// μ·h·Δ|τ_drive|·z²/2.
///
/// A further term μ₁·τ·z², which does not change its sign with the motion, is left to `gear_efficiency`: with |z| = 1 the sum is
/// the law there with μ₊ = μ + μ₁ and μ₋ = μ − μ₁.
pub struct GearLoadFriction;

const FRICTION: usize = 0;
const STEEPNESS: usize = 1;
const PRESLIDING: usize = 2;

const PARAMETERS: &[Parameter] = &[
    Parameter::new("friction", Unit::One, Role::Linear, 0.02, (0.0, 0.5)).counted(Count::PerArm),
    STEEPNESS_PARAMETER,
    Parameter::new("presliding", Unit::Rad, Role::Shape, 0.0, (1e-5, 0.05)).or_zero(),
];

/// Without presliding, and angles of it from lost motion (arc minutes) to elastic transmissions (degrees).
static STARTS: [Start; 5] = {
    const fn at(angle: &'static [f64]) -> Start {
        Start([Some((PRESLIDING, angle)), None, None])
    }
    [at(&[0.0]), at(&[5e-4]), at(&[2e-3]), at(&[8e-3]), at(&[0.03])]
};

static SPEC: Spec = Spec::new(
    "gear_load_friction",
    Part::Drives,
    About {
        summary: "friction of the arm gears in proportion to the torque they transmit",
        law: "τ_f,i = −μ_i·|τ_i|·z_i, τ_i the drive torque at the gear output, or the known load; z = tanh(k·q̇), \
              or with presliding h > 0: dz/dt = (q̇ − |q̇|·z)/h",
        shows: "torque scaled up while a drive works and down while it brakes; with presliding it changes over an angle \
                after a reversal",
        source: "Bittencourt et al., IROS 2010: about 2 % of the load torque; 1–5 %; presliding: Dahl, 1968",
    },
    PARAMETERS,
)
.drive_friction()
.constants(as_drive_friction)
.reads(Reads { torque: true, ..Reads::MOTION })
.starts(&STARTS);

impl Effect for GearLoadFriction {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for axis in 0..values.len(FRICTION) {
            let sliding = || smooth_sign(at.motion.qd[axis], values.one(STEEPNESS));
            let sign = at.state.get(axis).copied().unwrap_or_else(sliding);
            out.drive_torque(values.index(FRICTION, axis), axis, -at.transmitted(axis).abs() * sign);
        }
    }

    fn states(&self) -> Option<&dyn InternalStates> {
        Some(self)
    }
}

impl InternalStates for GearLoadFriction {
    fn initial_state(&self, values: &Values) -> Vec<f64> {
        vec![0.0; if values.one(PRESLIDING) > 0.0 { values.len(FRICTION) } else { 0 }]
    }

    fn state_rate(&self, values: &Values, at: &Instant, rate: &mut [f64], slope: &mut [f64]) {
        for i in 0..rate.len() {
            (rate[i], slope[i]) = presliding(at.state[i], at.motion.qd[i], values.one(PRESLIDING));
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
        let active = ActiveEffect::new(Arc::new(GearLoadFriction), &[&[0.02; 3], &[100.0], &[0.0]]);
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

    #[test]
    fn after_a_reversal_friction_follows_the_load_and_the_angle() {
        // 2 % of 50 N·m by z = −0.5: 0.5 N·m along the motion, whatever its speed.
        let active = ActiveEffect::new(Arc::new(GearLoadFriction), &[&[0.02; 3], &[100.0], &[1e-3]]);
        let mut motion = testing::still();
        motion.qd = [3.0; 4];
        let state = [-0.5, 0.0, 1.0];
        let mut torque = [0.0; 3];
        testing::at(&motion, &state, |at| {
            let at = &Instant { torque: [-50.0; 4], ..*at };
            GearLoadFriction.wrenches(
                &active.values(),
                at,
                &mut Wrenches::new(at.motion, &mut |k, body, _, m| {
                    torque[body] += active.values[k] * m.dot(&motion.drive(body).1.angular);
                }),
            );
            let (mut rate, mut slope) = ([0.0; 3], [0.0; 3]);
            active.state_rate(at, &mut rate, &mut slope);
            // (3 − 3·z)/1e-3
            approx::assert_relative_eq!(rate.as_slice(), [4500.0, 3000.0, 0.0].as_slice());
            approx::assert_relative_eq!(slope.as_slice(), [-3000.0; 3].as_slice());
        });
        approx::assert_relative_eq!(torque.as_slice(), [0.5, 0.0, -1.0].as_slice(), epsilon = 1e-12);
    }

    #[test]
    fn presliding_of_zero_is_no_state_and_no_parameter() {
        let with = |angle: f64| ActiveEffect::new(Arc::new(GearLoadFriction), &[&[0.02; 3], &[100.0], &[angle]]);
        let role = |active: &ActiveEffect| active.entries()[4].parameter.role;
        assert_eq!((with(0.0).states(), role(&with(0.0))), (0, Role::Fixed));
        assert_eq!((with(1e-3).states(), role(&with(1e-3))), (3, Role::Shape));
    }
}

//! Gear friction proportional to the transmitted torque that differs between driving and being driven.

use super::{
    About, Count, Effect, Instant, Parameter, Part, Reads, Role, STEEPNESS_PARAMETER, Spec, Unit, Values, Wrenches,
    as_drive_friction, smooth_sign,
};

/// Friction torque τ_f = −μ·|τ|·s, s = tanh(k·q̇), at each arm drive, with μ = μ₊ while the drive drives the load (τ·s >
/// 0) and μ = μ₋ while the load drives the gear (τ·s < 0).
///
/// μ₊ and μ₋ dimensionless, never negative; τ the total drive torque at the gear output, friction included, as in
/// `gear_load_friction`, which is the case μ₊ = μ₋; k in s/rad. The torque that reaches the load is τ + τ_f: the
/// efficiency is 1 − μ₊ forward and 1/(1 + μ₋) backward. Continuous where τ or q̇ changes its sign. Dissipates μ·|τ|·q̇·s.
///
/// The directional law |K_m·τ − K_e·τ_e|·s of [Duclusaud 2024] (model M5), with the motor's torque τ and the external
/// torque τ_e = −(τ + τ_f) on the gear, is this law with μ₊ = (K_m + K_e)/(1 + K_e) and μ₋ = (K_m + K_e)/(1 − K_e) for s =
/// ±1. Its terms that decay with speed and that grow with the square of the torque (M6) are not included.
pub struct GearEfficiency;

const DRIVING: usize = 0;
const DRIVEN: usize = 1;
const STEEPNESS: usize = 2;

const fn share(name: &'static str, default: f64) -> Parameter {
    Parameter::new(name, Unit::One, Role::Linear, default, (0.0, 0.5)).counted(Count::PerArm)
}

const PARAMETERS: &[Parameter] = &[share("driving", 0.03), share("driven", 0.06), STEEPNESS_PARAMETER];

static SPEC: Spec = Spec::new(
    "gear_efficiency",
    Part::Drives,
    About {
        summary: "friction of the arm gears by load, other forward than backward",
        law: "τ_f,i = −μ_i·|τ_i|·tanh(k·q̇_i), μ_i = μ₊,i while τ_i·q̇_i > 0 (driving), else μ₋,i (driven); τ_i or the known load",
        shows: "torque in proportion to itself, with one factor while a drive works and another while it brakes",
        source: "Bittencourt & Gunnarsson 2012 (load); Duclusaud et al. 2024, model M5 (direction); 2–10 % of the load",
    },
    PARAMETERS,
)
.drive_friction()
.constants(as_drive_friction)
.reads(Reads { torque: true, ..Reads::MOTION });

impl Effect for GearEfficiency {
    fn spec(&self) -> &Spec {
        &SPEC
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        for axis in 0..values.len(DRIVING) {
            let (sign, torque) = (smooth_sign(at.motion.qd[axis], values.one(STEEPNESS)), at.transmitted(axis));
            let block = if torque * sign > 0.0 { DRIVING } else { DRIVEN };
            out.drive_torque(values.index(block, axis), axis, -torque.abs() * sign);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::{ActiveEffect, find, testing};

    /// Torques on the arms at the rates 1, 1, −1 rad/s, where tanh(100) = 1.
    fn on_arms(active: &ActiveEffect, torque: [f64; 3]) -> [f64; 3] {
        let mut motion = testing::still();
        motion.qd = [1.0, 1.0, -1.0, 0.0];
        let mut sum = [0.0; 3];
        testing::at(&motion, &[], |at| {
            let at = &Instant { torque: [torque[0], torque[1], torque[2], 50.0], ..*at };
            active.effect.wrenches(
                &active.values(),
                at,
                &mut Wrenches::new(at.motion, &mut |k, body, _, m| {
                    sum[body] += active.values[k] * m.dot(&motion.drive(body).1.angular);
                }),
            );
        });
        sum
    }

    #[test]
    fn braking_costs_more_than_driving() {
        // 50 N·m: 2 % = 1 N·m while driving, 6 % = 3 N·m while driven, always against the motion.
        let active = ActiveEffect::new(Arc::new(GearEfficiency), &[&[0.02; 3], &[0.06; 3], &[100.0]]);
        approx::assert_relative_eq!(
            on_arms(&active, [50.0, -50.0, -50.0]).as_slice(),
            [-1.0, -3.0, 1.0].as_slice(),
            epsilon = 1e-12
        );
        assert!((on_arms(&active, [0.0, 0.0, 50.0])[2] - 3.0).abs() < 1e-12);
    }

    #[test]
    fn equal_shares_are_friction_by_load() {
        let both = ActiveEffect::new(Arc::new(GearEfficiency), &[&[0.04; 3], &[0.04; 3], &[100.0]]);
        let load = ActiveEffect::new(find("gear_load_friction").unwrap(), &[&[0.04; 3], &[100.0], &[0.0]]);
        for torque in [[50.0, -50.0, 20.0], [-3.0, 0.0, -70.0]] {
            assert_eq!(on_arms(&both, torque), on_arms(&load, torque));
        }
    }

    /// The published law, solved for its friction at given torques of motor and load.
    #[test]
    fn the_published_directional_law_is_contained() {
        let (motor, external) = (0.05, 0.02);
        let driving = (motor + external) / (1.0 + external);
        let driven = (motor + external) / (1.0 - external);
        let active = ActiveEffect::new(Arc::new(GearEfficiency), &[&[driving; 3], &[driven; 3], &[100.0]]);
        let torque = [40.0, -25.0, 30.0];
        for (i, friction) in on_arms(&active, torque).into_iter().enumerate() {
            let load = -(torque[i] + friction);
            approx::assert_relative_eq!(friction.abs(), (motor * torque[i] - external * load).abs(), epsilon = 1e-12);
        }
    }
}

//! The virtual robot of the experiments, assembled and disassembled.
//!
//! It is a single machine: the arms and arm drives of the disassembled model (Table 1 of the paper) with the struts,
//! platform and telescope of the assembled one (Tables 3 and 4) and optionally friction in its ball sockets.

use nalgebra::Vector3;

use super::paper;
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::machine::bodies::{ARM, ROTOR, STRUT};
use deltatwin::machine::{Inertia, SixStruts, ThreeArms, each, three_arms};
use deltatwin::model::Model;

/// Effects in the ball sockets.
const SOCKET_FRICTION: [&str; 3] = ["ball_socket_viscous", "ball_socket_coulomb", "ball_socket_load_dependent"];
const DRIVE_FRICTION: &str = "drive_friction";

/// `assembled` with the arms, the rotor and the arm drives' friction of `disassembled`.
pub fn one_machine(mut assembled: Model, disassembled: &Model) -> Model {
    for body in (ARM..STRUT).chain([ROTOR]) {
        assembled.bodies[body] = disassembled.bodies[body];
    }
    let own = disassembled.effects.iter().find(|a| a.effect.name() == DRIVE_FRICTION);
    let target = assembled.effects.iter_mut().find(|a| a.effect.name() == DRIVE_FRICTION);
    if let (Some(own), Some(target)) = (own, target) {
        for block in [0, 1] {
            for arm in three_arms() {
                let at = target.values().index(block, arm);
                target.values[at] = own.values().block(block)[arm];
            }
        }
    }
    assembled
}

/// The robot with frictionless ball sockets.
pub fn without_socket_friction(robot: &Model) -> Model {
    let mut free = robot.clone();
    free.effects.retain(|a| !SOCKET_FRICTION.contains(&a.effect.name()));
    free
}

/// The robot with a weight, kg, on the elbow of every arm (section 6.2.1; the paper does not state its position).
pub fn with_arm_weights(robot: &Model, mass: f64) -> Model {
    let mut loaded = robot.clone();
    for arm in ARM..STRUT {
        loaded.bodies[arm] += Inertia::point(mass, Vector3::x() * robot.geometry.limbs[0].arm_length);
    }
    loaded
}

/// The robot with the measurement strut of 340 g in place of strut 1 (section 6.5); the additional mass is
/// distributed evenly along it.
///
/// # Panics
/// If the effect `limb_asymmetry` is not registered, which does not occur.
pub fn with_measurement_strut(robot: &Model) -> Model {
    let mut measuring = robot.clone();
    let arms: ThreeArms<f64> = each(0.0);
    let mut extra: SixStruts<f64> = each(0.0);
    extra[0] = paper::MEASUREMENT_STRUT - robot.bodies[STRUT].mass;
    let lengths = [[robot.geometry.limbs[0].strut_length], [robot.geometry.limbs[0].arm_length]];
    let [center, gyration] = [[0.5], [f64::sqrt(1.0 / 3.0)]];
    let effect = find("limb_asymmetry").expect("a registered effect");
    measuring.effects.retain(|a| a.effect.name() != effect.name());
    measuring.effects.push(ActiveEffect::new(effect, &[&extra, &arms, &lengths[0], &lengths[1], &center, &gyration]));
    measuring
}

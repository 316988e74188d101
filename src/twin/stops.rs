//! Hard stops of arms, telescope and Hooke joints.
//!
//! Each stop is a buffer of stiffness k with the law of [Hunt 1975], f = k·x·max(0, 1 + χ·ẋ), where x is the depth
//! beyond the limit (see [`hunt_crossley`]); f opposes the penetration:
//!
//! - arm i, x = φ − φ_max or φ_min − φ in rad: the torque ∓f in N·m about its shaft, from the base;
//! - telescope, x = L − L_max or L_min − L in m: the force f in N along the bar, between its two parts;
//! - Hooke joints, x = θ − θ_max in rad, with θ the angle between the axes of the two joined parts: the moment f in N·m
//!   about their common normal, between them.
//!
//! Planning, excitation and inverse dynamics stay within the limits and do not include the stops.

use nalgebra::Vector3;

use super::wrench::Twist;
use crate::dynamics::Plant;
use crate::effects::hunt_crossley;
use crate::kinematics::Motion;
use crate::machine::bodies::{END_EFFECTOR, ROTOR, SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER};
use crate::machine::every_limb;

/// Number of degrees of freedom with stops: arms, telescope, two Hooke joints.
pub const STOPS: usize = LOWER_HOOKE + 1;
const TELESCOPE: usize = every_limb().end;
const UPPER_HOOKE: usize = TELESCOPE + 1;
const LOWER_HOOKE: usize = UPPER_HOOKE + 1;

/// State of a degree of freedom beyond its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Depth beyond the limit, m or rad; positive.
    pub depth: f64,
    /// Rate of the depth, m/s or rad/s.
    pub rate: f64,
    /// Whether the upper limit is exceeded, not the lower one.
    pub above: bool,
}

/// Every degree of freedom of `plant` beyond its limit.
pub fn hits(plant: &Plant, motion: &Motion) -> [Option<Hit>; STOPS] {
    let stops = &plant.stops;
    let mut out = [None; STOPS];
    if stops.arm_stiffness > 0.0 {
        for i in 0..plant.mechanism.arms() {
            out[i] = beyond(motion.q[i], motion.qd[i], stops.arm);
        }
    }
    if plant.assembled && plant.mechanism.has_telescope() {
        if stops.telescope_stiffness > 0.0 {
            let bar = &motion.telescope;
            out[TELESCOPE] = beyond(bar.length, bar.rate, plant.geometry.telescope_limits);
        }
        if stops.hooke_stiffness > 0.0 {
            for joint in [UPPER_HOOKE, LOWER_HOOKE] {
                if is_straighter(motion, joint, stops.hooke) {
                    continue;
                }
                let (angle, rate, _) = bend(motion, joint);
                out[joint] = beyond(angle, rate, [f64::NEG_INFINITY, stops.hooke]);
            }
        }
    }
    out
}

fn beyond(x: f64, rate: f64, [low, high]: [f64; 2]) -> Option<Hit> {
    if x > high {
        Some(Hit { depth: x - high, rate, above: true })
    } else if x < low {
        Some(Hit { depth: low - x, rate: -rate, above: false })
    } else {
        None
    }
}

/// The two bodies of a Hooke joint: the outer one and the part of the telescope.
fn joined(joint: usize) -> (usize, usize) {
    if joint == UPPER_HOOKE { (ROTOR, TELESCOPE_UPPER) } else { (END_EFFECTOR, TELESCOPE_LOWER) }
}

/// Whether a Hooke joint is certainly bent by less than `angle` (rad): its cosine is above the upper bound
/// 1 − x²/2 + x⁴/24 of cos x.
fn is_straighter(motion: &Motion, joint: usize, angle: f64) -> bool {
    let (outer, inner) = joined(joint);
    let along = |body: usize| motion.bodies[body].rotation.column(2);
    let square = angle * angle;
    along(outer).dot(&along(inner)) > 1.0 - square * (0.5 - square / 24.0)
}

/// Angle between the z axes of a Hooke joint's bodies (rad), its rate (rad/s), and the axis about which the telescope
/// part is rotated.
fn bend(motion: &Motion, joint: usize) -> (f64, f64, Vector3<f64>) {
    let (outer, inner) = joined(joint);
    let [a, b] = [outer, inner].map(|k| &motion.bodies[k]);
    let (za, zb) = (a.rotation.column(2), b.rotation.column(2));
    let normal = za.cross(&zb);
    let sine = normal.norm();
    let angle = sine.atan2(za.dot(&zb));
    // At zero angle the axis is undefined, and no stop is near.
    let axis = if sine > 0.0 { normal / sine } else { Vector3::zeros() };
    (angle, (b.angular_velocity - a.angular_velocity).dot(&axis), axis)
}

/// Adds the loads of the stops in `hits` to the bodies; returns their power, W.
pub(super) fn add(plant: &Plant, motion: &Motion, hits: &[Option<Hit>; STOPS], wrenches: &mut [Twist; SLOTS]) -> f64 {
    let stops = &plant.stops;
    let mut power = 0.0;
    for (k, hit) in hits.iter().enumerate() {
        let Some(hit) = hit else { continue };
        let (stiffness, damping) = match k {
            TELESCOPE => (stops.telescope_stiffness, stops.telescope_damping),
            UPPER_HOOKE | LOWER_HOOKE => (stops.hooke_stiffness, stops.hooke_damping),
            _ => (stops.arm_stiffness, stops.arm_damping),
        };
        let push = stiffness * hunt_crossley(hit.depth, hit.rate, damping);
        power -= push * hit.rate;
        // Sign along the coordinate.
        let push = if hit.above { -push } else { push };
        match k {
            TELESCOPE => {
                let force = motion.telescope.axis * push;
                wrenches[TELESCOPE_UPPER].0 += force;
                wrenches[TELESCOPE_LOWER].0 -= force;
            }
            UPPER_HOOKE | LOWER_HOOKE => {
                let (outer, inner) = joined(k);
                let moment = bend(motion, k).2 * push;
                wrenches[inner].1 += moment;
                wrenches[outer].1 -= moment;
            }
            arm => {
                let (body, screw) = motion.drive(arm);
                screw.push(&mut wrenches[body], push);
            }
        }
    }
    power
}

/// The stop that was reached, in words.
pub fn name(stop: usize, hit: &Hit) -> String {
    let end = if hit.above { "upper" } else { "lower" };
    match stop {
        TELESCOPE => format!("telescope at its {} end", if hit.above { "long" } else { "short" }),
        UPPER_HOOKE => "upper Hooke joint at its limit".into(),
        LOWER_HOOKE => "lower Hooke joint at its limit".into(),
        arm => format!("arm {} at its {end} stop", arm + 1),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::testing;
    use crate::kinematics::JointState;
    use crate::machine::{Setup, Stops};
    use crate::model::testing::irb360;
    use crate::numerics::{bisect, halvings};
    use crate::twin::{Torque, Twin};

    fn plant(change: impl FnOnce(&mut Stops)) -> Plant {
        let mut model = irb360();
        model.effects.clear();
        change(&mut model.stops);
        Plant::new(&model, &Setup::default())
    }

    /// Independent arms without weight: Θ·q̈ = −k·x·(1 + χ·ẋ) beyond the stop.
    fn lone_arms(damping: f64) -> Plant {
        let mut plant = plant(|stops| stops.arm_damping = damping);
        (plant.assembled, plant.gravity) = (false, 0.0);
        plant
    }

    /// With v = ẋ: Θ·v·dv/(1 + χ·v) = −k·x·dx. The left side integrated from 0 to v, over Θ.
    fn potential(v: f64, damping: f64) -> f64 {
        if damping == 0.0 { 0.5 * v * v } else { v / damping - (damping * v).ln_1p() / (damping * damping) }
    }

    #[test]
    fn an_arm_that_hits_its_stop_turns_back_as_the_closed_form_says() {
        for (damping, speed) in [(0.0, 8.0), (0.05, 8.0), (0.05, -8.0), (0.2, 4.0)] {
            let plant = lone_arms(damping);
            let stops = plant.stops;
            let theta = plant.bodies[0].tensor[(1, 1)];
            let end = if speed > 0.0 { stops.arm[1] } else { stops.arm[0] };
            let start = JointState { q: [end, 0.5, 0.5, 0.0], qd: [speed, 0.0, 0.0, 0.0], ..JointState::default() };
            let mut twin = Twin::new(plant.clone(), &plant.motion(&start).unwrap()).unwrap();
            let mut deepest = 0f64;
            for _ in 0..400 {
                twin.step(2e-4, &Torque::default()).unwrap();
                let x = (twin.motion().q[0] - end) * speed.signum();
                deepest = deepest.max(x);
            }
            let motion = twin.motion();
            // Deepest at v = 0: k·x²/2 = Θ·potential(v₀). The rebound speed v₁ < 0 has the same potential.
            let expected = (2.0 * theta * potential(speed.abs(), damping) / stops.arm_stiffness).sqrt();
            let above = |v: f64| potential(v, damping) > potential(speed.abs(), damping);
            let [low, _] = bisect([-speed.abs(), 0.0], halvings(speed.abs(), 1e-12), above);
            let back = motion.qd[0] * speed.signum();
            println!("χ {damping}, {speed} rad/s: {deepest:.5} rad deep ({expected:.5}), back at {back:.4} ({low:.4})");
            approx::assert_relative_eq!(deepest, expected, max_relative = 2e-3);
            approx::assert_relative_eq!(back, low, max_relative = 1e-3);
            // The work of the stop equals the energy lost by the arm.
            let lost = 0.5 * theta * (speed * speed - back * back);
            assert!((twin.work()[7] + lost).abs() < 1e-3 * (lost + 0.1) && twin.energy_balance().abs() < 1e-2);
            assert_eq!((motion.qd[1], twin.hits()), (0.0, &[None; STOPS]));
        }
    }

    #[test]
    fn loads_at_a_telescope_too_long_and_a_hooke_joint_bent_too_far_by_hand() {
        let plant = plant(|_| {});
        let stops = plant.stops;
        let mut motion = testing::still();
        motion.telescope.length = 1.372 + 2e-3;
        motion.telescope.rate = 0.5;
        // The upper telescope part is inclined by 0.02 rad more than the upper joint allows, about x, increasing at 3
        // rad/s.
        let bent = nalgebra::Rotation3::from_axis_angle(&Vector3::x_axis(), stops.hooke + 0.02);
        motion.bodies[TELESCOPE_UPPER].rotation = bent.into_inner();
        motion.bodies[TELESCOPE_UPPER].angular_velocity = Vector3::new(3.0, 7.0, 0.0);
        let hits = hits(&plant, &motion);
        let mut loads = [(Vector3::zeros(), Vector3::zeros()); SLOTS];
        let power = add(&plant, &motion, &hits, &mut loads);
        // 1e5 N/m · 2 mm · (1 + 0.3·0.5) = 230 N; 2e3 N·m/rad · 0.02 rad · (1 + 0.05·3) = 46 N·m.
        let z = Vector3::z;
        approx::assert_relative_eq!(loads[TELESCOPE_LOWER].0, z() * 230.0, epsilon = 1e-8);
        approx::assert_relative_eq!(loads[TELESCOPE_UPPER].0, z() * -230.0, epsilon = 1e-8);
        approx::assert_relative_eq!(loads[TELESCOPE_UPPER].1, Vector3::x() * -46.0, epsilon = 1e-8);
        approx::assert_relative_eq!(loads[ROTOR].1, Vector3::x() * 46.0, epsilon = 1e-8);
        approx::assert_relative_eq!(power, -230.0 * 0.5 - 46.0 * 3.0, epsilon = 1e-7);
        let told: Vec<String> = hits.iter().enumerate().filter_map(|(k, h)| h.as_ref().map(|h| name(k, h))).collect();
        assert_eq!(told, ["telescope at its long end", "upper Hooke joint at its limit"]);
        // Zero stiffness means no stops.
        let free = Plant { stops: Stops { telescope_stiffness: 0.0, hooke_stiffness: 0.0, ..stops }, ..plant };
        assert_eq!(super::hits(&free, &motion), [None; STOPS]);
    }
}

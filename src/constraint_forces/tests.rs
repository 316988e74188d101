use nalgebra::Vector3;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::loads::rigid_loads;
use super::*;
use crate::dynamics::{Plant, inverse_dynamics};
use crate::effects::{ActiveEffect, find};
use crate::kinematics::{JointState, Motion};
use crate::machine::bodies::{self, END_EFFECTOR};
use crate::machine::{Payload, Setup};
use crate::model::Model;
use crate::model::testing::{irb360, irb360_truth};
use crate::twin::{Torque, Twin};

fn setup() -> Setup {
    let payload = Payload::new(2.5, Vector3::new(0.03, -0.02, -0.08), 0.012);
    Setup { payload, ..Setup::default() }
}

fn plant(model: Model) -> Plant {
    Plant::new(&model, &setup())
}

/// Motions within the workspace up to 8 rad/s and 80 rad/s² (axis 4: 24 rad/s, 240 rad/s²).
fn motions(plant: &Plant, count: usize) -> Vec<Motion> {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let mut out = Vec::new();
    while out.len() < count {
        let q = std::array::from_fn(|i| rng.random_range(if i == 3 { -3.0..3.0 } else { -0.5..1.2 }));
        let scaled = |size: f64, i: usize| if i == 3 { 3.0 * size } else { size };
        let qd = std::array::from_fn(|i| scaled(rng.random_range(-8.0..8.0), i));
        let qdd = std::array::from_fn(|i| scaled(rng.random_range(-80.0..80.0), i));
        let Ok(p) = plant.geometry.forward(&q) else { continue };
        if plant.geometry.check_limits(&q, &p).is_ok() {
            out.push(plant.motion(&JointState { q, qd, qdd }).unwrap());
        }
    }
    out
}

fn rest(plant: &Plant) -> Vec<Vec<f64>> {
    plant.effects.iter().map(|a| a.initial_state()).collect()
}

fn forces(plant: &Plant, motion: &Motion, detail: Detail) -> Multipliers {
    let own = rest(plant);
    let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
    constraint_forces(plant, 0.0, motion, &states, detail).unwrap()
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[test]
fn block_elimination_solves_the_dense_system() {
    let plant = plant(irb360());
    for motion in motions(&plant, 100) {
        for detail in [Detail::Reduced, Detail::Complete] {
            let statics = Statics::of(&plant, &motion, detail).unwrap();
            let loads = statics.loads(&motion, &rigid_loads(&plant, 0.0, &motion, detail));
            let dense = statics.jacobian().transpose().lu().solve(&loads.to_vector(&statics)).unwrap();
            let block = statics.solve(&loads).to_array();
            let error = distance(&block, dense.as_slice()) / dense.amax();
            assert!(error < 1e-12, "{detail:?}: {error:e}");
        }
    }
}

#[test]
fn a_change_to_what_is_not_a_number_is_not_small() {
    let known = Multipliers { lambda_a: [1.0, 2.0, 3.0], ..Multipliers::default() };
    assert_eq!(known.output().change(&Multipliers::default().output()), 3.0);
    let mut lost = known;
    lost.lambda_p[2] = f64::NAN;
    assert!(known.output().change(&lost.output()).is_nan() && lost.output().change(&known.output()).is_nan());
}

#[test]
fn the_complete_detail_is_the_inverse_dynamics_with_every_effect() {
    let mut truth = plant(irb360_truth());
    for name in ["ball_socket_load_dependent", "gear_load_friction", "hooke_friction", "air_drag", "hose_spring"] {
        let mut active = ActiveEffect::absent(find(name).unwrap());
        active.values = active.entries().iter().map(|e| e.parameter.default).collect();
        truth.effects.push(active);
    }
    let own = rest(&truth);
    let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
    for motion in motions(&truth, 100) {
        let expected = inverse_dynamics(&truth, 0.0, &motion, &states, true).unwrap();
        let found = forces(&truth, &motion, Detail::Complete).output();
        let scale = expected.reactions.lower.iter().fold(100.0, |m: f64, f| m.max(f.abs()));
        assert!(distance(&found.tau, &expected.tau) < 1e-12 * scale, "{found:?}\n{expected:?}");
        assert!(distance(&found.reactions.upper, &expected.reactions.upper) < 1e-12 * scale);
        assert!(distance(&found.reactions.lower, &expected.reactions.lower) < 1e-12 * scale);
    }
}

#[test]
fn the_bearing_of_the_end_effector_carries_what_the_twin_says() {
    let plant = plant(irb360_truth());
    for motion in motions(&plant, 50) {
        let forces = forces(&plant, &motion, Detail::Complete);
        let mut twin = Twin::new(plant.clone(), &motion).unwrap();
        let snapshot = twin.evaluate(&Torque::constant(forces.output().tau)).unwrap();
        let (force, moment) = snapshot.joints(twin.plant()).end_effector;
        let ee = motion.bodies[END_EFFECTOR].rotation.transpose();
        let (f, m) = (ee * -force, ee * -moment);
        let expected = [m.x, m.y, f.x, f.y, f.z];
        let error = distance(&forces.lambda_e, &expected);
        assert!(error < 1e-9 * force.norm(), "{error:e}: {:?} {expected:?}", forces.lambda_e);
    }
}

#[test]
fn a_payload_off_the_axis_tilts_the_platform() {
    // At rest in the middle the payload's moment about the flange is m·g·(c × −z), and the struts share weight and
    // moment.
    let plant = plant(irb360());
    let joints = JointState { q: [0.3, 0.3, 0.3, 0.7], ..JointState::default() };
    let motion = plant.motion(&joints).unwrap();
    let forces = forces(&plant, &motion, Detail::Reduced);
    let weight = 2.5 * 9.81;
    approx::assert_relative_eq!(forces.lambda_e[0], 0.02 * weight, epsilon = 1e-12);
    approx::assert_relative_eq!(forces.lambda_e[1], 0.03 * weight, epsilon = 1e-12);
    approx::assert_relative_eq!(forces.lambda_e[4], -weight, epsilon = 1e-12);
    let down: f64 = (0..6).map(|s| -forces.lambda_p[s] * motion.strut_axis[s].z).sum();
    approx::assert_relative_eq!(down, weight + (1.2 + 0.557) * 9.81, epsilon = 1e-9);
    let spread = distance(&forces.lambda_p, &[forces.lambda_p[0]; 6]);
    assert!(spread > 5.0, "{spread}");
}

/// Difference between reduced and complete model over the workspace at up to 8 rad/s and 80 rad/s²: inertia and
/// weight across struts and telescope, and the couple of the Hooke joints that transmits the torque of drive 4.
/// `docs/planner.md` lists the figures.
#[test]
fn the_reduced_model_differs_by_what_it_neglects() {
    let plant = plant(irb360());
    let mut rigid = plant.clone();
    rigid.effects.clear();
    let (mut square, mut worst, mut force) = (0.0, 0.0f64, 0.0);
    let motions = motions(&rigid, 400);
    for motion in &motions {
        let complete = forces(&rigid, motion, Detail::Complete);
        let reduced = forces(&rigid, motion, Detail::Reduced);
        for s in 0..6 {
            let d = complete.lambda_s[s] - reduced.lambda_s[s];
            square += d * d;
            force += complete.lambda_s[s].powi(2);
            worst = worst.max(d.abs());
        }
        // With struts that are point masses at the elbows, a telescope that is a point mass at the platform and no
        // torque of drive 4, both agree.
        let mut light = rigid.clone();
        for s in 0..6 {
            let strut = &mut light.bodies[bodies::strut(s)];
            *strut = crate::machine::Inertia::point(strut.mass, Vector3::zeros());
        }
        for b in [crate::machine::bodies::ROTOR, crate::machine::bodies::TELESCOPE_UPPER] {
            light.bodies[b] = crate::machine::Inertia::ZERO;
        }
        light.bodies[END_EFFECTOR] = crate::machine::Inertia::point(2.5, Vector3::new(0.0, 0.0, -0.08));
        let lower = light.bodies[crate::machine::bodies::TELESCOPE_LOWER].mass;
        light.bodies[crate::machine::bodies::TELESCOPE_LOWER] = crate::machine::Inertia::point(lower, Vector3::zeros());
        light.bodies[crate::machine::bodies::PLATFORM].first_moment = Vector3::z() * (0.038 * 1.2);
        let (a, b) = (forces(&light, motion, Detail::Complete), forces(&light, motion, Detail::Reduced));
        let gap = distance(&a.lambda_p, &b.lambda_p);
        assert!(gap < 1e-9, "{gap:e}");
    }
    let count = (6 * motions.len()) as f64;
    let (rms, typical) = ((square / count).sqrt(), (force / count).sqrt());
    println!("difference {rms:.2} N rms, {worst:.2} N at most, of {typical:.1} N rms");
    assert!((0.05..0.3).contains(&(rms / typical)), "{rms} of {typical}");
}

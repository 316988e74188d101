//! Laws that hold for every registered effect and for the shipped models, whoever wrote the effect.

use crate::common;

use common::{model, nominal_plant, random_joints};
use deltatwin::dynamics::{Output, Plant, Sample, inverse_dynamics, regressor, set_parameters};
use deltatwin::effects::{ActiveEffect, Effect, Instant, Kind, REGISTRY, Role, Wrenches, find};
use deltatwin::kinematics::{JointState, KinematicsError, Motion, PlatformState, Reactions, SocketSet};
use deltatwin::machine::bodies::{
    self, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER, body_name,
};
use deltatwin::machine::{Geometry, Part, Payload, PerStrut, Setup, rate_place};
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin::recording::Signals;
use deltatwin::twin::energy;
use nalgebra::{Matrix3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::sync::Arc;

const NOMINAL: &str = "irb360-6-1600";
const TRUTH: &str = "irb360-6-1600-truth";

fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

fn payload() -> Setup {
    Setup { payload: Payload::new(2.5, [0.03, -0.02, -0.08], 0.012), ..Setup::default() }
}

/// The effect with linear parameters drawn up to three times their usual size, shapes and constants at their defaults.
fn at_random(effect: Arc<dyn Effect>, rng: &mut ChaCha8Rng, non_negative: bool) -> ActiveEffect {
    let mut active = ActiveEffect::absent(effect);
    let entries = active.entries();
    for (value, entry) in active.values.iter_mut().zip(entries) {
        let p = entry.parameter;
        if p.role == Role::Linear {
            let low = if non_negative { 0.0 } else { -3.0 };
            *value = (p.default * rng.random_range(low..3.0)).clamp(p.range.0, p.range.1);
        }
    }
    active
}

/// The nominal model with every registered effect beyond the bodies at once.
fn model_with_everything(rng: &mut ChaCha8Rng) -> Model {
    let mut all = model(NOMINAL);
    all.effects = REGISTRY[1..].iter().map(|e| at_random(e.clone(), rng, false)).collect();
    all
}

fn initial_states(plant: &Plant) -> Vec<Vec<f64>> {
    plant.effects.iter().map(|a| a.initial_state()).collect()
}

fn slices(states: &[Vec<f64>]) -> Vec<&[f64]> {
    states.iter().map(Vec::as_slice).collect()
}

fn inverse(plant: &Plant, motion: &Motion) -> Output {
    inverse_dynamics(plant, 0.0, motion, &slices(&initial_states(plant)), true).expect("a regular pose")
}

fn all_channels() -> Vec<Channel> {
    let struts = (0..6).map(Channel::StrutUpper).chain((0..6).map(Channel::StrutLower));
    Channel::TORQUES.into_iter().chain(struts).collect()
}

fn values_of(out: &Output) -> Vec<f64> {
    [&out.tau[..], &out.reactions.upper[..6], &out.reactions.lower[..6]].concat()
}

/// Power of an effect's wrenches on the bodies, and the sum of the magnitudes of its parts, W.
fn power(plant: &Plant, active: &ActiveEffect, motion: &Motion, loads: &Output) -> (f64, f64) {
    let state = active.initial_state();
    let at = instant(plant, motion, &loads.reactions, loads.tau, &state);
    let (mut sum, mut size) = (0.0, 0.0);
    active.effect.wrenches_along(
        &active.values(),
        &at,
        &mut Wrenches::new(at.motion, &mut |k, body, force, moment| {
            let m = &motion.bodies[body];
            let part = active.values[k] * (force.dot(&m.velocity) + moment.dot(&m.angular_velocity));
            sum += part;
            size += part.abs();
        }),
    );
    (sum, size)
}

// The registry.

#[test]
fn every_effect_file_is_registered_under_its_name() {
    let mut files: Vec<String> = std::fs::read_dir(crate::common::shipped("src/effects"))
        .expect("the effects' folder")
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter_map(|file| file.strip_suffix(".rs").map(String::from))
        .filter(|name| !["mod", "testing", "command", "payload"].contains(&name.as_str()))
        .collect();
    let mut names: Vec<&str> = REGISTRY.iter().map(|e| e.name()).collect();
    files.sort();
    names.sort();
    assert_eq!(files, names);
    assert!(names.windows(2).all(|w| w[0] != w[1]), "names are unique");
    for name in names {
        assert_eq!(find(name).map(|e| e.name()), Some(name));
    }
}

#[test]
fn every_effect_explains_itself() {
    for effect in REGISTRY.iter() {
        let name = effect.name();
        let about = effect.spec().about;
        for text in [about.summary, about.law, about.shows, about.source] {
            assert!(!text.trim().is_empty(), "{name}: {about:?}");
        }
        let mut keys = std::collections::BTreeSet::new();
        assert!(!effect.parameters().is_empty() || effect.formula().is_some(), "{name} has parameters");
        for p in effect.parameters() {
            let (low, high) = p.range;
            assert!(low.is_finite() && high.is_finite() && low < high, "{name}.{}", p.name);
            let allowed = (p.least()..=high).contains(&p.default);
            assert!(allowed, "{name}.{}: default {} in {low}..{high}", p.name, p.default);
            assert!(keys.insert(p.name.clone()), "{name}.{} appears twice", p.name);
            if p.role == Role::Linear {
                assert!((low..=high).contains(&0.0), "{name}.{}: zero, no effect, is allowed", p.name);
            }
        }
    }
}

#[test]
fn effects_act_on_nothing_but_the_parts_they_name() {
    let plant = Plant::new(&model(NOMINAL), &payload());
    let mut rng = rng(11);
    for effect in &REGISTRY[1..] {
        let on_drives = |b: usize| b < STRUT || b == ROTOR;
        let allowed = |b: usize| match effect.acts_on() {
            Part::Drives => on_drives(b),
            Part::Axis4 | Part::FourthDrive => b == ROTOR,
            // Weight is checked below: every body, in proportion to its mass.
            Part::Weight => true,
            Part::Linkage | Part::ArmDrives | Part::Delta => b <= END_EFFECTOR,
            Part::Telescope => b >= END_EFFECTOR,
            Part::TurningAxis => b == 0,
        };
        let mut active = at_random(Arc::clone(effect), &mut rng, true);
        let entries = active.entries();
        active.values.iter_mut().zip(entries).for_each(|(v, e)| *v = v.max(0.5 * e.parameter.default.abs()));
        let motion = plant.motion(&random_joints(&plant, &mut rng)).unwrap();
        let (loads, state) = (inverse(&plant, &motion), active.initial_state());
        let at = instant(&plant, &motion, &loads.reactions, loads.tau, &state);
        let name = effect.name();
        let refuse =
            |b: usize| assert!(allowed(b), "{name} acts on {}, not only on {:?}", body_name(b), effect.acts_on());
        let mut forces = Vec::new();
        effect.wrenches(
            &active.values(),
            &at,
            &mut Wrenches::new(at.motion, &mut |k, b, force, _| {
                refuse(b);
                forces.push((k, b, force));
            }),
        );
        if effect.acts_on() == Part::Weight {
            let per_mass = |&(k, b, force): &(usize, usize, Vector3<f64>)| (k, force / plant.bodies.0[b].mass);
            let heavy: Vec<_> = forces.iter().filter(|(_, b, _)| plant.bodies.0[*b].mass > 0.0).collect();
            assert!(heavy.len() > BODIES / 2, "{name} acts on the weight of {} bodies", heavy.len());
            for (k, pull) in heavy.iter().map(|force| per_mass(force)) {
                let first = heavy.iter().map(|force| per_mass(force)).find(|(other, _)| *other == k);
                let gap = first.map_or(f64::INFINITY, |(_, other)| (pull - other).norm());
                assert!(gap < 1e-9 * plant.gravity, "{name}: bodies fall apart by {gap:e} m/s²");
            }
        }
        effect.inertia(&active.values(), &payload().payload, &mut |_, b, _| refuse(b));
        let mut geometry = plant.geometry;
        effect.geometry(&active.values(), &mut geometry);
        let on_struts = matches!(effect.acts_on(), Part::Linkage | Part::Delta);
        assert!(geometry == plant.geometry || on_struts, "{name}");
    }
}

#[test]
fn the_effect_of_the_documentation_works_as_it_stands() {
    let (page, code) = (
        std::fs::read_to_string(crate::common::shipped("docs/contributing.md")).unwrap(),
        include_str!("effects/platform_damper.rs"),
    );
    assert!(page.contains(&format!("```rust\n{code}```\n")), "the documentation shows another file");
    // 3 N·s/m at v: the drives give 3·|v|² more, wherever the robot stands and however it moves.
    let base = model(NOMINAL);
    let mut damped = base.clone();
    damped.effects.push(ActiveEffect::new(Arc::new(crate::effects::platform_damper::PlatformDamper), &[&[3.0]]));
    let [plant, damped] = [base, damped].map(|m| Plant::new(&m, &payload()));
    assert!(
        damped
            .parameters()
            .iter()
            .any(|p| p.name == "platform_damper.damping" && p.unit == crate::effects::Unit::NSPerM)
    );
    let joints = random_joints(&plant, &mut rng(21));
    let motion = plant.motion(&joints).unwrap();
    let [without, with] = [&plant, &damped].map(|p| inverse(p, &motion).tau);
    let power: f64 = (0..4).map(|i| (with[i] - without[i]) * joints.qd[i]).sum();
    let speed = motion.bodies[deltatwin::machine::bodies::PLATFORM].velocity;
    approx::assert_relative_eq!(power, 3.0 * speed.norm_squared(), max_relative = 1e-9);
    assert!(power > 1e-3, "{power}");
}

// What effects do to the dynamics.

#[test]
fn zero_parameters_change_nothing() {
    for name in [NOMINAL, TRUTH] {
        let base = model(name);
        let plant = Plant::new(&base, &payload());
        for effect in REGISTRY.iter() {
            let mut with = base.clone();
            with.effects.push(ActiveEffect::absent(Arc::clone(effect)));
            let with = Plant::new(&with, &payload());
            assert_eq!(with.geometry, plant.geometry, "{}", effect.name());
            assert_eq!(with.bodies, plant.bodies, "{}", effect.name());
            let mut rng = rng(1);
            for _ in 0..10 {
                let motion = plant.motion(&random_joints(&plant, &mut rng)).unwrap();
                // Zero times a finite term is an exact zero.
                assert_eq!(inverse(&with, &motion), inverse(&plant, &motion), "{}", effect.name());
            }
            let signals = random_signals(&mut rng);
            let mut observed = signals.clone();
            let absent = ActiveEffect::absent(Arc::clone(effect));
            absent.observe(&mut observed);
            assert_eq!(observed, signals, "{}", effect.name());
            let state: Vec<f64> = absent.initial_state().iter().map(|x| x + 1.0).collect();
            let mut angles = [0.5; 4];
            absent.encoder(&state, &mut angles);
            assert_eq!(angles, [0.5; 4], "{}", effect.name());
            assert_eq!(absent.strut_spring(), None, "{}", effect.name());
            assert_eq!(absent.gear_springs(), None, "{}", effect.name());
            let motion = plant.motion(&random_joints(&plant, &mut rng)).unwrap();
            let [torque, zero] =
                [[30.0; 4], [0.0; 4]].map(|torque| drive_torques(&plant, &absent, &motion, torque, &state));
            assert_eq!((torque, zero), ([0.0; 4], [0.0; 4]), "{}", effect.name());
        }
    }
}

/// Torques an effect's wrenches put on the four drives in the twin, where the drives' torques are known.
fn drive_torques(plant: &Plant, active: &ActiveEffect, motion: &Motion, torque: [f64; 4], state: &[f64]) -> [f64; 4] {
    let reactions = Reactions::default();
    let mut sum = [0.0; 4];
    active.effect.wrenches(
        &active.values(),
        &instant(plant, motion, &reactions, torque, state),
        &mut Wrenches::new(motion, &mut |k, body, force, moment| {
            for (axis, sum) in sum.iter_mut().enumerate().filter(|(axis, _)| motion.drive(*axis).0 == body) {
                *sum += active.values[k] * motion.drive(axis).1.effort(&(force, moment));
            }
        }),
    );
    sum
}

/// Columns of laws that do not depend on the inertia are shared by models of other inertia.
#[test]
fn laws_that_depend_on_the_inertia_say_so() {
    let rng = &mut rng(11);
    let light = Plant::new(&model(NOMINAL), &payload());
    let motion = light.motion(&random_joints(&light, rng)).unwrap();
    let mut heavy = light.clone();
    heavy.bodies.0.iter_mut().for_each(|inertia| *inertia = *inertia * 2.0);
    for effect in &REGISTRY[1..] {
        let active = at_random(effect.clone(), rng, false);
        let state: Vec<f64> = active.initial_state().iter().map(|_| rng.random_range(0.1..1.0)).collect();
        let wrenches = |plant: &Plant| {
            let (mut all, reactions) = (Vec::new(), Reactions::default());
            let at = instant(plant, &motion, &reactions, [3.0; 4], &state);
            let mut add = |k, body, force, moment| all.push((k, body, force, moment));
            let out = &mut Wrenches::new(&motion, &mut add);
            active.effect.wrenches_along(&active.values(), &at, out);
            all
        };
        assert_eq!(wrenches(&light) != wrenches(&heavy), effect.spec().reads.inertia, "{}", effect.name());
    }
}

fn instant<'a>(
    plant: &'a Plant,
    motion: &'a Motion,
    reactions: &'a Reactions,
    torque: [f64; 4],
    state: &'a [f64],
) -> Instant<'a> {
    Instant {
        t: 0.0,
        motion,
        geometry: &plant.geometry,
        bodies: &plant.bodies,
        payload: &plant.payload,
        gravity: plant.gravity,
        reactions,
        state,
        torque,
        load: None,
        closed: SocketSet::ALL,
    }
}

fn random_signals(rng: &mut ChaCha8Rng) -> Signals {
    let mut rows =
        || -> Vec<[f64; 4]> { (0..50).map(|_| std::array::from_fn(|_| rng.random_range(-3.0..3.0))).collect() };
    let t = (0..50).map(|k| 4e-4 * f64::from(k)).collect();
    Signals::of_drives(Default::default(), t, &rows(), &rows())
}

/// Largest |offset + regressor · parameters − inverse dynamics| over 50 motions, relative to each channel's largest value,
/// and the largest |offset| on the torques and on the strut forces.
///
/// The offset is what no parameter describes: inverse dynamics of the same plant with all linear parameters zero.
fn regressor_gap(model: &Model, setup: &Setup) -> (f64, [f64; 2]) {
    let plant = Plant::new(model, setup);
    let mut bare = model.clone();
    bare.effects.clear();
    set_parameters(&mut bare, &vec![0.0; plant.rigid_bodies().values.len()]);
    let mut bare = Plant::new(&bare, setup);
    bare.geometry = plant.geometry;
    let rigid = plant.rigid_bodies();
    let effects: Vec<&ActiveEffect> = std::iter::once(&rigid).chain(&plant.effects).collect();
    let mut theta = Vec::new();
    for active in &effects {
        let linear = |role| role == Role::Linear;
        let acts = matches!(active.effect.kind(), Kind::Force | Kind::Inertia);
        for (value, entry) in active.values.iter().zip(active.entries()) {
            theta.push(if acts && linear(entry.parameter.role) { *value } else { 0.0 });
        }
    }
    let theta = nalgebra::DVector::from_vec(theta);
    let mut states = vec![Vec::new()];
    states.extend(initial_states(&plant));
    let channels = all_channels();
    let mut rng = rng(2);
    let (mut gap, mut scale) = (vec![0f64; 16], vec![0f64; 16]);
    let mut offsets = [0f64; 2];
    for _ in 0..50 {
        let motion = plant.motion(&random_joints(&plant, &mut rng)).unwrap();
        let out = inverse(&plant, &motion);
        let offset = values_of(&inverse(&bare, &motion));
        let rows =
            regressor(&plant, &effects, &Sample { t: 0.0, motion: &motion, loads: &out }, &slices(&states), &channels)
                .unwrap();
        let product = rows * &theta;
        for (c, want) in values_of(&out).into_iter().enumerate() {
            gap[c] = gap[c].max((offset[c] + product[c] - want).abs());
            scale[c] = scale[c].max(want.abs());
            offsets[usize::from(c >= 4)] = offsets[usize::from(c >= 4)].max(offset[c].abs());
        }
    }
    (gap.iter().zip(&scale).map(|(g, s)| g / s).fold(0.0, f64::max), offsets)
}

/// Rounding of a sum of some hundred terms, times the condition of the strut map (about 1e3), is below 1e-12; the
/// iteration over load-dependent friction stops at 1e-11 N of some 100 N.
const REGRESSOR_TOLERANCE: f64 = 1e-10;

#[test]
fn regressor_times_parameters_is_inverse_dynamics() {
    for name in [NOMINAL, TRUTH] {
        let (gap, [torque, strut]) = regressor_gap(&model(name), &Setup::default());
        println!("{name}: {gap:.1e}; not described by parameters: {torque:.1e} N·m, {strut:.2} N");
        assert!(gap < REGRESSOR_TOLERANCE, "{name}: {gap:e}");
        // The torques are described by the parameters alone. The platform's first moment is no parameter, because it
        // never enters the torques, but it loads the struts: it is all that is missing there.
        assert!(torque < 1e-10, "{name}: {torque:e} N·m");
        let mut centred = model(name);
        centred.bodies[PLATFORM].first_moment = Vector3::zeros();
        let (gap, [_, strut]) = regressor_gap(&centred, &Setup::default());
        assert!(gap < REGRESSOR_TOLERANCE && strut < 1e-10, "{name}: {gap:e}, {strut:e} N");
    }
}

#[test]
fn regressor_times_parameters_is_inverse_dynamics_with_every_effect() {
    let mut rng = rng(3);
    for round in 0..5 {
        let (gap, _) = regressor_gap(&model_with_everything(&mut rng), &payload());
        println!("round {round}: {gap:.1e}");
        assert!(gap < REGRESSOR_TOLERANCE, "round {round}: {gap:e}");
    }
}

#[test]
fn friction_only_removes_energy() {
    let mut rigid = model(NOMINAL);
    rigid.effects.clear();
    let plant = Plant::new(&rigid, &payload());
    let frictions: Vec<_> = REGISTRY
        .iter()
        .filter(|e| {
            [
                "friction",
                "ball_socket_viscous",
                "ball_socket_coulomb",
                "ball_socket_load",
                "stribeck",
                "viscous_curve",
                "efficiency",
                "drag",
            ]
            .iter()
            .any(|part| e.name().contains(part))
        })
        .collect();
    assert!(frictions.len() >= 15, "{}", frictions.len());
    for effect in frictions {
        let mut rng = rng(4);
        let mut total = 0.0;
        for _ in 0..200 {
            let active = at_random(Arc::clone(effect), &mut rng, true);
            let mut joints = random_joints(&plant, &mut rng);
            let slowness = 10f64.powf(rng.random_range(-3.0..0.0)); // also within the smooth signs' transition
            joints.qd = joints.qd.map(|x| x * slowness);
            let mut motion = plant.motion(&joints).unwrap();
            for s in 0..6 {
                motion.bodies[bodies::strut(s)].angular_velocity += motion.strut_axis[s] * rng.random_range(-2.0..2.0);
            }
            let mut force = || std::array::from_fn(|_| rng.random_range(-150.0..150.0));
            let reactions = Reactions { upper: force(), lower: force() };
            let tau = std::array::from_fn(|_| rng.random_range(-100.0..100.0));
            let (sum, size) = power(&plant, &active, &motion, &Output { tau, reactions });
            assert!(sum <= 4.0 * f64::EPSILON * size, "{} gives {sum:e} W", effect.name()); // rounding of its parts
            total += sum;
        }
        assert!(total < 0.0, "{} does nothing", effect.name());
    }
}

/// Arms and rotor of the nominal robot alone, at given joint motion.
fn arms_alone(plant: &Plant, joints: JointState) -> Motion {
    Motion::disassembled(&plant.geometry, &joints)
}

#[test]
fn stated_slopes_are_derivatives_of_the_state_rates() {
    let plant = nominal_plant();
    let mut rng = rng(9);
    let mut steep = 0;
    for effect in REGISTRY.iter() {
        let active = at_random(Arc::clone(effect), &mut rng, true);
        let n = active.states();
        for _ in 0..20 {
            let motion = arms_alone(&plant, random_joints(&plant, &mut rng));
            let state: Vec<f64> = (0..n).map(|_| rng.random_range(-1.0..1.0)).collect();
            let rate = |state: &[f64]| {
                let (mut rate, mut slope) = (vec![0.0; n], vec![0.0; n]);
                let reactions = Reactions::default();
                let at = instant(&plant, &motion, &reactions, [10.0; 4], state);
                active.state_rate(&at, &mut rate, &mut slope);
                (rate, slope)
            };
            let (before, slope) = rate(&state);
            // A slope that is not steep may be left at zero.
            for i in (0..n).filter(|&i| slope[i] != 0.0) {
                let mut moved = state.clone();
                moved[i] += 0.5;
                let want = (rate(&moved).0[i] - before[i]) / 0.5;
                // The laws are linear in their states; rounding of rates up to 1e5/s.
                assert!((slope[i] - want).abs() < 1e-9 * want.abs().max(1.0), "{}: {} {want}", effect.name(), slope[i]);
                assert!(slope[i] < 0.0, "{} does not run away", effect.name());
                steep += 1;
            }
        }
    }
    assert!(steep >= 50, "{steep}");
}

#[test]
fn hysteresis_returns_no_more_than_its_springs_hold() {
    let plant = nominal_plant();
    let mut rng = rng(10);
    const ANGLE: f64 = 2e-3;
    let moment = [1.0, 1.5, 2.0];
    let active = ActiveEffect::new(find("backlash_hysteresis").unwrap(), &[&moment, &[ANGLE]]);
    let mut state = active.initial_state();
    let waves: [[f64; 3]; 3] = std::array::from_fn(|_| std::array::from_fn(|_| rng.random_range(0.2..2.0)));
    let (mut taken, mut least) = ([0.0; 3], f64::INFINITY);
    let h = 2e-5;
    let reactions = Reactions::default();
    for step in 0..50_000 {
        let t = f64::from(step) * h;
        let qd = std::array::from_fn(|i| {
            let w = waves[i % 3];
            w[0] * (31.0 * w[1] * t).sin() + 0.1 * (300.0 * w[2] * t).cos()
        });
        let motion = arms_alone(&plant, JointState { qd, ..JointState::default() });
        let (mut rate, mut slope) = (vec![0.0; 3], vec![0.0; 3]);
        let before = state.clone();
        active.state_rate(&instant(&plant, &motion, &reactions, [0.0; 4], &state), &mut rate, &mut slope);
        for i in 0..3 {
            state[i] += h * (1.0 + 0.5 * h * slope[i]) * rate[i];
            assert!(state[i].abs() <= 1.0 + 1e-9, "{}", state[i]);
        }
        let middle: Vec<f64> = state.iter().zip(&before).map(|(a, b)| 0.5 * (a + b)).collect();
        let torque = drive_torques(&plant, &active, &motion, [0.0; 4], &middle);
        for i in 0..3 {
            taken[i] -= torque[i] * qd[i] * h;
            least = least.min(taken[i] - 0.5 * moment[i] * ANGLE * state[i] * state[i]);
        }
    }
    println!("taken {taken:?} J, least beyond the springs {least:.1e} J");
    assert!(least > -1e-9, "{least:e}"); // truncation of the steps
    assert!(taken.iter().all(|x| *x > 0.05), "{taken:?}");
}

#[test]
fn elastic_drives_keep_account_of_their_energy() {
    // The drive pays for rotor, spring, damper and what reaches the arm, whatever the arm does.
    let plant = nominal_plant();
    let (c, d, rotor) = (4e-5, 20.0, 0.18);
    let active = ActiveEffect::new(find("drive_elasticity").unwrap(), &[&[c; 3], &[d], &[rotor], &[0.0]]);
    let arm = |t: f64| {
        let (s, k) = (40.0 * t).sin_cos();
        JointState { q: [0.1 * s; 4], qd: [4.0 * k; 4], qdd: [-160.0 * s; 4] }
    };
    let torque = |t: f64| 30.0 * (90.0 * t).sin() + 20.0;
    let reactions = Reactions::default();
    let rate = |t: f64, x: &[f64]| {
        let (mut rate, mut slope) = (vec![0.0; x.len()], vec![0.0; x.len()]);
        let motion = arms_alone(&plant, arm(t));
        let at = instant(&plant, &motion, &reactions, [torque(t); 4], x);
        active.state_rate(&at, &mut rate, &mut slope);
        rate
    };
    let moved = |x: &[f64], r: &[f64], h: f64| -> Vec<f64> { x.iter().zip(r).map(|(x, r)| x + h * r).collect() };
    let stored = |t: f64, x: &[f64]| 0.5 * rotor * (arm(t).qd[0] + x[rate_place(0)]).powi(2) + 0.5 * x[0] * x[0] / c;
    // Power of the drive less that of the damper and that given to the arm, with the effect's own torque on the arm.
    let power = |t: f64, x: &[f64]| {
        let joints = arm(t);
        let given = torque(t) + drive_torques(&plant, &active, &arms_alone(&plant, joints), [torque(t); 4], x)[0];
        torque(t) * (joints.qd[0] + x[rate_place(0)]) - d * x[rate_place(0)] * x[rate_place(0)] - given * joints.qd[0]
    };
    let mut x = active.initial_state();
    let h = 1e-5;
    let (start, mut work, mut paid) = (stored(0.0, &x), 0.0, 0.0);
    for step in 0..30_000 {
        let t = f64::from(step) * h;
        let a = rate(t, &x);
        let b = rate(t + 0.5 * h, &moved(&x, &a, 0.5 * h));
        let middle = moved(&x, &b, 0.5 * h);
        let c = rate(t + 0.5 * h, &middle);
        let e = rate(t + h, &moved(&x, &c, h));
        let next: Vec<f64> = (0..x.len()).map(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + e[i])).collect();
        let parts = [power(t, &x), power(t + 0.5 * h, &middle), power(t + h, &next)];
        work += h / 6.0 * (parts[0] + 4.0 * parts[1] + parts[2]);
        paid += h * (torque(t) * (arm(t).qd[0] + x[rate_place(0)])).abs();
        x = next;
    }
    let gap = stored(0.3, &x) - start - work;
    println!("energy gap {gap:.1e} J of {paid:.1} J");
    assert!(gap.abs() < 1e-6, "{gap:e}");
}

#[test]
fn elastic_drives_at_rest_in_themselves_are_rigid() {
    let rigid = nominal_plant();
    let mut elastic = model(NOMINAL);
    elastic.effects =
        vec![ActiveEffect::new(find("drive_elasticity").unwrap(), &[&[4e-5, 1e-4, 0.0], &[20.0], &[0.18], &[0.0]])]
            .into();
    let elastic = Plant::new(&elastic, &Setup::default());
    assert!((elastic.bodies[0].tensor[(1, 1)] - 0.078).abs() < 1e-12, "the rotor left the arm");
    let mut rng = rng(11);
    for _ in 0..50 {
        let motion = rigid.motion(&random_joints(&rigid, &mut rng)).unwrap();
        for (a, b) in inverse(&elastic, &motion).tau.iter().zip(inverse(&rigid, &motion).tau) {
            assert!((a - b).abs() < 1e-11, "{a} {b}"); // rounding of 1/c and back
        }
    }
}

#[test]
fn gear_friction_is_solved_with_the_torque_it_depends_on() {
    // τ = τ₀ + μ·|τ|·s with s = tanh(k·q̇): τ₀/(1 − μ·s) for positive, τ₀/(1 + μ·s) for negative torque.
    let free = nominal_plant();
    let rubbing = common::with_effect(nominal_plant(), "gear_load_friction", &[&[0.02, 0.05, 0.1], &[100.0], &[0.0]]);
    let mut rng = rng(12);
    for _ in 0..50 {
        let motion = free.motion(&random_joints(&free, &mut rng)).unwrap();
        let (before, after) = (inverse(&free, &motion).tau, inverse(&rubbing, &motion).tau);
        for (i, friction) in [0.02, 0.05, 0.1].into_iter().enumerate() {
            let share = friction * (100.0 * motion.qd[i]).tanh() * before[i].signum();
            assert!((after[i] - before[i] / (1.0 - share)).abs() < 1e-10, "{} {}", after[i], before[i]);
        }
        assert_eq!(before[3], after[3]);
    }
}

#[test]
fn renaming_the_limbs_in_turn_permutes_torques_and_strut_forces() {
    // Turning robot and end effector by 120° about the vertical moves limb i to limb i + 1; gravity does not notice.
    let plant = nominal_plant();
    let mut rng = rng(5);
    let next = |x: [f64; 4]| [x[2], x[0], x[1], x[3]];
    let next_struts = |x: PerStrut<f64>| [x[4], x[5], x[0], x[1], x[2], x[3], x[6], x[7]];
    let mut worst = 0f64;
    for _ in 0..100 {
        let joints = random_joints(&plant, &mut rng);
        let mut turned = JointState { q: next(joints.q), qd: next(joints.qd), qdd: next(joints.qdd) };
        turned.q[3] += std::f64::consts::TAU / 3.0;
        let before = inverse(&plant, &plant.motion(&joints).unwrap());
        let after = inverse(&plant, &plant.motion(&turned).unwrap());
        let moved = Output {
            tau: next(before.tau),
            reactions: Reactions {
                upper: next_struts(before.reactions.upper),
                lower: next_struts(before.reactions.lower),
            },
        };
        for (a, b) in values_of(&after).iter().zip(values_of(&moved)) {
            worst = worst.max((a - b).abs());
        }
    }
    println!("120° symmetry: {worst:.1e} N·m or N");
    assert!(worst < 1e-10, "{worst:e}"); // rounding of 100 N times the condition of the strut map, about 1e3
}

// Kinematics.

/// A smooth joint motion through the middle of the workspace, with exact derivatives.
fn along(t: f64) -> JointState {
    // amplitude, angular frequency, phase
    const WAVES: [[f64; 3]; 4] = [[0.30, 5.0, 0.3], [0.35, 4.0, 1.7], [0.25, 6.0, 4.1], [1.2, 3.0, 2.2]];
    const CENTRE: [f64; 4] = [0.35, 0.30, 0.40, 0.5];
    let mut joints = JointState::default();
    for (i, [a, w, p]) in WAVES.into_iter().enumerate() {
        let (s, c) = (w * t + p).sin_cos();
        (joints.q[i], joints.qd[i], joints.qdd[i]) = (CENTRE[i] + a * s, a * w * c, -a * w * w * s);
    }
    joints
}

/// Step of the differences below, s.
const H: f64 = 5e-4;

/// Derivative by differences over seven points: truncation h⁶/140·f⁽⁷⁾, rounding about 2ε|f|/h.
fn derivative<T>(f: impl Fn(f64) -> T, t: f64) -> T
where
    T: std::ops::Sub<Output = T> + std::ops::Add<Output = T> + std::ops::Mul<f64, Output = T>,
{
    let d = |k: f64| f(t + k * H) - f(t - k * H);
    (d(1.0) * 45.0 + d(2.0) * -9.0 + d(3.0)) * (1.0 / (60.0 * H))
}

/// Lengths, rates and accelerations reach 10, 30 and 300 in SI units and repeat with ω up to 20 rad/s (third harmonics
/// and more of the joint motion), so f⁽⁷⁾ ≤ 300·20⁷ and truncation is below h⁶·3e9 = 5e-11; rounding of accelerations
/// is 2ε·300/h = 3e-10.
const DIFFERENCES: f64 = 1e-9;

fn times() -> impl Iterator<Item = f64> {
    (0..100).map(|k| 0.013 * f64::from(k))
}

#[test]
fn forward_inverts_inverse() {
    let plant = nominal_plant();
    let g = &plant.geometry;
    let mut rng = rng(6);
    let (mut worst, mut worst_rate, mut worst_acceleration) = (0f64, 0f64, 0f64);
    for _ in 0..1000 {
        let joints = random_joints(&plant, &mut rng);
        let platform = g.forward_motion(&joints).unwrap();
        let back = g.inverse_motion(&platform).unwrap();
        let there = g.forward_motion(&back).unwrap();
        for i in 0..4 {
            worst = worst.max((back.q[i] - joints.q[i]).abs());
            worst_rate = worst_rate.max((back.qd[i] - joints.qd[i]).abs());
            worst_acceleration = worst_acceleration.max((back.qdd[i] - joints.qdd[i]).abs());
        }
        worst = worst.max((there.position - platform.position).norm());
        for limb in 0..3 {
            let length = (platform.position + g.limbs[limb].point - g.elbow(limb, joints.q[limb])).norm();
            assert!((length - g.limbs[limb].strut_length).abs() < 1e-14, "strut of limb {limb}"); // rounding of 1 m
        }
    }
    println!("round trip: {worst:.1e} rad, {worst_rate:.1e} rad/s, {worst_acceleration:.1e} rad/s²");
    // Rounding of 1, 12 and 300 times the condition of the Jacobian, below 100 within the limits.
    assert!(worst < 1e-13 && worst_rate < 1e-12 && worst_acceleration < 1e-10);
}

#[test]
fn platform_rates_are_derivatives_of_its_position() {
    let g = nominal_plant().geometry;
    let at = |t: f64| -> PlatformState { g.forward_motion(&along(t)).unwrap() };
    let mut worst = 0f64;
    for t in times() {
        let velocity = (derivative(|t| at(t).position, t) - at(t).velocity).norm();
        let acceleration = (derivative(|t| at(t).velocity, t) - at(t).acceleration).norm();
        worst = worst.max(velocity).max(acceleration);
    }
    println!("platform: {worst:.1e}");
    assert!(worst < DIFFERENCES, "{worst:e}");
}

#[test]
fn twists_and_accelerations_of_all_bodies_are_derivatives_of_their_poses() {
    [false, true].into_iter().for_each(derivatives_of_poses);
}

/// Of the platform that only translates, and of one tilted by struts of unequal length.
fn derivatives_of_poses(unequal: bool) {
    let mut g = nominal_plant().geometry;
    if unequal {
        let active = common::defaults("strut_pair_error");
        active.effect.geometry(&active.values(), &mut g);
        g.limbs[1].strut_difference *= -3.0;
    }
    let at = |t: f64, b: usize| Motion::assembled(&g, &along(t)).unwrap().bodies[b];
    let mut worst = [0f64; BODIES];
    for t in times() {
        for b in 0..BODIES {
            let now = at(t, b);
            let turning: Matrix3<f64> = now.angular_velocity.cross_matrix() * now.rotation;
            let mut rotation = derivative(|t| at(t, b).rotation, t) - turning;
            if (STRUT..PLATFORM).contains(&b) {
                // A strut's roll is not defined by the joints: its twist has none, its frame keeps y near the pair.
                rotation =
                    Matrix3::from_columns(&[rotation.column(0).into_owned(), Vector3::zeros(), Vector3::zeros()]);
                let roll = now.angular_velocity.dot(&now.rotation.column(0));
                assert!(roll.abs() < 1e-14, "{}: {roll:e}", body_name(b));
            }
            for gap in [
                rotation.norm(),
                (derivative(|t| at(t, b).position, t) - now.velocity).norm(),
                (derivative(|t| at(t, b).velocity, t) - now.acceleration).norm(),
                (derivative(|t| at(t, b).angular_velocity, t) - now.angular_acceleration).norm(),
            ] {
                worst[b] = worst[b].max(gap);
            }
        }
    }
    for b in 0..BODIES {
        println!("{}: {:.1e}", body_name(b), worst[b]);
        assert!(worst[b] < DIFFERENCES, "{}: {:e}", body_name(b), worst[b]);
    }
}

/// Angles of a Hooke joint: about x of the yoke, then about y of the bar.
fn hooke_angles(motion: &Motion, yoke: usize) -> [f64; 2] {
    let m = motion.bodies[yoke].rotation.tr_mul(&motion.bodies[TELESCOPE_UPPER].rotation);
    let first = m[(2, 1)].atan2(m[(1, 1)]);
    let second = m[(0, 2)].atan2(m[(0, 0)]);
    [first, second]
}

#[test]
fn passive_joint_rates_are_derivatives_of_passive_joint_angles() {
    let g = nominal_plant().geometry;
    let at = |t: f64| Motion::assembled(&g, &along(t)).unwrap();
    let mut worst = 0f64;
    for t in times() {
        let now = at(t);
        worst = worst.max((derivative(|t| at(t).telescope.length, t) - now.telescope.rate).abs());
        for (joint, yoke) in [ROTOR, END_EFFECTOR].into_iter().enumerate() {
            // The cross holds: the yoke's x is normal to the bar's y.
            let cross = now.bodies[yoke].rotation.column(0).dot(&now.bodies[TELESCOPE_UPPER].rotation.column(1));
            assert!(cross.abs() < 1e-14, "{cross:e}");
            for i in 0..2 {
                let rate = derivative(|t| hooke_angles(&at(t), yoke)[i], t);
                worst = worst.max((rate - now.hooke_rates()[joint][i]).abs());
            }
        }
        for socket in 0..12 {
            // Seen from the ball's body, the strut's axis turns with the socket rate; the struts' own roll is zero.
            let (strut, ball) = now.socket_bodies(socket);
            let seen = |m: &Motion| m.bodies[ball].rotation.tr_mul(&m.strut_axis[strut - STRUT]);
            let turning = now.bodies[ball].rotation * derivative(|t| seen(&at(t)), t);
            let axis = now.strut_axis[strut - STRUT];
            worst = worst.max((now.socket_rate(socket).cross(&axis) - turning).norm());
            let roll = (now.socket_rate(socket) + now.bodies[ball].angular_velocity).dot(&axis);
            assert!(roll.abs() < 1e-14, "{roll:e}");
        }
        assert_eq!(now.bodies[TELESCOPE_LOWER].angular_velocity, now.bodies[TELESCOPE_UPPER].angular_velocity);
    }
    println!("passive joints: {worst:.1e}");
    assert!(worst < DIFFERENCES, "{worst:e}");
}

#[test]
fn poses_beyond_the_limits_name_the_limit() {
    let g = nominal_plant().geometry;
    let home = g.forward(&[0.3; 3]).unwrap();
    let [min, max] = g.arm_limits();
    for arm in 0..3 {
        for angle in [min - 1e-9, max + 1e-9, f64::NAN] {
            let mut q = [0.3; 3];
            q[arm] = angle;
            let refused =
                matches!(g.check_limits(&q, &home), Err(KinematicsError::ArmLimit { arm: a, .. }) if a == arm);
            assert!(refused, "arm {arm} at {angle}");
        }
        for angle in [min, max] {
            let mut q = [0.3; 3];
            q[arm] = angle;
            assert_eq!(g.check_limits(&q, &home), Ok(()));
        }
    }
    let [shortest, longest] = g.telescope_limits;
    let below = |length: f64| Vector3::z() * (g.upper_hooke_height - g.lower_hooke_height - length);
    for length in [shortest - 1e-9, longest + 1e-9] {
        let found = g.check_limits(&[0.3; 3], &below(length));
        assert!(matches!(found, Err(KinematicsError::TelescopeLimit { .. })), "{length}: {found:?}");
    }
    assert_eq!(g.check_limits(&[0.3; 3], &below(0.5 * (shortest + longest))), Ok(()));
    // 0.2 m + 0.5 m + 1.106 m is as far as a limb goes.
    let far = g.inverse(&Vector3::new(-1.8, 0.0, -0.5), 0.0);
    assert!(matches!(far, Err(KinematicsError::OutOfReach { limb: 0, .. })), "{far:?}");
    let mut stubby = g;
    stubby.limbs.iter_mut().for_each(|limb| limb.strut_length = 0.3);
    let open = stubby.forward(&[0.0; 3]);
    assert!(matches!(open, Err(KinematicsError::NoClosure { .. })), "{open:?}");
}

// Energy.

/// Largest |Στ·q̇ − dE/dt + power of the effects| along the smooth motion, W, and the largest power of the drives.
fn energy_gap(model: &Model, setup: &Setup) -> (f64, f64) {
    let plant = Plant::new(model, setup);
    let (mut worst, mut largest) = (0f64, 0f64);
    for t in times() {
        let motion = plant.motion(&along(t)).unwrap();
        let out = inverse(&plant, &motion);
        let drives: f64 = out.tau.iter().zip(&motion.qd).map(|(tau, rate)| tau * rate).sum();
        let effects: f64 = plant.effects.iter().map(|a| power(&plant, a, &motion, &out).0).sum();
        let stored = derivative(|t| energy::total(&plant, &plant.motion(&along(t)).unwrap()), t);
        worst = worst.max((drives - stored + effects).abs());
        largest = largest.max(drives.abs());
    }
    (worst, largest)
}

#[test]
fn drives_pay_for_stored_energy_and_friction() {
    let mut rng = rng(7);
    let mut rigid = model(NOMINAL);
    rigid.effects.clear();
    let everything = model_with_everything(&mut rng);
    for (what, model) in
        [("rigid", rigid), (NOMINAL, model(NOMINAL)), (TRUTH, model(TRUTH)), ("everything", everything)]
    {
        for setup in [Setup::default(), payload()] {
            let (gap, size) = energy_gap(&model, &setup);
            println!("{what}: {gap:.1e} W of {size:.0} W");
            // The energy, up to 100 J, is differenced: see `DIFFERENCES`.
            assert!(gap < DIFFERENCES, "{what}: {gap:e} W");
        }
    }
}

// Ball sockets, from positions alone.

/// ∂ω_rel/∂φ̇ⱼ at every socket and for every arm, by differences of strut directions over the arm angles.
fn socket_rate_jacobian(g: &Geometry, q: [f64; 4]) -> [[Vector3<f64>; 3]; 12] {
    let axis = |q: &[f64; 4], limb: usize| {
        let (length, own) = (g.limbs[limb].arm_length, &g.limbs[limb]);
        let radial = Vector3::new(own.azimuth().cos(), own.azimuth().sin(), 0.0);
        let elbow = radial * (own.base_radius + length * q[limb].cos()) - Vector3::z() * length * q[limb].sin();
        (g.forward(q).unwrap() + radial * g.platform_radius() - elbow).normalize()
    };
    std::array::from_fn(|socket| {
        let limb = socket % 6 / 2;
        std::array::from_fn(|j| {
            let moved = |dq: f64| {
                let mut q = q;
                q[j] += dq;
                axis(&q, limb)
            };
            // A strut that does not roll turns with u × u̇.
            let strut = moved(0.0).cross(&derivative(moved, 0.0));
            let turns_with_arm = socket < 6 && j == limb;
            let azimuth = g.limbs[limb].azimuth();
            let arm = Vector3::new(-azimuth.sin(), azimuth.cos(), 0.0);
            if turns_with_arm { strut - arm } else { strut }
        })
    })
}

#[test]
fn socket_friction_reaches_each_drive_by_virtual_work() {
    let rigid = nominal_plant();
    let viscous = common::with_effect(nominal_plant(), "ball_socket_viscous", &[&[0.30]]);
    let coulomb = common::with_effect(nominal_plant(), "ball_socket_coulomb", &[&[0.25], &[0.05]]);
    let loaded = common::with_effect(nominal_plant(), "ball_socket_load_dependent", &[&[0.15], &[0.0095], &[0.05]]);
    let mut rng = rng(8);
    let mut worst = [0f64; 3];
    for _ in 0..100 {
        let joints = random_joints(&rigid, &mut rng);
        let motion = rigid.motion(&joints).unwrap();
        let base = inverse(&rigid, &motion);
        let jacobian = socket_rate_jacobian(&rigid.geometry, joints.q);
        let rates = jacobian.map(|columns| (0..3).map(|j| columns[j] * joints.qd[j]).sum::<Vector3<f64>>());
        let saturated = |w: &Vector3<f64>| (w.norm() / 0.05).tanh() / w.norm();
        for (case, plant) in [&viscous, &coulomb, &loaded].into_iter().enumerate() {
            let out = inverse(plant, &motion);
            let forces = [&out.reactions.upper[..6], &out.reactions.lower[..6]].concat();
            let coefficient = |socket: usize| match case {
                0 => 0.30,
                1 => 0.25 * saturated(&rates[socket]),
                _ => 0.15 * 0.0095 * forces[socket].abs() * saturated(&rates[socket]),
            };
            let mut dissipated = 0.0;
            for socket in 0..12 {
                dissipated += coefficient(socket) * rates[socket].norm_squared();
            }
            let mut drives = 0.0;
            for j in 0..3 {
                let friction = out.tau[j] - base.tau[j];
                let want: f64 = (0..12).map(|s| coefficient(s) * rates[s].dot(&jacobian[s][j])).sum();
                worst[case] = worst[case].max((friction - want).abs());
                drives += friction * joints.qd[j];
            }
            worst[case] = worst[case].max((drives - dissipated).abs());
            assert!((out.tau[3] - base.tau[3]).abs() < 1e-12, "sockets do not load axis 4"); // rounding
        }
    }
    println!("socket friction: {worst:?} N·m or W");
    // Rounding of the differences, 2ε/h = 1e-12 per rate, times rates up to 10 rad/s, slopes 0.25/0.05 and 12 sockets.
    assert!(worst.iter().all(|w| *w < DIFFERENCES), "{worst:?}");
}

//! Known loads: what hangs from a single axis or pulls at it, and forces on a robot's flange.

use std::f64::consts::TAU;

use crate::common::{model, random_joints};
use crate::machines::{run, turntable};
use deltatwin::diagnosis::{Diagnosis, Verdict, diagnose};
use deltatwin::dynamics::{Plant, inverse_dynamics};
use deltatwin::gate::examine;
use deltatwin::identification::initial::axis;
use deltatwin::identification::{Dataset, Residuals};
use deltatwin::machine::{FREE_FALL, Joint, Load, Setup};
use deltatwin::recording::{Channel, Recording, Signals};
use nalgebra::Vector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

/// Load at the output of a winch: a mass on a rope that sways, N·m.
type Law = fn(f64) -> f64;

/// What a winch measures in 20 s at 200 Hz, by hand: τ = s·(J·q̈ + c·sign q̇ + v·q̇ + μ·|L|·sign q̇ + L), with noise of
/// 0.02 N·m in torque and load.
fn winch(seed: u64, scale: f64, proportional: f64, load: Law) -> Recording {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noise = || -> f64 { StandardNormal.sample(&mut rng) };
    let mut signals = Signals::default();
    let (mut rows, mut loads) = (Vec::new(), Vec::new());
    for k in 0..4000 {
        let t = f64::from(k) * 5e-3;
        let waves = [(3.0, 0.11), (1.0, 0.37), (0.3, 0.83 + 0.01 * seed as f64)];
        let sum = |f: &dyn Fn(f64, f64) -> f64| waves.iter().map(|(a, hz)| f(*a, TAU * hz)).sum::<f64>();
        let q = sum(&|a, w| a * (w * t).sin());
        let qd = sum(&|a, w| a * w * (w * t).cos());
        let qdd = sum(&|a, w| -a * w * w * (w * t).sin());
        let carried = load(t + 3.0 * seed as f64);
        let sign = (60.0 * qd).tanh();
        let torque = 0.03 * qdd + 0.25 * sign + 0.08 * qd + proportional * carried.abs() * sign + carried;
        rows.push([t, (q * 1e5).round() / 1e5, scale * torque + 0.02 * noise()]);
        loads.push(carried + 0.02 * noise());
    }
    signals.extend(Signals::of_axis(Joint::Revolute, &rows));
    signals.set(Channel::Load(0), loads);
    Recording { name: format!("winch {seed}"), signals, ..Recording::default() }
}

fn names(d: &Diagnosis) -> Vec<&str> {
    d.effects.iter().map(|e| e.name.as_str()).collect()
}

fn swaying(t: f64) -> f64 {
    4.0 + 1.5 * (TAU * 0.07 * t).sin() + 0.6 * (TAU * 0.31 * t).cos()
}

#[test]
fn a_hanging_mass_is_carried_by_twin_and_prediction() {
    let table = turntable();
    let load = Load { mass: 5.0, radius: Some(0.04), ..Load::default() };
    let carrying = Setup { load, ..Setup::default() };
    let (recording, report) = run(&table, &table, &carrying, 4.0, 5, true);
    assert!(report.energy_error < 1e-6, "{:e}", report.energy_error);
    let ratio = |setup: Setup| {
        let dataset = Dataset::new(&Recording { setup, ..recording.clone() });
        let left = Residuals::new(&table, std::slice::from_ref(&dataset)).unwrap().rms[0];
        left / dataset.noise(&table)[0]
    };
    // Without the load, its weight of 5·9.80665·0.04 = 1.96 N·m is left.
    let [with, without] = [carrying, Setup::default()].map(ratio);
    let weight = 5.0 * FREE_FALL * 0.04;
    assert!(with < 1.1 && (without * table.noise.torque[0] - weight).abs() < 0.1 * weight, "{with} {without}");
}

#[test]
fn friction_is_found_beside_a_measured_load() {
    let runs = [1, 2].map(|seed| winch(seed, 1.0, 0.0, swaying));
    let first = axis("winch", &runs, None).expect("a model");
    let of = |table: &str, key: &str| {
        let number = first.numbers.iter().find(|n| n.table == table && n.key == key).expect("a number");
        (number.values[0], number.std[0])
    };
    for (table, key, truth) in [
        ("bodies.axis", "inertia", 0.03),
        ("effects.drive_friction", "coulomb", 0.25),
        ("effects.drive_friction", "viscous", 0.08),
    ] {
        let (value, std) = of(table, key);
        assert!((value - truth).abs() < 4.0 * std + 0.01 * truth, "{key}: {value} ± {std}");
    }
    assert!(first.model.effects.iter().all(|e| e.effect.name() != "torque_gain_error"), "{:?}", first.remarks);
    let data = runs.each_ref().map(Dataset::new);
    assert!(data.iter().all(|dataset| examine(&first.model, dataset).iter().all(|f| !f.severe)));
    let d = diagnose(&first.model, &data[..1], &data[1..], &mut |_| {}).unwrap();
    assert_eq!(d.verdict, Verdict::None, "{:?} {:?} {:?}", names(&d), d.rms_after, d.noise_floor);
    // Noise of torque and load together.
    assert!((d.noise_floor[0] / 0.02f64.hypot(0.02) - 1.0).abs() < 0.05, "{:?}", d.noise_floor);
}

/// The load that was measured, and not the torque of the model, says what friction follows it.
#[test]
#[ignore = "campaign"]
fn friction_in_proportion_to_a_measured_load_is_named() {
    let healthy = [1, 2].map(|seed| winch(seed, 1.0, 0.0, swaying));
    let first = axis("winch", &healthy, None).expect("a model").model;
    let worn = [3, 4].map(|seed| Dataset::new(&winch(seed, 1.0, 0.06, swaying)));
    let d = diagnose(&first, &worn[..1], &worn[1..], &mut |_| {}).unwrap();
    let names = names(&d);
    let set = |name: &str| d.indistinguishable.iter().any(|s| s.iter().any(|n| n == name));
    assert!(names == ["gear_load_friction"] || set("gear_load_friction"), "{names:?} {:?}", d.indistinguishable);
    if let [effect] = &d.effects[..]
        && effect.name == "gear_load_friction"
    {
        let share = &effect.parameters[0];
        assert!((share.value - 0.06).abs() < 4.0 * share.std.max(1e-3), "{} ± {}", share.value, share.std);
    }
}

/// A torque in a unit of its own, such as per mille of a rated torque, is seen against the load.
#[test]
fn the_scale_of_the_torque_follows_from_the_load() {
    let initial = axis("winch", &[winch(1, 1.7, 0.0, swaying), winch(2, 1.7, 0.0, swaying)], None).expect("a model");
    let gain = initial.model.effects.iter().find(|e| e.effect.name() == "torque_gain_error").expect("a gain");
    assert!((gain.values[0] - 0.7).abs() < 0.01, "{:?}", gain.values);
    let number = |key: &str| initial.numbers.iter().find(|n| n.key == key).expect("a number").values[0];
    assert!((number("coulomb") - 0.25).abs() < 0.01 && (number("inertia") - 0.03).abs() < 0.003);
    assert!(initial.remarks.iter().any(|r| r.contains("--map \"tau1=tau1/1.")), "{:?}", initial.remarks);
    let far = axis("winch", &[winch(1, 250.0, 0.0, swaying)], None).err().expect("another unit").to_string();
    assert!(far.contains("times the load") && far.contains("--map \"tau1=tau1*0.004"), "{far}");
}

/// Virtual work: a force F on the flange changes the torques of the arms by −∂r/∂q·F, with the Jacobian of the closed-form
/// forward kinematics by central differences.
#[test]
fn a_force_on_the_flange_is_borne_by_the_arms() {
    let robot = model("irb360-6-1600");
    let plant = Plant::new(&robot, &Setup::default());
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let force = Vector3::new(12.0, -7.0, 30.0);
    let mut signals = Signals::new(robot.mechanism, vec![0.0, 1.0]);
    for k in 0..3 {
        signals.set(Channel::FlangeForce(k), vec![force[k]; 2]);
    }
    let pushed = Plant::along(&robot, &Recording { signals, ..Recording::default() });
    for _ in 0..20 {
        let joints = random_joints(&plant, &mut rng);
        let motion = plant.motion(&joints).unwrap();
        let torque = |plant: &Plant| {
            let states = plant.steady_states(0.5, &motion);
            let states: Vec<&[f64]> = states.iter().map(Vec::as_slice).collect();
            inverse_dynamics(plant, 0.5, &motion, &states, false).unwrap().tau
        };
        let (free, loaded) = (torque(&plant), torque(&pushed));
        for i in 0..3 {
            let at = |step: f64| {
                let mut q = joints.q;
                q[i] += step;
                plant.geometry.forward(&q).unwrap()
            };
            let expected = -(at(1e-6) - at(-1e-6)).dot(&force) / 2e-6;
            assert!((loaded[i] - free[i] - expected).abs() < 1e-6, "{i}: {} {expected}", loaded[i] - free[i]);
        }
        // A vertical axis through the flange's centre bears none of it.
        assert!((loaded[3] - free[3]).abs() < 1e-9);
    }
}

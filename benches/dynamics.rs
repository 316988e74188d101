//! What one call costs: kinematics, inverse dynamics, regressor and a step of the twin.
//!
//! All benches cycle through the same 64 random motions, so no branch or cache favours a single pose.

#![allow(missing_docs)] // the macros below write public functions

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use deltatwin::dynamics::{Output, Plant, Sample, inverse_dynamics, regressor};
use deltatwin::effects::ActiveEffect;
use deltatwin::identification::{Dataset, Method};
use deltatwin::kinematics::{JointState, Motion, SocketSet};
use deltatwin::machine::Setup;
use deltatwin::machine::bodies::SLOTS;
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin::scenario::{FourierMotion, MotionLimits};
use deltatwin::twin::maximal::MaximalCoordinates;
use deltatwin::twin::{Checkpoint, Options, Torque, Twin, simulate};
use deltatwin_benches::common;
use deltatwin_io::{model, scenario};
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

const POSES: usize = 64;

fn truth() -> Plant {
    Plant::new(&common::model("irb360-6-1600-truth"), &Setup::default())
}

fn joints(plant: &Plant) -> Vec<JointState> {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    (0..POSES).map(|_| common::random_joints(plant, &mut rng)).collect()
}

fn motions(plant: &Plant) -> Vec<Motion> {
    joints(plant).iter().map(|j| plant.motion(j).expect("reachable")).collect()
}

fn kinematics(c: &mut Criterion) {
    let plant = common::nominal_plant();
    let mut joints = joints(&plant).into_iter().cycle();
    c.bench_function("motion from joints", |b| b.iter(|| plant.motion(black_box(&joints.next().unwrap()))));
}

fn dynamics(c: &mut Criterion) {
    for (name, plant) in [("rigid", common::nominal_plant()), ("truth", truth())] {
        let motions = motions(&plant);
        let states: Vec<&[f64]> = plant.effects.iter().map(|_| [].as_slice()).collect();
        for (what, with_struts) in [("torques", false), ("torques and strut forces", true)] {
            let mut cycle = motions.iter().cycle();
            c.bench_function(&format!("inverse dynamics, {what} ({name})"), |b| {
                b.iter(|| inverse_dynamics(&plant, 0.0, black_box(cycle.next().unwrap()), &states, with_struts))
            });
        }
        let rigid = plant.rigid_bodies();
        let effects: Vec<&ActiveEffect> = std::iter::once(&rigid).chain(&plant.effects).collect();
        let states: Vec<&[f64]> = effects.iter().map(|_| [].as_slice()).collect();
        let none = Output::default();
        let mut cycle = motions.iter().cycle();
        c.bench_function(&format!("regressor, four torque rows ({name})"), |b| {
            b.iter(|| {
                let motion = black_box(cycle.next().unwrap());
                regressor(&plant, &effects, &Sample { t: 0.0, motion, loads: &none }, &states, &Channel::TORQUES)
            })
        });
    }
}

/// Four limbs, along the shipped motion of Par4.
fn four_limbs(c: &mut Criterion) {
    let model = common::model("par4");
    let scenario = scenario::read(&common::shipped("scenarios/par4.toml")).expect("a scenario");
    let desired = scenario.motion(&model).expect("a motion");
    let plant = Plant::new(&model, &scenario.setup);
    let joints = |k: usize| desired.at(0.4 * k as f64 / POSES as f64).joints(&plant.geometry).expect("reachable");
    let joints: Vec<JointState> = (0..POSES).map(joints).collect();
    let motions: Vec<Motion> = joints.iter().map(|j| plant.motion(j).expect("reachable")).collect();
    let mut cycle = joints.iter().cycle();
    c.bench_function("motion from joints (par4)", |b| b.iter(|| plant.motion(black_box(cycle.next().unwrap()))));
    let states = vec![[].as_slice(); plant.effects.len()];
    for (what, with_struts) in [("torques", false), ("torques and strut forces", true)] {
        let mut cycle = motions.iter().cycle();
        c.bench_function(&format!("inverse dynamics, {what} (par4)"), |b| {
            b.iter(|| inverse_dynamics(&plant, 0.0, black_box(cycle.next().unwrap()), &states, with_struts))
        });
    }
    let tau = inverse_dynamics(&plant, 0.0, &motions[0], &states, false).expect("a regular pose").tau;
    let mut twin = Twin::new(plant.clone(), &motions[0]).expect("a regular pose");
    let mut checkpoint = Checkpoint::default();
    twin.save(&mut checkpoint);
    c.bench_function("step of 0.4 ms (par4)", |b| {
        b.iter(|| {
            twin.restore(&checkpoint);
            twin.step(400e-6, &Torque::constant(tau)).expect("a regular pose");
        })
    });
}

fn twin(c: &mut Criterion) {
    for (name, plant, h) in [("rigid", common::nominal_plant(), 4e-3), ("truth", truth(), 400e-6)] {
        let mut twins: Vec<(Twin, Torque, Checkpoint)> = motions(&plant)
            .iter()
            .map(|motion| {
                let tau = inverse_dynamics(&plant, 0.0, motion, &vec![[].as_slice(); plant.effects.len()], false)
                    .expect("a regular pose")
                    .tau;
                let twin = Twin::new(plant.clone(), motion).expect("a regular pose");
                let mut checkpoint = Checkpoint::default();
                twin.save(&mut checkpoint);
                (twin, Torque::constant(tau), checkpoint)
            })
            .collect();
        let mut k = 0;
        let mut next = move || {
            k = (k + 1) % POSES;
            k
        };
        c.bench_function(&format!("84 accelerations and 74 reactions ({name})"), |b| {
            b.iter(|| {
                let (twin, torque, checkpoint) = &mut twins[next()];
                twin.restore(checkpoint);
                let snapshot = twin.evaluate(torque).expect("a regular pose");
                black_box((snapshot.joints(twin.plant()), snapshot))
            })
        });
        let mut k = 0;
        let mut next = move || {
            k = (k + 1) % POSES;
            k
        };
        c.bench_function(&format!("step of {} ms ({name})", h * 1e3), |b| {
            b.iter(|| {
                let (twin, torque, checkpoint) = &mut twins[next()];
                twin.restore(checkpoint);
                twin.step(h, torque).expect("a regular pose");
            })
        });
    }
}

fn maximal(c: &mut Criterion) {
    let plant = common::nominal_plant();
    let motions = motions(&plant);
    let wrenches = [(Vector3::zeros(), Vector3::zeros()); SLOTS];
    let mut maximal = MaximalCoordinates::new(&plant);
    let mut cycle = motions.iter().cycle();
    c.bench_function("maximal coordinates, 84 + 74", |b| {
        b.iter(|| {
            let motion = black_box(cycle.next().unwrap());
            maximal.solve(&plant, &motion.bodies, SocketSet::ALL, &wrenches, None).map(|s| s.bodies[0].1)
        })
    });
}

/// The whole closed loop: 2.5 kHz control, all frictions, encoders, noise, recording in memory.
fn closed_loop(c: &mut Criterion) {
    let mut group = c.benchmark_group("closed loop");
    group.sample_size(20);
    let options = Options { duration: 1.0, ..Options::default() };
    let loop_of = |robot: Model, believed: &Model| {
        let believed = Plant::new(believed, &Setup::default());
        let limits = MotionLimits::of(&robot, 0.8);
        let motion = FourierMotion::random(&believed, &limits, 0.1, 10, &mut ChaCha8Rng::seed_from_u64(1));
        let options = options.clone();
        move || {
            simulate(&robot, &Setup::default(), &believed, &|t| motion.at(t), &options, &mut |_| true)
                .expect("feasible")
        }
    };
    let run = loop_of(common::model("irb360-6-1600-truth"), &common::model("irb360-6-1600"));
    group.bench_function("one second", |b| b.iter(&run));
    let four = loop_of(common::model("par4"), &common::model("par4"));
    group.bench_function("one second (par4)", |b| b.iter(&four));
    let cores = rayon::current_num_threads();
    group.bench_function(format!("{} runs of one second on {cores} cores", 4 * cores), |b| {
        b.iter(|| (0..4 * cores).into_par_iter().map(|_| run().1.steps).sum::<usize>())
    });
    group.finish();
}

/// Runs in which sockets leave their balls: 0.8 s and 1 s, most of it after the breakage, with contacts.
fn broken(c: &mut Criterion) {
    let mut group = c.benchmark_group("after a breakage");
    group.sample_size(10);
    for name in ["crash", "worn-sockets"] {
        let scenario = scenario::read(&common::root().join(format!("scenarios/{name}.toml"))).expect("a scenario");
        let machine = model::read(&scenario.model).expect("a model");
        let planning = model::read(scenario.controller_model.as_ref().expect("a name")).expect("a model");
        let motion = scenario.motion(&planning).expect("a motion");
        let believed = Plant::new(&planning, &scenario.setup);
        let options = Options { contacts: Some(deltatwin_cell::contacts), ..Options::of(&scenario, &machine) };
        let desired = |t| motion.at(t);
        group.bench_function(name, |b| {
            b.iter(|| simulate(&machine, &scenario.setup, &believed, &desired, &options, &mut |_| true).expect("a run"))
        });
    }
    group.finish();
}

/// 50 000 quantised samples of four axes, on one core.
fn derivatives(c: &mut Criterion) {
    let nominal = common::model("irb360-6-1600");
    let plant = common::nominal_plant();
    let motion =
        FourierMotion::random(&plant, &MotionLimits::of(&nominal, 0.45), 0.1, 10, &mut ChaCha8Rng::seed_from_u64(3));
    let options = Options { duration: 20.0, ..Options::default() };
    let (recording, _) = simulate(&nominal, &Setup::default(), &plant, &|t| motion.at(t), &options, &mut |_| true)
        .expect("a feasible motion");
    let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    for method in [Method::Polynomial, Method::Smoother, Method::Reversals] {
        c.bench_function(&format!("derivatives of 20 s ({method:?})"), |b| {
            b.iter(|| one.install(|| Dataset::with(black_box(&recording), method)))
        });
    }
}

criterion_group!(benches, kinematics, dynamics, four_limbs, twin, closed_loop, broken, maximal, derivatives);
criterion_main!(benches);

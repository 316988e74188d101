//! What constraint forces, path coefficients and plans cost, along the paper's U-turn.

#![allow(missing_docs)] // the macros below write public functions

use std::hint::black_box;

use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use deltatwin::constraint_forces::{Detail, constraint_forces};
use deltatwin::dynamics::Plant;
use deltatwin::planner::jerk::{self, Sequence};
use deltatwin::planner::rows::{Grid, Tightening};
use deltatwin::planner::{Limits, Machine, Objective, Options, PathPoint, Reference, pass, plan};
use deltatwin_benches::common;
use deltatwin_benches::oracle::{Oracle, Programme};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

fn forces(c: &mut Criterion) {
    for (name, plant) in [
        ("rigid", common::nominal_plant()),
        ("truth", Plant::new(&common::model("irb360-6-1600-truth"), &Default::default())),
    ] {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let motions: Vec<_> =
            (0..64).map(|_| plant.motion(&common::random_joints(&plant, &mut rng)).expect("reachable")).collect();
        let states: Vec<&[f64]> = plant.effects.iter().map(|_| [].as_slice()).collect();
        for (what, detail) in [("reduced", Detail::Reduced), ("complete", Detail::Complete)] {
            let mut cycle = motions.iter().cycle();
            c.bench_function(&format!("constraint forces, {what} ({name})"), |b| {
                b.iter(|| constraint_forces(&plant, 0.0, black_box(cycle.next().unwrap()), &states, detail))
            });
        }
    }
}

fn planning(c: &mut Criterion) {
    let model = common::model("irb360-6-1600");
    let task = deltatwin_io::plan::read(&common::shipped("scenarios/u-turn.toml"), Limits::of(&model))
        .expect("a shipped path");
    let plant = Plant::new(&model, &task.setup);
    let machine = Machine::new(&plant, task.limits.detail);
    let curve = task.shape.curve();
    let limits = Limits { jerk: [f64::INFINITY; 4], ..task.limits };
    let places: Vec<f64> = (0..=1000).map(|k| f64::from(k) / 1e3).collect();
    let points: Vec<PathPoint> =
        places.iter().map(|s| PathPoint::new(&plant.geometry, &curve, *s).expect("reachable")).collect();
    let reference = Reference { speed: 2.0, acceleration: 10.0 };
    let mut group = c.benchmark_group("plan");
    group.sample_size(20);
    group.bench_function("coefficients of 1000 points", |b| {
        b.iter(|| points.iter().map(|p| machine.coefficients(p, reference).unwrap().a[0]).sum::<f64>())
    });
    let mut grid = Grid::new(&machine, &curve, &limits, &places).expect("reachable");
    grid.load(&machine, &limits, &vec![reference; places.len()]).expect("regular");
    let tightening = Tightening::none(places.len());
    group.bench_function("passes without jerk, 1000 intervals", |b| {
        b.iter(|| pass::solve(&grid, &tightening).unwrap().z[500])
    });
    for (what, limits, intervals) in [
        ("without jerk, checked", limits, 1000),
        ("with jerk, checked", task.limits, 200),
        ("with jerk, checked", task.limits, 1000),
    ] {
        let options = Options { intervals, certify: false, ..Options::default() };
        group.bench_function(format!("{what}, {intervals} intervals"), |b| {
            b.iter(|| plan(&machine, &curve, &limits, &options).unwrap().time)
        });
    }
    group.finish();
}

/// The U-turn's rows as they are given to copp, without D √z; set up is not measured on either side.
fn beside_copp(c: &mut Criterion) {
    let model = common::model("irb360-6-1600");
    let task = deltatwin_io::plan::read(&common::shipped("scenarios/u-turn.toml"), Limits::of(&model))
        .expect("a shipped path");
    let plant = Plant::new(&model, &task.setup);
    let machine = Machine::new(&plant, task.limits.detail);
    let (curve, limits) = (task.shape.curve(), task.limits);
    let mut group = c.benchmark_group("rows given");
    group.sample_size(20);
    for intervals in [100, 200, 500, 1000] {
        let places: Vec<f64> = (0..=intervals).map(|k| f64::from(k) / f64::from(intervals)).collect();
        let reference = Reference { speed: 2.0, acceleration: 10.0 };
        let mut grid = Grid::new(&machine, &curve, &limits, &places).expect("reachable");
        grid.load(&machine, &limits, &vec![reference; places.len()]).expect("regular");
        let tightening = Tightening::none(places.len());
        group.bench_function(format!("deltatwin, viscous friction, {intervals}"), |b| {
            b.iter(|| pass::solve(&grid, &tightening).unwrap().z[50])
        });
        grid.points.iter_mut().flat_map(|s| &mut s.rows).for_each(|row| row.d = 0.0);
        group.bench_function(format!("deltatwin, {intervals}"), |b| {
            b.iter(|| pass::solve(&grid, &tightening).unwrap().z[50])
        });
        let mut oracle = Oracle::new(&grid, &limits);
        group.bench_function(format!("copp TOPP2-RA, {intervals}"), |b| b.iter(|| oracle.without_jerk()[50]));
        let unlimited = pass::solve(&grid, &tightening).expect("a motion").z;
        group.bench_function(format!("deltatwin with jerk limits, {intervals}"), |b| {
            b.iter_batched(
                || grid.clone(),
                |grid| {
                    let mut sequence = Sequence::begin(grid, &limits, &unlimited);
                    sequence.settle(&limits, Objective::Time, jerk::SETTLED, |_, _| Ok(())).unwrap();
                    sequence.at.z[50]
                },
                BatchSize::LargeInput,
            )
        });
        for (name, programme) in [("LP", Programme::Linear), ("SOCP", Programme::Cone)] {
            group.bench_function(format!("copp TOPP3-{name}, 2 rounds, {intervals}"), |b| {
                b.iter(|| oracle.with_jerk(&unlimited, programme, 2).a[50])
            });
        }
    }
    group.finish();
}

criterion_group!(benches, forces, planning, beside_copp);
criterion_main!(benches);

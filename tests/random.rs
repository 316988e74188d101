//! A thousand random runs: no panic, no hang, no number that is none.

use std::collections::BTreeMap;
use std::sync::LazyLock;
use std::time::Instant;

use crate::common::{defaults, model};
use deltatwin::cell::{Mobility, Object, Shape, Surface};
use deltatwin::dynamics::Plant;
use deltatwin::effects::REGISTRY;
use deltatwin::machine::{Payload, Setup, each};
use deltatwin::model::Model;
use deltatwin::recording::Recording;
use deltatwin::scenario::{Action, ActionKind, FourierMotion, HoldTorque, PayloadShape, Supervision, Trip};
use deltatwin::twin::{Clamps, EventKind, Options, Report, SimulationError, simulate};
use nalgebra::{Matrix3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

const RUNS: u64 = 1000;
/// No run may take longer, s.
const PATIENCE: f64 = 20.0;

static NOMINAL: LazyLock<Model> = LazyLock::new(|| model("irb360-6-1600"));
static TRUTH: LazyLock<Model> = LazyLock::new(|| model("irb360-6-1600-truth"));

struct Random {
    robot: Model,
    setup: Setup,
    motion: FourierMotion,
    options: Options,
}

fn shape(rng: &mut ChaCha8Rng) -> Shape {
    let mut length = || rng.random_range(0.02..0.2);
    let (a, b, c) = (length(), length(), length());
    match rng.random_range(0..3) {
        0 => Shape::Box { size: Vector3::new(a, b, c) },
        1 => Shape::Cylinder { radius: 0.5 * a, height: b },
        _ => Shape::Sphere { radius: 0.5 * a },
    }
}

fn objects(rng: &mut ChaCha8Rng, centre: &[f64; 4]) -> Vec<Object> {
    let mut objects = Vec::new();
    if rng.random_bool(0.5) {
        objects.push(Object {
            name: "table".into(),
            shape: Shape::Box { size: Vector3::new(1.6, 1.6, 0.05) },
            mobility: if rng.random_bool(0.3) {
                Mobility::Conveyor { velocity: Vector3::new(0.3, -0.2, 0.0) }
            } else {
                Mobility::Fixed
            },
            // Sometimes so high that the platform starts in it.
            position: Vector3::new(0.0, 0.0, centre[2] - rng.random_range(0.05..0.4)),
            yaw: 0.0,
            surface: Surface::default(),
        });
    }
    for i in 0..rng.random_range(0..4) {
        let mobility = if rng.random_bool(0.4) {
            Mobility::Fixed
        } else {
            Mobility::Free { mass: 10f64.powf(rng.random_range(-1.3..1.0)) }
        };
        let mut offset = |reach: f64| rng.random_range(-reach..reach);
        let position = Vector3::new(centre[0] + offset(0.3), centre[1] + offset(0.3), centre[2] - 0.1 + offset(0.25));
        let surface = Surface {
            stiffness: 10f64.powf(rng.random_range(4.5..5.3)),
            dissipation: rng.random_range(0.0..2.0),
            friction: rng.random_range(0.0..1.0),
            rolling: rng.random_range(0.0..1e-3),
        };
        let yaw = rng.random_range(-3.0..3.0);
        objects.push(Object { name: format!("thing {i}"), shape: shape(rng), mobility, position, yaw, surface });
    }
    objects
}

fn draw(seed: u64) -> Random {
    let rng = &mut ChaCha8Rng::seed_from_u64(seed);
    let mut robot = if rng.random_bool(0.8) { TRUTH.clone() } else { NOMINAL.clone() };
    if rng.random_bool(0.5) {
        robot.effects.push(defaults(REGISTRY[rng.random_range(1..REGISTRY.len())].name()));
    }
    let mut payload = Payload::default();
    if rng.random_bool(0.7) {
        payload.mass = rng.random_range(0.01..8.0);
        payload.com = Vector3::from_fn(|_, _| rng.random_range(-0.1..0.1));
        payload.tensor = Matrix3::identity() * rng.random_range(0.0..0.1);
    }
    let setup = Setup { payload, ..Setup::default() };
    // Between standing still and far beyond what the drives can do; sometimes out of reach.
    let size = 10f64.powf(rng.random_range(-2.0..0.6));
    let mut coordinate = |scale: f64| size * scale * rng.random_range(-1.0..1.0);
    let mut row = || [coordinate(0.2), coordinate(0.2), coordinate(0.1), coordinate(3.0)];
    let (sine, cosine) = (vec![row(), row()], vec![row(), row()]);
    let centre = [
        rng.random_range(-0.3..0.3),
        rng.random_range(-0.3..0.3),
        rng.random_range(-1.1..-0.85),
        rng.random_range(-3.0..3.0),
    ];
    let motion = FourierMotion { frequency: rng.random_range(0.5..4.0), centre, sine, cosine };
    let objects = if rng.random_bool(0.6) { objects(rng, &centre) } else { Vec::new() };
    let duration = rng.random_range(0.05..0.15);
    let mut actions = Vec::new();
    if !objects.is_empty() && rng.random_bool(0.3) {
        let t = rng.random_range(0.0..duration);
        actions.push(Action { t, kind: ActionKind::Pick(rng.random_range(0..objects.len())) });
        if rng.random_bool(0.7) {
            actions.push(Action { t: rng.random_range(t..2.0 * duration), kind: ActionKind::Release });
        }
    }
    let clamps = Clamps {
        hold: std::array::from_fn(|_| rng.random_range(60.0..300.0)),
        preload: each(200.0),
        share: if rng.random_bool(0.2) { 1.0 } else { 0.0 },
        armed: rng.random_bool(0.7),
    };
    let supervision = Supervision {
        torque: rng.random_bool(0.5).then(|| rng.random_range(5.0..100.0)),
        tracking: rng.random_bool(0.5).then(|| rng.random_range(0.005..0.2)),
        trip: if rng.random_bool(0.5) { Trip::Coast } else { Trip::Brake { torque: rng.random_range(0.0..200.0) } },
    };
    let options = Options {
        duration,
        substeps: rng.random_range(1..3),
        control_period: rng.random_range(1..4),
        hold_torque: if rng.random_bool(0.5) { HoldTorque::Ramp } else { HoldTorque::Hold },
        noise_seed: rng.random_bool(0.5).then_some(seed),
        clamps: Some(clamps),
        supervision,
        payload_shape: rng
            .random_bool(0.3)
            .then(|| PayloadShape { shape: shape(rng), centre: Vector3::new(0.0, 0.0, -0.05) }),
        objects,
        actions,
        contacts: Some(deltatwin_cell::contacts),
        frames: rng.random_bool(0.1).then_some(0.01),
        ..Options::default()
    };
    Random { robot, setup, motion, options }
}

fn finite(recording: &Recording, report: &Report) -> bool {
    let s = &recording.signals;
    let rows = s.series().flat_map(|(_, values)| values);
    let sockets = report.min_margin.iter().take(12);
    let single = [
        report.simulated,
        report.max_loop_gap,
        report.max_loop_rate,
        report.energy_error,
        report.peak_strut_force,
        report.kinetic_energy,
        report.unconverged,
    ];
    s.t.iter().chain(rows).chain(sockets).chain(&report.tracking_error).chain(&single).all(|x| x.is_finite())
        && report.events.iter().all(|e| e.t.is_finite())
        && report
            .frames
            .iter()
            .all(|f| f.objects.iter().chain(&f.bodies).all(|p| p.to_homogeneous().iter().all(|x| x.is_finite())))
}

#[test]
#[ignore = "campaign"]
fn a_thousand_random_runs_end_cleanly() {
    let start = Instant::now();
    let outcomes: Vec<(u64, f64, Vec<String>, [f64; 3])> = (0..RUNS)
        .into_par_iter()
        .map(|seed| {
            let random = draw(seed);
            let believed = Plant::new(&NOMINAL, &random.setup);
            let begun = Instant::now();
            let desired = |t: f64| random.motion.at(t);
            let patient = &mut |_: f64| begun.elapsed().as_secs_f64() < PATIENCE;
            let run = || simulate(&random.robot, &random.setup, &believed, &desired, &random.options, patient);
            let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run));
            let mut tags: Vec<String> = Vec::new();
            let mut worst = [0.0; 3];
            match result {
                Err(_) => tags.push("PANIC".into()),
                Ok(Err(e)) => tags.push(match e {
                    SimulationError::Body { .. } => "error: body".into(),
                    SimulationError::Missing { .. }
                    | SimulationError::NoStrut { .. }
                    | SimulationError::NotThreeLimbs { .. }
                    | SimulationError::Load { .. } => "error: missing".into(),
                    SimulationError::Trajectory { .. } => "error: trajectory".into(),
                    SimulationError::Singular { .. } => {
                        println!("seed {seed}: {e} {:?}", random.robot.effects.last().map(|a| a.effect.name()));
                        "error: singular".into()
                    }
                    SimulationError::Cell { .. } => "error: cell".into(),
                    SimulationError::Law { .. } => "error: law".into(),
                }),
                Ok(Ok((recording, report))) => {
                    tags.push("ended".into());
                    worst = [report.max_loop_gap, report.energy_error, report.unconverged];
                    if !finite(&recording, &report) {
                        tags.push("NOT FINITE".into());
                    }
                    for kind in [
                        EventKind::Dislocation,
                        EventKind::Trip,
                        EventKind::Contact,
                        EventKind::Stop,
                        EventKind::Pick,
                        EventKind::Release,
                        EventKind::Rest,
                        EventKind::Singular,
                    ] {
                        if report.events.iter().any(|e| e.kind == kind) {
                            tags.push(kind.name().into());
                            if kind == EventKind::Singular {
                                let closed: Vec<usize> = report.closed.iter().collect();
                                println!(
                                    "seed {seed}: stuck at {:.4} s, closed {closed:?}, kinetic {:.1e} J",
                                    report.simulated, report.kinetic_energy
                                );
                            }
                        }
                    }
                }
            }
            let took = begun.elapsed().as_secs_f64();
            if took >= PATIENCE {
                tags.push("HANG".into());
            }
            if tags.iter().any(|t| t.chars().all(|c| c.is_uppercase() || c == ' ')) {
                println!("seed {seed}: {tags:?}");
            }
            (seed, took, tags, worst)
        })
        .collect();
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for tag in outcomes.iter().flat_map(|o| &o.2) {
        *counts.entry(tag).or_default() += 1;
    }
    for (tag, n) in &counts {
        println!("{n:>5} {tag}");
    }
    for (i, what) in ["loop gap", "energy error", "unconverged"].iter().enumerate() {
        let worst = outcomes.iter().max_by(|a, b| a.3[i].total_cmp(&b.3[i])).unwrap();
        println!("largest {what} {:.1e} (seed {})", worst.3[i], worst.0);
    }
    let slowest = outcomes.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
    let total: f64 = outcomes.iter().map(|o| o.1).sum();
    println!(
        "slowest {:.2} s (seed {}), all {total:.1} s, {:.1} s of wall clock",
        slowest.1,
        slowest.0,
        start.elapsed().as_secs_f64()
    );
    for bad in ["PANIC", "HANG", "NOT FINITE"] {
        assert_eq!(counts.get(bad), None, "{bad}");
    }
    for expected in ["ended", "dislocation", "trip", "contact", "pick", "error: trajectory"] {
        assert!(counts.get(expected).is_some_and(|n| *n >= 10), "{expected}: {:?}", counts.get(expected));
    }
}

//! The shipped scenarios run, and run the same again.

use crate::common;

use std::path::Path;
use std::sync::LazyLock;

use common::runs;
use deltatwin::dynamics::Plant;
use deltatwin::identification::{Dataset, swapped};
use deltatwin::kinematics::JointState;
use deltatwin::machine::bodies::{END_EFFECTOR, SLOTS};
use deltatwin::machine::{Inertia, Payload, Setup};
use deltatwin::recording::Recording;
use deltatwin::scenario::{FourierMotion, MotionLimits};
use deltatwin::twin::{Contacts, EventKind, Options, Report, Twin, simulate};
use deltatwin_cell::Cell;
use deltatwin_io::{model, scenario};
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;

/// Longest run, s.
const LONGEST: f64 = 2.0;

fn play(file: &Path, change: impl Fn(&mut Options)) -> (Recording, Report) {
    let scenario = scenario::read(file).unwrap();
    let machine = model::read(&scenario.model).unwrap();
    let planning = model::read(scenario.controller_model.as_ref().unwrap_or(&scenario.model)).unwrap();
    let motion = scenario.motion(&planning).unwrap();
    let believed = Plant::new(&planning, &scenario.setup);
    let mut options = Options { contacts: Some(deltatwin_cell::contacts), ..Options::of(&scenario, &machine) };
    options.duration = options.duration.min(LONGEST);
    change(&mut options);
    simulate(&machine, &scenario.setup, &believed, &|t| motion.at(t), &options, &mut |_| true)
        .unwrap_or_else(|e| panic!("{}: {e}", scenario.name))
}

/// All shipped scenarios, played on `threads` threads, in the order of their names.
fn played(threads: usize) -> Vec<(Recording, Report)> {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| runs().par_iter().map(|file| play(file, |_| ())).collect())
}

/// The same on two threads, for all tests.
static PLAYED: LazyLock<Vec<(Recording, Report)>> = LazyLock::new(|| played(2));

/// Every number in a recording.
fn numbers(r: &Recording) -> impl Iterator<Item = f64> + '_ {
    r.signals.t.iter().chain(r.signals.series().flat_map(|(_, values)| values)).copied()
}

#[test]
fn all_run_cleanly() {
    println!("scenario              s   gap (m)  rate     energy   kinetic (J)  peak (N)  events");
    for (file, (recording, report)) in runs().iter().zip(&*PLAYED) {
        let name = file.file_stem().unwrap().to_str().unwrap();
        println!(
            "{name:<20} {:5.3} {:.1e}  {:.1e}  {:.1e}  {:.1e}  {:8.1}  {}",
            report.simulated,
            report.max_loop_gap,
            report.max_loop_rate,
            report.energy_error,
            report.kinetic_energy,
            report.peak_strut_force,
            report.events.len()
        );
        assert!(!recording.signals.is_empty() && numbers(recording).all(f64::is_finite), "{name}");
        assert!(report.max_loop_gap < 1e-10 && report.max_loop_rate < 1e-9, "{name}: {:e}", report.max_loop_gap);
        assert!(report.energy_error < 1e-4, "{name}: {:e}", report.energy_error);
        assert!(report.kinetic_energy.is_finite() && report.peak_strut_force.is_finite() && report.unconverged == 0.0);
    }
}

#[test]
#[ignore = "campaign"]
fn all_run_the_same_again_on_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = |recording: &Recording| {
        let out = folder.path().join("run.mcap");
        deltatwin_io::recording::write(recording, &out).unwrap();
        std::fs::read(out).unwrap()
    };
    for ((file, (recording, report)), (recording_again, report_again)) in runs().iter().zip(&*PLAYED).zip(&played(3)) {
        let name = file.file_stem().unwrap().to_str().unwrap();
        assert!(bytes(recording) == bytes(recording_again), "{name}: other bytes");
        assert_eq!(format!("{report:?}"), format!("{report_again:?}"), "{name}");
    }
}

#[test]
fn no_shipped_scenario_looks_as_if_axes_were_swapped() {
    for (file, (recording, _)) in runs().iter().zip(&*PLAYED) {
        assert_eq!(swapped(&Dataset::new(recording)), None, "{}", file.display());
    }
}

#[test]
fn the_can_is_picked_and_placed() {
    let file = &crate::common::shipped("scenarios/pick-and-place.toml");
    let (_, report) = play(file, |o| {
        o.duration = 1.2;
        o.frames = Some(0.01);
    });
    let at = |kind: EventKind| report.events.iter().find(|e| e.kind == kind).expect("an event").t;
    assert!((at(EventKind::Pick) - 0.17).abs() < 1e-9 && (at(EventKind::Release) - 0.85).abs() < 1e-9);
    let can = 3;
    let last = report.frames.last().unwrap();
    let position = last.objects[can].translation.vector;
    // 50 mm above the block's top at −1.2 m, where the gripper let go.
    let off = position - Vector3::new(0.2, 0.1, -1.15);
    println!("can {position:?}, {:.2} mm beside, {:.2} mm above", 1e3 * off.xy().norm(), 1e3 * off.z);
    assert!(off.xy().norm() < 5e-3 && off.z.abs() < 5e-4, "{position}");
    // In the hand it moves with it: the pose on the end effector is constant.
    let seen: Vec<_> = report
        .frames
        .iter()
        .filter(|f| f.t > 0.175 && f.t < 0.845)
        .map(|f| f.bodies[END_EFFECTOR].inverse() * f.objects[can])
        .collect();
    for pose in &seen {
        assert!((pose.translation.vector - seen[0].translation.vector).norm() < 1e-12);
        assert!(pose.rotation.angle_to(&seen[0].rotation) < 1e-7);
    }
}

#[test]
fn momentum_is_conserved_when_the_gripper_closes() {
    // The joints' impulses do no work on a motion the joints allow: for each of the four, Σ Δp·v + ΔL·ω over the bodies
    // is what the can brings along, and afterwards the can moves with the hand.
    let scenario = scenario::read(&crate::common::shipped("scenarios/pick-and-place.toml")).unwrap();
    let machine = model::read(&scenario.model).unwrap();
    let plant = Plant::new(&machine, &scenario.setup);
    let q = plant.geometry.inverse(&Vector3::new(-0.2, 0.0, -1.0375), 0.0).unwrap();
    let q = [q[0], q[1], q[2], 0.4];
    for qd in [[0.0; 4], [1.0, -2.0, 1.5, 6.0]] {
        let motion = plant.motion(&JointState { q, qd, qdd: [0.0; 4] }).unwrap();
        let mut cell = Cell::new(&scenario.objects, &plant.geometry, None, plant.gravity_vector()).unwrap();
        // The belt carries the can along.
        (0..400).for_each(|_| cell.advance(4e-4, 0.0));
        let (before, _) = cell.momentum();
        let mut twin = Twin::new(plant.clone(), &motion).unwrap();
        let momenta = |twin: &Twin| -> [(Vector3<f64>, Vector3<f64>); SLOTS] {
            let motion = twin.motion();
            std::array::from_fn(|b| {
                let (inertia, m): (&Inertia, _) = (&twin.plant().bodies[b], &motion.bodies[b]);
                let h = m.rotation * inertia.first_moment;
                let theta = m.rotation * inertia.tensor * m.rotation.transpose();
                (
                    m.velocity * inertia.mass + m.angular_velocity.cross(&h),
                    theta * m.angular_velocity + h.cross(&m.velocity),
                )
            })
        };
        let robot = momenta(&twin);
        let held = cell.pick("can", &motion).unwrap();
        let (after, _) = cell.momentum();
        let linear = held.twist.0 * held.inertia.mass;
        assert!((before - after - linear).norm() < 1e-12, "the cell gives what the twin gets");
        assert!(linear.norm() > 0.09, "0.5 kg at 0.2 m/s: {linear}");
        let hand = motion.bodies[END_EFFECTOR];
        let point = Inertia::point(held.inertia.mass, held.inertia.first_moment / held.inertia.mass);
        let own = hand.rotation * (held.inertia.tensor - point.tensor) * hand.rotation.transpose();
        let angular = own * held.twist.1 + (held.position - hand.position).cross(&linear);
        let lever = hand.position - held.position;
        let velocity = held.twist.0 + held.twist.1.cross(&lever);
        twin.attach(&held.inertia, &(velocity, held.twist.1)).unwrap();
        let joined = momenta(&twin);
        for axis in 0..4 {
            let mut unit = [0.0; 4];
            unit[axis] = 1.0;
            let allowed = plant.motion(&JointState { q, qd: unit, qdd: [0.0; 4] }).unwrap();
            let along = |b: usize, p: &Vector3<f64>, l: &Vector3<f64>| {
                p.dot(&allowed.bodies[b].velocity) + l.dot(&allowed.bodies[b].angular_velocity)
            };
            let gained: f64 =
                (0..SLOTS).map(|b| along(b, &(joined[b].0 - robot[b].0), &(joined[b].1 - robot[b].1))).sum();
            let brought = along(END_EFFECTOR, &linear, &angular);
            println!("axis {}: brought {brought:+.6}, gained {gained:+.6} N·m·s", axis + 1);
            assert!((gained - brought).abs() < 1e-12 + 1e-9 * brought.abs(), "{gained} {brought}");
        }
    }
}

/// A payload off the axis of the flange loads the arms when axis 4 swings it: it is axis 4 that has to slow down.
#[test]
fn a_swinging_payload_does_not_stop_the_platform() {
    let model = common::model("irb360-6-1600");
    let payload = Payload::new(2.5, [0.03, -0.02, -0.08], 0.012);
    let plant = Plant::new(&model, &Setup { payload, ..Setup::default() });
    let limits = MotionLimits::of(&model, 0.45);
    // Six in a thousand draws ask for that; without it the platform stood still in these.
    for seed in [554, 705, 774, 1027, 1039, 1112] {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let motion = FourierMotion::random(&plant, &limits, 0.1, 10, &mut rng);
        let reach = (0..200)
            .map(|k| (motion.at(0.05 * f64::from(k)).position - motion.at(0.0).position).norm())
            .fold(0.0, f64::max);
        assert!(reach > 0.2, "seed {seed}: the platform moves {reach:.3} m");
    }
}

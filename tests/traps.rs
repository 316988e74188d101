//! Known traps: effects that look like another one, or like the parameters the model has. The answer may be a set or
//! nothing, but never a wrong name alone.
//!
//! Measurements are made by inverse dynamics along planned motions, with quantised angles and noise of the torques.

use crate::common::{encoded, model, planned};
use deltatwin::diagnosis::{Diagnosis, Verdict, diagnose};
use deltatwin::dynamics::{Plant, steady_inverse_dynamics};
use std::sync::Arc;

use deltatwin::effects::formula::{Expression, Formula, Place, Term};
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::excitation::Options;
use deltatwin::excitation::discriminate::discriminate;
use deltatwin::excitation::experiments::Experiment;
use deltatwin::identification::{Dataset, Residuals, fit, predict};
use deltatwin::kinematics::Motion;
use deltatwin::machine::{Payload, Setup};
use deltatwin::model::Model;
use deltatwin::recording::{Recording, Signals};
use deltatwin::scenario::motion::path::Path;
use deltatwin::scenario::motion::static_poses::StaticPoses;
use deltatwin::scenario::{Course, DesiredMotion, FourierMotion};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};

/// Sampling period, s: physics lives below 80 Hz.
const PERIOD: f64 = 1e-3;
/// Noise of the torques, N·m.
const NOISE: [f64; 4] = [0.4, 0.4, 0.4, 0.05];

fn nominal() -> Model {
    model("irb360-6-1600")
}

/// The nominal robot, a few percent off, with an effect.
fn robot(name: &str, blocks: &[&[f64]]) -> Model {
    let mut robot = nominal();
    deltatwin_validation::exam::perturb(&mut robot, &mut ChaCha8Rng::seed_from_u64(9));
    robot.effects.push(ActiveEffect::new(find(name).expect("registered"), blocks));
    robot
}

/// What `robot` measures along `course`.
fn measured(robot: &Model, course: &Course, payload: Payload, duration: f64, seed: u64) -> Dataset {
    let setup = Setup { payload, torque_noise: Some(NOISE), ..Setup::default() };
    let motion = course.on(robot, &setup).expect("a possible motion");
    let n = (duration / PERIOD) as usize;
    let joints: Vec<_> =
        (0..n).map(|k| motion.at(k as f64 * PERIOD).joints(&robot.geometry).expect("in reach")).collect();
    let exact = planned(setup, (0..n).map(|k| k as f64 * PERIOD).collect(), joints, PERIOD);
    let torque = predict(&Plant::new(robot, &setup), &exact).expect("a possible motion");
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut noisy = |i: usize, k: usize| torque[i][k] + Normal::new(0.0, NOISE[i]).expect("a width").sample(&mut rng);
    let tau: Vec<_> = (0..n).map(|k| std::array::from_fn(|i| noisy(i, k))).collect();
    let signals = Signals::of_drives(robot.mechanism, exact.t.clone(), &encoded(robot, &exact.joints), &tau);
    Dataset::new(&Recording { name: "measured".into(), signals, setup })
}

/// A random periodic motion that uses `share` of the drives' limits.
fn excitation(seed: u64, share: f64) -> Course {
    Course::RandomFourier { seed, frequency: 0.2, harmonics: 8, share }
}

fn diagnosed(datasets: &[Dataset]) -> Diagnosis {
    let d = diagnose(&nominal(), datasets, &[], &mut |_| {}).expect("a diagnosis");
    println!("{:?} {:?} sets {:?}", d.verdict, names(&d), d.indistinguishable);
    println!("unseen {:?}", d.unseen);
    println!("next {:?}", d.next_experiment.as_ref().map(|e| &e.what));
    d
}

fn names(d: &Diagnosis) -> Vec<&str> {
    d.effects.iter().map(|e| e.name.as_str()).collect()
}

/// Whether one set holds all of `members`.
fn set_with(d: &Diagnosis, members: &[&str]) -> bool {
    d.indistinguishable.iter().any(|set| members.iter().all(|m| set.iter().any(|n| n == m)))
}

/// The hidden effect is named, or in a set, or nothing is, or nothing known is said to explain the data.
fn not_misled(d: &Diagnosis, hidden: &str) -> bool {
    d.verdict == Verdict::Unknown || d.effects.is_empty() || names(d) == [hidden] || set_with(d, &[hidden])
}

/// Poses around the middle of the workspace, `size` m apart.
fn poses(size: f64) -> Course {
    let pose = |x: f64, y: f64, z: f64| [size * x, size * y, -1.0 + size * z, 0.0];
    let poses = vec![
        pose(0.0, 0.0, 0.0),
        pose(1.0, 0.0, 0.3),
        pose(-0.5, 0.9, -0.3),
        pose(-0.5, -0.9, 0.3),
        pose(0.2, 0.1, 1.0),
        pose(0.0, 0.0, 0.0),
    ];
    Course::StaticPoses(StaticPoses { poses, hold: 0.7, travel: 0.5 })
}

/// 0.6 s are too short for any test: 120 means over 5 ms. Nineteen times the noise is left on axis 4, and nearly all of it is
/// gone with the payload's true centre of mass, in another recording as well.
#[test]
#[ignore = "campaign"]
fn a_shifted_payload_is_named_in_a_recording_too_short_for_tests() {
    let robot = robot("payload_com_offset", &[&[0.05, 0.06, 0.0]]);
    let run = |seed: u64| {
        let course = Course::RandomFourier { seed, frequency: 1.0, harmonics: 4, share: 0.6 };
        measured(&robot, &course, Payload { mass: 1.5, ..Payload::default() }, 0.6, seed)
    };
    let d = diagnose(&nominal(), &[run(3)], &[run(4)], &mut |_| {}).expect("a diagnosis");
    println!("{:?} left {:?} of {:?}", names(&d), d.rms_after, d.rms_before);
    assert!(d.too_few.is_some());
    assert_eq!((names(&d), d.indistinguishable.len()), (vec!["payload_com_offset"], 0));
    assert!(d.rms_after[3] < 1.1 * d.noise_floor[3]);
}

/// A drive that drags another one takes most of the error, and forward selection takes it for other effects.
#[test]
#[ignore = "campaign"]
fn backlash_is_named_next_to_an_unknown_law() {
    let mut robot = robot("backlash_hysteresis", &[&[1.6, 1.5, 1.2], &[0.009]]);
    let law = Expression::parse("-abs(qd2*qd3)").expect("a law");
    let term = Term { name: "drag".into(), at: Place::Drive(0), law };
    let unknown = Formula::new(vec![(term, 1.0)], false, robot.mechanism);
    robot.effects.push(ActiveEffect { host: robot.host(), ..ActiveEffect::new(Arc::new(unknown), &[&[1.0]]) });
    let run = |seed: u64| measured(&robot, &excitation(seed, 0.6), Payload::default(), 12.0, seed);
    let d = diagnose(&nominal(), &[run(3)], &[run(4)], &mut |_| {}).expect("a diagnosis");
    println!("{:?} left {:?} of {:?}", names(&d), d.rms_after, d.rms_before);
    assert_eq!((d.verdict, names(&d)), (Verdict::Unknown, vec!["backlash_hysteresis"]));
    assert!(d.effects[0].confidence.probability() > 0.9);
    let (_, law, coefficient) = &d.unexplained.as_ref().expect("a formula").terms[0];
    assert_eq!(law, "-abs(qd2*qd3)");
    assert!((coefficient.value - 1.0).abs() < 0.01, "{}", coefficient.value);
    assert!(d.rms_after.iter().zip(&d.noise_floor).all(|(rms, floor)| *rms < 1.02 * floor), "{:?}", d.rms_after);
}

/// AR(1) noise a = 0.9 of 0.8 N·m next to the white one of 0.4: neighbouring samples show √(0.4² + 0.8²·0.1/1.9) = 0.44 N·m,
/// twice of which would be left; five laps show 0.89.
#[test]
#[ignore = "campaign"]
fn noise_with_memory_is_no_effect_where_laps_show_it() {
    let course = Course::RandomFourier { seed: 3, frequency: 0.25, harmonics: 8, share: 0.6 };
    let mut data = measured(&nominal(), &course, Payload::default(), 20.0, 5);
    data.setup.torque_noise = None;
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let innovation = Normal::new(0.0, 0.8 * (1.0f64 - 0.81).sqrt()).expect("a width");
    for series in data.measured.iter_mut().take(3) {
        let mut slow = 0.0;
        for x in series.iter_mut() {
            slow = 0.9 * slow + innovation.sample(&mut rng);
            *x += slow;
        }
    }
    let d = diagnosed(std::slice::from_ref(&data));
    assert_eq!((d.verdict, names(&d)), (Verdict::None, vec![]));
    let repeats = d.repeats.expect("laps");
    assert_eq!(repeats.laps, 5);
    for share in repeats.channels.iter().take(3) {
        let (noise, std) = share.parts.noise;
        assert!((noise - 0.8f64.hypot(0.4)).abs() < 4.0 * std && std < 0.02, "{}", share.sentence());
        assert_eq!(share.floor.map(|f| f > 0.8), Some(true), "{}", share.sentence());
    }
}

#[test]
#[ignore = "campaign"]
fn a_tilt_of_the_base_and_constant_torques_are_alike_in_a_small_workspace() {
    for (name, blocks, vanishes_at_rest) in [
        ("torque_bias", &[&[0.2, -0.1, -0.1, 0.0][..]][..], false),
        ("base_tilt", &[&[0.03, 0.015][..]], false),
        ("drive_coulomb_asymmetry", &[&[0.4, -0.2, -0.2][..], &[100.0]], true),
    ] {
        let robot = robot(name, blocks);
        println!("-- {name}");
        let d = diagnosed(&[measured(&robot, &poses(0.02), Payload::default(), 4.0, 3)]);
        if vanishes_at_rest {
            assert_eq!(names(&d), [name], "{:?}", d.indistinguishable);
            continue;
        }
        assert_eq!(d.verdict, Verdict::Ambiguous, "{name}: {:?}", names(&d));
        assert!(set_with(&d, &["torque_bias", "base_tilt"]), "{name}: {:?}", d.indistinguishable);
    }
}

#[test]
#[ignore = "campaign"]
fn viscous_friction_of_the_sockets_hides_in_that_of_drives_and_telescope() {
    for (coefficient, visible) in [(0.03, false), (0.25, true)] {
        let robot = robot("ball_socket_viscous", &[&[coefficient]]);
        let d = diagnosed(&[measured(&robot, &excitation(5, 0.15), Payload::default(), 3.0, 4)]);
        let report = d.candidates.iter().find(|c| c.name == "ball_socket_viscous").unwrap();
        println!("{report:?}");
        assert!(report.absorbed_by.iter().any(|p| p.contains("friction.viscous")), "{report:?}");
        if visible {
            assert!(not_misled(&d, "ball_socket_viscous"), "{:?}", names(&d));
        } else {
            assert_eq!((d.verdict, names(&d)), (Verdict::None, vec![]));
        }
    }
}

/// Mean viscous friction of the drives, N·m·s/rad.
fn viscosity(model: &Model) -> f64 {
    let parameters = Plant::new(model, &Setup::default()).parameters();
    let of = |i: usize| parameters.iter().find(|p| p.name == format!("drive_friction.viscous_{i}")).unwrap().value;
    (1..=3).map(of).sum::<f64>() / 3.0
}

#[test]
#[ignore = "campaign"]
fn coulomb_friction_of_the_sockets_looks_viscous_until_the_speed_changes() {
    let robot = robot("ball_socket_coulomb", &[&[0.35], &[0.05]]);
    let DesiredMotion::Fourier(fast) = excitation(7, 0.5).on(&robot, &Setup::default()).unwrap() else { panic!() };
    let slow = FourierMotion { frequency: 0.1 * fast.frequency, ..fast.clone() };
    let [slow, fast] = [(slow, 6.0), (fast, 4.0)]
        .map(|(series, duration)| measured(&robot, &Course::Fourier(series), Payload::default(), duration, 6));
    let alone = |t: &Dataset| {
        let f = fit(&nominal(), std::slice::from_ref(t), &[t.noise(&nominal())]).unwrap();
        viscosity(&f.model)
    };
    let seen = [alone(&slow), alone(&fast)];
    println!("viscosity {seen:?}");
    // Too much viscosity, and more of it at the tenth of the speed.
    let own = viscosity(&robot);
    assert!(seen[0] - own > 2.0 * (seen[1] - own) && seen[1] - own > 0.2, "{seen:?} {own}");
    let d = diagnosed(&[slow, fast]);
    assert_eq!((d.verdict, names(&d)), (Verdict::Effect, vec!["ball_socket_coulomb"]));
}

#[test]
#[ignore = "campaign"]
fn a_wrong_payload_hides_in_the_platform_until_it_is_taken_off() {
    let stated = Payload::new(2.5, [0.0, 0.0, -0.05], 0.01);
    let robot = robot("payload_mass_error", &[&[0.25]]);
    let with = measured(&robot, &excitation(8, 0.3), stated, 4.0, 8);
    let d = diagnosed(std::slice::from_ref(&with));
    let without = measured(&robot, &excitation(9, 0.3), Payload::default(), 4.0, 9);
    let both = diagnosed(&[with, without]);
    assert!(d.effects.is_empty() && d.unseen.iter().any(|n| n == "payload_mass_error"));
    assert_eq!(names(&both), ["payload_mass_error"]);
}

#[test]
#[ignore = "campaign"]
fn a_heavier_limb_is_not_taken_for_a_wrong_gain_or_an_elastic_gear() {
    for (name, blocks) in [
        ("limb_asymmetry", &[&[0.0, 0.0, 0.2, 0.0, 0.0, 0.0][..], &[0.0; 3], &[1.106], &[0.5], &[0.384], &[0.585]][..]),
        ("torque_gain_error", &[&[0.0, 0.06, 0.0, 0.0][..]]),
    ] {
        println!("-- {name}");
        let robot = robot(name, blocks);
        let d = diagnosed(&[measured(&robot, &excitation(10, 0.15), Payload::default(), 2.0, 10)]);
        assert!(not_misled(&d, name), "{name}: {:?} {:?}", names(&d), d.indistinguishable);
    }
}

/// Where the smoothed motion is not the motion, an error is the smoothing's: 3 N·m of extra friction there is nothing.
#[test]
#[ignore = "campaign"]
fn what_happens_next_to_reversals_alone_counts_nowhere() {
    let mut data = measured(&nominal(), &excitation(8, 0.5), Payload::default(), 4.0, 8);
    let before = Residuals::new(&nominal(), std::slice::from_ref(&data)).expect("possible poses").rms;
    let near: Vec<usize> = data.near_reversals.iter().cloned().flatten().collect();
    assert!(near.len() > data.len() / 20, "{} of {}", near.len(), data.len());
    for (axis, series) in data.measured.iter_mut().enumerate().take(3) {
        near.iter().for_each(|&k| series[k] += 3.0 * data.joints[k].qd[axis].signum());
    }
    assert_eq!(Residuals::new(&nominal(), std::slice::from_ref(&data)).expect("possible poses").rms, before);
    assert!(diagnosed(&[data]).effects.is_empty());
}

#[test]
#[ignore = "campaign"]
fn friction_by_load_is_found_or_left_open_near_self_locking() {
    for friction in [0.3, 1.5] {
        println!("-- {friction}");
        let robot = robot("ball_socket_load_dependent", &[&[friction], &[0.0095], &[0.05]]);
        let payload = Payload::new(2.5, [0.03, -0.02, -0.08], 0.012);
        let d = diagnosed(&[measured(&robot, &excitation(12, 0.5), payload, 3.0, 12)]);
        assert!(not_misled(&d, "ball_socket_load_dependent"), "{:?} {:?}", names(&d), d.indistinguishable);
    }
}

#[test]
#[ignore = "campaign"]
fn the_planned_motion_tells_a_bias_from_a_tilt() {
    let bias = [0.2, -0.15, -0.05, 0.0];
    let robot = robot("torque_bias", &[&bias]);
    let before = diagnosed(&[measured(&robot, &poses(0.03), Payload::default(), 3.5, 5)]);
    assert_eq!(before.verdict, Verdict::Ambiguous);
    assert!(set_with(&before, &["torque_bias", "base_tilt"]), "{:?}", before.indistinguishable);
    assert!(before.next_experiment.is_some_and(|e| e.pair.len() == 2 && e.chance > 0.5));

    let mut assumed = nominal();
    for (name, values) in [("base_tilt", &[0.006, -0.004][..]), ("torque_bias", &bias)] {
        assumed.effects.push(ActiveEffect::new(find(name).expect("registered"), &[values]));
    }
    let quick = Options { harmonics: 3, starts: 1, iterations: 3, ..Options::default() };
    let planned = discriminate(&assumed, ["base_tilt", "torque_bias"], &quick, &|| true).expect("a plan");
    let here = |e: &Experiment| e.kind.preparation() == 0.0;
    let (plan, promise) = planned.plans.iter().find(|(e, _)| here(e)).expect("a plan without tools");
    println!("{}: δ² {} chance {}", plan.what, promise.noncentrality, promise.chance);
    let course = plan.course.as_ref().expect("a motion of its own");
    let after = diagnosed(&[measured(&robot, course, Payload::default(), plan.length.min(20.0), 6)]);
    assert_eq!((after.verdict, names(&after)), (Verdict::Effect, vec!["torque_bias"]));
}

#[test]
#[ignore = "campaign"]
fn torques_that_come_four_samples_late_are_no_backlash() {
    let dataset = measured(&robot("signal_delay", &[&[0.004]]), &excitation(5, 0.6), Payload::default(), 10.0, 6);
    let d = diagnosed(&[dataset]);
    assert_eq!(names(&d), ["signal_delay"]);
    let delay = d.effects[0].parameters.iter().find(|p| p.name == "delay").expect("a parameter");
    assert!((delay.value - 0.004).abs() < 4.0 * delay.std + 2e-5, "{delay:?}");
}

/// Encoders of 0.4 mrad hide the reversals, and the bodies' parameters imitate a factor of one torque.
#[test]
#[ignore = "campaign"]
fn a_torque_factor_is_found_over_coarse_angles() {
    const STEP: f64 = 4e-4;
    let robot = robot("torque_gain_error", &[&[0.0, 0.0, 0.1, 0.0]]);
    let coarse = |seconds: f64, seed: u64| {
        let fine = measured(&robot, &picking(), Payload::default(), seconds, seed);
        let q: Vec<_> = fine.joints.iter().map(|joints| joints.q.map(|q| (q / STEP).round() * STEP)).collect();
        let tau: Vec<_> = (0..fine.len()).map(|k| std::array::from_fn(|i| fine.measured[i][k])).collect();
        let signals = Signals::of_drives(robot.mechanism, fine.t, &q, &tau);
        Dataset::new(&Recording { name: "measured".into(), signals, setup: fine.setup })
    };
    let d = diagnose(&nominal(), &[coarse(6.0, 13)], &[coarse(3.0, 14)], &mut |_| {}).expect("a diagnosis");
    println!("{:?} {:?} {:?}", d.verdict, names(&d), d.indistinguishable);
    assert!(names(&d) == ["torque_gain_error"] || set_with(&d, &["torque_gain_error"]), "{:?}", names(&d));
}

/// Straight lines between corners of a box of 0.5 m, with stops: acceleration 40 m/s² within 20 ms.
fn picking() -> Course {
    let waypoints = vec![
        [-0.25, -0.1, -1.05, 0.0],
        [-0.25, -0.1, -0.97, 0.0],
        [0.25, 0.12, -0.97, 1.0],
        [0.25, 0.12, -1.05, 1.0],
        [0.05, -0.25, -0.97, -0.5],
    ];
    Course::Path(Path {
        waypoints,
        blend: 0.05,
        speed: 3.0,
        acceleration: 40.0,
        jerk: 2000.0,
        turn_radius: 0.15,
        stops: vec![3],
        dwell: 0.1,
        closed: true,
        laps: 100,
    })
}

/// Both respond to the fourth derivative of the motion below their frequencies: the frame by the total force on it, a gear
/// by its own torque.
#[test]
#[ignore = "campaign"]
fn a_stiff_frame_is_no_elastic_gear() {
    for (name, blocks) in [
        ("frame_compliance", &[&[8e-3; 2][..], &[22.0, 24.0], &[0.05; 2]][..]),
        ("drive_elasticity", &[&[4e-5; 3][..], &[20.0], &[0.18], &[0.0]]),
    ] {
        println!("-- {name}");
        let robot = robot(name, blocks);
        let d = diagnosed(&[measured(&robot, &picking(), Payload::default(), 3.0, 13)]);
        assert!(not_misled(&d, name), "{name}: {:?} {:?}", names(&d), d.indistinguishable);
    }
}

/// A stiff gripper adds a little to the mass of the payload, in horizontal directions.
#[test]
#[ignore = "campaign"]
fn a_payload_that_swings_is_no_heavier_or_shifted_one() {
    let stated = Payload::new(2.5, [0.03, -0.02, -0.08], 0.012);
    for (name, blocks) in [
        ("payload_compliance", &[&[0.4][..], &[18.0], &[0.1]][..]),
        ("payload_mass_error", &[&[0.25][..]]),
        ("payload_com_offset", &[&[0.04, -0.02, 0.0][..]]),
    ] {
        println!("-- {name}");
        let robot = robot(name, blocks);
        let d = diagnosed(&[measured(&robot, &picking(), stated, 3.0, 14)]);
        assert!(not_misled(&d, name), "{name}: {:?} {:?}", names(&d), d.indistinguishable);
    }
}

/// Torques of a motion within a fiftieth of the limits hardly depend on most parameters. Held out, a wide motion then leaves many
/// times the noise, although nothing is missing.
#[test]
#[ignore = "campaign"]
fn a_small_motion_does_not_determine_the_model_of_a_wide_one() {
    let robot = nominal();
    let small = measured(&robot, &excitation(22, 0.02), Payload::default(), 3.0, 1);
    let wide = measured(&robot, &excitation(23, 0.5), Payload::default(), 3.0, 2);
    let d = diagnose(&nominal(), &[small], &[wide], &mut |_| {}).expect("a diagnosis");
    let sentence = deltatwin_analysis::sentence::verdict(&d);
    assert_eq!(d.verdict, Verdict::None, "{sentence}");
    assert!(sentence.starts_with("The recordings fitted to do not determine"), "{sentence}");
}

/// A low-pass, a delay and the inertia of a rotor all follow the rate of the torque; see also `axes.rs`.
#[test]
#[ignore = "campaign"]
fn a_filter_of_the_torques_is_no_delay_and_no_rotor() {
    let robot = robot("torque_filter", &[&[0.004]]);
    let d = diagnosed(&[measured(&robot, &excitation(5, 0.6), Payload::default(), 3.0, 13)]);
    assert_eq!(names(&d), ["torque_filter"]);
    assert!(d.unseen.iter().any(|n| n == "payload_drag"), "without payload: {:?}", d.unseen);
}

/// While a drive moves, a gear that is better forward than backward is friction by load and a gain; at rest it is not.
#[test]
#[ignore = "campaign"]
fn friction_by_load_forward_and_backward() {
    for (name, blocks) in [
        ("gear_efficiency", &[&[0.03; 3][..], &[0.12; 3], &[100.0]][..]),
        ("gear_load_friction", &[&[0.06; 3], &[100.0], &[0.0]]),
        ("torque_gain_error", &[&[0.06, 0.0, 0.0, 0.0]]),
    ] {
        println!("-- {name}");
        let robot = robot(name, blocks);
        let moving = measured(&robot, &excitation(14, 0.5), Payload::default(), 2.0, 14);
        let standing = measured(&robot, &poses(0.2), Payload::default(), 4.0, 15);
        let d = diagnosed(&[moving, standing]);
        assert_eq!(names(&d), [name], "{:?}", d.indistinguishable);
    }
}

#[test]
#[ignore = "campaign"]
fn a_torque_constant_that_falls_is_no_wrong_gain() {
    for (name, blocks) in
        [("torque_saturation", &[&[4e-5; 3][..]][..]), ("torque_gain_error", &[&[0.06, -0.04, 0.0, 0.0]])]
    {
        println!("-- {name}");
        let d = diagnosed(&[measured(&robot(name, blocks), &excitation(16, 0.7), Payload::default(), 2.0, 16)]);
        assert!(not_misled(&d, name), "{name}: {:?} {:?}", names(&d), d.indistinguishable);
    }
}

/// A bulky payload beside the flange brakes axis 4 as well.
#[test]
#[ignore = "campaign"]
fn drag_of_the_payload_is_told_from_that_of_the_platform() {
    let payload = Payload::new(1.0, [0.15, 0.0, -0.1], 0.01);
    for (name, blocks) in [("payload_drag", &[&[0.6][..]][..]), ("air_drag", &[&[0.6]])] {
        println!("-- {name}");
        let robot = robot(name, blocks);
        let d = diagnosed(&[measured(&robot, &excitation(17, 0.8), payload, 3.0, 17)]);
        assert!(not_misled(&d, name), "{name}: {:?} {:?}", names(&d), d.indistinguishable);
        assert!(name != "payload_drag" || !d.effects.is_empty());
    }
}

/// The torque of an uneven gear grows with the square of the speed, that of torque ripple does not.
#[test]
#[ignore = "campaign"]
fn an_uneven_gear_is_no_torque_ripple() {
    let none = [0.0; 3];
    for (name, size) in [("transmission_error", [1e-4, 0.0, 5e-5]), ("torque_ripple", [0.5, 0.0, 0.4])] {
        println!("-- {name}");
        let robot = robot(name, &[&size, &none, &none, &none, &[33.0]]);
        let d = diagnosed(&[measured(&robot, &excitation(19, 0.4), Payload::default(), 2.5, 19)]);
        assert!(not_misled(&d, name), "{name}: {:?} {:?}", names(&d), d.indistinguishable);
    }
}

/// A tilted platform carries the payload askew, as a shifted payload does, and moves it, as other struts do.
#[test]
#[ignore = "campaign"]
fn a_pair_of_unequal_struts_is_no_wrong_length_and_no_shifted_payload() {
    let stated = Payload::new(2.5, [0.0, 0.0, -0.15], 0.012);
    for (name, blocks) in [
        ("strut_pair_error", &[&[0.008, -0.004, 0.0][..]][..]),
        ("strut_length_error", &[&[0.004, -0.002, 0.0]]),
        ("payload_com_offset", &[&[0.04, -0.02, 0.0]]),
        ("joint_zero_offset", &[&[0.01, -0.005, 0.0, 0.0]]),
    ] {
        println!("-- {name}");
        let d = diagnosed(&[measured(&robot(name, blocks), &excitation(20, 0.7), stated, 5.0, 20)]);
        assert!(not_misled(&d, name), "{name}: {:?} {:?}", names(&d), d.indistinguishable);
    }
}

/// Friction by load with presliding changes over an angle after a reversal, in proportion to the load there; lost motion
/// does so by the same amount everywhere.
#[test]
#[ignore = "campaign"]
fn friction_by_load_with_presliding_is_no_lost_motion() {
    let load = |h: &'static [f64]| [&[0.08; 3][..], &[100.0], h];
    let (with, without) = (load(&[4e-3]), load(&[0.0]));
    for (name, blocks, angle) in [
        ("gear_load_friction", &with[..], Some(4e-3)),
        ("gear_load_friction", &without, None),
        ("backlash_hysteresis", &[&[1.5; 3], &[4e-3]], None),
    ] {
        println!("-- {name}, {angle:?}");
        let robot = robot(name, blocks);
        let data = [
            measured(&robot, &excitation(21, 0.5), Payload::default(), 4.0, 21),
            measured(&robot, &excitation(22, 0.1), Payload::new(4.0, [0.0, 0.0, -0.08], 0.01), 6.0, 22),
        ];
        let d = diagnosed(&data);
        assert!(not_misled(&d, name), "{name}: {:?} {:?}", names(&d), d.indistinguishable);
        assert!(angle.is_none() || names(&d) == [name], "{:?}", d.indistinguishable);
        let found = d.effects.iter().find(|e| e.name == name);
        let found = found.and_then(|e| e.parameters.iter().find(|p| p.name == "presliding"));
        match (angle, found) {
            (Some(angle), Some(p)) => assert!((p.value - angle).abs() < 4.0 * p.std + 2e-5, "{p:?}"),
            (angle, found) => assert!(angle.is_none() && found.is_none(), "{found:?}"),
        }
    }
}

/// Play moves the platform where the load of a strut changes its sign, friction of the sockets brakes it everywhere, lost
/// motion of a gear where its drive reverses.
#[test]
#[ignore = "campaign"]
fn play_of_the_balls_is_no_friction_and_no_lost_motion() {
    for (name, blocks) in [
        ("ball_socket_clearance", &[&[1.5e-3, 0.5e-3, 1e-3][..], &[10.0], &[4e-3]][..]),
        ("ball_socket_load_dependent", &[&[0.3], &[0.0095], &[0.05]]),
        ("backlash_hysteresis", &[&[1.5; 3], &[4e-3]]),
    ] {
        println!("-- {name}");
        let payload = Payload::new(2.5, [0.0, 0.0, -0.08], 0.01);
        let d = diagnosed(&[measured(&robot(name, blocks), &excitation(23, 0.8), payload, 10.0, 23)]);
        assert!(not_misled(&d, name), "{name}: {:?} {:?}", names(&d), d.indistinguishable);
        assert!(name != "ball_socket_clearance" || names(&d) == [name], "{:?}", d.indistinguishable);
    }
}

/// Instants of a plan at which `sides` of the machine (one number each) change their sign, each with its side.
fn changes(plan: &Experiment, sides: &dyn Fn(&Motion) -> Vec<f64>) -> Vec<(usize, usize)> {
    let plant = plan.dataset.plant(&nominal());
    let all: Vec<Vec<f64>> = plan.dataset.joints.iter().map(|j| sides(&plant.motion(j).expect("in reach"))).collect();
    let in_one = |k: usize| plan.dataset.segments.iter().any(|s| s.contains(&k) && s.contains(&(k - 1)));
    let changed = |k: usize, i: usize| in_one(k) && all[k][i] * all[k - 1][i] < 0.0;
    let places = (1..all.len()).flat_map(|k| (0..all[k].len()).map(move |i| (k, i)));
    places.filter(|&(k, i)| changed(k, i)).collect()
}

/// Instants of `changes` with no other one within 20 ms.
fn alone(plan: &Experiment, changes: &[(usize, usize)]) -> usize {
    let near = |a: usize, b: usize| a.abs_diff(b) as f64 * plan.dataset.dt < 0.02;
    let lonely = |&(k, i): &(usize, usize)| changes.iter().all(|&(l, j)| (k, i) == (l, j) || !near(k, l));
    changes.iter().filter(|at| lonely(at)).count()
}

/// The experiments that the search proposes pass the places that show an effect: a single pair whose load changes its sign,
/// a ball whose rate does while no drive reverses.
#[test]
#[ignore = "campaign"]
fn planned_motions_tell_effects_of_struts_and_sockets_from_their_rivals() {
    let load = [&[0.05; 3][..], &[100.0], &[4e-3]];
    for (name, blocks, rival) in [
        ("ball_socket_clearance", &[&[1e-3; 3][..], &[10.0], &[4e-3]][..], "ball_socket_load_dependent"),
        ("ball_socket_coulomb", &[&[0.3], &[0.05]], "drive_viscous_asymmetry"),
        ("gear_load_friction", &load, "backlash_hysteresis"),
        ("strut_pair_error", &[&[5e-3, -3e-3, 0.0]], "strut_length_error"),
        ("strut_pair_error", &[&[5e-3, -3e-3, 0.0]], "payload_com_offset"),
    ] {
        let mut assumed = nominal();
        assumed.effects.push(ActiveEffect::new(find(name).expect("registered"), blocks));
        if rival == "strut_length_error" {
            // At its usual millimetre it is as good as invisible.
            assumed.effects.push(ActiveEffect::new(find(rival).expect("registered"), &[&[4e-3, -3e-3, 0.0]]));
        }
        let quick = Options { harmonics: 3, starts: 1, iterations: 3, ..Options::default() };
        let planned = discriminate(&assumed, [name, rival], &quick, &|| true).expect("a plan");
        let (plan, promise) = &planned.plans[0];
        let plant = plan.dataset.plant(&nominal());
        let loads = changes(plan, &|motion| {
            let lower = steady_inverse_dynamics(&plant, 0.0, motion, true).expect("a regular pose").reactions.lower;
            (0..3).map(|i| lower[2 * i] + lower[2 * i + 1]).collect()
        });
        // Rates of the upper balls about their arms' shafts, and those of the arms.
        let rates = changes(plan, &|motion| {
            let socket = |i: usize| motion.socket_rate(2 * i).dot(&motion.shaft[i]);
            (0..6).map(|i| if i < 3 { socket(i) } else { motion.qd[i - 3] }).collect()
        });
        let balls = rates.iter().filter(|(_, i)| *i < 3).count();
        println!(
            "{name} or {rival}: {}, chance {:.3}; {} single pairs, {balls} balls, {} alone",
            plan.what,
            promise.chance,
            alone(plan, &loads),
            alone(plan, &rates)
        );
        assert!(promise.chance > 0.95, "{name} or {rival}: {} {}", plan.what, promise.chance);
        assert!(name != "ball_socket_clearance" || alone(plan, &loads) > 0, "{loads:?}");
        assert!(name != "ball_socket_coulomb" || (balls > 0 && alone(plan, &rates) > 0), "{rates:?}");
    }
}

/// Next to friction of the sockets, a rotor that is no rival of the heavier limb where both are fitted.
#[test]
#[ignore = "campaign"]
fn a_heavier_limb_and_friction_of_the_sockets_are_found_together() {
    let limb = [&[0.0, 0.0, 0.3, 0.3, 0.0, 0.0][..], &[0.0; 3], &[1.106], &[0.5], &[0.384], &[0.585]];
    let mut robot = robot("limb_asymmetry", &limb);
    robot.effects.push(ActiveEffect::new(find("ball_socket_coulomb").expect("registered"), &[&[0.2], &[0.05]]));
    let data = |seed| measured(&robot, &excitation(seed, 0.5), Payload::default(), 8.0, seed);
    let d = diagnose(&nominal(), &[data(21)], &[data(22)], &mut |_| {}).expect("a diagnosis");
    assert_eq!(names(&d), ["limb_asymmetry", "ball_socket_coulomb"]);
    assert_eq!(d.verdict, Verdict::Several, "{:?}", d.indistinguishable);
}

//! Effects that a lone axis shows, told from those that look like them there.
//!
//! The answer may be a set of at most three, or nothing, but never a wrong name alone.

use std::sync::Arc;

use crate::common::model;
use crate::machines::{run, turntable};
use deltatwin::diagnosis::{Diagnosis, Verdict, diagnose};
use deltatwin::effects::formula::{Expression, Formula, Place, Term};
use deltatwin::effects::{ActiveEffect, cogging, find};
use deltatwin::gate::{Problem, examine};
use deltatwin::identification::Dataset;
use deltatwin::identification::initial::axis;
use deltatwin::machine::{Joint, Setup};
use deltatwin::model::Model;
use deltatwin::recording::{Channel, Recording, Signals};

/// What the diagnosis says of 4 s of `machine` with `hidden`.
fn told(machine: &Model, hidden: ActiveEffect, seed: u64) -> Diagnosis {
    let mut robot = machine.clone();
    robot.effects.push(hidden);
    told_of(machine, &robot, machine, seed)
}

/// What the diagnosis says of 4 s of `robot`, whose controller believes in `believed`.
fn told_of(machine: &Model, robot: &Model, believed: &Model, seed: u64) -> Diagnosis {
    let (recording, _) = run(robot, believed, &Setup::default(), 4.0, seed, true);
    let d = diagnose(machine, &[Dataset::new(&recording)], &[], &mut |_| {}).expect("a diagnosis");
    println!("{:?} {:?} sets {:?} unseen {:?}", d.verdict, names(&d), d.indistinguishable, d.unseen);
    for e in &d.effects {
        println!("  {}: {:?}", e.name, e.parameters.iter().map(|p| (&*p.name, p.value, p.std)).collect::<Vec<_>>());
    }
    d
}

fn effect(name: &str, blocks: &[&[f64]]) -> ActiveEffect {
    ActiveEffect::new(find(name).expect("registered"), blocks)
}

fn names(d: &Diagnosis) -> Vec<&str> {
    d.effects.iter().map(|e| e.name.as_str()).collect()
}

/// Asserts that a parameter of the first named effect is within `tolerance` and four standard errors of `wanted`.
fn near(d: &Diagnosis, parameter: &str, wanted: f64, tolerance: f64) {
    let p = d.effects[0].parameters.iter().find(|p| p.name == parameter).expect("a parameter");
    assert!((p.value - wanted).abs() < tolerance.min(4.0 * p.std), "{parameter} = {} ± {}", p.value, p.std);
}

/// The effect is named alone, in a set of at most three, or nothing is named.
fn not_misled(d: &Diagnosis, hidden: &str) -> bool {
    let in_a_set = d.indistinguishable.iter().any(|s| s.len() <= 3 && s.iter().any(|n| n == hidden));
    d.verdict == Verdict::Unknown || d.effects.is_empty() || names(d) == [hidden] || in_a_set
}

#[test]
#[ignore = "campaign"]
fn gravity_of_a_turning_axis_is_told_from_a_bias() {
    let table = turntable();
    let d = told(&table, effect("axis_gravity", &[&[0.6], &[-0.3]]), 41);
    assert_eq!(names(&d), ["axis_gravity"]);
    near(&d, "sine", 0.6, 0.003);
    near(&d, "cosine", -0.3, 0.003);
    let d = told(&table, effect("torque_bias", &[&[0.1]]), 42);
    assert!(not_misled(&d, "torque_bias"));
    // Without gravity no torque depends on the angle.
    assert!(d.unseen.iter().any(|n| n == "joint_zero_offset"), "{:?}", d.unseen);
}

/// Friction by load that differs between forward and backward is, while the axis moves, symmetric friction by load and
/// a gain, which the mass takes.
#[test]
#[ignore = "campaign"]
fn friction_by_load_is_a_set_of_two_on_a_lone_slide() {
    let slide = model("servo-axis");
    for (name, blocks) in [
        ("gear_efficiency", &[&[0.03][..], &[0.12], &[1900.0]][..]),
        ("gear_load_friction", &[&[0.06], &[1900.0], &[0.0]]),
    ] {
        let d = told(&slide, effect(name, blocks), 43);
        assert!(not_misled(&d, name), "{name}");
    }
    let d = told(&slide, effect("torque_gain_error", &[&[0.08]]), 43);
    assert_eq!(d.verdict, Verdict::None, "the mass takes it");
}

/// The controller compensates all friction: where it does not, the axis jolts at reversals faster than angles resolve,
/// which looks like a smaller exponent.
#[test]
#[ignore = "campaign"]
fn powers_of_the_speed_are_found_on_a_lone_slide() {
    let slide = model("servo-axis");
    for exponent in [0.5, 2.0] {
        let mut robot = slide.clone();
        robot.effects.push(effect("viscous_curve", &[&[20.0], &[exponent], &[0.3], &[0.0], &[0.527]]));
        let d = told_of(&slide, &robot, &robot, 44);
        assert_eq!(names(&d), ["viscous_curve"]);
        near(&d, "exponent", exponent, 0.2);
    }
}

/// −20 N·tanh(q̇/0.2 m/s) is no power of the speed and no root of a square.
#[test]
#[ignore = "campaign"]
fn friction_that_saturates_is_found_in_another_shape() {
    let slide = model("servo-axis");
    let law = Expression::parse("-20*tanh(qd1/0.2)").unwrap();
    let term = Term { name: "curve".into(), at: Place::named("drive1").unwrap(), law };
    let formula = Arc::new(Formula::new(vec![(term, 1.0)], false, slide.mechanism));
    let mut hidden = ActiveEffect::absent_on(formula, slide.host());
    hidden.values = vec![1.0];
    let d = told(&slide, hidden, 45);
    assert!(not_misled(&d, "viscous_curve") && !d.effects.is_empty());
}

#[test]
#[ignore = "campaign"]
fn a_filter_of_the_torques_is_told_from_a_delay_and_from_inertia() {
    let slide = model("servo-axis");
    let d = told(&slide, effect("torque_filter", &[&[0.001]]), 46);
    assert_eq!(names(&d), ["torque_filter"]);
    near(&d, "time_constant", 0.001, 1e-4);
    let d = told(&slide, effect("signal_delay", &[&[0.003]]), 46);
    assert_eq!(names(&d), ["signal_delay"]);
    let d = told(&slide, effect("rotor_inertia", &[&[1.0]]), 46);
    assert_eq!(d.verdict, Verdict::None, "the mass takes it");
}

#[test]
#[ignore = "campaign"]
fn a_torque_constant_that_falls_with_the_current_is_found_on_a_lone_turntable() {
    let d = told(&turntable(), effect("torque_saturation", &[&[4e-3]]), 47);
    assert_eq!(names(&d), ["torque_saturation"]);
    near(&d, "saturation_1", 4e-3, 1e-3);
}

/// Both repeat with the motor's turn; the torque of an uneven gear grows with the square of the speed.
#[test]
#[ignore = "campaign"]
fn an_uneven_gear_is_told_from_torque_ripple() {
    let table = turntable();
    let d = told(&table, effect("transmission_error", &[&[2e-4], &[0.0], &[0.0], &[1e-4], &[10.0]]), 48);
    assert_eq!(names(&d), ["transmission_error"]);
    near(&d, "sine_1_1", 2e-4, 2e-5);
    near(&d, "cosine_2_1", 1e-4, 2e-5);
    let d = told(&table, effect("torque_ripple", &[&[0.05], &[0.0], &[0.0], &[0.03], &[10.0]]), 48);
    assert_eq!(names(&d), ["torque_ripple"]);
}

/// Orders 5 and 3 of the motor, of 1.5 and 0.75 times the noise of 2 N, below 100 Hz at the usual speed.
#[test]
fn cogging_is_named_with_its_orders() {
    let slide = model("servo-axis");
    let mut hidden = cogging::at_orders(&[5.0, 3.0], slide.drives[0].gear_ratio, slide.host());
    hidden.values[2..6].copy_from_slice(&[3.0, 0.0, 0.0, 1.5]);
    let d = told(&slide, hidden, 51);
    assert_eq!(names(&d), ["cogging"]);
    near(&d, "sine_5", 3.0, 0.2);
    near(&d, "cosine_3", 1.5, 0.2);
    assert_eq!(d.effects[0].parameters.len(), 4, "two orders");
}

/// At 62.5 Hz, 6 s are 375 samples, without averages, and reversals are not resolved.
#[test]
fn a_slow_recording_is_answered_without_a_false_name() {
    let slide = model("servo-axis");
    for seed in [52, 53] {
        let (mut recording, _) = run(&slide, &slide, &Setup::default(), 6.0, seed, true);
        let signals = &mut recording.signals;
        let kept = |k: &usize| k.is_multiple_of(40);
        let rows: Vec<[f64; 3]> = (0..signals.len())
            .filter(kept)
            .map(|k| [signals.t[k], signals[Channel::Angle(0)][k], signals[Channel::Torque(0)][k]])
            .collect();
        *signals = Signals::of_axis(slide.mechanism.joint(), &rows);
        let d = diagnose(&slide, &[Dataset::new(&recording)], &[], &mut |_| {}).expect("a diagnosis");
        assert!(d.effects.iter().all(|e| e.confidence.probability() < 0.5), "{:?}", names(&d));
    }
}

/// A large effect is no noise: gravity of 200 times the noise is named, and nothing beside it.
#[test]
fn a_large_effect_does_not_hide_in_the_noise() {
    let table = turntable();
    let size = 200.0 * table.noise.torque[0];
    let d = told(&table, effect("axis_gravity", &[&[size], &[0.0]]), 54);
    assert_eq!(names(&d), ["axis_gravity"]);
    assert_eq!(d.verdict, Verdict::Effect, "{:?}", d.indistinguishable);
}

/// A free rotor of 5e-4 kg·m² at a constant 2π rad/s: cogging of many orders, one of them swelling and fading, and a
/// slow disturbance, so that several times the noise is left whatever is named. Semi-implicit steps of 0.1 ms, and a
/// proportional-integral controller of the speed at 1 kHz; an encoder of 15 bit.
fn rotor(seed: u64) -> Recording {
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(seed);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let orders: [(f64, f64, f64); 6] = [
        (72.0, 0.17, 0.3),
        (18.0, 0.04, 1.0),
        (24.0, 0.02, 2.0),
        (12.0, 0.015, 4.0),
        (36.0, 0.014, 0.5),
        (144.0, 0.01, 1.5),
    ];
    let step = std::f64::consts::TAU / f64::from(1 << 15);
    let (mut angle, mut rate, mut integral, mut slow) = (29.0 + normal() * 0.1, 6.0, 0.1, 0.0);
    let mut samples = Vec::new();
    for k in 0..4000 {
        let error = std::f64::consts::TAU - rate;
        integral += 4.0 * error * 1e-3;
        let torque = 0.4 * error + integral;
        slow += -0.02 * slow + 0.004 * normal();
        samples.push([f64::from(k) * 1e-3, (angle / step).round() * step, torque + 0.009 * normal()]);
        for _ in 0..10 {
            let swell = 1.0 + 0.1 * (0.37 * angle).sin();
            let cogging: f64 = orders.iter().map(|(n, a, phase)| a * (n * angle + phase).sin()).sum();
            let resisting = 0.1 + swell * cogging + slow;
            rate += (torque - resisting) / 5e-4 * 1e-4;
            angle += rate * 1e-4;
        }
    }
    let signals = Signals::of_axis(Joint::Revolute, &samples);
    Recording { name: format!("rotor {seed}"), signals, ..Recording::default() }
}

/// Incremental encoders count from anywhere; the weight tells where. The mirrored angle explains nearly as much of it.
#[test]
fn another_zero_of_a_lone_axis_is_named_with_its_remedy() {
    let mut pendulum = turntable();
    pendulum.effects.push(effect("axis_gravity", &[&[6.0], &[-3.0]]));
    let (recording, _) = run(&pendulum, &pendulum, &Setup::default(), 4.0, 43, true);
    assert!(examine(&pendulum, &Dataset::new(&recording)).iter().all(|f| !f.severe));
    for shift in [0.7, 1.5, -2.2] {
        let mut shifted = recording.clone();
        shifted.signals.get_mut(Channel::Angle(0)).unwrap().iter_mut().for_each(|q| *q += shift);
        let found = examine(&pendulum, &Dataset::new(&shifted));
        let [zero] = &found.iter().filter(|f| f.severe).collect::<Vec<_>>()[..] else { panic!("{found:?}") };
        assert_eq!(zero.problem, Problem::Zero, "{shift}");
        let (value, _) = zero.evidence.value.expect("an angle");
        assert!((value + shift).abs() < 0.02, "{value} for {shift}");
    }
}

#[test]
#[ignore = "campaign"]
fn cogging_of_a_rotor_is_named_although_more_is_left() {
    let recordings = [rotor(1), rotor(2)];
    let rotor_model = axis("rotor", &recordings, None).expect("a first model").model;
    let [data, held_out] = recordings.map(|r| [Dataset::new(&r)]);
    let d = diagnose(&rotor_model, &data, &held_out, &mut |_| {}).expect("a diagnosis");
    println!("{:?} {:?} {:?} {:?}", d.verdict, names(&d), d.rms_before, d.rms_after);
    assert_eq!(names(&d), ["cogging"]);
    for order in [72, 18] {
        assert!(d.effects[0].parameters.iter().any(|p| p.name == format!("sine_{order}")), "order {order}");
    }
    assert!(d.rms_after[0] < 0.35 * d.rms_before[0], "{:?} -> {:?}", d.rms_before, d.rms_after);
}

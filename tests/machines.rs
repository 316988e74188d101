//! Machines with independent or fewer axes: laws, and the loop from a run of the twin to a diagnosis.

use crate::common::model;
use deltatwin::comparison::compare;
use deltatwin::diagnosis::{DiagnosisError, Verdict, add, diagnose};
use deltatwin::dynamics::{Plant, Sample, in_configuration, inverse_dynamics, regressor, set_parameters};
use deltatwin::effects::{ActiveEffect, REGISTRY, Role, find};
use deltatwin::identification::{Dataset, Estimate, Fit, NoiseLevel, fit};
use deltatwin::kinematics::JointState;
use deltatwin::machine::bodies::END_EFFECTOR;
use deltatwin::machine::{
    Configuration, Mechanism, Part, Payload, PerAxis, Setup, TELESCOPE_AXIS, Unit, each, every_axis,
};
use deltatwin::model::Model;
use deltatwin::recording::{Channel, Recording, Signals};
use deltatwin::scenario::{FourierMotion, MotionLimits};
use deltatwin::twin::{Gains, Options, Report, Torque, Twin, simulate};
use deltatwin_io::{model, recording};
use nalgebra::{DVector, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

fn disassembled() -> Setup {
    Setup { configuration: Configuration::Disassembled, ..Setup::default() }
}

/// A payload beside the centre line.
fn payload() -> Setup {
    Setup { payload: Payload::new(1.5, [0.05, -0.02, -0.05], 0.01), ..Setup::default() }
}

/// The shipped slide with another joint.
pub(crate) fn turntable() -> Model {
    let slide = std::fs::read_to_string(crate::common::shipped("models/servo-axis.toml")).unwrap();
    let text = slide
        .replace("name = \"servo-axis\"", "name = \"turntable\"")
        .replace("joint = \"prismatic\"", "joint = \"revolute\"")
        .replace("mass = 12.0", "inertia = 0.02")
        .replace("gear_ratio = 314.159265", "gear_ratio = 10.0")
        .replace("max_torque = 600.0", "max_torque = 12.0")
        .replace("max_speed = 1.0", "max_speed = 30.0")
        .replace("max_acceleration = 20.0", "max_acceleration = 400.0")
        .replace("max_jerk = 1000.0", "max_jerk = 2e4")
        .replace("limits = [-0.4, 0.4]", "limits = [-6.0, 6.0]")
        .replace("torque = 2.0", "torque = 0.02")
        .replace("coulomb = 30.0", "coulomb = 0.3")
        .replace("viscous = 60.0", "viscous = 0.01")
        .replace("steepness = 1900.0", "steepness = 65.0");
    model::parse(&text, &crate::common::shipped("models/turntable.toml")).unwrap()
}

/// A small payload beside the centre line.
fn small_payload() -> Setup {
    Setup { payload: Payload::new(0.1, [0.008, -0.004, -0.01], 2e-5), ..Setup::default() }
}

/// Every kind of machine that is not the assembled robot with telescope.
fn machines() -> Vec<(Model, Setup)> {
    vec![
        (model("irb360-6-1600-disassembled"), Setup::default()),
        (model("irb360-6-1600"), disassembled()),
        (model("clavel-delta"), payload()),
        (model("clavel-delta"), disassembled()),
        (model("linear-delta"), small_payload()),
        (model("linear-delta"), disassembled()),
        (model("servo-axis"), Setup::default()),
        (turntable(), Setup::default()),
    ]
}

const HARMONICS: usize = 8;

/// One period of a random motion, `duration` s; the controller believes in `believed`.
pub(crate) fn run(
    robot: &Model,
    believed: &Model,
    setup: &Setup,
    duration: f64,
    seed: u64,
    noise: bool,
) -> (Recording, Report) {
    let plant = Plant::new(believed, setup);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let limits = MotionLimits::of(believed, 0.6);
    let options =
        Options { duration, noise_seed: noise.then_some(seed), gains: Some(Gains::of(believed)), ..Options::default() };
    if plant.assembled {
        let motion = FourierMotion::random(&plant, &limits, 1.0 / duration, HARMONICS, &mut rng);
        return simulate(robot, setup, &plant, &|t| motion.at(t), &options, &mut |_| true).expect("a feasible motion");
    }
    let motion = FourierMotion::random_axes(&plant, &limits, 1.0 / duration, HARMONICS, &mut rng);
    let desired = |t: f64| {
        let [q, qd, qdd] = motion.coordinates(t);
        JointState { q, qd, qdd }
    };
    simulate(robot, setup, &plant, &desired, &options, &mut |_| true).expect("a feasible motion")
}

/// Joints of the machine somewhere within its limits; those it does not have rest.
fn joints(plant: &Plant, rng: &mut ChaCha8Rng) -> JointState {
    let mut joints = JointState::default();
    for i in 0..plant.mechanism.axes() {
        let [low, high] = match plant.mechanism {
            Mechanism::LINEAR_DELTA => [0.05, 0.15],
            _ => [-0.35, 0.35],
        };
        joints.q[i] = rng.random_range(low..high);
        joints.qd[i] = rng.random_range(-2.0..2.0);
        joints.qdd[i] = rng.random_range(-20.0..20.0);
    }
    joints
}

/// Effects the machine can have, at up to three times their usual size.
fn with_everything(base: &Model, setup: &Setup, rng: &mut ChaCha8Rng) -> Model {
    let mut all = base.clone();
    let plant = Plant::new(base, setup);
    all.effects = REGISTRY[1..]
        .iter()
        .filter(|e| plant.has(e.acts_on()))
        .map(|e| {
            let mut active = ActiveEffect::absent_on(e.clone(), base.host());
            let entries = active.entries();
            for (value, entry) in active.values.iter_mut().zip(entries) {
                if entry.parameter.role == Role::Linear {
                    *value = entry.parameter.default * rng.random_range(0.1..1.0);
                }
            }
            active
        })
        .collect();
    all
}

/// `model` with every estimated parameter a few percent off, each arm on its own.
pub(crate) fn perturbed(model: &Model, setup: &Setup, seed: u64) -> Model {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut robot = in_configuration(model, setup);
    let values: Vec<f64> = Plant::new(&robot, setup)
        .parameters()
        .iter()
        .map(|p| if p.role == Role::Fixed { p.value } else { p.value * rng.random_range(0.9..1.1) })
        .collect();
    set_parameters(&mut robot, &values);
    robot.assembled = model.assembled;
    robot
}

/// Estimates of all parameters that differ from those of `robot` by more than `sigmas` standard errors.
fn off(fitted: &Fit, robot: &Model, setup: &Setup, sigmas: f64) -> Vec<String> {
    let truth = Plant::new(robot, setup).parameters();
    let value = |name: &str| truth.iter().find(|p| p.name == name).expect("a parameter").value;
    for p in &fitted.parameters {
        println!(
            "{:<45} {:>9.5} ± {:.5} {:<10} {:+.1} σ",
            p.name,
            p.value,
            p.std,
            p.unit,
            (p.value - value(&p.name)) / p.std
        );
    }
    let bad = |p: &&Estimate| (p.value - value(&p.name)).abs() > sigmas * p.std;
    fitted.parameters.iter().filter(bad).map(|p| p.name.clone()).collect()
}

#[test]
fn each_arm_of_a_disassembled_robot_gets_its_own_inertia_back() {
    let nominal = model("irb360-6-1600-disassembled");
    let setup = Setup::default();
    let robot = perturbed(&nominal, &setup, 1);
    let (recording, report) = run(&robot, &nominal, &setup, 10.0, 2, true);
    assert!(report.energy_error < 1e-6, "{:e}", report.energy_error);
    let dataset = Dataset::new(&recording);
    let fitted = fit(&nominal, std::slice::from_ref(&dataset), &[dataset.noise(&nominal)]).unwrap();
    assert_eq!(off(&fitted, &robot, &setup, 3.5), [""; 0]);
    let names: Vec<&str> = fitted.parameters.iter().map(|p| p.name.as_str()).collect();
    for wanted in ["arm_first_moment_x", "arm_first_moment_z", "arm_inertia_yy"] {
        for arm in 1..=3 {
            assert!(names.contains(&format!("rigid_bodies.{wanted}_{arm}").as_str()), "{names:?}");
        }
    }
    assert_eq!(names.len(), 10 + 8, "{names:?}");
    assert!(fitted.parameters.iter().all(|p| p.std < 0.1 * p.value.abs().max(0.05)), "all are determined");
    for (rms, floor) in fitted.residuals.rms.iter().zip(dataset.noise(&nominal)) {
        assert!(*rms < 1.05 * floor, "{rms} {floor}");
    }
}

#[test]
fn a_model_of_the_assembled_robot_learns_its_arms_from_a_run_of_it_taken_apart() {
    let nominal = model("irb360-6-1600");
    let setup = disassembled();
    let mut robot = perturbed(&nominal, &setup, 3);
    // Ball sockets and telescope are not there: their friction must not act.
    robot.effects.push(ActiveEffect::new(find("ball_socket_viscous").unwrap(), &[&[5.0]]));
    let (recording, _) = run(&robot, &nominal, &setup, 10.0, 4, true);
    let dataset = Dataset::new(&recording);
    let fitted = fit(&nominal, std::slice::from_ref(&dataset), &[dataset.noise(&nominal)]).unwrap();
    assert_eq!(off(&fitted, &robot, &setup, 3.5), [""; 0]);
    assert!(fitted.parameters.iter().all(|p| !p.name.contains("strut") && !p.name.contains("telescope")));
    // What was not there stays as it was, and the file goes on describing the assembled robot.
    assert!(fitted.model.assembled);
    assert_eq!(fitted.model.bodies.0[3..11], nominal.bodies.0[3..11]);
    let telescope =
        |m: &Model| m.effects.iter().find(|a| a.effect.name() == "telescope_friction").unwrap().values.clone();
    assert_eq!(telescope(&fitted.model), telescope(&nominal));
    let text = model::updated_text(nominal.source.as_ref().unwrap(), &fitted.model).unwrap();
    assert!(text.contains("[bodies.arm2]"), "{text}");
}

#[test]
fn accelerations_of_the_twin_need_the_torques_that_make_them() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for (model, setup) in machines() {
        let plant = Plant::new(&model, &setup);
        for _ in 0..20 {
            let drawn = JointState { qdd: each(0.0), ..joints(&plant, &mut rng) };
            let mut twin = Twin::new(plant.clone(), &plant.motion(&drawn).unwrap()).unwrap();
            let axes = plant.mechanism.axes();
            let torque: PerAxis<f64> =
                std::array::from_fn(
                    |i| if i < axes { 0.3 * model.drives[i].max_torque * (i as f64 - 0.7) } else { 0.0 },
                );
            let motion = twin.evaluate(&Torque::constant(torque)).unwrap().motion;
            let again = plant.motion(&JointState { qdd: motion.qdd, ..drawn }).unwrap();
            let states: Vec<&[f64]> = vec![&[]; plant.effects.len()];
            let needed = inverse_dynamics(&plant, 0.0, &again, &states, false).unwrap().tau;
            for i in every_axis() {
                let error = (needed[i] - torque[i]).abs();
                assert!(error < 1e-10 * model.drives[0].max_torque, "{} axis {i}: {error:e}", model.name);
            }
        }
    }
}

#[test]
fn regressor_times_parameters_is_inverse_dynamics_with_every_effect_on() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    for (base, setup) in machines() {
        let model = with_everything(&base, &setup, &mut rng);
        let plant = Plant::new(&model, &setup);
        let mut bare = in_configuration(&model, &setup);
        bare.effects.clear();
        let bodies = Plant::new(&bare, &setup).rigid_bodies().values.len();
        set_parameters(&mut bare, &vec![0.0; bodies]);
        let mut bare = Plant::new(&bare, &setup);
        bare.geometry = plant.geometry;
        let rigid = plant.rigid_bodies();
        let effects: Vec<&ActiveEffect> = std::iter::once(&rigid).chain(&plant.effects).collect();
        let linear = |a: &&ActiveEffect| -> Vec<f64> {
            let whole = a.effect.kind().acts_on_the_whole();
            let keep = |(v, e): (&f64, deltatwin::effects::Entry)| match e.parameter.role {
                Role::Linear if !whole => *v,
                _ => 0.0,
            };
            a.values.iter().zip(a.entries()).map(keep).collect()
        };
        let theta = DVector::from_vec(effects.iter().flat_map(linear).collect());
        let own: Vec<Vec<f64>> = effects.iter().map(|a| a.initial_state()).collect();
        let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        let channels = deltatwin::recording::Channel::of_drives(base.mechanism);
        for _ in 0..20 {
            let drawn = joints(&plant, &mut rng);
            let motion = plant.motion(&drawn).unwrap();
            let whole = inverse_dynamics(&plant, 0.0, &motion, &states[1..], true).unwrap();
            let rest = inverse_dynamics(&bare, 0.0, &motion, &[], false).unwrap();
            let rows =
                regressor(&plant, &effects, &Sample { t: 0.0, motion: &motion, loads: &whole }, &states, &channels)
                    .unwrap();
            let product = rows * &theta;
            for i in 0..channels.len() {
                let (sum, wanted) = (product[i] + rest.tau[i], whole.tau[i]);
                assert!((sum - wanted).abs() < 1e-10 * base.drives[0].max_torque, "{}: {sum} {wanted}", base.name);
            }
        }
    }
}

#[test]
fn energy_is_balanced_on_every_machine() {
    for (model, setup) in machines() {
        let (recording, report) = run(&model, &model, &setup, 2.0, 7, false);
        println!("{:<28} {:.1e} of the work, {:?}", model.name, report.energy_error, report.tracking_error);
        assert!(report.energy_error < 1e-6, "{}: {:e}", model.name, report.energy_error);
        assert_eq!(recording.signals.mechanism, model.mechanism);
        let drives = recording.signals.series().filter(|(channel, _)| channel.drive().is_some()).count();
        assert_eq!(drives, model.mechanism.axes(), "{}", model.name);
    }
}

#[test]
fn what_hangs_beside_a_fixed_flange_turns_nothing() {
    // Without a telescope the platform and its struts carry the moment about the vertical axis.
    let model = model("clavel-delta");
    let plant = Plant::new(&model, &payload());
    assert_eq!(plant.bodies[END_EFFECTOR], deltatwin::machine::Inertia::ZERO);
    let (_, report) = run(&model, &model, &payload(), 1.0, 8, false);
    assert_eq!(report.tracking_error[3], 0.0);
    // A grasped thing becomes a part of the platform: momentum is kept, the rotor stays where it is.
    let drawn = JointState { qd: [1.0, -2.0, 0.5, 0.0], ..JointState::default() };
    let mut twin = Twin::new(plant.clone(), &plant.motion(&drawn).unwrap()).unwrap();
    let inertia = deltatwin::machine::Inertia::point(0.8, Vector3::new(0.04, 0.0, -0.03));
    twin.attach(&inertia, &(Vector3::zeros(), Vector3::zeros())).unwrap();
    let (before, after) = (plant.motion(&drawn).unwrap(), twin.motion());
    assert!(after.qd[3].abs() < 1e-12 && after.qd[0].abs() < before.qd[0].abs());
    twin.detach(&inertia).unwrap();
    let moved = (plant.bodies[9].mass, twin.plant().bodies[9].mass);
    approx::assert_relative_eq!(moved.0, moved.1, epsilon = 1e-12);
}

#[test]
fn parameters_of_every_machine_come_back_within_their_standard_errors() {
    for (nominal, setup) in [(model("servo-axis"), Setup::default()), (turntable(), Setup::default())] {
        let robot = perturbed(&nominal, &setup, 9);
        let (recording, _) = run(&robot, &nominal, &setup, 10.0, 10, true);
        let dataset = Dataset::new(&recording);
        let fitted = fit(&nominal, std::slice::from_ref(&dataset), &[dataset.noise(&nominal)]).unwrap();
        assert_eq!(off(&fitted, &robot, &setup, 3.5), [""; 0], "{}", nominal.name);
        let first = &fitted.parameters[0];
        let wanted = [("rigid_bodies.mass", Unit::Kg), ("rigid_bodies.inertia", Unit::KgM2)];
        assert_eq!((first.name.as_str(), first.unit), wanted[usize::from(nominal.name == "turntable")]);
        assert!(fitted.residuals.rms[0] < 1.1 * dataset.noise(&nominal)[0], "{:?}", fitted.residuals.rms);
    }
}

#[test]
fn base_parameters_of_a_three_axis_robot_come_back() {
    let nominal = model("clavel-delta");
    let robot = perturbed(&nominal, &payload(), 11);
    let (recording, _) = run(&robot, &nominal, &payload(), 10.0, 12, true);
    let dataset = Dataset::new(&recording);
    assert_eq!(dataset.channels.len(), 3);
    let fitted = fit(&nominal, std::slice::from_ref(&dataset), &[dataset.noise(&nominal)]).unwrap();
    let truth = Plant::new(&robot, &payload()).parameters();
    let value = |name: &str| truth.iter().find(|p| p.name == name).expect("a parameter").value;
    assert!(fitted.base.len() >= 9, "{}", fitted.base.len());
    for b in &fitted.base {
        let wanted = value(&b.name) + b.others.iter().map(|(n, f)| f * value(n)).sum::<f64>();
        println!("{:<40} {:>9.5} ± {:.5} {wanted:>9.5}", b.name, b.value, b.std);
        assert!((b.value - wanted).abs() < 3.5 * b.std, "{}: {} ± {} {wanted}", b.name, b.value, b.std);
    }
}

#[test]
#[ignore = "campaign"]
fn only_effects_on_what_is_there_are_candidates() {
    for (model, setup) in machines() {
        let (recording, _) = run(&model, &model, &setup, 1.0, 13, true);
        let d = diagnose(&model, &[Dataset::new(&recording)], &[], &mut |_| {}).unwrap();
        let plant = Plant::new(&model, &setup);
        for name in d.candidates.iter().map(|c| &c.name).chain(&d.unseen) {
            assert!(plant.has(find(name).unwrap().acts_on()), "{name} on {}", model.name);
        }
        let tried = d.candidates.len() + d.unseen.len();
        assert!(tried >= 10, "{}: {:?}", model.name, d.unseen);
    }
}

#[test]
fn nothing_hidden_is_nothing_found_on_a_lone_slide() {
    let nominal = model("servo-axis");
    let robot = perturbed(&nominal, &Setup::default(), 21);
    let (recording, _) = run(&robot, &nominal, &Setup::default(), 4.0, 21, true);
    let d = diagnose(&nominal, &[Dataset::new(&recording)], &[], &mut |_| {}).unwrap();
    assert_eq!(d.verdict, Verdict::None, "{:?}", d.effects);
}

/// Every recording weighs by its own noise, and is judged by it.
#[test]
#[ignore = "campaign"]
fn recordings_of_unequal_noise_leave_their_noise() {
    let nominal = model("servo-axis");
    let robot = perturbed(&nominal, &Setup::default(), 22);
    let [quiet, loud] = [(1.0, 2.0, 22), (2.0, 18.0, 23)].map(|(factor, duration, seed)| {
        let torque_noise = Some(robot.noise.torque.map(|sigma| factor * sigma));
        let setup = Setup { torque_noise, ..Setup::default() };
        let mut recording = run(&robot, &nominal, &setup, duration, seed, true).0;
        // The noise is not stated, but estimated from each recording.
        recording.setup.torque_noise = None;
        Dataset::new(&recording)
    });
    let both = [quiet.clone(), loud.clone()];
    let d = diagnose(&nominal, &both, &[], &mut |_| {}).unwrap();
    assert_eq!(d.verdict, Verdict::None, "{:?}", d.effects);
    approx::assert_abs_diff_eq!(d.rms_after[0] / d.noise_floor[0], 1.0, epsilon = 0.03);
    let sigma = robot.noise.torque[0];
    // √((1 + 9·2²)/10) of the smaller one.
    approx::assert_relative_eq!(d.noise_floor[0], 3.7_f64.sqrt() * sigma, max_relative = 0.03);
    let std = |data: &[Dataset]| {
        let fitted = fit(&nominal, data, &NoiseLevel::of(&nominal, data).of_each).unwrap();
        fitted.parameters.iter().find(|p| p.name == "drive_friction.viscous_1").expect("friction").std
    };
    // Informations of independent recordings add; standard errors come from the scores of some thirty intervals.
    let information = |data: &[Dataset]| std(data).powi(-2);
    let [one, other] = both.each_ref().map(|t| information(std::slice::from_ref(t)));
    approx::assert_relative_eq!(information(&both), one + other, max_relative = 0.1);
    // What is held out is judged by its own noise.
    let c = compare(&d.model, &[quiet], &[loud]).unwrap();
    let held_out = c.held_out.as_ref().expect("errors");
    approx::assert_abs_diff_eq!(held_out.rms[0] / held_out.noise_floor[0], 1.0, epsilon = 0.03);
    // The smoothing error at reversals adds a twentieth to the RMS of the quiet one.
    assert!(c.worst().expect("noise").1 < 1.1, "{:?}", c.worst());
}

/// Hides `active` in a machine and returns what diagnosis and addition make of it.
fn found(nominal: &Model, setup: &Setup, active: ActiveEffect, seed: u64) -> (Vec<String>, Vec<f64>, Vec<f64>) {
    let name = active.effect.name();
    let mut robot = nominal.clone();
    robot.effects.push(active);
    let (recording, _) = run(&robot, nominal, setup, 4.0, seed, true);
    let datasets = [Dataset::new(&recording)];
    let d = diagnose(nominal, &datasets, &[], &mut |_| {}).unwrap();
    println!("{}: {:?} {:?}", nominal.name, d.verdict, d.effects);
    let addition = add(nominal, name, &datasets, &[]).unwrap();
    for (after, floor) in addition.budget.rms_after().iter().zip(&addition.budget.noise_floor) {
        assert!(*after < 1.2 * floor, "{after} {floor}");
    }
    let values = addition.fit.model.effects.iter().find(|a| a.effect.name() == name).unwrap().values.clone();
    (d.effects.iter().map(|e| e.name.clone()).collect(), values, d.rms_before)
}

#[test]
fn friction_at_low_speed_is_found_on_a_lone_slide() {
    let nominal = model("servo-axis");
    let hidden = ActiveEffect::new(find("drive_stribeck").unwrap(), &[&[8.0], &[0.02], &[1900.0]]);
    let (names, values, before) = found(&nominal, &Setup::default(), hidden, 14);
    assert_eq!(names, ["drive_stribeck"]);
    assert!(before[0] > 1.1 * nominal.noise.torque[0], "it shows: {before:?}");
    assert!((values[0] - 8.0).abs() < 1.5 && (values[1] - 0.02).abs() < 0.003, "{values:?}");
}

/// Breakaway friction, N, that falls off over `speed`, m/s.
fn stribeck(breakaway: f64, speed: f64) -> ActiveEffect {
    ActiveEffect::new(find("drive_stribeck").unwrap(), &[&[breakaway], &[speed], &[1900.0]])
}

#[test]
#[ignore = "campaign"]
fn breakaway_friction_over_a_wide_range_of_speeds_is_found_on_a_lone_slide() {
    let (names, values, _) = found(&model("servo-axis"), &Setup::default(), stribeck(20.0, 0.05), 1);
    assert_eq!(names, ["drive_stribeck"]);
    assert!((values[0] - 20.0).abs() < 0.5 && (values[1] - 0.05).abs() < 0.002, "{values:?}");
}

/// An effect of size zero has no column for its shape.
#[test]
fn a_shape_is_estimated_from_size_zero() {
    let nominal = model("servo-axis");
    let mut robot = nominal.clone();
    robot.effects.push(stribeck(20.0, 0.05));
    let (recording, _) = run(&robot, &nominal, &Setup::default(), 4.0, 2, true);
    let dataset = [Dataset::new(&recording)];
    for speed in [0.01, 0.02, 0.1] {
        let mut believed = nominal.clone();
        believed.effects.push(stribeck(0.0, speed));
        let fitted = fit(&believed, &dataset, &[nominal.noise.torque[..1].to_vec()]).unwrap();
        let wrong = off(&fitted, &robot, &Setup::default(), 4.0);
        assert!(wrong.is_empty(), "from {speed} m/s: {wrong:?}");
    }
}

/// A controller that holds its torques delays them by half the sampling period: no effect, whatever side of it the
/// estimate falls on.
#[test]
#[ignore = "campaign"]
fn a_delay_of_half_a_sample_is_the_recordings() {
    let nominal = model("servo-axis");
    let mut robot = nominal.clone();
    robot.effects.push(ActiveEffect::new(find("signal_delay").unwrap(), &[&[0.5 * nominal.sample_time]]));
    for seed in 31..35 {
        let (recording, _) = run(&robot, &nominal, &Setup::default(), 4.0, seed, true);
        let d = diagnose(&nominal, &[Dataset::new(&recording)], &[], &mut |_| {}).unwrap();
        assert_eq!(d.verdict, Verdict::None, "{seed}: {:?}", d.effects);
        assert!(d.sampling_lag.is_none_or(|late| (late - 2e-4).abs() < 2e-5), "{seed}: {:?}", d.sampling_lag);
    }
}

#[test]
#[ignore = "campaign"]
fn torque_ripple_is_found_on_a_lone_turntable() {
    let nominal = turntable();
    let hidden = ActiveEffect::new(find("torque_ripple").unwrap(), &[&[0.05], &[0.0], &[0.0], &[0.03], &[10.0]]);
    let (names, values, _) = found(&nominal, &Setup::default(), hidden, 15);
    assert_eq!(names, ["torque_ripple"]);
    assert!((values[0] - 0.05).abs() < 0.005 && (values[3] - 0.03).abs() < 0.005, "{values:?}");
}

#[test]
#[ignore = "campaign"]
fn torque_ripple_of_one_arm_is_found_on_a_robot_taken_apart() {
    let nominal = model("irb360-6-1600-disassembled");
    let zero = [0.0; 3];
    let hidden =
        ActiveEffect::new(find("torque_ripple").unwrap(), &[&[0.0, 0.5, 0.0], &zero, &zero, &[0.0, 0.3, 0.0], &[33.0]]);
    let (names, values, _) = found(&nominal, &Setup::default(), hidden, 16);
    assert_eq!(names, ["torque_ripple"]);
    assert!((values[1] - 0.5).abs() < 0.05 && values[0].abs() < 0.05, "{values:?}");
}

#[test]
#[ignore = "campaign"]
fn friction_in_the_sockets_is_found_on_a_three_axis_robot() {
    let nominal = model("clavel-delta");
    let hidden = ActiveEffect::new(find("ball_socket_coulomb").unwrap(), &[&[0.5], &[0.05]]);
    let (names, values, _) = found(&nominal, &payload(), hidden, 17);
    assert_eq!(names, ["ball_socket_coulomb"]);
    assert!((values[0] - 0.5).abs() < 0.05, "{values:?}");
}

#[test]
fn effects_on_what_is_dismounted_cannot_be_added() {
    let nominal = model("irb360-6-1600");
    let (recording, _) = run(&nominal, &nominal, &disassembled(), 1.0, 18, true);
    let refused = add(&nominal, "ball_socket_viscous", &[Dataset::new(&recording)], &[]);
    assert!(matches!(refused, Err(DiagnosisError::Missing { part, .. }) if part == Part::Linkage.describe()));
}

#[test]
fn a_recording_has_the_columns_of_its_machine() {
    let folder = tempfile::tempdir().unwrap();
    let slide = model("servo-axis");
    for (model, setup) in machines() {
        let (mut recording, _) = run(&model, &model, &setup, 0.5, 19, true);
        recording.name = "run".into();
        let axes = model.mechanism.axes();
        for name in ["run.csv", "run.mcap"] {
            let path = folder.path().join(name);
            recording::write(&recording, &path).unwrap();
            let (read, warnings) = recording::read_of(&path, None, model.mechanism).unwrap();
            assert_eq!(warnings, [""; 0], "{} {name}", model.name);
            assert_eq!((read.signals.q(), read.signals.tau()), (recording.signals.q(), recording.signals.tau()));
            assert_eq!((read.signals.mechanism, read.setup), (model.mechanism, recording.setup), "{}", model.name);
            // Without a model the columns tell how many axes there are.
            let (read, _) = recording::read(&path, None).unwrap();
            assert_eq!(read.signals.mechanism.axes(), axes, "{} {name}", model.name);
            // More axes than the machine has are left out, fewer are refused.
            let (read, warnings) = recording::read_of(&path, None, slide.mechanism).unwrap();
            assert_eq!(read.signals.mechanism, slide.mechanism);
            assert_eq!(
                warnings.iter().any(|w| w.contains("ignored: the machine has one axis")),
                axes > 1,
                "{warnings:?}"
            );
            if axes <= TELESCOPE_AXIS {
                let e = recording::read_of(&path, None, Default::default()).unwrap_err().to_string();
                assert!(e.contains(if name.ends_with("csv") { "no column `q" } else { "axis1…axis4" }), "{e}");
            }
        }
        let header = std::fs::read_to_string(folder.path().join("run.csv")).unwrap();
        let wanted = ["t,q1,tau1", "t,q1,q2,q3,tau1,tau2,tau3", "t,q1,q2,q3,q4,tau1,tau2,tau3,tau4"];
        assert!(header.starts_with(wanted[axes / 2]), "{}", &header[..40]);
    }
}

/// Exchanges the torques of two axes.
fn swap(signals: &mut Signals, a: usize, b: usize) {
    let [first, second] = [a, b].map(|i| signals[Channel::Torque(i)].to_vec());
    signals.set(Channel::Torque(a), second);
    signals.set(Channel::Torque(b), first);
}

#[test]
#[ignore = "campaign"]
fn swapped_torques_are_named_and_others_are_not() {
    for (model, setup) in machines().into_iter().filter(|(m, _)| m.mechanism.axes() > 1) {
        let (mut recording, _) = run(&model, &model, &setup, 10.0, 20, true);
        assert_eq!(deltatwin::identification::swapped(&Dataset::new(&recording)), None, "{}", model.name);
        swap(&mut recording.signals, 0, 1);
        let what = deltatwin::identification::swapped(&Dataset::new(&recording)).expect("swapped");
        assert!(what.contains("tau1 follows q2") && what.contains("tau2 follows q1"), "{}: {what}", model.name);
        swap(&mut recording.signals, 1, 2);
        let what = deltatwin::identification::swapped(&Dataset::new(&recording)).expect("turned round");
        assert!(what.contains("tau3 follows q1") && what.contains("tau2 follows q3"), "{}: {what}", model.name);
    }
}

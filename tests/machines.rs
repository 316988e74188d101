//! Machines with independent or fewer axes: the loop from a run of the twin to a diagnosis.

mod common;

use common::model;
use deltatwin::dynamics::Plant;
use deltatwin::effects::ActiveEffect;
use deltatwin::identification::{Fit, Trace, fit};
use deltatwin::model::Model;
use deltatwin::recording::{Configuration, Recording, Setup};
use deltatwin::scenario::{FourierMotion, MotionLimits};
use deltatwin::twin::{Options, Report, simulate};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

fn disassembled() -> Setup {
    Setup { configuration: Configuration::Disassembled, ..Setup::default() }
}

/// Ten seconds of a random motion of independent axes; the controller believes in `believed`.
fn run(robot: &Model, believed: &Model, setup: &Setup, seed: u64, noise: bool) -> (Recording, Report) {
    let plant = Plant::new(believed, setup);
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let motion = FourierMotion::random_axes(&plant, &MotionLimits::of(believed, 0.6), 0.1, 10, &mut rng);
    let desired = |t: f64| {
        let [q, qd, qdd] = motion.coordinates(t);
        deltatwin::kinematics::JointState { q, qd, qdd }
    };
    let options = Options { duration: 10.0, noise_seed: noise.then_some(seed), ..Options::default() };
    simulate(robot, setup, &plant, &desired, &options, &mut |_| true).expect("a feasible motion")
}

/// `model` with every estimated parameter a few percent off, each arm on its own.
fn perturbed(model: &Model, setup: &Setup, seed: u64) -> Model {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut robot = deltatwin::dynamics::in_configuration(model, setup);
    let values: Vec<f64> = Plant::new(&robot, setup)
        .parameters()
        .iter()
        .map(|p| if p.role == deltatwin::effects::Role::Fixed { p.value } else { p.value * rng.random_range(0.9..1.1) })
        .collect();
    deltatwin::dynamics::set_parameters(&mut robot, &values);
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
    let bad = |p: &&deltatwin::identification::Estimate| (p.value - value(&p.name)).abs() > sigmas * p.std;
    fitted.parameters.iter().filter(bad).map(|p| p.name.clone()).collect()
}

#[test]
fn each_arm_of_a_disassembled_robot_gets_its_own_inertia_back() {
    let nominal = model("irb360-6-1600-disassembled");
    let setup = Setup::default();
    let robot = perturbed(&nominal, &setup, 1);
    let (recording, report) = run(&robot, &nominal, &setup, 2, true);
    assert!(report.energy_error < 1e-6, "{:e}", report.energy_error);
    let trace = Trace::new(&recording);
    let fitted = fit(&nominal, std::slice::from_ref(&trace), &[trace.noise(&nominal)]).unwrap();
    assert_eq!(off(&fitted, &robot, &setup, 3.5), [""; 0]);
    let names: Vec<&str> = fitted.parameters.iter().map(|p| p.name.as_str()).collect();
    for wanted in ["arm_first_moment_x", "arm_first_moment_z", "arm_inertia_yy"] {
        for arm in 1..=3 {
            assert!(names.contains(&format!("rigid_bodies.{wanted}_{arm}").as_str()), "{names:?}");
        }
    }
    assert_eq!(names.len(), 10 + 8, "{names:?}");
    assert!(fitted.parameters.iter().all(|p| p.std < 0.1 * p.value.abs().max(0.05)), "all are determined");
    for (rms, floor) in fitted.rms.iter().zip(trace.noise(&nominal)) {
        assert!(*rms < 1.05 * floor, "{rms} {floor}");
    }
}

#[test]
fn a_model_of_the_assembled_robot_learns_its_arms_from_a_run_of_it_taken_apart() {
    let nominal = model("irb360-6-1600");
    let setup = disassembled();
    let mut robot = perturbed(&nominal, &setup, 3);
    // Ball sockets and telescope are not there: their friction must not act.
    robot.effects.push(ActiveEffect::new(deltatwin::effects::find("ball_socket_viscous").unwrap(), &[&[5.0]]));
    let (recording, _) = run(&robot, &nominal, &setup, 4, true);
    let trace = Trace::new(&recording);
    let fitted = fit(&nominal, std::slice::from_ref(&trace), &[trace.noise(&nominal)]).unwrap();
    assert_eq!(off(&fitted, &robot, &setup, 3.5), [""; 0]);
    assert!(fitted.parameters.iter().all(|p| !p.name.contains("strut") && !p.name.contains("telescope")));
    // What was not there stays as it was, and the file goes on describing the assembled robot.
    assert!(fitted.model.assembled);
    assert_eq!(fitted.model.bodies.0[3..11], nominal.bodies.0[3..11]);
    let telescope =
        |m: &Model| m.effects.iter().find(|a| a.effect.name() == "telescope_friction").unwrap().values.clone();
    assert_eq!(telescope(&fitted.model), telescope(&nominal));
    let text = deltatwin::model::write::updated_text(nominal.source.as_ref().unwrap(), &fitted.model).unwrap();
    assert!(text.contains("[bodies.arm2]"), "{text}");
}

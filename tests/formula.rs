//! Laws written in the model file: read and written, in the twin, in inverse dynamics and in identification.

use std::path::Path;

use crate::common::{payload, random_joints};
use deltatwin::diagnosis::{DiagnosisError, add};
use deltatwin::dynamics::{Plant, Sample, inverse_dynamics, regressor};
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::identification::{Dataset, fit};
use deltatwin::kinematics::JointState;
use deltatwin::machine::{Configuration, Setup};
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin::scenario::{FourierMotion, MotionLimits};
use deltatwin::twin::{Gains, Options, Torque, Twin, simulate};
use deltatwin_io::model;
use deltatwin_io::model::{full_text, updated_text};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Every place, and every kind of variable.
const LAWS: &str = r#"
[effects.formula] # ours
[[effects.formula.terms]]
name = "cable"
at = "drive1"
law = "-sin(33*q1) * tanh(50*qd1)" # measured on Monday
coefficient = 0.3 # N·m
unit = "N·m"
[[effects.formula.terms]]
name = "rotor"
at = "drive2"
law = "-qdd2"
coefficient = 0.02
[[effects.formula.terms]]
name = "guide"
at = "platform_x"
law = "-x*abs(vx) - 0.1*ax + cos(2*pi*t)"
coefficient = 4
[[effects.formula.terms]]
name = "load"
at = "drive3"
law = "-tanh(20*qd3) * abs(strut5_upper + strut6_lower)"
coefficient = 2e-3
[[effects.formula.terms]]
name = "bush"
at = "telescope"
law = "-sd*(s - 0.8)"
coefficient = 3.0
[[effects.formula.terms]]
name = "tool"
at = "drive4"
law = "-qd4*max(0, -z)"
coefficient = 0.01
"#;

fn text(stem: &str, laws: &str) -> String {
    format!("{}\n{laws}", std::fs::read_to_string(crate::common::shipped(format!("models/{stem}.toml"))).unwrap())
}

fn parse(text: &str) -> miette::Result<Model> {
    model::parse(text, Path::new("robot.toml"))
}

fn robot() -> Model {
    parse(&text("irb360-6-1600", LAWS)).unwrap_or_else(|e| panic!("{e:?}"))
}

fn formula(model: &Model) -> &ActiveEffect {
    model.effects.iter().find(|a| a.effect.name() == "formula").expect("a formula")
}

#[test]
fn a_formula_is_read() {
    let model = robot();
    let active = formula(&model);
    assert_eq!(active.values, [0.3, 0.02, 4.0, 2e-3, 3.0, 0.01]);
    let names: Vec<String> =
        Plant::new(&model, &Setup::default()).parameters().iter().map(|p| p.name.clone()).collect();
    assert!(names.contains(&"formula.cable".to_string()), "{names:?}");
    let terms = &active.effect.formula().unwrap().terms;
    assert_eq!(terms[0].law.text(), "-sin(33*q1) * tanh(50*qd1)");
    assert!(active.effect.spec().reads.reactions && active.effect.spec().reads.accelerations);
}

#[test]
fn mistakes_are_named_with_their_place() {
    for (old, new, says) in [
        ("33*q1", "33*q5", &["law =", "unknown variable `q5`; did you mean `q"][..]),
        ("sin(33*q1)", "sine(33*q1)", &["unknown function `sine`; did you mean `sin`?"]),
        ("33*q1)", "33*q1", &["expected an operator or `)`"]),
        ("\"drive1\"", "\"drive5\"", &["at = \"drive5\"", "expected one of drive1", "did you mean `drive"]),
        ("name = \"rotor\"", "name = \"cable\"", &["a name that no other term has"]),
        ("name = \"rotor\"", "name = \"a.b\"", &["expected letters, digits"]),
        ("coefficient = 4", "coefficient = \"4\"", &["found a string", "a number in N per unit of the law from"]),
        ("coefficient = 4", "coefficient = nan", &["coefficient = nan", "expected a number"]),
        ("coefficient = 4", "", &["lacks `coefficient`"]),
        ("unit = \"N·m\"", "unit = \"Nm\"", &["expected \"N·m\", the unit of a coefficient at drive1"]),
        ("name = \"guide\"", "nam = \"guide\"", &["unknown key", "did you mean `name`?"]),
        ("[effects.formula] # ours", "[effects.formula]\nempirical = 1", &["expected true or false"]),
        ("law = \"-qdd2\"", "law = 3", &["found an integer, expected an expression"]),
    ] {
        let laws = LAWS.replacen(old, new, 1);
        assert_ne!(laws, LAWS, "{old}");
        let error = parse(&text("irb360-6-1600", &laws)).map(drop).expect_err(new);
        let message = error.to_string();
        assert!(message.starts_with("robot.toml:"), "{message}");
        for part in says {
            assert!(message.contains(part), "no {part:?} in {message}");
        }
    }
    for (laws, says) in [
        ("[effects.formula]\n", "lacks `terms`"),
        ("[effects.formula]\nterms = []\n", "expected at least one term"),
        ("[effects.formula]\nterms = [1]\n", "value 1 is no table"),
        ("[effects.formula]\nterms = \"q1\"\n", "found a string, expected an array of tables"),
    ] {
        let message = parse(&text("irb360-6-1600", laws)).map(drop).unwrap_err().to_string();
        assert!(message.contains(says), "{message}");
    }
    // The very character: column 20 of line `law = "-sin(33*q5) …`.
    let wrong = text("irb360-6-1600", &LAWS.replace("33*q1", "33*q5"));
    let line = wrong[..wrong.find("33*q5").unwrap()].matches('\n').count() + 1;
    let message = parse(&wrong).map(drop).unwrap_err().to_string();
    assert!(message.starts_with(&format!("robot.toml:{line}:16:")), "{message}");
}

#[test]
fn machines_have_only_their_own_places_and_variables() {
    let term = |at: &str, law: &str| {
        format!("[[effects.formula.terms]]\nname = \"a\"\nat = \"{at}\"\nlaw = \"{law}\"\ncoefficient = 1.0\n")
    };
    for (machine, at, law, accepted) in [
        ("servo-axis", "drive1", "-tanh(10*qd1)*q1^2", true),
        ("servo-axis", "drive2", "1", false),
        ("servo-axis", "platform_z", "1", false),
        ("servo-axis", "drive1", "z", false),
        ("servo-axis", "drive1", "q2", false),
        ("clavel-delta", "drive3", "qd2*z", true),
        ("clavel-delta", "drive4", "1", false),
        ("clavel-delta", "drive1", "qd4", false),
        ("clavel-delta", "telescope", "1", false),
        ("irb360-1-1130", "telescope", "sd", true),
        ("irb360-6-1600-disassembled", "drive4", "qd4", true),
    ] {
        let read = parse(&text(machine, &term(at, law)));
        match (&read, accepted) {
            (Ok(_), true) => {}
            (Err(e), false) => assert!(e.to_string().contains("this machine has no"), "{e}"),
            _ => panic!("{machine} {at} {law}: {:?}", read.map(drop)),
        }
    }
    // On a slide the torque is a force and the angle a length: N/m for a law that is the angle itself.
    let slide = term("drive1", "q1").replace("coefficient", "unit = \"N/m\"\ncoefficient");
    assert!(parse(&text("servo-axis", &slide)).is_ok());
}

#[test]
fn writing_keeps_laws_and_comments() {
    let mut model = robot();
    let same = updated_text(model.source.as_ref().unwrap(), &model).unwrap();
    assert_eq!(same, **model.source.as_ref().unwrap());
    let place = model.effects.iter().position(|a| a.effect.name() == "formula").unwrap();
    model.effects[place].values[0] = 0.1 + 0.2;
    let changed = updated_text(model.source.as_ref().unwrap(), &model).unwrap();
    assert_eq!(
        changed,
        model.source.as_ref().unwrap().replace("coefficient = 0.3 #", "coefficient = 0.30000000000000004 #")
    );
    // A new file, and back.
    let again = parse(&full_text(&model).unwrap()).unwrap();
    assert_eq!(formula(&again).values, model.effects[place].values);
    let laws = |m: &Model| {
        formula(m).effect.formula().unwrap().terms.iter().map(|t| t.law.text().to_string()).collect::<Vec<_>>()
    };
    assert_eq!(laws(&again), laws(&model));
    // Another formula replaces all terms; none removes the table.
    let other = r#"effects.formula = { empirical = true, terms = [{ name = "a", at = "drive1", law = "q1", coefficient = 1 }] }"#;
    let bare = std::fs::read_to_string(crate::common::shipped("models/irb360-6-1600.toml")).unwrap();
    let other = parse(&format!("{other}\n{}", bare.replace("[effects.", "[effects2."))).map(drop);
    assert!(other.is_err(), "an unknown table");
    let short = r#"
[effects]
formula = { empirical = true, terms = [{ name = "a", at = "drive1", law = "q1", coefficient = 1 }] }
"#;
    let other = parse(&text("irb360-6-1600", short)).unwrap();
    assert!(formula(&other).effect.formula().unwrap().empirical);
    model.effects[place] = formula(&other).clone();
    let replaced = updated_text(model.source.as_ref().unwrap(), &model).unwrap();
    assert!(!replaced.contains("33*q1") && replaced.contains("empirical = true"), "{replaced}");
    model.effects.remove(place);
    assert!(!updated_text(model.source.as_ref().unwrap(), &model).unwrap().contains("formula"));
}

#[test]
fn the_twin_and_inverse_dynamics_agree_with_the_regressor() {
    let model = robot();
    let plant = Plant::new(&model, &payload());
    let mut bare = plant.clone();
    bare.effects.retain(|a| a.effect.name() != "formula");
    let own = formula(&model);
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let states = vec![&[][..]; plant.effects.len()];
    let mut twin_checked = 0;
    for k in 0..30 {
        let t = 0.1 * f64::from(k);
        let joints = random_joints(&plant, &mut rng);
        let motion = plant.motion(&joints).unwrap();
        let out = inverse_dynamics(&plant, t, &motion, &states, true).unwrap();
        let without = inverse_dynamics(&bare, t, &motion, &states[1..], true).unwrap();
        let channels: Vec<Channel> = Channel::TORQUES.into_iter().chain((0..6).map(Channel::StrutUpper)).collect();
        let rows = regressor(&plant, &[own], &Sample { t, motion: &motion, loads: &out }, &[&[]], &channels).unwrap();
        let product = rows * nalgebra::DVector::from_column_slice(&own.values);
        for c in 0..4 {
            let want = out.tau[c] - without.tau[c];
            assert!((product[c] - want).abs() < 1e-9 * out.tau[c].abs().max(1.0), "axis {c}: {} {want}", product[c]);
        }
        for s in 0..6 {
            let want = out.reactions.upper[s] - without.reactions.upper[s];
            assert!((product[4 + s] - want).abs() < 1e-8, "strut {s}: {} {want}", product[4 + s]);
        }
        // Forward dynamics under these torques gives the accelerations back.
        let mut twin = Twin::new(plant.clone(), &motion).unwrap();
        twin.set_time(t);
        let snapshot = twin.evaluate(&Torque::constant(out.tau)).unwrap();
        for axis in 0..4 {
            let (got, want) = (snapshot.motion.qdd[axis], joints.qdd[axis]);
            assert!((got - want).abs() < 1e-6 * want.abs().max(1.0), "axis {axis}: {got} {want}");
        }
        assert_eq!(twin.unconverged(), 0.0);
        twin_checked += 1;
    }
    assert_eq!(twin_checked, 30);
}

/// A run of `robot` along a random motion that `believed` would follow.
fn run(
    robot: &Model,
    believed: &Model,
    setup: &Setup,
    duration: f64,
    noise: bool,
) -> (deltatwin::recording::Recording, deltatwin::twin::Report) {
    let plant = Plant::new(believed, setup);
    let mut rng = ChaCha8Rng::seed_from_u64(8);
    let limits = MotionLimits::of(believed, 0.4);
    let options =
        Options { duration, noise_seed: noise.then_some(3), gains: Some(Gains::of(believed)), ..Options::default() };
    if plant.assembled {
        let motion = FourierMotion::random(&plant, &limits, 1.0 / duration, 8, &mut rng);
        return simulate(robot, setup, &plant, &|t| motion.at(t), &options, &mut |_| true).unwrap();
    }
    let motion = FourierMotion::random_axes(&plant, &limits, 1.0 / duration, 8, &mut rng);
    let desired = |t: f64| {
        let [q, qd, qdd] = motion.coordinates(t);
        JointState { q, qd, qdd }
    };
    simulate(robot, setup, &plant, &desired, &options, &mut |_| true).unwrap()
}

#[test]
#[ignore = "campaign"]
fn a_run_is_audited_and_gives_the_coefficients_back() {
    let robot = robot();
    let nominal = parse(&text("irb360-6-1600", "")).unwrap();
    let (recording, report) = run(&robot, &nominal, &payload(), 10.0, true);
    assert!(report.energy_error < 1e-6, "{:e}", report.energy_error);
    assert_eq!(report.unconverged, 0.0);
    let dataset = Dataset::new(&recording);
    let mut start = robot.clone();
    let place = start.effects.iter().position(|a| a.effect.name() == "formula").unwrap();
    // All coefficients start from nothing; inertia of a drive is no more than what the arms' inertia imitates.
    start.effects[place].values.fill(0.0);
    let fitted = fit(&start, std::slice::from_ref(&dataset), &[dataset.noise(&nominal)]).unwrap();
    for (i, name) in ["cable", "rotor", "guide", "load", "bush", "tool"].iter().enumerate() {
        let p = fitted.parameters.iter().find(|p| p.name == format!("formula.{name}")).expect(name);
        let truth = formula(&robot).values[i];
        println!("{name}: {:.4} ± {:.4}, true {truth}", p.value, p.std);
        assert!((p.value - truth).abs() < 4.0 * p.std, "{name}: {} ± {}, true {truth}", p.value, p.std);
        assert!(p.std < truth, "{name} is determined: {} ± {}", p.value, p.std);
    }
}

#[test]
fn a_lone_slide_and_a_robot_taken_apart_have_formulas_too() {
    let laws = "[[effects.formula.terms]]\nname = \"rail\"\nat = \"drive1\"\nlaw = \"-tanh(2000*qd1)*q1^2\"\ncoefficient = 300.0\n";
    let (robot, nominal) = (parse(&text("servo-axis", laws)).unwrap(), parse(&text("servo-axis", "")).unwrap());
    let (recording, report) = run(&robot, &nominal, &Setup::default(), 10.0, true);
    assert!(report.energy_error < 1e-6, "{:e}", report.energy_error);
    let dataset = Dataset::new(&recording);
    let fitted = fit(&robot, std::slice::from_ref(&dataset), &[dataset.noise(&nominal)]).unwrap();
    let p = fitted.parameters.iter().find(|p| p.name == "formula.rail").unwrap();
    assert!((p.value - 300.0).abs() < 4.0 * p.std && p.std < 30.0 && p.unit.to_string() == "N/m²", "{p:?}");
    // Taken apart, a law of the drives still acts; one of the platform rests, and so does the whole formula with it.
    let apart = Setup { configuration: Configuration::Disassembled, ..Setup::default() };
    for (at, law, acts) in [("drive1", "q1", true), ("platform_x", "1", false), ("drive1", "z", false)] {
        let laws =
            format!("[[effects.formula.terms]]\nname = \"a\"\nat = \"{at}\"\nlaw = \"{law}\"\ncoefficient = 1.0\n");
        let plant = Plant::new(&parse(&text("irb360-6-1600", &laws)).unwrap(), &apart);
        assert_eq!(plant.effects.iter().any(|a| a.effect.name() == "formula"), acts, "{at} {law}");
    }
}

#[test]
fn without_terms_there_is_nothing_to_try() {
    assert!(find("formula").unwrap().parameters().is_empty());
    let model = parse(&text("servo-axis", "")).unwrap();
    let (recording, _) = run(&model, &model, &Setup::default(), 4.0, true);
    let error = add(&model, "formula", &[Dataset::new(&recording)], &[]).map(drop).unwrap_err();
    assert!(matches!(error, DiagnosisError::NoTerms), "{error}");
}

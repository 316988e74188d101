//! Effects that a lone axis shows, told from those that look like them there.
//!
//! The answer may be a set of at most three, or nothing, but never a wrong name alone.

use crate::common::model;
use crate::machines::{run, turntable};
use deltatwin::diagnosis::{Diagnosis, Verdict, diagnose};
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::identification::Dataset;
use deltatwin::machine::Setup;
use deltatwin::model::Model;

fn hidden(machine: &Model, name: &str, blocks: &[&[f64]], seed: u64) -> Diagnosis {
    let mut robot = machine.clone();
    robot.effects.push(ActiveEffect::new(find(name).expect("registered"), blocks));
    let (recording, _) = run(&robot, machine, &Setup::default(), 4.0, seed, true);
    let d = diagnose(machine, &[Dataset::new(&recording)], &[], &mut |_| {}).expect("a diagnosis");
    println!(
        "{} {name} {blocks:?}: {:?} {:?} sets {:?} before {:?} floor {:?}",
        machine.name,
        d.verdict,
        names(&d),
        d.indistinguishable,
        d.rms_before,
        d.noise_floor
    );
    for e in &d.effects {
        println!(
            "    {} p {:.2}: {:?}",
            e.name,
            e.explained,
            e.parameters.iter().map(|p| (p.name.clone(), p.value, p.std)).collect::<Vec<_>>()
        );
    }
    for c in d.candidates.iter().take(5) {
        println!(
            "    candidate {} p {:.2} explained {:.2} padj {:.3} {:?} {:?}",
            c.name, c.probability, c.explained, c.p_adjusted, c.standing, c.untestable
        );
    }
    println!("    unseen {:?}", d.unseen);
    d
}

fn names(d: &Diagnosis) -> Vec<&str> {
    d.effects.iter().map(|e| e.name.as_str()).collect()
}

#[test]
fn explore() {
    let slide = model("servo-axis");
    let table = turntable();
    hidden(&table, "axis_gravity", &[&[0.6], &[-0.3]], 41);
    hidden(&table, "torque_bias", &[&[0.1]], 42);
    for (name, blocks) in [
        ("gear_efficiency", &[&[0.03][..], &[0.12], &[1900.0]][..]),
        ("gear_load_friction", &[&[0.06], &[1900.0]]),
        ("viscous_curve", &[&[20.0], &[0.5], &[0.005], &[0.5]]),
        ("viscous_curve", &[&[20.0], &[2.0], &[0.005], &[0.5]]),
        ("viscous_curve", &[&[20.0], &[0.0], &[0.2], &[0.5]]),
        ("torque_filter", &[&[0.002]]),
        ("torque_filter", &[&[0.008]]),
        ("signal_delay", &[&[0.003]]),
        ("rotor_inertia", &[&[1.0]]),
        ("torque_saturation", &[&[8e-7]]),
        ("torque_gain_error", &[&[0.08]]),
        ("drive_stribeck", &[&[8.0], &[0.02], &[1900.0]]),
    ] {
        hidden(&slide, name, blocks, 43);
    }
    let _ = Verdict::None;
}

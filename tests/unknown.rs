//! Laws outside the library: the diagnosis says that it knows no effect like that, where it acts, and a formula.

mod common;

use std::path::Path;

use common::model;
use deltatwin::diagnosis::{Diagnosis, Verdict, diagnose};
use deltatwin::effects::Effect;
use deltatwin::effects::formula::{Expression, Formula, Place, Term};
use deltatwin::exam::{Case, campaign_with};
use deltatwin::identification::Trace;
use deltatwin::model::Model;
use deltatwin::model::write::updated_text;

/// Name, part of the machine, and terms.
type Hidden = (&'static str, &'static str, &'static [(&'static str, &'static str)]);

const OUTSIDE: [Hidden; 16] = [
    ("cogging at 47 per rad", "drive 1", &[("drive1", "sin(47*q1+0.7)")]),
    ("spring on one arm", "drive 2", &[("drive2", "-(q2-0.3)")]),
    ("friction that grows with the angle", "drive 3", &[("drive3", "-tanh(50*qd3)*max(0,q3-0.3)")]),
    ("cubic friction of one drive", "drive 1", &[("drive1", "-qd1^3")]),
    ("magnet below the platform", "platform", &[("platform_z", "-1/(z+1.5)^2")]),
    ("lateral field", "platform", &[("platform_x", "sin(15*x)")]),
    ("sticking near a pose", "drive 2", &[("drive2", "-tanh(30*qd2)*exp(-((q2-0.4)/0.1)^2)")]),
    ("drift of one drive", "drive 1", &[("drive1", "t")]),
    ("crosstalk of two drives", "drive 3", &[("drive3", "-abs(qd1*qd2)")]),
    ("friction of axis 4 over height", "drive 4", &[("drive4", "-tanh(20*qd4)*(z+1.2)")]),
    ("hum", "drive 2", &[("drive2", "sin(2*pi*7.3*t)")]),
    ("quadratic drag of one drive", "drive 3", &[("drive3", "-qd3*abs(qd3)")]),
    ("eccentric gear", "drive 1", &[("drive1", "cos(5*q1)*qd1")]),
    ("bush of the telescope wears at one end", "telescope", &[("telescope", "-tanh(20*sd)*(s-1.0)")]),
    ("drag along x alone", "platform", &[("platform_x", "-vx*abs(vx)")]),
    ("friction with the root of a strut force", "drive 2", &[("drive2", "-tanh(50*qd2)*sqrt(abs(strut3_upper))")]),
];

/// Known physics in another shape than the library's.
const OTHERWISE: [(&str, &[(&str, &str)]); 4] = [
    (
        "drive_stribeck",
        &[
            ("drive1", "-tanh(100*qd1)*exp(-(qd1/0.2)^2)"),
            ("drive2", "-tanh(100*qd2)*exp(-(qd2/0.2)^2)"),
            ("drive3", "-tanh(100*qd3)*exp(-(qd3/0.2)^2)"),
        ],
    ),
    (
        "drive_coulomb_asymmetry",
        &[
            ("drive1", "-sqrt(qd1^2/(qd1^2+0.003))"),
            ("drive2", "sqrt(qd2^2/(qd2^2+0.003))"),
            ("drive3", "-sqrt(qd3^2/(qd3^2+0.003))"),
        ],
    ),
    (
        "air_drag",
        &[
            ("platform_x", "-vx*(vx^2+vy^2+vz^2)^0.35"),
            ("platform_y", "-vy*(vx^2+vy^2+vz^2)^0.35"),
            ("platform_z", "-vz*(vx^2+vy^2+vz^2)^0.35"),
        ],
    ),
    (
        "hose_spring",
        &[
            ("platform_x", "-x*(1+2*(x^2+y^2))"),
            ("platform_y", "-y*(1+2*(x^2+y^2))"),
            ("platform_z", "-(z+0.7)*(1+2*(x^2+y^2))"),
        ],
    ),
];

fn formula(terms: &[(&str, &str)]) -> &'static dyn Effect {
    let term = |(i, (at, law)): (usize, &(&str, &str))| {
        let law = Expression::parse(law).unwrap();
        (Term { name: format!("hidden_{i}"), at: Place::named(at).unwrap(), law }, 1.0)
    };
    Formula::new(terms.iter().enumerate().map(term).collect(), false)
}

/// Measurement and validation of a campaign with registered effects and formulas hidden.
fn measure(seed: u64, effects: &[&str], beyond: &[&'static dyn Effect]) -> [Trace; 2] {
    let nominal = model("irb360-6-1600");
    let effects = effects.iter().map(|e| e.to_string()).collect();
    let case = Case { seed, effects, ..Case::default() };
    let campaign = campaign_with(&nominal, &case, beyond, &|_, _| ()).unwrap();
    [&campaign.measurement, &campaign.validation].map(Trace::new)
}

fn study(seed: u64, effects: &[&str], beyond: &[&'static dyn Effect]) -> Diagnosis {
    let [measurement, validation] = measure(seed, effects, beyond);
    diagnose(&model("irb360-6-1600"), &[measurement], &[validation], &mut |_| ()).unwrap()
}

fn line(name: &str, d: &Diagnosis) {
    let names: Vec<&str> = d.effects.iter().map(|e| e.name.as_str()).collect();
    let found = d.unexplained.as_ref().map_or(String::new(), |u| {
        let terms: Vec<String> =
            u.terms.iter().map(|(at, law, c)| format!("{} {:.4}*{law}", at.name(), c.value)).collect();
        format!("at {}, left {:.2}, takes {:.1} %: {}", u.location, u.left, 100.0 * d.explained(), terms.join(" + "))
    });
    println!("{name:<42} {:<9} {names:?} {found}", d.verdict);
}

#[test]
fn an_unknown_law_is_located_and_written_into_the_model() {
    let (name, place, terms) = OUTSIDE[0];
    let [measurement, validation] = measure(21, &[], &[formula(terms)]);
    let alone = diagnose(&model("irb360-6-1600"), std::slice::from_ref(&measurement), &[], &mut |_| ()).unwrap();
    line("without held-out data", &alone);
    assert_eq!(alone.unexplained.expect("a formula").location, place);
    let d = diagnose(&model("irb360-6-1600"), &[measurement], &[validation], &mut |_| ()).unwrap();
    line(name, &d);
    assert_eq!(d.verdict, Verdict::Unknown);
    let found = d.unexplained.as_ref().expect("a formula");
    assert_eq!(found.location, place);
    // What is left on the drive is its noise, of whose RMS fifty thousand samples show half a percent.
    assert!(d.rms_after[0] < 1.03 * d.noise_floor[0], "{:?} {:?}", d.rms_after, d.noise_floor);
    assert!(d.explained() >= 0.6, "{}", d.explained());
    let (period, variable) = found.shape.period.expect("a wave");
    assert!((period - std::f64::consts::TAU / 47.0).abs() < 0.01 * period && variable == "q1", "{period} {variable}");
    // Ready to paste, and what `diagnose -o` writes.
    let source = std::fs::read_to_string("models/irb360-6-1600.toml").unwrap();
    let pasted = Model::parse(&format!("{source}\n{}", found.toml()), Path::new("pasted.toml")).unwrap();
    let written = updated_text(&source, &d.model).unwrap();
    let written = Model::parse(&written, Path::new("written.toml")).unwrap();
    for model in [&pasted, &written] {
        let active = model.effects.iter().find(|a| a.effect.name() == "formula").unwrap();
        assert!(active.effect.formula().unwrap().empirical);
        for (value, (.., coefficient)) in active.values.iter().zip(&found.terms) {
            assert!((value / coefficient.value - 1.0).abs() < 1e-5, "{value} {}", coefficient.value);
        }
    }
}

#[test]
#[ignore = "minutes: sixteen campaigns of 20 s"]
fn laws_outside_the_library_are_called_unknown() {
    let only = std::env::var("ONLY").unwrap_or_default();
    let (mut count, mut unknown, mut located, mut taken) = (0, 0, 0, 0);
    for (i, (name, place, terms)) in OUTSIDE.iter().enumerate().filter(|(_, (name, ..))| name.contains(&only)) {
        let d = study(500 + i as u64, &[], &[formula(terms)]);
        line(name, &d);
        count += 1;
        unknown += usize::from(d.verdict == Verdict::Unknown);
        located += usize::from(d.unexplained.as_ref().is_some_and(|u| u.location == *place));
        taken += usize::from(d.unexplained.is_some() && d.explained() >= 0.6);
    }
    println!("{unknown} of {count} unknown, {located} located, {taken} explained by 60 % and more");
    assert!(10 * unknown >= 9 * count && 10 * located >= 8 * count && 10 * taken >= 9 * count);
}

#[test]
#[ignore = "minutes: campaigns of 20 s"]
fn known_effects_are_still_named() {
    let only = std::env::var("ONLY").unwrap_or_default();
    let known = [
        "none",
        "ball_socket_viscous",
        "ball_socket_coulomb",
        "ball_socket_load_dependent",
        "drive_stribeck",
        "drive_coulomb_asymmetry",
        "thermal_friction_drift",
        "torque_ripple",
        "payload_mass_error",
        "strut_length_error",
        "base_tilt",
        "torque_gain_error",
        "signal_delay",
        "hose_spring",
        "air_drag",
        "gear_load_friction",
        "backlash_hysteresis",
        "limb_asymmetry",
    ];
    let mut wrong = Vec::new();
    for (i, name) in known.iter().enumerate().filter(|(_, name)| name.contains(&only)) {
        let hidden: Vec<&str> = if *name == "none" { Vec::new() } else { vec![name] };
        let d = study(700 + i as u64, &hidden, &[]);
        line(name, &d);
        if d.unexplained.is_some() {
            wrong.push(*name);
        }
    }
    for (i, (name, terms)) in OTHERWISE.iter().enumerate().filter(|(_, (name, _))| name.contains(&only)) {
        let d = study(800 + i as u64, &[], &[formula(terms)]);
        line(&format!("{name} in another shape"), &d);
        if d.unexplained.is_some() {
            wrong.push(*name);
        }
    }
    assert!(wrong.is_empty(), "{wrong:?}");
}

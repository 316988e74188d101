//! Model files: the shipped ones load, wrong ones are refused with line, key, value and expectation, and writing keeps
//! the user's text.

use std::path::{Path, PathBuf};

use deltatwin::effects::{self, ActiveEffect};
use deltatwin::identification::Estimate;
use deltatwin::machine::bodies::{self, ARM, BODIES, END_EFFECTOR, Inertia, PLATFORM, ROTOR, STRUT};
use deltatwin::machine::{Joint, Mechanism, Unit};
use deltatwin::model::{Added, MeshPart, Model, Provenance, summary};
use deltatwin_io::model;
use deltatwin_io::model::{fitted_text, full_text, updated_text};
use deltatwin_io::outside::Access;
use proptest::prelude::*;

const NAME: &str = "robot.toml";

fn folder() -> PathBuf {
    crate::common::shipped("models")
}

fn shipped() -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder()).unwrap().map(|f| f.unwrap().path()).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "toml"));
    files.sort();
    files
}

fn text_of(stem: &str) -> String {
    std::fs::read_to_string(folder().join(format!("{stem}.toml"))).unwrap()
}

fn nominal() -> String {
    text_of("irb360-6-1600")
}

fn parse(text: &str) -> miette::Result<Model> {
    model::parse(text, Path::new(NAME))
}

/// The message for the nominal file with `old` replaced by `new`, which must point at the line of `new`.
fn refused(old: &str, new: &str) -> String {
    refused_at(old, new, new.lines().last().unwrap())
}

/// As [`refused`], pointing at the line that contains `mark`.
fn refused_at(old: &str, new: &str, mark: &str) -> String {
    let original = nominal();
    assert!(original.contains(old), "no {old:?}");
    let text = original.replacen(old, new, 1);
    let line = text[..text.find(mark).unwrap()].matches('\n').count() + 1;
    let error = match parse(&text) {
        Ok(_) => panic!("{new:?} was accepted"),
        Err(error) => error,
    };
    let message = error.to_string();
    assert!(message.starts_with(&format!("{NAME}:{line}:")), "expected line {line}: {message}");
    // the full report shows file, place and the line itself
    let report = format!("{error:?}");
    assert!(report.contains(&format!("{NAME}:{line}:")), "{report}");
    message
}

#[track_caller]
fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "no {part:?} in: {message}");
    }
}

/// Every number of two models is alike.
#[track_caller]
fn assert_same(a: &Model, b: &Model) {
    assert_eq!(a.name, b.name);
    assert_eq!((a.mechanism, a.assembled), (b.mechanism, b.assembled));
    assert_eq!(a.geometry, b.geometry);
    assert_eq!(a.bodies, b.bodies);
    assert_eq!(format!("{:?}", a.drives), format!("{:?}", b.drives));
    assert_eq!(format!("{:?} {:?}", a.sockets, a.noise), format!("{:?} {:?}", b.sockets, b.noise));
    assert_eq!((a.gravity, a.sample_time), (b.gravity, b.sample_time));
    let effects = |m: &Model| -> Vec<(&str, Vec<f64>, Vec<String>)> {
        m.effects
            .iter()
            .map(|e| (e.effect.name(), e.values.clone(), e.entries().into_iter().map(|e| e.name).collect()))
            .collect()
    };
    assert_eq!(effects(a), effects(b));
}

#[test]
fn every_shipped_model_loads() {
    let files = shipped();
    assert!(files.len() >= 3);
    for file in files {
        let model = model::read(&file).unwrap_or_else(|e| panic!("{e:?}"));
        assert_eq!(model.name, file.file_stem().unwrap().to_str().unwrap());
        assert_eq!(model.path.as_deref(), Some(file.as_path()));
        assert_eq!(model.source.as_deref(), Some(std::fs::read_to_string(&file).unwrap().as_str()));
        for b in 0..BODIES {
            assert_eq!(deltatwin::machine::check::inconsistency(&model.bodies[b]), None);
        }
    }
}

#[test]
fn every_number_of_the_shipped_models_has_a_comment() {
    for file in shipped() {
        for line in std::fs::read_to_string(&file).unwrap().lines() {
            let number = line
                .split_once('=')
                .is_some_and(|(_, v)| v.trim_start().starts_with(|c: char| "[-0123456789".contains(c)));
            let zero = line.contains("0.0, 0.0]") && !line.contains(|c: char| ('1'..='9').contains(&c));
            assert!(!number || zero || line.contains(" # "), "{}: {line}", file.display());
        }
    }
}

#[test]
fn numbers_arrive_where_they_belong() {
    let m = parse(&nominal()).unwrap();
    assert!(m.geometry.limbs.iter().all(|limb| limb.strut_length == 1.106) && m.geometry.limbs.len() == 3);
    assert_eq!(m.geometry.flange_height, -0.0625);
    assert_eq!(m.bodies[bodies::arm(2)], Inertia::diagonal(1.6, [0.176, 0.0, 0.006], [0.100, 0.258, 0.258]));
    assert_eq!(m.bodies[bodies::strut(5)].mass, 0.179);
    assert_eq!(m.bodies[PLATFORM].mass, 1.2);
    assert_eq!(m.bodies[END_EFFECTOR], Inertia::ZERO);
    assert_eq!(m.drives[3].max_speed, 55.851);
    assert_eq!((m.drives[0].gear_ratio, m.drives[0].encoder_bits), (33.0, 15));
    assert_eq!(m.noise.torque, [0.5, 0.5, 0.5, 0.05]);
    assert_eq!(m.sample_time, 400e-6);
    let names: Vec<&str> = m.effects.iter().map(|e| e.effect.name()).collect();
    assert_eq!(names, ["drive_friction", "axis4_friction", "telescope_friction"]);
    assert_eq!(m.effects[0].values, [4.667, 4.376, 6.466, 1.727, 2.064, 1.557, 100.0]);
}

#[test]
fn disassembled_robot_needs_arms_and_rotor_only() {
    let m = parse(&text_of("irb360-6-1600-disassembled")).unwrap();
    assert!(!m.assembled);
    assert_eq!(m.bodies[ARM].tensor[(1, 1)], 0.228);
    assert_eq!(m.bodies[bodies::arm(2)].first_moment.z, 0.016);
    assert_eq!(m.bodies[ROTOR].tensor[(2, 2)], 0.003);
    assert_eq!(m.bodies[STRUT], Inertia::ZERO);
    assert_eq!(m.effects[0].values[..8], [4.201, 4.145, 5.773, 0.387, 0.281, 0.419, 0.448, 0.012]);
}

#[test]
fn a_lone_axis_is_a_mass_or_an_inertia() {
    let slide = parse(&text_of("servo-axis")).unwrap();
    assert_eq!((slide.mechanism, slide.gravity), (Mechanism::axis(Joint::Prismatic), 0.0));
    assert_eq!((slide.bodies[ARM], slide.noise.torque[0]), (Inertia::lone(12.0), 2.0));
    assert_eq!((slide.drives[0].gear_ratio, slide.geometry.arm_limits()), (314.159265, [-0.4, 0.4]));
    assert_eq!(slide.effects[0].values, [30.0, 60.0, 1900.0]);
    // 0.02 m of lead by 2¹⁷ increments.
    approx::assert_relative_eq!(slide.drives[0].encoder_step(), 0.02 / 131072.0, max_relative = 1e-8);
    let turning = text_of("servo-axis").replace("prismatic\"\n", "revolute\"\n").replace("mass =", "inertia =");
    assert_eq!(parse(&turning).unwrap().mechanism, Mechanism::axis(Joint::Revolute));
    let refused = |old: &str, new: &str| {
        let text = text_of("servo-axis");
        assert!(text.contains(old), "no {old:?}");
        parse(&text.replacen(old, new, 1)).err().unwrap_or_else(|| panic!("{new:?} was accepted")).to_string()
    };
    assert_says(&refused("joint = \"prismatic\"", "joint = \"screw\""), &[":9:9:", "screw", "\"revolute\" or"]);
    assert_says(&refused("joint = \"prismatic\"\n", ""), &["lacks `joint`"]);
    assert_says(&refused("sample_time", "gravity = 9.81\nsample_time"), &[":10:1:", "gravity", "unknown key"]);
    assert_says(&refused("mass = 12.0", "mass = -1.0"), &["[bodies.axis] mass", "kg above 0"]);
    assert_says(&refused("mass = 12.0", "inertia = 1.0"), &["inertia", "unknown key; expected one of mass"]);
    assert_says(&refused("limits = [-0.4, 0.4]", "limits = [0.4, -0.4]"), &["smallest position first"]);
    assert_says(&refused("coulomb = 30.0", "coulomb = -1.0"), &["from 0 to", " N"]);
    assert_says(&refused("viscous = 60.0", "viscous = [1.0, 2.0]"), &["array of 2", "N·s/m"]);
    assert_says(
        &refused("# Guide", "[effects.base_tilt]\ntilt = [0.0, 0.0]\n# Guide"),
        &["[effects] base_tilt", "acts on bodies under gravity, which this machine does not have"],
    );
    assert_says(&refused("[drives.axis]", "[drives.arm]"), &["[drives] arm", "unknown key"]);
}

#[test]
fn messages_about_carriages_are_about_carriages() {
    for (old, new, said) in [
        (
            "strut_length = 0.269",
            "strut_length = 0.1",
            "q·cos(inclination)| for every carriage position q within arm_limits",
        ),
        ("arm_limits = [-0.020, 0.250]", "arm_limits = [0.250, -0.020]", "the smallest position first"),
        ("arm_limits = [-0.020, 0.250]", "arm_limits = [0.020, 0.250]", "contain the home pose, carriages at 0 m"),
    ] {
        let text = text_of("linear-delta");
        assert!(text.contains(old), "no {old:?}");
        assert_says(&parse(&text.replacen(old, new, 1)).err().expect("a refusal").to_string(), &[said]);
    }
}

#[test]
fn a_delta_robot_without_telescope_describes_none() {
    let m = parse(&text_of("clavel-delta")).unwrap();
    assert_eq!(m.mechanism, Mechanism::delta(false));
    assert!(m.assembled && m.noise.torque[3] == 0.0 && m.drives[3].max_torque == 0.0);
    for (old, new, said) in [
        ("flange_height", "upper_hooke_height = 0.0\nflange_height", "unknown key"),
        ("[sockets]", "[drives.telescope]\ngear_ratio = 1.0\n[sockets]", "unknown key"),
        ("[sockets]", "[bodies.rotor]\nmass = 1.0\n[sockets]", "unknown key"),
        ("torque = [0.5, 0.5, 0.5]", "torque = [0.5, 0.5, 0.5, 0.5]", "array of 3"),
        ("[sockets]", "[effects.telescope_friction]\ncoulomb = 1.0\nviscous = 1.0\n[sockets]", "acts on the telescope"),
    ] {
        let text = text_of("clavel-delta");
        assert!(text.contains(old), "no {old:?}");
        assert_says(&parse(&text.replacen(old, new, 1)).err().expect("a refusal").to_string(), &[said]);
    }
}

#[test]
fn effects_come_in_the_order_of_the_registry() {
    let text = nominal();
    let at = text.find("# Coulomb and viscous friction of the arm").unwrap();
    let shuffled = format!("{}[effects.ball_socket_viscous]\ncoefficient = 0.1\n\n{}", &text[..at], &text[at..]);
    let m = parse(&shuffled).unwrap();
    let order: Vec<usize> =
        m.effects.iter().map(|e| effects::REGISTRY.iter().position(|r| r.name() == e.effect.name()).unwrap()).collect();
    assert_eq!(order.len(), 4);
    assert!(order.is_sorted());
}

#[test]
fn optional_parameters_take_their_defaults() {
    let text = nominal().replace("steepness = 100.0 ", "# ").replace("saturation_speed = 8.5919", "#");
    let m = parse(&text).unwrap();
    assert_eq!(m.effects[0].values[6], 100.0);
    assert_eq!(m.effects[1].values[2], 8.5919);
}

#[test]
fn misspelt_keys_are_refused_with_the_nearest_name() {
    let m = refused("arm_length =", "arm_lenght =");
    assert_says(&m, &["[geometry] arm_lenght", "did you mean `arm_length`?", "platform_radius"]);
    assert_says(&refused("gravity =", "gravitiy ="), &["gravitiy", "did you mean `gravity`?"]);
    assert_says(&refused("[sockets]", "[socket]"), &["socket", "did you mean `sockets`?"]);
    assert_says(&refused("[bodies.platform]", "[bodies.plattform]"), &["[bodies] plattform", "`platform`"]);
    assert_says(&refused("max_torque", "max_torqe"), &["[drives.arm] max_torqe", "`max_torque`"]);
    assert_says(
        &refused("first_moment = [0.176", "first_momet = [0.176"),
        &["[bodies.arm] first_momet", "`first_moment`"],
    );
    assert_says(&refused("saturating =", "saturatin ="), &["[effects.axis4_friction] saturatin", "`saturating`"]);
}

#[test]
fn unknown_effects_are_refused_with_the_nearest_name() {
    let m = refused("[effects.drive_friction]", "[effects.drive_fricton]");
    assert_says(&m, &["[effects] drive_fricton", "unknown effect", "did you mean `drive_friction`?", "axis4_friction"]);
    let m = refused("[effects.drive_friction]", "[effects.gravity_waves]");
    assert_says(&m, &["gravity_waves", "expected one of"]);
    assert!(!m.contains("did you mean"), "{m}");
}

#[test]
fn bodies_are_no_effect() {
    let m = refused("[effects.drive_friction]", "[effects.rigid_bodies]");
    assert_says(&m, &["rigid_bodies", "always present", "[bodies]"]);
}

#[test]
fn arrays_of_the_wrong_length_are_refused() {
    let m = refused("coulomb = [4.667, 4.376, 6.466]", "coulomb = [4.667, 4.376]");
    assert_says(&m, &["[effects.drive_friction] coulomb = [4.667, 4.376]", "an array of 2", "3 or 4", "N·m"]);
    assert_says(
        &refused("arm_limits = [-0.703, 1.745]", "arm_limits = [1.745]"),
        &["arm_limits = [1.745]", "array of 2"],
    );
    let m = refused("first_moment = [0.176, 0.0, 0.006]", "first_moment = [0.176, 0.0, 0.006, 1.0]");
    assert_says(&m, &["[bodies.arm] first_moment", "array of 4", "array of 3"]);
    assert_says(&refused("strut_length = 1.106", "strut_length = [1.106, 1.106]"), &["strut_length", "array of 3"]);
    assert_says(
        &refused("base_radius = 0.200", "base_radius = [0.2]"),
        &["base_radius = [0.2]", "expected a number in m"],
    );
}

#[test]
fn wrong_types_are_refused() {
    assert_says(
        &refused("base_radius = 0.200", "base_radius = \"0.2\""),
        &["base_radius = \"0.2\"", "found a string", "number in m"],
    );
    assert_says(&refused("assembled = true", "assembled = 1"), &["assembled = 1", "true or false"]);
    assert_says(&refused("name = \"irb360-6-1600\"", "name = 360"), &["name = 360", "found an integer", "a string"]);
    assert_says(
        &refused("mechanism = \"delta\"", "mechanism = \"scara\""),
        &["mechanism = \"scara\"", "expected \"delta\""],
    );
    let m = refused("coulomb = [4.667, 4.376, 6.466]", "coulomb = [4.667, true, 6.466]");
    assert_says(&m, &["coulomb", "value 2 is a boolean", "expected a number"]);
    assert_says(&refused("coulomb = [4.667, 4.376, 6.466]", "coulomb = 4.6"), &["coulomb = 4.6", "array of 3 or 4"]);
    assert_says(&refused("torque = [0.5, 0.5, 0.5, 0.05]", "torque = 0.5"), &["[noise] torque = 0.5", "array of 4"]);
}

#[test]
fn values_outside_their_range_are_refused() {
    let m = refused("coulomb = [4.667, 4.376, 6.466]", "coulomb = [4.667, -4.376, 6.466]");
    assert_says(&m, &["coulomb = [4.667, -4.376, 6.466]", "value 2 is -4.376", "from 0 to 50", "N·m"]);
    assert_says(
        &refused("saturation_speed = 8.5919", "saturation_speed = 0.01"),
        &["saturation_speed = 0.01", "0.5", "rad/s"],
    );
    assert_says(&refused("gear_ratio = 33.0", "gear_ratio = 0.0"), &["[drives.arm] gear_ratio = 0.0", "above 0"]);
    assert_says(&refused("gear_ratio = 33.0", "gear_ratio = -33.0"), &["gear_ratio = -33.0", "above 0"]);
    for bits in ["0", "33", "15.5", "-1"] {
        let m = refused("encoder_bits = 15", &format!("encoder_bits = {bits}"));
        assert_says(&m, &[&format!("encoder_bits = {bits}"), "whole number", "from 1 to 32"]);
    }
    for time in ["0.0", "-4e-4", "0", "40.0"] {
        let m = refused("sample_time = 400e-6", &format!("sample_time = {time}"));
        assert_says(&m, &[&format!("sample_time = {time}"), "in s from 0.00001 to 1"]);
    }
    assert_says(
        &refused("strut_length = 1.106", "strut_length = 1106"),
        &["strut_length = 1106", "in m", "at most 10"],
    );
    assert_says(&refused("gravity = 9.81", "gravity = -9.81"), &["gravity = -9.81", "from 0"]);
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    for bad in ["nan", "inf", "-inf", "1e999", "-nan"] {
        assert_says(
            &refused("gravity = 9.81", &format!("gravity = {bad}")),
            &["gravity", bad, "expected a number in m/s²"],
        );
        let m = refused("first_moment = [0.176, 0.0,", &format!("first_moment = [0.176, {bad},"));
        assert_says(&m, &["first_moment", bad]);
    }
}

#[test]
fn impossible_bodies_are_refused_with_the_condition() {
    assert_says(&refused("mass = 0.179", "mass = -0.179"), &["[bodies.strut] mass = -0.179", "in kg from 0"]);
    let m = refused("inertia = [0.100, 0.258, 0.258]", "inertia = [0.100, 0.258, 0.100]");
    assert_says(&m, &["[bodies.arm] inertia = [0.100, 0.258, 0.100]", "triangle inequality", "real body"]);
    let m = refused("first_moment = [0.076, 0.0, 0.0]", "first_moment = [0.176, 0.0, 0.0]");
    assert_says(&m, &["[bodies.strut] first_moment = [0.176, 0.0, 0.0]", "centre of mass outside the body", "0.98"]);
    let m = refused("inertia = [0.077, 0.077, 3.00e-5]", "inertia = [0.077, 0.077, -3.00e-5]");
    assert_says(&m, &["[bodies.telescope_lower] inertia", "negative"]);
    let m = refused_at("mass = 0.179 ", "mass = 0 ", "first_moment = [0.076");
    assert_says(&m, &["[bodies.strut] first_moment", "no mass"]);
}

#[test]
fn struts_that_do_not_reach_are_refused() {
    let m = refused("strut_length = 1.106", "strut_length = 0.6");
    assert_says(&m, &["[geometry] strut_length = 0.6", "more than 0.6520 m"]);
    let m = refused("strut_length = 1.106", "strut_length = [1.106, 1.106, 3.5]");
    assert_says(&m, &["strut_length = [1.106, 1.106, 3.5]", "home pose"]);
}

/// `text` without its `count` tables from `number` (from 0) on that begin with `header`.
fn without_tables(text: &str, header: &str, number: usize, count: usize) -> String {
    let starts: Vec<usize> = text.match_indices(header).map(|(at, _)| at).collect();
    let end = |table: usize| text[starts[table] + 1..].find("\n[").map_or(text.len(), |at| starts[table] + 2 + at);
    format!("{}{}", &text[..starts[number]], &text[end(number + count - 1)..])
}

#[test]
fn topologies_that_cannot_work_are_refused_with_their_freedoms() {
    let (par4, par2) = (text_of("par4"), text_of("par2"));
    let one_plate = without_tables(&par4, "[plate]", 0, 1).replace("part = 2", "");
    let flat = par4.replace("pair_distance = 0.1 ", "pair_distance = 1e-9 ");
    let cases: [(String, &[&str]); 7] = [
        (without_tables(&par4, "[[limbs]]", 3, 1), &["3 pairs of struts leave 1 of 4 freedoms", "expected 4 limbs"]),
        (without_tables(&par4, "[[limbs]]", 2, 2), &["expected 3 to 4 limbs"]),
        (one_plate, &["4 pairs of struts hold 3 freedoms", "1 of the drives", "expected 3 limbs"]),
        (flat, &["at the home pose q = 0", "it can tilt"]),
        (
            par4.replace("strut_length = 0.825", "strut_length = 0.3"),
            &["at the home pose q = 0", "lengths that close there"],
        ),
        (without_tables(&par2, "[coupling]", 0, 1), &["[coupling]", "the two passive limbs"]),
        (par2.replace("limbs = [3, 4]", "limbs = [2, 3]"), &["limbs = [2, 3]", "`drive = false`"]),
    ];
    for (text, parts) in cases {
        let Err(error) = parse(&text) else { panic!("{parts:?}: accepted") };
        assert_says(&error.to_string(), parts);
    }
}

#[test]
fn limits_must_be_in_order_and_contain_the_home_pose() {
    let m = refused("arm_limits = [-0.703, 1.745]", "arm_limits = [1.745, -0.703]");
    assert_says(&m, &["arm_limits = [1.745, -0.703]", "smallest angle first"]);
    assert_says(&refused("arm_limits = [-0.703, 1.745]", "arm_limits = [0.5, 1.745]"), &["home pose"]);
    assert_says(&refused("arm_limits = [-0.703, 1.745]", "arm_limits = [-40, 100]"), &["value 1 is -40", "rad"]);
    let m = refused("telescope_limits = [0.812, 1.372]", "telescope_limits = [1.372, 0.812]");
    assert_says(&m, &["telescope_limits = [1.372, 0.812]", "smallest length first"]);
    let m = refused("telescope_limits = [0.812, 1.372]", "telescope_limits = [1.0, 1.372]");
    assert_says(&m, &["telescope_limits = [1.0, 1.372]", "home pose", "0.9304 m"]);
}

#[test]
fn missing_keys_are_reported_with_their_table() {
    assert_says(
        &refused_at("arm_length = 0.500", "#", "[geometry]"),
        &["[geometry] lacks `arm_length`", "number in m"],
    );
    assert_says(
        &refused_at("saturating = 0.6672", "#", "[effects.axis4_friction]"),
        &["[effects.axis4_friction] lacks `saturating`"],
    );
    assert_says(&refused_at("gravity = 9.81", "#", "# ABB"), &["the file lacks `gravity`", "m/s²"]);
    let text = nominal();
    let without = |from: &str, to: &str| {
        let (a, b) = (text.find(from).unwrap(), text.find(to).unwrap());
        parse(&format!("{}{}", &text[..a], &text[b..])).err().unwrap().to_string()
    };
    assert_says(&without("[geometry]", "# Bodies: mass"), &[NAME, "lacks table [geometry]"]);
    assert_says(
        &without("\n[bodies.strut]", "# Frame at the ball plane"),
        &[NAME, "[bodies] lacks table [bodies.strut]"],
    );
    assert_says(&without("[drives.telescope]", "[sockets]"), &["[drives] lacks table [drives.telescope]"]);
    assert_says(&without("[sockets]", "# Standard dev"), &["lacks table [sockets]"]);
    assert_says(&parse("").err().unwrap().to_string(), &[NAME, ":1:1:", "lacks `name`"]);
}

#[test]
fn broken_toml_and_missing_files_are_reported() {
    assert_says(&refused("arm_length = 0.500", "arm_length = = 0.500"), &["not valid TOML"]);
    let m = refused("arm_length = 0.500", "arm_length = 0.500\narm_length = 0.7");
    assert_says(&m, &["not valid TOML", "duplicate"]);
    let missing = model::read(&crate::common::shipped("models/none.toml")).err().unwrap();
    assert_says(&format!("{missing:?}"), &["models/none.toml", "cannot read"]);
}

#[test]
fn one_strut_may_depart_from_the_others() {
    let text = format!(
        "{}\n[bodies.strut4]\nmass = 0.34\nfirst_moment = [0.188, 0.0, 0.0]\ninertia = [1.5e-5, 0.14, 0.14]\n",
        nominal()
    );
    let m = parse(&text).unwrap();
    assert_eq!(m.bodies[bodies::strut(3)].mass, 0.34);
    assert_eq!(m.bodies[bodies::strut(4)].mass, 0.179);
    assert_same(&parse(&updated_text(&text, &m).unwrap()).unwrap(), &m);
}

#[test]
fn meshes_are_named_and_kept() {
    let text =
        nominal() + "\n[meshes] # from the data sheet\nscale = 0.001\narm = \"cad/arm.stl\"\nbase = \"cad/base.glb\"\n";
    let mut m = parse(&text).unwrap();
    assert_eq!(m.meshes.scale, 0.001);
    assert_eq!(m.meshes.files[&MeshPart::Arm], Path::new("cad/arm.stl"));
    assert_eq!(updated_text(&text, &m).unwrap(), text);
    m.gravity = 9.8067;
    assert_eq!(parse(&updated_text(&text, &m).unwrap()).unwrap().meshes, m.meshes);
    assert_eq!(parse(&full_text(&m).unwrap()).unwrap().meshes, m.meshes);
    let refused = |line: &str| parse(&format!("{}\n[meshes]\n{line}\n", nominal())).err().unwrap().to_string();
    assert!(refused("arm = \"arm.exe\"").contains("[meshes] arm = \"arm.exe\": expected the name of a file (.stl"));
    assert!(refused("arms = \"arm.stl\"").contains("did you mean `arm`"), "{}", refused("arms = \"arm.stl\""));
    assert!(refused("scale = 0.0").contains("[meshes] scale"), "{}", refused("scale = 0.0"));
    assert!(refused("axis = \"lever.stl\"").contains("unknown key"));

    // A model that is written into another folder finds them there.
    let folder = tempfile::tempdir().unwrap();
    for name in ["models", "out"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
    }
    let file = folder.path().join("models/own.toml");
    std::fs::write(&file, &text).unwrap();
    let written = folder.path().join("out/fitted.toml");
    model::write(&model::read(&file).unwrap(), &written).unwrap();
    let again = model::read(&written).unwrap();
    assert_eq!(again.meshes.files[&MeshPart::Arm], Path::new("../models/cad/arm.stl"));
    assert_eq!(model::meshes::files(&again, Access::PROJECT).unwrap()[1].0, MeshPart::Arm);
}

#[test]
fn unchanged_models_are_written_byte_for_byte() {
    for file in shipped() {
        let model = model::read(&file).unwrap();
        let text = model.source.clone().unwrap();
        assert_eq!(updated_text(&text, &model).unwrap(), *text);
    }
}

#[test]
fn line_ends_of_other_systems_are_read_and_written() {
    for text in [nominal().replace('\n', "\r\n"), format!("\u{feff}{}", nominal())] {
        let mut m = parse(&text).unwrap();
        assert_same(&m, &parse(&nominal()).unwrap());
        m.gravity = 9.8067;
        assert_same(&parse(&updated_text(&text, &m).unwrap()).unwrap(), &m);
    }
}

#[test]
fn deeply_nested_values_are_refused() {
    let deep = format!("name = {}1{}", "[".repeat(100_000), "]".repeat(100_000));
    assert!(parse(&deep).is_err());
    assert!(parse(&format!("[{}a]", "a.".repeat(10_000))).is_err());
}

#[test]
fn changed_numbers_keep_the_rest_of_the_file() {
    let text = nominal();
    let mut m = parse(&text).unwrap();
    for b in STRUT..PLATFORM {
        m.bodies[b].mass = 0.18123456789012346;
    }
    m.effects[0].values[1] = 4.4;
    m.effects[1].values[2] = 9.25;
    m.drives[1].max_torque = 120.0;
    let new = updated_text(&text, &m).unwrap();
    assert_same(&parse(&new).unwrap(), &m);
    let changed: Vec<(&str, &str)> = text.lines().zip(new.lines()).filter(|(a, b)| a != b).collect();
    let new_lines: Vec<&str> = changed.iter().map(|(_, b)| *b).collect();
    assert_eq!(text.lines().count(), new.lines().count());
    assert_eq!(
        new_lines.iter().map(|l| l.split("  ").next().unwrap()).collect::<Vec<_>>(),
        [
            "mass = 0.18123456789012346",
            "max_torque = [132.0, 120.0, 132.0]",
            "coulomb = [4.667, 4.4, 6.466]",
            "saturation_speed = 9.25"
        ]
    );
    for (old, new) in changed {
        assert_eq!(old.split_once('#').unwrap().1, new.split_once('#').unwrap().1);
    }
}

/// Line of `text` that sets `key` in `table`.
fn line<'a>(text: &'a str, table: &str, key: &str) -> &'a str {
    let from = text.find(&format!("[{table}]\n")).unwrap();
    text[from..].lines().find(|l| l.starts_with(&format!("{key} ="))).unwrap()
}

/// Files know parameters by name.
const NO_PARAM: effects::Param = effects::Param { effect: "", block: 0, item: 0 };
const NO_RANGE: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);

fn errors(parameters: &[Estimate]) -> impl Iterator<Item = (String, f64)> {
    parameters.iter().map(|p| (p.name.clone(), p.std))
}

#[test]
fn fitted_numbers_state_their_source_and_the_others_keep_theirs() {
    let text = nominal();
    let mut m = parse(&text).unwrap();
    let estimate = |name: &str, std: f64| Estimate {
        param: NO_PARAM,
        name: name.into(),
        unit: Unit::One,
        value: 0.0,
        std,
        range: NO_RANGE,
    };
    let fitted = |recording: &str, std: f64| {
        let mut parameters: Vec<Estimate> =
            (1..=3).map(|i| estimate(&format!("drive_friction.coulomb_{i}"), std * i as f64)).collect();
        parameters.push(estimate("rigid_bodies.arm_inertia_yy", 0.00123));
        parameters.push(estimate("rigid_bodies.platform_mass", f64::INFINITY));
        parameters.push(estimate("ball_socket_coulomb.moment", 6.2e-5));
        Provenance::new("identify", "2026-11-22".into(), vec![recording.into()], errors(&parameters))
    };
    m.effects[0].values[..3].copy_from_slice(&[4.5, 4.6, 7.3]);
    m.bodies[PLATFORM].mass = 1.3;
    for arm in ARM..STRUT {
        m.bodies[arm].tensor[(1, 1)] = 0.25;
    }
    m.effects.push(ActiveEffect::new(effects::find("ball_socket_coulomb").unwrap(), &[&[0.27], &[0.05]]));
    let new = fitted_text(&text, &m, &fitted("run.csv", 0.0032)).unwrap();
    assert_same(&parse(&new).unwrap(), &m);
    let source = format!("fitted to run.csv on 2026-11-22 by deltatwin {}", env!("CARGO_PKG_VERSION"));
    let coulomb = line(&new, "effects.drive_friction", "coulomb");
    let expected = format!("# N·m; {source}: ±0.0032, ±0.0064, ±0.0096; was 4.667, 4.376, 6.466");
    assert!(coulomb.ends_with(&expected), "{coulomb}");
    assert_eq!(line(&new, "effects.drive_friction", "viscous"), line(&text, "effects.drive_friction", "viscous"));
    let mass = line(&new, "bodies.platform", "mass");
    assert!(mass.ends_with(&format!("# kg; of the whole body; {source}: not determined alone; was 1.2")), "{mass}");
    let inertia = line(&new, "bodies.arm", "inertia");
    assert!(inertia.contains(": –, ±0.0012, –; was 0.1, 0.258, 0.258; unmoved: yy: paper Table 3;"), "{inertia}");
    let moment = line(&new, "effects.ball_socket_coulomb", "moment");
    assert!(moment.ends_with(&format!("# N·m; {source}: ±6.2e-5")), "{moment}");
    // a constant of the law was not fitted
    assert!(!line(&new, "effects.ball_socket_coulomb", "regularisation").contains("fitted"));
    let above = new.split("name = ").next().unwrap();
    assert!(above.ends_with(&format!("# `identify` moved 6 numbers, {source}.\n")), "{above}");
    // another fit of the same replaces what the first one said
    m.effects[0].values[0] = 4.4;
    for arm in ARM..STRUT {
        m.bodies[arm].tensor[(1, 1)] = 0.26;
    }
    let again = fitted_text(&new, &m, &fitted("other.csv", 0.001)).unwrap();
    let inertia = line(&again, "bodies.arm", "inertia");
    assert!(inertia.contains("fitted to other.csv") && !inertia.contains("run.csv"), "{inertia}");
    assert!(inertia.contains("was 0.1, 0.25, 0.258; unmoved: yy: paper Table 3;"), "{inertia}");
    // of three numbers one moved: what was said of the other two stays
    let coulomb = line(&again, "effects.drive_friction", "coulomb");
    assert!(coulomb.contains("other.csv") && coulomb.contains(": ±0.001, –, –; was 4.5, 4.6, 7.3"), "{coulomb}");
    assert!(coulomb.contains("unmoved: fitted to run.csv"), "{coulomb}");
    assert_eq!(fitted_text(&again, &m, &fitted("third.csv", 0.1)).unwrap(), again, "nothing moved");
}

#[test]
fn comments_between_numbers_do_not_outlive_them() {
    let old = "coulomb = [4.667, 4.376, 6.466]     # N·m; paper Table 4";
    let text = nominal().replace(old, "coulomb = [\n  4.667, # measured\n  4.376,\n  6.466, # guess\n]");
    let mut m = parse(&text).unwrap();
    m.effects[0].values[..3].copy_from_slice(&[4.5, 4.6, 7.3]);
    let name = "drive_friction.coulomb_1".into();
    let parameters = [Estimate { param: NO_PARAM, name, unit: Unit::NM, value: 4.5, std: 0.1, range: NO_RANGE }];
    let provenance = Provenance::new("identify", "2026-11-22".into(), vec!["run.csv".into()], errors(&parameters));
    let new = fitted_text(&text, &m, &provenance).unwrap();
    assert_same(&parse(&new).unwrap(), &m);
    assert!(!new.contains("guess") && new.contains("; was 4.667, 4.376, 6.466"), "{new}");
    assert!(updated_text(&text, &m).unwrap().contains("guess"), "a change by hand leaves comments alone");
}

#[test]
fn effects_are_added_and_removed() {
    let text = nominal();
    let mut m = parse(&text).unwrap();
    m.effects.retain(|e| e.effect.name() != "axis4_friction");
    m.effects.push(ActiveEffect::new(effects::find("ball_socket_viscous").unwrap(), &[&[0.31]]));
    let new = updated_text(&text, &m).unwrap();
    assert_same(&parse(&new).unwrap(), &m);
    assert!(!new.contains("axis4_friction"));
    assert!(!new.contains("saturating with speed"), "the comment goes with its table");
    assert!(new.contains("\n\n# viscous friction in the 12 ball sockets"), "{new}");
    assert!(new.ends_with("[effects.ball_socket_viscous]\ncoefficient = 0.31 # N·m·s/rad\n"), "{new}");
    // everything before the effects is untouched
    let head = text.find("[effects.drive_friction]").unwrap();
    assert_eq!(&new[..head], &text[..head]);
    // and back again
    let again = updated_text(&new, &parse(&text).unwrap()).unwrap();
    assert_same(&parse(&again).unwrap(), &parse(&text).unwrap());
}

#[test]
fn effects_found_in_any_order_are_written() {
    let text = nominal();
    let mut m = parse(&text).unwrap();
    for (name, blocks) in [
        ("base_tilt", &[&[0.011, -0.02][..]][..]),
        ("ball_socket_coulomb", &[&[0.287], &[0.05]]),
        ("ball_socket_viscous", &[&[0.31]]),
    ] {
        m.effects.push(ActiveEffect::new(effects::find(name).unwrap(), blocks));
    }
    assert_same(&parse(&updated_text(&text, &m).unwrap()).unwrap(), &m);
    assert_same(&parse(&full_text(&m).unwrap()).unwrap(), &m);
}

#[test]
fn effects_are_added_to_a_file_without_any() {
    let text = nominal();
    let text = text[..text.find("# Coulomb and viscous").unwrap()].to_string();
    let mut m = parse(&text).unwrap();
    assert!(m.effects.is_empty());
    m.effects = parse(&nominal()).unwrap().effects;
    let new = updated_text(&text, &m).unwrap();
    assert!(new.starts_with(text.trim_end()));
    assert_same(&parse(&new).unwrap(), &m);
}

#[test]
fn inline_and_dotted_tables_are_edited_too() {
    let text = nominal();
    let at = text.find("# Coulomb and viscous").unwrap();
    let effects_inline = "effects = { drive_friction = { coulomb = [1, 2, 3], viscous = [1.0, 2.0, 3.0] } }\n";
    let effects_dotted = "effects.drive_friction.coulomb = [1, 2, 3]\neffects.drive_friction.viscous = [1, 2, 3]\n";
    for effects_text in [effects_inline, effects_dotted] {
        let text = format!("{effects_text}{}", &text[..at]);
        let mut m = parse(&text).unwrap();
        m.effects[0].values[0] = 1.5;
        m.effects.push(ActiveEffect::new(effects::find("ball_socket_viscous").unwrap(), &[&[0.31]]));
        let new = updated_text(&text, &m).unwrap();
        assert_same(&parse(&new).unwrap(), &m);
    }
}

#[test]
fn a_single_body_departs_from_its_group_when_written() {
    let text = nominal();
    let mut m = parse(&text).unwrap();
    m.bodies[bodies::strut(3)] = Inertia::diagonal(0.34, [0.188, 0.0, 0.0], [1.5e-5, 0.14, 0.14]);
    m.bodies[PLATFORM].tensor[(0, 1)] = 1e-4;
    m.bodies[PLATFORM].tensor[(1, 0)] = 1e-4;
    m.geometry.limbs[1].strut_length = 1.1061;
    let new = updated_text(&text, &m).unwrap();
    assert!(new.contains("[bodies.strut4]"));
    assert_same(&parse(&new).unwrap(), &m);
}

#[test]
fn generated_files_hold_every_number() {
    for file in shipped() {
        let model = model::read(&file).unwrap();
        let text = full_text(&model).unwrap();
        assert_same(&parse(&text).unwrap_or_else(|e| panic!("{e:?}\n{text}")), &model);
        let comment = match model.mechanism {
            Mechanism::LINEAR_DELTA => "# m; centre line to the ball line of a carriage",
            machine if !machine.is_delta() && machine.limbs() > 1 => "# m; centre line to the shaft",
            Mechanism::Delta { .. } => "# m; centre line to motor shaft",
            Mechanism::Axis(_) => "# kg; of all that moves",
        };
        assert!(text.contains(comment), "{text}");
    }
}

#[test]
fn the_history_of_a_model_is_kept_and_grows() {
    let added = |effect: &str, rms: f64| Added {
        effect: effect.into(),
        channels: vec!["tau1".into(), "strut1_upper".into()],
        rms_before: vec![rms, 14.272],
        rms_after: vec![0.5 * rms, 0.5],
        noise_floor: vec![0.4, 0.498],
        held_out: true,
    };
    let text = nominal();
    let mut m = parse(&text).unwrap();
    assert!(m.history.is_empty());
    m.history.push(added("ball_socket_coulomb", 1.2366));
    let first = updated_text(&text, &m).unwrap();
    assert!(first.starts_with(text.trim_end()), "what was there stays");
    assert_eq!(parse(&first).unwrap().history, m.history);
    m.history.push(added("base_tilt", 0.618));
    let second = updated_text(&first, &m).unwrap();
    assert!(second.starts_with(first.trim_end()));
    assert_eq!(parse(&second).unwrap().history, m.history);
    assert_eq!(updated_text(&second, &m).unwrap(), second);
    m.history.remove(0);
    assert_eq!(parse(&updated_text(&second, &m).unwrap()).unwrap().history, m.history);
    assert!(parse(&full_text(&m).unwrap()).unwrap().history == m.history);
    for (from, to, expected) in [
        ("rms_after = [", "rms_afer = [", "[history] rms_afer: unknown key"),
        ("held_out = true", "held_out = 1", "[history] held_out = 1: found an integer, expected true or false"),
        ("noise_floor = [0.4, 0.498]", "noise_floor = [0.4]", "[history] noise_floor = [0.4]: found an array of 1"),
        ("effect = \"ball_socket_coulomb\"\n", "", "[history] lacks `effect`"),
    ] {
        assert!(first.contains(from), "{from}");
        let message = parse(&first.replace(from, to)).err().unwrap().to_string();
        assert!(message.contains(expected), "{message}");
    }
    assert!(parse(&format!("history = 3\n{text}")).err().unwrap().to_string().contains("tables [[history]]"));
}

#[test]
fn values_that_would_be_refused_are_not_written() {
    let text = nominal();
    let mut m = parse(&text).unwrap();
    m.effects[0].values[0] = -1.0;
    let error = format!("{:?}", updated_text(&text, &m).unwrap_err());
    assert_says(&error, &["coulomb", "-1", "from 0"]);
    m.effects[0].values[0] = f64::NAN;
    assert!(updated_text(&text, &m).is_err());
}

#[test]
fn models_are_written_beside_and_renamed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mine.toml");
    let mut m = parse(&nominal()).unwrap();
    m.gravity = 9.8067;
    deltatwin_io::model::write(&m, &path).unwrap();
    let again = model::read(&path).unwrap();
    assert_same(&again, &m);
    assert!(again.source.unwrap().contains("gravity = 9.8067                      # m/s², along −z"));
    m.source = None;
    deltatwin_io::model::write(&m, &path).unwrap();
    assert_same(&model::read(&path).unwrap(), &m);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file stays");
    let error = format!("{:?}", deltatwin_io::model::write(&m, &folder.path().join("none/mine.toml")).unwrap_err());
    assert_says(&error, &["cannot be written", "mine.toml"]);
}

#[test]
fn check_describes_the_machine() {
    let text = summary(&model::read(&folder().join("irb360-6-1600.toml")).unwrap());
    assert_says(
        &text,
        &[
            "irb360-6-1600",
            "delta",
            "14 bodies",
            "10 freedoms",
            "1.2309 m below the mounting plane",
            "telescope 0.9304 m",
            "drive_friction, axis4_friction, telescope_friction",
            "eigenvalue",
        ],
    );
    let text = summary(&model::read(&folder().join("irb360-6-1600-disassembled.toml")).unwrap());
    assert_says(&text, &["disassembled", "4 bodies", "4 freedoms"]);
    let text = summary(&model::read(&folder().join("clavel-delta.toml")).unwrap());
    assert_says(&text, &["without telescope, assembled", "10 bodies", "9 freedoms (3 driven"]);
    let text = summary(&model::read(&folder().join("servo-axis.toml")).unwrap());
    assert_says(&text, &["servo-axis: a single prismatic axis; effects: drive_friction."]);
    assert!(model::read(&folder().join("none.toml")).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn damaged_files_never_panic(at in 0usize..6000, cut in 0usize..40, insert in "[\\[\\]={}\"'.,0-9a-z#\n -]{0,6}") {
        let text: Vec<char> = nominal().chars().collect();
        let at = at.min(text.len());
        let end = (at + cut).min(text.len());
        let damaged: String = text[..at].iter().chain(&insert.chars().collect::<Vec<_>>()).chain(&text[end..]).collect();
        match parse(&damaged) {
            Err(e) => { let _ = format!("{e:?}"); }
            Ok(m) => {
                let again = updated_text(&damaged, &m).unwrap();
                assert_same(&parse(&again).unwrap(), &m);
                prop_assert_eq!(again, damaged);
            }
        }
    }

    #[test]
    fn arbitrary_text_never_panics(text in "(\\PC|\n){0,200}") {
        if let Err(e) = parse(&text) {
            let _ = format!("{e:?}");
        }
    }

    #[test]
    fn any_number_survives_writing(mass in 0.5f64..10.0, coulomb in 0.0f64..50.0, exponent in -12i32..0) {
        let text = nominal();
        let mut m = parse(&text).unwrap();
        m.bodies[PLATFORM].mass = mass;
        m.effects[0].values[2] = coulomb * 10f64.powi(exponent);
        let again = parse(&updated_text(&text, &m).unwrap()).unwrap();
        assert_same(&again, &m);
    }
}

//! Recordings as drive software, spreadsheets and scripts write them, and first models from them.

use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use deltatwin::machine::{Effort, Joint, Mechanism};
use deltatwin::recording::{Recording, Signals};
use deltatwin_io::recording::{self, Mapping, Reading};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};
use tempfile::TempDir;

use crate::common;

/// Inertia (kg·m²), Coulomb (N·m) and viscous friction (N·m·s/rad) of the bench, and the noise of its torque (N·m).
const TRUTH: [f64; 4] = [0.02, 0.3, 0.05, 0.01];
/// Sampling period, s.
const PERIOD: f64 = 1e-3;
/// Encoder step, rad: 2^16 per turn.
const STEP: f64 = std::f64::consts::TAU / 65536.0;

/// Eight seconds of a bench: time, angle and torque.
fn bench(seed: u64) -> Vec<[f64; 3]> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let noise = Normal::new(0.0, TRUTH[3]).expect("a width");
    let waves = [(0.9, 2.3, 0.1), (0.3, 7.1, 1.0), (0.05, 23.0, 2.0)];
    let row = |k: u32| {
        let t = f64::from(k) * PERIOD;
        let sum = |of: &dyn Fn(f64, f64, f64) -> f64| waves.iter().map(|(a, w, p)| of(*a, *w, w * t + p)).sum::<f64>();
        let [q, qd, qdd] =
            [sum(&|a, _, x| a * x.sin()), sum(&|a, w, x| a * w * x.cos()), sum(&|a, w, x| -a * w * w * x.sin())];
        let torque = TRUTH[0] * qdd + TRUTH[1] * (300.0 * qd).tanh() + TRUTH[2] * qd + noise.sample(&mut rng);
        [t, (q / STEP).round() * STEP, torque]
    };
    (0..8000).map(row).collect()
}

/// The rows as text: every number by `number`, cells between `separator`.
fn rows(data: &[[f64; 3]], separator: &str, number: impl Fn(usize, f64) -> String) -> String {
    let line = |row: &[f64; 3]| {
        let cells: Vec<String> = row.iter().enumerate().map(|(i, x)| number(i, *x)).collect();
        cells.join(separator) + "\r\n"
    };
    data.iter().map(line).collect()
}

fn comma(text: String) -> String {
    text.replace('.', ",")
}

fn read(file: &Path, how: &Reading) -> (Signals, String) {
    let (recording, warnings) = recording::read_as(file, how).unwrap_or_else(|e| panic!("{e}"));
    (recording.signals, warnings.join("\n"))
}

/// Asserts that the file holds the rows, to the digits written.
fn same(file: &Path, how: &Reading, data: &[[f64; 3]]) -> String {
    let (signals, warnings) = read(file, how);
    assert_eq!(signals.len(), data.len(), "{}", file.display());
    for (k, [t, q, torque]) in data.iter().enumerate() {
        let found = [signals.t[k] - signals.t[0], signals.q().at(k)[0], signals.tau().at(k)[0]];
        for (a, b) in found.iter().zip([t, q, torque]) {
            assert!((a - b).abs() < 2e-6, "{}, row {k}: {found:?}", file.display());
        }
    }
    warnings
}

#[test]
fn tables_of_every_form_are_the_same_recording() {
    let folder = TempDir::new().unwrap();
    let data = bench(1);
    let plain = Reading::default();
    let write = |name: &str, bytes: &[u8]| -> PathBuf {
        let file = folder.path().join(name);
        std::fs::write(&file, bytes).unwrap();
        file
    };
    let degrees = |i: usize, x: f64| if i == 1 { format!("{:.6}", x.to_degrees()) } else { format!("{x:.6}") };

    // Drive software: lines of its own, names, a row of units, decimal commas, UTF-16.
    let scope = format!(
        "Name;Project 7\r\nFile;C:\\scope.svdx\r\nStartTime;01/02/2024 12:30:01\r\n\r\nTime;Axis 1.ActPos;Axis 1.ActTorque\r\ns;deg;Nm\r\n{}",
        rows(&data, ";", |i, x| comma(degrees(i, x)))
    );
    let wide: Vec<u8> = [0xff, 0xfe].into_iter().chain(scope.encode_utf16().flat_map(u16::to_le_bytes)).collect();
    let said = same(&write("scope.csv", &wide), &plain, &data);
    for part in ["UTF-16", "3 line(s) above", "units from the line below", "`Axis 1.ActPos [deg]`"] {
        assert!(said.contains(part), "{part}: {said}");
    }

    // A spreadsheet in Latin-1, whose degree sign is the byte b0.
    let sheet = format!("Zeit [ms];Winkel [°];Drehmoment [Nm]\r\n{}", {
        rows(&data, ";", |i, x| comma(if i == 0 { format!("{:.3}", 1e3 * x) } else { degrees(i, x) }))
    });
    let latin: Vec<u8> = sheet.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
    assert!(same(&write("sheet.csv", &latin), &plain, &data).contains("Latin-1"));

    // A script that aligns columns with spaces, under a comment; another comment among the numbers.
    let mut script =
        format!("# bench 3, run 12\n#   t   q1   tau1\n{}", rows(&data, "   ", |_, x| format!("{x:>12.6}")));
    script.insert_str(script.len() / 2 + script[script.len() / 2..].find('\n').unwrap() + 1, "% paused\n");
    same(&write("script.txt", script.as_bytes()), &plain, &data);

    // UTF-8 with a mark, tabs, units in parentheses.
    let tabs =
        format!("\u{feff}time (s)\tposition (rad)\teffort (Nm)\n{}", rows(&data, "\t", |_, x| format!("{x:.7}")));
    same(&write("tabs.csv", tabs.as_bytes()), &plain, &data);

    // Numbers alone, and without time.
    let maps: Vec<Mapping> = vec!["t=column1, q1=column2, tau1=column3".parse().unwrap()];
    let bare = write("bare.csv", rows(&data, ",", |_, x| format!("{x:.7}")).as_bytes());
    let said = same(&bare, &Reading { maps: &maps, ..plain }, &data);
    assert!(said.contains("column1 … column3"), "{said}");
    let timeless: Vec<String> = data.iter().map(|[_, q, torque]| format!("{q:.7};{torque:.7}")).collect();
    let timeless = write("timeless.csv", format!("Position;Torque\n{}\n", timeless.join("\n")).as_bytes());
    same(&timeless, &Reading { rate: Some(1000.0), ..plain }, &data);
    let refused = recording::read_as(&timeless, &plain).unwrap_err().to_string();
    assert!(refused.contains("`t`") && refused.contains("--rate HZ"), "{refused}");
}

#[test]
fn a_missing_column_of_a_map_lists_those_that_are_there() {
    let folder = TempDir::new().unwrap();
    let file = folder.path().join("run.csv");
    std::fs::write(&file, format!("Zeit;Lage;Strom\n{}", rows(&bench(2), ";", |_, x| comma(format!("{x:.6}")))))
        .unwrap();
    let maps: Vec<Mapping> = vec!["tau1=Iq[A]*0.12".parse().unwrap()];
    let refused = recording::read_as(&file, &Reading { maps: &maps, ..Reading::default() }).unwrap_err().to_string();
    assert!(refused.contains("`Iq`") && refused.contains("Zeit, Lage, Strom"), "{refused}");
}

#[test]
fn the_motors_side_is_referred_to_the_joint() {
    let folder = TempDir::new().unwrap();
    let data = bench(3);
    let file = folder.path().join("motor.csv");
    let of_motor = |i: usize, x: f64| format!("{:.9}", [x, 50.0 * x, x / 50.0][i]);
    std::fs::write(&file, format!("t,motor_position,motor_torque\n{}", rows(&data, ",", of_motor))).unwrap();
    let said = same(&file, &Reading { gear_ratio: Some(50.0), ..Reading::default() }, &data);
    assert!(said.contains("gear of 50"), "{said}");
}

#[test]
fn a_lone_current_is_read_in_ampere_and_stays_so() {
    let folder = TempDir::new().unwrap();
    let data = bench(4);
    let file = folder.path().join("current.csv");
    std::fs::write(&file, format!("Time, Position, Iq\n{}", rows(&data, ", ", |_, x| format!("{x:.7}")))).unwrap();
    let said = same(&file, &Reading::default(), &data);
    assert!(said.contains("per torque constant"), "{said}");
    let (recording, _) = recording::read(&file, None).unwrap();
    let in_ampere = |r: &Recording| r.signals.mechanism.effort() == Effort::Current;
    assert!(in_ampere(&recording));
    for name in ["kept.csv", "kept.mcap"] {
        let kept = folder.path().join(name);
        recording::write(&recording, &kept).unwrap();
        let (again, _) = recording::read(&kept, None).unwrap();
        assert_eq!(again.signals.mechanism, recording.signals.mechanism, "{name}");
        assert_eq!(again.signals.tau(), recording.signals.tau(), "{name}");
        // Without a factor it is not the torque of a model in N·m.
        let refused = recording::read_of(&kept, None, Mechanism::axis(Joint::Revolute)).unwrap_err().to_string();
        assert!(refused.contains('A') && refused.contains("expected"), "{refused}");
    }
    let maps: Vec<Mapping> = vec!["tau1=Iq*0.12".parse().unwrap()];
    let (scaled, _) = read(&file, &Reading { maps: &maps, ..Reading::default() });
    assert_eq!(scaled.mechanism, Mechanism::axis(Joint::Revolute));
    assert!((scaled.tau().at(9)[0] - 0.12 * recording.signals.tau().at(9)[0]).abs() < 1e-12);
}

fn run(arguments: &[&str]) -> Output {
    Command::cargo_bin("deltatwin").unwrap().args(arguments).output().unwrap()
}

fn done(arguments: &[&str]) -> String {
    let out = run(arguments);
    let (said, wrong) = (String::from_utf8_lossy(&out.stdout), String::from_utf8_lossy(&out.stderr));
    assert!(out.status.success(), "{arguments:?}: {said}{wrong}");
    said.into_owned()
}

/// What `new` prints: at most a screen of 100 columns.
fn made(arguments: &[&str]) -> String {
    let said = done(arguments);
    assert!(said.lines().count() <= 45, "{said}");
    let wide = said.lines().find(|l| l.chars().count() > 100 && !l.contains("Wrote"));
    assert_eq!(wide, None);
    said
}

#[test]
fn from_a_file_to_a_diagnosis_of_an_axis() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    for (unit, effort, inertia) in [("torque [Nm]", "N·m", "kg·m²"), ("Iq [A]", "A", "A·s²/rad")] {
        let names = [path("run.csv"), path("again.csv")];
        for (name, seed) in names.iter().zip([5, 6]) {
            let text = rows(&bench(seed), ",", |_, x| format!("{x:.7}"));
            std::fs::write(name, format!("time,position [rad],{unit}\n{text}")).unwrap();
        }
        let [model, better] = [path("axis.toml"), path("better.toml")];
        let said = made(&["new", "axis", &names[0], &names[1], "-o", &model, "--force"]);
        for part in [inertia, effort, "coulomb", "encoder_bits", "16", "deltatwin diagnose"] {
            assert!(said.contains(part), "{part}: {said}");
        }
        let json = done(&["new", "axis", &names[0], "-o", &model, "--force", "--json"]);
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        let value = |key: &str| {
            let all = json["numbers"].as_array().unwrap();
            let number = all.iter().find(|n| n["key"] == key).unwrap_or_else(|| panic!("{key}"));
            (number["values"][0].as_f64().unwrap(), number["std"][0].as_f64())
        };
        for (key, truth) in [("inertia", TRUTH[0]), ("coulomb", TRUTH[1]), ("viscous", TRUTH[2])] {
            let (found, std) = value(key);
            let std = std.unwrap();
            assert!((found / truth - 1.0).abs() < 0.03 && std < 0.03 * truth, "{key}: {found} ± {std} for {truth}");
        }
        assert!((value("torque").0 / TRUTH[3] - 1.0).abs() < 0.1, "{:?}", value("torque"));
        assert_eq!((value("encoder_bits").0, value("sample_time").0), (16.0, PERIOD));
        let text = std::fs::read_to_string(&model).unwrap();
        assert!(text.contains("from run.csv: linear regression, ±"), "{text}");
        assert_eq!(text.contains("effort = \"A\""), effort == "A");

        done(&["check", &model]);
        assert!(done(&["check", &names[1], "--model", &model]).contains("It fits the model"));
        let said = done(&["identify", &model, &names[0], "-o", &better]);
        assert!(said.contains(inertia), "{said}");
        assert!(done(&["compare", &better, &names[1]]).contains(effort));
        let said = done(&["diagnose", &better, &names[0], "--held-out", &names[1], "--json"]);
        let json: serde_json::Value = serde_json::from_str(&said).unwrap();
        assert_eq!(json["verdict"], "none", "{said}");
        if cfg!(feature = "viewer") {
            let [odd, shown] = [path("odd.csv"), path("odd.rrd")];
            std::fs::write(&odd, format!("A,B,C\n{}", rows(&bench(5), ",", |_, x| format!("{x:.7}")))).unwrap();
            assert!(!run(&["replay", &odd, "--model", &model, "-o", &shown]).status.success());
            done(&["replay", &odd, "--model", &model, "-o", &shown, "--map", "t=A, q1=B, tau1=C"]);
            assert!(std::fs::read(&shown).unwrap().starts_with(b"RRF2"));
        }
        // Nothing is overwritten unasked.
        let refused = run(&["new", "axis", &names[0], "-o", &model]);
        assert_eq!(refused.status.code(), Some(2));
        assert!(String::from_utf8_lossy(&refused.stderr).contains("--force"));
    }
}

/// A pendulum whose encoder was switched on twice is one machine: the zero of the second recording is found, said, and
/// left alone on request.
#[test]
fn recordings_with_other_zeros_are_one_data_set() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let names = [path("run.csv"), path("again.csv")];
    let zero = 0.7;
    for (name, seed, zero) in [(&names[0], 5, 0.0), (&names[1], 6, zero)] {
        let with_weight = |[t, q, torque]: &[f64; 3]| [*t, q - zero, torque + 0.4 * q.sin() + 0.1 * q.cos()];
        let data: Vec<[f64; 3]> = bench(seed).iter().map(with_weight).collect();
        std::fs::write(
            name,
            format!("time,position [rad],torque [Nm]\n{}", rows(&data, ",", |_, x| format!("{x:.7}"))),
        )
        .unwrap();
    }
    let model = path("axis.toml");
    let said = made(&["new", "axis", &names[0], &names[1], "-o", &model]);
    assert!(said.contains("added to its positions"), "{said}");
    let fit = |more: &[&str]| -> serde_json::Value {
        let arguments = [&["identify", &model, &names[0], &names[1], "--json"], more].concat();
        serde_json::from_str(&done(&arguments)).unwrap()
    };
    let joined = fit(&[]);
    let found = &joined["zeros"][0];
    let [offset, std] = ["offset", "std"].map(|key| found[key].as_f64().unwrap());
    assert_eq!((found["recording"].as_str(), found["unit"].as_str()), (Some("again"), Some("rad")));
    assert!((offset - zero).abs() < 4.0 * std && std < 0.01, "{found}");
    let sine = joined["parameters"]["axis_gravity.sine"]["value"].as_f64().unwrap();
    // The drive holds the weight −(a·sin q + b·cos q).
    assert!((sine - 0.4).abs() < 0.01, "{sine} N·m");
    let rms = |fit: &serde_json::Value| fit["rms"][0].as_f64().unwrap();
    assert!(rms(&joined) < 1.1 * TRUTH[3], "{} N·m", rms(&joined));
    let kept = fit(&["--keep-zeros", "--no-gate"]);
    assert_eq!(kept["zeros"].as_array().map(Vec::len), Some(0));
    assert!(rms(&kept) > 5.0 * rms(&joined), "{} N·m", rms(&kept));
}

#[test]
#[ignore = "campaign"]
fn a_delta_robot_starts_from_a_template() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    for (scenario, template) in
        [("scenarios/clavel-delta.toml", "clavel-delta"), ("scenarios/smoke.toml", "irb360-6-1600")]
    {
        let (recording, model) = (path("run.mcap"), path("delta.toml"));
        done(&["simulate", scenario, "-o", &recording]);
        let said = made(&["new", "delta", &recording, "-o", &model, "--force"]);
        for part in [template, "sample_time", "arm_limits", "deltatwin identify"] {
            assert!(said.contains(part), "{part}: {said}");
        }
        done(&["check", &model]);
        done(&["compare", &model, &recording]);
        let refused = run(&["new", "axis", &recording, "-o", &model, "--force"]);
        assert!(String::from_utf8_lossy(&refused.stderr).contains("new delta"), "{refused:?}");
    }
}

#[test]
fn a_joint_of_a_bag_is_read_by_its_name() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let [bag, axis] = [path("robot.mcap"), path("axis.csv")];
    done(&["simulate", "scenarios/smoke.toml", "-o", &bag]);
    done(&["import", &bag, "--joint", "axis2", "-o", &axis]);
    let (robot, _) = recording::read(Path::new(&bag), None).unwrap();
    let (lone, _) = recording::read(Path::new(&axis), None).unwrap();
    assert_eq!(lone.signals.mechanism, Mechanism::axis(Joint::Revolute));
    for (a, b) in robot.signals.q().iter().zip(lone.signals.q().iter()) {
        assert_eq!(a[1], b[0]);
    }
    // The same from columns, and a joint that is not there.
    let how = Reading { joint: Some("2"), ..Reading::default() };
    let csv = folder.path().join("robot.csv");
    recording::write(&robot, &csv).unwrap();
    let (again, _) = recording::read_as(&csv, &how).unwrap();
    assert_eq!(again.signals.tau(), lone.signals.tau());
    let out = run(&["import", &bag, "--joint", "elbow", "-o", &path("none.csv")]);
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(!out.status.success() && said.contains("axis1, axis2, axis3, axis4") && said.contains("elbow"), "{said}");
}

/// Recordings of the twin with the usual noise, and without any, give no warning about themselves.
#[test]
#[ignore = "campaign"]
fn the_twin_raises_no_false_alarm() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    for (name, noise) in [("clavel-delta", true), ("servo-axis", true), ("servo-axis", false), ("smoke", false)] {
        let recording = folder.path().join("run.csv").display().to_string();
        let text = std::fs::read_to_string(format!("scenarios/{name}.toml")).unwrap();
        let models = common::root().join("models").display().to_string();
        let text = text.replace("../models", &models);
        let text = if noise { text } else { format!("noise = false\n{}", text.replace("noise = true", "")) };
        let scenario = folder.path().join("scenario.toml");
        std::fs::write(&scenario, text).unwrap();
        done(&["simulate", &scenario.display().to_string(), "-o", &recording]);
        let out = run(&["check", &recording, "--json"]);
        let json: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
        assert_eq!(json["files"][0]["warnings"], serde_json::json!([]), "{name}, noise {noise}");
    }
}

/// Whether an `.mcap` file has the robot for display, and a text of its provenance: topics and metadata are stored plainly.
fn shown(file: &str, origin: &str) -> [bool; 3] {
    let bytes = std::fs::read(file).unwrap();
    let has = |text: &str| bytes.windows(text.len()).any(|window| window == text.as_bytes());
    [has("/tf"), has("/robot_description"), has(origin)]
}

/// A robot is shown from every file whose machine is known; where a file comes from stands in all of them.
#[test]
fn a_robot_has_links_where_its_model_is_known_and_always_its_origin() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let [csv, bare, known, tape, planned] = ["run.csv", "bare.mcap", "known.mcap", "tape.mcap", "plan.mcap"]
        .map(|n| folder.path().join(n).display().to_string());
    done(&["simulate", "scenarios/smoke.toml", "-o", &csv]);
    done(&["import", &csv, "-o", &bare]);
    assert_eq!(shown(&bare, "deltatwin import run.csv"), [false, false, true]);
    const MODEL: &str = "models/irb360-6-1600.toml";
    done(&["import", &csv, "--model", MODEL, "-o", &known]);
    assert_eq!(shown(&known, "deltatwin import run.csv"), [true; 3]);
    if cfg!(feature = "watch") {
        done(&["watch", MODEL, "--follow", &csv, "--idle", "1", "-o", &tape]);
        assert_eq!(shown(&tape, "deltatwin watch irb360-6-1600.toml"), [true; 3]);
    }
    done(&["plan", MODEL, "scenarios/u-turn.toml", "-o", &planned]);
    assert_eq!(shown(&planned, "deltatwin plan irb360-6-1600.toml u-turn.toml"), [true; 3]);
}

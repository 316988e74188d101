//! The program itself: every command, its exit status, what it says and what it leaves behind.

use crate::common;

use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use serde_json::Value;
use tempfile::TempDir;

const MODEL: &str = "models/irb360-6-1600.toml";
const SMOKE: &str = "scenarios/smoke.toml";

fn run(arguments: &[&str]) -> Output {
    Command::cargo_bin("deltatwin").unwrap().args(arguments).output().unwrap()
}

fn done(arguments: &[&str]) -> String {
    let out = run(arguments);
    assert_eq!(out.status.code(), Some(0), "{arguments:?}: {}", String::from_utf8_lossy(&out.stderr));
    String::from_utf8(out.stdout).unwrap()
}

/// The one object on stdout.
fn json(arguments: &[&str]) -> Value {
    let text = done(&[arguments, &["--json"]].concat());
    serde_json::from_str(&text).unwrap_or_else(|e| panic!("{arguments:?}: {e}: {text}"))
}

/// What a refused input is answered with.
fn refused(arguments: &[&str]) -> String {
    let out = run(arguments);
    let text = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(2), "{arguments:?}: {text}");
    assert!(out.stdout.is_empty(), "{arguments:?}: {}", String::from_utf8_lossy(&out.stdout));
    assert!(!text.contains("panicked"), "{text}");
    text
}

fn toml_files(folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    entries.filter(|p| p.extension().is_some_and(|e| e == "toml")).collect()
}

fn path(folder: &TempDir, name: &str) -> String {
    folder.path().join(name).display().to_string()
}

/// A short run of the twin as CSV.
fn smoke(folder: &TempDir) -> String {
    let csv = path(folder, "smoke.csv");
    done(&["simulate", SMOKE, "-o", &csv]);
    csv
}

#[test]
fn a_scenario_names_files_of_its_project_unless_more_is_allowed() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let model = "../elsewhere/axis.toml";
    for place in ["project/models", "elsewhere"] {
        std::fs::create_dir_all(folder.path().join(place)).unwrap();
    }
    std::fs::copy("models/servo-axis.toml", folder.path().join("elsewhere/axis.toml")).unwrap();
    let text = std::fs::read_to_string("scenarios/servo-axis.toml").unwrap();
    let (scenario, study) = (path(&folder, "project/run.toml"), path(&folder, "project/study.toml"));
    std::fs::write(&scenario, text.replace("../models/servo-axis.toml", model)).unwrap();
    std::fs::write(
        &study,
        "title = \"x\"\nscenario = \"run.toml\"\n[design]\nkind = \"grid\"\n[[factors]]\nname = \"speed\"\n\
         key = \"speed_scale\"\nlevels = [0.5]\n",
    )
    .unwrap();
    let cases: [&[&str]; 3] = [&["check", &scenario], &["check", &study], &["simulate", &scenario]];
    let run: [&str; 4] = ["study", &study, "--run", "0"];
    for arguments in cases.into_iter().chain(cfg!(feature = "studies").then_some(&run[..])) {
        let said = refused(arguments);
        assert!(said.contains(model) && said.contains("is outside of") && said.contains("--allow-outside"), "{said}");
    }
    done(&["check", &scenario, &study, "--allow-outside"]);
}

/// Torque noise at rest and from differences against each other and against the truth model's 0.5 and 0.05 N·m.
#[test]
fn noise_at_rest_and_from_differences_agree() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let run = folder.path().join("rest.mcap").display().to_string();
    done(&["simulate", "scenarios/static-poses.toml", "-o", &run]);
    let noise = json(&["noise", &run]);
    assert!(noise["rests"].as_u64().unwrap() >= 4, "{noise}");
    let sigma = |key: &str, i: usize| noise[key][i][i].as_f64().unwrap().sqrt();
    for (i, truth) in [0.5, 0.5, 0.5, 0.05].into_iter().enumerate() {
        let (rest, differences) = (sigma("covariance_at_rest", i), sigma("covariance_from_differences", i));
        println!("axis {}: {rest:.4} N·m at rest, {differences:.4} N·m from differences", i + 1);
        assert!((rest / differences - 1.0).abs() < 0.1, "axis {}: {rest} {differences}", i + 1);
        assert!((rest / truth - 1.0).abs() < 0.1, "axis {}: {rest}", i + 1);
        for j in 0..i {
            let correlation =
                noise["covariance_at_rest"][i][j].as_f64().unwrap() / (rest * sigma("covariance_at_rest", j));
            assert!(correlation.abs() < 0.1, "axes {} and {}: {correlation}", i + 1, j + 1);
        }
    }
    let text = done(&["noise", &run]);
    assert!(text.contains("axis 4 standard deviation") && text.contains("rests"), "{text}");
}

#[test]
fn every_command_explains_itself_with_an_example() {
    common::at_root();
    let top = done(&["--help"]);
    let list = top.split("Commands:").nth(1).and_then(|t| t.split("Options:").next()).expect("a list of commands");
    let commands: Vec<&str> =
        list.lines().filter_map(|l| l.split_whitespace().next()).filter(|c| *c != "help").collect();
    assert!(commands.len() >= 19, "{commands:?}");
    for command in commands {
        let help = done(&[command, "--help"]);
        let example = help.split_once("Example").is_some_and(|(_, e)| e.contains(&format!("deltatwin {command}")));
        assert!(example && (help.contains("--json") || help.contains("Commands:")), "{help}");
    }
    for (command, feature, built) in [
        ("reproduce", "reproduce", cfg!(feature = "reproduce")),
        ("exam", "studies", cfg!(feature = "studies")),
        ("study", "studies", cfg!(feature = "studies")),
        ("studio", "studio", cfg!(feature = "studio")),
        ("watch", "watch", cfg!(feature = "watch")),
    ] {
        match built {
            true => assert!(top.contains(&format!("  {command} ")), "{command} is missing in\n{top}"),
            false => assert!(refused(&[command]).contains(&format!("--features {feature} -- {command}"))),
        }
    }
    refused(&["simulat", SMOKE]);
    refused(&["simulate"]);
}

#[test]
fn every_shipped_file_is_right() {
    common::at_root();
    let files: Vec<String> = ["models", "scenarios", "scenarios/studies"]
        .iter()
        .flat_map(|f| toml_files(f))
        .map(|p| p.display().to_string())
        .collect();
    assert!(files.len() >= 7, "{files:?}");
    let arguments: Vec<&str> = std::iter::once("check").chain(files.iter().map(String::as_str)).collect();
    let answer = json(&arguments);
    for entry in answer["files"].as_array().unwrap() {
        let file = entry["file"].as_str().unwrap();
        let is_path = |name: &str| file.ends_with(name);
        let expected = match file {
            _ if file.starts_with("models") => "model",
            _ if file.starts_with("scenarios/studies") => "study",
            _ if ["u-turn.toml", "cycle.toml", "par4-path.toml"].into_iter().any(is_path) => "path",
            _ => "scenario",
        };
        assert_eq!(entry["kind"], expected, "{entry}");
    }
    assert_eq!(answer["files"].as_array().unwrap().len(), files.len());
}

#[test]
fn the_library_of_effects_is_listed_and_described() {
    common::at_root();
    let names: Vec<String> = json(&["effects"])["effects"]
        .as_array()
        .unwrap()
        .iter()
        .map(|e| e["name"].as_str().unwrap().to_string())
        .collect();
    assert_eq!(names, deltatwin::effects::REGISTRY.iter().map(|e| e.name()).collect::<Vec<_>>());
    let one = json(&["effects", "ball_socket_coulomb"]);
    assert_eq!(one["parameters"][0]["unit"], "N·m");
    assert!(refused(&["effects", "ball_socket_colomb"]).contains("did you mean `ball_socket_coulomb`?"));
}

#[test]
#[ignore = "campaign"]
fn simulate_then_identify() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let mcap = path(&folder, "smoke.mcap");
    let run = json(&["simulate", SMOKE, "-o", &mcap]);
    assert_eq!(run["simulated_s"], 0.5);
    for key in ["wall_s", "steps", "max_loop_gap", "max_loop_rate", "energy_error", "peak_strut_force"] {
        assert!(run[key].is_number(), "{key}: {run}");
    }
    assert!(run["events"].is_array() && run["max_loop_gap"].as_f64().unwrap() < 1e-9, "{run}");

    let csv = smoke(&folder);
    let fitted = path(&folder, "fitted.toml");
    let answer = json(&["identify", MODEL, &mcap, "--held-out", &csv, "-o", &fitted]);
    for key in ["rms", "held_out_rms", "noise_floor"] {
        assert_eq!(answer[key].as_array().unwrap().len(), 4, "{key}: {answer}");
        assert_eq!(answer[format!("strut_{key}")].as_array().unwrap().len(), 1, "{key}: {answer}");
    }
    assert_eq!(answer["channels"].as_array().unwrap().len(), 5);
    assert!(answer["min_pseudo_inertia_eigenvalue"].as_f64().unwrap() >= 0.0);
    let friction = &answer["parameters"]["drive_friction.coulomb_1"];
    assert!(friction["value"].is_number() && friction["unit"] == "N·m", "{friction}");
    assert!(friction["std"].is_number() || friction["std"].is_null(), "{friction}");
    let base = answer["base_parameters"].as_object().unwrap().values().next().unwrap();
    assert!(base["combination"].is_string(), "{base}");
    assert_eq!(answer["model"], fitted.as_str());
    done(&["check", &fitted]);
    done(&["compare", &fitted, &mcap]);
}

#[test]
#[ignore = "campaign"]
fn excite_writes_a_scenario_that_runs() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let scenario = path(&folder, "excite.toml");
    let few = ["--starts", "1", "--iterations", "3", "--harmonics", "2", "--frequency", "2"];
    let arguments = [&["excite", MODEL, "-o", &scenario][..], &few].concat();
    let answer = json(&arguments);
    for key in ["condition_number", "log_det", "solve_s"] {
        assert!(answer[key].is_number(), "{key}: {answer}");
    }
    let log_det = answer["log_det"].as_f64().unwrap();
    assert!(log_det > answer["random"]["best_log_det"].as_f64().unwrap(), "{answer}");
    assert!(answer["random"]["median_condition_number"].is_number(), "{answer}");
    for (limit, share) in answer["worst_limit"].as_object().unwrap() {
        assert!(share.as_f64().unwrap() <= 1.0, "{limit}: {share}");
    }
    let friction = &answer["base_parameters"]["drive_friction.viscous_1"];
    assert!(friction["std"].is_number() && friction["unit"] == "N·m·s/rad", "{friction}");
    let first = std::fs::read_to_string(&scenario).unwrap();
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    let run = json(&["simulate", &scenario]);
    assert_eq!(run["simulated_s"], 1.0);

    let table = done(&arguments);
    assert!(table.contains("Condition number") && table.contains("random median"), "{table}");
    assert_eq!(std::fs::read_to_string(&scenario).unwrap(), first);
    let again = path(&folder, "cut.toml");
    let cut = json(&["excite", MODEL, "-o", &again, "--budget", "0", "--hemisphere", "0,0,-0.85,0.35"]);
    assert!(cut["stopped"] == true && cut["iterations"] == 0, "{cut}");
    assert!(cut["worst_limit"]["hemisphere"].as_f64().unwrap() <= 1.0, "{cut}");

    let output = path(&folder, "no.toml");
    let start = ["excite", MODEL, "-o", &output];
    let answer = |more: &[&str]| refused(&[&start[..], more].concat());
    assert!(answer(&["--share", "nan"]).contains("--share is NaN"));
    assert!(answer(&["--frequency", "0"]).contains("--frequency is 0"));
    assert!(answer(&["--hemisphere", "0,0,-3,0.3"]).contains("no motion fits"));
    assert!(answer(&["--hemisphere", "0,0,-1"]).contains("expected four numbers"));
    assert!(refused(&["excite", "models/irb360-6-1600-disassembled.toml", "-o", &output]).contains("disassembled"));
    assert!(refused(&["excite", MODEL, "-o", MODEL]).contains("is an input"));
    assert!(!Path::new(&output).exists());
}

#[test]
fn excite_plans_for_telling_two_effects_apart() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let scenario = path(&folder, "tell.toml");
    let plan = |a: &'static str, b: &'static str| {
        let quick = ["--harmonics", "2", "--starts", "1", "--iterations", "10"];
        [&["excite", MODEL, "-o", &scenario, "--discriminate", a, b], &quick[..]].concat()
    };
    let answer = json(&plan("base_tilt", "torque_bias"));
    assert_eq!(answer["pair"], serde_json::json!(["base_tilt", "torque_bias"]));
    assert!(answer["noncentrality"].as_f64().unwrap() > 0.0 && answer["searched"] == true, "{answer}");
    let kinds: Vec<&str> = answer["plans"].as_array().unwrap().iter().map(|p| p["kind"].as_str().unwrap()).collect();
    for kind in ["excitation", "slow_sweep", "static_poses", "reversals", "payload", "strut_sensor", "designed"] {
        assert!(kinds.contains(&kind), "{kind}: {kinds:?}");
    }
    done(&["check", &scenario]);
    assert!(refused(&plan("base_tilt", "base_tilt")).contains("given twice"));
    assert!(refused(&plan("base_tilt", "base_tlit")).contains("unknown effect `base_tlit`"));
    assert!(refused(&plan("base_tilt", "clamp_springs")).contains("no parameter of it shows"));
    assert!(refused(&plan("base_tilt", "rigid_bodies")).contains("no parameter of it shows"));
}

#[test]
fn compare_and_add_answer_in_json() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let csv = smoke(&folder);
    let answer = json(&["compare", MODEL, &csv]);
    assert_eq!(answer["rms"].as_array().unwrap().len(), 4);
    for finding in answer["findings"].as_array().unwrap() {
        assert!(finding["where"].is_string() && finding["share"].is_number(), "{finding}");
    }
    // A comparison fits nothing, and its page names both models among the inputs.
    let (page, later) = (path(&folder, "where.html"), "models/irb360-6-1600-truth.toml");
    done(&["compare", MODEL, &csv, "--held-out", &csv, "--beside", later, "--report", &page]);
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(!html.contains("fitted to") && html.contains("recorded in smoke; held out: smoke"));
    assert!(html.contains("later model"), "the inputs of the page");
    let added = path(&folder, "added.toml");
    let answer = json(&["add", MODEL, "ball_socket_coulomb", &csv, "-o", &added]);
    assert!(answer["parameters"]["moment"]["value"].is_number(), "{answer}");
    for key in ["rms_before", "rms_after", "noise_floor"] {
        assert_eq!(answer[key].as_array().unwrap().len(), 4, "{answer}");
    }
    let text = std::fs::read_to_string(&added).unwrap();
    assert!(text.contains("[effects.ball_socket_coulomb]") && text.matches("[[history]]").count() == 1, "{text}");
    let shares = |key: &str| answer["budget"][key][0].as_f64().unwrap();
    let explained = answer["budget"]["effects"][0]["share"][0].as_f64().unwrap();
    assert!((shares("noise") + explained + shares("unexplained") - 1.0).abs() < 1e-9, "{answer}");
    for key in ["parameters_before", "parameters_after"] {
        assert!(answer[key]["axis4_friction.coulomb"]["value"].is_number(), "{answer}");
    }
    let twice = path(&folder, "twice.toml");
    done(&["add", &added, "base_tilt", &csv, "-o", &twice]);
    assert_eq!(std::fs::read_to_string(&twice).unwrap().matches("[[history]]").count(), 2);
    refused(&["add", MODEL, "ball_socket_colomb", &csv, "-o", &path(&folder, "no.toml")]);
    assert!(refused(&["add", MODEL, "ball_socket_coulomb", &csv, "-o", MODEL]).contains("is an input"));
}

#[test]
fn export_and_import_lose_nothing() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let [mcap, csv, again, last] = ["a.mcap", "a.csv", "b.mcap", "b.csv"].map(|n| path(&folder, n));
    done(&["simulate", SMOKE, "-o", &mcap]);
    done(&["export", &mcap, "--csv", &csv]);
    done(&["import", &csv, "-o", &again]);
    done(&["export", &again, "--csv", &last]);
    assert!(std::fs::read(&csv).unwrap() == std::fs::read(&last).unwrap());
    assert!(folder.path().join("a.setup.toml").is_file());
    assert!(refused(&["import", &csv, "-o", &csv]).contains("is an input"));
}

#[test]
fn robots_for_other_programs() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let [xml, urdf] = ["a.xml", "a.urdf"].map(|n| path(&folder, n));
    let said = done(&["export", MODEL, "-o", &xml]);
    assert!(said.contains("14 links of 9.553 kg, 6 joints that close"), "{said}");
    done(&["export", MODEL, "-o", &urdf]);
    let [mjcf, tree] = [&xml, &urdf].map(|file| std::fs::read_to_string(file).unwrap());
    assert_eq!((mjcf.matches("<connect ").count(), mjcf.matches("<motor ").count()), (6, 4));
    assert_eq!(tree.matches("<loop_joint ").count(), 6);
    assert!(refused(&["export", MODEL, "-o", &xml]).contains("--force"));
    done(&["export", MODEL, "-o", &xml, "--force"]);
    refused(&["export", "models/servo-axis.toml", "-o", &path(&folder, "b.xml")]);
    // A parallelogram as plate closes with one hinge more; a rack follows its pinion.
    let [par4, i4] = ["par4", "i4"].map(|name| {
        let file = path(&folder, &format!("{name}.xml"));
        done(&["export", name, "-o", &file]);
        std::fs::read_to_string(&file).unwrap()
    });
    assert_eq!((par4.matches("<connect ").count(), par4.matches("<motor ").count()), (9, 4));
    assert!(i4.contains("joint1=\"rack\" joint2=\"spindle\""));
    refused(&["export", MODEL, "-o", &path(&folder, "b.csv")]);
}

#[cfg(feature = "studies")]
#[test]
fn recordings_as_parquet() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let [mcap, table] = ["a.mcap", "a.parquet"].map(|n| path(&folder, n));
    done(&["simulate", SMOKE, "-o", &mcap]);
    done(&["export", &mcap, "-o", &table]);
    let table = deltatwin_study::campaign::parquet::Reader::open(Path::new(&table)).unwrap();
    let (recording, _) = deltatwin_io::recording::read(Path::new(&mcap), None).unwrap();
    let expected: Vec<f64> = recording.signals.tau().iter().map(|tau| tau[1]).collect();
    let table = table.table().unwrap();
    assert_eq!(table.numbers(table.column("tau2").unwrap()), expected);
}

/// The lines of a good recording, changed into a bad one.
fn damaged(folder: &TempDir, name: &str, good: &str, change: impl Fn(usize, Vec<String>) -> Vec<String>) -> String {
    let lines: Vec<String> = good
        .lines()
        .enumerate()
        .map(|(i, line)| change(i, line.split(',').map(str::to_string).collect()).join(","))
        .collect();
    let file = path(folder, name);
    std::fs::write(&file, lines.join("\n")).unwrap();
    file
}

#[test]
fn bad_measurements_are_refused_in_one_message() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let good = std::fs::read_to_string(smoke(&folder)).unwrap();
    let set = |line: usize, column: usize, value: &'static str| {
        move |i: usize, mut cells: Vec<String>| {
            if i == line {
                cells[column] = value.into();
            }
            cells
        }
    };
    let degrees = |i: usize, mut cells: Vec<String>| {
        if i > 0 {
            for cell in &mut cells[1..5] {
                *cell = cell.parse::<f64>().unwrap().to_degrees().to_string();
            }
        }
        cells
    };
    let (empty, binary) = (path(&folder, "empty.csv"), path(&folder, "binary.csv"));
    std::fs::write(&empty, "").unwrap();
    std::fs::write(&binary, [0u8, 159, 146, 150, 0, 1, 2].repeat(100)).unwrap();
    let cases = [
        (damaged(&folder, "nan.csv", &good, set(17, 2, "NaN")), "line 18, column `q2`"),
        (damaged(&folder, "word.csv", &good, set(17, 6, "fast")), "line 18, column `tau2`"),
        (damaged(&folder, "column.csv", &good, set(0, 3, "other")), "`q3`"),
        (damaged(&folder, "time.csv", &good, set(40, 0, "0.0001")), "line 41, column `t`"),
        (damaged(&folder, "degrees.csv", &good, degrees), "degrees"),
        (empty, "is empty"),
        (binary, "binary"),
        (path(&folder, "missing.csv"), "cannot be read"),
    ];
    let (mcap, model) = (path(&folder, "out.mcap"), path(&folder, "out.toml"));
    for (file, place) in &cases {
        for arguments in
            [vec!["check", file], vec!["import", file, "-o", &mcap], vec!["identify", MODEL, file, "-o", &model]]
        {
            let text = refused(&arguments);
            assert!(text.contains(place), "{file}: {text}");
            assert_eq!(text.matches(file.as_str()).count(), 1, "{file}: {text}");
            assert!(!Path::new(&mcap).exists() && !Path::new(&model).exists(), "{arguments:?}");
        }
    }
}

#[test]
fn misspelt_keys_are_named_with_their_line() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let text = std::fs::read_to_string(MODEL).unwrap();
    let line = 1 + text.lines().position(|l| l.starts_with("arm_length")).unwrap();
    let model = path(&folder, "model.toml");
    std::fs::write(&model, text.replace("arm_length", "arm_lenght")).unwrap();
    for arguments in [vec!["check", &model], vec!["simulate", SMOKE, "--model", &model]] {
        let answer = refused(&arguments);
        assert!(answer.contains(&format!("model.toml:{line}:1")) && answer.contains("arm_length"), "{answer}");
    }
    let scenario = path(&folder, "scenario.toml");
    std::fs::write(&scenario, "model = \"model.toml\"\nduratoin = 1.0\n").unwrap();
    let answer = refused(&["check", &scenario]);
    assert!(answer.contains("scenario.toml:2:1") && answer.contains("duratoin"), "{answer}");
}

/// Ctrl-C ends a run early, and what is there is a valid recording.
/// Programs that ask for JSON get it in every case.
#[test]
fn errors_are_json_too() {
    common::at_root();
    let error = |arguments: &[&str]| {
        let out = run(arguments);
        assert_eq!(out.status.code(), Some(2), "{arguments:?}");
        assert!(!out.stderr.is_empty());
        let value: Value = serde_json::from_slice(&out.stdout).unwrap();
        value["error"]["message"].as_str().unwrap().to_string()
    };
    assert!(error(&["simulate", "nothing.toml", "--json"]).contains("nothing.toml"));
    assert!(error(&["compare", MODEL, "nothing.csv", "--json"]).contains("nothing.csv"));
    assert!(error(&["compare", "--json"]).contains("required"));
    assert!(error(&["effects", "air_darg", "--json"]).contains("did you mean `air_drag`?"));
    assert!(!error(&["effects", "quantum_foam", "--json"]).contains("did you mean"));
}

#[test]
fn shells_and_manuals_know_every_command() {
    common::at_root();
    let script = done(&["completions", "bash"]);
    assert!(script.contains("diagnose") && script.contains("--held-out"));
    let folder = TempDir::new().unwrap();
    done(&["man", "-o", &path(&folder, "man")]);
    let page = std::fs::read_to_string(folder.path().join("man/deltatwin-diagnose.1")).unwrap();
    assert!(page.contains("held\\-out"), "{page}");
}

/// Recordings of several scenarios never overwrite each other.
#[test]
fn runs_have_names_of_their_own() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let text =
        std::fs::read_to_string(SMOKE).unwrap().replace("../models", &format!("{}/models", common::root().display()));
    let (a, b) = (path(&folder, "run.v1.toml"), path(&folder, "run.v2.toml"));
    std::fs::write(&a, &text).unwrap();
    std::fs::write(&b, &text).unwrap();
    let out = path(&folder, "runs");
    done(&["simulate", &a, &b, "-o", &out]);
    let mut names: Vec<_> = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["run.v1.mcap", "run.v2.mcap"]);
    std::fs::create_dir(folder.path().join("other")).unwrap();
    let c = path(&folder, "other/run.v1.toml");
    std::fs::write(&c, &text).unwrap();
    let message = refused(&["simulate", &a, &c, "-o", &out]);
    assert!(message.contains("would both be written to") && message.contains("run.v1.mcap"), "{message}");
    // A recording that cannot be written takes no other with it.
    std::fs::create_dir_all(folder.path().join("mixed/run.v1.mcap")).unwrap();
    let out = run(&["simulate", &a, &b, "-o", &path(&folder, "mixed")]);
    assert_eq!(out.status.code(), Some(2));
    assert!(folder.path().join("mixed/run.v2.mcap").is_file());
    assert!(String::from_utf8_lossy(&out.stderr).contains("run.v1.mcap: cannot be written"));
    // The status is that of the worst run, not of the last one.
    let inside =
        "\n[[objects]]\nname = \"block\"\nshape = \"box\"\nsize = [0.4, 0.4, 0.4]\nposition = [0.0, 0.0, -1.0]\n";
    let blocked = path(&folder, "blocked.toml");
    std::fs::write(&blocked, text.clone() + inside).unwrap();
    let status =
        |files: &[&str]| run(&[&["simulate"][..], files, &["-o", &path(&folder, "mixed")]].concat()).status.code();
    assert_eq!(status(&[&blocked, &b]), Some(1));
    assert_eq!(status(&[&a, &blocked]), Some(2));
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_is_kept() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let mcap = path(&folder, "cut.mcap");
    let child = std::process::Command::new(assert_cmd::cargo::cargo_bin("deltatwin"))
        .args(["simulate", "scenarios/excitation.toml", "-o", &mcap, "--json"])
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    std::thread::sleep(std::time::Duration::from_millis(700));
    std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let out = child.wait_with_output().unwrap();
    assert_eq!(out.status.code(), Some(130));
    let answer: Value = serde_json::from_slice(&out.stdout).unwrap();
    assert_eq!(answer["interrupted"], true);
    assert!(answer["simulated_s"].as_f64().unwrap() < 20.0);
    done(&["check", &mcap]);
}

/// What was complete stays; the part has another name, which the answer states.
#[cfg(unix)]
#[test]
fn an_interrupted_run_replaces_no_complete_recording() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    for (name, part) in [("r.mcap", "r.partial.mcap"), ("r.csv", "r.partial.csv")] {
        let (file, part) = (path(&folder, name), path(&folder, part));
        done(&["simulate", SMOKE, "-o", &file]);
        let complete = std::fs::read(&file).unwrap();
        let child = std::process::Command::new(assert_cmd::cargo::cargo_bin("deltatwin"))
            .args(["simulate", "scenarios/excitation.toml", "-o", &file, "--json"])
            .stdout(std::process::Stdio::piped())
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        // Not before its first samples are on the disk.
        while std::fs::metadata(&part).map_or(0, |m| m.len()) < 1 << 16 {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
        let out = child.wait_with_output().unwrap();
        assert_eq!(out.status.code(), Some(130));
        assert!(std::fs::read(&file).unwrap() == complete, "{name} was replaced");
        let answer: Value = serde_json::from_slice(&out.stdout).unwrap();
        assert_eq!((&answer["interrupted"], &answer["recording"]), (&true.into(), &part.as_str().into()));
        assert!(answer["simulated_s"].as_f64().unwrap() < 20.0);
        done(&["check", &part, &file]);
    }
}

#[test]
fn runs_repeat_bit_by_bit_alone_and_together() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let (alone, together) = (path(&folder, "alone.mcap"), path(&folder, "runs"));
    done(&["simulate", SMOKE, "-o", &alone]);
    assert!(done(&["simulate", SMOKE, "--verify", &alone]).contains("bit for bit"));
    let answer = json(&["simulate", SMOKE, "scenarios/touch.toml", "-o", &together]);
    assert_eq!(answer["runs"].as_array().unwrap().len(), 2);
    let twice = std::fs::read(path(&folder, "runs/smoke.mcap")).unwrap();
    assert!(std::fs::read(&alone).unwrap() == twice, "the same scenario gives the same bytes");
    // Another scenario is not the same run: exit status 1, and the answer says where they part.
    let output = run(&["simulate", "scenarios/touch.toml", "--verify", &alone]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stdout).contains("differs"), "{output:?}");
}

#[test]
fn plan_run_and_forces() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let (table, figures) = (path(&folder, "u-turn.csv"), path(&folder, "figures"));
    let answer = json(&["plan", MODEL, "scenarios/u-turn.toml", "-o", &table, "--figure", &figures, "--twin", MODEL]);
    for key in ["time", "optimality_gap", "solve_s", "time_bound", "time_without_jerk"] {
        assert!(answer[key].as_f64().unwrap() > 0.0, "{key}: {answer}");
    }
    let worst = answer["max_violation"].as_object().unwrap();
    assert!(worst["lambda_s3"].as_f64().unwrap() > 0.99 && worst.values().all(|v| v.as_f64().unwrap() <= 1.001));
    assert!(answer["active"].as_array().unwrap().iter().all(|a| a["s"].is_number() && a["limit"].is_string()));
    assert_eq!(answer["execution"]["events"].as_array().unwrap().len(), 0);
    assert_eq!(answer["execution"]["violated"].as_array().unwrap().len(), 0);
    assert_eq!(answer["execution"]["within_limits"], true);
    for name in ["path", "speed", "drives", "forces", "executed-torques", "executed-forces", "executed-acceleration"] {
        let svg = std::fs::read_to_string(Path::new(&figures).join(name).with_extension("svg")).unwrap();
        assert!(svg.contains("</svg>") && !svg.contains("no data"), "{name}");
    }
    // The trajectory is a recording, and a table that a scenario can run.
    let scenario = path(&folder, "run.toml");
    let model = std::fs::canonicalize(MODEL).unwrap();
    let text = format!("model = {:?}\nnoise = false\n[motion]\nkind = \"table\"\nfile = \"u-turn.csv\"\n", model);
    std::fs::write(&scenario, format!("{text}[payload]\nmass = 2.5\ncom = [0, 0, -0.03]\ninertia_zz = 0.01\n"))
        .unwrap();
    let run = json(&["simulate", &scenario]);
    assert!(run["tracking_error"][1].as_f64().unwrap() < 1e-3, "{run}");
    for motion in [&table, &scenario] {
        let (csv, svg) = (path(&folder, "forces.csv"), path(&folder, "forces.svg"));
        let forces = json(&["forces", MODEL, motion, "-o", &csv, "--figure", &svg]);
        let strut = &forces["multipliers"]["lambda_s3"];
        let peak = strut["max"].as_f64().unwrap().max(-strut["min"].as_f64().unwrap());
        assert!((peak - 108.0).abs() < 0.5, "{forces}");
        // The margins are those of the twin's sockets.
        for socket in 0..12 {
            let name = if socket < 6 { format!("lambda_s{}", socket + 1) } else { format!("lambda_p{}", socket - 5) };
            let [margin, twin] = [&forces["multipliers"][&name]["margin"], &run["socket_margins"][socket]];
            assert!((margin.as_f64().unwrap() - twin.as_f64().unwrap()).abs() < 0.5, "{name}: {margin} {twin}");
        }
        assert!(std::fs::read_to_string(&csv).unwrap().starts_with("t,lambda_e1,"));
    }
    let measured = json(&["forces", MODEL, &table])["measured"]["strut3_upper"]["rms_difference"].as_f64().unwrap();
    assert!(measured < 0.1, "{measured}");
    refused(&["plan", MODEL, "scenarios/smoke.toml"]);
    refused(&["plan", MODEL, "scenarios/u-turn.toml", "-o", &path(&folder, "u-turn.txt")]);
    refused(&["forces", "models/irb360-6-1600-disassembled.toml", &table]);
    // A machine with friction in its sockets exceeds the limit of 120 N on the struts: said, on the page, status 1.
    let truth = "models/irb360-6-1600-truth.toml";
    let page = path(&folder, "u-turn.html");
    let output = self::run(&["plan", MODEL, "scenarios/u-turn.toml", "--twin", truth, "--report", &page]);
    let printed = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(1), "{output:?}");
    assert!(printed.contains("limit violated: strut") && printed.contains("of 120.0 N"), "{printed}");
    let html = std::fs::read_to_string(&page).unwrap();
    assert!(html.contains("<div class=\"callout bad\">") && html.contains("Limit violated: strut"));
    assert!(!html.contains("<div class=\"callout good\">"));
    // Too heavy: no plan, status 1, and the reason.
    let heavy = path(&folder, "heavy.toml");
    let text = std::fs::read_to_string("scenarios/u-turn.toml").unwrap();
    std::fs::write(&heavy, text.replace("mass = 2.5", "mass = 40.0")).unwrap();
    let output = run_status(&["plan", MODEL, &heavy]);
    assert!(output.contains("at rest"), "{output}");
}

/// What an answer of status 1 says.
fn run_status(arguments: &[&str]) -> String {
    let out = run(arguments);
    assert_eq!(out.status.code(), Some(1), "{arguments:?}");
    String::from_utf8(out.stderr).unwrap()
}

/// An answer that took a while is not lost because a file cannot be written: it stands on stdout, the error after it.
#[test]
#[ignore = "campaign"]
fn a_failed_write_loses_no_answer() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let csv = path(&folder, "axis.csv");
    done(&["simulate", "scenarios/servo-axis.toml", "-o", &csv]);
    // a folder stands where the file should go
    let taken = path(&folder, "taken.toml");
    std::fs::create_dir(&taken).unwrap();
    const AXIS: &str = "models/servo-axis.toml";
    for arguments in [
        &["identify", AXIS, &csv, "-o", &taken][..],
        &["diagnose", AXIS, &csv, "-o", &taken],
        &["add", AXIS, "drive_stribeck", &csv, "-o", &taken],
    ] {
        let out = run(&[arguments, &["--json"]].concat());
        let text = String::from_utf8_lossy(&out.stderr);
        assert_eq!(out.status.code(), Some(2), "{arguments:?}: {text}");
        assert!(text.contains("taken.toml"), "{text}");
        let answer: Value = serde_json::from_slice(&out.stdout).expect("the answer");
        assert_eq!(answer["noise_floor"].as_array().unwrap().len(), 1, "{answer}");
        let out = run(arguments);
        assert_eq!(out.status.code(), Some(2));
        let text = String::from_utf8_lossy(&out.stdout);
        assert!(text.contains("noise floor") && !text.contains("Wrote"), "{text}");
        let wide = text.lines().find(|l| l.chars().count() > 100);
        assert!(wide.is_none(), "{wide:?}");
        assert_eq!(text.contains("\n  Next\n"), arguments[0] == "diagnose", "{text}");
    }
}

//! Laws that give no number, steps that are too long, runs that fail under way: what is said, written and returned.

use crate::common;

use std::path::{Path, PathBuf};
use std::process::Output;

use assert_cmd::Command;
use deltatwin_io::recording;
use tempfile::TempDir;

/// A law that is a number until arm 1 has gone below 0.1 rad, on the shipped model.
const ROOT: &str = "
[effects.formula]
[[effects.formula.terms]]
name = \"well\"
at = \"drive1\"
law = \"sqrt(q1 - 0.1)\"
coefficient = 0.5
";

fn run(arguments: &[&str]) -> Output {
    Command::cargo_bin("deltatwin").unwrap().args(arguments).output().unwrap()
}

/// What is said on stderr beside an exit status.
fn ends(arguments: &[&str], status: i32) -> String {
    let out = run(arguments);
    let text = String::from_utf8(out.stderr).unwrap();
    assert_eq!(out.status.code(), Some(status), "{arguments:?}: {text}");
    assert!(!text.contains("panicked"), "{text}");
    text
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A model file with `change`, and a scenario on it that swings arm 1 through 0.1 rad, with a controller that does not know of it.
fn files(folder: &TempDir, change: impl Fn(String) -> String) -> [PathBuf; 2] {
    let [model, scenario, plain] = ["model.toml", "scenario.toml", "plain.toml"].map(|name| folder.path().join(name));
    std::fs::copy("models/irb360-6-1600.toml", plain).unwrap();
    std::fs::write(&model, change(std::fs::read_to_string("models/irb360-6-1600.toml").unwrap())).unwrap();
    let motion = "model = \"model.toml\"\ncontroller_model = \"plain.toml\"\nduration = 0.5\nnoise = false\n[motion]\nkind = \"fourier\"\nfrequency = 1.0\n\
                  centre = [0.0, 0.0, -1.0, 0.0]\nsine = [[0.0, 0.0, 0.1, 0.0]]\n";
    std::fs::write(&scenario, motion).unwrap();
    [model, scenario]
}

#[test]
fn a_law_without_a_number_is_named_where_it_is_first_met() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let [model, scenario] = files(&folder, |text| text + ROOT);
    let recording = folder.path().join("run.csv");
    let says = |text: &str| {
        for part in
            ["effect `formula`, term `well`: the law gives NaN", " at t = 0.", "q = (", "expected a finite number"]
        {
            assert!(text.contains(part), "{part}: {text}");
        }
    };
    // The twin: the sample at which the law ends is the last one written.
    says(&ends(&["simulate", text(&scenario), "-o", text(&recording)], 1));
    let written = recording::read(&recording, None).unwrap().0.signals;
    assert!(written.len() > 50 && written.q().iter().all(|q| q[0] > 0.099), "{}", written.len());
    // Predictions along a measured motion, and constraint forces.
    let whole = folder.path().join("whole.csv");
    let plain = TempDir::new().unwrap();
    let [_, healthy] = files(&plain, |text| text);
    ends(&["simulate", text(&healthy), "-o", text(&whole)], 0);
    for command in ["compare", "identify"] {
        let said = ends(&[command, text(&model), text(&whole)], 2);
        says(&said);
        assert!(said.contains(" at sample "), "{said}");
    }
    for motion in [&whole, &scenario] {
        let said = ends(&["forces", text(&model), text(motion)], 2);
        says(&said);
        assert!(said.contains(" at sample "), "{said}");
    }
}

#[test]
fn division_of_nothing_by_nothing_is_refused_at_once() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let [_, scenario] = files(&folder, |text| text + &ROOT.replace("sqrt(q1 - 0.1)", "0/0"));
    let said = ends(&["simulate", text(&scenario)], 1);
    assert!(said.contains("term `well`: the law gives NaN") && said.contains("t = 0.000000 s"), "{said}");
}

#[test]
fn a_run_whose_energy_does_not_close_is_no_success() {
    common::at_root();
    for (sample_time, cause) in [("0.02", "the energy balance does not close"), ("0.05", "the integration diverged")] {
        let folder = TempDir::new().unwrap();
        let slow = |text: String| text.replace("sample_time = 400e-6 ", &format!("sample_time = {sample_time} "));
        let [_, scenario] = files(&folder, slow);
        let motion = std::fs::read_to_string(&scenario).unwrap().replace("duration = 0.5", "duration = 5.0");
        std::fs::write(&scenario, motion.replace("frequency = 1.0", "frequency = 0.5")).unwrap();
        let recording = folder.path().join("run.csv");
        let said = ends(&["simulate", text(&scenario), "-o", text(&recording)], 1);
        assert!(said.contains(cause) && said.contains("too long for the motion"), "{said}");
        if cause.contains("diverged") {
            assert!(said.contains("q = (") && said.contains("platform at (") && said.contains("at t = "), "{said}");
        }
        assert!(recording.is_file(), "what was recorded is kept");
    }
}

/// Faults in lines longer than any screen, among files that are good: every file has its answer.
#[test]
fn faults_in_far_columns_are_answers_about_their_files_alone() {
    common::at_root();
    let folder = tempfile::tempdir().unwrap();
    let files: Vec<String> = ["\t", "x", "é", "漢", "\u{301}", "\u{200d}", "\u{7}", "\r", "\n"]
        .iter()
        .flat_map(|part| [1, 17_000, 70_000].map(|count| part.repeat(count)))
        .flat_map(|text| {
            [format!("x = \"{text}\" z"), format!("{text} = \"{text}\""), format!("x = [{text}, 1, \"{text}\"")]
        })
        .enumerate()
        .map(|(k, text)| {
            let file = folder.path().join(format!("long{k}.setup.toml"));
            std::fs::write(&file, text).unwrap();
            file.display().to_string()
        })
        .collect();
    let mut words = vec!["check", "models/servo-axis.toml"];
    words.extend(files.iter().map(String::as_str));
    words.extend(["models/linear-delta.toml", "--json"]);
    let out = run(&words);
    assert_eq!(out.status.code(), Some(2));
    let answer: serde_json::Value = serde_json::from_slice(&out.stdout).unwrap();
    let answers = answer["files"].as_array().unwrap();
    let good: Vec<usize> = (0..answers.len()).filter(|k| answers[*k]["good"] == true).collect();
    assert_eq!((answers.len(), good), (files.len() + 2, vec![0, files.len() + 1]));
    let said = String::from_utf8_lossy(&out.stderr);
    // The first text is one tab, the second many.
    assert!(!said.contains("panicked") && said.contains("long3.setup.toml:1:17008"), "{said:.2000}");
    assert!(said.lines().all(|line| line.chars().count() < 100_000));
}

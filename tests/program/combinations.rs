//! Every model with every kind of recording and option: an answer or a refusal that says what of, never a panic.

use crate::common;

use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use rayon::prelude::*;
use tempfile::TempDir;

/// Shipped models.
const MODELS: [&str; 6] = [
    "irb360-6-1600",
    "irb360-6-1600-truth",
    "irb360-6-1600-disassembled",
    "irb360-1-1130",
    "clavel-delta",
    "servo-axis",
];

/// Recordings of a tenth of a second: their scenario, and the model of a machine that moves so.
const RECORDINGS: [(&str, &str); 4] = [
    ("assembled", "scenarios/smoke.toml"),
    ("apart", "scenarios/disassembled.toml"),
    ("axis", "scenarios/servo-axis.toml"),
    ("three", "scenarios/clavel-delta.toml"),
];

fn run(arguments: &[String]) -> Output {
    Command::cargo_bin("deltatwin").unwrap().args(arguments).output().unwrap()
}

/// Shortens a scenario to a tenth of a second and runs it.
fn record(folder: &Path, name: &str, scenario: &str) {
    let text = std::fs::read_to_string(scenario).unwrap();
    let root = std::env::current_dir().unwrap().display().to_string();
    let short = |line: &str| match line.starts_with("duration") {
        true => "duration = 0.12".to_string(),
        false => line.replace("\"../models/", &format!("\"{root}/models/")),
    };
    let own = folder.join(format!("{name}-scenario.toml"));
    std::fs::write(&own, text.lines().map(short).collect::<Vec<_>>().join("\n")).unwrap();
    let out = folder.join(format!("{name}.csv"));
    let done = run(&["simulate", &own.display().to_string(), "-o", &out.display().to_string()].map(String::from));
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
}

/// Effects of a model file, with the links.
fn effects(model: &str) -> Vec<String> {
    let text = std::fs::read_to_string(model).unwrap();
    let named = text.lines().filter_map(|l| l.strip_prefix("[effects.")?.strip_suffix(']').map(String::from));
    named.chain(["rigid_bodies".to_string()]).collect()
}

/// Command lines on one model and one recording.
fn command_lines(folder: &Path, model: &str, recording: &str, number: usize) -> Vec<Vec<String>> {
    let model = format!("models/{model}.toml");
    let data = folder.join(format!("{recording}.csv")).display().to_string();
    let output = |kind: &str| folder.join(format!("{number}-{kind}.toml")).display().to_string();
    let hold: Vec<String> = effects(&model).into_iter().flat_map(|e| ["--hold".to_string(), e]).collect();
    let identify = |options: &[&str]| {
        let own = ["identify", &model, &data].into_iter().chain(options.iter().copied());
        own.map(String::from).collect::<Vec<_>>()
    };
    let mut all = vec![
        identify(&[]),
        identify(&["--payload"]),
        identify(&["--payload", "--json", "-o", &output("setup")]),
        identify(&["--limbs", "each", "--bodies", "complete", "-o", &output("each")]),
        identify(&["--bodies", "aligned", "--derivatives", "paper", "--gamma", "torque=1", "--gamma", "arm=0.1"]),
        identify(&["--gamma", "telescope_friction=2", "--json"]),
        [identify(&[]), hold.clone()].concat(),
        [identify(&["--payload"]), hold.clone()].concat(),
    ];
    let mut add = |line: &[&str]| all.push(line.iter().map(|s| s.to_string()).collect());
    add(&["compare", &model, &data, "--held-out", &data]);
    add(&["diagnose", &model, &data]);
    add(&["add", &model, "payload_com_offset", &data, "-o", &output("com")]);
    add(&["add", &model, "torque_bias", &data, "-o", &output("bias")]);
    add(&["forces", &model, &data]);
    let held: Vec<&str> = hold.iter().map(String::as_str).collect();
    add(&[&["diagnose", &model, &data], &held[..]].concat());
    all
}

/// What is wrong with an answer.
fn fault(arguments: &[String], out: &Output) -> Option<String> {
    let text = String::from_utf8_lossy(&out.stderr);
    let status = out.status.code();
    let what = format!("{}: status {status:?}: {text}", arguments.join(" "));
    if !matches!(status, Some(0..=2)) || text.contains("panicked") {
        return Some(what);
    }
    let stem = |path: &String| Path::new(path).file_stem().map(|s| s.to_string_lossy().into_owned());
    // The file, the option or the effect that is at fault.
    let named = arguments.iter().filter_map(stem).any(|name| text.contains(&name));
    (status == Some(2) && !named).then_some(what)
}

#[test]
#[ignore = "campaign"]
fn every_combination_is_answered_or_refused_by_name() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    RECORDINGS.par_iter().for_each(|(name, scenario)| record(folder.path(), name, scenario));
    let mut lines = Vec::new();
    for (i, model) in MODELS.iter().enumerate() {
        for (j, (recording, _)) in RECORDINGS.iter().enumerate() {
            lines.extend(command_lines(folder.path(), model, recording, 10 * i + j));
        }
        let output = folder.path().join(format!("{i}-excite.toml")).display().to_string();
        let model = format!("models/{model}.toml");
        let search = ["excite", &model, "-o", &output, "--starts", "1", "--iterations", "1", "--harmonics", "2"];
        lines.push(search.map(String::from).to_vec());
    }
    let faults: Vec<String> = lines.par_iter().filter_map(|line| fault(line, &run(line))).collect();
    println!("{} command lines", lines.len());
    assert!(faults.is_empty(), "{} of {}:\n{}", faults.len(), lines.len(), faults.join("\n"));
}

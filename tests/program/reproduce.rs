//! The paper's experiments on shortened scenarios: what the physics demands of their results.

use crate::common;

use std::path::{Path, PathBuf};

use assert_cmd::Command;
use deltatwin::machine::{every_axis, three_arms};
use deltatwin_validation::reproduce::page::{Comparison, Row};
use deltatwin_validation::reproduce::runs::Campaign;
use deltatwin_validation::reproduce::{arms, assembled, friction_curve, sections};
use tempfile::TempDir;

/// The shipped scenarios, shortened.
fn shortened() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let models = common::root().join("models");
    for entry in std::fs::read_dir("scenarios/reproduce").unwrap() {
        let file: PathBuf = entry.unwrap().path();
        let text = std::fs::read_to_string(&file).unwrap();
        let short: Vec<String> = text
            .lines()
            .map(|line| match line.split_once(" = ").map(|(key, _)| key) {
                Some("duration") => "duration = 8.0".into(),
                Some("speeds") => "speeds = [3.0, 8.0, 15.0, 30.0, 55.8]".into(),
                Some("hold") => "hold = 2.0".into(),
                Some("repeat") => "repeat = 1".into(),
                _ => line.replace("../../models", &models.display().to_string()),
            })
            .collect();
        std::fs::write(folder.path().join(file.file_name().unwrap()), short.join("\n")).unwrap();
    }
    folder
}

/// Every estimate within three standard errors of the truth, and every standard error small.
fn near(rows: &[Row]) {
    for row in rows {
        let errors = row.errors(0).unwrap_or_else(|| panic!("{} has no standard error", row.quantity));
        println!("{:<20} {:?} {errors:+.1} σ", row.quantity, row.ours[0]);
        assert!(errors.abs() < 3.0, "{}: {:?}, {:?}", row.quantity, row.ours, row.truth);
    }
    assert!(Comparison::new("", rows.to_vec()).misses(0).0.is_empty());
}

#[test]
fn socket_friction_and_nothing_else_inflates_the_viscous_friction_of_the_drives() {
    common::at_root();
    let folder = shortened();
    let campaign = Campaign::run(folder.path(), 1, &|_| true).unwrap();

    // Σ from rests: 1250 samples at each of six poses give a standard error of 0.8 %.
    let sigma = arms::noise(&campaign);
    for axis in every_axis() {
        let truth = campaign.disassembled.noise.torque[axis];
        assert!((sigma[axis] / truth - 1.0).abs() < 0.05, "{sigma:?}");
    }

    let table_1 = arms::identify(&campaign.disassembled, &campaign.arms[0], &sigma).unwrap();
    assert_eq!(table_1.rows.len(), 5 * 3 + 3);
    near(&table_1.rows);
    let theta = table_1.value(0, "Θ_yy").unwrap();
    assert!(theta.std.unwrap() < 1e-3, "{theta:?}");
    assert!(table_1.difference < 1e-10, "{:e}", table_1.difference);

    let points = friction_curve::points(&campaign.constant_speed);
    assert_eq!(points.len(), 10);
    let curve = friction_curve::fit(&points).unwrap();
    let truth = campaign.robot.effects.iter().find(|a| a.effect.name() == "axis4_friction").unwrap();
    for i in 0..3 {
        println!("eq. 48: {} ± {} {}", curve.values[i], curve.std[i], truth.values[i]);
        assert!((curve.values[i] - truth.values[i]).abs() < 3.0 * curve.std[i], "{curve:?}");
        assert!(curve.std[i] < 0.01 * truth.values[i], "{curve:?}");
    }

    let prior = assembled::prior(&campaign.known, &table_1, &curve);
    let found = assembled::identify(&campaign, prior, &sigma).unwrap();
    let inflation = found.inflation(&table_1);
    println!("growth of p_v: {inflation:.2?}");
    assert!(inflation[0].iter().all(|f| *f > 2.0), "{inflation:?}");
    for fitted in [&found.free, &found.complete] {
        for arm in three_arms() {
            let p_v = assembled::estimate(fitted, &format!("drive_friction.viscous_{}", arm + 1)).unwrap();
            let truth = table_1.rows.iter().find(|r| r.quantity == format!("arm {}: p_v", arm + 1)).unwrap().truth;
            let errors = (p_v.value - truth.unwrap()) / p_v.std.unwrap();
            println!("p_v of drive {}: {p_v:?} {errors:+.1} σ", arm + 1);
            assert!(errors.abs() < 3.0, "{p_v:?} {truth:?}");
        }
    }
    // What the paper's model cannot explain is there with socket friction only.
    let [with, free, complete] =
        [&found.paper, &found.free, &found.complete].map(|f| f.residuals.rms[three_arms()].to_vec());
    for arm in three_arms() {
        assert!(with[arm] > 1.1 * sigma[arm], "{with:?}");
        assert!(free[arm] < 1.05 * sigma[arm] && complete[arm] < 1.05 * sigma[arm], "{free:?} {complete:?}");
    }
}

#[test]
fn every_section_has_its_figures_and_numbers() {
    common::at_root();
    let folder = shortened();
    let campaign = Campaign::run(folder.path(), 2, &|_| true).unwrap();
    let sections = sections(&campaign, &|_| ()).unwrap();
    let keys: Vec<&str> = sections.iter().map(|s| s.key).collect();
    let expected = [
        "covariance",
        "table_1",
        "figure_8",
        "table_2",
        "table_3",
        "table_4",
        "figure_10",
        "figure_11",
        "figure_13",
        "figure_14",
        "figure_15",
        "figure_16",
        "figure_17",
    ];
    assert_eq!(keys, expected);
    let figures: Vec<&str> = sections.iter().flat_map(|s| &s.plots).map(|p| p.name).collect();
    let expected = [
        "figure-8",
        "figure-9",
        "figure-10",
        "figure-11",
        "figure-13",
        "figure-14",
        "figure-15",
        "figure-16",
        "figure-16-executed",
        "figure-16-torques",
        "figure-17",
    ];
    assert_eq!(figures, expected);
    for section in &sections {
        let text = section.markdown();
        assert!(!text.contains("NaN") && !text.contains("inf"), "{text}");
        assert!(!section.tables.is_empty() && !section.agreement.is_empty(), "{}", section.key);
        assert!(section.plots.iter().all(|p| !p.figure.svg().contains("no data")), "{}", section.key);
    }
}

#[test]
fn the_command_writes_a_page_and_says_what_is_missing() {
    common::at_root();
    let folder = shortened();
    let output = folder.path().join("out");
    let run = |scenarios: &Path| {
        Command::cargo_bin("deltatwin")
            .unwrap()
            .args(["reproduce", "--json", "--seed", "3", "-o"])
            .arg(&output)
            .arg("--scenarios")
            .arg(scenarios)
            .output()
            .unwrap()
    };
    let done = run(folder.path());
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    let answer: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(answer["results"]["table_1"]["tables"][0]["rows"].as_array().unwrap().len(), 18);
    let page = std::fs::read_to_string(output.join("reproduce.md")).unwrap();
    for line in page.lines().filter(|l| l.starts_with("![")) {
        let file = line.rsplit_once('(').unwrap().1.trim_end_matches(')');
        assert!(output.join(file).is_file(), "{line}");
    }
    assert!(output.join("verification.mcap").is_file());
    let refused = run(&folder.path().join("nowhere"));
    assert_eq!(refused.status.code(), Some(2));
    let message = String::from_utf8(refused.stderr).unwrap();
    assert!(message.contains("arms-excitation.toml") && !message.contains("panicked"), "{message}");
}

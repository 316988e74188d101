//! Studies: the table is the same however it was made, runs are made again, and mistakes are named.

use crate::common;

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use serde_json::Value;
use tempfile::TempDir;

/// A tenth of a second of a fast motion with weak sockets, of which some hold.
const SCENARIO: &str = r#"
controller_model = "models/irb360-6-1600.toml"
model = "models/irb360-6-1600-truth.toml"
duration = 0.1

[motion]
kind = "fourier"
frequency = 2.0
centre = [0.0, 0.0, -1.05, 0.0]
sine = [[0.1, 0.05, 0.03, 1.0]]
cosine = [[0.0, 0.1, 0.0, 0.3]]

[payload]
mass = 2.0
com = [0.0, 0.0, -0.1]

[sockets]
draw = { sigma = 10.0 }
"#;

const STUDY: &str = r#"
scenario = "scenario.toml"
seed = 3
keep = "none"

[design]
kind = "sobol"
runs = RUNS

[[factors]]
name = "mass"
key = "payload.mass"
unit = "kg"
from = 0.5
to = 6.0

[[factors]]
name = "offset"
key = "payload.com.x"
unit = "m"
distribution = { kind = "normal", mean = 0.1, sigma = 0.1 }

[[factors]]
name = "controller"
key = "controller_model"
levels = ["models/irb360-6-1600.toml", "models/irb360-6-1600-truth.toml"]
"#;

/// A study of `runs` runs in a folder of its own.
struct Place {
    folder: TempDir,
}

impl Place {
    fn new(runs: u64) -> Self {
        common::at_root();
        let folder = tempfile::tempdir().unwrap();
        // Beside the study, so that its text and with it its random numbers are the same everywhere.
        std::fs::create_dir(folder.path().join("models")).unwrap();
        for model in ["models/irb360-6-1600.toml", "models/irb360-6-1600-truth.toml"] {
            std::fs::copy(model, folder.path().join(model)).unwrap();
        }
        std::fs::write(folder.path().join("scenario.toml"), SCENARIO).unwrap();
        std::fs::write(folder.path().join("study.toml"), STUDY.replace("RUNS", &runs.to_string())).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, output: &str, options: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_deltatwin"));
        command.args(["study", &self.path("study.toml").display().to_string()]);
        command.args(["-o", &self.path(output).display().to_string()]).args(options);
        command
    }

    fn run(&self, output: &str, options: &[&str]) -> (i32, String, String) {
        let out = self.command(output, options).output().unwrap();
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        (out.status.code().unwrap_or(-1), text(&out.stdout), text(&out.stderr))
    }

    fn done(&self, output: &str, options: &[&str]) -> String {
        let (status, stdout, stderr) = self.run(output, options);
        assert_eq!(status, 0, "{options:?}\n{stdout}\n{stderr}");
        stdout
    }

    fn table(&self, output: &str) -> Vec<u8> {
        std::fs::read(self.path(output).join("runs.parquet")).unwrap()
    }
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

#[test]
fn the_table_depends_on_neither_threads_nor_chunks() {
    let place = Place::new(40);
    let answer: Value = serde_json::from_str(&place.done("whole", &["--json"])).unwrap();
    assert_eq!((answer["runs"].as_u64(), answer["errors"].as_u64()), (Some(40), Some(0)), "{answer}");
    let failed = answer["failed"].as_u64().unwrap();
    assert!(failed > 2 && failed < 38, "{answer}");
    let whole = place.table("whole");
    for (output, threads, chunks) in [("one", "1", 1), ("two", "2", 2), ("seven", "3", 7)] {
        // The last chunk first.
        for number in (1..=chunks).rev() {
            let chunk = format!("{number}/{chunks}");
            let out = place.command(output, &["--chunk", &chunk]).env("RAYON_NUM_THREADS", threads).output().unwrap();
            assert!(out.status.success());
            // One part, and nothing else.
            assert_eq!(names(&place.path(output)), ["parts"]);
            let parts = names(&place.path(output).join("parts"));
            assert!(parts[0] == ".study" && parts.len() == chunks + 2 - number, "{parts:?}");
        }
        place.done(output, &["--merge"]);
        assert!(place.table(output) == whole, "{chunks} chunks");
    }
    // The same in another folder, and nothing is made twice.
    let before = std::fs::metadata(place.path("whole/runs.parquet")).unwrap().modified().unwrap();
    place.done("whole", &[]);
    assert_eq!(before, std::fs::metadata(place.path("whole/runs.parquet")).unwrap().modified().unwrap());
}

#[test]
fn kills_at_any_time_change_nothing() {
    let place = Place::new(150);
    // Without failures, which take so long that no process would come to the end of one.
    let study = place.path("study.toml");
    let text = std::fs::read_to_string(&study).unwrap();
    std::fs::write(
        &study,
        text.replace("to = 6.0", "to = 1.0").replace("mean = 0.1, sigma = 0.1", "mean = 0.0, sigma = 0.01"),
    )
    .unwrap();
    place.done("whole", &[]);
    let whole = place.table("whole");
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut kills, mut completed) = (0, 0);
    // Whole studies, and chunks that are merged.
    for round in 0.. {
        let output = format!("round-{round}");
        let steps: &[&[&str]] =
            if round % 2 == 0 { &[&[]] } else { &[&["--chunk", "1/2"], &["--chunk", "2/2"], &["--merge"]] };
        for options in steps {
            loop {
                let mut child =
                    place.command(&output, options).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
                std::thread::sleep(Duration::from_millis(rng.random_range(5..500 + 20 * kills)));
                if child.try_wait().unwrap().is_some_and(|status| status.success()) {
                    break;
                }
                child.kill().unwrap();
                if child.wait().unwrap().success() {
                    break;
                }
                kills += 1;
            }
        }
        completed += 1;
        assert!(place.table(&output) == whole, "after {kills} kills");
        if kills >= 20 && completed >= 2 {
            break;
        }
    }
}

#[test]
fn any_run_is_made_again_from_its_row() {
    let place = Place::new(12);
    let answer: Value = serde_json::from_str(&place.done("out", &["--json"])).unwrap();
    let worst = answer["worst_run"].as_u64().unwrap().to_string();
    let bag = place.path("again.mcap").display().to_string();
    let again: Value = serde_json::from_str(&place.done("out", &["--run", &worst, "--mcap", &bag, "--json"])).unwrap();
    assert_eq!((again["same_as_table"].as_bool(), again["survived"].as_bool()), (Some(true), Some(false)), "{again}");
    assert_eq!(again["margin"], answer["least_margin"]);
    let (recording, _) = deltatwin_io::recording::read(Path::new(&bag), None).unwrap();
    assert!(recording.signals.len() > 100);
    // Without a table the plan gives the same run.
    let apart: Value = serde_json::from_str(&place.done("empty", &["--run", &worst, "--json"])).unwrap();
    assert_eq!((&apart["margin"], &apart["same_as_table"]), (&again["margin"], &Value::Null));
    assert!(!place.path("empty").exists());
    let (status, _, stderr) = place.run("out", &["--run", "12"]);
    assert!(status == 2 && stderr.contains("no run 12; expected a number from 0 to 11"), "{stderr}");
}

#[test]
fn recordings_are_kept_by_rule() {
    let place = Place::new(10);
    let study = place.path("study.toml");
    let text = std::fs::read_to_string(&study).unwrap();
    std::fs::write(&study, text.replace("\"none\"", "\"failed\"")).unwrap();
    let answer: Value = serde_json::from_str(&place.done("failed", &["--json"])).unwrap();
    let kept = names(&place.path("failed/recordings"));
    assert_eq!(kept.len() as u64, answer["failed"].as_u64().unwrap(), "{kept:?}");
    std::fs::write(&study, text.replace("\"none\"", "[2, 7]")).unwrap();
    place.done("some", &[]);
    assert_eq!(names(&place.path("some/recordings")), ["run-000002.mcap", "run-000007.mcap"]);
    assert!(place.table("failed") == place.table("some"), "the rule has no influence on the table");
}

#[test]
fn what_is_in_the_way_or_missing_is_named() {
    let place = Place::new(9);
    place.done("out", &["--chunk", "1/3"]);
    let (status, _, stderr) = place.run("out", &["--merge"]);
    assert!(status == 2 && stderr.contains("6 of 9 runs are missing, the first is run 3"), "{stderr}");
    assert!(stderr.contains("--chunk 2/3") && stderr.contains("--chunk 3/3"), "{stderr}");
    let study = place.path("study.toml");
    let text = std::fs::read_to_string(&study).unwrap();
    std::fs::write(&study, text.replace("seed = 3", "seed = 4")).unwrap();
    let (status, _, stderr) = place.run("out", &["--merge"]);
    assert!(status == 2 && stderr.contains("belongs to another study"), "{stderr}");
    // Refused before the first run, and the first study goes on.
    for options in [&[][..], &["--chunk", "2/3"]] {
        let (status, _, stderr) = place.run("out", options);
        assert!(status == 2 && stderr.contains("study (digest ") && stderr.contains("this one is study"), "{stderr}");
        assert_eq!(names(&place.path("out/parts")), [".study", "00001-of-00003.parquet"]);
    }
    std::fs::write(&study, &text).unwrap();
    for chunk in ["2/3", "3/3"] {
        place.done("out", &["--chunk", chunk]);
    }
    place.done("out", &["--merge"]);
    std::fs::write(&study, text.replace("seed = 3", "seed = 4")).unwrap();
    place.done("out", &["--force"]);
    for (from, to, expected) in [
        ("payload.mass", "payload.maas", "study.toml:11:8: factor `mass` at 0.5: unknown key `payload.maas`"),
        ("to = 6.0", "to = 600.0", "factor `mass` at 600: `payload.mass` is 600; expected a number from 0 to 100 kg"),
        ("\"mass\"", "\"margin\"", "factor `margin` has the name of another column"),
        ("\"sobol\"", "\"subset\"\nsamples = 20", "has no meaning for kind = \"subset\""),
    ] {
        std::fs::write(&study, text.replacen(from, to, 1)).unwrap();
        let (status, _, stderr) = place.run("new", &[]);
        assert!(status == 2 && stderr.contains(expected), "{expected}\n{stderr}");
    }
    assert!(!place.path("new").exists());
}

#[test]
fn searches_find_the_boundary_the_worst_and_the_rare() {
    let place = Place::new(60);
    let study = place.path("study.toml");
    let text = std::fs::read_to_string(&study).unwrap();
    let text = &text[..text.rfind("[[factors]]").unwrap()]
        .replace("distribution = { kind = \"normal\", mean = 0.1, sigma = 0.1 }", "from = 0.0\nto = 0.4");
    let text = &text.replace("seed = 3", "seed = 3\ndraws = \"same\"");
    // Least margin of the search: at the corner of greatest mass and offset.
    std::fs::write(&study, text.replace("\"sobol\"", "\"worst_case\"")).unwrap();
    let worst: Value = serde_json::from_str(&place.done("worst", &["--json"])).unwrap();
    let row: Value = serde_json::from_str(
        &place.done("worst", &["--json", "--run", &worst["worst_run"].as_u64().unwrap().to_string()]),
    )
    .unwrap();
    assert!(
        row["factors"]["mass"].as_f64().unwrap() == 6.0 && row["factors"]["offset"].as_f64().unwrap() == 0.4,
        "{row}"
    );
    let (status, _, stderr) = place.run("worst2", &["--chunk", "1/2"]);
    assert!(status == 2 && stderr.contains("cannot be cut into chunks"), "{stderr}");
    // A subset simulation, whose result is told again from the table.
    let rare = "\"subset\"\nsamples = 20\nshare = 0.5\nlevels = 2";
    std::fs::write(&study, text.replace("\"sobol\"", rare).replace("runs = 60", "")).unwrap();
    let first: Value = serde_json::from_str(&place.done("rare", &["--json"])).unwrap();
    let probability = first["probability"]["value"].as_f64().unwrap();
    assert!(probability > 0.0 && probability < 1.0 && first["runs"] == first["probability"]["runs"], "{first}");
    assert_eq!(first, serde_json::from_str::<Value>(&place.done("rare", &["--json"])).unwrap());
    // Points of the boundary: the margin of the run next to it is just below zero. A drive may saturate in a run that
    // survives; where the robot does not catch up any more, the torque needed is beyond the limit by a tenth.
    let boundary = "\"boundary\"\nalong = [\"mass\", \"offset\"]\nrays = 5\ntolerance = 1e-4";
    std::fs::write(&study, text.replace("\"sobol\"", boundary).replace("runs = 60", "")).unwrap();
    place.done("rays", &[]);
    for run in ["1", "3"] {
        let row: Value = serde_json::from_str(&place.done("rays", &["--json", "--run", run])).unwrap();
        let margin = row["margin"].as_f64().unwrap();
        let least = if row["cause"] == "drive torque" { -0.15 } else { -2e-3 };
        assert!(row["same_as_table"] == true && (least..0.0).contains(&margin), "{row}");
    }
}

const EXPERIMENTS: &str = r#"
model = "models/irb360-6-1600.toml"

[design]
kind = "grid"

[[factors]]
name = "effect"
key = "effect"
levels = ["none", "torque_bias"]

[[factors]]
name = "size"
key = "size"
levels = ["large"]

[[factors]]
name = "length"
key = "duration"
unit = "s"
levels = [4]
"#;

#[test]
fn experiments_are_studies_too() {
    let place = Place::new(1);
    let models = std::fs::canonicalize("models").unwrap().display().to_string();
    let study = place.path("study.toml");
    let text = EXPERIMENTS.replace("MODELS", &models);
    std::fs::write(&study, &text).unwrap();
    let answer: Value = serde_json::from_str(&place.done("whole", &["--json"])).unwrap();
    assert_eq!(answer["runs"], 2, "{answer}");
    assert_eq!(answer["by"]["effect"]["torque_bias"]["of"], 1, "{answer}");
    for chunk in ["2/2", "1/2"] {
        place.done("parts", &["--chunk", chunk]);
    }
    place.done("parts", &["--merge"]);
    assert!(place.table("whole") == place.table("parts"));
    for (from, to, expected) in [
        ("torque_bias", "torque_bais", "`effect` is torque_bais; expected none, "),
        ("torque_bias", "torque_bais", "did you mean torque_bias?"),
        ("\"large\"", "\"huge\"", "`size` is huge; expected small, medium, large"),
        ("\"duration\"", "\"lenght\"", "has the key `lenght`; expected, in an experiment, one of effect, size"),
        ("levels = [4]", "levels = [0.5]", "`duration` is 0.5; expected a number from 1 to 600 s"),
    ] {
        std::fs::write(&study, text.replace(from, to)).unwrap();
        let (status, _, stderr) = place.run("new", &[]);
        assert!(status == 2 && stderr.contains(expected) && stderr.contains("study.toml:"), "{expected}\n{stderr}");
    }
}

/// Friction in the sockets that the controller's model does not have: 2 s of a recording name it, and a healthy robot passes.
#[test]
fn the_diagnosis_of_the_runs_names_what_wears() {
    let place = Place::new(1);
    let write = |study: &str| std::fs::write(place.path("study.toml"), study).unwrap();
    let models = std::fs::canonicalize("models").unwrap().display().to_string();
    let scenario = SCENARIO
        .replace("irb360-6-1600-truth.toml", "irb360-6-1600.toml")
        .replace("MODELS", &models)
        .replace("duration = 0.1", "duration = 3.0\nnoise = true")
        .replace("[sockets]\ndraw = { sigma = 10.0 }\n", "")
        .replace("frequency = 2.0", "frequency = 1.0");
    std::fs::write(place.path("scenario.toml"), &scenario).unwrap();
    let study = r#"
scenario = "scenario.toml"
over = "moment"
diagnose = true

[design]
kind = "grid"

[[factors]]
name = "moment"
key = "model.effects.ball_socket_coulomb.moment"
unit = "N·m"
levels = [0.0, 0.5]

[[factors]]
name = "regularisation"
key = "model.effects.ball_socket_coulomb.regularisation"
levels = [0.05]
"#;
    write(study);
    let answer: Value = serde_json::from_str(&place.done("study", &["--json"])).unwrap();
    let diagnosed = &answer["diagnosed"];
    assert_eq!(diagnosed["named"], serde_json::json!({ "ball_socket_coulomb": 1 }), "{answer}");
    assert_eq!((diagnosed["runs"].as_u64(), diagnosed["unknown"].as_u64()), (Some(2), Some(0)), "{answer}");
    assert_eq!(diagnosed["named_from"].as_f64(), Some(0.5), "{answer}");
    // A run again is that of the table, although its verdict was made with a diagnosis.
    assert!(place.done("study", &["--run", "1"]).contains("bit by bit"));
    // Without a model to compare with there is nothing to name.
    let first = scenario.lines().find(|line| line.starts_with("controller_model")).unwrap();
    std::fs::write(place.path("scenario.toml"), scenario.replace(first, "")).unwrap();
    let (status, _, stderr) = place.run("other", &[]);
    assert!(status == 2 && stderr.contains("controller_model"), "{status} {stderr}");
}

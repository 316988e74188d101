//! What the program says of broken inputs, whole and word by word, against `tests/snapshots/messages.txt`.
//!
//! On Unix, where the system's own words in them are the same.
#![cfg(unix)]

use crate::common;
use crate::snapshot;

use std::path::Path;

use assert_cmd::Command;
use tempfile::TempDir;

const SNAPSHOT: &str = "tests/snapshots/messages.txt";

/// Head of the snapshot.
const HEAD: &str = "\
What the program says of broken inputs. Each block is one case: its name, what departs from the sound files, the command, its
exit status, and what stands on stderr. The sound files are `robot.toml` (the shipped IRB 360-6/1600), `axis.toml` (the
servo axis), `run.toml` (the scenario smoke.toml on robot.toml), `pick.toml` (pick-and-place.toml), `path.toml` (u-turn.toml),
and `run.csv`, 300 samples of the axis.
";

/// An input that is refused.
struct Case {
    name: String,
    /// What was changed in which sound file, or the content of a file of its own.
    change: Change,
    /// Arguments of the program.
    command: String,
}

enum Change {
    /// Nothing: the command line is what is wrong.
    None,
    /// Replaces the text once.
    Replaced { file: &'static str, old: &'static str, new: &'static str },
    /// Ends the file before a text.
    CutBefore { file: &'static str, text: &'static str },
    /// Multiplies a column of `run.csv`.
    Scaled { column: usize, by: i64 },
    /// Sets a column of `run.csv` to one value.
    Constant { column: usize, to: &'static str },
    /// A file that stands beside the sound ones.
    Written { file: &'static str, text: &'static str },
}

/// `robot.toml` with a replacement, and `check robot.toml`.
const MODELS: &[[&str; 3]] = &[
    ["misspelt key", "arm_length = 0.500", "arm_lenght = 0.500"],
    ["misspelt table", "[bodies.platform]", "[bodies.plattform]"],
    ["unknown effect with a near name", "[effects.drive_friction]", "[effects.drive_frictoin]"],
    ["unknown effect", "[effects.drive_friction]", "[effects.gremlins]"],
    ["text instead of a number", "base_radius = 0.200", "base_radius = \"200 mm\""],
    ["array of the wrong length", "arm_limits = [-0.703, 1.745]", "arm_limits = [-0.703]"],
    ["parameter out of range", "sample_time = 400e-6", "sample_time = -400e-6"],
    ["number that is none", "gravity = 9.81", "gravity = nan"],
    ["impossible body", "inertia = [1.50e-5, 0.075, 0.075]", "inertia = [1.50e-5, 0.75, 0.075]"],
    ["missing key", "strut_length = 1.106", "# strut_length = 1.106"],
    ["limits in the wrong order", "arm_limits = [-0.703, 1.745]", "arm_limits = [1.745, -0.703]"],
    ["struts that do not reach", "strut_length = 1.106", "strut_length = 0.106"],
    ["no TOML", "base_radius = 0.200", "base_radius = = 0.200"],
    ["key given twice", "arm_length = 0.500", "arm_length = 0.500\narm_length = 0.500"],
];

/// `run.toml` with a replacement, and `simulate run.toml`.
const SCENARIOS: &[[&str; 3]] = &[
    ["misspelt key", "duration = 0.5", "durration = 0.5"],
    ["misspelt key of the motion", "frequency = 1.0", "frequenzy = 1.0"],
    ["unknown kind of motion", "kind = \"fourier\"", "kind = \"forier\""],
    ["text instead of a number", "duration = 0.5", "duration = \"0.5 s\""],
    ["negative duration", "duration = 0.5", "duration = -0.5"],
    ["model that is not there", "model = \"robot.toml\"\nc", "model = \"robbot.toml\"\nc"],
    ["rows of the wrong length", "[0.02, 0.06, 0.01, 0.2]]", "[0.02, 0.06]]"],
    ["out of reach", "centre = [0.0, 0.0, -1.05, 0.0]", "centre = [0.9, 0.0, -1.05, 0.0]"],
    ["unknown strut", "strut_upper = [1]", "strut_upper = [7]"],
    ["missing key", "frequency = 1.0", "# frequency = 1.0"],
    ["missing table", "[motion]", "[sensor]"],
];

/// `pick.toml` with a replacement, and `simulate pick.toml`.
const CELLS: &[[&str; 3]] = &[
    ["object that is not there", "pick = \"can\"", "pick = \"cann\""],
    ["object that cannot be picked", "pick = \"can\"", "pick = \"table\""],
    ["unknown shape", "shape = \"cylinder\"", "shape = \"zylinder\""],
    ["free object without a mass", "mass = 0.5 ", "# mass = 0.5 "],
    ["release before pick", "t = 0.85\n", "t = 0.05\n"],
    ["size of the wrong length", "size = [0.3, 0.4, 0.05]", "size = [0.3, 0.4]"],
];

/// `run.csv` with a replacement, and `check run.csv --model axis.toml`.
const RECORDINGS: &[[&str; 3]] = &[
    ["missing column", "t,q1,tau1\n", "t,q1,temperature\n"],
    ["torque in per mille", "t,q1,tau1\n", "t,q1,Torque [‰]\n"],
    ["torque in counts", "t,q1,tau1\n", "t,q1,Torque (counts)\n"],
    ["column given twice", "t,q1,tau1\n", "t,q1,q1\n"],
    ["NaN in a row", "0.400,-0.100,", "0.400,NaN,"],
    ["empty cell", "0.400,-0.100,", "0.400,,"],
    ["decimal comma", "0.400,-0.100,", "0,400,-0,100,"],
    ["no number", "0.400,-0.100,", "0.400,-0.1.0,"],
    ["time that goes back", "0.400,-0.100,", "0.300,-0.100,"],
    ["time that repeats with other values", "0.400,-0.100,", "0.398,-0.101,"],
];

/// A sidecar beside `run.csv`, and `check run.csv --model axis.toml`.
const SETUPS: &[[&str; 2]] = &[
    ["misspelt key", "[payload]\nmas = 2.5\n"],
    ["misspelt table", "[payloat]\nmass = 2.5\n"],
    ["negative mass", "[payload]\nmass = -2.5\n"],
    ["text instead of a number", "[payload]\nmass = \"2.5 kg\"\n"],
    ["unknown configuration", "configuration = \"asembled\"\n"],
    ["noise of the wrong length", "[noise]\ntorque = [0.5, 0.5]\n"],
    ["column that is not there", "[columns]\ntau1 = \"current*0.12\"\n"],
    ["channel that is not there", "[columns]\ntau9 = \"tau1\"\n"],
    ["unknown unit", "[columns]\ntau1 = \"tau1[furlong]\"\n"],
];

/// `path.toml` with a replacement, and `plan robot.toml path.toml`.
const PATHS: &[[&str; 3]] = &[
    ["misspelt key", "strut_upper = 120.0", "strut_uper = 120.0"],
    ["unknown kind of path", "kind = \"b_spline\"", "kind = \"nurbs\""],
    ["negative limit", "strut_upper = 120.0", "strut_upper = -120.0"],
    ["margin of more than all", "margin = 0.1", "margin = 1.1"],
    ["point of the wrong length", "[0.0, 0.4, -0.94, 0.0]", "[0.0, 0.4, -0.94]"],
    ["out of reach", "[0.0, 0.4, -0.94, 0.0]", "[0.0, 4.4, -0.94, 0.0]"],
    ["too heavy at rest", "mass = 2.5", "mass = 40.0"],
];

/// Command lines on the sound files.
const COMMAND_LINES: &[[&str; 2]] = &[
    ["misspelt command", "simulat run.toml"],
    ["misspelt option", "simulate run.toml --ouput run.mcap"],
    ["missing argument", "simulate"],
    ["text instead of a number", "demo --seed one"],
    ["two runs with the same output", "simulate run.toml sub/run.toml -o runs"],
    ["file that is not there", "check absent.toml"],
    ["recording that is not there", "check absent.csv"],
    ["unknown kind of file", "check run.xyz"],
    ["unknown effect with a near name", "effects ball_socket_colomb"],
    ["effect to add that is none", "add axis.toml drive_stribek run.csv -o better.toml"],
    ["effect to hold that is none", "identify axis.toml run.csv --hold drive_fricton"],
    ["output of unknown kind", "simulate run.toml -o run.txt"],
    ["scenario instead of a model", "check run.csv --model run.toml"],
    ["model instead of a scenario", "simulate robot.toml"],
    ["path instead of a model", "check run.csv --model path.toml"],
    ["scenario instead of a path", "plan robot.toml run.toml"],
    ["recording of another machine", "compare robot.toml run.csv"],
    ["column of a map that is not there", "check run.csv --model axis.toml --map tau1=current"],
    ["map that is none", "check run.csv --model axis.toml --map tau1"],
];

fn cases() -> Vec<Case> {
    let mut all = Vec::new();
    let mut replaced = |what: &str, file: &'static str, table: &'static [[&str; 3]], command: &str| {
        all.extend(table.iter().map(|&[name, old, new]| Case {
            name: format!("{what}: {name}"),
            change: Change::Replaced { file, old, new },
            command: command.into(),
        }));
    };
    const CHECK: &str = "check run.csv --model axis.toml";
    replaced("model", "robot.toml", MODELS, "check robot.toml");
    replaced("scenario", "run.toml", SCENARIOS, "simulate run.toml");
    replaced("cell", "pick.toml", CELLS, "simulate pick.toml");
    replaced("recording", "run.csv", RECORDINGS, CHECK);
    replaced("path", "path.toml", PATHS, "plan robot.toml path.toml");
    let mut changed = |name: &str, change: Change, command: &str| {
        all.push(Case { name: name.into(), change, command: command.into() });
    };
    changed("recording: cut short in a row", Change::CutBefore { file: "run.csv", text: "012," }, CHECK);
    changed("recording: cut short after the header", Change::CutBefore { file: "run.csv", text: "0.000,-" }, CHECK);
    changed("recording: empty", Change::CutBefore { file: "run.csv", text: "t,q1" }, CHECK);
    changed("recording: milliseconds", Change::Scaled { column: 0, by: 1000 }, CHECK);
    changed("recording: torque without bounds", Change::Scaled { column: 2, by: 1_000_000_000 }, CHECK);
    changed("recording: angle that never changes", Change::Constant { column: 1, to: "0.1" }, CHECK);
    changed("model: cut short", Change::CutBefore { file: "robot.toml", text: "0.003, 0.003]" }, "check robot.toml");
    changed("scenario: cut short", Change::CutBefore { file: "run.toml", text: "frequency" }, "simulate run.toml");
    for &[name, text] in SETUPS {
        let name = format!("setup: {name}");
        changed(&name, Change::Written { file: "run.setup.toml", text }, CHECK);
    }
    for &[name, command] in COMMAND_LINES {
        changed(&format!("command line: {name}"), Change::None, command);
    }
    all
}

/// 300 samples of an axis at 500 Hz in decimals that every machine writes alike.
fn recording() -> String {
    let row = |k: i64| {
        let angle = 100 - (k % 200 - 100).abs() * 2;
        let sign = if angle < 0 { "-" } else { "" };
        format!("{}.{:03},{sign}0.{:03},{}.5\n", k / 500, 2 * k % 1000, angle.abs(), 10 + k % 7)
    };
    std::iter::once("t,q1,tau1\n".to_string()).chain((0..300).map(row)).collect()
}

/// Writes the sound files and then the change.
fn write_files(folder: &Path, change: &Change) {
    let read = |file: &str| std::fs::read_to_string(common::root().join(file)).expect("a shipped file");
    let own = |text: String| {
        text.replace("../models/irb360-6-1600-truth.toml", "robot.toml")
            .replace("../models/irb360-6-1600.toml", "robot.toml")
    };
    let write = |file: &str, text: &str| std::fs::write(folder.join(file), text).expect("a file is written");
    write("robot.toml", &read("models/irb360-6-1600.toml"));
    write("axis.toml", &read("models/servo-axis.toml"));
    write("run.toml", &own(read("scenarios/smoke.toml")));
    write("pick.toml", &own(read("scenarios/pick-and-place.toml")));
    write("path.toml", &read("scenarios/u-turn.toml"));
    write("run.csv", &recording());
    std::fs::create_dir(folder.join("sub")).expect("a folder is made");
    write("sub/run.toml", &own(read("scenarios/smoke.toml")).replace("robot.toml", "../robot.toml"));
    let sound = |file: &str| std::fs::read_to_string(folder.join(file)).expect("a sound file");
    let by_row = |change: &dyn Fn(&mut Vec<String>)| {
        let row = |line: &str| {
            let mut cells: Vec<String> = line.split(',').map(String::from).collect();
            if line.starts_with(|c: char| c.is_ascii_digit()) {
                change(&mut cells);
            }
            cells.join(",") + "\n"
        };
        recording().lines().map(row).collect::<String>()
    };
    match change {
        Change::None => {}
        Change::Replaced { file, old, new } => {
            let text = sound(file);
            assert!(text.contains(old), "no {old:?} in {file}");
            write(file, &text.replacen(old, new, 1));
        }
        Change::CutBefore { file, text } => {
            let whole = sound(file);
            write(file, &whole[..whole.find(text).unwrap_or_else(|| panic!("no {text:?} in {file}"))]);
        }
        Change::Scaled { column, by } => {
            let scaled = |cell: &str| (cell.parse::<f64>().expect("a number") * *by as f64).round().to_string();
            write("run.csv", &by_row(&|cells| cells[*column] = scaled(&cells[*column])));
        }
        Change::Constant { column, to } => write("run.csv", &by_row(&|cells| cells[*column] = (*to).into())),
        Change::Written { file, text } => write(file, text),
    }
}

/// What departs from the sound files, in one line.
fn described(change: &Change) -> String {
    match change {
        Change::None => "sound files".into(),
        Change::Replaced { file, old, new } => format!("{file}: {old:?} → {new:?}"),
        Change::CutBefore { file, text } => format!("{file} ends before {text:?}"),
        Change::Scaled { column, by } => format!("run.csv: column {} times {by}", column + 1),
        Change::Constant { column, to } => format!("run.csv: column {} is {to}", column + 1),
        Change::Written { file, text } => format!("{file}: {text:?}"),
    }
}

/// One block of the snapshot.
fn block(case: &Case) -> String {
    let folder = TempDir::new().expect("a folder");
    write_files(folder.path(), &case.change);
    let out = Command::cargo_bin("deltatwin")
        .expect("the program")
        .args(case.command.split(' '))
        .current_dir(folder.path())
        // How errors are drawn depends on terminal and language, and on nothing else.
        .env("NO_COLOR", "1")
        .env("LC_ALL", "C.UTF-8")
        .env("TERM", "xterm")
        .env_remove("NO_GRAPHICS")
        .env_remove("CLICOLOR_FORCE")
        .env_remove("FORCE_COLOR")
        .output()
        .expect("the program runs");
    let text = String::from_utf8(out.stderr).expect("text");
    let (status, answer) = (out.status.code().expect("an exit status"), String::from_utf8_lossy(&out.stdout));
    assert!(!text.contains("panicked"), "{}: {text}", case.name);
    assert!(status != 0 && answer.is_empty(), "{} is not refused: {answer}{text}", case.name);
    let place = folder.path().display().to_string();
    let lines: Vec<String> = text.replace(&place, "<folder>").lines().map(|l| l.trim_end().to_string()).collect();
    format!(
        "\n=== {}\n{}\n$ deltatwin {}\nexit status {}\n{}\n",
        case.name,
        described(&case.change),
        case.command,
        status,
        lines.join("\n").trim_matches('\n')
    )
}

#[test]
fn what_is_said_of_broken_inputs_stays_as_it_was_accepted() {
    common::at_root();
    let cases = cases();
    assert!(cases.len() >= 30);
    let file = Path::new(SNAPSHOT);
    let blocks: Vec<String> = cases.iter().map(block).collect();
    let now = format!("{HEAD}{}", blocks.concat());
    if snapshot::accepts() {
        std::fs::write(file, &now).expect("the snapshot is written");
    }
    let before = std::fs::read_to_string(file).expect("a committed snapshot");
    let known: Vec<&str> = before.split("\n=== ").collect();
    let said: Vec<&str> = now.split("\n=== ").collect();
    let changed: Vec<&str> = said.iter().filter(|block| !known.contains(block)).copied().collect();
    let gone: Vec<&str> = known.iter().filter(|block| !said.contains(block)).copied().collect();
    let how = snapshot::how_to_accept(file);
    assert!(
        now == before,
        "the program says something else; {how}\n--- before\n{}\n--- now\n{}",
        gone.join("\n=== "),
        changed.join("\n=== ")
    );
}

//! Command lines over mutated files: commands × models × recordings × options.
//!
//! Every line starts from one that is answered, so that what is mutated is met by the command's work and not only by the
//! reading of its arguments.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

/// Address space of a command, KiB: 2 GB and what its threads reserve without using it.
const MEMORY: u64 = 3 << 20;

/// How a command ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum End {
    /// With an answer, yes or no.
    Answer,
    /// With a refusal of the input.
    Refusal,
    /// With a panic.
    Panic,
    /// By a signal, such as for want of memory.
    Abort,
    /// Not within the time.
    Hang,
    /// As if all were well, with an answer that is not.
    Nonsense,
}

/// Files that lines write.
pub const WRITTEN: [&str; 7] = ["out.csv", "out.mcap", "out.toml", "out.html", "out.setup.toml", "out.svg", "out.dir"];

/// A line that is answered, and the options it takes beside those of every command.
struct Shape {
    line: &'static str,
    options: &'static [&'static [Choice]],
}

/// An option with its values; without any it is a switch.
struct Choice(&'static str, &'static [&'static str]);

const EDGES: &[&str] = &["0", "-1", "1e-300", "5e-324", "1e300", "nan", "inf", "1", "0.5", "3", "99999999999", "", "x"];

const COMMON: &[Choice] =
    &[Choice("--json", &[]), Choice("--json", &[]), Choice("--time-limit", &["0", "0.05", "2", "1e300", "nan", "-1"])];

const COLUMNS: &[Choice] = &[
    Choice("--rate", EDGES),
    Choice("--rate", &["2500", "1000", "100"]),
    Choice("--gear-ratio", EDGES),
    Choice("--gear-ratio", &["33", "-1", "0.01"]),
    Choice("--joint", &["1", "2", "9", "joint_1", "\u{1b}[2J"]),
    Choice(
        "--map",
        &[
            "t=t[ms]",
            "t=t",
            "q1=q1[deg]",
            "q1=q2",
            "q1=-q1",
            "q1=q1+0.3",
            "tau1=tau1*1e300",
            "tau1=tau1[A]*0.12",
            "tau1=tau1*0",
            "t=",
            "=t",
            "q1=nothing",
            "t=q1",
            "q1=q1,q1=q1",
        ],
    ),
    Choice("--max-memory", &["1", "10M", "1G", "1e30G", "-1", "x"]),
    Choice("--setup", &["run.setup.toml", "models", "run.csv", "/dev/null", "nothing.toml"]),
];

const FITS: &[Choice] = &[
    Choice("--held-out", &["run.csv", "run.mcap", "axis.csv", "models/servo-axis.toml"]),
    Choice("--payload-mass", EDGES),
    Choice("--payload-mass", &["0", "2.5", "6"]),
    Choice("--no-gate", &[]),
    Choice("--report", &["out.html", "models", "nowhere/out.html"]),
];

const IDENTIFY: &[Choice] = &[
    Choice("--weighing", &["noise", "maximum", "x"]),
    Choice("--robust", &[]),
    Choice("--method", &["cones", "log-cholesky"]),
    Choice("--prior", &["models/irb360-6-1600-truth.toml", "models/servo-axis.toml"]),
    Choice("--regularisation", EDGES),
    Choice("--gamma", &["links=0", "links=1e300", "links=nan", "friction=1", "=1", "links"]),
    Choice("--hold", &["drive_friction", "rigid_bodies", "nothing", ""]),
    Choice("--limbs", &["alike", "each"]),
    Choice("--bodies", &["symmetric", "aligned", "complete"]),
    Choice("--derivatives", &["paper", "polynomial", "smoother", "reversals"]),
];

const SIMULATE: &[Choice] = &[
    Choice("--formulation", &["eliminated", "absolute", "x"]),
    Choice("--step-error", &[]),
    Choice("--model", &["models/irb360-6-1600-truth.toml", "models/servo-axis.toml", "models/clavel-delta.toml"]),
    Choice("--verify", &["run.mcap", "run.csv"]),
];

const EXCITE: &[Choice] = &[
    Choice("--objective", &["logdet", "condition"]),
    Choice("--frequency", EDGES),
    Choice("--frequency", &["0.2", "1", "5"]),
    Choice("--harmonics", &["1", "3", "0", "1000000", "-1"]),
    Choice("--periods", &["1", "0", "100000000"]),
    Choice("--share", EDGES),
    Choice("--hemisphere", &["0,0,-0.85,0.35", "0,0,0,0", "nan,0,0,1", "1,2,3", "0,0,-0.85,1e300"]),
    Choice("--seed", &["0", "18446744073709551615", "-1"]),
    Choice("--starts", &["1", "0", "2"]),
    Choice("--iterations", &["0", "3"]),
    Choice("--discriminate", &["base_tilt torque_bias", "base_tilt base_tilt", "x y"]),
];

const SHAPES: &[Shape] = &[
    Shape {
        line: "check models/irb360-6-1600.toml scenarios/smoke.toml run.csv run.setup.toml",
        options: &[COMMON, COLUMNS],
    },
    Shape { line: "check run.csv --model models/irb360-6-1600.toml", options: &[COMMON, COLUMNS] },
    Shape { line: "check axis.csv --model models/servo-axis.toml", options: &[COMMON, COLUMNS] },
    Shape { line: "simulate scenarios/smoke.toml -o out.mcap", options: &[COMMON, SIMULATE] },
    Shape { line: "simulate scenarios/smoke.toml -o out.csv", options: &[COMMON, SIMULATE] },
    Shape { line: "simulate scenarios/touch.toml -o out.mcap", options: &[COMMON, SIMULATE] },
    Shape { line: "simulate scenarios/servo-axis.toml -o out.csv", options: &[COMMON, SIMULATE] },
    Shape { line: "simulate scenarios/clavel-delta.toml -o out.mcap", options: &[COMMON, SIMULATE] },
    Shape {
        line: "identify models/irb360-6-1600.toml run.mcap -o out.toml",
        options: &[COMMON, COLUMNS, FITS, IDENTIFY],
    },
    Shape {
        line: "identify models/irb360-6-1600.toml run.csv --payload -o out.setup.toml",
        options: &[COMMON, COLUMNS, FITS],
    },
    Shape { line: "identify models/servo-axis.toml axis.csv -o out.toml", options: &[COMMON, COLUMNS, FITS, IDENTIFY] },
    Shape {
        line: "compare models/irb360-6-1600.toml run.csv",
        options: &[COMMON, COLUMNS, FITS, &[Choice("--fail-above", EDGES)]],
    },
    Shape { line: "compare models/irb360-6-1600.toml run.mcap", options: &[COMMON, COLUMNS, FITS] },
    Shape {
        line: "diagnose models/servo-axis.toml axis.csv --time-limit 4 -o out.toml",
        options: &[COMMON, COLUMNS, FITS],
    },
    Shape { line: "add models/servo-axis.toml cogging axis.csv -o out.toml", options: &[COMMON, COLUMNS, FITS] },
    Shape { line: "add models/irb360-6-1600.toml base_tilt run.csv -o out.toml", options: &[COMMON, COLUMNS, FITS] },
    Shape { line: "new axis axis.csv -o out.toml", options: &[COMMON, COLUMNS] },
    Shape { line: "new delta run.csv -o out.toml", options: &[COMMON, COLUMNS] },
    Shape { line: "forces models/irb360-6-1600.toml run.mcap -o out.csv", options: &[COMMON, COLUMNS] },
    Shape { line: "forces models/irb360-6-1600.toml scenarios/smoke.toml -o out.csv", options: &[COMMON] },
    Shape { line: "import run.csv -o out.mcap", options: &[COMMON, COLUMNS] },
    Shape { line: "import axis.csv -o out.csv", options: &[COMMON, COLUMNS] },
    Shape { line: "export run.mcap --csv out.csv", options: &[COMMON] },
    Shape { line: "noise run.csv", options: &[COMMON, COLUMNS, FITS] },
    Shape {
        line: "plan models/irb360-6-1600.toml scenarios/u-turn.toml -o out.csv",
        options: &[
            COMMON,
            &[
                Choice("--tighten", &[]),
                Choice("--twin", &["models/irb360-6-1600-truth.toml", "models/servo-axis.toml"]),
            ],
        ],
    },
    Shape {
        line: "excite models/irb360-6-1600.toml -o out.toml --budget 1 --iterations 2",
        options: &[COMMON, EXCITE],
    },
    Shape { line: "effects cogging", options: &[COMMON] },
];

/// A random command line in a folder with `models/`, `scenarios/`, and the recordings `run` and `axis`.
pub fn line(random: &mut ChaCha8Rng) -> Vec<String> {
    let Some(shape) = SHAPES.choose(random) else { return Vec::new() };
    let mut line: Vec<String> = shape.line.split(' ').map(String::from).collect();
    for _ in 0..random.random_range(0..=2) {
        let option = shape.options.choose(random).and_then(|group| group.choose(random));
        let Some(Choice(name, values)) = option.filter(|Choice(name, _)| !line.iter().any(|word| word == name)) else {
            continue;
        };
        line.push((*name).into());
        line.extend(values.choose(random).iter().flat_map(|value| value.split(' ')).map(String::from));
    }
    if random.random_bool(0.05) {
        disorder(&mut line, random);
    }
    line
}

/// Removes, repeats or exchanges words.
fn disorder(line: &mut Vec<String>, random: &mut ChaCha8Rng) {
    let (a, b) = (random.random_range(0..line.len()), random.random_range(0..line.len()));
    match random.random_range(0..3) {
        0 => drop(line.remove(a)),
        1 => line.insert(a, line[b].clone()),
        _ => line.swap(a, b),
    }
}

/// Runs `program` in `folder` for at most `longest`.
///
/// # Errors
/// Those of starting it, and of the files for what it prints.
pub fn run(program: &Path, folder: &Path, line: &[String], longest: Duration) -> std::io::Result<End> {
    let out = folder.join("stdout");
    let err = folder.join("stderr");
    let mut child = Command::new("sh")
        .args(["-c", &format!("ulimit -v {MEMORY}; exec \"$0\" \"$@\"")])
        .arg(program)
        .args(line)
        .current_dir(folder)
        .env("RAYON_NUM_THREADS", "2")
        .stdin(Stdio::null())
        .stdout(std::fs::File::create(&out)?)
        .stderr(std::fs::File::create(&err)?)
        .spawn()?;
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.try_wait()? {
            break status;
        }
        if start.elapsed() > longest {
            child.kill()?;
            child.wait()?;
            return Ok(End::Hang);
        }
        std::thread::sleep(Duration::from_millis(3));
    };
    Ok(match status.code() {
        Some(0) if is_nonsense(folder, &out, line) => End::Nonsense,
        // 130: by its time limit.
        Some(0 | 1 | 130) => End::Answer,
        Some(2) => End::Refusal,
        Some(_) => End::Panic,
        None => End::Abort,
    })
}

/// Whether a successful answer has what no answer may have: JSON that is none, or a number in a file that is none.
fn is_nonsense(folder: &Path, out: &Path, line: &[String]) -> bool {
    let text = std::fs::read_to_string(out).unwrap_or_default();
    let is_json = line.iter().any(|word| word == "--json");
    if is_json && !text.trim().is_empty() && serde_json::from_str::<serde_json::Value>(&text).is_err() {
        return true;
    }
    let written = ["out.csv", "out.toml", "out.setup.toml"].map(|name| folder.join(name));
    written.iter().filter_map(|file| std::fs::read_to_string(file).ok()).any(|text| {
        text.split([',', '\n', ' ', '[', ']'])
            .any(|word| matches!(word.trim(), "NaN" | "nan" | "inf" | "-inf" | "-nan"))
    })
}

//! Command lines over mutated files: commands × models × recordings × options.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_chacha::ChaCha8Rng;

/// Address space of a command, KiB: 2 GB and what its threads reserve without using it.
const MEMORY: u64 = 3 << 20;

/// How a command ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum End {
    /// With an answer or a refusal.
    Sound,
    /// With a panic.
    Panic,
    /// By a signal, such as for want of memory.
    Abort,
    /// Not within the time.
    Hang,
    /// As if all were well, with an answer that is not.
    Nonsense,
}

const MODELS: [&str; 4] = ["irb360-6-1600", "clavel-delta", "servo-axis", "irb360-6-1600-truth"];
const SCENARIOS: [&str; 5] = ["smoke", "touch", "u-turn", "servo-axis", "clavel-delta"];
const NUMBERS: [&str; 8] = ["0", "-1", "1e-300", "1e300", "nan", "1", "0.5", "99999999999"];

/// A random command line in a folder with `models/`, `scenarios/`, `run.csv` and `run.mcap`, of which some are mutated.
pub fn line(random: &mut ChaCha8Rng) -> Vec<String> {
    let model =
        || format!("models/{}.toml", MODELS.choose(&mut rand_chacha::ChaCha8Rng::clone(random)).unwrap_or(&MODELS[0]));
    let model = model();
    let data = if random.random_bool(0.5) { "run.csv" } else { "run.mcap" }.to_string();
    let scenario = format!("scenarios/{}.toml", SCENARIOS.choose(random).unwrap_or(&SCENARIOS[0]));
    let words = |text: &str| text.split(' ').map(String::from).collect::<Vec<_>>();
    let mut line = match random.random_range(0..12) {
        0 | 1 => words(&format!("check {model} {scenario} {data} run.setup.toml")),
        2 => words(&format!("check {data} --model {model}")),
        3 | 4 => words(&format!("simulate {scenario} -o out.mcap")),
        5 => words(&format!("simulate {scenario} --model {model} -o out.csv")),
        6 => words(&format!("identify {model} {data} -o out.toml")),
        7 => words(&format!("compare {model} {data}")),
        8 => words(&format!("forces {model} {data} -o out.csv")),
        9 => words(&format!("import {data} -o imported.csv")),
        10 => words(&format!("noise {data}")),
        _ => words(&format!("plan {model} scenarios/u-turn.toml -o out.csv --intervals 40")),
    };
    if random.random_bool(0.5) {
        line.push("--json".into());
    }
    if random.random_bool(0.3) {
        let option = *["--rate", "--gear-ratio", "--joint", "--map", "--payload-mass", "--max-memory", "--setup"]
            .choose(random)
            .unwrap_or(&"--rate");
        let value = match option {
            "--map" => ["t=t[ms]", "q1=q2[deg]", "tau1=tau1*1e300", "t=", "=t", "q1=nothing"].choose(random),
            "--setup" => ["run.setup.toml", "models", "run.csv", "/dev/null"].choose(random),
            _ => NUMBERS.choose(random),
        };
        line.extend([option.to_string(), value.map_or(String::new(), |value| value.to_string())]);
    }
    line
}

/// Runs `program` in `folder` for at most `longest`.
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
        Some(0..=2) => End::Sound,
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
    let written = ["out.csv", "out.toml", "imported.csv"].map(|name| folder.join(name));
    written.iter().filter_map(|file| std::fs::read_to_string(file).ok()).any(|text| {
        text.split([',', '\n', ' ', '[', ']'])
            .any(|word| matches!(word.trim(), "NaN" | "nan" | "inf" | "-inf" | "-nan"))
    })
}

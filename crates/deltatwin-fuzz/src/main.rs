//! Mutates shipped files and command lines, and counts what did not end with an answer or a refusal.
//!
//! Mutations are structured (numbers, lines, lengths, stretches of other files) and repeat for a seed; nothing guides
//! them to new code; `guided/` has the same readers for a fuzzer that is guided. Every finding is kept as a file; those that were mended are in `tests/files/corpus`.

use std::collections::BTreeMap;
use std::panic::catch_unwind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use clap::Parser;
use rand::seq::IndexedRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use deltatwin_fuzz::command::{self, End};
use deltatwin_fuzz::mutation;
use deltatwin_fuzz::target::{self, TARGETS, Target, seeds};

/// Longest time of one input, s.
const LONGEST: u64 = 10;

/// Mutated inputs for the readers of deltatwin, and mutated command lines.
#[derive(Parser)]
struct Args {
    /// Inputs for each reader.
    #[arg(long, default_value_t = 1000)]
    inputs: u64,
    /// Command lines, with --program.
    #[arg(long, default_value_t = 0)]
    commands: u64,
    /// The program.
    #[arg(long)]
    program: Option<PathBuf>,
    /// Only this reader.
    #[arg(long)]
    target: Option<String>,
    /// Seed of the mutations.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder of the project, with its models and scenarios.
    #[arg(long, default_value = ".")]
    root: PathBuf,
    /// Folder to write the shipped inputs to, by reader, for guided fuzzing; nothing else is done.
    #[arg(long)]
    seeds: Option<PathBuf>,
    /// Folder for the findings.
    #[arg(long, default_value = "findings")]
    findings: PathBuf,
}

fn main() -> ExitCode {
    match run(&Args::parse()) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(e) => {
            eprintln!("{e}");
            ExitCode::from(2)
        }
    }
}

fn run(args: &Args) -> std::io::Result<u64> {
    let root = args.root.canonicalize()?;
    if let Some(folder) = &args.seeds {
        return seeds_written(&root, folder).map(|()| 0);
    }
    let folder = tempfile::tempdir()?;
    let mut seed_files = prepared(&root, folder.path())?;
    let mut found = 0;
    watch();
    for target in TARGETS.iter().filter(|t| args.target.as_ref().is_none_or(|name| name == t.name)) {
        let (tried, bad) = readers(target, args, folder.path(), &seed_files)?;
        println!("{:<9} {tried:>7} inputs, {bad} findings", target.name);
        found += bad;
    }
    if let Some(program) = args.program.as_ref().filter(|_| args.commands > 0) {
        let program = program.canonicalize()?;
        recorded(&program, folder.path(), &mut seed_files)?;
        let ends = commands(&program, args, folder.path(), &seed_files)?;
        let count = |end: End| ends.get(&end).copied().unwrap_or(0);
        println!(
            "commands  {:>7} tried: {} answers, {} refusals, {} panics, {} aborts, {} hangs, {} nonsense",
            args.commands,
            count(End::Answer),
            count(End::Refusal),
            count(End::Panic),
            count(End::Abort),
            count(End::Hang),
            count(End::Nonsense)
        );
        found += args.commands - count(End::Answer) - count(End::Refusal);
    }
    Ok(found)
}

/// Writes the seeds of every reader to `folder/<reader>`.
fn seeds_written(root: &Path, folder: &Path) -> std::io::Result<()> {
    let recording = recording();
    for target in &TARGETS {
        let place = folder.join(target.name);
        std::fs::create_dir_all(&place)?;
        let mut inputs: Vec<Vec<u8>> = target.seeds.iter().flat_map(|name| seeds(root, name)).collect();
        if target.file.starts_with("run.") && target.name != "setup" {
            let file = place.join(target.file);
            deltatwin_io::recording::write(&recording, &file).map_err(std::io::Error::other)?;
            inputs.push(std::fs::read(&file)?);
            std::fs::remove_file(&file)?;
            let _ = std::fs::remove_file(place.join("run.setup.toml"));
        }
        for (k, input) in inputs.iter().enumerate() {
            std::fs::write(place.join(format!("seed-{k}")), input)?;
        }
    }
    Ok(())
}

/// Files that a run needs and those that it mutates: a copy of models and scenarios, and a short recording.
fn prepared(root: &Path, folder: &Path) -> std::io::Result<BTreeMap<String, Vec<u8>>> {
    let mut files = BTreeMap::new();
    for place in ["models", "scenarios", "scenarios/studies", "scenarios/failures", "scenarios/tables"] {
        std::fs::create_dir_all(folder.join(place))?;
        for entry in std::fs::read_dir(root.join(place))? {
            let path = entry?.path();
            if path.is_file() {
                let name = format!("{place}/{}", path.file_name().unwrap_or_default().to_string_lossy());
                let mut bytes = std::fs::read(&path)?;
                if place == "scenarios" {
                    bytes = lasting(&bytes, "0.4");
                }
                std::fs::write(folder.join(&name), &bytes)?;
                files.insert(name, bytes);
            }
        }
    }
    files.insert("run.setup.toml".into(), target::made("setup").unwrap_or_default().swap_remove(0));
    for name in ["run.csv", "run.mcap"] {
        let file = folder.join(name);
        deltatwin_io::recording::write(&recording(), &file).map_err(std::io::Error::other)?;
        files.insert(name.into(), std::fs::read(&file)?);
    }
    Ok(files)
}

/// The scenario with a run of so many seconds.
fn lasting(bytes: &[u8], seconds: &str) -> Vec<u8> {
    let text = String::from_utf8_lossy(bytes);
    let line =
        |line: &str| if line.starts_with("duration") { format!("duration = {seconds}") } else { line.to_string() };
    text.lines().map(line).collect::<Vec<_>>().join("\n").into_bytes()
}

/// Half a second of the robot.
fn recording() -> deltatwin::recording::Recording {
    let t: Vec<f64> = (0..600).map(|i| f64::from(i * 4) / 1e4).collect();
    let axes = |f: &dyn Fn(f64, f64) -> f64| -> Vec<[f64; 4]> {
        t.iter().map(|t| std::array::from_fn(|k| f(k as f64, *t))).collect()
    };
    let q = axes(&|k, t| 0.4 + 0.2 * ((20.0 + k) * t).sin());
    let tau = axes(&|k, t| 20.0 * ((20.0 + k) * t).cos() + (1e4 * t).sin());
    let signals = deltatwin::recording::Signals::of_drives(Default::default(), t, &q, &tau);
    deltatwin::recording::Recording { name: "run".into(), signals, ..Default::default() }
}

/// Instant at which the present input began, ms since the start; zero between inputs.
static BEGAN: AtomicU64 = AtomicU64::new(0);

/// Ends the program if an input takes too long: its file is then the last one in the folder of findings.
fn watch() {
    let start = Instant::now();
    std::thread::spawn(move || {
        let mut since = (0, start);
        loop {
            std::thread::sleep(Duration::from_millis(200));
            let input = BEGAN.load(Ordering::Relaxed);
            if input != since.0 {
                since = (input, Instant::now());
            } else if input != 0 && since.1.elapsed() > Duration::from_secs(LONGEST) {
                eprintln!("input {input} takes longer than {LONGEST} s: see `present` in the folder of findings");
                std::process::exit(1);
            }
        }
    });
}

/// Number of inputs for a reader, and of those that it did not survive.
fn readers(
    target: &Target,
    args: &Args,
    folder: &Path,
    made: &BTreeMap<String, Vec<u8>>,
) -> std::io::Result<(u64, u64)> {
    let mut corpus: Vec<Vec<u8>> = target.seeds.iter().flat_map(|name| seeds(&args.root, name)).collect();
    corpus.extend(made.get(target.file).cloned());
    let mut random = ChaCha8Rng::seed_from_u64(args.seed);
    let file = folder.join(target.file);
    let mut bad = 0;
    std::panic::set_hook(Box::new(|_| {}));
    for k in 0..args.inputs {
        let (Some(seed), Some(other)) = (corpus.choose(&mut random), corpus.choose(&mut random)) else { break };
        let input = mutation::mutated(seed, other, &mut random);
        std::fs::write(&file, &input)?;
        BEGAN.store(k + 1, Ordering::Relaxed);
        let start = Instant::now();
        let ended = catch_unwind(|| (target.read)(&file));
        let slow = start.elapsed() > Duration::from_secs(LONGEST);
        BEGAN.store(0, Ordering::Relaxed);
        if ended.is_err() || slow {
            bad += 1;
            std::fs::create_dir_all(&args.findings)?;
            let extension = file.extension().unwrap_or_default().to_string_lossy();
            let name = format!("{}-{k}-{}.{extension}", target.name, if slow { "slow" } else { "panic" });
            std::fs::write(args.findings.join(name), &input)?;
        }
    }
    let _ = std::panic::take_hook();
    match made.get(target.file) {
        Some(bytes) => std::fs::write(&file, bytes)?,
        None if args.inputs > 0 => std::fs::remove_file(&file)?,
        None => {}
    }
    Ok((args.inputs, bad))
}

/// Makes the recordings `run` (a robot, 5 s) and `axis` (a lone axis, 6 s) by the program in `folder`, and adds them to `files`.
fn recorded(program: &Path, folder: &Path, files: &mut BTreeMap<String, Vec<u8>>) -> std::io::Result<()> {
    for (scenario, seconds, outputs) in
        [("excitation", 5, ["run.csv", "run.mcap"].as_slice()), ("servo-axis", 6, ["axis.csv"].as_slice())]
    {
        let text = &files[&format!("scenarios/{scenario}.toml")];
        let short = lasting(text, &seconds.to_string());
        std::fs::write(folder.join("scenarios/recorded.toml"), short)?;
        for output in outputs {
            let _ = std::fs::remove_file(folder.join(output));
            let line = ["simulate", "scenarios/recorded.toml", "-o", output].map(String::from);
            let end = command::run(program, folder, &line, Duration::from_secs(60))?;
            if end != End::Answer {
                let told = std::fs::read_to_string(folder.join("stderr")).unwrap_or_default();
                return Err(std::io::Error::other(format!("`{}` ends with {end:?}: {told}", line.join(" "))));
            }
            files.insert((*output).into(), std::fs::read(folder.join(output))?);
        }
    }
    Ok(())
}

/// Number of command lines by the way in which they ended.
fn commands(
    program: &Path,
    args: &Args,
    folder: &Path,
    files: &BTreeMap<String, Vec<u8>>,
) -> std::io::Result<BTreeMap<End, u64>> {
    let mut random = ChaCha8Rng::seed_from_u64(args.seed);
    let names: Vec<&String> = files.keys().collect();
    let mut ends = BTreeMap::new();
    for k in 0..args.commands {
        let line = command::line(&mut random);
        let read: Vec<&String> = names.iter().filter(|name| line.contains(name)).copied().collect();
        let mutated = read.choose(&mut random).copied();
        let content = mutated.and_then(|name| match random.random_range(0..10) {
            0..4 => None,
            4..8 => Some((name, mutation::nudged(&files[name], &mut random))),
            _ => {
                let other = names.choose(&mut random).map_or(name, |other| other);
                Some((name, mutation::mutated(&files[name], &files[other], &mut random)))
            }
        });
        if let Some((name, content)) = &content {
            std::fs::write(folder.join(name), content)?;
        }
        let end = command::run(program, folder, &line, Duration::from_secs(LONGEST))?;
        if !matches!(end, End::Answer | End::Refusal) {
            let kept = args.findings.join(format!("command-{}-{k}-{end:?}", args.seed));
            std::fs::create_dir_all(&kept)?;
            std::fs::write(kept.join("line.txt"), line.join(" "))?;
            let _ = std::fs::copy(folder.join("stderr"), kept.join("stderr"));
            if let Some((name, content)) = &content {
                std::fs::write(kept.join(name.replace('/', "-")), content)?;
            }
        }
        *ends.entry(end).or_default() += 1;
        if let Some((name, _)) = &content {
            std::fs::write(folder.join(name), &files[*name])?;
        }
        for out in command::WRITTEN {
            let out = folder.join(out);
            let _ = if out.is_dir() { std::fs::remove_dir_all(&out) } else { std::fs::remove_file(&out) };
        }
    }
    Ok(ends)
}

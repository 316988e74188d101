//! Faults of processes, disks and pipes: what was tried, and what was lost.
//!
//! On Unix, whose signals and limits are used.
#![cfg(unix)]

use crate::common;

use std::fs;
use std::io::Write;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use deltatwin_io::recording;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

/// Number of kills and of power cuts; `FAULTS=200` in the environment for a long trial.
fn tries(usual: usize) -> usize {
    std::env::var("FAULTS").ok().and_then(|n| n.parse().ok()).unwrap_or(usual)
}

fn program() -> Command {
    common::at_root();
    let mut command = Command::new(assert_cmd::cargo::cargo_bin("deltatwin"));
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
    command
}

/// A scenario that runs for minutes, and its recording.
fn long_run(folder: &TempDir, name: &str) -> (PathBuf, PathBuf) {
    common::at_root();
    let root = std::env::current_dir().unwrap();
    let text = fs::read_to_string("scenarios/excitation.toml").unwrap();
    let text = text.replace("\"../models/", &format!("\"{}/models/", root.display()));
    let line = |line: &str| if line.starts_with("duration") { "duration = 3600".to_string() } else { line.into() };
    let scenario = folder.path().join("long.toml");
    fs::write(&scenario, text.lines().map(line).collect::<Vec<_>>().join("\n")).unwrap();
    (scenario, folder.path().join(name))
}

fn partial(target: &Path) -> PathBuf {
    let extension = target.extension().unwrap().to_string_lossy().into_owned();
    target.with_extension(format!("partial.{extension}"))
}

fn start(scenario: &Path, target: &Path) -> Child {
    let child = program().arg("simulate").arg(scenario).arg("-o").arg(target).spawn().unwrap();
    let begun = Instant::now();
    while fs::metadata(partial(target)).map_or(0, |m| m.len()) == 0 && begun.elapsed() < Duration::from_secs(20) {
        std::thread::sleep(Duration::from_millis(5));
    }
    child
}

/// Samples in a recording, 0 if it is too short for one.
fn samples(file: &Path) -> usize {
    recording::read(file, None).map_or(0, |(recording, _)| recording.signals.len())
}

#[test]
fn killed_runs_lose_nothing_that_was_handed_on() {
    let folder = TempDir::new().unwrap();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let (mut tried, mut lost, mut most) = (0, 0, 0);
    for k in 0..tries(6) {
        let (scenario, target) = long_run(&folder, ["run.mcap", "run.csv"][k % 2]);
        let mut child = start(&scenario, &target);
        std::thread::sleep(Duration::from_millis(random.random_range(50..400)));
        // What the system has now must be there afterwards.
        let before = fs::read(partial(&target)).unwrap();
        let copy = target.with_file_name("before").with_extension(target.extension().unwrap());
        fs::write(&copy, &before).unwrap();
        child.kill().unwrap();
        assert_eq!(child.wait().unwrap().signal(), Some(9));
        let (had, has) = (samples(&copy), samples(&partial(&target)));
        tried += 1;
        // In the first instants, there is no recording yet.
        lost += usize::from(has < had);
        most = most.max(has);
        assert!(!target.exists(), "a recording that is not complete has no final name");
        fs::remove_file(partial(&target)).unwrap();
    }
    println!("kill -9: {tried} tried, {lost} lost; {most} samples at most");
    assert!(lost == 0 && most > 1_000);
}

#[test]
#[ignore = "campaign"]
fn power_cuts_lose_at_most_what_was_not_synced() {
    let folder = TempDir::new().unwrap();
    let (scenario, target) = long_run(&folder, "run.mcap");
    let mut child = start(&scenario, &target);
    std::thread::sleep(Duration::from_millis(600));
    child.kill().unwrap();
    child.wait().unwrap();
    let whole = fs::read(partial(&target)).unwrap();
    let all = samples(&partial(&target));
    let cut = folder.path().join("cut.mcap");
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let (mut tried, mut lost) = (0, 0);
    for _ in 0..tries(30) {
        // Behind the last sync, blocks are missing, zero or from another file; before it, nothing changes.
        let synced = random.random_range(whole.len() / 4..whole.len());
        fs::write(&cut, &whole[..synced]).unwrap();
        let kept = samples(&cut);
        let mut after = whole.clone();
        for block in after[synced..].chunks_mut(4096) {
            match random.random_range(0..4) {
                0 => block.fill(0),
                1 => random.fill(block),
                _ => {}
            }
        }
        let end = random.random_range(synced..=after.len());
        fs::write(&cut, &after[..end]).unwrap();
        tried += 1;
        lost += usize::from(samples(&cut) < kept);
        assert!(samples(&cut) <= all);
    }
    println!("power cuts: {tried} tried, {lost} lost");
    assert_eq!(lost, 0);
}

#[test]
fn requests_to_end_are_followed_within_a_second_and_keep_the_run() {
    let folder = TempDir::new().unwrap();
    for signal in ["INT", "TERM", "HUP"] {
        let (scenario, target) = long_run(&folder, &format!("{signal}.mcap"));
        let mut child = start(&scenario, &target);
        std::thread::sleep(Duration::from_millis(300));
        Command::new("kill").args([&format!("-{signal}"), &child.id().to_string()]).status().unwrap();
        let asked = Instant::now();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{signal}");
        assert!(asked.elapsed() < Duration::from_millis(1200), "{signal}: {:?}", asked.elapsed());
        assert!(samples(&target) > 100 && !partial(&target).exists(), "{signal}");
    }
}

#[test]
fn a_time_limit_is_kept() {
    let folder = TempDir::new().unwrap();
    let (scenario, target) = long_run(&folder, "run.mcap");
    let begun = Instant::now();
    let status = program().arg("simulate").arg(&scenario).arg("-o").arg(&target).args(["--time-limit", "2"]).status();
    assert!(begun.elapsed() < Duration::from_millis(2800), "{:?}", begun.elapsed());
    assert!(matches!(status.unwrap().code(), Some(1 | 130)));
    assert!(samples(&target) > 100);
}

#[test]
fn a_full_disk_is_named_and_leaves_what_fits() {
    let folder = TempDir::new().unwrap();
    let (scenario, target) = long_run(&folder, "run.mcap");
    let deltatwin = assert_cmd::cargo::cargo_bin("deltatwin");
    // No file longer than 600 blocks of 512 or 1024 bytes; the signal of the limit is ignored, as a full disk has none.
    let line = "trap '' XFSZ; ulimit -f 600; exec \"$0\" simulate \"$1\" -o \"$2\"";
    let out = Command::new("sh").args(["-c", line]).arg(deltatwin).arg(&scenario).arg(&target).output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(said.contains("run.partial.mcap: cannot be written: File too large"), "{said}");
    assert!(!target.exists() && samples(&partial(&target)) > 100);
}

/// The help is about the disk, not about the fit.
#[test]
fn a_model_that_does_not_fit_on_the_disk_is_no_fault_of_the_recording() {
    common::at_root();
    let folder = TempDir::new().unwrap();
    let [data, model] = ["run.mcap", "fitted.toml"].map(|name| folder.path().join(name));
    assert!(program().args(["simulate", "scenarios/smoke.toml", "-o"]).arg(&data).status().unwrap().success());
    let line = "trap '' XFSZ; ulimit -f 8; exec \"$0\" identify models/irb360-6-1600.toml \"$1\" -o \"$2\"";
    let mut identify = Command::new("sh");
    identify.args(["-c", line]).arg(assert_cmd::cargo::cargo_bin("deltatwin")).args([&data, &model]);
    let out = identify.output().unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert_eq!(out.status.code(), Some(2), "{said}");
    assert!(said.contains("fitted.toml: cannot be written") && said.contains("free space"), "{said}");
    assert!(!said.contains("do not determine") && !model.exists(), "{said}");
}

#[test]
fn folders_that_cannot_be_written_are_named() {
    let folder = TempDir::new().unwrap();
    let (scenario, _) = long_run(&folder, "run.mcap");
    let out = program()
        .arg("simulate")
        .arg(&scenario)
        .args(["-o", "/proc/run.mcap"])
        .stderr(Stdio::piped())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&out.stderr).into_owned();
    assert!(out.status.code() == Some(2) && said.contains("/proc/run.mcap: cannot be written"), "{said}");
}

#[test]
fn pipes_that_nobody_reads_are_no_error() {
    common::at_root();
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let status = program().args(["check", "no-such-file"]).stderr(full()).status().unwrap();
    assert_eq!(status.code(), Some(2));
    let mut child = program().args(["effects", "--json"]).stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

#[test]
fn devices_and_pipes_are_no_files() {
    let folder = TempDir::new().unwrap();
    let pipe = folder.path().join("pipe");
    Command::new("mkfifo").arg(&pipe).status().unwrap();
    let (scenario, _) = long_run(&folder, "run.mcap");
    let text = fs::read_to_string(&scenario).unwrap();
    let head = &text[..text.find("[motion]").unwrap()];
    for file in [Path::new("/dev/zero"), &pipe] {
        let table = folder.path().join("table.toml");
        let mut out = fs::File::create(&table).unwrap();
        write!(out, "{head}[motion]\nkind = \"table\"\nfile = \"{}\"\n", file.display()).unwrap();
        for command in [vec!["check"], vec!["simulate"]] {
            let begun = Instant::now();
            let out = program().args(command).arg(&table).stderr(Stdio::piped()).output().unwrap();
            let said = String::from_utf8_lossy(&out.stderr).into_owned();
            assert!(out.status.code() == Some(2) && said.contains("expected a file"), "{said}");
            assert!(begun.elapsed() < Duration::from_secs(5));
        }
        let out = program().arg("check").arg(file).output().unwrap();
        assert_eq!(out.status.code(), Some(2), "{}", file.display());
    }
}

#[test]
fn writers_of_one_recording_do_not_mix() {
    let folder = TempDir::new().unwrap();
    common::at_root();
    let target = folder.path().join("run.mcap");
    let spawn = |_| program().args(["simulate", "scenarios/smoke.toml", "-o"]).arg(&target).spawn().unwrap();
    let children: Vec<Child> = (0..4).map(spawn).collect();
    for mut child in children {
        assert_eq!(child.wait().unwrap().code(), Some(0));
    }
    let (_, warnings) = recording::read(&target, None).unwrap();
    assert!(warnings.iter().all(|w| !w.contains("damaged") && !w.contains("cut short")), "{warnings:?}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "nothing else is left");
}

//! `deltatwin demo`.

#![allow(clippy::print_stdout)]

use std::path::{Path, PathBuf};

use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, WrapErr};
use serde_json::json;

use crate::terminal::{Table, origin, spinner, wrapped};
use deltatwin::model::Model;
use deltatwin::recording::Recording;
use deltatwin::text::with_error;
use deltatwin::twin::origin::of_recording;
use deltatwin_analysis::{Inputs, folder, sentence};
use deltatwin_io::model;
use deltatwin_io::model::shipped::IRB_360_6_1600;
use deltatwin_validation::demo::{DURATION, Findings, LeftOut, describe, hidden, hide, investigate};
use deltatwin_validation::exam::Campaign;

/// Hide an effect in a robot, measure it, and find it: the whole loop in under a minute.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = "Example: deltatwin demo --seed 7 --effect ball_socket_coulomb")]
pub struct Args {
    /// Draws the effect, its size, the model's errors, the motions and the noise.
    #[arg(long, default_value_t = SEED)]
    pub seed: u64,
    /// Hide this effect instead of one drawn from those that these motions can show; `none` hides nothing.
    #[arg(long, value_name = "NAME")]
    pub effect: Option<String>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
    /// Folder for recordings, report, model and Rerun file.
    #[arg(short, long, default_value = "recordings/demo", value_name = "DIR")]
    pub output: PathBuf,
}

/// The seed of a demo without arguments, which hides a `payload_drag`, and its time on two cores, s.
const SEED: u64 = 2;
const SECONDS: u32 = 20;

impl Default for Args {
    fn default() -> Self {
        Self { seed: SEED, effect: None, json: false, output: "recordings/demo".into() }
    }
}

/// Prints a line of the demo; what was found is in its files, too, if nobody reads it here.
macro_rules! tell {
    ($($line:tt)*) => {{
        let _ = crate::terminal::say(format!($($line)*));
    }};
}

/// Measures a robot with a hidden effect, with a bar; the effects that were drawn and left out, with the reasons.
///
/// # Errors
/// If there is no such effect, or the machine cannot be simulated.
pub fn measured(seed: u64, effect: Option<&str>) -> miette::Result<(Campaign, LeftOut)> {
    let model = model::parse(IRB_360_6_1600, Path::new("irb360-6-1600"))?;
    let bar = ProgressBar::new((2.0 * DURATION * 1000.0) as u64);
    bar.set_style(
        ProgressStyle::with_template("{prefix:>10} [{bar:40}] {percent:>3} % {msg}").expect("a valid template"),
    );
    bar.set_prefix("measure");
    let done = [std::sync::atomic::AtomicU64::new(0), std::sync::atomic::AtomicU64::new(0)];
    let robot = hide(&model, seed, effect).into_diagnostic()?;
    let left_out = robot.left_out;
    let campaign = robot.prepared.record(&model, &|k, t| {
        let now = (t * 1000.0) as u64;
        let before = done[k].swap(now, std::sync::atomic::Ordering::Relaxed);
        bar.inc(now - before);
    });
    bar.finish_and_clear();
    Ok((campaign.into_diagnostic()?, left_out))
}

/// Runs the demo; returns the exit status 0, or 1 if the hidden effect was not found.
pub fn run(args: &Args) -> miette::Result<u8> {
    let say = |text: String| {
        if !args.json {
            tell!("{text}");
        }
    };
    say(format!("A robot with a hidden effect is simulated, and the effect found: about {SECONDS} s on two cores."));
    say("Robot: IRB 360-6/1600 with a 2.5 kg payload and one effect its model does not have.".into());
    let (measured, left_out) = measured(args.seed, args.effect.as_deref())?;
    if !left_out.is_empty() {
        let each: Vec<String> = left_out.iter().map(|(name, why)| format!("{name} ({why})")).collect();
        say(wrapped(&format!("Drawn and left out: {}.", each.join(", ")), 0));
    }
    say(wrapped(
        &format!(
            "Measured: two motions of {DURATION} s at {:.1} kHz, quantised encoders, noisy torques, one strut with a force sensor.",
            1e-3 / measured.model.sample_time
        ),
        0,
    ));
    let progress = spinner("check");
    let findings = investigate(&measured, &mut |step| progress.set_message(super::run::message(&step)));
    progress.finish_and_clear();
    let findings = findings.into_diagnostic()?;
    let files = write(args, &measured, &findings)?;
    if args.json {
        let mut object = summary(args, &measured, &findings, &files);
        object["left_out"] = left_out.iter().map(|(name, why)| json!({"name": name, "why": why})).collect();
        tell!("{object}");
    } else {
        print(&measured, &findings, &files);
    }
    Ok(u8::from(!findings.right))
}

fn write(args: &Args, campaign: &Campaign, findings: &Findings) -> miette::Result<Vec<PathBuf>> {
    let folder = &args.output;
    std::fs::create_dir_all(folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
    let mut files = Vec::new();
    let delivered = folder.join("delivered.toml");
    model::write(&campaign.model, &delivered)?;
    let known = model::read(&delivered)?;
    for recording in [&campaign.measurement, &campaign.validation] {
        files.push(keep(args, &known, recording)?);
    }
    let inputs = Inputs { data: vec![files[0].clone()], held_out: vec![files[1].clone()], ..Inputs::default() };
    let mut origin = origin("demo", Some(&delivered), &inputs, &[])?;
    let answer = if findings.right { "The diagnosis has found it." } else { "The diagnosis has not found it." };
    origin.note = format!("Hidden in the robot was {}. {answer}", describe(campaign));
    files.push(delivered);
    files.extend(folder::write(folder, &findings.analysis, &campaign.model, &findings.data, &origin)?);
    #[cfg(feature = "viewer")]
    {
        let path = folder.join("validation.rrd");
        crate::command::run::replay(&campaign.validation, None, &findings.analysis).write(&path)?;
        files.push(path);
    }
    Ok(files)
}

/// Writes a recording of the machine whose delivered model is `known`; returns its file.
fn keep(args: &Args, known: &Model, recording: &Recording) -> miette::Result<PathBuf> {
    let path = args.output.join(format!("{}.mcap", recording.name));
    let effect = args.effect.as_ref().map_or(String::new(), |name| format!(" --effect {name}"));
    let mut context = of_recording(&format!("deltatwin demo --seed {}{effect}", args.seed), Some(known), recording);
    context.provenance.insert("seed".into(), args.seed.to_string());
    deltatwin_io::recording::write_with(recording, &path, &context)?;
    Ok(path)
}

fn print(campaign: &Campaign, findings: &Findings, files: &[PathBuf]) {
    let d = &findings.analysis.diagnosis;
    tell!("\nWhere the model as delivered fails:");
    for f in findings.analysis.delivered.findings.iter().take(4) {
        tell!("{}", wrapped(&f.sentence, 2));
    }
    tell!("\n{}", wrapped(&format!("Diagnosis: {}", sentence::verdict(d)), 0));
    for p in d.effects.iter().flat_map(|e| &e.parameters) {
        tell!("    {:<18} {}", p.name, p.unit.quantity(format!("{:>20}", with_error(p.value, p.std))));
    }
    if let Some(next) = &d.next_experiment {
        tell!("{}", wrapped(&format!("Next experiment: {}", next.what), 0));
    }
    let [delivered, identified, added] = findings.stage_rms();
    let series = [delivered, identified, added];
    let [delivered, identified, added] = series.each_ref().map(|rms| Some(&rms[..]));
    let stages = [("delivered", delivered), ("identified", identified), ("effect added", added)];
    let all = [&stages[..], &[("noise floor", Some(&d.noise_floor[..]))]].concat();
    tell!("\nOn the held-out motion\n{}", Table::of_channels(d.budget.mechanism, &d.channels, &all));
    tell!("\nHidden was {}", describe(campaign));
    tell!("{}", if findings.right { "Found." } else { "Not found." });
    tell!("\nWritten:");
    for f in files {
        tell!("  {}", f.display());
    }
    if let Some(how) = super::VIEWER {
        tell!("\nTo {how}.");
    }
}

fn summary(args: &Args, campaign: &Campaign, findings: &Findings, files: &[PathBuf]) -> serde_json::Value {
    let d = &findings.analysis.diagnosis;
    let axes = |v: &[f64]| v[..4].to_vec();
    json!({
        "seed": args.seed,
        "hidden": hidden(campaign),
        "hidden_values": describe(campaign),
        "verdict": d.verdict.to_string(),
        "named": d.effects.iter().map(|e| e.name.clone()).collect::<Vec<_>>(),
        "indistinguishable": d.indistinguishable,
        "right": findings.right,
        "rms_delivered": axes(&findings.stage_rms()[0]),
        "rms_before": axes(&d.rms_before),
        "rms_after": axes(&d.rms_after),
        "noise_floor": axes(&d.noise_floor),
        "files": files,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltatwin::recording::Signals;

    #[test]
    fn a_recording_has_the_robot_the_model_and_the_command() {
        let folder = tempfile::tempdir().unwrap();
        let args = Args { output: folder.path().into(), effect: Some("base_tilt".into()), ..Args::default() };
        let known = model::parse(IRB_360_6_1600, Path::new("models/irb360-6-1600.toml")).unwrap();
        let t = (0..100).map(|k| f64::from(k) * 4e-4).collect();
        let signals = Signals::of_drives(known.mechanism, t, &[[0.3; 4]; 100], &[[0.0; 4]; 100]);
        let file = keep(&args, &known, &Recording { name: "run".into(), signals, ..Recording::default() }).unwrap();
        let bytes = std::fs::read(&file).unwrap();
        for text in ["/tf", "/robot_description", "deltatwin demo --seed 2 --effect base_tilt", "[geometry]"] {
            assert!(bytes.windows(text.len()).any(|window| window == text.as_bytes()), "{text}");
        }
    }
}

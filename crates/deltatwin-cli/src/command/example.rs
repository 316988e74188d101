//! `deltatwin example`.

use std::path::PathBuf;

use miette::{IntoDiagnostic, WrapErr};
use serde_json::json;

use super::demo::measured;
use crate::terminal::{DONE, command, path, say};
use deltatwin_io::file::replace_text;
use deltatwin_io::recording;
use deltatwin_validation::demo::describe;

/// Write two recordings to begin with: a robot with an effect that its model lacks.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = "Example: deltatwin example -o example")]
pub struct Args {
    /// Draws the effect, its size, the model's errors, the motions and the noise.
    #[arg(long, default_value_t = 5)]
    pub seed: u64,
    /// Hide this effect instead of one drawn from those that these motions can show; `none` hides nothing.
    #[arg(long, value_name = "NAME")]
    pub effect: Option<String>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
    /// Folder of the recordings.
    #[arg(short, long, default_value = "example", value_name = "DIR")]
    pub output: PathBuf,
}

/// The model that belongs to the recordings.
const MODEL: &str = "irb360-6-1600";

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let (campaign, _) = measured(args.seed, args.effect.as_deref())?;
    let folder = &args.output;
    std::fs::create_dir_all(folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
    let files = ["first.csv", "second.csv"].map(|name| folder.join(name));
    for (recorded, file) in [&campaign.measurement, &campaign.validation].into_iter().zip(&files) {
        recording::write(recorded, file)?;
    }
    let hidden = folder.join("hidden.txt");
    replace_text(&hidden, &format!("{}\n", describe(&campaign)))
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", hidden.display()))?;
    if args.json {
        say(json!({ "model": MODEL, "data": path(&files[0]), "held_out": path(&files[1]), "hidden": path(&hidden) }))?;
        return Ok(DONE);
    }
    let [first, second] = files.each_ref().map(|file| file.display().to_string());
    say("  Two motions of a robot, as recorded: time, four joint angles, four torques, one strut force.")?;
    say(format!("  Its model {MODEL} lacks one effect; {} names it.\n", hidden.display()))?;
    say("  Written")?;
    files.iter().try_for_each(|file| say(format!("    {}", file.display())))?;
    say("\n  Next")?;
    let loops = ["deltatwin", "run", MODEL, &first, "--held-out", &second, "-o", "analysis"];
    say(command(&loops.map(String::from), 4))?;
    let checks = ["deltatwin", "check", "--model", MODEL, &first];
    say(command(&checks.map(String::from), 4))?;
    Ok(DONE)
}

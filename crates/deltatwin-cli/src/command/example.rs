//! `deltatwin example`.

use std::path::PathBuf;

use miette::{IntoDiagnostic, WrapErr};
use serde_json::json;

use super::demo::measured;
use crate::terminal::{DONE, command, path, say};
use deltatwin_validation::demo::{EXAMPLE, write_example};

/// Write two recordings to begin with: a robot with an effect that its model lacks.
#[derive(clap::Args, Debug, Clone)]
#[command(after_help = "Example: deltatwin example -o example")]
pub struct Args {
    /// Draws the effect, its size, the model's errors, the motions and the noise.
    #[arg(long, default_value_t = EXAMPLE.0)]
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

const MODEL: &str = EXAMPLE.1;

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let (campaign, _) = measured(args.seed, args.effect.as_deref())?;
    let folder = &args.output;
    std::fs::create_dir_all(folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
    let [first, second, hidden] = write_example(&campaign, folder)?;
    if args.json {
        say(json!({ "model": MODEL, "data": path(&first), "held_out": path(&second), "hidden": path(&hidden) }))?;
        return Ok(DONE);
    }
    let [first, second] = [first, second].map(|file| file.display().to_string());
    say("  Two motions of a robot, as recorded: time, four joint angles, four torques, one strut force.")?;
    say(format!("  Its model {MODEL} lacks one effect; {} names it.\n", hidden.display()))?;
    say("  Written")?;
    say(format!("    {first}\n    {second}"))?;
    say("\n  Next")?;
    let loops = ["deltatwin", "run", MODEL, &first, "--held-out", &second, "-o", "analysis"];
    say(command(&loops.map(String::from), 4))?;
    let checks = ["deltatwin", "check", "--model", MODEL, &first];
    say(command(&checks.map(String::from), 4))?;
    Ok(DONE)
}

//! `deltatwin export`.

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr, miette};
use serde_json::json;

use deltatwin_io::exchange::{self, Exported, Format};
use deltatwin_io::kind::{Kind, kind};
use deltatwin_io::recording::{Reading, setup};
use deltatwin_io::{file, model};

use crate::terminal::{DONE, check_output, path, say, warn};

/// Write a recording or a robot for other programs.
///
/// A recording becomes a table: CSV with its setup beside it, or Parquet. A model of an assembled delta robot becomes
/// MJCF for MuJoCo (.xml), with closed loops, motors and friction; or URDF (.urdf), a tree with the joints that close
/// its loops beside it.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Examples: deltatwin export run.mcap -o run.parquet\n          \
                  deltatwin export models/irb360-6-1600.toml -o robot.xml")]
pub struct Args {
    /// Recording or model.
    #[arg(value_name = "FILE")]
    pub input: PathBuf,
    /// File to write: .csv, .parquet or .mcap of a recording, .xml (MJCF) or .urdf of a model.
    #[arg(short, long, value_name = "OUT", required_unless_present = "csv")]
    pub output: Option<PathBuf>,
    /// CSV file to write; the setup goes to `<stem>.setup.toml` beside it.
    #[arg(long, value_name = "OUT", conflicts_with = "output")]
    pub csv: Option<PathBuf>,
    /// Setup with the payload: of a recording instead of its sidecar, or carried by the robot.
    #[arg(long, value_name = "FILE")]
    pub setup: Option<PathBuf>,
    /// Replace an existing robot.
    #[arg(long)]
    pub force: bool,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let setup = args.setup.as_deref();
    match (&args.csv, &args.output) {
        (Some(csv), _) => table(args, csv, &["csv"]),
        (None, Some(output)) if kind(&args.input)? == Kind::Model => robot(args, output, setup),
        (None, Some(output)) => table(args, output, &["csv", "parquet", "mcap"]),
        (None, None) => Err(miette!("no file to write; expected -o OUT")),
    }
}

fn table(args: &Args, output: &Path, extensions: &[&str]) -> miette::Result<u8> {
    let how = Reading { setup: args.setup.as_deref(), ..Reading::default() };
    super::convert(&args.input, None, &how, output, extensions, args.json)
}

/// Writes a robot.
fn robot(args: &Args, output: &Path, setup: Option<&Path>) -> miette::Result<u8> {
    let inputs: Vec<&Path> = std::iter::once(args.input.as_path()).chain(setup).collect();
    check_output(output, &inputs, &["xml", "urdf"])?;
    if output.exists() && !args.force {
        return Err(miette!("{} exists; expected another name, or --force", output.display()));
    }
    let model = model::read(&args.input)?;
    let carried = setup.map(setup::read).transpose()?.unwrap_or_default();
    let format =
        if output.extension().is_some_and(|e| e.eq_ignore_ascii_case("urdf")) { Format::Urdf } else { Format::Mjcf };
    let made = exchange::export(&model, &carried, format).wrap_err_with(|| args.input.display().to_string())?;
    file::replace_text(output, &made.text).into_diagnostic().wrap_err_with(|| output.display().to_string())?;
    let left_out: Vec<String> = made.left_out.iter().map(|what| format!("left out: {what}")).collect();
    warn(&left_out);
    if args.json {
        say(to_json(args, output, &made))?;
    } else {
        let Exported { links, loops, mass, .. } = made;
        say(format!("Wrote {}: {links} links of {mass:.3} kg, {loops} joints that close the loops", output.display()))?;
        say(format!("  next: {}", next(format, output)))?;
    }
    Ok(DONE)
}

fn to_json(args: &Args, output: &Path, made: &Exported) -> serde_json::Value {
    json!({
        "input": path(&args.input),
        "output": path(output),
        "links": made.links,
        "loops": made.loops,
        "mass": made.mass,
        "left_out": made.left_out,
    })
}

/// What opens the robot.
fn next(format: Format, output: &Path) -> String {
    match format {
        Format::Mjcf => format!("python -m mujoco.viewer --mjcf={}", output.display()),
        Format::Urdf => format!("pinocchio.buildModelFromUrdf(\"{}\") in Python", output.display()),
    }
}

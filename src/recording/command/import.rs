//! `deltatwin import`.

use std::path::PathBuf;

/// Check a measurement and keep it as MCAP.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin import run.csv -o run.mcap")]
pub struct Args {
    /// Measurement; its setup is taken from the sidecar `<stem>.setup.toml` if there is one.
    pub csv: PathBuf,
    /// Recording to write, .mcap or .csv.
    #[arg(short, long, value_name = "REC")]
    pub output: PathBuf,
    /// Setup of the run, instead of the sidecar.
    #[arg(long, value_name = "FILE")]
    pub setup: Option<PathBuf>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> miette::Result<u8> {
    super::convert(&args.csv, args.setup.as_deref(), &args.output, &["mcap", "csv"], args.json)
}

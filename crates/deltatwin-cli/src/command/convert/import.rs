//! `deltatwin import`.

use std::path::PathBuf;

use crate::data::ColumnArgs;

/// Check a measurement from elsewhere and keep it as MCAP or CSV.
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
    #[command(flatten)]
    pub columns: ColumnArgs,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let how = args.columns.reading(args.setup.as_deref(), None);
    super::convert(&args.csv, &how, &args.output, &["mcap", "csv"], args.json)
}

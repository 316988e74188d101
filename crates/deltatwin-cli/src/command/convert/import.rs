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
    /// Model file of the machine: the .mcap file then has the robot for display, and the model.
    #[arg(long, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    #[command(flatten)]
    pub columns: ColumnArgs,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = args.model.as_deref().map(deltatwin_io::model::read).transpose()?;
    let how = args.columns.reading(args.setup.as_deref(), model.as_ref().map(|model| model.mechanism));
    super::convert(&args.csv, model.as_ref(), &how, &args.output, &["mcap", "csv"], args.json)
}

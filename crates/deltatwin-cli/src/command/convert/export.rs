//! `deltatwin export`.

use std::path::PathBuf;

use deltatwin_io::recording::Reading;

/// Write a recording as CSV, with its setup beside it.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin export run.mcap --csv run.csv")]
pub struct Args {
    /// Recording.
    pub recording: PathBuf,
    /// CSV file to write; the setup goes to `<stem>.setup.toml` beside it.
    #[arg(long, value_name = "OUT")]
    pub csv: PathBuf,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    super::convert(&args.recording, &Reading::default(), &args.csv, &["csv"], args.json)
}

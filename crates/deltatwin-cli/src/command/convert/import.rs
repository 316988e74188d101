//! `deltatwin import`.

use std::path::PathBuf;

use deltatwin_io::recording::{Mapping, Reading};

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
    /// Which column is which channel, such as "t=Time[ms], q1=ActPos[deg], tau1=Iq[A]*0.12"; may be given several times.
    #[arg(long, value_name = "MAP")]
    pub map: Vec<Mapping>,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let how = Reading { setup: args.setup.as_deref(), machine: None, maps: &args.map };
    super::convert(&args.csv, &how, &args.output, &["mcap", "csv"], args.json)
}

//! `deltatwin replay`.

#[cfg(feature = "watch")]
mod send;
#[cfg(feature = "viewer")]
mod show;

use std::path::PathBuf;

#[cfg(feature = "watch")]
use crate::broker::{Access, Given};
use crate::data::{ColumnArgs, Outside, positive};

/// Look at a recording in Rerun: the moving robot, measured and predicted torques; or send it to a broker.
///
/// With --mqtt the samples are published like those of a running machine, for `deltatwin watch`.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin replay run.mcap && rerun run.rrd")]
pub struct Args {
    /// Recordings; several are sent one after the other.
    #[arg(required = true, value_name = "REC")]
    pub recordings: Vec<PathBuf>,
    /// Rerun file to write; without it, next to the recording.
    #[arg(short, long, value_name = "RRD")]
    pub output: Option<PathBuf>,
    /// Model file to compare with; the shipped `irb360-6-1600.toml` without it.
    #[arg(long, value_name = "M")]
    pub model: Option<PathBuf>,
    /// Later model file, whose residual is shown next to the first.
    #[arg(long, value_name = "MODEL2")]
    pub beside: Option<PathBuf>,
    #[command(flatten)]
    pub columns: ColumnArgs,
    #[command(flatten)]
    pub outside: Outside,
    #[cfg(feature = "viewer")]
    #[command(flatten)]
    viewer: super::view::LiveView,
    /// Broker to publish the samples at, instead of writing a file.
    #[cfg(feature = "watch")]
    #[arg(long, value_name = "URL", requires = "topic", conflicts_with = "output")]
    pub mqtt: Option<Given>,
    /// Topic of the samples.
    #[cfg(feature = "watch")]
    #[arg(long, value_name = "TOPIC", requires = "mqtt")]
    pub topic: Option<String>,
    #[cfg(feature = "watch")]
    #[command(flatten)]
    pub access: Access,
    /// Seconds of the recording per second, to the broker or with --live.
    #[arg(long, value_name = "X", default_value_t = 1.0, value_parser = positive)]
    pub speed: f64,
    /// Seconds of samples in a message.
    #[cfg(feature = "watch")]
    #[arg(long, value_name = "SECONDS", default_value_t = 0.02, value_parser = positive, requires = "mqtt")]
    pub batch: f64,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    #[cfg(feature = "watch")]
    if let (Some(address), Some(topic)) = (&args.mqtt, &args.topic) {
        return send::run(args, address, topic);
    }
    look(args)
}

#[cfg(feature = "viewer")]
fn look(args: &Args) -> miette::Result<u8> {
    show::run(args)
}

#[cfg(not(feature = "viewer"))]
fn look(_: &Args) -> miette::Result<u8> {
    Err(miette::miette!("this build leaves the viewer out; build it with `cargo run --features viewer -- replay …`"))
}

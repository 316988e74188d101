//! Command-line arguments.

use crate::command::Command;
use crate::data::positive;
use clap::Parser;

/// Digital twin of a delta robot: compare, diagnose the missing physical effect, add it, watch the error fall.
#[derive(Parser)]
#[command(
    name = "deltatwin",
    version,
    after_help = "Without a command, deltatwin runs the demo. Example: deltatwin demo --seed 7"
)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
    /// Longest time of the command, s; what was written until then is kept.
    #[arg(long, global = true, value_name = "SECONDS", value_parser = positive)]
    pub time_limit: Option<f64>,
}

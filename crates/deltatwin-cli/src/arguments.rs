//! The commands.

use clap::{Parser, Subcommand};
use deltatwin::{
    check, comparison, constraint_forces, demo, diagnosis, effects, exam, excitation, identification, planner,
    recording, reproduce, twin,
};

use crate::shell;

/// Digital twin of a delta robot: compare, diagnose the missing physical effect, add it, watch the error fall.
#[derive(Parser)]
#[command(version, after_help = "Without a command, deltatwin runs the demo. Example: deltatwin demo --seed 7")]
pub struct Cli {
    #[command(subcommand)]
    pub command: Option<Command>,
}

/// One variant per command.
#[derive(Subcommand)]
pub enum Command {
    Demo(demo::command::Args),
    Reproduce(reproduce::command::Args),
    Simulate(twin::command::Args),
    Import(recording::command::import::Args),
    Export(recording::command::export::Args),
    Excite(excitation::command::Args),
    Identify(identification::command::Args),
    Noise(identification::noise::Args),
    Compare(comparison::command::Args),
    Diagnose(diagnosis::command::diagnose::Args),
    Add(diagnosis::command::add::Args),
    Exam(exam::command::Args),
    Effects(effects::command::Args),
    Forces(constraint_forces::command::Args),
    Plan(planner::command::Args),
    #[cfg(feature = "viewer")]
    Replay(deltatwin::replay::command::Args),
    Check(check::command::Args),
    Completions(shell::Completions),
    Man(shell::Man),
}

//! Command-line arguments.

use crate::command::{
    add, check, compare, convert, demo, diagnose, effects, exam, excite, forces, identify, new, noise, plan, replay,
    reproduce, run, shell, simulate, study, watch,
};
use crate::data::positive;
use clap::{Parser, Subcommand};

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

/// One variant per command.
#[derive(Subcommand)]
pub enum Command {
    Demo(demo::Args),
    Run(run::Args),
    Reproduce(reproduce::Args),
    Simulate(simulate::Args),
    New(new::Args),
    Import(convert::import::Args),
    Export(convert::export::Args),
    Excite(excite::Args),
    Identify(identify::Args),
    Noise(noise::Args),
    Compare(compare::Args),
    Diagnose(diagnose::Args),
    Add(add::Args),
    Exam(exam::Args),
    Effects(effects::Args),
    Forces(forces::Args),
    Plan(plan::Args),
    #[cfg(feature = "studio")]
    Studio(crate::command::studio::Args),
    Study(study::Args),
    Replay(replay::Args),
    Watch(watch::Args),
    Check(check::Args),
    Completions(shell::Completions),
    Man(shell::Man),
}

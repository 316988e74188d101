//! The `deltatwin` command line.

mod cli;
mod shell;

use std::process::ExitCode;

use clap::Parser;
use cli::{Cli, Command};
use deltatwin::{
    check, comparison, constraint_forces, demo, diagnosis, effects, exam, excitation, identification, planner,
    recording, reproduce, terminal, twin,
};
use miette::MietteHandlerOpts;

fn main() -> ExitCode {
    // Paths and lines of an error stay whole for whoever searches in them.
    miette::set_hook(Box::new(|_| Box::new(MietteHandlerOpts::new().wrap_lines(false).build())))
        .expect("no other handler is installed");
    // The command line may be what is wrong, so its parser cannot be asked.
    let as_json = std::env::args_os().any(|a| a == "--json");
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(usage) => {
            if as_json && usage.use_stderr() {
                print_json_error(&usage.render().to_string(), &[], None);
            }
            usage.exit()
        }
    };
    match run(cli.command.unwrap_or_else(|| Command::Demo(demo::command::Args::default()))) {
        Ok(status) => ExitCode::from(status),
        Err(report) => {
            eprintln!("{report:?}");
            // An answer that stands on stdout already stays the only object there.
            if as_json && !terminal::has_said() {
                let causes: Vec<String> = report.chain().skip(1).map(ToString::to_string).collect();
                print_json_error(&report.to_string(), &causes, report.help().map(|h| h.to_string()));
            }
            ExitCode::from(terminal::BAD_INPUT)
        }
    }
}

/// Prints `{"error": {"message", "causes", "help"}}` on stdout, for programs that asked for JSON.
fn print_json_error(message: &str, causes: &[String], help: Option<String>) {
    let error = serde_json::json!({ "error": { "message": message.trim(), "causes": causes, "help": help } });
    // Nothing is left to do if stdout is gone, too: the error stands on stderr.
    let _ = terminal::say(error);
}

fn run(command: Command) -> miette::Result<u8> {
    match &command {
        Command::Demo(args) => demo::command::run(args),
        Command::Reproduce(args) => reproduce::command::run(args),
        Command::Simulate(args) => twin::command::run(args),
        Command::Import(args) => recording::command::import::run(args),
        Command::Export(args) => recording::command::export::run(args),
        Command::Excite(args) => excitation::command::run(args),
        Command::Identify(args) => identification::command::run(args),
        Command::Noise(args) => identification::noise::run(args),
        Command::Compare(args) => comparison::command::run(args),
        Command::Diagnose(args) => diagnosis::command::diagnose::run(args),
        Command::Add(args) => diagnosis::command::add::run(args),
        Command::Exam(args) => exam::command::run(args),
        Command::Effects(args) => effects::command::run(args),
        Command::Forces(args) => constraint_forces::command::run(args),
        Command::Plan(args) => planner::command::run(args),
        #[cfg(feature = "viewer")]
        Command::Replay(args) => deltatwin::replay::command::run(args),
        Command::Check(args) => check::command::run(args),
        Command::Completions(args) => shell::completions(args),
        Command::Man(args) => shell::man(args),
    }
}

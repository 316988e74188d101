//! The `deltatwin` command line.

mod arguments;
#[cfg(feature = "watch")]
mod broker;
mod command;
mod data;
mod kind;
mod report;
mod terminal;

use std::process::ExitCode;

use arguments::Cli;
use clap::Parser;
use clap::error::{ContextKind, ContextValue};
use command::{Command, demo, left_out};
use miette::MietteHandlerOpts;
use serde_json::{Value, json};

fn main() -> ExitCode {
    // Paths and lines of an error are not wrapped, so that they can be searched.
    // Without colours and links: whatever steers a terminal comes from a file, and is shown instead.
    let plain = || MietteHandlerOpts::new().wrap_lines(false).color(false).terminal_links(false).build();
    miette::set_hook(Box::new(move |_| Box::new(plain()))).expect("no other handler is installed");
    // The parser is not available if the command line itself is invalid.
    let as_json = std::env::args_os().any(|a| a == "--json");
    let cli = match Cli::try_parse() {
        Ok(cli) => cli,
        Err(mut usage) => {
            if let Some(expected) = expected_number(&usage).map(str::to_string).or_else(|| needs_a_feature(&usage)) {
                usage.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![expected.into()]));
            }
            // The parser repeats what it does not know, such as an address at a wrong place with its password.
            let text = usage.render().to_string();
            let shown = terminal::without_login(&text);
            if as_json && usage.use_stderr() {
                print_json_error(json!({ "message": shown.trim(), "causes": [], "help": null }));
            }
            if usage.use_stderr() && shown != text {
                terminal::complain(shown.trim_end());
                return ExitCode::from(terminal::BAD_INPUT);
            }
            usage.exit()
        }
    };
    // These give the best answer that the time allows.
    let is_bounded = matches!(cli.command, Some(Command::Diagnose(_) | Command::Run(_)));
    if let Some(limit) = cli.time_limit.filter(|_| !is_bounded) {
        terminal::end_after(limit);
    }
    let outcome = cli.command.unwrap_or_else(|| Command::Demo(demo::Args::default())).run();
    #[cfg(feature = "viewer")]
    command::view::end();
    match outcome {
        Ok(status) => ExitCode::from(status),
        Err(report) => {
            terminal::complain(format!("{report:?}"));
            // An answer already printed on stdout remains the only object there.
            if as_json && !terminal::has_said() {
                print_json_error(terminal::error_json(&report));
            }
            ExitCode::from(terminal::BAD_INPUT)
        }
    }
}

/// What was expected where a number of the command line is none, which the parsers of numbers do not say.
fn expected_number(usage: &clap::Error) -> Option<&'static str> {
    let cause = std::error::Error::source(usage)?;
    if cause.is::<std::num::ParseIntError>() {
        Some("expected a whole number")
    } else if cause.is::<std::num::ParseFloatError>() {
        Some("expected a number")
    } else {
        None
    }
}

/// How to build a program that has the command asked for, if this build leaves it out.
fn needs_a_feature(usage: &clap::Error) -> Option<String> {
    let Some(ContextValue::String(name)) = usage.get(ContextKind::InvalidSubcommand) else { return None };
    let feature = left_out(name)?;
    Some(format!("this build leaves `{name}` out; build it with `cargo run --features {feature} -- {name} …`"))
}

/// Prints `{"error": {"message", "causes", "help"}}` on stdout, for programs that asked for JSON.
fn print_json_error(error: Value) {
    // If stdout is closed as well, the error is on stderr only.
    let _ = terminal::say(json!({ "error": error }));
}

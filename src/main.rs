//! The `deltatwin` command.
use clap::Parser;
#[derive(Parser)]
struct Cli {
    #[command(flatten)]
    args: deltatwin::demo::command::Args,
}
fn main() -> miette::Result<()> {
    let c = Cli::parse();
    let code = deltatwin::demo::command::run(&c.args)?;
    std::process::exit(code.into())
}

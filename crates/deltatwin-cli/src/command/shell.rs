//! `deltatwin completions` and `deltatwin man`: shell completions and the manual.

const NAME: &str = "deltatwin";

/// `deltatwin completions`.
pub mod completions {
    use clap::CommandFactory;
    use clap_complete::Shell;
    use miette::IntoDiagnostic;
    use serde_json::json;

    use crate::arguments::Cli;
    use crate::terminal::{DONE, say};

    /// Print what completes deltatwin's commands and options in a shell.
    #[derive(clap::Args, Clone, Debug)]
    #[command(
        after_help = "Example: deltatwin completions bash > ~/.local/share/bash-completion/completions/deltatwin"
    )]
    pub struct Args {
        /// Shell.
        pub shell: Shell,
        /// The script as one JSON object.
        #[arg(long)]
        pub json: bool,
    }

    /// Prints a completion script; returns the exit status.
    pub fn run(args: &Args) -> miette::Result<u8> {
        let mut script = Vec::new();
        clap_complete::generate(args.shell, &mut Cli::command(), super::NAME, &mut script);
        let script = String::from_utf8(script).into_diagnostic()?;
        match args.json {
            true => say(json!({ "shell": args.shell.to_string(), "script": script }))?,
            false => say(script.trim_end())?,
        }
        Ok(DONE)
    }
}

/// `deltatwin man`.
pub mod man {
    use std::path::PathBuf;

    use clap::CommandFactory;
    use miette::{IntoDiagnostic, WrapErr};
    use serde_json::json;

    use crate::arguments::Cli;
    use crate::terminal::{DONE, say};

    /// Write the manual, one page per command.
    #[derive(clap::Args, Clone, Debug)]
    #[command(after_help = "Example: deltatwin man -o ~/.local/share/man/man1 && man deltatwin-diagnose")]
    pub struct Args {
        /// Folder for the pages `deltatwin.1`, `deltatwin-COMMAND.1`.
        #[arg(short, long, value_name = "DIR")]
        pub output: PathBuf,
        /// One JSON object on stdout.
        #[arg(long)]
        pub json: bool,
    }

    /// Writes the manual; returns the exit status.
    pub fn run(args: &Args) -> miette::Result<u8> {
        let folder = args.output.display().to_string();
        std::fs::create_dir_all(&args.output).into_diagnostic().wrap_err_with(|| folder.clone())?;
        clap_mangen::generate_to(Cli::command(), &args.output).into_diagnostic().wrap_err_with(|| folder.clone())?;
        match args.json {
            true => say(json!({ "output": folder }))?,
            false => say(format!("Wrote the manual into {folder}; read it with: man -l {folder}/{}.1", super::NAME))?,
        }
        Ok(DONE)
    }
}

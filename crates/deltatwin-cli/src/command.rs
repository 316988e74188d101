//! The commands, one module each, and their list.

pub mod add;
pub mod check;
pub mod compare;
pub mod convert;
pub mod demo;
pub mod diagnose;
pub mod effects;
#[cfg(feature = "studies")]
pub mod exam;
pub mod example;
pub mod excite;
pub mod forces;
pub mod gate;
pub mod identify;
pub mod new;
pub mod noise;
pub mod plan;
pub mod replay;
#[cfg(feature = "reproduce")]
pub mod reproduce;
pub mod run;
pub mod shell;
pub mod simulate;
#[cfg(feature = "studio")]
pub mod studio;
#[cfg(feature = "studies")]
pub mod study;
#[cfg(feature = "viewer")]
pub mod view;
#[cfg(feature = "watch")]
pub mod watch;

/// How to see the robot in Rerun, where this build leaves the viewer out.
pub const VIEWER: Option<&str> =
    if cfg!(feature = "viewer") { None } else { Some("see the robot move in Rerun: build with `--features viewer`") };

/// The list of commands, in the order of the help: the parser, the help, the completions and the manual follow it.
///
/// A module has `Args` and `run`. A command that needs a feature of the build is known without it, too:
/// [`left_out`] names the feature.
macro_rules! commands {
    ($($variant:ident($($module:ident)::+) $(needs $feature:literal)?,)*) => {
        /// One variant per command.
        #[derive(clap::Subcommand)]
        pub enum Command {
            $($(#[cfg(feature = $feature)])? $variant($($module)::+::Args),)*
        }

        impl Command {
            /// Runs the command; returns the exit status.
            pub fn run(&self) -> miette::Result<u8> {
                match self {
                    $($(#[cfg(feature = $feature)])? Self::$variant(args) => $($module)::+::run(args),)*
                }
            }
        }

        /// Feature that the command `name` needs and this build lacks.
        pub fn left_out(name: &str) -> Option<&'static str> {
            let needed = [$($((stringify!($variant), $feature, cfg!(feature = $feature)),)?)*];
            let found = needed.into_iter().find(|(variant, ..)| variant.eq_ignore_ascii_case(name));
            found.filter(|(.., built)| !built).map(|(_, feature, _)| feature)
        }
    };
}

commands! {
    Demo(demo),
    Example(example),
    Run(run),
    Reproduce(reproduce) needs "reproduce",
    Simulate(simulate),
    New(new),
    Import(convert::import),
    Export(convert::export),
    Excite(excite),
    Identify(identify),
    Noise(noise),
    Compare(compare),
    Diagnose(diagnose),
    Add(add),
    Exam(exam) needs "studies",
    Effects(effects),
    Forces(forces),
    Plan(plan),
    Studio(studio) needs "studio",
    Study(study) needs "studies",
    Replay(replay),
    Watch(watch) needs "watch",
    Check(check),
    Completions(shell::completions),
    Man(shell::man),
}

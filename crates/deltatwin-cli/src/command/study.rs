//! `deltatwin study`.

mod advice;
mod again;
mod experiment;
mod pictures;
pub mod progress;
mod told;

use std::path::{Path, PathBuf};

use miette::miette;

use crate::data::Outside;
use crate::terminal::{DONE, INTERRUPTED, catch_interrupt};
use deltatwin_io::study;
use deltatwin_study::campaign::{CampaignError, Chunk, Held};
use deltatwin_study::conduct::{Conduct, ConductError};
use progress::Progress;

/// Run the twin many times: which factors make it fail, where, why, how often.
///
/// DIR gets the table `runs.parquet`, one row a run, and pictures of it. What is there is kept: the same command goes on
/// after Ctrl-C or a kill, and the table does not depend on threads, chunks or interruptions.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Examples:\n  \
    deltatwin study scenarios/studies/smoke.toml -o study\n  \
    deltatwin study scenarios/studies/smoke.toml -o study --run 11 --mcap run.mcap\n  \
    deltatwin study scenarios/failures/bulky-torque-limits.toml --advise\n  \
    on two machines with a common folder: … --chunk 1/2 and … --chunk 2/2, then … --merge")]
pub struct Args {
    /// Study file.
    pub study: PathBuf,
    /// Folder for the table, the pictures and the kept recordings.
    #[arg(short, long, value_name = "DIR", required_unless_present_any = ["run", "advise"])]
    pub output: Option<PathBuf>,
    /// Make chunk K of N only: one part of the table, and nothing else.
    #[arg(long, value_name = "K/N", conflicts_with_all = ["merge", "run"])]
    pub chunk: Option<Chunk>,
    /// Make the table of parts that are there; names the missing ones.
    #[arg(long, conflicts_with = "run")]
    pub merge: bool,
    /// Make this run again, from its row in the table if there is one.
    #[arg(long, value_name = "I")]
    pub run: Option<u64>,
    /// Recording of the run that is made again, .mcap or .csv.
    #[arg(long, value_name = "FILE", requires = "run")]
    pub mcap: Option<PathBuf>,
    /// Rerun file of the run that is made again.
    #[cfg(feature = "viewer")]
    #[arg(long, value_name = "FILE", requires = "run")]
    pub rrd: Option<PathBuf>,
    /// Find the three cheapest remedies for a scenario, or for a study with its factors at their middles: slower, turned,
    /// gripped elsewhere, higher, planned within strut limits. Each is checked on the twin.
    #[arg(long, conflicts_with_all = ["chunk", "merge", "run", "output"])]
    pub advise: bool,
    /// Path file along which the motion is planned first.
    #[arg(long, value_name = "FILE", requires = "advise")]
    pub path: Option<PathBuf>,
    /// Margin that a remedy must give: 1 unloaded, 0 at the limit.
    #[arg(long, default_value_t = 0.1, value_name = "MARGIN", value_parser = margin, requires = "advise")]
    pub wanted: f64,
    /// Remove the rows of another study, or of this one, from DIR first.
    #[arg(long, conflicts_with_all = ["merge", "run"])]
    pub force: bool,
    #[command(flatten)]
    pub outside: Outside,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    if args.advise {
        return advice::run(args);
    }
    let study = study::read(&args.study, args.outside.access())?;
    let folder = args.output.clone().unwrap_or_default();
    if folder.is_file() {
        return Err(miette!("{}: is a file; expected a folder, which may be new", folder.display()));
    }
    catch_interrupt()?;
    if study.experiment.is_some() {
        return experiment::run(args, study);
    }
    let conduct = Conduct::new(study, &folder)?;
    if let Some(run) = args.run {
        return again::run(args, &conduct, run);
    }
    if args.force {
        conduct.campaign.clear()?;
    }
    if args.merge {
        merged(args, &conduct)?;
        return told::table(args, &conduct);
    }
    if let Some(chunk) = args.chunk {
        return if made(&conduct, chunk)? { told::part(args, &conduct, chunk) } else { Ok(told::interrupted(args)) };
    }
    if conduct.campaign.held()? == Held::Open {
        if !made(&conduct, Chunk::WHOLE)? {
            return Ok(told::interrupted(args));
        }
        merged(args, &conduct)?;
    }
    conduct.campaign.remove_parts()?;
    told::table(args, &conduct)
}

fn margin(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (0.0..1.0).contains(&x) => Ok(x),
        _ => Err("expected a number from 0 to below 1".into()),
    }
}

/// Makes the rows of a chunk; returns whether it was not interrupted.
fn made(conduct: &Conduct, chunk: Chunk) -> miette::Result<bool> {
    let range = chunk.range(conduct.runs());
    let progress = Progress::new(range.end - range.start, (Some(conduct.columns.survived), "failed"));
    let end = conduct.chunk(chunk, &progress);
    progress.finish();
    match end {
        Ok(()) => Ok(true),
        Err(ConductError::Campaign(CampaignError::Interrupted)) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// Merges the parts.
fn merged(args: &Args, conduct: &Conduct) -> miette::Result<u64> {
    let runs = (!conduct.is_search()).then(|| conduct.runs());
    conduct.campaign.merge(runs).map_err(|error| merge_help(args, error))
}

/// The error of a merge, with the commands that make what is missing.
fn merge_help(args: &Args, error: CampaignError) -> miette::Report {
    let CampaignError::Incomplete { chunks, .. } = &error else { return error.into() };
    let next: Vec<String> = chunks.iter().take(SHOWN).map(|chunk| command(args, &format!("--chunk {chunk}"))).collect();
    let more = if chunks.len() > SHOWN { format!("\n(and {} more)", chunks.len() - SHOWN) } else { String::new() };
    miette!(help = format!("make what is missing:\n{}{more}", next.join("\n")), "{error}")
}

/// Number of missing chunks that are listed.
const SHOWN: usize = 5;

/// A command on the same study and folder.
fn command(args: &Args, options: &str) -> String {
    let folder = args.output.as_deref().unwrap_or(Path::new("DIR"));
    format!("deltatwin study {} -o {} {options}", args.study.display(), folder.display()).trim_end().into()
}

/// The status after an interruption.
const STOPPED: u8 = INTERRUPTED;
/// The status of a study that is complete.
const COMPLETE: u8 = DONE;

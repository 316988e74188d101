//! `deltatwin exam`.

use std::path::PathBuf;

use miette::{IntoDiagnostic, miette};
use rayon::prelude::*;

use crate::terminal::{
    DONE, INTERRUPTED, Table, bar, catch_interrupt, complain, interrupted, origin_of, path, say, warn, write_figure,
};
use deltatwin::model::Model;
use deltatwin_analysis::json::paths;
use deltatwin_analysis::page::end;
use deltatwin_io::model;
use deltatwin_study::campaign::{CampaignError as Stopped, Chunk};
use deltatwin_validation::exam::campaign::hideable;
use deltatwin_validation::exam::conduct::{answer, graded};
use deltatwin_validation::exam::motion::MotionKind;
use deltatwin_validation::exam::noise::Noise;
use deltatwin_validation::exam::plan::Plan;
use deltatwin_validation::exam::score::{Judged, Score};
use deltatwin_validation::exam::size::Size;
use deltatwin_validation::exam::{self, Exam, Grade, figures, folder};

use super::study::progress::Progress;

/// Examine the diagnosis: hide effects in a robot, judge what is said about it, count.
///
/// Every campaign is a folder in DIR with its recordings, the truth and the answer. What is there already is kept, so that
/// an interrupted exam goes on. With --judge, the campaigns that stand in a folder are judged and none is made.
#[derive(clap::Args, Clone, Debug)]
#[command(
    after_help = "Example: deltatwin exam models/irb360-6-1600.toml --effects ball_socket_coulomb,torque_bias --seeds 3"
)]
pub struct Args {
    /// Model file.
    pub model: PathBuf,
    /// Folder for the campaigns and the figures.
    #[arg(short, long, default_value = "recordings/exam", value_name = "DIR")]
    pub output: PathBuf,
    /// Judge the campaigns in this folder, made by whatever software.
    #[arg(long, value_name = "DIR")]
    pub judge: Option<PathBuf>,
    /// Judge again what has an answer already.
    #[arg(long, alias = "anew")]
    pub force: bool,
    /// Effects to hide, one at a time and in pairs; all that the model lacks without it, `none` for none.
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    pub effects: Option<Vec<String>>,
    /// Sizes of single effects.
    #[arg(long, value_delimiter = ',', value_enum, default_value = "medium")]
    pub sizes: Vec<Size>,
    /// Campaigns per effect and size.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(0..=100_000))]
    pub seeds: u64,
    /// Campaigns with two effects of medium size.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=100_000))]
    pub pairs: u64,
    /// Campaigns with a law outside the library: those published by others first, then those written for the exam.
    #[arg(long, default_value_t = 0, value_parser = clap::value_parser!(u64).range(0..=100_000))]
    pub outside: u64,
    /// Campaigns in which nothing is hidden.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u64).range(0..=100_000))]
    pub null: u64,
    /// Further campaigns in which nothing is hidden: other noise on the recordings of four robots. Only answers are kept.
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = clap::value_parser!(u64).range(0..=100_000))]
    pub fast_null: u64,
    /// Kinds of noise, in turn.
    #[arg(long, value_delimiter = ',', value_enum, default_value = "white")]
    pub noise: Vec<Noise>,
    /// What the robots do.
    #[arg(long, value_enum, default_value_t)]
    pub motion: MotionKind,
    /// No force sensors in struts; two thirds of the robots have one without it.
    #[arg(long)]
    pub no_strut: bool,
    /// No payloads; half of the robots have one without it.
    #[arg(long)]
    pub no_payload: bool,
    /// Length of each recording, s.
    #[arg(long, default_value_t = 20.0, value_name = "SECONDS")]
    pub duration: f64,
    /// Draws everything.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Make and judge chunk K of N only, for example on one of several machines with a common folder.
    #[arg(long, value_name = "K/N", conflicts_with_all = ["judge", "merge", "no_answers"])]
    pub chunk: Option<Chunk>,
    /// Put the chunks together.
    #[arg(long, conflicts_with_all = ["judge", "no_answers"])]
    pub merge: bool,
    /// Only make the campaigns.
    #[arg(long, conflicts_with = "judge")]
    pub no_answers: bool,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = model::read(&args.model)?;
    let exam = planned(args, &model)?;
    catch_interrupt()?;
    let root = args.judge.as_ref().unwrap_or(&args.output);
    let (mut folders, mut judged): (Vec<PathBuf>, Vec<Judged>) = (Vec::new(), Vec::new());
    if args.judge.is_some() {
        let campaigns = folder::campaigns(root).into_diagnostic()?;
        let one = |folder: &PathBuf| answer(folder, &model, args.force, &told);
        judged = each("judge", &campaigns, one)?.into_iter().flatten().collect();
    } else if args.no_answers {
        folders = each("make", exam.cases(), |case| exam.made(case, &told))?.into_iter().flatten().collect();
    } else {
        judged = conducted(args, &exam)?;
        if args.chunk.is_some() && !interrupted() {
            say("Next, when all chunks are there: the same command with --merge in place of --chunk")?;
            return Ok(DONE);
        }
    }
    if interrupted() {
        complain("interrupted; the same command goes on");
        return Ok(INTERRUPTED);
    }
    if args.no_answers {
        say(format!("{} campaigns in {}", folders.len(), root.display()))?;
        return Ok(DONE);
    }
    if judged.is_empty() {
        return Err(miette!("{}: holds no campaign; expected folders with {}", root.display(), folder::TRUTH));
    }
    judged.sort_by(|a, b| a.name.cmp(&b.name));
    let score = Score::of(&judged);
    let mut files = Vec::new();
    for (name, figure) in figures::all(&score, &judged) {
        let file = root.join(format!("{name}.svg"));
        write_figure(&file, &figure)?;
        files.push(file);
    }
    let page = root.join("exam.html");
    let mut report = exam::page::page(&score, &judged, &model.name);
    end(&mut report, &origin_of("exam", &[("model", &args.model)])?);
    report.write(&page).into_diagnostic()?;
    if args.json {
        let mut object = score.json(&judged);
        object["figures"] = paths(&files);
        object["page"] = path(&page);
        say(object)?;
    } else {
        print(&score, &judged)?;
        say(format!("\n  Wrote {} with its figures", page.display()))?;
    }
    Ok(DONE)
}

/// The exam with the given arguments.
fn planned(args: &Args, model: &Model) -> miette::Result<Exam> {
    let effects = match &args.effects {
        Some(names) => names.iter().filter(|n| *n != "none").cloned().collect(),
        None => hideable(model).iter().map(|e| e.name().to_string()).collect(),
    };
    let plan = Plan {
        effects,
        sizes: args.sizes.clone(),
        seeds: args.seeds,
        pairs: args.pairs,
        outside: args.outside,
        null: args.null,
        noise: args.noise.clone(),
        motion: args.motion,
        strut_sensors: !args.no_strut,
        payloads: !args.no_payload,
        duration: args.duration,
        seed: args.seed,
    };
    Ok(Exam::new(model.clone(), plan, args.fast_null, &args.output)?.judging(args.force))
}

/// Tells that a campaign was left out.
fn told(what: String) {
    warn(&[what]);
}

/// Results of `work` for all `items`, computed on all cores until interrupted.
fn each<T: Sync, R: Send>(
    what: &str,
    items: &[T],
    work: impl Fn(&T) -> miette::Result<R> + Sync,
) -> miette::Result<Vec<R>> {
    let progress = bar(what, items.len() as u64);
    let done = |item: &T| {
        let result = if interrupted() { None } else { Some(work(item)?) };
        progress.inc(1);
        Ok(result)
    };
    let results: miette::Result<Vec<Option<R>>> = items.par_iter().map(done).collect();
    progress.finish_and_clear();
    Ok(results?.into_iter().flatten().collect())
}

/// Makes and judges all campaigns of an exam on the engine of the studies, and writes their table; what has an answer in
/// its folder is taken from there.
fn conducted(args: &Args, exam: &Exam) -> miette::Result<Vec<Judged>> {
    let rows = &exam.rows;
    // The folders hold what was done: rows of an earlier plan are made of them again.
    if args.chunk.is_none() && !args.merge {
        rows.clear()?;
    }
    if !args.merge {
        let chunk = args.chunk.unwrap_or(Chunk::WHOLE);
        let range = chunk.range(exam.runs());
        let right = rows.headings.iter().position(|h| h.name == "right");
        let progress = Progress::new(range.end - range.start, (right, "not right"));
        let end = exam.chunk(chunk, &progress, &told);
        progress.finish();
        match end {
            Err(Stopped::Interrupted) => return Ok(Vec::new()),
            end => end?,
        }
        if args.chunk.is_some() {
            return Ok(Vec::new());
        }
    }
    rows.merge(Some(exam.runs()))?;
    if !args.merge {
        rows.remove_parts()?;
    }
    exam.answered().iter().map(|folder| graded(folder)).collect()
}

fn print(score: &Score, judged: &[Judged]) -> miette::Result<()> {
    let mut table = Table::new(
        &["Not right", "hidden", "verdict", "named {or one of}", "grade", "probability", "after/floor"],
        &[1, 2, 3, 4],
    );
    let wrong: Vec<&Judged> = judged.iter().filter(|j| j.grade != Grade::Right).collect();
    for j in &wrong {
        let [verdict, named, probability, ratio] = j.answered();
        let hidden = j.hidden() + if j.truth.limited { " (limited)" } else { "" };
        table.row([j.name.clone(), hidden, verdict, named, j.grade.to_string(), probability, ratio]);
    }
    if !wrong.is_empty() {
        say(format!("{table}\n"))?;
    }
    let mut table = Table::new(&["Exam", "count = share (95 % interval)"], &[1]);
    for (what, rate) in score.rates() {
        table.row([what, rate.to_string()]);
    }
    say(table)?;
    if let Some([median, most]) = score.time() {
        say(format!("\n  {} campaigns, {median:.1} s per diagnosis (median; at most {most:.1} s)", judged.len()))?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_comes_back_in_order_and_the_first_error_ends_it() {
        let items: Vec<u64> = (0..50).collect();
        assert_eq!(each("test", &items, |k| Ok(2 * k)).unwrap(), (0..50).map(|k| 2 * k).collect::<Vec<_>>());
        assert!(each("test", &items, |k| if *k == 7 { Err(miette!("seven")) } else { Ok(()) }).is_err());
    }
}

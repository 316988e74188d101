//! `deltatwin exam`.

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, miette};
use rayon::prelude::*;

use crate::terminal::{
    DONE, INTERRUPTED, Table, bar, catch_interrupt, complain, interrupted, origin_of, path, paths, say, warn,
    write_figure,
};
use deltatwin::machine::Mechanism;
use deltatwin::model::Model;
use deltatwin::recording::Recording;
use deltatwin_analysis::page::end;
use deltatwin_io::{model, recording};
use deltatwin_study::campaign::{BUILD, Campaign as Rows, CampaignError as Stopped, Chunk, Digest, Row};
use deltatwin_validation::exam::campaign::{Campaign, CampaignError, Case, campaign, hideable, quiet_campaign};
use deltatwin_validation::exam::motion::MotionKind;
use deltatwin_validation::exam::noise::Noise;
use deltatwin_validation::exam::plan::{NOTHING, Plan, seed};
use deltatwin_validation::exam::score::{Judged, Score};
use deltatwin_validation::exam::size::Size;
use deltatwin_validation::exam::{self, Grade, experiment, figures, folder, judge};

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

/// Number of robots whose recordings the fast campaigns share.
const FAST_ROBOTS: u64 = 4;
/// Shortest and longest duration of a recording, s.
const DURATION: (f64, f64) = (1.0, 600.0);

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = model::read(&args.model)?;
    if !model.assembled || !matches!(model.mechanism, Mechanism::Delta { .. }) {
        return Err(miette!("{}: expected the model of an assembled delta robot", args.model.display()));
    }
    let plan = plan(args, &model)?;
    catch_interrupt()?;
    let root = args.judge.as_ref().unwrap_or(&args.output);
    let (mut folders, mut judged) = (Vec::new(), Vec::new());
    if args.judge.is_some() {
        judged = answers(args, &folder::campaigns(root).into_diagnostic()?, &model)?;
    } else if args.no_answers {
        folders = make(args, &plan.cases(), &model)?;
    } else {
        judged = conducted(args, &plan, &model)?;
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

/// Plan of the exam with the given arguments.
fn plan(args: &Args, model: &Model) -> miette::Result<Plan> {
    if !(DURATION.0..=DURATION.1).contains(&args.duration) {
        return Err(miette!(
            "--duration is {}; expected a number from {} to {} s",
            args.duration,
            DURATION.0,
            DURATION.1
        ));
    }
    let known: Vec<&str> = hideable(model).iter().map(|e| e.name()).collect();
    let effects = match &args.effects {
        Some(names) => names.iter().filter(|n| *n != "none").cloned().collect(),
        None => known.iter().map(|n| n.to_string()).collect::<Vec<String>>(),
    };
    if let Some(name) = effects.iter().find(|n| !known.contains(&n.as_str())) {
        return Err(miette!("--effects: cannot hide `{name}`; expected `none` or some of {}", known.join(", ")));
    }
    Ok(Plan {
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
    })
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

/// Makes the missing campaigns and returns their folders. A robot that cannot move with its hidden effects is
/// omitted.
fn make(args: &Args, cases: &[(String, Case)], model: &Model) -> miette::Result<Vec<PathBuf>> {
    let folders = each("make", cases, |case| made(args, case, model))?;
    Ok(folders.into_iter().flatten().collect())
}

/// Makes a campaign if it is missing and returns its folder; `None` if the robot cannot be simulated.
fn made(args: &Args, (name, case): &(String, Case), model: &Model) -> miette::Result<Option<PathBuf>> {
    let folder = args.output.join(name);
    if folder.join(folder::TRUTH).is_file() {
        return Ok(Some(folder));
    }
    match campaign(model, case, &|_, _| {}) {
        Ok(campaign) => folder::write(&folder, &campaign).into_diagnostic()?,
        Err(CampaignError::Simulation(e)) => {
            warn(&[format!("{name}: left out, the robot cannot be simulated: {e}")]);
            return Ok(None);
        }
        Err(e) => return Err(miette!("{name}: {e}")),
    }
    Ok(Some(folder))
}

/// Makes and judges all campaigns of a plan on the engine of the studies, and writes their table; what has an answer in
/// its folder is taken from there.
fn conducted(args: &Args, plan: &Plan, model: &Model) -> miette::Result<Vec<Judged>> {
    let cases = plan.cases();
    let robots = if args.merge { Vec::new() } else { robots(args, plan, model)? };
    let runs = cases.len() as u64 + args.fast_null;
    let one = |run: u64| -> miette::Result<(String, Option<Judged>)> {
        match cases.get(run as usize) {
            Some(case) => {
                let folder = made(args, case, model)?;
                let judged = folder.map(|folder| answer(args, &folder, model)).transpose()?.flatten();
                Ok((case.0.clone(), judged))
            }
            None => fast(args, (run - cases.len() as u64, &robots), model).map(|j| (j.name.clone(), Some(j))),
        }
    };
    // The folders hold what was done: rows of an earlier plan are made of them again.
    let source = model.source.as_deref().unwrap_or_default();
    let planned = format!("{plan:?} {}", args.fast_null);
    let digest = Digest::of([("exam", planned.as_bytes()), ("model", source.as_bytes())]);
    let table = Rows {
        folder: args.output.clone(),
        digest,
        build: BUILD.into(),
        headings: experiment::exam_headings(),
        metadata: vec![("exam".into(), planned)],
    };
    if args.chunk.is_none() && !args.merge {
        table.clear()?;
    }
    if !args.merge {
        let chunk = args.chunk.unwrap_or(Chunk::WHOLE);
        let range = chunk.range(runs);
        let right = table.headings.iter().position(|h| h.name == "right");
        let progress = Progress::new(range.end - range.start, (right, "not right"));
        let row = |run: u64| -> Row {
            let (name, judged) = one(run)?;
            Ok(experiment::exam_row(run, &name, judged.as_ref()))
        };
        let end = table.chunk(chunk, runs, &row, &progress);
        progress.finish();
        match end {
            Err(Stopped::Interrupted) => return Ok(Vec::new()),
            end => end?,
        }
        if args.chunk.is_some() {
            return Ok(Vec::new());
        }
    }
    table.merge(Some(runs))?;
    if args.chunk.is_none() && !args.merge {
        table.remove_parts()?;
    }
    let names = cases.iter().map(|(name, _)| name.clone()).chain((0..args.fast_null).map(|k| fast_name(args, k)));
    let folders = names.map(|name| args.output.join(name)).filter(|folder| folder.join(folder::ANSWER).is_file());
    folders.map(|folder| graded(&folder)).collect()
}

/// The grade of the answer in a folder.
fn graded(folder: &Path) -> miette::Result<Judged> {
    let name = folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned();
    let truth = folder::read_truth(folder).into_diagnostic()?;
    let answer = folder::read_answer(folder).into_diagnostic()?;
    Ok(Judged::new(name, truth, answer.unwrap_or_default()))
}

/// Graded campaigns; those without an answer are diagnosed first.
fn answers(args: &Args, folders: &[PathBuf], model: &Model) -> miette::Result<Vec<Judged>> {
    each("judge", folders, |folder| answer(args, folder, model)).map(|judged| judged.into_iter().flatten().collect())
}

/// The grade of a campaign, which is diagnosed if it has no answer; `None` without recordings.
fn answer(args: &Args, folder: &Path, model: &Model) -> miette::Result<Option<Judged>> {
    let truth = folder::read_truth(folder).into_diagnostic()?;
    let name = folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned();
    if !args.force
        && let Some(answer) = folder::read_answer(folder).into_diagnostic()?
    {
        return Ok(Some(Judged::new(name, truth, answer)));
    }
    let Some(recordings) = recordings(folder, model)? else {
        warn(&[format!("{name}: left out, without recordings it cannot be judged")]);
        return Ok(None);
    };
    let answer = judge::judge(model, &recordings);
    folder::write_answer(folder, &answer).into_diagnostic()?;
    Ok(Some(Judged::new(name, truth, answer)))
}

/// Both recordings of a campaign; `None` if they were not kept.
fn recordings(folder: &Path, model: &Model) -> miette::Result<Option<[Recording; 2]>> {
    let file = |stem: &str| {
        let files = ["csv", "mcap"].map(|extension| folder.join(format!("{stem}.{extension}")));
        files.into_iter().find(|f| f.is_file())
    };
    let (Some(first), Some(second)) = (file(folder::MEASUREMENT), file(folder::VALIDATION)) else { return Ok(None) };
    let read = |file: &Path| recording::read_of(file, None, model.mechanism).map(|(recording, _)| recording);
    Ok(Some([read(&first)?, read(&second)?]))
}

/// The robots whose recordings the fast campaigns share.
fn robots(args: &Args, plan: &Plan, model: &Model) -> miette::Result<Vec<Campaign>> {
    each("make", &(0..FAST_ROBOTS.min(args.fast_null)).collect::<Vec<_>>(), |k| {
        let robot = Plan {
            effects: Vec::new(),
            null: 1,
            outside: 0,
            seed: seed(args.seed, &format!("robot {k}")),
            ..plan.clone()
        };
        let (name, case) = robot.cases().remove(0);
        quiet_campaign(model, &case, &[], &|_, _| {}).map_err(|e| miette!("{name}: {e}"))
    })
}

/// Name of a fast campaign.
fn fast_name(args: &Args, k: u64) -> String {
    format!("{NOTHING}-fast-{}-{}", args.noise[k as usize % args.noise.len()], k + 1)
}

/// A graded campaign without hidden effects that differs from others in its noise; truth and answer are written,
/// recordings are not.
fn fast(args: &Args, (k, robots): (u64, &[Campaign]), model: &Model) -> miette::Result<Judged> {
    let noise = args.noise[k as usize % args.noise.len()];
    let name = fast_name(args, k);
    let folder = args.output.join(&name);
    let there = !args.force && folder.join(folder::TRUTH).is_file();
    if there && let Some(answer) = folder::read_answer(&folder).into_diagnostic()? {
        return Ok(Judged::new(name, folder::read_truth(&folder).into_diagnostic()?, answer));
    }
    // All combinations of noise kinds and robots occur.
    let robot = &robots[(k as usize / args.noise.len()) % robots.len()];
    let case = Case { seed: seed(args.seed, &name), noise, ..robot.case.clone() };
    let answer = judge::judge(model, &robot.noisy(&case));
    folder::write_truth(&folder, &folder::truth(robot, &case)).into_diagnostic()?;
    folder::write_answer(&folder, &answer).into_diagnostic()?;
    Ok(Judged::new(name, folder::read_truth(&folder).into_diagnostic()?, answer))
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

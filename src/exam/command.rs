//! `deltatwin exam`.

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, miette};
use rayon::prelude::*;

use super::campaign::{Case, campaign, hideable};
use super::folder::{self, Truth};
use super::judge::{Answer, Grade, judge};
use super::motion::MotionKind;
use super::noise::Noise;
use super::size::Size;
use crate::model::{Mechanism, Model};
use crate::recording::Recording;
use crate::terminal::{DONE, INTERRUPTED, Table, bar, catch_interrupt, interrupted, say, significant};

/// Examine the diagnosis: hide effects in a robot, judge what is said about it, count.
///
/// Every campaign is a folder in DIR with its recordings, the truth and the answer; what is there already is kept, so that
/// an interrupted exam goes on. With --judge, the campaigns that stand in a folder are judged and none is made.
#[derive(clap::Args, Clone, Debug)]
#[command(
    after_help = "Example: deltatwin exam models/irb360-6-1600.toml --effects ball_socket_coulomb,torque_bias --seeds 3"
)]
pub struct Args {
    /// Model file.
    pub model: PathBuf,
    /// Folder for the campaigns.
    #[arg(short, long, default_value = "recordings/exam", value_name = "DIR")]
    pub output: PathBuf,
    /// Judge the campaigns in this folder, made by whatever software.
    #[arg(long, value_name = "DIR")]
    pub judge: Option<PathBuf>,
    /// Judge anew what has an answer already.
    #[arg(long)]
    pub anew: bool,
    /// Effects to hide, one at a time; all that the model lacks without it.
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    pub effects: Option<Vec<String>>,
    /// Sizes of the hidden effects.
    #[arg(long, value_delimiter = ',', value_enum, default_value = "medium")]
    pub sizes: Vec<Size>,
    /// Campaigns per effect and size.
    #[arg(long, default_value_t = 1)]
    pub seeds: u64,
    /// Campaigns with two effects.
    #[arg(long, default_value_t = 0)]
    pub pairs: u64,
    /// Campaigns in which nothing is hidden.
    #[arg(long, default_value_t = 1)]
    pub null: u64,
    /// Kinds of noise, in turn.
    #[arg(long, value_delimiter = ',', value_enum, default_value = "white")]
    pub noise: Vec<Noise>,
    /// What the robot does.
    #[arg(long, value_enum, default_value_t)]
    pub motion: MotionKind,
    /// No force sensor in strut 1.
    #[arg(long)]
    pub no_strut: bool,
    /// No payload.
    #[arg(long)]
    pub no_payload: bool,
    /// Length of each recording, s.
    #[arg(long, default_value_t = 20.0, value_name = "SECONDS")]
    pub duration: f64,
    /// Draws everything.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Only make the campaigns.
    #[arg(long, conflicts_with = "judge")]
    pub no_answers: bool,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// A judged campaign.
struct Judged {
    name: String,
    truth: Truth,
    answer: Answer,
}

/// Runs the command.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = Model::read(&args.model)?;
    if !model.assembled || !matches!(model.mechanism, Mechanism::Delta { .. }) {
        return Err(miette!("{}: expected the model of an assembled delta robot", args.model.display()));
    }
    catch_interrupt()?;
    let folders = match &args.judge {
        Some(root) => folder::campaigns(root).into_diagnostic()?,
        None => make(args, &model)?,
    };
    if folders.is_empty() {
        let root = args.judge.as_ref().unwrap_or(&args.output);
        return Err(miette!("{}: holds no campaign; expected folders with {}", root.display(), folder::TRUTH));
    }
    if args.no_answers || interrupted() {
        return Ok(if interrupted() { INTERRUPTED } else { DONE });
    }
    let progress = bar("judge", folders.len() as u64);
    let judged: Vec<Option<Judged>> = folders
        .par_iter()
        .map(|f| {
            let judged = if interrupted() { None } else { Some(judged(f, &model, args.anew)?) };
            progress.inc(1);
            Ok(judged)
        })
        .collect::<miette::Result<_>>()?;
    progress.finish_and_clear();
    let judged: Vec<Judged> = judged.into_iter().flatten().collect();
    print(&judged)?;
    Ok(if interrupted() { INTERRUPTED } else { DONE })
}

/// The cases that the arguments ask for, with the names of their folders.
fn cases(args: &Args, model: &Model) -> Vec<(String, Case)> {
    let names: Vec<String> = match &args.effects {
        Some(names) => names.clone(),
        None => hideable(model).iter().map(|e| e.name().to_string()).collect(),
    };
    let mut out = Vec::new();
    let mut add = |label: &str, effects: Vec<String>, size: Size, k: u64| {
        let noise = args.noise[out.len() % args.noise.len()];
        let mut name = format!("{label}-{noise}");
        for (unusual, word) in [
            (args.motion != MotionKind::Fourier, args.motion.name()),
            (args.no_strut, "torques"),
            (args.no_payload, "empty"),
        ] {
            if unusual {
                name += &format!("-{word}");
            }
        }
        name += &format!("-{k}");
        let case = Case {
            seed: seed(args.seed, &name),
            effects,
            size,
            noise,
            motion: args.motion,
            strut_sensor: !args.no_strut,
            payload: !args.no_payload,
            duration: args.duration,
        };
        out.push((name, case));
    };
    for k in 1..=args.null {
        add("nothing", Vec::new(), Size::Medium, k);
    }
    for size in &args.sizes {
        for name in names.iter().filter(|n| *n != "none") {
            for k in 1..=args.seeds {
                add(&format!("{name}-{size}"), vec![name.clone()], *size, k);
            }
        }
    }
    for k in 1..=args.pairs {
        // Every effect takes its turn, with ever another partner.
        let n = names.len() as u64;
        let (i, step) = ((k - 1) % n.max(1), 1 + (seed(args.seed, &format!("pair {k}")) % n.saturating_sub(1).max(1)));
        let pair = vec![names[i as usize].clone(), names[((i + step) % n.max(1)) as usize].clone()];
        if pair[0] != pair[1] {
            add(&format!("{}+{}", pair[0], pair[1]), pair, Size::Medium, k);
        }
    }
    out
}

/// Seed of a campaign from that of the exam and its name (FNV-1a).
fn seed(exam: u64, name: &str) -> u64 {
    let bytes = exam.to_le_bytes().into_iter().chain(name.bytes());
    bytes.fold(0xcbf2_9ce4_8422_2325, |h, b| (h ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3))
}

/// Makes the campaigns that are not there yet.
fn make(args: &Args, model: &Model) -> miette::Result<Vec<PathBuf>> {
    let cases = cases(args, model);
    if !(0.5..=600.0).contains(&args.duration) {
        return Err(miette!("--duration is {}; expected a number from 0.5 to 600 s", args.duration));
    }
    let progress = bar("make", cases.len() as u64);
    let made: Vec<Option<PathBuf>> = cases
        .par_iter()
        .map(|(name, case)| {
            let folder = args.output.join(name);
            if interrupted() {
                return Ok(None);
            }
            if !folder.join(folder::TRUTH).is_file() {
                let campaign = campaign(model, case, &|_, _| {}).map_err(|e| miette!("{name}: {e}"))?;
                folder::write(&folder, &campaign).into_diagnostic()?;
            }
            progress.inc(1);
            Ok(Some(folder))
        })
        .collect::<miette::Result<_>>()?;
    progress.finish_and_clear();
    Ok(made.into_iter().flatten().collect())
}

/// Judges one campaign, unless its answer is there.
fn judged(folder: &Path, model: &Model, anew: bool) -> miette::Result<Judged> {
    let truth = folder::read_truth(folder).into_diagnostic()?;
    let name = folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned();
    if !anew && let Some(answer) = folder::read_answer(folder).into_diagnostic()? {
        return Ok(Judged { name, truth, answer });
    }
    let read = |stem: &str| {
        let files = [folder.join(format!("{stem}.csv")), folder.join(format!("{stem}.mcap"))];
        let file = files.iter().find(|f| f.is_file()).unwrap_or(&files[0]);
        Recording::read_of(file, None, model.mechanism).map(|(recording, _)| recording)
    };
    let answer = judge(model, &read(folder::MEASUREMENT)?, &read(folder::VALIDATION)?);
    folder::write_answer(folder, &answer).into_diagnostic()?;
    Ok(Judged { name, truth, answer })
}

fn print(judged: &[Judged]) -> miette::Result<()> {
    let mut table = Table::new(
        &["Campaign", "hidden", "verdict", "named", "grade", "probability", "after/floor", "s"],
        &[1, 2, 3, 4],
    );
    for j in judged {
        let a = &j.answer;
        let mut named: Vec<String> = a.effects.iter().map(|e| e.name.clone()).collect();
        named.extend(a.indistinguishable.iter().map(|set| format!("{{{}}}", set.join(", "))));
        table.row([
            j.name.clone(),
            j.truth.effects.join(", ") + if j.truth.limited { " (limited)" } else { "" },
            a.failure.clone().unwrap_or_else(|| a.verdict.clone()),
            named.join(", "),
            format!("{:?}", Grade::of(&j.truth, a)),
            a.effects.first().map_or_else(String::new, |e| format!("{:.2}", e.probability)),
            a.held_out_ratio().map_or_else(String::new, |r| significant(r, 4)),
            format!("{:.1}", a.seconds),
        ]);
    }
    say(table)
}

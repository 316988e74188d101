//! An exam in a folder, on the engine of the studies: its campaigns are made, judged and written as rows of a table.
//!
//! A row is a function of the model, the plan and its number, so that chunks may be computed anywhere. Every campaign has a
//! folder of its own with truth and answer; what has an answer there is not judged again.

use std::path::{Path, PathBuf};

use deltatwin::machine::Mechanism;
use deltatwin::model::Model;
use deltatwin::recording::Recording;
use deltatwin_io::recording;
use deltatwin_study::campaign::{BUILD, Campaign as Rows, CampaignError as RowsError, Chunk, Digest, Row, Watch};
use miette::{IntoDiagnostic, miette};
use rayon::prelude::*;

use super::campaign::{Campaign, CampaignError, Case, campaign, hideable, quiet_campaign};
use super::experiment;
use super::folder;
use super::judge;
use super::plan::{NOTHING, Plan, seed};
use super::score::Judged;

/// An exam with its folder.
pub struct Exam {
    /// Model that is examined.
    pub model: Model,
    /// What is drawn.
    pub plan: Plan,
    /// Number of further campaigns without a hidden effect, which share the recordings of few robots.
    pub fast_null: u64,
    /// Whether campaigns that have an answer are judged again.
    anew: bool,
    /// The rows on the disk.
    pub rows: Rows,
    cases: Vec<(String, Case)>,
}

/// Who is told that a campaign was left out.
pub type Tell<'a> = &'a (dyn Fn(String) + Sync);

/// Number of robots whose recordings the fast campaigns share.
const FAST_ROBOTS: u64 = 4;
/// Shortest and longest duration of a recording, s.
const DURATION: (f64, f64) = (1.0, 600.0);

impl Exam {
    /// The exam of `model` with its rows and campaigns in `folder`.
    ///
    /// # Errors
    /// If the model is none of an assembled delta robot, or the plan names what cannot be hidden or a duration outside its
    /// range.
    pub fn new(model: Model, plan: Plan, fast_null: u64, folder: &Path) -> miette::Result<Self> {
        if !model.assembled || !matches!(model.mechanism, Mechanism::Delta { .. }) {
            let file = model.path.as_ref().map_or_else(|| model.name.clone(), |path| path.display().to_string());
            return Err(miette!("{file}: expected the model of an assembled delta robot"));
        }
        let (shortest, longest) = DURATION;
        if !(shortest..=longest).contains(&plan.duration) {
            let given = plan.duration;
            return Err(miette!("duration is {given}; expected a number from {shortest} to {longest} s"));
        }
        let known: Vec<&str> = hideable(&model).iter().map(|e| e.name()).collect();
        if let Some(name) = plan.effects.iter().find(|n| !known.contains(&n.as_str())) {
            return Err(miette!("effects: cannot hide `{name}`; expected `none` or some of {}", known.join(", ")));
        }
        if plan.noise.is_empty() {
            return Err(miette!("noise: no kind is given; expected at least one"));
        }
        let planned = format!("{plan:?} {fast_null}");
        let source = model.source.as_deref().unwrap_or_default();
        let rows = Rows {
            name: "exam".into(),
            folder: folder.into(),
            digest: Digest::of([("exam", planned.as_bytes()), ("model", source.as_bytes())]),
            build: BUILD.into(),
            headings: experiment::exam_headings(),
            metadata: vec![("exam".into(), planned)],
        };
        Ok(Self { cases: plan.cases(), model, plan, fast_null, anew: false, rows })
    }

    /// The exam in which campaigns that have an answer are judged again if `anew`.
    #[must_use]
    pub fn judging(self, anew: bool) -> Self {
        Self { anew, ..self }
    }

    /// Number of campaigns.
    pub fn runs(&self) -> u64 {
        self.cases.len() as u64 + self.fast_null
    }

    /// Campaigns with the names of their folders, without the fast ones.
    pub fn cases(&self) -> &[(String, Case)] {
        &self.cases
    }

    /// Folders of all campaigns that have an answer, in the order of the rows.
    pub fn answered(&self) -> Vec<PathBuf> {
        let names =
            self.cases.iter().map(|(name, _)| name.clone()).chain((0..self.fast_null).map(|k| self.fast_name(k)));
        let folders = names.map(|name| self.rows.folder.join(name));
        folders.filter(|folder| folder.join(folder::ANSWER).is_file()).collect()
    }

    /// Makes and judges the campaigns of a chunk that are not there.
    ///
    /// # Errors
    /// If a campaign cannot be made, the rows cannot be kept, or the watch asks to stop.
    pub fn chunk(&self, chunk: Chunk, watch: &dyn Watch, tell: Tell) -> Result<(), RowsError> {
        self.rows.claim()?;
        let range = chunk.range(self.runs());
        let first_fast = self.cases.len() as u64;
        let robots = self.robots(range.start.max(first_fast)..range.end).map_err(|reason| {
            let run = range.start.max(first_fast);
            RowsError::Run { run, reason: reason.into() }
        })?;
        let row = |run: u64| -> Row {
            let (name, judged) = match self.cases.get(run as usize) {
                Some(case) => (case.0.clone(), self.conducted(case, tell)?),
                None => {
                    let judged = self.fast(run - first_fast, &robots)?;
                    (judged.name.clone(), Some(judged))
                }
            };
            Ok(experiment::exam_row(run, &name, judged.as_ref()))
        };
        self.rows.chunk(chunk, self.runs(), &row, watch)
    }

    /// The graded campaign, which is made if it is missing; `None` if the robot cannot be simulated.
    fn conducted(&self, case: &(String, Case), tell: Tell) -> miette::Result<Option<Judged>> {
        let folder = self.made(case, tell)?;
        Ok(folder.map(|folder| answer(&folder, &self.model, self.anew, tell)).transpose()?.flatten())
    }

    /// Folder of a campaign, which is made if it is missing; `None` if the robot cannot be simulated.
    ///
    /// # Errors
    /// If the effect cannot be sized, or a file cannot be written.
    pub fn made(&self, (name, case): &(String, Case), tell: Tell) -> miette::Result<Option<PathBuf>> {
        let folder = self.rows.folder.join(name);
        if folder.join(folder::TRUTH).is_file() {
            return Ok(Some(folder));
        }
        match campaign(&self.model, case, &|_, _| {}) {
            Ok(campaign) => folder::write(&folder, &campaign).into_diagnostic()?,
            Err(CampaignError::Simulation(e)) => {
                tell(format!("{name}: left out, the robot cannot be simulated: {e}"));
                return Ok(None);
            }
            Err(e) => return Err(miette!("{name}: {e}")),
        }
        Ok(Some(folder))
    }

    /// The robots whose recordings the fast campaigns share; none if `runs`, the fast ones to be made, is empty.
    fn robots(&self, runs: std::ops::Range<u64>) -> miette::Result<Vec<Campaign>> {
        let count = if runs.is_empty() { 0 } else { FAST_ROBOTS.min(self.fast_null) };
        let one = |k: u64| {
            let robot = Plan {
                effects: Vec::new(),
                null: 1,
                outside: 0,
                seed: seed(self.plan.seed, &format!("robot {k}")),
                ..self.plan.clone()
            };
            let (name, case) = robot.cases().remove(0);
            quiet_campaign(&self.model, &case, &[], &|_, _| {}).map_err(|e| miette!("{name}: {e}"))
        };
        (0..count).into_par_iter().map(one).collect()
    }

    /// Name of a fast campaign.
    fn fast_name(&self, k: u64) -> String {
        let noise = &self.plan.noise;
        format!("{NOTHING}-fast-{}-{}", noise[k as usize % noise.len()], k + 1)
    }

    /// A graded campaign without hidden effects that differs from others in its noise; truth and answer are written,
    /// recordings are not.
    fn fast(&self, k: u64, robots: &[Campaign]) -> miette::Result<Judged> {
        let kinds = &self.plan.noise;
        let noise = kinds[k as usize % kinds.len()];
        let name = self.fast_name(k);
        let folder = self.rows.folder.join(&name);
        let there = !self.anew && folder.join(folder::TRUTH).is_file();
        if there && let Some(answer) = folder::read_answer(&folder).into_diagnostic()? {
            return Ok(Judged::new(name, folder::read_truth(&folder).into_diagnostic()?, answer));
        }
        // All combinations of noise kinds and robots occur.
        let robot = &robots[(k as usize / kinds.len()) % robots.len()];
        let case = Case { seed: seed(self.plan.seed, &name), noise, ..robot.case.clone() };
        let answer = judge::judge(&self.model, &robot.noisy(&case));
        folder::write_truth(&folder, &folder::truth(robot, &case)).into_diagnostic()?;
        folder::write_answer(&folder, &answer).into_diagnostic()?;
        Ok(Judged::new(name, folder::read_truth(&folder).into_diagnostic()?, answer))
    }
}

/// The grade of the answer in a folder.
///
/// # Errors
/// If truth or answer cannot be read.
pub fn graded(folder: &Path) -> miette::Result<Judged> {
    let truth = folder::read_truth(folder).into_diagnostic()?;
    let answer = folder::read_answer(folder).into_diagnostic()?;
    Ok(Judged::new(name_of(folder), truth, answer.unwrap_or_default()))
}

/// The grade of a campaign, which is diagnosed if it has no answer or if `anew`; `None` without recordings.
///
/// # Errors
/// If a file of the campaign cannot be read or the answer cannot be written.
pub fn answer(folder: &Path, model: &Model, anew: bool, tell: Tell) -> miette::Result<Option<Judged>> {
    let truth = folder::read_truth(folder).into_diagnostic()?;
    let name = name_of(folder);
    if !anew && let Some(answer) = folder::read_answer(folder).into_diagnostic()? {
        return Ok(Some(Judged::new(name, truth, answer)));
    }
    let Some(recordings) = recordings(folder, model)? else {
        tell(format!("{name}: left out, without recordings it cannot be judged"));
        return Ok(None);
    };
    let answer = judge::judge(model, &recordings);
    folder::write_answer(folder, &answer).into_diagnostic()?;
    Ok(Some(Judged::new(name, truth, answer)))
}

/// Name of a campaign from its folder.
fn name_of(folder: &Path) -> String {
    folder.file_name().unwrap_or(folder.as_os_str()).to_string_lossy().into_owned()
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

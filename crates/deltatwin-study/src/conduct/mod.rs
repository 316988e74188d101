//! A study from its file to its table: every row is a run of the twin, or the point of a ray at which it fails.

mod record;
mod rows;
mod summary;

pub use rows::{Columns, cell, heading};
pub use summary::{Diagnosed, Summary};

use std::path::Path;

use deltatwin_io::Problem;
use deltatwin_io::study::{Design, Keep as Kept, Setting, Study};
use miette::Diagnostic;
use thiserror::Error;

use crate::campaign::parquet::Reader;
use crate::campaign::{BUILD, Campaign, CampaignError, Chunk, Digest, Draws, Heading, Held, Row, Steps, Value, Watch};
use crate::design::{Plan, Point, evolution, nominal, normal_share, root};
use crate::run::{AFTER_LANDING, Case, CauseKind, Keep, Naming, Outcome, RunError, Verdict, run};
use crate::statistics::{Subset, SubsetError, SubsetOptions, subset};

/// A study with its folder.
pub struct Conduct {
    /// The study.
    pub study: Study,
    /// Its points.
    pub plan: Plan,
    /// Its rows on the disk.
    pub campaign: Campaign,
    /// Its columns.
    pub columns: Columns,
    draws: Draws,
}

/// Why a study cannot be conducted.
#[derive(Debug, Error, Diagnostic)]
pub enum ConductError {
    /// A factor does not fit the scenario or a model.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Factor(#[from] Problem),
    /// The rows cannot be made or kept.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Campaign(#[from] CampaignError),
    /// A run has no verdict.
    #[error("run {run}: {reason}")]
    Run {
        /// The run.
        run: u64,
        /// Why.
        reason: String,
    },
    /// A run is not of the study.
    #[error("the study has no run {run}; expected a number from 0 to {}", .of.saturating_sub(1))]
    Beyond {
        /// The run.
        run: u64,
        /// Number of runs.
        of: u64,
    },
    /// A search is one chunk.
    #[error("a study with kind = \"{design}\" cannot be cut into chunks: every run depends on those before it")]
    Chunks {
        /// Kind of the design.
        design: &'static str,
    },
    /// The subset simulation failed.
    #[error("the subset simulation has no result: {0}")]
    Subset(String),
}

/// Version of the meaning of rows; another one is another study.
const FORMAT: &str = "1";

impl Conduct {
    /// The study with its rows in `folder`, after a check that its factors fit the scenario at both ends of their ranges.
    ///
    /// # Errors
    /// If a factor does not fit.
    pub fn new(study: Study, folder: &Path) -> Result<Self, ConductError> {
        let columns = Columns::of(&study)?;
        let (campaign, draws) = campaign(&study, columns.headings.clone(), folder);
        let conduct = Self { campaign, plan: Plan::new(&study, draws.clone()), columns, draws, study };
        conduct.check()?;
        Ok(conduct)
    }

    /// Whether the scenario and the models admit every factor at both ends of its range, and all at their middles.
    fn check(&self) -> Result<(), ConductError> {
        let factors = &self.study.factors;
        let middle: Vec<Setting> = factors.iter().map(nominal).collect();
        for (k, settings) in self.plan.extremes() {
            // What a factor needs, another one may bring.
            let with_others = || {
                let mut settings_of_all = middle.clone();
                settings_of_all[k] = settings[k];
                self.study.files(&settings_of_all, None)
            };
            self.study.files(&settings, None).or_else(|why| with_others().map_err(|_| why)).map_err(|why| {
                let value = self.columns.text(&factors[k], settings[k]);
                self.study.refuse(k, format!("factor `{}` at {value}: {why}", factors[k].name))
            })?;
        }
        let all = |why| self.study.refuse(0, format!("all factors at their middles: {why}"));
        let files = self.study.files(&middle, None).map_err(all)?;
        if self.study.diagnose && files.controller_model.is_none() {
            let why = "`diagnose` compares the runs with the controller's model, and the scenario names none; expected \
                       `controller_model` in it";
            return Err(self.study.refuse(0, why.into()).into());
        }
        Ok(())
    }

    /// Number of rows; of a search the largest.
    pub fn runs(&self) -> u64 {
        self.plan.runs()
    }

    /// Whether each run depends on those before, so that the number of rows is not known beforehand.
    pub fn is_search(&self) -> bool {
        self.plan.is_search()
    }

    /// Makes the rows of a chunk that are not there.
    ///
    /// # Errors
    /// If the rows cannot be made or kept, the watch asks to stop, or the study is a search and the chunk not the whole.
    pub fn chunk(&self, chunk: Chunk, watch: &dyn Watch) -> Result<(), ConductError> {
        if !self.plan.is_search() {
            return Ok(self.campaign.chunk(chunk, self.runs(), &|run| self.row(run), watch)?);
        }
        if chunk != Chunk::WHOLE {
            return Err(ConductError::Chunks { design: self.study.design.name() });
        }
        match (&self.study.design, self.subset_options()) {
            (Design::WorstCase { runs }, _) => self.campaign.sequence(watch, |steps| self.worst_case(steps, *runs)),
            (_, Some(options)) => self.campaign.sequence(watch, |steps| self.subset(steps, options).map(|_| ())),
            _ => Ok(()),
        }
    }

    /// Options of the subset simulation; `None` for another design.
    fn subset_options(&self) -> Option<SubsetOptions> {
        let Design::Subset { samples, share, levels } = self.study.design else { return None };
        Some(SubsetOptions {
            samples: samples as usize,
            share,
            levels: levels as usize,
            seed: self.draws.seed(0),
            ..SubsetOptions::default()
        })
    }

    /// The result of a subset simulation from the margins in the table; `None` for another design.
    ///
    /// # Errors
    /// If the table cannot be read or is not that of the simulation.
    pub fn subset_result(&self) -> Result<Option<Subset>, ConductError> {
        let Some(options) = self.subset_options() else { return Ok(None) };
        let name = self.columns.headings[self.columns.margin].name.as_str();
        let margins: Vec<f64> =
            self.picked(&[name])?.rows.iter().map(|row| row[0].number().unwrap_or(f64::NEG_INFINITY)).collect();
        let mut next = 0;
        let outcome = subset(self.study.factors.len(), options, &mut |points: &[Vec<f64>]| {
            let own = margins.get(next..next + points.len()).map(<[f64]>::to_vec);
            next += points.len();
            own.ok_or("the table ends before the simulation")
        });
        outcome.map(Some).map_err(|e| ConductError::Subset(e.to_string()))
    }

    fn worst_case(&self, steps: &mut Steps, runs: u64) -> Result<(), ConductError> {
        let mut generation = 0;
        let mut rng = self.draws.generator("worst case");
        evolution::minimise(self.study.factors.len(), runs as usize, &mut rng, |points| {
            let of = |u: &[f64]| self.plan.in_cube(u);
            // What cannot be run is no worst case.
            let margins = self.generation(steps, points, (generation, f64::INFINITY), &of)?;
            generation += 1;
            Ok(margins)
        })
    }

    fn subset(&self, steps: &mut Steps, options: SubsetOptions) -> Result<Subset, ConductError> {
        let mut batch = 0;
        let outcome = subset(self.study.factors.len(), options, &mut |points: &[Vec<f64>]| {
            let of = |u: &[f64]| {
                let shares: Vec<f64> = u.iter().map(|z| normal_share(*z)).collect();
                self.plan.in_cube(&shares)
            };
            // What cannot be run at all counts as failed.
            let margins = self.generation(steps, points, (batch, f64::NEG_INFINITY), &of)?;
            batch += 1;
            Ok(margins)
        });
        outcome.map_err(|error| match error {
            SubsetError::Evaluation(own) => own,
            other => ConductError::Subset(other.to_string()),
        })
    }

    /// Margins of points that are run at once; `without` is that of a run without a verdict.
    fn generation(
        &self,
        steps: &mut Steps,
        points: &[Vec<f64>],
        (number, without): (i64, f64),
        settings: &(dyn Fn(&[f64]) -> Vec<Setting> + Sync),
    ) -> Result<Vec<f64>, ConductError> {
        let rows = steps.batch(points.len(), &|run, k| {
            let point = Point { settings: settings(&points[k]), seed: self.plan.seed(run) };
            self.tried(run, &point, vec![Value::Integer(number)])
        })?;
        let margin = self.columns.margin;
        Ok(rows.iter().map(|row| row[margin].number().unwrap_or(without)).collect())
    }

    /// Row of a run of a design that is no search.
    fn row(&self, run: u64) -> Row {
        match self.study.design {
            Design::Boundary { tolerance, .. } => self.boundary(run, tolerance),
            _ => self.tried(run, &self.plan.point(run), Vec::new()),
        }
    }

    /// The run at `point`, and its row with the values of the design's own columns.
    fn tried(&self, run: u64, point: &Point, own: Vec<Value>) -> Row {
        let answer =
            if self.study.diagnose { self.diagnosed(point) } else { self.verdict(point).map(|v| (v, Vec::new())) };
        self.keep(run, point, answer.as_ref().ok().map(|(verdict, _)| verdict))?;
        let answer = answer.map(|(verdict, naming)| [verdict.row(), naming].concat());
        Ok(self.columns.row(&self.study, (run, point), own, answer))
    }

    /// Verdict of the run at `point`, and what the diagnosis says of its recording.
    fn diagnosed(&self, point: &Point) -> Result<(Verdict, Vec<Value>), String> {
        let case = self.case(point)?;
        let outcome = run(&case, Keep::Recording).map_err(|e| e.to_string())?;
        let naming = Naming::of(&case, &outcome)?;
        Ok((outcome.verdict, naming.row()))
    }

    fn verdict(&self, point: &Point) -> Result<Verdict, String> {
        let case = self.case(point)?;
        run(&case, Keep::Nothing).map(|outcome| outcome.verdict).map_err(|e| e.to_string())
    }

    /// The case at a point.
    ///
    /// # Errors
    /// What the scenario or a model does not admit.
    pub fn case(&self, point: &Point) -> Result<Case, String> {
        let files = self.study.files(&point.settings, point.seed)?;
        Ok(Case {
            model: files.model,
            controller_model: files.controller_model,
            scenario: files.scenario,
            base: files.folder,
            after_landing: self.study.after_landing.unwrap_or(AFTER_LANDING),
            nominal: files.nominal,
        })
    }

    /// The point of a ray at which the margin is zero: the row is that of the failing run next to it.
    fn boundary(&self, run: u64, tolerance: f64) -> Row {
        let at = |share: f64| Point { settings: self.plan.on_ray(run, share), seed: self.plan.seed(run) };
        let crossing = root::crossing(tolerance, |share| self.verdict(&at(share)).map(|verdict| self.limit(&verdict)));
        match crossing {
            Ok(crossing) => {
                let point = at(crossing.high.or(crossing.low).unwrap_or(0.0));
                self.tried(run, &point, rows::crossing(&crossing))
            }
            Err(reason) => Ok(self.columns.row(&self.study, (run, &at(0.0)), rows::no_crossing(), Err(reason))),
        }
    }

    /// The margin that the study is about.
    fn limit(&self, verdict: &Verdict) -> f64 {
        // What does not apply does not limit.
        self.study.margin.map_or(verdict.margin, |cause| verdict.margin_of(CauseKind::ALL[cause]).unwrap_or(1.0))
    }

    /// Writes the recording of a run if the rule says so.
    fn keep(&self, run: u64, point: &Point, verdict: Option<&Verdict>) -> Result<(), String> {
        let wanted = match &self.study.keep {
            Kept::None => false,
            Kept::Failed => verdict.is_some_and(|v| !v.survived),
            Kept::Runs(runs) => verdict.is_some() && runs.contains(&run),
        };
        if !wanted {
            return Ok(());
        }
        let folder = self.campaign.folder.join(RECORDINGS);
        std::fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
        let file = folder.join(format!("run-{run:06}.mcap"));
        let remade = self.remake_at(run, point).map_err(|e| e.to_string())?;
        remade.write_recording(self, &file).map_err(|e| e.to_string())
    }

    /// A run made again, from its row in the table if there is one, else from the plan.
    ///
    /// # Errors
    /// If the study has no such run, or the run has no verdict.
    pub fn remake(&self, run: u64) -> Result<Remade, ConductError> {
        let row = self.find(run)?;
        let point = match &row {
            Some(row) => self.columns.point(&self.study, row).map_err(|reason| ConductError::Run { run, reason })?,
            None if run < self.runs() && !self.plan.is_search() => match self.study.design {
                Design::Boundary { .. } => {
                    let row = self.row(run).map_err(|e| ConductError::Run { run, reason: e.to_string() })?;
                    self.columns.point(&self.study, &row).map_err(|reason| ConductError::Run { run, reason })?
                }
                _ => self.plan.point(run),
            },
            None => return Err(ConductError::Beyond { run, of: self.runs() }),
        };
        let mut remade = self.remake_at(run, &point)?;
        let own = |row: &[Value]| self.columns.verdict_of(row).to_vec();
        remade.same = row.map(|row| own(&row) == remade.outcome.verdict.row());
        Ok(remade)
    }

    fn remake_at(&self, run: u64, point: &Point) -> Result<Remade, ConductError> {
        let failed = |reason: String| ConductError::Run { run, reason };
        let files = self.study.files(&point.settings, point.seed).map_err(failed)?;
        let text = files.text.clone();
        let case = self.case(point).map_err(failed)?;
        let outcome = self::run(&case, Keep::Recording).map_err(|e: RunError| failed(e.to_string()))?;
        Ok(Remade { run, point: point.clone(), case, text, outcome, same: None })
    }

    /// Row of a run in the table, if there is a table.
    fn find(&self, run: u64) -> Result<Option<Vec<Value>>, ConductError> {
        let is_nowhere = self.campaign.folder.as_os_str().is_empty();
        if is_nowhere || self.campaign.held()? == Held::Open {
            return Ok(None);
        }
        let file = self.campaign.table();
        let content = |reason| CampaignError::Content { file: file.clone(), reason };
        let reader = Reader::open(&file).map_err(content)?;
        if run >= reader.len() {
            return Err(ConductError::Beyond { run, of: reader.len() });
        }
        let mut before = 0;
        for group in 0..reader.groups() {
            let rows = reader.group(group).map_err(content)?;
            if let Some(row) = rows.get((run - before) as usize) {
                return Ok(Some(row.clone()));
            }
            before += rows.len() as u64;
        }
        Ok(None)
    }
}

/// The campaign of a study with rows under `headings` in `folder`, and its random numbers, which do not depend on the
/// build: the same runs can be compared between two.
pub fn campaign(study: &Study, headings: Vec<Heading>, folder: &Path) -> (Campaign, Draws) {
    let version = [("program", env!("CARGO_PKG_VERSION").as_bytes()), ("rows", FORMAT.as_bytes())];
    let seed = study.seed.to_le_bytes();
    let contents = study.contents().iter().map(|(name, content)| (name.as_str(), content.as_slice()));
    let digest = Digest::of(version.into_iter().chain([("seed", &seed[..])]).chain(contents));
    let metadata = vec![
        ("program".into(), format!("deltatwin {}", env!("CARGO_PKG_VERSION"))),
        // Not as written: the same study in other words is the same table.
        (
            "study".into(),
            study.contents().first().map_or_else(String::new, |(_, text)| String::from_utf8_lossy(text).into()),
        ),
        ("design".into(), study.design.name().into()),
        ("seed".into(), study.seed.to_string()),
    ];
    let name = study.name.clone();
    let campaign = Campaign { name, folder: folder.into(), digest, build: BUILD.into(), headings, metadata };
    (campaign, Draws::new(&digest, study.seed))
}

/// Folder of the recordings in a study's folder.
pub const RECORDINGS: &str = "recordings";

/// A run that was made again, with its recording.
pub struct Remade {
    /// The run.
    pub run: u64,
    /// Its settings.
    pub point: Point,
    /// The case.
    pub case: Case,
    /// The scenario as text.
    pub text: String,
    /// What came out.
    pub outcome: Outcome,
    /// Whether the verdict is that of the table, bit by bit; `None` without a table.
    pub same: Option<bool>,
}

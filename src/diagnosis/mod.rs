//! Which physical effect is missing: refit the model, try every absent effect, add what the data demand.
//!
//! The statistics stand in [`crate::evidence`]; this module states the hypotheses in the robot's terms and reads the
//! outcome back into them.

mod add;
pub mod budget;
pub mod candidates;
pub mod confidence;
pub mod experiment;
mod judge;
pub mod left;
mod problem;
mod search;
pub mod unknown;

use std::sync::atomic::{AtomicBool, Ordering};

pub use add::{Addition, add};
use budget::{Budget, Change};
pub use candidates::CandidateReport;
use confidence::Confidence;
pub use experiment::NextExperiment;
use experiment::Open;
use judge::{Judge, Judged, relative_energy};
pub use left::Left;
use thiserror::Error;

use crate::dynamics::{Channel, in_configuration};
use crate::effects::{self, ActiveEffect};
use crate::evidence::{self, Assessment, Outcome, Problem, Visibility};
use crate::identification::Trace;
use crate::identification::fit::{Estimate, Fit, FitError, Options, fit_with};
use crate::identification::trace::noise_floor as floor;
use crate::model::Model;
pub use unknown::Unexplained;

/// Why a diagnosis cannot be made.
#[derive(Debug, Error)]
pub enum DiagnosisError {
    /// The model cannot be fitted.
    #[error(transparent)]
    Fit(#[from] FitError),
    /// The statistics failed.
    #[error("diagnosis: {0}")]
    Evidence(#[from] evidence::Error),
    /// Too little is left of the recordings for statistics.
    #[error(
        "diagnosis: {used:.3} s of {recorded:.3} s are usable ({rows} means of {block} samples; the noise model needs the first \
         {skip} of each of {stretches} stretches), expected at least {needed:.3} s ({means} means); record longer, or without gaps",
        block = problem::BLOCK
    )]
    TooShort {
        /// Length of all stretches, s.
        recorded: f64,
        /// Stretches of evenly spaced samples.
        stretches: usize,
        /// Part of it that statistics can use, s.
        used: f64,
        /// The same in means.
        rows: usize,
        /// Means that the noise model needs of each stretch.
        skip: usize,
        /// Least length, s.
        needed: f64,
        /// The same in means.
        means: usize,
    },
    /// No recording was given.
    #[error("no recording to diagnose")]
    NoData,
    /// The recordings measure different channels.
    #[error("recordings {first} and {second} measure different channels")]
    Channels {
        /// Name of a recording.
        first: String,
        /// Name of another one.
        second: String,
    },
    /// There is no such effect.
    #[error("unknown effect `{0}`; `deltatwin effects` lists them")]
    UnknownEffect(String),
    /// The machine of the recordings lacks what the effect acts on.
    #[error("`{effect}` acts on {part}, which the machine of these recordings does not have")]
    Missing {
        /// Name of the effect.
        effect: String,
        /// What it acts on.
        part: &'static str,
    },
    /// The effect is in the twin only.
    #[error(
        "`{0}` acts in the twin only: inverse dynamics along a measured motion does not show it, so no data determine its \
         parameters; put its table into the model file by hand"
    )]
    TwinOnly(String),
    /// A formula has no law of its own.
    #[error(
        "`formula` has no law until its terms stand in the model file; write [[effects.formula.terms]] there by hand"
    )]
    NoTerms,
    /// The effect is in the model already.
    #[error("the model has `{0}` already")]
    Present(String),
}

impl DiagnosisError {
    /// An error of the statistics on means of samples, in the seconds of the recordings.
    fn of_statistics(error: evidence::Error, traces: &[Trace]) -> Self {
        let evidence::Error::TooShort { rows, skip, needed: means } = error else { return error.into() };
        let mean = problem::BLOCK as f64 * traces.iter().map(|t| t.dt).fold(0.0, f64::max);
        let (stretches, all) = problem::segments(traces);
        Self::TooShort {
            recorded: all as f64 * mean,
            stretches: stretches.len(),
            used: rows as f64 * mean,
            rows,
            skip,
            needed: means as f64 * mean,
            means,
        }
    }
}

/// Conclusion of a diagnosis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing is missing.
    None,
    /// One effect is missing.
    Effect,
    /// More than one effect is missing.
    Several,
    /// Something is missing, and the data do not tell which of several effects.
    Ambiguous,
    /// Something is missing that no known effect explains.
    Unknown,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::None => "none",
            Self::Effect => "effect",
            Self::Several => "several",
            Self::Ambiguous => "ambiguous",
            Self::Unknown => "unknown",
        })
    }
}

/// What is missing.
#[derive(Clone)]
pub struct Diagnosis {
    /// Conclusion.
    pub verdict: Verdict,
    /// Channels of the following arrays.
    pub channels: Vec<Channel>,
    /// Standard deviation of the sensor noise.
    pub noise_floor: Vec<f64>,
    /// RMS residual of the refitted model without new effects; on held-out data where given.
    pub rms_before: Vec<f64>,
    /// The same with the found effects.
    pub rms_after: Vec<f64>,
    /// Effects that are missing, in the order found.
    pub effects: Vec<Named>,
    /// All candidates, best first.
    pub candidates: Vec<CandidateReport>,
    /// Sets of effects the data cannot tell apart.
    pub indistinguishable: Vec<Vec<String>>,
    /// Effects the data could not show at their usual size.
    pub unseen: Vec<String>,
    /// Parameters of the other candidates that no channel shows at all, such as the height of a payload without strut forces.
    pub unseen_parameters: Vec<String>,
    /// Those of them that act in the twin only.
    pub twin_only: Vec<String>,
    /// What to measure to tell the members of a set apart, or to see what these data cannot show.
    pub next_experiment: Option<NextExperiment>,
    /// What each found effect explains.
    pub budget: Budget,
    /// Parameters that the found effects moved.
    pub changes: Vec<Change>,
    /// All parameters before and after.
    pub parameters: [Vec<Estimate>; 2],
    /// What is left with everything that was found, and whether something unknown acts beside the effects named.
    pub left: Left,
    /// Names of what the time did not allow to try.
    pub not_tried: Vec<String>,
    /// What no known effect explains: for [`Verdict::Unknown`], with the formula in the model; beside named effects that
    /// stand, with the formula as a proposal.
    pub unexplained: Option<Unexplained>,
    /// By how much the torques come late, s, if it is less than half a sample: no effect, but part of the model.
    pub sampling_lag: Option<f64>,
    /// The refitted model with the found effects, which its history tells of, and with a formula for what they do not explain.
    pub model: Model,
}

/// A missing effect.
#[derive(Clone, Debug)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// What would have been said, had something else been true.
    pub confidence: Confidence,
    /// Share of the explainable error it explains.
    pub explained: f64,
    /// Its parameters.
    pub parameters: Vec<Estimate>,
}

/// Share of the time for a diagnosis that has passed: one and more once it is up.
pub type Clock<'a> = &'a (dyn Fn() -> f64 + Sync);

/// Shares of the time after which no further effect, no law outside the library and no experiment is looked for.
const SEARCH: f64 = 0.6;
/// The same for the first effect: on a slow computer it is tried all the same.
const FIRST: f64 = 2.0;
const EXPLAIN: f64 = 0.75;
const EXPERIMENT: f64 = 0.9;

/// Finds the missing effects; `progress` is told what is being done.
pub fn diagnose(
    model: &Model,
    traces: &[Trace],
    held_out: &[Trace],
    progress: &mut dyn FnMut(&str),
) -> Result<Diagnosis, DiagnosisError> {
    diagnose_holding(model, &[], traces, held_out, progress)
}

/// The same, with the parameters of some effects (or of `rigid_bodies`) known: they are not fitted.
pub fn diagnose_holding(
    model: &Model,
    held: &[String],
    traces: &[Trace],
    held_out: &[Trace],
    progress: &mut dyn FnMut(&str),
) -> Result<Diagnosis, DiagnosisError> {
    diagnose_within(&|| 0.0, model, held, traces, held_out, progress)
}

/// The same within a time: once `clock` says that it is up, the best answer so far, and what was not tried.
pub fn diagnose_within(
    clock: Clock,
    model: &Model,
    held: &[String],
    traces: &[Trace],
    held_out: &[Trace],
    progress: &mut dyn FnMut(&str),
) -> Result<Diagnosis, DiagnosisError> {
    check(traces, held_out)?;
    let fitting = Fitting { traces, noise: floor(model, traces), held, clock, tried: AtomicBool::new(false) };
    let judge = Judge::new(&fitting, model, held_out);
    let noise_floor = judge.floor.clone();
    progress("refit");
    let start = fitting.fit(model)?;
    let mounted = in_configuration(model, &traces[0].setup);
    let candidates = problem::absent(&mounted);
    let search::Found { start, end, without, outcome, all, problem, settings, sampling_lag, mut not_tried } =
        search::find(start, &judge, &candidates, progress)?;
    let Judged { fit: start, rms: rms_before, .. } = start;
    let Judged { fit: end, rms: mut rms_after, .. } = end;
    progress("confidence");
    let found = outcome.found();
    let mut effects = Vec::new();
    for (finding, without) in outcome.findings.iter().zip(&without) {
        let name = candidates[finding.chosen.candidate][0].effect.name();
        let judged_in = finding.problem.as_deref().or(outcome.refitted.as_ref()).unwrap_or(&problem);
        effects.push(Named {
            name: name.into(),
            confidence: Confidence::of(finding, judged_in, &settings)?,
            explained: explained(&rms_before, without, &rms_after, &noise_floor),
            parameters: Vec::new(),
        });
    }
    let twin_only: Vec<String> = problem::beyond(&mounted).into_iter().map(|e| e.name().into()).collect();
    let unseen: Vec<String> = all
        .candidates
        .iter()
        .filter(|a| a.visibility != Visibility::Visible && !found.contains(&a.candidate))
        .map(|a| a.name.clone())
        .chain(twin_only.iter().cloned())
        .collect();
    let unseen_parameters = problem::not_excited(&problem, &unseen);
    let mut indistinguishable: Vec<Vec<String>> = outcome
        .findings
        .iter()
        .map(|f| {
            let own = candidates[f.chosen.candidate][0].effect.name().to_string();
            let rivals = f.ranking.confidence_set().into_iter().map(|a| a.name.clone()).filter(|n| *n != own);
            std::iter::once(own.clone()).chain(rivals.collect::<Vec<_>>()).collect::<Vec<String>>()
        })
        .filter(|set| set.len() > 1)
        .collect();
    let leaves_more = judge.leaves_more(&end)?;
    let verdict =
        verdict(&outcome, [&rms_before, &rms_after, &noise_floor], leaves_more, !indistinguishable.is_empty());
    progress("what is left");
    let mut left = Left::new(&rms_after, &noise_floor, !effects.is_empty(), verdict);
    let doubt = unknown::Doubt { named: effects.len(), is_more_than_noise: left.is_more_than_noise() };
    let unexplained = if clock() < EXPLAIN {
        unknown::explain([&start, &end], doubt, &fitting, held_out, progress)?
    } else {
        not_tried.push("a law outside the library".into());
        None
    };
    let (verdict, end) = match unexplained.as_ref().filter(|u| u.replaces) {
        None => (verdict, end),
        Some(found) => {
            // Named effects stay only where they add to it.
            if !found.beside_named {
                effects.clear();
                indistinguishable.clear();
            }
            rms_after.clone_from(&found.rms);
            (Verdict::Unknown, found.fit.clone())
        }
    };
    if verdict == Verdict::Unknown {
        // Where something else is the matter, a name is worth what it explains.
        effects.iter_mut().for_each(|e| e.confidence.doubt(e.explained));
    }
    // As they are in the model, beside a formula if it has one.
    effects.iter_mut().for_each(|e| e.parameters = parameters_of(&end, &e.name));
    let is_explained = unexplained.as_ref().is_some_and(|u| u.replaces);
    left = Left::new(&rms_after, &noise_floor, !effects.is_empty(), verdict);
    if left.is_more_than_noise() && unexplained.is_none() {
        left.look(&end, &fitting, held_out)?;
    }
    let lag = sampling_lag.map(|_| search::DELAY);
    let reports = candidates::reports(&all, &outcome, &settings, &effects, &indistinguishable, lag);
    progress("next experiment");
    let next_experiment = if clock() < EXPERIMENT {
        next_experiment(verdict, &outcome, &candidates, &end, &fitting)
    } else {
        not_tried.push("the next experiment".into());
        None
    };
    let mut stages: Vec<(String, Vec<f64>)> = Vec::new();
    let mut added: Vec<&str> = effects.iter().map(|e| e.name.as_str()).collect();
    added.extend(is_explained.then_some(effects::formula::NAME));
    for i in 1..=added.len() {
        let rms = if i == added.len() {
            rms_after.clone()
        } else {
            let part = without_effects(&end.model, &added[i..]);
            judge.of(fitting.fit(&part)?)?.rms
        };
        stages.push((added[i - 1].to_string(), rms));
    }
    let budget = Budget {
        channels: traces[0].channels.clone(),
        rms_before: rms_before.clone(),
        noise_floor: noise_floor.clone(),
        effects: stages,
        held_out: !held_out.is_empty(),
    };
    let mut found_model = end.model.clone();
    found_model.history.extend(budget.history());
    Ok(Diagnosis {
        verdict,
        channels: traces[0].channels.clone(),
        noise_floor,
        rms_before,
        rms_after,
        effects,
        candidates: reports,
        indistinguishable,
        unseen,
        unseen_parameters,
        twin_only,
        next_experiment,
        left,
        budget,
        changes: budget::changes(&start, &end),
        parameters: [start.parameters, end.parameters],
        unexplained,
        sampling_lag,
        not_tried,
        model: found_model,
    })
}

impl Diagnosis {
    /// Share of the explainable error, on the data judged by, that goes with everything that was found.
    pub fn explained(&self) -> f64 {
        explained(&self.rms_before, &self.rms_before, &self.rms_after, &self.noise_floor)
    }

    /// The same with a formula that no effect of the library is, where there is one.
    pub fn explained_with_formula(&self) -> f64 {
        let after = self.unexplained.as_ref().map_or(&self.rms_after, |u| &u.rms);
        explained(&self.rms_before, &self.rms_before, after, &self.noise_floor)
    }

    /// Whether something unknown acts beside the effects that are named.
    pub fn unknown_beside(&self) -> bool {
        self.left.beside
    }
}

/// The model without the effects named.
fn without_effects(model: &Model, names: &[&str]) -> Model {
    let mut reduced = model.clone();
    reduced.effects.retain(|a| !names.contains(&a.effect.name()));
    reduced
}

/// How a model is fitted to the data.
struct Fitting<'a> {
    traces: &'a [Trace],
    /// Noise of the channels.
    noise: Vec<f64>,
    /// Effects that keep their parameters.
    held: &'a [String],
    /// Share of the time that has passed.
    clock: Clock<'a>,
    /// Whether an effect was tried.
    tried: AtomicBool,
}

impl Fitting<'_> {
    fn fit(&self, model: &Model) -> Result<Fit, FitError> {
        let weights = vec![self.noise.clone(); self.traces.len()];
        let stop = || self.is_late();
        fit_with(model, self.traces, &weights, &Options { held: self.held, stop: Some(&stop), ..Options::default() })
    }

    /// Whether it is too late to look for another effect.
    fn is_late(&self) -> bool {
        (self.clock)() >= if self.tried.load(Ordering::Relaxed) { SEARCH } else { FIRST }
    }

    /// From now on the time is as long as it is.
    fn has_tried(&self) {
        self.tried.store(true, Ordering::Relaxed);
    }

    /// The problem of a fit, without the parameters that are held or what the edge of the possible holds.
    fn problem(&self, fit: &Fit, candidates: &[Vec<ActiveEffect>]) -> Result<Problem, FitError> {
        let mut problem = problem::problem(fit, self.traces, &self.noise, candidates)?;
        problem.base.retain(|c| !self.holds(&c.name));
        problem::along_edges(&mut problem.base, fit);
        Ok(problem)
    }

    /// Whether a parameter, with its effect before its name, stays as it is.
    fn holds(&self, parameter: &str) -> bool {
        self.held.iter().any(|h| parameter.split('.').next() == Some(h))
    }
}

fn check(traces: &[Trace], held_out: &[Trace]) -> Result<(), DiagnosisError> {
    let first = traces.first().ok_or(DiagnosisError::NoData)?;
    match traces.iter().chain(held_out).find(|t| t.channels != first.channels) {
        Some(other) => Err(DiagnosisError::Channels { first: first.name.clone(), second: other.name.clone() }),
        None => Ok(()),
    }
}

/// Estimates of one effect, with its name left out of theirs.
pub fn parameters_of(fit: &Fit, effect: &str) -> Vec<Estimate> {
    let prefix = format!("{effect}.");
    fit.parameters
        .iter()
        .filter_map(|p| p.name.strip_prefix(&prefix).map(|name| Estimate { name: name.into(), ..p.clone() }))
        .collect()
}

/// Share of the explainable error that goes from `without` to `with`.
fn explained(before: &[f64], without: &[f64], with: &[f64], floor: &[f64]) -> f64 {
    let explainable = relative_energy(before, floor) - floor.len() as f64;
    if explainable <= 0.0 {
        return 0.0;
    }
    ((relative_energy(without, floor) - relative_energy(with, floor)) / explainable).clamp(0.0, 1.0)
}

fn verdict(outcome: &Outcome, [before, after, floor]: [&[f64]; 3], leaves_more: bool, ambiguous: bool) -> Verdict {
    let n = outcome.findings.len();
    // Named effects must explain most of what is there, else something else is the matter.
    let left = (relative_energy(after, floor) - floor.len() as f64)
        / (relative_energy(before, floor) - floor.len() as f64).max(f64::MIN_POSITIVE);
    match n {
        _ if leaves_more && (n == 0 || left > 0.5) => Verdict::Unknown,
        _ if outcome.verdict == evidence::Verdict::Unknown => Verdict::Unknown,
        0 => Verdict::None,
        _ if ambiguous => Verdict::Ambiguous,
        1 => Verdict::Effect,
        _ => Verdict::Several,
    }
}

/// The experiment that tells the members of the first set apart; without one, that shows what the data could not.
fn next_experiment(
    verdict: Verdict,
    outcome: &Outcome,
    candidates: &[Vec<ActiveEffect>],
    end: &Fit,
    fitting: &Fitting,
) -> Option<NextExperiment> {
    let sets = outcome.findings.iter().map(|f| (f.chosen, &f.ranking));
    let set = sets.map(|(own, ranking)| (own, ranking, ranking.confidence_set())).find(|(_, _, set)| set.len() > 1);
    let ranking = &outcome.remaining;
    let (traces, held) = (fitting.traces, fitting.held);
    let (filters, stride, blocks) = (&ranking.filters, problem::BLOCK, ranking.blocks);
    let open = |model| Open { model, held, traces, filters, stride, blocks };
    match (verdict, set) {
        (Verdict::Unknown, _) => None,
        (_, Some((own, _, set))) => {
            let sized = |a: &Assessment| {
                let fitted = end
                    .model
                    .effects
                    .iter()
                    .find(|e| e.effect.name() == a.name)
                    .filter(|_| a.candidate == own.candidate);
                let estimated = a.coefficients.iter().map(|c| (c.name.clone(), c.value));
                fitted.cloned().unwrap_or_else(|| experiment::sized(&candidates[a.candidate][a.variant], estimated))
            };
            // The one that was added first leads.
            let leader = set.iter().filter(|a| a.candidate == own.candidate);
            let rivals = set.iter().filter(|a| a.candidate != own.candidate);
            let effects: Vec<ActiveEffect> = leader.chain(rivals).map(|a| sized(a)).collect();
            let names: Vec<&str> = effects.iter().map(|a| a.effect.name()).collect();
            open(&without_effects(&end.model, &names)).tell(&effects)
        }
        (_, None) => {
            let unseen = ranking.candidates.iter().filter(|a| a.visibility != Visibility::Visible && !a.generic);
            let effects: Vec<ActiveEffect> =
                unseen.map(|a| experiment::usual(&candidates[a.candidate][a.variant])).collect();
            if effects.is_empty() { None } else { open(&end.model).see(&effects) }
        }
    }
}

//! Forward selection of effects on the robot's own model, with validation of every selected effect.
//!
//! A fit with a given set of effects is computed once and reused. When the time is up, the result is the longest
//! sequence of effects, in the order of their addition, that the validation data confirm, or the confirmed set of all fits
//! that leaves clearly less.

pub(super) mod lag;

mod fits;
mod insignificant;
mod models;
mod pairs;
mod rivals;
mod standing;
pub(super) mod starts;

use std::cell::OnceCell;

pub(super) use models::{begun_with, with_effects, without_effects};

use super::judge::{Judge, Judged, MIN_RELEVANCE, relative_energy, relevance};
use super::problem::Edges;
use super::progress::{Progress, promises};
use super::{DiagnosisError, problem};
use crate::effects::{ActiveEffect, Role};
use crate::evidence::{self, Chosen, Outcome, Problem, Ranking, Refit, Settings};
use crate::gate::carries_weight_alone;
use crate::identification::fit::{Fit, FitError, is_nonlinear};
use crate::model::Model;
use fits::Fits;
use lag::{DELAY, Lag};
use pairs::Proposed;
use standing::Standing;

/// Largest number of effects refused by the validation. After it the answer is what stands of a selection; where no
/// machine with an effect can be fitted, only the strongest one is tried, and after one more refusal none.
const MAX_REFUSED: usize = 5;

/// The largest number where the start leaves hardly more than noise: drift, which imitates many effects.
const MAX_REFUSED_IN_NOISE: usize = 2;

/// Outcome of the search.
pub(super) struct Found {
    /// The model without new effects, but with the recorder's delay if there is one.
    pub start: Judged,
    /// The model with everything found.
    pub end: Judged,
    /// RMS residuals without each found effect, on the validation data.
    pub without: Vec<Vec<f64>>,
    /// The statistics of the last selection.
    pub outcome: Outcome,
    /// Ranking of all candidates before any was refused.
    pub all: Ranking,
    /// The original problem.
    pub problem: Problem,
    /// How its parameters are restricted by consistency constraints.
    pub edges: Edges,
    /// Settings of the selection.
    pub settings: Settings,
    /// Delay of the torques, s.
    pub sampling_lag: Option<f64>,
    /// Effects that the data require but that were not tried for lack of time.
    pub not_tried: Vec<String>,
}

impl Found {
    /// Whether every found effect is distinguished from all rivals and the residual does not exceed the noise.
    fn is_clear(&self, judge: &Judge) -> bool {
        let single = self.outcome.findings.iter().all(|f| f.ranking.confidence_set().len() < 2);
        single && !judge.is_more_than_noise(self.end.rms())
    }
}

/// Result of one selection.
enum Selection {
    /// Regular end.
    Complete(Box<(Outcome, Judged)>),
    /// The delay found is that of the recorder; the effects found before it.
    Lag(ActiveEffect, Vec<Chosen>),
    /// The effect of that name is not confirmed.
    Refused(String),
    /// Two other effects promise to leave clearly less than the first two selected.
    Pairs,
}

/// Selection of effects, repeated until all that were found are confirmed.
///
/// If the start has several active consistency constraints and the outcome is not clear, the search is repeated with
/// each constraint separately. Returned is an outcome that is clear, otherwise the one with the smaller residual.
pub(super) fn find(
    start: Fit,
    judge: &Judge,
    candidates: &[Vec<ActiveEffect>],
    progress: &mut dyn FnMut(Progress),
) -> Result<Found, DiagnosisError> {
    let is_held = start.edges.len() > 1;
    let (first, known) = find_along(Edges::Together, (start.clone(), None), judge, candidates, progress)?;
    if !is_held || first.is_clear(judge) || judge.fitting.is_late() {
        return Ok(first);
    }
    progress(Progress::Step("every edge of the possible by itself"));
    let (second, _) = find_along(Edges::Apart, (start, known), judge, candidates, progress)?;
    let left = |found: &Found| relative_energy(found.end.rms(), &judge.floor);
    // Both may have found the same effects, with which they leave the same but for rounding.
    let is_better = second.is_clear(judge) || left(&second) < left(&first);
    Ok(if is_better { second } else { first })
}

/// What a search knows that another one from the same start may use.
struct Known {
    fits: Fits,
    problem: Problem,
}

/// The outcome of a search along `edges` from a start, of which something may be known.
fn find_along(
    edges: Edges,
    (start, known): (Fit, Option<Known>),
    judge: &Judge,
    candidates: &[Vec<ActiveEffect>],
    progress: &mut dyn FnMut(Progress),
) -> Result<(Found, Option<Known>), DiagnosisError> {
    progress(Progress::Step("columns of the candidates"));
    let mut search = Search::new((edges, start), known, judge, candidates, progress)?;
    if let Some(late) = search.lag_of_slow_recordings() {
        search.accept_lag(late)?;
    }
    let mut begun: Vec<Chosen> = Vec::new();
    // The last selection of which an effect was refused.
    let mut refuted = None;
    let best = loop {
        judge.fitting.go_on()?;
        progress(Progress::Step("evidence"));
        let selected = search.select(&std::mem::take(&mut begun), progress)?;
        judge.fitting.go_on()?;
        let refused = match selected {
            Selection::Complete(complete) => {
                let (outcome, end) = *complete;
                let is_delayed_more = search.sampling_lag(&end).is_some()
                    && search.recorded_lag(&end.fit).is_none()
                    && !search.is_smoothed(&end.fit);
                // Without time for another selection, what stands of this one is the answer.
                if is_delayed_more && !judge.fitting.is_late() {
                    search.exclude_lag();
                    continue;
                }
                // So is what stands of the last one if this one was cut at once.
                let is_cut_at_once = outcome.cut_short && outcome.findings.is_empty();
                let (outcome, end) = refuted.take().filter(|_| is_cut_at_once).unwrap_or((outcome, end));
                match search.confirm(outcome, end)? {
                    Ok(standing) => {
                        if judge.is_more_than_noise(standing.end.rms()) {
                            search.try_pairs(progress)?;
                        }
                        let best = search.better_of(standing);
                        let best = search.or_alone(best, progress)?;
                        break search.and_more(best, progress)?;
                    }
                    Err(name) => {
                        refuted.clone_from(&search.selected);
                        name
                    }
                }
            }
            Selection::Lag(late, others) => {
                search.accept_lag(late)?;
                // One effect may be another one with the delay; several are what carries the explanation.
                begun = if others.len() > 1 { others } else { Vec::new() };
                continue;
            }
            Selection::Refused(name) => name,
            Selection::Pairs => {
                search.try_pairs(progress)?;
                match search.clear_pairs() {
                    Some(paired) => break search.and_more(paired, progress)?,
                    None => continue,
                }
            }
        };
        // A refusal must not take what carries the explanation together with another effect.
        search.try_pairs(progress)?;
        if let Some(paired) = search.clear_pairs() {
            break search.and_more(paired, progress)?;
        }
        search.refuse(refused, progress);
    };
    let best = search.or_known(best)?;
    let best = search.or_rival(best, progress)?;
    let fits = std::mem::take(&mut search.fits);
    // With the recorder's delay in the model they have another start.
    let known = (search.lag == Lag::Possible).then(|| Known { fits, problem: search.problem.clone() });
    Ok((search.found(best), known))
}

/// Added effects with the fit that contains them.
type Refitted = (Vec<Chosen>, Judged);

/// Repeated forward selection from one refitted model.
struct Search<'a> {
    edges: Edges,
    judge: &'a Judge<'a>,
    candidates: &'a [Vec<ActiveEffect>],
    settings: Settings,
    /// The model to which effects are added.
    start: Judged,
    /// Its linearised problem.
    problem: Problem,
    /// Model and problem without the recorder's delay.
    without_lag: (Judged, Problem),
    lag: Lag,
    /// Names of the effects that were not confirmed.
    refused: Vec<String>,
    /// The ranking before anything was added or refused.
    all: Option<Ranking>,
    fits: Fits,
    /// The last selection if it came to its regular end, until another one begins with it.
    selected: Option<(Outcome, Judged)>,
    /// The best pairs of effects, whether they were tried, and what of the best one is confirmed.
    pairs: OnceCell<Vec<Proposed>>,
    has_paired: bool,
    paired: Option<Standing>,
}

impl<'a> Search<'a> {
    fn new(
        (edges, start): (Edges, Fit),
        known: Option<Known>,
        judge: &'a Judge<'a>,
        candidates: &'a [Vec<ActiveEffect>],
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Self, DiagnosisError> {
        let block = problem::block(judge.fitting.datasets);
        let mut settings = Settings { min_relevance: MIN_RELEVANCE * (block as f64).sqrt(), ..Settings::default() };
        let (problem, fits) = match known {
            Some(Known { fits, problem }) => (Problem { base: judge.fitting.base(&start, edges)?, ..problem }, fits),
            None => (judge.fitting.problem(&start, candidates, edges, progress)?, Fits::default()),
        };
        let start = judge.of(start)?;
        // Nothing is to be explained, or the torques show nothing of the dynamics.
        let mechanism = start.fit.model.mechanism;
        let is_moved_otherwise = judge.fitting.datasets.iter().any(|t| carries_weight_alone(mechanism, t));
        if is_moved_otherwise || judge.is_noise(start.rms()) {
            settings.max_steps = 0;
        }
        Ok(Self {
            edges,
            judge,
            candidates,
            settings,
            without_lag: (start.clone(), problem.clone()),
            start,
            problem,
            lag: Lag::Possible,
            refused: Vec::new(),
            all: None,
            fits,
            selected: None,
            pairs: OnceCell::new(),
            has_paired: false,
            paired: None,
        })
    }

    /// Whether no further effect may be refused.
    fn is_exhausted(&self) -> bool {
        let is_noise = !self.judge.is_more_than_noise(self.start.rms());
        self.refused.len() >= if is_noise { MAX_REFUSED_IN_NOISE } else { MAX_REFUSED }
    }

    fn refuse(&mut self, name: String, progress: &mut dyn FnMut(Progress)) {
        progress(Progress::Step(&format!("without {name}")));
        match self.is_exhausted() {
            false => self.refused.push(name),
            true => self.settings.max_steps = usize::from(self.settings.max_steps > 1),
        }
    }

    /// Whether the start has active consistency constraints, by which its linearisation differs from that of a fit with
    /// the right effect.
    fn is_bounded(&self) -> bool {
        !self.start.fit.edges.is_empty()
    }

    /// The problem without the refused candidates, except those that the selection begins with: an effect that does not
    /// stand alone may stand next to another one.
    fn stated(&self, begun: &[Chosen]) -> Problem {
        let mut stated = self.problem.clone();
        for (i, c) in stated.candidates.iter_mut().enumerate() {
            let is_refused = self.refused.contains(&c.name) && begun.iter().all(|b| b.candidate != i);
            if is_refused || self.is_in_model(&c.name) {
                c.variants.clear();
            }
        }
        stated
    }

    /// Whether a candidate is the recorder's delay, which the start already has.
    fn is_in_model(&self, name: &str) -> bool {
        self.lag == Lag::InModel && name == DELAY
    }

    fn found(self, standing: Standing) -> Found {
        let sampling_lag = self.sampling_lag(&standing.end);
        let Standing { outcome, end, without, not_tried } = standing;
        Found {
            start: self.start,
            end,
            without,
            all: self.all.unwrap_or_else(|| outcome.remaining.clone()),
            outcome,
            problem: self.problem,
            edges: self.edges,
            settings: self.settings,
            sampling_lag,
            not_tried,
        }
    }

    /// Forward selection; the model is refitted after every addition if any parameter enters its prediction
    /// nonlinearly or a consistency constraint is active, because the error of an old linearisation resembles further
    /// effects. The effects of `begun` are added first.
    fn select(&mut self, begun: &[Chosen], progress: &mut dyn FnMut(Progress)) -> Result<Selection, DiagnosisError> {
        self.selected = None;
        let (stated, fitting) = (self.stated(begun), self.judge.fitting);
        let is_begun = !begun.is_empty();
        let mut stopped: Option<Selection> = None;
        let mut last: Option<Refitted> = None;
        let mut all = self.all.take();
        let mut rankings = 0;
        let refit = |chosen: &[Chosen], ranking: &Ranking| {
            rankings += 1;
            let alone = all.get_or_insert_with(|| {
                progress(Progress::Ranked(&promises(ranking)));
                ranking.clone()
            });
            if last.as_ref().is_some_and(|(_, fitted)| self.is_explained(fitted, chosen, alone)) {
                return Ok(Refit::Negligible);
            }
            if !is_begun && self.has_better_pairs(chosen, alone, ranking, last.as_ref()) {
                stopped = Some(Selection::Pairs);
                return Err(String::new());
            }
            self.added(chosen, ranking, &stated, &mut last, progress).map_err(|selection| {
                stopped = Some(selection);
                String::new()
            })
        };
        let held = |others: &[Chosen]| self.held(&stated, others).map_err(|e| e.to_string());
        let outcome = evidence::select_with(&stated, &self.settings, &|| fitting.is_late(), refit, &held, begun);
        self.all = all;
        fitting.count_rankings(outcome.as_ref().map_or(rankings, |o| o.rankings));
        if let Some(stopped) = stopped {
            return Ok(stopped);
        }
        let outcome = outcome?;
        if self.all.is_none() {
            progress(Progress::Ranked(&promises(&outcome.remaining)));
            self.all = Some(outcome.remaining.clone());
        }
        let selection = self.complete(outcome, last, progress)?;
        if let Selection::Complete(complete) = &selection {
            self.selected = Some((**complete).clone());
        }
        Ok(selection)
    }

    /// The problem linearised at the fit with `others` if consistency constraints are active there. Without others, constraints that
    /// are taken together count only in a linear model: its linearisation follows from them.
    fn held(&self, stated: &Problem, others: &[Chosen]) -> Result<Option<Problem>, FitError> {
        if others.is_empty() {
            let counts = self.edges == Edges::Apart || !is_nonlinear(&self.start.fit.model);
            return Ok((self.is_bounded() && counts).then(|| stated.clone()));
        }
        // Without a fit, or the time for one, nothing is held.
        let fitted = if self.judge.fitting.is_late() { None } else { self.refit(others, None).ok() };
        let held = fitted.filter(|fitted| !fitted.fit.edges.is_empty());
        held.map(|fitted| self.relinearised(&fitted.fit, stated, others)).transpose()
    }

    /// Whether the effects `fitted` before the last of `chosen` leave nothing to be explained, and the last one is neither the
    /// recorder's delay nor an effect that may stand in place of the first: alone it explains plainly less.
    fn is_explained(&self, fitted: &Judged, chosen: &[Chosen], alone: &Ranking) -> bool {
        let of = |c: Option<&Chosen>| c.and_then(|c| alone.of(c.candidate));
        let is_less = of(chosen.first()).zip(of(chosen.last())).is_some_and(|(a, b)| a.explains_plainly_more(b));
        is_less && !self.ends_with_lag(chosen) && self.judge.is_noise(fitted.rms())
    }

    /// Whether the last of `chosen` may be the recorder's delay.
    fn ends_with_lag(&self, chosen: &[Chosen]) -> bool {
        self.lag == Lag::Possible && chosen.last().is_some_and(|c| self.shape(c).effect.name() == DELAY)
    }

    /// Change of the problem after the last of `chosen` was added, or the reason that ends the selection.
    fn added(
        &self,
        chosen: &[Chosen],
        ranking: &Ranking,
        stated: &Problem,
        last: &mut Option<Refitted>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Refit, Selection> {
        let fitting = self.judge.fitting;
        let names = self.names(chosen);
        let is_lag = self.ends_with_lag(chosen);
        let model = with_effects(&self.start.fit.model, self.candidates, chosen, None);
        if !is_lag && !self.is_bounded() && !is_nonlinear(&model) {
            fitting.tried();
            return Ok(Refit::Same);
        }
        if self.promises_little(chosen, ranking) {
            fitting.tried();
            return Ok(Refit::Negligible);
        }
        progress(Progress::Step(&format!("refit with {}", names.join(", "))));
        let before = last.as_ref().map_or(&self.start, |(_, before)| before);
        let is_lost = |fitted: &Judged| chosen.len() > 1 && self.judge.is_lost_in_the_rest(before, fitted);
        let made = self.refit_worth_it(chosen, ranking, last.as_ref()).and_then(|fitted| match fitted {
            Ok(fitted) if is_lost(&fitted) => Ok(Ok(None)),
            Ok(fitted) => Ok(Ok(Some((self.relinearised(&fitted.fit, stated, chosen)?, fitted)))),
            Err(selection) => Ok(Err(selection)),
        });
        fitting.tried();
        // If the refit leads to an impossible machine, the newest effect is refused.
        match made.unwrap_or_else(|_| Err(self.refusal(chosen))) {
            Ok(None) => Ok(Refit::Negligible),
            Ok(Some((next, fitted))) => {
                *last = Some((chosen.to_vec(), fitted));
                Ok(Refit::New(Box::new(next)))
            }
            Err(Selection::Refused(_)) if fitting.is_late() => Ok(Refit::Withdraw),
            Err(selection) => Err(selection),
        }
    }

    /// Whether the last of several `chosen` effects enters linearly and gains too little in the ranking to be fitted.
    fn promises_little(&self, chosen: &[Chosen], ranking: &Ranking) -> bool {
        let newest = chosen.last().filter(|_| chosen.len() > 1);
        let linear = newest.filter(|c| self.shape(c).entries().iter().all(|e| e.parameter.role != Role::Shape));
        let assessed = linear.and_then(|c| ranking.of(c.candidate));
        assessed.is_some_and(|a| self.judge.will_be_lost(ranking, a))
    }

    /// The fit with the chosen effects, or the reason that ends the selection. Fits of elastic gears take long, so a
    /// relevant gain is required in the ranking before the fit and on the validation data after it.
    fn refit_worth_it(
        &self,
        chosen: &[Chosen],
        ranking: &Ranking,
        last: Option<&Refitted>,
    ) -> Result<Result<Judged, Selection>, FitError> {
        let before = last.map_or(&self.start, |(_, before)| before);
        let gears = chosen.last().filter(|c| self.shape(c).has_gears());
        if gears.is_some_and(|c| !is_promising(ranking, c)) {
            return Ok(Err(self.refusal(chosen)));
        }
        let fitted = match last {
            // The fit begins at that of the effects before.
            Some((had, before)) if gears.is_none() && chosen.split_last().is_some_and(|(_, others)| had == others) => {
                let newest = &chosen[had.len()..];
                let model = with_effects(&before.fit.model, self.candidates, newest, Some(ranking));
                self.fits.of(chosen, || self.fit(&model, chosen))?
            }
            _ => self.refit(chosen, Some(ranking))?,
        };
        if let Some(late) = self.chosen_lag(&fitted.fit, chosen) {
            return Ok(Err(Selection::Lag(late, self.without_lag(chosen))));
        }
        let keeps = gears.is_none() || self.judge.confirms(before, &fitted)?;
        Ok(if keeps { Ok(fitted) } else { Err(self.refusal(chosen)) })
    }

    /// Refusal of the last of `chosen`.
    fn refusal(&self, chosen: &[Chosen]) -> Selection {
        Selection::Refused(self.names(chosen).pop().unwrap_or_default())
    }

    /// Regular end of a selection, with the fit of all chosen effects.
    fn complete(
        &self,
        outcome: Outcome,
        last: Option<Refitted>,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Selection, DiagnosisError> {
        let chosen: Vec<Chosen> = outcome.chosen();
        let end = match last {
            _ if chosen.is_empty() => self.start.clone(),
            Some((before, fitted)) if before == chosen => fitted,
            _ => {
                progress(Progress::Step(&format!("refit with {}", self.names(&chosen).join(", "))));
                match self.refit(&chosen, None) {
                    Ok(end) => end,
                    Err(_) => return Ok(self.refusal(&chosen)),
                }
            }
        };
        Ok(match self.chosen_lag(&end.fit, &chosen) {
            Some(late) => Selection::Lag(late, self.without_lag(&chosen)),
            None => Selection::Complete(Box::new((outcome, end))),
        })
    }

    /// The chosen effects without the delay.
    fn without_lag(&self, chosen: &[Chosen]) -> Vec<Chosen> {
        chosen.iter().copied().filter(|c| self.shape(c).effect.name() != DELAY).collect()
    }

    fn names(&self, chosen: &[Chosen]) -> Vec<String> {
        chosen.iter().map(|c| self.shape(c).effect.name().to_string()).collect()
    }

    fn shape(&self, chosen: &Chosen) -> &ActiveEffect {
        &self.candidates[chosen.candidate][chosen.variant]
    }

    /// The outcome with `chosen` effects, significant or not, and their fit.
    fn given(&self, chosen: &[Chosen], fitted: &Fit) -> Result<Outcome, DiagnosisError> {
        let refitted = self.relinearised(fitted, &self.problem, chosen)?;
        let held = |others: &[Chosen]| self.held(&self.problem, others).map_err(|e| e.to_string());
        let outcome = evidence::given(refitted, chosen, &self.settings, &held)?;
        self.judge.fitting.count_rankings(outcome.rankings);
        Ok(outcome)
    }

    /// Error above the noise of the validation data.
    fn left(&self, judged: &Judged) -> f64 {
        self.above(relative_energy(judged.rms(), &self.judge.floor))
    }

    /// The part of an energy above the noise.
    fn above(&self, energy: f64) -> f64 {
        energy - self.judge.floor.len() as f64
    }

    fn refit(&self, chosen: &[Chosen], ranking: Option<&Ranking>) -> Result<Judged, FitError> {
        self.fits.of(chosen, || {
            let models = [&self.start.fit.model, &self.stated_model()];
            self.fit(&begun_with(self.judge.fitting, models, self.candidates, chosen, ranking)?, chosen)
        })
    }

    /// The fit that begins at a model with the chosen effects, or at another start of one of them.
    fn fit(&self, begun: &Model, chosen: &[Chosen]) -> Result<Judged, FitError> {
        starts::fit(self.judge, (&self.problem, self.candidates), chosen, begun, &self.start)
    }

    /// The model as stated, with the effects that the start has in addition.
    fn stated_model(&self) -> Model {
        let mut model = self.judge.stated.clone();
        let own = |a: &ActiveEffect| self.judge.stated.effects.iter().any(|b| b.effect.name() == a.effect.name());
        model.effects.extend(self.start.fit.model.effects.iter().filter(|a| !own(a)).cloned());
        model
    }

    /// The problem linearised at the parameters fitted with the chosen effects; their linear contribution is added
    /// back to y.
    fn relinearised(&self, fitted: &Fit, stated: &Problem, chosen: &[Chosen]) -> Result<Problem, FitError> {
        let (fitting, names) = (self.judge.fitting, self.names(chosen));
        let mut next = Problem { y: fitting.residual_series(&fitted.residuals), base: Vec::new(), ..stated.clone() };
        let mut base = Vec::new();
        for c in chosen {
            next.candidates[c.candidate].variants[c.variant].columns.clear();
        }
        for owned in fitting.columns_of(fitted)?.iter() {
            if fitting.is_fixed(owned.param) {
                continue;
            }
            let Some(i) = names.iter().position(|n| *n == owned.param.effect) else {
                base.push(owned.clone());
                continue;
            };
            if let Some(value) = owned.linear {
                for (y, x) in next.y.iter_mut().zip(&owned.column.values) {
                    *y += value * x;
                }
            }
            next.candidates[chosen[i].candidate].variants[chosen[i].variant].columns.push(owned.column.clone());
        }
        // The columns of the others are seen through the effects on the time of the torques as those of the model are.
        let in_time = |a: &&ActiveEffect| names.contains(&a.effect.name().into()) && a.shifts_time();
        for sensor in fitted.model.effects.iter().filter(in_time) {
            let others = (0..).zip(&mut next.candidates).filter(|(i, _)| chosen.iter().all(|c| c.candidate != *i));
            let variants = others.flat_map(|(_, candidate)| &mut candidate.variants);
            let columns = variants.flat_map(|variant| &mut variant.columns);
            columns.for_each(|column| problem::report(fitting.datasets, sensor, &mut column.values));
        }
        next.base = problem::along_edges(base, fitted, self.edges);
        next.base.extend(fitting.blurred_reversals());
        Ok(next)
    }
}

/// Whether the gain of a candidate in the ranking is relevant on some channel; true if it is not ranked.
fn is_promising(ranking: &Ranking, chosen: &Chosen) -> bool {
    let rms = |squares: &[f64]| squares.iter().map(|s| s.sqrt()).collect::<Vec<_>>();
    ranking
        .of(chosen.candidate)
        .is_none_or(|a| relevance(&rms(&ranking.sum_of_squares), &rms(&a.sum_of_squares)) >= MIN_RELEVANCE)
}

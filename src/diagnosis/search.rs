//! Forward selection of effects on the robot's own model, with names that do not stand refused.

use super::judge::{Judge, Judged, MIN_RELEVANCE, is_relevant};
use super::{DiagnosisError, Fitting, problem, without_effects};
use crate::effects::{ActiveEffect, Kind, Role};
use crate::evidence::{self, Chosen, Outcome, Problem, Ranking, Settings};
use crate::identification::fit::{Fit, FitError};
use crate::model::Model;

/// Most names that are refused; when a further one is wrong, too, nothing is named.
const MAX_REFUSED: usize = 5;

/// The effect that sampling looks like.
pub(super) const DELAY: &str = "signal_delay";

/// What the search ends with.
pub(super) struct Found {
    /// The model without new effects, but with a lag of the recorder if there is one.
    pub start: Judged,
    /// The model with all that was found.
    pub end: Judged,
    /// RMS residuals without each found effect, on the data to judge by.
    pub without: Vec<Vec<f64>>,
    /// The statistics of the last selection.
    pub outcome: Outcome,
    /// All candidates before any was refused.
    pub all: Ranking,
    /// The problem that was stated.
    pub problem: Problem,
    /// How it was judged.
    pub settings: Settings,
    /// By how much the torques come late, s.
    pub sampling_lag: Option<f64>,
}

/// How one selection ended.
enum Selection {
    /// Regularly.
    Complete(Box<(Outcome, Judged)>),
    /// The delay found is the recorder's.
    Lag(ActiveEffect),
    /// The effect of that name does not stand.
    Refused(&'static str),
}

/// Selects effects until all that were found stand.
pub(super) fn find(
    start: Fit,
    judge: &Judge,
    candidates: &[Vec<ActiveEffect>],
    progress: &mut dyn FnMut(&str),
) -> Result<Found, DiagnosisError> {
    let fitting = judge.fitting;
    let dt = fitting.traces[0].dt;
    let mut settings =
        Settings { min_relevance: MIN_RELEVANCE * (problem::BLOCK as f64).sqrt(), ..Settings::default() };
    progress("columns of the candidates");
    let mut problem = fitting.problem(&start, candidates)?;
    let mut start = judge.of(start)?;
    let alone = (start.clone(), problem.clone());
    // Stop at the noise floor: there is nothing to explain where no channel lies above it.
    if start.rms.iter().zip(&judge.floor).all(|(r, f)| r <= f) {
        settings.max_steps = 0;
    }
    let mut all: Option<Ranking> = None;
    let mut refused: Vec<&str> = Vec::new();
    let (mut lags, mut may_lag) = (false, true);
    loop {
        let mut stated = problem.clone();
        for c in &mut stated.candidates {
            if refused.contains(&c.name.as_str()) || (lags && c.name == DELAY) {
                c.variants.clear();
            }
        }
        progress("evidence");
        let search = Search { start: &start, judge, candidates, may_lag: may_lag && !lags };
        let wrong = match search.select(&stated, &settings, &mut all, progress)? {
            Selection::Lag(late) => {
                lags = true;
                let mut model = start.fit.model.clone();
                model.effects.push(late);
                start = judge.fit(&model)?;
                problem = fitting.problem(&start.fit, candidates)?;
                continue;
            }
            Selection::Refused(name) => name,
            Selection::Complete(complete) => {
                let (outcome, end) = *complete;
                let sampling_lag = delay(&end.fit.model).filter(|_| lags).map(|late| late.values[0]);
                if sampling_lag.is_some_and(|late| late.abs() >= 0.5 * dt) {
                    // Beside what else was found it is a delay.
                    (lags, may_lag) = (false, false);
                    (start, problem) = alone.clone();
                    continue;
                }
                let names: Vec<&'static str> =
                    outcome.found().into_iter().map(|i| candidates[i][0].effect.name()).collect();
                match search.stand(&names, &end)? {
                    Ok(without) => {
                        let all = all.unwrap_or_else(|| outcome.remaining.clone());
                        return Ok(Found { start, end, without, outcome, all, problem, settings, sampling_lag });
                    }
                    Err(name) => name,
                }
            }
        };
        match refused.len() < MAX_REFUSED {
            true => refused.push(wrong),
            // After so many refusals no name is worth trusting.
            false => settings.max_steps = 0,
        }
    }
}

fn delay(model: &Model) -> Option<&ActiveEffect> {
    model.effects.iter().find(|a| a.effect.name() == DELAY)
}

struct Search<'a> {
    start: &'a Judged,
    judge: &'a Judge<'a>,
    candidates: &'a [Vec<ActiveEffect>],
    /// Whether a delay of less than half a sample is the recorder's: a controller holds its torque from one sample to the
    /// next.
    may_lag: bool,
}

impl Search<'_> {
    /// Forward selection; the model is refitted after the addition of an effect that the parameters enter nonlinearly.
    /// `all` becomes the assessment before anything was added.
    fn select(
        &self,
        stated: &Problem,
        settings: &Settings,
        all: &mut Option<Ranking>,
        progress: &mut dyn FnMut(&str),
    ) -> Result<Selection, DiagnosisError> {
        let mut stopped: Option<Result<Selection, FitError>> = None;
        let mut last: Option<(Vec<Chosen>, Judged)> = None;
        let outcome = evidence::select_with(stated, settings, |chosen, ranking| {
            all.get_or_insert_with(|| ranking.clone());
            let names: Vec<&str> = chosen.iter().map(|c| self.shape(c).effect.name()).collect();
            let is_lag = self.may_lag && names.last() == Some(&DELAY);
            if !is_lag && !chosen.iter().any(|c| is_nonlinear(self.shape(c))) {
                return Ok(None);
            }
            let newest = chosen.last().map(|c| (c, self.shape(c)));
            // What takes long must be worth it at once.
            let gears = newest.filter(|(_, a)| a.has_gears()).map(|(c, a)| (c, a.effect.name()));
            if let Some((_, name)) = gears.filter(|(c, _)| !promises(ranking, c)) {
                stopped = Some(Ok(Selection::Refused(name)));
                return Err(String::new());
            }
            progress(&format!("refit with {}", names.join(", ")));
            let mut step = || -> Result<Result<Problem, Selection>, FitError> {
                let fitted = self.refit(chosen, Some(ranking))?;
                if let Some(late) = self.lag(&fitted.fit, &names) {
                    return Ok(Err(Selection::Lag(late)));
                }
                let before = last.as_ref().map_or(self.start, |(_, before)| before);
                if let Some((_, name)) = gears
                    && !self.judge.confirms(before, &fitted)?
                {
                    return Ok(Err(Selection::Refused(name)));
                }
                let next = relinearised(&fitted.fit, self.judge.fitting, stated, chosen, &names)?;
                last = Some((chosen.to_vec(), fitted));
                Ok(Ok(next))
            };
            let (stop, text) = match step() {
                Ok(Ok(next)) => return Ok(Some(next)),
                Ok(Err(selection)) => (Ok(selection), String::new()),
                Err(e) => {
                    let text = e.to_string();
                    (Err(e), text)
                }
            };
            stopped = Some(stop);
            Err(text)
        });
        if let Some(stopped) = stopped {
            return Ok(stopped?);
        }
        let outcome = outcome?;
        let chosen: Vec<Chosen> = outcome.findings.iter().map(|f| f.chosen).collect();
        let end = match last {
            _ if chosen.is_empty() => self.start.clone(),
            Some((before, fitted)) if before == chosen => fitted,
            _ => {
                progress("refit");
                self.refit(&chosen, None)?
            }
        };
        let names: Vec<&str> = chosen.iter().map(|c| self.shape(c).effect.name()).collect();
        Ok(match self.lag(&end.fit, &names) {
            Some(late) => Selection::Lag(late),
            None => Selection::Complete(Box::new((outcome, end))),
        })
    }

    /// RMS residuals without each of the effects named; or the name of one that does not stand.
    fn stand(&self, names: &[&'static str], end: &Judged) -> Result<Result<Vec<Vec<f64>>, &'static str>, FitError> {
        // A law with a definite sign must come out with it.
        let impossible = |name: &&&str| end.fit.impossible.iter().any(|p| p.split('.').next() == Some(**name));
        if let Some(name) = names.iter().find(impossible) {
            return Ok(Err(*name));
        }
        let mut all = Vec::new();
        for name in names {
            let without = match names.len() {
                1 => self.start.clone(),
                _ => self.judge.fit(&without_effects(&end.fit.model, &[name]))?,
            };
            if !self.judge.confirms(&without, end)? {
                return Ok(Err(*name));
            }
            all.push(without.rms);
        }
        Ok(Ok(all))
    }

    fn shape(&self, chosen: &Chosen) -> &ActiveEffect {
        &self.candidates[chosen.candidate][chosen.variant]
    }

    fn refit(&self, chosen: &[Chosen], ranking: Option<&Ranking>) -> Result<Judged, FitError> {
        self.judge.fit(&with_effects(&self.start.fit.model, self.candidates, chosen, ranking))
    }

    /// A delay among the effects found that is a way of recording.
    fn lag(&self, fit: &Fit, names: &[&str]) -> Option<ActiveEffect> {
        let late = delay(&fit.model).filter(|_| self.may_lag && names.contains(&DELAY))?;
        (late.values[0].abs() < 0.5 * self.judge.fitting.traces[0].dt).then(|| late.clone())
    }
}

/// A model with effects that were chosen; those that a ranking assesses begin at its estimates.
pub(super) fn with_effects(
    model: &Model,
    candidates: &[Vec<ActiveEffect>],
    chosen: &[Chosen],
    ranking: Option<&Ranking>,
) -> Model {
    let mut model = model.clone();
    for c in chosen {
        let mut active = candidates[c.candidate][c.variant].clone();
        if let Some(assessed) = ranking.and_then(|r| r.of(c.candidate)) {
            begin_at(&mut active, &assessed.coefficients);
        }
        model.effects.push(active);
    }
    model
}

/// Whether a candidate may take enough from some channel, by its columns, to be confirmed after a fit.
fn promises(ranking: &Ranking, chosen: &Chosen) -> bool {
    let rms = |squares: &[f64]| squares.iter().map(|s| s.sqrt()).collect::<Vec<_>>();
    ranking.of(chosen.candidate).is_none_or(|a| is_relevant(&rms(&ranking.sum_of_squares), &rms(&a.sum_of_squares)))
}

/// Whether the prediction is nonlinear in the effect's estimated parameters.
fn is_nonlinear(active: &ActiveEffect) -> bool {
    let shaped = active.entries().iter().any(|e| e.parameter.role == Role::Shape);
    shaped || matches!(active.effect.kind(), Kind::Geometry | Kind::Encoder)
}

/// Sets the linear parameters to estimates, as far as the law allows them.
fn begin_at(active: &mut ActiveEffect, coefficients: &[evidence::Estimate]) {
    let entries = active.entries();
    let linear = active.values.iter_mut().zip(&entries).filter(|(_, e)| e.parameter.role == Role::Linear);
    for ((value, entry), estimate) in linear.zip(coefficients) {
        *value = estimate.value.clamp(entry.parameter.range.0, entry.parameter.range.1);
    }
}

/// The problem at the parameters fitted with the chosen effects; their linear contribution is put back into y.
fn relinearised(
    fitted: &Fit,
    fitting: &Fitting,
    stated: &Problem,
    chosen: &[Chosen],
    names: &[&str],
) -> Result<Problem, FitError> {
    let traces = fitting.traces;
    let mut next =
        Problem { y: problem::residual_series(traces, &fitted.residuals), base: Vec::new(), ..stated.clone() };
    for c in chosen {
        next.candidates[c.candidate].variants[c.variant].columns.clear();
    }
    for owned in problem::owned_columns(&fitted.model, traces)? {
        if fitting.holds(&owned.column.name) {
            continue;
        }
        let Some(i) = names.iter().position(|n| *n == owned.effect) else {
            next.base.push(owned.column);
            continue;
        };
        if let Some(value) = owned.linear {
            for (y, x) in next.y.iter_mut().zip(&owned.column.values) {
                *y += value * x;
            }
        }
        next.candidates[chosen[i].candidate].variants[chosen[i].variant].columns.push(owned.column);
    }
    problem::along_edge(&mut next.base, fitted);
    Ok(next)
}

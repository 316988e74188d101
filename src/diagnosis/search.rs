//! Forward selection of effects on the robot's own model, with names that do not stand refused.
//!
//! A fit with given effects is made once, however often the selection comes back to them. When the time is up, the
//! effects that stand in the order in which they were added are the answer.

use std::cell::RefCell;
use std::rc::Rc;

use super::judge::{Judge, Judged, MIN_RELEVANCE, is_relevant};
use super::{DiagnosisError, Fitting, problem, without_effects};
use crate::effects::{ActiveEffect, Role};
use crate::evidence::{self, Chosen, Outcome, Problem, Ranking, Refit, Settings};
use crate::identification::fit::{Fit, FitError, is_nonlinear};
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
    /// Effects that the data ask for and that the time did not allow to try.
    pub not_tried: Vec<String>,
}

/// Candidates and variants that a fit holds.
type Key = Vec<(usize, usize)>;

/// Fits made so far from one start, by the effects that they hold.
#[derive(Default)]
struct Fits {
    judged: RefCell<Vec<(Key, Judged)>>,
    columns: RefCell<Vec<(Key, Rc<Vec<problem::Owned>>)>>,
}

/// What a set of effects is known by, in whatever order they were added.
fn key(chosen: &[Chosen]) -> Vec<(usize, usize)> {
    let mut key: Vec<_> = chosen.iter().map(|c| (c.candidate, c.variant)).collect();
    key.sort_unstable();
    key
}

impl Fits {
    /// The fit with `chosen`; `make` makes it if there is none yet.
    fn of<E>(&self, chosen: &[Chosen], make: impl FnOnce() -> Result<Judged, E>) -> Result<Judged, E> {
        let key = key(chosen);
        if let Some((_, known)) = self.judged.borrow().iter().find(|(k, _)| *k == key) {
            return Ok(known.clone());
        }
        let made = make()?;
        self.judged.borrow_mut().push((key, made.clone()));
        Ok(made)
    }

    /// Columns of all parameters at the fit with `chosen`.
    fn columns(&self, chosen: &[Chosen], fit: &Fit, fitting: &Fitting) -> Result<Rc<Vec<problem::Owned>>, FitError> {
        let key = key(chosen);
        if let Some((_, known)) = self.columns.borrow().iter().find(|(k, _)| *k == key) {
            return Ok(known.clone());
        }
        let made = Rc::new(problem::owned_columns(&fit.model, fitting.traces)?);
        self.columns.borrow_mut().push((key, made.clone()));
        Ok(made)
    }
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
    let mut fits = Fits::default();
    loop {
        let mut stated = problem.clone();
        for c in &mut stated.candidates {
            if refused.contains(&c.name.as_str()) || (lags && c.name == DELAY) {
                c.variants.clear();
            }
        }
        progress("evidence");
        let search = Search { start: &start, judge, candidates, may_lag: may_lag && !lags, fits: &fits };
        let wrong = match search.select(&stated, &settings, &mut all, progress)? {
            Selection::Lag(late) => {
                lags = true;
                let mut model = start.fit.model.clone();
                model.effects.push(late);
                start = judge.fit(&model)?;
                fits = Fits::default();
                if !fitting.is_late() {
                    problem = fitting.problem(&start.fit, candidates)?;
                }
                continue;
            }
            Selection::Refused(name) => name,
            Selection::Complete(complete) => {
                let (mut outcome, mut end) = *complete;
                let sampling_lag = delay(&end.fit.model).filter(|_| lags).map(|late| late.values[0]);
                if sampling_lag.is_some_and(|late| late.abs() >= 0.5 * dt) {
                    // Beside what else was found it is a delay.
                    (lags, may_lag) = (false, false);
                    (start, problem) = alone.clone();
                    fits = Fits::default();
                    continue;
                }
                let chosen: Vec<Chosen> = outcome.findings.iter().map(|f| f.chosen).collect();
                let judged = if outcome.cut_short || fitting.is_late() {
                    let standing = search.longest_standing(&chosen)?;
                    end = standing.0;
                    outcome.findings.truncate(standing.1.len());
                    Ok(standing.1)
                } else {
                    search.stand(&chosen, &end)?
                };
                match judged {
                    Ok(without) => {
                        let all = all.unwrap_or_else(|| outcome.remaining.clone());
                        let not_tried = match outcome.cut_short {
                            true => untried(&outcome, &chosen[without.len()..], candidates, &settings),
                            false => Vec::new(),
                        };
                        return Ok(Found {
                            start,
                            end,
                            without,
                            outcome,
                            all,
                            problem,
                            settings,
                            sampling_lag,
                            not_tried,
                        });
                    }
                    Err(name) => name,
                }
            }
        };
        progress(&format!("without {wrong}"));
        match refused.len() < MAX_REFUSED {
            true => refused.push(wrong),
            // After so many refusals no name is worth trusting.
            false => settings.max_steps = 0,
        }
    }
}

/// Names of what an outcome that was cut short leaves open: `unjudged` effects, and candidates that still pass.
fn untried(
    outcome: &Outcome,
    unjudged: &[Chosen],
    candidates: &[Vec<ActiveEffect>],
    settings: &Settings,
) -> Vec<String> {
    let ranking = &outcome.remaining;
    let passing = ranking.order.iter().map(|&i| &ranking.candidates[i]).filter(|a| a.passes(settings));
    let unjudged = unjudged.iter().map(|c| candidates[c.candidate][0].effect.name().to_string());
    unjudged.chain(passing.map(|a| a.name.clone())).collect()
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
    fits: &'a Fits,
}

impl Search<'_> {
    /// Forward selection; the model is refitted after every addition if any parameter enters its prediction nonlinearly: the
    /// error of an old linearisation looks like further effects.
    /// `all` becomes the assessment before anything was added.
    fn select(
        &self,
        stated: &Problem,
        settings: &Settings,
        all: &mut Option<Ranking>,
        progress: &mut dyn FnMut(&str),
    ) -> Result<Selection, DiagnosisError> {
        let mut stopped: Option<Selection> = None;
        let mut last: Option<(Vec<Chosen>, Judged)> = None;
        let fitting = self.judge.fitting;
        let outcome = evidence::select_with(stated, settings, &|| fitting.is_late(), |chosen, ranking| {
            all.get_or_insert_with(|| ranking.clone());
            let names: Vec<&str> = chosen.iter().map(|c| self.shape(c).effect.name()).collect();
            let is_lag = self.may_lag && names.last() == Some(&DELAY);
            let model = with_effects(&self.start.fit.model, self.candidates, chosen, None);
            if !is_lag && !is_nonlinear(&model) {
                fitting.has_tried();
                return Ok(Refit::Same);
            }
            let newest = chosen.last().map(|c| (c, self.shape(c)));
            let refused = newest.map_or("", |(_, a)| a.effect.name());
            // What takes long must be worth it at once.
            let gears = newest.filter(|(_, a)| a.has_gears()).map(|(c, _)| c);
            progress(&format!("refit with {}", names.join(", ")));
            let mut step = || -> Result<Result<Problem, Selection>, FitError> {
                if gears.is_some_and(|c| !promises(ranking, c)) {
                    return Ok(Err(Selection::Refused(refused)));
                }
                let fitted = self.refit(chosen, Some(ranking))?;
                if let Some(late) = self.lag(&fitted.fit, &names) {
                    return Ok(Err(Selection::Lag(late)));
                }
                let before = last.as_ref().map_or(self.start, |(_, before)| before);
                if gears.is_some() && !self.judge.confirms(before, &fitted)? {
                    return Ok(Err(Selection::Refused(refused)));
                }
                let next = self.relinearised(&fitted.fit, stated, chosen, &names)?;
                last = Some((chosen.to_vec(), fitted));
                Ok(Ok(next))
            };
            let made = step();
            fitting.has_tried();
            // Where the data lead to a machine that cannot be, the newest effect is not what they show.
            let selection = match made {
                Ok(Ok(next)) => return Ok(Refit::New(Box::new(next))),
                Ok(Err(selection)) => selection,
                Err(_) => Selection::Refused(refused),
            };
            if fitting.is_late() && matches!(selection, Selection::Refused(_)) {
                return Ok(Refit::Withdraw);
            }
            stopped = Some(selection);
            Err(String::new())
        });
        if let Some(stopped) = stopped {
            return Ok(stopped);
        }
        let outcome = outcome?;
        let chosen: Vec<Chosen> = outcome.findings.iter().map(|f| f.chosen).collect();
        let end = match last {
            _ if chosen.is_empty() => self.start.clone(),
            Some((before, fitted)) if before == chosen => fitted,
            _ => {
                let names: Vec<&str> = chosen.iter().map(|c| self.shape(c).effect.name()).collect();
                progress(&format!("refit with {}", names.join(", ")));
                match (self.refit(&chosen, None), chosen.last()) {
                    (Ok(end), _) => end,
                    (Err(_), Some(newest)) => return Ok(Selection::Refused(self.shape(newest).effect.name())),
                    (Err(e), None) => return Err(e.into()),
                }
            }
        };
        let names: Vec<&str> = chosen.iter().map(|c| self.shape(c).effect.name()).collect();
        Ok(match self.lag(&end.fit, &names) {
            Some(late) => Selection::Lag(late),
            None => Selection::Complete(Box::new((outcome, end))),
        })
    }

    /// RMS residuals without each of the effects chosen; or the name of one that does not stand.
    fn stand(&self, chosen: &[Chosen], end: &Judged) -> Result<Result<Vec<Vec<f64>>, &'static str>, FitError> {
        let name = |c: &Chosen| self.shape(c).effect.name();
        if let Some(c) = chosen.iter().find(|c| is_impossible(&end.fit, name(c))) {
            return Ok(Err(name(c)));
        }
        let mut all = Vec::new();
        for c in chosen {
            let others: Vec<Chosen> = chosen.iter().copied().filter(|other| other != c).collect();
            let make = || self.judge.fit(&without_effects(&end.fit.model, &[name(c)]));
            let without = if others.is_empty() { Ok(self.start.clone()) } else { self.fits.of(&others, make) };
            match without {
                Ok(without) if self.judge.confirms(&without, end)? => all.push(without.rms),
                _ => return Ok(Err(name(c))),
            }
        }
        Ok(Ok(all))
    }

    /// The fit with as many of the effects chosen, in their order, as stand given those before, and the RMS residuals
    /// before each of them was added.
    fn longest_standing(&self, chosen: &[Chosen]) -> Result<(Judged, Vec<Vec<f64>>), FitError> {
        let (mut end, mut without) = (self.start.clone(), Vec::new());
        for (k, c) in chosen.iter().enumerate() {
            let Ok(next) = self.refit(&chosen[..=k], None) else { break };
            if is_impossible(&next.fit, self.shape(c).effect.name()) || !self.judge.confirms(&end, &next)? {
                break;
            }
            without.push(std::mem::replace(&mut end, next).rms);
        }
        Ok((end, without))
    }

    fn shape(&self, chosen: &Chosen) -> &ActiveEffect {
        &self.candidates[chosen.candidate][chosen.variant]
    }

    fn refit(&self, chosen: &[Chosen], ranking: Option<&Ranking>) -> Result<Judged, FitError> {
        let make = || self.judge.fit(&with_effects(&self.start.fit.model, self.candidates, chosen, ranking));
        self.fits.of(chosen, make)
    }

    /// A delay among the effects found that is a way of recording.
    fn lag(&self, fit: &Fit, names: &[&str]) -> Option<ActiveEffect> {
        let late = delay(&fit.model).filter(|_| self.may_lag && names.contains(&DELAY))?;
        (late.values[0].abs() < 0.5 * self.judge.fitting.traces[0].dt).then(|| late.clone())
    }

    /// The problem at the parameters fitted with the chosen effects; their linear contribution is put back into y.
    fn relinearised(
        &self,
        fitted: &Fit,
        stated: &Problem,
        chosen: &[Chosen],
        names: &[&str],
    ) -> Result<Problem, FitError> {
        let fitting = self.judge.fitting;
        let mut next = Problem {
            y: problem::residual_series(fitting.traces, &fitted.residuals),
            base: Vec::new(),
            ..stated.clone()
        };
        for c in chosen {
            next.candidates[c.candidate].variants[c.variant].columns.clear();
        }
        for owned in self.fits.columns(chosen, fitted, fitting)?.iter() {
            if fitting.holds(&owned.column.name) {
                continue;
            }
            let Some(i) = names.iter().position(|n| *n == owned.effect) else {
                next.base.push(owned.column.clone());
                continue;
            };
            if let Some(value) = owned.linear {
                for (y, x) in next.y.iter_mut().zip(&owned.column.values) {
                    *y += value * x;
                }
            }
            next.candidates[chosen[i].candidate].variants[chosen[i].variant].columns.push(owned.column.clone());
        }
        problem::along_edge(&mut next.base, fitted);
        Ok(next)
    }
}

/// Whether an effect has a value that its law does not allow: a law with a definite sign must come out with it.
fn is_impossible(fit: &Fit, name: &str) -> bool {
    fit.impossible.iter().any(|p| p.effect == name)
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

/// Sets the linear parameters to estimates, as far as the law allows them.
fn begin_at(active: &mut ActiveEffect, coefficients: &[evidence::Estimate]) {
    let entries = active.entries();
    let linear = active.values.iter_mut().zip(&entries).filter(|(_, e)| e.parameter.role == Role::Linear);
    for ((value, entry), estimate) in linear.zip(coefficients) {
        *value = estimate.value.clamp(entry.parameter.range.0, entry.parameter.range.1);
    }
}

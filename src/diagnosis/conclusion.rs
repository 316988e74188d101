//! Interpretation of the outcome of a search: named effects, their posterior probabilities, indistinguishable sets
//! and the verdict.

use std::sync::Arc;

use super::DiagnosisError;
use super::alone::Alone;
use super::answer::{Diagnosis, Named, Verdict};
use super::budget::{Budget, changes};
use super::candidates;
use super::confidence::Confidence;
use super::experiment::NextExperiment;
use super::judge::{Judge, Judged, relative_energy};
use super::left::Left;
use super::search::lag::TIMES;
use super::search::{Found, without_effects};
use super::unknown::{self, Unexplained};
use super::{missing, problem};
use crate::effects::{self, ActiveEffect};
use crate::evidence::Finding;
use crate::identification::fit::{Estimate, Fit, FitError};
use crate::identification::{Dataset, NoiseLevel};
use crate::model::Model;

/// Share of the explainable error left by the named effects above which an unknown effect is concluded.
const MAX_LEFT: f64 = 0.5;

/// Share of the explainable error that named effects must leave, to a formula or unexplained, to lower their probability.
const LEAVES_MORE: f64 = 0.1;

/// Share of the time over which the angles are smoothed below which the effects on the time of the torques look alike.
const HIDDEN: f64 = 0.25;

/// Share of the error by which effects found anew next to a formula may leave more than those found before it.
const HARDLY_MORE: f64 = 0.02;

/// Conclusion about the model.
pub(super) struct Conclusion {
    pub verdict: Verdict,
    /// Missing effects, in the order found.
    pub effects: Vec<Named>,
    /// Sets of effects that the data cannot distinguish, each starting with the one that was found.
    pub indistinguishable: Vec<Vec<String>>,
    /// The model with all found effects, and its residuals on the validation data.
    pub end: Judged,
    /// Error that no known effect explains.
    pub unexplained: Option<Unexplained>,
    /// Effects and steps not tried for lack of time.
    pub not_tried: Vec<String>,
    /// Share of the explainable error that they leave on the validation data.
    left: f64,
    /// Whether the residual on the validation data exceeds the noise clearly.
    is_more_than_noise: bool,
    /// Whether what is left above the noise is noise with a memory.
    pub leaves_noise: bool,
    /// Of effects found next to a formula, the fit without either, and their shares of the explainable error with the formula.
    without_formula: Option<(Judged, Vec<f64>)>,
}

impl Conclusion {
    /// Conclusion from the outcome of a search.
    pub fn new(found: &Found, judge: &Judge) -> Result<Self, DiagnosisError> {
        let effects = named(found, &judge.floor)?;
        let indistinguishable = indistinguishable(found, judge.fitting.datasets);
        let leaves_more = judge.leaves_more(&found.end);
        let is_more_than_noise = judge.is_more_than_noise(found.end.rms());
        let left = left([found.start.rms(), found.end.rms(), &judge.floor]);
        let verdict = match effects.len() {
            n if leaves_more && (n == 0 || left > MAX_LEFT) => Verdict::Unknown,
            n => verdict_of_names(n, !indistinguishable.is_empty()),
        };
        let (end, mut not_tried) = (found.end.clone(), found.not_tried.clone());
        if judge.fitting.was_stopped() {
            not_tried.push("the last steps of a fit".into());
        }
        // What was not tried may explain what is left.
        let is_open = !not_tried.is_empty() && matches!(verdict, Verdict::None | Verdict::Unknown);
        let verdict = if is_open { Verdict::Undecided } else { verdict };
        Ok(Self {
            verdict,
            effects,
            indistinguishable,
            end,
            unexplained: None,
            not_tried,
            left,
            is_more_than_noise,
            leaves_noise: false,
            without_formula: None,
        })
    }

    /// Replaces or supplements the named effects by a formula that explains more, if there is one.
    pub fn revise(&mut self, unexplained: Option<Unexplained>) {
        self.unexplained = unexplained;
        let Some(formula) = self.unexplained.as_ref().filter(|u| u.replaces) else { return };
        // Named effects are kept only if they add to it.
        if !formula.beside_named {
            self.effects.clear();
            self.indistinguishable.clear();
        }
        self.end = Judged { fit: formula.fit.clone(), residuals: Arc::clone(&formula.residuals) };
        self.verdict = Verdict::Unknown;
    }

    /// The fit with a formula that explains what no known effect does, without names, if more than noise is left next to it.
    pub fn formula_alone(&self, judge: &Judge) -> Option<Fit> {
        let formula = self.unexplained.as_ref().filter(|formula| formula.replaces)?;
        let names: Vec<&str> = self.effects.iter().map(|named| named.name.as_str()).collect();
        match names[..] {
            [] => judge.is_more_than_noise(self.end.rms()).then(|| formula.fit.clone()),
            // They may have stood for the unknown law.
            _ => judge.fitting.fit(&without_effects(&formula.fit.model, &names)).ok(),
        }
    }

    /// Whether effects that were found `anew`, next to the formula, leave hardly more than what is named so far.
    pub fn is_as_well(&self, anew: &Found, judge: &Judge) -> bool {
        let energy = |judged: &Judged| relative_energy(judged.rms(), &judge.floor);
        !anew.outcome.findings.is_empty() && energy(&anew.end) <= (1.0 + HARDLY_MORE) * energy(&self.end)
    }

    /// Names the effects that were found `anew`, next to the formula, and gives their outcome; `start` is the fit without either,
    /// with the recorder's delay `sampling_lag` if there is one.
    ///
    /// # Errors
    /// If the statistics fail.
    pub fn name_next_to_formula(
        &mut self,
        (start, sampling_lag): (Judged, Option<f64>),
        anew: Found,
        judge: &Judge,
    ) -> Result<Found, DiagnosisError> {
        self.effects = named(&anew, &judge.floor)?;
        self.indistinguishable = indistinguishable(&anew, judge.fitting.datasets);
        self.end = anew.end.clone();
        self.is_more_than_noise = judge.is_more_than_noise(self.end.rms());
        self.not_tried.extend(anew.not_tried.iter().cloned());
        if let Some(formula) = self.unexplained.as_mut() {
            formula.join_names(&self.end);
        }
        let share = |without: &Vec<f64>| explained(start.rms(), without, self.end.rms(), &judge.floor);
        let shares = anew.without.iter().map(share).collect();
        self.without_formula = Some((start, shares));
        Ok(Found { sampling_lag, ..anew })
    }

    /// Where neither a known effect nor a formula explains what is left and it is not related to the motion, it is noise: the
    /// names stand without it, or nothing is missing. The same holds without names where the fitted recordings do not determine
    /// the parameters.
    ///
    /// # Errors
    /// If a pose is impossible for the model.
    pub fn weigh_the_rest(&mut self, found: &Found, judge: &Judge) -> Result<(), FitError> {
        let leaves_more = self.left > LEAVES_MORE || self.verdict == Verdict::Unknown;
        let is_open = self.is_more_than_noise && leaves_more && self.unexplained.is_none();
        let is_extrapolated = is_open && judge.is_extrapolated(&self.end);
        self.leaves_noise = is_open && !is_extrapolated && !unknown::is_related(&self.end, judge)?;
        if self.leaves_noise {
            // The error to be explained is that above this noise.
            let share = |without: &Vec<f64>| explained(found.start.rms(), without, self.end.rms(), self.end.rms());
            self.effects.iter_mut().zip(&found.without).for_each(|(named, without)| named.explained = share(without));
        }
        let is_no_law = self.leaves_noise || (is_extrapolated && self.effects.is_empty());
        if is_no_law && self.verdict == Verdict::Unknown {
            self.verdict = verdict_of_names(self.effects.len(), !self.indistinguishable.is_empty());
        }
        Ok(())
    }

    /// Sets the parameters of the named effects from the final model and their probabilities from the final verdict. With
    /// a step left out for lack of time, a search without a finding is not an answer.
    pub fn settle(&mut self) {
        if self.verdict == Verdict::None && !self.not_tried.is_empty() {
            self.verdict = Verdict::Undecided;
        }
        // What a formula explains more, or nothing does, stands for another law: the names have the share that they explain.
        let unexplained = if self.is_more_than_noise && !self.leaves_noise { self.left } else { 0.0 };
        let certain = share_of_names(self.unexplained.as_ref().map_or(unexplained, |formula| formula.left));
        for named in &mut self.effects {
            // With an unknown effect present, the probability of a name is limited by its explained share.
            let is_open = matches!(self.verdict, Verdict::Unknown | Verdict::Undecided);
            named.confidence.doubt(if is_open { named.explained } else { certain });
            named.parameters = parameters_of(&self.end.fit, &named.name);
        }
        // Next to a formula a name is as likely as what it explains of the rest; it is measured by the whole error.
        let shares = self.without_formula.iter().flat_map(|(_, shares)| shares);
        self.effects.iter_mut().zip(shares).for_each(|(named, share)| named.explained = *share);
    }

    /// Whether a formula is in the final model.
    fn has_formula(&self) -> bool {
        self.unexplained.as_ref().is_some_and(|u| u.replaces)
    }

    /// Error budget of the effects added one after another, followed by the formula if it is part of the model.
    fn budget(&self, start: &Judged, judge: &Judge) -> Result<Budget, FitError> {
        let mut added: Vec<&str> = self.effects.iter().map(|e| e.name.as_str()).collect();
        added.extend(self.has_formula().then_some(effects::formula::NAME));
        let mut stages = Vec::new();
        for (i, name) in added.iter().enumerate() {
            let later = &added[i + 1..];
            let rms = match later.is_empty() {
                true => self.end.rms().to_vec(),
                false => judge.fit(&without_effects(&self.end.fit.model, later))?.rms().to_vec(),
            };
            stages.push((name.to_string(), rms));
        }
        Ok(judge.budget(start.rms().to_vec(), stages))
    }

    /// Result of the diagnosis: the conclusion with intermediate results.
    pub fn answer(
        mut self,
        found: Found,
        left: Left,
        next_experiment: Option<NextExperiment>,
        (mounted, absent): (&Model, &[Vec<ActiveEffect>]),
        judge: &Judge,
    ) -> Result<Diagnosis, DiagnosisError> {
        let start = self.without_formula.take().map_or_else(|| found.start.clone(), |(start, _)| start);
        let budget = self.budget(&start, judge)?;
        let candidates = candidates::reports(&found, &self.effects, &self.indistinguishable);
        let alone = Alone::of(&found, absent, &candidates, judge.fitting)?;
        let twin_only: Vec<String> = missing::untestable(mounted).into_iter().map(|e| e.name().into()).collect();
        let unseen = unseen(&found, &twin_only);
        let [rms_before, rms_after] = [&start, &self.end].map(|judged| judged.rms().to_vec());
        let datasets = judge.fitting.datasets;
        let level = NoiseLevel::of(&self.end.fit.model, datasets);
        let repeats = level.with_repeats(datasets, &self.end.fit.residuals).1;
        let (start, end) = (start.fit, self.end.fit);
        let mut model = end.model.clone();
        model.history.extend(budget.history());
        Ok(Diagnosis {
            verdict: self.verdict,
            channels: budget.channels.clone(),
            noise_floor: judge.floor.clone(),
            rms_before,
            rms_after,
            effects: self.effects,
            candidates,
            alone,
            indistinguishable: self.indistinguishable,
            unseen_parameters: problem::not_excited(&found.problem, &unseen),
            unseen,
            twin_only,
            next_experiment,
            budget,
            changes: changes(&start, &end),
            parameters: [start.parameters, end.parameters],
            covariance: end.covariance,
            left,
            repeats,
            too_few: found.all.too_few,
            is_work_spent: !self.not_tried.is_empty() && judge.fitting.is_work_spent(),
            smoothing: datasets.iter().filter_map(Dataset::smoothing).reduce(f64::max),
            not_tried: self.not_tried,
            unexplained: self.unexplained,
            sampling_lag: found.sampling_lag,
            model,
            work: judge.fitting.work(),
        })
    }
}

/// Factor of the probability of names that leave the share `left` of the explainable error.
fn share_of_names(left: f64) -> f64 {
    if left >= LEAVES_MORE { 1.0 - left.min(1.0) } else { 1.0 }
}

/// Names of the effects that the data could not reveal at their usual size, those that exist in the twin only last.
fn unseen(found: &Found, twin_only: &[String]) -> Vec<String> {
    let named = found.outcome.found();
    let hidden = found.all.candidates.iter().filter(|a| !a.is_revealed(&found.settings));
    let unnamed = hidden.filter(|a| !named.contains(&a.candidate)).map(|a| a.name.clone());
    unnamed.chain(twin_only.iter().cloned()).collect()
}

/// The found effects, each with its posterior probabilities and its share of the explainable error.
fn named(found: &Found, floor: &[f64]) -> Result<Vec<Named>, DiagnosisError> {
    let last = found.outcome.refitted.as_ref().unwrap_or(&found.problem);
    let one = |(finding, without): (&Finding, &Vec<f64>)| {
        let problem = finding.problem.as_deref().unwrap_or(last);
        Ok(Named {
            name: problem.candidates[finding.chosen.candidate].name.clone(),
            confidence: Confidence::of(finding, problem, &found.settings)?,
            explained: explained(found.start.rms(), without, found.end.rms(), floor),
            parameters: Vec::new(),
        })
    };
    found.outcome.findings.iter().zip(&found.without).map(one).collect()
}

/// Sets of more than one effect that the data cannot distinguish.
fn indistinguishable(found: &Found, datasets: &[Dataset]) -> Vec<Vec<String>> {
    let candidates = &found.problem.candidates;
    let smoothing = datasets.iter().filter_map(Dataset::smoothing).fold(0.0, f64::max);
    let is_hidden = |name: &str| {
        let active = found.end.fit.model.effects.iter().find(|a| a.effect.name() == name);
        TIMES.contains(&name) && active.is_some_and(|a| a.values[0].abs() < HIDDEN * smoothing)
    };
    let set = |finding: &Finding| {
        let own = &candidates[finding.chosen.candidate].name;
        let rivals = finding.ranking.confidence_set().into_iter().map(|a| &a.name).filter(|name| *name != own);
        let mut set: Vec<String> = std::iter::once(own).chain(rivals).cloned().collect();
        if is_hidden(own) {
            let others = candidates.iter().map(|c| &c.name).filter(|name| TIMES.contains(&name.as_str()));
            let others: Vec<String> = others.filter(|name| !set.contains(name)).cloned().collect();
            set.extend(others);
        }
        set
    };
    found.outcome.findings.iter().map(set).filter(|set| set.len() > 1).collect()
}

/// Share of the excess of the RMS residuals `before` over the noise floor that is left `after`.
fn left([before, after, floor]: [&[f64]; 3]) -> f64 {
    let excess = |rms: &[f64]| relative_energy(rms, floor) - floor.len() as f64;
    excess(after) / excess(before).max(f64::MIN_POSITIVE)
}

/// Verdict where everything but noise is explained by `named` effects.
fn verdict_of_names(named: usize, is_ambiguous: bool) -> Verdict {
    match named {
        0 => Verdict::None,
        _ if is_ambiguous => Verdict::Ambiguous,
        1 => Verdict::Effect,
        _ => Verdict::Several,
    }
}

/// Least noise relative to its estimate, so that a model without error divides by more than zero.
const LEAST: f64 = 1e-6;

/// Difference of the shares of the explainable error between `without` and `with`.
///
/// All arguments are RMS residuals per channel on the same data; the explainable error is the part of `before` above the
/// noise `floor`, or above what `with` leaves where that is less: the floor is an estimate, and fast effects raise it.
pub(super) fn explained(before: &[f64], without: &[f64], with: &[f64], floor: &[f64]) -> f64 {
    let floor = &floor.iter().zip(with).map(|(floor, with)| floor.min(with.max(LEAST * floor))).collect::<Vec<_>>()[..];
    let explainable = relative_energy(before, floor) - floor.len() as f64;
    if explainable <= 0.0 {
        return 0.0;
    }
    ((relative_energy(without, floor) - relative_energy(with, floor)) / explainable).clamp(0.0, 1.0)
}

/// Estimates of one effect's parameters, without the effect's name as prefix.
pub fn parameters_of(fit: &Fit, effect: &str) -> Vec<Estimate> {
    own_parameters(&fit.parameters, effect)
}

/// The estimates among `all` of one effect's parameters, without the effect's name as prefix.
pub(super) fn own_parameters(all: &[Estimate], effect: &str) -> Vec<Estimate> {
    let short = |p: &Estimate| p.name.split_once('.').map_or(p.name.clone(), |(_, name)| name.into());
    let own = all.iter().filter(|p| p.param.effect == effect);
    own.map(|p| Estimate { name: short(p), ..p.clone() }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_less_likely_where_a_tenth_is_left() {
        assert_eq!(share_of_names(0.09), 1.0);
        approx::assert_relative_eq!(share_of_names(0.2), 0.8);
    }

    #[test]
    fn noise_is_no_more_than_what_is_left() {
        // Above the noise are 4 - 1 before and 2.5 - 1 without; a floor of 3 is too high.
        let of = |floor: f64, with: f64| explained(&[2.0], &[2.5f64.sqrt()], &[with], &[floor]);
        approx::assert_relative_eq!(of(1.0, 1.0), 0.5);
        approx::assert_relative_eq!(of(3.0, 1.0), 0.5);
        approx::assert_relative_eq!(of(1.0, 0.0), 2.5 / 4.0, epsilon = 1e-9);
    }
}

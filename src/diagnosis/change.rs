//! What has changed in a machine since it was healthy.
//!
//! [`super::diagnose`] refits every parameter, so an effect of the model whose parameter has grown leaves no trace in
//! it. Here the healthy recordings determine the parameters, and the candidates act in the later recordings only: each
//! effect of the model with a change of its linear parameters, and each effect that the model lacks. In
//! y = Y·θ + Z·c·1(later) + ε the columns Y of the model's parameters extend over both, so what the model gets wrong in
//! both alike is no change.

use super::fitting::{Fitting, Options};
use super::judge::MIN_RELEVANCE;
use super::search::with_effects;
use super::{DiagnosisError, check, conclusion, missing, problem};
use crate::dynamics::in_configuration;
use crate::effects::{ActiveEffect, rigid_bodies};
use crate::evidence::{self, Assessment, Chosen, Finding, Settings};
use crate::identification::fit::{Estimate, Options as FitOptions, fit_with};
use crate::identification::{Dataset, NoiseLevel, Residuals};
use crate::machine::Unit;
use crate::model::Model;
use crate::recording::Channel;

/// Largest number of changes named.
const MAX_CHANGES: usize = 3;
/// Relevance from which a change is named, in that of a missing effect: parameters that the healthy recordings
/// determine leave smaller changes visible.
const RELEVANCE: f64 = 0.3;

/// Least relevance of a further change relative to that of the largest: a smaller one may come from where the columns,
/// linear in the parameters, do not follow the largest one.
const LEAST_SHARE: f64 = 0.1;

/// A parameter before and after.
#[derive(Clone, Debug, PartialEq)]
pub struct Shift {
    /// Its name within the effect.
    pub name: String,
    /// Unit.
    pub unit: Unit,
    /// Healthy value.
    pub before: f64,
    /// Present value.
    pub after: f64,
    /// Standard error of the present value; infinite if the data do not determine it individually.
    pub std: f64,
}

/// An effect that has changed or appeared.
#[derive(Clone, Debug, PartialEq)]
pub struct Cause {
    /// Its name.
    pub name: String,
    /// Whether the model had it before, so that only its parameters have changed.
    pub was_present: bool,
    /// Probability of a statistic as large by chance, over all candidates.
    pub p_value: f64,
    /// Effects that the data do not distinguish from it.
    pub rivals: Vec<String>,
    /// Its parameters.
    pub parameters: Vec<Shift>,
}

/// What has changed.
#[derive(Clone)]
pub struct Changed {
    /// Channels, in the order of the following arrays.
    pub channels: Vec<Channel>,
    /// Standard deviation of the sensor noise, N·m or N.
    pub noise_floor: Vec<f64>,
    /// RMS residual of the healthy model on the later data, N·m or N; on held-out data where given.
    pub rms_before: Vec<f64>,
    /// The same with the changes.
    pub rms_after: Vec<f64>,
    /// Changes in the order found; empty if nothing of the library has changed.
    pub causes: Vec<Cause>,
    /// The healthy model with the changes.
    pub model: Model,
}

impl Changed {
    /// Share of the error above the noise that the changes explain, on the data of `rms_before`.
    pub fn explained(&self) -> f64 {
        conclusion::explained(&self.rms_before, &self.rms_before, &self.rms_after, &self.noise_floor)
    }
}

/// Changes of the machine of `model` from the recordings `healthy` to the recordings `later`, validated on `held_out`
/// where given. Of `options` the clock counts: when the time is up, no fit goes on.
///
/// # Errors
/// As [`super::diagnose`].
pub fn changed(
    model: &Model,
    healthy: &[Dataset],
    later: &[Dataset],
    held_out: &[Dataset],
    options: &Options,
) -> Result<Changed, DiagnosisError> {
    check(healthy, later)?;
    check(later, held_out)?;
    let fit = Fitting::new(model, healthy, options).fit(model)?;
    let all: Vec<Dataset> = healthy.iter().chain(later).cloned().collect();
    let both = Fitting::new(model, &all, options);
    let mounted = in_configuration(model, &later[0].setup);
    let absent = missing::testable(&mounted, &fit, &all, &[]);
    let problem = both.change(&fit.model, healthy.len(), &absent)?;
    let settings = Settings {
        min_relevance: RELEVANCE * MIN_RELEVANCE * (problem::block(&all) as f64).sqrt(),
        max_steps: MAX_CHANGES,
        ..Settings::default()
    };
    let outcome = evidence::select(&problem, &settings)?;
    if let Some(few) = outcome.remaining.too_few {
        return Err(DiagnosisError::TooFew(few));
    }
    let findings = worthwhile(outcome.findings);
    let names: Vec<&str> = problem.candidates.iter().map(|c| c.name.as_str()).collect();
    let (present, estimates) = refit(&fit.model, &findings, (&names, &absent), later)?;
    let shifts = [fit.parameters.as_slice(), &estimates];
    let causes = findings.iter().map(|finding| cause(finding, &names, shifts)).collect();
    let judged = if held_out.is_empty() { later } else { held_out };
    let rms = |model: &Model| Residuals::new(model, judged).map(|residuals| residuals.rms);
    Ok(Changed {
        channels: judged[0].channels.clone(),
        noise_floor: NoiseLevel::of(model, judged).pooled,
        rms_before: rms(&fit.model)?,
        rms_after: rms(&present)?,
        causes,
        model: present,
    })
}

/// The findings of at least [`LEAST_SHARE`] of the largest relevance.
fn worthwhile(mut findings: Vec<Finding>) -> Vec<Finding> {
    let relevance = |f: &Finding| f.ranking.of(f.chosen.candidate).map_or(0.0, Assessment::max_relevance);
    let largest = findings.iter().map(relevance).fold(0.0, f64::max);
    findings.retain(|f| relevance(f) >= LEAST_SHARE * largest);
    findings
}

/// The model with the found effects alone fitted to the later recordings, all else as in the healthy machine, and their
/// estimates.
fn refit(
    healthy: &Model,
    findings: &[Finding],
    (names, absent): (&[&str], &[Vec<ActiveEffect>]),
    later: &[Dataset],
) -> Result<(Model, Vec<Estimate>), DiagnosisError> {
    // Candidates that the model lacks follow those that it has.
    let own = names.len() - absent.len();
    let lacking = findings.iter().map(|f| f.chosen).filter(|c| c.candidate >= own);
    let chosen: Vec<Chosen> = lacking.map(|c| Chosen { candidate: c.candidate - own, ..c }).collect();
    let model = with_effects(healthy, absent, &chosen, None);
    let found: Vec<&str> = findings.iter().map(|f| names[f.chosen.candidate]).collect();
    let parameters = later[0].plant(&model).parameters();
    let mut fixed: Vec<String> = parameters.iter().map(|p| p.param.effect.to_string()).collect();
    fixed.retain(|effect| !found.contains(&effect.as_str()));
    fixed.dedup();
    if found.is_empty() {
        return Ok((model, Vec::new()));
    }
    let noise = NoiseLevel::of(&model, later);
    let fit = fit_with(&model, later, &noise.of_each, &FitOptions { fixed: &fixed, ..FitOptions::default() })?;
    Ok((fit.model, fit.parameters))
}

fn cause(finding: &Finding, names: &[&str], [before, after]: [&[Estimate]; 2]) -> Cause {
    let name = names[finding.chosen.candidate];
    let own = finding.ranking.of(finding.chosen.candidate);
    let rivals = finding.ranking.confidence_set().into_iter().map(|a| a.name.clone()).filter(|n| n != name);
    let healthy = conclusion::own_parameters(before, name);
    let shift = |p: Estimate| Shift {
        before: healthy.iter().find(|h| h.name == p.name).map_or(0.0, |h| h.value),
        name: p.name,
        unit: p.unit,
        after: p.value,
        std: p.std,
    };
    Cause {
        name: name.into(),
        was_present: !healthy.is_empty(),
        p_value: own.map_or(1.0, |a| a.p_adjusted),
        rivals: rivals.collect(),
        parameters: conclusion::own_parameters(after, name).into_iter().map(shift).collect(),
    }
}

/// Whether a change of the effect is a candidate: masses and geometry do not change by themselves, and a changed payload
/// is an effect of its own.
pub(super) fn can_change(effect: &str) -> bool {
    effect != rigid_bodies::NAME
}

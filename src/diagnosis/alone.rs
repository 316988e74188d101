//! What each candidate explains as the only addition, at every moment: predictions by the first-order estimates of the ranking.

use std::collections::HashMap;

use nalgebra::{Matrix2, Vector2};

use super::candidates::{CandidateReport, Standing};
use super::fitting::Fitting;
use super::problem;
use super::search::Found;
use crate::dynamics::{Plant, in_configuration, set_parameters};
use crate::effects::{ActiveEffect, Role};
use crate::evidence::{Assessment, dot};
use crate::identification::fit::FitError;
use crate::identification::{Dataset, Residuals};
use crate::machine::Setup;
use crate::model::Model;

/// Most candidates with a model of their own.
const MOST: usize = 8;
/// Least share of the error that a candidate explains of all fitted data: of less, the parameters that change with it explain
/// more than the candidate does.
const LEAST: f64 = 0.05;

/// Share of a linear candidate's step at which predictions are differentiated: laws that depend on strut forces multiply a
/// candidate with all other parameters, whose steps may be large in directions that the data do not determine.
const STEP: f64 = 1e-4;

/// Singular value, relative to the sum, below which two changes are one.
const SINGULAR: f64 = 1e-9;

/// The refitted model, and what it would be with one candidate at a time, to first order.
#[derive(Clone)]
pub struct Alone {
    /// The model to which candidates are added.
    pub before: Model,
    /// The step of all its parameters that the ranking makes, whose rows are whitened, before it adds a candidate.
    anew: Step,
    /// Steps to the best candidates that the data can test, in the order of
    /// [`Diagnosis::candidates`](super::Diagnosis::candidates).
    with: Vec<(String, Step)>,
    /// Noise of the channels, N·m or N.
    noise: Vec<f64>,
}

/// A step of a model.
#[derive(Clone)]
struct Step {
    /// Share of the step.
    share: f64,
    /// The model after this share. It is for predictions only: parameters may be outside their ranges.
    model: Model,
}

impl Step {
    /// Change of the residuals `before` along recordings by the whole step.
    fn change(&self, before: &Residuals, datasets: &[Dataset]) -> Result<Residuals, FitError> {
        Ok(Residuals::new(&self.model, datasets)?.minus(before).times(1.0 / self.share))
    }
}

/// Residuals with each candidate, by its name.
pub type ByCandidate<'a> = Vec<(&'a str, Residuals)>;

impl Alone {
    /// The models of the best of the reported candidates.
    pub(super) fn of(
        found: &Found,
        candidates: &[Vec<ActiveEffect>],
        reports: &[CandidateReport],
        fitting: &Fitting,
    ) -> Result<Self, FitError> {
        let before = in_configuration(&found.start.fit.model, &fitting.datasets[0].setup);
        let mut owned = match found.start.fit.edges[..] {
            [] => Vec::new(),
            _ => fitting.columns_of(&found.start.fit)?.to_vec(),
        };
        owned.retain(|o| !fitting.is_fixed(o.param));
        let followers = problem::followers(owned, &found.start.fit, found.edges);
        let is_tested = |c: &&CandidateReport| !matches!(c.standing, Standing::Untestable | Standing::InModel);
        let tested = reports.iter().filter(is_tested).filter(|c| c.explained >= LEAST);
        let changes = |of: &dyn Fn(usize) -> f64| {
            let names = found.all.base.iter().map(|b| b.name.clone()).enumerate();
            let mut changes: HashMap<String, f64> = names.map(|(k, name)| (name, of(k))).collect();
            // The last follower follows none of the others.
            for (name, factors) in followers.iter().rev() {
                let part = |(other, factor): &(String, f64)| factor * changes.get(other).unwrap_or(&0.0);
                changes.insert(name.clone(), factors.iter().map(part).sum());
            }
            changes
        };
        let anew = stepped(&before, None, &changes(&|k| found.all.base[k].value));
        let mut with = Vec::new();
        for report in tested.take(MOST) {
            let Some(assessed) = found.all.candidates.iter().find(|a| a.name == report.name) else { continue };
            let start = &candidates[assessed.candidate][assessed.variant];
            let step = stepped(&before, Some((start, assessed)), &changes(&|k| assessed.base_change[k]));
            with.push((report.name.clone(), step));
        }
        Ok(Self { before, anew, with, noise: fitting.noise.pooled.clone() })
    }

    /// Residuals of the model before along the recordings `shown`, and with each candidate in addition. Its amplitude and the
    /// one of the other parameters leave the least squares of the recordings `fitted`, in units of the noise. A candidate that
    /// cannot be predicted is left out.
    ///
    /// # Errors
    /// [`FitError::Kinematics`] if the inverse dynamics of the model before fail at a measured pose.
    pub fn residuals(&self, fitted: &[Dataset], shown: &[Dataset]) -> Result<(Residuals, ByCandidate<'_>), FitError> {
        let left = Residuals::new(&self.before, fitted)?;
        let (y, own) = (self.series(&left), self.series(&self.anew.change(&left, fitted)?));
        let before = Residuals::new(&self.before, shown)?;
        let anew = self.anew.change(&before, shown)?;
        let mut with = Vec::new();
        for (name, step) in &self.with {
            let (Ok(there), Ok(change)) = (step.change(&left, fitted), step.change(&before, shown)) else { continue };
            let Some([first, second]) = amplitudes(&y, &own, &self.series(&there)) else { continue };
            let left = before.minus(&anew.times(-first)).minus(&change.times(-second));
            if left.rms.iter().all(|rms| rms.is_finite()) {
                with.push((name.as_str(), left));
            }
        }
        Ok((before, with))
    }

    /// All residuals in units of the noise, without channels whose noise is not known.
    fn series(&self, residuals: &Residuals) -> Vec<f64> {
        let noise = self.noise.iter().enumerate().filter(|(_, n)| **n > 0.0);
        noise.flat_map(|(c, n)| residuals.channel(c).into_iter().map(move |x| x / n)).collect()
    }
}

/// Amplitudes of two changes of the residuals `y` that leave the least squares; `None` if they are not finite or both zero.
fn amplitudes(y: &[f64], first: &[f64], second: &[f64]) -> Option<[f64; 2]> {
    let normal = Matrix2::new(dot(first, first), dot(first, second), dot(second, first), dot(second, second));
    // Changes are of residuals, so that their signs are opposite to those of predictions.
    let right = -Vector2::new(dot(first, y), dot(second, y));
    let found: [f64; 2] = (normal.pseudo_inverse(SINGULAR * normal.trace()).ok()? * right).into();
    (found.iter().all(|x| x.is_finite()) && found != [0.0; 2]).then_some(found)
}

/// A step of the model `before` by `changes` of its parameters and, where given, an assessed candidate of an initial shape.
fn stepped(before: &Model, addition: Option<(&ActiveEffect, &Assessment)>, changes: &HashMap<String, f64>) -> Step {
    // The columns of elastic gears are those at their usual size.
    let share = if addition.is_some_and(|(start, _)| start.has_gears()) { 1.0 } else { STEP };
    let table = Plant::new(before, &Setup::default()).parameters();
    let mut values = table.values();
    for (value, parameter) in values.iter_mut().zip(table.iter()) {
        let Some(change) = changes.get(&parameter.name) else { continue };
        *value += share * change;
        if parameter.role != Role::Linear {
            *value = value.clamp(parameter.range.0, parameter.range.1);
        }
    }
    let mut model = before.clone();
    set_parameters(&mut model, &values);
    let Some((start, assessed)) = addition else { return Step { share, model } };
    let mut active = start.clone();
    let entries = active.entries();
    let linear = active.values.iter_mut().zip(&entries).filter(|(_, e)| e.parameter.role == Role::Linear);
    for ((value, _), estimate) in linear.zip(&assessed.coefficients) {
        *value = share * estimate.value;
    }
    model.effects.push(active);
    Step { share, model }
}

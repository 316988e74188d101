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
    /// [`Diagnosis::candidates`](super::Diagnosis::candidates), with the amplitudes of `anew` and of the step that leave the
    /// least squares of the fitted recordings.
    with: Vec<(String, Step, [f64; 2])>,
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

/// Residuals by the names of candidates.
pub type Named<'a> = Vec<(&'a str, Residuals)>;

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
            _ => fitting.owned_columns(&found.start.fit.model)?,
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
            with.push((report.name.clone(), step, [0.0; 2]));
        }
        let mut alone = Self { before, anew, with };
        alone.set_amplitudes(fitting)?;
        Ok(alone)
    }

    /// Amplitudes of least squares, in units of the noise; a candidate that cannot be predicted is left out.
    fn set_amplitudes(&mut self, fitting: &Fitting) -> Result<(), FitError> {
        let datasets = fitting.datasets;
        let series = |r: &Residuals| -> Vec<f64> {
            let noise = fitting.noise.pooled.iter().enumerate();
            noise.filter(|(_, n)| **n > 0.0).flat_map(|(c, n)| r.channel(c).into_iter().map(move |x| x / n)).collect()
        };
        let before = Residuals::new(&self.before, datasets)?;
        let (y, anew) = (series(&before), series(&self.anew.change(&before, datasets)?));
        for (_, step, amplitudes) in &mut self.with {
            let Ok(change) = step.change(&before, datasets) else { continue };
            let own = series(&change);
            // Changes are of residuals, so that their signs are opposite to those of predictions.
            let normal = Matrix2::new(dot(&anew, &anew), dot(&anew, &own), dot(&own, &anew), dot(&own, &own));
            let right = -Vector2::new(dot(&anew, &y), dot(&own, &y));
            let Ok(inverse) = normal.pseudo_inverse(SINGULAR * normal.trace()) else { continue };
            let found = inverse * right;
            *amplitudes = if found.iter().all(|x| x.is_finite()) { found.into() } else { [0.0; 2] };
        }
        self.with.retain(|(.., amplitudes)| *amplitudes != [0.0; 2]);
        Ok(())
    }

    /// Residuals of the model before along recordings, and with each candidate in addition, by its name. A candidate that
    /// cannot be predicted there is left out.
    ///
    /// # Errors
    /// [`FitError::Kinematics`] if the inverse dynamics of the model before fail at a measured pose.
    pub fn residuals(&self, datasets: &[Dataset]) -> Result<(Residuals, Named<'_>), FitError> {
        let before = Residuals::new(&self.before, datasets)?;
        let anew = self.anew.change(&before, datasets)?;
        let mut with = Vec::new();
        for (name, step, [first, second]) in &self.with {
            let Ok(change) = step.change(&before, datasets) else { continue };
            let left = before.minus(&anew.times(-first)).minus(&change.times(-second));
            if left.rms.iter().all(|rms| rms.is_finite()) {
                with.push((name.as_str(), left));
            }
        }
        Ok((before, with))
    }
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

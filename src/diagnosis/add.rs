//! Addition of an effect requested by the user: its share of the error and its influence on the other parameters.

use super::budget::{self, Budget, Change};
use super::fitting::{Fitting, Options};
use super::judge::{Judge, Judged};
use super::search::{begun_with, starts};
use super::{DiagnosisError, check, missing, problem};
use crate::dynamics::in_configuration;
use crate::effects;
use crate::evidence::{self, Chosen};
use crate::identification::Dataset;
use crate::identification::fit::{Estimate, Fit};
use crate::model::Model;

/// An effect added to a model.
#[derive(Clone)]
pub struct Addition {
    /// Its name.
    pub effect: String,
    /// Error budget of the effect; on held-out data where given.
    pub budget: Budget,
    /// Parameters that it changed significantly.
    pub changes: Vec<Change>,
    /// All parameters before the addition.
    pub parameters_before: Vec<Estimate>,
    /// The fit with the effect; its model's history records the addition.
    pub fit: Fit,
}

/// Adds an effect to a model and refits all parameters.
///
/// # Errors
/// [`DiagnosisError`], if there are no data, recordings differ in configuration or channels, the effect is present,
/// unknown, not identifiable or without a part to act on, or the model cannot be fitted.
pub fn add(
    model: &Model,
    effect: &str,
    datasets: &[Dataset],
    held_out: &[Dataset],
) -> Result<Addition, DiagnosisError> {
    add_with(model, effect, datasets, held_out, &Options::default())
}

/// Addition as [`add`], with known parameters, a time limit and effects outside the registry.
///
/// # Errors
/// As [`add`]; [`DiagnosisError::Stopped`] once the clock is infinite.
pub fn add_with(
    model: &Model,
    effect: &str,
    datasets: &[Dataset],
    held_out: &[Dataset],
    options: &Options,
) -> Result<Addition, DiagnosisError> {
    check(datasets, held_out)?;
    if model.effects.iter().any(|a| a.effect.name() == effect) || effect == effects::rigid_bodies::NAME {
        return Err(DiagnosisError::Present(effect.into()));
    }
    let mounted = in_configuration(model, &datasets[0].setup);
    let other = || options.candidates.iter().find(|e| e.name() == effect).cloned();
    // A formula has its name from the registry, and its terms from the caller.
    let known =
        other().or_else(|| effects::find(effect)).ok_or_else(|| DiagnosisError::UnknownEffect(effect.into()))?;
    if !mounted.mechanism.has(known.acts_on(), mounted.assembled) {
        return Err(DiagnosisError::Missing { effect: effect.into(), part: known.acts_on().describe() });
    }
    if missing::untestable(&mounted).iter().any(|e| e.name() == effect) {
        return Err(DiagnosisError::TwinOnly(effect.into()));
    }
    if known.parameters().is_empty() {
        return Err(DiagnosisError::NoTerms);
    }
    let fitting = Fitting::new(model, datasets, options).with_repeats(model)?;
    let judge = Judge::new(&fitting, model, held_out)?;
    let before = judge.of(fitting.refit(model, options)?)?;
    fitting.go_on()?;
    let absent = missing::testable(&mounted, &before.fit, datasets, options.candidates);
    let shapes = absent.into_iter().find(|c| c[0].effect.name() == effect);
    let candidates = [shapes.ok_or_else(|| DiagnosisError::NotResolved(effect.into()))?];
    let problem = fitting.problem(&before.fit, &candidates, problem::Edges::Together, &mut |_| {})?;
    let ranking = evidence::evaluate(&problem, &[], &evidence::Settings::default())?;
    let chosen = Chosen { candidate: 0, variant: ranking.of(0).map_or(0, |a| a.variant) };
    let with = begun_with(&fitting, [&before.fit.model, model], &candidates, &[chosen], Some(&ranking))?;
    fitting.go_on()?;
    let Judged { mut fit, residuals } = starts::fit(&judge, (&problem, &candidates), &[chosen], &with, &before)?;
    fitting.go_on()?;
    let budget = judge.budget(before.rms().to_vec(), vec![(effect.into(), residuals.rms.clone())]);
    fit.model.history.extend(budget.history());
    let changes = budget::changes(&before.fit, &fit);
    Ok(Addition { effect: effect.into(), budget, changes, parameters_before: before.fit.parameters, fit })
}

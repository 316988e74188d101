//! An effect added to a model by hand: what it explains, and what it does to the other parameters.

use super::budget::{self, Budget, Change};
use super::judge::relative_energy;
use super::{DiagnosisError, check, problem};
use crate::dynamics::in_configuration;
use crate::effects::{self, ActiveEffect};
use crate::identification::fit::{Estimate, Fit, channel_rms, residuals};
use crate::identification::trace::noise_floor as floor;
use crate::identification::{Trace, fit};
use crate::model::Model;

/// An effect added to a model.
#[derive(Clone)]
pub struct Addition {
    /// Its name.
    pub effect: String,
    /// What it explains; on held-out data where given.
    pub budget: Budget,
    /// Parameters that it moved.
    pub changes: Vec<Change>,
    /// All parameters before.
    pub parameters_before: Vec<Estimate>,
    /// The fit with it, which the history of its model tells of.
    pub fit: Fit,
}

/// Adds an effect to a model and refits all parameters.
pub fn add(model: &Model, effect: &str, traces: &[Trace], held_out: &[Trace]) -> Result<Addition, DiagnosisError> {
    check(traces, held_out)?;
    if model.effects.iter().any(|a| a.effect.name() == effect) || effect == effects::rigid_bodies::NAME {
        return Err(DiagnosisError::Present(effect.into()));
    }
    let mounted = in_configuration(model, &traces[0].setup);
    if let Some(known) = effects::find(effect).filter(|e| !mounted.mechanism.has(e.acts_on(), mounted.assembled)) {
        return Err(DiagnosisError::Missing { effect: effect.into(), part: known.acts_on().describe() });
    }
    if problem::beyond(&mounted).iter().any(|e| e.name() == effect) {
        return Err(DiagnosisError::TwinOnly(effect.into()));
    }
    if effects::find(effect).is_some_and(|e| e.parameters().is_empty()) {
        return Err(DiagnosisError::NoTerms);
    }
    let shapes = problem::absent(&mounted).into_iter().find(|c| c[0].effect.name() == effect);
    let shapes = shapes.ok_or_else(|| DiagnosisError::UnknownEffect(effect.into()))?;
    let noise = floor(model, traces);
    let weights = vec![noise.clone(); traces.len()];
    let before = fit(model, traces, &weights)?;
    let mut best: Option<Fit> = None;
    for shape in shapes {
        let mut with = before.model.clone();
        with.effects.push(shape);
        sort_effects(&mut with);
        let fitted = fit(&with, traces, &weights)?;
        let energy = |f: &Fit| relative_energy(&f.rms, &noise);
        if best.as_ref().is_none_or(|b| energy(&fitted) < energy(b)) {
            best = Some(fitted);
        }
    }
    let mut fit = best.expect("an effect has at least one shape");
    let judge = if held_out.is_empty() { traces } else { held_out };
    let budget = Budget {
        channels: traces[0].channels.clone(),
        rms_before: channel_rms(&residuals(&before.model, judge)?),
        noise_floor: floor(model, judge),
        effects: vec![(effect.into(), channel_rms(&residuals(&fit.model, judge)?))],
        held_out: !held_out.is_empty(),
    };
    fit.model.history.extend(budget.history());
    let changes = budget::changes(&before, &fit);
    Ok(Addition { effect: effect.into(), budget, changes, parameters_before: before.parameters, fit })
}

/// Brings the effects of a model into the order of the registry.
fn sort_effects(model: &mut Model) {
    let place = |a: &ActiveEffect| effects::REGISTRY.iter().position(|e| e.name() == a.effect.name());
    model.effects.sort_by_key(place);
}

//! Models with and without effects.

use crate::effects::{ActiveEffect, Role};
use crate::evidence::{self, Chosen, Ranking};
use crate::model::Model;

/// A model with the chosen effects; those assessed in a ranking start at its estimates.
pub(in crate::diagnosis) fn with_effects(
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

/// The model without the named effects.
pub(in crate::diagnosis) fn without_effects(model: &Model, names: &[&str]) -> Model {
    let mut reduced = model.clone();
    reduced.effects.retain(|a| !names.contains(&a.effect.name()));
    reduced
}

/// Sets the linear parameters to the estimates, clamped to the ranges of the law.
fn begin_at(active: &mut ActiveEffect, coefficients: &[evidence::Estimate]) {
    let entries = active.entries();
    let linear = active.values.iter_mut().zip(&entries).filter(|(_, e)| e.parameter.role == Role::Linear);
    for ((value, entry), estimate) in linear.zip(coefficients) {
        *value = estimate.value.clamp(entry.parameter.range.0, entry.parameter.range.1);
    }
}

//! Models with and without effects.

use crate::diagnosis::fitting::Fitting;
use crate::diagnosis::judge::relative_energy;
use crate::effects::{ActiveEffect, Role};
use crate::evidence::{self, Chosen, Ranking};
use crate::identification::Residuals;
use crate::identification::fit::FitError;
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

/// The model of [`with_effects`] from which a fit begins: `fitted`, but with elastic gears that of `fitted` and `stated`, and of
/// the gears as estimated and their variants, that leaves least. Where the motion excites the resonance behind the gears, the
/// error has several minima over their compliance, and parameters fitted without gears imitate them.
pub(in crate::diagnosis) fn begun_with(
    fitting: &Fitting,
    [fitted, stated]: [&Model; 2],
    candidates: &[Vec<ActiveEffect>],
    chosen: &[Chosen],
    ranking: Option<&Ranking>,
) -> Result<Model, FitError> {
    let variants = |c: &Chosen| &candidates[c.candidate];
    let begun = with_effects(fitted, candidates, chosen, ranking);
    let Some(gears) = chosen.iter().find(|c| variants(c)[c.variant].has_gears()) else { return Ok(begun) };
    let as_variant = |variant: &ActiveEffect, begun: &Model| {
        let mut model = without_effects(begun, &[variant.effect.name()]);
        model.effects.push(variant.clone());
        model
    };
    let from_stated = with_effects(stated, candidates, chosen, ranking);
    let mut best = (f64::INFINITY, begun.clone());
    for begun in [begun, from_stated] {
        let sized: Vec<Model> = variants(gears).iter().map(|variant| as_variant(variant, &begun)).collect();
        for model in std::iter::once(begun).chain(sized) {
            let left = relative_energy(&Residuals::along(&model, &fitting.kept)?.rms, &fitting.noise.pooled);
            if left < best.0 {
                best = (left, model);
            }
        }
    }
    Ok(best.1)
}

/// The model without the named effects.
pub(in crate::diagnosis) fn without_effects(model: &Model, names: &[&str]) -> Model {
    let mut reduced = model.clone();
    reduced.effects.retain(|a| !names.contains(&a.effect.name()));
    reduced
}

/// Sets the linear parameters to the estimates, clamped to the ranges of the law.
pub(super) fn begin_at(active: &mut ActiveEffect, coefficients: &[evidence::Estimate]) {
    let entries = active.entries();
    let linear = active.values.iter_mut().zip(&entries).filter(|(_, e)| e.parameter.role == Role::Linear);
    for ((value, entry), estimate) in linear.zip(coefficients) {
        *value = estimate.value.clamp(entry.parameter.range.0, entry.parameter.range.1);
    }
}

//! Fits of effects that are made again: where they have diverged, and from another start of an effect where a shape ends at a
//! limit of its law or beyond zero.
//!
//! The error has several minima over a shape that enters nonlinearly, and a start that the linear problem prefers may lead to
//! a wrong one. There a shape often ends at a limit, or beyond zero: a spring that seems to have less than no free length pulls from
//! the wrong side, if it is not preloaded.

use super::models::{begin_at, with_effects, without_effects};
use crate::diagnosis::judge::{Judge, Judged, relative_energy};
use crate::effects::{ActiveEffect, Count, Role};
use crate::evidence::{self, Chosen, Problem, Settings};
use crate::identification::fit::FitError;
use crate::model::Model;

/// Distance from a limit, relative to the usual value of the parameter, up to which a shape lies at it.
const AT_LIMIT: f64 = 1e-3;

/// The fit of `begun`, a model with the `chosen` effects of `problem`. A fit that leaves more than the one `without` them has
/// diverged, and is made again from that one between possible machines. If a shape of an effect ends at a
/// limit or beyond zero, the fit begins again from the best other start of this effect in `problem`. The fit that leaves less is returned.
pub(in crate::diagnosis) fn fit(
    judge: &Judge,
    (problem, candidates): (&Problem, &[Vec<ActiveEffect>]),
    chosen: &[Chosen],
    begun: &Model,
    without: &Judged,
) -> Result<Judged, FitError> {
    let left = |judged: &Judged| relative_energy(&judged.fit.residuals.rms, &judge.fitting.noise.pooled);
    let less = |first: Judged, second: Judged| if left(&second) < left(&first) { second } else { first };
    let mut first = judge.fit(begun)?;
    if judge.fitting.is_late() {
        return Ok(first);
    }
    // The linear problem may begin it far away along what parameters of the model imitate.
    if left(&first) > left(without) {
        let from_without = with_effects(&without.fit.model, candidates, chosen, None);
        if let Ok(again) = judge.fitting.fit_possible(&from_without).and_then(|fit| judge.of(fit)) {
            first = less(first, again);
        }
    }
    let is_doubtful = |c: &&Chosen| {
        let name = candidates[c.candidate][c.variant].effect.name();
        first.fit.model.effects.iter().any(|a| a.effect.name() == name && ends_oddly(a))
    };
    let other = chosen.iter().find(is_doubtful).and_then(|c| other_start(problem, candidates, chosen, *c));
    let Some(other) = other else { return Ok(first) };
    let mut model = without_effects(begun, &[other.effect.name()]);
    model.effects.push(other);
    let Ok(second) = judge.fit(&model) else { return Ok(first) };
    Ok(less(first, second))
}

/// Whether a shape is at a limit of the law, or a single one on the other side of zero than its usual value.
fn ends_oddly(active: &ActiveEffect) -> bool {
    active.entries().into_iter().zip(&active.values).any(|(entry, value)| {
        let parameter = &entry.parameter;
        let distance = f64::min(value - parameter.range.0, parameter.range.1 - value);
        let is_beyond_zero = parameter.count == Count::One && value * parameter.default < 0.0;
        parameter.role == Role::Shape && (distance < AT_LIMIT * parameter.default.abs() || is_beyond_zero)
    })
}

/// The best start in `problem` of the effect of `known`, without its own, with the other `chosen` effects in the model.
fn other_start(
    problem: &Problem,
    candidates: &[Vec<ActiveEffect>],
    chosen: &[Chosen],
    known: Chosen,
) -> Option<ActiveEffect> {
    let others: Vec<Chosen> = chosen.iter().copied().filter(|c| *c != known).collect();
    let mut rest = problem.clone();
    for (i, candidate) in rest.candidates.iter_mut().enumerate() {
        if i == known.candidate {
            candidate.variants.remove(known.variant);
        } else if others.iter().all(|c| c.candidate != i) {
            candidate.variants.clear();
        }
    }
    let ranking = evidence::evaluate(&rest, &others, &Settings::default()).ok()?;
    let assessed = ranking.of(known.candidate).filter(|a| a.rank > 0)?;
    let variant = assessed.variant + usize::from(assessed.variant >= known.variant);
    let mut other = candidates[known.candidate].get(variant)?.clone();
    begin_at(&mut other, &assessed.coefficients);
    Some(other)
}

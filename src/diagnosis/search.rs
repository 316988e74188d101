//! Forward selection of effects on the robot's own model.

use super::{DiagnosisError, Fitting, problem};
use crate::effects::{ActiveEffect, Kind, Role};
use crate::evidence::{self, Chosen, Outcome, Problem, Ranking, Settings};
use crate::identification::fit::{Fit, FitError};

/// Forward selection; the model is refitted after the addition of an effect that the parameters enter nonlinearly.
pub(super) fn search(
    start: &Fit,
    fitting: &Fitting,
    candidates: &[Vec<ActiveEffect>],
    stated: &Problem,
    settings: &Settings,
    progress: &mut dyn FnMut(&str),
) -> Result<(Outcome, Fit), DiagnosisError> {
    let mut failure = None;
    let mut last: Option<(Vec<Chosen>, Fit)> = None;
    let refit = |chosen: &[Chosen], ranking: Option<&Ranking>| -> Result<Fit, FitError> {
        let mut model = start.model.clone();
        for c in chosen {
            let mut active = candidates[c.candidate][c.variant].clone();
            if let Some(assessed) = ranking.and_then(|r| r.of(c.candidate)) {
                begin_at(&mut active, &assessed.coefficients);
            }
            model.effects.push(active);
        }
        fitting.fit(&model)
    };
    let outcome = evidence::select_with(stated, settings, |chosen, ranking| {
        if !chosen.iter().any(|c| is_nonlinear(&candidates[c.candidate][c.variant])) {
            return Ok(None);
        }
        let names: Vec<&str> = chosen.iter().map(|c| candidates[c.candidate][0].effect.name()).collect();
        progress(&format!("refit with {}", names.join(", ")));
        let next = refit(chosen, Some(ranking)).and_then(|fitted| {
            let next = relinearised(&fitted, fitting, stated, chosen, &names)?;
            last = Some((chosen.to_vec(), fitted));
            Ok(Some(next))
        });
        next.map_err(|e| {
            let text = e.to_string();
            failure = Some(e);
            text
        })
    });
    if let Some(e) = failure {
        return Err(e.into());
    }
    let outcome = outcome?;
    let chosen: Vec<Chosen> = outcome.findings.iter().map(|f| f.chosen).collect();
    let end = match last {
        _ if chosen.is_empty() => start.clone(),
        Some((before, fitted)) if before == chosen => fitted,
        _ => {
            progress("refit");
            refit(&chosen, None)?
        }
    };
    Ok((outcome, end))
}

/// Whether the prediction is nonlinear in the effect's estimated parameters.
fn is_nonlinear(active: &ActiveEffect) -> bool {
    let shaped = active.entries().iter().any(|e| e.parameter.role == Role::Shape);
    shaped || matches!(active.effect.kind(), Kind::Geometry | Kind::Encoder)
}

/// Sets the linear parameters to estimates, as far as the law allows them.
fn begin_at(active: &mut ActiveEffect, coefficients: &[evidence::Estimate]) {
    let entries = active.entries();
    let linear = active.values.iter_mut().zip(&entries).filter(|(_, e)| e.parameter.role == Role::Linear);
    for ((value, entry), estimate) in linear.zip(coefficients) {
        *value = estimate.value.clamp(entry.parameter.range.0, entry.parameter.range.1);
    }
}

/// The problem at the parameters fitted with the chosen effects; their linear contribution is put back into y.
fn relinearised(
    fitted: &Fit,
    fitting: &Fitting,
    stated: &Problem,
    chosen: &[Chosen],
    names: &[&str],
) -> Result<Problem, FitError> {
    let traces = fitting.traces;
    let mut next = Problem { y: problem::residual_series(traces, fitted), base: Vec::new(), ..stated.clone() };
    for c in chosen {
        next.candidates[c.candidate].variants[c.variant].columns.clear();
    }
    for owned in problem::owned_columns(&fitted.model, traces)? {
        if fitting.holds(&owned.column.name) {
            continue;
        }
        let Some(i) = names.iter().position(|n| *n == owned.effect) else {
            next.base.push(owned.column);
            continue;
        };
        if let Some(value) = owned.linear {
            for (y, x) in next.y.iter_mut().zip(&owned.column.values) {
                *y += value * x;
            }
        }
        next.candidates[chosen[i].candidate].variants[chosen[i].variant].columns.push(owned.column);
    }
    Ok(next)
}

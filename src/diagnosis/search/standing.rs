//! Confirmation of a selection on the validation data: every effect must stand against the model without it.

use super::Search;
use super::models::without_effects;
use super::pairs::CLEARLY_LESS;
use crate::diagnosis::DiagnosisError;
use crate::diagnosis::judge::{Judged, relative_energy};
use crate::effects::{ActiveEffect, Role};
use crate::evidence::{Chosen, Outcome, Settings, others};
use crate::identification::fit::{Fit, FitError};
use crate::identification::{Dataset, predict};
use crate::machine::Unit;

/// Steps of the measured angle over which a law must change to be told from the steps.
const RESOLVED: f64 = 2.0;

/// Speeds at which friction must take power, as multiples of the measured one: negative friction that a constant part
/// hides at the measured speed shows at twice that, and an asymmetry in the other direction.
const SPEEDS: [f64; 3] = [1.0, 2.0, -2.0];

/// Effects confirmed by the validation data.
pub(super) struct Standing {
    pub outcome: Outcome,
    /// The fit with them.
    pub end: Judged,
    /// RMS residuals without each of them, on the validation data.
    pub without: Vec<Vec<f64>>,
    pub not_tried: Vec<String>,
}

impl Search<'_> {
    /// Confirmed outcome of a selection on the validation data, or the name of an effect that is not confirmed. When the
    /// time is up, or no further effect may be refused, it is what is confirmed of it.
    pub(super) fn confirm(&self, outcome: Outcome, end: Judged) -> Result<Result<Standing, String>, FitError> {
        if outcome.cut_short || self.judge.fitting.is_late() || self.is_exhausted() {
            return self.confirm_some(outcome, end).map(Ok);
        }
        let chosen: Vec<Chosen> = outcome.chosen();
        let without = self.stand(&chosen, &end)?;
        Ok(without.map(|without| Standing { outcome, end, without, not_tried: Vec::new() }))
    }

    /// What of a selection is confirmed: all of it, or what stands after those that do not were taken out, one at a time.
    pub(super) fn confirm_some(&self, mut outcome: Outcome, mut end: Judged) -> Result<Standing, FitError> {
        while !outcome.cut_short && !self.judge.fitting.is_late() {
            let chosen: Vec<Chosen> = outcome.chosen();
            let refused = match self.stand(&chosen, &end)? {
                Ok(without) => return Ok(Standing { outcome, end, without, not_tried: Vec::new() }),
                Err(name) => name,
            };
            let kept: Vec<Chosen> = chosen.into_iter().filter(|c| self.shape(c).effect.name() != refused).collect();
            let Ok(next) = self.refit(&kept, None) else { break };
            outcome.findings.retain(|f| kept.contains(&f.chosen));
            end = next;
        }
        self.leading(outcome)
    }

    /// The longest leading sequence of a selection that is confirmed.
    fn leading(&self, mut outcome: Outcome) -> Result<Standing, FitError> {
        let chosen: Vec<Chosen> = outcome.chosen();
        let (end, without) = self.longest_standing(&chosen)?;
        outcome.findings.truncate(without.len());
        let unjudged = self.names(&chosen[without.len()..]);
        let is_open = outcome.cut_short || (self.judge.fitting.is_late() && !unjudged.is_empty());
        let not_tried = if is_open { untried(&outcome, unjudged, &self.settings) } else { Vec::new() };
        Ok(Standing { outcome, end, without, not_tried })
    }

    /// `standing`, or where its search was cut short, of the sets of effects that were fitted and are confirmed the one that
    /// leaves least, if that is clearly less.
    pub(super) fn or_known(&self, standing: Standing) -> Result<Standing, DiagnosisError> {
        if standing.not_tried.is_empty() {
            return Ok(standing);
        }
        let most = (1.0 - CLEARLY_LESS) * self.left(&standing.end);
        let mut known = self.fits.all();
        known.retain(|(chosen, fitted)| !chosen.is_empty() && self.left(fitted) < most);
        known.sort_by(|a, b| self.left(&a.1).total_cmp(&self.left(&b.1)));
        for (chosen, end) in known {
            let is_judged = |c: &Chosen| chosen.len() == 1 || self.fits.known(&others(&chosen, *c)).is_some();
            if !chosen.iter().all(is_judged) {
                continue;
            }
            let Ok(without) = self.stand(&chosen, &end)? else { continue };
            // The effect whose absence costs most comes first.
            let mut named: Vec<(Chosen, Vec<f64>)> = chosen.into_iter().zip(without).collect();
            let energy = |rms: &[f64]| relative_energy(rms, &self.judge.floor);
            named.sort_by(|a, b| energy(&b.1).total_cmp(&energy(&a.1)));
            let (chosen, without): (Vec<Chosen>, Vec<Vec<f64>>) = named.into_iter().unzip();
            let outcome = self.given(&chosen, &end.fit)?;
            let names = self.names(&chosen);
            let not_tried = standing.not_tried.into_iter().filter(|name| !names.contains(name)).collect();
            return Ok(Standing { outcome, end, without, not_tried });
        }
        Ok(standing)
    }

    /// RMS residuals without each of the chosen effects, or the name of the weakest that is not confirmed.
    pub(super) fn stand(&self, chosen: &[Chosen], end: &Judged) -> Result<Result<Vec<Vec<f64>>, String>, FitError> {
        let name = |c: &Chosen| self.shape(c).effect.name();
        if let Some(c) = chosen.iter().find(|c| self.is_no_law(&end.fit, name(c))) {
            return Ok(Err(name(c).into()));
        }
        // A fit that leaves more than the start has diverged, with a column that the data hardly determine.
        let energy = |judged: &Judged| relative_energy(&judged.fit.residuals.rms, &self.judge.fitting.noise.pooled);
        if let Some(last) = chosen.last().filter(|_| energy(end).is_nan() || energy(end) > energy(&self.start)) {
            return Ok(Err(name(last).into()));
        }
        let mut all = Vec::new();
        // Of those that do not stand, the one whose absence costs least: any other may only suffer from it.
        let mut weakest: Option<(f64, &str)> = None;
        for c in chosen {
            let others = others(chosen, *c);
            let make = || self.judge.fit(&without_effects(&end.fit.model, &[name(c)]));
            // Where no machine without it can be fitted, the effect is compared with the model without any.
            let without = match others.is_empty() {
                true => self.start.clone(),
                false => self.fits.of(&others, make).unwrap_or_else(|_: FitError| self.start.clone()),
            };
            let left = relative_energy(without.rms(), &self.judge.floor);
            if !self.judge.confirms(&without, end)? && weakest.is_none_or(|(least, _)| left < least) {
                weakest = Some((left, name(c)));
            }
            all.push(without.rms().to_vec());
        }
        Ok(weakest.map_or(Ok(all), |(_, name)| Err(name.into())))
    }

    /// Whether an effect in a fit is not a law of the machine: impossible coefficients, coefficients that are all zero within
    /// their errors, an effect on the time of the torques that belongs to the recording, an error that the derivatives of the
    /// angles leave, or friction that gives power.
    fn is_no_law(&self, fit: &Fit, name: &str) -> bool {
        is_impossible(fit, name)
            || is_nothing(fit, name)
            || self.is_of_recording(fit, name)
            || self.is_unresolved(fit, name)
            || self.is_driving(fit, name)
    }

    /// Whether the law of an effect changes over an angle that the measured angles do not resolve: their steps, smoothed,
    /// change friction at reversals as well.
    fn is_unresolved(&self, fit: &Fit, name: &str) -> bool {
        let datasets = self.judge.fitting.datasets;
        let drives = datasets[0].channels.iter().filter_map(|c| c.drive());
        // The axis that resolves most tells it.
        let finest = |dataset: &Dataset| drives.clone().map(|i| dataset.resolution(i)).fold(f64::INFINITY, f64::min);
        let angles = fit.model.effects.iter().filter(|a| a.effect.name() == name).flat_map(|active| {
            let entries = active.entries().into_iter().zip(&active.values);
            let angles = entries.filter(|(e, _)| e.parameter.role == Role::Shape && e.parameter.unit == Unit::Rad);
            angles.map(|(_, value)| *value).collect::<Vec<f64>>()
        });
        let resolution = datasets.iter().map(finest).fold(0.0, f64::max);
        angles.fold(f64::INFINITY, f64::min) < RESOLVED * resolution
    }

    /// Whether an effect is friction, and all friction of some drive together gives it power along the measured path at
    /// one of the [`SPEEDS`]: the law of a controller around a constant rate, τ = −k·Δq̇, looks like negative friction.
    fn is_driving(&self, fit: &Fit, name: &str) -> bool {
        let is_friction = |a: &ActiveEffect| a.effect.spec().is_drive_friction;
        if !fit.model.effects.iter().any(|a| a.effect.name() == name && is_friction(a)) {
            return false;
        }
        let mut frictionless = fit.model.clone();
        frictionless.effects.retain(|a| !is_friction(a));
        let gives = |dataset: &Dataset| {
            let both = [&fit.model, &frictionless].map(|model| predict(&dataset.plant(model), dataset));
            let [Ok(with), Ok(without)] = both else { return false };
            dataset.channels.iter().enumerate().any(|(c, channel)| {
                let axis = channel.drive();
                let torques = with[c].iter().zip(&without[c]).map(|(with, without)| with - without);
                axis.is_some_and(|i| {
                    torques.zip(&dataset.joints).map(|(torque, at)| torque * at.qd[i]).sum::<f64>() < 0.0
                })
            })
        };
        let at_some_speed = |dataset: &Dataset| SPEEDS.iter().any(|factor| gives(&dataset.at_speed(*factor)));
        self.judge.fitting.datasets.iter().any(at_some_speed)
    }

    /// Fit with the longest leading sequence of chosen effects that are each confirmed given the previous ones, and
    /// the RMS residuals before each addition.
    fn longest_standing(&self, chosen: &[Chosen]) -> Result<(Judged, Vec<Vec<f64>>), FitError> {
        let (mut end, mut without) = (self.start.clone(), Vec::new());
        for k in 0..chosen.len() {
            let Ok(next) = self.refit(&chosen[..=k], None) else { break };
            let is_no_law = |c: &Chosen| self.is_no_law(&next.fit, self.shape(c).effect.name());
            if chosen[..=k].iter().any(is_no_law) || !self.judge.confirms(&end, &next)? {
                break;
            }
            without.push(std::mem::replace(&mut end, next).rms().to_vec());
        }
        Ok((end, without))
    }
}

/// Names of effects left open by an outcome that was cut short: `unjudged` effects and significant candidates.
fn untried(outcome: &Outcome, unjudged: Vec<String>, settings: &Settings) -> Vec<String> {
    let ranking = &outcome.remaining;
    let passing = ranking.order.iter().map(|&i| &ranking.candidates[i]).filter(|a| a.passes(settings));
    unjudged.into_iter().chain(passing.map(|a| a.name.clone())).collect()
}

/// Whether an effect has a parameter outside the range of its law, such as a negative coefficient of a law with a
/// definite sign.
fn is_impossible(fit: &Fit, name: &str) -> bool {
    fit.impossible.iter().any(|p| p.effect == name)
}

/// Whether the data determine all coefficients of an effect, and none differs from zero by its standard error.
fn is_nothing(fit: &Fit, name: &str) -> bool {
    let Some(active) = fit.model.effects.iter().find(|a| a.effect.name() == name) else { return false };
    let is_coefficient = |block: usize| active.effect.parameters().get(block).is_some_and(|p| p.role == Role::Linear);
    let mut own = fit.parameters.iter().filter(|p| p.param.effect == name && is_coefficient(p.param.block)).peekable();
    own.peek().is_some() && own.all(|p| p.std.is_finite() && p.value.abs() < p.std)
}

//! Validation of effects on held-out recordings, or on the fitted ones without any.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::DVector;

use super::budget::Budget;
use super::fitting::Fitting;
use super::problem::{self, Edges};
use crate::evidence::drift::Noise;
use crate::evidence::{Assessment, Column, Ranking, critical, cut, dot, t_statistic};
use crate::identification::fit::{Fit, FitError};
use crate::identification::{Dataset, KeptColumns, NoiseLevel, Residuals};
use crate::model::Model;

/// Smallest relative RMS contribution of an effect on some channel, for it to be named. It is relative to the
/// residual with the effect on the validation data, because smoothing leaves an error in every recording, and an effect much
/// smaller than a large model error explains nothing.
pub(super) const MIN_RELEVANCE: f64 = 0.1;

/// The smallest contribution over coarse angles, a tenth of the variance: their smoothing leaves an error that follows the
/// motion, and small effects imitate it.
const RELEVANCE_OF_COARSE: f64 = 0.33;

/// Share that an effect must gain on held-out data of what it predicts there or gained on the fitted data, whichever is
/// less. A drifting bias gains nothing; a motion that shows the effect less gains less, as predicted.
const HELD_OUT_SHARE: f64 = 0.3;

/// Least gain of an effect relative to the error above the noise that is left next to it: a much smaller effect may be a
/// part of what is left and not known.
const ABOVE_THE_REST: f64 = 0.1;

/// Share of [`ABOVE_THE_REST`] below which an effect is not pursued, and error above the noise, in units of the noise, from
/// which that counts.
const LOST: f64 = 0.5;
const FEW: f64 = 0.3;

/// Gain, in units of the noise, below which drift may explain an effect: seven standard deviations of one parameter,
/// because the drift intensity is estimated from a few slow cosines only.
const MAX_DRIFT_GAIN: f64 = 50.0;

/// Ratio of the RMS residual to the noise floor above which it is not explained by controller or filter.
pub(super) const UNEXPLAINED: f64 = 1.15;

/// The ratio over coarse angles, whose smoothing leaves more.
const UNEXPLAINED_OF_COARSE: f64 = 1.25;

/// Blocks of the validation data whose losses two fits are compared by.
const BLOCKS: usize = 50;

/// A fit with its residuals on the validation data.
#[derive(Clone)]
pub(super) struct Judged {
    pub fit: Fit,
    pub residuals: Arc<Residuals>,
}

impl Judged {
    /// RMS residual of each channel on the validation data, N·m or N.
    pub fn rms(&self) -> &[f64] {
        &self.residuals.rms
    }
}

/// Ratio of held-out to fitted residuals, both in units of the noise, from which the fitted motion counts as too small.
const EXTRAPOLATED: f64 = 10.0;

/// Data for the search of effects and data for their validation.
pub(super) struct Judge<'a> {
    pub fitting: &'a Fitting<'a>,
    /// The model before it was fitted.
    pub stated: &'a Model,
    /// Recordings that no fit uses; may be empty.
    pub held_out: &'a [Dataset],
    /// The held-out recordings with the columns that their models share.
    kept: Vec<KeptColumns<'a>>,
    /// Noise floor of the validation data.
    pub floor: Vec<f64>,
}

impl<'a> Judge<'a> {
    pub fn new(fitting: &'a Fitting<'a>, model: &'a Model, held_out: &'a [Dataset]) -> Result<Self, FitError> {
        let own = || fitting.noise.pooled.clone();
        let floor = if held_out.is_empty() { own() } else { NoiseLevel::measured(model, held_out)?.pooled };
        Ok(Self { fitting, stated: model, held_out, kept: KeptColumns::of(held_out), floor })
    }

    /// Validation data: the held-out recordings, or without any the fitted ones.
    pub fn data(&self) -> &'a [Dataset] {
        if self.held_out.is_empty() { self.fitting.datasets } else { self.held_out }
    }

    /// Whether the residuals on the validation data clearly exceed the noise of some channel.
    pub fn is_more_than_noise(&self, rms: &[f64]) -> bool {
        rms.iter().zip(&self.floor).any(|(r, floor)| r / floor.max(f64::MIN_POSITIVE) > UNEXPLAINED)
    }

    /// Whether the validation data leave many times the noise and the fitted recordings do not: the fitted motion does not
    /// determine parameters on which the other one depends.
    pub fn is_extrapolated(&self, judged: &Judged) -> bool {
        let over = |(rms, floor): (&f64, &f64)| rms / floor.max(f64::MIN_POSITIVE);
        let fitted = judged.fit.residuals.rms.iter().zip(&self.fitting.noise.pooled).map(over);
        let held_out = judged.rms().iter().zip(&self.floor).map(over);
        held_out.zip(fitted).any(|(held_out, fitted)| held_out > EXTRAPOLATED * fitted.max(1.0))
    }

    /// Whether an effect changes the RMS residual of some channel on the validation data enough to be named.
    pub fn is_relevant(&self, without: &[f64], with: &[f64]) -> bool {
        let least = if self.is_coarse() { RELEVANCE_OF_COARSE } else { MIN_RELEVANCE };
        relevance(without, with) >= least
    }

    /// Ratio of the RMS residual to the noise floor above which the motion may explain it.
    pub fn unexplained(&self) -> f64 {
        if self.is_coarse() { UNEXPLAINED_OF_COARSE } else { UNEXPLAINED }
    }

    /// Whether the angles of some recording are too coarse to resolve reversals.
    fn is_coarse(&self) -> bool {
        self.fitting.datasets.iter().chain(self.held_out).any(Dataset::is_coarse)
    }

    /// Whether no channel of the validation data exceeds its noise, so that nothing is to be explained.
    pub fn is_noise(&self, rms: &[f64]) -> bool {
        rms.iter().zip(&self.floor).all(|(r, floor)| r <= floor)
    }

    /// Whether one fit leaves clearly less of the validation data than another, by the share of the error above the noise that is
    /// left where it gains.
    pub fn is_clearly_less(&self, less: &[f64], more: &[f64], share: f64) -> bool {
        let [before, after] = [more, less].map(|rms| energies(rms, &self.floor));
        let gain = before.iter().sum::<f64>() - after.iter().sum::<f64>();
        gain > 0.0 && gain > share / (1.0 - share) * left_next_to(&before, &after)
    }

    /// Error budget on the validation data.
    pub fn budget(&self, rms_before: Vec<f64>, effects: Vec<(String, Vec<f64>)>) -> Budget {
        Budget {
            mechanism: self.fitting.datasets[0].mechanism,
            channels: self.fitting.datasets[0].channels.clone(),
            rms_before,
            noise_floor: self.floor.clone(),
            effects,
            held_out: !self.held_out.is_empty(),
        }
    }

    /// Fit of a model with its residuals on the validation data.
    pub fn fit(&self, model: &Model) -> Result<Judged, FitError> {
        self.of(self.fitting.fit(model)?)
    }

    /// Whether the residual away from reversals exceeds the noise on the fitted data and on the validation data: a
    /// drifting bias differs between recordings, and parameters follow it.
    pub fn leaves_more(&self, judged: &Judged) -> bool {
        let above = |datasets: &[Dataset], residuals: &Residuals, floor: &[f64]| {
            let rms = rms_away_from_reversals(datasets, residuals);
            rms.iter().zip(floor).any(|(r, f)| *r > UNEXPLAINED * f)
        };
        above(self.fitting.datasets, &judged.fit.residuals, &self.fitting.noise.pooled)
            && above(self.data(), &judged.residuals, &self.floor)
    }

    /// The fit with its residuals on the validation data.
    pub fn of(&self, fit: Fit) -> Result<Judged, FitError> {
        let residuals = match self.held_out {
            [] => Arc::clone(&fit.residuals),
            _ => Arc::new(Residuals::along(&fit.model, &self.kept)?),
        };
        Ok(Judged { fit, residuals })
    }

    /// t statistic of the losses of `rival` less those of `best` over blocks of the validation data without the samples next
    /// to reversals, and its critical value [Vuong 1989].
    pub fn compare(&self, best: &Judged, rival: &Judged) -> (f64, f64) {
        let (segments, samples) = problem::determined(self.data());
        let blocks = cut(&segments, 0, BLOCKS);
        let level = NoiseLevel { of_each: vec![self.floor.clone(); self.data().len()], pooled: self.floor.clone() };
        let losses = |judged: &Judged| {
            let series = problem::residual_series(self.data(), &level, &judged.residuals);
            let square = |c: usize, range: &Range<usize>| {
                let own = &series[c * samples..][range.clone()];
                dot(own, own) / self.floor[c].powi(2).max(f64::MIN_POSITIVE)
            };
            let loss = |block: &Vec<Range<usize>>| -> f64 {
                block
                    .iter()
                    .flat_map(|range| (0..self.floor.len()).map(move |c| (c, range)))
                    .map(|(c, r)| square(c, r))
                    .sum()
            };
            DVector::from_iterator(blocks.len(), blocks.iter().map(loss))
        };
        (t_statistic(&losses(best), &losses(rival), 0.0), critical(blocks.len()))
    }

    /// Whether an effect gains so much less on the fitted data than what is left with it above the noise that no
    /// validation data will confirm it.
    pub fn is_lost_in_the_rest(&self, without: &Judged, with: &Judged) -> bool {
        let energy = |judged: &Judged| relative_energy(&judged.fit.residuals.rms, &self.fitting.noise.pooled);
        self.is_lost(energy(without) - energy(with), energy(with) - self.channels())
    }

    /// Whether a linear effect promises so little in a ranking, which sees means over [`problem::block`] samples.
    pub fn will_be_lost(&self, ranking: &Ranking, assessed: &Assessment) -> bool {
        let (before, after) = (ranking.energy(&ranking.sum_of_squares), ranking.energy(&assessed.sum_of_squares));
        let block = problem::block(self.fitting.datasets) as f64;
        self.is_lost((before - after) / block, (after - self.channels()) / block)
    }

    /// Whether a gain is lost in the error that is `left` above the noise on all channels.
    fn is_lost(&self, gain: f64, left: f64) -> bool {
        left > FEW * self.channels() && gain < LOST * ABOVE_THE_REST * left
    }

    fn channels(&self) -> f64 {
        self.fitting.noise.pooled.len() as f64
    }

    /// RMS residuals on the validation data, without reversals that the recordings do not resolve.
    pub fn resolved_rms(&self, judged: &Judged) -> Vec<f64> {
        resolved_rms(self.data(), &judged.residuals)
    }

    /// Whether the validation data confirm the effect that `with` contains and `without` does not.
    pub fn confirms(&self, without: &Judged, with: &Judged) -> Result<bool, FitError> {
        let rms = |judged: &Judged| resolved_rms(self.fitting.datasets, &judged.fit.residuals);
        let gain = |without: &[f64], with: &[f64], floor: &[f64]| {
            relative_energy(without, floor) - relative_energy(with, floor)
        };
        let fitted = gain(&rms(without), &rms(with), &self.fitting.noise.pooled);
        let [before, after] = [self.resolved_rms(without), self.resolved_rms(with)];
        let held_out = gain(&before, &after, &self.floor);
        let change = resolved_rms(self.data(), &without.residuals.minus(&with.residuals));
        let share = HELD_OUT_SHARE * fitted.min(relative_energy(&change, &self.floor));
        let left = left_next_to(&energies(&before, &self.floor), &energies(&after, &self.floor));
        let stays = held_out >= share.max(ABOVE_THE_REST * left)
            && self.is_relevant(&before, &after)
            && self.is_relevant(without.rms(), with.rms());
        // Each recording drifts differently.
        let is_repeated = || !self.held_out.is_empty() && !wanders_in(self.held_out, without, with);
        Ok(stays && (!self.fitting.wanders(&without.fit, &with.fit)? || is_repeated()))
    }
}

impl Fitting<'_> {
    /// Whether drift explains the gain of `with` over `without` on the fitted data.
    pub fn wanders(&self, without: &Fit, with: &Fit) -> Result<bool, FitError> {
        Ok(self.gain(without, with)? < MAX_DRIFT_GAIN)
    }

    /// Decrease of the energy from one fit to the other that drift does not explain, in units of the noise.
    fn gain(&self, without: &Fit, with: &Fit) -> Result<f64, FitError> {
        let datasets = self.datasets;
        let (segments, samples) = problem::segments(datasets);
        let series = |fit: &Fit| self.residual_series(&fit.residuals);
        let (before, left) = (series(without), series(with));
        let mut noise = Noise::of(&left, samples, &segments, drives(datasets));
        if !noise.wanders() {
            return Ok(noise.energy(&before) - noise.energy(&left));
        }
        let (own, least) = (self.base(without, Edges::Apart)?, self.base(with, Edges::Apart)?);
        let after = left;
        let refitted = |y: &[f64], base: &[Column], noise: &Noise| {
            let columns: Vec<&[f64]> = base.iter().map(|c| &*c.values).collect();
            noise.least_squares(y, &columns)
        };
        // Ordinary least squares absorb part of the drift in the parameters, so the noise is estimated again.
        let left = refitted(&after, &least, &noise);
        noise = Noise::of(&left, samples, &segments, drives(datasets));
        Ok(noise.energy(&refitted(&before, &own, &noise)) - noise.energy(&refitted(&after, &least, &noise)))
    }
}

/// RMS residuals per channel, without the reversals of recordings that do not resolve them.
fn resolved_rms(datasets: &[Dataset], residuals: &Residuals) -> Vec<f64> {
    if datasets.iter().any(Dataset::blurs_reversals) {
        rms_away_from_reversals(datasets, residuals)
    } else {
        residuals.rms.clone()
    }
}

/// RMS residuals per channel away from the drives' reversals and rest: the derivatives smooth the jump of friction over their
/// half width. All samples count if none is away.
fn rms_away_from_reversals(datasets: &[Dataset], residuals: &Residuals) -> Vec<f64> {
    let kept: Vec<Vec<usize>> = datasets.iter().map(away_from_reversals).collect();
    if kept.iter().all(Vec::is_empty) {
        return residuals.rms.clone();
    }
    residuals.at(&kept).rms
}

/// Samples of a dataset whose distance from every reversal, and from every sample at which the readings do not determine the sign
/// of a rate, exceeds the half width of the derivatives.
fn away_from_reversals(dataset: &Dataset) -> Vec<usize> {
    let mut is_away = vec![true; dataset.len()];
    for axis in 0..drives(std::slice::from_ref(dataset)) {
        let reach = dataset.half_width[axis];
        // At rest friction takes any value up to its limit.
        let is_unsigned = |k: &usize| dataset.joints[*k].qd[axis].abs() < dataset.accuracy[axis].rate;
        for k in dataset.reversals(axis).chain((0..dataset.len()).filter(is_unsigned)) {
            is_away[k.saturating_sub(reach + 1)..(k + reach + 1).min(dataset.len())].fill(false);
        }
    }
    (0..dataset.len()).filter(|&k| is_away[k]).collect()
}

/// Number of the drives' channels, which come first.
fn drives(datasets: &[Dataset]) -> usize {
    datasets[0].channels.iter().filter(|c| c.drive().is_some()).count()
}

/// Whether drift explains the difference of the residuals of two fits on data that were not fitted, `without` an effect and
/// `with` it.
pub(super) fn wanders_in(datasets: &[Dataset], without: &Judged, with: &Judged) -> bool {
    let (segments, samples) = problem::segments(datasets);
    let level = NoiseLevel::of(&without.fit.model, datasets);
    let [before, left] = [without, with].map(|one| problem::residual_series(datasets, &level, &one.residuals));
    let noise = Noise::of(&left, samples, &segments, drives(datasets));
    noise.energy(&before) - noise.energy(&left) < MAX_DRIFT_GAIN
}

/// RMS contribution of an effect relative to the residual with it, of the channel on which it is largest.
pub(super) fn relevance(without: &[f64], with: &[f64]) -> f64 {
    let gains = without.iter().zip(with).map(|(without, with)| (without / with).powi(2) - 1.0);
    gains.fold(0.0, f64::max).sqrt()
}

/// Sum over the channels of the variance in units of the noise.
pub(super) fn relative_energy(rms: &[f64], floor: &[f64]) -> f64 {
    energies(rms, floor).iter().sum()
}

/// Variance of each channel in units of the noise.
fn energies(rms: &[f64], floor: &[f64]) -> Vec<f64> {
    rms.iter().zip(floor).map(|(r, f)| (r / f).powi(2)).collect()
}

/// Error above the noise next to an effect, from the energies without and with it: every channel counts by the gain of the effect
/// there, relative to the largest one. An effect on one axis is no smaller for an error of the others.
fn left_next_to(before: &[f64], after: &[f64]) -> f64 {
    let gains: Vec<f64> = before.iter().zip(after).map(|(before, after)| (before - after).max(0.0)).collect();
    let most = gains.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    gains.iter().zip(after).map(|(gain, after)| gain / most * (after - 1.0)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_effect_on_one_axis_is_measured_by_what_is_left_there() {
        // Ten times the noise on the second axis is nothing to an effect of the first.
        assert_eq!(left_next_to(&[2.0, 10.0], &[1.5, 10.0]), 0.5);
        assert_eq!(left_next_to(&[2.0, 10.0], &[1.5, 9.75]), 0.5 + 0.5 * 8.75);
    }
}

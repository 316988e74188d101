//! Whether an effect is worth its name, on data it was not found in.

use std::ops::Range;

use super::{Fitting, problem};
use crate::evidence::drift::{self, Series};
use crate::identification::Trace;
use crate::identification::fit::{Fit, FitError, channel_rms, residuals};
use crate::identification::prediction::Channels;
use crate::identification::trace::noise_floor as floor;
use crate::model::Model;

/// Smallest share of the raw noise an effect must explain on some channel to be worth naming. In the data it is judged by
/// it is a share of all that is left: what smoothing blurs at reversals is there in every recording, and beside a large error
/// of the model a trifle is no explanation.
pub(super) const MIN_RELEVANCE: f64 = 0.1;

/// Share of what an effect takes from the residual it was found in that it must take from held-out data, too. A bias that
/// walks takes nothing there.
const HELD_OUT_SHARE: f64 = 0.3;

/// Gain, in units of the noise, below which an effect takes no more than what wanders: ten standard deviations of one
/// parameter. How much wanders is known from a few slow cosines only, of which the fit has taken a part.
const NO_MORE: f64 = 100.0;

/// A fit with its RMS residuals on the data it is judged by.
#[derive(Clone)]
pub(super) struct Judged {
    pub fit: Fit,
    pub rms: Vec<f64>,
}

/// The data to find effects in and those to judge them by.
pub(super) struct Judge<'a> {
    pub fitting: &'a Fitting<'a>,
    /// Those held out; without any, those to find in.
    held_out: &'a [Trace],
    /// Their noise floor.
    pub floor: Vec<f64>,
}

impl<'a> Judge<'a> {
    pub fn new(fitting: &'a Fitting<'a>, model: &Model, held_out: &'a [Trace]) -> Self {
        let held_out = if held_out.is_empty() { fitting.traces } else { held_out };
        Self { fitting, held_out, floor: floor(model, held_out) }
    }

    /// Refits a model.
    pub fn fit(&self, model: &Model) -> Result<Judged, FitError> {
        self.of(self.fitting.fit(model)?)
    }

    /// Judges a fit.
    pub fn of(&self, fit: Fit) -> Result<Judged, FitError> {
        Ok(Judged { rms: channel_rms(&residuals(&fit.model, self.held_out)?), fit })
    }

    /// Whether what `with` has and `without` has not is worth a name.
    pub fn confirms(&self, without: &Judged, with: &Judged) -> bool {
        if wanders(self.fitting.traces, &without.fit.residuals, &with.fit.residuals) {
            return false;
        }
        let gain = relative_energy(&without.fit.rms, &self.fitting.noise)
            - relative_energy(&with.fit.rms, &self.fitting.noise);
        let held_out = relative_energy(&without.rms, &self.floor) - relative_energy(&with.rms, &self.floor);
        held_out >= HELD_OUT_SHARE * gain && is_relevant(&without.rms, &with.rms)
    }
}

/// Whether an effect takes no more from the residuals, `without` it and `with` it, than noise that drifts.
pub(super) fn wanders(traces: &[Trace], without: &[Channels], with: &[Channels]) -> bool {
    let segments: Vec<Vec<Range<usize>>> = traces.iter().map(|t| t.averaged(problem::BLOCK).segments).collect();
    let gain = |c: usize| -> f64 {
        let means = |residuals: &[Channels]| -> Vec<Vec<f64>> {
            traces.iter().zip(residuals).map(|(t, r)| t.means(&r[c], problem::BLOCK)).collect()
        };
        let (before, left) = (means(without), means(with));
        let left: Vec<Series> = left.iter().zip(&segments).map(|(x, s)| Series::new(x, s)).collect();
        let lambda = drift::walk(&left);
        left.iter().zip(&before).map(|(left, before)| left.gain(before, lambda)).sum()
    };
    (0..traces[0].channels.len()).map(gain).sum::<f64>() < NO_MORE
}

/// Whether the variance of some channel falls by enough, in units of what is left.
pub(super) fn is_relevant(without: &[f64], with: &[f64]) -> bool {
    let gains = without.iter().zip(with).map(|(without, with)| (without / with).powi(2) - 1.0);
    gains.fold(0.0, f64::max) >= MIN_RELEVANCE.powi(2)
}

/// Σ over channels of the variance in units of the noise.
pub(super) fn relative_energy(rms: &[f64], floor: &[f64]) -> f64 {
    rms.iter().zip(floor).map(|(r, f)| (r / f).powi(2)).sum()
}

//! Delays that are a property of the recording and no effect of the machine.

use super::{Fits, Search};
use crate::diagnosis::DiagnosisError;
use crate::diagnosis::judge::{Judged, relative_energy};
use crate::effects::{self, ActiveEffect};
use crate::evidence::Chosen;
use crate::identification::Dataset;
use crate::identification::fit::Fit;
use crate::model::Model;

/// Share by which the recorder's delay must lower the mean square error of slow recordings.
const LAG_GAIN: f64 = 0.1;

/// Name of the effect that is equivalent to a delay of the recorder.
pub(in crate::diagnosis) const DELAY: &str = "signal_delay";

/// Effects on the time of the torques.
pub(in crate::diagnosis) const TIMES: [&str; 2] = [DELAY, "torque_filter"];

/// State of a delay that is a property of the recording and no effect, see [`Search::recorded_lag`].
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Lag {
    /// A delay that is found may be the recorder's.
    Possible,
    /// The recorder's delay is in the model.
    InModel,
    /// Together with other effects the delay was longer: a delay that is found is an effect.
    Excluded,
}

impl Search<'_> {
    /// The recorder's delay in recordings whose samples are so far apart that the hold of the torques distorts every
    /// reversal; `None` if they resolve them, or if a delay lowers the error on the fitted or the validation data by less
    /// than [`LAG_GAIN`].
    pub(super) fn lag_of_slow_recordings(&self) -> Option<ActiveEffect> {
        let fitting = self.judge.fitting;
        if delay(&self.start.fit.model).is_some() || !fitting.datasets.iter().any(Dataset::blurs_reversals) {
            return None;
        }
        let mut model = self.start.fit.model.clone();
        model.effects.push(ActiveEffect::absent_on(effects::find(DELAY)?, model.host()));
        // Where no machine with it can be fitted, there is none.
        let with = self.judge.fit(&model).ok()?;
        let gains = |without: &[f64], with: &[f64], floor: &[f64]| {
            relative_energy(with, floor) < (1.0 - LAG_GAIN) * relative_energy(without, floor)
        };
        let fitted = gains(&self.start.fit.residuals.rms, &with.fit.residuals.rms, &fitting.noise.pooled);
        let held_out = gains(self.start.rms(), with.rms(), &self.judge.floor);
        self.recorded_lag(&with.fit).filter(|_| fitted && held_out)
    }

    /// Adds the recorder's delay to the starting model.
    pub(super) fn accept_lag(&mut self, late: ActiveEffect) -> Result<(), DiagnosisError> {
        self.lag = Lag::InModel;
        let mut model = self.start.fit.model.clone();
        model.effects.push(late);
        self.start = self.judge.fit(&model)?;
        self.fits = Fits::default();
        self.forget_pairs();
        if !self.judge.fitting.is_late() {
            let fit = &self.start.fit;
            let late = delay(&fit.model).expect("just added");
            self.problem = self.judge.fitting.delayed(&self.without_lag.1, self.candidates, (fit, late), self.edges)?;
        }
        Ok(())
    }

    /// Removes the recorder's delay from the model: together with the other effects found it is an effect.
    pub(super) fn exclude_lag(&mut self) {
        self.lag = Lag::Excluded;
        (self.start, self.problem) = self.without_lag.clone();
        self.fits = Fits::default();
        self.forget_pairs();
    }

    /// The recorder's delay in a fit, s; `None` if it is not part of the model.
    pub(super) fn sampling_lag(&self, end: &Judged) -> Option<f64> {
        delay(&end.fit.model).filter(|_| self.lag == Lag::InModel).map(|late| late.values[0])
    }

    /// The recorder's delay among the chosen effects, if there is one.
    pub(super) fn chosen_lag(&self, fit: &Fit, chosen: &[Chosen]) -> Option<ActiveEffect> {
        let is_chosen = chosen.iter().any(|c| self.shape(c).effect.name() == DELAY);
        self.recorded_lag(fit).filter(|_| self.lag == Lag::Possible && is_chosen)
    }

    /// The delay in a fit if sampling explains it, within three standard errors of the estimate: a recorder delays by at
    /// most half the sampling period. A command is recorded early, by half a period while it is held and by one more if
    /// it is computed during the period before it acts.
    pub(super) fn recorded_lag(&self, fit: &Fit) -> Option<ActiveEffect> {
        let late = delay(&fit.model)?;
        let std = std_of_delay(fit);
        let period = self.judge.fitting.datasets[0].dt;
        let most = if late.values[0] < 0.0 { 1.5 * period } else { 0.5 * period };
        (late.values[0].abs() < most + 3.0 * std).then(|| late.clone())
    }

    /// Whether `name` is an effect on the time of the torques that belongs to the recording: a delay that sampling explains, or
    /// by which they are recorded earlier than any controller holds or computes them; or the smoothing of the angles.
    pub(super) fn is_of_recording(&self, fit: &Fit, name: &str) -> bool {
        let is_early = || delay(&fit.model).is_some_and(|late| late.values[0] < 0.0);
        let is_own_delay = name == DELAY && self.lag != Lag::InModel;
        (is_own_delay && (self.recorded_lag(fit).is_some() || is_early())) || self.is_smoothing(fit, name)
    }

    /// Whether `name` is a filter of the torque with which the recorder's delay is earlier than a held command, by most of the
    /// time by which the filter is late: both together are the smoothing of the angles, which the torque lacks.
    fn is_smoothing(&self, fit: &Fit, name: &str) -> bool {
        let Some(late) = delay(&fit.model).filter(|_| self.lag == Lag::InModel).map(|late| late.values[0]) else {
            return false;
        };
        let is_undone = |filter: &ActiveEffect| filter.sensor_memory() > 0.0 && -late > 0.5 * filter.values[0];
        let held = -0.5 * self.judge.fitting.datasets[0].dt;
        late + 3.0 * std_of_delay(fit) < held
            && fit.model.effects.iter().any(|a| a.effect.name() == name && is_undone(a))
    }

    /// Whether the smoothing of coarse angles is in the model as a filter next to an earlier delay: the filter will be refused.
    pub(super) fn is_smoothed(&self, fit: &Fit) -> bool {
        self.judge.fitting.datasets.iter().any(Dataset::blurs_reversals)
            && fit.model.effects.iter().any(|a| self.is_smoothing(fit, a.effect.name()))
    }
}

/// Standard error of the delay in a fit, s; zero if it is not estimated.
fn std_of_delay(fit: &Fit) -> f64 {
    let own = fit.parameters.iter().find(|p| p.param.effect == DELAY);
    own.map(|p| p.std).filter(|std| std.is_finite()).unwrap_or(0.0)
}

fn delay(model: &Model) -> Option<&ActiveEffect> {
    model.effects.iter().find(|a| a.effect.name() == DELAY)
}

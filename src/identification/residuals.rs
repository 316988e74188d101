//! [`Residuals`]: measured minus predicted channels of recordings.

use std::ops::Range;

use super::fit::{FitError, kinematics};
use super::prediction::{Channels, KeptColumns, predict, predict_knowing};
use super::{Dataset, NoiseLevel};
use crate::model::Model;

/// Residuals of a model along recordings.
#[derive(Clone, Debug, Default)]
pub struct Residuals {
    /// Measured − predicted, N·m or N, per recording and channel.
    pub series: Vec<Channels>,
    /// Samples of each recording that do not count in the RMS, see [`Dataset::near_reversals`].
    uncounted: Vec<Vec<Range<usize>>>,
    /// Root mean square of each channel over all recordings, N·m or N.
    pub rms: Vec<f64>,
}

/// Errors of a model on recordings that no fit uses.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldOut {
    /// RMS residual of each channel, N·m or N.
    pub rms: Vec<f64>,
    /// Pooled noise of each channel in these recordings, N·m or N.
    pub noise_floor: Vec<f64>,
}

impl HeldOut {
    /// Errors of `model` on the recordings `held_out`; `None` without any.
    ///
    /// # Errors
    /// [`FitError::Kinematics`] if the inverse dynamics fail at a measured pose.
    pub fn new(model: &Model, held_out: &[Dataset]) -> Result<Option<Self>, FitError> {
        if held_out.is_empty() {
            return Ok(None);
        }
        let residuals = Residuals::new(model, held_out)?;
        let noise_floor = NoiseLevel::of(model, held_out).with_repeats(held_out, &residuals).0.pooled;
        Ok(Some(Self { rms: residuals.rms, noise_floor }))
    }
}

impl Residuals {
    /// Residuals of `model` along `datasets`, without refitting.
    ///
    /// # Errors
    /// [`FitError::Kinematics`] if the inverse dynamics fail at a measured pose.
    pub fn new(model: &Model, datasets: &[Dataset]) -> Result<Self, FitError> {
        let one = |dataset: &Dataset| {
            let predicted = predict(&dataset.plant(model), dataset).map_err(kinematics(dataset))?;
            Ok(subtracted(dataset, &predicted))
        };
        Ok(Self::counting(datasets.iter().map(one).collect::<Result<_, _>>()?, datasets.iter().map(near).collect()))
    }

    /// Residuals of `model` along recordings whose columns are kept from one model to the next.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn along(model: &Model, recordings: &[KeptColumns]) -> Result<Self, FitError> {
        let one = |kept: &KeptColumns| {
            let (plant, dataset) = (kept.dataset.plant(model), kept.dataset);
            let predicted = kept.laws(&plant).and_then(|known| predict_knowing(&plant, dataset, &known));
            Ok(subtracted(dataset, &predicted.map_err(kinematics(dataset))?))
        };
        Ok(Self::along_these(recordings, recordings.iter().map(one).collect::<Result<_, _>>()?))
    }

    /// The residuals `series` of recordings.
    pub(super) fn along_these(recordings: &[KeptColumns], series: Vec<Channels>) -> Self {
        Self::counting(series, recordings.iter().map(|kept| near(kept.dataset)).collect())
    }

    /// Residuals of one recording with the given `predicted` channels.
    pub fn of(dataset: &Dataset, predicted: &[Vec<f64>]) -> Self {
        Self::counting(vec![subtracted(dataset, predicted)], vec![near(dataset)])
    }

    /// Residuals of channel `c`, all recordings in sequence.
    ///
    /// # Panics
    /// If a recording has no channel `c`.
    pub fn channel(&self, c: usize) -> Vec<f64> {
        self.series.iter().flat_map(|recording| &recording[c]).copied().collect()
    }

    /// Change of the prediction from the model of these residuals to the model of `other`, N·m or N.
    pub fn minus(&self, other: &Self) -> Self {
        let of =
            |(a, b): (&Channels, &Channels)| -> Channels { a.iter().zip(b).map(|(a, b)| difference(a, b)).collect() };
        Self::counting(self.series.iter().zip(&other.series).map(of).collect(), self.uncounted.clone())
    }

    /// These residuals times a factor.
    pub fn times(&self, factor: f64) -> Self {
        let of = |recording: &Channels| -> Channels {
            recording.iter().map(|series| series.iter().map(|r| factor * r).collect()).collect()
        };
        Self::counting(self.series.iter().map(of).collect(), self.uncounted.clone())
    }

    /// Residuals restricted to the samples `kept` of each recording.
    ///
    /// # Panics
    /// If a recording lacks a sample of `kept`.
    pub fn at(&self, kept: &[Vec<usize>]) -> Self {
        let of = |(recording, kept): (&Channels, &Vec<usize>)| -> Channels {
            recording.iter().map(|series| kept.iter().map(|&k| series[k]).collect()).collect()
        };
        self.series.iter().zip(kept).map(of).collect::<Vec<_>>().into()
    }

    /// Samples that do not count in the RMS, relative to the noise `sigma` of each recording and channel, N·m or N: root mean
    /// square over all channels, and share of the squares above the noise of all samples.
    pub fn uncounted(&self, sigma: &[Vec<f64>]) -> (f64, f64) {
        let (mut uncounted, mut all, mut samples) = (0.0, 0.0, 0);
        for ((recording, out), sigma) in self.series.iter().zip(&self.uncounted).zip(sigma) {
            for (series, sigma) in recording.iter().zip(sigma).filter(|(_, sigma)| **sigma > 0.0) {
                let above = |samples: &[f64]| samples.iter().map(|r| (r / sigma).powi(2) - 1.0).sum::<f64>();
                uncounted += out.iter().map(|range| above(&series[range.clone()])).sum::<f64>();
                samples += out.iter().map(ExactSizeIterator::len).sum::<usize>();
                all += above(series);
            }
        }
        ((uncounted / samples.max(1) as f64 + 1.0).sqrt(), uncounted / all)
    }

    /// Residuals in whose RMS the samples `uncounted` of each recording do not count.
    fn counting(series: Vec<Channels>, uncounted: Vec<Vec<Range<usize>>>) -> Self {
        let channels = series.iter().map(Vec::len).min().unwrap_or(0);
        let rms = |c: usize| {
            let counted = |(own, out): (&Channels, &Vec<Range<usize>>)| outside(out, own[c].len());
            let all = series.iter().zip(&uncounted).map(counted).collect::<Vec<_>>();
            let parts = series.iter().zip(&all).flat_map(|(own, ranges)| ranges.iter().map(|r| &own[c][r.clone()]));
            root_mean_square(parts.flatten())
        };
        let rms = (0..channels).map(rms).collect();
        Self { series, uncounted, rms }
    }
}

impl From<Vec<Channels>> for Residuals {
    fn from(series: Vec<Channels>) -> Self {
        let uncounted = vec![Vec::new(); series.len()];
        Self::counting(series, uncounted)
    }
}

/// What is left of 0..`len` without `ranges`, which are in order.
fn outside(ranges: &[Range<usize>], len: usize) -> Vec<Range<usize>> {
    let starts = std::iter::once(0).chain(ranges.iter().map(|r| r.end.min(len)));
    let ends = ranges.iter().map(|r| r.start.min(len)).chain(std::iter::once(len));
    starts.zip(ends).map(|(start, end)| start..end).collect()
}

fn near(dataset: &Dataset) -> Vec<Range<usize>> {
    dataset.near_reversals.clone()
}

fn subtracted(dataset: &Dataset, predicted: &[Vec<f64>]) -> Channels {
    dataset.measured.iter().zip(predicted).map(|(m, p)| difference(m, p)).collect()
}

/// Measured − predicted, sample by sample; its length is that of the shorter series.
pub fn difference(measured: &[f64], predicted: &[f64]) -> Vec<f64> {
    measured.iter().zip(predicted).map(|(m, p)| m - p).collect()
}

/// Root mean square of a series; zero for an empty one.
pub fn rms(series: &[f64]) -> f64 {
    root_mean_square(series.iter())
}

fn root_mean_square<'a>(series: impl Iterator<Item = &'a f64> + Clone) -> f64 {
    let n = series.clone().count().max(1);
    (series.map(|x| x * x).sum::<f64>() / n as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_of_every_recording_counts_alike() {
        let series = vec![vec![vec![3.0, 3.0], vec![1.0, 0.0]], vec![vec![6.0], vec![0.0]]];
        let residuals = Residuals::from(series);
        assert_eq!(residuals.rms, [18f64.sqrt(), (1.0 / 3.0f64).sqrt()]);
        assert_eq!(residuals.channel(0), [3.0, 3.0, 6.0]);
        assert_eq!(residuals.at(&[vec![0], vec![]]).rms, [3.0, 1.0]);
        let counting = Residuals::counting(residuals.series.clone(), vec![vec![0..1], vec![]]);
        assert_eq!(counting.rms[0], 22.5f64.sqrt());
        // Above the noise are 8, 8 and 8 of the first channel; a channel without noise does not count.
        assert_eq!(counting.uncounted(&[vec![1.0, 0.0], vec![2.0, 0.0]]), (3.0, 8.0 / 24.0));
        assert_eq!(outside(&[1..2, 4..5], 5), [0..1, 2..4, 5..5]);
        assert_eq!(residuals.times(-2.0).channel(0), [-6.0, -6.0, -12.0]);
        assert_eq!((rms(&[]), difference(&[2.0, 5.0], &[1.5])), (0.0, vec![0.5]));
    }
}

//! The stacked linear problem and the settings of the procedure.

use std::ops::Range;

use super::Error;
use super::gram::dot;
use crate::recording::Series;

/// Stacked linear system `y = Y θ + Σ_j Z_j c_j + ε`; every series is channel-major: the samples of channel 0, then
/// of channel 1, ….
#[derive(Clone, Debug, Default)]
pub struct Problem {
    /// Measured channels, in stacking order.
    pub channels: Vec<Channel>,
    /// Samples per channel.
    pub samples: usize,
    /// Contiguous intervals of samples, in order; filters and blocks do not cross them. Samples outside are not used.
    pub segments: Vec<Range<usize>>,
    /// Measurement, or measurement minus a prediction.
    pub y: Series,
    /// Regressors of the parameters the model already has.
    pub base: Vec<Column>,
    /// Effects the model may lack.
    pub candidates: Vec<Candidate>,
}

/// A measured channel: an axis torque, a strut force.
#[derive(Clone, Debug, Default)]
pub struct Channel {
    /// Name for reports.
    pub name: String,
    /// Standard deviation of the measurement noise, where known; no model can have a smaller residual.
    pub noise_sigma: Option<f64>,
}

/// A regressor over all channels.
#[derive(Clone, Debug, Default)]
pub struct Column {
    /// Parameter it belongs to.
    pub name: String,
    /// Series of length channels × samples.
    pub values: Series,
    /// Base columns: present parameter value, to express changes in percent. Candidate columns: the smallest
    /// coefficient of practical interest. Zero or NaN: unknown.
    pub magnitude: f64,
}

/// An effect that may be missing.
#[derive(Clone, Debug, Default)]
pub struct Candidate {
    /// Name for reports.
    pub name: String,
    /// Grid over a nonlinear shape parameter; a single entry if there is none.
    pub variants: Vec<Variant>,
}

/// A candidate at one value of its shape parameter.
#[derive(Clone, Debug, Default)]
pub struct Variant {
    /// Description of the shape parameter's value; empty if there is none.
    pub label: String,
    /// Its regressors.
    pub columns: Vec<Column>,
}

/// An effect already added.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Chosen {
    /// Index into [`Problem::candidates`].
    pub candidate: usize,
    /// Index into [`Candidate::variants`].
    pub variant: usize,
}

/// Settings of the procedure.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Family-wise false-alarm rate.
    pub alpha: f64,
    /// Number of sign flips.
    pub flips: usize,
    /// Target number of blocks of time.
    pub blocks: usize,
    /// Largest order of the whitening filter.
    pub max_order: usize,
    /// Smallest explained RMS to be reported, in units of the channel's noise.
    pub min_relevance: f64,
    /// Largest number of effects added.
    pub max_steps: usize,
    /// Seed of the sign flips.
    pub seed: u64,
}

impl Default for Settings {
    fn default() -> Self {
        Self { alpha: 0.05, flips: 999, blocks: 50, max_order: 12, min_relevance: 0.05, max_steps: 6, seed: 1 }
    }
}

impl Problem {
    /// Length of the stacked system.
    pub fn rows(&self) -> usize {
        self.channels.len() * self.samples
    }

    /// Checks that lengths and segments are consistent.
    ///
    /// # Errors
    /// If there are no channels, samples or segments, a segment is empty, out of order or outside the samples, or a
    /// series has the wrong length.
    pub fn check(&self) -> Result<(), Error> {
        let expected = self.rows();
        if expected == 0 || self.segments.is_empty() {
            return Err(Error::Empty);
        }
        let mut from = 0;
        for (i, s) in self.segments.iter().enumerate() {
            if s.start < from || s.end <= s.start || s.end > self.samples {
                return Err(Error::Segment(i));
            }
            from = s.end;
        }
        let columns = self.base.iter().chain(self.candidates.iter().flat_map(|c| &c.variants).flat_map(|v| &v.columns));
        for (name, values) in columns.map(|c| (c.name.as_str(), &c.values)).chain([("y", &self.y)]) {
            if values.len() != expected {
                return Err(Error::Length { name: name.into(), found: values.len(), expected });
            }
        }
        Ok(())
    }

    /// Sum of squares of a series per channel, over the samples that are used.
    pub fn sum_of_squares(&self, series: &[f64]) -> Vec<f64> {
        let part = |c: usize, s: &Range<usize>| &series[c * self.samples + s.start..c * self.samples + s.end];
        let one = |c: usize| self.segments.iter().map(|s| part(c, s)).map(|x| dot(x, x)).sum();
        (0..self.channels.len()).map(one).collect()
    }

    /// The variant that a choice refers to.
    ///
    /// # Errors
    /// If the problem has no such candidate or variant.
    pub fn variant(&self, chosen: Chosen) -> Result<&Variant, Error> {
        let variant = self.candidates.get(chosen.candidate).and_then(|c| c.variants.get(chosen.variant));
        variant.ok_or(Error::Chosen(chosen.candidate))
    }

    /// Base columns followed by those of the chosen effects.
    pub(super) fn left(&self, chosen: &[Chosen]) -> Result<Vec<&Column>, Error> {
        let mut left: Vec<&Column> = self.base.iter().collect();
        for &c in chosen {
            left.extend(&self.variant(c)?.columns);
        }
        Ok(left)
    }

    /// Name of the first series with a value that is not finite.
    pub(super) fn not_finite(&self) -> Option<&str> {
        let bad = |v: &[f64]| v.iter().any(|x| !x.is_finite());
        if bad(&self.y) {
            return Some("y");
        }
        let columns = self.base.iter().chain(self.candidates.iter().flat_map(|c| &c.variants).flat_map(|v| &v.columns));
        columns.into_iter().find(|c| bad(&c.values)).map(|c| c.name.as_str())
    }
}

//! What candidates of a diagnosis explain of a recording, bin by bin of time.

use serde_json::{Value, json};

use super::places::short;

/// Number of bins over the recording.
const BINS: usize = 200;

/// What is left of a recording, by channel and sample, and with one addition to the model at a time.
pub struct Alternatives {
    /// Without any.
    pub before: Vec<Vec<f64>>,
    /// With each.
    pub with: Vec<Addition>,
}

/// An addition to a model.
pub struct Addition {
    /// What was added.
    pub name: String,
    /// Whether all parameters were fitted with it.
    pub refitted: bool,
    /// What is left, by channel and sample.
    pub left: Vec<Vec<f64>>,
}

/// Sums of squares per bin of time `t` of what is left before (channel, bin) and with every addition (addition, channel,
/// bin), in units of the squared noise, or of N·m and N where it is not known; null without additions.
pub fn of(alternatives: &Alternatives, t: &[f64], noise: &[f64]) -> Value {
    let Some(bins) = Bins::of(t).filter(|_| !alternatives.with.is_empty()) else { return Value::Null };
    let scale = |c: usize| noise.get(c).copied().filter(|n| *n > 0.0).unwrap_or(1.0);
    let channel =
        |(c, series): (usize, &Vec<f64>)| -> Value { bins.squares(series, scale(c)).into_iter().map(short).collect() };
    let sums = |left: &[Vec<f64>]| -> Value { left.iter().enumerate().map(channel).collect() };
    json!({
        "first": bins.first, "width": bins.width, "samples": bins.samples(),
        "before": sums(&alternatives.before),
        "names": alternatives.with.iter().map(|a| a.name.as_str()).collect::<Vec<_>>(),
        "refitted": alternatives.with.iter().map(|a| a.refitted).collect::<Vec<_>>(),
        "after": alternatives.with.iter().map(|a| sums(&a.left)).collect::<Vec<_>>(),
    })
}

/// Bins of time of equal width, s.
struct Bins {
    first: f64,
    width: f64,
    /// Bin of every sample.
    of: Vec<usize>,
}

impl Bins {
    /// Bins over all times; `None` without a span.
    fn of(t: &[f64]) -> Option<Self> {
        let (first, last) = (*t.first()?, *t.last()?);
        let width = (last - first) / BINS as f64;
        let of = t.iter().map(|t| (((t - first) / width) as usize).min(BINS - 1)).collect();
        (width > 0.0).then_some(Self { first, width, of })
    }

    fn samples(&self) -> Vec<usize> {
        let mut count = vec![0; BINS];
        self.of.iter().for_each(|bin| count[*bin] += 1);
        count
    }

    /// Sum of (x/scale)² in every bin.
    fn squares(&self, series: &[f64], scale: f64) -> Vec<f64> {
        let mut sums = vec![0.0; BINS];
        self.of.iter().zip(series).for_each(|(bin, x)| sums[*bin] += (x / scale).powi(2));
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_sample_is_in_the_bin_of_its_time() {
        // Two samples per bin, the last time in the last bin; a gap leaves bins empty. Binary fractions, so that edges are exact.
        let t: Vec<f64> = (0..=400).filter(|k| !(100..300).contains(k)).map(|k| 5.0 + f64::from(k) / 128.0).collect();
        let bins = Bins::of(&t).unwrap();
        assert_eq!(bins.width, 2.0 / 128.0);
        let samples = bins.samples();
        assert_eq!((samples.iter().sum::<usize>(), samples[100], samples[199]), (201, 0, 3));
        let series: Vec<f64> = t.iter().map(|t| if *t > 7.0 { 3.0 } else { 1.0 }).collect();
        let squares = bins.squares(&series, 0.5);
        assert_eq!((squares[3], squares[100], squares[199]), (8.0, 0.0, 108.0));
        assert!(Bins::of(&[1.0, 1.0]).is_none() && Bins::of(&[]).is_none());
    }
}

//! Steps of the times: gaps, rounded times, unequal steps.

use std::ops::Range;

use deltatwin::recording::{is_even, sample_time};
use deltatwin::text::significant;

use super::{MIN_SAMPLES, Table};
use crate::recording::ReadError;

/// Longest gap, in sampling periods, between samples of one segment: four widths of the smoother of the longest time scale
/// (`src/identification/derivatives.rs`), beyond which neither side depends on the other. Shorter ones it judges itself.
const LONGEST_GAP: f64 = 100.0;
/// Step, in sampling periods, from which samples are missing.
const GAP: f64 = 1.5;

impl Table {
    /// Splits at gaps that nothing bridges; all other samples keep their times.
    pub(super) fn sampling(&mut self, warnings: &mut Vec<String>) -> Result<Vec<Range<usize>>, ReadError> {
        let step = sample_time(&self.t);
        let width = |i: usize| self.t[i] - self.t[i - 1];
        let gaps: Vec<usize> = (1..self.t.len()).filter(|&i| width(i) > GAP * step).collect();
        let (long, short): (Vec<usize>, Vec<usize>) = gaps.iter().partition(|&&i| width(i) > LONGEST_GAP * step);
        for (gaps, end) in [(&short, "samples keep their times"), (&long, "samples before and after are kept apart")] {
            let Some(&longest) = gaps.iter().max_by(|&&a, &&b| width(a).total_cmp(&width(b))) else { continue };
            let (width, at) = (significant(width(longest), 3), self.at(longest));
            warnings.push(match gaps.len() {
                1 => format!("gap of {width} s before {at}: {end}"),
                n => format!("{n} gaps of up to {width} s, the longest before {at}: {end}"),
            });
        }
        let starts = std::iter::once(0).chain(long.iter().copied());
        let all: Vec<Range<usize>> =
            starts.zip(long.iter().copied().chain([self.t.len()])).map(|(a, b)| a..b).collect();
        let (stretches, few): (Vec<_>, Vec<_>) = all.into_iter().partition(|r| r.len() >= MIN_SAMPLES);
        if let Some(first) = few.first() {
            let count: usize = few.iter().map(|r| r.len()).sum();
            let at = self.at(first.start);
            warnings.push(format!(
                "{count} samples in {} pieces shorter than {MIN_SAMPLES}, the first from {at}: dropped",
                few.len()
            ));
        }
        if stretches.is_empty() {
            let problem = format!("no {MIN_SAMPLES} samples in a row without a gap of {LONGEST_GAP} sampling periods");
            return Err(ReadError::content(&self.file, problem, "more samples in a row"));
        }
        if stretches.iter().all(|r| is_even(&self.t[r.clone()], step)) {
            return Ok(self.pick(&stretches));
        }
        let steps = || (1..self.t.len()).map(width).filter(|w| *w <= GAP * step);
        let percent = significant(steps().map(|w| 100.0 * (w / step - 1.0).abs()).fold(0.0, f64::max), 3);
        if let Some((digit, times)) = rounded(&self.t, &stretches) {
            for (r, t) in stretches.iter().zip(times) {
                self.t[r.clone()].copy_from_slice(&t);
            }
            warnings.push(format!("time is rounded to {digit} s, steps vary by {percent} %: taken as uniform"));
        } else if !steps().all(|w| (w / step - 1.0).abs() <= 0.01) {
            let period = significant(step, 3);
            warnings.push(format!("time steps vary by up to {percent} % of {period} s: samples keep their times"));
        }
        Ok(self.pick(&stretches))
    }

    /// Keeps only the samples in `stretches` and returns their new ranges.
    fn pick(&mut self, stretches: &[Range<usize>]) -> Vec<Range<usize>> {
        if stretches.iter().map(|r| r.len()).sum::<usize>() == self.t.len() {
            return stretches.to_vec();
        }
        let cut = |v: &Vec<f64>| stretches.iter().flat_map(|r| &v[r.clone()]).copied().collect();
        self.t = cut(&self.t);
        for c in &mut self.columns {
            c.values = cut(&c.values);
        }
        let mut start = 0;
        let consecutive = stretches.iter().map(|r| {
            start += r.len();
            start - r.len()..start
        });
        consecutive.collect()
    }
}

/// Sampling period and uniform times of each segment, if the recorded times differ from them by at most their last
/// digit.
fn rounded(t: &[f64], stretches: &[Range<usize>]) -> Option<(f64, Vec<Vec<f64>>)> {
    let multiple = |digit: i32| {
        let k = 10f64.powi(digit);
        t.iter().all(|v| (v * k - (v * k).round()).abs() < 1e-3)
    };
    let digit = (0..=7).find(|&d| multiple(d))?;
    let unit = 1.0 / 10f64.powi(digit);
    let mut times = Vec::new();
    for r in stretches {
        let (first, last, n) = (t[r.start], t[r.end - 1], r.len());
        let uniform: Vec<f64> = (0..n).map(|k| first + (last - first) * k as f64 / (n - 1) as f64).collect();
        if t[r.clone()].iter().zip(&uniform).any(|(a, b)| (a - b).abs() > 1.001 * unit) {
            return None;
        }
        times.push(uniform);
    }
    Some((unit, times))
}

//! Segments with uniform sampling.

use std::ops::Range;

use deltatwin::recording::sample_time;

use super::{MIN_SAMPLES, Table};
use crate::recording::ReadError;

/// Smallest number of samples of a segment between gaps; shorter ones are dropped.
const SHORTEST_STRETCH: usize = 10;
/// Largest relative deviation of a sampling step from the median that counts as uniform.
const JITTER: f64 = 0.01;

impl Table {
    /// Splits at gaps, and resamples segments that are not uniform.
    pub(super) fn sampling(&mut self, warnings: &mut Vec<String>) -> Result<Vec<Range<usize>>, ReadError> {
        let step = sample_time(&self.t);
        // One or two lost samples are interpolated, unless the sampling period is too long for that.
        let gap = (1.5 * step).max((3.5 * step).min(5e-3));
        let mut stretches = Vec::new();
        let mut start = 0;
        for i in 1..=self.t.len() {
            if i == self.t.len() || self.t[i] - self.t[i - 1] > gap {
                if i < self.t.len() {
                    let width = self.t[i] - self.t[i - 1];
                    let problem = format!("gap of {width:.6} s before {}", self.at(i));
                    warnings.push(format!("{problem}: samples before and after are kept apart"));
                }
                if i - start >= SHORTEST_STRETCH {
                    stretches.push(start..i);
                } else {
                    warnings.push(format!("{} samples from {} dropped", i - start, self.at(start)));
                }
                start = i;
            }
        }
        limit_number(warnings, "gap of", 10);
        limit_number(warnings, "samples from", 10);
        let total: usize = stretches.iter().map(|r| r.len()).sum();
        if total < MIN_SAMPLES {
            let problem = format!("only {total} samples remain between gaps in time");
            return Err(ReadError::content(&self.file, problem, format!("at least {MIN_SAMPLES}")));
        }
        let deviation = |r: &Range<usize>| {
            let steps = self.t[r.clone()].windows(2);
            steps.map(|w| (w[1] - w[0] - step).abs() / step).fold(0.0, f64::max)
        };
        let worst = stretches.iter().map(deviation).fold(0.0, f64::max);
        if worst <= JITTER {
            return Ok(self.pick(&stretches));
        }
        let percent = 100.0 * worst;
        if let Some((digit, times)) = rounded(&self.t, &stretches) {
            for (r, t) in stretches.iter().zip(times) {
                self.t[r.clone()].copy_from_slice(&t);
            }
            warnings.push(format!("time is rounded to {digit} s, steps vary by {percent:.1} %: taken as uniform"));
            return Ok(self.pick(&stretches));
        }
        warnings
            .push(format!("time steps vary by up to {percent:.1} %: resampled to {step:.6e} s by cubic interpolation"));
        let stretches = self.resample(&stretches, step);
        if self.t.len() < MIN_SAMPLES {
            let problem = "hardly any samples remain after resampling";
            return Err(ReadError::content(&self.file, problem, "evenly sampled signals"));
        }
        Ok(stretches)
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
        consecutive(stretches.iter().map(|r| r.len()))
    }

    fn resample(&mut self, stretches: &[Range<usize>], step: f64) -> Vec<Range<usize>> {
        let mut t = Vec::new();
        let mut stencils = Vec::new();
        let mut lengths = Vec::new();
        for r in stretches {
            let (first, last) = (self.t[r.start], self.t[r.end - 1]);
            let mut kept = vec![r.start]; // Samples almost on top of each other would only amplify noise.
            kept.extend((r.start + 1..r.end).filter({
                let mut previous = first;
                let times = &self.t;
                move |&i| {
                    let keep = times[i] - previous >= 0.3 * step;
                    if keep {
                        previous = times[i];
                    }
                    keep
                }
            }));
            if kept.len() < 4 {
                continue;
            }
            let count = ((last - first) / step + 1e-6) as usize + 1;
            let mut j = 0;
            for k in 0..count {
                let x = first + k as f64 * step;
                while j + 2 < kept.len() && self.t[kept[j + 1]] <= x {
                    j += 1;
                }
                let s = j.saturating_sub(1).min(kept.len() - 4);
                let nodes = [kept[s], kept[s + 1], kept[s + 2], kept[s + 3]];
                stencils.push((nodes, lagrange(nodes.map(|i| self.t[i]), x)));
                t.push(x);
            }
            lengths.push(count);
        }
        for c in &mut self.columns {
            let value = |(nodes, weights): &([usize; 4], [f64; 4])| {
                nodes.iter().zip(weights).map(|(&i, w)| w * c.values[i]).sum()
            };
            c.values = stencils.iter().map(value).collect();
        }
        self.t = t;
        consecutive(lengths.into_iter())
    }
}

fn consecutive(lengths: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    let mut start = 0;
    lengths
        .map(|n| {
            start += n;
            start - n..start
        })
        .collect()
}

/// Keeps the first `most` warnings that contain `pattern` and counts the others.
fn limit_number(warnings: &mut Vec<String>, pattern: &str, most: usize) {
    let count = warnings.iter().filter(|w| w.contains(pattern)).count();
    if count > most {
        let mut seen = 0;
        warnings.retain(|w| {
            seen += usize::from(w.contains(pattern));
            !w.contains(pattern) || seen <= most
        });
        warnings.push(format!("{} more like \"{pattern} …\"", count - most));
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

/// Weights of cubic Lagrange interpolation through four points at `x`.
fn lagrange(nodes: [f64; 4], x: f64) -> [f64; 4] {
    std::array::from_fn(|i| {
        let others = (0..4).filter(|&j| j != i);
        others.map(|j| (x - nodes[j]) / (nodes[i] - nodes[j])).product()
    })
}

//! Dependence of a residual on a quantity, by means per bin that are validated between two halves of the data.

/// Number of bins along one quantity.
const BINS: usize = 24;
/// Number of blocks of time assigned alternately to two halves; a pattern must occur in both.
const BLOCKS: usize = 32;
/// Least number of samples of each half in a bin that is used.
const MIN_SAMPLES: usize = 8;
/// Ratio to the largest rate below which an axis is near a reversal.
const NEAR_REVERSAL: f64 = 0.05;

/// A partition of the samples.
pub struct Partition {
    /// Bin of each sample.
    pub bin: Vec<usize>,
    /// Number of bins.
    pub bins: usize,
}

impl Partition {
    /// Partition into bins of equal count along `x`.
    pub fn along(x: &[f64]) -> Self {
        Self { bin: quantiles(x, BINS), bins: BINS }
    }

    /// Partition into 4 × 4 × 3 cells of equal count along each coordinate.
    pub fn cells(points: &[[f64; 3]]) -> Self {
        const CELLS: [usize; 3] = [4, 4, 3];
        let along = |k: usize| quantiles(&points.iter().map(|p| p[k]).collect::<Vec<_>>(), CELLS[k]);
        let [x, y, z] = [along(0), along(1), along(2)];
        let bin = (0..points.len()).map(|i| (x[i] * CELLS[1] + y[i]) * CELLS[2] + z[i]).collect();
        Self { bin, bins: CELLS.iter().product() }
    }

    /// Samples of one bin.
    pub fn members(&self, bin: usize) -> impl Iterator<Item = usize> {
        self.bin.iter().enumerate().filter(move |(_, b)| **b == bin).map(|(i, _)| i)
    }

    /// Part of `r` explained by the means of the bins.
    pub fn explain(&self, r: &[f64]) -> Explained {
        let n = r.len();
        let mut sums = vec![[0.0; 2]; self.bins];
        let mut counts = vec![[0usize; 2]; self.bins];
        for (i, &b) in self.bin.iter().enumerate() {
            let half = i * BLOCKS / n.max(1) % 2;
            sums[b][half] += r[i];
            counts[b][half] += 1;
        }
        let total: f64 = r.iter().map(|v| v * v).sum();
        let (mut common, mut largest) = (0.0, (0, 0.0));
        let mut means = vec![0.0; self.bins];
        for b in 0..self.bins {
            let (s, c) = (sums[b], counts[b]);
            if c.iter().any(|&c| c < MIN_SAMPLES) {
                continue;
            }
            // The product of two independent estimates of a mean of zero has expectation zero.
            let [first, second] = [0, 1].map(|h| s[h] / c[h] as f64);
            common += (c[0] + c[1]) as f64 * first * second;
            means[b] = (s[0] + s[1]) / (c[0] + c[1]) as f64;
            if first * second > 0.0 && means[b].abs() > f64::abs(largest.1) {
                largest = (b, means[b]);
            }
        }
        let share = if total > 0.0 { (common / total).max(0.0) } else { 0.0 };
        Explained { share, bin: largest.0, mean: largest.1, means }
    }
}

/// Part explained by the means of a partition's bins.
pub struct Explained {
    /// Share of the mean square that occurs in both halves.
    pub share: f64,
    /// Bin of the largest absolute mean.
    pub bin: usize,
    /// Its mean.
    pub mean: f64,
    /// Means of all bins.
    pub means: Vec<f64>,
}

/// Index of the quantile, of `count`, of each value; equal values share one.
fn quantiles(x: &[f64], count: usize) -> Vec<usize> {
    let mut sorted = x.to_vec();
    sorted.sort_by(f64::total_cmp);
    let edges: Vec<f64> = (1..count).filter_map(|k| sorted.get(k * x.len() / count).copied()).collect();
    x.iter().map(|v| edges.partition_point(|e| e <= v)).collect()
}

/// Excess of a residual near an axis' reversals over elsewhere.
pub struct Reversal {
    /// Share of the mean square in excess of the level elsewhere.
    pub share: f64,
    /// Rate below which the axis is near a reversal, in the unit of `rate`.
    pub near: f64,
    /// RMS near reversals and elsewhere.
    pub rms: [f64; 2],
}

/// Excess of `r` where |`rate`| is small; `None` if the axis never or mostly reverses.
pub fn reversal(rate: &[f64], r: &[f64]) -> Option<Reversal> {
    let near = NEAR_REVERSAL * rate.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
    let (mut squares, mut counts) = ([0.0; 2], [0usize; 2]);
    for (v, r) in rate.iter().zip(r) {
        let far = usize::from(v.abs() > near);
        squares[far] += r * r;
        counts[far] += 1;
    }
    if near <= 0.0 || counts[0] < 50 || counts[1] < counts[0] {
        return None;
    }
    let mean = |k: usize| squares[k] / counts[k] as f64;
    let excess = counts[0] as f64 * (mean(0) - mean(1));
    let share = excess / (squares[0] + squares[1]).max(f64::MIN_POSITIVE);
    Some(Reversal { share, near, rms: [mean(0).sqrt(), mean(1).sqrt()] })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut state = seed;
        let mut uniform = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        (0..n).map(|_| uniform() + uniform() + uniform()).collect()
    }

    #[test]
    fn noise_with_memory_sits_nowhere() {
        // AR(1) with a correlation time of 50 samples along a motion of period 1000.
        for seed in 1..20 {
            let mut last = 0.0;
            let r: Vec<f64> = noise(20_000, seed)
                .into_iter()
                .map(|e| {
                    last = 0.98 * last + e;
                    last
                })
                .collect();
            let x: Vec<f64> = (0..r.len()).map(|k| (k as f64 * 6.283e-3).sin()).collect();
            let share = Partition::along(&x).explain(&r).share;
            assert!(share < 0.05, "{seed}: {share}");
        }
    }

    #[test]
    fn a_pattern_has_the_share_it_was_given() {
        let n = 20_000;
        let x: Vec<f64> = (0..n).map(|k| (k as f64 * 6.283e-3).sin()).collect();
        // x² has the mean 1/2, the noise 1/4: two thirds.
        let r: Vec<f64> = noise(n, 3).iter().zip(&x).map(|(e, x)| e + x).collect();
        let found = Partition::along(&x).explain(&r);
        assert!((found.share - 2.0 / 3.0).abs() < 0.03, "{}", found.share);
        assert!(found.mean.abs() > 0.9, "{}", found.mean);
    }

    #[test]
    fn near_a_reversal_means_near() {
        let n = 20_000;
        let rate: Vec<f64> = (0..n).map(|k| 2.0 * (k as f64 * 6.283e-3).sin()).collect();
        let quiet = noise(n, 5);
        let even = reversal(&rate, &quiet).unwrap();
        assert!(even.share.abs() < 0.02 && even.near <= 0.11, "{} {}", even.share, even.near);
        let loud: Vec<f64> = quiet.iter().zip(&rate).map(|(e, v)| if v.abs() < 0.1 { 5.0 * e } else { *e }).collect();
        assert!(reversal(&rate, &loud).unwrap().share > 0.3);
        // A residual that grows with speed has no excess near reversals.
        let fast: Vec<f64> = quiet.iter().zip(&rate).map(|(e, v)| e * (1.0 + v.abs())).collect();
        assert!(reversal(&rate, &fast).unwrap().share < 0.0);
    }
}

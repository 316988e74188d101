//! Family-wise p values by common sign flips of the block scores [Kline 2012; Westfall 1993].

use nalgebra::DMatrix;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::problem::Settings;
use super::score::tail;
use crate::numerics::parallel;

/// Draws per batch.
const BATCH: usize = 128;

/// Family-wise p of every marginal p: `p_adj = (1 + #{min_i p_i* ≤ p}) / (flips + 1)`. The matrices hold the
/// standardised block scores (rank × B) of all variants of all candidates; common signs preserve the correlation of
/// the candidates.
pub fn family_wise(scores: &[&DMatrix<f64>], marginal: &[f64], blocks: usize, flips: usize, seed: u64) -> Vec<f64> {
    let smallest = smallest_p(scores, blocks, flips, seed);
    let adjust = |p: &f64| {
        let bound = p * (1.0 + 1e-9);
        let hits = smallest.iter().filter(|&&s| s <= bound).count();
        (1 + hits) as f64 / (flips + 1) as f64
    };
    marginal.iter().map(adjust).collect()
}

/// Largest marginal p whose family-wise p is below `alpha`.
pub fn critical(scores: &[&DMatrix<f64>], blocks: usize, settings: &Settings) -> f64 {
    let mut smallest = smallest_p(scores, blocks, settings.flips, settings.seed);
    smallest.sort_by(f64::total_cmp);
    let hits = (settings.alpha * (settings.flips + 1) as f64).ceil() as usize;
    // One draw fewer than the level allows must be below it.
    hits.checked_sub(2).and_then(|i| smallest.get(i)).copied().unwrap_or(0.0)
}

/// The smallest p over all variants for every draw.
fn smallest_p(scores: &[&DMatrix<f64>], blocks: usize, flips: usize, seed: u64) -> Vec<f64> {
    let mut order: Vec<&DMatrix<f64>> = scores.iter().copied().filter(|s| s.nrows() > 0).collect();
    // Among variants of equal rank the smallest p belongs to the largest T: one tail evaluation per rank.
    order.sort_by_key(|s| s.nrows());
    let width = order.iter().map(|s| s.nrows()).sum();
    let mut stacked = DMatrix::zeros(width, blocks);
    let mut at = 0;
    for s in &order {
        stacked.rows_mut(at, s.nrows()).copy_from(s);
        at += s.nrows();
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let signs: Vec<f64> = (0..flips * blocks).map(|_| if rng.random::<bool>() { 1.0 } else { -1.0 }).collect();
    let batches: Vec<&[f64]> = signs.chunks((BATCH * blocks).max(1)).collect();
    let batch = |i: usize| -> Vec<f64> {
        let signs = batches[i];
        let draws = signs.len() / blocks.max(1);
        let sums = &stacked * DMatrix::from_column_slice(blocks, draws, signs);
        sums.column_iter().map(|sum| smallest(&order, sum.as_slice(), blocks)).collect()
    };
    parallel::map(batches.len(), batch).concat()
}

/// The smallest p given the sums of the signed scores.
fn smallest(order: &[&DMatrix<f64>], sums: &[f64], blocks: usize) -> f64 {
    let (mut least, mut at, mut rank, mut largest) = (1.0_f64, 0, 0, 0.0_f64);
    for s in order {
        let m = s.nrows();
        if m != rank {
            least = least.min(tail(largest, rank, blocks));
            (rank, largest) = (m, 0.0);
        }
        let t: f64 = sums[at..at + m].iter().map(|x| x * x).sum();
        largest = largest.max(t.min(blocks as f64));
        at += m;
    }
    least.min(tail(largest, rank, blocks))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_scores_are_as_significant_as_the_draws_allow() {
        let strong = DMatrix::from_element(1, 40, (1.0_f64 / 40.0).sqrt());
        let p = family_wise(&[&strong], &[tail(40.0, 1, 40), 1.0], 40, 999, 3);
        assert_eq!(p, [0.001, 1.0]);
        assert!(family_wise(&[], &[1.0], 40, 99, 3)[0] >= 1.0);
    }
}

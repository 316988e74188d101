//! Pairwise comparison of candidates with the best one by their block losses
//! [Hansen 2011; Vuong 1989].

use nalgebra::{DMatrix, DVector};

use super::base_fit::BaseFit;
use super::describe::{Entry, searched};
use super::gram::Pass;
use super::problem::Problem;
use super::ranking::Assessment;
use super::score::Scores;
use super::special::t_quantile;

/// Overlap above which two effects are indistinguishable on these motions even without noise.
pub const SAME: f64 = 0.999;

/// Overlap from which an effect with more parameters contains the best one exactly, so that the simpler one is named.
const CONTAINED: f64 = 1.0 - 1e-7;

/// One-sided confidence level of the pairwise tests.
pub const LEVEL: f64 = 0.95;

/// Share of the best one's gain below which a rival does not explain the same, and difference of the gains, in units of
/// the noise, from which that is clear whatever single blocks say.
const REACHES: (f64, f64) = (0.5, 100.0);

/// Share of the error above the noise from which the best one explains much of it, and share of that below which a rival is too
/// faint to be the same, however well it fits the fast part that whitened evidence counts.
const FAINT: (f64, f64) = (0.2, 0.1);

/// Block losses of adding a candidate, relative to adding nothing: `−2 cᵀ g_b + cᵀ S_b c`.
pub fn losses(scores: &Scores, grams: &[DMatrix<f64>]) -> DVector<f64> {
    let c = &scores.sum;
    DVector::from_iterator(
        grams.len(),
        grams.iter().enumerate().map(|(b, s)| c.dot(&(s * c)) - 2.0 * c.dot(&scores.blocks.column(b))),
    )
}

/// Penalty per fitted parameter: expected optimism of a whitened fit's loss relative to new data [Akaike 1974]. A BIC
/// penalty (logarithm of the number of rows) would exclude the right effect from its confidence set wherever it has
/// more parameters than a rival that fits nearly as well.
const OPTIMISM: f64 = 2.0;

/// t statistic of the block losses `rival − best`, corrected for the optimism of `extra` more parameters of the
/// rival.
pub fn t_statistic(best: &DVector<f64>, rival: &DVector<f64>, extra: f64) -> f64 {
    let b = best.len() as f64;
    let d = (rival - best).add_scalar(extra * OPTIMISM / b);
    let mean = d.mean();
    let error = (d.map(|x| (x - mean).powi(2)).sum() / (b - 1.0).max(1.0) / b).sqrt();
    match error > 1e-12 * mean.abs() {
        true => mean / error,
        false if mean.abs() <= f64::MIN_POSITIVE => 0.0,
        false => mean.signum() * f64::INFINITY,
    }
}

/// Largest t at which a rival stays in the confidence set, for the given number of blocks.
pub fn critical(blocks: usize) -> f64 {
    t_quantile(LEVEL, blocks.saturating_sub(1).max(1) as f64)
}

impl BaseFit<'_> {
    /// Sets overlap, t statistic and the indistinguishable flag of all candidates relative to candidate `w`.
    pub fn compare(
        &self,
        problem: &Problem,
        present: &[&Entry<'_>],
        blockwise: &[Vec<DMatrix<f64>>],
        w: usize,
        candidates: &mut [Assessment],
    ) {
        let a = present[w];
        let m = a.variant.columns.len();
        let variants = std::iter::once(a).chain(present.iter().copied());
        let mut columns: Vec<&[f64]> = variants.flat_map(|e| &e.variant.columns).map(|c| &*c.values).collect();
        columns.extend(self.columns.iter().map(|c| &*c.values));
        let pass = Pass { columns, left: m, groups: Vec::new() };
        let grams = pass.run(&self.filters, problem.samples, &self.blocks);
        let total = grams.iter().fold(DMatrix::zeros(m, pass.columns.len()), |s, g| s + &g.cross);
        let base = total.columns(pass.columns.len() - self.columns.len(), self.columns.len());
        let effect = &a.projected.basis * &a.scores.sum;
        let energy = a.scores.sum.norm_squared();
        let size = |i: usize| present[i].projected.rank() as f64 + searched(problem, present[i].candidate);
        let best = losses(&a.scores, &blockwise[w]);
        let critical = critical(self.blocks.len());
        let share = |a: &Assessment| a.explained_share.unwrap_or(0.0);
        let own = share(&candidates[w]);
        let is_faint = |a: &Assessment| own > FAINT.0 && share(a) < FAINT.1 * own;
        let mut at = m;
        for (i, e) in present.iter().enumerate() {
            let k = e.variant.columns.len();
            // z⊥_aᵀ z⊥_k = Z_aᵀ Z_k − Z_aᵀ Y · (imitation of k)
            let cross = total.columns(at, k) - base * &e.projected.imitation;
            at += k;
            let shared = e.projected.basis.transpose() * cross.transpose() * &effect;
            let rival = losses(&e.scores, &blockwise[i]);
            let c = &mut candidates[i];
            c.overlap = if energy > 0.0 { (shared.norm_squared() / energy).clamp(0.0, 1.0) } else { 0.0 };
            c.t_against_best = if i == w { 0.0 } else { t_statistic(&best, &rival, size(i) - size(w)) };
            // An extension by more parameters that fits no better than those cost.
            let is_extension = c.overlap > CONTAINED && c.rank > present[w].projected.rank() && c.t_against_best >= 0.0;
            let (gain, reached) = (-best.sum(), -rival.sum());
            let is_far_behind = reached < REACHES.0 * gain && gain - reached > REACHES.1;
            let is_rival = c.t_against_best < critical && !is_far_behind && !is_faint(c);
            c.indistinguishable = i == w || (!is_extension && (is_rival || c.overlap > SAME));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_losses_are_equal() {
        let a = DVector::from_fn(20, |i, _| (i as f64).sin());
        assert_eq!(t_statistic(&a, &a, 0.0), 0.0);
        assert!(t_statistic(&a, &a.add_scalar(1.0), 0.0) > critical(20));
        assert!(t_statistic(&a, &a, 1.0) > 0.0);
    }
}

//! Confusion matrix of the ranking: the effect ranked first, given the true effect.
//!
//! The winner, each of its rivals and the null are taken as the truth in turn, at the estimated size and in noise
//! resampled from the data (common sign flips of the blocks of the winner's residual), and ranked like the data. With
//! equal prior weights, `P(truth = j | ranked first i) ∝ P(ranked first i | truth = j)`. The base parameters are
//! fitted anew in every draw; shape parameters stay at their best grid value.

use nalgebra::{DMatrix, DVector};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::base_fit::BaseFit;
use super::describe::{Entry, searched};
use super::evaluate::Entries;
use super::gram::Pass;
use super::predict::subtract;
use super::problem::{Problem, Settings};
use super::ranking::{Assessment, Ranking};
use super::score::{Scores, block_grams, obvious};
use super::special::ln_chi2_tail;
use super::{Error, sign_flips};
use crate::numerics::parallel;

/// Largest number of rivals taken as the truth.
const RIVALS: usize = 8;

/// Count added to each of the two outcomes of a truth: Jeffreys' prior of a proportion.
const UNSEEN: f64 = 0.5;

/// Relative difference of two evidences up to which they are equal: the winner goes before rivals with the same columns.
const ROUNDING: f64 = 1e-9;

/// Counts of the effect ranked first, per true effect.
#[derive(Clone, Debug, PartialEq)]
pub struct Confusion {
    /// The truths: indices into [`Problem::candidates`], the winner first; `None` is the null.
    pub truths: Vec<Option<usize>>,
    /// `counts[k][j]`: draws with truth k in which truth j was ranked first; the last entry counts all other
    /// outcomes.
    pub counts: Vec<Vec<usize>>,
    /// Draws per truth.
    pub runs: usize,
}

impl Confusion {
    /// Posterior probability of each truth, given that truth 0 was ranked first, with equal prior weights.
    pub fn probabilities(&self) -> Vec<f64> {
        let share = |counts: &Vec<usize>| (counts[0] as f64 + UNSEEN) / (self.runs as f64 + 2.0 * UNSEEN);
        let shares: Vec<f64> = self.counts.iter().map(share).collect();
        let sum: f64 = shares.iter().sum();
        shares.iter().map(|s| s / sum).collect()
    }
}

/// Confusion matrix from `runs` draws each for the winner of a ranking of `problem`, its rivals and the null; `None`
/// if the ranking has no winner.
///
/// # Errors
/// If the problem is inconsistent, too short for the tests, or not finite.
pub fn confusion(
    problem: &Problem,
    ranking: &Ranking,
    settings: &Settings,
    runs: usize,
) -> Result<Option<Confusion>, Error> {
    let Some(winner) = ranking.best else { return Ok(None) };
    let named = |i: &usize| ranking.candidates[*i].rank > 0;
    let ranked: Vec<usize> = ranking.order.iter().copied().filter(named).collect();
    let rival = |&&i: &&usize| {
        let a = &ranking.candidates[i];
        i != winner && (a.passes(settings) || a.indistinguishable)
    };
    let mut rivals: Vec<usize> = ranked.iter().filter(rival).copied().collect();
    rivals.sort_by_key(|&i| !ranking.candidates[i].indistinguishable);
    rivals.truncate(RIVALS);
    // The winner and its rivals first: their position among the assessed is their number as a truth.
    let first: Vec<usize> = std::iter::once(winner).chain(rivals).collect();
    let others = ranked.iter().copied().filter(|i| !first.contains(i));
    let assessed: Vec<&Assessment> = first.iter().copied().chain(others).map(|i| &ranking.candidates[i]).collect();
    let drawn = Drawn::new(problem, ranking, settings, &assessed, first.len())?;
    let truths = first.iter().map(|&i| Some(ranking.candidates[i].candidate)).chain([None]).collect();
    let counts = (0..=first.len())
        .map(|truth| {
            let name = |run: usize| drawn.said(truth, settings.seed.wrapping_add((truth * runs + run) as u64));
            let mut counts = vec![0; first.len() + 1];
            for name in parallel::map(runs, name) {
                counts[name.filter(|i| *i < first.len()).unwrap_or(first.len())] += 1;
            }
            counts
        })
        .collect();
    Ok(Some(Confusion { truths, counts, runs }))
}

/// Block scores of the noise and of every truth in the orthonormal coordinates of every candidate.
struct Drawn<'a> {
    settings: &'a Settings,
    entries: Vec<Entry<'a>>,
    grams: Vec<Vec<DMatrix<f64>>>,
    /// Largest relevance of each candidate per unit norm of its scores.
    relevance: Vec<f64>,
    freedom: Vec<f64>,
    /// `[candidate]`, rank × blocks.
    noise: Vec<DMatrix<f64>>,
    /// `[truth][candidate]`, rank × blocks.
    effects: Vec<Vec<DMatrix<f64>>>,
    noise_energy: f64,
    /// `[truth]`: inner product of noise and effect per block, energy of the effect.
    energies: Vec<(DVector<f64>, f64)>,
    /// Residual degrees of freedom of the base.
    rows: f64,
    blocks: usize,
    critical: f64,
}

impl<'a> Drawn<'a> {
    fn new(
        problem: &'a Problem,
        ranking: &Ranking,
        settings: &'a Settings,
        assessed: &[&Assessment],
        truths: usize,
    ) -> Result<Self, Error> {
        let mut base = BaseFit::new(problem, &ranking.chosen, settings)?.in_noise_of(problem, ranking, settings)?;
        let places = assessed.iter().map(|a| (a.candidate, a.variant)).collect();
        let Entries { list, grams, rest, .. } = base.assess(problem, places)?;
        base.update(&rest.base);
        let columns: Vec<&[f64]> = base.columns.iter().map(|c| &*c.values).collect();
        let contribution = |e: &Entry<'_>| {
            let coefficients = &e.projected.basis * &e.scores.sum;
            let own: Vec<&[f64]> = e.variant.columns.iter().map(|c| &*c.values).collect();
            let mut series = vec![0.0; problem.rows()];
            subtract(&mut series, &own, (-&coefficients).as_slice());
            subtract(&mut series, &columns, (&e.projected.imitation * &coefficients).as_slice());
            series
        };
        let effects: Vec<Vec<f64>> = list[..truths].iter().map(contribution).collect();
        // Base columns, residual and effects on the left, then the candidates.
        let p = columns.len();
        let mut all = columns.clone();
        all.push(&base.residual);
        all.extend(effects.iter().map(Vec::as_slice));
        let left = all.len();
        all.extend(list.iter().flat_map(|e| &e.variant.columns).map(|c| &*c.values));
        let pass = Pass { columns: all, left, groups: Vec::new() };
        let products = pass.run(&base.filters, problem.samples, &base.blocks);
        let scores = |series: usize, e: &Entry<'_>| {
            let (m, start) = (e.variant.columns.len(), e.at - (p + 1) + left);
            let mut blocks = DMatrix::zeros(e.projected.rank(), products.len());
            for (b, g) in products.iter().enumerate() {
                let raw = g.cross.view((series, start), (1, m)).transpose()
                    - e.projected.imitation.transpose() * g.cross.view((0, series), (p, 1));
                blocks.set_column(b, &(e.projected.basis.transpose() * raw.column(0)));
            }
            blocks
        };
        let of = |series: usize| -> Vec<DMatrix<f64>> { list.iter().map(|e| scores(series, e)).collect() };
        let residual = of(p);
        let effects: Vec<Vec<DMatrix<f64>>> = (0..truths).map(|k| of(p + 1 + k)).collect();
        let noise: Vec<DMatrix<f64>> = residual.iter().zip(&effects[0]).map(|(r, w)| r - w).collect();
        let blockwise =
            |x: usize, y: usize| DVector::from_iterator(products.len(), products.iter().map(|g| g.cross[(x, y)]));
        let energies = (0..truths)
            .map(|k| {
                let effect = p + 1 + k;
                (blockwise(p, effect) - blockwise(p + 1, effect), blockwise(effect, effect).sum())
            })
            .collect();
        let noise_energy = blockwise(p, p).sum() - 2.0 * blockwise(p, p + 1).sum() + blockwise(p + 1, p + 1).sum();
        let standard: Vec<&DMatrix<f64>> = list.iter().map(|e| &e.scores.standard).collect();
        let relevance = assessed.iter().zip(&list).map(|(a, e)| {
            let length = e.scores.sum.norm();
            if length > 0.0 { a.max_relevance() / length } else { 0.0 }
        });
        Ok(Self {
            settings,
            grams: list.iter().map(|e| block_grams(&grams, e.group, e.at, &e.projected)).collect(),
            relevance: relevance.collect(),
            freedom: list.iter().map(|e| e.projected.rank() as f64 + searched(problem, e.candidate)).collect(),
            noise,
            effects,
            noise_energy,
            energies,
            rows: rest.freedom(),
            blocks: base.blocks.len(),
            critical: sign_flips::critical(&standard, base.blocks.len(), settings),
            entries: list,
        })
    }

    /// Position among the assessed of the candidate ranked first when `truth` holds; the last truth is the null.
    fn said(&self, truth: usize, seed: u64) -> Option<usize> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let signs = DVector::from_fn(self.blocks, |_, _| if rng.random::<bool>() { 1.0 } else { -1.0 });
        let effect = self.effects.get(truth);
        let energy = self.noise_energy
            + self.energies.get(truth).map_or(0.0, |(product, energy)| 2.0 * product.dot(&signs) + energy);
        let mut best: Option<(f64, usize)> = None;
        for (i, entry) in self.entries.iter().enumerate() {
            let mut blocks = self.noise[i].clone();
            for (mut column, sign) in blocks.column_iter_mut().zip(signs.iter()) {
                column *= *sign;
            }
            if let Some(effect) = effect {
                blocks += &effect[i];
            }
            let m = entry.projected.rank() as f64;
            let explained = blocks.column_sum().norm_squared();
            let left = (energy - explained).max(f64::MIN_POSITIVE) / (self.rows - m).max(1.0);
            let evidence = ln_chi2_tail(explained / left, self.freedom[i]);
            if best.is_some_and(|(least, _)| evidence + ROUNDING * f64::abs(least) >= least) {
                continue;
            }
            let relevant = self.relevance[i] * explained.sqrt() >= self.settings.min_relevance;
            if !relevant {
                continue;
            }
            let scores = Scores::of(blocks);
            if scores.p <= self.critical || obvious(&scores, &self.grams[i], self.entries.len()) {
                best = Some((evidence, i));
            }
        }
        best.map(|(_, i)| i)
    }
}

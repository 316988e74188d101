//! Subset simulation: the probability of a rare failure from few runs.
//!
//! The failure F = {g(u) ≤ 0} of a limit state g of independent standard normal variables u is the last of nested sets
//! {g ≤ b₁} ⊃ {g ≤ b₂} ⊃ … ⊃ F, so that P(F) is the product of the conditional probabilities, none of them small
//! [Au 2001]. Each threshold bⱼ is the `share`-quantile of the samples of its level; the samples below it are the seeds
//! of Markov chains that fill the next level.
//!
//! - A chain moves by the modified Metropolis algorithm: each component i proposes uᵢ + w·U(−1, 1) and accepts it with
//!   probability min(1, φ(uᵢ′)/φ(uᵢ)); the candidate is then kept if g(u′) ≤ bⱼ [Au 2001, section 4]. Seeds already
//!   have the stationary distribution, so that no burn-in is needed.
//! - The c.o.v. of a level is δⱼ² = (1 − Pⱼ)/(Pⱼ N)·(1 + γⱼ), γⱼ = 2 Σₖ (nₖ/N) ρⱼ(k), with the correlation ρⱼ(k) of the
//!   indicator along the chains and nₖ the pairs at lag k [Au 2001, eq. 25–29]; nₖ = N − k·Nc for chains of equal length.
//!   The c.o.v. of the product lies between the root of Σ δⱼ² (levels independent) and Σ δⱼ (fully dependent).
//! - Samples descend from common seeds, which makes levels and chains dependent; γⱼ does not see this. The lineages do:
//!   if w_e is the share of the failed samples that descend from sample e of the first level, of N, the relative
//!   variance is Σ w_e² − 1/N, as for a branching process whose lineages are independent [Lee 2018].

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;
use statrs::distribution::{ContinuousCDF, StudentsT};
use thiserror::Error;

/// Settings of a subset simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubsetOptions {
    /// Samples of a level, N.
    pub samples: usize,
    /// Share of the samples of a level that become seeds of the next one; Nc = share·N chains.
    pub share: f64,
    /// Half-width w of the uniform proposal of a component.
    pub width: f64,
    /// Largest number of levels.
    pub levels: usize,
    /// Seed; a run is a function of it.
    pub seed: u64,
}

impl Default for SubsetOptions {
    /// 1000 samples a level, a tenth of them seeds, proposals within ±1, 12 levels.
    fn default() -> Self {
        Self { samples: 1000, share: 0.1, width: 1.0, levels: 12, seed: 0 }
    }
}

/// A point and the limit state there.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// Standard normal variables u.
    pub point: Vec<f64>,
    /// Limit state g(u): at most zero where it fails.
    pub margin: f64,
}

/// One level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Level {
    /// Threshold bⱼ; zero at the last level if the failure is reached.
    pub threshold: f64,
    /// Conditional probability Pⱼ: share of the samples at or below the threshold.
    pub probability: f64,
    /// Share of the moves of the chains that were kept; 1 at the first level, which has none.
    pub acceptance: f64,
    /// Factor γⱼ of the correlation along the chains; 0 at the first level.
    pub correlation: f64,
    /// Coefficient of variation δⱼ of Pⱼ.
    pub variation: f64,
    /// Evaluations of the limit state.
    pub evaluations: usize,
}

/// How a simulation ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// At the failure.
    Reached,
    /// At a level whose samples nearly all have the margin of the threshold: the limit state does not fall further.
    Stalled,
    /// At the largest number of levels.
    Exhausted,
}

/// Result of a subset simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct Subset {
    /// Probability of failure; if the failure was not reached, of the last threshold instead, an upper bound.
    pub probability: f64,
    /// Coefficient of variation of the probability from the lineages; the one to be reported.
    pub variation: f64,
    /// Effective number 1/Σ w_e² of the samples of the first level from which the failed ones descend.
    pub lineages: f64,
    /// Lower and upper value of the coefficient of variation from the levels: independent, fully dependent.
    pub variation_bounds: [f64; 2],
    /// Levels.
    pub levels: Vec<Level>,
    /// Evaluations of the limit state in total.
    pub evaluations: usize,
    /// How the simulation ended.
    pub ended: Ended,
    /// Failed samples of the last level, whose distribution is that of u given failure, the worst first.
    pub failures: Vec<Sample>,
}

impl Subset {
    /// Probabilities between which the samples without a verdict, whose margin is −∞, leave the true one: all of them hold,
    /// all fail.
    pub fn bounds(&self) -> [f64; 2] {
        let unknown = self.failures.iter().filter(|sample| sample.margin == f64::NEG_INFINITY).count();
        let known = 1.0 - unknown as f64 / self.failures.len().max(1) as f64;
        [self.probability * known, self.probability]
    }

    /// Confidence interval of the probability, symmetric in its logarithm.
    ///
    /// The coefficient of variation is itself estimated from few lineages, 1/Σ w_e² effective ones, so that the interval
    /// takes Student's t with one degree of freedom less.
    pub fn interval(&self, confidence: f64) -> [f64; 2] {
        let deviation = self.variation.powi(2).ln_1p().sqrt();
        let freedom = (self.lineages - 1.0).max(1.0);
        let quantile =
            StudentsT::new(0.0, 1.0, freedom).map_or(f64::INFINITY, |t| t.inverse_cdf(0.5 + 0.5 * confidence));
        let factor = (quantile * deviation).exp();
        [self.probability / factor, (self.probability * factor).min(1.0)]
    }
}

/// Reason why a subset simulation has no result.
#[derive(Debug, Error)]
pub enum SubsetError<E> {
    /// The settings are not usable.
    #[error("{0}")]
    Options(String),
    /// The limit state returned a wrong number of values.
    #[error("the limit state returned {found} values for {expected} points")]
    Count {
        /// Values returned.
        found: usize,
        /// Points given.
        expected: usize,
    },
    /// The limit state is not a number.
    #[error("the margin of sample {sample} of level {level} is not a number; its point is {point:?}")]
    NotANumber {
        /// Level, from 0.
        level: usize,
        /// Sample of the batch.
        sample: usize,
        /// Point u.
        point: Vec<f64>,
    },
    /// The limit state itself failed.
    #[error(transparent)]
    Evaluation(E),
}

/// A sample and where it comes from.
#[derive(Clone)]
struct Member {
    sample: Sample,
    /// Sample of the first level from which it descends.
    root: usize,
}

/// Probability that `limit_state` is at most zero for `dimension` independent standard normal variables.
///
/// The points of a batch are independent of each other, so that `limit_state` may evaluate them in parallel: all samples
/// of the first level, then one step of all chains at a time. Infinite margins are allowed. The sequence of batches is a
/// function of options and margins, so that a simulation that was interrupted repeats its batches.
///
/// # Errors
/// If the options are unusable, the limit state fails, or a margin is not a number.
pub fn subset<E>(
    dimension: usize,
    options: SubsetOptions,
    limit_state: &mut impl FnMut(&[Vec<f64>]) -> Result<Vec<f64>, E>,
) -> Result<Subset, SubsetError<E>> {
    check(dimension, &options).map_err(SubsetError::Options)?;
    let mut run = Run { options, limit_state, evaluations: 0 };
    let mut chains: Vec<Vec<Member>> = run.first_level(dimension)?;
    let (mut levels, mut probability) = (Vec::<Level>::new(), 1.0);
    let (mut acceptance, mut before) = (1.0, 0);
    let ended = loop {
        let threshold = threshold(&chains, options.share);
        let (share, correlation) = correlation(&chains, threshold);
        let n = options.samples as f64;
        let variation = ((1.0 - share) / (share * n) * (1.0 + correlation)).max(0.0).sqrt();
        probability *= share;
        let evaluations = run.evaluations - before;
        before = run.evaluations;
        levels.push(Level { threshold, probability: share, acceptance, correlation, variation, evaluations });
        if threshold <= 0.0 {
            break Ended::Reached;
        }
        // With nearly all samples at or below the threshold, a next level would be this one again.
        if share > 0.5 {
            break Ended::Stalled;
        }
        if levels.len() == options.levels {
            break Ended::Exhausted;
        }
        (chains, acceptance) = run.next_level(seeds(chains, threshold), threshold, levels.len())?;
    };
    let last = levels.last().map_or(0.0, |level| level.threshold);
    let mut failures = seeds(chains, last);
    let squares = lineage_squares(&failures);
    let (variation, lineages) = ((squares - 1.0 / options.samples as f64).max(0.0).sqrt(), 1.0 / squares);
    failures.sort_by(|a, b| a.sample.margin.total_cmp(&b.sample.margin));
    let independent = levels.iter().map(|l| l.variation.powi(2)).sum::<f64>().sqrt();
    let variation_bounds = [independent, levels.iter().map(|l| l.variation).sum()];
    let failures = if ended == Ended::Reached { failures } else { Vec::new() };
    let failures = failures.into_iter().map(|m| m.sample).collect();
    Ok(Subset {
        probability,
        variation,
        lineages,
        variation_bounds,
        levels,
        evaluations: run.evaluations,
        ended,
        failures,
    })
}

fn check(dimension: usize, options: &SubsetOptions) -> Result<(), String> {
    let SubsetOptions { samples, share, width, levels, .. } = *options;
    let seeds = share * samples as f64;
    let problem = if dimension == 0 {
        "there is no random variable".into()
    } else if !(share > 0.0 && share <= 0.5) {
        format!("share {share} of seeds: expected a value above 0, at most 0.5")
    } else if seeds < 10.0 {
        format!("{samples} samples a level leave {seeds:.0} seeds; expected at least 10, {:.0} samples", 10.0 / share)
    } else if !(width > 0.0 && width.is_finite()) {
        format!("width {width} of the proposal: expected a positive number")
    } else if levels == 0 {
        "0 levels: expected at least 1".into()
    } else {
        return Ok(());
    };
    Err(problem)
}

/// Limit state and the count of its evaluations.
struct Run<'a, F> {
    options: SubsetOptions,
    limit_state: &'a mut F,
    evaluations: usize,
}

impl<E, F: FnMut(&[Vec<f64>]) -> Result<Vec<f64>, E>> Run<'_, F> {
    fn evaluate(&mut self, points: &[Vec<f64>], level: usize) -> Result<Vec<f64>, SubsetError<E>> {
        if points.is_empty() {
            return Ok(Vec::new());
        }
        let margins = (self.limit_state)(points).map_err(SubsetError::Evaluation)?;
        if margins.len() != points.len() {
            return Err(SubsetError::Count { found: margins.len(), expected: points.len() });
        }
        if let Some(sample) = margins.iter().position(|m| m.is_nan()) {
            return Err(SubsetError::NotANumber { level, sample, point: points[sample].clone() });
        }
        self.evaluations += points.len();
        Ok(margins)
    }

    /// Random numbers of one chain of a level, or of one sample of the first one.
    fn random(&self, level: usize, chain: usize) -> ChaCha8Rng {
        let mut rng = ChaCha8Rng::seed_from_u64(self.options.seed);
        rng.set_stream(((level as u64) << 32) | chain as u64);
        rng
    }

    /// Independent samples, each a chain of its own.
    fn first_level(&mut self, dimension: usize) -> Result<Vec<Vec<Member>>, SubsetError<E>> {
        let draw = |k: usize| {
            let mut rng = self.random(0, k);
            (0..dimension).map(|_| rng.sample(StandardNormal)).collect::<Vec<f64>>()
        };
        let points: Vec<Vec<f64>> = (0..self.options.samples).map(draw).collect();
        let margins = self.evaluate(&points, 0)?;
        let member = |(root, (point, margin))| vec![Member { sample: Sample { point, margin }, root }];
        Ok(points.into_iter().zip(margins).enumerate().map(member).collect())
    }

    /// Chains from `seeds` that stay at or below the threshold, N samples in total with the seeds, and the share of the
    /// moves kept.
    fn next_level(
        &mut self,
        seeds: Vec<Member>,
        threshold: f64,
        level: usize,
    ) -> Result<(Vec<Vec<Member>>, f64), SubsetError<E>> {
        let (count, samples) = (seeds.len(), self.options.samples);
        // The first chains are one longer if the number of samples is not a multiple of the seeds.
        let length = |chain: usize| samples / count + usize::from(chain < samples % count);
        let mut randoms: Vec<ChaCha8Rng> = (0..count).map(|chain| self.random(level, chain)).collect();
        let mut chains: Vec<Vec<Member>> = seeds.into_iter().map(|seed| vec![seed]).collect();
        let (mut moves, mut kept) = (0, 0);
        for step in 1..length(0) {
            let moving: Vec<usize> = (0..count).filter(|&chain| step < length(chain)).collect();
            let candidates: Vec<Option<Vec<f64>>> =
                moving.iter().map(|&k| self.propose(&chains[k][step - 1].sample.point, &mut randoms[k])).collect();
            let points: Vec<Vec<f64>> = candidates.iter().flatten().cloned().collect();
            let mut margins = self.evaluate(&points, level)?.into_iter();
            for (&chain, candidate) in moving.iter().zip(candidates) {
                moves += 1;
                let mut member = chains[chain][step - 1].clone();
                let moved = candidate.and_then(|point| Some((point, margins.next()?)));
                if let Some((point, margin)) = moved.filter(|(_, margin)| *margin <= threshold) {
                    kept += 1;
                    member.sample = Sample { point, margin };
                }
                chains[chain].push(member);
            }
        }
        Ok((chains, if moves > 0 { f64::from(kept) / f64::from(moves) } else { 1.0 }))
    }

    /// Candidate of the modified Metropolis algorithm; `None` if no component moves.
    fn propose(&self, from: &[f64], rng: &mut ChaCha8Rng) -> Option<Vec<f64>> {
        let mut moved = false;
        let component = |&now: &f64| {
            let next = now + self.options.width * rng.random_range(-1.0..1.0);
            // Always drawn, so that the stream does not depend on the outcome.
            let chance: f64 = rng.random();
            if chance < (0.5 * (now * now - next * next)).exp() {
                moved = true;
                next
            } else {
                now
            }
        };
        let candidate: Vec<f64> = from.iter().map(component).collect();
        moved.then_some(candidate)
    }
}

/// The `share`-quantile of the margins, at least zero: the failure itself.
fn threshold(chains: &[Vec<Member>], share: f64) -> f64 {
    let mut margins: Vec<f64> = chains.iter().flatten().map(|m| m.sample.margin).collect();
    let seeds = (share * margins.len() as f64).round().max(1.0) as usize;
    let (_, quantile, _) = margins.select_nth_unstable_by(seeds - 1, f64::total_cmp);
    quantile.max(0.0)
}

/// Members at or below the threshold, in the order of the chains.
fn seeds(chains: Vec<Vec<Member>>, threshold: f64) -> Vec<Member> {
    chains.into_iter().flatten().filter(|m| m.sample.margin <= threshold).collect()
}

/// Share P of the samples at or below the threshold, and the factor γ of their correlation along the chains.
fn correlation(chains: &[Vec<Member>], threshold: f64) -> (f64, f64) {
    let inside: Vec<Vec<f64>> =
        chains.iter().map(|c| c.iter().map(|m| f64::from(m.sample.margin <= threshold)).collect()).collect();
    let n = inside.iter().map(Vec::len).sum::<usize>() as f64;
    let share = inside.iter().flatten().sum::<f64>() / n;
    let variance = share * (1.0 - share);
    if variance <= 0.0 {
        return (share, 0.0);
    }
    let longest = inside.iter().map(Vec::len).max().unwrap_or(0);
    let lag = |k: usize| {
        let pairs = || inside.iter().flat_map(|c| c.iter().zip(c.iter().skip(k)));
        let count = pairs().count() as f64;
        let covariance = pairs().map(|(a, b)| a * b).sum::<f64>() / count - share * share;
        count / n * covariance / variance
    };
    (share, 2.0 * (1..longest).map(lag).sum::<f64>())
}

/// Sum Σ w_e² over the lineages of the failed samples, w_e the share of the samples in one.
fn lineage_squares(failures: &[Member]) -> f64 {
    let mut roots: Vec<usize> = failures.iter().map(|m| m.root).collect();
    roots.sort_unstable();
    let total = roots.len() as f64;
    roots.chunk_by(|a, b| a == b).map(|same| (same.len() as f64 / total).powi(2)).sum()
}

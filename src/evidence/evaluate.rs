//! One step: whitening, projection, scores and ranking of all candidates.

use nalgebra::DMatrix;

use super::base_fit::{BaseFit, sum};
use super::describe::{Chance, Entry, Gain, base_estimates, contribution, describe, ln_p_of};
use super::gram::{BlockGram, Blocks, cut, usable};
use super::predict::{Contribution, Effect, effects};
use super::problem::{Chosen, Problem, Settings, Variant};
use super::project::{Projected, pseudo_inverse};
use super::ranking::{Assessment, Ranking};
use super::score::{Remainder, Scores, block_grams, obvious};
use super::{Error, sign_flips};

/// Assessment of every candidate that is not among `chosen`; the columns of the chosen effects join the base.
///
/// # Errors
/// If the problem is inconsistent, has no more values than parameters, or is not finite.
pub fn evaluate(problem: &Problem, chosen: &[Chosen], settings: &Settings) -> Result<Ranking, Error> {
    evaluate_for(problem, chosen, None, settings)
}

/// Assessment as [`evaluate()`], with the candidate `own` first, significant or not: its rivals are compared with it.
///
/// # Errors
/// As [`evaluate()`].
pub fn evaluate_for(
    problem: &Problem,
    chosen: &[Chosen],
    own: Option<usize>,
    settings: &Settings,
) -> Result<Ranking, Error> {
    problem.check()?;
    ranked(problem, chosen, own, BaseFit::new(problem, chosen, settings)?, settings)
}

/// Assessment of every candidate next to `others` with `own` first, significant or not, in the noise that is left with all of
/// them.
///
/// # Errors
/// As [`evaluate()`].
pub fn evaluate_in_the_rest(
    problem: &Problem,
    own: Chosen,
    others: &[Chosen],
    settings: &Settings,
) -> Result<Ranking, Error> {
    problem.check()?;
    let BaseFit { columns, residual, theta, .. } = BaseFit::new(problem, others, settings)?;
    let base = BaseFit { columns, residual, theta, ..BaseFit::new(problem, &[others, &[own]].concat(), settings)? };
    ranked(problem, others, Some(own.candidate), base, settings)
}

fn ranked(
    problem: &Problem,
    chosen: &[Chosen],
    own: Option<usize>,
    base: BaseFit,
    settings: &Settings,
) -> Result<Ranking, Error> {
    let is_open = |i: &usize| chosen.iter().all(|c| c.candidate != *i);
    let tested: Vec<usize> = (0..problem.candidates.len()).filter(is_open).collect();
    let places = tested.iter().flat_map(|&j| (0..problem.candidates[j].variants.len()).map(move |v| (j, v))).collect();
    let entries = base.assess(problem, places)?;
    base.rank(problem, (&tested, own), entries, chosen, settings)
}

/// First candidate: the one with the smallest tail probability, unless another explains plainly more of the error.
/// Whitening weights frequencies by their inverse noise: where the error exceeds the noise by far, a wrong effect that
/// fits only its fast part would otherwise lead.
fn leader(order: &[usize], candidates: &[Assessment], settings: &Settings) -> Option<usize> {
    let passing = || order.iter().copied().filter(|&i| candidates[i].passes(settings));
    let share = |i: usize| candidates[i].explained_share.unwrap_or(0.0);
    let likeliest = passing().next()?;
    let most = passing().max_by(|&a, &b| share(a).total_cmp(&share(b)))?;
    Some(if candidates[most].explains_plainly_more(&candidates[likeliest]) { most } else { likeliest })
}

/// All variants with the quantities that they share.
pub struct Entries<'a> {
    pub list: Vec<Entry<'a>>,
    pub grams: Vec<BlockGram>,
    pub inverse: DMatrix<f64>,
    pub rest: Remainder,
}

impl<'a> BaseFit<'a> {
    /// Projections, scores and Gram matrices of the given (candidate, variant) pairs.
    pub fn assess(&self, problem: &'a Problem, chosen: Vec<(usize, usize)>) -> Result<Entries<'a>, Error> {
        let p = self.columns.len();
        let mut places = Vec::new();
        let mut at = p + 1;
        for (j, index) in chosen {
            let v = &problem.candidates[j].variants[index];
            places.push((j, index, v, at));
            at += v.columns.len();
        }
        let groups: Vec<_> = places.iter().map(|&(_, _, v, at)| at..at + v.columns.len()).collect();
        let variants: Vec<&Variant> = places.iter().map(|x| x.2).collect();
        let grams = self.pass(&variants, groups).run(&self.filters, problem.samples, &self.blocks);
        let total = sum(&grams, p + 1);
        let own: Vec<DMatrix<f64>> = (0..places.len())
            .map(|g| {
                grams.iter().fold(
                    DMatrix::zeros(0, 0),
                    |s, x| {
                        if s.is_empty() { x.own[g].clone() } else { s + &x.own[g] }
                    },
                )
            })
            .collect();
        if total.iter().chain(own.iter().flatten()).any(|x| !x.is_finite()) {
            return Err(Error::NotFinite(problem.not_finite().unwrap_or("candidates").into()));
        }
        let (inverse, rank) = pseudo_inverse(&total.view((0, 0), (p, p)).into_owned());
        let rest = Remainder::new(&grams, &inverse, rank, self.rows(problem));
        let list = places.into_iter().enumerate().map(|(group, (candidate, index, variant, at))| {
            let m = variant.columns.len();
            let cross = grams.iter().fold(DMatrix::zeros(p, m), |s, g| s + g.cross.view((0, at), (p, m)));
            let projected = Projected::new(&inverse, &cross, &own[group]);
            let scores = Scores::new(&grams, at, &projected, &rest);
            Entry { candidate, index, variant, at, group, projected, scores }
        });
        Ok(Entries { list: list.collect(), grams, inverse, rest })
    }

    fn rank(
        mut self,
        problem: &Problem,
        (tested, own): (&[usize], Option<usize>),
        entries: Entries<'_>,
        chosen: &[Chosen],
        settings: &Settings,
    ) -> Result<Ranking, Error> {
        self.update(&entries.rest.base);
        let levels = Levels::new(&self, problem);
        let groups: Vec<Vec<&Entry<'_>>> =
            tested.iter().map(|j| entries.list.iter().filter(|e| e.candidate == *j).collect()).collect();
        let chances = entries.chances(&groups, self.blocks.len(), settings);
        // A variant with the derivatives of its shape has more columns than the others.
        let ln_p = |e: &Entry<'_>| ln_p_of(e, problem, &entries.rest);
        let best = groups.iter().map(|g| g.iter().copied().min_by(|a, b| ln_p(a).total_cmp(&ln_p(b))));
        let (chances, present): (Vec<Chance>, Vec<&Entry<'_>>) =
            chances.into_iter().zip(best).filter_map(|(chance, best)| Some((chance, best?))).unzip();
        let blockwise: Vec<Vec<DMatrix<f64>>> =
            present.iter().map(|e| block_grams(&entries.grams, e.group, e.at, &e.projected)).collect();
        let gains = self.gains(problem, &present, &levels, &entries.rest);
        let mut candidates: Vec<Assessment> = Vec::new();
        for (i, (mut chance, gain)) in chances.into_iter().zip(gains).enumerate() {
            if self.too_few.is_some() {
                chance.p_adjusted = 1.0;
            } else if obvious(&present[i].scores, &blockwise[i], entries.list.len()) {
                chance.p_adjusted = chance.p_adjusted.min(1.0 / (settings.flips + 1) as f64);
            }
            let fit = (&self, &entries.rest);
            candidates.push(describe(present[i], problem, fit, &blockwise[i], (chance, gain), settings));
        }
        let (order, winner) = ordered(&candidates, own, settings);
        if let Some(w) = winner {
            self.compare(problem, &present, &blockwise, w, &mut candidates);
        }
        Ok(Ranking {
            chosen: chosen.to_vec(),
            candidates,
            order,
            best: winner,
            base: base_estimates(&self, &entries.inverse, &entries.rest),
            base_rank: entries.rest.rank,
            noise: levels.noise,
            floor_known: levels.floor_known,
            residual: self.residual,
            sum_of_squares: levels.before,
            rows: entries.rest.rows,
            samples: levels.samples,
            blocks: self.blocks.len(),
            correlation_time: self.correlation_time,
            blocks_too_short: self.blocks_too_short,
            too_few: self.too_few,
            filters: self.filters,
        })
    }

    /// Change of the residual per channel by the fit of each candidate.
    fn gains(&self, problem: &Problem, present: &[&Entry<'_>], levels: &Levels, rest: &Remainder) -> Vec<Gain> {
        let channels = problem.channels.len();
        let contributions: Vec<Contribution<'_>> = present.iter().map(|e| contribution(e)).collect();
        let columns: Vec<&[f64]> = self.columns.iter().map(|c| &*c.values).collect();
        let whole: Blocks = cut(&problem.segments, 0, self.blocks.len());
        let done = effects(&columns, &self.residual, &contributions, channels, problem.samples, &whole);
        let gain = |(entry, Effect { energy, product }): (&&Entry<'_>, &Effect)| {
            let after = |c: usize| (levels.before[c] - 2.0 * product[c] + energy[c]).max(0.0);
            let sum_of_squares: Vec<f64> = (0..channels).map(after).collect();
            let explained_share = match levels.floor_known {
                true => levels.explained(&sum_of_squares),
                false => (rest.energy > 0.0).then(|| (entry.scores.sum.norm_squared() / rest.energy).min(1.0)),
            };
            Gain { sum_of_squares, relevance: levels.in_units_of_noise(energy), explained_share }
        };
        present.iter().zip(&done).map(gain).collect()
    }
}

impl Entries<'_> {
    /// Score, smallest marginal p and family-wise p of every candidate, from common sign flips of all variants.
    fn chances(&self, groups: &[Vec<&Entry<'_>>], blocks: usize, settings: &Settings) -> Vec<Chance> {
        let p: Vec<f64> = groups.iter().map(|g| g.iter().map(|e| e.scores.p).fold(1.0, f64::min)).collect();
        let stacked: Vec<&DMatrix<f64>> = self.list.iter().map(|e| &e.scores.standard).collect();
        let adjusted = sign_flips::family_wise(&stacked, &p, blocks, settings.flips, settings.seed);
        let score = |group: &[&Entry<'_>]| {
            let least = group.iter().min_by(|a, b| a.scores.p.total_cmp(&b.scores.p));
            least.map_or(0.0, |e| e.scores.statistic)
        };
        let chance = |((group, p_marginal), p_adjusted): ((&Vec<&Entry<'_>>, f64), f64)| Chance {
            score: score(group),
            p_marginal,
            p_adjusted,
        };
        groups.iter().zip(p).zip(adjusted).map(chance).collect()
    }
}

/// Residual of the base fit and noise, per channel.
struct Levels {
    /// Sum of squares of the residual.
    before: Vec<f64>,
    /// Number of samples summed.
    samples: usize,
    /// Noise that relevance refers to: the given one, else the residual's RMS.
    noise: Vec<f64>,
    /// Whether the noise of every channel was given.
    floor_known: bool,
}

impl Levels {
    fn new(fit: &BaseFit<'_>, problem: &Problem) -> Self {
        let channels = problem.channels.len();
        let before = problem.sum_of_squares(&fit.residual);
        let samples = usable(&problem.segments, 0);
        let given = |c: usize| problem.channels[c].noise_sigma.filter(|s| *s > 0.0 && s.is_finite());
        let rms = |c: usize| (before[c] / samples.max(1) as f64).sqrt();
        let noise = (0..channels).map(|c| given(c).unwrap_or(rms(c)).max(fit.floor[c])).collect();
        let floor_known = (0..channels).all(|c| given(c).is_some() || before[c] <= 0.0);
        Self { before, samples, noise, floor_known }
    }

    /// RMS of signals with the given energies, in units of the noise.
    fn in_units_of_noise(&self, energy: &[f64]) -> Vec<f64> {
        let rms = |energy: f64| (energy / self.samples.max(1) as f64).sqrt();
        energy.iter().zip(&self.noise).map(|(e, n)| if *n > 0.0 { rms(*e) / n } else { 0.0 }).collect()
    }

    /// Share of the residual variance above the noise, summed over channels in units of the noise, removed when
    /// `after` remains.
    fn explained(&self, after: &[f64]) -> Option<f64> {
        let samples = self.samples.max(1) as f64;
        let excess = |squares: &[f64]| -> f64 {
            let channels = squares.iter().zip(&self.noise).filter(|(_, n)| **n > 0.0);
            channels.map(|(s, n)| s / (samples * n * n) - 1.0).sum()
        };
        let before = excess(&self.before);
        (before > 0.0).then(|| 1.0 - excess(after) / before)
    }
}

/// Candidates by the tail probability of their fit, the winner first: the candidate `own`, else the best if one passes.
fn ordered(candidates: &[Assessment], own: Option<usize>, settings: &Settings) -> (Vec<usize>, Option<usize>) {
    let mut order: Vec<usize> = (0..candidates.len()).collect();
    order.sort_by(|&a, &b| {
        let (x, y) = (&candidates[a], &candidates[b]);
        x.ln_p.total_cmp(&y.ln_p).then(y.f_statistic.total_cmp(&x.f_statistic))
    });
    let own = candidates.iter().position(|a| Some(a.candidate) == own);
    let winner = own.or_else(|| leader(&order, candidates, settings));
    if let Some(place) = winner.and_then(|w| order.iter().position(|&i| i == w)) {
        order[..=place].rotate_right(1);
    }
    (order, winner)
}

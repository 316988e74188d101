//! One step: whiten, project, score and rank every candidate.

use nalgebra::DMatrix;

use super::base_fit::{BaseFit, sum};
use super::describe::{Entry, base_estimates, contribution, describe, estimates, f_of};
use super::gram::{BlockGram, Blocks, cut, usable};
use super::predict::{Contribution, Effect, effects, squares};
use super::problem::{Chosen, Problem, Settings, Variant};
use super::project::{Projected, pseudo_inverse};
use super::ranking::{Assessment, Ranking};
use super::score::{Remainder, Scores, block_grams, obvious};
use super::{Error, flip};

/// Assess every candidate that is not among `chosen`, whose columns join the base.
pub fn evaluate(problem: &Problem, chosen: &[Chosen], settings: &Settings) -> Result<Ranking, Error> {
    let all: Vec<usize> = (0..problem.candidates.len()).collect();
    evaluate_only(problem, chosen, &all, settings)
}

/// Assess the candidates listed in `only`, without those among `chosen`.
pub fn evaluate_only(
    problem: &Problem,
    chosen: &[Chosen],
    only: &[usize],
    settings: &Settings,
) -> Result<Ranking, Error> {
    problem.check()?;
    let tested: Vec<usize> = (0..problem.candidates.len())
        .filter(|i| only.contains(i) && chosen.iter().all(|c| c.candidate != *i))
        .collect();
    let base = BaseFit::new(problem, chosen, settings)?;
    let places = tested.iter().flat_map(|&j| (0..problem.candidates[j].variants.len()).map(move |v| (j, v))).collect();
    let entries = base.assess(problem, places)?;
    base.rank(problem, &tested, entries, chosen, settings)
}

/// How many times as much of the explainable error a candidate must explain to lead before a likelier one.
const PLAINLY_MORE: f64 = 2.0;

/// The candidate that goes first: the likeliest, unless it leaves most of the error to another. Whitening weighs by
/// rarity; where an error dwarfs the noise, a law of the wrong kind that mends its fast part would lead.
fn leader(order: &[usize], candidates: &[Assessment], settings: &Settings) -> Option<usize> {
    let passing = || order.iter().copied().filter(|&i| !candidates[i].generic && candidates[i].passes(settings));
    let share = |i: usize| candidates[i].explained_share.unwrap_or(0.0);
    let likeliest = passing().next()?;
    let most = passing().max_by(|&a, &b| share(a).total_cmp(&share(b)))?;
    Some(if share(most) > 0.5 && share(most) > PLAINLY_MORE * share(likeliest) { most } else { likeliest })
}

/// All variants with the quantities they share.
pub struct Entries<'a> {
    pub list: Vec<Entry<'a>>,
    pub grams: Vec<BlockGram>,
    pub inverse: DMatrix<f64>,
    pub rest: Remainder,
}

impl<'a> BaseFit<'a> {
    /// What all statistics of the given (candidate, variant) are made of.
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
        tested: &[usize],
        entries: Entries<'_>,
        chosen: &[Chosen],
        settings: &Settings,
    ) -> Result<Ranking, Error> {
        let Entries { list, grams, inverse, rest } = entries;
        let (channels, n) = (problem.channels.len(), problem.samples);
        self.update(&rest.base);
        let before = squares(&self.residual, channels, n, &problem.segments);
        let samples = usable(&problem.segments, 0);
        let rms = |ss: f64| (ss / samples.max(1) as f64).sqrt();
        let given = |c: usize| problem.channels[c].noise_sigma.filter(|s| *s > 0.0 && s.is_finite());
        let noise: Vec<f64> = (0..channels).map(|c| given(c).unwrap_or(rms(before[c])).max(self.floor[c])).collect();
        let floor_known = (0..channels).all(|c| given(c).is_some() || before[c] <= 0.0);

        let groups: Vec<Vec<&Entry<'_>>> =
            tested.iter().map(|j| list.iter().filter(|e| e.candidate == *j).collect()).collect();
        let p: Vec<f64> = groups.iter().map(|g| g.iter().map(|e| e.scores.p).fold(1.0, f64::min)).collect();
        let stacked: Vec<&DMatrix<f64>> = list.iter().map(|e| &e.scores.standard).collect();
        let adjusted = flip::family_wise(&stacked, &p, self.blocks.len(), settings.flips, settings.seed);

        let best: Vec<Option<&Entry<'_>>> =
            groups.iter().map(|g| g.iter().copied().max_by(|a, b| f_of(a, &rest).total_cmp(&f_of(b, &rest)))).collect();
        let present: Vec<&Entry<'_>> = best.iter().copied().flatten().collect();
        let blockwise: Vec<Vec<DMatrix<f64>>> =
            present.iter().map(|e| block_grams(&grams, e.group, e.at, &e.projected)).collect();
        let contributions: Vec<Contribution<'_>> = present.iter().map(|e| contribution(e)).collect();
        let columns: Vec<&[f64]> = self.columns.iter().map(|c| c.values.as_slice()).collect();
        let whole: Blocks = cut(&problem.segments, 0, self.blocks.len());
        let done = effects(&columns, &self.residual, &contributions, channels, n, &whole);

        let mut candidates = Vec::new();
        for (i, entry) in present.iter().enumerate() {
            let Some(group) = tested.iter().position(|j| *j == entry.candidate) else {
                continue;
            };
            let least = groups[group].iter().min_by(|a, b| a.scores.p.total_cmp(&b.scores.p));
            let mut a = describe(entry, problem, &self, &rest, settings, groups[group].len());
            a.score = least.map_or(0.0, |e| e.scores.statistic);
            (a.p_marginal, a.p_adjusted) = (p[group], adjusted[group]);
            if obvious(&entry.scores, &blockwise[i], list.len()) {
                a.p_adjusted = a.p_adjusted.min(1.0 / (settings.flips + 1) as f64);
            }
            a.coefficients = estimates(entry, &blockwise[i]);
            a.base_change = contributions[i].imitation.iter().map(|x| -x).collect();
            let Effect { energy, product } = &done[i];
            a.sum_of_squares = (0..channels).map(|c| (before[c] - 2.0 * product[c] + energy[c]).max(0.0)).collect();
            a.relevance = (0..channels).map(|c| if noise[c] > 0.0 { rms(energy[c]) / noise[c] } else { 0.0 }).collect();
            a.explained_share = if floor_known {
                let excess = |ss: &[f64]| -> f64 {
                    let one = |c: usize| ss[c] / (samples.max(1) as f64 * noise[c] * noise[c]) - 1.0;
                    (0..channels).filter(|&c| noise[c] > 0.0).map(one).sum()
                };
                let old = excess(&before);
                (old > 0.0).then(|| 1.0 - excess(&a.sum_of_squares) / old)
            } else {
                (rest.energy > 0.0).then(|| (entry.scores.sum.norm_squared() / rest.energy).min(1.0))
            };
            candidates.push(a);
        }
        let mut order: Vec<usize> = (0..candidates.len()).collect();
        order.sort_by(|&a, &b| {
            let (x, y) = (&candidates[a], &candidates[b]);
            x.log_evidence.total_cmp(&y.log_evidence).then(y.f_statistic.total_cmp(&x.f_statistic))
        });
        let winner = leader(&order, &candidates, settings);
        if let Some(place) = winner.and_then(|w| order.iter().position(|&i| i == w)) {
            order[..=place].rotate_right(1);
        }
        if let Some(w) = winner {
            self.compare(problem, &present, &blockwise, w, &mut candidates);
        }
        let base = base_estimates(&self, &inverse, &rest);
        Ok(Ranking {
            chosen: chosen.to_vec(),
            candidates,
            order,
            best: winner,
            base,
            base_rank: rest.rank,
            noise,
            floor_known,
            residual: self.residual,
            sum_of_squares: before,
            rows: rest.rows,
            samples,
            blocks: self.blocks.len(),
            correlation_time: self.correlation_time,
            blocks_too_short: self.blocks_too_short,
            filters: self.filters,
        })
    }
}

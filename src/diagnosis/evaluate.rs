//! One step: whiten, project, score and rank every candidate.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::gram::{BlockGram, Blocks, Pass, cut, usable};
use super::noise::correlation_time;
use super::predict::{Contribution, Effect, effects, squares, subtract};
use super::problem::{Chosen, Column, Problem, Settings, Variant};
use super::project::{Projected, pseudo_inverse};
use super::ranking::{Absorption, Assessment, Estimate, Ranking, Visibility};
use super::score::{Remainder, Scores, block_grams, sandwich};
use super::special::{ln_chi2_tail, noncentrality};
use super::whiten::ArFilter;
use super::{Error, compare, flip};

/// Fewest blocks for scores.
const MIN_BLOCKS: usize = 16;

/// Fewest samples of a block.
const MIN_BLOCK: usize = 8;

/// A channel's noise is taken to be at least this share of its RMS: below is rounding.
const ROUNDING: f64 = 1e-9;

/// Power at which an effect counts as visible.
const POWER: f64 = 0.95;

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
    let entries = base.assess(problem, &tested)?;
    base.rank(problem, &tested, entries, chosen, settings)
}

/// The base fitted to the data, with the noise model that belongs to it.
struct BaseFit<'a> {
    columns: Vec<&'a Column>,
    residual: Vec<f64>,
    theta: DVector<f64>,
    filters: Vec<ArFilter>,
    floor: Vec<f64>,
    blocks: Blocks,
    correlation_time: f64,
    blocks_too_short: bool,
}

/// One variant of one candidate.
struct Entry<'a> {
    candidate: usize,
    index: usize,
    variant: &'a Variant,
    at: usize,
    group: usize,
    projected: Projected,
    scores: Scores,
}

/// All variants with the quantities they share.
struct Entries<'a> {
    list: Vec<Entry<'a>>,
    grams: Vec<BlockGram>,
    inverse: DMatrix<f64>,
    rest: Remainder,
}

impl<'a> BaseFit<'a> {
    fn new(problem: &'a Problem, chosen: &[Chosen], settings: &Settings) -> Result<Self, Error> {
        let columns = problem.left(chosen)?;
        let (channels, n) = (problem.channels.len(), problem.samples);
        let used = usable(&problem.segments, 0).max(1) as f64;
        let size: Vec<f64> =
            squares(&problem.y, channels, n, &problem.segments).iter().map(|s| (s / used).sqrt()).collect();
        if size.iter().any(|s| !s.is_finite()) {
            return Err(Error::NotFinite(problem.not_finite().unwrap_or("y").into()));
        }
        let floor: Vec<f64> = size.iter().map(|s| ROUNDING * s).collect();
        let mut fit = Self {
            theta: DVector::zeros(columns.len()),
            columns,
            residual: problem.y.clone(),
            filters: size.into_iter().map(ArFilter::scale).collect(),
            floor,
            blocks: Vec::new(),
            correlation_time: 1.0,
            blocks_too_short: false,
        };
        // Two rounds: scaled least squares gives a residual for the noise model, that one a better residual.
        for _ in 0..2 {
            fit.cut(problem, settings, 1.0)?;
            let grams = fit.pass(&[], Vec::new()).run(&fit.filters, n, &fit.blocks);
            let (inverse, rank) = pseudo_inverse(&sum(&grams, fit.columns.len()));
            let rest = Remainder::new(&grams, &inverse, rank, fit.rows(problem));
            if rest.base.iter().any(|x| !x.is_finite()) || !rest.energy.is_finite() {
                return Err(Error::NotFinite(problem.not_finite().unwrap_or("base").into()));
            }
            fit.update(&rest.base);
            fit.filters = (0..channels)
                .map(|c| {
                    let series = &fit.residual[c * n..(c + 1) * n];
                    let mut filter = ArFilter::fit(series, &problem.segments, settings.max_order);
                    filter.sigma = filter.sigma.max(fit.floor[c]);
                    filter
                })
                .collect();
        }
        let time = (0..channels)
            .filter(|&c| fit.filters[c].sigma > 0.0)
            .map(|c| {
                let (skip, filter) = (fit.skip(), &fit.filters[c]);
                let white = problem.segments.iter().filter(|s| s.len() > skip).map(|s| {
                    let mut out = vec![0.0; s.len() - skip];
                    filter.apply(&fit.residual[c * n..(c + 1) * n], s.start + skip..s.end, &mut out);
                    out
                });
                correlation_time(&white.collect::<Vec<_>>())
            })
            .fold(1.0, f64::max);
        fit.cut(problem, settings, time)?;
        Ok(fit)
    }

    /// Samples lost at the start of each segment.
    fn skip(&self) -> usize {
        self.filters.iter().map(ArFilter::order).max().unwrap_or(0)
    }

    fn rows(&self, problem: &Problem) -> usize {
        usable(&problem.segments, self.skip()) * self.filters.iter().filter(|f| f.sigma > 0.0).count()
    }

    fn cut(&mut self, problem: &Problem, settings: &Settings, time: f64) -> Result<(), Error> {
        let rows = usable(&problem.segments, self.skip());
        let length = (5.0 * time).max(MIN_BLOCK as f64);
        let wanted = ((rows as f64 / length) as usize).min(settings.blocks.max(MIN_BLOCKS));
        self.blocks = cut(&problem.segments, self.skip(), wanted.max(MIN_BLOCKS));
        self.correlation_time = time;
        self.blocks_too_short = wanted < MIN_BLOCKS;
        let blocks = self.blocks.len();
        if rows < MIN_BLOCKS * MIN_BLOCK || blocks < MIN_BLOCKS / 2 || self.rows(problem) <= self.columns.len() {
            return Err(Error::TooShort { rows, blocks, needed: MIN_BLOCKS });
        }
        Ok(())
    }

    fn update(&mut self, change: &DVector<f64>) {
        let columns: Vec<&[f64]> = self.columns.iter().map(|c| c.values.as_slice()).collect();
        subtract(&mut self.residual, &columns, change.as_slice());
        self.theta += change;
    }

    /// Base columns and residual on the left, then the columns of the variants.
    fn pass<'b>(&'b self, variants: &[&'b Variant], groups: Vec<Range<usize>>) -> Pass<'b> {
        let mut columns: Vec<&[f64]> = self.columns.iter().map(|c| c.values.as_slice()).collect();
        columns.push(&self.residual);
        let left = columns.len();
        columns.extend(variants.iter().flat_map(|v| &v.columns).map(|c| c.values.as_slice()));
        Pass { columns, left, groups }
    }

    fn assess(&self, problem: &'a Problem, tested: &[usize]) -> Result<Entries<'a>, Error> {
        let p = self.columns.len();
        let mut places = Vec::new();
        let mut at = p + 1;
        for &j in tested {
            for (index, v) in problem.candidates[j].variants.iter().enumerate() {
                places.push((j, index, v, at));
                at += v.columns.len();
            }
        }
        let groups: Vec<_> = places.iter().map(|&(_, _, v, at)| at..at + v.columns.len()).collect();
        let variants: Vec<&Variant> = places.iter().map(|x| x.2).collect();
        let grams = self.pass(&variants, groups).run(&self.filters, problem.samples, &self.blocks);
        let total = sum(&grams, p + 1);
        let own: Vec<DMatrix<f64>> = (0..places.len())
            .map(|g| grams.iter().fold(DMatrix::zeros(0, 0), |s, x| if s.is_empty() { x.own[g].clone() } else { s + &x.own[g] }))
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

        let best: Vec<Option<&Entry<'_>>> = groups
            .iter()
            .map(|g| g.iter().copied().max_by(|a, b| f_of(a, &rest).total_cmp(&f_of(b, &rest))))
            .collect();
        let present: Vec<&Entry<'_>> = best.iter().copied().flatten().collect();
        let blockwise: Vec<Vec<DMatrix<f64>>> =
            present.iter().map(|e| block_grams(&grams, e.group, e.at, &e.projected)).collect();
        let contributions: Vec<Contribution<'_>> = present.iter().map(|e| contribution(e)).collect();
        let columns: Vec<&[f64]> = self.columns.iter().map(|c| c.values.as_slice()).collect();
        let whole: Blocks = cut(&problem.segments, 0, self.blocks.len());
        let done = effects(&columns, &self.residual, &contributions, channels, n, &whole);

        let mut candidates = Vec::new();
        for (i, entry) in present.iter().enumerate() {
            let Some(group) = tested.iter().position(|j| *j == entry.candidate) else { continue };
            let least = groups[group].iter().min_by(|a, b| a.scores.p.total_cmp(&b.scores.p));
            let mut a = describe(entry, problem, &self, &rest, settings, groups[group].len());
            a.score = least.map_or(0.0, |e| e.scores.statistic);
            (a.p_marginal, a.p_adjusted) = (p[group], adjusted[group]);
            a.coefficients = estimates(entry, &blockwise[i]);
            a.base_change = contributions[i].imitation.iter().map(|x| -x).collect();
            let Effect { energy, product } = &done[i];
            a.sum_of_squares = (0..channels).map(|c| (before[c] - 2.0 * product[c] + energy[c]).max(0.0)).collect();
            a.relevance = (0..channels)
                .map(|c| if noise[c] > 0.0 { rms(energy[c]) / noise[c] } else { 0.0 })
                .collect();
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
        let winner = order.iter().copied().find(|&i| !candidates[i].generic && candidates[i].passes(settings));
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

    /// Mark the candidates that the data cannot tell from candidate `w`.
    fn compare(
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
        let mut columns: Vec<&[f64]> =
            variants.flat_map(|e| &e.variant.columns).map(|c| c.values.as_slice()).collect();
        columns.extend(self.columns.iter().map(|c| c.values.as_slice()));
        let pass = Pass { columns, left: m, groups: Vec::new() };
        let grams = pass.run(&self.filters, problem.samples, &self.blocks);
        let total = grams.iter().fold(DMatrix::zeros(m, pass.columns.len()), |s, g| s + &g.cross);
        let base = total.columns(pass.columns.len() - self.columns.len(), self.columns.len());
        let effect = &a.projected.basis * &a.scores.sum;
        let energy = a.scores.sum.norm_squared();
        let size = |i: usize| present[i].projected.rank() as f64 + searched(problem, present[i].candidate);
        let best = compare::losses(&a.scores, &blockwise[w]);
        let critical = compare::critical(self.blocks.len());
        let mut at = m;
        for (i, e) in present.iter().enumerate() {
            let k = e.variant.columns.len();
            // z⊥_aᵀ z⊥_k = Z_aᵀ Z_k − Z_aᵀ Y · (imitation of k)
            let cross = total.columns(at, k) - base * &e.projected.imitation;
            at += k;
            let shared = e.projected.basis.transpose() * cross.transpose() * &effect;
            let rival = compare::losses(&e.scores, &blockwise[i]);
            let c = &mut candidates[i];
            c.overlap = if energy > 0.0 { (shared.norm_squared() / energy).clamp(0.0, 1.0) } else { 0.0 };
            c.t_against_best =
                if i == w { 0.0 } else { compare::t_statistic(&best, &rival, size(i) - size(w), self.rows(problem)) };
            c.indistinguishable = i == w || c.t_against_best < critical || c.overlap > compare::SAME;
        }
    }
}

/// Sum of the left part of the cross-products.
fn sum(grams: &[BlockGram], width: usize) -> DMatrix<f64> {
    grams.iter().fold(DMatrix::zeros(width, width), |s, g| s + g.cross.view((0, 0), (width, width)))
}

/// One degree of freedom for a shape parameter that was searched.
fn searched(problem: &Problem, candidate: usize) -> f64 {
    f64::from(u8::from(problem.candidates[candidate].variants.len() > 1))
}

fn f_of(entry: &Entry<'_>, rest: &Remainder) -> f64 {
    let m = entry.projected.rank() as f64;
    let explained = entry.scores.sum.norm_squared();
    let left = (rest.energy - explained).max(0.0) / (rest.freedom() - m).max(1.0);
    match explained > 0.0 && m > 0.0 {
        true => explained / m / left,
        false => 0.0,
    }
}

fn contribution<'b>(entry: &Entry<'b>) -> Contribution<'b> {
    let coefficients = &entry.projected.basis * &entry.scores.sum;
    let imitation = &entry.projected.imitation * &coefficients;
    Contribution {
        columns: entry.variant.columns.iter().map(|c| c.values.as_slice()).collect(),
        coefficients: coefficients.as_slice().to_vec(),
        imitation: imitation.as_slice().to_vec(),
    }
}

fn estimates(entry: &Entry<'_>, blockwise: &[DMatrix<f64>]) -> Vec<Estimate> {
    let basis = &entry.projected.basis;
    let covariance = basis * sandwich(&entry.scores, blockwise) * basis.transpose();
    let value = basis * &entry.scores.sum;
    let one = |(i, c): (usize, &Column)| Estimate {
        name: c.name.clone(),
        value: value[i],
        standard_error: covariance[(i, i)].max(0.0).sqrt(),
    };
    entry.variant.columns.iter().enumerate().map(one).collect()
}

fn base_estimates(fit: &BaseFit<'_>, inverse: &DMatrix<f64>, rest: &Remainder) -> Vec<Estimate> {
    let spread = inverse * &rest.base_scores;
    let one = |(i, c): (usize, &&Column)| Estimate {
        name: c.name.clone(),
        value: fit.theta[i],
        standard_error: spread.row(i).norm(),
    };
    fit.columns.iter().enumerate().map(one).collect()
}

/// Everything about a candidate that needs neither flips nor a second pass.
fn describe(
    entry: &Entry<'_>,
    problem: &Problem,
    fit: &BaseFit<'_>,
    rest: &Remainder,
    settings: &Settings,
    variants: usize,
) -> Assessment {
    let candidate = &problem.candidates[entry.candidate];
    let projected = &entry.projected;
    let known = |c: &Column| c.magnitude != 0.0 && c.magnitude.is_finite();
    let sized = !entry.variant.columns.is_empty() && entry.variant.columns.iter().all(known);
    let smallest = entry.variant.columns.iter().map(|c| if sized { c.magnitude } else { 1.0 });
    let smallest = DVector::from_iterator(entry.variant.columns.len(), smallest);
    let energy = projected.energy(&smallest);
    let visibility = match (projected.empty, projected.rank()) {
        (true, _) => Visibility::Empty,
        (_, 0) => Visibility::InBaseSpan,
        (_, m) if sized && energy < noncentrality(m, settings.alpha, POWER) => Visibility::TooWeak,
        _ => Visibility::Visible,
    };
    let change = &projected.imitation * &smallest;
    let mut absorbed_by: Vec<Absorption> = fit
        .columns
        .iter()
        .zip(change.iter())
        .map(|(c, &change)| Absorption {
            parameter: c.name.clone(),
            change,
            percent: known(c).then(|| 100.0 * change / c.magnitude.abs()),
        })
        .collect();
    let weight = |a: &Absorption| a.percent.unwrap_or(0.0).abs();
    absorbed_by.sort_by(|a, b| weight(b).total_cmp(&weight(a)).then(b.change.abs().total_cmp(&a.change.abs())));
    absorbed_by.truncate(5);
    let f = f_of(entry, rest);
    let rank = projected.rank();
    let freedom = rank as f64 + f64::from(u8::from(variants > 1));
    Assessment {
        candidate: entry.candidate,
        name: candidate.name.clone(),
        generic: candidate.generic,
        variant: entry.index,
        label: entry.variant.label.clone(),
        visibility,
        tolerance: projected.tolerance,
        noncentrality: sized.then_some(energy),
        absorbed_by,
        rank,
        f_statistic: f,
        log_evidence: if rank > 0 { ln_chi2_tail(rank as f64 * f, freedom) } else { 0.0 },
        score: entry.scores.statistic,
        p_marginal: 1.0,
        p_adjusted: 1.0,
        relevance: Vec::new(),
        explained_share: None,
        coefficients: Vec::new(),
        base_change: Vec::new(),
        sum_of_squares: Vec::new(),
        t_against_best: 0.0,
        overlap: 0.0,
        indistinguishable: false,
    }
}

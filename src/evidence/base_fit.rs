//! Fit of the base model: parameters, residual, noise model and blocks of time.

use std::borrow::Cow;
use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::Error;
use super::gram::{BlockGram, Blocks, Pass, cut, usable};
use super::noise::correlation_time;
use super::predict::subtract;
use super::problem::{Channel, Chosen, Column, Problem, Settings, Variant};
use super::project::pseudo_inverse;
use super::ranking::{Ranking, TooFew};
use super::score::Remainder;
use super::whiten::ArFilter;

/// Fewest blocks for scores.
const MIN_BLOCKS: usize = 16;

/// Fewest samples of a block.
const MIN_BLOCK: usize = 8;

/// Ratio of a residual to the known noise above which a missing effect dominates it.
const LARGE: f64 = 8.0;

/// Least number of values per column of a fit of all candidates.
const ROWS_PER_COLUMN: usize = 20;

/// Number of values per column from which all candidates are fitted for the noise that they leave, if there are more.
const USED_ROWS_PER_COLUMN: usize = 25;

/// Lower bound of a channel's noise, as a share of the RMS of its measurement; smaller values are rounding errors.
const ROUNDING: f64 = 1e-9;

/// Base model fitted to the data: parameters θ, residual, whitening filters and blocks.
pub struct BaseFit<'a> {
    pub columns: Vec<&'a Column>,
    pub residual: Vec<f64>,
    pub theta: DVector<f64>,
    pub filters: Vec<ArFilter>,
    pub floor: Vec<f64>,
    pub blocks: Blocks,
    pub correlation_time: f64,
    pub blocks_too_short: bool,
    /// Rows of each channel and the least number for tests, if there are fewer.
    pub too_few: Option<TooFew>,
}

impl<'a> BaseFit<'a> {
    pub fn new(problem: &'a Problem, chosen: &[Chosen], settings: &Settings) -> Result<Self, Error> {
        let columns = problem.left(chosen)?;
        let (channels, n) = (problem.channels.len(), problem.samples);
        let used = usable(&problem.segments, 0).max(1) as f64;
        let size: Vec<f64> = problem.sum_of_squares(&problem.y).iter().map(|s| (s / used).sqrt()).collect();
        if size.iter().any(|s| !s.is_finite()) {
            return Err(Error::NotFinite(problem.not_finite().unwrap_or("y").into()));
        }
        let floor: Vec<f64> = size.iter().map(|s| ROUNDING * s).collect();
        let mut fit = Self {
            theta: DVector::zeros(columns.len()),
            columns,
            residual: problem.y.to_vec(),
            filters: size.into_iter().map(ArFilter::scale).collect(),
            floor,
            blocks: Vec::new(),
            correlation_time: 1.0,
            blocks_too_short: false,
            too_few: None,
        };
        // Two rounds: scaled least squares gives the residual for the noise model, which then gives a better
        // residual.
        for round in 0..2 {
            fit.cut(problem, settings, 1.0)?;
            let grams = fit.pass(&[], Vec::new()).run(&fit.filters, n, &fit.blocks);
            let (inverse, rank) = pseudo_inverse(&sum(&grams, fit.columns.len()));
            let rest = Remainder::new(&grams, &inverse, rank, fit.rows(problem));
            if rest.base.iter().any(|x| !x.is_finite()) || !rest.energy.is_finite() {
                return Err(Error::NotFinite(problem.not_finite().unwrap_or("base").into()));
            }
            fit.update(&rest.base);
            let noise = match round {
                0 => Cow::Borrowed(&fit.residual[..]),
                _ => fit.left_by_candidates(problem, chosen),
            };
            fit.filters = (0..channels)
                .map(|c| {
                    let series = &noise[c * n..(c + 1) * n];
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

    /// Residual from which the noise is estimated: that of the base, or where it exceeds the noise of every channel by far, what all
    /// open candidates together leave of it. A large missing effect would otherwise count as noise, and the filter that
    /// whitens it would remove slow effects and keep the steps of friction.
    fn left_by_candidates(&self, problem: &Problem, chosen: &[Chosen]) -> Cow<'_, [f64]> {
        let n = problem.samples;
        let rows: Vec<usize> = problem.segments.iter().cloned().flatten().collect();
        let scale: Vec<f64> =
            problem.sum_of_squares(&self.residual).iter().map(|s| (s / rows.len().max(1) as f64).sqrt()).collect();
        let is_large =
            |(channel, rms): (&Channel, &f64)| channel.noise_sigma.is_some_and(|s| s > 0.0 && *rms > LARGE * s);
        if !problem.channels.iter().zip(&scale).all(is_large) {
            return Cow::Borrowed(&self.residual);
        }
        let open = |i: &usize| chosen.iter().all(|c| c.candidate != *i);
        let candidates: Vec<_> = (0..problem.candidates.len()).filter(open).map(|i| &problem.candidates[i]).collect();
        let shapes = candidates.iter().map(|c| c.variants.len()).max().unwrap_or(0);
        let most = rows.len() * problem.channels.len() / ROWS_PER_COLUMN;
        // The first shapes of all candidates, then the second ones, as far as the data permit.
        let variants = (0..shapes).flat_map(|v| candidates.iter().filter_map(move |c| c.variants.get(v)));
        let columns = self.columns.iter().copied().chain(variants.flat_map(|v| &v.columns)).take(most);
        let columns: Vec<&Column> = columns.filter(|c| c.values.iter().any(|v| *v != 0.0)).collect();
        let used: Vec<usize> = (0..problem.channels.len()).filter(|&c| scale[c] > 0.0).collect();
        let stride = (rows.len() * used.len() / (USED_ROWS_PER_COLUMN * columns.len()).max(1)).max(1);
        let places: Vec<usize> =
            used.iter().flat_map(|c| rows.iter().step_by(stride).map(move |k| c * n + k)).collect();
        let value = |series: &[f64], place: usize| series[place] / scale[place / n];
        let matrix = DMatrix::from_fn(places.len(), columns.len(), |i, j| value(&columns[j].values, places[i]));
        let right = DVector::from_iterator(places.len(), places.iter().map(|&p| value(&self.residual, p)));
        // A product of matrices is blocked for the cache; `tr_mul` is not.
        let transposed = matrix.transpose();
        let (inverse, _) = pseudo_inverse(&(&transposed * matrix));
        let coefficients = inverse * (transposed * right);
        let mut left = self.residual.clone();
        let columns: Vec<&[f64]> = columns.iter().map(|c| &*c.values).collect();
        subtract(&mut left, &columns, coefficients.as_slice());
        Cow::Owned(left)
    }

    /// Samples lost at the start of each segment.
    pub fn skip(&self) -> usize {
        self.filters.iter().map(ArFilter::order).max().unwrap_or(0)
    }

    pub fn rows(&self, problem: &Problem) -> usize {
        usable(&problem.segments, self.skip()) * self.filters.iter().filter(|f| f.sigma > 0.0).count()
    }

    /// The fit in the noise of a ranking, which may be estimated with a further effect.
    pub fn in_noise_of(mut self, problem: &Problem, ranking: &Ranking, settings: &Settings) -> Result<Self, Error> {
        self.filters.clone_from(&ranking.filters);
        self.cut(problem, settings, ranking.correlation_time)?;
        Ok(self)
    }

    fn cut(&mut self, problem: &Problem, settings: &Settings, time: f64) -> Result<(), Error> {
        let rows = usable(&problem.segments, self.skip());
        let length = (5.0 * time).max(MIN_BLOCK as f64);
        let wanted = ((rows as f64 / length) as usize).min(settings.blocks.max(MIN_BLOCKS));
        self.blocks = cut(&problem.segments, self.skip(), wanted.max(MIN_BLOCKS));
        self.correlation_time = time;
        self.blocks_too_short = wanted < MIN_BLOCKS;
        // A block is at most 1.5 times as long as intended, so this many samples give the required number of blocks.
        let needed = MIN_BLOCKS * MIN_BLOCK;
        self.too_few = (rows < needed).then_some(TooFew { rows, needed });
        let (values, parameters) = (self.rows(problem), self.columns.len());
        if values <= parameters {
            return Err(Error::Undetermined { values, parameters });
        }
        Ok(())
    }

    pub fn update(&mut self, change: &DVector<f64>) {
        let columns: Vec<&[f64]> = self.columns.iter().map(|c| &*c.values).collect();
        subtract(&mut self.residual, &columns, change.as_slice());
        self.theta += change;
    }

    /// Pass over the whitened columns: base columns and residual on the left, then the columns of the variants.
    pub fn pass<'b>(&'b self, variants: &[&'b Variant], groups: Vec<Range<usize>>) -> Pass<'b> {
        let mut columns: Vec<&[f64]> = self.columns.iter().map(|c| &*c.values).collect();
        columns.push(&self.residual);
        let left = columns.len();
        columns.extend(variants.iter().flat_map(|v| &v.columns).map(|c| &*c.values));
        Pass { columns, left, groups }
    }
}

/// Sum of the left part of the cross-products.
pub fn sum(grams: &[BlockGram], width: usize) -> DMatrix<f64> {
    grams.iter().fold(DMatrix::zeros(width, width), |s, g| s + g.cross.view((0, 0), (width, width)))
}

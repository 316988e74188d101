//! Fit of the base model: parameters, residual, noise model and blocks of time.

use std::ops::Range;

use nalgebra::{DMatrix, DVector};

use super::Error;
use super::gram::{BlockGram, Blocks, Pass, cut, usable};
use super::noise::correlation_time;
use super::predict::{squares, subtract};
use super::problem::{Chosen, Column, Problem, Settings, Variant};
use super::project::pseudo_inverse;
use super::score::Remainder;
use super::whiten::ArFilter;

/// Fewest blocks for scores.
const MIN_BLOCKS: usize = 16;

/// Fewest samples of a block.
const MIN_BLOCK: usize = 8;

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
}

impl<'a> BaseFit<'a> {
    pub fn new(problem: &'a Problem, chosen: &[Chosen], settings: &Settings) -> Result<Self, Error> {
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
        // Two rounds: scaled least squares gives the residual for the noise model, which then gives a better
        // residual.
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
    pub fn skip(&self) -> usize {
        self.filters.iter().map(ArFilter::order).max().unwrap_or(0)
    }

    pub fn rows(&self, problem: &Problem) -> usize {
        usable(&problem.segments, self.skip()) * self.filters.iter().filter(|f| f.sigma > 0.0).count()
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
        if rows < needed {
            return Err(Error::TooShort { rows, skip: self.skip(), needed });
        }
        let (values, parameters) = (self.rows(problem), self.columns.len());
        if values <= parameters {
            return Err(Error::Undetermined { values, parameters });
        }
        Ok(())
    }

    pub fn update(&mut self, change: &DVector<f64>) {
        let columns: Vec<&[f64]> = self.columns.iter().map(|c| c.values.as_slice()).collect();
        subtract(&mut self.residual, &columns, change.as_slice());
        self.theta += change;
    }

    /// Pass over the whitened columns: base columns and residual on the left, then the columns of the variants.
    pub fn pass<'b>(&'b self, variants: &[&'b Variant], groups: Vec<Range<usize>>) -> Pass<'b> {
        let mut columns: Vec<&[f64]> = self.columns.iter().map(|c| c.values.as_slice()).collect();
        columns.push(&self.residual);
        let left = columns.len();
        columns.extend(variants.iter().flat_map(|v| &v.columns).map(|c| c.values.as_slice()));
        Pass { columns, left, groups }
    }
}

/// Sum of the left part of the cross-products.
pub fn sum(grams: &[BlockGram], width: usize) -> DMatrix<f64> {
    grams.iter().fold(DMatrix::zeros(width, width), |s, g| s + g.cross.view((0, 0), (width, width)))
}

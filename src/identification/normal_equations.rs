//! Normal equations of a model along recordings, accumulated in one pass.
//!
//! A recording is processed in windows, of which only the residuals and, for every block of time, YᵀWY and YᵀWr are
//! kept. Their total gives the Gauss–Newton step, their scatter over blocks the standard errors.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};

use super::dataset::stride_for;
use super::fit::{FitError, kinematics};
use super::prediction::{Channels, KeptColumns, Laws, chunk, is_local, prediction_and_columns, surroundings};
use super::residuals::difference;
use super::{Dataset, Residuals};
use crate::dynamics::Plant;
use crate::model::Model;
use crate::numerics::parallel;
use crate::recording::Series;

/// Blocks of time per recording: sufficient for the scatter of more parameters than any model has.
const BLOCKS: usize = 100;
/// Least number of samples of a block.
const MIN_BLOCK: usize = 20;
/// Number of samples whose rows are kept.
const ROWS: usize = 2000;

/// Weight of a sample, given its channel and its residual in units of the channel's noise.
pub type Weight<'a> = &'a (dyn Fn(usize, f64) -> f64 + Sync);

/// Unit weights.
pub const UNIT_WEIGHTS: Weight<'static> = &|_, _| 1.0;

/// Sums over one block of time.
#[derive(Clone)]
pub struct Block {
    /// YᵀWY.
    pub information: DMatrix<f64>,
    /// YᵀWr.
    pub score: DVector<f64>,
}

/// Normal equations at the present parameters of a model.
#[derive(Clone)]
pub struct NormalEquations {
    /// Blocks of every recording, in the order of time.
    pub blocks: Vec<Vec<Block>>,
    /// YᵀWY over all blocks.
    pub information: DMatrix<f64>,
    /// YᵀWr over all blocks.
    pub score: DVector<f64>,
    /// Measured − predicted, per recording and channel, N·m or N.
    pub residuals: Arc<Residuals>,
    /// Weighted rows of Y at every so many samples, for what products of Y with itself are too coarse to show.
    pub rows: Vec<Vec<f64>>,
    /// Number of samples per kept row of each channel.
    pub stride: usize,
}

impl NormalEquations {
    /// Sums over all recordings for the parameters `free` of the plant; `sigma[dataset][channel]` scales the rows.
    ///
    /// # Errors
    /// [`FitError::Kinematics`] if a pose is impossible for the model's geometry or a law gives no finite value.
    pub fn new(
        model: &Model,
        recordings: &[KeptColumns],
        sigma: &[Vec<f64>],
        free: &[usize],
        weight: Weight,
    ) -> Result<Self, FitError> {
        let n = free.len();
        let mut all = Self {
            blocks: Vec::new(),
            information: DMatrix::zeros(n, n),
            score: DVector::zeros(n),
            residuals: Arc::default(),
            rows: Vec::new(),
            stride: stride_for(recordings.iter().map(|kept| kept.dataset.len()).sum(), ROWS),
        };
        let pass =
            |(kept, sigma): (&KeptColumns, &Vec<f64>)| all.pass(&kept.dataset.plant(model), kept, sigma, free, weight);
        let residuals = recordings.iter().zip(sigma).map(pass).collect::<Result<Vec<Channels>, _>>()?;
        all.residuals = Arc::new(Residuals::along_these(recordings, residuals));
        for b in all.blocks.iter().flatten() {
            all.information += &b.information;
            all.score += &b.score;
        }
        Ok(all)
    }

    /// Adds the blocks and rows of one recording; its residuals.
    fn pass(
        &mut self,
        plant: &Plant,
        kept: &KeptColumns,
        sigma: &[f64],
        free: &[usize],
        weight: Weight,
    ) -> Result<Channels, FitError> {
        let dataset = kept.dataset;
        let known = kept.laws(plant).map_err(kinematics(dataset))?;
        let length = dataset.len().div_ceil(BLOCKS).max(MIN_BLOCK);
        let window = if is_local(plant) { length * (chunk(plant) / length).max(1) } else { dataset.len().max(1) };
        let starts: Vec<usize> = (0..dataset.len()).step_by(window).collect();
        let rows = Rows { length, stride: self.stride, sigma, free, weight };
        let parts = parallel::map(starts.len(), |i| {
            let range = starts[i]..(starts[i] + window).min(dataset.len());
            part(plant, dataset, range, rows, &known)
        });
        let mut residuals: Channels = dataset.channels.iter().map(|_| Vec::with_capacity(dataset.len())).collect();
        let mut blocks = Vec::new();
        for part in parts {
            let part = part?;
            blocks.extend(part.blocks);
            self.rows.extend(part.rows);
            for (all, part) in residuals.iter_mut().zip(part.residual) {
                all.extend(part);
            }
        }
        self.blocks.push(blocks);
        Ok(residuals)
    }

    /// Updates the scores for a `step` of the parameters to first order; residuals are not changed.
    pub fn advance(&mut self, step: &DVector<f64>) {
        for b in self.blocks.iter_mut().flatten() {
            b.score -= &b.information * step;
        }
        self.score -= &self.information * step;
    }
}

/// Result of one window.
struct Part {
    blocks: Vec<Block>,
    residual: Channels,
    rows: Vec<Vec<f64>>,
}

/// Weights and selection of the rows of a dataset.
#[derive(Clone, Copy)]
struct Rows<'a> {
    /// Samples of a block.
    length: usize,
    /// Stride of the samples whose rows are kept.
    stride: usize,
    /// Standard deviation of the noise per channel.
    sigma: &'a [f64],
    /// Indices of the parameters of the columns.
    free: &'a [usize],
    weight: Weight<'a>,
}

fn part(plant: &Plant, dataset: &Dataset, range: Range<usize>, of: Rows, known: &Laws) -> Result<Part, FitError> {
    let Rows { length, stride, sigma, free, weight } = of;
    let (around, shift) = surroundings(plant, dataset, &range);
    let known = known.from(range.start - shift);
    let (predicted, columns) = prediction_and_columns(plant, &around, known).map_err(kinematics(dataset))?;
    let here = |(m, p): (&Series, &Vec<f64>)| difference(&m[range.clone()], &p[shift..]);
    let residual: Channels = dataset.measured.iter().zip(&predicted).map(here).collect();
    let n = free.len();
    let uses = used(dataset, &range);
    let mut blocks = Vec::new();
    for start in (0..range.len()).step_by(length) {
        let rows = start..(start + length).min(range.len());
        let mut information = DMatrix::zeros(n, n);
        let mut score = DVector::zeros(n);
        for (c, s) in sigma.iter().enumerate() {
            let root = |k: usize| uses[k] * weight(c, residual[c][k] / s).sqrt() / s;
            let root: Vec<f64> = rows.clone().map(root).collect();
            let live: Vec<usize> = (0..n)
                .filter(|&j| columns[free[j]][c][shift + rows.start..shift + rows.end].iter().any(|x| *x != 0.0))
                .collect();
            let y = DMatrix::from_fn(rows.len(), live.len(), |i, j| {
                columns[free[live[j]]][c][shift + rows.start + i] * root[i]
            });
            let r = DVector::from_fn(rows.len(), |i, _| residual[c][rows.start + i] * root[i]);
            let (square, product) = (y.tr_mul(&y), y.tr_mul(&r));
            for (a, &i) in live.iter().enumerate() {
                score[i] += product[a];
                for (b, &j) in live.iter().enumerate() {
                    information[(i, j)] += square[(a, b)];
                }
            }
        }
        blocks.push(Block { information, score });
    }
    let kept = range.clone().filter(|k| k % stride == 0).map(|k| k - range.start);
    let mut rows = Vec::new();
    for k in kept {
        for (c, s) in sigma.iter().enumerate() {
            let root = uses[k] * weight(c, residual[c][k] / s).sqrt() / s;
            rows.push(free.iter().map(|&j| columns[j][c][shift + k] * root).collect());
        }
    }
    Ok(Part { blocks, residual, rows })
}

/// Weights of the samples in `range`: 1, or 0 near reversals.
pub fn used(dataset: &Dataset, range: &Range<usize>) -> Vec<f64> {
    let mut uses = vec![1.0; range.len()];
    for near in &dataset.near_reversals {
        let [start, end] = [near.start, near.end].map(|k| k.clamp(range.start, range.end) - range.start);
        uses[start..end].fill(0.0);
    }
    uses
}

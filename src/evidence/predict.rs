//! Change of the unwhitened residual by a fitted candidate, per channel.

use std::ops::Range;

use nalgebra::{DMatrix, DMatrixView};

use super::gram::{Blocks, dot};
use crate::numerics::parallel;

/// Rows per tile.
const TILE: usize = 1024;

/// A candidate's columns, their coefficients, and the base coefficients that imitate their contribution.
pub struct Contribution<'a> {
    /// Columns, stacked over channels.
    pub columns: Vec<&'a [f64]>,
    /// Coefficient of each column.
    pub coefficients: Vec<f64>,
    /// Base coefficients that reproduce the contribution's projection onto the base.
    pub imitation: Vec<f64>,
}

/// Per channel: energy of the contribution and its product with the residual.
#[derive(Clone, Debug, Default)]
pub struct Effect {
    /// Sum of squares of the contribution per channel.
    pub energy: Vec<f64>,
    /// Its product with the residual per channel.
    pub product: Vec<f64>,
}

/// `y − Σ_i columns_i coefficients_i` in place, over all rows.
pub fn subtract(series: &mut [f64], columns: &[&[f64]], coefficients: &[f64]) {
    let mut parts: Vec<&mut [f64]> = series.chunks_mut(4 * TILE).collect();
    parallel::each(&mut parts, |k, part| {
        let at = k * 4 * TILE;
        for (column, c) in columns.iter().zip(coefficients).filter(|(_, c)| **c != 0.0) {
            for (y, x) in part.iter_mut().zip(&column[at..]) {
                *y -= c * x;
            }
        }
    });
}

/// The effect of every contribution, summed over blocks of time in order.
pub fn effects(
    base: &[&[f64]],
    residual: &[f64],
    contributions: &[Contribution<'_>],
    channels: usize,
    samples: usize,
    blocks: &Blocks,
) -> Vec<Effect> {
    let imitation = DMatrix::from_fn(base.len(), contributions.len(), |i, j| contributions[j].imitation[i]);
    let tasks: Vec<(usize, &Vec<Range<usize>>)> =
        (0..channels).flat_map(|c| blocks.iter().map(move |b| (c, b))).collect();
    let sum = |i: usize| one_block(base, residual, contributions, &imitation, tasks[i].0 * samples, tasks[i].1);
    let sums = parallel::map(tasks.len(), sum);
    let zero = Effect { energy: vec![0.0; channels], product: vec![0.0; channels] };
    let mut out = vec![zero; contributions.len()];
    for ((c, _), sums) in tasks.iter().zip(sums) {
        for (o, s) in out.iter_mut().zip(sums) {
            o.energy[*c] += s[0];
            o.product[*c] += s[1];
        }
    }
    out
}

fn one_block(
    base: &[&[f64]],
    residual: &[f64],
    contributions: &[Contribution<'_>],
    imitation: &DMatrix<f64>,
    offset: usize,
    block: &[Range<usize>],
) -> Vec<[f64; 2]> {
    let mut sums = vec![[0.0; 2]; contributions.len()];
    let mut tile = vec![0.0; TILE * base.len()];
    for range in block {
        for start in range.clone().step_by(TILE) {
            let rows = offset + start..offset + (start + TILE).min(range.end);
            let n = rows.len();
            for (k, column) in base.iter().enumerate() {
                tile[k * n..(k + 1) * n].copy_from_slice(&column[rows.clone()]);
            }
            let view = DMatrixView::from_slice(&tile[..n * base.len()], n, base.len());
            let mut made = -(view * imitation);
            for ((one, mut d), sum) in contributions.iter().zip(made.column_iter_mut()).zip(&mut sums) {
                for (column, c) in one.columns.iter().zip(&one.coefficients) {
                    for (d, x) in d.iter_mut().zip(&column[rows.clone()]) {
                        *d += c * x;
                    }
                }
                let d = d.as_slice();
                sum[0] += dot(d, d);
                sum[1] += dot(d, &residual[rows.clone()]);
            }
        }
    }
    sums
}

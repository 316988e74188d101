//! Cross-products of whitened columns per block of time, computed in one pass without a whitened copy of the data.

use std::ops::Range;

use nalgebra::DMatrix;

use super::whiten::ArFilter;
use crate::numerics::parallel;

/// Rows per tile; a tile of a hundred columns fits the second-level cache.
const TILE: usize = 256;

/// Intervals of samples that make up each block.
pub type Blocks = Vec<Vec<Range<usize>>>;

/// Cross-products over one block.
#[derive(Clone, Debug)]
pub struct BlockGram {
    /// Left columns against all columns.
    pub cross: DMatrix<f64>,
    /// Every group's columns against themselves.
    pub own: Vec<DMatrix<f64>>,
}

/// Columns of a pass over the data, and the products to form.
pub struct Pass<'a> {
    /// All columns; the left ones come first.
    pub columns: Vec<&'a [f64]>,
    /// Number of left columns.
    pub left: usize,
    /// Column ranges whose own Gram matrices are wanted.
    pub groups: Vec<Range<usize>>,
}

/// Samples per channel that remain when each segment loses its first `skip` samples.
pub fn usable(segments: &[Range<usize>], skip: usize) -> usize {
    segments.iter().map(|s| s.len().saturating_sub(skip)).sum()
}

/// About `target` blocks of equal length. A block does not cross segments, unless there are more segments than
/// blocks; neighbouring segments then share one.
pub fn cut(segments: &[Range<usize>], skip: usize, target: usize) -> Blocks {
    let total = usable(segments, skip);
    let length = total as f64 / target.max(1) as f64;
    let mut blocks: Blocks = Vec::new();
    let mut open = 0.0;
    for s in segments.iter().filter(|s| s.len() > skip) {
        let (start, n) = (s.start + skip, s.len() - skip);
        let parts = (n as f64 / length).round() as usize;
        if parts <= 1 {
            // An interval shorter than 1.5 blocks joins the previous block while that has room.
            match blocks.last_mut() {
                Some(last) if open > 0.0 && open + 0.5 * n as f64 <= length => {
                    last.push(start..s.end);
                    open += n as f64;
                }
                _ => {
                    blocks.push(vec![start..s.end]);
                    open = n as f64;
                }
            }
            continue;
        }
        open = 0.0;
        blocks.extend((0..parts).map(|i| vec![start + i * n / parts..start + (i + 1) * n / parts]));
    }
    blocks
}

impl Pass<'_> {
    /// Cross-products of every block, in order. One thread sums each block in a fixed order, so the result does not
    /// depend on the number of threads.
    pub fn run(&self, filters: &[ArFilter], samples: usize, blocks: &Blocks) -> Vec<BlockGram> {
        let acting: Vec<Vec<usize>> = (0..filters.len()).map(|c| self.acting(c, samples)).collect();
        let channels: Vec<(&ArFilter, &[usize])> = filters.iter().zip(acting.iter().map(Vec::as_slice)).collect();
        parallel::map(blocks.len(), |i| self.block(&channels, samples, &blocks[i]))
    }

    /// Columns that are not zero throughout a channel; many laws act on one drive.
    fn acting(&self, channel: usize, samples: usize) -> Vec<usize> {
        let acts = |i: &usize| self.columns[*i][channel * samples..(channel + 1) * samples].iter().any(|x| *x != 0.0);
        (0..self.columns.len()).filter(acts).collect()
    }

    fn block(&self, channels: &[(&ArFilter, &[usize])], samples: usize, block: &[Range<usize>]) -> BlockGram {
        let mut out = BlockGram {
            cross: DMatrix::zeros(self.left, self.columns.len()),
            own: self.groups.iter().map(|g| DMatrix::zeros(g.len(), g.len())).collect(),
        };
        for (c, (filter, acting)) in channels.iter().enumerate().filter(|(_, (filter, _))| filter.sigma > 0.0) {
            let place = |column: usize| acting.partition_point(|&i| i < column);
            let mut tile = DMatrix::zeros(TILE, acting.len());
            let mut left = DMatrix::zeros(place(self.left), TILE);
            let mut cross = DMatrix::zeros(left.nrows(), acting.len());
            for range in block {
                for start in range.clone().step_by(TILE) {
                    let rows = start..(start + TILE).min(range.end);
                    for (&i, cells) in acting.iter().zip(tile.as_mut_slice().chunks_exact_mut(TILE)) {
                        let (used, rest) = cells.split_at_mut(rows.len());
                        filter.apply(&self.columns[i][c * samples..(c + 1) * samples], rows.clone(), used);
                        rest.fill(0.0);
                    }
                    tile.columns(0, left.nrows()).transpose_to(&mut left);
                    cross.gemm(1.0, &left, &tile, 1.0);
                    for (group, own) in self.groups.iter().zip(&mut out.own) {
                        let places = place(group.start)..place(group.end);
                        let cells = &tile.as_slice()[places.start * TILE..places.end * TILE];
                        add_gram(cells, &acting[places], group.start, own);
                    }
                }
            }
            for (column, &j) in cross.column_iter().zip(*acting) {
                column.iter().zip(*acting).for_each(|(x, &i)| out.cross[(i, j)] += x);
            }
        }
        for own in &mut out.own {
            own.fill_upper_triangle_with_lower_triangle();
        }
        out
    }
}

/// Adds the products of a tile's columns to the lower triangle; `places` are the columns' numbers, which count from `first` in
/// `own`.
fn add_gram(columns: &[f64], places: &[usize], first: usize, own: &mut DMatrix<f64>) {
    for (j, b) in columns.chunks_exact(TILE).enumerate() {
        for (i, a) in columns.chunks_exact(TILE).enumerate().skip(j) {
            own[(places[i] - first, places[j] - first)] += dot(a, b);
        }
    }
}

/// Inner product with eight partial sums, which the compiler can keep in vector registers.
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (ca, cb) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = ca.remainder().iter().zip(cb.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in ca.zip(cb) {
        for i in 0..8 {
            sums[i] += x[i] * y[i];
        }
    }
    sums.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_cover_every_usable_sample_once() {
        for (segments, target) in [
            (vec![0..1000], 40),
            (vec![0..100, 100..900, 950..1000], 20),
            ((0..200).map(|i| 10 * i..10 * i + 10).collect::<Vec<_>>(), 50),
            (vec![0..3, 3..400], 10),
        ] {
            let blocks = cut(&segments, 4, target);
            let mut seen = vec![0; 2000];
            for t in blocks.iter().flatten().cloned().flatten() {
                seen[t] += 1;
            }
            for s in &segments {
                for t in s.clone() {
                    assert_eq!(seen[t], usize::from(t >= s.start + 4));
                }
            }
            assert!(blocks.len() <= 2 * target && 2 * blocks.len() >= target, "{} for {target}", blocks.len());
        }
    }

    #[test]
    fn block_sums_equal_direct_products() {
        let (n, channels) = (700, 2);
        let make = |k: f64| -> Vec<f64> { (0..n * channels).map(|i| (0.37 * k * i as f64).sin() + k).collect() };
        let mut data: Vec<Vec<f64>> = (1..5).map(|k| make(f64::from(k))).collect();
        data[2][n..].fill(0.0);
        let pass = Pass { columns: data.iter().map(Vec::as_slice).collect(), left: 2, groups: vec![1..4] };
        let filters = [ArFilter { coefficients: vec![0.4, -0.1], sigma: 2.0 }, ArFilter::scale(0.5)];
        let segments = [0..300, 310..n];
        let grams = pass.run(&filters, n, &cut(&segments, 2, 7));
        let white = |k: usize, c: usize, t: usize| {
            let x = |back: usize| data[k][c * n + t - back];
            if c == 0 { (x(0) - 0.4 * x(1) + 0.1 * x(2)) / 2.0 } else { x(0) / 0.5 }
        };
        let direct = |i: usize, j: usize| -> f64 {
            let times = || (2..300).chain(312..n);
            (0..2).map(|c| times().map(|t| white(i, c, t) * white(j, c, t)).sum::<f64>()).sum()
        };
        let cross = |i: usize, j: usize| grams.iter().map(|g| g.cross[(i, j)]).sum::<f64>();
        let own = |i: usize, j: usize| grams.iter().map(|g| g.own[0][(i - 1, j - 1)]).sum::<f64>();
        for (i, j) in [(0, 0), (0, 2), (1, 2), (1, 3)] {
            assert!((cross(i, j) - direct(i, j)).abs() < 1e-9 * direct(i, j).abs(), "{i} {j}");
        }
        for (i, j) in [(1, 3), (2, 1), (2, 3), (2, 2)] {
            assert!((own(i, j) - direct(i, j)).abs() < 1e-9 * direct(i, j).abs(), "own {i} {j}");
        }
    }
}

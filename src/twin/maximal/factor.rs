//! Cholesky factors: of 6×6 blocks of one body, and of the fronts of S = G·M⁻¹·Gᵀ.
//!
//! The graph of the joints is a star: the limbs (bearing, two elbows) and the chain of axis 4 meet at the joints of the
//! plate. Each branch is a front whose inner rows are eliminated independently; its Schur complement on the plate's rows
//! is added to the last, dense front. There is no fill-in outside the fronts.

use super::structure::Run;

/// Six numbers of one body: translational part at its origin, then rotational part.
pub(super) type Six = [f64; 6];

#[inline]
pub(super) fn dot(a: &Six, b: &Six) -> f64 {
    (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) + (a[3] * b[3] + a[4] * b[4] + a[5] * b[5])
}

/// a += k·b.
#[inline]
pub(super) fn add(a: &mut Six, k: f64, b: &Six) {
    for (x, y) in a.iter_mut().zip(b) {
        *x += k * y;
    }
}

/// Ratio of pivot to diagonal below which a matrix counts as singular.
const BODY_RANK: f64 = 1e-11;
const ROW_RANK: f64 = 1e-12;

/// Lower Cholesky factor of a 6×6 matrix: columns, and the reciprocal diagonal.
#[derive(Clone, Copy)]
pub(super) struct Root {
    columns: [Six; 6],
    inverse: Six,
}

impl Root {
    pub const ONE: Self = Self { columns: [[0.0; 6]; 6], inverse: [1.0; 6] };

    /// Factor of the symmetric `m` (lower triangle by columns); `None` if it is not safely positive definite.
    pub fn new(m: &[Six; 6]) -> Option<Self> {
        let mut root = Self { columns: *m, inverse: [0.0; 6] };
        // For a body without shifted inertia the translational block is m·1.
        if m[0][1] == 0.0 && m[0][2] == 0.0 && m[1][2] == 0.0 && m[0][0] == m[1][1] && m[0][0] == m[2][2] {
            if m[0][0] <= 0.0 {
                return None;
            }
            let scale = 1.0 / m[0][0].sqrt();
            for k in 0..3 {
                root.inverse[k] = scale;
                for x in &mut root.columns[k] {
                    *x *= scale;
                }
            }
            let [a, b, c, rest @ ..] = &mut root.columns;
            for j in 0..3 {
                for i in j..3 {
                    rest[j][3 + i] -= a[3 + i] * a[3 + j] + b[3 + i] * b[3 + j] + c[3 + i] * c[3 + j];
                }
            }
            root.eliminate::<3>(m)?;
        } else {
            root.eliminate::<0>(m)?;
        }
        Some(root)
    }

    #[inline(always)]
    fn eliminate<const FROM: usize>(&mut self, m: &[Six; 6]) -> Option<()> {
        for k in FROM..6 {
            let pivot = self.columns[k][k];
            let regular = pivot > BODY_RANK * m[k][k]; // false for NaN
            if !regular {
                return None;
            }
            let scale = 1.0 / pivot.sqrt();
            self.inverse[k] = scale;
            for i in k..6 {
                self.columns[k][i] *= scale;
            }
            let column = self.columns[k];
            for j in k + 1..6 {
                for i in j..6 {
                    self.columns[j][i] -= column[j] * column[i];
                }
            }
        }
        Some(())
    }

    /// L⁻¹·x.
    #[inline]
    pub fn lower(&self, x: &Six) -> Six {
        let mut y = *x;
        for k in 0..6 {
            y[k] *= self.inverse[k];
            for i in k + 1..6 {
                y[i] -= self.columns[k][i] * y[k];
            }
        }
        y
    }

    /// L⁻ᵀ·x.
    #[inline]
    pub fn upper(&self, x: &Six) -> Six {
        let mut y = *x;
        for k in (0..6).rev() {
            for i in k + 1..6 {
                y[k] -= self.columns[k][i] * y[i];
            }
            y[k] *= self.inverse[k];
        }
        y
    }
}

/// L⁻¹·Gᵀ component by component: six rows of block rows.
pub(super) type Columns = [Vec<f64>; 6];

/// target += Σ factor_b·source_b, element-wise; all slices have the same length.
#[inline(always)]
fn add_all<const B: usize>(target: &mut [f64], factors: &[f64; B], sources: &[&[f64]; B]) {
    let n = target.len();
    let mut cut = *sources;
    for b in 0..B {
        cut[b] = &sources[b][..n];
    }
    for i in 0..n {
        let mut sum = target[i];
        for b in 0..B {
            sum += factors[b] * cut[b][i];
        }
        target[i] = sum;
    }
}

/// target += products of block row `row` with those from `others` on.
#[inline(always)]
fn row_times(target: &mut [f64], y: &Columns, row: usize, others: usize) {
    let n = target.len();
    let mut factors = [0.0; 6];
    let mut sources: [&[f64]; 6] = [&[]; 6];
    for c in 0..6 {
        factors[c] = y[c][row];
        sources[c] = &y[c][others..others + n];
    }
    add_all(target, &factors, &sources);
}

/// A symmetric matrix, lower triangle by columns, whose first rows are eliminated joint by joint.
#[derive(Default)]
pub(super) struct Front {
    n: usize,
    columns: Vec<f64>,
    /// Reciprocal pivots of the inner rows.
    inverse: Vec<f64>,
    /// Number of rows of each inner joint (1 to 5), and one past the last row reached by its elimination.
    panels: Vec<(usize, usize)>,
}

impl Front {
    pub fn new(n: usize, inner: usize, panels: &[(usize, usize)]) -> Self {
        Self { n, columns: vec![0.0; n * n], inverse: vec![0.0; inner], panels: panels.to_vec() }
    }

    pub fn clear(&mut self) {
        self.columns.fill(0.0);
    }

    /// Column `k` from its diagonal entry down.
    pub fn column(&mut self, k: usize) -> &mut [f64] {
        &mut self.columns[k * self.n + k..(k + 1) * self.n]
    }

    /// Adds `Y·Yᵀ` of the block rows of one body.
    pub fn gram(&mut self, y: &Columns, runs: &[Run]) {
        for (k, run) in runs.iter().enumerate() {
            for j in 0..run.len {
                let (column, block) = (run.at + j, run.block + j);
                row_times(&mut self.column(column)[..run.len - j], y, block, block);
                for other in &runs[k + 1..] {
                    let at = other.at - column;
                    row_times(&mut self.column(column)[at..at + other.len], y, block, other.block);
                }
            }
        }
    }

    /// Writes the diagonal entries.
    pub fn diagonal(&self, out: &mut [f64]) {
        out.iter_mut().enumerate().for_each(|(k, x)| *x = self.columns[k * self.n + k]);
    }

    /// Partial Cholesky factorisation; the trailing rows then hold the Schur complement.
    ///
    /// Returns false if a pivot is negligible relative to its `diagonal` entry in the whole matrix.
    pub fn eliminate(&mut self, diagonal: &[f64]) -> bool {
        let mut at = 0;
        for p in 0..self.panels.len() {
            let (len, reach) = self.panels[p];
            for k in at..at + len {
                let (done, rest) = self.columns.split_at_mut((k + 1) * self.n);
                let column = &mut done[k * self.n + k..k * self.n + reach];
                let regular = column[0] > ROW_RANK * diagonal[k]; // false for NaN
                if !regular {
                    return false;
                }
                let scale = 1.0 / column[0].sqrt();
                self.inverse[k] = scale;
                for x in column.iter_mut() {
                    *x *= scale;
                }
                for j in 0..at + len - k - 1 {
                    let target = &mut rest[j * self.n + k + 1 + j..j * self.n + reach];
                    add_all(target, &[-column[j + 1]], &[&column[j + 1..]]);
                }
            }
            match len {
                1 => self.update::<1>(at, reach),
                2 => self.update::<2>(at, reach),
                3 => self.update::<3>(at, reach),
                4 => self.update::<4>(at, reach),
                5 => self.update::<5>(at, reach),
                _ => unreachable!("rows of a joint"),
            }
            at += len;
        }
        true
    }

    /// Subtracts the contribution of the panel of `B` columns at `at` from the columns after it.
    fn update<const B: usize>(&mut self, at: usize, reach: usize) {
        let n = self.n;
        let (done, rest) = self.columns.split_at_mut((at + B) * n);
        for j in at + B..reach {
            let mut factors = [0.0; B];
            let mut panel: [&[f64]; B] = [&[]; B];
            for b in 0..B {
                panel[b] = &done[(at + b) * n + j..(at + b) * n + reach];
                factors[b] = -panel[b][0];
            }
            let column = (j - at - B) * n;
            add_all(&mut rest[column + j..column + reach], &factors, &panel);
        }
    }

    /// x := L⁻¹·x on the eliminated rows, with their contributions subtracted from the others.
    pub fn forward(&self, x: &mut [f64]) {
        let mut at = 0;
        for &(len, reach) in &self.panels {
            match len {
                1 => self.forward_panel::<1>(x, at, reach),
                2 => self.forward_panel::<2>(x, at, reach),
                3 => self.forward_panel::<3>(x, at, reach),
                4 => self.forward_panel::<4>(x, at, reach),
                _ => self.forward_panel::<5>(x, at, reach),
            }
            at += len;
        }
    }

    fn forward_panel<const B: usize>(&self, x: &mut [f64], at: usize, reach: usize) {
        let (own, rest) = x[at..reach].split_at_mut(B);
        let mut factors = [0.0; B];
        let mut panel: [&[f64]; B] = [&[]; B];
        for k in 0..B {
            let column = &self.columns[(at + k) * self.n..][..reach];
            own[k] *= self.inverse[at + k];
            for i in k + 1..B {
                own[i] -= column[at + i] * own[k];
            }
            panel[k] = &column[at + B..];
            factors[k] = -own[k];
        }
        add_all(rest, &factors, &panel);
    }

    /// x := L⁻ᵀ·x on the eliminated rows; the others must be known.
    pub fn backward(&self, x: &mut [f64]) {
        let mut at = self.inverse.len();
        for &(len, reach) in self.panels.iter().rev() {
            at -= len;
            match len {
                1 => self.backward_panel::<1>(x, at, reach),
                2 => self.backward_panel::<2>(x, at, reach),
                3 => self.backward_panel::<3>(x, at, reach),
                4 => self.backward_panel::<4>(x, at, reach),
                _ => self.backward_panel::<5>(x, at, reach),
            }
        }
    }

    fn backward_panel<const B: usize>(&self, x: &mut [f64], at: usize, reach: usize) {
        let (own, rest) = x[at..reach].split_at_mut(B);
        let mut panel: [&[f64]; B] = [&[]; B];
        for k in 0..B {
            panel[k] = &self.columns[(at + k) * self.n + at + B..][..rest.len()];
        }
        for i in 0..rest.len() {
            for k in 0..B {
                own[k] -= panel[k][i] * rest[i];
            }
        }
        for k in (0..B).rev() {
            for i in k + 1..B {
                own[k] -= self.columns[(at + k) * self.n + at + i] * own[i];
            }
            own[k] *= self.inverse[at + k];
        }
    }
}

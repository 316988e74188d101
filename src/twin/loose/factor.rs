//! Cholesky factors: 6×6 of one body, and the fronts of S = G·M⁻¹·Gᵀ.
//!
//! The graph of the joints is a star: three limbs (bearing, two elbows) and the chain of axis 4 meet in the joints of
//! the platform. Each branch is a front whose inner rows are eliminated by themselves; what they leave on the platform's
//! rows is added to the last, dense front of 23 rows. No fill arises outside of the fronts.

/// Rows of one body's block or of a twist: velocity of the origin, angular velocity.
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

/// Pivot over diagonal below which a matrix counts as singular.
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

    /// Factor of the symmetric `m` (lower triangle by columns), `None` when it is not safely positive definite.
    pub fn new(m: &[Six; 6]) -> Option<Self> {
        let mut columns = *m;
        let mut inverse = [0.0; 6];
        for k in 0..6 {
            let pivot = columns[k][k];
            // Also catches NaN.
            if !(pivot > BODY_RANK * m[k][k]) {
                return None;
            }
            let scale = 1.0 / pivot.sqrt();
            inverse[k] = scale;
            for i in k..6 {
                columns[k][i] *= scale;
            }
            let column = columns[k];
            for j in k + 1..6 {
                for i in j..6 {
                    columns[j][i] -= column[j] * column[i];
                }
            }
        }
        Some(Self { columns, inverse })
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

/// A symmetric matrix of N rows, lower triangle by columns, whose first `P` rows are eliminated.
pub(super) struct Front<const N: usize, const P: usize> {
    pub columns: [[f64; N]; N],
    inverse: [f64; P],
    /// One past the last row that elimination of a column reaches.
    reach: [usize; P],
}

impl<const N: usize, const P: usize> Front<N, P> {
    pub fn new(reach: [usize; P]) -> Self {
        Self { columns: [[0.0; N]; N], inverse: [0.0; P], reach }
    }

    pub fn clear(&mut self) {
        self.columns = [[0.0; N]; N];
    }

    /// Adds `Y·Yᵀ` at row `at`; `y` are rows after the body's root.
    pub fn gram(&mut self, y: &[Six], at: usize) {
        for (j, yj) in y.iter().enumerate() {
            let column = &mut self.columns[at + j][at + j..at + y.len()];
            for (x, yi) in column.iter_mut().zip(&y[j..]) {
                *x += dot(yj, yi);
            }
        }
    }

    /// Adds `Y_i·Y_jᵀ` at row `i` and column `j`, for two joints of one body, i after j.
    pub fn cross(&mut self, yi: &[Six], i: usize, yj: &[Six], j: usize) {
        for (b, y) in yj.iter().enumerate() {
            for (a, x) in yi.iter().enumerate() {
                self.columns[j + b][i + a] += dot(x, y);
            }
        }
    }

    pub fn diagonal(&self) -> [f64; N] {
        std::array::from_fn(|k| self.columns[k][k])
    }

    /// Partial Cholesky factorisation; the trailing rows hold the Schur complement.
    ///
    /// False when a pivot vanishes against its `diagonal` entry in the whole matrix.
    pub fn eliminate(&mut self, diagonal: &[f64; N]) -> bool {
        for k in 0..P {
            let (done, rest) = self.columns.split_at_mut(k + 1);
            let reach = self.reach[k];
            let column = &mut done[k][..reach];
            let pivot = column[k];
            if !(pivot > ROW_RANK * diagonal[k]) {
                return false;
            }
            let scale = 1.0 / pivot.sqrt();
            self.inverse[k] = scale;
            for x in &mut column[k..] {
                *x *= scale;
            }
            for (j, target) in rest[..reach - k - 1].iter_mut().enumerate() {
                let tail = &column[k + 1 + j..];
                let factor = tail[0];
                for (x, y) in target[k + 1 + j..reach].iter_mut().zip(tail) {
                    *x -= factor * y;
                }
            }
        }
        true
    }

    /// x := L⁻¹·x on the eliminated rows, with what they leave on the others.
    pub fn forward(&self, x: &mut [f64; N]) {
        for k in 0..P {
            x[k] *= self.inverse[k];
            let (done, rest) = x.split_at_mut(k + 1);
            let last = self.reach[k];
            for (x, l) in rest.iter_mut().zip(&self.columns[k][k + 1..last]) {
                *x -= l * done[k];
            }
        }
    }

    /// x := L⁻ᵀ·x on the eliminated rows, the others known.
    pub fn backward(&self, x: &mut [f64; N]) {
        for k in (0..P).rev() {
            let last = self.reach[k];
            let sum: f64 = self.columns[k][k + 1..last].iter().zip(&x[k + 1..last]).map(|(l, x)| l * x).sum();
            x[k] = (x[k] - sum) * self.inverse[k];
        }
    }
}

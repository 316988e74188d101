//! Motion from a look-up table of times with platform poses or joint angles.
//!
//! The rows are interpolated by the quintic spline, whose derivatives up to the fourth are continuous. The two
//! conditions at either end are zero rate and acceleration, or rate and acceleration of the polynomial through the
//! nearest rows.

use std::path::PathBuf;

use nalgebra::{DMatrix, Matrix2, Matrix2x4, Vector4};

use super::polynomial::{Piecewise, quintic};

/// Rows of a look-up table.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// File it was read from.
    pub file: PathBuf,
    /// Whether the rows are joint angles (rad) instead of platform poses (m and rad).
    pub joints: bool,
    /// Times from the first row, s, increasing.
    pub t: Vec<f64>,
    /// (x, y, z, ψ) or (φ1, φ2, φ3, ψ).
    pub rows: Vec<[f64; 4]>,
    /// Whether the motion starts and ends with non-zero rate.
    pub moving: bool,
}

/// Number of rows from which rate and acceleration at the end of a moving table are computed.
const END_ROWS: usize = 6;

impl Table {
    /// Interpolated rows over time; a moving table continues beyond its end with the final rate.
    pub fn course(&self) -> Piecewise {
        let rows: Vec<Vector4<f64>> = self.rows.iter().map(|r| Vector4::from(*r)).collect();
        let n = self.t.len().min(rows.len()).saturating_sub(1);
        if n == 0 {
            return Piecewise::new(rows.first().copied().unwrap_or_default());
        }
        let ends = if self.moving {
            let m = END_ROWS.min(n + 1);
            let backwards: Vec<usize> = (0..m).map(|k| n - k).collect();
            [self.derivatives(&rows, &(0..m).collect::<Vec<_>>()), self.derivatives(&rows, &backwards)]
        } else {
            [Matrix2x4::zeros(); 2]
        };
        let steps: Vec<f64> = self.t[..=n].windows(2).map(|w| w[1] - w[0]).collect();
        let inner = spline(&steps, &rows, ends);
        let mut course = Piecewise::new(rows[0]);
        let state = |i: usize| [rows[i], inner[i].row(0).transpose(), inner[i].row(1).transpose()];
        for (i, step) in steps.iter().enumerate() {
            course.push(*step, quintic(*step, state(i), state(i + 1)));
        }
        if self.moving { course.drifting() } else { course }
    }

    /// Rate and acceleration, at the first of the rows `at`, of the polynomial through these rows.
    fn derivatives(&self, rows: &[Vector4<f64>], at: &[usize]) -> Matrix2x4<f64> {
        let t = |k: usize| self.t[at[k]] - self.t[at[0]];
        let unit = t(at.len() - 1);
        let powers = DMatrix::from_fn(at.len(), at.len(), |k, p| (t(k) / unit).powi(p as i32));
        let values = DMatrix::from_fn(at.len(), 4, |k, i| rows[at[k]][i]);
        let Some(c) = powers.lu().solve(&values) else { return Matrix2x4::zeros() };
        Matrix2x4::from_fn(|order, i| match order {
            0 => c[(1, i)] / unit,
            _ if at.len() > 2 => 2.0 * c[(2, i)] / unit.powi(2),
            _ => 0.0,
        })
    }
}

/// Rates and accelerations at all knots of the quintic spline through `rows`, for given ones at both ends.
///
/// Continuity of the third and fourth derivatives at each inner knot is a block-tridiagonal system.
fn spline(steps: &[f64], rows: &[Vector4<f64>], ends: [Matrix2x4<f64>; 2]) -> Vec<Matrix2x4<f64>> {
    let n = steps.len();
    // In units of the mean step all numbers are of order one.
    let unit = steps.iter().sum::<f64>() / n as f64;
    let to_units = Matrix2::new(unit, 0.0, 0.0, unit * unit);
    let mut out = vec![Matrix2x4::zeros(); n + 1];
    (out[0], out[n]) = (to_units * ends[0], to_units * ends[1]);
    let lower = |h: f64| Matrix2::new(-8.0 / h.powi(2), -1.0 / h, -14.0 / h.powi(3), -2.0 / h.powi(2));
    let upper = |h: f64| Matrix2::new(8.0 / h.powi(2), -1.0 / h, -14.0 / h.powi(3), 2.0 / h.powi(2));
    let mut eliminated: Vec<(Matrix2<f64>, Matrix2x4<f64>)> = Vec::with_capacity(n);
    for i in 1..n {
        let (l, r) = (steps[i - 1] / unit, steps[i] / unit);
        let (dl, dr) = ((rows[i] - rows[i - 1]).transpose(), (rows[i + 1] - rows[i]).transpose());
        let mut diagonal = Matrix2::new(
            12.0 / r.powi(2) - 12.0 / l.powi(2),
            3.0 / l + 3.0 / r,
            -16.0 / l.powi(3) - 16.0 / r.powi(3),
            3.0 / l.powi(2) - 3.0 / r.powi(2),
        );
        let mut right = Matrix2x4::from_rows(&[
            (dr / r.powi(3) - dl / l.powi(3)) * 20.0,
            (dr / r.powi(4) + dl / l.powi(4)) * -30.0,
        ]);
        match eliminated.last() {
            Some((u, y)) => {
                diagonal -= lower(l) * u;
                right -= lower(l) * y;
            }
            None => right -= lower(l) * out[0],
        }
        if i + 1 == n {
            right -= upper(r) * out[n];
        }
        let inverse = diagonal.try_inverse().unwrap_or_else(|| Matrix2::repeat(f64::NAN));
        eliminated.push((inverse * upper(r), inverse * right));
    }
    for i in (1..n).rev() {
        let (u, y) = eliminated[i - 1];
        out[i] = if i + 1 == n { y } else { y - u * out[i + 1] };
    }
    let from_units = Matrix2::new(1.0 / unit, 0.0, 0.0, 1.0 / unit.powi(2));
    out.iter().map(|d| from_units * d).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing;
    use super::*;

    fn sampled(f: impl Fn(f64) -> [f64; 4], times: &[f64], moving: bool) -> Table {
        let rows = times.iter().map(|t| f(*t)).collect();
        Table { file: "table.csv".into(), joints: false, t: times.to_vec(), rows, moving }
    }

    #[test]
    fn a_quintic_is_reproduced() {
        // In motion at both ends, with unequal steps.
        let f = |t: f64| [1.0 + t - t.powi(5), t * t, 0.3 * t.powi(4) - t.powi(3), 2.0 - t];
        let times = [0.0, 0.1, 0.25, 0.3, 0.5, 0.62, 0.8, 1.0];
        let course = sampled(f, &times, true).course();
        for k in 0..100 {
            let t = k as f64 / 100.0;
            let [p, v, a] = course.at(t);
            assert!((p - Vector4::from(f(t))).norm() < 1e-12, "{t}");
            assert!((v[0] - (1.0 - 5.0 * t.powi(4))).abs() < 1e-10 && (a[0] + 20.0 * t.powi(3)).abs() < 1e-8, "{t}");
        }
        let [p, v, _] = course.at(1.1);
        assert!((p[3] - 0.9).abs() < 1e-9 && (v[0] + 4.0).abs() < 1e-8);
    }

    #[test]
    fn rows_at_any_rate_converge_with_the_sixth_order() {
        let f = |t: f64| [0.1 * (1.0 - (std::f64::consts::TAU * t).cos()).powi(3), 0.0, 0.0, 0.0];
        let error = |n: usize| {
            let times: Vec<f64> = (0..=n).map(|k| k as f64 / n as f64).collect();
            let course = sampled(f, &times, false).course();
            testing::check(&course);
            (0..1000).map(|k| k as f64 / 1e3).map(|t| (course.at(t)[0][0] - f(t)[0]).abs()).fold(0.0, f64::max)
        };
        let order = (error(40) / error(80)).log2();
        assert!((5.5..7.0).contains(&order), "{order}");
    }

    proptest! {
        #[test]
        fn any_rows_are_joined_smoothly(
            rows in prop::collection::vec((0.02..0.5f64, [-1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64, -1.0..1.0f64]), 2..12),
            moving in any::<bool>(),
        ) {
            let mut t = 0.0;
            let times: Vec<f64> = rows.iter().enumerate().map(|(i, r)| { if i > 0 { t += r.0 } t }).collect();
            let table = Table {
                file: "table.csv".into(),
                joints: false,
                t: times.clone(),
                rows: rows.iter().map(|r| r.1).collect(),
                moving,
            };
            let course = table.course();
            testing::smooth(&course);
            for (t, row) in times.iter().zip(&table.rows) {
                prop_assert!((course.at(*t)[0] - Vector4::from(*row)).norm() < 1e-8);
            }
            if !moving {
                testing::check(&course);
            }
        }
    }
}

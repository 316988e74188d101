//! Solution of the six length rows by pairs of struts.

use nalgebra::{Matrix3, Vector3};

use super::super::SingularPose;
use super::blocks::Paired;
use crate::machine::SixStruts;

/// Factorisation of B_P, the platform part of the length rows, by sums and differences of each pair's rows.
///
/// The struts of a pair are nearly parallel, so that the sums (S_v S_w) determine the platform's velocity and the
/// differences (D_v D_w) mainly its rotation; two 3 × 3 inverses suffice.
pub(super) struct Pairs {
    s_v_inverse: Matrix3<f64>,
    s_w: Matrix3<f64>,
    d_v: Matrix3<f64>,
    /// S_v⁻¹ S_w
    turned: Matrix3<f64>,
    /// (D_w − D_v S_v⁻¹ S_w)⁻¹
    schur_inverse: Matrix3<f64>,
}

/// Inverse of the matrix with rows `a`, `b`, `c`; its columns are b × c, c × a and a × b over the determinant.
#[inline]
fn inverse_of_rows(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>) -> Option<Matrix3<f64>> {
    let first = b.cross(c);
    let determinant = a.dot(&first);
    if determinant == 0.0 {
        return None;
    }
    let scale = 1.0 / determinant;
    Some(Matrix3::from_columns(&[first * scale, c.cross(a) * scale, a.cross(b) * scale]))
}

/// Matrix with these rows.
#[inline]
fn of_rows(a: &Vector3<f64>, b: &Vector3<f64>, c: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z)
}

impl Pairs {
    pub fn new(rows: &SixStruts<Paired>) -> Result<Self, SingularPose> {
        let [a, b, c, d, e, f] = rows;
        let (sums, differences) = ([*a + *b, *c + *d, *e + *f], [*a - *b, *c - *d, *e - *f]);
        let s_v_inverse = inverse_of_rows(&sums[0].v, &sums[1].v, &sums[2].v).ok_or(SingularPose)?;
        let s_w = of_rows(&sums[0].w, &sums[1].w, &sums[2].w);
        let d_v = of_rows(&differences[0].v, &differences[1].v, &differences[2].v);
        let d_w = of_rows(&differences[0].w, &differences[1].w, &differences[2].w);
        let turned = s_v_inverse * s_w;
        let schur = (d_w - d_v * turned).transpose();
        let schur_inverse = inverse_of_rows(
            &schur.column(0).into_owned(),
            &schur.column(1).into_owned(),
            &schur.column(2).into_owned(),
        )
        .ok_or(SingularPose)?;
        Ok(Self { s_v_inverse, s_w, d_v, turned, schur_inverse })
    }

    /// x with B_P x = g.
    #[inline]
    pub fn solve(&self, g: &SixStruts<f64>) -> Paired {
        let sum = Vector3::new(g[0] + g[1], g[2] + g[3], g[4] + g[5]);
        let difference = Vector3::new(g[0] - g[1], g[2] - g[3], g[4] - g[5]);
        self.back(self.s_v_inverse * sum, difference)
    }

    /// x with B_P x = g, where g is zero except for `own` at the two struts of `pair`.
    #[inline]
    pub fn solve_pair(&self, pair: usize, own: [f64; 2]) -> Paired {
        let mut difference = Vector3::zeros();
        difference[pair] = own[0] - own[1];
        self.back(self.s_v_inverse.column(pair) * (own[0] + own[1]), difference)
    }

    /// The solution for `free`, the velocity without rotation, and the differences of the right side.
    #[inline]
    fn back(&self, free: Vector3<f64>, difference: Vector3<f64>) -> Paired {
        let w = self.schur_inverse * (difference - self.d_v * free);
        Paired { v: free - self.turned * w, w }
    }

    /// T with B_Pᵀ T = f.
    #[inline]
    pub fn solve_transposed(&self, f: &Paired) -> SixStruts<f64> {
        let free = self.s_v_inverse.tr_mul(&f.v);
        let difference = self.schur_inverse.tr_mul(&(f.w - self.s_w.tr_mul(&free)));
        let sum = free - self.s_v_inverse.tr_mul(&self.d_v.tr_mul(&difference));
        let (a, b) = (sum + difference, sum - difference);
        [a.x, b.x, a.y, b.y, a.z, b.z]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::{each, three_arms};

    fn residual(rows: &SixStruts<Paired>, x: &Paired, g: &SixStruts<f64>) -> f64 {
        rows.iter().zip(g).map(|(row, g)| (row.dot(x) - g).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn solutions_fulfil_their_rows() {
        let number = |k: usize| ((k * k) as f64 * 0.7).sin();
        let vector = |k: usize| Vector3::new(number(k), number(k + 1), number(k + 2));
        let rows: SixStruts<Paired> = std::array::from_fn(|s| Paired::new(vector(5 * s), vector(90 + 7 * s)));
        let pairs = Pairs::new(&rows).unwrap();
        let g = std::array::from_fn(|s| number(200 + s));
        assert!(residual(&rows, &pairs.solve(&g), &g) < 1e-12);
        for pair in three_arms() {
            let mut g: SixStruts<f64> = each(0.0);
            (g[2 * pair], g[2 * pair + 1]) = (0.7, -0.2);
            assert!(residual(&rows, &pairs.solve_pair(pair, [0.7, -0.2]), &g) < 1e-12);
        }
        let f = Paired::new(vector(300), vector(310));
        let forces = pairs.solve_transposed(&f);
        let sum = rows.iter().zip(forces).fold(Paired::ZERO, |sum, (row, t)| sum + *row * t) - f;
        assert!(sum.dot(&sum).sqrt() < 1e-12, "{sum:?}");
        assert!(Pairs::new(&each(rows[0])).is_err());
    }
}

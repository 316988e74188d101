//! Solution of the six length rows by pairs of struts.

use nalgebra::{Matrix3, Vector3};

use super::super::SingularPose;
use super::{Vector6, join};
use crate::machine::STRUTS;

/// Factorisation of B_P, the platform part of the length rows, by sums and differences of each pair's rows.
///
/// The struts of a pair are nearly parallel, so that the sums (S_v S_w) determine the platform's velocity and the
/// differences (D_v D_w) mainly its rotation; two 3 × 3 inverses suffice.
pub(super) struct Pairs {
    s_v_inverse: Matrix3<f64>,
    s_w: Matrix3<f64>,
    d_v: Matrix3<f64>,
    /// (D_w − D_v S_v⁻¹ S_w)⁻¹
    schur_inverse: Matrix3<f64>,
}

impl Pairs {
    pub fn new(rows: &[Vector6; STRUTS]) -> Result<Self, SingularPose> {
        let block =
            |sign: f64, at: usize| Matrix3::from_fn(|i, k| rows[2 * i][at + k] + sign * rows[2 * i + 1][at + k]);
        let (s_w, d_v, d_w) = (block(1.0, 3), block(-1.0, 0), block(-1.0, 3));
        let s_v_inverse = block(1.0, 0).try_inverse().ok_or(SingularPose)?;
        let schur_inverse = (d_w - d_v * s_v_inverse * s_w).try_inverse().ok_or(SingularPose)?;
        Ok(Self { s_v_inverse, s_w, d_v, schur_inverse })
    }

    /// x with B_P x = g.
    pub fn solve(&self, g: &Vector6) -> Vector6 {
        let sum = Vector3::from_fn(|i, _| g[2 * i] + g[2 * i + 1]);
        let difference = Vector3::from_fn(|i, _| g[2 * i] - g[2 * i + 1]);
        let free = self.s_v_inverse * sum;
        let w = self.schur_inverse * (difference - self.d_v * free);
        let v = free - self.s_v_inverse * (self.s_w * w);
        join(&v, &w)
    }

    /// T with B_Pᵀ T = f.
    pub fn solve_transposed(&self, f: &Vector6) -> Vector6 {
        let (f_v, f_w) = (f.fixed_rows::<3>(0).into_owned(), f.fixed_rows::<3>(3).into_owned());
        let free = self.s_v_inverse.tr_mul(&f_v);
        let difference = self.schur_inverse.tr_mul(&(f_w - self.s_w.tr_mul(&free)));
        let sum = free - self.s_v_inverse.tr_mul(&self.d_v.tr_mul(&difference));
        Vector6::from_fn(
            |s, _| if s % 2 == 0 { sum[s / 2] + difference[s / 2] } else { sum[s / 2] - difference[s / 2] },
        )
    }
}

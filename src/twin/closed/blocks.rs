//! Vectors and matrices over the platform's velocity and angular velocity, in blocks of three.

use std::ops::{Add, AddAssign, Mul, Sub};

use nalgebra::{Matrix3, SMatrix, Vector3};

/// Two vectors: of the velocity and of the angular velocity, or of the force and of the moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Paired {
    pub v: Vector3<f64>,
    pub w: Vector3<f64>,
}

impl Paired {
    pub const ZERO: Self = Self { v: Vector3::new(0.0, 0.0, 0.0), w: Vector3::new(0.0, 0.0, 0.0) };

    #[inline]
    pub fn new(v: Vector3<f64>, w: Vector3<f64>) -> Self {
        Self { v, w }
    }

    #[inline]
    pub fn dot(&self, other: &Self) -> f64 {
        self.v.dot(&other.v) + self.w.dot(&other.w)
    }

    /// All six numbers, the velocity first.
    pub fn to_vector(self) -> nalgebra::Vector6<f64> {
        nalgebra::Vector6::new(self.v.x, self.v.y, self.v.z, self.w.x, self.w.y, self.w.z)
    }
}

impl Add for Paired {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { v: self.v + other.v, w: self.w + other.w }
    }
}

impl AddAssign for Paired {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        self.v += other.v;
        self.w += other.w;
    }
}

impl Sub for Paired {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { v: self.v - other.v, w: self.w - other.w }
    }
}

impl Mul<f64> for Paired {
    type Output = Self;
    #[inline]
    fn mul(self, factor: f64) -> Self {
        Self { v: self.v * factor, w: self.w * factor }
    }
}

/// Symmetric matrix [vv, vw; vwᵀ, ww].
#[derive(Clone, Copy)]
pub(super) struct Symmetric {
    pub vv: Matrix3<f64>,
    pub vw: Matrix3<f64>,
    pub ww: Matrix3<f64>,
}

impl Symmetric {
    #[inline]
    pub fn times(&self, x: &Paired) -> Paired {
        Paired { v: self.vv * x.v + self.vw * x.w, w: self.vw.tr_mul(&x.v) + self.ww * x.w }
    }

    /// All 36 numbers.
    pub fn to_matrix(self) -> SMatrix<f64, 6, 6> {
        let mut out = SMatrix::<f64, 6, 6>::zeros();
        out.fixed_view_mut::<3, 3>(0, 0).copy_from(&self.vv);
        out.fixed_view_mut::<3, 3>(0, 3).copy_from(&self.vw);
        out.fixed_view_mut::<3, 3>(3, 0).copy_from(&self.vw.transpose());
        out.fixed_view_mut::<3, 3>(3, 3).copy_from(&self.ww);
        out
    }
}

/// a·bᵀ.
#[inline]
pub(super) fn outer(a: &Vector3<f64>, b: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::from_columns(&[a * b.x, a * b.y, a * b.z])
}

/// a·bᵀ + b·aᵀ.
#[inline]
pub(super) fn symmetric_outer(a: &Vector3<f64>, b: &Vector3<f64>) -> Matrix3<f64> {
    let half = outer(a, b);
    half + half.transpose()
}

/// a× m, the cross product with every column.
#[inline]
pub(super) fn cross_columns(a: &Vector3<f64>, m: &Matrix3<f64>) -> Matrix3<f64> {
    let column = |i: usize| a.cross(&m.column(i));
    Matrix3::from_columns(&[column(0), column(1), column(2)])
}

/// `tensor` in the axes of the frame in which that of the body is `rotation`: R·Θ·Rᵀ.
#[inline]
pub(super) fn turned(tensor: &Matrix3<f64>, rotation: &Matrix3<f64>) -> Matrix3<f64> {
    rotation * tensor * rotation.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_those_of_the_whole_matrix() {
        let number = |k: usize| ((k * k) as f64 * 0.7).sin();
        let m = Matrix3::from_fn(|i, j| number(3 * i + j));
        let symmetric = |m: &Matrix3<f64>| m + m.transpose();
        let mass = Symmetric { vv: symmetric(&m), vw: m * m, ww: symmetric(&(m * m * m)) };
        let (a, b) = (Vector3::from_fn(|i, _| number(i + 20)), Vector3::from_fn(|i, _| number(i + 30)));
        let x = Paired::new(a, b);
        approx::assert_relative_eq!(mass.times(&x).to_vector(), mass.to_matrix() * x.to_vector(), epsilon = 1e-14);
        approx::assert_relative_eq!(
            x.dot(&mass.times(&x)),
            x.to_vector().dot(&(mass.to_matrix() * x.to_vector())),
            epsilon = 1e-14
        );
        approx::assert_relative_eq!(symmetric_outer(&a, &b), a * b.transpose() + b * a.transpose(), epsilon = 1e-15);
        approx::assert_relative_eq!(cross_columns(&a, &m), a.cross_matrix() * m, epsilon = 1e-15);
    }
}

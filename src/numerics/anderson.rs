//! Anderson acceleration of fixed-point iterations.

use nalgebra::SVector;

/// Number of earlier steps that are remembered.
const MEMORY: usize = 6;

/// Accelerated iteration to the fixed point of a contraction g in `N` dimensions.
///
/// With the residual f(x) = g(x) − x, the next point is g(x) − ΔG γ with γ = argmin |f(x) − ΔF γ| over the differences of
/// the last steps [Walker & Ni 2011: Anderson acceleration for fixed-point iterations, SIAM J. Numer. Anal. 49(4)]. For an
/// affine g this is GMRES: exact after at most `N` steps. The columns of ΔF are kept orthonormal by Gram and Schmidt, and
/// those of ΔG undergo the same operations.
pub struct Anderson<const N: usize> {
    /// Orthonormal combinations of differences of residuals, with the same combinations of values of g.
    pairs: [(SVector<f64, N>, SVector<f64, N>); MEMORY],
    count: usize,
    last: Option<(SVector<f64, N>, SVector<f64, N>)>,
}

impl<const N: usize> Default for Anderson<N> {
    fn default() -> Self {
        Self { pairs: [(SVector::zeros(), SVector::zeros()); MEMORY], count: 0, last: None }
    }
}

impl<const N: usize> Anderson<N> {
    /// The point after `x`, at which g has the value `g`. After a step that has increased the residual it is `g`, and the
    /// iteration begins anew: at a kink of g earlier differences mislead.
    pub fn next(&mut self, x: &SVector<f64, N>, g: &SVector<f64, N>) -> SVector<f64, N> {
        let f = g - x;
        if let Some((before, value)) = self.last.replace((f, *g)) {
            if f.norm() > before.norm() {
                self.count = 0;
                return *g;
            }
            self.remember(f - before, g - value);
        }
        self.pairs[..self.count].iter().fold(*g, |next, (q, p)| next - p * q.dot(&f))
    }

    fn remember(&mut self, df: SVector<f64, N>, dg: SVector<f64, N>) {
        if self.count == MEMORY {
            self.pairs.rotate_left(1);
            self.count -= 1;
        }
        let (mut q, mut p) = (df, dg);
        for (earlier, value) in &self.pairs[..self.count] {
            let share = earlier.dot(&q);
            q -= earlier * share;
            p -= value * share;
        }
        // A difference that the earlier ones contain is newer than they are.
        if q.norm() < 1e-3 * df.norm() {
            (self.count, q, p) = (0, df, dg);
        }
        let size = q.norm();
        if size > 0.0 {
            self.pairs[self.count] = (q / size, p / size);
            self.count += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{SMatrix, Vector4};

    /// x = A·x + b with a spectral radius of 0.9: exact after five evaluations in four dimensions, where plain iteration
    /// needs 260.
    #[test]
    fn an_affine_map_is_solved_in_as_many_steps_as_it_has_dimensions() {
        let a = SMatrix::<f64, 4, 4>::from_row_slice(&[
            0.9, 0.1, 0.0, 0.2, 0.0, -0.5, 0.3, 0.0, 0.0, 0.0, 0.4, 0.1, 0.0, 0.0, 0.0, -0.7,
        ]);
        let b = Vector4::new(1.0, -2.0, 3.0, 0.5);
        let exact = (SMatrix::identity() - a).lu().solve(&b).unwrap();
        let mut anderson = Anderson::default();
        let mut x = Vector4::zeros();
        for _ in 0..5 {
            x = anderson.next(&x, &(a * x + b));
        }
        assert!((x - exact).norm() < 1e-10 * exact.norm(), "{}", (x - exact).norm());
    }

    /// x = 2 − |x|/2 at 4/3, from the other side of the kink.
    #[test]
    fn a_kink_does_not_mislead() {
        let mut anderson = Anderson::<1>::default();
        let mut x = SVector::from([-3.0]);
        for _ in 0..8 {
            x = anderson.next(&x, &SVector::from([2.0 - 0.5 * f64::abs(x[0])]));
        }
        assert!((x[0] - 4.0 / 3.0).abs() < 1e-12, "{}", x[0]);
    }

    /// cos x = x at 0.739085133215160642 (the Dottie number): seven evaluations, where plain iteration needs 60.
    #[test]
    fn a_nonlinear_map_converges_as_the_secant_method() {
        let mut anderson = Anderson::<1>::default();
        let mut x = SVector::from([1.0]);
        for _ in 0..7 {
            x = anderson.next(&x, &SVector::from([x[0].cos()]));
        }
        assert!((x[0] - 0.739_085_133_215_160_6).abs() < 1e-12, "{}", x[0]);
    }
}

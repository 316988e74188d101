//! Anderson acceleration of fixed-point iterations.

use nalgebra::SVector;

/// Number of previous iterations that are remembered: the rank of two inertia-like laws in two directions.
const DEPTH: usize = 4;
/// Change relative to its part along other changes below which it is dependent on them.
const DEPENDENT: f64 = 1e-6;

/// Anderson acceleration of a fixed-point iteration x ← G(x) in `N` dimensions ([Anderson 1965]).
///
/// For an affine G of low rank, such as laws that depend on accelerations like an additional mass, the iteration ends
/// after one step more than the rank, even where x ← G(x) diverges.
pub struct Anderson<const N: usize> {
    /// G(x) − x and G(x) of previous iterations, the newest last.
    past: [(SVector<f64, N>, SVector<f64, N>); DEPTH],
    count: usize,
}

impl<const N: usize> Default for Anderson<N> {
    fn default() -> Self {
        Self { past: [(SVector::zeros(), SVector::zeros()); DEPTH], count: 0 }
    }
}

impl<const N: usize> Anderson<N> {
    /// Next x: the combination of all known G(x) whose combination of G(x) − x is smallest, by modified Gram–Schmidt.
    pub fn next(&mut self, x: &SVector<f64, N>, image: &SVector<f64, N>) -> SVector<f64, N> {
        let (own, mut best) = (image - x, *image);
        let mut left = own;
        let mut basis = [(SVector::<f64, N>::zeros(), SVector::<f64, N>::zeros()); DEPTH];
        let mut known = 0;
        for (gap, other) in self.past[..self.count].iter().rev() {
            let (mut change, mut moved) = (own - gap, image - other);
            let size = change.norm();
            for (direction, along) in &basis[..known] {
                let share = change.dot(direction);
                change -= direction * share;
                moved -= along * share;
            }
            let norm = change.norm();
            if norm <= DEPENDENT * size {
                continue;
            }
            let (direction, along) = (change / norm, moved / norm);
            let share = left.dot(&direction);
            left -= direction * share;
            best -= along * share;
            basis[known] = (direction, along);
            known += 1;
        }
        if self.count == DEPTH {
            self.past.rotate_left(1);
        } else {
            self.count += 1;
        }
        self.past[self.count - 1] = (own, *image);
        best
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

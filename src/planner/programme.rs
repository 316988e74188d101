//! A conic programme assembled row by row, solved by Clarabel.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolution, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};

/// Largest number of iterations of the interior-point solver.
const MAX_ITERATIONS: u32 = 100;

/// Rows b − A x ∈ K: equalities first, then inequalities, then second-order cones of dimension three.
#[derive(Default)]
pub(super) struct Programme {
    rows: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
    right: Vec<f64>,
}

impl Programme {
    /// Number of rows so far.
    pub(super) fn len(&self) -> usize {
        self.right.len()
    }

    /// Adds Σ terms ≤ right, or Σ terms = right among the equalities; a term is (column, value).
    pub(super) fn row(&mut self, terms: &[(usize, f64)], right: f64) {
        let row = self.right.len();
        for &(column, value) in terms {
            self.rows.push(row);
            self.columns.push(column);
            self.values.push(value);
        }
        self.right.push(right);
    }

    /// Adds Σ terms ≤ 0, every term divided by `unit`.
    pub(super) fn scaled_row(&mut self, terms: &[(usize, f64)], unit: f64) {
        let terms: Vec<_> = terms.iter().map(|(column, value)| (*column, value / unit)).collect();
        self.row(&terms, 0.0);
    }

    /// Adds x² ≤ y with y = Σ terms: (y + 1, y − 1, 2x) in the cone.
    pub(super) fn square(&mut self, terms: &[(usize, f64)], x: usize) {
        let negative: Vec<_> = terms.iter().map(|(column, value)| (*column, -value)).collect();
        self.row(&negative, 1.0);
        self.row(&negative, -1.0);
        self.row(&[(x, -2.0)], 0.0);
    }

    /// Adds x y ≥ 1: (x + y, x − y, 2) in the cone.
    pub(super) fn product(&mut self, x: usize, y: usize) {
        self.row(&[(x, -1.0), (y, -1.0)], 0.0);
        self.row(&[(x, -1.0), (y, 1.0)], 0.0);
        self.row(&[], 2.0);
    }

    /// Minimiser of `cost`ᵀx and the dual bound on its value; `None` if the solver finds none.
    ///
    /// The first `equalities` rows are equalities, those up to `bounded` inequalities, the rest cones.
    pub(super) fn solve(self, cost: &[f64], equalities: usize, bounded: usize) -> Option<DefaultSolution<f64>> {
        let mut cones =
            vec![SupportedConeT::ZeroConeT(equalities), SupportedConeT::NonnegativeConeT(bounded - equalities)];
        cones.extend((0..(self.len() - bounded) / 3).map(|_| SupportedConeT::SecondOrderConeT(3)));
        let columns = cost.len();
        let matrix = CscMatrix::new_from_triplets(self.right.len(), columns, self.rows, self.columns, self.values);
        let settings = DefaultSettingsBuilder::default().verbose(false).max_iter(MAX_ITERATIONS).build().ok()?;
        let quadratic = CscMatrix::zeros((columns, columns));
        let mut solver = DefaultSolver::new(&quadratic, cost, &matrix, &self.right, &cones, settings).ok()?;
        solver.solve();
        let solved = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        solved.then_some(solver.solution)
    }
}

/// Factor that scales the absolute sum of `cost` to one; `cost` is multiplied by it.
pub(super) fn normalise(cost: &mut [f64]) -> f64 {
    let scale = 1.0 / cost.iter().map(|c| c.abs()).sum::<f64>();
    cost.iter_mut().for_each(|c| *c *= scale);
    scale
}

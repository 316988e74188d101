//! Physically consistent bodies of least cost as a second-order cone programme.
//!
//! An arrow matrix is positive semidefinite exactly if D ≥ 0 and there are t with tₖDₖ ≥ hₖ² and Σtₖ ≤ m: rotated
//! second-order cones instead of a semidefinite one. Bodies with deviation moments have no such form and are left to
//! `barrier`.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use nalgebra::{DMatrix, DVector};

use super::Cost;
use super::barrier;
use super::class::{Arrow, BodyClass, First, Shape, Source};
use super::log_cholesky::possible;

/// Solution with its optimality certificate.
#[derive(Clone, Debug)]
pub struct Certified {
    /// Parameters of least cost.
    pub x: DVector<f64>,
    /// Difference of the cost of `x` and the lower bound of the dual solution, in units of the cost.
    pub gap: f64,
    /// Iterations of the solver, or Newton steps of the barrier.
    pub iterations: usize,
}

/// Physically consistent parameters of least cost; `None` if the solver finds no solution.
pub fn minimise(cost: &Cost) -> Option<Certified> {
    if cost.classes.iter().any(|c| matches!(c.shape, Shape::Full(_))) {
        return barrier::minimise(cost);
    }
    let n = cost.centre.len();
    let mut problem = Cones { variables: n, linear: Vec::new(), second_order: Vec::new() };
    for class in &cost.classes {
        if let Shape::Arrow(arrow) = &class.shape {
            problem.body(class, arrow, &cost.size);
        }
    }
    for i in cost.free_of_bodies() {
        problem.within(i, cost.size[i], cost.range[i]);
    }
    let total = problem.variables;
    // Variables are the parameters in units of their own size, followed by the tₖ.
    let scaled = DMatrix::from_fn(n, n, |i, j| cost.curvature[(i, j)] * cost.size[i] * cost.size[j]);
    let unit = scaled.diagonal().amax();
    let centre = cost.centre.component_div(&cost.size);
    let mut q = vec![0.0; total];
    q[..n].copy_from_slice((&scaled * &centre / -unit).as_slice());
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for j in 0..n {
        for i in 0..=j {
            rows.push(i);
            columns.push(j);
            values.push(scaled[(i, j)] / unit);
        }
    }
    let quadratic = CscMatrix::new_from_triplets(total, total, rows, columns, values);
    let (a, b, cones) = problem.finish();
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .max_iter(500)
        .tol_gap_abs(1e-13)
        .tol_gap_rel(1e-13)
        .tol_feas(1e-12)
        .build()
        .ok()?;
    let mut solver = DefaultSolver::new(&quadratic, &q, &a, &b, &cones, settings).ok()?;
    solver.solve();
    let s = &solver.solution;
    let usable =
        matches!(s.status, SolverStatus::Solved | SolverStatus::AlmostSolved | SolverStatus::InsufficientProgress);
    let gap = unit * (s.obj_val - s.obj_val_dual).abs();
    // The solver may violate a bound by its tolerance.
    usable.then(|| Certified {
        x: possible(cost, &DVector::from_fn(n, |i, _| s.x[i] * cost.size[i])),
        gap,
        iterations: s.iterations as usize,
    })
}

/// Affine expression in the variables.
#[derive(Clone, Default)]
struct Affine {
    constant: f64,
    terms: Vec<(usize, f64)>,
}

impl Affine {
    fn constant(constant: f64) -> Self {
        Self { constant, terms: Vec::new() }
    }

    fn variable(i: usize, factor: f64) -> Self {
        Self { constant: 0.0, terms: vec![(i, factor)] }
    }

    fn is_zero(&self) -> bool {
        self.constant == 0.0 && self.terms.iter().all(|(_, f)| *f == 0.0)
    }

    fn sum(parts: &[(f64, &Affine)]) -> Self {
        let mut out = Self::default();
        for (factor, part) in parts {
            out.constant += factor * part.constant;
            out.terms.extend(part.terms.iter().map(|(v, x)| (*v, factor * x)));
        }
        out
    }
}

/// Expressions that must be non-negative or lie in a second-order cone.
struct Cones {
    variables: usize,
    linear: Vec<Affine>,
    second_order: Vec<[Affine; 3]>,
}

impl Cones {
    /// Restricts variable `i`, in units of `size`, to a range.
    fn within(&mut self, i: usize, size: f64, (low, high): (f64, f64)) {
        self.linear.push(Affine { constant: -low / size, terms: vec![(i, 1.0)] });
        self.linear.push(Affine { constant: high / size, terms: vec![(i, -1.0)] });
    }

    /// Restricts a body to consistent ones, with all entries in units of its reference.
    fn body(&mut self, class: &BodyClass, arrow: &Arrow, size: &DVector<f64>) {
        let (second, mass) = (class.reference.second, class.reference.mass);
        let first = (second * mass).sqrt();
        let sizes: Vec<Affine> = arrow
            .sizes
            .iter()
            .map(|terms| Affine {
                constant: 0.0,
                terms: terms.iter().map(|(i, f)| (*i, f * size[*i] / second)).collect(),
            })
            .collect();
        for s in &sizes {
            self.linear.push(Affine::sum(&[(1.0, s), (-1.0, &Affine::constant(super::MARGIN))]));
        }
        let m = Affine::variable(arrow.mass, size[arrow.mass] / mass);
        let mut rest = Affine::sum(&[(1.0, &m), (-1.0, &Affine::constant(super::MARGIN))]);
        for k in 0..3 {
            let (source, share) = arrow.second[k];
            let d = match source {
                Source::Size(g) => Affine::sum(&[(share, &sizes[g])]),
                Source::Mass => Affine::sum(&[(share * mass / second, &m)]),
                Source::Constant => Affine::constant(share / second),
            };
            let h = match arrow.first[k] {
                First::Own(i) => Affine::variable(i, size[i] / first),
                First::Mass(arm) => Affine::sum(&[(arm * mass / first, &m)]),
                First::Constant(h) => Affine::constant(h / first),
            };
            if h.is_zero() {
                continue;
            }
            let share = Affine::variable(self.variables, 1.0);
            self.variables += 1;
            self.second_order.push([
                Affine::sum(&[(1.0, &d), (1.0, &share)]),
                Affine::sum(&[(1.0, &d), (-1.0, &share)]),
                Affine::sum(&[(2.0, &h)]),
            ]);
            rest = Affine::sum(&[(1.0, &rest), (-1.0, &share)]);
        }
        self.linear.push(rest);
    }

    /// Constraint matrix, right-hand side and cones in the form b − A·x ∈ K.
    fn finish(self) -> (CscMatrix<f64>, Vec<f64>, Vec<SupportedConeT<f64>>) {
        let cones = std::iter::once(SupportedConeT::NonnegativeConeT(self.linear.len()))
            .chain(self.second_order.iter().map(|_| SupportedConeT::SecondOrderConeT(3)))
            .collect();
        let (mut rows, mut columns, mut values, mut b) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (row, expression) in self.linear.iter().chain(self.second_order.iter().flatten()).enumerate() {
            for (variable, factor) in &expression.terms {
                rows.push(row);
                columns.push(*variable);
                values.push(-factor);
            }
            b.push(expression.constant);
        }
        (CscMatrix::new_from_triplets(b.len(), self.variables, rows, columns, values), b, cones)
    }
}

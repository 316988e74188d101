//! Physical consistency: the possible bodies nearest to an estimate, as a second-order cone programme.
//!
//! Without deviation moments the pseudo-inertia is an arrow matrix [[D, h], [hᵀ, m]], D = ½tr(Θ)·1 − Θ, and it is
//! positive semidefinite exactly if D ≥ 0 and there are t with tᵢDᵢ ≥ hᵢ² and Σtᵢ ≤ m. The step is weighed by the
//! information of the data, so the fit is given up only where the data are silent.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use nalgebra::{DMatrix, DVector};

use crate::effects::ActiveEffect;
use crate::model::Bodies;
use crate::model::bodies::{BODIES, Inertia};
use crate::recording::Payload;

/// Distance kept from the boundary of the possible, relative to the mass and to the largest moment of the body.
const MARGIN: f64 = 1e-6;

/// Weight of staying near the prior in directions the data do not determine, per own size of a parameter squared.
const PRIOR: f64 = 1e-3;

/// Smallest pseudo-inertia eigenvalue over all bodies that have any inertia.
pub fn min_eigenvalue(bodies: &Bodies) -> f64 {
    bodies.0.iter().filter(|b| **b != Inertia::ZERO).map(Inertia::min_eigenvalue).fold(f64::INFINITY, f64::min)
}

/// Parameters nearest to `estimate` for which all bodies are possible.
///
/// The first entries are those of `links`, the inertia of `bodies` as an effect; `information` is YᵀWY of all entries,
/// `scale` their own sizes, `prior` what they were before the data, `ranges` what the effects' parameters, those after the
/// links', may be. `None` if the solver finds no solution.
pub fn nearest_consistent(
    bodies: &Bodies,
    links: &ActiveEffect,
    estimate: &DVector<f64>,
    prior: &DVector<f64>,
    scale: &DVector<f64>,
    information: &DMatrix<f64>,
    ranges: &[(f64, f64)],
) -> Option<DVector<f64>> {
    let n = estimate.len();
    let mut problem = Cones::new(bodies, links, scale, n);
    for i in links.values.len()..n {
        problem.within(i, scale[i], ranges[i]);
    }
    let total = problem.variables;
    // Variables are parameters in units of their own size, then the tᵢ.
    let mut p = DMatrix::<f64>::zeros(total, total);
    let mut q = vec![0.0; total];
    let size = (0..n).map(|i| information[(i, i)] * scale[i] * scale[i]).fold(1.0, f64::max);
    for i in 0..n {
        for j in 0..n {
            p[(i, j)] = information[(i, j)] * scale[i] * scale[j] / size;
        }
    }
    for i in 0..n {
        q[i] = -(0..n).map(|j| p[(i, j)] * estimate[j] / scale[j]).sum::<f64>();
    }
    for i in 0..n {
        let weight = PRIOR / size;
        p[(i, i)] += weight;
        q[i] -= weight * prior[i] / scale[i];
    }
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    for j in 0..total {
        for i in 0..=j {
            if p[(i, j)] != 0.0 {
                rows.push(i);
                columns.push(j);
                values.push(p[(i, j)]);
            }
        }
    }
    let quadratic = CscMatrix::new_from_triplets(total, total, rows, columns, values);
    let (a, b, cones) = problem.finish();
    let settings = DefaultSettingsBuilder::default().verbose(false).max_iter(200).build().ok()?;
    let mut solver = DefaultSolver::new(&quadratic, &q, &a, &b, &cones, settings).ok()?;
    solver.solve();
    let usable = matches!(
        solver.solution.status,
        SolverStatus::Solved | SolverStatus::AlmostSolved | SolverStatus::InsufficientProgress
    );
    // The solver stays on either side of a bound by its tolerance.
    let value = |i: usize| {
        let v = solver.solution.x[i] * scale[i];
        if i < links.values.len() { v } else { v.clamp(ranges[i].0, ranges[i].1) }
    };
    usable.then(|| DVector::from_fn(n, |i, _| value(i)))
}

/// Affine expression in the variables.
#[derive(Clone, Default)]
struct Affine {
    constant: f64,
    terms: Vec<(usize, f64)>,
}

impl Affine {
    fn is_zero(&self) -> bool {
        self.constant == 0.0 && self.terms.is_empty()
    }

    fn combine(parts: &[(f64, &Affine)]) -> Self {
        let mut out = Self::default();
        for (factor, part) in parts {
            out.constant += factor * part.constant;
            out.terms.extend(part.terms.iter().map(|(v, x)| (*v, factor * x)));
        }
        out
    }
}

/// Linear and second-order cone rows, `expression ∈ K`.
struct Cones {
    variables: usize,
    linear: Vec<Affine>,
    second_order: Vec<[Affine; 3]>,
}

impl Cones {
    fn new(bodies: &Bodies, links: &ActiveEffect, scale: &DVector<f64>, parameters: usize) -> Self {
        let mut out = Self { variables: parameters, linear: Vec::new(), second_order: Vec::new() };
        let mut known: Vec<(Vec<usize>, Inertia)> = Vec::new();
        for body in 0..BODIES {
            let units = units(links, body);
            let own = (units.iter().map(|u| u.0).collect(), bodies[body]);
            // Of limbs alike one stands for all.
            if !units.is_empty() && !known.contains(&own) {
                out.body(&pseudo_inertia(&bodies[body], links, &units, scale), bodies[body].pseudo_inertia().amax());
                known.push(own);
            }
        }
        out
    }

    /// Keeps variable `i`, in units of `scale`, within a range.
    fn within(&mut self, i: usize, scale: f64, (low, high): (f64, f64)) {
        self.linear.push(Affine { constant: -low / scale, terms: vec![(i, 1.0)] });
        self.linear.push(Affine { constant: high / scale, terms: vec![(i, -1.0)] });
    }

    fn body(&mut self, (second, first, mass): &([Affine; 3], [Affine; 3], Affine), size: f64) {
        let mut shares = Affine { constant: -MARGIN * mass.constant.abs().max(MARGIN), terms: Vec::new() };
        for k in 0..3 {
            let margin = Affine { constant: MARGIN * 1e-3 * size, terms: Vec::new() };
            let d = Affine::combine(&[(1.0, &second[k]), (-1.0, &margin)]);
            if first[k].is_zero() {
                self.linear.push(d);
                continue;
            }
            let share = Affine { constant: 0.0, terms: vec![(self.variables, 1.0)] };
            self.variables += 1;
            self.second_order.push([
                Affine::combine(&[(1.0, &d), (1.0, &share)]),
                Affine::combine(&[(1.0, &d), (-1.0, &share)]),
                Affine::combine(&[(2.0, &first[k])]),
            ]);
            shares = Affine::combine(&[(1.0, &shares), (-1.0, &share)]);
        }
        self.linear.push(Affine::combine(&[(1.0 - MARGIN, mass), (1.0, &shares)]));
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

/// Parameters of a body with their unit inertias.
fn units(links: &ActiveEffect, body: usize) -> Vec<(usize, Inertia)> {
    let mut units: Vec<(usize, Inertia)> = Vec::new();
    links.effect.inertia(&links.values(), &Payload::default(), &mut |k, b, unit| {
        if b == body {
            units.push((k, unit));
        }
    });
    units
}

/// Diagonal of D, first moment and mass of a body as affine expressions of the scaled parameters.
fn pseudo_inertia(
    body: &Inertia,
    links: &ActiveEffect,
    units: &[(usize, Inertia)],
    scale: &DVector<f64>,
) -> ([Affine; 3], [Affine; 3], Affine) {
    let read = |i: &Inertia| {
        let j = i.pseudo_inertia();
        ([j[(0, 0)], j[(1, 1)], j[(2, 2)]], [j[(0, 3)], j[(1, 3)], j[(2, 3)]], j[(3, 3)])
    };
    let mut rest = *body;
    for (k, unit) in units {
        rest += *unit * -links.values[*k];
    }
    let (d, h, m) = read(&rest);
    let affine =
        |constant: f64| Affine { constant: if constant.abs() < 1e-15 { 0.0 } else { constant }, terms: vec![] };
    let mut second = d.map(affine);
    let mut first = h.map(affine);
    let mut mass = affine(m);
    for (k, unit) in units {
        let (d, h, m) = read(unit);
        let add = |to: &mut Affine, factor: f64| {
            if factor != 0.0 {
                to.terms.push((*k, factor * scale[*k]));
            }
        };
        for axis in 0..3 {
            add(&mut second[axis], d[axis]);
            add(&mut first[axis], h[axis]);
        }
        add(&mut mass, m);
    }
    (second, first, mass)
}

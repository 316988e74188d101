//! Physically consistent bodies of least cost with deviation moments: a convex programme over J(x) ⪰ 0, by a barrier
//! method.
//!
//! Newton's method on cost/t − Σ ln det J(x) − Σ ln(distance to the ends of a range). At its minimum the cost exceeds
//! the least one by at most ν·t, where ν is the number of rows of all J plus that of all ends
//! [Boyd 2004], section 11.2.2: a certificate independent of log-Cholesky variables.

use nalgebra::{DMatrix, DVector, Matrix4};

use super::cones::Certified;
use super::log_cholesky::possible;
use super::{BodyClass, Cost};

/// Physically consistent parameters of least cost; `None` if Newton's method fails.
pub fn minimise(cost: &Cost) -> Option<Certified> {
    let pencils: Vec<Pencil> = cost.classes.iter().map(|c| Pencil::new(c, cost.centre.len())).collect();
    let ends: Vec<(usize, f64, f64)> = cost
        .free_of_bodies()
        .flat_map(|i| [(i, 1.0, cost.range[i].0), (i, -1.0, -cost.range[i].1)])
        .filter(|(_, _, end)| end.is_finite())
        .collect();
    let problem = Barrier { cost, pencils, ends };
    let nu = problem.parameter();
    let mut x = problem.inside(possible(cost, &cost.start));
    let mut t = cost.of(&x).max(f64::MIN_POSITIVE);
    let mut iterations = 0;
    loop {
        x = problem.centred(x, t, &mut iterations)?;
        if nu * t <= ACCURACY * cost.of(&x) || t < MIN_WEIGHT {
            break;
        }
        t *= REDUCTION;
    }
    let bound = cost.of(&x) - nu * t;
    let x = possible(cost, &x);
    let gap = cost.of(&x) - bound;
    Some(Certified { x, gap, iterations })
}

/// Relative gap of the cost at which the search ends.
const ACCURACY: f64 = 1e-8;
const REDUCTION: f64 = 0.1;
/// Weight of the barrier below which the cost counts as zero.
const MIN_WEIGHT: f64 = 1e-12;
const MAX_STEPS: usize = 100;

struct Barrier<'a> {
    cost: &'a Cost,
    pencils: Vec<Pencil>,
    /// Variable, sign and end of a range: sign·x > end.
    ends: Vec<(usize, f64, f64)>,
}

impl Barrier<'_> {
    /// Parameter ν of the barrier.
    fn parameter(&self) -> f64 {
        (4 * self.pencils.len() + self.ends.len()) as f64
    }

    /// The point, moved off the ends of the ranges.
    fn inside(&self, mut x: DVector<f64>) -> DVector<f64> {
        for &(i, sign, end) in &self.ends {
            let least = end + 1e-6 * self.cost.size[i];
            x[i] = sign * (sign * x[i]).max(least);
        }
        x
    }

    /// Value of the barrier; infinite outside its domain.
    fn value(&self, x: &DVector<f64>) -> f64 {
        let bodies: f64 = self.pencils.iter().map(|p| p.log_det(x).map_or(f64::INFINITY, |d| -d)).sum();
        let ends = self.ends.iter().map(|&(i, sign, end)| {
            let rest = sign * x[i] - end;
            if rest > 0.0 { -rest.ln() } else { f64::INFINITY }
        });
        bodies + ends.sum::<f64>()
    }

    /// Minimiser of cost/t + barrier, started at `x`; counts its steps in `iterations`.
    fn centred(&self, mut x: DVector<f64>, t: f64, iterations: &mut usize) -> Option<DVector<f64>> {
        for _ in 0..MAX_STEPS {
            *iterations += 1;
            let mut gradient = &self.cost.curvature * (&x - &self.cost.centre) / t;
            let mut hessian = &self.cost.curvature / t;
            self.pencils.iter().for_each(|p| p.add(&x, &mut gradient, &mut hessian));
            for &(i, sign, end) in &self.ends {
                let rest = sign * x[i] - end;
                gradient[i] -= sign / rest;
                hessian[(i, i)] += 1.0 / (rest * rest);
            }
            let step = newton(&hessian, &gradient)?;
            let decrement = gradient.dot(&step);
            if decrement.is_nan() {
                return None;
            }
            if decrement < 1e-10 {
                return Some(x);
            }
            let value = |x: &DVector<f64>| self.cost.of(x) / t + self.value(x);
            let (before, mut length) = (value(&x), 1.0);
            loop {
                let next = &x - &step * length;
                if value(&next) <= before - 0.1 * length * decrement {
                    x = next;
                    break;
                }
                length *= 0.5;
                if length < 1e-12 {
                    // Centred up to rounding.
                    return Some(x);
                }
            }
        }
        Some(x)
    }
}

/// H⁻¹·g with the variables scaled by their own curvature; damped if rounding makes H indefinite.
fn newton(hessian: &DMatrix<f64>, gradient: &DVector<f64>) -> Option<DVector<f64>> {
    let scale = hessian.diagonal().map(|h| 1.0 / h.sqrt());
    let n = scale.len();
    let damped = |damping: f64| {
        let entry = |i, j| hessian[(i, j)] * scale[i] * scale[j] + if i == j { damping } else { 0.0 };
        DMatrix::from_fn(n, n, entry).cholesky()
    };
    let factor = [0.0, 1e-14, 1e-12, 1e-10, 1e-8].into_iter().find_map(damped)?;
    Some(factor.solve(&gradient.component_mul(&scale)).component_mul(&scale))
}

/// Pseudo-inertia of a class of bodies, J₀ + Σ xᵢJᵢ.
struct Pencil {
    constant: Matrix4<f64>,
    terms: Vec<(usize, Matrix4<f64>)>,
}

impl Pencil {
    fn new(class: &BodyClass, variables: usize) -> Self {
        let mut x = DVector::zeros(variables);
        let constant = class.inertia(&x).pseudo_inertia();
        let mut term = |v: usize| {
            x[v] = 1.0;
            let own = class.inertia(&x).pseudo_inertia() - constant;
            x[v] = 0.0;
            (v, own)
        };
        let terms = class.variables().into_iter().map(&mut term).collect();
        Self { constant, terms }
    }

    fn at(&self, x: &DVector<f64>) -> Matrix4<f64> {
        self.terms.iter().fold(self.constant, |sum, (v, own)| sum + own * x[*v])
    }

    fn log_det(&self, x: &DVector<f64>) -> Option<f64> {
        let factor = self.at(x).cholesky()?;
        let own = 2.0 * factor.l_dirty().diagonal().map(f64::ln).sum();
        own.is_finite().then_some(own)
    }

    /// Adds the gradient and Hessian of −ln det J.
    fn add(&self, x: &DVector<f64>, gradient: &mut DVector<f64>, hessian: &mut DMatrix<f64>) {
        let Some(factor) = self.at(x).cholesky() else { return };
        let turned: Vec<Matrix4<f64>> = self.terms.iter().map(|(_, own)| factor.solve(own)).collect();
        for ((v, _), a) in self.terms.iter().zip(&turned) {
            gradient[*v] -= a.trace();
            for ((w, _), b) in self.terms.iter().zip(&turned) {
                hessian[(*v, *w)] += (a * b).trace();
            }
        }
    }
}

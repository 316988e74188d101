//! Sequential quadratic programming with a trust region over the Fourier coefficients.
//!
//! Each step solves min gᵀd + ½dᵀBd + µ·Σⱼ sⱼ subject to the limit rows c(x) + ∇c·d ≤ 1 − margin + sⱼ (one slack
//! variable per limit) and |d| ≤ Δ with Clarabel; B is the damped BFGS approximation of the Hessian of the
//! Lagrangian. Rows that cannot become active within the trust region are omitted. The merit function is f + µ·Σⱼ
//! max(0, worst violation of limit j).

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver, SolverStatus, SupportedConeT};
use nalgebra::{DMatrix, DVector};

use super::limits::LIMITS;
use super::machine::{Machine, Sample, Slopes, information, worst};
use super::series::Basis;

/// Margin to every limit on the grid of the search, for the motion between its instants.
pub const MARGIN: f64 = 0.005;
/// Violation of the margin that still counts as feasible.
const TOLERANCE: f64 = 1e-3;
const FIRST_RADIUS: f64 = 0.1;
const LARGEST_RADIUS: f64 = 0.5;
const LEAST_RADIUS: f64 = 2e-4;
/// Predicted decrease below which the search has converged.
const LEAST_GAIN: f64 = 1e-3;

/// Objective: value and derivative with respect to the information matrix.
pub type Target<'a> = dyn Fn(&DMatrix<f64>) -> Option<(f64, DMatrix<f64>)> + Sync + 'a;

/// Optimisation problem of one search.
pub struct Search<'a> {
    /// Machine with softened friction.
    pub machine: &'a Machine,
    /// Instants over one period.
    pub basis: &'a Basis,
    /// Objective to be minimised.
    pub objective: &'a Target<'a>,
    /// Usual size of each decision variable.
    pub scale: &'a [f64],
}

/// Reason why a search ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The predicted decrease is negligible or the trust region too small.
    Converged,
    /// The largest number of iterations was reached.
    Iterations,
    /// The caller stopped it.
    Stopped,
}

/// Result of a search.
pub struct Found {
    /// Best feasible decision variables; `None` if there are none.
    pub x: Option<Vec<f64>>,
    /// Objective at `x`.
    pub value: f64,
    /// Number of iterations.
    pub iterations: usize,
    /// Reason why it ended.
    pub end: End,
}

/// Iterate with its objective, samples and limits.
struct Point {
    x: Vec<f64>,
    value: f64,
    derivative: DMatrix<f64>,
    samples: Vec<Sample>,
    worst: [f64; LIMITS],
}

impl Point {
    /// Violation of each limit including the margin.
    fn violations(&self) -> impl Iterator<Item = f64> + '_ {
        self.worst.iter().map(|w| (w - 1.0 + MARGIN).max(0.0))
    }

    fn violation(&self) -> f64 {
        self.violations().sum()
    }

    fn feasible(&self) -> bool {
        self.violations().all(|v| v <= TOLERANCE)
    }
}

/// One linearised limit: index of the sample, index of the limit.
type Row = (usize, usize);

impl Search<'_> {
    fn point(&self, x: Vec<f64>) -> Option<Point> {
        let samples = self.machine.samples(self.basis, &x)?;
        let (value, derivative) = (self.objective)(&information(&samples))?;
        let worst = worst(&samples);
        Some(Point { x, value, derivative, samples, worst })
    }

    fn slopes(&self, point: &Point) -> Option<Vec<Slopes>> {
        let factor = 2.0 / point.samples.len() as f64;
        let weights: Vec<DMatrix<f64>> = point.samples.iter().map(|s| &s.rows * &point.derivative * factor).collect();
        self.machine.slopes(self.basis, &point.x, &point.samples, &weights)
    }

    /// Objective and its gradient with respect to the decision variables.
    pub fn gradient(&self, x: &[f64]) -> Option<(f64, Vec<f64>)> {
        let point = self.point(x.to_vec())?;
        let slopes = self.slopes(&point)?;
        Some((point.value, self.pulled_back(&slopes, &[])))
    }

    /// Gradient of the objective plus multipliers times limits with respect to the decision variables.
    fn pulled_back(&self, slopes: &[Slopes], multipliers: &[(Row, f64)]) -> Vec<f64> {
        let mut gradient = vec![0.0; self.basis.variables()];
        for (k, s) in slopes.iter().enumerate() {
            self.basis.pull_back(k, &s.objective, 1.0, &mut gradient);
        }
        for &((k, limit), z) in multipliers {
            self.basis.pull_back(k, &slopes[k].limits[limit], z, &mut gradient);
        }
        gradient
    }

    fn scaled(&self, mut gradient: Vec<f64>) -> DVector<f64> {
        gradient.iter_mut().zip(self.scale).for_each(|(g, s)| *g *= s);
        DVector::from_vec(gradient)
    }

    /// Gradient of the Lagrangian with respect to the scaled variables.
    fn lagrangian(&self, slopes: &[Slopes], multipliers: &[(Row, f64)]) -> DVector<f64> {
        self.scaled(self.pulled_back(slopes, multipliers))
    }

    /// Gradient of one limit with respect to the scaled variables.
    fn limit_gradient(&self, slopes: &[Slopes], (k, limit): Row) -> DVector<f64> {
        let mut gradient = vec![0.0; self.basis.variables()];
        self.basis.pull_back(k, &slopes[k].limits[limit], 1.0, &mut gradient);
        self.scaled(gradient)
    }

    /// Improves `start` by at most `iterations` steps, while `go_on` returns true.
    pub fn run(&self, start: &[f64], iterations: usize, go_on: &dyn Fn() -> bool) -> Found {
        let mut found = Found { x: None, value: f64::INFINITY, iterations: 0, end: End::Iterations };
        let Some(mut point) = self.point(start.to_vec()) else { return found };
        let keep = |found: &mut Found, point: &Point| {
            if point.feasible() && point.value < found.value {
                (found.x, found.value) = (Some(point.x.clone()), point.value);
            }
        };
        keep(&mut found, &point);
        let n = start.len();
        if !go_on() {
            found.end = End::Stopped;
            return found;
        }
        let Some(mut slopes) = self.slopes(&point) else { return found };
        let mut gradient = self.lagrangian(&slopes, &[]);
        let mut hessian = DMatrix::identity(n, n) * gradient.norm().max(1e-3);
        let mut penalty = 2.0 * gradient.amax().max(1.0);
        let mut radius = FIRST_RADIUS;
        for iteration in 0..iterations {
            if !go_on() {
                found.end = End::Stopped;
                break;
            }
            found.iterations = iteration + 1;
            let step = self.step(&point, &slopes, (&gradient, &hessian), (penalty, radius));
            let Some(Step { d, slack, multipliers }) = step else {
                radius *= 0.25;
                if radius < LEAST_RADIUS {
                    found.end = End::Converged;
                    break;
                }
                continue;
            };
            let model = gradient.dot(&d) + 0.5 * d.dot(&(&hessian * &d));
            let predicted = -model + penalty * (point.violation() - slack);
            if predicted < LEAST_GAIN {
                found.end = End::Converged;
                break;
            }
            let x = (0..n).map(|i| point.x[i] + self.scale[i] * d[i]).collect();
            let next = self.point(x);
            let actual = next.as_ref().map_or(f64::NEG_INFINITY, |next| {
                point.value - next.value + penalty * (point.violation() - next.violation())
            });
            let ratio = actual / predicted;
            let moved = d.amax();
            match next {
                Some(next) if ratio > 0.05 => {
                    let Some(next_slopes) = self.slopes(&next) else {
                        radius *= 0.25;
                        continue;
                    };
                    let before = self.lagrangian(&slopes, &multipliers);
                    let after = self.lagrangian(&next_slopes, &multipliers);
                    update(&mut hessian, &d, &(after - before));
                    (point, slopes) = (next, next_slopes);
                    gradient = self.lagrangian(&slopes, &[]);
                    keep(&mut found, &point);
                    if ratio > 0.7 && moved > 0.9 * radius {
                        radius = (2.0 * radius).min(LARGEST_RADIUS);
                    } else if ratio < 0.25 {
                        radius *= 0.5;
                    }
                }
                _ => radius = 0.3 * moved.min(radius),
            }
            // The multipliers of an exact penalty are smaller than the penalty parameter.
            let mut load = [0.0; LIMITS];
            multipliers.iter().for_each(|((_, limit), z)| load[*limit] += z);
            if load.iter().any(|l| *l > 0.9 * penalty) && point.violation() > TOLERANCE {
                penalty *= 2.0;
            }
            if radius < LEAST_RADIUS {
                found.end = End::Converged;
                break;
            }
        }
        found
    }

    /// Step of the quadratic programme in scaled variables.
    fn step(
        &self,
        point: &Point,
        slopes: &[Slopes],
        (gradient, hessian): (&DVector<f64>, &DMatrix<f64>),
        (penalty, radius): (f64, f64),
    ) -> Option<Step> {
        let n = gradient.len();
        let mut limits: Vec<(Row, DVector<f64>, f64)> = Vec::new();
        for (k, sample) in point.samples.iter().enumerate() {
            for limit in 0..LIMITS {
                let value = sample.limits[limit] - 1.0 + MARGIN;
                let row = self.limit_gradient(slopes, (k, limit));
                if value + radius * row.lp_norm(1) > 0.0 {
                    limits.push(((k, limit), row, value));
                }
            }
        }
        let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
        let mut b = Vec::new();
        let mut entry = |i: usize, j: usize, v: f64| {
            if v != 0.0 {
                rows.push(i);
                columns.push(j);
                values.push(v);
            }
        };
        for (i, ((_, limit), row, value)) in limits.iter().enumerate() {
            for j in 0..n {
                entry(i, j, row[j]);
            }
            entry(i, n + limit, -1.0);
            b.push(-value);
        }
        for limit in 0..LIMITS {
            entry(b.len(), n + limit, -1.0);
            b.push(0.0);
        }
        for j in 0..n {
            for sign in [1.0, -1.0] {
                entry(b.len(), j, sign);
                b.push(radius);
            }
        }
        let a = CscMatrix::new_from_triplets(b.len(), n + LIMITS, rows, columns, values);
        let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
        for j in 0..n {
            for i in 0..=j {
                rows.push(i);
                columns.push(j);
                values.push(hessian[(i, j)]);
            }
        }
        let p = CscMatrix::new_from_triplets(n + LIMITS, n + LIMITS, rows, columns, values);
        let q: Vec<f64> = gradient.iter().copied().chain([penalty; LIMITS]).collect();
        let cones = [SupportedConeT::NonnegativeConeT(b.len())];
        let settings = DefaultSettingsBuilder::default().verbose(false).max_iter(100).build().ok()?;
        let mut solver = DefaultSolver::new(&p, &q, &a, &b, &cones, settings).ok()?;
        solver.solve();
        let solution = &solver.solution;
        let usable = matches!(solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        if !usable || solution.x.iter().any(|v| !v.is_finite()) {
            return None;
        }
        let multipliers = limits.iter().zip(&solution.z).map(|((row, ..), z)| (*row, *z));
        Some(Step {
            d: DVector::from_fn(n, |i, _| solution.x[i].clamp(-radius, radius)),
            slack: solution.x[n..].iter().map(|s| s.max(0.0)).sum(),
            multipliers: multipliers.filter(|(_, z)| *z > 1e-6 * penalty).collect(),
        })
    }
}

struct Step {
    d: DVector<f64>,
    /// Sum of the violations that remain to first order.
    slack: f64,
    multipliers: Vec<(Row, f64)>,
}

/// BFGS update with Powell's damping, which keeps the matrix positive definite.
fn update(hessian: &mut DMatrix<f64>, d: &DVector<f64>, change: &DVector<f64>) {
    let bent = &*hessian * d;
    let curvature = d.dot(&bent);
    if curvature.is_nan() || curvature <= 1e-14 {
        return;
    }
    let along = d.dot(change);
    let theta = if along >= 0.2 * curvature { 1.0 } else { 0.8 * curvature / (curvature - along) };
    let damped = change * theta + &bent * (1.0 - theta);
    let scale = d.dot(&damped);
    if scale.is_nan() || scale <= 1e-14 {
        return;
    }
    *hessian += &damped * damped.transpose() / scale - &bent * bent.transpose() / curvature;
}

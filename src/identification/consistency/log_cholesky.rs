//! Log-Cholesky parametrisation of physically consistent bodies [Rucker 2022], for arrow matrices.
//!
//! With D = diag(e^{2d}), h = l·√D and m = Σ l² + e^{2μ} every (d, l, μ) is a consistent body, and every consistent
//! body has exactly one; bodies with deviation moments have full matrices. The 18 variables of the paper for the
//! links of the robot are four each for the arm, the strut and both parts of the telescope, one each for the platform
//! and the rotor. The quadratic cost is minimised by Newton's method with dx/dπ and d²x/dπ² in closed form.

use nalgebra::{DMatrix, DVector};

use super::Cost;
use super::class::{Arrow, First, Shape, Source};
use super::full::TEN;

const MAX_ITERATIONS: usize = 1000;
/// Relative decrease of the cost that counts as none, and number of such steps in a row that ends the search.
const PROGRESS: f64 = 1e-13;
const PATIENCE: usize = 4;

/// Variables of a cost: those of every class, then the parameters that no class owns.
struct Chart<'a> {
    cost: &'a Cost,
    /// First variable of each class.
    starts: Vec<usize>,
    /// Parameters that no class owns.
    others: Vec<usize>,
    /// Smallest and largest value of each variable.
    bounds: Vec<(f64, f64)>,
}

impl<'a> Chart<'a> {
    fn new(cost: &'a Cost) -> Self {
        let mut bounds = Vec::new();
        let mut starts = Vec::new();
        for class in &cost.classes {
            starts.push(bounds.len());
            let above = |least: f64| (0.5 * least.ln(), f64::INFINITY);
            const ANY: (f64, f64) = (f64::NEG_INFINITY, f64::INFINITY);
            match &class.shape {
                Shape::Arrow(arrow) => {
                    bounds.extend(arrow.sizes.iter().map(|_| above(class.least_size())));
                    bounds.extend(own_moments(arrow).map(|_| ANY));
                    bounds.push(above(class.least_rest()));
                }
                Shape::Full(_) => {
                    bounds.extend([above(class.least_size()); 3]);
                    bounds.push(above(class.least_rest()));
                    bounds.extend([ANY; TEN - 4]);
                }
            }
        }
        let others: Vec<usize> = cost.free_of_bodies().collect();
        bounds.extend(others.iter().map(|&i| cost.range[i]));
        Self { cost, starts, others, bounds }
    }

    fn clamped(&self, pi: &DVector<f64>) -> DVector<f64> {
        DVector::from_fn(pi.len(), |i, _| pi[i].clamp(self.bounds[i].0, self.bounds[i].1))
    }

    /// Variables of parameters, moved to the nearest consistent ones where necessary.
    fn variables(&self, x: &DVector<f64>) -> DVector<f64> {
        let mut pi = DVector::zeros(self.bounds.len());
        for (class, &start) in self.cost.classes.iter().zip(&self.starts) {
            let arrow = match &class.shape {
                Shape::Arrow(arrow) => arrow,
                Shape::Full(full) => {
                    let own = full.coordinates(x, (class.least_size(), class.least_rest()));
                    pi.rows_mut(start, TEN).copy_from_slice(&own);
                    continue;
                }
            };
            let mut at = start;
            for g in 0..arrow.sizes.len() {
                pi[at] = 0.5 * arrow.size(g, x).max(class.least_size()).ln();
                at += 1;
            }
            let second = second(arrow, &pi, start, x[arrow.mass]);
            let mut rest = x[arrow.mass] * (1.0 - tied(arrow));
            for k in 0..3 {
                match arrow.first[k] {
                    First::Own(v) => {
                        pi[at] = x[v] / second[k].sqrt();
                        rest -= pi[at] * pi[at];
                        at += 1;
                    }
                    First::Constant(h) => rest -= h * h / second[k],
                    First::Mass(_) => {}
                }
            }
            pi[at] = 0.5 * rest.max(class.least_rest()).ln();
        }
        let offset = self.bounds.len() - self.others.len();
        for (k, &i) in self.others.iter().enumerate() {
            pi[offset + k] = x[i];
        }
        self.clamped(&pi)
    }

    /// Σ gₖ·d²xₖ/dπ²: the second-order part of the curvature.
    fn bend(&self, pi: &DVector<f64>, g: &DVector<f64>) -> DMatrix<f64> {
        let mut bend = DMatrix::zeros(pi.len(), pi.len());
        for (class, &start) in self.cost.classes.iter().zip(&self.starts) {
            let class = match &class.shape {
                Shape::Arrow(arrow) => arrow,
                Shape::Full(full) => {
                    full.bend(pi, start, g, &mut bend);
                    continue;
                }
            };
            for (v, factors) in &class.moments {
                for (size, factor) in factors.iter().enumerate() {
                    let i = start + size;
                    bend[(i, i)] += 4.0 * g[*v] * factor * (2.0 * pi[i]).exp();
                }
            }
            let second = second(class, pi, start, 0.0);
            let mut at = start + class.sizes.len();
            let mass = g[class.mass] / (1.0 - tied(class));
            for k in 0..3 {
                match (class.first[k], class.second[k].0) {
                    (First::Own(v), source) => {
                        let root = second[k].sqrt();
                        if let Source::Size(size) = source {
                            let i = start + size;
                            bend[(i, i)] += g[v] * pi[at] * root;
                            bend[(i, at)] += g[v] * root;
                            bend[(at, i)] += g[v] * root;
                        }
                        bend[(at, at)] += 2.0 * mass;
                        at += 1;
                    }
                    (First::Constant(h), Source::Size(size)) => {
                        let i = start + size;
                        bend[(i, i)] += 4.0 * mass * h * h / second[k];
                    }
                    _ => {}
                }
            }
            bend[(at, at)] += 4.0 * mass * (2.0 * pi[at]).exp();
        }
        bend
    }

    /// Parameters x(π) and dx/dπ.
    fn parameters(&self, pi: &DVector<f64>) -> (DVector<f64>, DMatrix<f64>) {
        let mut x = DVector::zeros(self.cost.centre.len());
        let mut slope = DMatrix::zeros(x.len(), pi.len());
        for (class, &start) in self.cost.classes.iter().zip(&self.starts) {
            let class = match &class.shape {
                Shape::Arrow(arrow) => arrow,
                Shape::Full(full) => {
                    full.parameters(pi, start, &mut x, &mut slope);
                    continue;
                }
            };
            let sizes: Vec<f64> = (0..class.sizes.len()).map(|g| (2.0 * pi[start + g]).exp()).collect();
            for (v, factors) in &class.moments {
                for (g, factor) in factors.iter().enumerate() {
                    x[*v] += factor * sizes[g];
                    slope[(*v, start + g)] += 2.0 * factor * sizes[g];
                }
            }
            let second = second(class, pi, start, 0.0);
            let mut at = start + sizes.len();
            let scale = 1.0 / (1.0 - tied(class));
            for k in 0..3 {
                match class.first[k] {
                    First::Own(v) => {
                        let root = second[k].sqrt();
                        x[v] = pi[at] * root;
                        slope[(v, at)] = root;
                        if let Source::Size(g) = class.second[k].0 {
                            slope[(v, start + g)] = x[v];
                        }
                        x[class.mass] += scale * pi[at] * pi[at];
                        slope[(class.mass, at)] += scale * 2.0 * pi[at];
                        at += 1;
                    }
                    First::Constant(h) if h != 0.0 => {
                        let load = scale * h * h / second[k];
                        x[class.mass] += load;
                        if let Source::Size(g) = class.second[k].0 {
                            slope[(class.mass, start + g)] -= 2.0 * load;
                        }
                    }
                    _ => {}
                }
            }
            let rest = scale * (2.0 * pi[at]).exp();
            x[class.mass] += rest;
            slope[(class.mass, at)] += 2.0 * rest;
        }
        let offset = pi.len() - self.others.len();
        for (k, &i) in self.others.iter().enumerate() {
            x[i] = pi[offset + k];
            slope[(i, offset + k)] = 1.0;
        }
        (x, slope)
    }
}

fn own_moments(class: &Arrow) -> impl Iterator<Item = usize> + '_ {
    class.first.iter().filter_map(|f| if let First::Own(v) = f { Some(*v) } else { None })
}

/// Diagonal of D for the sizes in π and a mass.
fn second(class: &Arrow, pi: &DVector<f64>, start: usize, mass: f64) -> [f64; 3] {
    class.second.map(|(source, share)| match source {
        Source::Size(g) => share * (2.0 * pi[start + g]).exp(),
        Source::Mass => share * mass,
        Source::Constant => share,
    })
}

/// Share Σ r²/(D/m) of the mass required by first moments proportional to the mass.
fn tied(class: &Arrow) -> f64 {
    (0..3)
        .filter_map(|k| match (class.first[k], class.second[k]) {
            (First::Mass(arm), (Source::Mass, share)) => Some(arm * arm / share),
            _ => None,
        })
        .sum::<f64>()
        .min(1.0 - super::MARGIN)
}

/// Consistent parameters: unchanged where `x` is consistent, else on the boundary.
pub fn possible(cost: &Cost, x: &DVector<f64>) -> DVector<f64> {
    let chart = Chart::new(cost);
    chart.parameters(&chart.variables(x)).0
}

/// Weight of the barrier relative to the cost at the start, its reduction factor, and the number of weights.
const BARRIERS: (f64, f64, usize) = (0.1, 10.0, 12);

/// Physically consistent parameters of least cost; consistent for any cost.
///
/// Close to the boundary of consistency dx/dπ vanishes, so a plain descent would stall there. The barrier −t·ln(Π
/// sizes · Π rests), linear in π, keeps the iterates away from it while t decreases to zero.
pub fn minimise(cost: &Cost) -> DVector<f64> {
    let chart = Chart::new(cost);
    let mut pi = chart.variables(&cost.start);
    let (first, by, count) = BARRIERS;
    let mut t = first * cost.of(&chart.parameters(&pi).0);
    for _ in 0..count {
        pi = descend(&chart, pi, t);
        t /= by;
    }
    chart.parameters(&descend(&chart, pi, 0.0)).0
}

/// Damped Newton's method on the cost with a barrier of weight `t`.
fn descend(chart: &Chart, mut pi: DVector<f64>, t: f64) -> DVector<f64> {
    let cost = chart.cost;
    // Sizes and rests have a lower bound on half their logarithm, first moments have none, other parameters have no
    // barrier.
    let bodies = pi.len() - chart.others.len();
    let logarithm = |i: usize| i < bodies && chart.bounds[i].0.is_finite();
    let total = |x: &DVector<f64>, pi: &DVector<f64>| {
        cost.of(x) - t * (0..bodies).filter(|&i| logarithm(i)).map(|i| 2.0 * pi[i]).sum::<f64>()
    };
    let (mut x, mut slope) = chart.parameters(&pi);
    let mut value = total(&x, &pi);
    let mut damping = 1e-6;
    let mut idle = 0;
    for _ in 0..MAX_ITERATIONS {
        let by_parameter = &cost.curvature * (&x - &cost.centre);
        let mut gradient = slope.tr_mul(&by_parameter);
        (0..bodies).filter(|&i| logarithm(i)).for_each(|i| gradient[i] -= 2.0 * t);
        let normal = slope.tr_mul(&(&cost.curvature * &slope));
        let curvature = &normal + chart.bend(&pi, &by_parameter);
        // Variables whose descent direction violates their bound stay at it.
        let fixed: Vec<bool> = (0..pi.len())
            .map(|i| {
                let (low, high) = chart.bounds[i];
                (pi[i] <= low && gradient[i] > 0.0) || (pi[i] >= high && gradient[i] < 0.0)
            })
            .collect();
        let step = step(&curvature, &gradient, &fixed, damping).or_else(|| step(&normal, &gradient, &fixed, damping));
        let better = step.map(|d| chart.clamped(&(&pi - d))).and_then(|next| {
            let (x, slope) = chart.parameters(&next);
            let value = total(&x, &next);
            value.is_finite().then_some((next, x, slope, value))
        });
        match better {
            Some((next, at, tangent, new)) if new <= value => {
                idle = if value - new <= PROGRESS * value.abs() { idle + 1 } else { 0 };
                (pi, x, slope, value) = (next, at, tangent, new);
                damping = (damping * 0.1).max(1e-12);
            }
            _ => {
                damping *= 10.0;
                if damping > 1e12 {
                    break;
                }
            }
        }
        if idle >= PATIENCE {
            break;
        }
    }
    pi
}

/// Damped step (A + λ·|diag A|)⁻¹·g of the free variables; `None` if the matrix is not positive definite.
fn step(curvature: &DMatrix<f64>, gradient: &DVector<f64>, fixed: &[bool], damping: f64) -> Option<DVector<f64>> {
    let free: Vec<usize> = (0..fixed.len()).filter(|&i| !fixed[i]).collect();
    let m = DMatrix::from_fn(free.len(), free.len(), |a, b| {
        let n = curvature[(free[a], free[b])];
        if a == b { n + damping * n.abs() + f64::MIN_POSITIVE } else { n }
    });
    let g = DVector::from_fn(free.len(), |a, _| gradient[free[a]]);
    let d = m.cholesky()?.solve(&g);
    let mut all = DVector::zeros(fixed.len());
    for (a, &i) in free.iter().enumerate() {
        all[i] = d[a];
    }
    Some(all)
}

//! Parameters of least cost by Gauss–Newton iteration, damped where parameters enter nonlinearly ([Levenberg 1944],
//! [Marquardt 1963]).

use std::sync::Arc;

use nalgebra::DVector;

use super::regression::Regression;
use super::{FitError, is_nonlinear};
use crate::effects::Role;
use crate::identification::Residuals;
use crate::identification::estimator::Estimator;
use crate::identification::normal_equations::{NormalEquations, Weight};
use crate::model::Model;

pub(super) const MAX_ITERATIONS: usize = 8;
/// Decrease of the cost that counts as progress, in units of the mean cost of a residual if that exceeds the noise's:
/// moving a parameter by its standard error changes the cost by about one such unit.
pub(super) const PROGRESS: f64 = 0.01;
/// Damping that keeps what the data hardly determine, such as all torques of a drive with the factor of its sensor.
const SLIGHT: f64 = 1e-5;
/// Successive trials of a step.
pub(super) const TRIALS: [Trial; 10] = [
    Trial { all: 0.0, shapes: 0.0, length: 1.0 },
    Trial { all: SLIGHT, shapes: 0.0, length: 1.0 },
    Trial { all: SLIGHT, shapes: 0.01, length: 1.0 },
    Trial { all: SLIGHT, shapes: 0.1, length: 1.0 },
    Trial { all: SLIGHT, shapes: 1.0, length: 1.0 },
    Trial { all: SLIGHT, shapes: 10.0, length: 1.0 },
    Trial { all: SLIGHT, shapes: 10.0, length: 0.25 },
    Trial { all: SLIGHT, shapes: 10.0, length: 0.0625 },
    Trial { all: SLIGHT, shapes: 10.0, length: 0.0156 },
    Trial { all: SLIGHT, shapes: 10.0, length: 0.0039 },
];
/// Number of rounds of reweighting.
const ROUNDS: usize = 4;
/// Residual, in robust standard deviations, above which it is downweighted: 95 % efficiency for normal noise
/// [Huber 1964].
const HUBER: f64 = 1.345;
/// Residual, in robust standard deviations, above which it is rejected.
const TRIM: f64 = 3.0;

/// A model with parameters of least cost, its normal equations and their solver.
pub(super) struct Solution {
    pub model: Model,
    pub normal: NormalEquations,
    pub estimator: Estimator,
}

/// How a step is damped and shortened.
pub(super) struct Trial {
    /// Share of the curvature along each parameter by which it is damped.
    all: f64,
    /// Share of the curvature along each shape parameter, the others following it, by which the shape is damped in addition.
    /// Linear parameters stay free: along a curved valley the shapes take short steps, and the others go with them.
    shapes: f64,
    /// Share of its length.
    pub length: f64,
}

/// Parameters with their residuals and their cost.
struct Point {
    model: Model,
    values: DVector<f64>,
    residuals: Arc<Residuals>,
    cost: f64,
}

impl Regression<'_> {
    /// Solution of least cost, with the present parameters of `model` as initial values.
    pub fn least_squares(&self, model: Model, weight: Weight) -> Result<Solution, FitError> {
        let solution = self.linearised(model, weight)?;
        if is_nonlinear(&solution.model) { self.iterated(solution, weight) } else { self.one_step(solution) }
    }

    /// Iteratively reweighted solution: samples far outside the robust standard deviation of the residuals are
    /// downweighted if `robust`, otherwise rejected.
    pub fn reweighted(&self, mut solution: Solution, robust: bool) -> Result<Solution, FitError> {
        for _ in 0..ROUNDS {
            if (self.stop)() {
                break;
            }
            let scale = self.scatter(&solution.normal.residuals);
            let huber = |c: usize, r: f64| (HUBER * scale[c] / r.abs()).min(1.0);
            let trimmed = |c: usize, r: f64| f64::from(r.abs() <= TRIM * scale[c]);
            let weight: Weight = if robust { &huber } else { &trimmed };
            solution = self.least_squares(solution.model, weight)?;
        }
        Ok(solution)
    }

    pub fn linearised(&self, model: Model, weight: Weight) -> Result<Solution, FitError> {
        let normal = self.normal_equations(&model, weight)?;
        let estimator = Estimator::new(&normal, &self.size, &self.weights).ok_or(FitError::NotFinite)?;
        Ok(Solution { model, normal, estimator })
    }

    /// Solution in one step, for parameters that all enter linearly.
    fn one_step(&self, mut solution: Solution) -> Result<Solution, FitError> {
        let Solution { model, normal, estimator } = &mut solution;
        let values = self.values(model);
        let step = estimator.step(normal, &(&values - &self.prior), &[]);
        self.set(model, &(&values + &step));
        normal.advance(&step);
        normal.residuals = Arc::new(self.residuals(model)?);
        Ok(solution)
    }

    fn iterated(&self, mut solution: Solution, weight: Weight) -> Result<Solution, FitError> {
        let (mut here, mut damping) = (self.point(&solution, weight), 0);
        for iteration in 0..MAX_ITERATIONS {
            if iteration > 0 && (self.stop)() {
                break;
            }
            let progress = PROGRESS * self.scale(here.cost);
            let step = self.step(&solution.normal, &solution.estimator, &here.values);
            if 0.5 * step.dot(&(&solution.normal.information * &step)) < progress {
                break;
            }
            let next = self.search(&here, &solution, weight, damping, iteration > 0);
            if !next.as_ref().map_or(&here, |(next, ..)| next).cost.is_finite() {
                return Err(FitError::NotFinite);
            }
            let Some((next, damped, around)) = next else { break };
            // Less damping is tried next, and after a shortened step hardly any.
            damping =
                if TRIALS[damped].length == 1.0 { damped.saturating_sub(1) } else { usize::from(damped > damping) };
            let (step, change) = (&next.values - &here.values, here.cost - next.cost);
            let is_accurate = damped == 0 && !self.is_blind(&solution, &here.values);
            let promised = solution.normal.score.dot(&step) - 0.5 * step.dot(&(&solution.normal.information * &step))
                + self.prior_cost(&here.values)
                - self.prior_cost(&next.values);
            here = next;
            // The columns are accurate enough, or those of the previous iterate, which only affects the standard
            // errors.
            if (is_accurate && (change - promised).abs() < progress) || (self.stop)() {
                solution.normal.advance(&step);
                break;
            }
            solution = match around {
                Some(around) => around,
                None => self.linearised(here.model.clone(), weight)?,
            };
            if change < progress.max(1e-12 * here.cost) {
                break;
            }
        }
        solution.model = here.model;
        solution.normal.residuals = here.residuals;
        Ok(solution)
    }

    fn point(&self, solution: &Solution, weight: Weight) -> Point {
        let values = self.values(&solution.model);
        let residuals = Arc::clone(&solution.normal.residuals);
        let cost = self.cost(&residuals, &values, weight);
        Point { model: solution.model.clone(), values, residuals, cost }
    }

    /// The estimator for a trial; `None` if it equals the one for the trial before, as without shape parameters.
    pub fn damped(&self, place: usize, estimator: &Estimator) -> Option<Estimator> {
        let Trial { all, shapes, length } = TRIALS[place];
        let own: Vec<usize> = self.shapes().collect();
        let is_repeated = own.is_empty() && shapes > 0.0 && length == 1.0;
        (!is_repeated).then(|| estimator.damped(all, shapes, &own).unwrap_or_else(|| estimator.clone()))
    }

    /// Whether there are two shape parameters or more.
    pub fn has_several_shapes(&self) -> bool {
        self.shapes().nth(1).is_some()
    }

    /// Indices of the shape parameters.
    fn shapes(&self) -> impl Iterator<Item = usize> {
        (0..self.free.len()).filter(|&i| self.parameters[i].role == Role::Shape)
    }

    /// Step of least linearised cost from `values` in which shape parameters change as [`Self::permitted`].
    pub fn step(&self, normal: &NormalEquations, estimator: &Estimator, values: &DVector<f64>) -> DVector<f64> {
        let offset = values - &self.prior;
        let mut held: Vec<(usize, f64)> = Vec::new();
        loop {
            let step = estimator.step(normal, &offset, &held);
            let limited = |i: usize| {
                let most = self.permitted(values, i, step[i]);
                let is_free = held.iter().all(|(h, _)| *h != i);
                (is_free && most != step[i]).then_some((i, most))
            };
            let beyond: Vec<(usize, f64)> = (0..values.len()).filter_map(limited).collect();
            if beyond.is_empty() {
                return step;
            }
            held.extend(beyond);
        }
    }

    /// Whether some shape parameter has no column that the next linearisation may have: that of an effect which had the
    /// size zero at the `values` of this one.
    fn is_blind(&self, solution: &Solution, values: &DVector<f64>) -> bool {
        let of = |role: Role| (0..self.free.len()).filter(move |&i| self.parameters[i].role == role);
        let is_absent = |shape: usize| {
            let effect = self.parameters[shape].param.effect;
            of(Role::Linear).filter(|&i| self.parameters[i].param.effect == effect).all(|i| values[i] == 0.0)
        };
        of(Role::Shape).any(|i| solution.normal.information[(i, i)] == 0.0 && is_absent(i))
    }

    /// First of the [`TRIALS`] from `first` on whose cost is not larger, its place, and the linearisation next to it if linear
    /// parameters had to follow the shapes for that; `None` without any, or if `may_stop` and the fit is stopped.
    fn search(
        &self,
        from: &Point,
        solution: &Solution,
        weight: Weight,
        first: usize,
        may_stop: bool,
    ) -> Option<(Point, usize, Option<Solution>)> {
        for (place, trial) in TRIALS.iter().enumerate().skip(first) {
            let Some(damped) = self.damped(place, &solution.estimator) else { continue };
            let step = self.step(&solution.normal, &damped, &from.values) * trial.length;
            // Trials need no columns. A step to a machine that cannot be assembled is too long.
            if let Some(next) = self.moved(&from.model, &from.values + step, weight) {
                if next.cost <= from.cost {
                    return Some((next, place, None));
                }
                let followed = if trial.length == 1.0 { self.followed(&next, weight) } else { None };
                if let Some((next, around)) = followed.filter(|(next, _)| next.cost <= from.cost) {
                    return Some((next, place, Some(around)));
                }
            }
            if may_stop && (self.stop)() {
                break;
            }
        }
        None
    }

    /// `model` with other values of its parameters; `None` if it cannot be assembled along the recordings.
    fn moved(&self, model: &Model, values: DVector<f64>, weight: Weight) -> Option<Point> {
        let mut model = model.clone();
        self.set(&mut model, &values);
        let residuals = Arc::new(self.residuals(&model).ok()?);
        let cost = self.cost(&residuals, &values, weight);
        Some(Point { model, values, residuals, cost })
    }

    /// `point` with the linear parameters of least cost at its shapes (variable projection [Golub 1973]), and the linearisation
    /// next to it; `None` with fewer than two shapes, for which damping is enough.
    fn followed(&self, point: &Point, weight: Weight) -> Option<(Point, Solution)> {
        if !self.has_several_shapes() {
            return None;
        }
        let held: Vec<(usize, f64)> = self.shapes().map(|i| (i, 0.0)).collect();
        let mut around = self.linearised(point.model.clone(), weight).ok()?;
        let step = around.estimator.step(&around.normal, &(&point.values - &self.prior), &held);
        around.normal.advance(&step);
        Some((self.moved(&point.model, &point.values + step, weight)?, around))
    }

    /// The part of the change `by` of parameter `i` that one step may make: a shape parameter changes by at most half its
    /// value, one that may be zero by at most half its usual size if that is larger, and stays within its range.
    fn permitted(&self, values: &DVector<f64>, i: usize, by: f64) -> f64 {
        let (p, value) = (&self.parameters[i], values[i]);
        if p.role != Role::Shape {
            return by;
        }
        let least = if p.range.0 <= 0.0 { p.usual } else { 0.0 };
        let most = 0.5 * value.abs().max(least);
        let by = by.clamp(-most, most);
        let there = value + by;
        if there < p.range.0 || there > p.range.1 { there.clamp(p.range.0, p.range.1) - value } else { by }
    }
}

//! One linear programme of the sequence: limits and time linearised at an iterate.

use super::active_set::ActiveSet;
use super::constraint::{Constraints, jerk_row, ramp_caps};
use super::{GridProfile, Objective};
use crate::machine::every_axis;
use crate::planner::programme::{Programme, normalise};
use crate::planner::unknowns::Unknowns;

/// Least ratio of z after a step to z before it with [`Objective::Speed`].
///
/// ∫ z ds does not penalise time at rest, so the reduction of the speed per step is bounded.
const SPEED_STEP: f64 = 0.5;
/// Coefficients of the tangent 1.5 − 0.5 x to √(z₀/z), with x = z/z₀, at x = 1.
const ROOT_TANGENT: [f64; 2] = [1.5, -0.5];

/// Optimum of a linear programme.
pub struct Step {
    /// z and s̈ at the optimum.
    pub profile: GridProfile,
    /// Lower bound on the time within its rows, s; −∞ with [`Objective::Speed`].
    pub bound: f64,
    /// Iterations of the solver.
    pub iterations: usize,
}

/// Optimum of the programme about the iterate `at`; `None` if the solver finds none.
///
/// Only the rows of loads and jerk limits in `active` are included.
pub fn step(constraints: Constraints, active: &ActiveSet, at: &GridProfile, objective: Objective) -> Option<Step> {
    let linear = Linear { constraints, active, at, unknowns: Unknowns::new(constraints.grid, at) };
    let mut programme = Programme::default();
    linear.unknowns.continuity(&mut programme);
    linear.unknowns.ends(&mut programme);
    let equalities = programme.len();
    linear.load_rows(&mut programme, objective);
    linear.jerk_rows(&mut programme);
    linear.dip_rows(&mut programme);
    let inequalities = programme.len();
    let gradient = at.gradient(constraints.grid);
    let mut cost = linear.cost(objective, &gradient);
    let scale = normalise(&mut cost);
    let solution = programme.solve(&cost, equalities, inequalities)?;
    let profile = linear.unknowns.read(&solution.x);
    let moving = constraints.grid.moving();
    if profile.z[moving].iter().any(|z| !z.is_finite() || *z <= 0.0) {
        return None;
    }
    let bound = match objective {
        Objective::Time => linear.time_bound(&gradient, solution.obj_val_dual / scale),
        Objective::Speed => f64::NEG_INFINITY,
    };
    Some(Step { profile, bound, iterations: solution.iterations as usize })
}

struct Linear<'a> {
    constraints: Constraints<'a>,
    active: &'a ActiveSet,
    at: &'a GridProfile,
    unknowns: Unknowns<'a>,
}

impl Linear<'_> {
    /// Adds the bounds on z and the rows of accelerations and loads, point by point.
    fn load_rows(&self, programme: &mut Programme, objective: Objective) {
        let Constraints { grid, limits, tightening } = self.constraints;
        let ramps = grid.ramps();
        let caps = ramp_caps(grid, limits, &tightening.jerk);
        let least = match objective {
            Objective::Time => 0.0,
            Objective::Speed => SPEED_STEP,
        };
        for i in grid.moving() {
            let (z, acceleration) = (self.unknowns.z(i), self.unknowns.acceleration(i));
            let (z_unit, acceleration_unit) = (self.unknowns.z_unit(i), self.unknowns.acceleration_unit);
            let ramp_cap = ramps.iter().zip(&caps).filter(|(ramp, _)| ramp.neighbour == i).map(|(_, cap)| *cap);
            let cap = ramp_cap.fold(grid.points[i].cap * tightening.cap(i), f64::min);
            programme.row(&[(z, -1.0)], -least);
            if cap.is_finite() {
                programme.row(&[(z, z_unit / cap)], 1.0);
            }
            for (r, (row, &k)) in grid.points[i].rows.iter().zip(&grid.quantities).enumerate() {
                let (a, b, c) = row.tangent(z_unit.sqrt());
                for sign in self.active.load_signs(i, r) {
                    let terms = [(acceleration, sign * a * acceleration_unit), (z, sign * b * z_unit)];
                    programme.row(&terms, tightening.share[i][k] - sign * c);
                }
            }
        }
    }

    /// Adds |q‴ z + 3 q″ s̈ + q′ c| ≤ J/√z at both ends of the intervals, with the tangent at z₀ as right side, in
    /// units of J/√z₀.
    fn jerk_rows(&self, programme: &mut Programme) {
        let Constraints { grid, limits, tightening } = self.constraints;
        let (unknowns, unit) = (&self.unknowns, self.unknowns.acceleration_unit);
        let [offset, slope] = ROOT_TANGENT;
        for i in grid.inner() {
            let h = grid.length(i);
            for (side, point) in [i, i + 1].into_iter().enumerate() {
                let z0 = self.at.z[point];
                for axis in every_axis().filter(|&k| limits.jerk[k].is_finite()) {
                    let [third, second, first] = jerk_row(&grid.points[point], limits, axis).map(|v| v * z0.sqrt());
                    let share = tightening.jerk[point][axis];
                    for sign in self.active.jerk_signs(i, side, axis) {
                        let mut terms = [
                            (unknowns.acceleration(i), -sign * first / h * unit),
                            (unknowns.acceleration(i + 1), sign * first / h * unit),
                            (unknowns.z(point), sign * third * z0 - slope * share),
                        ];
                        terms[side].1 += sign * second * unit;
                        programme.row(&terms, offset * share);
                    }
                }
            }
        }
    }

    /// Adds zᵢ + h s̈ᵢ ≥ 0, the middle Bernstein coefficient of z over an interval; z ≥ 0 if all three are
    /// non-negative.
    fn dip_rows(&self, programme: &mut Programme) {
        let (grid, unknowns) = (self.constraints.grid, &self.unknowns);
        for i in grid.inner().filter(|&i| self.active.must_not_vanish(i)) {
            let scale = 1.0 / unknowns.z_unit(i).max(unknowns.z_unit(i + 1));
            let step = -grid.length(i) * unknowns.acceleration_unit * scale;
            programme.row(&[(unknowns.z(i), -unknowns.z_unit(i) * scale), (unknowns.acceleration(i), step)], 0.0);
        }
    }

    /// Cost vector: ∇T·z, or −∫ z ds by the trapezoidal rule.
    fn cost(&self, objective: Objective, gradient: &[f64]) -> Vec<f64> {
        let grid = self.constraints.grid;
        let n = grid.intervals();
        let reach = |k: usize| if k < n { grid.length(k) } else { 0.0 };
        let mut cost = vec![0.0; 2 * self.unknowns.count];
        for i in grid.moving() {
            cost[self.unknowns.z(i)] = self.unknowns.z_unit(i)
                * match objective {
                    Objective::Time => gradient[self.unknowns.position(i)],
                    Objective::Speed => -0.5 * (reach(i.wrapping_sub(1)) + reach(i)) * grid.points[i].weight,
                };
        }
        cost
    }

    /// Lower bound T(z) + ∇T·(z* − z) on the time, s, with the `dual` bound on ∇T·z*.
    fn time_bound(&self, gradient: &[f64], dual: f64) -> f64 {
        let grid = self.constraints.grid;
        let present: f64 = grid.moving().map(|i| gradient[self.unknowns.position(i)] * self.at.z[i]).sum();
        self.at.time(grid) + dual - present
    }
}

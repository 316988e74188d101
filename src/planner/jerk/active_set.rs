//! Active set of the programmes: the rows close to their limits. All other rows are checked after each programme.

use super::constraint::{Constraints, JerkPlace};
use super::{Grid, GridProfile};
use crate::machine::{PerAxis, each, every_axis};

/// Use of a row from which its side enters the active set.
const ENTERING_USE: f64 = 0.8;
/// Largest use at which a row outside the active set counts as satisfied.
const FEASIBLE_USE: f64 = 1.0 + 1e-6;
/// Number of intervals on either side of a violated jerk row over which the row enters as well.
const NEIGHBOURS: usize = 3;
/// Least use of a jerk limit, relative to the largest of the drives, at which both sides stay in the active set.
const KEPT_SHARE: f64 = 0.6;

/// Sides of the rows (≤ share, ≥ −share) that are part of the programmes.
pub struct ActiveSet {
    /// Per grid point and row of loads.
    loads: Vec<Vec<Sides>>,
    /// Per interval: each drive at the interval's start and end.
    jerks: Vec<[PerAxis<Sides>; 2]>,
    /// Intervals in which z must stay positive although it is positive at both ends.
    dips: Vec<bool>,
}

/// Upper and lower side of a row.
#[derive(Clone, Copy, Default)]
struct Sides([bool; 2]);

impl Sides {
    const BOTH: Self = Self([true; 2]);

    /// Use of a side that was outside, else zero; a side enters at a use above [`ENTERING_USE`].
    fn update(&mut self, used: f64) -> f64 {
        let side = usize::from(used < 0.0);
        let outside = if self.0[side] { 0.0 } else { used.abs() };
        self.0[side] |= used.abs() > ENTERING_USE;
        outside
    }

    /// Signs of the sides in the active set.
    fn signs(self) -> impl Iterator<Item = f64> {
        [1.0, -1.0].into_iter().zip(self.0).filter_map(|(sign, inside)| inside.then_some(sign))
    }
}

impl ActiveSet {
    /// Active set of the rows close to `near`; of the jerk limits, those at the start of every interval.
    pub(super) fn new(constraints: Constraints, near: &GridProfile) -> Self {
        let grid = constraints.grid;
        let mut active = Self {
            loads: grid.points.iter().map(|point| vec![Sides::default(); point.rows.len()]).collect(),
            jerks: vec![[each(Sides::BOTH), each(Sides::default())]; grid.intervals()],
            dips: vec![false; grid.intervals()],
        };
        active.update_loads(constraints, near);
        active
    }

    /// Signs of the active sides of row `row` at grid point `i`.
    pub(in crate::planner) fn load_signs(&self, i: usize, row: usize) -> impl Iterator<Item = f64> {
        self.loads[i][row].signs()
    }

    /// Signs of the active sides of a jerk limit; `side` is 0 at the start of the interval, 1 at its end.
    pub(super) fn jerk_signs(&self, interval: usize, side: usize, axis: usize) -> impl Iterator<Item = f64> {
        self.jerks[interval][side][axis].signs()
    }

    /// Whether a row outside the active set was violated; the rows close to `profile` enter.
    pub(super) fn update(&mut self, constraints: Constraints, profile: &GridProfile) -> bool {
        let loads = self.update_loads(constraints, profile);
        let jerks = self.update_jerks(constraints, profile);
        loads > FEASIBLE_USE || jerks > FEASIBLE_USE
    }

    /// Largest use of a load row outside the active set; rows close to their limit enter.
    fn update_loads(&mut self, constraints: Constraints, profile: &GridProfile) -> f64 {
        let Constraints { grid, tightening, .. } = constraints;
        let mut worst = 0.0f64;
        for i in 1..grid.intervals() {
            for (r, (row, &k)) in grid.points[i].rows.iter().zip(&grid.quantities).enumerate() {
                let used = row.at(profile.z[i], profile.acceleration[i]) / tightening.share[i][k];
                worst = worst.max(self.loads[i][r].update(used));
            }
        }
        worst
    }

    /// Largest use of a jerk limit outside the active set; a violated side also enters over the neighbouring
    /// intervals.
    fn update_jerks(&mut self, constraints: Constraints, profile: &GridProfile) -> f64 {
        let mut worst = 0.0f64;
        let inner = constraints.grid.inner();
        for interval in inner.clone() {
            for (side, grid_point) in [interval, interval + 1].into_iter().enumerate() {
                for axis in every_axis() {
                    let used = constraints.jerk_use(profile, JerkPlace { interval, grid_point, axis });
                    let outside = self.jerks[interval][side][axis].update(used);
                    worst = worst.max(outside);
                    if outside > FEASIBLE_USE {
                        let first = interval.saturating_sub(NEIGHBOURS).max(inner.start);
                        for near in first..(interval + NEIGHBOURS + 1).min(inner.end) {
                            self.jerks[near][side][axis].0[usize::from(used < 0.0)] = true;
                        }
                    }
                }
            }
        }
        worst
    }

    /// Whether z must stay positive within an interval.
    pub(super) fn must_not_vanish(&self, interval: usize) -> bool {
        self.dips[interval]
    }

    /// Whether z of `profile` vanishes within an interval outside the set; such intervals enter.
    ///
    /// The time of an interval, 2h/(√zᵢ + √zᵢ₊₁), depends on its ends only, so a programme may let z vanish in
    /// between.
    pub(super) fn update_dips(&mut self, grid: &Grid, profile: &GridProfile) -> bool {
        let mut outside = false;
        for interval in grid.inner() {
            if profile.vanishes_within(grid, interval) && !self.dips[interval] {
                self.dips[interval] = true;
                outside = true;
            }
        }
        outside
    }

    /// Removes the jerk rows far from `profile`; the drives closest to their limit keep both sides at the interval's
    /// start.
    pub(super) fn prune(&mut self, constraints: Constraints, profile: &GridProfile) {
        for interval in constraints.grid.inner() {
            let at = |axis| JerkPlace { interval, grid_point: interval, axis };
            let used: PerAxis<f64> = std::array::from_fn(|axis| constraints.jerk_use(profile, at(axis)));
            let largest = used.iter().fold(0.0f64, |m, u| m.max(u.abs()));
            for (axis, used) in used.into_iter().enumerate() {
                let sides = &mut self.jerks[interval];
                sides[0][axis] = if used.abs() > KEPT_SHARE * largest { Sides::BOTH } else { Sides::default() };
                sides[1][axis] = Sides::default();
            }
        }
    }
}

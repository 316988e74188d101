//! z and s̈ at the grid points: the iterate of the jerk-limited search.

use crate::planner::Profile;
use crate::planner::rows::Grid;

/// Steps of the line search, each of which reduces the interval to two thirds.
const LINE_SEARCH_STEPS: usize = 12;

/// z and s̈ at every grid point; both vanish at the ends.
#[derive(Clone, Debug)]
pub struct GridProfile {
    /// ṡ², 1/s².
    pub z: Vec<f64>,
    /// s̈, 1/s².
    pub acceleration: Vec<f64>,
}

impl GridProfile {
    /// Profile of least time between this one and `other`; its time is at most that of `other`.
    ///
    /// The time is convex in z, and convex combinations of feasible profiles of one programme are feasible.
    pub fn towards(&self, other: &Self, grid: &Grid) -> Self {
        let mix = |share: f64| {
            let blend = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect();
            Self { z: blend(&self.z, &other.z), acceleration: blend(&self.acceleration, &other.acceleration) }
        };
        if other.time(grid) <= self.time(grid) {
            return other.clone();
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..LINE_SEARCH_STEPS {
            let (left, right) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if mix(left).time(grid) < mix(right).time(grid) { high = right } else { low = left }
        }
        mix(0.5 * (low + high))
    }

    /// Piecewise z(s) between the grid points.
    pub fn interpolated(&self, grid: &Grid) -> Profile {
        let s: Vec<f64> = grid.points.iter().map(|x| x.point.s).collect();
        let of = if grid.eased { Profile::smooth } else { Profile::quadratic };
        of(&s, &self.z, &self.acceleration)
    }

    /// Time over the path, s: T = Σ 2h/(√z + √z₊), with 3h/√z over an interval with one end at rest.
    pub fn time(&self, grid: &Grid) -> f64 {
        let n = grid.intervals();
        let part = |i: usize| {
            let h = grid.length(i);
            match i {
                0 if !grid.eased => 3.0 * h / self.z[1].sqrt(),
                i if i + 1 == n && !grid.eased => 3.0 * h / self.z[i].sqrt(),
                i => 2.0 * h / (self.z[i].sqrt() + self.z[i + 1].sqrt()),
            }
        };
        (0..n).map(part).sum()
    }

    /// Whether z = zᵢ + 2bσ + cσ² vanishes within interval `i`.
    pub(super) fn vanishes_within(&self, grid: &Grid, i: usize) -> bool {
        let (h, b) = (grid.length(i), self.acceleration[i]);
        let c = (self.acceleration[i + 1] - b) / h;
        c > 0.0 && b < 0.0 && -b < c * h && self.z[i] * c <= b * b
    }

    /// ∂T/∂z at the moving grid points, s³.
    pub(super) fn gradient(&self, grid: &Grid) -> Vec<f64> {
        let n = grid.intervals();
        let side = |i: usize, interval: usize, other: usize| {
            let (h, root) = (grid.length(interval), self.z[i].sqrt());
            if !grid.eased && (interval == 0 || interval + 1 == n) {
                -1.5 * h / (root * self.z[i])
            } else {
                -h / ((root + self.z[other].sqrt()).powi(2) * root)
            }
        };
        grid.moving()
            .map(|i| {
                let before = if i > 0 { side(i, i - 1, i - 1) } else { 0.0 };
                let after = if i < n { side(i, i, i + 1) } else { 0.0 };
                before + after
            })
            .collect()
    }
}

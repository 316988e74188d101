//! z and s̈ at the grid points as scaled unknowns of a programme, and the equalities between them.

use super::jerk::GridProfile;
use super::programme::Programme;
use super::rows::Grid;

/// Unit of s̈ relative to the largest z per length of the path.
const ACCELERATION_SCALE: f64 = 4.0;

/// Columns and units of z and s̈ at the moving grid points: z in units of its value at the iterate, s̈ in the common
/// unit [`Unknowns::acceleration_unit`].
pub(super) struct Unknowns<'a> {
    grid: &'a Grid,
    at: &'a GridProfile,
    first: usize,
    /// Number of moving grid points.
    pub(super) count: usize,
    /// Unit of s̈, 1/s².
    pub(super) acceleration_unit: f64,
}

impl<'a> Unknowns<'a> {
    /// Unknowns scaled by the iterate `at`.
    pub(super) fn new(grid: &'a Grid, at: &'a GridProfile) -> Self {
        let moving = grid.moving();
        let length = grid.s(grid.intervals()) - grid.s(0);
        let unit: f64 = moving.clone().map(|i| at.z[i] / length).fold(0.0, f64::max);
        Self { grid, at, first: moving.start, count: moving.len(), acceleration_unit: ACCELERATION_SCALE * unit }
    }

    /// Position of grid point `i` among those that move.
    pub(super) fn position(&self, i: usize) -> usize {
        i - self.first
    }

    /// Column of z at grid point `i`.
    pub(super) fn z(&self, i: usize) -> usize {
        i - self.first
    }

    /// Column of s̈ at grid point `i`.
    pub(super) fn acceleration(&self, i: usize) -> usize {
        self.count + i - self.first
    }

    /// Unit of z at grid point `i`, 1/s².
    pub(super) fn z_unit(&self, i: usize) -> f64 {
        self.at.z[i]
    }

    /// Adds z₊ − z = h (s̈ + s̈₊) over every interval between moving points.
    pub(super) fn continuity(&self, programme: &mut Programme) {
        for i in self.grid.inner() {
            let (h, scale) = (self.grid.length(i), 1.0 / self.z_unit(i).max(self.z_unit(i + 1)));
            let step = -h * self.acceleration_unit * scale;
            let terms = [
                (self.z(i + 1), self.z_unit(i + 1) * scale),
                (self.z(i), -self.z_unit(i) * scale),
                (self.acceleration(i), step),
                (self.acceleration(i + 1), step),
            ];
            programme.row(&terms, 0.0);
        }
    }

    /// Adds the equalities at both ends of the path.
    ///
    /// At the ends of an eased path s̈ is indeterminate and set to that of the neighbour. Otherwise s ∝ t³ over the
    /// first and the last interval, which implies s̈ = ± 2z/3h at their moving ends.
    pub(super) fn ends(&self, programme: &mut Programme) {
        let n = self.grid.intervals();
        if self.grid.eased {
            programme.row(&[(self.acceleration(0), 1.0), (self.acceleration(1), -1.0)], 0.0);
            programme.row(&[(self.acceleration(n), 1.0), (self.acceleration(n - 1), -1.0)], 0.0);
        }
        for ramp in self.grid.ramps() {
            let i = ramp.neighbour;
            let ratio = -ramp.sign * 2.0 / 3.0 * self.z_unit(i) / (ramp.length * self.acceleration_unit);
            programme.row(&[(self.acceleration(i), 1.0), (self.z(i), ratio)], 0.0);
        }
    }

    /// z and s̈ at all grid points from a solution `x`; zero at the points at rest.
    pub(super) fn read(&self, x: &[f64]) -> GridProfile {
        let n = self.grid.intervals();
        let mut found = GridProfile { z: vec![0.0; n + 1], acceleration: vec![0.0; n + 1] };
        for i in self.grid.moving() {
            found.z[i] = x[self.z(i)] * self.z_unit(i);
            found.acceleration[i] = x[self.acceleration(i)] * self.acceleration_unit;
        }
        found
    }
}

//! Unknowns of the relaxation and their units.

use crate::planner::jerk::GridProfile;
use crate::planner::rows::{Grid, Ramp};
use crate::planner::unknowns::Unknowns;

/// Number of parts of an interval, each with its own time.
pub(super) const PARTS: usize = 2;

/// Columns in order: z, s̈ and roots ω of z at the moving grid points; times τ of the parts of the inner intervals,
/// roots μ of the mean z over them; times of the ramps. Units are the values of the iterate.
pub(super) struct Columns<'a> {
    grid: &'a Grid,
    /// z and s̈.
    pub(super) states: Unknowns<'a>,
    /// Intervals from and to rest.
    pub(super) ramps: Vec<Ramp>,
}

impl<'a> Columns<'a> {
    pub(super) fn new(grid: &'a Grid, at: &'a GridProfile) -> Self {
        Self { grid, states: Unknowns::new(grid, at), ramps: grid.ramps() }
    }

    /// Number of columns.
    pub(super) fn count(&self) -> usize {
        self.ramp(0) + self.ramps.len()
    }

    /// Column of the root ω of z at grid point `i`, in units of √z.
    pub(super) fn root(&self, i: usize) -> usize {
        2 * self.states.count + self.states.position(i)
    }

    /// Column of the time over a part of interval `i`.
    pub(super) fn time(&self, i: usize, part: usize) -> usize {
        3 * self.states.count + (i - self.grid.inner().start) * PARTS + part
    }

    /// Column of the root μ of the mean z over a part of interval `i`.
    pub(super) fn mean_root(&self, i: usize, part: usize) -> usize {
        self.time(i, part) + self.grid.inner().len() * PARTS
    }

    /// Column of the time over ramp `k`.
    pub(super) fn ramp(&self, k: usize) -> usize {
        3 * self.states.count + 2 * self.grid.inner().len() * PARTS + k
    }

    /// Mean of z over the ends of interval `i` at the iterate, 1/s².
    pub(super) fn middle(&self, i: usize) -> f64 {
        0.5 * (self.states.z_unit(i) + self.states.z_unit(i + 1))
    }

    /// Unit of the time over a part of interval `i`, s.
    pub(super) fn time_unit(&self, i: usize) -> f64 {
        self.grid.length(i) / (PARTS as f64 * self.middle(i).sqrt())
    }

    /// Unit of the time over a ramp, s.
    pub(super) fn ramp_unit(&self, ramp: &Ramp) -> f64 {
        3.0 * ramp.length / self.states.z_unit(ramp.neighbour).sqrt()
    }

    /// Columns of all times with their units, s.
    pub(super) fn times(&self) -> Vec<(usize, f64)> {
        let parts = |i: usize| (0..PARTS).map(move |part| (self.time(i, part), self.time_unit(i)));
        let ramps = self.ramps.iter().enumerate().map(|(k, ramp)| (self.ramp(k), self.ramp_unit(ramp)));
        self.grid.inner().flat_map(parts).chain(ramps).collect()
    }

    /// Terms of a control point z, z + b h or z₊ of the parabola z over interval `i`.
    pub(super) fn control(&self, i: usize, point: usize) -> [(usize, f64); 2] {
        let states = &self.states;
        match point {
            0 => [(states.z(i), states.z_unit(i)), (states.acceleration(i), 0.0)],
            1 => [
                (states.z(i), states.z_unit(i)),
                (states.acceleration(i), self.grid.length(i) * states.acceleration_unit),
            ],
            _ => [(states.z(i + 1), states.z_unit(i + 1)), (states.acceleration(i), 0.0)],
        }
    }

    /// Factors of b₀ and b₁ − b₀ in the mean of z − z₀ = 2 b₀ σ + (b₁ − b₀) σ²/h over a part of interval `i`.
    pub(super) fn mean(&self, i: usize, part: usize) -> [f64; 2] {
        let h = self.grid.length(i);
        let [from, to] = [part, part + 1].map(|k| k as f64 / PARTS as f64);
        [h * (from + to), h * (from * from + from * to + to * to) / 3.0]
    }
}

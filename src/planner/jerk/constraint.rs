//! The jerk limits of the drives at the grid points.

use super::GridProfile;
use crate::machine::{PerAxis, every_axis};
use crate::planner::limits::Limits;
use crate::planner::rows::{Grid, GridPoint, Ramp, Tightening};

/// Constraints of a jerk-limited search: rows at the grid points, jerk limits, and the usable share of both.
#[derive(Clone, Copy)]
pub struct Constraints<'a> {
    /// Rows of loads and accelerations, and caps on z by the speeds.
    pub grid: &'a Grid,
    /// Limits, of which the drives' jerks in rad/s³ are used.
    pub limits: &'a Limits,
    /// Usable share of every limit.
    pub tightening: &'a Tightening,
}

/// A drive at one end of an interval.
#[derive(Clone, Copy)]
pub(super) struct JerkPlace {
    /// Interval.
    pub(super) interval: usize,
    /// Grid point at the start or the end of the interval.
    pub(super) grid_point: usize,
    /// Drive.
    pub(super) axis: usize,
}

impl Constraints<'_> {
    /// Signed use of the jerk limit of a drive by `profile` at one end of an interval.
    pub(super) fn jerk_use(&self, profile: &GridProfile, place: JerkPlace) -> f64 {
        let JerkPlace { interval, grid_point, axis } = place;
        let slope = (profile.acceleration[interval + 1] - profile.acceleration[interval]) / self.grid.length(interval);
        let [third, second, first] = jerk_row(&self.grid.points[grid_point], self.limits, axis);
        let value = third * profile.z[grid_point] + second * profile.acceleration[grid_point] + first * slope;
        value * profile.z[grid_point].sqrt() / self.tightening.jerk[grid_point][axis]
    }
}

/// (q‴, 3 q″, q′) of a drive in units of its jerk limit, s³.
pub(in crate::planner) fn jerk_row(grid_point: &GridPoint, limits: &Limits, axis: usize) -> [f64; 3] {
    let [_, q1, q2, q3] = grid_point.point.q.map(|q| q[axis]);
    [q3, 3.0 * q2, q1].map(|v| v / limits.jerk[axis])
}

/// Largest z at an end of an eased path, 1/s²: with q′ = q″ = 0 a drive's jerk is q‴ z^(3/2), so z = (J/q‴)^(2/3).
pub(in crate::planner) fn cap_at_rest(grid_point: &GridPoint, limits: &Limits) -> f64 {
    let third = every_axis().map(|axis| jerk_row(grid_point, limits, axis)[0].abs()).fold(0.0, f64::max);
    third.powf(-2.0 / 3.0)
}

/// Largest z at the moving end of each ramp of `grid`, 1/s², for the usable shares of the jerk limits.
pub(in crate::planner) fn ramp_caps(grid: &Grid, limits: &Limits, share: &[PerAxis<f64>]) -> Vec<f64> {
    let cap = |ramp: Ramp| {
        let at = |axis: usize| (share[ramp.neighbour][axis] / ramp_use(grid, limits, ramp, axis)).powf(2.0 / 3.0);
        every_axis().map(at).fold(f64::INFINITY, f64::min)
    };
    grid.ramps().into_iter().map(cap).collect()
}

/// Use of the jerk limit of a drive over a ramp, per z^(3/2).
///
/// With constant s⃛ the jerk over the limit is |q‴ + 2 q″/h + 2 q′/9h²| at the moving end and |2 q′/9h²| at rest.
fn ramp_use(grid: &Grid, limits: &Limits, ramp: Ramp, axis: usize) -> f64 {
    let Ramp { rest, neighbour, length: h, sign } = ramp;
    let [third, second, first] = jerk_row(&grid.points[neighbour], limits, axis);
    let moving = (third + sign * second * 2.0 / (3.0 * h) + first * 2.0 / (9.0 * h * h)).abs();
    moving.max((jerk_row(&grid.points[rest], limits, axis)[2] * 2.0 / (9.0 * h * h)).abs())
}

/// First iterate: z without jerk limits, reduced near the ends, and s̈ = 0.
///
/// Constant s⃛ at the jerk limit gives z = (9/2)^(2/3) s⃛^(2/3) s^(4/3) from rest; an eased path has z = (J/q‴)^(2/3)
/// there.
pub(super) fn first_iterate(grid: &Grid, limits: &Limits, unlimited: &[f64]) -> GridProfile {
    let n = grid.intervals();
    let acceleration = vec![0.0; n + 1];
    if grid.eased {
        let cap = cap_at_rest(&grid.points[0], limits).min(cap_at_rest(&grid.points[n], limits));
        return GridProfile { z: unlimited.iter().map(|z| z.min(cap)).collect(), acceleration };
    }
    let end = |i: usize| {
        let jerk =
            every_axis().map(|k| 1.0 / jerk_row(&grid.points[i], limits, k)[2].abs()).fold(f64::INFINITY, f64::min);
        (4.5 * jerk).powf(2.0 / 3.0)
    };
    let (start, stop) = (end(0), end(n));
    let four_thirds = |x: f64| x.cbrt().powi(4);
    let z = (0..=n)
        .map(|i| {
            let [departure, arrival] = [grid.s(i) - grid.s(0), grid.s(n) - grid.s(i)];
            unlimited[i].min(start * four_thirds(departure)).min(stop * four_thirds(arrival))
        })
        .collect();
    GridProfile { z, acceleration }
}

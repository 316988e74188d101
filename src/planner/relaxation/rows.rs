//! Inequalities and cones of the relaxation.

use super::{PARTS, Range, Relaxation};
use crate::machine::{each, every_axis};
use crate::planner::jerk::{cap_at_rest, jerk_row, ramp_caps};
use crate::planner::programme::Programme;

impl Relaxation<'_> {
    /// Adds the bounds on z, ω ≥ z/√u and the rows of loads, speeds and accelerations, point by point.
    pub(super) fn load_rows(&self, programme: &mut Programme) {
        let (grid, states) = (&self.sequence.grid, &self.columns.states);
        let n = grid.intervals();
        for (i, cap) in grid.moving().zip(self.caps()) {
            let (z, acceleration, root) = (states.z(i), states.acceleration(i), self.columns.root(i));
            let z_unit = states.z_unit(i);
            programme.row(&[(z, z_unit / cap)], 1.0);
            programme.row(&[(z, (z_unit / cap).sqrt()), (root, -1.0)], 0.0);
            // At rest the rows of loads are constant.
            let rows = if i == 0 || i == n { &[] } else { grid.points[i].rows.as_slice() };
            for (r, row) in rows.iter().enumerate() {
                for sign in self.sequence.active.load_signs(i, r) {
                    let terms = [
                        (acceleration, sign * row.a * states.acceleration_unit),
                        (z, sign * row.b * z_unit),
                        (root, sign * row.d * z_unit.sqrt()),
                    ];
                    programme.row(&terms, 1.0 - sign * row.c);
                }
            }
        }
    }

    /// Upper bounds u on z at the moving grid points, 1/s².
    fn caps(&self) -> Vec<f64> {
        let (grid, limits) = (&self.sequence.grid, self.limits);
        let n = grid.intervals();
        let ramp_caps = ramp_caps(grid, limits, &vec![each(1.0); n + 1]);
        let cap = |i: usize| {
            let mut cap = grid.points[i].cap.min(self.above[i]);
            if grid.eased && (i == 0 || i == n) {
                cap = cap.min(cap_at_rest(&grid.points[i], limits));
            }
            let ramps = self.columns.ramps.iter().zip(&ramp_caps).filter(|(ramp, _)| ramp.neighbour == i);
            ramps.fold(cap, |cap, (_, ramp_cap)| cap.min(*ramp_cap))
        };
        grid.moving().map(cap).collect()
    }

    /// Adds |q̈₊ − q̈| ≤ J τ over every interval, with q̈ = 0 at rest; accelerations are divided by the drives' jerk
    /// limits.
    pub(super) fn jerk_rows(&self, programme: &mut Programme) {
        let (grid, limits, columns) = (&self.sequence.grid, self.limits, &self.columns);
        let states = &columns.states;
        for axis in every_axis().filter(|&k| limits.jerk[k].is_finite()) {
            let acceleration = |i: usize, sign: f64| {
                let [_, second, first] = jerk_row(&grid.points[i], limits, axis);
                [
                    (states.z(i), sign * second / 3.0 * states.z_unit(i)),
                    (states.acceleration(i), sign * first * states.acceleration_unit),
                ]
            };
            for sign in [1.0, -1.0] {
                for i in grid.inner() {
                    let unit = columns.time_unit(i);
                    let mut terms = [acceleration(i, -sign), acceleration(i + 1, sign)].concat();
                    terms.extend((0..PARTS).map(|part| (columns.time(i, part), -unit)));
                    programme.scaled_row(&terms, unit);
                }
                for (k, ramp) in columns.ramps.iter().enumerate() {
                    let unit = columns.ramp_unit(ramp);
                    let mut terms = acceleration(ramp.neighbour, sign).to_vec();
                    terms.push((columns.ramp(k), -unit));
                    programme.scaled_row(&terms, unit);
                }
            }
        }
    }

    /// Adds the ranges of z and the chords above the times, interval by interval.
    pub(super) fn range_rows(&self, programme: &mut Programme) {
        let columns = &self.columns;
        for i in self.sequence.grid.inner() {
            let unit = columns.states.z_unit(i);
            for (point, [low, high]) in self.ranges[i].into_iter().enumerate() {
                for (sign, side) in [(-1.0, low), (1.0, high)] {
                    if side > 0.0 && side.is_finite() {
                        let terms = columns.control(i, point).map(|(column, value)| (column, sign * value / unit));
                        programme.row(&terms, sign * side / unit);
                    }
                }
            }
            self.chord(programme, i, &self.ranges[i]);
        }
    }

    /// Adds Σ τ ≤ h (chord of z^(−1/2) over the range) at the mean z̄ = z₀ + (2 b₀ + b₁) h/3, if the range is
    /// bounded.
    fn chord(&self, programme: &mut Programme, i: usize, range: &Range) {
        let (columns, states) = (&self.columns, &self.columns.states);
        let low = range.iter().fold(f64::INFINITY, |m, r| m.min(r[0]));
        let high = range.iter().fold(0.0f64, |m, r| m.max(r[1]));
        if !(low > 0.0 && high.is_finite() && high > low) {
            return;
        }
        let h = self.sequence.grid.length(i);
        let slope = (high.sqrt().recip() - low.sqrt().recip()) / (high - low);
        let offset = low.sqrt().recip() - slope * low;
        let unit = PARTS as f64 * columns.time_unit(i);
        let bend = -h * slope * states.acceleration_unit * h / 3.0;
        let mut terms = vec![
            (states.z(i), -h * slope * states.z_unit(i) / unit),
            (states.acceleration(i), 2.0 * bend / unit),
            (states.acceleration(i + 1), bend / unit),
        ];
        terms.extend((0..PARTS).map(|part| (columns.time(i, part), columns.time_unit(i) / unit)));
        programme.row(&terms, h * offset / unit);
    }

    /// Adds Σ τ ≤ `longest`, s, if that is finite.
    pub(super) fn time_row(&self, programme: &mut Programme, longest: f64) {
        if longest.is_finite() {
            let times = self.columns.times();
            let terms: Vec<_> = times.into_iter().map(|(column, time)| (column, time / longest)).collect();
            programme.row(&terms, 1.0);
        }
    }

    /// Adds ω² ≤ z; μ² ≤ z̄ and τ μ ≥ h over the parts of the intervals; τ ω ≥ 3h over the ramps.
    pub(super) fn cone_rows(&self, programme: &mut Programme) {
        let (grid, columns) = (&self.sequence.grid, &self.columns);
        let states = &columns.states;
        for i in grid.moving() {
            programme.square(&[(states.z(i), 1.0)], columns.root(i));
        }
        for i in grid.inner() {
            let middle = columns.middle(i);
            for part in 0..PARTS {
                let [line, bend] = columns.mean(i, part).map(|v| v * states.acceleration_unit / middle);
                let mean = [
                    (states.z(i), states.z_unit(i) / middle),
                    (states.acceleration(i), line - bend),
                    (states.acceleration(i + 1), bend),
                ];
                programme.square(&mean, columns.mean_root(i, part));
                programme.product(columns.time(i, part), columns.mean_root(i, part));
            }
        }
        for (k, ramp) in columns.ramps.iter().enumerate() {
            programme.product(columns.ramp(k), columns.root(ramp.neighbour));
        }
    }
}

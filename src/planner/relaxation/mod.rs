//! Lower bound on the time of every jerk-limited motion on a grid, by a convex relaxation.
//!
//! A drive's acceleration changes over an interval by at most its jerk limit times the time τ spent there, |q̈ᵢ₊₁ −
//! q̈ᵢ| ≤ J τᵢ, and q̈ = q″ z + q′ s̈ is linear in z and s̈. By Jensen's inequality τ ≥ h z̄^(−1/2), with z̄ the mean
//! of z, also linear in z and s̈. With τ as a separate variable both constraints and the objective Σ τ are convex.
//! The relaxation permits τ above the time implied by z, which permits more jerk at the cost of the full τ; where
//! this does not reduce Σ τ, the relaxation is exact. No least speed is assumed.
//!
//! Friction D √z uses a variable ω for the root, z/√u ≤ ω ≤ √z with z ≤ u; rows of loads, speeds and accelerations
//! hold at the grid points. The bound covers motions with s̈ linear in s over every interval, with s ∝ t³ at both
//! ends of the path.
//!
//! Where τ exceeds the time implied by z, the bound can be tightened ([`tightened`]): minimising and maximising z
//! within the relaxation gives the range of z of all motions at least as fast as the plan; over this range h z^(−1/2)
//! lies below its chord, which bounds τ from above.

mod columns;
mod rows;

use super::jerk::Sequence;
use super::limits::Limits;
use super::programme::{Programme, normalise};
use crate::numerics::parallel;
use columns::{Columns, PARTS};

/// Largest number of rounds of tightening.
const MAX_ROUNDS: usize = 8;
/// Ratio of τ to the time implied by z in an interval, from which the range of z is tightened.
const TRADED_TIME: f64 = 1.001;
/// Least gain of a round, relative to the time, for another round to follow.
const LEAST_GAIN: f64 = 2e-4;
/// Tolerance of the solver in units of z, by which ranges of z are widened.
const SOLVER_TOLERANCE: f64 = 1e-6;

/// Lower bound on the time of all motions on the grid of `sequence` within its limits, s; `None` if the solver finds
/// none.
///
/// Variables are scaled by the iterate of the sequence, and of the load rows only the active ones are included;
/// `above` is an upper bound on z at every grid point, 1/s².
pub fn bound(sequence: &Sequence, limits: &Limits, above: &[f64]) -> Option<f64> {
    Relaxation::new(sequence, limits, above).solve(Goal::Time, f64::INFINITY).map(|found| found.bound)
}

/// Lower bound as [`bound`], tightened by ranges of z until its relative gap to the time of the iterate is at most
/// `gap` or a round gains less than 2e-4 of the time.
pub fn tightened(sequence: &Sequence, limits: &Limits, above: &[f64], gap: f64) -> Option<f64> {
    let mut relaxation = Relaxation::new(sequence, limits, above);
    let time = sequence.profile().time();
    let mut found = relaxation.solve(Goal::Time, f64::INFINITY)?;
    for _ in 0..MAX_ROUNDS {
        if time - found.bound <= gap * time {
            break;
        }
        relaxation.confine(&found, time);
        let next = relaxation.solve(Goal::Time, f64::INFINITY)?;
        let gain = next.bound - found.bound;
        found = next;
        if gain < LEAST_GAIN * time {
            break;
        }
    }
    Some(found.bound)
}

/// Objective to be minimised.
#[derive(Clone, Copy)]
enum Goal {
    /// The time.
    Time,
    /// A control point of the parabola z over an interval, multiplied by the sign.
    Point { interval: usize, point: usize, sign: f64 },
}

/// Optimum of the relaxation.
struct Optimum {
    /// Lower bound on its value by the dual, s, or in units of z at the interval's start.
    bound: f64,
    /// Ratio of τ to the time implied by z, per interval; zero for both ramps.
    traded: Vec<f64>,
}

/// Least and largest value of the three control points of the parabola z over an interval, 1/s²; z lies between them.
type Range = [[f64; 2]; 3];

struct Relaxation<'a> {
    sequence: &'a Sequence,
    limits: &'a Limits,
    above: &'a [f64],
    columns: Columns<'a>,
    /// One range per interval.
    ranges: Vec<Range>,
}

impl<'a> Relaxation<'a> {
    fn new(sequence: &'a Sequence, limits: &'a Limits, above: &'a [f64]) -> Self {
        let ranges = vec![[[0.0, f64::INFINITY]; 3]; sequence.grid.intervals()];
        Self { sequence, limits, above, columns: Columns::new(&sequence.grid, &sequence.at), ranges }
    }

    /// Tightens the ranges of z for motions of at most `time`, in the intervals where `found` has τ above the time
    /// implied by z.
    fn confine(&mut self, found: &Optimum, time: f64) {
        let inner = self.sequence.grid.inner();
        let traded: Vec<usize> = inner.filter(|&i| found.traded[i] > TRADED_TIME).collect();
        let ranges = parallel::map(traded.len(), |k| self.range(traded[k], time));
        for (i, range) in traded.into_iter().zip(ranges) {
            self.ranges[i] = range;
        }
    }

    /// Ranges of the control points over interval `i` for motions of at most `time`, s.
    fn range(&self, i: usize, time: f64) -> Range {
        let unit = self.sequence.at.z[i];
        std::array::from_fn(|point| {
            let [low, high] = self.ranges[i][point];
            let bound = |sign: f64| {
                self.solve(Goal::Point { interval: i, point, sign }, time).map(|found| sign * found.bound * unit)
            };
            let least = bound(1.0).map_or(low, |z| low.max(z - SOLVER_TOLERANCE * unit));
            let largest = bound(-1.0).map_or(high, |z| high.min(z + SOLVER_TOLERANCE * unit));
            [least, largest]
        })
    }

    /// Optimum among the motions of at most `longest`, s.
    fn solve(&self, goal: Goal, longest: f64) -> Option<Optimum> {
        let mut programme = Programme::default();
        self.columns.states.continuity(&mut programme);
        self.columns.states.ends(&mut programme);
        let equalities = programme.len();
        self.load_rows(&mut programme);
        self.jerk_rows(&mut programme);
        self.range_rows(&mut programme);
        self.time_row(&mut programme, longest);
        let inequalities = programme.len();
        self.cone_rows(&mut programme);
        let mut cost = self.cost(goal);
        let scale = normalise(&mut cost);
        let solution = programme.solve(&cost, equalities, inequalities)?;
        Some(Optimum { bound: solution.obj_val_dual / scale, traded: self.traded(&solution.x) })
    }

    /// Cost vector of the objective.
    fn cost(&self, goal: Goal) -> Vec<f64> {
        let columns = &self.columns;
        let mut cost = vec![0.0; columns.count()];
        match goal {
            Goal::Time => columns.times().into_iter().for_each(|(column, time)| cost[column] = time),
            Goal::Point { interval, point, sign } => {
                for (column, value) in columns.control(interval, point) {
                    cost[column] = sign * value / columns.states.z_unit(interval);
                }
            }
        }
        cost
    }

    /// Ratio of τ to the time implied by z, per interval, for a solution `x`.
    fn traded(&self, x: &[f64]) -> Vec<f64> {
        let (grid, columns) = (&self.sequence.grid, &self.columns);
        let states = &columns.states;
        let mut traded = vec![0.0; grid.intervals()];
        for i in grid.inner() {
            let needed = |part: usize| {
                let [line, bend] = columns.mean(i, part);
                let accelerations = [i, i + 1].map(|k| x[states.acceleration(k)]);
                let z = x[states.z(i)] * states.z_unit(i)
                    + ((line - bend) * accelerations[0] + bend * accelerations[1]) * states.acceleration_unit;
                (columns.middle(i) / z).sqrt()
            };
            let taken = x[columns.time(i, 0)] + x[columns.time(i, 1)];
            traded[i] = taken / (needed(0) + needed(1));
        }
        traded
    }
}

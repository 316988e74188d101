//! A lower bound on the time of every motion along a grid with jerk limits, by a convex relaxation.
//!
//! A drive's acceleration changes over an interval by no more than its jerk limit times the time τ spent there,
//! |q̈ᵢ₊₁ − q̈ᵢ| ≤ J τᵢ, and q̈ = q″ z + q′ s̈ is linear in z and s̈. By Jensen's inequality τ ≥ h z̄^(−1/2), where z̄ is the mean of z,
//! linear in z and s̈ as well. With τ as a variable of its own both are convex, and so is Σ τ: the relaxation is that τ may be
//! larger than the time that z takes, which permits more jerk and costs the full τ; where that does not reduce Σ τ the
//! relaxation is exact. No least speed is assumed anywhere.
//!
//! Friction D √z takes a variable ω for the root, z/√u ≤ ω ≤ √z with z ≤ u; rows of loads, speeds and accelerations hold at the
//! grid points. The motions are those whose s̈ is linear in s over every interval, with s ∝ t³ at both ends of the path.
//!
//! Where time is traded for jerk, the bound can be tightened ([`tightened`]): minimising and maximising z within the relaxation finds
//! the range of z of all motions that take no longer than the plan; over it h z^(−1/2) lies below its chord, and so must τ.

mod columns;
mod rows;

use rayon::prelude::*;

use super::jerk::Sequence;
use super::limits::Limits;
use super::programme::{Programme, normalise};
use columns::{Columns, PARTS};

/// Rounds of tightening at most.
const MAX_ROUNDS: usize = 8;
/// Time in an interval over the time that z takes there, from which the range of z is tightened.
const TRADED_TIME: f64 = 1.001;
/// Least gain of a round, relative to the time, after which there is another one.
const LEAST_GAIN: f64 = 2e-4;
/// Tolerance of the solver, by which ranges of z are widened, in units of z.
const SOLVER_TOLERANCE: f64 = 1e-6;

/// Lower bound on the time of all motions on the grid of `sequence` within its limits, s; `None` if the solver finds none.
///
/// Variables are scaled by the iterate of the sequence, and of the loads its active rows enter; `above` is an upper bound on z
/// at every grid point, 1/s².
pub fn bound(sequence: &Sequence, limits: &Limits, above: &[f64]) -> Option<f64> {
    Relaxation::new(sequence, limits, above).solve(Goal::Time, f64::INFINITY).map(|found| found.bound)
}

/// The same bound, tightened by ranges of z until its gap to the time of the iterate is below `gap`, relative, or a round gains less than 2e-4 of the time.
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

/// The objective, which is minimised.
#[derive(Clone, Copy)]
enum Goal {
    /// The time.
    Time,
    /// A control point of the parabola z over an interval, times the sign.
    Point { interval: usize, point: usize, sign: f64 },
}

/// An optimum of the relaxation.
struct Optimum {
    /// Lower bound on its value by the dual, s, or in units of z at the interval's start.
    bound: f64,
    /// Time over the time that z takes, per interval; zero for both ramps.
    traded: Vec<f64>,
}

/// Least and largest value of the three control points of the parabola z over an interval, 1/s²; z lies between them.
type Range = [[f64; 2]; 3];

struct Relaxation<'a> {
    sequence: &'a Sequence,
    limits: &'a Limits,
    above: &'a [f64],
    columns: Columns<'a>,
    /// Per interval.
    ranges: Vec<Range>,
}

impl<'a> Relaxation<'a> {
    fn new(sequence: &'a Sequence, limits: &'a Limits, above: &'a [f64]) -> Self {
        let ranges = vec![[[0.0, f64::INFINITY]; 3]; sequence.grid.intervals()];
        Self { sequence, limits, above, columns: Columns::new(&sequence.grid, &sequence.at), ranges }
    }

    /// Tightens the ranges of z, for motions that take no longer than `time`, where `found` trades time for jerk.
    fn confine(&mut self, found: &Optimum, time: f64) {
        let inner = self.sequence.grid.inner();
        let traded: Vec<usize> = inner.filter(|&i| found.traded[i] > TRADED_TIME).collect();
        let ranges: Vec<_> = traded.into_par_iter().map(|i| (i, self.range(i, time))).collect();
        for (i, range) in ranges {
            self.ranges[i] = range;
        }
    }

    /// Ranges of the control points over interval `i` for motions that take no longer than `time`.
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

    /// The optimum among the motions that take no longer than `longest`, s.
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

    /// Coefficients of the objective.
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

    /// Time over the time that z takes, per interval, of a solution `x`.
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

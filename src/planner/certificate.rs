//! Lower bound on the time of any motion within the limits, without jerk limits.
//!
//! Over an interval of length h, a row of a feasible motion satisfies on average ⟨a s̈⟩ + ⟨b z⟩ + ⟨c⟩ ≤ 1. With the
//! means of a, b and c, the exact ⟨s̈⟩ = Δz/2h, and z̄ of the straight line between the ends, it reads a s̈ + b z̄ +
//! c ≤ 1 + ε with ε = ¼|Δa| U + ½(|b| + |Δb|) h U plus terms of the second differences of a, b and c. Δ is the change
//! over the interval, U bounds |s̈|, and h U bounds the deviation of z from the straight line. The samples of every
//! feasible motion therefore satisfy the rows with the right-hand side 1 + ε, and the passes with these rows give a
//! z(s) above all of them. Force laws are linearised at the plan; means and second differences are taken from the
//! ends and the middle of each interval (Simpson's rule).

use super::coefficients::{Machine, Reference};
use super::grid::graded;
use super::limits::Limits;
use super::pass::relaxed;
use super::rows::Grid;
use super::{Curve, PlanError, Profile};

/// Number of intervals of the relaxation.
const INTERVALS: usize = 16_000;

/// Upper bound on z(s) of every feasible motion, without jerk limits.
pub struct UpperBound {
    s: Vec<f64>,
    /// z at the ends of the intervals, and the largest possible excess of z between them, 1/s².
    z: Vec<f64>,
    margin: Vec<f64>,
    /// Time over the path at this z, s: a lower bound on the time of every motion.
    pub time: f64,
}

impl UpperBound {
    /// Upper bound on z at `s`, 1/s².
    pub fn at(&self, s: f64) -> f64 {
        let i = self.s.partition_point(|&x| x <= s).clamp(1, self.margin.len()) - 1;
        let part = (s - self.s[i]) / (self.s[i + 1] - self.s[i]);
        self.z[i] + part * (self.z[i + 1] - self.z[i]) + self.margin[i]
    }
}

/// Upper bound on z(s), without jerk limits; force laws are linearised along `plan`.
///
/// # Errors
///
/// [`PlanError::Place`] where the robot cannot follow the path.
pub fn upper_bound(machine: &Machine, curve: &Curve, limits: &Limits, plan: &Profile) -> Result<UpperBound, PlanError> {
    let s = graded(plan, curve, INTERVALS);
    // Alternating ends and middles of all intervals.
    let middles = s.windows(2).map(|w| 0.5 * (w[0] + w[1]));
    let mut all: Vec<f64> = s.iter().copied().zip(middles).flat_map(|(end, middle)| [end, middle]).collect();
    all.push(curve.end());
    let mut grid = Grid::new(machine, curve, limits, &all)?;
    let references: Vec<Reference> = all
        .iter()
        .map(|s| {
            // At rest the law is linearised at the speed of the neighbouring place.
            let pace = plan.pace(s.clamp(all[1], all[all.len() - 2]));
            Reference { speed: pace.z.sqrt().max(1e-6), acceleration: pace.acceleration }
        })
        .collect();
    grid.load(machine, limits, &references)?;
    let (z, margin) = relaxed(&grid);
    let part = |i: usize| 2.0 * (s[i + 1] - s[i]) / ((z[i] + margin[i]).sqrt() + (z[i + 1] + margin[i]).sqrt());
    let time = (0..INTERVALS).map(part).sum();
    Ok(UpperBound { s, z, margin, time })
}

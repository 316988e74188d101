//! A lower bound on the time of any motion within the limits, jerk limits left aside.
//!
//! Over an interval of length h, a row of a feasible motion is on average ⟨a s̈⟩ + ⟨b z⟩ + ⟨c⟩ ≤ 1. With the means of a, b
//! and c, with ⟨s̈⟩ = Δz/2h exactly and z̄ that of the straight line between the ends, it reads a s̈ + b z̄ + c ≤ 1 + ε,
//! ε = ¼|Δa| U + ½(|b| + |Δb|) h U and the bends of a, b, c: Δ is the change over the interval, U bounds |s̈|, and h U is the
//! most by which z departs from the straight line. So the samples of every feasible motion satisfy the rows with 1 + ε of
//! room, and the passes with these rows find a z(s) above all of them. Force laws are linearised at the plan; means and bends
//! are Simpson's from ends and middle.

use super::coefficients::{Machine, Reference};
use super::limits::Limits;
use super::pass::{Passes, relaxed};
use super::plan::graded;
use super::rows::Stations;
use super::{Curve, PlanError, Profile};

/// Intervals of the relaxation.
const INTERVALS: usize = 16_000;

/// Lower bound on the time, s; `passes` is the plan without jerk limits on `grid`.
pub fn bound(
    machine: &Machine,
    curve: &Curve,
    limits: &Limits,
    passes: &Passes,
    grid: &[f64],
) -> Result<f64, PlanError> {
    let profile = Profile::linear(grid, &passes.z);
    let ends = graded(&profile, INTERVALS);
    // Ends and middles of all intervals in turn.
    let middles = ends.windows(2).map(|w| 0.5 * (w[0] + w[1]));
    let mut all: Vec<f64> = ends.iter().copied().zip(middles).flat_map(|(end, middle)| [end, middle]).collect();
    all.push(curve.end());
    let mut stations = Stations::new(machine, curve, limits, &all)?;
    let references: Vec<Reference> = all
        .iter()
        .map(|s| {
            // At the ends of the path the robot is just leaving or arriving.
            let pace = profile.pace(s.clamp(all[1], all[all.len() - 2]));
            Reference { speed: pace.z.sqrt().max(1e-6), acceleration: pace.acceleration }
        })
        .collect();
    stations.load(machine, limits, &references)?;
    let (z, margin) = relaxed(&stations);
    let time = |i: usize| 2.0 * (ends[i + 1] - ends[i]) / ((z[i] + margin[i]).sqrt() + (z[i + 1] + margin[i]).sqrt());
    Ok((0..INTERVALS).map(time).sum())
}

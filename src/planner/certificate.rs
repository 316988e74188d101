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
use super::rows::Stations;
use super::{Curve, PlanError, Profile};

/// Intervals of the relaxation per interval of the plan; [`LEAST`] to [`MOST`] in all.
const FINER: usize = 4;
const LEAST: usize = 4000;
const MOST: usize = 20_000;

/// Lower bound on the time, s; `passes` is the plan without jerk limits on `grid`.
pub fn bound(
    machine: &Machine,
    curve: &Curve,
    limits: &Limits,
    passes: &Passes,
    grid: &[f64],
) -> Result<f64, PlanError> {
    let profile = Profile::linear(grid, &passes.z);
    let n = (FINER * (grid.len() - 1)).clamp(LEAST, MOST);
    let end = curve.end();
    // Ends and middles of all intervals in turn.
    let all: Vec<f64> = (0..=2 * n).map(|k| end * k as f64 / (2 * n) as f64).collect();
    let mut stations = Stations::new(machine, curve, limits, &all)?;
    let references: Vec<Reference> = all
        .iter()
        .map(|s| {
            // At the ends of the path the robot is just leaving or arriving.
            let pace = profile.pace(s.clamp(all[1], all[2 * n - 1]));
            Reference { speed: pace.z.sqrt().max(1e-6), acceleration: pace.acceleration }
        })
        .collect();
    stations.load(machine, limits, &references)?;
    let (z, margin) = relaxed(&stations);
    let h = end / n as f64;
    Ok((0..n).map(|i| 2.0 * h / ((z[i] + margin[i]).sqrt() + (z[i + 1] + margin[i]).sqrt())).sum())
}

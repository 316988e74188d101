//! Time-optimal z(s) with jerk limits: a sequence of linear programmes, each an inner approximation.
//!
//! s̈ is linear in s over an interval, s̈ = b + cσ, so z = ṡ² is quadratic and s⃛ = c √z. A drive's jerk (40) is then
//! √z (q‴ z + 3 q″ s̈ + q′ c), and its limit J reads |q‴ z + 3 q″ s̈ + q′ c| ≤ J/√z. The right side is convex in z
//! and its tangent at the last iterate lies below it, so the optimum of the programme is feasible. The last iterate
//! is feasible in the programme, so the time cannot increase. At both ends of the path s⃛ is constant over the
//! interval, s ∝ t³, which makes z₁ and s̈₁ proportional.
//!
//! T = Σ 2h/(√zᵢ + √zᵢ₊₁) is convex in z. The objective is its linearisation at the last iterate, so the optimum of a
//! programme gives the lower bound T ≥ T(z) + ∇T·(z* − z) on the time of all profiles that satisfy its rows.

mod active_set;
mod constraint;
mod grid_profile;
mod linear;

pub use active_set::ActiveSet;
pub use constraint::Constraints;
pub(super) use constraint::{cap_at_rest, jerk_row, ramp_caps};
pub use grid_profile::GridProfile;
pub use linear::{Step, step};

use super::limits::Limits;
use super::rows::{Grid, Tightening};
use super::{Objective, PlanError, Profile};

/// Relative gap between time and lower bound at which the programmes have converged.
pub const SETTLED: f64 = 1e-4;
/// Largest number of programmes.
const MAX_PROGRAMMES: usize = 40;
/// Largest number of programmes without a solution; each is followed by one about a slower iterate.
const MAX_SLOWDOWNS: usize = 5;
/// Factor on z and s̈ of the slower iterate.
const SLOWDOWN: f64 = 0.25;
/// Largest number of programmes about one iterate, each with the rows that its predecessor violated.
const MAX_REPEATS: usize = 6;

/// Work of a sequence of programmes until convergence.
#[derive(Clone, Copy, Default)]
pub struct Settled {
    /// Programmes solved.
    pub programmes: usize,
    /// Iterations of the solver in those with a solution.
    pub iterations: usize,
}

/// Linear programmes on one grid, each about the optimum of the previous one.
pub struct Sequence {
    /// Rows at the grid points.
    pub grid: Grid,
    /// Usable share of every limit.
    pub tightening: Tightening,
    /// Rows that are in the programmes.
    pub active: ActiveSet,
    /// The iterate: the optimum of the last programme.
    pub at: GridProfile,
    /// Lower bound on the time within the rows of the last programme, s.
    pub bound: f64,
    /// Whether `at` is close to a motion that satisfies all rows.
    near_feasible: bool,
}

impl Sequence {
    /// Sequence started at `unlimited`, z without jerk limits, reduced near the ends of the path.
    pub fn begin(grid: Grid, limits: &Limits, unlimited: &[f64]) -> Self {
        let tightening = Tightening::none(grid.points.len());
        let near = GridProfile { z: unlimited.to_vec(), acceleration: vec![0.0; unlimited.len()] };
        let active = ActiveSet::new(Constraints { grid: &grid, limits, tightening: &tightening }, &near);
        let at = constraint::first_iterate(&grid, limits, unlimited);
        Self { grid, tightening, active, at, bound: f64::NEG_INFINITY, near_feasible: false }
    }

    /// Sequence started at `at`, a profile close to the optimum.
    pub fn near(grid: Grid, limits: &Limits, at: GridProfile) -> Self {
        let tightening = Tightening::none(grid.points.len());
        let constraints = Constraints { grid: &grid, limits, tightening: &tightening };
        let mut active = ActiveSet::new(constraints, &at);
        active.prune(constraints, &at);
        Self { grid, tightening, active, at, bound: f64::NEG_INFINITY, near_feasible: true }
    }

    /// Motion of the last programme.
    pub fn profile(&self) -> Profile {
        self.at.interpolated(&self.grid)
    }

    /// Constraints of the programmes.
    pub fn constraints<'a>(&'a self, limits: &'a Limits) -> Constraints<'a> {
        Constraints { grid: &self.grid, limits, tightening: &self.tightening }
    }

    /// Work until convergence: the gap between time and lower bound, or with
    /// [`Objective::Speed`] the change of the time, is below `settled` relative to the time.
    ///
    /// Before each programme `reload` linearises the force laws in the rows at the iterate.
    ///
    /// # Errors
    ///
    /// [`PlanError::Unsolved`] if programmes about slower and slower iterates have no solution, and the errors of
    /// `reload`.
    pub fn settle(
        &mut self,
        limits: &Limits,
        objective: Objective,
        settled: f64,
        mut reload: impl FnMut(&mut Grid, &GridProfile) -> Result<(), PlanError>,
    ) -> Result<Settled, PlanError> {
        let (mut feasible, mut slowdowns, mut repeats) = (false, 0, 0);
        let mut work = Settled::default();
        while work.programmes < MAX_PROGRAMMES {
            work.programmes += 1;
            reload(&mut self.grid, &self.at)?;
            let before = self.at.time(&self.grid);
            let Some(step) = step(self.constraints(limits), &self.active, &self.at, objective) else {
                if slowdowns == MAX_SLOWDOWNS {
                    return Err(PlanError::Unsolved);
                }
                slowdowns += 1;
                self.slow_down();
                continue;
            };
            work.iterations += step.iterations;
            let next = match objective {
                Objective::Time if feasible => self.at.towards(&step.profile, &self.grid),
                _ => step.profile,
            };
            let constraints = Constraints { grid: &self.grid, limits, tightening: &self.tightening };
            let broken = self.active.update(constraints, &next);
            if broken && self.near_feasible && repeats < MAX_REPEATS {
                repeats += 1;
                continue;
            }
            repeats = 0;
            feasible = !broken;
            self.near_feasible |= feasible;
            (self.at, self.bound) = (next, step.bound);
            let time = self.at.time(&self.grid);
            let change = match objective {
                Objective::Time => (time - self.bound).abs(),
                Objective::Speed => (time - before).abs(),
            };
            if feasible && change < settled * time {
                if !self.active.update_dips(&self.grid, &self.at) {
                    return Ok(work);
                }
                // The profile found is no motion, so a convex combination with it is not feasible.
                feasible = false;
            }
            if work.programmes == 1 && !self.near_feasible {
                self.active.prune(Constraints { grid: &self.grid, limits, tightening: &self.tightening }, &self.at);
            }
        }
        Ok(work)
    }

    /// Reduces the speed of the iterate: about a slower motion the tangents of the jerk limits are less restrictive.
    fn slow_down(&mut self) {
        self.at.z.iter_mut().for_each(|z| *z *= SLOWDOWN);
        self.at.acceleration.iter_mut().for_each(|a| *a *= SLOWDOWN);
    }
}

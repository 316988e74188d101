//! Time-optimal z(s) with jerk limits: a sequence of linear programmes, each an inner approximation.
//!
//! s̈ is linear in s over an interval, s̈ = b + cσ, so z = ṡ² is quadratic and s⃛ = c √z. A drive's jerk (40) is then
//! √z (q‴ z + 3 q″ s̈ + q′ c), and its limit J reads |q‴ z + 3 q″ s̈ + q′ c| ≤ J/√z. The right side is convex in z: its tangent
//! at the last iterate lies below it everywhere, so the optimum of the programme is feasible, and the last iterate is feasible
//! in the programme: the time cannot grow. At both ends of the path s⃛ is constant over the first interval, s ∝ t³, which
//! makes z₁ and s̈₁ proportional.
//!
//! T = Σ 2h/(√zᵢ + √zᵢ₊₁) is convex in z. Its linearisation at the last iterate is the objective, so the optimum of a
//! programme bounds the time of everything its rows allow from below: T ≥ T(z) + ∇T·(z* − z).

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
use super::rows::{Grid, Slack};
use super::{Objective, PlanError, Profile};

/// Change of the time, relative, at which programmes have settled.
pub const SETTLED: f64 = 1e-4;
/// Programmes at most.
const MAX_PROGRAMMES: usize = 40;
/// Programmes without a solution, each followed by one about a slower iterate, at most.
const MAX_SLOWDOWNS: usize = 5;
/// z and s̈ of the slower iterate over those before.
const SLOWDOWN: f64 = 0.25;
/// Programmes about one iterate, each with the rows that its predecessor broke, at most.
const MAX_REPEATS: usize = 6;

/// What a sequence cost until it settled.
#[derive(Clone, Copy, Default)]
pub struct Settled {
    /// Programmes solved.
    pub programmes: usize,
    /// Iterations of the solver in those that have a solution.
    pub iterations: usize,
}

/// Linear programmes on one grid, each about the optimum of the last one.
pub struct Sequence {
    /// Rows at the grid points.
    pub grid: Grid,
    /// Share of every limit that may be used.
    pub slack: Slack,
    /// Rows that are in the programmes.
    pub active: ActiveSet,
    /// The iterate: the optimum of the last programme.
    pub at: GridProfile,
    /// Lower bound on the time within the last programme's rows, s.
    pub bound: f64,
    /// Whether `at` is near a motion that keeps all rows.
    near_feasible: bool,
}

impl Sequence {
    /// A sequence that starts at `unlimited`, z without jerk limits, made slower near the ends of the path.
    pub fn begin(grid: Grid, limits: &Limits, unlimited: &[f64]) -> Self {
        let slack = Slack::full(grid.points.len());
        let near = GridProfile { z: unlimited.to_vec(), acceleration: vec![0.0; unlimited.len()] };
        let active = ActiveSet::new(Constraints { grid: &grid, limits, slack: &slack }, &near);
        let at = constraint::first_iterate(&grid, limits, unlimited);
        Self { grid, slack, active, at, bound: f64::NEG_INFINITY, near_feasible: false }
    }

    /// A sequence that starts at `at`, which is near the optimum.
    pub fn near(grid: Grid, limits: &Limits, at: GridProfile) -> Self {
        let slack = Slack::full(grid.points.len());
        let constraints = Constraints { grid: &grid, limits, slack: &slack };
        let mut active = ActiveSet::new(constraints, &at);
        active.prune(constraints, &at);
        Self { grid, slack, active, at, bound: f64::NEG_INFINITY, near_feasible: true }
    }

    /// Motion of the last programme.
    pub fn profile(&self) -> Profile {
        self.at.interpolated(&self.grid)
    }

    /// Constraints of the programmes.
    pub fn constraints<'a>(&'a self, limits: &'a Limits) -> Constraints<'a> {
        Constraints { grid: &self.grid, limits, slack: &self.slack }
    }

    /// The work done until the time changed by no more than `settled`, relative.
    ///
    /// `reload` linearises the force laws in the rows at the iterate before each programme.
    ///
    /// # Errors
    ///
    /// [`PlanError::Unsolved`] if programmes about slower and slower iterates have no solution, and what `reload` returns.
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
            let constraints = Constraints { grid: &self.grid, limits, slack: &self.slack };
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
                // What was found is no motion, and nothing lies between it and one.
                feasible = false;
            }
            if work.programmes == 1 && !self.near_feasible {
                self.active.prune(Constraints { grid: &self.grid, limits, slack: &self.slack }, &self.at);
            }
        }
        Ok(work)
    }

    /// Makes the iterate slower: about a slower motion the tangents of the jerk limits are less tight.
    fn slow_down(&mut self) {
        self.at.z.iter_mut().for_each(|z| *z *= SLOWDOWN);
        self.at.acceleration.iter_mut().for_each(|a| *a *= SLOWDOWN);
    }
}

//! From a path and limits to a checked motion.

use std::collections::BTreeMap;

use super::coefficients::Machine;
use super::grid::even;
use super::limits::{Limit, Limits};
use super::search::Search;
use super::verify::{self, CHECKED, Use};
use super::{Curve, Objective, PlanError, Profile};

/// Options of the search.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Intervals of the path.
    pub intervals: usize,
    /// What is optimised.
    pub objective: Objective,
    /// Whether bounds on the time are computed; they cost more than the plan.
    pub certify: bool,
    /// Whether the bound with jerk limits is tightened until its gap is [`TIGHTENED_GAP`] or no longer shrinks, which takes seconds.
    pub tighten: bool,
    /// Whether intervals are split where no limit is reached, see [`refine`](super::refine).
    pub refine: bool,
    /// Seconds since some fixed instant, from which [`Plan::solve_s`] and [`Plan::verify_s`] come; they are zero by default.
    pub clock: fn() -> f64,
}

/// Gap of the bound with jerk limits at which it is no further tightened.
pub const TIGHTENED_GAP: f64 = 5e-3;

impl Default for Options {
    fn default() -> Self {
        Self {
            intervals: 200,
            objective: Objective::default(),
            certify: true,
            tighten: false,
            refine: true,
            clock: || 0.0,
        }
    }
}

/// A motion along a path that keeps its limits.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The path over the parameter of `profile`: s, or with jerk limits x, see [`Curve::eased`].
    pub curve: Curve,
    /// z over the parameter.
    pub profile: Profile,
    /// Time over the path, s.
    pub time: f64,
    /// No motion along the path is faster, jerk limits left aside, s; zero if not asked for.
    pub bound: f64,
    /// With jerk limits: no motion whose ẍ is linear over the plan's intervals is faster, s.
    pub outer_bound: Option<f64>,
    /// With jerk limits: no motion that the last programme allows is faster, s. Jerk limits are their tangents at the plan
    /// there, so a small gap shows that the search has converged, not that its optimum is global.
    pub search_bound: Option<f64>,
    /// With jerk limits: time on an ever finer grid, s, extrapolated: what is left to gain is about what the last split gained.
    pub estimate: Option<f64>,
    /// Time without jerk limits, s.
    pub time_without_jerk: f64,
    /// Maximum velocity curve without jerk limits: s and largest z.
    pub mvc: Vec<[f64; 2]>,
    /// Use of the limits on a grid ten times finer or more.
    pub uses: Vec<Use>,
    /// Time of the search, s.
    pub solve_s: f64,
    /// Time of the check, s.
    pub verify_s: f64,
    /// Passes or programmes solved.
    pub iterations: usize,
    /// Iterations of the interior-point solver in the programmes of the search; zero without jerk limits.
    pub solver_iterations: usize,
}

/// Largest use of a limit by a plan.
pub const ALLOWED_USE: f64 = 1.001;
/// Path speed at which loads count as those of rest, in lengths of the path per second.
const CREEPING_SPEED: f64 = 0.05;
/// Intervals over those asked for, up to which they are doubled where a limit cannot be kept.
const MAX_REFINEMENT: usize = 4;
/// Use from which a limit counts as active.
const ACTIVE_USE: f64 = 0.998;

/// The fastest motion along `curve` from rest to rest within `limits`, checked against the full model.
///
/// # Errors
///
/// [`PlanError`] says where the path or the limits leave no motion, or that none was found.
pub fn plan(machine: &Machine, curve: &Curve, limits: &Limits, options: &Options) -> Result<Plan, PlanError> {
    let mut search = Search::new(machine, curve, limits, options);
    search.at_rest(&[0.0, curve.end()], 0.0, ALLOWED_USE)?;
    match finer(&mut search, curve, options) {
        // Of a hundred paths one has a motion that the programmes do not find over the eased parameter.
        Err(error) if limits.has_jerk() && is_of_the_search(&error) => {
            finer(&mut Search::over_length(machine, curve, limits, options), curve, options).map_err(|_| error)
        }
        answer => answer,
    }
}

/// The plan on the first of finer and finer grids that has a motion.
fn finer(search: &mut Search, curve: &Curve, options: &Options) -> Result<Plan, PlanError> {
    let mut intervals = options.intervals;
    loop {
        match search.run(intervals) {
            Err(error) if is_of_the_search(&error) => {
                if intervals >= MAX_REFINEMENT * options.intervals {
                    let places = even(curve, options.intervals);
                    return search.at_rest(&places, CREEPING_SPEED * curve.end(), 1.0).and(Err(error));
                }
                intervals *= 2;
            }
            answer => return answer,
        }
    }
}

/// Whether another grid may have a motion.
fn is_of_the_search(error: &PlanError) -> bool {
    matches!(error, PlanError::Violated { .. } | PlanError::Unsolved | PlanError::Stuck { .. })
}

impl Plan {
    /// By how much the plan is slower than what may be possible along the path, relative to its time.
    ///
    /// Without jerk limits that is [`Plan::bound`]. With them it is an estimate: the lower one of [`Plan::outer_bound`], which
    /// holds on the plan's intervals, and [`Plan::estimate`], what finer ones would give.
    pub fn optimality_gap(&self) -> f64 {
        let possible = match (self.outer_bound, self.estimate) {
            (None, None) => self.bound,
            (a, b) => a.unwrap_or(f64::INFINITY).min(b.unwrap_or(f64::INFINITY)),
        };
        1.0 - possible / self.time
    }

    /// s and z = ṡ² at a place of the check.
    pub fn speed(&self, at: &Use) -> [f64; 2] {
        let [s, g1, ..] = self.curve.way(at.s);
        let x = at.s - self.profile.s[at.interval];
        [s, self.profile.at(at.interval, x).z * g1 * g1]
    }

    /// Largest use of each limit.
    pub fn worst(&self) -> BTreeMap<Limit, f64> {
        let mut worst = BTreeMap::new();
        for u in &self.uses {
            for (k, ratio) in u.ratio.iter().enumerate() {
                let entry = worst.entry(verify::checked(k)).or_insert(0.0);
                *entry = f64::max(*entry, *ratio);
            }
        }
        worst
    }

    /// Limits that are reached and where, in stretches of s.
    pub fn active(&self) -> Vec<(Limit, [f64; 2])> {
        let mut out: Vec<(Limit, [f64; 2])> = Vec::new();
        for k in 0..CHECKED {
            let mut last: Option<usize> = None;
            for (i, u) in self.uses.iter().enumerate().filter(|(_, u)| u.ratio[k] > ACTIVE_USE) {
                match (last, out.last_mut()) {
                    (Some(j), Some((_, stretch))) if self.uses[i].interval - self.uses[j].interval <= 2 => {
                        stretch[1] = u.s
                    }
                    _ => out.push((verify::checked(k), [u.s, u.s])),
                }
                last = Some(i);
            }
        }
        for stretch in out.iter_mut().flat_map(|(_, stretch)| stretch) {
            *stretch = self.curve.way(*stretch)[0];
        }
        out.sort_by(|a, b| a.1[0].total_cmp(&b.1[0]));
        out
    }
}

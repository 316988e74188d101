//! Planning: from a path and limits to a checked motion.

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
    /// Number of intervals of the path.
    pub intervals: usize,
    /// Objective of the optimisation.
    pub objective: Objective,
    /// Whether bounds on the time are computed; they take longer than the plan.
    pub certify: bool,
    /// Whether the bound with jerk limits is tightened until its gap is [`TIGHTENED_GAP`] or stops shrinking, which
    /// takes seconds.
    pub tighten: bool,
    /// Whether intervals are split where no limit is reached, see [`refine`](super::refine).
    pub refine: bool,
    /// Seconds since a fixed instant, for [`Plan::solve_s`] and [`Plan::verify_s`]; constant zero by default.
    pub clock: fn() -> f64,
}

/// Relative gap of the bound with jerk limits at which tightening stops.
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

/// Motion along a path within its limits.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The path over the parameter of `profile`: s, or with jerk limits x, see [`Curve::eased`].
    pub curve: Curve,
    /// z over the parameter, 1/s².
    pub profile: Profile,
    /// Time over the path, s.
    pub time: f64,
    /// Lower bound on the time of every motion along the path, without jerk limits, s; zero if not requested.
    pub bound: f64,
    /// With jerk limits: lower bound on the time of every motion with ẍ linear over the plan's intervals, s.
    pub outer_bound: Option<f64>,
    /// With jerk limits: lower bound on the time of every motion within the last programme, s. The programme replaces
    /// the jerk limits by their tangents at the plan, so a small gap shows convergence of the search, not global
    /// optimality.
    pub search_bound: Option<f64>,
    /// With jerk limits: extrapolated time on an infinitely fine grid, s; the remaining gain is about that of the
    /// last split.
    pub estimate: Option<f64>,
    /// Time without jerk limits, s.
    pub time_without_jerk: f64,
    /// Maximum velocity curve without jerk limits: s and largest z.
    pub mvc: Vec<[f64; 2]>,
    /// Use of the limits on a grid at least ten times finer.
    pub uses: Vec<Use>,
    /// Time of the search, s.
    pub solve_s: f64,
    /// Time of the check, s.
    pub verify_s: f64,
    /// Number of passes or programmes solved.
    pub iterations: usize,
    /// Iterations of the interior-point solver in the programmes of the search; zero without jerk limits.
    pub solver_iterations: usize,
}

/// Largest use of a limit that a plan may have.
pub const ALLOWED_USE: f64 = 1.001;
/// Path speed at which loads count as those at rest, in lengths of the path per second.
const CREEPING_SPEED: f64 = 0.05;
/// Largest factor on the requested number of intervals, which is doubled where a limit cannot be satisfied.
const MAX_REFINEMENT: usize = 4;
/// Use from which a limit counts as active.
const ACTIVE_USE: f64 = 0.998;

/// Fastest motion along `curve` from rest to rest within `limits`, checked against the full model.
///
/// # Errors
///
/// [`PlanError`] states where the path or the limits permit no motion, or that none was found.
pub fn plan(machine: &Machine, curve: &Curve, limits: &Limits, options: &Options) -> Result<Plan, PlanError> {
    let mut search = Search::new(machine, curve, limits, options);
    search.at_rest(&[0.0, curve.end()], 0.0, ALLOWED_USE)?;
    match finer(&mut search, curve, options) {
        // For about one path in a hundred the programmes find no motion over the eased parameter.
        Err(error) if limits.has_jerk() && is_of_the_search(&error) => {
            finer(&mut Search::over_length(machine, curve, limits, options), curve, options).map_err(|_| error)
        }
        answer => answer,
    }
}

/// Plan on the coarsest grid, of repeatedly doubled size, on which a motion is found.
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

/// Whether another grid may permit a motion.
fn is_of_the_search(error: &PlanError) -> bool {
    matches!(error, PlanError::Violated { .. } | PlanError::Unsolved | PlanError::Stuck { .. })
}

impl Plan {
    /// Excess of the plan's time over its lower bound or estimate, relative to the plan's time.
    ///
    /// Without jerk limits the bound is [`Plan::bound`]. With jerk limits the gap is an estimate: it refers to the
    /// smaller of [`Plan::outer_bound`], which is valid on the plan's intervals, and [`Plan::estimate`], the
    /// extrapolation to finer ones.
    pub fn optimality_gap(&self) -> f64 {
        let possible = match (self.outer_bound, self.estimate) {
            (None, None) => self.bound,
            (a, b) => a.unwrap_or(f64::INFINITY).min(b.unwrap_or(f64::INFINITY)),
        };
        1.0 - possible / self.time
    }

    /// s and z = ṡ² (1/s²) at a place of the check.
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

    /// Active limits and the ranges of s in which they are reached.
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

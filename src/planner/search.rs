//! Search for the fastest motion: first without jerk limits, then with them on successively finer grids; each result
//! is checked against the full model.

use super::accept::{accept, tighten};
use super::certificate::UpperBound;
use super::coefficients::Machine;
use super::grid::{even, graded};
use super::jerk::{self, Sequence};
use super::limits::{DYNAMIC, Limit, Limits};
use super::linearise::{references, references_of_passes, reparametrised, resampled};
use super::pass::{self, Passes, Stuck};
use super::plan::{Options, Plan, TIGHTENED_GAP};
use super::rows::{Grid, Tightening};
use super::verify::{self, Use};
use super::{Curve, Objective, PathPoint, PlaceError, PlanError, Profile, certificate, refine, relaxation};

/// Least number of checked places per interval, and over the whole path in the last check.
const PLACES_PER_INTERVAL: usize = 10;
const PLACES_IN_ALL: usize = 4000;
/// Largest number of rounds of tightening exceeded limits.
const MAX_TIGHTENINGS: usize = 12;
/// Ratio of z to that of the fastest motion below which a motion counts as at rest.
const REST_SHARE: f64 = 1e-3;
/// Largest number of rounds of splitting, and largest number of intervals after them.
const MAX_SPLITS: usize = 6;
const MAX_INTERVALS: usize = 1000;
/// Relative gap between time and lower bound at which programmes on a coarse grid have converged.
const COARSE_SETTLED: f64 = 2e-3;
/// Number of intervals of the coarsest programme with jerk limits, and refinement factor from one grid to the next.
const COARSEST: usize = 50;
const REFINEMENT: usize = 4;
/// Largest number of solutions for one set of limits, each with force laws linearised at the previous one.
const MAX_LINEARISATIONS: usize = 30;
/// Relative change of z at which linearisations without jerk limits have converged.
const SETTLED: f64 = 1e-6;
/// Reference speeds relative to those of the last motion: factor after a failure, and share below which it is not
/// applied.
const SLOWDOWN: f64 = 0.25;
const LEAST_SPEED_SHARE: f64 = 1e-4;

/// A checked motion and its bounds.
struct Found {
    profile: Profile,
    uses: Vec<Use>,
    outer_bound: Option<f64>,
    search_bound: Option<f64>,
    estimate: Option<f64>,
}

/// A motion that can be solved again with smaller usable shares.
trait Solver {
    fn profile(&self) -> Profile;

    fn tightening(&mut self) -> &mut Tightening;

    /// Solves again; the last motion is kept on an error.
    fn solve(&mut self, search: &mut Search) -> Result<(), PlanError>;
}

/// The passes without jerk limits on one grid.
struct Unlimited {
    places: Vec<f64>,
    grid: Grid,
    tightening: Tightening,
    passes: Passes,
}

impl Solver for Unlimited {
    fn profile(&self) -> Profile {
        Profile::linear(&self.places, &self.passes.z)
    }

    fn tightening(&mut self) -> &mut Tightening {
        &mut self.tightening
    }

    fn solve(&mut self, search: &mut Search) -> Result<(), PlanError> {
        self.passes = search.passes(&mut self.grid, &self.tightening, Some(&self.passes))?;
        Ok(())
    }
}

impl Solver for Sequence {
    fn profile(&self) -> Profile {
        self.profile()
    }

    fn tightening(&mut self) -> &mut Tightening {
        &mut self.tightening
    }

    fn solve(&mut self, search: &mut Search) -> Result<(), PlanError> {
        let last = (self.at.clone(), self.bound);
        let solved = search.settle(self, search.options.objective, jerk::SETTLED);
        if solved.is_err() {
            (self.at, self.bound) = last;
        }
        solved
    }
}

/// Search along one path within one set of limits.
pub(super) struct Search<'a> {
    machine: &'a Machine<'a>,
    curve: &'a Curve,
    /// The path over the parameter of the jerk-limited search.
    eased: Curve,
    limits: &'a Limits,
    options: &'a Options,
    solve_s: f64,
    verify_s: f64,
    iterations: usize,
    solver_iterations: usize,
}

impl<'a> Search<'a> {
    /// Search for jerk-limited motions over the eased parameter of the path.
    pub(super) fn new(machine: &'a Machine<'a>, curve: &'a Curve, limits: &'a Limits, options: &'a Options) -> Self {
        let eased = curve.clone().eased();
        Self {
            machine,
            curve,
            eased,
            limits,
            options,
            solve_s: 0.0,
            verify_s: 0.0,
            iterations: 0,
            solver_iterations: 0,
        }
    }

    /// Search for jerk-limited motions over the length of the path.
    pub(super) fn over_length(
        machine: &'a Machine<'a>,
        curve: &'a Curve,
        limits: &'a Limits,
        options: &'a Options,
    ) -> Self {
        Self { eased: curve.clone(), ..Self::new(machine, curve, limits, options) }
    }

    /// Plan on about as many intervals, or more where they are split.
    ///
    /// # Errors
    ///
    /// Reason why the path is impossible, or that no motion was found on this grid.
    pub(super) fn run(&mut self, intervals: usize) -> Result<Plan, PlanError> {
        let mut unlimited = self.unlimited(even(self.curve, intervals))?;
        let has_jerk = self.limits.has_jerk();
        let uses = if has_jerk { None } else { Some(self.verified(self.curve, &mut unlimited)?) };
        let profile = unlimited.profile();
        let time_without_jerk = profile.time();
        let above = self.upper_bound(&profile)?;
        let found = match uses {
            Some(uses) => Found { profile, uses, outer_bound: None, search_bound: None, estimate: None },
            None => self
                .with_jerk(&profile, above.as_ref(), unlimited.grid.intervals())
                .map_err(|e| e.along(&self.eased))?,
        };
        Ok(Plan {
            curve: if has_jerk { self.eased.clone() } else { self.curve.clone() },
            time: found.profile.time(),
            profile: found.profile,
            bound: above.map_or(0.0, |above| above.time),
            outer_bound: found.outer_bound,
            search_bound: found.search_bound,
            estimate: found.estimate,
            time_without_jerk,
            mvc: unlimited.places.iter().zip(&unlimited.passes.mvc).map(|(s, z)| [*s, *z]).collect(),
            uses: found.uses,
            solve_s: self.solve_s,
            verify_s: self.verify_s,
            iterations: self.iterations,
            solver_iterations: self.solver_iterations,
        })
    }

    /// The fastest motion without jerk limits on a grid, not yet checked.
    fn unlimited(&mut self, places: Vec<f64>) -> Result<Unlimited, PlanError> {
        self.timed(|search| {
            let mut grid = Grid::new(search.machine, search.curve, search.limits, &places)?;
            let tightening = Tightening::none(places.len());
            let passes = search.passes(&mut grid, &tightening, None)?;
            Ok(Unlimited { places, grid, tightening, passes })
        })
    }

    /// Fastest motion with jerk limits, started at the one without them.
    fn with_jerk(
        &mut self,
        unlimited: &Profile,
        above: Option<&UpperBound>,
        intervals: usize,
    ) -> Result<Found, PlanError> {
        let coarse = self.coarse_to_fine(unlimited, intervals)?;
        let (mut sequence, change) = self.refined(coarse, intervals)?;
        if self.options.objective == Objective::Speed {
            self.maximise_speed(&mut sequence)?;
        }
        let uses = self.verified(&self.eased.clone(), &mut sequence)?;
        let profile = sequence.profile();
        Ok(Found {
            outer_bound: above.and_then(|above| self.outer_bound(&sequence, above)),
            search_bound: self.search_bound(&sequence),
            estimate: change.map(|change| profile.time() * (1.0 - change)),
            profile,
            uses,
        })
    }

    /// Uses of the limits by the motion of `solver`, which is solved with smaller usable shares until no limit is exceeded.
    ///
    /// The last check is finer; where there is no motion with smaller usable shares, the last one is accepted or rejected.
    fn verified(&mut self, curve: &Curve, solver: &mut impl Solver) -> Result<Vec<Use>, PlanError> {
        let (mut round, mut fine) = (0, false);
        loop {
            let uses = self.check(curve, &solver.profile(), fine)?;
            let done = !tighten(&uses, solver.tightening()) || round == MAX_TIGHTENINGS;
            match (done, fine) {
                (true, true) => return accept(uses),
                (true, false) => fine = true,
                (false, _) => {
                    round += 1;
                    if self.timed(|search| solver.solve(search)).is_err() {
                        (fine, round) = (true, MAX_TIGHTENINGS);
                    }
                }
            }
        }
    }

    /// Fastest motion on a grid of `intervals`, found on successively finer grids.
    fn coarse_to_fine(&mut self, unlimited: &Profile, intervals: usize) -> Result<Sequence, PlanError> {
        let mut sizes = vec![intervals];
        while sizes[0] >= COARSEST * REFINEMENT {
            sizes.insert(0, (sizes[0] / REFINEMENT).max(COARSEST));
        }
        let settled = |level: usize| if level + 1 == sizes.len() { jerk::SETTLED } else { COARSE_SETTLED };
        let mut sequence = self.first_sequence(unlimited, &even(&self.eased, sizes[0]), settled(0))?;
        for (level, &size) in sizes.iter().enumerate().skip(1) {
            let profile = sequence.profile();
            sequence = self.next_sequence(&profile, &graded(&profile, &self.eased, size), settled(level))?;
        }
        Ok(sequence)
    }

    /// Fastest motion on a sufficiently fine grid, and the relative change of its time by the last split.
    fn refined(&mut self, mut sequence: Sequence, intervals: usize) -> Result<(Sequence, Option<f64>), PlanError> {
        let mut change = None;
        for _ in 0..if self.options.refine { MAX_SPLITS } else { 0 } {
            let profile = sequence.profile();
            let uses = self.check(&self.eased.clone(), &profile, false)?;
            let idle = refine::idle(&profile, &uses);
            let wanted = 2 * idle.len();
            let largest = MAX_INTERVALS.max(intervals).min(wanted);
            sequence = self.next_sequence(&profile, &refine::split(&profile, &idle, largest), jerk::SETTLED)?;
            let gained = (profile.time() / sequence.profile().time() - 1.0).abs();
            change = Some(gained);
            if gained < refine::SETTLED || largest < wanted {
                break;
            }
        }
        Ok((sequence, change))
    }

    /// Maximises ∫ ṡ² ds, started at the fastest motion.
    fn maximise_speed(&mut self, sequence: &mut Sequence) -> Result<(), PlanError> {
        let fastest = sequence.at.z.clone();
        self.timed(|search| search.settle(sequence, Objective::Speed, jerk::SETTLED))?;
        let rests = |i: &usize| sequence.at.z[*i] < REST_SHARE * fastest[*i];
        match sequence.grid.moving().find(rests) {
            Some(i) => Err(PlanError::Rests { s: sequence.grid.s(i) }),
            None => Ok(()),
        }
    }

    /// Programmes at `places` until convergence, started below `unlimited`, a motion over s without jerk limits.
    fn first_sequence(&mut self, unlimited: &Profile, places: &[f64], settled: f64) -> Result<Sequence, PlanError> {
        self.timed(|search| {
            let near = reparametrised(unlimited, &search.eased, places);
            let mut grid = Grid::new(search.machine, &search.eased, search.limits, places)?;
            grid.load(search.machine, search.limits, &references(&near))?;
            let mut sequence = Sequence::begin(grid, search.limits, &near.z);
            search.settle(&mut sequence, Objective::Time, settled)?;
            Ok(sequence)
        })
    }

    /// Programmes at `places` until convergence, started at the motion `profile` with jerk limits.
    fn next_sequence(&mut self, profile: &Profile, places: &[f64], settled: f64) -> Result<Sequence, PlanError> {
        self.timed(|search| {
            let near = resampled(profile, places);
            let mut grid = Grid::new(search.machine, &search.eased, search.limits, places)?;
            grid.load(search.machine, search.limits, &references(&near))?;
            let mut sequence = Sequence::near(grid, search.limits, near);
            search.settle(&mut sequence, Objective::Time, settled)?;
            Ok(sequence)
        })
    }

    /// Programmes until convergence, with force laws linearised at the result of each.
    fn settle(&mut self, sequence: &mut Sequence, objective: Objective, settled: f64) -> Result<(), PlanError> {
        let (machine, limits) = (self.machine, self.limits);
        let work =
            sequence.settle(limits, objective, settled, |grid, at| grid.load(machine, limits, &references(at)))?;
        self.iterations += work.programmes;
        self.solver_iterations += work.iterations;
        Ok(())
    }

    /// Passes until the force laws are linearised at their result; viscous friction is linear everywhere.
    ///
    /// Tangents of other laws at speed may permit no motion at rest, so the reference speeds are reduced until the
    /// first passes succeed.
    fn passes(&mut self, grid: &mut Grid, tightening: &Tightening, from: Option<&Passes>) -> Result<Passes, PlanError> {
        let mut found = match from {
            Some(found) => found.clone(),
            None => pass::solve(grid, tightening).map_err(|e| stuck(e, grid))?,
        };
        let (mut speed_share, mut solved) = (1.0, 0);
        while solved < MAX_LINEARISATIONS {
            let mut references = references_of_passes(&found);
            references.iter_mut().for_each(|r| r.speed *= speed_share);
            grid.load(self.machine, self.limits, &references)?;
            self.iterations += 1;
            let next = match pass::solve(grid, tightening) {
                Ok(next) => next,
                Err(_) if solved > 0 => break,
                Err(_) if speed_share > LEAST_SPEED_SHARE => {
                    speed_share *= SLOWDOWN;
                    continue;
                }
                Err(e) => return Err(stuck(e, grid)),
            };
            let apart = |(a, b): (&f64, &f64)| (a - b).abs() / (a + b).max(f64::MIN_POSITIVE);
            let change = next.z.iter().zip(&found.z).map(apart).fold(0.0, f64::max);
            found = next;
            solved += 1;
            if change < SETTLED && speed_share == 1.0 && (solved > 1 || from.is_some()) {
                break;
            }
            speed_share = 1.0;
        }
        Ok(found)
    }

    /// Upper bound on z without jerk limits, if bounds are requested.
    fn upper_bound(&self, profile: &Profile) -> Result<Option<UpperBound>, PlanError> {
        match self.options.certify {
            true => certificate::upper_bound(self.machine, self.curve, self.limits, profile).map(Some),
            false => Ok(None),
        }
    }

    /// Lower bound on the time of all motions within the rows of the last programme, s.
    fn search_bound(&self, sequence: &Sequence) -> Option<f64> {
        if self.options.objective == Objective::Time {
            return Some(sequence.bound);
        }
        jerk::step(sequence.constraints(self.limits), &sequence.active, &sequence.at, Objective::Time)
            .map(|step| step.bound)
    }

    /// Lower bound on the time of all motions on the grid of the last programme, s.
    fn outer_bound(&self, sequence: &Sequence, above: &UpperBound) -> Option<f64> {
        let largest = |i: usize| {
            let [s, g1, ..] = self.eased.way(sequence.grid.s(i));
            above.at(s) / (g1 * g1)
        };
        let above: Vec<f64> = (0..sequence.grid.points.len()).map(largest).collect();
        match self.options.tighten {
            true => relaxation::tightened(sequence, self.limits, &above, TIGHTENED_GAP),
            false => relaxation::bound(sequence, self.limits, &above),
        }
    }

    /// Uses of the limits on a grid ten times finer, or with `fine` at about [`PLACES_IN_ALL`] places if that is
    /// more.
    fn check(&mut self, curve: &Curve, profile: &Profile, fine: bool) -> Result<Vec<Use>, PlanError> {
        if profile.stalls() {
            return Err(PlanError::Unsolved);
        }
        let start = (self.options.clock)();
        let in_all = if fine { PLACES_IN_ALL / profile.pieces.len() } else { 0 };
        let uses = verify::uses(self.machine, curve, self.limits, profile, PLACES_PER_INTERVAL.max(in_all))?;
        self.verify_s += (self.options.clock)() - start;
        Ok(uses)
    }

    /// Error of the largest excess of a load at rest, or at the speed `creeping` along the path.
    ///
    /// # Errors
    ///
    /// [`PlanError::AtRest`] if a load at one of the `places` exceeds `allowed` times the usable value.
    pub(super) fn at_rest(&self, places: &[f64], creeping: f64, allowed: f64) -> Result<(), PlanError> {
        let usable = self.limits.usable();
        let geometry = &self.machine.plant().geometry;
        let mut worst: Option<(f64, PlanError)> = None;
        for &s in places {
            let place = |e| PlanError::Place { s, at: self.curve.at(s)[0].into(), reason: PlaceError::Pose(e) };
            let point = PathPoint::new(geometry, self.curve, s).map_err(place)?;
            for speed in [0.0, creeping] {
                let loads = self.machine.loads(&point.motion(geometry, speed, 0.0)).map_err(place)?;
                for (k, value) in loads.into_iter().enumerate() {
                    let usable = usable[DYNAMIC + k];
                    let used = value.abs() / usable;
                    if used > allowed && worst.as_ref().is_none_or(|w| used > w.0) {
                        let limit = Limit::affine(DYNAMIC + k);
                        let machine = self.machine.plant().mechanism;
                        worst = Some((used, PlanError::AtRest { limit, s, value, usable, machine }));
                    }
                }
            }
        }
        worst.map_or(Ok(()), |w| Err(w.1))
    }

    /// Result of `solve`, whose duration is added to that of the search.
    fn timed<T>(&mut self, solve: impl FnOnce(&mut Self) -> T) -> T {
        let start = (self.options.clock)();
        let solved = solve(self);
        self.solve_s += (self.options.clock)() - start;
        solved
    }
}

fn stuck(stuck: Stuck, grid: &Grid) -> PlanError {
    PlanError::Stuck { s: grid.s(stuck.grid_point) }
}

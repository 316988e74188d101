//! The search for the fastest motion: without jerk limits, then with them on finer and finer grids, checked in the end.

use super::accept::{accept, tighten};
use super::certificate::Above;
use super::coefficients::{Machine, Reference};
use super::grid::{even, graded};
use super::jerk::{self, Course, Sequence};
use super::limits::{Limit, Limits};
use super::pass::{self, Passes, Stuck};
use super::plan::{ENOUGH, Options, Plan};
use super::rows::{Room, Stations};
use super::verify::{self, Use};
use super::{Curve, Objective, PathPoint, PlaceError, PlanError, Profile, certificate, refine, relaxation};
use crate::machine::AXES;

/// Places per interval at which a plan is checked, and in all, at least.
const FINER: usize = 10;
const PLACES: usize = 4000;
/// Rounds of holding limits tighter where the finer grid asks for it.
const ROUNDS: usize = 12;
/// Part of the fastest motion's z below which a motion rests.
const RESTING: f64 = 1e-3;
/// Rounds of splitting intervals, and how many there may be in the end.
const SPLITS: usize = 6;
const MOST: usize = 1000;
/// Change of the time, relative, at which programmes on a grid that is not the last have settled.
const COARSELY: f64 = 2e-3;
/// Intervals of the coarsest programme with jerk limits, and how much finer each next one is.
const COARSEST: usize = 50;
const REFINEMENT: usize = 4;

/// What a search returns.
struct Found {
    profile: Profile,
    uses: Vec<Use>,
    outer_bound: Option<f64>,
    search_bound: Option<f64>,
    estimate: Option<f64>,
}

/// One path within one set of limits.
pub(super) struct Search<'a> {
    machine: &'a Machine<'a>,
    curve: &'a Curve,
    /// The same path over the parameter in which jerk-limited motions are sought.
    eased: Curve,
    limits: &'a Limits,
    options: &'a Options,
    solve_s: f64,
    verify_s: f64,
    iterations: usize,
}

impl<'a> Search<'a> {
    /// Nothing found yet.
    pub(super) fn new(machine: &'a Machine<'a>, curve: &'a Curve, limits: &'a Limits, options: &'a Options) -> Self {
        let eased = curve.clone().eased();
        Self { machine, curve, eased, limits, options, solve_s: 0.0, verify_s: 0.0, iterations: 0 }
    }

    /// The same, with jerk-limited motions sought over the length of the path, whose ends take finer intervals.
    pub(super) fn over_length(
        machine: &'a Machine<'a>,
        curve: &'a Curve,
        limits: &'a Limits,
        options: &'a Options,
    ) -> Self {
        Self { eased: curve.clone(), ..Self::new(machine, curve, limits, options) }
    }

    /// A plan on about as many intervals, or more where they are split.
    pub(super) fn run(&mut self, intervals: usize) -> Result<Plan, PlanError> {
        let grid = even(self.curve, intervals);
        let has_jerk = self.limits.has_jerk();
        let (profile, passes, uses) = self.without_jerk(&grid, !has_jerk)?;
        let mvc = grid.iter().zip(&passes.mvc).map(|(s, z)| [*s, *z]).collect();
        let time_without_jerk = profile.time();
        let above = match self.options.certify {
            true => Some(certificate::above(self.machine, self.curve, self.limits, &profile)?),
            false => None,
        };
        let bound = above.as_ref().map_or(0.0, |above| above.time);
        let found = match uses {
            Some(uses) => Found { profile, uses, outer_bound: None, search_bound: None, estimate: None },
            None => self.with_jerk(&profile, above.as_ref(), grid.len() - 1).map_err(|e| e.along(&self.eased))?,
        };
        let Found { profile, uses, outer_bound, search_bound, estimate } = found;
        Ok(Plan {
            time: profile.time(),
            curve: if has_jerk { self.eased.clone() } else { self.curve.clone() },
            profile,
            bound,
            outer_bound,
            search_bound,
            estimate,
            time_without_jerk,
            mvc,
            uses,
            solve_s: self.solve_s,
            verify_s: self.verify_s,
            iterations: self.iterations,
        })
    }

    /// Passes until the force laws are linearised at what they find; checked and repeated with less room if asked for.
    fn without_jerk(&mut self, grid: &[f64], check: bool) -> Result<(Profile, Passes, Option<Vec<Use>>), PlanError> {
        let start = (self.options.clock)();
        let mut stations = Stations::new(self.machine, self.curve, self.limits, grid)?;
        let mut room = Room::full(grid.len());
        let mut jerk_room = Vec::new();
        let mut found = self.passes(&mut stations, &room, None)?;
        self.solve_s += (self.options.clock)() - start;
        let (mut round, mut fine) = (0, false);
        loop {
            let profile = Profile::linear(grid, &found.z);
            if !check {
                return Ok((profile, found, None));
            }
            let uses = self.check(self.curve, &profile, fine)?;
            let enough = !tighten(&uses, &mut room, &mut jerk_room) || round == ROUNDS;
            if enough && fine {
                return accept(uses).map(|uses| (profile, found, Some(uses)));
            }
            if enough {
                fine = true;
                continue;
            }
            round += 1;
            let start = (self.options.clock)();
            match self.passes(&mut stations, &room, Some(&found)) {
                Ok(next) => found = next,
                // No motion with less room: what was found last is what there is.
                Err(_) => (fine, round) = (true, ROUNDS),
            }
            self.solve_s += (self.options.clock)() - start;
        }
    }

    /// Passes until the force laws are linearised at what they find; viscous friction is linear anywhere.
    ///
    /// Tangents of other laws at speed may leave no motion at rest, so references slow down until the first passes succeed.
    fn passes(&mut self, stations: &mut Stations, room: &Room, from: Option<&Passes>) -> Result<Passes, PlanError> {
        const MOST: usize = 30;
        const SETTLED: f64 = 1e-6;
        const SLOWEST: f64 = 1e-4;
        let mut found = match from {
            Some(found) => found.clone(),
            None => pass::solve(stations, room).map_err(|e| stuck(e, stations))?,
        };
        let (mut slow, mut done) = (1.0, 0);
        while done < MOST {
            let mut references = references(&found);
            references.iter_mut().for_each(|r| r.speed *= slow);
            stations.load(self.machine, self.limits, &references)?;
            self.iterations += 1;
            let next = match pass::solve(stations, room) {
                Ok(next) => next,
                Err(_) if done > 0 => break,
                Err(_) if slow > SLOWEST => {
                    slow *= 0.25;
                    continue;
                }
                Err(e) => return Err(stuck(e, stations)),
            };
            let apart = |(a, b): (&f64, &f64)| (a - b).abs() / (a + b).max(f64::MIN_POSITIVE);
            let change = next.z.iter().zip(&found.z).map(apart).fold(0.0, f64::max);
            found = next;
            done += 1;
            if change < SETTLED && slow == 1.0 && (done > 1 || from.is_some()) {
                break;
            }
            slow = 1.0;
        }
        Ok(found)
    }

    /// Largest load at rest, or creeping along the path, at some places, if it is beyond `allowed` of what may be used.
    pub(super) fn at_rest(&self, places: &[f64], creeping: f64, allowed: f64) -> Result<(), PlanError> {
        let usable = self.limits.usable();
        let geometry = &self.machine.plant().geometry;
        let mut worst: Option<(f64, PlanError)> = None;
        for &s in places {
            let place = |e| PlanError::Place { s, at: self.curve.at(s)[0].into(), source: PlaceError::Pose(e) };
            let point = PathPoint::new(geometry, self.curve, s).map_err(place)?;
            for speed in [0.0, creeping] {
                let loads = self.machine.loads(&point.motion(geometry, speed, 0.0)).map_err(place)?;
                for (k, value) in loads.into_iter().enumerate() {
                    let usable = usable[AXES + k];
                    let used = value.abs() / usable;
                    if used > allowed && worst.as_ref().is_none_or(|w| used > w.0) {
                        let limit = Limit::affine(AXES + k);
                        worst = Some((used, PlanError::AtRest { limit, s, value, usable }));
                    }
                }
            }
        }
        worst.map_or(Ok(()), |w| Err(w.1))
    }

    /// Programmes from coarse to fine, the last one repeated with less room until the check agrees.
    fn with_jerk(&mut self, unlimited: &Profile, above: Option<&Above>, intervals: usize) -> Result<Found, PlanError> {
        let (mut programme, change) = self.refined(unlimited, intervals)?;
        if self.options.objective == Objective::Speed {
            let fastest = programme.at.z.clone();
            let start = (self.options.clock)();
            self.programmes(&mut programme, Objective::Speed, true)?;
            self.solve_s += (self.options.clock)() - start;
            let slower = |i: &usize| programme.at.z[*i] < RESTING * fastest[*i];
            if let Some(i) = programme.stations.moving().find(slower) {
                return Err(PlanError::Rests { s: programme.stations.list[i].point.s });
            }
        }
        let (mut round, mut fine) = (0, false);
        loop {
            let profile = programme.profile();
            let uses = self.check(&self.eased.clone(), &profile, fine)?;
            let enough = !tighten(&uses, &mut programme.room, &mut programme.jerk_room) || round == ROUNDS;
            if enough && fine {
                let uses = accept(uses)?;
                let outer_bound = above.and_then(|above| self.outer_bound(&programme, above));
                let estimate = change.map(|change| profile.time() * (1.0 - change));
                return Ok(Found { profile, uses, outer_bound, search_bound: self.search_bound(&programme), estimate });
            }
            if enough {
                fine = true;
                continue;
            }
            round += 1;
            let start = (self.options.clock)();
            let last = (programme.at.clone(), programme.bound);
            if self.programmes(&mut programme, self.options.objective, true).is_err() {
                (programme.at, programme.bound) = last;
                (fine, round) = (true, ROUNDS);
            }
            self.solve_s += (self.options.clock)() - start;
        }
    }

    /// The fastest motion on a grid that is fine enough, and by how much the last split changed its time, relative.
    fn refined(&mut self, unlimited: &Profile, intervals: usize) -> Result<(Sequence, Option<f64>), PlanError> {
        let mut sizes = vec![intervals];
        while sizes[0] >= COARSEST * REFINEMENT {
            sizes.insert(0, (sizes[0] / REFINEMENT).max(COARSEST));
        }
        let mut programme = self.programme(unlimited, even(&self.eased, sizes[0]), true, sizes.len() == 1)?;
        for (level, &size) in sizes.iter().enumerate().skip(1) {
            let profile = programme.profile();
            programme =
                self.programme(&profile, graded(&profile, &self.eased, size), false, level + 1 == sizes.len())?;
        }
        let mut change = None;
        for _ in 0..if self.options.refine { SPLITS } else { 0 } {
            let profile = programme.profile();
            let uses = self.check(&self.eased.clone(), &profile, false)?;
            let idle = refine::idle(&profile, &uses);
            let most = MOST.max(intervals).min(2 * idle.len());
            let finer = self.programme(&profile, refine::split(&profile, &idle, most), false, true)?;
            let time = finer.profile().time();
            let gained = (profile.time() / time - 1.0).abs();
            programme = finer;
            change = Some(gained);
            if gained < refine::SETTLED || most < 2 * idle.len() {
                break;
            }
        }
        Ok((programme, change))
    }

    /// Programmes on `grid` until they settle, begun near `profile`, or below it if that knows nothing of jerk limits.
    fn programme(
        &mut self,
        profile: &Profile,
        grid: Vec<f64>,
        unlimited: bool,
        finest: bool,
    ) -> Result<Sequence, PlanError> {
        let start = (self.options.clock)();
        let mut stations = Stations::new(self.machine, &self.eased, self.limits, &grid)?;
        let near = match unlimited {
            true => eased(profile, &self.eased, &grid),
            false => course(profile, &grid),
        };
        stations.load(self.machine, self.limits, &course_references(&near))?;
        let mut programme = match unlimited {
            true => Sequence::begin(stations, self.limits, &near.z),
            false => Sequence::near(stations, self.limits, near),
        };
        let done = self.programmes(&mut programme, Objective::Time, finest);
        self.solve_s += (self.options.clock)() - start;
        done.map(|()| programme)
    }

    /// Lower bound on the time of all that the programme's rows allow.
    fn search_bound(&self, p: &Sequence) -> Option<f64> {
        if self.options.objective == Objective::Time {
            return Some(p.bound);
        }
        jerk::step(&p.stations, self.limits, &p.room, &p.jerk_room, &p.watch, &p.at, Objective::Time)
            .map(|step| step.bound)
    }

    /// Lower bound on the time of all motions on the programme's grid.
    fn outer_bound(&self, p: &Sequence, above: &Above) -> Option<f64> {
        let above: Vec<f64> = p
            .stations
            .list
            .iter()
            .map(|station| {
                let [s, g1, ..] = self.eased.way(station.point.s);
                above.at(s) / (g1 * g1)
            })
            .collect();
        let (stations, limits) = (&p.stations, self.limits);
        match self.options.tighten {
            true => relaxation::tightened(stations, limits, &p.watch, &p.at, &above, ENOUGH),
            false => relaxation::bound(stations, limits, &p.watch, &p.at, &above),
        }
    }

    /// Programmes until the time stays the same, force laws linearised at each one's result.
    fn programmes(&mut self, p: &mut Sequence, objective: Objective, finest: bool) -> Result<(), PlanError> {
        let settled = if finest { jerk::SETTLED } else { COARSELY };
        let reload =
            |stations: &mut Stations, at: &Course| stations.load(self.machine, self.limits, &course_references(at));
        self.iterations += p.settle(self.limits, objective, settled, reload)?;
        Ok(())
    }

    /// Uses on the grid ten times finer, or `fine` on all places.
    fn check(&mut self, curve: &Curve, profile: &Profile, fine: bool) -> Result<Vec<Use>, PlanError> {
        if profile.stalls() {
            return Err(PlanError::Unsolved);
        }
        let start = (self.options.clock)();
        let points = if fine { FINER.max(PLACES / profile.pieces.len()) } else { FINER };
        let uses = verify::uses(self.machine, curve, self.limits, profile, points)?;
        self.verify_s += (self.options.clock)() - start;
        Ok(uses)
    }
}

/// Speed at a station at rest for which force laws are linearised, as a share of z next to it.
const DEPARTING: f64 = 0.25;

fn reference(z: &[f64], i: usize, acceleration: f64) -> Reference {
    let n = z.len() - 1;
    let z = match i {
        0 => DEPARTING * z[1],
        i if i == n => DEPARTING * z[n - 1],
        i => z[i],
    };
    Reference { speed: z.sqrt().max(1e-6), acceleration }
}

/// Where force laws are linearised: speed and mean acceleration at every station.
fn references(passes: &Passes) -> Vec<Reference> {
    let n = passes.z.len() - 1;
    let mean = |i: usize| 0.5 * (passes.acceleration[i.saturating_sub(1)] + passes.acceleration[i.min(n - 1)]);
    (0..=n).map(|i| reference(&passes.z, i, mean(i))).collect()
}

fn course_references(course: &Course) -> Vec<Reference> {
    (0..course.z.len()).map(|i| reference(&course.z, i, course.acceleration[i])).collect()
}

fn course(profile: &Profile, grid: &[f64]) -> Course {
    let paces: Vec<_> = grid.iter().map(|s| profile.pace(*s)).collect();
    Course { z: paces.iter().map(|p| p.z).collect(), acceleration: paces.iter().map(|p| p.acceleration).collect() }
}

/// z and acceleration of the parameter of `curve` at `grid` for a profile over s; z is infinite at rest.
fn eased(profile: &Profile, curve: &Curve, grid: &[f64]) -> Course {
    let at = |x: &f64| {
        let [s, g1, g2, _] = curve.way(*x);
        let pace = profile.pace(s);
        let z = if g1 > 0.0 { pace.z / (g1 * g1) } else { f64::INFINITY };
        if z.is_finite() { (z, (pace.acceleration - g2 * z) / g1) } else { (z, 0.0) }
    };
    let (z, acceleration) = grid.iter().map(at).unzip();
    Course { z, acceleration }
}

fn stuck(stuck: Stuck, stations: &Stations) -> PlanError {
    PlanError::Stuck { s: stations.list[stuck.station].point.s }
}

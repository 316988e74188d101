//! Time-optimal z(s) with jerk limits: a sequence of linear programmes, each an inner approximation.
//!
//! s̈ is linear in s over an interval, s̈ = b + cσ, so z = ṡ² is quadratic and s⃛ = c √z. A drive's jerk (40) is then
//! √z (q‴ z + 3 q″ s̈ + q′ c), and its limit J reads |q‴ z + 3 q″ s̈ + q′ c| ≤ J/√z. The right side is convex in z: its tangent
//! at the last iterate lies below it everywhere, so what the programme finds is feasible, and the last iterate is feasible
//! in the programme: the time cannot grow. At both ends of the path s⃛ is constant over the first interval, s ∝ t³, which
//! makes z₁ and s̈₁ proportional.
//!
//! T = Σ 2h/(√zᵢ + √zᵢ₊₁) is convex in z. Its linearisation at the last iterate is the objective, so the optimum of a
//! programme bounds the time of everything its rows allow from below: T ≥ T(z) + ∇T·(z* − z).

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolution, DefaultSolver, IPSolver, SolverStatus, SupportedConeT,
};

use super::limits::Limits;
use super::rows::{Room, Station, Stations};
use super::{Objective, PlanError, Profile};
use crate::machine::AXES;

/// z and s̈ at every station; both vanish at the ends.
#[derive(Clone, Debug)]
pub struct Course {
    /// ṡ².
    pub z: Vec<f64>,
    /// s̈.
    pub acceleration: Vec<f64>,
}

/// A solved programme.
pub struct Step {
    /// What it found.
    pub course: Course,
    /// Lower bound on the time within its rows, s.
    pub bound: f64,
}

/// Room for the jerk of each drive at each station: one, less where a finer grid found more.
pub type JerkRoom = Vec<[f64; AXES]>;

/// Which sides of the rows (≤ room, ≥ −room) are in the programme; the others are watched from outside.
pub struct Watch {
    loads: Vec<Vec<Sides>>,
    /// Per interval: each drive at its start and at its end.
    jerks: Vec<[[Sides; AXES]; 2]>,
    /// Intervals in which z must not vanish, though it does at neither end.
    dips: Vec<bool>,
}

/// Upper and lower side of a row.
#[derive(Clone, Copy, Default)]
struct Sides([bool; 2]);

impl Sides {
    const BOTH: Self = Self([true; 2]);

    /// Takes a side in of which `used` (signed) is nearly all; the use if it was outside.
    fn see(&mut self, used: f64) -> f64 {
        let side = usize::from(used < 0.0);
        let outside = if self.0[side] { 0.0 } else { used.abs() };
        self.0[side] |= used.abs() > NEAR;
        outside
    }

    /// Signs of the sides in the programme.
    fn signs(self) -> impl Iterator<Item = f64> {
        [1.0, -1.0].into_iter().zip(self.0).filter_map(|(sign, inside)| inside.then_some(sign))
    }
}

/// Sides of rows of which more than this is used are taken into the programme.
const NEAR: f64 = 0.8;
/// Steps of a line search, each to two thirds of the interval.
const LINE_SEARCH: usize = 12;
/// A row outside the programme may use this much of its room.
const ENOUGH: f64 = 1.0 + 1e-6;

impl Course {
    /// The course between this one and `other`, at most the latter, that takes the least time.
    ///
    /// The time is convex in z, and what lies between two feasible courses of one programme is feasible.
    pub fn towards(&self, other: &Self, stations: &Stations) -> Self {
        let mix = |share: f64| {
            let blend = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a + share * (b - a)).collect();
            Self { z: blend(&self.z, &other.z), acceleration: blend(&self.acceleration, &other.acceleration) }
        };
        if other.time(stations) <= self.time(stations) {
            return other.clone();
        }
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..LINE_SEARCH {
            let (a, b) = (low + (high - low) / 3.0, high - (high - low) / 3.0);
            if mix(a).time(stations) < mix(b).time(stations) { high = b } else { low = a }
        }
        mix(0.5 * (low + high))
    }

    /// Its motion.
    pub fn profile(&self, stations: &Stations) -> Profile {
        let s: Vec<f64> = stations.list.iter().map(|x| x.point.s).collect();
        let of = if stations.eased { Profile::smooth } else { Profile::quadratic };
        of(&s, &self.z, &self.acceleration)
    }

    /// Time over the path, s.
    pub fn time(&self, stations: &Stations) -> f64 {
        let n = stations.intervals();
        let part = |i: usize| {
            let h = stations.length(i);
            match i {
                0 if !stations.eased => 3.0 * h / self.z[1].sqrt(),
                i if i + 1 == n && !stations.eased => 3.0 * h / self.z[i].sqrt(),
                i => 2.0 * h / (self.z[i].sqrt() + self.z[i + 1].sqrt()),
            }
        };
        (0..n).map(part).sum()
    }

    /// Whether z = zᵢ + 2bσ + cσ² vanishes within interval `i`.
    fn dips(&self, stations: &Stations, i: usize) -> bool {
        let (h, b) = (stations.length(i), self.acceleration[i]);
        let c = (self.acceleration[i + 1] - b) / h;
        c > 0.0 && b < 0.0 && -b < c * h && self.z[i] * c <= b * b
    }

    /// ∂T/∂z at the moving stations.
    fn gradient(&self, stations: &Stations) -> Vec<f64> {
        let n = stations.intervals();
        let side = |i: usize, interval: usize, other: usize| {
            let (h, root) = (stations.length(interval), self.z[i].sqrt());
            if !stations.eased && (interval == 0 || interval + 1 == n) {
                -1.5 * h / (root * self.z[i])
            } else {
                -h / ((root + self.z[other].sqrt()).powi(2) * root)
            }
        };
        stations
            .moving()
            .map(|i| {
                let before = if i > 0 { side(i, i - 1, i - 1) } else { 0.0 };
                let after = if i < n { side(i, i, i + 1) } else { 0.0 };
                before + after
            })
            .collect()
    }
}

/// (q‴, 3 q″, q′) of a drive in units of its jerk limit.
pub(super) fn jerk_row(station: &Station, limits: &Limits, axis: usize) -> [f64; 3] {
    let [_, q1, q2, q3] = station.point.q.map(|q| q[axis]);
    [q3, 3.0 * q2, q1].map(|v| v / limits.jerk[axis])
}

/// Use of the jerk limit of a drive by constant s⃛ from rest up to z over the interval between a station at rest and its
/// neighbour, per z^(3/2): |q‴ + 2 q″/h + 2 q′/9h²| at the neighbour and |2 q′/9h²| at rest. `sign` is −1 at the end.
fn ramp_use(rest: &Station, neighbour: &Station, limits: &Limits, h: f64, sign: f64, axis: usize) -> f64 {
    let [third, second, first] = jerk_row(neighbour, limits, axis);
    let moving = (third + sign * second * 2.0 / (3.0 * h) + first * 2.0 / (9.0 * h * h)).abs();
    moving.max((jerk_row(rest, limits, axis)[2] * 2.0 / (9.0 * h * h)).abs())
}

/// Largest z next to each end of the path.
pub(super) fn ramp_caps(stations: &Stations, limits: &Limits, room: &JerkRoom) -> [f64; 2] {
    if stations.eased {
        return [f64::INFINITY; 2];
    }
    let n = stations.intervals();
    let cap = |rest: usize, neighbour: usize, h: f64, sign: f64| {
        let at = |axis: usize| {
            let most = ramp_use(&stations.list[rest], &stations.list[neighbour], limits, h, sign, axis);
            (room[neighbour][axis] / most).powf(2.0 / 3.0)
        };
        (0..AXES).map(at).fold(f64::INFINITY, f64::min)
    };
    [cap(0, 1, stations.length(0), 1.0), cap(n, n - 1, stations.length(n - 1), -1.0)]
}

/// z to linearise at first: what is possible without jerk limits, less near the ends, where constant s⃛ from rest at the
/// jerk limit gives z = (9/2)^(2/3) s⃛^(2/3) s^(4/3); along an eased path, where q′ = q″ = 0 at rest, z = (J/q‴)^(2/3).
fn first_guess(stations: &Stations, limits: &Limits, unlimited: &[f64]) -> Course {
    let n = stations.intervals();
    if stations.eased {
        let still = |i: usize| {
            let third = (0..AXES).map(|k| jerk_row(&stations.list[i], limits, k)[0].abs()).fold(0.0, f64::max);
            third.powf(-2.0 / 3.0)
        };
        let most = still(0).min(still(n));
        let z = unlimited.iter().map(|z| z.min(most)).collect();
        return Course { z, acceleration: vec![0.0; n + 1] };
    }
    let end = |i: usize| {
        let jerk =
            (0..AXES).map(|k| 1.0 / jerk_row(&stations.list[i], limits, k)[2].abs()).fold(f64::INFINITY, f64::min);
        (4.5 * jerk).powf(2.0 / 3.0)
    };
    let (start, stop) = (end(0), end(n));
    let s = |i: usize| stations.list[i].point.s;
    let four_thirds = |x: f64| x.cbrt().powi(4);
    let z = (0..=n)
        .map(|i| unlimited[i].min(start * four_thirds(s(i) - s(0))).min(stop * four_thirds(s(n) - s(i))))
        .collect();
    Course { z, acceleration: vec![0.0; n + 1] }
}

impl Watch {
    /// Rows that a motion with z and s̈ at the stations comes near; of the jerks those at the start of every interval.
    fn new(stations: &Stations, room: &Room, near: &Course) -> Self {
        let n = stations.intervals();
        let mut watch = Self {
            loads: stations.list.iter().map(|s| vec![Sides::default(); s.rows.len()]).collect(),
            jerks: vec![[[Sides::BOTH; AXES], [Sides::default(); AXES]]; n],
            dips: vec![false; n],
        };
        watch.see_loads(stations, room, near);
        watch
    }

    /// Signs of the sides of row `r` at station `i` that are in the programme.
    pub(super) fn signs(&self, i: usize, r: usize) -> impl Iterator<Item = f64> {
        self.loads[i][r].signs()
    }

    /// The rows whose room is nearly used at each station; the largest use of a row that was not watched.
    fn see_loads(&mut self, stations: &Stations, room: &Room, course: &Course) -> f64 {
        let mut worst = 0.0f64;
        for i in 1..stations.intervals() {
            let station = &stations.list[i];
            for (r, (row, &k)) in station.rows.iter().zip(&stations.quantities).enumerate() {
                let used = row.at(course.z[i], course.acceleration[i]) / room.share[i][k];
                worst = worst.max(self.loads[i][r].see(used));
            }
        }
        worst
    }

    /// Takes in the intervals within which z vanishes; whether one was outside.
    ///
    /// The time of an interval, 2h/(√zᵢ + √zᵢ₊₁), is that of its ends alone: a programme may let the motion stand still in between.
    fn see_dips(&mut self, stations: &Stations, course: &Course) -> bool {
        let mut outside = false;
        for i in stations.inner() {
            if course.dips(stations, i) && !self.dips[i] {
                self.dips[i] = true;
                outside = true;
            }
        }
        outside
    }

    /// The same for jerks; a side that is broken is taken in over the neighbouring intervals as well.
    fn see_jerks(&mut self, stations: &Stations, limits: &Limits, room: &JerkRoom, course: &Course) -> f64 {
        let mut worst = 0.0f64;
        let inner = stations.inner();
        for i in inner.clone() {
            for (side, at) in [i, i + 1].into_iter().enumerate() {
                for axis in 0..AXES {
                    let used = jerk_use(stations, limits, room, course, i, at, axis);
                    let outside = self.jerks[i][side][axis].see(used);
                    worst = worst.max(outside);
                    if outside > ENOUGH {
                        for k in i.saturating_sub(AROUND).max(inner.start)..(i + AROUND + 1).min(inner.end) {
                            self.jerks[k][side][axis].0[usize::from(used < 0.0)] = true;
                        }
                    }
                }
            }
        }
        worst
    }
}

/// Intervals to either side of a broken row that watch it too.
const AROUND: usize = 3;

/// Linear programmes on the stations of one grid, each about what the last one found.
pub struct Sequence {
    /// Rows.
    pub stations: Stations,
    /// Of them that may be used.
    pub room: Room,
    /// Of the jerk limits that may be used.
    pub jerk_room: JerkRoom,
    /// Rows that are in the programmes.
    pub watch: Watch,
    /// What the last programme found.
    pub at: Course,
    /// Lower bound on the time within the last programme's rows, s.
    pub bound: f64,
    /// Whether `at` is near a motion that keeps all rows.
    known: bool,
}

/// With [`Objective::Speed`], z after a step over z before it, at least.
const SLOWER: f64 = 0.5;
/// Change of the time, relative, at which programmes have settled.
pub const SETTLED: f64 = 1e-4;

impl Sequence {
    /// Begins at what is possible without jerk limits.
    pub fn begin(stations: Stations, limits: &Limits, unlimited: &[f64]) -> Self {
        let (room, jerk_room) = Self::full(&stations);
        let near = Course { z: unlimited.to_vec(), acceleration: vec![0.0; unlimited.len()] };
        let watch = Watch::new(&stations, &room, &near);
        let at = first_guess(&stations, limits, unlimited);
        Self { stations, room, jerk_room, watch, at, bound: f64::NEG_INFINITY, known: false }
    }

    /// Begins at a course near the optimum.
    pub fn near(stations: Stations, limits: &Limits, at: Course) -> Self {
        let (room, jerk_room) = Self::full(&stations);
        let mut watch = Watch::new(&stations, &room, &at);
        watch.prune(&stations, limits, &jerk_room, &at);
        Self { stations, room, jerk_room, watch, at, bound: f64::NEG_INFINITY, known: true }
    }

    fn full(stations: &Stations) -> (Room, JerkRoom) {
        let n = stations.list.len();
        (Room::full(n), vec![[1.0; AXES]; n])
    }

    /// Motion of the last programme.
    pub fn profile(&self) -> Profile {
        self.at.profile(&self.stations)
    }

    /// Solves programmes until the time changes by no more than `settled`, relative; `reload` brings the rows up to date
    /// before each. Returns their number.
    pub fn settle(
        &mut self,
        limits: &Limits,
        objective: Objective,
        settled: f64,
        mut reload: impl FnMut(&mut Stations, &Course) -> Result<(), PlanError>,
    ) -> Result<usize, PlanError> {
        const MOST: usize = 40;
        const SLOWED: usize = 5;
        const STAYS: usize = 6;
        let (mut feasible, mut slowed, mut stays) = (false, 0, 0);
        for k in 0..MOST {
            reload(&mut self.stations, &self.at)?;
            let before = self.at.time(&self.stations);
            let step = step(&self.stations, limits, &self.room, &self.jerk_room, &self.watch, &self.at, objective);
            let Some(step) = step else {
                // About a slower motion the tangents leave more room.
                if slowed == SLOWED {
                    return Err(PlanError::Unsolved);
                }
                slowed += 1;
                self.at.z.iter_mut().for_each(|z| *z *= 0.25);
                self.at.acceleration.iter_mut().for_each(|a| *a *= 0.25);
                continue;
            };
            let course = match objective {
                Objective::Time if feasible => self.at.towards(&step.course, &self.stations),
                _ => step.course,
            };
            let broken = broken(&self.stations, limits, &self.room, &self.jerk_room, &mut self.watch, &course);
            if broken && self.known && stays < STAYS {
                // The same programme with the rows that were missing.
                stays += 1;
                continue;
            }
            stays = 0;
            feasible = !broken;
            self.known |= feasible;
            self.at = course;
            self.bound = step.bound;
            let time = self.at.time(&self.stations);
            let change = match objective {
                Objective::Time => (time - self.bound).abs(),
                Objective::Speed => (time - before).abs(),
            };
            if !broken && change < settled * time {
                if !self.watch.see_dips(&self.stations, &self.at) {
                    return Ok(k + 1);
                }
                // What was found is no motion, and nothing lies between it and one.
                feasible = false;
            }
            if k == 0 && !self.known {
                self.watch.prune(&self.stations, limits, &self.jerk_room, &self.at);
            }
        }
        Ok(MOST)
    }
}

/// Rows of a programme, b − A x ∈ K with zeros first.
#[derive(Default)]
pub(super) struct Programme {
    rows: Vec<usize>,
    columns: Vec<usize>,
    values: Vec<f64>,
    pub(super) right: Vec<f64>,
}

impl Programme {
    /// The x of so many columns that costs least. `None` if the solver finds none.
    pub(super) fn solve(
        self,
        columns: usize,
        cost: &[f64],
        cones: &[SupportedConeT<f64>],
    ) -> Option<DefaultSolution<f64>> {
        let matrix = CscMatrix::new_from_triplets(self.right.len(), columns, self.rows, self.columns, self.values);
        let settings = DefaultSettingsBuilder::default().verbose(false).max_iter(100).build().ok()?;
        let quadratic = CscMatrix::zeros((columns, columns));
        let mut solver = DefaultSolver::new(&quadratic, cost, &matrix, &self.right, cones, settings).ok()?;
        solver.solve();
        let solved = matches!(solver.solution.status, SolverStatus::Solved | SolverStatus::AlmostSolved);
        solved.then_some(solver.solution)
    }

    /// Σ terms ≤ right, or = for the first rows.
    pub(super) fn row(&mut self, terms: &[(usize, f64)], right: f64) {
        let row = self.right.len();
        for &(column, value) in terms {
            self.rows.push(row);
            self.columns.push(column);
            self.values.push(value);
        }
        self.right.push(right);
    }
}

/// One programme about `at`. `None` if the solver finds no solution.
pub fn step(
    stations: &Stations,
    limits: &Limits,
    room: &Room,
    jerk_room: &JerkRoom,
    watch: &Watch,
    at: &Course,
    objective: Objective,
) -> Option<Step> {
    let n = stations.intervals();
    let (moving, start) = (stations.moving(), stations.moving().start);
    let count = moving.len();
    // Variables: z in units of the last iterate, s̈ in units of its largest value that z allows.
    let length = stations.list[n].point.s - stations.list[0].point.s;
    let unit: f64 = moving.clone().map(|i| at.z[i] / length).fold(0.0, f64::max);
    let (zv, bv) = (|i: usize| i - start, |i: usize| count + i - start);
    let (zs, bs) = (|i: usize| at.z[i], 4.0 * unit);
    let mut p = Programme::default();
    for i in stations.inner() {
        let (h, scale) = (stations.length(i), 1.0 / zs(i).max(zs(i + 1)));
        p.row(
            &[
                (zv(i + 1), zs(i + 1) * scale),
                (zv(i), -zs(i) * scale),
                (bv(i), -h * bs * scale),
                (bv(i + 1), -h * bs * scale),
            ],
            0.0,
        );
    }
    if stations.eased {
        // Nothing holds s̈ at rest: it is that of the neighbour.
        p.row(&[(bv(0), 1.0), (bv(1), -1.0)], 0.0);
        p.row(&[(bv(n), 1.0), (bv(n - 1), -1.0)], 0.0);
    } else {
        let (first, last) = (stations.length(0), stations.length(n - 1));
        p.row(&[(bv(1), 1.0), (zv(1), -2.0 / 3.0 * zs(1) / (first * bs))], 0.0);
        p.row(&[(bv(n - 1), 1.0), (zv(n - 1), 2.0 / 3.0 * zs(n - 1) / (last * bs))], 0.0);
    }
    let equalities = p.right.len();
    let caps = ramp_caps(stations, limits, jerk_room);
    // ∫ z ds does not count the time that a motion stands still: it may slow down from step to step only.
    let least = match objective {
        Objective::Time => 0.0,
        Objective::Speed => SLOWER,
    };
    for i in moving.clone() {
        let mut cap = stations.list[i].cap * room.cap(i);
        if i == 1 {
            cap = cap.min(caps[0]);
        }
        if i == n - 1 {
            cap = cap.min(caps[1]);
        }
        p.row(&[(zv(i), -1.0)], -least);
        if cap.is_finite() {
            p.row(&[(zv(i), zs(i) / cap)], 1.0);
        }
        let station = &stations.list[i];
        for (r, (row, &k)) in station.rows.iter().zip(&stations.quantities).enumerate() {
            let (a, b, c) = row.tangent(zs(i).sqrt());
            for sign in watch.signs(i, r) {
                p.row(&[(bv(i), sign * a * bs), (zv(i), sign * b * zs(i))], room.share[i][k] - sign * c);
            }
        }
    }
    for i in stations.inner() {
        let h = stations.length(i);
        for (side, at_station) in [i, i + 1].into_iter().enumerate() {
            let z0 = at.z[at_station];
            // Tangent of √(z₀/z) at one, over z/z₀.
            let (offset, slope) = (1.5, -0.5);
            for axis in (0..AXES).filter(|&k| limits.jerk[k].is_finite()) {
                // In units of J/√z₀.
                let [third, second, first] = jerk_row(&stations.list[at_station], limits, axis).map(|v| v * z0.sqrt());
                let share = jerk_room[at_station][axis];
                for sign in watch.jerks[i][side][axis].signs() {
                    let mut terms = [(bv(i), -sign * first / h * bs), (bv(i + 1), sign * first / h * bs)];
                    terms[side].1 += sign * second * bs;
                    p.row(&[terms[0], terms[1], (zv(at_station), sign * third * z0 - slope * share)], offset * share);
                }
            }
        }
    }
    for i in stations.inner().filter(|&i| watch.dips[i]) {
        // The middle Bernstein coefficient of z over the interval, zᵢ + h·s̈ᵢ: with it none is negative.
        let scale = 1.0 / zs(i).max(zs(i + 1));
        p.row(&[(zv(i), -zs(i) * scale), (bv(i), -stations.length(i) * bs * scale)], 0.0);
    }
    let time = at.time(stations);
    let gradient = at.gradient(stations);
    let mut cost = vec![0.0; 2 * count];
    for i in moving.clone() {
        let reach = |k: usize| if k < n { stations.length(k) } else { 0.0 };
        cost[zv(i)] = zs(i)
            * match objective {
                Objective::Time => gradient[i - start],
                Objective::Speed => -0.5 * (reach(i.wrapping_sub(1)) + reach(i)) * stations.list[i].weight,
            };
    }
    let scale = 1.0 / cost.iter().map(|c| c.abs()).sum::<f64>();
    let scaled: Vec<f64> = cost.iter().map(|c| c * scale).collect();
    let cones = [SupportedConeT::ZeroConeT(equalities), SupportedConeT::NonnegativeConeT(p.right.len() - equalities)];
    let solution = p.solve(2 * count, &scaled, &cones)?;
    let x = &solution.x;
    let mut course = Course { z: vec![0.0; n + 1], acceleration: vec![0.0; n + 1] };
    for i in moving.clone() {
        course.z[i] = x[zv(i)] * zs(i);
        course.acceleration[i] = x[bv(i)] * bs;
    }
    if course.z[moving.clone()].iter().any(|z| !z.is_finite() || *z <= 0.0) {
        return None;
    }
    let bound = match objective {
        Objective::Time => {
            let present: f64 = moving.map(|i| gradient[i - start] * at.z[i]).sum();
            time + solution.obj_val_dual / scale - present
        }
        Objective::Speed => f64::NEG_INFINITY,
    };
    Some(Step { course, bound })
}

impl Watch {
    /// Leaves out the jerk rows that `course` is far from; the drives nearest to their limit stay on both sides.
    fn prune(&mut self, stations: &Stations, limits: &Limits, room: &JerkRoom, course: &Course) {
        for i in stations.inner() {
            let used: [f64; AXES] = std::array::from_fn(|axis| jerk_use(stations, limits, room, course, i, i, axis));
            let most = used.iter().fold(0.0f64, |m, u| m.max(u.abs()));
            for (axis, used) in used.into_iter().enumerate() {
                let sides = &mut self.jerks[i];
                sides[0][axis] = if used.abs() > KEPT * most { Sides::BOTH } else { Sides::default() };
                sides[1][axis] = Sides::default();
            }
        }
    }
}

/// Drives whose share of the jerk limit is at least this much of the largest share keep both sides.
const KEPT: f64 = 0.6;

/// Share of the jerk limit of a drive used at station `at` of interval `i`, with its sign.
fn jerk_use(
    stations: &Stations,
    limits: &Limits,
    room: &JerkRoom,
    course: &Course,
    i: usize,
    at: usize,
    axis: usize,
) -> f64 {
    let c = (course.acceleration[i + 1] - course.acceleration[i]) / stations.length(i);
    let [third, second, first] = jerk_row(&stations.list[at], limits, axis);
    let value = third * course.z[at] + second * course.acceleration[at] + first * c;
    value * course.z[at].sqrt() / room[at][axis]
}

/// Brings the watch up to date with `course`; whether a row outside the programme was broken.
fn broken(
    stations: &Stations,
    limits: &Limits,
    room: &Room,
    jerk_room: &JerkRoom,
    watch: &mut Watch,
    course: &Course,
) -> bool {
    let loads = watch.see_loads(stations, room, course);
    let jerks = watch.see_jerks(stations, limits, jerk_room, course);
    loads > ENOUGH || jerks > ENOUGH
}

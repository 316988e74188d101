//! The grid along a path, and the limits at its points as rows in z = ṡ² and s̈.

use rayon::prelude::*;

use super::coefficients::{Coefficients, Machine, Reference};
use super::limits::{LOADS, Limits, QUANTITIES};
use super::{Curve, PathPoint, PlanError};
use crate::machine::AXES;

/// ṡ at which force laws are linearised for rest: there is no friction yet.
const REST_SPEED: f64 = 1e-9;
/// Least time over a path, s: bounds ṡ where the joints stand still.
const LEAST_TIME: f64 = 1e-3;

/// A limit |a s̈ + b z + c + d √z| ≤ 1, in units of what may be used of the quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Row {
    /// Per s̈.
    pub a: f64,
    /// Per ṡ².
    pub b: f64,
    /// Constant.
    pub c: f64,
    /// Per ṡ.
    pub d: f64,
}

impl Row {
    /// Value of the row at z and s̈.
    pub fn at(&self, z: f64, acceleration: f64) -> f64 {
        self.a * acceleration + self.b * z + self.c + self.d * z.sqrt()
    }

    /// (a, b, c) of the row in s̈ and z alone, with √z replaced by its tangent at `speed`.
    pub fn tangent(&self, speed: f64) -> (f64, f64, f64) {
        (self.a, self.b + 0.5 * self.d / speed, self.c + 0.5 * self.d * speed)
    }
}

/// All limits at one grid point.
#[derive(Clone, Debug)]
pub struct GridPoint {
    /// The path there, in joint space.
    pub point: PathPoint,
    /// Largest z by the drive speeds.
    pub cap: f64,
    /// Rows of the limited quantities, see [`Grid::quantities`].
    pub rows: Vec<Row>,
    /// At the ends of the path: the rows of torques and constraint forces once more, at rest, where there is no friction.
    pub rest: Vec<Row>,
    /// (ds/dx)³ = ṡ² ds / ẋ² dx.
    pub weight: f64,
    /// Speed at which the rows' force laws are linearised.
    pub reference: f64,
}

/// Grid points along a path.
#[derive(Clone, Debug)]
pub struct Grid {
    /// In order of s, first and last at the ends of the path.
    pub points: Vec<GridPoint>,
    /// The limited quantities that the rows stand for, in order.
    pub quantities: Vec<usize>,
    /// Whether the path is eased at its ends: the robot rests there while the parameter has a speed.
    pub eased: bool,
}

impl Grid {
    /// Grid points at `places` with the limits on drive speeds and accelerations.
    ///
    /// # Errors
    ///
    /// [`PlanError::Place`] where the robot cannot follow the path.
    pub fn new(machine: &Machine, curve: &Curve, limits: &Limits, places: &[f64]) -> Result<Self, PlanError> {
        let usable = limits.usable();
        let quantities: Vec<usize> = (0..AXES).filter(|&k| usable[k].is_finite()).collect();
        let geometry = &machine.plant().geometry;
        let grid_point = |&s: &f64| {
            let point = PathPoint::new(geometry, curve, s)
                .map_err(super::PlaceError::Pose)
                .and_then(|p| p.check(geometry).map(|()| p))
                .map_err(|reason| PlanError::Place { s, at: curve.at(s)[0].into(), reason })?;
            let [_, q1, q2, _] = &point.q;
            let cap_by_time = (curve.end() / LEAST_TIME).powi(2);
            let cap = (0..AXES).map(|i| (limits.speed[i] / q1[i]).powi(2)).fold(cap_by_time, f64::min);
            let rows = quantities.iter().map(|&k| Row { a: q1[k] / usable[k], b: q2[k] / usable[k], c: 0.0, d: 0.0 });
            Ok(GridPoint {
                rows: rows.collect(),
                rest: Vec::new(),
                point,
                cap,
                weight: curve.way(s)[1].powi(3),
                reference: 1.0,
            })
        };
        Ok(Self {
            points: places.iter().map(grid_point).collect::<Result<_, _>>()?,
            quantities,
            eased: curve.is_eased(),
        })
    }

    /// Replaces the rows of torques and constraint forces by those with force laws linearised at `references`, one per point.
    ///
    /// # Errors
    ///
    /// [`PlanError::Place`] where the constraint forces are not determined.
    pub fn load(&mut self, machine: &Machine, limits: &Limits, references: &[Reference]) -> Result<(), PlanError> {
        let usable = limits.usable();
        let loads: Vec<usize> = (0..LOADS).filter(|&k| usable[AXES + k].is_finite()).collect();
        let kinematic = self.quantities.iter().filter(|&&k| k < AXES).count();
        self.quantities.truncate(kinematic);
        self.quantities.extend(loads.iter().map(|k| AXES + k));
        let ends = [&self.points[0], &self.points[self.points.len() - 1]].map(|x| x.point.s);
        let update = |(grid_point, reference): (&mut GridPoint, &Reference)| {
            let s = grid_point.point.s;
            let at = grid_point.point.r[0].into();
            let all = machine.coefficients(&grid_point.point, *reference).map_err(|e| PlanError::Place {
                s,
                at,
                reason: super::PlaceError::Pose(e),
            })?;
            grid_point.rows.truncate(kinematic);
            grid_point.reference = reference.speed;
            let row = |all: &Coefficients, k: usize| {
                let [a, b, c, d] = [all.a[k], all.b[k], all.c[k], all.d[k]].map(|x| x / usable[AXES + k]);
                Row { a, b, c, d }
            };
            grid_point.rows.extend(loads.iter().map(|&k| row(&all, k)));
            if grid_point.rest.is_empty() && (s == ends[0] || s == ends[1]) {
                let still = Reference { speed: REST_SPEED, acceleration: 0.0 };
                let all = machine.coefficients(&grid_point.point, still).map_err(|e| PlanError::Place {
                    s,
                    at,
                    reason: super::PlaceError::Pose(e),
                })?;
                grid_point.rest = loads.iter().map(|&k| Row { d: 0.0, ..row(&all, k) }).collect();
            }
            Ok(())
        };
        self.points.par_iter_mut().zip(references).try_for_each(update)
    }

    /// Number of intervals.
    pub fn intervals(&self) -> usize {
        self.points.len() - 1
    }

    /// Path parameter of grid point `i`.
    pub fn s(&self, i: usize) -> f64 {
        self.points[i].point.s
    }

    /// Grid points at which the parameter moves.
    pub fn moving(&self) -> std::ops::Range<usize> {
        if self.eased { 0..self.points.len() } else { 1..self.intervals() }
    }

    /// Intervals between two of these.
    pub fn inner(&self) -> std::ops::Range<usize> {
        if self.eased { 0..self.intervals() } else { 1..self.intervals() - 1 }
    }

    /// Length of interval `i` in s.
    pub fn length(&self, i: usize) -> f64 {
        self.s(i + 1) - self.s(i)
    }

    /// The first and the last interval of a path that is not eased.
    pub(super) fn ramps(&self) -> Vec<Ramp> {
        if self.eased {
            return Vec::new();
        }
        let n = self.intervals();
        let (first, last) = (self.length(0), self.length(n - 1));
        vec![
            Ramp { rest: 0, neighbour: 1, length: first, sign: 1.0 },
            Ramp { rest: n, neighbour: n - 1, length: last, sign: -1.0 },
        ]
    }
}

/// An interval from or to rest with constant s⃛: s ∝ t³ from the end at rest.
#[derive(Clone, Copy)]
pub(super) struct Ramp {
    /// Grid point at rest.
    pub rest: usize,
    /// Grid point that moves.
    pub neighbour: usize,
    /// Length of the interval in s.
    pub length: f64,
    /// Sign of s̈: 1 at the start of the path, −1 at its end.
    pub sign: f64,
}

/// Share of each limit that may be used at each grid point: one, less where the check on a finer grid found an excess.
#[derive(Clone, Debug)]
pub struct Slack {
    /// Per grid point: of each affine quantity, and at the end of the cap on z.
    pub share: Vec<[f64; QUANTITIES + 1]>,
    /// Per grid point: of each drive's jerk limit.
    pub jerk: Vec<[f64; AXES]>,
}

impl Slack {
    /// All of every limit at `points` grid points.
    pub fn full(points: usize) -> Self {
        Self { share: vec![[1.0; QUANTITIES + 1]; points], jerk: vec![[1.0; AXES]; points] }
    }

    /// Share of the cap on z at grid point `i`.
    pub fn cap(&self, i: usize) -> f64 {
        self.share[i][QUANTITIES]
    }
}

//! Grid along a path, with the limits at its points as rows in z = ṡ² and s̈.

use super::coefficients::{Coefficients, Machine, Reference};
use super::limits::{DYNAMIC, LOADS, Limits, QUANTITIES};
use super::{Curve, PathPoint, PlanError};
use crate::machine::{PerAxis, each, every_axis};
use crate::numerics::parallel;

/// ṡ at which force laws are linearised for rest, where friction vanishes, 1/s.
const REST_SPEED: f64 = 1e-9;
/// Least time over a path, s: bounds ṡ where the joint speeds vanish.
const LEAST_TIME: f64 = 1e-3;

/// Limit |a s̈ + b z + c + d √z| ≤ 1, in units of the usable value of the quantity.
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

    /// (a, b, c) of the row in s̈ and z alone, with √z replaced by its tangent at ṡ = `speed`.
    pub fn tangent(&self, speed: f64) -> (f64, f64, f64) {
        (self.a, self.b + 0.5 * self.d / speed, self.c + 0.5 * self.d * speed)
    }
}

/// All limits at one grid point.
#[derive(Clone, Debug)]
pub struct GridPoint {
    /// Path point in joint space.
    pub point: PathPoint,
    /// Largest z permitted by the drive speeds, 1/s².
    pub cap: f64,
    /// Rows of the limited quantities, see [`Grid::quantities`].
    pub rows: Vec<Row>,
    /// At the ends of the path: the rows of torques and constraint forces again, at rest and without friction.
    pub rest: Vec<Row>,
    /// Weight of the objective ∫ z ds over the parameter: (ds/dx)³ = ṡ² ds / ẋ² dx.
    pub weight: f64,
    /// ṡ at which the rows' force laws are linearised, 1/s.
    pub reference: f64,
}

/// Grid points along a path.
#[derive(Clone, Debug)]
pub struct Grid {
    /// Grid points in ascending s; the first and the last are the ends of the path.
    pub points: Vec<GridPoint>,
    /// Indices of the limited quantities of the rows, in order.
    pub quantities: Vec<usize>,
    /// Whether the path is eased: the robot rests at its ends at a non-zero rate of the parameter.
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
        let quantities: Vec<usize> = every_axis().filter(|&k| usable[k].is_finite()).collect();
        let geometry = &machine.plant().geometry;
        let grid_point = |&s: &f64| {
            let point = PathPoint::new(geometry, curve, s)
                .map_err(super::PlaceError::Pose)
                .and_then(|p| p.check(geometry).map(|()| p))
                .map_err(|reason| PlanError::Place { s, at: curve.at(s)[0].into(), reason })?;
            let [_, q1, q2, _] = &point.q;
            let cap_by_time = (curve.end() / LEAST_TIME).powi(2);
            let cap = every_axis().map(|i| (limits.speed[i] / q1[i]).powi(2)).fold(cap_by_time, f64::min);
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

    /// Replaces the rows of torques and constraint forces by rows with force laws linearised at `references`, one per
    /// point.
    ///
    /// # Errors
    ///
    /// [`PlanError::Place`] where the constraint forces are indeterminate.
    pub fn load(&mut self, machine: &Machine, limits: &Limits, references: &[Reference]) -> Result<(), PlanError> {
        let usable = limits.usable();
        let loads: Vec<usize> = (0..LOADS).filter(|&k| usable[DYNAMIC + k].is_finite()).collect();
        let kinematic = self.quantities.iter().filter(|&&k| k < DYNAMIC).count();
        self.quantities.truncate(kinematic);
        self.quantities.extend(loads.iter().map(|k| DYNAMIC + k));
        let ends = [&self.points[0], &self.points[self.points.len() - 1]].map(|x| x.point.s);
        let update = |i: usize, grid_point: &mut GridPoint| {
            let reference = &references[i];
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
                let [a, b, c, d] = [all.a[k], all.b[k], all.c[k], all.d[k]].map(|x| x / usable[DYNAMIC + k]);
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
        parallel::each(&mut self.points, update).into_iter().collect()
    }

    /// Number of intervals.
    pub fn intervals(&self) -> usize {
        self.points.len() - 1
    }

    /// Path parameter of grid point `i`.
    pub fn s(&self, i: usize) -> f64 {
        self.points[i].point.s
    }

    /// Range of the moving grid points, at which the rate of the parameter is positive.
    pub fn moving(&self) -> std::ops::Range<usize> {
        if self.eased { 0..self.points.len() } else { 1..self.intervals() }
    }

    /// Range of the intervals between two moving grid points.
    pub fn inner(&self) -> std::ops::Range<usize> {
        if self.eased { 0..self.intervals() } else { 1..self.intervals() - 1 }
    }

    /// Length of interval `i` in s.
    pub fn length(&self, i: usize) -> f64 {
        self.s(i + 1) - self.s(i)
    }

    /// First and last interval of a path that is not eased; empty for an eased one.
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

/// Usable share of each limit at each grid point: one, or less where the check on a finer grid found an excess.
#[derive(Clone, Debug)]
pub struct Tightening {
    /// Per grid point: share of each affine quantity, and as last entry of the cap on z.
    pub share: Vec<[f64; QUANTITIES + 1]>,
    /// Per grid point: share of each drive's jerk limit.
    pub jerk: Vec<PerAxis<f64>>,
}

impl Tightening {
    /// No limit tightened at `points` grid points.
    pub fn none(points: usize) -> Self {
        Self { share: vec![[1.0; QUANTITIES + 1]; points], jerk: vec![each(1.0); points] }
    }

    /// Share of the cap on z at grid point `i`.
    pub fn cap(&self, i: usize) -> f64 {
        self.share[i][QUANTITIES]
    }
}

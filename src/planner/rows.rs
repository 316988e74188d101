//! The limits at the stations of a path as rows in z = ṡ² and s̈.

use rayon::prelude::*;

use super::coefficients::{Coefficients, Machine, Reference};
use super::limits::{LOADS, Limits, QUANTITIES};
use super::{Curve, PathPoint, PlanError};
use crate::machine::AXES;

/// ṡ at which there is no friction yet.
const STILL: f64 = 1e-9;
/// Shortest time over a path, s: bounds ṡ where the joints stand still.
const SHORTEST: f64 = 1e-3;

/// |a s̈ + b z + c + d √z| ≤ room, in units of what may be used of the quantity.
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
    /// Its value at z and s̈.
    pub fn at(&self, z: f64, acceleration: f64) -> f64 {
        self.a * acceleration + self.b * z + self.c + self.d * z.sqrt()
    }

    /// √z replaced by its tangent at `speed`: (a, b, c) of a row in s̈ and z alone.
    pub fn tangent(&self, speed: f64) -> (f64, f64, f64) {
        (self.a, self.b + 0.5 * self.d / speed, self.c + 0.5 * self.d * speed)
    }
}

/// All limits at one station.
#[derive(Clone, Debug)]
pub struct Station {
    /// The place.
    pub point: PathPoint,
    /// Largest z by the drive speeds.
    pub cap: f64,
    /// Rows of the limited quantities, see [`Stations::quantities`].
    pub rows: Vec<Row>,
    /// At the ends of the path: the rows of torques and constraint forces once more, at rest, where there is no friction.
    pub rest: Vec<Row>,
    /// (ds/dx)³: ṡ² ds over ẋ² dx.
    pub weight: f64,
    /// Speed at which the rows' force laws are linearised.
    pub reference: f64,
}

/// Stations along a path.
#[derive(Clone, Debug)]
pub struct Stations {
    /// In order of s, first and last at the ends of the path.
    pub list: Vec<Station>,
    /// The limited quantities that the rows stand for, in order.
    pub quantities: Vec<usize>,
    /// Whether the path is eased at its ends: the robot rests there while its parameter moves on.
    pub eased: bool,
}

impl Stations {
    /// Places at `grid` with the limits on drive speeds and accelerations.
    pub fn new(machine: &Machine, curve: &Curve, limits: &Limits, grid: &[f64]) -> Result<Self, PlanError> {
        let usable = limits.usable();
        let quantities: Vec<usize> = (0..AXES).filter(|&k| usable[k].is_finite()).collect();
        let geometry = &machine.plant().geometry;
        let station = |&s: &f64| {
            let point = PathPoint::new(geometry, curve, s)
                .map_err(super::PlaceError::Pose)
                .and_then(|p| p.check(geometry).map(|()| p))
                .map_err(|source| PlanError::Place { s, at: curve.at(s)[0].into(), source })?;
            let [_, q1, q2, _] = &point.q;
            let fastest = (curve.end() / SHORTEST).powi(2);
            let cap = (0..AXES).map(|i| (limits.speed[i] / q1[i]).powi(2)).fold(fastest, f64::min);
            let rows = quantities.iter().map(|&k| Row { a: q1[k] / usable[k], b: q2[k] / usable[k], c: 0.0, d: 0.0 });
            Ok(Station {
                rows: rows.collect(),
                rest: Vec::new(),
                point,
                cap,
                weight: curve.way(s)[1].powi(3),
                reference: 1.0,
            })
        };
        Ok(Self { list: grid.iter().map(station).collect::<Result<_, _>>()?, quantities, eased: curve.is_eased() })
    }

    /// Adds the rows of torques and constraint forces, force laws linearised at `references`, or brings them up to date.
    pub fn load(&mut self, machine: &Machine, limits: &Limits, references: &[Reference]) -> Result<(), PlanError> {
        let usable = limits.usable();
        let loads: Vec<usize> = (0..LOADS).filter(|&k| usable[AXES + k].is_finite()).collect();
        let kinematic = self.quantities.iter().filter(|&&k| k < AXES).count();
        self.quantities.truncate(kinematic);
        self.quantities.extend(loads.iter().map(|k| AXES + k));
        let ends = [&self.list[0], &self.list[self.list.len() - 1]].map(|x| x.point.s);
        let update = |(station, reference): (&mut Station, &Reference)| {
            let s = station.point.s;
            let at = station.point.r[0].into();
            let all = machine.coefficients(&station.point, *reference).map_err(|e| PlanError::Place {
                s,
                at,
                source: super::PlaceError::Pose(e),
            })?;
            station.rows.truncate(kinematic);
            station.reference = reference.speed;
            let row = |all: &Coefficients, k: usize| {
                let [a, b, c, d] = [all.a[k], all.b[k], all.c[k], all.d[k]].map(|x| x / usable[AXES + k]);
                Row { a, b, c, d }
            };
            station.rows.extend(loads.iter().map(|&k| row(&all, k)));
            if station.rest.is_empty() && (s == ends[0] || s == ends[1]) {
                let still = Reference { speed: STILL, acceleration: 0.0 };
                let all = machine.coefficients(&station.point, still).map_err(|e| PlanError::Place {
                    s,
                    at,
                    source: super::PlaceError::Pose(e),
                })?;
                station.rest = loads.iter().map(|&k| Row { d: 0.0, ..row(&all, k) }).collect();
            }
            Ok(())
        };
        self.list.par_iter_mut().zip(references).try_for_each(update)
    }

    /// Number of intervals.
    pub fn intervals(&self) -> usize {
        self.list.len() - 1
    }

    /// Stations at which the parameter moves.
    pub fn moving(&self) -> std::ops::Range<usize> {
        if self.eased { 0..self.list.len() } else { 1..self.intervals() }
    }

    /// Intervals between two of these.
    pub fn inner(&self) -> std::ops::Range<usize> {
        if self.eased { 0..self.intervals() } else { 1..self.intervals() - 1 }
    }

    /// Length of interval `i` in s.
    pub fn length(&self, i: usize) -> f64 {
        self.list[i + 1].point.s - self.list[i].point.s
    }
}

/// How much of each row may be used at each station: one, less where a finer grid found more.
#[derive(Clone, Debug)]
pub struct Room {
    /// Per station and quantity; of the caps at the end.
    pub share: Vec<[f64; QUANTITIES + 1]>,
}

impl Room {
    /// All of it at `stations` stations.
    pub fn full(stations: usize) -> Self {
        Self { share: vec![[1.0; QUANTITIES + 1]; stations] }
    }

    /// Of the cap of station `i`.
    pub fn cap(&self, i: usize) -> f64 {
        self.share[i][QUANTITIES]
    }
}

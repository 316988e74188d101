//! Time-optimal z(s) without jerk limits by a backward and a forward pass along the path.
//!
//! s̈ is constant over an interval, so z = ṡ² is linear in s. Rows hold at both ends of every interval with its s̈.
//! For a given z they restrict s̈ to [L(z), U(z)]; each bound is (±1 − b z − c − d √z)/a of one row. In the backward
//! pass the largest controllable z at a grid point, from which the next one can be reached, is the largest with L ≤
//! U: where L > U, the difference of the two rows is a negative quadratic in √z, so no smaller z is feasible down to
//! its next root, and the search continues at that root (`Strips::largest`; without d this is Newton's method from
//! the right). The forward pass takes the largest s̈ within the controllable z, as in TOPP-RA [Pham 2018]. In
//! the backward pass √z at the end of an interval is replaced by its tangent, which is updated at the z reached until
//! both agree; in the forward pass z is known and √z exact.

use super::rows::{Grid, Row, Tightening};

/// The result of the passes.
#[derive(Clone, Debug)]
pub struct Passes {
    /// z at each grid point.
    pub z: Vec<f64>,
    /// s̈ in each interval.
    pub acceleration: Vec<f64>,
    /// Maximum velocity curve: largest z at each grid point on its own, 1/s².
    pub mvc: Vec<f64>,
}

/// Error: the limits permit no z at a grid point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stuck {
    /// Grid point.
    pub grid_point: usize,
}

/// Function α + β z + δ √z.
#[derive(Clone, Copy)]
struct Curved {
    constant: f64,
    slope: f64,
    bend: f64,
}

impl Curved {
    fn at(&self, z: f64, root: f64) -> f64 {
        self.constant + self.slope * z + self.bend * root
    }

    /// Largest √z below `root`, where the function is negative, at which it is zero; negative if that root lies below
    /// zero.
    fn root_below(&self, root: f64) -> Option<f64> {
        let Self { constant, slope, bend } = *self;
        let square = bend * bend - 4.0 * slope * constant;
        if square < 0.0 {
            return None;
        }
        // Of the two roots, the one at which the function decreases with √z.
        let found =
            if bend < 0.0 { 2.0 * constant / (square.sqrt() - bend) } else { -0.5 * (bend + square.sqrt()) / slope };
        (found <= root * (1.0 + 1e-9)).then_some(found)
    }
}

/// Bounds on s̈: [low, high] + slope·z + bend·√z.
#[derive(Clone, Copy)]
struct Strip {
    slope: f64,
    bend: f64,
    low: f64,
    high: f64,
}

/// Bounds on s̈ for given z, and bounds on z itself.
#[derive(Default)]
struct Strips {
    list: Vec<Strip>,
    /// Functions of z that must be non-negative.
    bare: Vec<Curved>,
    cap: f64,
}

impl Strips {
    fn clear(&mut self, cap: f64) {
        self.list.clear();
        self.bare.clear();
        self.cap = cap;
    }

    /// Keeps the first `strips` and `bare` rows only.
    fn truncate(&mut self, [strips, bare]: [usize; 2]) {
        self.list.truncate(strips);
        self.bare.truncate(bare);
    }

    /// Adds |a s̈ + b z + c + d √z| ≤ usable share.
    fn add(&mut self, row: Row, share: f64) {
        let Row { a, b, c, d } = row;
        if a.abs() > f64::MIN_POSITIVE.sqrt() {
            let (p, q) = ((share - c) / a, (-share - c) / a);
            self.list.push(Strip { slope: -b / a, bend: -d / a, low: p.min(q), high: p.max(q) });
        } else if b != 0.0 || d != 0.0 {
            for sign in [1.0, -1.0] {
                self.bare.push(Curved { constant: share - sign * c, slope: -sign * b, bend: -sign * d });
            }
        }
    }

    /// Upper and lower bound on s̈ at z, each with the strip that determines it.
    fn range(&self, z: f64, root: f64) -> [(f64, Option<&Strip>); 2] {
        let (mut upper, mut lower) = ((f64::INFINITY, None), (f64::NEG_INFINITY, None));
        for s in &self.list {
            let base = s.slope * z + s.bend * root;
            if s.high + base < upper.0 {
                upper = (s.high + base, Some(s));
            }
            if s.low + base > lower.0 {
                lower = (s.low + base, Some(s));
            }
        }
        [upper, lower]
    }

    /// A condition on z that is violated by more than `rounding`, if there is one.
    fn broken(&self, z: f64, rounding: f64) -> Option<Curved> {
        let root = z.sqrt();
        if let Some(bare) = self.bare.iter().find(|bare| bare.at(z, root) < -rounding) {
            return Some(*bare);
        }
        match self.range(z, root) {
            [(upper, Some(u)), (lower, Some(l))] if upper - lower < -rounding * (upper.abs() + lower.abs()) => {
                Some(Curved { constant: u.high - l.low, slope: u.slope - l.slope, bend: u.bend - l.bend })
            }
            _ => None,
        }
    }

    /// Whether L ≤ U, up to rounding.
    fn holds(&self, z: f64) -> bool {
        self.broken(z, 1e-9).is_none()
    }

    /// Largest z up to the cap with L ≤ U.
    fn largest(&self) -> Option<f64> {
        let mut z = self.cap;
        for _ in 0..100 {
            let Some(broken) = self.broken(z, 1e-12) else { return Some(z) };
            let root = broken.root_below(z.sqrt())?;
            if root < 0.0 {
                return self.holds(0.0).then_some(0.0);
            }
            let next = root * root;
            if next >= z {
                return Some(z);
            }
            z = next;
        }
        Some(z)
    }

    /// Adds the rows at grid point `i` in z of that point.
    fn here(&mut self, grid: &Grid, tightening: &Tightening, i: usize) {
        let grid_point = &grid.points[i];
        for (row, &k) in grid_point.rows.iter().zip(&grid.quantities) {
            self.add(*row, tightening.share[i][k]);
        }
        for row in &grid_point.rest {
            self.add(*row, 1.0);
        }
    }

    /// Adds the rows at grid point `i` + 1 in z of grid point `i`, z₊ = z + 2hs̈; √z₊ is replaced by its tangent at
    /// `z`.
    fn ahead(&mut self, grid: &Grid, tightening: &Tightening, i: usize, z: f64) {
        let (grid_point, h) = (&grid.points[i + 1], grid.length(i));
        let rows = grid_point.rows.iter().zip(&grid.quantities).map(|(row, &k)| (row, tightening.share[i + 1][k]));
        for (row, share) in rows.chain(grid_point.rest.iter().map(|row| (row, 1.0))) {
            let (a, b, c) = if z > 0.0 { row.tangent(z.sqrt()) } else { (row.a, row.b, row.c) };
            self.add(Row { a: a + 2.0 * h * b, b, c, d: 0.0 }, share);
        }
    }

    /// Adds the rows at grid point `i` + 1 as bounds on its own z for a given z of grid point `i`.
    fn arriving(&mut self, grid: &Grid, tightening: &Tightening, i: usize, z: f64) {
        let (grid_point, h) = (&grid.points[i + 1], grid.length(i));
        let rows = grid_point.rows.iter().zip(&grid.quantities).map(|(row, &k)| (row, tightening.share[i + 1][k]));
        for (row, share) in rows.chain(grid_point.rest.iter().map(|row| (row, 1.0))) {
            let a = 0.5 * row.a / h;
            self.add(Row { a: 0.0, b: a + row.b, c: row.c - a * z, d: row.d }, share);
        }
    }

    /// Adds the rows at grid point `i` with √z replaced by its tangent at the reference speed.
    fn linear(&mut self, grid: &Grid, tightening: &Tightening, i: usize) {
        let grid_point = &grid.points[i];
        for (row, &k) in grid_point.rows.iter().zip(&grid.quantities) {
            let (a, b, c) = row.tangent(grid_point.reference);
            self.add(Row { a, b, c, d: 0.0 }, tightening.share[i][k]);
        }
    }

    /// z + 2hs̈ at the end of an interval for the largest s̈ at z, at most `limit`.
    fn reached(&self, z: f64, h: f64, limit: f64) -> f64 {
        let [(upper, _), _] = self.range(z, z.sqrt());
        (z + 2.0 * h * upper).clamp(0.0, limit)
    }

    /// Adds 0 ≤ z + 2hs̈ ≤ limit.
    fn reach(&mut self, h: f64, limit: f64) {
        self.list.push(Strip { slope: -0.5 / h, bend: 0.0, low: 0.0, high: 0.5 * limit / h });
    }
}

/// Relative change of z at which the tangents to √z have converged; their error is an eighth of its square.
const SETTLED: f64 = 1e-4;
/// Largest number of tangents for one interval.
const MAX_TANGENTS: usize = 10;

/// Largest z at every grid point from rest to rest, within the usable shares of the rows.
///
/// # Errors
///
/// [`Stuck`] with the grid point at which the limits permit no z.
pub fn solve(grid: &Grid, tightening: &Tightening) -> Result<Passes, Stuck> {
    let mvc = maximum_velocity_curve(grid, tightening)?;
    let controllable = backward(grid, tightening, &mvc)?;
    let (z, acceleration) = forward(grid, tightening, &mvc, &controllable)?;
    Ok(Passes { z, acceleration, mvc })
}

/// The largest z at each grid point alone.
fn maximum_velocity_curve(grid: &Grid, tightening: &Tightening) -> Result<Vec<f64>, Stuck> {
    let mut strips = Strips::default();
    let largest = |i: usize| {
        strips.clear(grid.points[i].cap * tightening.cap(i));
        strips.here(grid, tightening, i);
        strips.largest().ok_or(Stuck { grid_point: i })
    };
    (0..grid.points.len()).map(largest).collect()
}

/// Largest controllable z at each grid point, from which rest at the end of the path can be reached.
fn backward(grid: &Grid, tightening: &Tightening, mvc: &[f64]) -> Result<Vec<f64>, Stuck> {
    let n = grid.intervals();
    let viscous = |i: usize| grid.points[i].rows.iter().any(|row| row.d != 0.0);
    let mut strips = Strips::default();
    let mut controllable = vec![0.0; n + 1];
    for i in (0..n).rev() {
        let (h, next) = (grid.length(i), controllable[i + 1]);
        strips.clear(mvc[i]);
        strips.reach(h, next);
        strips.here(grid, tightening, i);
        let own = [strips.list.len(), strips.bare.len()];
        let mut tangent = next;
        let mut found = None;
        for _ in 0..MAX_TANGENTS {
            strips.truncate(own);
            strips.ahead(grid, tightening, i, tangent);
            let Some(z) = strips.largest() else {
                // A tangent at a much larger z overestimates √z.
                tangent *= 0.25;
                continue;
            };
            found = Some(z);
            let reached = strips.reached(z, h, next);
            if (reached - tangent).abs() <= SETTLED * tangent || !viscous(i + 1) {
                break;
            }
            tangent = reached;
        }
        controllable[i] = found.ok_or(Stuck { grid_point: i })?;
    }
    Ok(controllable)
}

/// z at each grid point and s̈ in each interval of the motion with the largest s̈ within the controllable z.
fn forward(
    grid: &Grid,
    tightening: &Tightening,
    mvc: &[f64],
    controllable: &[f64],
) -> Result<(Vec<f64>, Vec<f64>), Stuck> {
    let n = grid.intervals();
    let (mut z, mut acceleration) = (vec![0.0; n + 1], vec![0.0; n]);
    let (mut strips, mut arriving) = (Strips::default(), Strips::default());
    for i in 0..n {
        let (h, limit) = (grid.length(i), controllable[i + 1]);
        strips.clear(mvc[i]);
        strips.reach(h, limit);
        strips.here(grid, tightening, i);
        let mut reach = |z: f64, strips: &Strips| {
            let [(upper, _), (lower, _)] = strips.range(z, z.sqrt());
            arriving.clear((z + 2.0 * h * upper).clamp(0.0, limit));
            arriving.arriving(grid, tightening, i, z);
            let next = arriving.largest()?;
            (next >= (z + 2.0 * h * lower) * (1.0 - 1e-9)).then_some(next)
        };
        let next = if strips.holds(z[i]) { reach(z[i], &strips) } else { None };
        z[i + 1] = match next {
            Some(next) => next,
            None => {
                // Close to the largest z, steep rows amplify rounding of z in s̈.
                strips.cap = z[i];
                strips.ahead(grid, tightening, i, limit);
                match strips.largest() {
                    Some(lower) if lower >= z[i] * (1.0 - 1e-6) => z[i] = lower,
                    _ => return Err(Stuck { grid_point: i }),
                }
                strips.reached(z[i], h, limit)
            }
        };
        acceleration[i] = 0.5 * (z[i + 1] - z[i]) / h;
    }
    Ok((z, acceleration))
}

/// Upper bound on z of every feasible motion, see [`super::certificate`]: z at the ends of the intervals, and the
/// largest deviation of z from a straight line over each interval, 1/s². The grid points alternate between ends and
/// middles of the intervals.
pub(super) fn relaxed(grid: &Grid) -> (Vec<f64>, Vec<f64>) {
    let n = grid.intervals() / 2;
    let tightening = Tightening::none(grid.points.len());
    let mut strips = Strips::default();
    let mut above: Vec<f64> = (0..=n)
        .map(|i| {
            strips.clear(grid.points[2 * i].cap);
            strips.linear(grid, &tightening, 2 * i);
            strips.largest().unwrap_or(grid.points[2 * i].cap)
        })
        .collect();
    let mut margin = vec![0.0; n];
    // Each round: the bound on z bounds s̈, which bounds ε, which bounds z.
    for _ in 0..BOUND_ROUNDS {
        let mut means: Vec<MeanRows> = (0..n).map(|i| MeanRows::new(grid, i, above[i].max(above[i + 1]))).collect();
        let mut largest = vec![0.0; n + 1];
        for i in (0..n).rev() {
            let MeanRows { strips, length, .. } = &mut means[i];
            strips.cap = strips.cap.min(above[i]);
            strips.reach(*length, largest[i + 1]);
            largest[i] = strips.largest().unwrap_or(strips.cap);
        }
        above[0] = 0.0;
        for i in 0..n {
            let MeanRows { strips, length, .. } = &means[i];
            let [(upper, _), _] = strips.range(above[i], 0.0);
            above[i + 1] = (above[i] + 2.0 * length * upper).clamp(0.0, largest[i + 1]);
        }
        margin = means.iter().map(|mean| mean.margin).collect();
    }
    (above, margin)
}

/// Number of rounds in which the bounds on z, s̈ and ε update each other.
const BOUND_ROUNDS: usize = 4;

/// Rows averaged over an interval, see [`super::certificate`].
struct MeanRows {
    /// The averaged rows with right sides 1 + ε.
    strips: Strips,
    /// Length of the interval in s.
    length: f64,
    /// Bound on the deviation of z from a straight line, 1/s².
    margin: f64,
}

impl MeanRows {
    /// Averaged rows of interval `i`, between the grid points 2i and 2i + 2, for z up to `most` at both ends.
    fn new(grid: &Grid, i: usize, most: f64) -> Self {
        let [left, here, right] = [0, 1, 2].map(|k| &grid.points[2 * i + k]);
        let h = right.point.s - left.point.s;
        let rows = || (0..here.rows.len()).map(|r| [left, here, right].map(|s| s.rows[r].tangent(s.reference)));
        let least = |(a, b, c): (f64, f64, f64), top: f64| (1.0 + b.abs() * top + c.abs()) / a.abs();
        // Within the interval z may exceed both ends, by an amount limited by s̈.
        let bound = |top: f64| {
            rows().map(|row| row.map(|r| least(r, top)).into_iter().fold(0.0, f64::max)).fold(f64::INFINITY, f64::min)
        };
        let mut top = most;
        for _ in 0..3 {
            top = most + h * bound(top);
        }
        let acceleration = bound(top);
        let margin = h * acceleration;
        let mut strips = Strips::default();
        strips.clear(f64::INFINITY);
        for [l, m, r] in rows() {
            let mean = |l: f64, m: f64, r: f64| (l + 4.0 * m + r) / 6.0;
            let bend = |l: f64, m: f64, r: f64| (l - 2.0 * m + r).abs();
            let (a, b, c) = (mean(l.0, m.0, r.0), mean(l.1, m.1, r.1), mean(l.2, m.2, r.2));
            let excess = (0.25 * (r.0 - l.0).abs() + bend(l.0, m.0, r.0)) * acceleration
                + bend(l.1, m.1, r.1) * top
                + bend(l.2, m.2, r.2)
                + (0.5 * b.abs() + 0.5 * (r.1 - l.1).abs()) * margin;
            strips.add(Row { a: a + h * b, b, c, d: 0.0 }, 1.0 + excess);
        }
        Self { strips, length: h, margin }
    }
}

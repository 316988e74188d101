//! Time-optimal z(s) without jerk limits: one pass back along the path, one forth.
//!
//! s̈ is constant over an interval, so z = ṡ² is linear in s. Rows hold at both ends of every interval with its s̈. For a
//! given z the rows are linear in s̈ and leave s̈ ∈ [L(z), U(z)] with L convex and U concave: the largest z at a station
//! from which the next one can be reached is where L = U, found by Newton's method from the right, which is exact after
//! a few steps. Back along the path this gives the largest controllable z, forth the largest s̈ within it, as in TOPP-RA
//! [Pham & Pham, 2018]. √z stands for its tangent at the reference speed, see [`super::rows`].

use super::rows::{Room, Stations};

/// What the passes found.
#[derive(Clone, Debug)]
pub struct Passes {
    /// z at each station.
    pub z: Vec<f64>,
    /// s̈ in each interval.
    pub acceleration: Vec<f64>,
    /// Maximum velocity curve: largest z at each station alone.
    pub mvc: Vec<f64>,
}

/// There is no z at a station.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stuck {
    /// Station.
    pub station: usize,
}

/// u ∈ [low + slope·z, high + slope·z].
#[derive(Clone, Copy)]
struct Strip {
    slope: f64,
    low: f64,
    high: f64,
}

/// Bounds on u for given z, and a bound on z itself.
#[derive(Default)]
struct Strips {
    list: Vec<Strip>,
    cap: f64,
}

impl Strips {
    fn clear(&mut self, cap: f64) {
        self.list.clear();
        self.cap = cap;
    }

    /// |a u + b z + c| ≤ room.
    fn add(&mut self, a: f64, b: f64, c: f64, room: f64) {
        if a.abs() > f64::MIN_POSITIVE.sqrt() {
            let (p, q) = ((room - c) / a, (-room - c) / a);
            self.list.push(Strip { slope: -b / a, low: p.min(q), high: p.max(q) });
        } else if b != 0.0 {
            self.cap = self.cap.min((room.copysign(b) - c) / b);
        }
    }

    /// U(z), L(z) with their slopes.
    fn range(&self, z: f64) -> [(f64, f64); 2] {
        let (mut upper, mut lower) = ((f64::INFINITY, 0.0), (f64::NEG_INFINITY, 0.0));
        for s in &self.list {
            let base = s.slope * z;
            if s.high + base < upper.0 {
                upper = (s.high + base, s.slope);
            }
            if s.low + base > lower.0 {
                lower = (s.low + base, s.slope);
            }
        }
        [upper, lower]
    }

    /// Whether L ≤ U, up to rounding.
    fn holds(&self, z: f64) -> bool {
        let [(upper, _), (lower, _)] = self.range(z);
        upper - lower >= -1e-9 * (upper.abs() + lower.abs())
    }

    /// Largest z up to the cap for which L ≤ U.
    fn largest(&self) -> Option<f64> {
        let mut z = self.cap;
        for _ in 0..100 {
            let [(upper, rise), (lower, fall)] = self.range(z);
            let gap = upper - lower;
            if gap >= -1e-12 * (upper.abs() + lower.abs()) {
                return Some(z);
            }
            let slope = rise - fall;
            if slope >= 0.0 {
                return None;
            }
            let next = z - gap / slope;
            if next < 0.0 {
                return self.holds(0.0).then_some(0.0);
            }
            if next >= z {
                return Some(z);
            }
            z = next;
        }
        Some(z)
    }
}

impl Strips {
    /// Rows at station `i` with its own z.
    fn here(&mut self, stations: &Stations, room: &Room, i: usize) {
        let station = &stations.list[i];
        for (row, &k) in station.rows.iter().zip(&stations.quantities) {
            let (a, b, c) = row.tangent(station.reference);
            self.add(a, b, c, room.share[i][k]);
        }
        for row in &station.rest {
            self.add(row.a, row.b, row.c, 1.0);
        }
    }

    /// Rows at station `i` + 1, whose z is that of station `i` plus 2hu.
    fn ahead(&mut self, stations: &Stations, room: &Room, i: usize) {
        let (station, h) = (&stations.list[i + 1], stations.length(i));
        for (row, &k) in station.rows.iter().zip(&stations.quantities) {
            let (a, b, c) = row.tangent(station.reference);
            self.add(a + 2.0 * h * b, b, c, room.share[i + 1][k]);
        }
        for row in &station.rest {
            self.add(row.a + 2.0 * h * row.b, row.b, row.c, 1.0);
        }
    }

    /// 0 ≤ z + 2hu ≤ limit.
    fn reach(&mut self, h: f64, limit: f64) {
        self.list.push(Strip { slope: -0.5 / h, low: 0.0, high: 0.5 * limit / h });
    }
}

/// z at rest at both ends of the path.
pub fn solve(stations: &Stations, room: &Room) -> Result<Passes, Stuck> {
    let n = stations.intervals();
    let cap = |i: usize| stations.list[i].cap * room.cap(i);
    let mut strips = Strips::default();
    let mut mvc = vec![0.0; n + 1];
    for i in 0..=n {
        strips.clear(cap(i));
        strips.here(stations, room, i);
        mvc[i] = strips.largest().ok_or(Stuck { station: i })?;
    }
    let mut largest = vec![0.0; n + 1];
    for i in (0..n).rev() {
        strips.clear(mvc[i]);
        strips.reach(stations.length(i), largest[i + 1]);
        strips.here(stations, room, i);
        strips.ahead(stations, room, i);
        largest[i] = strips.largest().ok_or(Stuck { station: i })?;
    }
    let (mut z, mut acceleration) = (vec![0.0; n + 1], vec![0.0; n]);
    for i in 0..n {
        let h = stations.length(i);
        strips.clear(mvc[i]);
        strips.reach(h, largest[i + 1]);
        strips.here(stations, room, i);
        strips.ahead(stations, room, i);
        if !strips.holds(z[i]) {
            // Next to the largest z steep rows turn rounding of z into much of s̈.
            strips.cap = z[i];
            match strips.largest() {
                Some(lower) if lower >= z[i] * (1.0 - 1e-6) => z[i] = lower,
                _ => return Err(Stuck { station: i }),
            }
        }
        let [(upper, _), _] = strips.range(z[i]);
        z[i + 1] = (z[i] + 2.0 * h * upper).clamp(0.0, largest[i + 1]);
        acceleration[i] = 0.5 * (z[i + 1] - z[i]) / h;
    }
    Ok(Passes { z, acceleration, mvc })
}

/// z(s) above that of every feasible motion, see [`super::certificate`]; `stations` are ends and middles of the intervals in
/// turn. Returns z at the ends and by how much z may depart from a straight line over each interval.
pub(super) fn relaxed(stations: &Stations) -> (Vec<f64>, Vec<f64>) {
    let n = stations.intervals() / 2;
    let room = Room::full(stations.list.len());
    let mut strips = Strips::default();
    let mut above: Vec<f64> = (0..=n)
        .map(|i| {
            strips.clear(stations.list[2 * i].cap);
            strips.here(stations, &room, 2 * i);
            strips.largest().unwrap_or(stations.list[2 * i].cap)
        })
        .collect();
    let mut margin = vec![0.0; n];
    // What z cannot exceed bounds s̈, which bounds the slack, which bounds z.
    for _ in 0..TURNS {
        let mut means: Vec<(Strips, f64)> = Vec::with_capacity(n);
        for i in 0..n {
            means.push(mean_rows(stations, i, above[i].max(above[i + 1]), &mut margin[i]));
        }
        let mut largest = vec![0.0; n + 1];
        for i in (0..n).rev() {
            let (strips, h) = &mut means[i];
            strips.cap = strips.cap.min(above[i]);
            strips.reach(*h, largest[i + 1]);
            largest[i] = strips.largest().unwrap_or(strips.cap);
        }
        above[0] = 0.0;
        for i in 0..n {
            let (strips, h) = &means[i];
            let [(upper, _), _] = strips.range(above[i]);
            above[i + 1] = (above[i] + 2.0 * h * upper).clamp(0.0, largest[i + 1]);
        }
    }
    (above, margin)
}

/// Rounds of the bootstrap.
const TURNS: usize = 4;

/// Rows averaged over interval `i` between the ends 2i and 2i + 2, with the slack they need for z up to `most`; its length.
/// Sets how far z may depart from a straight line.
fn mean_rows(stations: &Stations, i: usize, most: f64, margin: &mut f64) -> (Strips, f64) {
    let [left, here, right] = [0, 1, 2].map(|k| &stations.list[2 * i + k]);
    let h = right.point.s - left.point.s;
    let rows = || (0..here.rows.len()).map(|r| [left, here, right].map(|s| s.rows[r].tangent(s.reference)));
    let least = |(a, b, c): (f64, f64, f64), top: f64| (1.0 + b.abs() * top + c.abs()) / a.abs();
    // z between the ends may be above both by as much as s̈ allows.
    let bound = |top: f64| {
        rows().map(|row| row.map(|r| least(r, top)).into_iter().fold(0.0, f64::max)).fold(f64::INFINITY, f64::min)
    };
    let mut top = most;
    for _ in 0..3 {
        top = most + h * bound(top);
    }
    let acceleration = bound(top);
    *margin = h * acceleration;
    let mut strips = Strips::default();
    strips.clear(f64::INFINITY);
    for [l, m, r] in rows() {
        let mean = |l: f64, m: f64, r: f64| (l + 4.0 * m + r) / 6.0;
        let bend = |l: f64, m: f64, r: f64| (l - 2.0 * m + r).abs();
        let (a, b, c) = (mean(l.0, m.0, r.0), mean(l.1, m.1, r.1), mean(l.2, m.2, r.2));
        let slack = (0.25 * (r.0 - l.0).abs() + bend(l.0, m.0, r.0)) * acceleration
            + bend(l.1, m.1, r.1) * top
            + bend(l.2, m.2, r.2)
            + (0.5 * b.abs() + 0.5 * (r.1 - l.1).abs()) * *margin;
        strips.add(a + h * b, b, c, 1.0 + slack);
    }
    (strips, h)
}

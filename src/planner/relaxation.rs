//! A lower bound on the time of every motion along a grid with jerk limits, by a convex relaxation.
//!
//! A drive's acceleration changes over an interval by no more than its jerk limit times the time τ spent there,
//! |q̈ᵢ₊₁ − q̈ᵢ| ≤ J τᵢ, and q̈ = q″ z + q′ s̈ is linear in z and s̈. By Jensen's inequality τ ≥ h z̄^(−1/2), where z̄ is the mean of z,
//! linear in z and s̈ as well. With τ as a variable of its own both are convex, and so is Σ τ: what is given up is only that
//! τ may be larger than z makes it. More time than needed pays for more jerk, and is paid for in full; where an optimal
//! motion would not gain by that the relaxation is exact. There is no assumption on how slow a motion may be anywhere.
//!
//! Friction D √z takes a variable ω for the root, z/√u ≤ ω ≤ √z with z ≤ u; rows of loads, speeds and accelerations hold at the
//! stations. The motions are those whose s̈ is linear in s over every interval, with s ∝ t³ at both ends of the path.
//!
//! Where time is traded for jerk, the bound can be tightened ([`tightened`]): minimising and maximising z within the relaxation finds
//! the range of z of all motions that take no longer than the one at hand; over it h z^(−1/2) lies below its chord, and so must τ.

use clarabel::solver::SupportedConeT;
use rayon::prelude::*;

use super::jerk::{Course, Programme, Watch, jerk_row, ramp_caps};
use super::limits::Limits;
use super::rows::{Station, Stations};
use crate::machine::AXES;

/// Parts of an interval whose times are bounded one by one.
const PARTS: usize = 2;
/// Rounds of confining z.
const ROUNDS: usize = 8;
/// Time in an interval over what z makes it from which time is traded for jerk there.
const TRADED: f64 = 1.001;
/// Gain of a round, relative to the time, below which there is no other.
const LEAST_GAIN: f64 = 2e-4;
/// Solver's tolerance that ranges of z are widened by, in units of z.
const CARE: f64 = 1e-6;

/// Lower bound on the time, s. `at` is a good motion, by which variables are scaled; `above` lies above z at every station.
/// Of the loads the rows in `watch` enter.
pub fn bound(stations: &Stations, limits: &Limits, watch: &Watch, at: &Course, above: &[f64]) -> Option<f64> {
    Relaxation::new(stations, limits, watch, at, above).solve(Goal::Time, f64::INFINITY).map(|found| found.bound)
}

/// The same with z confined in rounds until the gap to the time of `at` is below `enough`, relative, or hardly shrinks.
pub fn tightened(
    stations: &Stations,
    limits: &Limits,
    watch: &Watch,
    at: &Course,
    above: &[f64],
    enough: f64,
) -> Option<f64> {
    let mut relaxation = Relaxation::new(stations, limits, watch, at, above);
    let time = at.profile(stations).time();
    let mut found = relaxation.solve(Goal::Time, f64::INFINITY)?;
    for _ in 0..ROUNDS {
        if time - found.bound <= enough * time {
            break;
        }
        let traded: Vec<usize> = stations.inner().filter(|&i| found.traded[i] > TRADED).collect();
        let ranges: Vec<_> = traded.into_par_iter().map(|i| (i, relaxation.confine(i, time))).collect();
        for (i, range) in ranges {
            relaxation.range[i] = range;
        }
        let next = relaxation.solve(Goal::Time, f64::INFINITY)?;
        let gain = next.bound - found.bound;
        found = next;
        if gain < LEAST_GAIN * time {
            break;
        }
    }
    Some(found.bound)
}

/// What is minimised.
#[derive(Clone, Copy)]
enum Goal {
    /// The time.
    Time,
    /// A control point of the parabola z over an interval, times the sign.
    Point { interval: usize, point: usize, sign: f64 },
}

/// An optimum of the relaxation.
struct Optimum {
    /// Lower bound on its value by the dual, s, or in units of z at the interval's start.
    bound: f64,
    /// Time over what z makes it, per interval; zero for both ramps.
    traded: Vec<f64>,
}

struct Relaxation<'a> {
    stations: &'a Stations,
    limits: &'a Limits,
    watch: &'a Watch,
    at: &'a Course,
    above: &'a [f64],
    /// Ranges of the three control points of the parabola z over each interval, between which z lies.
    range: Vec<[[f64; 2]; 3]>,
}

impl<'a> Relaxation<'a> {
    fn new(stations: &'a Stations, limits: &'a Limits, watch: &'a Watch, at: &'a Course, above: &'a [f64]) -> Self {
        let range = vec![[[0.0, f64::INFINITY]; 3]; stations.intervals()];
        Self { stations, limits, watch, at, above, range }
    }

    /// Ranges of the control points over interval `i` for motions that take no longer than `time`.
    fn confine(&self, i: usize, time: f64) -> [[f64; 2]; 3] {
        let unit = self.at.z[i];
        std::array::from_fn(|point| {
            let [low, high] = self.range[i][point];
            let bound = |sign: f64| {
                self.solve(Goal::Point { interval: i, point, sign }, time).map(|found| sign * found.bound * unit)
            };
            let least = bound(1.0).map_or(low, |x| low.max(x - CARE * unit));
            let most = bound(-1.0).map_or(high, |x| high.min(x + CARE * unit));
            [least, most]
        })
    }

    /// Of the mean of z − z₀ = 2 b₀ σ + (b₁ − b₀) σ²/h over a part of interval `i`: the factors of b₀ and of b₁ − b₀.
    fn mean(&self, i: usize, part: usize) -> [f64; 2] {
        let h = self.stations.length(i);
        let [from, to] = [part, part + 1].map(|k| k as f64 / PARTS as f64);
        [h * (from + to), h * (from * from + from * to + to * to) / 3.0]
    }

    /// The optimum; motions that take longer than `within` are left out.
    fn solve(&self, goal: Goal, within: f64) -> Option<Optimum> {
        let Self { stations, limits, watch, at, above, range } = self;
        let n = stations.intervals();
        let (moving, inner) = (stations.moving(), stations.inner());
        let (first, count) = (moving.start, moving.len());
        let length = stations.list[n].point.s - stations.list[0].point.s;
        let unit: f64 = moving.clone().map(|i| at.z[i] / length).fold(0.0, f64::max);
        let (zs, bs) = (|i: usize| at.z[i], 4.0 * unit);
        let (zv, bv, wv) = (|i: usize| i - first, |i: usize| count + i - first, |i: usize| 2 * count + i - first);
        // Times and the roots of means, over the parts of the inner intervals; times of the ramps, if there are any.
        let tv = |i: usize, part: usize| 3 * count + (i - first) * PARTS + part;
        let mv = |i: usize, part: usize| 3 * count + (inner.len() + i - first) * PARTS + part;
        let ramps = 3 * count + 2 * inner.len() * PARTS;
        let ends = match stations.eased {
            true => Vec::new(),
            false => vec![(1, 1.0, stations.length(0)), (n - 1, -1.0, stations.length(n - 1))],
        };
        let columns = ramps + ends.len();
        // Times of the parts and of the ramps in units of those of `at`.
        let middle = |i: usize| 0.5 * (zs(i) + zs(i + 1));
        let time = |i: usize| stations.length(i) / (PARTS as f64 * middle(i).sqrt());
        let ramp = |k: usize| 3.0 * ends[k].2 / zs(ends[k].0).sqrt();
        let mut times: Vec<(usize, f64)> =
            inner.clone().flat_map(|i| [(tv(i, 0), time(i)), (tv(i, 1), time(i))]).collect();
        times.extend((0..ends.len()).map(|k| (ramps + k, ramp(k))));
        // Control points z, z + b h and z₊.
        let control = |i: usize, point: usize| match point {
            0 => [(zv(i), zs(i)), (bv(i), 0.0)],
            1 => [(zv(i), zs(i)), (bv(i), stations.length(i) * bs)],
            _ => [(zv(i + 1), zs(i + 1)), (bv(i), 0.0)],
        };

        let mut p = Programme::default();
        for i in inner.clone() {
            let (h, scale) = (stations.length(i), 1.0 / zs(i).max(zs(i + 1)));
            let step = -h * bs * scale;
            p.row(&[(zv(i + 1), zs(i + 1) * scale), (zv(i), -zs(i) * scale), (bv(i), step), (bv(i + 1), step)], 0.0);
        }
        if stations.eased {
            p.row(&[(bv(0), 1.0), (bv(1), -1.0)], 0.0);
            p.row(&[(bv(n), 1.0), (bv(n - 1), -1.0)], 0.0);
        }
        for &(i, sign, h) in &ends {
            p.row(&[(bv(i), 1.0), (zv(i), -sign * 2.0 / 3.0 * zs(i) / (h * bs))], 0.0);
        }
        let equalities = p.right.len();

        let caps = ramp_caps(stations, limits, &vec![[1.0; AXES]; n + 1]);
        for i in moving.clone() {
            let mut cap = stations.list[i].cap.min(above[i]);
            if stations.eased && (i == 0 || i == n) {
                cap = cap.min(at_rest(&stations.list[i], limits));
            }
            for ((neighbour, ..), ramp) in ends.iter().zip(caps) {
                if i == *neighbour {
                    cap = cap.min(ramp);
                }
            }
            p.row(&[(zv(i), zs(i) / cap)], 1.0);
            // ω in units of √z.
            p.row(&[(zv(i), (zs(i) / cap).sqrt()), (wv(i), -1.0)], 0.0);
            // At rest the rows of loads are constant.
            let rows = if i == 0 || i == n { &[] } else { stations.list[i].rows.as_slice() };
            for (r, row) in rows.iter().enumerate() {
                for sign in watch.signs(i, r) {
                    let (a, b, d) = (sign * row.a * bs, sign * row.b * zs(i), sign * row.d * zs(i).sqrt());
                    p.row(&[(bv(i), a), (zv(i), b), (wv(i), d)], 1.0 - sign * row.c);
                }
            }
        }
        for axis in (0..AXES).filter(|&k| limits.jerk[k].is_finite()) {
            // q̈ over the jerk limit.
            let acceleration = |i: usize, sign: f64| {
                let [_, second, first] = jerk_row(&stations.list[i], limits, axis);
                [(zv(i), sign * second / 3.0 * zs(i)), (bv(i), sign * first * bs)]
            };
            for sign in [1.0, -1.0] {
                for i in inner.clone() {
                    let mut terms = [acceleration(i, -sign), acceleration(i + 1, sign)].concat();
                    terms.extend((0..PARTS).map(|part| (tv(i, part), -time(i))));
                    scaled(&mut p, &terms, time(i));
                }
                for (k, &(i, ..)) in ends.iter().enumerate() {
                    let mut terms = acceleration(i, sign).to_vec();
                    terms.push((ramps + k, -ramp(k)));
                    scaled(&mut p, &terms, ramp(k));
                }
            }
        }
        for i in inner.clone() {
            let h = stations.length(i);
            for (point, [low, high]) in range[i].into_iter().enumerate() {
                for (sign, side) in [(-1.0, low), (1.0, high)] {
                    if side > 0.0 && side.is_finite() {
                        let terms = control(i, point).map(|(column, value)| (column, sign * value / zs(i)));
                        p.row(&terms, sign * side / zs(i));
                    }
                }
            }
            let low = range[i].iter().fold(f64::INFINITY, |m, r| m.min(r[0]));
            let high = range[i].iter().fold(0.0f64, |m, r| m.max(r[1]));
            if low > 0.0 && high.is_finite() && high > low {
                // Σ τ below the chord at the mean z₀ + (2 b₀ + b₁) h/3.
                let slope = (high.sqrt().recip() - low.sqrt().recip()) / (high - low);
                let offset = low.sqrt().recip() - slope * low;
                let unit = PARTS as f64 * time(i);
                let bend = -h * slope * bs * h / 3.0;
                let mut terms =
                    vec![(zv(i), -h * slope * zs(i) / unit), (bv(i), 2.0 * bend / unit), (bv(i + 1), bend / unit)];
                terms.extend((0..PARTS).map(|part| (tv(i, part), time(i) / unit)));
                p.row(&terms, h * offset / unit);
            }
        }
        if within.is_finite() {
            let terms: Vec<_> = times.iter().map(|(column, time)| (*column, time / within)).collect();
            p.row(&terms, 1.0);
        }
        let bounded = p.right.len();

        // ω² ≤ z; μ² ≤ z̄ and τ μ ≥ h over a part; τ ω ≥ 3h over a ramp.
        for i in moving {
            square(&mut p, &[(zv(i), 1.0)], wv(i));
        }
        for i in inner.clone() {
            for part in 0..PARTS {
                let [line, bend] = self.mean(i, part).map(|v| v * bs / middle(i));
                let terms = [(zv(i), zs(i) / middle(i)), (bv(i), line - bend), (bv(i + 1), bend)];
                square(&mut p, &terms, mv(i, part));
                product(&mut p, tv(i, part), mv(i, part));
            }
        }
        for (k, &(i, ..)) in ends.iter().enumerate() {
            product(&mut p, ramps + k, wv(i));
        }
        let cones = (p.right.len() - bounded) / 3;

        let mut cost = vec![0.0; columns];
        match goal {
            Goal::Time => times.iter().for_each(|(column, time)| cost[*column] = *time),
            Goal::Point { interval, point, sign } => {
                for (column, value) in control(interval, point) {
                    cost[column] = sign * value / zs(interval);
                }
            }
        }
        let scale = 1.0 / cost.iter().map(|c| c.abs()).sum::<f64>();
        cost.iter_mut().for_each(|c| *c *= scale);
        let mut kinds =
            vec![SupportedConeT::ZeroConeT(equalities), SupportedConeT::NonnegativeConeT(bounded - equalities)];
        kinds.extend((0..cones).map(|_| SupportedConeT::SecondOrderConeT(3)));
        let solution = p.solve(columns, &cost, &kinds)?;
        let x = &solution.x;
        let mut traded = vec![0.0; n];
        for i in inner.clone() {
            let needed = |part: usize| {
                let [line, bend] = self.mean(i, part);
                let z = x[zv(i)] * zs(i) + ((line - bend) * x[bv(i)] + bend * x[bv(i + 1)]) * bs;
                (middle(i) / z).sqrt()
            };
            traded[i] = (x[tv(i, 0)] + x[tv(i, 1)]) / (needed(0) + needed(1));
        }
        Some(Optimum { bound: solution.obj_val_dual / scale, traded })
    }
}

/// Largest z at an end of an eased path, where q′ = q″ = 0 and a drive's jerk is q‴ z^(3/2).
fn at_rest(station: &Station, limits: &Limits) -> f64 {
    let third = (0..AXES).map(|k| jerk_row(station, limits, k)[0].abs()).fold(0.0, f64::max);
    third.powf(-2.0 / 3.0)
}

/// Σ terms ≤ 0 in units of `unit`.
fn scaled(p: &mut Programme, terms: &[(usize, f64)], unit: f64) {
    let terms: Vec<_> = terms.iter().map(|(column, value)| (*column, value / unit)).collect();
    p.row(&terms, 0.0);
}

/// x² ≤ Σ terms: (y + 1, y − 1, 2x) in the cone.
fn square(p: &mut Programme, terms: &[(usize, f64)], x: usize) {
    let negative: Vec<_> = terms.iter().map(|(column, value)| (*column, -value)).collect();
    p.row(&negative, 1.0);
    p.row(&negative, -1.0);
    p.row(&[(x, -2.0)], 0.0);
}

/// x y ≥ 1: (x + y, x − y, 2) in the cone.
fn product(p: &mut Programme, x: usize, y: usize) {
    p.row(&[(x, -1.0), (y, -1.0)], 0.0);
    p.row(&[(x, -1.0), (y, 1.0)], 0.0);
    p.row(&[], 2.0);
}

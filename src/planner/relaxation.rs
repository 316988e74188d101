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

use clarabel::solver::SupportedConeT;

use super::jerk::{Course, Programme, Watch, jerk_row, ramp_caps};
use super::limits::Limits;
use super::rows::Stations;
use crate::model::AXES;

/// Parts of an interval whose times are bounded one by one.
const PARTS: usize = 2;

/// Lower bound on the time, s. `at` is a good motion, by which variables are scaled; `above` lies above z at every station.
/// Of the loads the rows in `watch` enter.
pub fn bound(stations: &Stations, limits: &Limits, watch: &Watch, at: &Course, above: &[f64]) -> Option<f64> {
    let n = stations.intervals();
    let inner = n - 1;
    let unit: f64 = (1..n).map(|i| at.z[i] / (stations.list[n].point.s - stations.list[0].point.s)).fold(0.0, f64::max);
    let (zs, bs) = (|i: usize| at.z[i], 4.0 * unit);
    let (zv, bv, wv) = (|i: usize| i - 1, |i: usize| inner + i - 1, |i: usize| 2 * inner + i - 1);
    // Times and the roots of means, over the parts of the inner intervals; times of the two ramps.
    let tv = |i: usize, part: usize| 3 * inner + (i - 1) * PARTS + part;
    let mv = |i: usize, part: usize| 3 * inner + (n - 2 + i - 1) * PARTS + part;
    let ramps = 3 * inner + 2 * (n - 2) * PARTS;
    let columns = ramps + 2;
    let ends = [(0, 1, 1.0, stations.length(0)), (n, n - 1, -1.0, stations.length(n - 1))];

    let mut p = Programme::default();
    for i in 1..n - 1 {
        let (h, scale) = (stations.length(i), 1.0 / zs(i).max(zs(i + 1)));
        let step = -h * bs * scale;
        p.row(&[(zv(i + 1), zs(i + 1) * scale), (zv(i), -zs(i) * scale), (bv(i), step), (bv(i + 1), step)], 0.0);
    }
    for (_, i, sign, h) in ends {
        p.row(&[(bv(i), 1.0), (zv(i), -sign * 2.0 / 3.0 * zs(i) / (h * bs))], 0.0);
    }
    let equalities = p.right.len();

    let caps = ramp_caps(stations, limits, &vec![[1.0; AXES]; n + 1]);
    for i in 1..n {
        let mut cap = stations.list[i].cap.min(above[i]);
        for ((_, neighbour, ..), ramp) in ends.iter().zip(caps) {
            if i == *neighbour {
                cap = cap.min(ramp);
            }
        }
        p.row(&[(zv(i), zs(i) / cap)], 1.0);
        // ω in units of √z.
        p.row(&[(zv(i), (zs(i) / cap).sqrt()), (wv(i), -1.0)], 0.0);
        for (r, row) in stations.list[i].rows.iter().enumerate() {
            for sign in watch.signs(i, r) {
                let terms =
                    [(bv(i), sign * row.a * bs), (zv(i), sign * row.b * zs(i)), (wv(i), sign * row.d * zs(i).sqrt())];
                p.row(&terms, 1.0 - sign * row.c);
            }
        }
    }
    // Times of the intervals in units of those of `at`.
    let mean = |i: usize| 0.5 * (zs(i) + zs(i + 1));
    let time = |i: usize| stations.length(i) / (PARTS as f64 * mean(i).sqrt());
    let ramp = |k: usize| 3.0 * ends[k].3 / zs(ends[k].1).sqrt();
    for axis in (0..AXES).filter(|&k| limits.jerk[k].is_finite()) {
        // q̈ over the jerk limit.
        let acceleration = |i: usize, sign: f64| {
            let [_, second, first] = jerk_row(&stations.list[i], limits, axis);
            [(zv(i), sign * second / 3.0 * zs(i)), (bv(i), sign * first * bs)]
        };
        for sign in [1.0, -1.0] {
            for i in 1..n - 1 {
                let mut terms = [acceleration(i, -sign), acceleration(i + 1, sign)].concat();
                terms.extend((0..PARTS).map(|part| (tv(i, part), -time(i))));
                scaled(&mut p, &terms, time(i));
            }
            for (k, (_, i, ..)) in ends.iter().enumerate() {
                let mut terms = acceleration(*i, sign).to_vec();
                terms.push((ramps + k, -ramp(k)));
                scaled(&mut p, &terms, ramp(k));
            }
        }
    }
    let bounded = p.right.len();

    // ω² ≤ z; μ² ≤ z̄ and τ μ ≥ h; τ ω ≥ 3h over a ramp.
    for i in 1..n {
        square(&mut p, &[(zv(i), 1.0)], wv(i));
    }
    for i in 1..n - 1 {
        let h = stations.length(i);
        for part in 0..PARTS {
            let [from, to] = [part, part + 1].map(|k| k as f64 / PARTS as f64);
            // Mean of z = z₀ + 2 b₀ σ + (b₁ − b₀) σ²/h.
            let (line, bend) = (h * (from + to), h * (from * from + from * to + to * to) / 3.0);
            let terms =
                [(zv(i), zs(i) / mean(i)), (bv(i), (line - bend) * bs / mean(i)), (bv(i + 1), bend * bs / mean(i))];
            square(&mut p, &terms, mv(i, part));
            product(&mut p, tv(i, part), mv(i, part));
        }
    }
    for (k, (_, i, ..)) in ends.iter().enumerate() {
        product(&mut p, ramps + k, wv(*i));
    }
    let cones = (p.right.len() - bounded) / 3;

    let mut cost = vec![0.0; columns];
    for i in 1..n - 1 {
        (0..PARTS).for_each(|part| cost[tv(i, part)] = time(i));
    }
    (0..2).for_each(|k| cost[ramps + k] = ramp(k));
    let scale = 1.0 / cost.iter().sum::<f64>();
    cost.iter_mut().for_each(|c| *c *= scale);
    let mut kinds = vec![SupportedConeT::ZeroConeT(equalities), SupportedConeT::NonnegativeConeT(bounded - equalities)];
    kinds.extend((0..cones).map(|_| SupportedConeT::SecondOrderConeT(3)));
    p.solve(columns, &cost, &kinds).map(|solution| solution.obj_val_dual / scale)
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

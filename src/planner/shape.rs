//! Shapes of paths: lines with blended corners, B-splines, curves through waypoints, arches.

use nalgebra::Vector4;

use super::Curve;
use crate::scenario::motion::table::Table;

/// What a path file asks for; waypoints (x, y, z, ψ) in m and rad.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Straight lines between waypoints, each corner rounded from the distance `blend` (m) before it to the same after it.
    Lines {
        /// Corners with both ends; neighbours apart.
        points: Vec<[f64; 4]>,
        /// Distance from a corner at which its blend begins, m; at most half of a line is used.
        blend: f64,
        /// Length that a turn of ψ by 1 rad counts, m.
        turn_radius: f64,
    },
    /// Quintic B-spline with clamped ends.
    BSpline {
        /// Control points, at least five; the path begins at the first and ends at the last.
        points: Vec<[f64; 4]>,
        /// Polynomial degree, 4 to 7 and below the number of points.
        degree: usize,
    },
    /// Quintic spline through waypoints.
    Through {
        /// Waypoints, neighbours apart.
        points: Vec<[f64; 4]>,
        /// Length that a turn of ψ by 1 rad counts, m.
        turn_radius: f64,
    },
}

impl Shape {
    /// Up by `height`, across and down again, as lines: the U-turn of the paper, pick and place, ABB's cycle.
    pub fn arch(from: [f64; 4], to: [f64; 4], height: f64, blend: f64, turn_radius: f64) -> Self {
        let top = from[2].max(to[2]) + height;
        let points = vec![from, [from[0], from[1], top, from[3]], [to[0], to[1], top, to[3]], to];
        Self::Lines { points, blend, turn_radius }
    }

    /// The path over s from 0 to 1.
    pub fn curve(&self) -> Curve {
        match self {
            Self::Lines { points, blend, turn_radius } => lines(points, *blend, *turn_radius),
            Self::BSpline { points, degree } => b_spline(points, *degree),
            Self::Through { points, turn_radius } => through(points, *turn_radius),
        }
        .rescaled(1.0)
    }
}

fn scales(turn_radius: f64) -> (Vector4<f64>, Vector4<f64>) {
    (Vector4::new(1.0, 1.0, 1.0, turn_radius), Vector4::new(1.0, 1.0, 1.0, 1.0 / turn_radius))
}

/// Corner P between directions d₀ and d₁: r(u) = P − b d₀ + 2b [(u − W) d₀ + W d₁], W = u⁶ − 3u⁵ + 5u⁴/2, u = s/2b.
///
/// W′ is the smooth step of degree five, so value and three derivatives join those of the lines; |r′| ≤ 1.
fn lines(points: &[[f64; 4]], blend: f64, turn_radius: f64) -> Curve {
    let (to, back) = scales(turn_radius);
    let points: Vec<Vector4<f64>> = points.iter().map(|p| Vector4::from(*p).component_mul(&to)).collect();
    let spans: Vec<Vector4<f64>> = points.windows(2).map(|w| w[1] - w[0]).collect();
    let lengths: Vec<f64> = spans.iter().map(|d| d.norm()).collect();
    let room =
        |i: usize| if i == 0 || i == spans.len() { 0.0 } else { blend.min(0.5 * lengths[i - 1].min(lengths[i])) };
    let mut pieces = Vec::new();
    for (i, span) in spans.iter().enumerate() {
        let direction = span / lengths[i];
        let (b0, b1) = (room(i), room(i + 1));
        pieces.push((lengths[i] - b0 - b1, vec![points[i] + direction * b0, direction]));
        if let Some(next) = spans.get(i + 1) {
            let bend = next / lengths[i + 1] - direction;
            let b = b1;
            let w = |coefficient: f64, power: i32| bend * (coefficient * 2.0 * b / (2.0 * b).powi(power));
            let start = points[i + 1] - direction * b;
            let none = Vector4::zeros();
            pieces.push((2.0 * b, vec![start, direction, none, none, w(2.5, 4), w(-3.0, 5), w(1.0, 6)]));
        }
    }
    Curve::new(pieces).scaled(&back)
}

/// Spline through the points over centripetal chord lengths.
fn through(points: &[[f64; 4]], turn_radius: f64) -> Curve {
    let (to, _) = scales(turn_radius);
    let mut t = vec![0.0];
    for pair in points.windows(2) {
        let chord = (Vector4::from(pair[1]) - Vector4::from(pair[0])).component_mul(&to).norm();
        t.push(t[t.len() - 1] + chord.sqrt());
    }
    let table = Table { file: Default::default(), joints: false, t, rows: points.to_vec(), moving: true };
    Curve::new(table.course().pieces().map(|(length, terms)| (length, terms.to_vec())))
}

/// Each knot span as a Taylor polynomial about its start, whose derivatives are B-splines of differences.
fn b_spline(points: &[[f64; 4]], degree: usize) -> Curve {
    let spans = points.len() - degree;
    let knot = |k: usize| (k.clamp(degree, points.len()) - degree) as f64 / spans as f64;
    // Control points of each derivative.
    let mut controls = vec![points.iter().map(|p| Vector4::from(*p)).collect::<Vec<_>>()];
    for order in 1..=degree {
        let (p, last) = (degree + 1 - order, &controls[order - 1]);
        let difference = |k: usize| {
            let width = knot(k + 1 + p + order - 1) - knot(k + order);
            if width > 0.0 { (last[k + 1] - last[k]) * (p as f64 / width) } else { Vector4::zeros() }
        };
        controls.push((0..last.len() - 1).map(difference).collect());
    }
    let pieces = (0..spans).map(|span| {
        let at = knot(span + degree);
        let mut factorial = 1.0;
        let terms = (0..=degree).map(|order| {
            if order > 0 {
                factorial *= order as f64;
            }
            // De Boor's scheme for a spline of degree p whose knots are those of the curve without `order` at each end.
            let p = degree - order;
            let mut d: Vec<Vector4<f64>> = controls[order][span..=span + p].to_vec();
            let t = |k: usize| knot(k + order);
            for r in 1..=p {
                for j in (r..=p).rev() {
                    let i = span + j;
                    let (low, high) = (t(i), t(i + p + 1 - r));
                    let alpha = if high > low { (at - low) / (high - low) } else { 0.0 };
                    d[j] = d[j - 1] * (1.0 - alpha) + d[j] * alpha;
                }
            }
            d[p] / factorial
        });
        (1.0 / spans as f64, terms.collect())
    });
    Curve::new(pieces)
}

//! Shapes of paths: lines with blended corners, B-splines, curves through waypoints, arches.

use nalgebra::Vector4;

use super::Curve;
use crate::scenario::motion::table::Table;

/// Shape of a path as given in a path file; waypoints (x, y, z, ψ) in m and rad.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// Straight lines between waypoints, each corner rounded between the distance `blend` (m) before and after it.
    /// Where the path reverses, it does so at the waypoint itself.
    Lines {
        /// Both ends and the corners between them; neighbours differ.
        points: Vec<[f64; 4]>,
        /// Distance from a corner at which its blend begins, m; at most half of a line is used. Zero without corners.
        blend: f64,
        /// Length equivalent to a rotation of ψ by 1 rad, m.
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
        /// Waypoints; neighbours differ.
        points: Vec<[f64; 4]>,
        /// Length equivalent to a rotation of ψ by 1 rad, m.
        turn_radius: f64,
    },
}

impl Shape {
    /// Arch of lines: up by `height`, across and down again, as in the U-turn of the paper, pick and place, and ABB's
    /// cycle.
    pub fn arch(from: [f64; 4], to: [f64; 4], height: f64, blend: f64, turn_radius: f64) -> Self {
        let top = from[2].max(to[2]) + height;
        let points = vec![from, [from[0], from[1], top, from[3]], [to[0], to[1], top, to[3]], to];
        Self::Lines { points, blend, turn_radius }
    }

    /// Deviations of the path from the request, one sentence each.
    pub fn notes(&self) -> Vec<String> {
        let Self::Lines { points, blend, turn_radius } = self else { return Vec::new() };
        let legs = Legs::new(points, *turn_radius);
        let corners = 1..legs.lengths.len();
        let cut = corners.filter(|&i| !legs.reverses(i) && legs.blend(i, *blend) < *blend * (1.0 - 1e-12));
        cut.map(|i| {
            let used = legs.blend(i, *blend);
            format!(
                "the blend at corner {} begins {used:.4} m from it instead of {blend} m: half of the shorter line",
                i + 1
            )
        })
        .collect()
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

/// Lines between waypoints, with (x, y, z, ψ times the turn radius) in m.
struct Legs {
    points: Vec<Vector4<f64>>,
    directions: Vec<Vector4<f64>>,
    lengths: Vec<f64>,
}

/// Norm of the sum of two unit vectors below which they count as opposite.
const OPPOSITE_TOLERANCE: f64 = 1e-6;

impl Legs {
    fn new(points: &[[f64; 4]], turn_radius: f64) -> Self {
        let to = scales(turn_radius).0;
        let points: Vec<Vector4<f64>> = points.iter().map(|p| Vector4::from(*p).component_mul(&to)).collect();
        let spans = points.windows(2).map(|w| w[1] - w[0]);
        let lengths: Vec<f64> = spans.clone().map(|d| d.norm()).collect();
        let directions = spans.zip(&lengths).map(|(d, length)| d / *length).collect();
        Self { points, directions, lengths }
    }

    /// Whether the path reverses at waypoint `i`.
    fn reverses(&self, i: usize) -> bool {
        (self.directions[i - 1] + self.directions[i]).norm() < OPPOSITE_TOLERANCE
    }

    /// Half of the shorter line at waypoint `i`, m.
    fn half(&self, i: usize) -> f64 {
        0.5 * self.lengths[i - 1].min(self.lengths[i])
    }

    /// Distance from waypoint `i` at which its lines end and its blend begins, m.
    fn blend(&self, i: usize, blend: f64) -> f64 {
        match i {
            0 => 0.0,
            i if i == self.lengths.len() => 0.0,
            i if self.reverses(i) => self.half(i),
            i => blend.min(self.half(i)),
        }
    }
}

/// First waypoint, from 0, that is neither an end, collinear with its neighbours, nor a reversal.
pub fn first_corner(points: &[[f64; 4]], turn_radius: f64) -> Option<usize> {
    let legs = Legs::new(points, turn_radius);
    let straight = |i: usize| (legs.directions[i - 1] - legs.directions[i]).norm() < OPPOSITE_TOLERANCE;
    (1..legs.lengths.len()).find(|&i| !straight(i) && !legs.reverses(i))
}

/// Curve of lines and corners. A corner P between directions d₀ and d₁ is r(u) = P − b d₀ + 2b [(u − W) d₀ + W d₁], W
/// = u⁶ − 3u⁵ + 5u⁴/2, u = s/2b.
///
/// W′ is the smooth step of degree five, so value and three derivatives join those of the lines; |r′| ≤ 1. Where d₁ =
/// −d₀, the same polynomial reaches P if it begins at b = 11w/16: r = P − w g(1 − s/w) d₀ up to P and r = P + w
/// g(s/w) d₁ from it, g(x) = (15x² − 5x⁴ + x⁶)/16, with s from the start of each. There r′ vanishes with s̈ and ṡ
/// free: the robot is at rest at P.
fn lines(points: &[[f64; 4]], blend: f64, turn_radius: f64) -> Curve {
    let legs = Legs::new(points, turn_radius);
    let none = Vector4::zeros();
    let mut pieces = Vec::new();
    for (i, &direction) in legs.directions.iter().enumerate() {
        let (b0, b) = (legs.blend(i, blend), legs.blend(i + 1, blend));
        pieces.push((legs.lengths[i] - b0 - b, vec![legs.points[i] + direction * b0, direction]));
        let Some(&next) = legs.directions.get(i + 1) else { continue };
        let corner = legs.points[i + 1];
        let start = corner - direction * b;
        if legs.reverses(i + 1) {
            let w = 16.0 / 11.0 * b;
            let term = |d: Vector4<f64>, factor: f64, power: i32| d * (factor / 16.0 * w / w.powi(power));
            let back = |factor: f64, power: i32| term(-direction, factor, power);
            pieces.push((w, vec![start, direction, none, none, back(10.0, 4), back(-6.0, 5), back(1.0, 6)]));
            let on = |factor: f64, power: i32| term(next, factor, power);
            pieces.push((w, vec![corner, none, on(15.0, 2), none, on(-5.0, 4), none, on(1.0, 6)]));
        } else {
            let bend = next - direction;
            let w = |coefficient: f64, power: i32| bend * (coefficient * 2.0 * b / (2.0 * b).powi(power));
            pieces.push((2.0 * b, vec![start, direction, none, none, w(2.5, 4), w(-3.0, 5), w(1.0, 6)]));
        }
    }
    Curve::new(pieces).scaled(&scales(turn_radius).1)
}

/// Spline through the points with centripetal parametrisation (square roots of the chord lengths).
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

/// B-spline as one Taylor polynomial per knot span; its derivatives are B-splines of differences.
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
            // De Boor's algorithm for a spline of degree p whose knots are those of the curve without `order` at each
            // end.
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

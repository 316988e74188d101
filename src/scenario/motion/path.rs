//! Motion along waypoints: straight lines with blended corners and jerk-limited speed.
//!
//! The path has the four coordinates (x, y, z, ρψ), so that one limit applies to translation and rotation. On a line
//! the speed changes by pieces of constant jerk ("double S"). The blend of a corner P between the directions d₀ and d₁
//! starts and ends at the distance b from P and takes T = 2b/v:
//!
//! r(u) = P − b d₀ + 2b [(u − W) d₀ + W d₁],  W = u³ − u⁴/2,  u = t/T
//!
//! It starts and ends with speed v and zero acceleration; |r̈| ≤ 1.5 v² |d₁ − d₀| / 2b, |r⃛| ≤ 6 v³ |d₁ − d₀| / (2b)².
//! Position, velocity and acceleration are continuous, and all limits hold everywhere.

use nalgebra::Vector4;

use super::polynomial::Piecewise;
use crate::numerics::bisect;

/// A path along waypoints, at rest at both ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Path {
    /// Platform positions and angles (x, y, z, ψ), m and rad; at least two, consecutive ones distinct.
    pub waypoints: Vec<[f64; 4]>,
    /// Distance from a corner at which its blend starts, m, reduced to half of a line if larger. Zero stops at every
    /// corner.
    pub blend: f64,
    /// Largest speed, m/s.
    pub speed: f64,
    /// Largest acceleration, m/s².
    pub acceleration: f64,
    /// Largest jerk, m/s³.
    pub jerk: f64,
    /// Path length ρ assigned to a rotation of ψ by 1 rad, m.
    pub turn_radius: f64,
    /// Inner waypoints at which the platform stops, from 0.
    pub stops: Vec<usize>,
    /// Duration of every stop and of the one at the end, s.
    pub dwell: f64,
    /// Whether it returns to the first waypoint.
    pub closed: bool,
    /// Number of laps of a closed path.
    pub laps: usize,
}

impl Path {
    /// The platform pose over time.
    pub fn course(&self) -> Piecewise {
        let scale = Vector4::new(1.0, 1.0, 1.0, self.turn_radius);
        let mut points: Vec<Vector4<f64>> =
            self.waypoints.iter().map(|w| Vector4::from(*w).component_mul(&scale)).collect();
        if self.closed {
            points.extend(points.first().copied());
        }
        let Some(start) = points.first() else { return Piecewise::new(ZERO) };
        let lines: Vec<Line> = points.windows(2).map(Line::between).collect();
        let (blends, speeds) = self.corners(&lines);
        let mut out = Builder { course: Piecewise::new(start.component_div(&scale)), scale };
        for (i, line) in lines.iter().enumerate() {
            let (b0, b1) = (blends[i], blends[i + 1]);
            self.travel(
                &mut out,
                points[i] + line.direction * b0,
                line,
                line.length - b0 - b1,
                [speeds[i], speeds[i + 1]],
            );
            match lines.get(i + 1) {
                Some(next) if b1 > 0.0 => {
                    blend(&mut out, points[i + 1], line.direction, next.direction, b1, speeds[i + 1])
                }
                _ => out.course.rest(self.dwell),
            }
        }
        out.course.repeated(if self.closed { self.laps } else { 1 })
    }

    /// Blend distance (m) and speed (m/s) at every waypoint; both zero at a stop.
    fn corners(&self, lines: &[Line]) -> (Vec<f64>, Vec<f64>) {
        let n = lines.len();
        let (mut blends, mut speeds) = (vec![0.0; n + 1], vec![0.0; n + 1]);
        for i in 1..n {
            let b = self.blend.min(0.5 * lines[i - 1].length).min(0.5 * lines[i].length);
            if b <= 0.0 || self.stops.contains(&i) {
                continue;
            }
            let bend = (lines[i].direction - lines[i - 1].direction).norm().max(1e-12);
            blends[i] = b;
            speeds[i] = self
                .speed
                .min((2.0 * b * self.acceleration / (1.5 * bend)).sqrt())
                .min((4.0 * b * b * self.jerk / (6.0 * bend)).cbrt());
        }
        // A line must be long enough for the change between its end speeds.
        let room: Vec<f64> = (0..n).map(|i| lines[i].length - blends[i] - blends[i + 1]).collect();
        for i in 0..n {
            speeds[i + 1] = f64::min(speeds[i + 1], self.reach(speeds[i], room[i]));
        }
        for i in (0..n).rev() {
            speeds[i] = f64::min(speeds[i], self.reach(speeds[i + 1], room[i]));
        }
        (blends, speeds)
    }

    /// Duration of a change of speed, and of each of its two jerk phases, s.
    fn change(&self, from: f64, to: f64) -> (f64, f64) {
        let (a, j, d) = (self.acceleration, self.jerk, (to - from).abs());
        if d * j <= a * a {
            let jerking = (d / j).sqrt();
            (2.0 * jerking, jerking)
        } else {
            (d / a + a / j, a / j)
        }
    }

    fn distance(&self, from: f64, to: f64) -> f64 {
        0.5 * (from + to) * self.change(from, to).0
    }

    /// Largest speed (m/s) reachable from `from` within `room` m.
    fn reach(&self, from: f64, room: f64) -> f64 {
        largest(from, self.speed.max(from), |to| self.distance(from, to) <= room)
    }

    /// Appends the motion over `room` m along `line` from `start` with the speeds `ends` at both ends.
    fn travel(&self, out: &mut Builder, start: Vector4<f64>, line: &Line, room: f64, ends: [f64; 2]) {
        let fastest = ends[0].max(ends[1]);
        let peak = largest(fastest, self.speed.max(fastest), |peak| {
            self.distance(ends[0], peak) + self.distance(peak, ends[1]) <= room
        });
        let slow_down = self.distance(peak, ends[1]);
        let speed_up = self.distance(ends[0], peak);
        self.ramp(out, start, line.direction, ends[0], peak);
        let cruise = (room - speed_up - slow_down).max(0.0);
        let from = start + line.direction * speed_up;
        if peak > 0.0 {
            out.push(cruise / peak, [from, line.direction * peak, ZERO, ZERO, ZERO]);
        }
        self.ramp(out, from + line.direction * cruise, line.direction, peak, ends[1]);
    }

    /// Appends a change of speed along `direction` from `start`: jerk, constant acceleration, opposite jerk.
    fn ramp(&self, out: &mut Builder, start: Vector4<f64>, direction: Vector4<f64>, from: f64, to: f64) {
        let (total, jerking) = self.change(from, to);
        let jerk = self.jerk.copysign(to - from);
        let (mut s, mut v, mut a) = (0.0, from, 0.0);
        for (j, t) in [(jerk, jerking), (0.0, total - 2.0 * jerking), (-jerk, jerking)] {
            out.push(t, [start + direction * s, direction * v, direction * (0.5 * a), direction * (j / 6.0), ZERO]);
            s += v * t + a * t * t / 2.0 + j * t * t * t / 6.0;
            v += a * t + 0.5 * j * t * t;
            a += j * t;
        }
    }
}

const ZERO: Vector4<f64> = Vector4::new(0.0, 0.0, 0.0, 0.0);

struct Line {
    direction: Vector4<f64>,
    length: f64,
}

impl Line {
    fn between(ends: &[Vector4<f64>]) -> Self {
        let span = ends[1] - ends[0];
        let length = span.norm();
        Self { direction: span / length.max(f64::MIN_POSITIVE), length }
    }
}

/// Collects pieces in path coordinates.
struct Builder {
    course: Piecewise,
    scale: Vector4<f64>,
}

impl Builder {
    fn push(&mut self, duration: f64, c: [Vector4<f64>; 5]) {
        let c = c.map(|x| x.component_div(&self.scale));
        self.course.push(duration, [c[0], c[1], c[2], c[3], c[4], ZERO]);
    }
}

/// Appends the blend of `corner`, with both ends at distance `b` (m) from it.
fn blend(out: &mut Builder, corner: Vector4<f64>, before: Vector4<f64>, after: Vector4<f64>, b: f64, speed: f64) {
    let time = 2.0 * b / speed;
    let bend = after - before;
    let (cubic, quartic) = (bend * (2.0 * b / time.powi(3)), bend * (-b / time.powi(4)));
    out.push(time, [corner - before * b, before * speed, ZERO, cubic, quartic]);
}

/// Largest value in `low..high` for which `fits` holds; `fits` must hold at `low` and be monotonic.
fn largest(low: f64, high: f64, fits: impl Fn(f64) -> bool) -> f64 {
    if fits(high) { high } else { bisect([low, high], 80, fits)[0] }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::testing;
    use super::*;

    fn path(waypoints: Vec<[f64; 4]>, blend: f64) -> Path {
        Path {
            waypoints,
            blend,
            speed: 2.0,
            acceleration: 30.0,
            jerk: 1500.0,
            turn_radius: 0.1,
            stops: vec![],
            dwell: 0.0,
            closed: false,
            laps: 1,
        }
    }

    /// Largest speed, acceleration and jerk in path coordinates on a fine grid.
    fn peaks(path: &Path) -> [f64; 3] {
        let course = path.course();
        let n = 20_000;
        let step = course.length() / n as f64;
        let at = |k: usize| {
            course.at(k as f64 * step).map(|mut v| {
                v[3] *= path.turn_radius;
                v
            })
        };
        let mut peak = [0f64; 3];
        for k in 0..n {
            let ([_, v, a], [_, _, b]) = (at(k), at(k + 1));
            peak = [peak[0].max(v.norm()), peak[1].max(a.norm()), peak[2].max((b - a).norm() / step)];
        }
        peak
    }

    #[test]
    fn a_long_line_reaches_all_three_limits() {
        let line = path(vec![[-0.4, 0.0, -1.0, 0.0], [0.4, 0.0, -1.0, 0.0]], 0.0);
        let peak = peaks(&line);
        for (p, limit) in peak.iter().zip([2.0, 30.0, 1500.0]) {
            assert!((p / limit - 1.0).abs() < 1e-6, "{peak:?}");
        }
        // Double S in closed form: L/v + v/a + a/j.
        let time = 0.8 / 2.0 + 2.0 / 30.0 + 30.0 / 1500.0;
        assert!((line.course().length() - time).abs() < 1e-9, "{}", line.course().length());
    }

    #[test]
    fn stops_rest_and_laps_repeat() {
        let square = [[0.1, 0.1], [0.1, -0.1], [-0.1, -0.1], [-0.1, 0.1]].map(|[x, y]| [x, y, -1.0, 0.0]).to_vec();
        let path = Path { stops: vec![2], dwell: 0.05, closed: true, laps: 3, ..path(square, 0.05) };
        let course = path.course();
        testing::check(&course);
        assert!((course.length() - 3.0 * course.lap()).abs() < 1e-12);
        let [here, again] = [0.123, 0.123 + 2.0 * course.lap()].map(|t| course.at(t));
        assert!((here[0] - again[0]).norm() < 1e-12);
        let resting = (0..100_000)
            .filter(|k| {
                let [p, v, _] = course.at(*k as f64 * course.lap() / 1e5);
                v.norm() == 0.0 && (p - Vector4::new(-0.1, -0.1, -1.0, 0.0)).norm() < 1e-12
            })
            .count();
        assert!((resting as f64 * course.lap() / 1e5 - 0.05).abs() < 1e-3, "{resting}");
    }

    #[test]
    fn a_reversal_is_smooth_and_the_platform_may_only_turn() {
        let there_and_back = path(vec![[0.0, 0.0, -1.0, 0.0], [0.0, 0.0, -0.9, 0.0], [0.0, 0.0, -1.0, 0.0]], 0.03);
        testing::check(&there_and_back.course());
        let turn = path(vec![[0.0, 0.0, -1.0, -1.0], [0.0, 0.0, -1.0, 2.0]], 0.0);
        testing::check(&turn.course());
        assert!((turn.course().at(turn.course().length())[0][3] - 2.0).abs() < 1e-12);
    }

    #[test]
    fn accelerating_for_half_a_millisecond_in_eight_seconds_is_smooth() {
        let slow = path(vec![[0.0, 0.365, -0.85, 0.0], [0.0, 0.0, -1.022, -0.984]], 0.0);
        testing::check(&Path { speed: 0.05, acceleration: 83.3, jerk: 4726.0, ..slow }.course());
    }

    proptest! {
        #[test]
        fn limits_hold_and_ends_rest(
            waypoints in prop::collection::vec([-0.4..0.4f64, -0.4..0.4f64, -1.05..-0.85f64, -2.0..2.0f64], 2..7),
            blend in 0.0..0.2f64,
            limits in [0.05..5.0f64, 1.0..100.0f64, 10.0..5000.0f64],
        ) {
            let [speed, acceleration, jerk] = limits;
            let ends = [waypoints[0], waypoints[waypoints.len() - 1]];
            let path = Path { speed, acceleration, jerk, ..path(waypoints, blend) };
            let course = path.course();
            testing::check(&course);
            for (p, limit) in peaks(&path).iter().zip(limits) {
                prop_assert!(*p <= limit * (1.0 + 1e-6), "{p} beyond {limit}");
            }
            prop_assert!((course.at(0.0)[0] - Vector4::from(ends[0])).norm() < 1e-12);
            prop_assert!((course.at(course.length())[0] - Vector4::from(ends[1])).norm() < 1e-12);
        }
    }
}

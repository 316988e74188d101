//! Motion of one axis to and fro at constant speeds, the others at rest: points of a friction curve ([Gnad 2024],
//! section 6.3.1).

use nalgebra::Vector4;

use super::polynomial::Piecewise;

/// Runs of one axis between two angles.
///
/// Every run starts and ends at rest within the two angles. During acceleration and deceleration the rate follows v
/// (3u² − 2u³): position, rate and acceleration are continuous.
#[derive(Clone, Debug, PartialEq)]
pub struct ConstantSpeed {
    /// Axis, from 0.
    pub axis: usize,
    /// Platform pose (x, y, z, ψ) at which the other axes are held, m and rad.
    pub pose: [f64; 4],
    /// Angles at which the axis reverses, rad; it starts at the first.
    pub between: [f64; 2],
    /// Speeds, one run to and fro each, rad/s, positive.
    pub speeds: Vec<f64>,
    /// Largest acceleration, rad/s².
    pub acceleration: f64,
    /// Number of runs to and fro at each speed.
    pub repeat: usize,
}

impl ConstantSpeed {
    /// Angle needed to accelerate to `speed` (rad/s) and to decelerate, rad.
    pub fn ramps(&self, speed: f64) -> f64 {
        speed * self.ramp_time(speed)
    }

    fn ramp_time(&self, speed: f64) -> f64 {
        // 3u² − 2u³ has its largest slope, 1.5, at u = 1/2.
        1.5 * speed / self.acceleration
    }

    /// Joint angles over time; `held` are those of the pose, rad.
    pub fn course(&self, held: [f64; 4]) -> Piecewise {
        let [from, to] = self.between;
        let direction = (to - from).signum();
        let mut state = Run { axis: self.axis, angles: Vector4::from(held), course: None };
        state.angles[self.axis] = from;
        for &speed in &self.speeds {
            let time = self.ramp_time(speed);
            let cruise = ((to - from).abs() - self.ramps(speed)).max(0.0) / speed;
            for _ in 0..self.repeat {
                for v in [direction * speed, -direction * speed] {
                    state.push(time, [0.0, v / time.powi(2), -0.5 * v / time.powi(3)]);
                    state.push(cruise, [v, 0.0, 0.0]);
                    state.push(time, [v, -v / time.powi(2), 0.5 * v / time.powi(3)]);
                }
            }
        }
        state.course.unwrap_or_else(|| Piecewise::new(state.angles))
    }
}

/// Pieces of one axis, each starting where the previous one ended.
struct Run {
    axis: usize,
    angles: Vector4<f64>,
    course: Option<Piecewise>,
}

impl Run {
    /// Appends a piece with linear, cubic and quartic coefficients.
    fn push(&mut self, duration: f64, [linear, cubic, quartic]: [f64; 3]) {
        let mut c = [Vector4::zeros(); 6];
        c[0] = self.angles;
        (c[1][self.axis], c[3][self.axis], c[4][self.axis]) = (linear, cubic, quartic);
        let start = self.angles;
        self.course.get_or_insert_with(|| Piecewise::new(start)).push(duration, c);
        self.angles[self.axis] += linear * duration + cubic * duration.powi(3) + quartic * duration.powi(4);
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing;
    use super::*;

    #[test]
    fn every_speed_is_held_both_ways_within_the_angles() {
        for axis in 0..4 {
            let runs = ConstantSpeed {
                axis,
                pose: [0.0; 4],
                between: [1.0, -1.5],
                speeds: vec![0.5, 3.0],
                acceleration: 20.0,
                repeat: 2,
            };
            let course = runs.course([0.1, 0.2, 0.3, 0.4]);
            testing::check(&course);
            let step = course.length() / 50_000.0;
            let states: Vec<_> = (0..50_000).map(|k| course.at(k as f64 * step)).collect();
            for v in [0.5, -0.5, 3.0, -3.0] {
                let held = states.iter().filter(|[_, r, a]| (r[axis] - v).abs() < 1e-12 && a.norm() == 0.0).count();
                // Twice the angle between the reversals minus the ramps.
                let expected = 2.0 * (2.5 - 1.5 * v * v / 20.0) / v.abs();
                assert!((held as f64 * step - expected).abs() < 10.0 * step, "{v}: {}", held as f64 * step);
            }
            for [q, _, a] in &states {
                assert!(q[axis] < 1.0 + 1e-12 && q[axis] > -1.5 - 1e-12 && a[axis].abs() < 20.0 + 1e-9);
                assert!((0..4).all(|i| i == axis || q[i] == [0.1, 0.2, 0.3, 0.4][i]));
            }
        }
    }
}

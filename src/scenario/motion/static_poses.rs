//! Sequence of static poses, for the torque noise at standstill ([Gnad 2024], section 6.2.1).

use nalgebra::Vector4;

use super::polynomial::{Piecewise, quintic};

/// Poses held for a given time, with quintic moves along straight lines between them.
///
/// Position, velocity and acceleration are continuous; moves start and end with zero acceleration.
#[derive(Clone, Debug, PartialEq)]
pub struct StaticPoses {
    /// Platform poses (x, y, z, ψ), m and rad.
    pub poses: Vec<[f64; 4]>,
    /// Time at each pose, s.
    pub hold: f64,
    /// Time from pose to pose, s.
    pub travel: f64,
}

impl StaticPoses {
    /// Platform pose over time.
    pub fn course(&self) -> Piecewise {
        let pose = |i: usize| self.poses.get(i).map_or(Vector4::zeros(), |p| Vector4::from(*p));
        let rest = |i: usize| [pose(i), Vector4::zeros(), Vector4::zeros()];
        let mut course = Piecewise::new(pose(0));
        course.rest(self.hold);
        for i in 1..self.poses.len() {
            course.push(self.travel, quintic(self.travel, rest(i - 1), rest(i)));
            course.rest(self.hold);
        }
        course
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing;
    use super::*;

    #[test]
    fn poses_are_held() {
        let poses = vec![[0.1, 0.2, -0.9, 0.0], [-0.1, 0.2, -1.0, 1.0], [0.0, 0.0, -1.0, -1.0]];
        let course = StaticPoses { poses: poses.clone(), hold: 0.3, travel: 0.4 }.course();
        testing::check(&course);
        assert!((course.length() - 1.7).abs() < 1e-12);
        for (i, pose) in poses.iter().enumerate() {
            for t in [0.001, 0.299] {
                let [p, v, a] = course.at(0.7 * i as f64 + t);
                assert!((p - Vector4::from(*pose)).norm() < 1e-12 && v.norm() == 0.0 && a.norm() == 0.0);
            }
        }
    }
}

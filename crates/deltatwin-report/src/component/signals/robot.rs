//! The robot at times of the recording: points that move, and the rods and faces between them.

use deltatwin::dynamics::Plant;
use deltatwin::identification::Dataset;
use deltatwin::kinematics::{JointState, KinematicsError, Motion};
use deltatwin::machine::bodies::{END_EFFECTOR, TELESCOPE_LOWER, arm, strut};
use deltatwin::machine::{Geometry, Joint, Mechanism};
use deltatwin::model::Model;
use nalgebra::Vector3;
use serde_json::{Value, json};

use super::pack::Packed;

/// Largest number of poses.
const MOST_POSES: usize = 1000;
/// Step of the stored coordinates, m.
const STEP: f64 = 1e-3;
/// Thickness of the drawn parts in lengths of the struts: arms and carriages, struts, guides, bars of the plate and at the
/// elbows, telescope and flange; for the eye only.
const ARM: f64 = 0.055;
const STRUT: f64 = 0.015;
const GUIDE: f64 = 0.02;
const BAR: f64 = 0.025;
const TELESCOPE: f64 = 0.02;
/// Half the length of a drawn carriage and length of the tool's pointer in lengths of the struts.
const CARRIAGE: f64 = 0.06;
const POINTER: f64 = 0.09;

/// Poses of the robot of `model` at the measured joints, in `packed`; null for a single axis and where no pose belongs to
/// the joints.
///
/// `points` are the coordinates of points in the inertial frame; pose k belongs to sample `k·every` of the
/// page. An end of a rod and a corner of a face is `[point, x, y, z]`: the offset from a point, or a place if there is none
/// (−1). Of a rod `of` is the index of the drive whose residual colours it, −1 for the frame.
pub fn of(model: &Model, dataset: &Dataset, packed: &mut Packed) -> Value {
    if matches!(dataset.mechanism, Mechanism::Axis(_)) {
        return Value::Null;
    }
    let plant = dataset.plant(model);
    let every = packed.len().div_ceil(MOST_POSES).max(1);
    let kept = packed.every(every);
    let motion = |&k: &usize| plant.motion(&JointState { q: dataset.joints[k].q, ..JointState::default() });
    let motions: Result<Vec<Motion>, KinematicsError> = kept.iter().map(motion).collect();
    let Ok(motions) = motions else { return Value::Null };
    let Some(first) = motions.first() else { return Value::Null };
    let shape = Shape::of(&plant, first);
    let mut coordinate = |place: &Point, axis: usize| {
        let series: Vec<f64> = motions.iter().map(|m| place(m)[axis]).collect();
        packed.add_all(&series, STEP, 1)
    };
    let points: Vec<Value> = shape.points.iter().map(|p| (0..3).map(|axis| coordinate(p, axis)).collect()).collect();
    json!({"poses": motions.len(), "every": every, "points": points, "rods": shape.rods, "faces": shape.faces})
}

/// A point of the robot in the inertial frame, m.
type Point<'a> = Box<dyn Fn(&Motion) -> Vector3<f64> + 'a>;

/// The robot as it is drawn.
struct Shape<'a> {
    geometry: &'a Geometry,
    /// Length of the struts, m.
    size: f64,
    /// The motion whose offsets are drawn at all times: ball pairs and bars that carry them only translate.
    first: &'a Motion,
    points: Vec<Point<'a>>,
    rods: Vec<Value>,
    faces: Vec<Value>,
}

impl<'a> Shape<'a> {
    fn of(plant: &'a Plant, first: &'a Motion) -> Self {
        let geometry = &plant.geometry;
        let size = geometry.limbs.iter().map(|limb| limb.strut_length).fold(0.0, f64::max);
        let mut shape = Self { geometry, size, first, points: Vec::new(), rods: Vec::new(), faces: Vec::new() };
        shape.base();
        let elbows: Vec<usize> =
            (0..geometry.limbs.len()).map(|i| shape.point(move |m| geometry.elbow(i, m.q[i]))).collect();
        for (i, &elbow) in elbows.iter().enumerate() {
            shape.limb(i, elbow, plant.assembled);
        }
        if plant.assembled {
            shape.plate(&elbows);
        }
        shape
    }

    fn point(&mut self, of: impl Fn(&Motion) -> Vector3<f64> + 'a) -> usize {
        self.points.push(Box::new(of));
        self.points.len() - 1
    }

    /// A place of the first pose as the offset from a point.
    fn at(&self, point: usize, place: Vector3<f64>) -> Value {
        end(point as i64, place - self.points[point](self.first))
    }

    fn rod(&mut self, from: Value, to: Value, thickness: f64, of: Option<usize>) {
        self.rods
            .push(json!({"ends": [from, to], "wide": short(thickness * self.size), "of": of.map_or(-1, |i| i as i64)}));
    }

    /// The frame between the shafts, or between the upper and the lower ends of guides.
    fn base(&mut self) {
        let geometry = self.geometry;
        let ends = |k: usize| match geometry.actuator().joint() {
            Joint::Revolute => geometry.limbs.iter().map(|limb| limb.shaft()).collect::<Vec<_>>(),
            Joint::Prismatic => {
                (0..geometry.limbs.len()).map(|i| geometry.elbow(i, geometry.limbs[i].limits[k])).collect()
            }
        };
        self.faces.push(around(ends(0)).into_iter().map(|corner| end(-1, corner)).collect());
        if geometry.actuator().joint() == Joint::Prismatic {
            for (from, to) in ends(0).into_iter().zip(ends(1)) {
                self.rod(end(-1, from), end(-1, to), GUIDE, None);
            }
        }
    }

    /// An arm or a carriage, the bar for its balls, and the struts' upper ends.
    fn limb(&mut self, i: usize, elbow: usize, assembled: bool) {
        let geometry = self.geometry;
        let limb = &geometry.limbs[i];
        let of = limb.driven.then_some(i);
        match geometry.actuator().joint() {
            Joint::Revolute => {
                self.rod(end(-1, self.first.bodies[arm(i)].position), end(elbow as i64, Vector3::zeros()), ARM, of)
            }
            Joint::Prismatic => {
                let along = self.first.arm_screw(i).linear * (CARRIAGE * self.size);
                self.rod(end(elbow as i64, -along), end(elbow as i64, along), ARM, of);
            }
        }
        if assembled {
            let [a, b] = [2 * i, 2 * i + 1].map(|s| self.at(elbow, self.first.bodies[strut(s)].position));
            self.rod(a, b, BAR, of);
        }
    }

    /// Plate and struts, end effector and telescope.
    fn plate(&mut self, elbows: &[usize]) {
        let (geometry, first) = (self.geometry, self.first);
        let plate = geometry.plate;
        for (k, &body) in plate.bodies().iter().enumerate() {
            let joints = plate.pivots_on(k);
            let limbs: Vec<usize> = (0..elbows.len()).filter(|i| first.carrier[2 * i] == body).collect();
            if limbs.is_empty() {
                // A bar that turns: between its joints.
                let ends: Vec<usize> = joints
                    .into_iter()
                    .map(|joint| {
                        // Joints are in the plane of the plate, the end effector's frame is at its flange.
                        let height =
                            if body == END_EFFECTOR { Vector3::z() * geometry.flange_height } else { Vector3::zeros() };
                        self.point(move |m| m.bodies[body].position - height + m.bodies[body].rotation * joint)
                    })
                    .collect();
                if let [a, b] = ends[..] {
                    self.rod(end(a as i64, Vector3::zeros()), end(b as i64, Vector3::zeros()), BAR, None);
                }
                continue;
            }
            let own = self.point(move |m| m.bodies[body].position);
            for &i in &limbs {
                for s in [2 * i, 2 * i + 1] {
                    let [upper, lower] =
                        [self.at(elbows[i], first.bodies[strut(s)].position), self.at(own, first.lower_ball(s))];
                    self.rod(upper, lower, STRUT, geometry.limbs[i].driven.then_some(i));
                }
            }
            let balls = limbs.iter().flat_map(|i| [2 * i, 2 * i + 1]).map(|s| first.lower_ball(s));
            let corners = balls.chain(joints.into_iter().map(|joint| first.bodies[body].position + joint)).collect();
            self.faces.push(around(corners).into_iter().map(|corner| self.at(own, corner)).collect());
        }
        self.tool();
    }

    /// The flange under the plate with a pointer that shows its rotation, and the telescope above it.
    fn tool(&mut self) {
        let geometry = self.geometry;
        let turned = !geometry.plate.turns() && geometry.has_telescope();
        let of = turned.then_some(geometry.limbs.len());
        let flange = self.point(|m| m.bodies[END_EFFECTOR].position);
        let reach = Vector3::x() * (POINTER * self.size);
        let pointer = self.point(move |m| m.bodies[END_EFFECTOR].position + m.bodies[END_EFFECTOR].rotation * reach);
        let above = end(flange as i64, Vector3::z() * -geometry.flange_height);
        self.rod(above, end(flange as i64, Vector3::zeros()), TELESCOPE, of);
        self.rod(end(flange as i64, Vector3::zeros()), end(pointer as i64, Vector3::zeros()), BAR, of);
        if geometry.has_telescope() {
            let lower = self.at(flange, self.first.bodies[TELESCOPE_LOWER].position);
            self.rod(lower, end(-1, geometry.upper_hooke()), TELESCOPE, of);
        }
    }
}

/// An end of a rod or a corner of a face: the offset, m, from a point, or a place without one.
fn end(point: i64, offset: Vector3<f64>) -> Value {
    json!([point, short(offset.x), short(offset.y), short(offset.z)])
}

/// `x`, m, to 0.1 mm.
fn short(x: f64) -> f64 {
    (1e4 * x).round() / 1e4
}

/// Points of a face in the order of their angle about its middle, seen from above.
fn around(mut points: Vec<Vector3<f64>>) -> Vec<Vector3<f64>> {
    let middle = points.iter().sum::<Vector3<f64>>() / points.len().max(1) as f64;
    points.sort_by(|a, b| {
        let angle = |p: &Vector3<f64>| (p.y - middle.y).atan2(p.x - middle.x);
        angle(a).total_cmp(&angle(b))
    });
    points
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltatwin::kinematics::PlatformState;
    use deltatwin::machine::Setup;

    fn shipped(name: &str) -> Model {
        deltatwin_io::model::read(std::path::Path::new(name)).unwrap()
    }

    /// Where an end of a rod is in a pose.
    fn place(shape: &Shape, m: &Motion, end: &Value) -> Vector3<f64> {
        let number = |k: usize| end[k].as_f64().unwrap();
        let offset = Vector3::new(number(1), number(2), number(3));
        match end[0].as_u64() {
            Some(point) => shape.points[point as usize](m) + offset,
            None => offset,
        }
    }

    #[test]
    fn limbs_of_every_mechanism_are_drawn_where_they_are_in_every_pose() {
        for (name, faces) in [
            ("irb360-6-1600", 2),
            ("clavel-delta", 2),
            ("linear-delta", 2),
            ("par4", 3),
            ("h4", 3),
            ("i4", 3),
            ("par2", 2),
        ] {
            let plant = Plant::new(&shipped(name), &Setup::default());
            let geometry = &plant.geometry;
            let platform = |z: f64, k: f64| PlatformState {
                position: Vector3::new(0.02 * k, -0.01 * k, z + 0.015 * k),
                psi: [0.1 * k, 0.0, 0.0],
                ..PlatformState::default()
            };
            // In the middle of the heights that it reaches on its centre line.
            let heights: Vec<f64> = (0..200).map(|k| -0.01 * f64::from(k)).collect();
            let reached: Vec<f64> =
                heights.into_iter().filter(|z| geometry.inverse_motion(&platform(*z, 0.0)).is_ok()).collect();
            let z = reached[reached.len() / 2];
            let pose = |k: f64| plant.motion(&geometry.inverse_motion(&platform(z, k)).unwrap()).unwrap();
            let (first, later) = (pose(0.0), pose(3.0));
            let shape = Shape::of(&plant, &first);
            assert_eq!(shape.faces.len(), faces, "{name}");
            let width = short(STRUT * shape.size);
            let struts: Vec<&Value> = shape.rods.iter().filter(|r| r["wide"] == width).collect();
            assert_eq!(struts.len(), later.struts(), "{name}");
            for m in [&first, &later] {
                let drawn = |s: usize| {
                    let near = |rod: &&Value| {
                        let [a, b] = [0, 1].map(|k| place(&shape, m, &rod["ends"][k]));
                        (a - m.bodies[strut(s)].position).norm() < 2e-4 && (b - m.lower_ball(s)).norm() < 2e-4
                    };
                    let of = if geometry.limbs[s / 2].driven { s as i64 / 2 } else { -1 };
                    struts.iter().copied().filter(near).all(|rod| rod["of"] == of)
                        && struts.iter().copied().any(|rod| near(&rod))
                };
                assert!((0..m.struts()).all(drawn), "{name}");
            }
        }
    }

    #[test]
    fn a_single_axis_has_no_robot() {
        let model = shipped("servo-axis");
        let dataset =
            Dataset::exact(model.mechanism, Setup::default(), Vec::new(), 1e-3, vec![JointState::default(); 3]);
        assert!(of(&model, &dataset, &mut Packed::new((0..3).collect())).is_null());
    }
}

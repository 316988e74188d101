//! The robot as a tree of links, with the joints that close its loops.
//!
//! The platform hangs on the telescope if there is one, so that the lower sockets of the struts are all that is left to
//! close. Every joint is at zero in the home pose q = 0, and every link then stands as on the assembled robot.

use nalgebra::{Isometry3, Unit, Vector3};

use deltatwin::cell::links::{Cylinder, cylinder};
use deltatwin::dynamics::Plant;
use deltatwin::kinematics::{JointState, Motion};
use deltatwin::machine::bodies::{
    END_EFFECTOR, LINK, PLATFORM, ROTOR, SECOND_PLATFORM, SLOTS, TELESCOPE_LOWER, TELESCOPE_UPPER, arm, body_name,
    strut,
};
use deltatwin::machine::{Actuator, Drive, Inertia, Plate};
use deltatwin::model::Model;

use super::friction::{Friction, Frictions};

/// A link with the joints that carry it, in the order of the chain.
pub(super) struct Link {
    /// Name, that of the body.
    pub name: String,
    /// Index of the link that carries it; none for the base.
    pub parent: Option<usize>,
    /// Pose of its joints' common frame in the frame of the parent, in the home pose.
    pub origin: Isometry3<f64>,
    /// Its joints, all through the origin.
    pub joints: Vec<Joint>,
    /// Origin of the link's own frame in that of the joints, whose axes are the same, m.
    pub offset: Vector3<f64>,
    /// Inertia in its own frame.
    pub inertia: Inertia,
    /// Shape for display.
    pub shape: Option<Cylinder>,
}

/// A joint of the tree.
pub(super) struct Joint {
    /// Name.
    pub name: String,
    /// Freedoms.
    pub freedom: Freedom,
    /// Friction in it.
    pub friction: Friction,
    /// Least and largest coordinate, rad or m.
    pub range: Option<[f64; 2]>,
    /// The drive that moves it.
    pub drive: Option<Drive>,
    /// Joint whose coordinate times the factor its own is.
    pub follows: Option<(String, f64)>,
}

/// Freedoms of a joint; unit vectors in the link's frame in the home pose, after the joints before it.
#[derive(Clone, Copy)]
pub(super) enum Freedom {
    /// Rotation about a vector.
    Turn(Vector3<f64>),
    /// Translation along a vector.
    Slide(Vector3<f64>),
    /// All rotations.
    Ball,
    /// All motions.
    Free,
}

/// Points of two links that coincide: a ball socket, or the last hinge of a parallelogram, that closes a loop.
pub(super) struct Loop {
    /// Name.
    pub name: String,
    /// Indices of strut and plate, or of two parts of the plate.
    pub links: [usize; 2],
    /// The point in either frame, m.
    pub points: [Vector3<f64>; 2],
}

/// A robot as a tree with loops.
pub(super) struct Tree {
    /// Links; a link comes after the one that carries it.
    pub links: Vec<Link>,
    /// Closures.
    pub loops: Vec<Loop>,
}

impl Tree {
    /// The tree of the robot of `model` as `plant`, whose home pose is `home`.
    pub fn new(model: &Model, plant: &Plant, home: &Motion, frictions: &Frictions) -> Self {
        let mut builder = Builder { model, plant, home, poses: home.poses(), frictions, links: Vec::new() };
        builder.limbs();
        let closed = match plant.mechanism.has_telescope() {
            true => {
                builder.telescope();
                None
            }
            false => builder.plate(),
        };
        let geometry = &plant.geometry;
        let sockets = (0..plant.mechanism.struts()).map(|s| Loop {
            name: format!("socket{}_lower", s + 1),
            links: [builder.at(strut(s)), builder.at(home.carrier[s])],
            points: [Vector3::x() * geometry.limbs[s / 2].strut_length, geometry.platform_ball(s)],
        });
        Self { loops: sockets.chain(closed).collect(), links: builder.links }
    }
}

struct Builder<'a> {
    model: &'a Model,
    plant: &'a Plant,
    home: &'a Motion,
    /// Poses of the bodies in the home pose.
    poses: [Isometry3<f64>; SLOTS],
    frictions: &'a Frictions,
    links: Vec<Link>,
}

impl Builder<'_> {
    /// Adds the link of a body on `parent`, a body with its link, and returns its index.
    fn link(&mut self, body: usize, parent: Option<(usize, usize)>, joints: Vec<Joint>) -> usize {
        let pose = self.poses[body];
        let origin = parent.map_or(pose, |(body, _)| self.poses[body].inv_mul(&pose));
        self.links.push(Link {
            name: body_name(body),
            parent: parent.map(|(_, link)| link),
            origin,
            joints,
            offset: Vector3::zeros(),
            inertia: self.plant.bodies[body],
            shape: cylinder(&self.plant.geometry, body),
        });
        self.links.len() - 1
    }

    /// Index of the link of a body that has one.
    fn at(&self, body: usize) -> usize {
        let name = body_name(body);
        self.links.iter().position(|link| link.name == name).expect("a link of the body")
    }

    /// Adds the link of a body that turns about the vertical through `hinge` (m, inertial frame) on `parent`.
    fn hinged(&mut self, body: usize, parent: usize, name: &str, hinge: Vector3<f64>) {
        let turn = passive(name.into(), Freedom::Turn(Vector3::z()));
        let index = self.link(body, Some((parent, self.at(parent))), vec![turn]);
        let pose = self.poses[body];
        let offset = pose.rotation.inverse() * (pose.translation.vector - hinge);
        let link = &mut self.links[index];
        link.origin *= nalgebra::Translation3::from(-offset);
        link.offset = offset;
    }

    fn driven(&self, axis: usize, freedom: Freedom, range: Option<[f64; 2]>) -> Joint {
        let (friction, drive) = (self.frictions.drives[axis], Some(self.model.drives[axis]));
        Joint { name: format!("axis{}", axis + 1), freedom, friction, range, drive, follows: None }
    }

    /// Arms with their struts.
    fn limbs(&mut self) {
        let limbs = self.plant.geometry.limbs;
        let first_passive = limbs.iter().position(|limb| !limb.driven);
        for (i, limb) in limbs.iter().enumerate() {
            let freedom = match limb.actuator {
                Actuator::Revolute => Freedom::Turn(Vector3::y()),
                Actuator::Prismatic { .. } => Freedom::Slide(Vector3::x()),
            };
            let range = Some(limb.limits.map(|limit| limit - self.home.q[i]));
            let axis = match limb.driven {
                true => self.driven(i, freedom, range),
                // Coupled passive arms have the same angle.
                false => Joint {
                    range,
                    follows: first_passive
                        .filter(|first| *first < i)
                        .map(|first| (format!("passive{}", first + 1), 1.0)),
                    ..passive(format!("passive{}", i + 1), freedom)
                },
            };
            let own = self.link(arm(i), None, vec![axis]);
            for s in [2 * i, 2 * i + 1] {
                let ball = passive(format!("socket{}_upper", s + 1), Freedom::Ball);
                self.link(strut(s), Some((arm(i), own)), vec![ball]);
            }
        }
    }

    /// The plate of a robot without telescope, part by part; returns the closure of a parallelogram.
    fn plate(&mut self) -> Option<Loop> {
        self.link(PLATFORM, None, vec![passive("translation".into(), Freedom::Free)]);
        let place = |body: usize| self.poses[body].translation.vector;
        match self.plant.geometry.plate {
            Plate::Rigid => None,
            Plate::Par4 { main, .. } => {
                // The bars lie about the plate's origin: halves of a connecting bar are those of the main bars' distance.
                let half = (place(PLATFORM) - place(SECOND_PLATFORM)) / 2.0;
                let [first, second] = [place(END_EFFECTOR), place(LINK)];
                self.hinged(END_EFFECTOR, PLATFORM, "hinge1", first + half);
                self.hinged(SECOND_PLATFORM, END_EFFECTOR, "hinge2", first - half);
                self.hinged(LINK, PLATFORM, "hinge3", second + half);
                let in_link = self.poses[LINK].rotation.inverse() * -half;
                Some(Loop {
                    name: "hinge4".into(),
                    links: [LINK, SECOND_PLATFORM].map(|body| self.at(body)),
                    points: [in_link, -main / 2.0],
                })
            }
            Plate::H4 { .. } => {
                let hinges = [place(PLATFORM), place(SECOND_PLATFORM)];
                self.hinged(END_EFFECTOR, PLATFORM, "hinge1", hinges[0]);
                self.hinged(SECOND_PLATFORM, END_EFFECTOR, "hinge2", hinges[1]);
                None
            }
            Plate::I4 { azimuth, radius } => {
                let spindle = place(END_EFFECTOR);
                self.hinged(END_EFFECTOR, PLATFORM, "spindle", spindle);
                let way = Vector3::new(azimuth.cos(), azimuth.sin(), 0.0);
                let slide =
                    Joint { follows: Some(("spindle".into(), radius)), ..passive("rack".into(), Freedom::Slide(way)) };
                self.link(SECOND_PLATFORM, Some((PLATFORM, self.at(PLATFORM))), vec![slide]);
                None
            }
        }
    }

    /// Rotor, telescope, end effector and, on its bearing, the platform.
    fn telescope(&mut self) {
        let geometry = &self.plant.geometry;
        let limits = geometry.telescope_limits;
        let turn = self.driven(3, Freedom::Turn(Vector3::z()), None);
        let rotor = self.link(ROTOR, None, vec![turn]);
        let upper_joints = self.hooke("hooke_upper", [ROTOR, TELESCOPE_UPPER], [Vector3::x(), Vector3::y()]);
        let upper = self.link(TELESCOPE_UPPER, Some((ROTOR, rotor)), upper_joints);
        let length =
            (self.poses[TELESCOPE_LOWER].translation.vector - self.poses[TELESCOPE_UPPER].translation.vector).norm();
        let slide = Joint {
            friction: self.frictions.telescope,
            range: Some(limits.map(|limit| limit - length)),
            ..passive("telescope".into(), Freedom::Slide(-Vector3::z()))
        };
        let lower = self.link(TELESCOPE_LOWER, Some((TELESCOPE_UPPER, upper)), vec![slide]);
        let lower_joints = self.hooke("hooke_lower", [TELESCOPE_LOWER, END_EFFECTOR], [Vector3::y(), Vector3::x()]);
        let effector = self.link(END_EFFECTOR, Some((TELESCOPE_LOWER, lower)), lower_joints);
        // Its joints are at the lower Hooke joint, its frame is at the flange.
        let geometry = &self.plant.geometry;
        let offset = Vector3::z() * (geometry.flange_height - geometry.lower_hooke_height);
        let carried = &mut self.links[effector];
        carried.origin *= nalgebra::Translation3::from(-offset);
        carried.offset = offset;
        let bearing = passive("bearing".into(), Freedom::Turn(-Vector3::z()));
        self.link(PLATFORM, Some((END_EFFECTOR, effector)), vec![bearing]);
    }

    /// The two joints of a cross between two bodies: about the axis `first` of the first body, then about the axis
    /// `second` of the other one.
    fn hooke(&self, name: &str, [from, to]: [usize; 2], [first, second]: [Vector3<f64>; 2]) -> Vec<Joint> {
        let seen = self.poses[to].rotation.inverse() * (self.poses[from].rotation * Unit::new_normalize(first));
        let turns = [(format!("{name}_1"), seen.into_inner()), (format!("{name}_2"), second)];
        let joint = |(name, axis)| Joint { friction: self.frictions.hooke, ..passive(name, Freedom::Turn(axis)) };
        turns.map(joint).into()
    }
}

/// The motion of the robot in the pose in which every joint is at zero; `None` if the struts do not reach.
pub(super) fn home(plant: &Plant) -> Option<Motion> {
    plant.motion(&JointState::default()).ok()
}

fn passive(name: String, freedom: Freedom) -> Joint {
    Joint { name, freedom, friction: Friction::default(), range: None, drive: None, follows: None }
}

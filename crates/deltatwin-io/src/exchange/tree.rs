//! The robot as a tree of links, with the joints that close its loops.
//!
//! The platform hangs on the telescope if there is one, so that the lower sockets of the struts are all that is left to
//! close. Every joint is at zero in the home pose q = 0, and every link then stands as on the assembled robot.

use nalgebra::{Isometry3, Unit, Vector3};

use deltatwin::cell::links::{Cylinder, cylinder};
use deltatwin::dynamics::Plant;
use deltatwin::kinematics::{JointState, Motion};
use deltatwin::machine::bodies::{
    ARM, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER, body_name,
};
use deltatwin::machine::{ARMS, Actuator, Drive, Inertia, STRUTS};
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
    /// Height of the link's own frame above the joints' along their common z, m.
    pub offset: f64,
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

/// Points of two links that coincide: a ball socket that closes a loop.
pub(super) struct Loop {
    /// Name.
    pub name: String,
    /// Indices of strut and platform.
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
        let mut builder = Builder { model, plant, poses: home.poses(), frictions, links: Vec::new() };
        builder.limbs();
        let platform = if plant.mechanism.has_telescope() { builder.telescope() } else { builder.free_platform() };
        let geometry = &plant.geometry;
        let loops = (0..STRUTS).map(|strut| {
            let limb = strut / 2;
            Loop {
                name: format!("socket{}_lower", strut + 1),
                // Arms and struts come first, limb by limb.
                links: [3 * limb + 1 + strut % 2, platform],
                points: [Vector3::x() * geometry.limbs[limb].strut_length, geometry.platform_ball(strut)],
            }
        });
        Self { loops: loops.collect(), links: builder.links }
    }
}

struct Builder<'a> {
    model: &'a Model,
    plant: &'a Plant,
    /// Poses of the bodies in the home pose.
    poses: [Isometry3<f64>; deltatwin::machine::bodies::SLOTS],
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
            offset: 0.0,
            inertia: self.plant.bodies[body],
            shape: cylinder(&self.plant.geometry, body),
        });
        self.links.len() - 1
    }

    fn driven(&self, axis: usize, freedom: Freedom, range: Option<[f64; 2]>) -> Joint {
        let (friction, drive) = (self.frictions.drives[axis], Some(self.model.drives[axis]));
        Joint { name: format!("axis{}", axis + 1), freedom, friction, range, drive }
    }

    /// Arms with their struts.
    fn limbs(&mut self) {
        for limb in 0..ARMS {
            let geometry = &self.plant.geometry;
            let freedom = match geometry.limbs[limb].actuator {
                Actuator::Revolute => Freedom::Turn(Vector3::y()),
                Actuator::Prismatic { .. } => Freedom::Slide(Vector3::x()),
            };
            let axis = self.driven(limb, freedom, Some(geometry.limbs[limb].limits));
            let arm = self.link(ARM + limb, None, vec![axis]);
            for strut in [2 * limb, 2 * limb + 1] {
                let ball = passive(format!("socket{}_upper", strut + 1), Freedom::Ball);
                self.link(STRUT + strut, Some((ARM + limb, arm)), vec![ball]);
            }
        }
    }

    /// The platform of a robot without telescope.
    fn free_platform(&mut self) -> usize {
        self.link(PLATFORM, None, vec![passive("translation".into(), Freedom::Free)])
    }

    /// Rotor, telescope, end effector and, on its bearing, the platform; returns the platform's index.
    fn telescope(&mut self) -> usize {
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
        let offset = geometry.flange_height - geometry.lower_hooke_height;
        let carried = &mut self.links[effector];
        carried.origin *= nalgebra::Translation3::new(0.0, 0.0, -offset);
        carried.offset = offset;
        let bearing = passive("bearing".into(), Freedom::Turn(-Vector3::z()));
        self.link(PLATFORM, Some((END_EFFECTOR, effector)), vec![bearing])
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
    Joint { name, freedom, friction: Friction::default(), range: None, drive: None }
}

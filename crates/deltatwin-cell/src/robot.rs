//! The robot as seen by the contact solver: parts of its links and the held object.

use deltatwin::kinematics::{Motion, SocketSet};
use deltatwin::machine::bodies::{END_EFFECTOR, SLOTS};
use deltatwin::twin::ContactBody;
use nalgebra::{Matrix3, Vector3};

use super::hull::Hull;
use super::links::Part;
use super::placement::{Bounds, Placement};
use super::world::{Collider, World};

/// Parts of the links, and the object in the gripper.
pub struct Robot {
    /// Parts in order of the bodies.
    pub parts: Vec<Part>,
    /// The held object, if any.
    pub grip: Option<Grip>,
    /// Largest distance of a point of each body from the body's origin, m; that of the held object follows.
    own: [f64; SLOTS],
    held: f64,
    /// Number of struts.
    pub struts: usize,
}

/// An object in the gripper: its index and its pose in the end effector's frame.
#[derive(Clone, Copy)]
pub struct Grip {
    /// Index of the object.
    pub object: usize,
    /// Rotation from the object's to the end effector's axes.
    pub rotation: Matrix3<f64>,
    /// Origin of the object in the end effector's frame, m.
    pub position: Vector3<f64>,
}

/// A part or held object with its pose.
pub struct Placed<'a> {
    /// Body of the twin on which its loads act.
    pub body: usize,
    /// Shape.
    pub hull: &'a Hull,
    /// Pose and twist.
    pub at: Placement,
    /// Bounding box.
    pub bounds: Bounds,
}

impl Robot {
    /// A robot with this number of struts and an empty gripper.
    pub fn new(parts: Vec<Part>, struts: usize) -> Self {
        let mut own = [0.0_f64; SLOTS];
        for part in &parts {
            own[part.body] = own[part.body].max(part.position.norm() + part.hull.extent());
        }
        Self { parts, grip: None, own, held: 0.0, struts }
    }

    /// Attaches an object that extends to `extent` m from its origin.
    pub fn hold(&mut self, grip: Grip, extent: f64) {
        self.held = grip.position.norm() + extent;
        self.grip = Some(grip);
    }

    /// Releases the held object, if any.
    pub fn release(&mut self) -> Option<Grip> {
        self.held = 0.0;
        self.grip.take()
    }

    /// All sockets.
    pub fn sockets(&self) -> SocketSet {
        SocketSet::of(self.struts)
    }

    /// Largest distance of a point that moves with each body from the body's origin, m.
    pub fn extents(&self) -> [f64; SLOTS] {
        let mut extents = self.own;
        extents[END_EFFECTOR] = extents[END_EFFECTOR].max(self.held);
        extents
    }

    /// Whether the collider is a part of the robot or held by it.
    pub fn owns(&self, collider: Collider) -> bool {
        match collider {
            Collider::Part(_) => true,
            Collider::Object(o) => self.grip.is_some_and(|g| g.object == o),
        }
    }

    /// The body to which a collider belongs.
    pub fn named(&self, collider: Collider) -> ContactBody {
        match collider {
            Collider::Part(p) => ContactBody::Link(self.parts[p].body),
            Collider::Object(o) => ContactBody::Object(o),
        }
    }

    /// A part or the held object at `motion`; `None` for any other collider.
    pub fn placed<'a>(&'a self, world: &'a World, collider: Collider, motion: &Motion) -> Option<Placed<'a>> {
        let (body, hull, at) = match (collider, self.grip) {
            (Collider::Part(p), _) => {
                let part = self.parts.get(p)?;
                let at = Placement::from(&motion.bodies[part.body]).offset(&part.rotation, &part.position);
                (part.body, &part.hull, at)
            }
            (Collider::Object(o), Some(grip)) if grip.object == o => {
                (END_EFFECTOR, &world.objects[o].hull, grip.placement(motion))
            }
            _ => return None,
        };
        Some(Placed { body, hull, at, bounds: hull.bounds(&at) })
    }
}

impl Grip {
    /// Pose and twist of the object at `motion`.
    pub fn placement(&self, motion: &Motion) -> Placement {
        Placement::from(&motion.bodies[END_EFFECTOR]).offset(&self.rotation, &self.position)
    }
}

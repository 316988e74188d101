//! The robot's side of contacts: the parts of its links and what it holds.

use deltatwin::kinematics::Motion;
use deltatwin::machine::bodies::{BODIES, END_EFFECTOR};
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
    /// What it holds.
    pub grip: Option<Grip>,
    /// Largest distance of a point of each body, and of what it holds, from the body's origin, m.
    own: [f64; BODIES],
    held: f64,
}

/// An object in the gripper: its index and its pose in the end effector's frame.
#[derive(Clone, Copy)]
pub struct Grip {
    /// Which object.
    pub object: usize,
    /// Maps object to end effector.
    pub rotation: Matrix3<f64>,
    /// Its origin, m.
    pub position: Vector3<f64>,
}

/// A part or held object in the world.
pub struct Placed<'a> {
    /// Body of the twin that bears its loads.
    pub body: usize,
    /// Shape.
    pub hull: &'a Hull,
    /// Where it is.
    pub at: Placement,
    /// Box around it.
    pub bounds: Bounds,
}

impl Robot {
    /// A robot that holds nothing.
    pub fn new(parts: Vec<Part>) -> Self {
        let mut own = [0.0_f64; BODIES];
        for part in &parts {
            own[part.body] = own[part.body].max(part.position.norm() + part.hull.extent());
        }
        Self { parts, grip: None, own, held: 0.0 }
    }

    /// Takes an object that reaches `extent` m from its origin.
    pub fn hold(&mut self, grip: Grip, extent: f64) {
        self.held = grip.position.norm() + extent;
        self.grip = Some(grip);
    }

    /// Lets go.
    pub fn release(&mut self) -> Option<Grip> {
        self.held = 0.0;
        self.grip.take()
    }

    /// Largest distance of a point that moves with each body from the body's origin, m.
    pub fn extents(&self) -> [f64; BODIES] {
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

    /// The body that a collider belongs to.
    pub fn named(&self, collider: Collider) -> ContactBody {
        match collider {
            Collider::Part(p) => ContactBody::Link(self.parts[p].body),
            Collider::Object(o) => ContactBody::Object(o),
        }
    }

    /// A part, or the held object, as it moves with the robot.
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
    /// Where the object is while the robot is at `motion`.
    pub fn placement(&self, motion: &Motion) -> Placement {
        Placement::from(&motion.bodies[END_EFFECTOR]).offset(&self.rotation, &self.position)
    }
}

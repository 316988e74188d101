//! All colliding bodies as bodies of Rapier: objects, and the robot's links as kinematic bodies that follow the twin.

use deltatwin::cell::{Mobility, Object};
use deltatwin::kinematics::SocketSet;
use deltatwin::machine::Inertia;
use deltatwin::machine::bodies::SLOTS;
use nalgebra::{Isometry3, Rotation3, Vector3};
use parry3d::query;
use rapier3d::dynamics::{FrictionModel, RigidBodyType, SpringCoefficients};
use rapier3d::prelude::{
    ActiveCollisionTypes, ActiveHooks, ColliderBuilder, ColliderHandle, Group, InteractionGroups, InteractionTestMode,
    PhysicsWorld, Pose, RigidBodyBuilder, RigidBodyHandle, Vector,
};

use super::hooks::Surfaces;
use super::hull::Hull;
use super::links::Part;
use super::placement::{Bounds, Placement};
use super::robot::Robot;

/// Typical dimension of an object, m; scales Rapier's tolerances.
const LENGTH_UNIT: f64 = 0.05;
/// Penetration that Rapier leaves uncorrected, m; small, because a picked object keeps it under the stiffer law of this
/// crate.
const ALLOWED_PENETRATION: f64 = 1e-6;
/// Natural frequency of Rapier's contacts, Hz; for the same reason above its default of 30 Hz.
const CONTACT_FREQUENCY: f64 = 200.0;
/// Upper bound of all speeds in the cell, m/s.
const MAX_SPEED: f64 = 1e3;
/// Longest step of Rapier, s.
const MAX_STEP: f64 = 1e-3;
/// Distance below which Rapier anticipates contacts of objects, m; its default for this length unit.
const PREDICTION: f64 = 0.02 * LENGTH_UNIT;

/// An object and its state.
pub struct Body {
    /// Description in the scenario.
    pub object: Object,
    /// Collision geometry.
    pub hull: Hull,
    /// Inertia about its origin, the centre of mass; zero unless free.
    pub inertia: Inertia,
    /// False while it is held by the robot.
    pub present: bool,
    /// Pose and twist.
    pub at: Placement,
    /// Bounding box at this pose.
    pub bounds: Bounds,
    /// Largest distance of a point from the origin, m.
    pub extent: f64,
    handle: RigidBodyHandle,
    collider: ColliderHandle,
}

impl Body {
    fn new(object: &Object) -> Self {
        let rotation = *Rotation3::from_axis_angle(&Vector3::z_axis(), object.yaw).matrix();
        let at = Placement::at_rest(rotation, object.position);
        let hull = Hull::solid(&object.shape);
        let inertia = match object.mobility {
            Mobility::Free { mass } => object.shape.inertia(mass),
            _ => Inertia::ZERO,
        };
        Self {
            object: object.clone(),
            bounds: hull.bounds(&at),
            extent: hull.extent(),
            hull,
            inertia,
            present: true,
            at,
            handle: RigidBodyHandle::invalid(),
            collider: ColliderHandle::invalid(),
        }
    }

    /// Makes it an object among others, whose contacts Rapier solves.
    fn join(&mut self, rapier: &mut PhysicsWorld) {
        self.present = true;
        if let Some(collider) = rapier.colliders.get_mut(self.collider) {
            collider.set_collision_groups(InteractionGroups::new(OBJECTS, Group::ALL, InteractionTestMode::And));
            collider.set_solver_groups(InteractionGroups::all());
        }
    }

    /// Velocity of the surface relative to the body, m/s.
    pub fn belt(&self) -> Vector3<f64> {
        if let Mobility::Conveyor { velocity } = self.object.mobility { velocity } else { Vector3::zeros() }
    }

    /// Whether it can be picked up.
    pub fn is_free(&self) -> bool {
        matches!(self.object.mobility, Mobility::Free { .. })
    }

    /// Angular momentum about the origin, inertial axes, N·m·s.
    pub fn angular_momentum(&self) -> Vector3<f64> {
        self.at.rotation * (self.inertia.tensor * self.at.rotation.tr_mul(&self.at.angular_velocity))
    }
}

/// Collision group of the objects, which may collide with everything.
const OBJECTS: Group = Group::GROUP_1;
/// Collision group of the robot's links and of the object it holds.
const LINKS: Group = Group::GROUP_2;
/// Collision group of parts inside the sockets, which collide with objects only.
const SOCKETS: Group = Group::GROUP_3;

/// Owner of a collider; stored in Rapier's user data.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Collider {
    /// Part of a link, by index.
    Part(usize),
    /// Object, by index.
    Object(usize),
}

impl Collider {
    fn encode(self) -> u128 {
        match self {
            Self::Part(i) => (i as u128) << 1,
            Self::Object(i) => (i as u128) << 1 | 1,
        }
    }

    fn decode(data: u128) -> Self {
        let index = (data >> 1) as usize;
        if data & 1 == 0 { Self::Part(index) } else { Self::Object(index) }
    }
}

/// All bodies that can collide.
pub struct World {
    /// Objects in the order given.
    pub objects: Vec<Body>,
    /// Steps of the free objects so far.
    pub steps: usize,
    rapier: PhysicsWorld,
    surfaces: Surfaces,
    /// Kinematic bodies of the robot's bodies; the colliders of their parts follow.
    links: [RigidBodyHandle; SLOTS],
    parts: Vec<ColliderHandle>,
}

impl World {
    /// Objects at their initial poses under `gravity` (m/s²), and the parts of a robot.
    pub fn new(objects: &[Object], parts: &[Part], gravity: Vector3<f64>) -> Self {
        let mut rapier = PhysicsWorld::new();
        rapier.gravity = glam(&gravity);
        let parameters = &mut rapier.integration_parameters;
        parameters.length_unit = LENGTH_UNIT;
        parameters.normalized_allowed_linear_error = ALLOWED_PENETRATION / LENGTH_UNIT;
        parameters.normalized_max_linear_velocity = MAX_SPEED / LENGTH_UNIT;
        parameters.normalized_prediction_distance = PREDICTION / LENGTH_UNIT;
        parameters.contact_recycling = false;
        parameters.contact_softness = SpringCoefficients::new(CONTACT_FREQUENCY, 10.0);
        parameters.static_contact_softness = SpringCoefficients::new(CONTACT_FREQUENCY, 10.0);
        parameters.friction_model = FrictionModel::Coulomb;
        let links = std::array::from_fn(|_| rapier.insert_body(RigidBodyBuilder::kinematic_position_based()));
        let mut world = Self {
            objects: objects.iter().map(Body::new).collect(),
            steps: 0,
            rapier,
            surfaces: Surfaces::default(),
            links,
            parts: Vec::with_capacity(parts.len()),
        };
        for (i, part) in parts.iter().enumerate() {
            world.insert_part(i, part);
        }
        for i in 0..objects.len() {
            world.insert_object(i);
        }
        world
    }

    fn insert_part(&mut self, index: usize, part: &Part) {
        let (shape, pose) = part.hull.shape();
        let at = Placement::at_rest(part.rotation, part.position).isometry() * pose;
        let collider = ColliderBuilder::new(shape)
            .position(at.into())
            .density(0.0)
            .user_data(Collider::Part(index).encode())
            .collision_groups(robot_groups(part.meets_links, false))
            // Contacts of the robot are found and solved by this crate.
            .solver_groups(InteractionGroups::none())
            .active_hooks(ActiveHooks::FILTER_CONTACT_PAIRS)
            .active_collision_types(ActiveCollisionTypes::all());
        self.parts.push(self.rapier.insert_collider(collider, Some(self.links[part.body])));
    }

    fn insert_object(&mut self, index: usize) {
        let body = &mut self.objects[index];
        let builder = match body.object.mobility {
            Mobility::Free { .. } => RigidBodyBuilder::dynamic().can_sleep(false),
            Mobility::Fixed | Mobility::Conveyor { .. } => RigidBodyBuilder::fixed(),
        };
        let hooks = match body.object.mobility {
            Mobility::Fixed => ActiveHooks::empty(),
            Mobility::Conveyor { .. } | Mobility::Free { .. } => ActiveHooks::MODIFY_SOLVER_CONTACTS,
        };
        let (shape, pose) = body.hull.shape();
        let collider = ColliderBuilder::new(shape)
            .position(pose.into())
            .mass(body.inertia.mass)
            .friction(body.object.surface.friction)
            .active_hooks(hooks)
            .active_collision_types(ActiveCollisionTypes::all())
            .user_data(Collider::Object(index).encode());
        (body.handle, body.collider) = self.rapier.insert(builder.pose(body.at.isometry().into()), collider);
        body.join(&mut self.rapier);
        if let Mobility::Conveyor { velocity } = body.object.mobility {
            self.surfaces.0.push((body.handle, velocity));
        }
    }

    /// Objects that are not held.
    pub fn present(&self) -> impl Iterator<Item = &Body> {
        self.objects.iter().filter(|o| o.present)
    }

    /// Free objects that are not held.
    pub fn free(&self) -> impl Iterator<Item = &Body> {
        self.present().filter(|o| o.is_free())
    }

    /// Index of the object called `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.objects.iter().position(|o| o.object.name == name)
    }

    /// Makes an object part of the robot.
    pub fn take(&mut self, index: usize) {
        let object = &mut self.objects[index];
        object.present = false;
        if let Some(body) = self.rapier.bodies.get_mut(object.handle) {
            body.set_body_type(RigidBodyType::KinematicPositionBased, false);
        }
        if let Some(collider) = self.rapier.colliders.get_mut(object.collider) {
            collider.set_solver_groups(InteractionGroups::none());
        }
    }

    /// Releases an object with pose and twist `at`.
    pub fn put(&mut self, index: usize, at: Placement) {
        let object = &mut self.objects[index];
        object.at = at;
        object.bounds = object.hull.bounds(&at);
        object.join(&mut self.rapier);
        if let Some(body) = self.rapier.bodies.get_mut(object.handle) {
            body.set_body_type(RigidBodyType::Dynamic, true);
            body.set_position(at.isometry().into(), true);
            body.set_linvel(glam(&at.velocity), true);
            body.set_angvel(glam(&at.angular_velocity), true);
        }
    }

    /// Sets the poses of the robot's bodies, and of the object it holds, with the sockets in `closed`; poses that are
    /// not finite are ignored.
    pub fn mirror(
        &mut self,
        robot: &Robot,
        bodies: &[Placement; SLOTS],
        held: Option<(usize, Placement)>,
        closed: SocketSet,
    ) {
        let broken = closed != robot.sockets();
        let moved = self.links.iter().zip(bodies).map(|(h, at)| (*h, *at));
        for (handle, at) in moved.chain(held.map(|(i, at)| (self.objects[i].handle, at))) {
            if let Some(body) = self.rapier.bodies.get_mut(handle).filter(|_| at.is_finite()) {
                let pose: Pose = at.isometry().into();
                // Rapier searches for pairs again only after a change of pose, and an equal pose is not a change.
                body.set_next_kinematic_position(Pose::from_translation(pose.translation + Vector::X));
                body.set_position(pose, false);
            }
        }
        for (handle, part) in self.parts.iter().zip(&robot.parts) {
            let Some(collider) = self.rapier.colliders.get_mut(*handle) else { continue };
            collider.set_enabled(part.bared_by.is_none_or(|socket| !closed.contains(socket)));
            collider.set_collision_groups(robot_groups(part.meets_links, broken));
        }
        if let Some(collider) = held.and_then(|(i, _)| self.rapier.colliders.get_mut(self.objects[i].collider)) {
            collider.set_collision_groups(robot_groups(true, broken));
        }
    }

    /// Pairs of colliders closer to each other than `distance` (m); pairs without the robot only if Rapier already
    /// knows them.
    pub fn pairs(&mut self, distance: f64) -> impl Iterator<Item = (Collider, Collider)> {
        // A step of zero length searches for pairs without motion. Each box is extended by half of the prediction
        // distance, but those of objects may be older.
        let parameters = &mut self.rapier.integration_parameters;
        parameters.dt = 0.0;
        parameters.normalized_prediction_distance = 2.0 * distance / LENGTH_UNIT;
        self.rapier.step_with_events(&self.surfaces, &());
        self.rapier.integration_parameters.normalized_prediction_distance = PREDICTION / LENGTH_UNIT;
        let colliders = &self.rapier.colliders;
        self.rapier.contact_pairs().filter_map(move |pair| {
            let (a, b) = (colliders.get(pair.collider1)?, colliders.get(pair.collider2)?);
            let gap = query::distance(a.position(), a.shape(), b.position(), b.shape());
            // If the distance cannot be computed, the shapes count as near.
            let near = gap.map_or(true, |gap| gap.distance <= distance);
            near.then(|| (Collider::decode(a.user_data), Collider::decode(b.user_data)))
        })
    }

    /// Advances the free objects by `h` s under `loads`: force (N) and moment about its origin (N·m) on each object.
    pub fn advance(&mut self, h: f64, loads: &[(Vector3<f64>, Vector3<f64>)]) {
        if !(h > 0.0 && h.is_finite()) || self.free().next().is_none() {
            return;
        }
        for (object, (force, moment)) in self.objects.iter().zip(loads) {
            if let Some(body) = self.rapier.bodies.get_mut(object.handle)
                && body.is_dynamic()
            {
                body.reset_forces(false);
                body.reset_torques(false);
                body.add_force(glam(force), true);
                body.add_torque(glam(moment), true);
            }
        }
        let steps = (h / MAX_STEP).ceil().max(1.0);
        self.rapier.integration_parameters.dt = h / steps;
        for _ in 0..steps as usize {
            self.rapier.step_with_events(&self.surfaces, &());
            self.steps += 1;
        }
        for object in self.objects.iter_mut().filter(|o| o.present && o.is_free()) {
            let Some(body) = self.rapier.bodies.get(object.handle) else { continue };
            let pose: Isometry3<f64> = (*body.position()).into();
            object.at = Placement {
                rotation: *pose.rotation.to_rotation_matrix().matrix(),
                position: pose.translation.vector,
                velocity: own(&body.linvel()),
                angular_velocity: own(&body.angvel()),
            };
            object.bounds = object.hull.bounds(&object.at);
        }
    }
}

/// Collision groups of a part of the robot: links collide with each other once the robot is broken.
fn robot_groups(meets_links: bool, broken: bool) -> InteractionGroups {
    let (own, others) = match (meets_links, broken) {
        (false, _) => (SOCKETS, OBJECTS),
        (true, false) => (LINKS, OBJECTS),
        (true, true) => (LINKS, OBJECTS | LINKS),
    };
    InteractionGroups::new(own, others, InteractionTestMode::And)
}

fn glam(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn own(v: &Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

#[cfg(test)]
mod tests;

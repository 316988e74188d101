//! The robot's surroundings: table, conveyor, obstacles and products.
//!
//! All of them and the robot's links are bodies of Rapier. It moves the free objects, solves their contacts with each
//! other, and finds what comes near the robot: its links are kinematic bodies that follow the twin. A kinematic body pushes
//! as if it were infinitely heavy and takes no reaction, so where the robot touches objects, or itself once it has fallen
//! apart, the compliant [`law`] acts on both sides with opposite sign: momentum crosses between twin and Rapier without
//! loss.

mod contact;
mod hooks;
mod hull;
pub mod law;
pub mod links;
pub mod mesh;
mod neighbours;
pub mod object;
mod placement;
mod robot;
#[cfg(test)]
mod tests;
mod urdf;
mod world;

use nalgebra::{Isometry3, Matrix3, Vector3};
use thiserror::Error;

pub use object::{Mobility, Object, Shape, Surface};
pub use urdf::urdf;

use crate::kinematics::{Motion, SocketSet};
use crate::machine::bodies::{BODIES, END_EFFECTOR, body_name};
use crate::machine::{Geometry, Inertia};
use contact::{Wrench, about, add, press};
use hull::{Hull, Point};
use links::Part;
use neighbours::Neighbours;
use placement::Placement;
use robot::{Grip, Robot};
use world::{Collider, World};

/// Force, N, and moment about the origin of each body, N·m, world axes.
pub type BodyWrenches = [(Vector3<f64>, Vector3<f64>); BODIES];

const UNLOADED: BodyWrenches = [(Vector3::new(0.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.0)); BODIES];

/// Relative acceleration that [`Cell::near`] reckons with, m/s².
const ACCELERATION: f64 = 300.0;
/// [`Cell::contact_step`] over √(m/k).
const STEP: f64 = 0.1;
/// Deepest contact at which a run may start, m.
const DEEPEST_START: f64 = 1e-3;
/// Mass felt at the end of a strut, kg: a quarter of 0.179 kg (paper, Table 3).
const STRUT_END_MASS: f64 = 0.045;

/// What is wrong with a cell, or with a request to it.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CellError {
    /// Two objects of one name.
    #[error("two objects are named '{0}'")]
    DuplicateName(String),
    /// An object without a name.
    #[error("object {0} has no name")]
    NoName(usize),
    /// A size, mass or surface property out of range.
    #[error("'{object}': {what} is {value}, expected a {expected} number")]
    BadValue {
        /// Name of the object.
        object: String,
        /// Which quantity.
        what: &'static str,
        /// What it is.
        value: f64,
        /// What it should be.
        expected: &'static str,
    },
    /// A mesh that would have to fall.
    #[error("'{0}' is free, which a mesh cannot be; expected shape = \"hull\", or a fixed mesh")]
    FreeMesh(String),
    /// No object of that name.
    #[error("there is no object '{0}'")]
    Unknown(String),
    /// A fixed object cannot be picked.
    #[error("'{0}' is not free and cannot be picked up")]
    NotFree(String),
    /// The gripper is occupied.
    #[error("cannot pick up '{wanted}': the gripper holds '{held}'")]
    Occupied {
        /// What was to be picked.
        wanted: String,
        /// What is in the gripper.
        held: String,
    },
    /// Nothing to release.
    #[error("the gripper holds nothing to release")]
    Empty,
    /// Robot and object in one place.
    #[error("{link} stands {:.1} mm deep in '{other}' at the start", 1e3 * .depth)]
    Overlap {
        /// Link of the robot.
        link: String,
        /// The object.
        other: String,
        /// How deep, m.
        depth: f64,
    },
}

/// Linear and angular velocity, m/s and rad/s, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twist {
    /// Of the origin, m/s.
    pub velocity: Vector3<f64>,
    /// rad/s.
    pub angular_velocity: Vector3<f64>,
}

/// An object at the moment it is picked up.
#[derive(Clone, Debug, PartialEq)]
pub struct Held {
    /// Its name.
    pub name: String,
    /// Its inertia about the origin and along the axes of the end effector's frame.
    pub inertia: Inertia,
    /// Its centre of mass, m, inertial frame.
    pub position: Vector3<f64>,
    /// Its twist at the centre of mass; the end effector's own may differ, and the twin shares out the momentum.
    pub twist: Twist,
}

/// What the robot touched, and how hard.
#[derive(Clone, Debug, PartialEq)]
pub struct Touch {
    /// Link, or held object.
    pub link: String,
    /// Object or other link.
    pub other: String,
    /// Sum of the normal forces of all contact points, N.
    pub force: f64,
}

/// A pair in contact: sum of the normal forces.
#[derive(Clone, Copy)]
struct Pair {
    link: Collider,
    other: Collider,
    force: f64,
    depth: f64,
}

/// The cell with everything in it but the robot's dynamics.
pub struct Cell {
    /// Number of objects given; the robot's frame follows.
    listed: usize,
    world: World,
    robot: Robot,
    neighbours: Neighbours,
    wrenches: BodyWrenches,
    /// Loads on the objects, force and moment about the origin, at the last contact, and at the one before.
    reactions: Vec<Wrench>,
    earlier: Vec<Wrench>,
    /// `contact` was called since the last `advance`.
    fresh: bool,
    pairs: Vec<Pair>,
    points: Vec<Point>,
}

impl Cell {
    /// A cell with `objects` around a robot; `payload` is a rigid shape on the flange with its centre in the end effector's
    /// frame, m; `gravity` in m/s², inertial frame.
    pub fn new(
        objects: &[Object],
        geometry: &Geometry,
        payload: Option<(Shape, Vector3<f64>)>,
        gravity: Vector3<f64>,
    ) -> Result<Self, CellError> {
        Self::around(objects, None, geometry, payload, gravity)
    }

    /// The same with the robot's own frame, which loose parts can hit.
    pub fn with_frame(
        objects: &[Object],
        geometry: &Geometry,
        payload: Option<(Shape, Vector3<f64>)>,
        gravity: Vector3<f64>,
    ) -> Result<Self, CellError> {
        Self::around(objects, links::frame(geometry), geometry, payload, gravity)
    }

    fn around(
        objects: &[Object],
        frame: Option<Object>,
        geometry: &Geometry,
        payload: Option<(Shape, Vector3<f64>)>,
        gravity: Vector3<f64>,
    ) -> Result<Self, CellError> {
        for (i, object) in objects.iter().enumerate() {
            object.check(i)?;
            if objects[..i].iter().any(|o| o.name == object.name) {
                return Err(CellError::DuplicateName(object.name.clone()));
            }
        }
        let all: Vec<Object> = objects.iter().cloned().chain(frame).collect();
        let mut parts = links::parts(geometry);
        if let Some((shape, position)) = payload {
            object::check_shape("payload", &shape)?;
            object::check_finite("payload", "position", position.as_slice())?;
            parts.push(Part {
                body: END_EFFECTOR,
                rotation: Matrix3::identity(),
                position,
                hull: Hull::solid(&shape),
                meets_links: true,
                bared_by: None,
            });
        }
        Ok(Self {
            listed: objects.len(),
            world: World::new(&all, &parts, gravity),
            robot: Robot::new(parts),
            neighbours: Neighbours::default(),
            wrenches: UNLOADED,
            reactions: vec![(Vector3::zeros(), Vector3::zeros()); all.len()],
            earlier: vec![(Vector3::zeros(), Vector3::zeros()); all.len()],
            fresh: false,
            pairs: Vec::new(),
            points: Vec::new(),
        })
    }

    /// Whether anything could touch within `horizon` s at the present speeds, so that steps must not be longer than
    /// [`Self::contact_step`].
    pub fn near(&mut self, motion: &Motion, closed: SocketSet, horizon: f64) -> bool {
        let Self { world, robot, neighbours, .. } = self;
        let travel = |speed: f64| speed * horizon + 0.5 * ACCELERATION * horizon * horizon;
        let extents = robot.extents();
        let speed_of = |body: usize| Placement::from(&motion.bodies[body]).speed(extents[body]);
        let links = (0..BODIES).map(speed_of).fold(0.0, f64::max);
        let objects = world.present().map(|o| o.at.speed(o.extent)).fold(0.0, f64::max);
        neighbours.look(world, robot, motion, closed, travel(links + links.max(objects)));
        neighbours.pairs.iter().any(|&(first, second)| {
            let Some(link) = robot.placed(world, first, motion) else { return false };
            let within = |bounds: &placement::Bounds, hull: &Hull, at: &Placement, speed: f64| {
                let margin = travel(speed_of(link.body) + speed);
                link.bounds.overlap(bounds, margin) && link.hull.within(&link.at, hull, at, margin)
            };
            match (robot.placed(world, second, motion), second) {
                (Some(other), _) => within(&other.bounds, other.hull, &other.at, speed_of(other.body)),
                (None, Collider::Object(o)) => {
                    let object = &world.objects[o];
                    within(&object.bounds, &object.hull, &object.at, object.at.speed(object.extent))
                }
                (None, Collider::Part(_)) => false,
            }
        })
    }

    /// Longest step that resolves the oscillation of the lightest body on its contacts, s.
    pub fn contact_step(&self) -> f64 {
        let default = Surface::default();
        let objects = self.world.objects.iter().map(|o| {
            // A corner of a free body feels about a quarter of its mass.
            let own = if o.inertia.mass > 0.0 { 0.25 * o.inertia.mass } else { f64::INFINITY };
            own.min(STRUT_END_MASS) / o.object.surface.stiffness
        });
        STEP * objects.fold(STRUT_END_MASS / default.stiffness, f64::min).sqrt()
    }

    /// Contact wrenches on the robot's bodies for the poses and twists of `motion`, while the sockets in `closed` hold.
    /// The opposite loads act on the objects in the next [`Self::advance`]: momentum is conserved if the twin's wrenches go
    /// linearly from those of the call before to these over that step.
    pub fn contact(&mut self, motion: &Motion, closed: SocketSet) -> &BodyWrenches {
        let Self { world, robot, neighbours, wrenches, reactions, fresh, pairs, points, .. } = self;
        *wrenches = UNLOADED;
        *fresh = true;
        reactions.fill((Vector3::zeros(), Vector3::zeros()));
        pairs.clear();
        neighbours.look(world, robot, motion, closed, 0.0);
        for &(first, second) in &neighbours.pairs {
            let Some(link) = robot.placed(world, first, motion) else { continue };
            let other = robot.placed(world, second, motion);
            let (hull, at, bounds, surface, belt) = match (&other, second) {
                (Some(o), _) => (o.hull, o.at, o.bounds, Surface::default(), Vector3::zeros()),
                (None, Collider::Object(o)) => {
                    let object = &world.objects[o];
                    let surface = match first {
                        Collider::Object(held) => {
                            law::between(&world.objects[held].object.surface, &object.object.surface)
                        }
                        Collider::Part(_) => object.object.surface,
                    };
                    (&object.hull, object.at, object.bounds, surface, object.belt())
                }
                (None, Collider::Part(_)) => continue,
            };
            if !link.bounds.overlap(&bounds, 0.0) {
                continue;
            }
            points.clear();
            link.hull.contacts(&link.at, hull, &at, points);
            let loads = press(points, &surface, &link.at, &at, &belt);
            if loads.normal <= 0.0 {
                continue;
            }
            let origin = |body: usize| motion.bodies[body].position;
            add(&mut wrenches[link.body], &about(&loads.on_first, &link.at, &origin(link.body)));
            match (&other, second) {
                (Some(o), _) => add(&mut wrenches[o.body], &about(&loads.on_second, &o.at, &origin(o.body))),
                (None, Collider::Object(o)) => add(&mut reactions[o], &loads.on_second),
                (None, Collider::Part(_)) => {}
            }
            pairs.push(Pair { link: first, other: second, force: loads.normal, depth: loads.depth });
        }
        wrenches
    }

    /// Refuses a start in which the robot stands more than a millimetre deep in an object.
    pub fn check_start(&mut self, motion: &Motion) -> Result<(), CellError> {
        self.contact(motion, SocketSet::ALL);
        self.fresh = false;
        match self.pairs.iter().max_by(|a, b| a.depth.total_cmp(&b.depth)) {
            Some(pair) if pair.depth > DEEPEST_START => {
                Err(CellError::Overlap { link: self.name(pair.link), other: self.name(pair.other), depth: pair.depth })
            }
            _ => Ok(()),
        }
    }

    /// Moves the free objects on by `h` s under gravity, their own contacts and the opposite of the robot's contact
    /// wrenches, which went linearly from those of the [`Self::contact`] before to the last one's and got as far as
    /// `share` (0 to 1) of that way. Without a new `contact` the robot touches nothing.
    pub fn advance(&mut self, h: f64, share: f64) {
        if std::mem::take(&mut self.fresh) {
            for (now, earlier) in self.reactions.iter_mut().zip(&self.earlier) {
                now.0 = earlier.0.lerp(&now.0, share);
                now.1 = earlier.1.lerp(&now.1, share);
            }
        } else {
            self.reactions.fill((Vector3::zeros(), Vector3::zeros()));
            self.earlier.fill((Vector3::zeros(), Vector3::zeros()));
        }
        for (mean, now) in self.earlier.iter_mut().zip(&self.reactions) {
            *mean = (0.5 * (mean.0 + now.0), 0.5 * (mean.1 + now.1));
        }
        self.world.advance(h, &self.earlier);
        std::mem::swap(&mut self.earlier, &mut self.reactions);
    }

    /// Takes a free object into the gripper, where it keeps its pose relative to the end effector.
    pub fn pick(&mut self, name: &str, motion: &Motion) -> Result<Held, CellError> {
        let index = self.world.find(name).ok_or_else(|| CellError::Unknown(name.into()))?;
        if let Some(grip) = self.robot.grip {
            let held = self.world.objects[grip.object].object.name.clone();
            return Err(CellError::Occupied { wanted: name.into(), held });
        }
        let object = &self.world.objects[index];
        if !object.is_free() {
            return Err(CellError::NotFree(name.into()));
        }
        let (at, hand) = (object.at, &motion.bodies[END_EFFECTOR]);
        let rotation = hand.rotation.tr_mul(&at.rotation);
        let position = hand.rotation.tr_mul(&(at.position - hand.position));
        let mut inertia = Inertia::point(object.inertia.mass, position);
        inertia.tensor += rotation * object.inertia.tensor * rotation.transpose();
        self.robot.hold(Grip { object: index, rotation, position }, object.extent);
        self.world.take(index);
        self.reactions[index] = (Vector3::zeros(), Vector3::zeros());
        self.earlier[index] = (Vector3::zeros(), Vector3::zeros());
        let twist = Twist { velocity: at.velocity, angular_velocity: at.angular_velocity };
        Ok(Held { name: name.into(), inertia, position: at.position, twist })
    }

    /// Lets go of the held object with the pose and twist it has on the end effector; returns its name.
    pub fn release(&mut self, motion: &Motion) -> Result<String, CellError> {
        let grip = self.robot.release().ok_or(CellError::Empty)?;
        self.world.put(grip.object, grip.placement(motion));
        Ok(self.world.objects[grip.object].object.name.clone())
    }

    /// Objects in the order given, with pose and twist at their origins; a held one moves with the end effector of `motion`.
    pub fn objects<'a>(&'a self, motion: &'a Motion) -> impl Iterator<Item = (&'a Object, Isometry3<f64>, Twist)> {
        self.world.objects[..self.listed].iter().enumerate().map(|(i, o)| {
            let at = self.robot.grip.filter(|g| g.object == i).map_or(o.at, |g| g.placement(motion));
            (&o.object, at.isometry(), Twist { velocity: at.velocity, angular_velocity: at.angular_velocity })
        })
    }

    /// Name of the object in the gripper.
    pub fn held(&self) -> Option<&str> {
        self.robot.grip.map(|g| self.world.objects[g.object].object.name.as_str())
    }

    /// Momentum, N·s, and angular momentum about the inertial frame's origin, N·m·s, of the free objects.
    pub fn momentum(&self) -> (Vector3<f64>, Vector3<f64>) {
        let mut sum = (Vector3::zeros(), Vector3::zeros());
        for o in self.world.free() {
            let p = o.at.velocity * o.inertia.mass;
            add(&mut sum, &(p, o.at.position.cross(&p) + o.angular_momentum()));
        }
        sum
    }

    /// Kinetic energy of the free objects, J.
    pub fn kinetic_energy(&self) -> f64 {
        let energy = |o: &world::Body| {
            o.inertia.mass * o.at.velocity.norm_squared() + o.at.angular_velocity.dot(&o.angular_momentum())
        };
        0.5 * self.world.free().map(energy).sum::<f64>()
    }

    /// Potential energy of the free objects, J, zero at the inertial frame's origin.
    pub fn potential_energy(&self) -> f64 {
        -self.world.free().map(|o| o.inertia.mass * self.world.gravity().dot(&o.at.position)).sum::<f64>()
    }

    /// What the robot touched in the last [`Self::contact`]: each pair once, links in order.
    pub fn touching(&self) -> Vec<Touch> {
        let mut touches: Vec<Touch> = Vec::new();
        for pair in &self.pairs {
            let (link, other) = (self.name(pair.link), self.name(pair.other));
            match touches.iter_mut().find(|t| t.link == link && t.other == other) {
                Some(touch) => touch.force += pair.force,
                None => touches.push(Touch { link, other, force: pair.force }),
            }
        }
        touches
    }

    fn name(&self, collider: Collider) -> String {
        match collider {
            Collider::Part(p) => body_name(self.robot.parts[p].body),
            Collider::Object(o) => self.world.objects[o].object.name.clone(),
        }
    }
}

//! The robot's surroundings: table, conveyor, obstacles and products.
//!
//! The objects are bodies of Rapier, which moves the free ones and solves their contacts with each other. The robot's
//! links are not: where they touch objects, or each other once the robot has fallen apart, the compliant [`law`] acts on
//! both sides with opposite sign, so momentum crosses between twin and Rapier without loss.

mod hull;
pub mod law;
pub(crate) mod links;
pub mod object;
#[cfg(test)]
mod tests;
mod world;

use nalgebra::{Isometry3, Matrix3, Rotation3, Vector3};
use thiserror::Error;

pub use object::{Mobility, Object, Shape, Surface};

use crate::kinematics::{Motion, SocketSet};
use crate::model::bodies::{BODIES, END_EFFECTOR, body_name};
use crate::model::{Geometry, Inertia};
use hull::{Bounds, Hull, Placement, Point};
use links::Part;
use world::World;

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

#[derive(Clone, Copy, PartialEq)]
enum Collider {
    Part(usize),
    Held(usize),
    Object(usize),
}

/// An object in the gripper: its index and its pose in the end effector's frame.
#[derive(Clone, Copy)]
struct Grip {
    object: usize,
    rotation: Matrix3<f64>,
    position: Vector3<f64>,
}

/// The cell with everything in it but the robot's dynamics.
pub struct Cell {
    /// Number of objects given; the robot's frame follows.
    listed: usize,
    world: World,
    parts: Vec<Part>,
    grip: Option<Grip>,
    wrenches: BodyWrenches,
    /// On each object: force, and moment about its origin.
    /// Loads on the objects at the last contact, and at the one before.
    reactions: Vec<(Vector3<f64>, Vector3<f64>)>,
    earlier: Vec<(Vector3<f64>, Vector3<f64>)>,
    /// `contact` was called since the last `advance`.
    fresh: bool,
    pairs: Vec<Pair>,
    points: Vec<Point>,
    links: Vec<Placed>,
}

/// A part or held object of the robot in the world.
#[derive(Clone, Copy)]
struct Placed {
    collider: Collider,
    body: usize,
    at: Placement,
    bounds: Bounds,
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
        for (i, object) in objects.iter().enumerate() {
            object.check(i)?;
            if objects[..i].iter().any(|o| o.name == object.name) {
                return Err(CellError::DuplicateName(object.name.clone()));
            }
        }
        let all: Vec<Object> = objects.iter().cloned().chain(links::frame(geometry)).collect();
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
            world: World::new(&all, gravity),
            parts,
            grip: None,
            wrenches: UNLOADED,
            reactions: vec![(Vector3::zeros(), Vector3::zeros()); all.len()],
            earlier: vec![(Vector3::zeros(), Vector3::zeros()); all.len()],
            fresh: false,
            pairs: Vec::new(),
            points: Vec::new(),
            links: Vec::new(),
        })
    }

    /// Whether anything could touch within `horizon` s at the present speeds, so that steps must not be longer than
    /// [`Self::contact_step`].
    pub fn near(&self, motion: &Motion, closed: SocketSet, horizon: f64) -> bool {
        let travel = |speed: f64| speed * horizon + 0.5 * ACCELERATION * horizon * horizon;
        let mut placed = Vec::with_capacity(self.parts.len() + 1);
        place(&self.parts, &self.world, self.grip, motion, closed, &mut placed);
        let speed = |p: &Placed| {
            let b = &p.at;
            b.velocity.norm() + b.angular_velocity.norm() * p.bounds.reach(&b.position)
        };
        for (i, link) in placed.iter().enumerate() {
            let (own, own_speed) = (hull(&self.parts, &self.world, link.collider), speed(link));
            for object in self.world.present() {
                let margin = travel(own_speed + object.speed());
                if link.bounds.overlap(&object.bounds, margin) && own.within(&link.at, &object.hull, &object.at, margin)
                {
                    return true;
                }
            }
            if closed == SocketSet::ALL {
                continue;
            }
            for other in &placed[..i] {
                let margin = travel(own_speed + speed(other));
                if meet(&self.parts, link, other, closed)
                    && link.bounds.overlap(&other.bounds, margin)
                    && own.within(&link.at, hull(&self.parts, &self.world, other.collider), &other.at, margin)
                {
                    return true;
                }
            }
        }
        false
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
        let Self { world, parts, grip, wrenches, reactions, fresh, pairs, points, links, .. } = self;
        *wrenches = UNLOADED;
        *fresh = true;
        reactions.fill((Vector3::zeros(), Vector3::zeros()));
        pairs.clear();
        place(parts, world, *grip, motion, closed, links);
        for (i, link) in links.iter().enumerate() {
            let own = hull(parts, world, link.collider);
            for (o, object) in world.objects.iter().enumerate().filter(|(_, o)| o.present) {
                if !link.bounds.overlap(&object.bounds, 0.0) {
                    continue;
                }
                let surface = match link.collider {
                    Collider::Held(held) => law::between(&world.objects[held].object.surface, &object.object.surface),
                    _ => object.object.surface,
                };
                points.clear();
                own.contacts(&link.at, &object.hull, &object.at, points);
                let loads = press(points, &surface, &link.at, &object.at, &object.belt());
                if loads.normal > 0.0 {
                    add(
                        &mut wrenches[link.body],
                        &about(&loads.on_first, &link.at, &motion.bodies[link.body].position),
                    );
                    add(&mut reactions[o], &loads.on_second);
                    pairs.push(Pair {
                        link: link.collider,
                        other: Collider::Object(o),
                        force: loads.normal,
                        depth: loads.depth,
                    });
                }
            }
            for other in links[..i].iter().filter(|other| meet(parts, link, other, closed)) {
                if !link.bounds.overlap(&other.bounds, 0.0) {
                    continue;
                }
                points.clear();
                own.contacts(&link.at, hull(parts, world, other.collider), &other.at, points);
                let loads = press(points, &Surface::default(), &link.at, &other.at, &Vector3::zeros());
                if loads.normal > 0.0 {
                    for (body, load) in [(link, &loads.on_first), (other, &loads.on_second)] {
                        add(&mut wrenches[body.body], &about(load, &body.at, &motion.bodies[body.body].position));
                    }
                    pairs.push(Pair {
                        link: link.collider,
                        other: other.collider,
                        force: loads.normal,
                        depth: loads.depth,
                    });
                }
            }
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
        if let Some(grip) = self.grip {
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
        self.grip = Some(Grip { object: index, rotation, position });
        self.world.take(index);
        self.reactions[index] = (Vector3::zeros(), Vector3::zeros());
        self.earlier[index] = (Vector3::zeros(), Vector3::zeros());
        let twist = Twist { velocity: at.velocity, angular_velocity: at.angular_velocity };
        Ok(Held { name: name.into(), inertia, position: at.position, twist })
    }

    /// Lets go of the held object with the pose and twist it has on the end effector; returns its name.
    pub fn release(&mut self, motion: &Motion) -> Result<String, CellError> {
        let grip = self.grip.take().ok_or(CellError::Empty)?;
        self.world.put(grip.object, grip.placement(motion));
        Ok(self.world.objects[grip.object].object.name.clone())
    }

    /// Objects in the order given, with pose and twist at their origins; a held one moves with the end effector of `motion`.
    pub fn objects<'a>(&'a self, motion: &'a Motion) -> impl Iterator<Item = (&'a Object, Isometry3<f64>, Twist)> {
        self.world.objects[..self.listed].iter().enumerate().map(|(i, o)| {
            let at = self.grip.filter(|g| g.object == i).map_or(o.at, |g| g.placement(motion));
            let rotation = Rotation3::from_matrix_unchecked(at.rotation);
            let pose = Isometry3::from_parts(at.position.into(), rotation.into());
            (&o.object, pose, Twist { velocity: at.velocity, angular_velocity: at.angular_velocity })
        })
    }

    /// Name of the object in the gripper.
    pub fn held(&self) -> Option<&str> {
        self.grip.map(|g| self.world.objects[g.object].object.name.as_str())
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
            Collider::Part(p) => body_name(self.parts[p].body),
            Collider::Held(o) | Collider::Object(o) => self.world.objects[o].object.name.clone(),
        }
    }
}

impl Grip {
    fn placement(&self, motion: &Motion) -> Placement {
        Placement::from(&motion.bodies[END_EFFECTOR]).offset(&self.rotation, &self.position)
    }
}

type Wrench = (Vector3<f64>, Vector3<f64>);

fn add(sum: &mut Wrench, wrench: &Wrench) {
    sum.0 += wrench.0;
    sum.1 += wrench.1;
}

/// Moves a wrench about the origin of `at` to `origin`.
fn about(wrench: &Wrench, at: &Placement, origin: &Vector3<f64>) -> Wrench {
    (wrench.0, wrench.1 + (at.position - origin).cross(&wrench.0))
}

fn hull<'a>(parts: &'a [Part], world: &'a World, collider: Collider) -> &'a Hull {
    match collider {
        Collider::Part(p) => &parts[p].hull,
        Collider::Held(o) | Collider::Object(o) => &world.objects[o].hull,
    }
}

fn meet(parts: &[Part], a: &Placed, b: &Placed, closed: SocketSet) -> bool {
    let meets = |c: Collider| if let Collider::Part(p) = c { parts[p].meets_links } else { true };
    links::can_meet(a.body, b.body, closed) && meets(a.collider) && meets(b.collider)
}

/// Parts of the robot and the held object in the world.
fn place(parts: &[Part], world: &World, grip: Option<Grip>, motion: &Motion, closed: SocketSet, out: &mut Vec<Placed>) {
    out.clear();
    let there = |part: &Part| part.bared_by.is_none_or(|socket| !closed.contains(socket));
    out.extend(parts.iter().enumerate().filter(|(_, part)| there(part)).map(|(p, part)| {
        let at = Placement::from(&motion.bodies[part.body]).offset(&part.rotation, &part.position);
        Placed { collider: Collider::Part(p), body: part.body, at, bounds: part.hull.bounds(&at) }
    }));
    out.extend(grip.map(|g| {
        let at = g.placement(motion);
        let bounds = world.objects[g.object].hull.bounds(&at);
        Placed { collider: Collider::Held(g.object), body: END_EFFECTOR, at, bounds }
    }));
}

/// Loads of all contact points of a pair, each about the origin of its side.
struct Loads {
    normal: f64,
    depth: f64,
    on_first: Wrench,
    on_second: Wrench,
}

fn press(points: &[Point], surface: &Surface, a: &Placement, b: &Placement, belt: &Vector3<f64>) -> Loads {
    let none = (Vector3::zeros(), Vector3::zeros());
    let mut loads = Loads { normal: 0.0, depth: 0.0, on_first: none, on_second: none };
    let spin = a.angular_velocity - b.angular_velocity;
    for p in points {
        let surface_velocity = b.velocity_at(&p.position) + belt - p.normal * p.normal.dot(belt);
        let velocity = a.velocity_at(&p.position) - surface_velocity;
        let load = law::load(surface, p.weight, p.depth, &p.normal, &velocity, &spin);
        loads.normal += load.normal;
        loads.depth = loads.depth.max(p.depth);
        let (on_first, on_second) = (&mut loads.on_first, &mut loads.on_second);
        add(on_first, &(load.force, (p.position - a.position).cross(&load.force) + load.moment));
        add(on_second, &(-load.force, -(p.position - b.position).cross(&load.force) - load.moment));
    }
    loads
}

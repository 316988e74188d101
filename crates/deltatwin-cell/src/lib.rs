//! Contacts of the robot with its surroundings (table, conveyor, obstacles, products) and, once it has broken, with
//! itself.
//!
//! [`contacts`] creates the contact solver for a run of the twin. All objects and the robot's links are bodies of
//! Rapier, which moves the free objects, solves the contacts between them, and finds bodies near the robot: its links
//! are kinematic bodies that follow the twin. In Rapier a kinematic body acts like an infinite mass and has no
//! reaction. Contacts of the robot with objects or with itself are therefore described by the compliant [`law`], which
//! acts on both sides with opposite sign: momentum is conserved between twin and Rapier.
//!
//! Sources are cited by the keys of `docs/bibliography.md`.

mod contact;
mod hooks;
mod hull;
pub mod law;
mod links;
pub mod mesh;
mod neighbours;
mod placement;
mod robot;
#[cfg(test)]
mod tests;
mod world;

use deltatwin::cell::{CellError, Mobility, Object, Surface, check};
use deltatwin::kinematics::{Motion, SocketSet};
use deltatwin::machine::bodies::{END_EFFECTOR, PLATFORM, SLOTS, STRUT, body_name};
use deltatwin::machine::{Bodies, Geometry, Inertia};
use deltatwin::scenario::PayloadShape;
use deltatwin::twin::{ContactBody, ContactWork, Contacts, Held, Resistance, Surroundings, Touch, Twist};
use nalgebra::{Isometry3, Matrix3, Vector3};

use contact::{Wrench, about, add, press};
use hull::{Hull, Point};
use links::Part;
use neighbours::Neighbours;
use placement::Placement;
use robot::{Grip, Robot};
use world::{Collider, World};

const UNLOADED: [Wrench; SLOTS] = [(Vector3::new(0.0, 0.0, 0.0), Vector3::new(0.0, 0.0, 0.0)); SLOTS];

/// Upper bound of the relative acceleration assumed by `near`, m/s².
const ACCELERATION: f64 = 300.0;
/// Longest step, in units of √(m/k).
const STEP: f64 = 0.1;
/// Largest penetration at the start of a run, m.
const DEEPEST_START: f64 = 1e-3;
/// Effective mass at the end of a strut, kg: a quarter of 0.179 kg ([Gnad 2024], Table 3).
const STRUT_END_MASS: f64 = 0.045;
/// Effective mass at a corner of a free body, relative to its mass.
const CORNER: f64 = 0.25;

/// Contact solver of a robot with its surroundings and its own frame, for [`Options::contacts`].
///
/// # Errors
/// A [`CellError`] if an object is not valid, or if the robot penetrates one by more than 1 mm at the start.
///
/// [`Options::contacts`]: deltatwin::twin::Options::contacts
pub fn contacts(surroundings: &Surroundings<'_>) -> Result<Box<dyn Contacts>, CellError> {
    let Surroundings { objects, payload, geometry, gravity, bodies, start } = *surroundings;
    let mut cell = Cell::with_frame(objects, geometry, payload, gravity)?;
    cell.weigh(bodies);
    cell.check_start(start)?;
    Ok(Box::new(cell))
}

/// Contact solver: the robot's surroundings and the shapes of its links.
pub struct Cell {
    /// Number of objects given; the robot's frame follows.
    listed: usize,
    world: World,
    robot: Robot,
    neighbours: Neighbours,
    /// Effective masses of the robot's bodies at their surfaces, kg.
    masses: [f64; SLOTS],
    /// Least effective mass over stiffness of the pairs that were near at the last call of `near`, s²; of all pairs that
    /// there could be before.
    quickest: f64,
    /// Force (N) and moment about the origin (N·m) on each body of the robot, inertial axes.
    wrenches: [Wrench; SLOTS],
    /// Resistance of the contacts on each body, about the origin of the inertial frame until asked for.
    resistances: Box<[Resistance; SLOTS]>,
    /// Whether a free object was near at the last call of `near`.
    loose: bool,
    /// Loads on the objects, force and moment about the origin, at the last call of `wrenches`; those at the previous
    /// call follow.
    reactions: Vec<Wrench>,
    earlier: Vec<Wrench>,
    /// Whether `wrenches` was called since the last `advance`.
    fresh: bool,
    /// Pairs in contact at the last call of `wrenches`; the one with the largest penetration (m) follows.
    touches: Vec<Touch>,
    deepest: Option<(Touch, f64)>,
    points: Vec<Point>,
    /// Sockets that were closed at the last call of `near`.
    closed: Option<SocketSet>,
    /// Pairs that overlapped when a socket opened between them or bared one, with the depth from which their contact counts,
    /// m: ball and cup lie in each other, and the least depth since then has no force.
    bared: Vec<((Collider, Collider), f64)>,
    /// Pairs whose contact points were computed so far.
    queries: usize,
}

/// Distance between a link of the robot and an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clearance {
    /// Link.
    pub link: ContactBody,
    /// Object.
    pub other: ContactBody,
    /// Distance, m; negative: depth of the overlap.
    pub distance: f64,
}

impl Cell {
    /// Contact solver with `objects` around a robot.
    ///
    /// `payload` is a rigid shape on the flange with its centre in the end effector's frame (m); `gravity` is in m/s²,
    /// inertial frame.
    ///
    /// # Errors
    /// A [`CellError`] of the first object, or of the payload, that is not valid.
    pub fn new(
        objects: &[Object],
        geometry: &Geometry,
        payload: Option<&PayloadShape>,
        gravity: Vector3<f64>,
    ) -> Result<Self, CellError> {
        Self::around(objects, None, geometry, payload, gravity)
    }

    /// [`Self::new`] with the robot's own frame, with which loose parts can collide.
    ///
    /// # Errors
    /// As for [`Self::new`].
    pub fn with_frame(
        objects: &[Object],
        geometry: &Geometry,
        payload: Option<&PayloadShape>,
        gravity: Vector3<f64>,
    ) -> Result<Self, CellError> {
        Self::around(objects, links::frame(geometry), geometry, payload, gravity)
    }

    fn around(
        objects: &[Object],
        frame: Option<Object>,
        geometry: &Geometry,
        payload: Option<&PayloadShape>,
        gravity: Vector3<f64>,
    ) -> Result<Self, CellError> {
        check(objects, payload.map(|p| (&p.shape, &p.centre)))?;
        let all: Vec<Object> = objects.iter().cloned().chain(frame).collect();
        let mut parts = links::parts(geometry);
        if let Some(PayloadShape { shape, centre }) = payload {
            parts.push(Part {
                body: END_EFFECTOR,
                rotation: Matrix3::identity(),
                position: *centre,
                hull: Hull::solid(shape),
                meets_links: true,
                bared_by: None,
            });
        }
        Ok(Self {
            listed: objects.len(),
            world: World::new(&all, &parts, gravity),
            robot: Robot::new(parts, 2 * geometry.limbs.len()),
            neighbours: Neighbours::default(),
            masses: [STRUT_END_MASS; SLOTS],
            quickest: all.iter().map(quickness).fold(STRUT_END_MASS / Surface::default().stiffness, f64::min),
            wrenches: UNLOADED,
            resistances: Box::new([Resistance::NONE; SLOTS]),
            loose: true,
            reactions: vec![(Vector3::zeros(), Vector3::zeros()); all.len()],
            earlier: vec![(Vector3::zeros(), Vector3::zeros()); all.len()],
            fresh: false,
            touches: Vec::new(),
            deepest: None,
            points: Vec::new(),
            closed: None,
            bared: Vec::new(),
            queries: 0,
        })
    }

    /// Takes the masses of the robot's `bodies` for the length of its steps; without them all are struts. The end
    /// effector moves with the platform.
    fn weigh(&mut self, bodies: &Bodies) {
        // Some models do not state the masses of bodies that enter the dynamics by their moments alone.
        let least = match CORNER * bodies[STRUT].mass {
            strut if strut > 0.0 => strut,
            _ => STRUT_END_MASS,
        };
        for (body, mass) in self.masses.iter_mut().enumerate() {
            let own = match body {
                PLATFORM | END_EFFECTOR => bodies[PLATFORM].mass + bodies[END_EFFECTOR].mass,
                _ => bodies[body].mass,
            };
            *mass = (CORNER * own).max(least);
        }
    }

    /// Notes the pairs that overlap because a socket has opened since the last call, and how far those known have parted.
    fn bare(&mut self, motion: &Motion, closed: SocketSet) {
        let Self { world, robot, neighbours, points, bared, .. } = self;
        let before = self.closed.replace(closed).filter(|before| *before != closed);
        if before.is_none() && bared.is_empty() {
            return;
        }
        if let Some(before) = before {
            neighbours.look(world, robot, motion, before, 0.0);
            let known = neighbours.pairs.clone();
            neighbours.look(world, robot, motion, closed, 0.0);
            let new = neighbours.pairs.iter().filter(|pair| !known.contains(pair));
            bared.extend(new.map(|pair| (*pair, f64::INFINITY)));
        }
        bared.retain_mut(|((first, second), least)| {
            points.clear();
            if let (Some(a), Some(b)) = (robot.placed(world, *first, motion), robot.placed(world, *second, motion)) {
                a.hull.contacts(&a.at, b.hull, &b.at, points);
            }
            *least = points.iter().map(|p| p.depth).fold(0.0, f64::max).min(*least);
            *least > 0.0
        });
    }

    /// Checks that the robot penetrates no object by more than 1 mm at the start.
    fn check_start(&mut self, motion: &Motion) -> Result<(), CellError> {
        self.wrenches(motion, self.robot.sockets());
        self.fresh = false;
        match self.deepest {
            Some((touch, depth)) if depth > DEEPEST_START => {
                Err(CellError::Overlap { link: self.name(touch.link), other: self.name(touch.other), depth })
            }
            _ => Ok(()),
        }
    }

    /// Objects in the order given, with pose and twist at their origins; a held one moves with the end effector of
    /// `motion`.
    pub fn objects<'a>(&'a self, motion: &'a Motion) -> impl Iterator<Item = (&'a Object, Isometry3<f64>, Twist)> {
        self.world.objects[..self.listed].iter().enumerate().map(|(i, o)| {
            let at = self.robot.grip.filter(|g| g.object == i).map_or(o.at, |g| g.placement(motion));
            (&o.object, at.isometry(), (at.velocity, at.angular_velocity))
        })
    }

    /// Name of the object in the gripper.
    pub fn held(&self) -> Option<&str> {
        self.robot.grip.map(|g| self.world.objects[g.object].object.name.as_str())
    }

    /// Least distance between the robot and an object other than those in `without` (their indices), if any is closer
    /// than `reach` (m), with the sockets closed.
    pub fn clearance(&mut self, motion: &Motion, reach: f64, without: &[usize]) -> Option<Clearance> {
        let Self { world, robot, neighbours, listed, .. } = self;
        neighbours.look(world, robot, motion, robot.sockets(), reach);
        let mut least: Option<Clearance> = None;
        for &(first, second) in &neighbours.pairs {
            let Collider::Object(object) = second else { continue };
            if object >= *listed || without.contains(&object) || robot.owns(second) {
                continue;
            }
            let Some(link) = robot.placed(world, first, motion) else { continue };
            let other = &world.objects[object];
            let within = least.as_ref().map_or(reach, |l| l.distance);
            let Some(distance) = link.hull.gap(&link.at, &other.hull, &other.at, within) else { continue };
            if distance < within {
                least = Some(Clearance { link: robot.named(first), other: ContactBody::Object(object), distance });
            }
        }
        least
    }

    /// Momentum (N·s), and angular momentum about the origin of the inertial frame (N·m·s), of the free objects.
    pub fn momentum(&self) -> (Vector3<f64>, Vector3<f64>) {
        let mut sum = (Vector3::zeros(), Vector3::zeros());
        for o in self.world.free() {
            let p = o.at.velocity * o.inertia.mass;
            add(&mut sum, &(p, o.at.position.cross(&p) + o.angular_momentum()));
        }
        sum
    }
}

/// Effective mass over stiffness of an object, s²; infinite for one that does not move.
fn quickness(object: &Object) -> f64 {
    match &object.mobility {
        Mobility::Free { mass } => CORNER * mass / object.surface.stiffness,
        _ => f64::INFINITY,
    }
}

impl Contacts for Cell {
    fn near(&mut self, motion: &Motion, closed: SocketSet, horizon: f64) -> bool {
        self.bare(motion, closed);
        let Self { world, robot, neighbours, masses, quickest, loose, .. } = self;
        let travel = |speed: f64| speed * horizon + 0.5 * ACCELERATION * horizon * horizon;
        let extents = robot.extents();
        let speed_of = |body: usize| Placement::from(&motion.bodies[body]).speed(extents[body]);
        let links = (0..SLOTS).map(speed_of).fold(0.0, f64::max);
        let objects = world.present().map(|o| o.at.speed(o.extent)).fold(0.0, f64::max);
        neighbours.look(world, robot, motion, closed, travel(links + links.max(objects)));
        *loose = false;
        let near = |&(first, second): &(Collider, Collider)| {
            let link = robot.placed(world, first, motion)?;
            let within = |bounds: &placement::Bounds, hull: &Hull, at: &Placement, speed: f64| {
                let margin = travel(speed_of(link.body) + speed);
                link.bounds.overlap(bounds, margin) && link.hull.within(&link.at, hull, at, margin)
            };
            let own = masses[link.body];
            match (robot.placed(world, second, motion), second) {
                (Some(other), _) => within(&other.bounds, other.hull, &other.at, speed_of(other.body))
                    .then(|| own.min(masses[other.body]) / Surface::default().stiffness),
                (None, Collider::Object(o)) => {
                    let object = &world.objects[o];
                    let near = within(&object.bounds, &object.hull, &object.at, object.at.speed(object.extent));
                    *loose |= near && object.is_free();
                    near.then(|| (own / object.object.surface.stiffness).min(quickness(&object.object)))
                }
                (None, Collider::Part(_)) => None,
            }
        };
        let least = neighbours.pairs.iter().filter_map(near).reduce(f64::min);
        *quickest = least.unwrap_or(*quickest);
        least.is_some()
    }

    fn longest_step(&self) -> f64 {
        STEP * self.quickest.sqrt()
    }

    fn wrenches(&mut self, motion: &Motion, closed: SocketSet) -> &[Twist; SLOTS] {
        let Self { world, robot, neighbours, wrenches, reactions, fresh, touches, deepest, points, queries, .. } = self;
        *wrenches = UNLOADED;
        self.resistances.fill(Resistance::NONE);
        *fresh = true;
        reactions.fill((Vector3::zeros(), Vector3::zeros()));
        touches.clear();
        *deepest = None;
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
            *queries += 1;
            points.clear();
            link.hull.contacts(&link.at, hull, &at, points);
            if let Some((_, least)) = self.bared.iter().find(|(pair, _)| *pair == (first, second)) {
                points.iter_mut().for_each(|p| p.depth -= least);
                points.retain(|p| p.depth > 0.0);
            }
            let loads = press(points, &surface, &link.at, &at, &belt);
            if loads.normal <= 0.0 {
                continue;
            }
            let origin = |body: usize| motion.bodies[body].position;
            add(&mut wrenches[link.body], &about(&loads.on_first, &link.at, &origin(link.body)));
            self.resistances[link.body].add(&loads.resistance);
            match (&other, second) {
                (Some(o), _) => {
                    add(&mut wrenches[o.body], &about(&loads.on_second, &o.at, &origin(o.body)));
                    self.resistances[o.body].add(&loads.resistance);
                }
                (None, Collider::Object(o)) => add(&mut reactions[o], &loads.on_second),
                (None, Collider::Part(_)) => {}
            }
            let touch = Touch {
                link: robot.named(first),
                other: robot.named(second),
                force: loads.normal,
                at: loads.centre,
                normal: loads.pressure,
                push: loads.on_first.0,
            };
            match touches.iter_mut().find(|t| (t.link, t.other) == (touch.link, touch.other)) {
                Some(known) => known.add(&touch),
                None => touches.push(touch),
            }
            if deepest.is_none_or(|(_, depth)| loads.depth >= depth) {
                *deepest = Some((touch, loads.depth));
            }
        }
        wrenches
    }

    fn resistances(&mut self, motion: &Motion) -> Option<&[Resistance; SLOTS]> {
        if self.loose {
            return None;
        }
        for (resistance, body) in self.resistances.iter_mut().zip(&motion.bodies) {
            if *resistance != Resistance::NONE {
                *resistance = resistance.seen_from(&-body.position);
            }
        }
        Some(&self.resistances)
    }

    fn touches(&self) -> &[Touch] {
        &self.touches
    }

    fn name(&self, body: ContactBody) -> String {
        match body {
            ContactBody::Link(link) => body_name(link),
            ContactBody::Object(o) => self.world.objects[o].object.name.clone(),
        }
    }

    fn advance(&mut self, h: f64, share: f64) {
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

    fn pick(&mut self, name: &str, motion: &Motion) -> Result<Held, CellError> {
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
        Ok(Held { inertia, position: at.position, twist: (at.velocity, at.angular_velocity) })
    }

    fn release(&mut self, motion: &Motion) -> Result<String, CellError> {
        let grip = self.robot.release().ok_or(CellError::Empty)?;
        self.world.put(grip.object, grip.placement(motion));
        Ok(self.world.objects[grip.object].object.name.clone())
    }

    fn poses(&self, motion: &Motion) -> Vec<Isometry3<f64>> {
        self.objects(motion).map(|(_, pose, _)| pose).collect()
    }

    fn kinetic_energy(&self) -> f64 {
        let energy = |o: &world::Body| {
            o.inertia.mass * o.at.velocity.norm_squared() + o.at.angular_velocity.dot(&o.angular_momentum())
        };
        0.5 * self.world.free().map(energy).sum::<f64>()
    }

    fn work(&self) -> ContactWork {
        ContactWork { searches: self.neighbours.searches, queries: self.queries, steps: self.world.steps }
    }
}

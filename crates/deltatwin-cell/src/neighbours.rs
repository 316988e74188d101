//! Pairs of colliders that are near each other, updated only after sufficient motion.

use deltatwin::kinematics::{Motion, SocketSet};
use deltatwin::machine::bodies::{END_EFFECTOR, SLOTS};

use super::links::can_meet;
use super::placement::Placement;
use super::robot::Robot;
use super::world::{Collider, World};

/// Addition to the search distance, m: motion for which the result remains valid.
const SKIN: f64 = 0.03;
/// Largest search distance, m.
const MAX_DISTANCE: f64 = 20.0;

/// Pairs found by the last search, and the poses at that time.
#[derive(Default)]
pub struct Neighbours {
    /// Collider of the robot, or of what it holds, and the collider it may touch; in order.
    pub pairs: Vec<(Collider, Collider)>,
    /// Number of searches so far.
    pub searches: usize,
    /// Distance up to which all pairs were found, m.
    reach: f64,
    then: Option<Then>,
}

/// State on which the pairs depend.
struct Then {
    closed: SocketSet,
    held: Option<usize>,
    bodies: [Placement; SLOTS],
    objects: Vec<Placement>,
}

impl Neighbours {
    /// Updates the pairs, such that every pair closer than `margin` (m) is among them.
    pub fn look(&mut self, world: &mut World, robot: &Robot, motion: &Motion, closed: SocketSet, margin: f64) {
        let margin = margin.clamp(0.0, MAX_DISTANCE - SKIN).min(MAX_DISTANCE - SKIN);
        let bodies = motion.bodies.each_ref().map(Placement::from);
        let held = robot.grip.map(|g| g.object);
        if let Some(then) = &self.then
            && (then.closed, then.held) == (closed, held)
        {
            let links = bodies.iter().zip(&then.bodies).zip(robot.extents());
            let links = links.map(|((now, then), extent)| now.moved(then, extent)).fold(0.0, most);
            let objects = world.objects.iter().zip(&then.objects).filter(|(o, _)| o.present);
            let objects = objects.map(|(o, then)| o.at.moved(then, o.extent)).fold(0.0, most);
            // Two links can approach each other by twice the motion of one.
            if links + most(links, objects) + margin <= self.reach {
                return;
            }
        }
        let grip = robot.grip.map(|g| (g.object, g.placement(motion)));
        world.mirror(robot, &bodies, grip, closed);
        self.searches += 1;
        self.reach = margin + SKIN;
        self.pairs.clear();
        let own = |c: &Collider| robot.owns(*c);
        let pairs = world.pairs(self.reach).filter(|(a, b)| own(a) || own(b));
        self.pairs
            .extend(pairs.map(|(a, b)| if !own(&a) || (own(&b) && b.follows(a, held)) { (b, a) } else { (a, b) }));
        self.pairs.retain(|(a, b)| !own(b) || meet(robot, *a, *b, closed));
        self.pairs.sort_unstable_by_key(|(a, b)| (a.order(held), own(b), b.order(held)));
        let objects = world.objects.iter().map(|o| o.at).collect();
        self.then = Some(Then { closed, held, bodies, objects });
    }
}

/// The larger of two numbers; NaN if one is NaN.
fn most(a: f64, b: f64) -> f64 {
    if a.is_nan() || a > b { a } else { b }
}

/// Whether two parts of the robot can collide.
fn meet(robot: &Robot, a: Collider, b: Collider, closed: SocketSet) -> bool {
    let body = |c| if let Collider::Part(p) = c { robot.parts[p].body } else { END_EFFECTOR };
    can_meet(body(a), body(b), robot.struts, closed)
}

impl Collider {
    /// Sort key among the robot's colliders: a held object comes after the parts.
    fn order(self, held: Option<usize>) -> (bool, usize) {
        match self {
            Self::Part(p) => (false, p),
            Self::Object(o) => (held == Some(o), o),
        }
    }

    fn follows(self, other: Self, held: Option<usize>) -> bool {
        self.order(held) > other.order(held)
    }
}

use std::sync::Arc;

use approx::assert_relative_eq;
use nalgebra::{Matrix3, Rotation3, Vector3};

use deltatwin::cell::{CellError, Mobility, Object, Shape, Surface};
use deltatwin::kinematics::{BodyMotion, JointState, Motion, SocketSet};
use deltatwin::machine::Geometry;
use deltatwin::machine::bodies::{self, END_EFFECTOR, STRUT};
use deltatwin::scenario::PayloadShape;
use deltatwin::twin::{ContactBody, Contacts};

use super::Cell;
use super::mesh::closed;
use super::mesh::tests::block;

/// The shipped robot's geometry.
pub fn geometry() -> Geometry {
    deltatwin_io::model::read(std::path::Path::new("../../models/irb360-6-1600.toml")).unwrap().geometry
}

const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);
const TABLE_TOP: f64 = -1.2;

fn object(name: &str, shape: Shape, mobility: Mobility, position: [f64; 3]) -> Object {
    Object { name: name.into(), shape, mobility, position: position.into(), yaw: 0.0, surface: Surface::default() }
}

fn cuboid(x: f64, y: f64, z: f64) -> Shape {
    Shape::Box { size: Vector3::new(x, y, z) }
}

/// A box made of triangles.
fn triangles(x: f64, y: f64, z: f64, convex: bool) -> Shape {
    let (corners, triangles) = block(x, y, z);
    Shape::Mesh(Arc::new(closed(corners, triangles, convex).unwrap().0))
}

fn table() -> Object {
    object("table", cuboid(2.0, 2.0, 0.1), Mobility::Fixed, [0.0, 0.0, TABLE_TOP - 0.05])
}

fn cell(objects: &[Object]) -> Cell {
    Cell::new(objects, &geometry(), None, GRAVITY).unwrap()
}

/// All links at rest, far apart from each other and from everything else.
pub fn scattered() -> Motion {
    let mut motion = Motion::disassembled(&geometry(), &JointState::default());
    for (b, body) in motion.bodies.iter_mut().enumerate() {
        *body = BodyMotion { position: Vector3::new(0.0, 100.0 + 10.0 * b as f64, 0.0), ..BodyMotion::REST };
    }
    motion
}

fn assembled(position: [f64; 3]) -> Motion {
    let q = geometry().inverse(&position.into(), 0.0).unwrap();
    let joints = JointState { q: [q[0], q[1], q[2], 0.3], ..JointState::default() };
    Motion::assembled(&geometry(), &joints).unwrap()
}

fn open(sockets: impl IntoIterator<Item = usize>) -> SocketSet {
    sockets.into_iter().fold(SocketSet::ALL, SocketSet::without)
}

/// A link moving as a free rigid body: symplectic Euler integration of momentum and angular momentum.
#[derive(Clone)]
struct FreeLink {
    body: usize,
    mass: f64,
    /// Centre of mass in the body frame, m.
    centre: Vector3<f64>,
    /// Principal moments about the centre of mass, along the axes of the body frame, kg·m².
    moments: Vector3<f64>,
    gravity: Vector3<f64>,
    rotation: Matrix3<f64>,
    position: Vector3<f64>,
    momentum: Vector3<f64>,
    angular_momentum: Vector3<f64>,
    /// Contact wrench at the end of the last step.
    last: (Vector3<f64>, Vector3<f64>),
}

impl FreeLink {
    /// A strut as a uniform rod, lying along x at `position` of its upper ball.
    fn strut(position: Vector3<f64>) -> Self {
        Self {
            body: STRUT,
            mass: 0.179,
            centre: Vector3::x() * 0.553,
            moments: Vector3::new(1.5e-5, 0.0182, 0.0182),
            gravity: GRAVITY,
            rotation: Matrix3::identity(),
            position: position + Vector3::x() * 0.553,
            momentum: Vector3::zeros(),
            angular_momentum: Vector3::zeros(),
            last: (Vector3::zeros(), Vector3::zeros()),
        }
    }

    fn spin(&self) -> Vector3<f64> {
        self.rotation * self.rotation.tr_mul(&self.angular_momentum).component_div(&self.moments)
    }

    fn energy(&self) -> f64 {
        0.5 * (self.momentum.norm_squared() / self.mass + self.angular_momentum.dot(&self.spin()))
    }

    fn show(&self, motion: &mut Motion) {
        let lever = -self.rotation * self.centre;
        let (spin, body) = (self.spin(), &mut motion.bodies[self.body]);
        body.rotation = self.rotation;
        body.position = self.position + lever;
        body.velocity = self.momentum / self.mass + spin.cross(&lever);
        body.angular_velocity = spin;
    }

    fn step(&mut self, h: f64, cell: &mut Cell, motion: &mut Motion, closed: SocketSet) {
        // As in the twin: wrenches are linear up to their values at the end of the step.
        let mut ahead = self.clone();
        ahead.position += self.momentum / self.mass * h;
        ahead.rotation = *(Rotation3::new(self.spin() * h) * Rotation3::from_matrix_unchecked(self.rotation)).matrix();
        ahead.show(motion);
        let next = cell.wrenches(motion, closed)[self.body];
        let (force, moment) = (0.5 * (self.last.0 + next.0), 0.5 * (self.last.1 + next.1));
        self.last = next;
        let lever = self.rotation * self.centre;
        self.momentum += (force + self.gravity * self.mass) * h;
        self.angular_momentum += (moment - lever.cross(&force)) * h;
        self.position += self.momentum / self.mass * h;
        self.rotation = *(Rotation3::new(self.spin() * h) * Rotation3::from_matrix_unchecked(self.rotation)).matrix();
        cell.advance(h, 1.0);
        self.show(motion);
    }
}

#[test]
fn a_product_rides_at_belt_speed() {
    let belt = Mobility::Conveyor { velocity: Vector3::new(0.3, 0.0, 0.0) };
    let mut cell = cell(&[
        object("belt", cuboid(4.0, 0.4, 0.1), belt, [0.0, 0.0, -0.05]),
        object("bar", cuboid(0.08, 0.04, 0.02), Mobility::Free { mass: 0.1 }, [0.0, 0.0, 0.01]),
    ]);
    // Friction 0.3 accelerates it to 0.3 m/s in 0.3/(0.3·9.81) = 0.102 s, after 15.3 mm; until 1 s it moves 0.285 m.
    for _ in 0..2000 {
        cell.advance(5e-4, 1.0);
    }
    let motion = scattered();
    let (_, pose, twist) = cell.objects(&motion).nth(1).unwrap();
    assert_relative_eq!(twist.0, Vector3::new(0.3, 0.0, 0.0), epsilon = 1e-4);
    assert_relative_eq!(pose.translation.x, 0.2847, epsilon = 2e-3);
}

#[test]
fn a_link_hitting_a_free_box_conserves_momentum_and_creates_no_energy() {
    let free = Mobility::Free { mass: 0.2 };
    let mut cell =
        Cell::new(&[object("box", cuboid(0.1, 0.08, 0.06), free, [0.0; 3])], &geometry(), None, Vector3::zeros())
            .unwrap();
    // The middle of the strut crosses the box's upper edge along y off its centre: all angular momenta change.
    let mut link = FreeLink::strut(Vector3::new(-0.5, 0.02, 0.041));
    link.rotation = *Rotation3::from_axis_angle(&Vector3::y_axis(), 0.3).matrix();
    link.position = Vector3::new(0.06, 0.02, 0.045);
    link.gravity = Vector3::zeros();
    link.momentum = Vector3::new(-0.3, 0.1, -1.0) * link.mass;
    let mut motion = scattered();
    let total = |link: &FreeLink, cell: &Cell| {
        let (p, l) = cell.momentum();
        (p + link.momentum, l + link.position.cross(&link.momentum) + link.angular_momentum)
    };
    let (p0, l0) = total(&link, &cell);
    let (e0, mut hits) = (link.energy(), 0);
    for _ in 0..20_000 {
        link.step(1e-5, &mut cell, &mut motion, SocketSet::ALL);
        hits += cell.touches().len();
        assert!(link.energy() + cell.kinetic_energy() < e0 * (1.0 + 1e-6));
    }
    let (p1, l1) = total(&link, &cell);
    assert!(hits > 50 && cell.kinetic_energy() > 0.01 * e0, "{hits} {} of {e0}", cell.kinetic_energy());
    assert!((p1 - p0).norm() < 1e-9 * p0.norm());
    assert!((l1 - l0).norm() < 1e-3 * l0.norm());
}

#[test]
fn a_reaction_acts_for_one_step() {
    let shape = Shape::Sphere { radius: 0.05 };
    let objects = [object("ball", shape, Mobility::Free { mass: 0.2 }, [0.0; 3])];
    let mut cell = Cell::new(&objects, &geometry(), None, Vector3::zeros()).unwrap();
    let mut motion = scattered();
    // The strut's middle is 0.1 mm deep: from zero to 20 N within 1 ms.
    motion.bodies[STRUT].position = Vector3::new(-0.5, 0.0, 0.058 - 1e-4);
    cell.wrenches(&motion, SocketSet::ALL);
    for _ in 0..3 {
        cell.advance(1e-3, 1.0);
        assert_relative_eq!(cell.momentum().0, Vector3::z() * -0.01, epsilon = 1e-12);
    }
}

/// Strut with its rounded ends `height` above the table.
fn dropped(height: f64) -> FreeLink {
    FreeLink::strut(Vector3::new(-0.5, 0.0, TABLE_TOP + 0.008 + height))
}

#[test]
fn a_dropped_strut_comes_to_rest() {
    let mut cell = cell(&[table()]);
    let (mut link, mut motion) = (dropped(0.02), scattered());
    link.rotation = *Rotation3::from_axis_angle(&Vector3::y_axis(), 0.01).matrix();
    link.angular_momentum.x = 1.5e-5 * 20.0;
    let h = cell.longest_step();
    let steps = (2.0 / h) as usize;
    for _ in 0..steps {
        link.step(h, &mut cell, &mut motion, open([0, 6]));
    }
    assert!(link.energy() < 1e-6);
}

#[test]
fn tumbling_over_edges_and_corners_creates_no_energy() {
    let surface = Surface { dissipation: 0.3, ..Surface::default() };
    let block = Object { surface, ..object("block", cuboid(0.2, 0.2, 0.1), Mobility::Fixed, [0.0; 3]) };
    for i in 0..24 {
        let turn = 0.261 * f64::from(i);
        let mut cell = cell(&[block.clone(), table()]);
        let (mut link, mut motion) = (dropped(0.0), scattered());
        link.position = Vector3::new(0.08 * turn.cos(), 0.08 * turn.sin(), 0.22 + 0.01 * f64::from(i % 5));
        let tilt = Rotation3::from_euler_angles(0.0, 0.15 * f64::from(i % 4), turn * 2.3);
        link.rotation = *tilt.matrix();
        let total = |link: &FreeLink| link.energy() + 9.81 * link.mass * (link.position.z - TABLE_TOP);
        let start = total(&link);
        let h = cell.longest_step();
        let (mut hits, mut lowest, mut gain) = (0, start, 0.0_f64);
        for _ in 0..(1.5 / h) as usize {
            link.step(h, &mut cell, &mut motion, SocketSet::ALL);
            hits += cell.touches().len();
            // Between contacts no energy is stored in them.
            if cell.touches().is_empty() {
                gain = gain.max(total(&link) - lowest);
                lowest = lowest.min(total(&link));
            }
        }
        // The integration error, up to 3 mJ; proportional to the step.
        assert!(hits > 0 && gain < 5e-3, "{i}: {hits} hits, {gain} J gained");
    }
}

#[test]
fn at_rest_the_table_carries_the_weight_at_the_penetration_of_the_law() {
    let mut cell = cell(&[table()]);
    // 0.179 kg on two ends of 2e5 N/m: 0.179·9.81/4e5 = 4.389975 µm
    let mut link = dropped(-4.389_975e-6);
    let mut motion = scattered();
    link.show(&mut motion);
    let (force, moment) = cell.wrenches(&motion, SocketSet::ALL)[STRUT];
    assert_relative_eq!(force, Vector3::z() * 1.755_99, epsilon = 1e-9);
    // about the upper ball: 1.75599 N at 0.553 m
    assert_relative_eq!(moment, Vector3::y() * -0.971_062_47, epsilon = 1e-9);
    let [touch] = *cell.touches() else { panic!("{:?}", cell.touches()) };
    assert_eq!((cell.name(touch.link).as_str(), cell.name(touch.other).as_str()), ("strut1", "table"));
    assert_relative_eq!(touch.force, 1.755_99, epsilon = 1e-9);
    link.last = (force, moment);
    for _ in 0..2000 {
        link.step(1e-5, &mut cell, &mut motion, SocketSet::ALL);
    }
    // With open sockets the strut also has its tips: four points at the same depth.
    let two = cell.wrenches(&motion, SocketSet::ALL)[STRUT].0.z;
    let four = cell.wrenches(&motion, open([0, 6]))[STRUT].0.z;
    assert_relative_eq!(four, 2.0 * two, max_relative = 1e-9);
    assert!(link.energy() < 1e-15, "{:e}", link.energy());
}

#[test]
fn resistances_are_the_differences_of_the_wrenches() {
    // A strut on the table, 0.1 mm deep at both ends, rolled about its axis; 20 N at each.
    let mut cell = cell(&[table()]);
    let mut motion = scattered();
    dropped(-1e-4).show(&mut motion);
    motion.bodies[STRUT].rotation = *Rotation3::from_axis_angle(&Vector3::x_axis(), 0.4).matrix();
    assert!(cell.resistances(&motion).is_none(), "not asked yet what is near");
    assert!(cell.near(&motion, SocketSet::ALL, 1e-3));
    let mut wrench = |change: &dyn Fn(&mut BodyMotion)| {
        let mut moved = motion;
        change(&mut moved.bodies[STRUT]);
        let (force, moment) = cell.wrenches(&moved, SocketSet::ALL)[STRUT];
        [force, moment]
    };
    let (small, unit) = (1e-8, |k: usize| Vector3::ith(k % 3, 1.0));
    let [mut stiffness, mut damping] = [[[0.0; 6]; 6]; 2];
    for k in 0..6 {
        let shifted = |sign: f64| {
            move |b: &mut BodyMotion| match k {
                0..3 => b.position += unit(k) * (sign * small),
                _ => b.rotation = Rotation3::from_scaled_axis(unit(k) * (sign * small)).into_inner() * b.rotation,
            }
        };
        let quickened = |sign: f64| {
            move |b: &mut BodyMotion| match k {
                0..3 => b.velocity += unit(k) * (sign * small),
                _ => b.angular_velocity += unit(k) * (sign * small),
            }
        };
        let [up, down, faster, slower] =
            [wrench(&shifted(1.0)), wrench(&shifted(-1.0)), wrench(&quickened(1.0)), wrench(&quickened(-1.0))];
        for i in 0..6 {
            stiffness[i][k] = (down[i / 3][i % 3] - up[i / 3][i % 3]) / (2.0 * small);
            damping[i][k] = (slower[i / 3][i % 3] - faster[i / 3][i % 3]) / (2.0 * small);
        }
    }
    wrench(&|_| ());
    let known = cell.resistances(&motion).expect("nothing near moves")[STRUT];
    // Displacements also turn the lever arms and slide the points of contact along the strut: 20 N per metre or radian,
    // beside 4e5 N/m.
    for (got, want, size) in [(known.stiffness, stiffness, 4e5), (known.damping, damping, 1.2e3)] {
        for (i, k) in (0..6).flat_map(|i| (0..6).map(move |k| (i, k))) {
            let gap = (got[i][k] - want[i][k]).abs();
            assert!(gap < 1e-3 * size, "row {i}, column {k}: {} instead of {}", got[i][k], want[i][k]);
        }
    }
    assert!(stiffness[2][2] > 3.9e5 && damping[0][0] > 1.1e3, "{stiffness:?} {damping:?}");
    // Beside a product, which moves, nothing is taken implicitly.
    let parcel = object("parcel", cuboid(0.1, 0.1, 0.1), Mobility::Free { mass: 0.2 }, [-0.2, 0.0, TABLE_TOP + 0.07]);
    let mut cell = self::cell(&[table(), parcel]);
    assert!(cell.near(&motion, SocketSet::ALL, 1e-2));
    cell.wrenches(&motion, SocketSet::ALL);
    assert!(cell.resistances(&motion).is_none());
}

#[test]
fn work_around_a_closed_path_in_contact_is_zero() {
    // Without dissipation and friction the law is elastic; the path moves the strut's end over edge and corner, 0.1 mm
    // deep. The work of the fading at edges must be less than that of friction with a coefficient of 0.01.
    let surface = Surface { stiffness: 1e5, dissipation: 0.0, friction: 0.0, rolling: 0.0 };
    let cylinder = Shape::Cylinder { radius: 0.05, height: 0.1 };
    for (shape, x) in [
        (cuboid(0.1, 0.1, 0.1), 0.02),
        (cylinder, 0.02),
        (Shape::Sphere { radius: 0.05 }, -0.02),
        (triangles(0.1, 0.1, 0.1, true), 0.02),
        (triangles(0.1, 0.1, 0.1, false), 0.02),
    ] {
        let mut cell = cell(&[Object { surface, ..object("thing", shape.clone(), Mobility::Fixed, [0.0; 3]) }]);
        let mut motion = scattered();
        let (mut work, mut size, mut last, mut jump, mut peak) = (0.0, 0.0, Vector3::zeros(), 0.0_f64, 0.0_f64);
        let n = 200_000;
        let at = |i: usize| {
            let a = i as f64 * std::f64::consts::TAU / n as f64;
            Vector3::new(x + 0.03 * a.cos(), 0.02 * (2.0 * a).sin(), 0.058 - 1e-4 * a.sin())
        };
        for i in 0..n {
            let (from, to) = (at(i), at(i + 1));
            motion.bodies[STRUT].rotation = *Rotation3::from_axis_angle(&Vector3::y_axis(), -0.002).matrix();
            motion.bodies[STRUT].position = 0.5 * (from + to);
            let (force, _) = cell.wrenches(&motion, SocketSet::ALL)[STRUT];
            work += force.dot(&(to - from));
            size += force.norm() * (to - from).norm();
            peak = peak.max(force.norm());
            if i > 0 {
                jump = jump.max((force - last).norm());
            }
            last = force;
        }
        assert!(peak > 5.0 && work.abs() < 0.01 * size, "{shape:?}: {work} of {size}, peak {peak}");
        assert!(jump < 0.01 * peak, "{shape:?}: {jump}");
    }
}

#[test]
fn every_face_carries_what_the_law_says() {
    // A payload pressed 10 µm into a table at 2e5 N/m: four corners of a box, one sphere, twelve points of a rim.
    for (shape, half, points) in [
        (cuboid(0.1, 0.1, 0.06), 0.03, 4.0),
        (Shape::Sphere { radius: 0.03 }, 0.03, 1.0),
        (Shape::Cylinder { radius: 0.04, height: 0.06 }, 0.03, 12.0),
        (triangles(0.1, 0.1, 0.06, true), 0.03, 4.0),
    ] {
        let hang = Vector3::new(0.01, 0.0, -half);
        let mut cell =
            Cell::new(&[table()], &geometry(), Some(&PayloadShape { shape, centre: hang }), GRAVITY).unwrap();
        let mut motion = scattered();
        motion.bodies[END_EFFECTOR].position = Vector3::new(0.0, 0.0, TABLE_TOP + 2.0 * half - 1e-5);
        let (force, moment) = cell.wrenches(&motion, SocketSet::ALL)[END_EFFECTOR];
        assert_relative_eq!(force, Vector3::z() * (2.0 * points), epsilon = 1e-9);
        assert_relative_eq!(moment, Vector3::y() * (-0.02 * points), epsilon = 1e-9);
    }
}

#[test]
fn upright_cans_meet_side_to_side() {
    let can = Shape::Cylinder { radius: 0.04, height: 0.12 };
    let objects = [object("can", can.clone(), Mobility::Fixed, [0.08 - 1e-5, 0.0, 0.03])];
    let mut cell =
        Cell::new(&objects, &geometry(), Some(&PayloadShape { shape: can, centre: Vector3::zeros() }), GRAVITY)
            .unwrap();
    let mut motion = scattered();
    motion.bodies[END_EFFECTOR].position = Vector3::zeros();
    // Half way between the spheres of the rims.
    motion.bodies[END_EFFECTOR].rotation = *Rotation3::from_axis_angle(&Vector3::z_axis(), 0.2618).matrix();
    let (force, moment) = cell.wrenches(&motion, SocketSet::ALL)[END_EFFECTOR];
    // 2e5·1e-5 = 2 N at each end of the overlap, z = −0.03 and 0.06; one sphere of the other's rim is opposite at
    // −0.029.
    let ball = force.x + 4.0;
    assert_relative_eq!(force, Vector3::x() * (-4.0 + ball), epsilon = 1e-9);
    assert_relative_eq!(moment, Vector3::y() * (-0.06 - 0.029 * ball), epsilon = 1e-9);
    assert_relative_eq!(ball, -2.0, epsilon = 1e-9);
}

#[test]
fn links_of_an_assembled_robot_do_not_touch() {
    let mut cell = cell(&[]);
    let mut sets: Vec<SocketSet> = (0..12).map(|s| open([s])).collect();
    sets.extend([SocketSet::ALL, open(0..12)]);
    for x in [-0.55, 0.0, 0.4, 0.75] {
        for y in [-0.5, 0.0, 0.55] {
            for z in [-0.8, -0.95, -1.08] {
                if Vector3::new(x, y, 0.0).norm() > 0.78 {
                    continue;
                }
                let motion = assembled([x, y, z]);
                for &closed in &sets {
                    let wrenches = *cell.wrenches(&motion, closed);
                    let touches = cell.touches();
                    assert!(wrenches.iter().all(|w| w.0 == Vector3::zeros()), "{x} {y} {z}: {touches:?}");
                }
                assert!(!cell.near(&motion, SocketSet::ALL, 1e-3));
            }
        }
    }
}

#[test]
fn links_that_came_off_meet_with_opposite_forces() {
    // Struts 1 and 3 of different limbs cross at right angles, 15.9 mm apart: 0.1 mm of 16 mm at 2e5 N/m is 20 N.
    let mut cell = cell(&[]);
    let mut motion = scattered();
    motion.bodies[STRUT].position = Vector3::new(-0.5, 0.0, 0.0161);
    motion.bodies[bodies::strut(2)].position = Vector3::new(0.0, -0.3, 0.0);
    motion.bodies[bodies::strut(2)].rotation =
        *Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2).matrix();
    assert!(!cell.near(&motion, SocketSet::ALL, 1e-3) && cell.near(&motion, open([0]), 1e-3));
    motion.bodies[STRUT].position.z = 0.0159;
    let wrenches = cell.wrenches(&motion, open([0]));
    assert_relative_eq!(wrenches[STRUT].0, Vector3::z() * 20.0, epsilon = 1e-8);
    assert_relative_eq!(wrenches[STRUT].1, Vector3::y() * -10.0, epsilon = 1e-8);
    assert_relative_eq!(wrenches[bodies::strut(2)].0, Vector3::z() * -20.0, epsilon = 1e-8);
    let force: Vector3<f64> = wrenches.iter().map(|w| w.0).sum();
    assert!(force.norm() < 1e-12);
}

#[test]
fn pick_and_release_keep_pose_and_momentum() {
    let free = Mobility::Free { mass: 0.5 };
    let mut cell = cell(&[
        table(),
        Object { yaw: 0.4, ..object("box", cuboid(0.06, 0.04, 0.02), free, [0.1, 0.0, TABLE_TOP + 0.5]) },
        object("other", cuboid(0.05, 0.05, 0.05), free, [0.5, 0.0, TABLE_TOP + 0.025]),
    ]);
    let mut motion = assembled([0.05, 0.02, -0.9]);
    (0..100).for_each(|_| cell.advance(1e-4, 1.0));
    let before = cell.objects(&motion).nth(1).unwrap();
    let (pose, twist) = (before.1, before.2);
    let momentum = cell.momentum().0;
    let held = cell.pick("box", &motion).unwrap();
    assert_eq!(held.position, pose.translation.vector);
    assert_eq!(held.twist, twist);
    assert_eq!(held.inertia.mass, 0.5);
    assert_relative_eq!(momentum - cell.momentum().0, held.twist.0 * 0.5, epsilon = 1e-12);
    // The held centre of mass must be that of the box; the tensor about it is the box's: m(x² + y²)/12 about z.
    let centre = held.inertia.first_moment / 0.5;
    let hand = motion.bodies[END_EFFECTOR];
    assert_relative_eq!(hand.position + hand.rotation * centre, pose.translation.vector, epsilon = 1e-12);
    let about_centre = held.inertia.tensor[(2, 2)] - 0.5 * (centre.x * centre.x + centre.y * centre.y);
    assert_relative_eq!(about_centre, 0.5 * (0.06 * 0.06 + 0.04 * 0.04) / 12.0, epsilon = 1e-12);
    assert_eq!(cell.held(), Some("box"));

    assert_eq!(cell.pick("other", &motion), Err(CellError::Occupied { wanted: "other".into(), held: "box".into() }));
    // While held it keeps its pose relative to the end effector.
    cell.advance(1e-3, 1.0);
    assert_relative_eq!(cell.objects(&motion).nth(1).unwrap().1, pose, epsilon = 1e-12);
    let hand = &mut motion.bodies[END_EFFECTOR];
    hand.velocity = Vector3::new(0.5, 0.0, 0.1);
    hand.angular_velocity = Vector3::z() * 2.0;
    let expected = hand.velocity + hand.angular_velocity.cross(&(pose.translation.vector - hand.position));
    assert_eq!(cell.release(&motion), Ok("box".into()));
    let (_, after, twist) = cell.objects(&motion).nth(1).unwrap();
    assert_relative_eq!(after, pose, epsilon = 1e-12);
    assert_relative_eq!(twist.0, expected, epsilon = 1e-12);
    assert_eq!(twist.1, Vector3::z() * 2.0);
    assert_eq!(cell.release(&motion), Err(CellError::Empty));
    cell.advance(1e-3, 1.0);
    let (_, later, _) = cell.objects(&motion).nth(1).unwrap();
    assert_relative_eq!((later.translation.vector - after.translation.vector).x, expected.x * 1e-3, epsilon = 1e-9);
}

#[test]
fn picking_from_a_table_starts_without_a_blow() {
    let free = Mobility::Free { mass: 0.5 };
    let mut cell = cell(&[table(), object("box", cuboid(0.06, 0.04, 0.02), free, [0.0, 0.0, TABLE_TOP + 0.01])]);
    let mut motion = scattered();
    motion.bodies[END_EFFECTOR].position = Vector3::new(0.0, 0.0, TABLE_TOP + 0.02);
    (0..2000).for_each(|_| cell.advance(5e-4, 1.0));
    cell.pick("box", &motion).unwrap();
    let force = cell.wrenches(&motion, SocketSet::ALL)[END_EFFECTOR].0.z;
    assert!(force < 2.0 * 0.5 * 9.81, "{force}");
}

#[test]
fn near_sees_what_comes() {
    let mut cell = cell(&[table()]);
    let mut motion = assembled([0.0, 0.0, -0.9]);
    // Flange 237.5 mm above the table.
    assert!(!cell.near(&motion, SocketSet::ALL, 1e-3));
    motion.bodies[END_EFFECTOR].velocity = Vector3::z() * -5.0;
    assert!(!cell.near(&motion, SocketSet::ALL, 0.01));
    assert!(cell.near(&motion, SocketSet::ALL, 0.04));
}

#[test]
fn two_runs_give_identical_bits() {
    let run = || {
        let free = Mobility::Free { mass: 0.1 };
        let belt = Mobility::Conveyor { velocity: Vector3::y() * 0.2 };
        let mut cell = cell(&[
            table(),
            object("belt", cuboid(0.5, 0.5, 0.1), belt, [0.3, 0.0, TABLE_TOP + 0.05]),
            object("can", Shape::Cylinder { radius: 0.03, height: 0.1 }, free, [0.2, 0.0, TABLE_TOP + 0.16]),
            object("box", cuboid(0.05, 0.05, 0.05), free, [-0.2, 0.01, TABLE_TOP + 0.03]),
            object("ball", Shape::Sphere { radius: 0.03 }, free, [-0.25, 0.0, TABLE_TOP + 0.1]),
        ]);
        let (mut link, mut motion) = (dropped(0.12), scattered());
        for _ in 0..3000 {
            link.step(1e-4, &mut cell, &mut motion, open([0, 6]));
        }
        let mut bits: Vec<u64> = link.position.iter().chain(&link.momentum).map(|x| x.to_bits()).collect();
        for (_, pose, twist) in cell.objects(&motion) {
            bits.extend(pose.translation.vector.iter().chain(&twist.0).map(|x| x.to_bits()));
            bits.extend(pose.rotation.coords.iter().chain(&twist.1).map(|x| x.to_bits()));
        }
        bits
    };
    assert_eq!(run(), run());
}

#[test]
fn bad_objects_are_refused() {
    let refused = |o: Object| Cell::new(&[table(), o], &geometry(), None, GRAVITY).err().map(|e| e.to_string());
    let free = |mass| Mobility::Free { mass };
    let good = object("a", cuboid(0.1, 0.1, 0.1), free(1.0), [0.0; 3]);
    assert_eq!(refused(good.clone()), None);
    assert_eq!(refused(table()).unwrap(), "two objects are named 'table'");
    assert_eq!(refused(Object { name: String::new(), ..good.clone() }).unwrap(), "object 2 has no name");
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(refused(Object { mobility: free(bad), ..good.clone() }).is_some());
        assert!(refused(Object { shape: cuboid(0.1, bad, 0.1), ..good.clone() }).is_some());
        let surface = Surface { stiffness: bad, ..Surface::default() };
        assert!(refused(Object { surface, ..good.clone() }).is_some());
    }
    assert_eq!(
        refused(Object { shape: Shape::Sphere { radius: -0.1 }, ..good.clone() }).unwrap(),
        "'a': radius is -0.1, expected a positive number"
    );
    let payload = PayloadShape { shape: Shape::Sphere { radius: 0.0 }, centre: Vector3::zeros() };
    assert!(Cell::new(&[good], &geometry(), Some(&payload), GRAVITY).is_err());
    let mut cell = cell(&[table()]);
    assert_eq!(cell.pick("table", &scattered()), Err(CellError::NotFree("table".into())));
    assert_eq!(cell.pick("cup", &scattered()), Err(CellError::Unknown("cup".into())));
}

#[test]
fn bad_numbers_do_no_harm() {
    let free = Mobility::Free { mass: 0.1 };
    let mut cell = cell(&[table(), object("box", cuboid(0.1, 0.1, 0.1), free, [0.0, 0.0, 0.0])]);
    let mut motion = scattered();
    motion.bodies[STRUT].position.x = f64::NAN;
    motion.bodies[bodies::strut(1)].velocity.x = f64::INFINITY;
    motion.bodies[bodies::strut(1)].position = Vector3::new(-0.5, 0.0, 0.0);
    cell.near(&motion, open(0..12), f64::NAN);
    cell.wrenches(&motion, open(0..12));
    for h in [0.0, -1.0, f64::NAN, f64::INFINITY, 1e-3] {
        cell.advance(h, 1.0);
    }
    assert!(cell.momentum().0.iter().all(|p| p.is_finite()));
}

#[test]
fn pairs_that_were_found_before_serve_until_something_has_moved() {
    // A strut moves among objects of every shape; a new search at every step must find the same contacts.
    let objects = [
        table(),
        object("box", cuboid(0.2, 0.2, 0.2), Mobility::Fixed, [0.3, 0.0, TABLE_TOP + 0.1]),
        object("ball", Shape::Sphere { radius: 0.1 }, Mobility::Fixed, [-0.2, 0.1, TABLE_TOP + 0.1]),
        object("can", Shape::Cylinder { radius: 0.05, height: 0.2 }, Mobility::Fixed, [0.0, -0.2, TABLE_TOP + 0.1]),
        object("mesh", triangles(0.2, 0.1, 0.1, false), Mobility::Fixed, [0.1, 0.4, TABLE_TOP + 0.05]),
    ];
    let (mut lasting, mut hits, mut near) = (cell(&objects), 0, 0);
    let mut motion = scattered();
    for i in 0..1500 {
        let a = 0.01 * f64::from(i);
        let strut = &mut motion.bodies[STRUT];
        strut.rotation = *Rotation3::from_euler_angles(0.3 * a, 0.05 * (1.3 * a).sin(), 1.7 * a).matrix();
        strut.position = Vector3::new(0.1 * a.sin(), 0.1 * (0.7 * a).cos(), TABLE_TOP + 0.1 + 0.1 * (2.1 * a).sin());
        let other = &mut motion.bodies[bodies::strut(2)];
        other.position = Vector3::new(-0.5, 0.1 * (0.9 * a).sin(), TABLE_TOP + 0.12);
        let closed = if i % 400 < 200 { SocketSet::ALL } else { open([0, 2, 6, 8]) };
        let wrenches = lasting.wrenches(&motion, closed);
        if i % 3 == 0 {
            let mut anew = cell(&objects);
            assert_eq!(wrenches, anew.wrenches(&motion, closed), "{i}");
            assert_eq!(lasting.touches(), anew.touches(), "{i}");
            assert_eq!(lasting.near(&motion, closed, 1e-3), anew.near(&motion, closed, 1e-3), "{i}");
        }
        hits += usize::from(!lasting.touches().is_empty());
        let [first, third] = [STRUT, bodies::strut(2)].map(ContactBody::Link);
        near += lasting.touches().iter().filter(|t| t.other == first || t.link == third).count();
    }
    assert!((100..1400).contains(&hits) && near > 5, "{hits} {near}");
}

#[test]
fn what_is_held_may_touch_and_lies_still_once_it_is_put_down() {
    let free = Mobility::Free { mass: 0.5 };
    let start = [0.0, 0.0, TABLE_TOP + 0.05];
    let mut cell = cell(&[table(), object("part", triangles(0.1, 0.1, 0.1, true), free, start)]);
    let mut motion = scattered();
    (0..400).for_each(|_| cell.advance(5e-4, 1.0));
    motion.bodies[END_EFFECTOR].position = Vector3::new(0.0, 0.0, TABLE_TOP + 0.1);
    cell.pick("part", &motion).unwrap();
    motion.bodies[END_EFFECTOR].position.z += 0.02;
    assert_eq!(cell.wrenches(&motion, SocketSet::ALL)[END_EFFECTOR].0, Vector3::zeros());
    // Four corners of 2e5 N/m, 10 µm deeper than Rapier's equilibrium.
    motion.bodies[END_EFFECTOR].position.z -= 0.02 + 1e-5;
    let depth = start[2] - cell.objects(&motion).nth(1).unwrap().1.translation.z;
    let force = cell.wrenches(&motion, SocketSet::ALL)[END_EFFECTOR].0;
    assert_relative_eq!(force, Vector3::z() * (8e5 * depth), epsilon = 0.1);
    assert!((1e-5..2e-5).contains(&depth), "{depth}");
    cell.release(&motion).unwrap();
    motion.bodies[END_EFFECTOR].position.z += 1.0;
    (0..2000).for_each(|_| cell.advance(5e-4, 1.0));
    let (_, pose, twist) = cell.objects(&motion).nth(1).unwrap();
    assert_relative_eq!(pose.translation.vector, Vector3::from(start), epsilon = 1e-4);
    assert!(twist.0.norm() < 1e-6);
}

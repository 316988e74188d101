//! Rows of all joints at one pose: violations c, Jacobian G and the right-hand side γ of G·a = γ.
//!
//! G is stored in blocks of one joint on one body: six numbers per row, for the velocity of the body's origin and its
//! angular velocity, inertial axes. Rows are numbered as in [`constraints`](crate::twin::constraints), block rows body
//! by body.

use nalgebra::Vector3;

use crate::kinematics::{Arm, BodyMotion, SocketSet};
use crate::machine::bodies::{
    ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, SLOTS, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER,
};
use crate::machine::{ARMS, Actuator, Geometry, STRUTS};
use crate::twin::constraints::ROWS;

/// Number of block rows: 20 rows act on one body (the other is the fixed base), 54 on two.
pub(super) const BLOCK_ROWS: usize = 128;

/// First row of each joint: bearings of arms and rotor, ball sockets, then the chain of axis 4.
pub(super) const fn bearing(arm: usize) -> usize {
    5 * arm
}
pub(super) const ROTOR_BEARING: usize = 15;
/// First row of socket 0..12 (0..6 at the elbows).
pub(super) const fn socket(k: usize) -> usize {
    20 + 6 * (k % STRUTS) + 3 * (k / STRUTS)
}
pub(super) const PIVOT: usize = 56;
pub(super) const UPPER_HOOKE: usize = 61;
pub(super) const SLIDE: usize = 65;
pub(super) const LOWER_HOOKE: usize = 70;

/// First block row of each body, and one past the last.
pub(super) const BODY: [usize; BODIES + 1] = [0, 11, 22, 33, 39, 45, 51, 57, 63, 69, 92, 101, 110, 119, BLOCK_ROWS];

/// First block row of each joint on each of its bodies.
pub(super) const fn bearing_block(arm: usize) -> usize {
    BODY[ARM + arm]
}
pub(super) const fn elbow_on_arm(strut: usize) -> usize {
    BODY[ARM + strut / 2] + 5 + 3 * (strut % 2)
}
pub(super) const fn elbow_on_strut(strut: usize) -> usize {
    BODY[STRUT + strut]
}
pub(super) const fn ball_on_strut(strut: usize) -> usize {
    BODY[STRUT + strut] + 3
}
pub(super) const fn ball_on_platform(strut: usize) -> usize {
    BODY[PLATFORM] + 5 + 3 * strut
}
pub(super) const PIVOT_ON_PLATFORM: usize = BODY[PLATFORM];
pub(super) const LOWER_HOOKE_ON_END_EFFECTOR: usize = BODY[END_EFFECTOR];
pub(super) const PIVOT_ON_END_EFFECTOR: usize = BODY[END_EFFECTOR] + 4;
pub(super) const ROTOR_BEARING_BLOCK: usize = BODY[ROTOR];
pub(super) const UPPER_HOOKE_ON_ROTOR: usize = BODY[ROTOR] + 5;
pub(super) const UPPER_HOOKE_ON_TELESCOPE: usize = BODY[TELESCOPE_UPPER];
pub(super) const SLIDE_ON_UPPER: usize = BODY[TELESCOPE_UPPER] + 4;
pub(super) const SLIDE_ON_LOWER: usize = BODY[TELESCOPE_LOWER];
pub(super) const LOWER_HOOKE_ON_LOWER: usize = BODY[TELESCOPE_LOWER] + 5;

/// Row of every block row.
pub(super) const ROW: [usize; BLOCK_ROWS] = row_of_blocks();

const fn row_of_blocks() -> [usize; BLOCK_ROWS] {
    let mut out = [usize::MAX; BLOCK_ROWS];
    let mut i = 0;
    while i < ARMS {
        out = joint(out, bearing_block(i), bearing(i), 5);
        i += 1;
    }
    let mut s = 0;
    while s < STRUTS {
        out = joint(out, elbow_on_arm(s), socket(s), 3);
        out = joint(out, elbow_on_strut(s), socket(s), 3);
        out = joint(out, ball_on_strut(s), socket(STRUTS + s), 3);
        out = joint(out, ball_on_platform(s), socket(STRUTS + s), 3);
        s += 1;
    }
    out = joint(out, ROTOR_BEARING_BLOCK, ROTOR_BEARING, 5);
    out = joint(out, PIVOT_ON_PLATFORM, PIVOT, 5);
    out = joint(out, PIVOT_ON_END_EFFECTOR, PIVOT, 5);
    out = joint(out, UPPER_HOOKE_ON_ROTOR, UPPER_HOOKE, 4);
    out = joint(out, UPPER_HOOKE_ON_TELESCOPE, UPPER_HOOKE, 4);
    out = joint(out, SLIDE_ON_UPPER, SLIDE, 5);
    out = joint(out, SLIDE_ON_LOWER, SLIDE, 5);
    out = joint(out, LOWER_HOOKE_ON_LOWER, LOWER_HOOKE, 4);
    joint(out, LOWER_HOOKE_ON_END_EFFECTOR, LOWER_HOOKE, 4)
}

const fn joint(mut out: [usize; BLOCK_ROWS], block: usize, row: usize, n: usize) -> [usize; BLOCK_ROWS] {
    let mut k = 0;
    while k < n {
        out[block + k] = row + k;
        k += 1;
    }
    out
}

/// All rows at one pose; those of an open socket are zero.
pub(super) struct Rows {
    /// Violation c, m or 1.
    pub values: [f64; ROWS],
    /// γ = −(d²c/dt² at zero acceleration), m/s² or 1/s².
    pub gamma: [f64; ROWS],
    /// Blocks of G.
    pub blocks: [[f64; 6]; BLOCK_ROWS],
}

impl Rows {
    pub fn new() -> Self {
        Self { values: [0.0; ROWS], gamma: [0.0; ROWS], blocks: [[0.0; 6]; BLOCK_ROWS] }
    }

    /// Computes the rows of all joints with the sockets in `closed`; `lengths` are the strut lengths, m.
    pub fn fill(&mut self, geometry: &Geometry, lengths: &[f64; STRUTS], b: &[BodyMotion; SLOTS], closed: SocketSet) {
        for i in 0..ARMS {
            let (row, block, arm) = (bearing(i), bearing_block(i), &b[ARM + i]);
            match geometry.limbs[i].actuator {
                Actuator::Revolute => {
                    let shaft = Point::fixed(geometry.limbs[i].shaft());
                    self.same_point(row, Point::new(block, arm, Vector3::zeros()), shaft);
                    let y = Axis::new(block + 3, arm, 1);
                    self.normal(row + 3, y, Axis::fixed(geometry.limbs[i].radial()));
                    self.normal(row + 4, Axis { block: Some(block + 4), ..y }, Axis::fixed(Vector3::z()));
                }
                Actuator::Prismatic { .. } => {
                    let guide = Arm::new(&geometry.limbs[i], 0.0);
                    let (v, offset) = (geometry.limbs[i].tangential(), arm.position - guide.origin);
                    for (k, across) in [v, guide.z].into_iter().enumerate() {
                        (self.values[row + k], self.gamma[row + k]) = (offset.dot(&across), 0.0);
                        self.write(block + k, &across, &Vector3::zeros());
                    }
                    for (k, (own, fixed)) in [(1, guide.x), (1, guide.z), (0, guide.z)].into_iter().enumerate() {
                        self.normal(row + 2 + k, Axis::new(block + 2 + k, arm, own), Axis::fixed(fixed));
                    }
                }
            }
        }
        let (row, block, rotor) = (ROTOR_BEARING, ROTOR_BEARING_BLOCK, &b[ROTOR]);
        self.same_point(row, Point::new(block, rotor, Vector3::zeros()), Point::fixed(geometry.upper_hooke()));
        self.normal(row + 3, Axis::new(block + 3, rotor, 2), Axis::fixed(Vector3::x()));
        self.normal(row + 4, Axis::new(block + 4, rotor, 2), Axis::fixed(Vector3::y()));
        for s in 0..STRUTS {
            let strut = &b[STRUT + s];
            let (on_arm, on_platform) = (geometry.elbow_ball(s), geometry.platform_ball(s));
            let along = Vector3::new(lengths[s], 0.0, 0.0);
            let elbow = [(elbow_on_strut(s), strut, Vector3::zeros()), (elbow_on_arm(s), &b[ARM + s / 2], on_arm)];
            let ball = [(ball_on_strut(s), strut, along), (ball_on_platform(s), &b[PLATFORM], on_platform)];
            for (k, [on_strut, on_partner]) in [(s, elbow), (STRUTS + s, ball)] {
                if closed.contains(k) {
                    let point = |(block, body, x): (usize, &BodyMotion, Vector3<f64>)| Point::new(block, body, x);
                    self.same_point(socket(k), point(on_strut), point(on_partner));
                } else {
                    for i in 0..3 {
                        (self.values[socket(k) + i], self.gamma[socket(k) + i]) = (0.0, 0.0);
                        self.blocks[on_strut.0 + i] = [0.0; 6];
                        self.blocks[on_partner.0 + i] = [0.0; 6];
                    }
                }
            }
        }
        self.chain(geometry, b);
    }

    /// Computes the rows of pivot, Hooke joints and telescope.
    fn chain(&mut self, geometry: &Geometry, b: &[BodyMotion; SLOTS]) {
        let [platform, ee, rotor, upper, lower] =
            [PLATFORM, END_EFFECTOR, ROTOR, TELESCOPE_UPPER, TELESCOPE_LOWER].map(|k| &b[k]);
        let origin = Vector3::zeros();
        let flange = Vector3::new(0.0, 0.0, geometry.flange_height);
        let (on_ee, on_platform) = (PIVOT_ON_END_EFFECTOR, PIVOT_ON_PLATFORM);
        self.same_point(PIVOT, Point::new(on_ee, ee, origin), Point::new(on_platform, platform, flange));
        for i in 0..2 {
            let k = 3 + i;
            self.normal(PIVOT + k, Axis::new(on_ee + k, ee, 2), Axis::new(on_platform + k, platform, i));
        }
        let (on_rotor, on_upper) = (UPPER_HOOKE_ON_ROTOR, UPPER_HOOKE_ON_TELESCOPE);
        self.same_point(UPPER_HOOKE, Point::new(on_upper, upper, origin), Point::new(on_rotor, rotor, origin));
        self.normal(UPPER_HOOKE + 3, Axis::new(on_rotor + 3, rotor, 0), Axis::new(on_upper + 3, upper, 1));
        let (on_upper, on_lower) = (SLIDE_ON_UPPER, SLIDE_ON_LOWER);
        for i in 0..3 {
            let (p, q) = (Axis::new(on_upper + i, upper, i), Axis::new(on_lower + i, lower, (i + 1) % 3));
            self.normal(SLIDE + i, p, q);
        }
        for i in 0..2 {
            self.in_plane(SLIDE + 3 + i, (on_lower + 3 + i, lower), (on_upper + 3 + i, upper), i);
        }
        let cross = Vector3::new(0.0, 0.0, geometry.lower_hooke_height - geometry.flange_height);
        let (on_lower, on_ee) = (LOWER_HOOKE_ON_LOWER, LOWER_HOOKE_ON_END_EFFECTOR);
        self.same_point(LOWER_HOOKE, Point::new(on_lower, lower, origin), Point::new(on_ee, ee, cross));
        self.normal(LOWER_HOOKE + 3, Axis::new(on_ee + 3, ee, 0), Axis::new(on_lower + 3, lower, 1));
    }

    /// c = x_a − x_b with ẋ = v + ω × r.
    fn same_point(&mut self, row: usize, a: Point, b: Point) {
        let (c, bias) = (a.x - b.x, a.bias - b.bias);
        for k in 0..3 {
            self.values[row + k] = c[k];
            self.gamma[row + k] = -bias[k];
            for (end, sign) in [(&a, 1.0), (&b, -1.0)] {
                if let Some(block) = end.block {
                    let e = Vector3::ith(k, sign);
                    self.write(block + k, &e, &end.r.cross(&e));
                }
            }
        }
    }

    /// c = p·q with ṗ = ω × p.
    fn normal(&mut self, row: usize, p: Axis, q: Axis) {
        self.values[row] = p.x.dot(&q.x);
        self.gamma[row] = -(p.bias.dot(&q.x) + 2.0 * p.rate.dot(&q.rate) + p.x.dot(&q.bias));
        let n = p.x.cross(&q.x);
        for (axis, n) in [(p, n), (q, -n)] {
            if let Some(block) = axis.block {
                self.write(block, &Vector3::zeros(), &n);
            }
        }
    }

    /// c = (x_a − x_b)·e with e axis `i` of body b.
    fn in_plane(&mut self, row: usize, a: (usize, &BodyMotion), b: (usize, &BodyMotion), i: usize) {
        let e = Axis::new(b.0, b.1, i);
        let (d, rate) = (a.1.position - b.1.position, a.1.velocity - b.1.velocity);
        self.values[row] = d.dot(&e.x);
        self.gamma[row] = -(2.0 * rate.dot(&e.rate) + d.dot(&e.bias));
        self.write(a.0, &e.x, &Vector3::zeros());
        self.write(b.0, &-e.x, &e.x.cross(&d));
    }

    fn write(&mut self, block: usize, linear: &Vector3<f64>, angular: &Vector3<f64>) {
        self.blocks[block] = [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z];
    }
}

/// A point of a body, or of the base.
struct Point {
    /// First block row on its body.
    block: Option<usize>,
    x: Vector3<f64>,
    /// Vector from the body's origin.
    r: Vector3<f64>,
    /// Centripetal acceleration ω × (ω × r).
    bias: Vector3<f64>,
}

impl Point {
    fn new(block: usize, b: &BodyMotion, in_body: Vector3<f64>) -> Self {
        let r = b.rotation * in_body;
        let omega = &b.angular_velocity;
        Self { block: Some(block), x: b.position + r, r, bias: omega.cross(&omega.cross(&r)) }
    }

    fn fixed(x: Vector3<f64>) -> Self {
        Self { block: None, x, r: Vector3::zeros(), bias: Vector3::zeros() }
    }
}

/// An axis of a body, or of the base.
#[derive(Clone, Copy)]
struct Axis {
    /// Block row on its body.
    block: Option<usize>,
    x: Vector3<f64>,
    rate: Vector3<f64>,
    /// ω × (ω × x).
    bias: Vector3<f64>,
}

impl Axis {
    fn new(block: usize, b: &BodyMotion, i: usize) -> Self {
        let x = b.rotation.column(i).into_owned();
        let rate = b.angular_velocity.cross(&x);
        Self { block: Some(block), x, rate, bias: b.angular_velocity.cross(&rate) }
    }

    fn fixed(x: Vector3<f64>) -> Self {
        Self { block: None, x, rate: Vector3::zeros(), bias: Vector3::zeros() }
    }
}

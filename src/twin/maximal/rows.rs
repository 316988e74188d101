//! Rows of all joints at one pose: violations c, Jacobian G and the right-hand side γ of G·a = γ.
//!
//! G is stored in blocks of one joint on one body: six numbers per row, for the velocity of the body's origin and its
//! angular velocity, inertial axes. Rows and block rows are numbered by [`Structure`].

use nalgebra::Vector3;

use super::structure::{Joint, Kind, MAX_ROWS, Structure};
use crate::kinematics::{Arm, BodyMotion, SocketSet};
use crate::machine::bodies::SLOTS;
use crate::machine::{Actuator, Geometry, PerStrut};
use crate::numerics::with_turns;

/// All rows at one pose; those of an open socket are zero.
pub(super) struct Rows {
    /// Violation c, m or 1.
    pub values: [f64; MAX_ROWS],
    /// γ = −(d²c/dt² at zero acceleration), m/s² or 1/s².
    pub gamma: [f64; MAX_ROWS],
    /// Blocks of G.
    pub blocks: Vec<[f64; 6]>,
}

impl Rows {
    pub fn new(structure: &Structure) -> Self {
        Self { values: [0.0; MAX_ROWS], gamma: [0.0; MAX_ROWS], blocks: vec![[0.0; 6]; structure.row.len()] }
    }

    /// Computes the rows of all joints with the sockets in `closed`; `lengths` are the strut lengths, m.
    pub fn fill(
        &mut self,
        structure: &Structure,
        geometry: &Geometry,
        lengths: &PerStrut<f64>,
        b: &[BodyMotion; SLOTS],
        closed: SocketSet,
    ) {
        for joint in &structure.joints {
            let on = |k: usize| On { block: joint.blocks[k], body: &b[joint.bodies[k]] };
            let origin = Vector3::zeros();
            match joint.kind {
                Kind::Bearing(limb) => self.bearing(joint.row, on(0), geometry, limb),
                Kind::Socket(k) if !closed.contains(k) => self.open(joint),
                Kind::Socket(k) => {
                    let upper = k < structure.struts;
                    let s = if upper { k } else { k - structure.struts };
                    let along = if upper { origin } else { Vector3::new(lengths[s], 0.0, 0.0) };
                    let ball = if upper { geometry.elbow_ball(s) } else { geometry.platform_ball(s) };
                    self.same_point(joint.row, on(0).point(along), on(1).point(ball));
                }
                Kind::Hinge([p, q]) => {
                    let alone = joint.bodies.len() == 1;
                    let fixed = if alone { Point::fixed(q) } else { on(1).point(q) };
                    self.same_point(joint.row, on(0).point(p), fixed);
                    for i in 0..2 {
                        let k = 3 + i;
                        let across = if alone { Axis::fixed(Vector3::ith(i, 1.0)) } else { on(1).after(k).axis(i) };
                        self.normal(joint.row + k, on(0).after(k).axis(2), across);
                    }
                }
                Kind::Hooke([p, q]) => {
                    self.same_point(joint.row, on(0).point(p), on(1).point(q));
                    self.normal(joint.row + 3, on(1).after(3).axis(0), on(0).after(3).axis(1));
                }
                Kind::Rail(across) => {
                    for i in 0..3 {
                        self.normal(joint.row + i, on(1).after(i).axis(i), on(0).after(i).axis((i + 1) % 3));
                    }
                    for (i, e) in across.into_iter().enumerate() {
                        let k = 3 + i;
                        let (a, b) = (on(0).after(k), on(1).after(k));
                        self.in_plane(joint.row + k, a.point(origin), b.point(origin), b.fixed(&e));
                    }
                }
                Kind::Pin([p, q]) => {
                    for i in 0..2 {
                        let (a, b) = (on(0).after(i), on(1).after(i));
                        self.in_plane(joint.row + i, a.point(p), b.point(q), b.axis(i));
                    }
                }
                Kind::Pinion { along, radius } => self.pinion(joint.row, [on(0), on(1), on(2)], &along, radius),
                Kind::Coupling(limbs) => {
                    let [p, q] = [0, 1].map(|k| {
                        let (limb, arm) = (&geometry.limbs[limbs[k]], on(k).body);
                        let (screw, sign) = (Arm::new(limb, 0.0).screw(limb), [1.0, -1.0][k]);
                        self.write(joint.blocks[k], &(screw.linear * sign), &(screw.angular * sign));
                        Arm::coordinate(limb, arm)
                    });
                    (self.values[joint.row], self.gamma[joint.row]) = (p - q, 0.0);
                }
            }
        }
    }

    fn open(&mut self, joint: &Joint) {
        for i in 0..3 {
            (self.values[joint.row + i], self.gamma[joint.row + i]) = (0.0, 0.0);
            joint.blocks.iter().for_each(|block| self.blocks[block + i] = [0.0; 6]);
        }
    }

    fn bearing(&mut self, row: usize, arm: On, geometry: &Geometry, limb: usize) {
        let limb = &geometry.limbs[limb];
        match limb.actuator {
            Actuator::Revolute => {
                self.same_point(row, arm.point(Vector3::zeros()), Point::fixed(limb.shaft()));
                for (k, across) in [(3, limb.radial()), (4, Vector3::z())] {
                    self.normal(row + k, arm.after(k).axis(1), Axis::fixed(across));
                }
            }
            Actuator::Prismatic { .. } => {
                let guide = Arm::new(limb, 0.0);
                let offset = arm.body.position - guide.origin;
                for (k, across) in [limb.tangential(), guide.z].into_iter().enumerate() {
                    (self.values[row + k], self.gamma[row + k]) = (offset.dot(&across), 0.0);
                    self.write(arm.block + k, &across, &Vector3::zeros());
                }
                for (k, own, fixed) in [(2, 1, guide.x), (3, 1, guide.z), (4, 0, guide.z)] {
                    self.normal(row + k, arm.after(k).axis(own), Axis::fixed(fixed));
                }
            }
        }
    }

    /// c = r·θ − d·e with d from `guide` to `rack`, e `along` of the guide, and θ the angle of the pinion on the guide about z.
    fn pinion(&mut self, row: usize, [guide, rack, pinion]: [On; 3], along: &Vector3<f64>, radius: f64) {
        let (e, z) = (guide.fixed(along), guide.axis(2));
        let d = rack.body.position - guide.body.position;
        let rate = rack.body.velocity - guide.body.velocity;
        let turning = pinion.body.angular_velocity - guide.body.angular_velocity;
        let x = guide.body.rotation.tr_mul(&pinion.body.rotation.column(0));
        let way = d.dot(&e.x);
        let angle = with_turns(x.y.atan2(x.x), way / radius);
        self.values[row] = radius * angle - way;
        self.gamma[row] = -(radius * turning.dot(&z.rate) - 2.0 * rate.dot(&e.rate) - d.dot(&e.bias));
        self.write(guide.block, &e.x, &(z.x * -radius - e.x.cross(&d)));
        self.write(rack.block, &-e.x, &Vector3::zeros());
        self.write(pinion.block, &Vector3::zeros(), &(z.x * radius));
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

    /// c = (x_a − x_b)·e with e fixed in body b.
    fn in_plane(&mut self, row: usize, a: Point, b: Point, e: Axis) {
        let (d, rate) = (a.x - b.x, a.rate - b.rate);
        self.values[row] = d.dot(&e.x);
        self.gamma[row] = -((a.bias - b.bias).dot(&e.x) + 2.0 * rate.dot(&e.rate) + d.dot(&e.bias));
        if let (Some(on_a), Some(on_b)) = (a.block, b.block) {
            self.write(on_a, &e.x, &a.r.cross(&e.x));
            self.write(on_b, &-e.x, &(e.x.cross(&d) - b.r.cross(&e.x)));
        }
    }

    fn write(&mut self, block: usize, linear: &Vector3<f64>, angular: &Vector3<f64>) {
        self.blocks[block] = [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z];
    }
}

/// A body in a joint, with its block row.
#[derive(Clone, Copy)]
struct On<'a> {
    block: usize,
    body: &'a BodyMotion,
}

impl On<'_> {
    /// `k` block rows later.
    fn after(self, k: usize) -> Self {
        Self { block: self.block + k, ..self }
    }

    fn point(self, in_body: Vector3<f64>) -> Point {
        let (b, omega) = (self.body, &self.body.angular_velocity);
        let r = b.rotation * in_body;
        let swing = omega.cross(&r);
        Point { block: Some(self.block), x: b.position + r, r, rate: b.velocity + swing, bias: omega.cross(&swing) }
    }

    fn axis(self, i: usize) -> Axis {
        self.turned(self.body.rotation.column(i).into_owned())
    }

    /// A direction in the axes of the body.
    fn fixed(self, in_body: &Vector3<f64>) -> Axis {
        self.turned(self.body.rotation * in_body)
    }

    fn turned(self, x: Vector3<f64>) -> Axis {
        let rate = self.body.angular_velocity.cross(&x);
        Axis { block: Some(self.block), x, rate, bias: self.body.angular_velocity.cross(&rate) }
    }
}

/// A point of a body, or of the base.
struct Point {
    /// First block row on its body.
    block: Option<usize>,
    x: Vector3<f64>,
    /// Vector from the body's origin.
    r: Vector3<f64>,
    rate: Vector3<f64>,
    /// Centripetal acceleration ω × (ω × r).
    bias: Vector3<f64>,
}

impl Point {
    fn fixed(x: Vector3<f64>) -> Self {
        Self { block: None, x, r: Vector3::zeros(), rate: Vector3::zeros(), bias: Vector3::zeros() }
    }
}

/// A direction of a body, or of the base.
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
    fn fixed(x: Vector3<f64>) -> Self {
        Self { block: None, x, rate: Vector3::zeros(), bias: Vector3::zeros() }
    }
}

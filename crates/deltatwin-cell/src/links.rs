//! Collision shapes of the robot's links, and pairs of links that can collide.

use deltatwin::cell::links::{
    ARM_RADIUS, ARM_TRIM, BALL_RADIUS, CARRIAGE_RADIUS, FLANGE_RADIUS, PLATFORM_INSET, PLATFORM_THICKNESS,
    ROD_CLEARANCE, ROD_RADIUS, STRUT_RADIUS, TUBE_CLEARANCE, TUBE_RADIUS,
};
use deltatwin::cell::{Mobility, Object, Shape, Surface};
use deltatwin::kinematics::SocketSet;
use deltatwin::machine::bodies::{BodyKind, END_EFFECTOR, TELESCOPE_LOWER, TELESCOPE_UPPER, arm, body_kind, strut};
use deltatwin::machine::{Actuator, Geometry};
use nalgebra::{Matrix3, Vector3};

use super::hull::Hull;

/// Gap between a strut's rounded end and the ball, m, so that adjacent links do not touch.
const STRUT_GAP: f64 = 1e-3;
/// Rounding radius of the flange's rim, m; estimated.
const FLANGE_ROUNDING: f64 = 0.005;
/// Height of the underside of the frame's plate above the shaft plane, m, which raised arms do not reach; estimated
/// from pictures.
const FRAME_BOTTOM: f64 = 0.1;
/// Number of corners of the platform plate and of the flange's rim.
const CORNERS: usize = 6;

/// A part of a link.
pub struct Part {
    /// Body of the twin to which it belongs.
    pub body: usize,
    /// Rotation from the hull's frame to the body's.
    pub rotation: Matrix3<f64>,
    /// Origin of the hull's frame in the body, m.
    pub position: Vector3<f64>,
    /// Shape.
    pub hull: Hull,
    /// Whether it can collide with other links; parts inside the sockets, such as balls, collide with objects only.
    pub meets_links: bool,
    /// Socket that must be open for the part to be active.
    pub bared_by: Option<usize>,
}

impl Part {
    fn new(body: usize, hull: Hull, meets_links: bool) -> Self {
        Self { body, rotation: Matrix3::identity(), position: Vector3::zeros(), hull, meets_links, bared_by: None }
    }
}

/// Shapes of the links of a robot; the rotor is inside the base.
pub fn parts(geometry: &Geometry) -> Vec<Part> {
    let mut parts = Vec::new();
    for (i, limb) in geometry.limbs.iter().enumerate() {
        let elbow = Vector3::x() * limb.arm_length;
        let end = Vector3::x() * (limb.arm_length - ARM_TRIM).max(0.5 * limb.arm_length);
        let pair = Vector3::y() * (0.5 * limb.pair_distance);
        let body = match limb.actuator {
            Actuator::Revolute => Hull::chain(&[Vector3::zeros(), end], ARM_RADIUS, false),
            // Beside the ball line, away from the struts.
            Actuator::Prismatic { .. } => {
                let middle = elbow + Vector3::z() * (2.0 * CARRIAGE_RADIUS + BALL_RADIUS);
                Hull::chain(&[middle - pair, middle + pair], CARRIAGE_RADIUS, false)
            }
        };
        parts.push(Part::new(arm(i), body, true));
        parts.push(Part::new(arm(i), Hull::chain(&[elbow - pair, elbow + pair], BALL_RADIUS, false), false));
    }
    let struts = 2 * geometry.limbs.len();
    for s in 0..struts {
        let length = geometry.limbs[s / 2].strut_length;
        let trim = (BALL_RADIUS + STRUT_RADIUS + STRUT_GAP).min(0.4 * length);
        let ends = [Vector3::x() * trim, Vector3::x() * (length - trim)];
        parts.push(Part::new(strut(s), Hull::chain(&ends, STRUT_RADIUS, false), true));
        // An open end extends to the former place of the ball; it starts inside the ball, so that it collides with
        // objects only.
        for (socket, end) in [(s, 0.0), (struts + s, length)] {
            let tip = Part::new(strut(s), Hull::chain(&[Vector3::x() * end], STRUT_RADIUS, false), false);
            parts.push(Part { bared_by: Some(socket), ..tip });
        }
    }
    let plate = &geometry.plate;
    for (k, &body) in plate.bodies().iter().enumerate() {
        let on_part = |s: &usize| k < plate.carriers() && geometry.limbs[s / 2].part == k;
        let balls: Vec<_> = (0..struts).filter(on_part).map(|s| geometry.platform_ball(s)).collect();
        let down = if body == END_EFFECTOR { -geometry.flange_height } else { 0.0 };
        let bars: Vec<_> = match plate.turns() {
            true => {
                let pivots = plate.pivots_on(k).into_iter().map(|place| place + Vector3::z() * down);
                pivots.chain(balls.chunks(2).map(|pair| (pair[0] + pair[1]) / 2.0)).collect()
            }
            false => {
                let ring = (geometry.platform_radius() - PLATFORM_INSET).max(0.5 * geometry.platform_radius());
                polygon(ring, 0.0)
            }
        };
        parts.push(Part::new(body, Hull::chain(&bars, PLATFORM_THICKNESS, bars.len() > 2), true));
        if !balls.is_empty() {
            parts.push(Part::new(body, Hull::chain(&balls, BALL_RADIUS, true), false));
        }
    }
    let rim = polygon(FLANGE_RADIUS - FLANGE_ROUNDING, FLANGE_ROUNDING);
    let mut flange = Hull::chain(&rim, FLANGE_ROUNDING, true);
    let plane = -geometry.flange_height;
    if plane > FLANGE_RADIUS {
        let foot = Vector3::z() * (FLANGE_RADIUS + 1e-4);
        flange = flange.and(Hull::chain(&[foot, foot.sup(&(Vector3::z() * plane))], FLANGE_RADIUS, false));
    }
    parts.push(Part::new(END_EFFECTOR, flange, true));
    if !geometry.has_telescope() {
        return parts;
    }
    let shortest = geometry.telescope_limits[0];
    let (rod, tube) = ((shortest - ROD_CLEARANCE).max(0.0), (shortest - TUBE_CLEARANCE).max(0.0));
    for (body, end, radius) in [(TELESCOPE_UPPER, -rod, ROD_RADIUS), (TELESCOPE_LOWER, tube, TUBE_RADIUS)] {
        let hull = Hull::chain(&[Vector3::zeros(), Vector3::z() * end], radius, false);
        parts.push(Part::new(body, hull, true));
    }
    parts
}

/// The robot's frame: the base plate with the motors, a cylinder below the mounting plane; `None` if there is no room
/// for it above the shafts.
///
/// An intact robot does not reach it. The gear housings, in which the arms' hubs rotate, are omitted.
pub fn frame(geometry: &Geometry) -> Option<Object> {
    let bottom = FRAME_BOTTOM.max(geometry.upper_hooke_height + TUBE_RADIUS);
    let height = geometry.mounting_height - bottom;
    (height > 0.0).then(|| Object {
        name: "frame".into(),
        shape: Shape::Cylinder { radius: geometry.limbs[0].base_radius, height },
        mobility: Mobility::Fixed,
        position: Vector3::z() * (bottom + 0.5 * height),
        yaw: 0.0,
        surface: Surface::default(),
    })
}

/// Corners of a regular polygon about z, m.
fn polygon(radius: f64, z: f64) -> Vec<Vector3<f64>> {
    (0..CORNERS)
        .map(|i| {
            let (s, c) = (i as f64 * std::f64::consts::TAU / CORNERS as f64).sin_cos();
            Vector3::new(radius * c, radius * s, z)
        })
        .collect()
}

/// Whether links `a` and `b` of a robot with `struts` struts can collide with the sockets in `closed`.
///
/// On an intact robot the mechanism prevents collisions of links; links adjacent to a joint overlap by construction.
pub fn can_meet(a: usize, b: usize, struts: usize, closed: SocketSet) -> bool {
    use BodyKind::{Arm, EndEffector, Link, Platform, Strut, TelescopeLower, TelescopeUpper};
    if closed == SocketSet::of(struts) || a == b {
        return false;
    }
    let meet = |a: BodyKind, b: BodyKind| match (a, b) {
        (Arm(_), Arm(_)) => false,
        (Arm(limb), Strut(s)) => s / 2 != limb || !closed.contains(s),
        (Arm(_), _) | (Strut(_), TelescopeUpper | TelescopeLower) => true,
        (Strut(s), Strut(t)) => {
            s / 2 != t / 2 || ![s, t, s + struts, t + struts].into_iter().all(|socket| closed.contains(socket))
        }
        (Strut(s), Platform(_) | EndEffector | Link) => !closed.contains(s + struts),
        _ => false,
    };
    let (a, b) = (body_kind(a), body_kind(b));
    meet(a, b) || meet(b, a)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::placement::Placement;
    use crate::tests::{geometry, scattered};
    use deltatwin::kinematics::{JointState, Motion};
    use deltatwin::machine::bodies::STRUT;

    fn solid(frame: &Object) -> (Hull, Placement) {
        let at = Placement::at_rest(Matrix3::identity(), frame.position);
        (Hull::solid(&frame.shape), at)
    }

    #[test]
    fn a_raised_arm_clears_the_frame_and_a_loose_strut_does_not() {
        let geometry = geometry();
        let frame = frame(&geometry).unwrap();
        let (hull, at) = solid(&frame);
        let all = parts(&geometry);
        // From the lower hard stop of the arms to the upper one.
        for k in 0..=50 {
            let q = -0.805 + 2.652 * f64::from(k) / 50.0;
            let joints = JointState { q: [q, q, q, 0.0], ..Default::default() };
            let motion = Motion::disassembled(&geometry, &joints);
            for part in all.iter().filter(|p| p.body < STRUT) {
                let there = Placement::from(&motion.bodies[part.body]).offset(&part.rotation, &part.position);
                assert!(!part.hull.within(&there, &hull, &at, 0.01), "arm {} at {q:.3} rad", part.body + 1);
            }
        }
        // A strut pointing up beside the telescope, its end 30 mm inside the plate.
        let strut = all.iter().find(|p| p.body == STRUT && p.meets_links).unwrap();
        let mut motion = scattered();
        let body = &mut motion.bodies[STRUT];
        let length = geometry.limbs[0].strut_length;
        body.position = Vector3::new(0.1, 0.0, 0.13 - length);
        body.rotation = Matrix3::from_columns(&[Vector3::z(), Vector3::y(), -Vector3::x()]);
        let mut points = Vec::new();
        strut.hull.contacts(&Placement::from(&*body), &hull, &at, &mut points);
        assert!(points.iter().any(|p| p.depth > 0.0 && p.normal.z < -0.9), "{} points", points.len());
    }
}

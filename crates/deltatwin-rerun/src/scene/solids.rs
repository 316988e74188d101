//! Shapes of the moving bodies in their own frames; those of the links have the collision dimensions.

use nalgebra::Vector3;

use super::content::Scene;
use super::mesh::Mesh;
use deltatwin::cell::links::{
    ARM_RADIUS, ARM_TRIM, BALL_RADIUS, CARRIAGE_LENGTH, CARRIAGE_RADIUS, FLANGE_RADIUS, PLATFORM_INSET,
    PLATFORM_THICKNESS, ROD_CLEARANCE, ROD_RADIUS, STRUT_RADIUS, TUBE_CLEARANCE, TUBE_RADIUS,
};
use deltatwin::machine::bodies::{BodyKind, body_kind};
use deltatwin::machine::{Actuator, Axis, Geometry, Joint, Limb, Mechanism, Plate};

/// Depth and wall of a cup on its ball, m; estimated.
const CUP: (f64, f64) = (0.012, 0.004);
/// Length of the displayed part of a single axis, m.
pub(super) const LONE_SIZE: f64 = 0.2;

pub(super) const SHELL: [u8; 3] = [214, 216, 220];
pub(super) const STEEL: [u8; 3] = [150, 155, 165];
pub(super) const CARBON: [u8; 3] = [88, 92, 102];
pub(super) const BRASS: [u8; 3] = [215, 175, 80];
const ORANGE: [u8; 3] = [235, 125, 40];

/// Names of the cups of a strut: at the elbow, at the platform.
pub(super) const CUPS: [&str; 2] = ["cup_upper", "cup_lower"];

/// A part of a body, an entity of its own.
pub(super) struct Part {
    /// Name below that of the body; empty for the body itself.
    pub name: &'static str,
    /// Shape in the body's frame.
    pub mesh: Mesh,
    /// Colour unless it shows a load or a residual.
    pub color: [u8; 3],
}

/// Parts of body `b`.
pub(super) fn parts(scene: &Scene, b: usize) -> Vec<Part> {
    let g = scene.geometry;
    let body = |mesh, color| vec![Part { name: "", mesh, color }];
    if let Mechanism::Axis(Axis { joint, .. }) = scene.machine {
        let end = match joint {
            Joint::Revolute => Vector3::x() * LONE_SIZE,
            Joint::Prismatic => Vector3::z() * (0.5 * LONE_SIZE),
        };
        return body(rod(end, ARM_RADIUS), STEEL);
    }
    match body_kind(b) {
        BodyKind::Arm(limb) => match g.limbs[limb].actuator {
            Actuator::Prismatic { .. } => carriage(&g.limbs[limb]),
            Actuator::Revolute => arm(&g.limbs[limb]),
        },
        BodyKind::Strut(s) => strut(g.limbs[s / 2].strut_length),
        BodyKind::Platform(part) => platform(g, part),
        BodyKind::EndEffector => end_effector(g),
        BodyKind::TelescopeUpper => {
            body(rod(Vector3::z() * (ROD_CLEARANCE - g.telescope_limits[0]).min(0.0), ROD_RADIUS), STEEL)
        }
        BodyKind::TelescopeLower => {
            body(rod(Vector3::z() * (g.telescope_limits[0] - TUBE_CLEARANCE).max(0.0), TUBE_RADIUS), STEEL)
        }
        BodyKind::Link => link(g),
        BodyKind::Rotor => Vec::new(),
    }
}

/// Centres of the balls on body `b`, m.
pub(super) fn balls(scene: &Scene, b: usize) -> Vec<Vector3<f64>> {
    let g = scene.geometry;
    match (body_kind(b), scene.machine) {
        (_, Mechanism::Axis(_)) => Vec::new(),
        (BodyKind::Arm(limb), _) => vec![g.elbow_ball(2 * limb), g.elbow_ball(2 * limb + 1)],
        (BodyKind::Platform(part), _) => corners(g, part),
        _ => Vec::new(),
    }
}

/// A rod from the body's origin to `end`, m.
fn rod(end: Vector3<f64>, radius: f64) -> Mesh {
    let length = end.norm();
    let Some(axis) = end.try_normalize(1e-9) else { return Mesh::default() };
    let chamfer = (0.2 * radius).min(0.5 * length);
    let profile = [
        (0.0, 0.0),
        (0.0, radius - chamfer),
        (chamfer, radius),
        (length - chamfer, radius),
        (length, radius - chamfer),
        (length, 0.0),
    ];
    Mesh::lathe(Vector3::zeros(), axis, &profile)
}

/// Hub on the motor's shaft, tapered beam, and at the elbow the bar for its two balls.
fn arm(limb: &Limb) -> Vec<Part> {
    let elbow = Vector3::x() * limb.arm_length;
    let tube = (limb.arm_length - ARM_TRIM).max(0.5 * limb.arm_length);
    let half = 0.5 * limb.pair_distance;
    let wide = 1.4 * ARM_RADIUS;
    let hub = Mesh::lathe(Vector3::zeros(), Vector3::y(), &[(-wide, 0.0), (-wide, wide), (wide, wide), (wide, 0.0)]);
    let beam = Mesh::beam(tube, [0.9 * ARM_RADIUS, 1.3 * ARM_RADIUS], [0.5 * ARM_RADIUS, 0.6 * ARM_RADIUS]);
    let neck = Mesh::lathe(Vector3::x() * tube, Vector3::x(), &[(0.0, 0.012), (limb.arm_length - tube, 0.007)]);
    let bar = Mesh::lathe(elbow, Vector3::y(), &[(-half, 0.0), (-half, 0.006), (half, 0.006), (half, 0.0)]);
    vec![Part { name: "", mesh: hub.and(beam), color: STEEL }, Part { name: "neck", mesh: neck.and(bar), color: BRASS }]
}

/// Block on its guide, and beside it the bar for its two balls.
fn carriage(limb: &Limb) -> Vec<Part> {
    let half = 0.5 * limb.pair_distance;
    let (r, l) = (CARRIAGE_RADIUS, 0.5 * CARRIAGE_LENGTH);
    let guide = Vector3::z() * (2.0 * r + BALL_RADIUS);
    let block = Mesh::lathe(guide, Vector3::x(), &[(-l, 0.0), (-l, 1.6 * r), (l, 1.6 * r), (l, 0.0)]);
    let neck = Mesh::lathe(Vector3::zeros(), Vector3::z(), &[(0.0, 0.006), (2.0 * r, 0.008)]);
    let bar = Mesh::lathe(Vector3::zeros(), Vector3::y(), &[(-half, 0.0), (-half, 0.004), (half, 0.004), (half, 0.0)]);
    vec![Part { name: "", mesh: block, color: STEEL }, Part { name: "neck", mesh: neck.and(bar), color: BRASS }]
}

/// Tube with a cup at either end.
fn strut(length: f64) -> Vec<Part> {
    let (depth, wall) = CUP;
    let (begin, end) = (depth, (length - depth).max(depth));
    let tube = [(begin, 0.0), (begin, STRUT_RADIUS), (end, STRUT_RADIUS), (end, 0.0)];
    // Seen from outside: a bowl around the ball that narrows to the tube.
    let wide = BALL_RADIUS + wall;
    let bowl = [(-0.3 * depth, BALL_RADIUS), (-0.3 * depth, wide), (0.5 * depth, wide), (1.6 * depth, STRUT_RADIUS)];
    let cup = |k: usize, base: f64, axis: Vector3<f64>| Part {
        name: CUPS[k],
        mesh: Mesh::lathe(Vector3::x() * base, axis, &bowl),
        color: STEEL,
    };
    let tube = Mesh::lathe(Vector3::zeros(), Vector3::x(), &tube);
    let tube = Part { name: "", mesh: tube, color: CARBON };
    vec![tube, cup(0, 0.0, Vector3::x()), cup(1, length, -Vector3::x())]
}

/// Corners of part `part` of the plate, where its balls are, anticlockwise from the first limb, m.
fn corners(g: &Geometry, part: usize) -> Vec<Vector3<f64>> {
    let limbs = (0..g.limbs.len()).filter(|&i| g.limbs[i].part == part);
    let mut all: Vec<_> = limbs.flat_map(|i| [2 * i + 1, 2 * i]).map(|s| g.platform_ball(s)).collect();
    if !g.has_platform_of_three() {
        let centre = all.iter().sum::<Vector3<f64>>() / all.len().max(1) as f64;
        let angle = |v: &Vector3<f64>| (v.y - centre.y).atan2(v.x - centre.x);
        all.sort_by(|a, b| angle(a).total_cmp(&angle(b)));
    }
    all
}

/// The connecting bar of a parallelogram that does not carry the end effector.
fn link(g: &Geometry) -> Vec<Part> {
    let Plate::Par4 { connecting, .. } = g.plate else { return Vec::new() };
    let (length, radius) = (connecting.norm(), PLATFORM_THICKNESS);
    let bar = [(0.0, 0.0), (0.0, radius), (length, radius), (length, 0.0)];
    let mesh = Mesh::lathe(connecting / -2.0, connecting / length, &bar);
    vec![Part { name: "", mesh, color: ORANGE }]
}

fn platform(g: &Geometry, part: usize) -> Vec<Part> {
    let plate = Mesh::plate(&corners(g, part), 0.5 * PLATFORM_THICKNESS);
    if g.plate.turns() {
        return vec![Part { name: "hub", mesh: plate, color: ORANGE }];
    }
    let radius = (g.platform_radius() - PLATFORM_INSET).max(0.5 * g.platform_radius()) + PLATFORM_THICKNESS;
    let thick = PLATFORM_THICKNESS;
    let profile = [(-thick, 0.0), (-thick, 0.8 * radius), (0.0, radius), (thick, 0.8 * radius), (thick, 0.0)];
    let hub = Mesh::lathe(Vector3::zeros(), Vector3::z(), &profile);
    vec![Part { name: "hub", mesh: plate.and(hub), color: ORANGE }]
}

/// Flange, with a mark that shows the rotation of axis 4.
fn end_effector(g: &Geometry) -> Vec<Part> {
    let (height, radius) = ((-g.flange_height).max(0.01), FLANGE_RADIUS);
    let profile = [(0.0, 0.0), (0.0, radius), (height, radius), (height, 0.0)];
    let flange = Mesh::lathe(Vector3::zeros(), Vector3::z(), &profile);
    let mark = Mesh::beam(0.03, [0.005, 0.2 * height], [0.005, 0.2 * height]);
    let mark = mark.moved(Vector3::new(radius - 0.015, 0.0, 0.3 * height));
    vec![Part { name: "", mesh: flange, color: BRASS }, Part { name: "mark", mesh: mark, color: CARBON }]
}

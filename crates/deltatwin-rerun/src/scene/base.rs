//! The fixed parts of a machine: housing and motors, guides, or the shaft or rail of a single axis.

use nalgebra::Vector3;
use rerun::{RecordingStream, archetypes as a};

use super::content::Scene;
use super::mesh::Mesh;
use super::solids::{LONE_SIZE, SHELL, STEEL};
use super::{Outcome, assets, color, point};
use deltatwin::cell::links::{BALL_RADIUS, CARRIAGE_LENGTH, CARRIAGE_RADIUS};
use deltatwin::machine::{Actuator, Axis, Geometry, Joint, Mechanism};
use deltatwin::model::MeshPart;

/// Height of the base's housing and radius of the motors, m; estimated from pictures.
const HOUSING: f64 = 0.12;
const MOTOR_RADIUS: f64 = 0.045;

/// Logs the fixed parts, or the user's mesh in their place.
pub(super) fn shapes(rec: &RecordingStream, scene: &Scene) -> Outcome {
    if let Some(asset) = assets::of(scene, MeshPart::Base) {
        return asset.log(rec, "world/base", Some(SHELL));
    }
    let g = scene.geometry;
    match (scene.machine, g.actuator()) {
        (Mechanism::Axis(Axis { joint, .. }), _) => rail(rec, g, joint),
        (_, Actuator::Prismatic { .. }) => guides(rec, g),
        (_, Actuator::Revolute) => housing(rec, g),
    }
}

/// Logs the rail or shaft of a single axis.
fn rail(rec: &RecordingStream, g: &Geometry, joint: Joint) -> Outcome {
    let ends = match joint {
        Joint::Prismatic => g.arm_limits().map(|x| Vector3::x() * x),
        Joint::Revolute => [-0.5, 0.5].map(|side| Vector3::y() * (side * LONE_SIZE)),
    };
    let rail = a::LineStrips3D::new([ends.map(point)]).with_colors([color(STEEL)]).with_radii([0.01f32]);
    rec.log_static("world/base/rail", &rail)?;
    Ok(())
}

/// Logs a flat housing that hangs from the frame, with one motor per arm below its edge.
fn housing(rec: &RecordingStream, g: &Geometry) -> Outcome {
    let widest = g.limbs.iter().map(|limb| limb.base_radius).fold(0.0, f64::max);
    let (top, rim) = (g.mounting_height, 0.75 * widest);
    let below = (top - HOUSING).max(MOTOR_RADIUS);
    let housing = Mesh::lathe(
        Vector3::zeros(),
        Vector3::z(),
        &[(below, 0.0), (below, rim - 0.02), (below + 0.02, rim), (top, rim), (top, 0.0)],
    );
    rec.log_static("world/base/housing", &housing.solid(SHELL))?;
    let flange = Mesh::lathe(
        Vector3::zeros(),
        Vector3::z(),
        &[(top, 0.0), (top, widest), (top + 0.015, widest), (top + 0.015, 0.0)],
    );
    rec.log_static("world/base/flange", &flange.solid(STEEL))?;
    let mut motors = Mesh::default();
    for limb in g.limbs.iter() {
        let shaft = limb.shaft();
        let (across, half) = (limb.tangential(), 0.35 * limb.base_radius);
        let body = [(-half, 0.0), (-half, 0.8), (0.012 - half, 1.0), (half - 0.012, 1.0), (half, 0.8), (half, 0.0)];
        motors = motors.and(Mesh::lathe(shaft, across, &body.map(|(place, share)| (place, share * MOTOR_RADIUS))));
        let bracket = (below + 0.02 - shaft.z).max(0.01);
        let reach = [(0.0, 0.0), (0.0, 0.03), (bracket, 0.045), (bracket, 0.0)];
        motors = motors.and(Mesh::lathe(shaft * 0.9, Vector3::z(), &reach));
    }
    rec.log_static("world/base/motors", &motors.solid(SHELL))?;
    Ok(())
}

/// Logs the guides of carriages, and the ring that holds them.
fn guides(rec: &RecordingStream, g: &Geometry) -> Outcome {
    let away = 2.0 * CARRIAGE_RADIUS + BALL_RADIUS;
    let ends = |limb: usize| {
        let joints = g.limbs[limb].limits.map(|q| g.elbow(limb, q));
        let along = (joints[1] - joints[0]).normalize();
        let across = along.cross(&g.limbs[limb].tangential()) * away;
        [joints[0] - along * CARRIAGE_LENGTH + across, joints[1] + along * CARRIAGE_LENGTH + across].map(point)
    };
    let lines = a::LineStrips3D::new((0..g.limbs.len()).map(ends))
        .with_colors([color(STEEL)])
        .with_radii([0.6 * CARRIAGE_RADIUS as f32]);
    rec.log_static("world/base/guides", &lines)?;
    let (top, rim) = (g.mounting_height, g.limbs[0].base_radius + away);
    let ring = [(top, 0.9 * rim), (top, 1.1 * rim), (top + 0.01, 1.1 * rim), (top + 0.01, 0.9 * rim), (top, 0.9 * rim)];
    rec.log_static("world/base/flange", &Mesh::lathe(Vector3::zeros(), Vector3::z(), &ring).solid(SHELL))?;
    Ok(())
}

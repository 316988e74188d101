//! Solids of a scene; those of the links have the collision dimensions.

use nalgebra::{Isometry3, Vector3};
use rerun::components::FillMode;
use rerun::{EntityPath, EntityPathPart, RecordingStream, TimeColumn, archetypes as a};

use super::content::{Scene, Thing};
use super::{AXIS, Outcome, TIME, color};
use deltatwin::cell::links::{
    ARM_RADIUS, ARM_TRIM, BALL_RADIUS, FLANGE_RADIUS, PLATFORM_INSET, PLATFORM_THICKNESS, ROD_CLEARANCE, ROD_RADIUS,
    STRUT_RADIUS, TUBE_CLEARANCE, TUBE_RADIUS,
};
use deltatwin::cell::{Mobility, Object, Shape};
use deltatwin::machine::bodies::{
    ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER, body_name,
};
use deltatwin::machine::{ARMS, Axis, Geometry, Joint, Mechanism, STRUTS};

const STEEL: [u8; 3] = [150, 155, 165];
const CARBON: [u8; 3] = [88, 92, 102];
const ORANGE: [u8; 3] = [235, 125, 40];
const BRASS: [u8; 3] = [215, 175, 80];
/// Colour of a strut with an open socket.
const LOOSE: [u8; 3] = [225, 40, 60];
const PAYLOAD: [u8; 3] = [110, 150, 190];
const FIXED: [[u8; 3]; 3] = [[165, 150, 130], [110, 113, 116], [140, 140, 125]];
const BELT: [u8; 3] = [60, 95, 120];
const PRODUCTS: [[u8; 3]; 4] = [[200, 90, 110], [95, 170, 150], [205, 170, 90], [140, 120, 190]];

/// Logs the fixed parts: mounting ring and motors, or rail or shaft of a single axis.
pub(super) fn base(rec: &RecordingStream, scene: &Scene) -> Outcome {
    let g = scene.geometry;
    if let Mechanism::Axis(Axis { joint, .. }) = scene.machine {
        let ends = match joint {
            Joint::Prismatic => g.arm_limits.map(|x| Vector3::x() * x),
            Joint::Revolute => [-0.5, 0.5].map(|side| Vector3::y() * (side * LONE_SIZE)),
        };
        let rail = a::LineStrips3D::new([ends.map(point)]).with_colors([color(STEEL)]).with_radii([0.01f32]);
        rec.log_static("world/base/rail", &rail)?;
        return Ok(());
    }
    let ring = (0..=72).map(|k| {
        let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 72.0).sin_cos();
        [g.base_radius * cos, g.base_radius * sin, g.mounting_height].map(|v| v as f32)
    });
    let mut strips: Vec<Vec<[f32; 3]>> = vec![ring.collect()];
    let (mut from, mut to) = (Vec::new(), Vec::new());
    for i in 0..ARMS {
        let shaft = Geometry::radial(i) * g.base_radius;
        let half = Geometry::tangential(i) * (0.35 * g.base_radius);
        from.push(point(shaft - half));
        to.push(point(shaft + half));
        let above = shaft.xy().push(g.mounting_height);
        strips.push(vec![point(above), point(shaft)]);
    }
    let lines = a::LineStrips3D::new(strips).with_colors([color(STEEL)]).with_radii([0.008f32]);
    rec.log_static("world/base/frame", &lines)?;
    let motors = a::Capsules3D::from_endpoints_and_radii(from, to, [0.045f32; ARMS])
        .with_colors([color(STEEL)])
        .with_fill_mode(FillMode::Solid);
    rec.log_static("world/base/motors", &motors)?;
    Ok(())
}

/// Bodies that are displayed.
fn shown(scene: &Scene) -> impl Iterator<Item = usize> {
    let assembled = is_assembled(scene);
    let last = if scene.geometry.has_telescope() { BODIES } else { ROTOR };
    (0..last).filter(move |&b| b != ROTOR && (b < STRUT || assembled))
}

/// Whether the robot is assembled: bodies of a disassembled robot are at the origin, which the platform never reaches.
fn is_assembled(scene: &Scene) -> bool {
    scene.bodies.iter().any(|b| b[PLATFORM].translation.vector.norm() > 0.0)
}

/// Logs poses and colours of the moving bodies.
pub(super) fn robot_motion(rec: &RecordingStream, scene: &Scene) -> Outcome {
    if let Mechanism::Axis(_) = scene.machine {
        follow(rec, &EntityPath::from(LONE), &scene.times, scene.bodies.iter().map(|poses| poses[ARM]))?;
        return paint(rec, LONE, scene, ARM);
    }
    for b in shown(scene) {
        let entity = format!("world/{}", body_name(b));
        follow(rec, &EntityPath::from(entity.as_str()), &scene.times, scene.bodies.iter().map(|poses| poses[b]))?;
        paint(rec, &entity, scene, b)?;
    }
    Ok(())
}

/// Logs the trajectory of the platform.
pub(super) fn trail(rec: &RecordingStream, scene: &Scene) -> Outcome {
    if matches!(scene.machine, Mechanism::Axis(_)) || !is_assembled(scene) {
        return Ok(());
    }
    let path: Vec<_> = scene.bodies.iter().map(|b| point(b[PLATFORM].translation.vector)).collect();
    let path = a::LineStrips3D::new([path]).with_colors([color(AXIS[0])]).with_radii([0.001f32]);
    rec.log_static("world/path", &path)?;
    Ok(())
}

/// Logs the shapes of the moving bodies.
pub(super) fn robot(rec: &RecordingStream, scene: &Scene) -> Outcome {
    let g = scene.geometry;
    if let Mechanism::Axis(Axis { joint, .. }) = scene.machine {
        return lone(rec, joint);
    }
    for b in shown(scene) {
        let entity = format!("world/{}", body_name(b));
        let rod = |end: Vector3<f64>, radius: f64| rod(rec, &entity, end, radius);
        match b {
            ARM..STRUT => {
                let elbow = Vector3::x() * g.arm_length;
                let tube = (g.arm_length - ARM_TRIM).max(0.5 * g.arm_length);
                rod(Vector3::x() * tube, ARM_RADIUS)?;
                let pair = Vector3::y() * (0.5 * g.pair_distance);
                let neck = [[Vector3::x() * tube, elbow], [elbow - pair, elbow + pair]].map(|line| line.map(point));
                let neck = a::LineStrips3D::new(neck).with_colors([color(BRASS)]).with_radii([0.007f32]);
                rec.log_static(format!("{entity}/neck"), &neck)?;
                balls(rec, &entity, [elbow + pair, elbow - pair])?;
            }
            STRUT..PLATFORM => {
                let length = g.strut_length[(b - STRUT) / (STRUTS / ARMS)];
                rod(Vector3::x() * length, STRUT_RADIUS)?;
            }
            PLATFORM => platform(rec, &entity, g)?,
            END_EFFECTOR => end_effector(rec, &entity, scene)?,
            TELESCOPE_UPPER => rod(Vector3::z() * (ROD_CLEARANCE - g.telescope_limits[0]).min(0.0), ROD_RADIUS)?,
            TELESCOPE_LOWER => rod(Vector3::z() * (g.telescope_limits[0] - TUBE_CLEARANCE).max(0.0), TUBE_RADIUS)?,
            _ => {}
        }
    }
    Ok(())
}

/// Length of the displayed part of a single axis, m.
const LONE_SIZE: f64 = 0.2;
/// Entity path of a single axis.
const LONE: &str = "world/axis";

/// Logs the lever or carriage of a single axis.
fn lone(rec: &RecordingStream, joint: Joint) -> Outcome {
    let end = match joint {
        Joint::Revolute => Vector3::x() * LONE_SIZE,
        Joint::Prismatic => Vector3::z() * (0.5 * LONE_SIZE),
    };
    rod(rec, LONE, end, ARM_RADIUS)
}

/// Logs a rod from the body's origin to `end` (m), without colour.
fn rod(rec: &RecordingStream, entity: &str, end: Vector3<f64>, radius: f64) -> Outcome {
    let rod = a::Capsules3D::from_endpoints_and_radii([[0f32; 3]], [point(end)], [radius as f32]);
    rec.log_static(entity, &rod.with_fill_mode(FillMode::Solid))?;
    Ok(())
}

/// Logs the colour of the rod of body `b` over time.
fn paint(rec: &RecordingStream, entity: &str, scene: &Scene, b: usize) -> Outcome {
    let (usual, axis) = match b {
        ARM..STRUT => (STEEL, Some(b - ARM)),
        STRUT..PLATFORM => (CARBON, None),
        TELESCOPE_UPPER => (STEEL, Some(3)),
        TELESCOPE_LOWER => (CARBON, Some(3)),
        _ => return Ok(()),
    };
    let colors: Vec<_> = match (&scene.residual, &scene.loose, axis) {
        (Some(residual), _, Some(axis)) => residual.iter().map(|r| color(heat(r[axis]))).collect(),
        (_, Some(loose), None) => loose.iter().map(|open| color(if open[b - STRUT] { LOOSE } else { usual })).collect(),
        _ => {
            rec.log_static(entity, &a::Capsules3D::update_fields().with_colors([color(usual)]))?;
            return Ok(());
        }
    };
    let colors = a::Capsules3D::update_fields().with_colors(colors);
    rec.send_columns(entity, [frames(&scene.times)], colors.columns_of_unit_batches()?)?;
    Ok(())
}

fn platform(rec: &RecordingStream, entity: &str, g: &Geometry) -> Outcome {
    let corner = |s: usize| {
        let i = s / (STRUTS / ARMS);
        Geometry::radial(i) * g.platform_radius + Geometry::tangential(i) * g.pair_offset(s)
    };
    let corners = [1, 0, 3, 2, 5, 4].map(corner);
    balls(rec, entity, corners)?;
    let edge = corners.iter().chain(&corners[..1]).map(|c| point(*c));
    let edge = a::LineStrips3D::new([edge]).with_colors([color(ORANGE)]).with_radii([0.008f32]);
    rec.log_static(format!("{entity}/edge"), &edge)?;
    let radius = (g.platform_radius - PLATFORM_INSET).max(0.5 * g.platform_radius) + PLATFORM_THICKNESS;
    let hub = a::Cylinders3D::from_lengths_and_radii([2.0 * PLATFORM_THICKNESS as f32], [radius as f32]);
    let hub = hub.with_colors([color(ORANGE)]).with_fill_mode(FillMode::Solid);
    rec.log_static(format!("{entity}/hub"), &hub)?;
    Ok(())
}

/// Logs the flange, with a mark that shows the rotation of axis 4, and the payload.
fn end_effector(rec: &RecordingStream, entity: &str, scene: &Scene) -> Outcome {
    let height = (-scene.geometry.flange_height).max(0.01) as f32;
    let flange = a::Cylinders3D::from_lengths_and_radii([height], [FLANGE_RADIUS as f32])
        .with_centers([[0.0, 0.0, 0.5 * height]])
        .with_colors([color(BRASS)])
        .with_fill_mode(FillMode::Solid);
    rec.log_static(entity, &flange)?;
    let mark = a::Boxes3D::from_centers_and_half_sizes(
        [[FLANGE_RADIUS as f32, 0.0, 0.3 * height]],
        [[0.015f32, 0.005, 0.2 * height]],
    );
    rec.log_static(format!("{entity}/mark"), &mark.with_colors([color(CARBON)]).with_fill_mode(FillMode::Solid))?;
    if let Some((shape, centre)) = &scene.payload {
        let entity = EntityPath::from(format!("{entity}/payload"));
        rec.log_static(entity.clone(), &a::Transform3D::from_translation(point(*centre)))?;
        solid(rec, &entity, shape, PAYLOAD, "payload")?;
    }
    Ok(())
}

fn entity_of(object: &Object) -> EntityPath {
    EntityPath::from(["world", "objects", &object.name].map(EntityPathPart::new).to_vec())
}

/// Logs the poses of the free objects.
pub(super) fn things_motion(rec: &RecordingStream, scene: &Scene) -> Outcome {
    for Thing { object, poses } in scene.things.iter().filter(|t| matches!(t.object.mobility, Mobility::Free { .. })) {
        follow(rec, &entity_of(object), &scene.times, poses.iter().copied())?;
    }
    Ok(())
}

/// Logs the objects around the robot, at their initial poses if they have any.
pub(super) fn things(rec: &RecordingStream, scene: &Scene) -> Outcome {
    for (i, Thing { object, poses }) in scene.things.iter().enumerate() {
        let entity = entity_of(object);
        let paint = match object.mobility {
            Mobility::Fixed => FIXED[i % FIXED.len()],
            Mobility::Conveyor { .. } => BELT,
            Mobility::Free { .. } => PRODUCTS[i % PRODUCTS.len()],
        };
        solid(rec, &entity, &object.shape, paint, &object.name)?;
        if let (Mobility::Fixed | Mobility::Conveyor { .. }, Some(pose)) = (&object.mobility, poses.first()) {
            let at = a::Transform3D::from_translation(point(pose.translation.vector));
            rec.log_static(entity, &at.with_quaternion(quaternion(pose)))?;
        }
    }
    Ok(())
}

/// Logs the shape of an object, with its name where the label hides little.
fn solid(rec: &RecordingStream, entity: &EntityPath, shape: &Shape, rgb: [u8; 3], name: &str) -> Outcome {
    let (paint, fill) = ([color(rgb)], FillMode::Solid);
    let corner = match *shape {
        Shape::Mesh(ref mesh) => {
            let (corners, triangles) = (mesh.corners(), mesh.triangles());
            let solid = a::Mesh3D::new(corners.iter().map(|c| point(*c)))
                .with_triangle_indices(triangles.iter().copied())
                .with_albedo_factor(rerun::Rgba32::from_rgb(rgb[0], rgb[1], rgb[2]));
            rec.log_static(entity.clone(), &solid)?;
            corners.iter().fold(Vector3::zeros(), |top, c| if c.z > top.z { *c } else { top })
        }
        Shape::Box { size } => {
            let solid = a::Boxes3D::from_half_sizes([point(0.5 * size)]);
            rec.log_static(entity.clone(), &solid.with_colors(paint).with_fill_mode(fill))?;
            Vector3::new(0.5 * size.x, -0.5 * size.y, 0.5 * size.z)
        }
        Shape::Cylinder { radius, height } => {
            let solid = a::Cylinders3D::from_lengths_and_radii([height as f32], [radius as f32]);
            rec.log_static(entity.clone(), &solid.with_colors(paint).with_fill_mode(fill))?;
            Vector3::new(radius, 0.0, 0.5 * height)
        }
        Shape::Sphere { radius } => {
            let solid = a::Ellipsoids3D::from_radii([radius as f32]);
            rec.log_static(entity.clone(), &solid.with_colors(paint).with_fill_mode(fill))?;
            Vector3::new(0.0, 0.0, radius)
        }
    };
    let tag = a::Points3D::new([point(corner)]).with_radii([0.001f32]).with_colors(paint).with_labels([name]);
    rec.log_static(entity.join(&EntityPath::from("name")), &tag)?;
    Ok(())
}

fn balls(rec: &RecordingStream, entity: &str, centres: impl IntoIterator<Item = Vector3<f64>>) -> Outcome {
    let points = a::Points3D::new(centres.into_iter().map(point));
    let points = points.with_radii([BALL_RADIUS as f32]).with_colors([color(BRASS)]);
    rec.log_static(format!("{entity}/sockets"), &points)?;
    Ok(())
}

/// Logs the poses of `entity` over time.
fn follow(
    rec: &RecordingStream,
    entity: &EntityPath,
    times: &[f64],
    poses: impl Iterator<Item = Isometry3<f64>> + Clone,
) -> Outcome {
    let poses = a::Transform3D::update_fields()
        .with_many_translation(poses.clone().map(|p| point(p.translation.vector)))
        .with_many_quaternion(poses.map(|p| quaternion(&p)));
    rec.send_columns(entity.clone(), [frames(times)], poses.columns_of_unit_batches()?)?;
    Ok(())
}

fn frames(times: &[f64]) -> TimeColumn {
    TimeColumn::new_duration_secs(TIME, times.iter().copied())
}

fn quaternion(pose: &Isometry3<f64>) -> rerun::Quaternion {
    let [x, y, z, w] = pose.rotation.coords.map(|v| v as f32).into();
    rerun::Quaternion::from_xyzw([x, y, z, w])
}

fn point(v: Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// Colour of a residual: green within the noise, yellow at 3 σ, red from 6 σ.
fn heat(sigma: f64) -> [u8; 3] {
    let stops = [[70.0, 170.0, 90.0], [240.0, 200.0, 60.0], [215.0, 50.0, 45.0]];
    let x = if sigma.is_finite() { (sigma.abs() - 1.0).clamp(0.0, 5.0) / 2.5 } else { 2.0 };
    let i = (x as usize).min(1);
    std::array::from_fn(|c| (stops[i][c] + (x - i as f64) * (stops[i + 1][c] - stops[i][c])) as u8)
}

#[cfg(test)]
mod tests {
    use super::heat;

    #[test]
    fn residual_colours() {
        assert_eq!(heat(0.5), [70, 170, 90]);
        assert_eq!(heat(-3.5), [240, 200, 60]);
        assert_eq!(heat(50.0), [215, 50, 45]);
        assert_eq!(heat(f64::NAN), [215, 50, 45]);
    }
}

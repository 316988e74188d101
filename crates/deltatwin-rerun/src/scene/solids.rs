//! Solids of a scene; those of the links have the collision dimensions.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rerun::components::FillMode;
use rerun::{EntityPath, EntityPathPart, RecordingStream, TimeColumn, archetypes as a};

use super::content::{Scene, Thing};
use super::mesh::{Mesh, spring};
use super::{AXIS, Outcome, TIME, color};
use deltatwin::cell::links::{
    ARM_RADIUS, ARM_TRIM, BALL_RADIUS, CARRIAGE_LENGTH, CARRIAGE_RADIUS, FLANGE_RADIUS, PLATFORM_INSET,
    PLATFORM_THICKNESS, ROD_CLEARANCE, ROD_RADIUS, STRUT_RADIUS, TUBE_CLEARANCE, TUBE_RADIUS,
};
use deltatwin::cell::{Mobility, Object, Shape};
use deltatwin::machine::bodies::{
    ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER, body_name,
};
use deltatwin::machine::{ARMS, AXES, Actuator, Axis, Geometry, Joint, Mechanism, STRUTS};

/// Height of the base's housing and radius of the motors, m; estimated from pictures.
const HOUSING: f64 = 0.12;
const MOTOR_RADIUS: f64 = 0.045;
/// Depth and wall of a cup on its ball, m; estimated.
const CUP: (f64, f64) = (0.012, 0.004);
/// Distance of the clamp springs from the line of the balls, their radius, m, and turns; estimated.
const SPRINGS: (f64, f64, usize) = (0.035, 0.005, 12);
/// Radius of the springs' wire, m.
const WIRE: f32 = 0.0008;

const SHELL: [u8; 3] = [214, 216, 220];
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
    if let Actuator::Prismatic { .. } = g.arms {
        return guides(rec, g);
    }
    // A flat housing that hangs from the frame, with one motor per arm below its edge.
    let (top, rim) = (g.mounting_height, 0.75 * g.base_radius);
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
        &[(top, 0.0), (top, g.base_radius), (top + 0.015, g.base_radius), (top + 0.015, 0.0)],
    );
    rec.log_static("world/base/flange", &flange.solid(STEEL))?;
    let mut motors = Mesh::default();
    for i in 0..ARMS {
        let shaft = Geometry::radial(i) * g.base_radius;
        let (across, half) = (Geometry::tangential(i), 0.35 * g.base_radius);
        let body = [(-half, 0.0), (-half, 0.8), (0.012 - half, 1.0), (half - 0.012, 1.0), (half, 0.8), (half, 0.0)];
        motors = motors.and(Mesh::lathe(shaft, across, &body.map(|(place, share)| (place, share * MOTOR_RADIUS))));
        let bracket = (below + 0.02 - shaft.z).max(0.01);
        let reach = [(0.0, 0.0), (0.0, 0.03), (bracket, 0.045), (bracket, 0.0)];
        motors = motors.and(Mesh::lathe(shaft * 0.9, Vector3::z(), &reach));
    }
    rec.log_static("world/base/motors", &motors.solid(SHELL))?;
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
    if is_assembled(scene) { springs_motion(rec, scene) } else { Ok(()) }
}

/// Logs the trajectory of the platform.
pub(super) fn trail(rec: &RecordingStream, scene: &Scene) -> Outcome {
    if matches!(scene.machine, Mechanism::Axis(_)) || !is_assembled(scene) {
        return Ok(());
    }
    let path: Vec<_> = scene.bodies.iter().map(|b| point(b[PLATFORM].translation.vector)).collect();
    let worst = |r: &[f64; AXES]| r.iter().fold(0.0f64, |most, x| most.max(x.abs()));
    let path = match &scene.residual {
        // One piece per frame, in the colour of the axis with the largest residual there.
        Some(residual) => a::LineStrips3D::new(path.windows(2).map(<[_]>::to_vec))
            .with_colors(residual.iter().skip(1).map(|r| color(heat(worst(r)))))
            .with_radii([0.002f32]),
        None => a::LineStrips3D::new([path]).with_colors([color(AXIS[0])]).with_radii([0.001f32]),
    };
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
            ARM..STRUT => arm(rec, &entity, g)?,
            STRUT..PLATFORM => strut(rec, &entity, g.strut_length[(b - STRUT) / (STRUTS / ARMS)])?,
            PLATFORM => platform(rec, &entity, g)?,
            END_EFFECTOR => end_effector(rec, &entity, scene)?,
            TELESCOPE_UPPER => rod(Vector3::z() * (ROD_CLEARANCE - g.telescope_limits[0]).min(0.0), ROD_RADIUS)?,
            TELESCOPE_LOWER => rod(Vector3::z() * (g.telescope_limits[0] - TUBE_CLEARANCE).max(0.0), TUBE_RADIUS)?,
            _ => {}
        }
    }
    if is_assembled(scene) { springs(rec, g) } else { Ok(()) }
}

/// Length of the displayed part of a single axis, m.
const LONE_SIZE: f64 = 0.2;
/// Entity path of a single axis.
const LONE: &str = "world/axis";

/// Logs the guides of carriages, and the ring that holds them.
fn guides(rec: &RecordingStream, g: &Geometry) -> Outcome {
    let away = 2.0 * CARRIAGE_RADIUS + BALL_RADIUS;
    let ends = |limb: usize| {
        let joints = g.arm_limits.map(|q| g.elbow(limb, q));
        let along = (joints[1] - joints[0]).normalize();
        let across = along.cross(&Geometry::tangential(limb)) * away;
        [joints[0] - along * CARRIAGE_LENGTH + across, joints[1] + along * CARRIAGE_LENGTH + across].map(point)
    };
    let lines = a::LineStrips3D::new((0..ARMS).map(ends))
        .with_colors([color(STEEL)])
        .with_radii([0.6 * CARRIAGE_RADIUS as f32]);
    rec.log_static("world/base/guides", &lines)?;
    let (top, rim) = (g.mounting_height, g.base_radius + away);
    let ring = [(top, 0.9 * rim), (top, 1.1 * rim), (top + 0.01, 1.1 * rim), (top + 0.01, 0.9 * rim), (top, 0.9 * rim)];
    rec.log_static("world/base/flange", &Mesh::lathe(Vector3::zeros(), Vector3::z(), &ring).solid(SHELL))?;
    Ok(())
}

/// Logs the lever or carriage of a single axis.
fn lone(rec: &RecordingStream, joint: Joint) -> Outcome {
    let end = match joint {
        Joint::Revolute => Vector3::x() * LONE_SIZE,
        Joint::Prismatic => Vector3::z() * (0.5 * LONE_SIZE),
    };
    rod(rec, LONE, end, ARM_RADIUS)
}

/// Logs a rod from the body's origin to `end` (m), without colour: one for all times would hide those of [`paint`].
fn rod(rec: &RecordingStream, entity: &str, end: Vector3<f64>, radius: f64) -> Outcome {
    let length = end.norm();
    let Some(axis) = end.try_normalize(1e-9) else { return Ok(()) };
    let chamfer = (0.2 * radius).min(0.5 * length);
    let profile = [
        (0.0, 0.0),
        (0.0, radius - chamfer),
        (chamfer, radius),
        (length - chamfer, radius),
        (length, radius - chamfer),
        (length, 0.0),
    ];
    rec.log_static(entity, &Mesh::lathe(Vector3::zeros(), axis, &profile).bare())?;
    Ok(())
}

/// Logs an arm: hub on the motor's shaft, tapered beam, and at the elbow the bar with its two balls.
fn arm(rec: &RecordingStream, entity: &str, g: &Geometry) -> Outcome {
    if let Actuator::Prismatic { .. } = g.arms {
        return carriage(rec, entity, g);
    }
    let elbow = Vector3::x() * g.arm_length;
    let tube = (g.arm_length - ARM_TRIM).max(0.5 * g.arm_length);
    let half = 0.5 * g.pair_distance;
    let wide = 1.4 * ARM_RADIUS;
    let hub = Mesh::lathe(Vector3::zeros(), Vector3::y(), &[(-wide, 0.0), (-wide, wide), (wide, wide), (wide, 0.0)]);
    let beam = Mesh::beam(tube, [0.9 * ARM_RADIUS, 1.3 * ARM_RADIUS], [0.5 * ARM_RADIUS, 0.6 * ARM_RADIUS]);
    rec.log_static(entity, &hub.and(beam).bare())?;
    let neck = Mesh::lathe(Vector3::x() * tube, Vector3::x(), &[(0.0, 0.012), (g.arm_length - tube, 0.007)]);
    let bar = Mesh::lathe(elbow, Vector3::y(), &[(-half, 0.0), (-half, 0.006), (half, 0.006), (half, 0.0)]);
    rec.log_static(format!("{entity}/neck"), &neck.and(bar).solid(BRASS))?;
    let pair = Vector3::y() * half;
    balls(rec, entity, [elbow + pair, elbow - pair])
}

/// Logs a carriage: the block on its guide, and the bar with its two balls beside it.
fn carriage(rec: &RecordingStream, entity: &str, g: &Geometry) -> Outcome {
    let half = 0.5 * g.pair_distance;
    let (r, l) = (CARRIAGE_RADIUS, 0.5 * CARRIAGE_LENGTH);
    let guide = Vector3::z() * (2.0 * r + BALL_RADIUS);
    let block = Mesh::lathe(guide, Vector3::x(), &[(-l, 0.0), (-l, 1.6 * r), (l, 1.6 * r), (l, 0.0)]);
    rec.log_static(entity, &block.bare())?;
    let neck = Mesh::lathe(Vector3::zeros(), Vector3::z(), &[(0.0, 0.006), (2.0 * r, 0.008)]);
    let bar = Mesh::lathe(Vector3::zeros(), Vector3::y(), &[(-half, 0.0), (-half, 0.004), (half, 0.004), (half, 0.0)]);
    rec.log_static(format!("{entity}/neck"), &neck.and(bar).solid(BRASS))?;
    let pair = Vector3::y() * half;
    balls(rec, entity, [pair, -pair])
}

/// Logs a strut with a cup at either end, each an entity of its own so that it has its own colour.
fn strut(rec: &RecordingStream, entity: &str, length: f64) -> Outcome {
    let (depth, wall) = CUP;
    let (begin, end) = (depth, (length - depth).max(depth));
    let tube = [(begin, 0.0), (begin, STRUT_RADIUS), (end, STRUT_RADIUS), (end, 0.0)];
    rec.log_static(entity, &Mesh::lathe(Vector3::zeros(), Vector3::x(), &tube).bare())?;
    // Seen from outside: a bowl around the ball that narrows to the tube.
    let wide = BALL_RADIUS + wall;
    let bowl = [(-0.3 * depth, BALL_RADIUS), (-0.3 * depth, wide), (0.5 * depth, wide), (1.6 * depth, STRUT_RADIUS)];
    for (name, base, axis) in [(CUPS[0], 0.0, Vector3::x()), (CUPS[1], length, -Vector3::x())] {
        let cup = Mesh::lathe(Vector3::x() * base, axis, &bowl);
        rec.log_static(format!("{entity}/{name}"), &cup.bare())?;
    }
    Ok(())
}

/// Entities of the cups of a strut: at the elbow, at the platform.
const CUPS: [&str; 2] = ["cup_upper", "cup_lower"];

/// Logs the colours over time: of the arms by their residual, of struts and cups by the share of the hold that their
/// load uses.
fn paint(rec: &RecordingStream, entity: &str, scene: &Scene, b: usize) -> Outcome {
    let color = |[r, g, b]: [u8; 3]| rerun::Rgba32::from_rgb(r, g, b);
    let send = |entity: &str, colors: Vec<rerun::Rgba32>| -> Outcome {
        let colors = a::Mesh3D::update_fields().with_many_albedo_factor(colors);
        rec.send_columns(entity, [frames(&scene.times)], colors.columns_of_unit_batches()?)?;
        Ok(())
    };
    let always = |entity: &str, usual: [u8; 3]| -> Outcome {
        rec.log_static(entity, &a::Mesh3D::update_fields().with_albedo_factor(color(usual)))?;
        Ok(())
    };
    let axis = match b {
        ARM..STRUT => Some(b - ARM),
        TELESCOPE_UPPER | TELESCOPE_LOWER => Some(3),
        _ => None,
    };
    match (&scene.residual, axis) {
        (Some(residual), Some(axis)) => {
            return send(entity, residual.iter().map(|r| color(heat(r[axis]))).collect());
        }
        (None, Some(_)) => return always(entity, STEEL),
        _ if !(STRUT..PLATFORM).contains(&b) => return Ok(()),
        _ => {}
    }
    let s = b - STRUT;
    let is_loose = |k: usize| scene.loose.as_ref().is_some_and(|loose| loose[k][s]);
    let tint = |k: usize, used: f64, usual: [u8; 3]| color(if is_loose(k) { LOOSE } else { strain(usual, used) });
    let count = scene.times.len();
    let Some(used) = &scene.used else {
        for name in CUPS {
            always(&format!("{entity}/{name}"), STEEL)?;
        }
        return match &scene.loose {
            Some(_) => send(entity, (0..count).map(|k| tint(k, 0.0, CARBON)).collect()),
            None => always(entity, CARBON),
        };
    };
    let larger = |k: usize| used[k][s].max(used[k][STRUTS + s]);
    send(entity, (0..count).map(|k| tint(k, larger(k), CARBON)).collect())?;
    for (end, name) in CUPS.iter().enumerate() {
        let colors = (0..count).map(|k| tint(k, used[k][end * STRUTS + s], STEEL)).collect();
        send(&format!("{entity}/{name}"), colors)?;
    }
    Ok(())
}

/// Entity of the clamp spring of a pair at the elbow (`end` 0) or at the platform (1).
fn spring_entity(pair: usize, end: usize) -> String {
    format!("world/springs/pair{}_{}", pair + 1, ["upper", "lower"][end])
}

/// Logs the clamp springs between the struts of each pair, at the elbows and at the platform.
fn springs(rec: &RecordingStream, g: &Geometry) -> Outcome {
    let coil = spring([Vector3::zeros(), Vector3::x() * g.pair_distance], SPRINGS.1, SPRINGS.2);
    for (pair, end) in (0..ARMS).flat_map(|pair| [(pair, 0), (pair, 1)]) {
        let coil = a::LineStrips3D::new([coil.clone()]).with_colors([color(STEEL)]);
        rec.log_static(spring_entity(pair, end), &coil)?;
    }
    Ok(())
}

/// Logs where the springs are, from one strut of the pair to the other, and that there are none once a strut is loose.
fn springs_motion(rec: &RecordingStream, scene: &Scene) -> Outcome {
    for (pair, end) in (0..ARMS).flat_map(|pair| [(pair, 0), (pair, 1)]) {
        let place = Point3::from(Vector3::x() * [SPRINGS.0, scene.geometry.strut_length[pair] - SPRINGS.0][end]);
        let pose = |bodies: &[Isometry3<f64>; BODIES]| {
            let [from, to] = [0, 1].map(|k| bodies[STRUT + 2 * pair + k] * place);
            let turn = UnitQuaternion::rotation_between(&Vector3::x(), &(to - from)).unwrap_or_default();
            Isometry3::from_parts(from.coords.into(), turn)
        };
        let entity = spring_entity(pair, end);
        follow(rec, &EntityPath::from(entity.as_str()), &scene.times, scene.bodies.iter().map(pose))?;
        if let Some(loose) = &scene.loose {
            let radius = |open: &[bool; STRUTS]| if open[2 * pair] || open[2 * pair + 1] { 0.0 } else { WIRE };
            let columns = a::LineStrips3D::update_fields().with_radii(loose.iter().map(radius));
            rec.send_columns(entity, [frames(&scene.times)], columns.columns_of_unit_batches()?)?;
        } else {
            rec.log_static(entity, &a::LineStrips3D::update_fields().with_radii([WIRE]))?;
        }
    }
    Ok(())
}

fn platform(rec: &RecordingStream, entity: &str, g: &Geometry) -> Outcome {
    let corner = |s: usize| {
        let i = s / (STRUTS / ARMS);
        Geometry::radial(i) * g.platform_radius + Geometry::tangential(i) * g.pair_offset(s)
    };
    let corners = [1, 0, 3, 2, 5, 4].map(corner);
    balls(rec, entity, corners)?;
    let plate = Mesh::plate(&corners, 0.5 * PLATFORM_THICKNESS);
    let radius = (g.platform_radius - PLATFORM_INSET).max(0.5 * g.platform_radius) + PLATFORM_THICKNESS;
    let thick = PLATFORM_THICKNESS;
    let profile = [(-thick, 0.0), (-thick, 0.8 * radius), (0.0, radius), (thick, 0.8 * radius), (thick, 0.0)];
    let hub = Mesh::lathe(Vector3::zeros(), Vector3::z(), &profile);
    rec.log_static(format!("{entity}/hub"), &plate.and(hub).solid(ORANGE))?;
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

pub(super) fn point(v: Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// Colour of a part that uses the share `used` of its hold: its `usual` colour up to a half, yellow at three quarters, red
/// at the limit.
fn strain(usual: [u8; 3], used: f64) -> [u8; 3] {
    let stops = [usual, [240, 200, 60], [225, 40, 40]];
    let x = if used.is_finite() { (4.0 * (used - 0.5)).clamp(0.0, 2.0) } else { 2.0 };
    let i = (x as usize).min(1);
    let mix = |a: u8, b: u8| (f64::from(a) + (x - i as f64) * (f64::from(b) - f64::from(a))) as u8;
    std::array::from_fn(|c| mix(stops[i][c], stops[i + 1][c]))
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
    use super::{CARBON, heat, strain};

    #[test]
    fn strain_colours() {
        assert_eq!((strain(CARBON, 0.0), strain(CARBON, 0.5)), (CARBON, CARBON));
        assert_eq!((strain(CARBON, 0.75), strain(CARBON, 1.2)), ([240, 200, 60], [225, 40, 40]));
        assert_eq!(strain(CARBON, f64::NAN), [225, 40, 40]);
    }

    #[test]
    fn residual_colours() {
        assert_eq!(heat(0.5), [70, 170, 90]);
        assert_eq!(heat(-3.5), [240, 200, 60]);
        assert_eq!(heat(50.0), [215, 50, 45]);
        assert_eq!(heat(f64::NAN), [215, 50, 45]);
    }
}

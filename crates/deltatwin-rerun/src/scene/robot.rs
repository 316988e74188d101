//! The robots of a scene: the measured one, that of the later model, and their ghosts.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rerun::components::TransformFrameId;
use rerun::{EntityPath, RecordingStream, archetypes as a};

use super::content::Scene;
use super::known::Known;
use super::mesh::spring;
use super::solids::{BRASS, STEEL, balls, parts};
use super::{Outcome, assets, color, frames, paint, point, quaternion, things};
use deltatwin::cell::links::BALL_RADIUS;
use deltatwin::machine::bodies::{BodyKind, END_EFFECTOR, PLATFORM, ROTOR, SLOTS, body_kind, body_name, strut};
use deltatwin::machine::{Mechanism, PerAxis, PerStrut};
use deltatwin::model::MeshPart;

/// Roots of the robots' entities.
const ROBOT: &str = "world/robot";
const GHOST: &str = "world/ghost";
/// Everything below is of the later model.
pub(super) const AFTER: &str = "world/after";
const AFTER_ROBOT: &str = "world/after/robot";
const AFTER_GHOST: &str = "world/after/ghost";
/// What is of the first model alone.
pub(super) const BEFORE: [&str; 3] = [ROBOT, GHOST, "world/path"];

/// Distance of the clamp springs from the line of the balls, their radius, m, and turns; estimated.
const SPRINGS: (f64, f64, usize) = (0.035, 0.005, 12);
/// Radius of the springs' wire, m.
const WIRE: f32 = 0.0008;
/// Distance of a part of a ghost from the robot from which on it is shown, m.
const APART: f64 = 1e-3;
/// Size of a ghost that is not shown; zero is no transform.
const HIDDEN: f32 = 1e-6;
const PAYLOAD: [u8; 3] = [110, 150, 190];

/// A robot: its entities have a common root.
pub(super) struct Figure<'s> {
    pub root: &'static str,
    /// Poses, one set per frame.
    pub bodies: &'s [[Isometry3<f64>; SLOTS]],
    /// Residual that colours it.
    pub residual: Option<&'s [PerAxis<f64>]>,
    /// Whether it is transparent and of one colour.
    pub is_ghost: bool,
}

/// The robots of a scene.
pub(super) fn figures<'s>(scene: &'s Scene) -> Vec<Figure<'s>> {
    let figure = |root, bodies, residual| Figure { root, bodies, residual, is_ghost: false };
    let ghost = |root, bodies| Figure { root, bodies, residual: None, is_ghost: true };
    let mut all = vec![figure(ROBOT, scene.bodies.as_slice(), scene.residual.as_deref())];
    all.extend(scene.ghost.as_deref().map(|bodies| ghost(GHOST, bodies)));
    if let Some(after) = &scene.after {
        all.push(figure(AFTER_ROBOT, scene.bodies.as_slice(), Some(after.residual.as_slice())));
        all.extend(after.ghost.as_deref().map(|bodies| ghost(AFTER_GHOST, bodies)));
    }
    all
}

impl Figure<'_> {
    /// Whether it is shown, by frame: a ghost where it is apart from the robot.
    fn visible(&self, scene: &Scene) -> Vec<bool> {
        let pairs = scene.bodies.iter().zip(self.bodies);
        pairs.map(|(own, other)| !self.is_ghost || apart(scene, own, other) > APART).collect()
    }

    /// Entity of body `b`.
    pub fn entity(&self, scene: &Scene, b: usize) -> String {
        match scene.machine {
            Mechanism::Axis(_) => format!("{}/axis", self.root),
            Mechanism::Delta { .. } => format!("{}/{}", self.root, body_name(b)),
        }
    }
}

/// Bodies that are displayed.
pub(super) fn shown(scene: &Scene) -> impl Iterator<Item = usize> {
    let assembled = is_assembled(scene);
    let machine = scene.machine;
    (0..SLOTS)
        .filter(move |&b| machine.has_body(b) && b != ROTOR && (assembled || matches!(body_kind(b), BodyKind::Arm(_))))
}

/// Whether the robot is assembled: bodies of a disassembled robot are at the origin, which the platform never reaches.
pub(super) fn is_assembled(scene: &Scene) -> bool {
    let delta = matches!(scene.machine, Mechanism::Delta { .. });
    delta && scene.bodies.iter().any(|b| b[PLATFORM].translation.vector.norm() > 0.0)
}

/// The mesh that a user may give body `b`.
fn mesh_part(scene: &Scene, b: usize) -> Option<MeshPart> {
    if matches!(scene.machine, Mechanism::Axis(_)) {
        return Some(MeshPart::Axis);
    }
    Some(match body_kind(b) {
        BodyKind::Arm(_) => MeshPart::Arm,
        BodyKind::Strut(_) => MeshPart::Strut,
        BodyKind::Platform(0) => MeshPart::Platform,
        BodyKind::EndEffector => MeshPart::EndEffector,
        BodyKind::TelescopeUpper => MeshPart::TelescopeUpper,
        BodyKind::TelescopeLower => MeshPart::TelescopeLower,
        BodyKind::Platform(_) | BodyKind::Rotor | BodyKind::Link => return None,
    })
}

/// The user's mesh of body `b` of a robot that is no ghost.
pub(super) fn asset<'s>(scene: &'s Scene, figure: &Figure, b: usize) -> Option<&'s assets::Asset> {
    mesh_part(scene, b).filter(|_| !figure.is_ghost).and_then(|part| assets::of(scene, part))
}

/// Logs the shapes of the moving bodies.
pub(super) fn shapes(rec: &RecordingStream, scene: &Scene) -> Outcome {
    for figure in figures(scene) {
        for b in shown(scene) {
            body(rec, scene, &figure, b)?;
        }
        if is_assembled(scene) && !figure.is_ghost {
            springs(rec, scene, &figure)?;
        }
    }
    Ok(())
}

/// Logs the shape of body `b`.
fn body(rec: &RecordingStream, scene: &Scene, figure: &Figure, b: usize) -> Outcome {
    let entity = figure.entity(scene, b);
    let all = parts(scene, b);
    if let Some(asset) = asset(scene, figure, b) {
        let usual = all.first().map(|part| part.color).filter(|_| paint::of(scene, figure, b, "").is_none());
        asset.log(rec, &entity, usual)?;
    } else {
        for part in all {
            let mesh = part.mesh.bare();
            // A colour for all times would hide those that change.
            let mesh = match paint::of(scene, figure, b, part.name) {
                Some(_) => mesh,
                None => mesh.with_albedo_factor(paint::usual(figure, part.color)),
            };
            rec.log_static(paint::part_entity(&entity, part.name), &mesh)?;
        }
        let centres = balls(scene, b);
        if !centres.is_empty() && !figure.is_ghost {
            let balls = a::Points3D::new(centres.into_iter().map(point));
            let balls = balls.with_radii([BALL_RADIUS as f32]).with_colors([color(BRASS)]);
            rec.log_static(format!("{entity}/sockets"), &balls)?;
        }
    }
    if let (END_EFFECTOR, false, Some((shape, centre))) = (b, figure.is_ghost, &scene.payload) {
        let entity = EntityPath::from(format!("{entity}/payload"));
        rec.log_static(entity.clone(), &a::Transform3D::from_translation(point(*centre)))?;
        things::solid(rec, &entity, shape, PAYLOAD, "payload")?;
    }
    Ok(())
}

/// The clamp springs: pair, and at the elbow (0) or at the platform (1).
fn clamp_springs(scene: &Scene) -> impl Iterator<Item = (usize, usize)> {
    (0..scene.machine.limbs()).flat_map(|pair| [(pair, 0), (pair, 1)])
}

fn spring_entity(figure: &Figure, pair: usize, end: usize) -> String {
    format!("{}/springs/pair{}_{}", figure.root, pair + 1, ["upper", "lower"][end])
}

/// Logs the clamp springs between the struts of each pair.
fn springs(rec: &RecordingStream, scene: &Scene, figure: &Figure) -> Outcome {
    let coil = spring([Vector3::zeros(), Vector3::x() * scene.geometry.limbs[0].pair_distance], SPRINGS.1, SPRINGS.2);
    for (pair, end) in clamp_springs(scene) {
        let coil = a::LineStrips3D::new([coil.clone()]).with_colors([color(STEEL)]);
        let coil = if scene.loose.is_some() { coil } else { coil.with_radii([WIRE]) };
        rec.log_static(spring_entity(figure, pair, end), &coil)?;
    }
    Ok(())
}

/// Pose of a clamp spring, from one strut of the pair to the other.
fn spring_pose(scene: &Scene, bodies: &[Isometry3<f64>; SLOTS], pair: usize, end: usize) -> Isometry3<f64> {
    let place = Point3::from(Vector3::x() * [SPRINGS.0, scene.geometry.limbs[pair].strut_length - SPRINGS.0][end]);
    let [from, to] = [0, 1].map(|k| bodies[strut(2 * pair + k)] * place);
    let turn = UnitQuaternion::rotation_between(&Vector3::x(), &(to - from)).unwrap_or_default();
    Isometry3::from_parts(from.coords.into(), turn)
}

/// An entity that moves: its frame and its parent's, and its pose in every frame of the scene in which it is shown.
struct Mover {
    frames: [TransformFrameId; 2],
    poses: Vec<Option<Isometry3<f64>>>,
}

impl Mover {
    fn new(entity: impl Into<EntityPath>, poses: Vec<Option<Isometry3<f64>>>) -> Self {
        let entity = entity.into();
        let parent = entity.parent().unwrap_or_else(EntityPath::root);
        Self { frames: [&entity, &parent].map(TransformFrameId::from_entity_path), poses }
    }
}

/// Everything that moves in the scene.
fn movers(scene: &Scene) -> Vec<Mover> {
    let mut all = Vec::new();
    for figure in figures(scene) {
        let visible = figure.visible(scene);
        let of = |pose: &dyn Fn(&[Isometry3<f64>; SLOTS]) -> Isometry3<f64>| {
            figure.bodies.iter().zip(&visible).map(|(bodies, visible)| visible.then(|| pose(bodies))).collect()
        };
        all.extend(shown(scene).map(|b| Mover::new(figure.entity(scene, b), of(&|bodies| bodies[b]))));
        if is_assembled(scene) && !figure.is_ghost {
            let spring = |(pair, end)| {
                let poses = of(&|bodies| spring_pose(scene, bodies, pair, end));
                Mover::new(spring_entity(&figure, pair, end), poses)
            };
            all.extend(clamp_springs(scene).map(spring));
        }
    }
    all.extend(
        things::free(scene).map(|(entity, poses)| Mover::new(entity, poses.iter().copied().map(Some).collect())),
    );
    all
}

/// Logs the poses of all that moves, as one entity: its cost is that of one part.
pub(super) fn poses(rec: &RecordingStream, scene: &Scene) -> Outcome {
    let movers = movers(scene);
    let of_frame = |k: usize| movers.iter().filter_map(move |mover| Some((k, &mover.frames, mover.poses[k]?)));
    let rows: Vec<_> = (0..scene.times.len()).flat_map(of_frame).collect();
    let poses = a::Transform3D::update_fields()
        .with_many_translation(rows.iter().map(|(.., pose)| point(pose.translation.vector)))
        .with_many_quaternion(rows.iter().map(|(.., pose)| quaternion(pose)))
        .with_many_child_frame(rows.iter().map(|(_, frames, _)| frames[0].clone()))
        .with_many_parent_frame(rows.iter().map(|(_, frames, _)| frames[1].clone()));
    let times: Vec<f64> = rows.iter().map(|(k, ..)| scene.times[*k]).collect();
    rec.send_columns("world/poses", [frames(&times)], poses.columns_of_unit_batches()?)?;
    Ok(())
}

/// Logs when ghosts are shown, and that there are no springs once a strut is loose.
pub(super) fn appearance(rec: &RecordingStream, scene: &Scene, known: &mut Known) -> Outcome {
    for figure in figures(scene) {
        if figure.is_ghost {
            let sizes = figure.visible(scene).into_iter().map(|apart| if apart { 1.0f32 } else { HIDDEN }.to_bits());
            let (times, sizes) = known.changes(figure.root, &scene.times, sizes);
            if !times.is_empty() {
                let sizes = a::Transform3D::update_fields()
                    .with_many_scale(sizes.into_iter().map(|bits| [f32::from_bits(bits); 3]));
                rec.send_columns(figure.root, [frames(&times)], sizes.columns_of_unit_batches()?)?;
            }
            continue;
        }
        let Some(loose) = scene.loose.as_ref().filter(|_| is_assembled(scene)) else { continue };
        for (pair, end) in clamp_springs(scene) {
            let entity = spring_entity(&figure, pair, end);
            let radius = |open: &PerStrut<bool>| if open[2 * pair] || open[2 * pair + 1] { 0.0 } else { WIRE };
            let (times, radii) = known.changes(&entity, &scene.times, loose.iter().map(|open| radius(open).to_bits()));
            if !times.is_empty() {
                let columns = a::LineStrips3D::update_fields().with_radii(radii.into_iter().map(f32::from_bits));
                rec.send_columns(entity, [frames(&times)], columns.columns_of_unit_batches()?)?;
            }
        }
    }
    Ok(())
}

/// Largest distance between corresponding bodies, m; of a part that turns about its origin, between ends 0.3 m away.
fn apart(scene: &Scene, own: &[Isometry3<f64>; SLOTS], other: &[Isometry3<f64>; SLOTS]) -> f64 {
    let ends = [Point3::origin(), Point3::new(0.3, 0.0, 0.0)];
    let distance = |b: usize| ends.map(|end| (own[b] * end - other[b] * end).norm());
    shown(scene).flat_map(distance).fold(0.0, f64::max)
}

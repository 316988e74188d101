//! The objects around the robot.

use nalgebra::{Isometry3, Vector3};
use rerun::components::FillMode;
use rerun::{EntityPath, EntityPathPart, RecordingStream, archetypes as a};

use super::content::{Scene, Thing};
use super::{Outcome, color, point, quaternion};
use deltatwin::cell::{Mobility, Object, Shape};

const FIXED: [[u8; 3]; 3] = [[165, 150, 130], [110, 113, 116], [140, 140, 125]];
const BELT: [u8; 3] = [60, 95, 120];
const PRODUCTS: [[u8; 3]; 4] = [[200, 90, 110], [95, 170, 150], [205, 170, 90], [140, 120, 190]];

fn entity_of(object: &Object) -> EntityPath {
    EntityPath::from(["world", "objects", &object.name].map(EntityPathPart::new).to_vec())
}

/// Free objects: their entities and their poses, one per frame.
pub(super) fn free<'s>(scene: &'s Scene) -> impl Iterator<Item = (EntityPath, &'s [Isometry3<f64>])> {
    let free = |thing: &&Thing<'_>| matches!(thing.object.mobility, Mobility::Free { .. });
    scene.things.iter().filter(free).map(|thing| (entity_of(thing.object), thing.poses.as_slice()))
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
pub(super) fn solid(rec: &RecordingStream, entity: &EntityPath, shape: &Shape, rgb: [u8; 3], name: &str) -> Outcome {
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

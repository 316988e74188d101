use std::sync::Arc;

use deltatwin::cell::{Shape, Surface};

use super::*;
use crate::mesh::closed;
use crate::mesh::tests::block;

#[test]
fn the_table_carries_the_weight_of_a_box() {
    let object = |name: &str, size: [f64; 3], mobility, z| Object {
        name: name.into(),
        shape: Shape::Box { size: size.into() },
        mobility,
        position: Vector3::z() * z,
        yaw: 0.3,
        surface: Surface::default(),
    };
    let objects = [
        object("table", [1.0, 1.0, 0.1], Mobility::Fixed, -0.05),
        object("box", [0.1, 0.08, 0.06], Mobility::Free { mass: 0.4 }, 0.0301),
    ];
    let mut world = World::new(&objects, &[], Vector3::z() * -9.81);
    let h = 5e-4;
    let none = [(Vector3::zeros(), Vector3::zeros()); 2];
    (0..2000).for_each(|_| world.advance(h, &none));
    let impulse: f64 = world.rapier.contact_pairs().map(|p| p.total_impulse_magnitude()).sum();
    // 0.4·9.81 = 3.924 N
    approx::assert_relative_eq!(impulse / h, 3.924, max_relative = 1e-3);
    approx::assert_relative_eq!(world.objects[1].at.position, Vector3::z() * 0.03, epsilon = 2e-5);
    assert!(world.objects[1].at.velocity.norm() < 1e-6);
}

/// Slides a body of 2 kg along x at 2 m/s over a table with friction 0.3; returns its displacement (m) and its change
/// of yaw (rad).
fn slid(shape: Shape, half_height: f64, yaw: f64) -> (Vector3<f64>, f64) {
    let object = |name: &str, shape, mobility, z, yaw| Object {
        name: name.into(),
        shape,
        mobility,
        position: Vector3::z() * z,
        yaw,
        surface: Surface::default(),
    };
    let table = Shape::Box { size: Vector3::new(10.0, 10.0, 0.1) };
    let objects = [
        object("table", table, Mobility::Fixed, -0.05, 0.0),
        object("body", shape, Mobility::Free { mass: 2.0 }, half_height, yaw),
    ];
    let mut world = World::new(&objects, &[], Vector3::z() * -9.81);
    let none = [(Vector3::zeros(), Vector3::zeros()); 2];
    let run = |world: &mut World, seconds: f64| (0..(seconds / 5e-4) as usize).for_each(|_| world.advance(5e-4, &none));
    run(&mut world, 0.2);
    let start = world.objects[1].at;
    world.rapier.bodies.get_mut(world.objects[1].handle).unwrap().set_linvel(Vector::X * 2.0, true);
    run(&mut world, 1.0);
    let end = world.objects[1].at;
    assert!(end.velocity.norm() < 1e-9 && end.angular_velocity.norm() < 1e-9, "{end:?}");
    let turn = (start.rotation.transpose() * end.rotation)[(1, 0)].asin();
    (end.position - start.position, turn)
}

#[test]
fn sliding_is_braked_by_friction_times_weight() {
    // v²/(2 μ g) = 4/(2·0.3·9.81) = 0.679579 m, straight, for any inertia and yaw.
    let cuboid = |x: f64, y: f64, z: f64| Shape::Box { size: Vector3::new(x, y, z) };
    let (corners, triangles) = block(0.2, 0.02, 0.02);
    let hull = Shape::Mesh(Arc::new(closed(corners, triangles, true).unwrap().0));
    for (shape, half_height, yaw) in [
        (cuboid(0.1, 0.1, 0.1), 0.05, 0.0),
        (cuboid(0.1, 0.1, 0.1), 0.05, 0.4),
        (cuboid(0.2, 0.02, 0.02), 0.01, 0.785),
        (cuboid(0.04, 0.04, 0.08), 0.04, 0.3),
        (Shape::Cylinder { radius: 0.04, height: 0.06 }, 0.03, 0.0),
        (hull, 0.01, 0.785),
    ] {
        let (way, turn) = slid(shape.clone(), half_height, yaw);
        assert!((way.x - 0.679_579).abs() < 1e-3, "{shape:?}: {way:?}");
        assert!(way.y.abs() < 2e-3 && turn.abs() < 1e-2, "{shape:?}: {way:?}, {turn}");
    }
}

#[test]
fn the_force_on_a_kinematic_link_is_that_of_an_infinite_mass() {
    // The reason for a separate law between links and objects: a plastic impact of a link of 0.179 kg at 1 m/s on a box
    // of 0.2 kg at rest transfers 0.0945 N·s (0.179·0.2/0.379); in Rapier the box gets the full 1 m/s.
    let mut world = PhysicsWorld::new();
    world.gravity = Vector::ZERO;
    world.integration_parameters.dt = 5e-4;
    world.integration_parameters.length_unit = LENGTH_UNIT;
    let link = RigidBodyBuilder::kinematic_velocity_based().linvel(Vector::X);
    let capsule = ColliderBuilder::capsule_y(0.5, 0.008).mass(0.179);
    world.insert(link, capsule.active_collision_types(ActiveCollisionTypes::all()));
    let free = RigidBodyBuilder::dynamic().translation(Vector::X * 0.06);
    let (free, _) = world.insert(free, ColliderBuilder::cuboid(0.05, 0.05, 0.05).mass(0.2));
    let wall = RigidBodyBuilder::fixed().translation(Vector::X * -0.0575);
    let wall = world.insert(wall, ColliderBuilder::cuboid(0.05, 0.05, 0.05));
    (0..400).for_each(|_| world.step());
    let momentum = 0.2 * world.bodies[free].linvel().x;
    assert!(momentum > 0.2 - 1e-6, "{momentum}");
    // Against a fixed body there is no force at all, although the link starts half a millimetre inside.
    let impulse: f64 = world.contact_pairs_with(wall.1).map(|p| p.total_impulse_magnitude()).sum();
    assert_eq!(impulse, 0.0);
}

//! The objects as bodies of Rapier.

use nalgebra::{Isometry3, Matrix3, Rotation3, Vector3};
use rapier3d::dynamics::{FrictionModel, SpringCoefficients};
use rapier3d::prelude::{
    ActiveHooks, ColliderBuilder, ContactModificationContext, PhysicsHooks, PhysicsWorld, Pose, RigidBodyBuilder,
    RigidBodyHandle, Vector,
};

use super::hull::{Bounds, Hull, Placement};
use super::object::{Mobility, Object};
use crate::model::Inertia;

/// Typical size of an object, m; scales Rapier's tolerances.
const LENGTH_UNIT: f64 = 0.05;
/// Penetration that Rapier leaves uncorrected, m. Small, because a picked object takes it into our stiffer contact law.
const ALLOWED_PENETRATION: f64 = 1e-6;
/// Natural frequency of Rapier's contacts, Hz; for the same reason above its default of 30 Hz.
const CONTACT_FREQUENCY: f64 = 200.0;
/// Above any speed in the cell, m/s.
const MAX_SPEED: f64 = 1e3;
/// Longest step of Rapier, s.
const MAX_STEP: f64 = 1e-3;

/// An object and its state.
pub struct Body {
    /// As described by the scenario.
    pub object: Object,
    /// Collision geometry.
    pub hull: Hull,
    /// Inertia about its origin, the centre of mass; zero unless free.
    pub inertia: Inertia,
    /// False while it is held by the robot.
    pub present: bool,
    /// Pose and twist.
    pub at: Placement,
    /// Bounds at this pose.
    pub bounds: Bounds,
    handle: RigidBodyHandle,
    reach: f64,
}

impl Body {
    /// Velocity of the surface over the body, m/s.
    pub fn belt(&self) -> Vector3<f64> {
        if let Mobility::Conveyor { velocity } = self.object.mobility { velocity } else { Vector3::zeros() }
    }

    /// Whether it can be picked up.
    pub fn is_free(&self) -> bool {
        matches!(self.object.mobility, Mobility::Free { .. })
    }

    /// Bound on the speed of its points, m/s.
    pub fn speed(&self) -> f64 {
        self.at.velocity.norm() + self.at.angular_velocity.norm() * self.reach
    }

    /// Angular momentum about its origin, N·m·s, world axes.
    pub fn angular_momentum(&self) -> Vector3<f64> {
        self.at.rotation * (self.inertia.tensor * self.at.rotation.tr_mul(&self.at.angular_velocity))
    }
}

/// All objects.
pub struct World {
    /// In the order given.
    pub objects: Vec<Body>,
    rapier: PhysicsWorld,
    belts: Belts,
}

/// Surface velocity of the conveyors, by body.
struct Belts(Vec<(RigidBodyHandle, Vector3<f64>)>);

impl PhysicsHooks for Belts {
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext) {
        let belt = |body: Option<RigidBodyHandle>| {
            self.0.iter().find(|(h, _)| Some(*h) == body).map_or(Vector::ZERO, |(_, v)| glam(v))
        };
        let relative = belt(context.rigid_body1) - belt(context.rigid_body2);
        if let Some(contact) = context.rigid_mut() {
            let normal = *contact.normal;
            for point in contact.solver_contacts.iter_mut() {
                point.tangent_velocity = relative - normal * normal.dot(relative);
            }
        }
    }
}

impl World {
    /// Objects at their starts under `gravity`, m/s².
    pub fn new(objects: &[Object], gravity: Vector3<f64>) -> Self {
        let mut rapier = PhysicsWorld::new();
        rapier.gravity = glam(&gravity);
        let parameters = &mut rapier.integration_parameters;
        parameters.length_unit = LENGTH_UNIT;
        parameters.normalized_allowed_linear_error = ALLOWED_PENETRATION / LENGTH_UNIT;
        parameters.normalized_max_linear_velocity = MAX_SPEED / LENGTH_UNIT;
        parameters.contact_recycling = false;
        parameters.contact_softness = SpringCoefficients::new(CONTACT_FREQUENCY, 10.0);
        parameters.static_contact_softness = SpringCoefficients::new(CONTACT_FREQUENCY, 10.0);
        parameters.friction_model = FrictionModel::Coulomb;
        let mut world = Self { objects: Vec::with_capacity(objects.len()), rapier, belts: Belts(Vec::new()) };
        for object in objects {
            let at = Placement {
                rotation: *Rotation3::from_axis_angle(&Vector3::z_axis(), object.yaw).matrix(),
                position: object.position,
                velocity: Vector3::zeros(),
                angular_velocity: Vector3::zeros(),
            };
            let hull = Hull::solid(&object.shape);
            let inertia = match object.mobility {
                Mobility::Free { mass } => object.shape.inertia(mass),
                _ => Inertia::ZERO,
            };
            let bounds = hull.bounds(&at);
            world.objects.push(Body {
                object: object.clone(),
                bounds,
                reach: bounds.reach(&at.position),
                hull,
                inertia,
                present: false,
                at,
                handle: RigidBodyHandle::invalid(),
            });
            world.put(world.objects.len() - 1, at);
        }
        world
    }

    /// Gravity, m/s².
    pub fn gravity(&self) -> Vector3<f64> {
        own(&self.rapier.gravity)
    }

    /// Objects that are not held.
    pub fn present(&self) -> impl Iterator<Item = &Body> {
        self.objects.iter().filter(|o| o.present)
    }

    /// Free objects that are not held.
    pub fn free(&self) -> impl Iterator<Item = &Body> {
        self.present().filter(|o| o.is_free())
    }

    /// Index of the object called `name`.
    pub fn find(&self, name: &str) -> Option<usize> {
        self.objects.iter().position(|o| o.object.name == name)
    }

    /// Takes an object out of the world.
    pub fn take(&mut self, index: usize) {
        let object = &mut self.objects[index];
        object.present = false;
        self.rapier.remove_body(object.handle);
    }

    /// Puts an object into the world at `at`.
    pub fn put(&mut self, index: usize, at: Placement) {
        let object = &mut self.objects[index];
        let Some((shape, turn)) = object.hull.solid_shape() else { return };
        let builder = match object.object.mobility {
            Mobility::Free { .. } => RigidBodyBuilder::dynamic().can_sleep(false),
            Mobility::Fixed | Mobility::Conveyor { .. } => RigidBodyBuilder::fixed(),
        };
        let body = builder
            .pose(pose(&at.rotation, &at.position))
            .linvel(glam(&at.velocity))
            .angvel(glam(&at.angular_velocity));
        let hooks = match object.object.mobility {
            Mobility::Conveyor { .. } => ActiveHooks::MODIFY_SOLVER_CONTACTS,
            _ => ActiveHooks::empty(),
        };
        let collider = ColliderBuilder::new(shape)
            .position(pose(&turn, &Vector3::zeros()))
            .mass(object.inertia.mass)
            .friction(object.object.surface.friction)
            .active_hooks(hooks);
        (object.handle, _) = self.rapier.insert(body, collider);
        object.present = true;
        object.at = at;
        object.bounds = object.hull.bounds(&at);
        if let Mobility::Conveyor { velocity } = object.object.mobility {
            self.belts.0.push((object.handle, velocity));
        }
    }

    /// Moves the free objects on by `h` s under `loads`: force, and moment about its origin, on each object.
    pub fn advance(&mut self, h: f64, loads: &[(Vector3<f64>, Vector3<f64>)]) {
        if !(h > 0.0 && h.is_finite()) || self.free().next().is_none() {
            return;
        }
        for (object, (force, moment)) in self.objects.iter().zip(loads) {
            if let Some(body) = self.rapier.bodies.get_mut(object.handle)
                && body.is_dynamic()
            {
                body.reset_forces(false);
                body.reset_torques(false);
                body.add_force(glam(force), true);
                body.add_torque(glam(moment), true);
            }
        }
        let steps = (h / MAX_STEP).ceil().max(1.0);
        self.rapier.integration_parameters.dt = h / steps;
        for _ in 0..steps as usize {
            self.rapier.step_with_events(&self.belts, &());
        }
        for object in self.objects.iter_mut().filter(|o| o.present && o.is_free()) {
            let Some(body) = self.rapier.bodies.get(object.handle) else { continue };
            let pose: Isometry3<f64> = (*body.position()).into();
            object.at = Placement {
                rotation: *pose.rotation.to_rotation_matrix().matrix(),
                position: pose.translation.vector,
                velocity: own(&body.linvel()),
                angular_velocity: own(&body.angvel()),
            };
            object.bounds = object.hull.bounds(&object.at);
        }
    }
}

fn pose(rotation: &Matrix3<f64>, position: &Vector3<f64>) -> Pose {
    let rotation = Rotation3::from_matrix_unchecked(*rotation);
    Isometry3::from_parts((*position).into(), rotation.into()).into()
}

fn glam(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

fn own(v: &Vector) -> Vector3<f64> {
    Vector3::new(v.x, v.y, v.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::{Shape, Surface};

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
        let mut world = World::new(&objects, Vector3::z() * -9.81);
        let h = 5e-4;
        let none = [(Vector3::zeros(), Vector3::zeros()); 2];
        (0..2000).for_each(|_| world.advance(h, &none));
        let impulse: f64 = world.rapier.contact_pairs().map(|p| p.total_impulse_magnitude()).sum();
        // 0.4·9.81 = 3.924 N
        approx::assert_relative_eq!(impulse / h, 3.924, max_relative = 1e-3);
        approx::assert_relative_eq!(world.objects[1].at.position, Vector3::z() * 0.03, epsilon = 2e-5);
        assert!(world.objects[1].at.velocity.norm() < 1e-6);
    }
}

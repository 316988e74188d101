//! Modification of Rapier's contacts: moving belts, and friction opposite to the sliding velocity.

use nalgebra::Vector3;
use rapier3d::dynamics::{RigidBody, RigidBodySet};
use rapier3d::prelude::{
    ContactModificationContext, PairFilterContext, PhysicsHooks, RigidBodyHandle, SolverFlags, Vector,
};
use rapier3d::utils::AngularInertiaOps;

/// Surface velocities of the conveyors, m/s, by body.
#[derive(Default)]
pub struct Surfaces(pub Vec<(RigidBodyHandle, Vector3<f64>)>);

impl Surfaces {
    fn belt(&self, body: Option<RigidBodyHandle>) -> Vector {
        let found = self.0.iter().find(|(h, _)| Some(*h) == body);
        found.map_or(Vector::ZERO, |(_, v)| Vector::new(v.x, v.y, v.z))
    }
}

impl PhysicsHooks for Surfaces {
    /// Excludes the contacts of the robot's parts, the only ones with this hook, from Rapier's solver; the law in
    /// [`crate::law`] applies.
    fn filter_contact_pair(&self, _: &PairFilterContext) -> Option<SolverFlags> {
        None
    }

    /// Sets the target tangent velocity at every contact point.
    ///
    /// Rapier limits the impulse −K⁻¹u, which would stop the sliding velocity u, to μ times the normal impulse. K, the
    /// inverse mass at the point, is not a multiple of the identity off the line through the centre of mass, so that
    /// the limited impulse is not parallel to u: four corners of a sliding cube decelerate it with 0.936 μN. With K u/k
    /// in place of u, k half the trace of K, the impulse is −u/k, parallel to the sliding. At rest both vanish.
    fn modify_solver_contacts(&self, context: &mut ContactModificationContext) {
        let belts = self.belt(context.rigid_body1) - self.belt(context.rigid_body2);
        let bodies: &RigidBodySet = context.bodies;
        let sides = [context.rigid_body1, context.rigid_body2].map(|h| h.and_then(|h| bodies.get(h)));
        let Some(contact) = context.rigid_mut() else { return };
        let normal = *contact.normal;
        let tangential = |v: Vector| v - normal * normal.dot(v);
        let across = normal.any_orthonormal_vector();
        let frame = [across, normal.cross(across)];
        for point in contact.solver_contacts.iter_mut() {
            let at = (point.anchor1 + point.anchor2) * 0.5;
            let velocity = |side: Option<&RigidBody>| side.map_or(Vector::ZERO, |b| b.velocity_at_point(at));
            let sliding = tangential(velocity(sides[0]) - velocity(sides[1]) + belts);
            let k = |impulse: Vector| sides.iter().flatten().map(|b| response(b, at, impulse)).sum::<Vector>();
            let mean = 0.5 * frame.iter().map(|t| t.dot(k(*t))).sum::<f64>();
            point.tangent_velocity = tangential(belts);
            if mean > 0.0 {
                point.tangent_velocity += tangential(k(sliding)) / mean - sliding;
            }
        }
    }
}

/// Velocity change of the body's point `at` after an impulse (N·s) there, m/s.
fn response(body: &RigidBody, at: Vector, impulse: Vector) -> Vector {
    let mass = body.mass_properties();
    let arm = at - mass.world_com;
    let spin = mass.effective_world_inv_inertia.transform_vector(arm.cross(impulse));
    impulse * mass.effective_inv_mass + spin.cross(arm)
}

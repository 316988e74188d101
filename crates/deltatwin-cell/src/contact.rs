//! Sum of the loads of all contact points between two bodies.

use deltatwin::cell::Surface;
use deltatwin::twin::{Block, Resistance};
use nalgebra::Vector3;

use super::hull::Point;
use super::law;
use super::placement::Placement;

/// Force (N) and moment (N·m).
pub type Wrench = (Vector3<f64>, Vector3<f64>);

/// Adds a wrench about the same point to `sum`.
pub fn add(sum: &mut Wrench, wrench: &Wrench) {
    sum.0 += wrench.0;
    sum.1 += wrench.1;
}

/// The wrench about `origin` that is equivalent to `wrench` about the origin of `at`.
pub fn about(wrench: &Wrench, at: &Placement, origin: &Vector3<f64>) -> Wrench {
    (wrench.0, wrench.1 + (at.position - origin).cross(&wrench.0))
}

/// Loads of all contact points of a pair, each about the origin of its own body.
pub struct Loads {
    /// Sum of the normal forces, N.
    pub normal: f64,
    /// Their sum as vectors on the first body, N.
    pub pressure: Vector3<f64>,
    /// Centre of the contact points, weighted by their normal forces, m.
    pub centre: Vector3<f64>,
    /// Deepest penetration, m.
    pub depth: f64,
    /// Wrench on the first body.
    pub on_first: Wrench,
    /// Wrench on the second body.
    pub on_second: Wrench,
    /// Resistance to the motion of either body, about the origin of the inertial frame.
    pub resistance: Resistance,
}

/// Adds `factor`·j·jᵀ with the direction `along` at `point` (m), j = (along, point × along).
fn stiffen(block: &mut Block, factor: f64, along: &Vector3<f64>, point: &Vector3<f64>) {
    let turning = point.cross(along);
    let j = [along.x, along.y, along.z, turning.x, turning.y, turning.z];
    for (row, x) in block.iter_mut().zip(j) {
        for (entry, y) in row.iter_mut().zip(j) {
            *entry += factor * x * y;
        }
    }
}

/// Adds the resistance of a contact point with its normal force (N), the velocity of the loaded body there and the
/// relative angular velocity.
fn resist(
    sum: &mut Resistance,
    surface: &Surface,
    p: &Point,
    (normal, velocity, spin): (f64, &Vector3<f64>, &Vector3<f64>),
) {
    if normal <= 0.0 {
        return;
    }
    let sliding = velocity - p.normal * p.normal.dot(velocity);
    let slopes = law::slopes(surface, p.weight, p.depth, normal, sliding.norm(), spin.norm());
    let along = sliding.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(|| any_across(&p.normal));
    let across = p.normal.cross(&along);
    stiffen(&mut sum.stiffness, slopes.normal.0, &p.normal, &p.position);
    for (factor, direction) in [(slopes.normal.1, &p.normal), (slopes.sliding.0, &along), (slopes.sliding.1, &across)] {
        stiffen(&mut sum.damping, factor, direction, &p.position);
    }
    for k in 3..6 {
        sum.damping[k][k] += slopes.rolling;
    }
}

/// A unit vector across `normal`.
fn any_across(normal: &Vector3<f64>) -> Vector3<f64> {
    let least = normal.iamin();
    let axis = Vector3::from_fn(|k, _| if k == least { 1.0 } else { 0.0 });
    (axis - normal * normal[least]).normalize()
}

/// Loads at the contact points of body `a` with body `b`, whose surface moves relative to it with velocity `belt`
/// (m/s).
pub fn press(points: &[Point], surface: &Surface, a: &Placement, b: &Placement, belt: &Vector3<f64>) -> Loads {
    let none = (Vector3::zeros(), Vector3::zeros());
    let mut loads = Loads {
        normal: 0.0,
        pressure: Vector3::zeros(),
        centre: Vector3::zeros(),
        depth: 0.0,
        on_first: none,
        on_second: none,
        resistance: Resistance::NONE,
    };
    let spin = a.angular_velocity - b.angular_velocity;
    for p in points {
        let surface_velocity = b.velocity_at(&p.position) + belt - p.normal * p.normal.dot(belt);
        let velocity = a.velocity_at(&p.position) - surface_velocity;
        let load = law::load(surface, p.weight, p.depth, &p.normal, &velocity, &spin);
        resist(&mut loads.resistance, surface, p, (load.normal, &velocity, &spin));
        loads.normal += load.normal;
        loads.pressure += p.normal * load.normal;
        loads.centre += p.position * load.normal;
        loads.depth = loads.depth.max(p.depth);
        let (on_first, on_second) = (&mut loads.on_first, &mut loads.on_second);
        add(on_first, &(load.force, (p.position - a.position).cross(&load.force) + load.moment));
        add(on_second, &(-load.force, -(p.position - b.position).cross(&load.force) - load.moment));
    }
    if loads.normal > 0.0 {
        loads.centre /= loads.normal;
    }
    loads
}

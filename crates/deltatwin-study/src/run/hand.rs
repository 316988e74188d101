//! The customary estimate by hand, and where and why the twin differs from it.

use deltatwin::constraint_forces::{Detail, Loads, Statics, constraint_forces};
use deltatwin::dynamics::Plant;
use deltatwin::kinematics::Motion;
use deltatwin::machine::bodies::END_EFFECTOR;
use deltatwin::machine::{each, six_struts};
use deltatwin::scenario::DesiredMotion;
use deltatwin::twin::Sample;
use deltatwin::twin::sockets::socket_name;
use nalgebra::Vector3;

use super::verdict::Hand;

/// Spacing of the estimate, s.
const SPACING: f64 = 2e-3;
/// Difference from the estimate that is explained, relative to it.
const EXPLAINED: f64 = 0.1;

/// Load of the payload on the plate: force (N) and its moment about the plate's origin (N·m).
///
/// F = m (g − a) at the centre of mass, and the rate of the spin about the vertical.
pub fn payload_load(plant: &Plant, motion: &Motion) -> (Vector3<f64>, Vector3<f64>) {
    let payload = &plant.payload;
    let (hand, origin) = (&motion.bodies[END_EFFECTOR], motion.origin(&plant.geometry.plate));
    let lever = hand.rotation * payload.com;
    let (omega, alpha) = (hand.angular_velocity, hand.angular_acceleration);
    let acceleration = hand.acceleration + alpha.cross(&lever) + omega.cross(&omega.cross(&lever));
    let force = (plant.gravity_vector() - acceleration) * payload.mass;
    let tensor = hand.rotation * payload.tensor * hand.rotation.transpose();
    let spin = tensor * alpha + omega.cross(&(tensor * omega));
    (force, (hand.position + lever - origin).cross(&force) - spin)
}

/// The estimate for a desired motion of `duration` s, compared with the `trace` of the unlimited twin; `None` without
/// payload or struts.
///
/// `hold` (N) is the force to which the margin is related.
pub fn estimate(plant: &Plant, desired: &DesiredMotion, duration: f64, trace: &[Sample], hold: f64) -> Option<Hand> {
    if !plant.assembled || plant.payload.mass <= 0.0 {
        return None;
    }
    let at = |t: f64| desired.at(t).joints(&plant.geometry).ok().and_then(|joints| plant.motion(&joints).ok());
    let (mut torque, mut time) = (0.0, 0.0);
    let steps = (duration / SPACING).ceil().max(1.0) as usize;
    for k in 0..=steps {
        let t = k as f64 * SPACING;
        let Some(motion) = at(t) else { break };
        let tilting = payload_load(plant, &motion).1.xy().norm();
        if tilting > torque {
            (torque, time) = (tilting, t);
        }
    }
    let force = torque / plant.geometry.limbs[0].pair_distance;
    let (twin_force, socket, when) = peak(plant.mechanism.struts(), trace);
    let excess = (force > 0.0).then(|| twin_force / force - 1.0);
    let mut why = String::new();
    if plant.is_closed_delta()
        && excess.is_some_and(|e| e.abs() > EXPLAINED)
        && let Some(motion) = at(when)
    {
        why = explained(plant, &motion, (socket, twin_force, when)).unwrap_or_default();
    }
    Some(Hand { torque, time, force, margin: 1.0 - force / hold, twin_force, excess, why })
}

/// Largest axial strut force (N), its socket and its time (s).
fn peak(struts: usize, trace: &[Sample]) -> (f64, usize, f64) {
    let mut most = (0.0, 0, 0.0);
    for sample in trace {
        let forces = sample.strut_force.iter().flat_map(|end| &end[..struts]);
        for (socket, force) in forces.enumerate() {
            if force.abs() > most.0 {
                most = (force.abs(), socket, sample.t);
            }
        }
    }
    most
}

/// Parts of a strut's force at one instant, of three limbs: what the tilting torque causes there, and what the estimate omits.
fn explained(plant: &Plant, motion: &Motion, (socket, force, time): (usize, f64, f64)) -> Option<String> {
    let struts = six_struts().len();
    let strut = socket % struts;
    let statics = Statics::of(plant, motion, Detail::Complete).ok()?;
    let none = (Vector3::zeros(), Vector3::zeros());
    let (weight, moment) = payload_load(plant, motion);
    let tilting = Vector3::new(moment.x, moment.y, 0.0);
    let alone = |platform| {
        let loads = Loads { end_effector: none, platform, struts: each(0.0), arms: each(0.0) };
        statics.solve(&loads).lambda_p[strut]
    };
    let (couple, carried) = (alone((Vector3::zeros(), tilting)), alone((weight, Vector3::zeros())));
    let own = plant.steady_states(0.0, motion);
    let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
    let all = constraint_forces(plant, 0.0, motion, &states, Detail::Complete).ok()?;
    let rigid = if socket < struts { all.lambda_s[strut] } else { all.lambda_p[strut] };
    let sign = rigid.signum();
    let [couple, carried, total] = [couple, carried, rigid].map(|x| sign * x);
    let hand = tilting.norm() / plant.geometry.limbs[0].pair_distance;
    let incline = motion.strut_axis[strut].z.abs().acos().to_degrees();
    Some(format!(
        "{} at {time:.3} s: {force:.0} N, of which the tilting torque causes {couple:.0} N (three pairs share the \
         {hand:.0} N of the formula, struts {incline:.0}° from the vertical), weight and acceleration of the payload \
         {carried:.0} N, platform, struts, telescope and friction {:.0} N, the control loop {:.0} N; the formula has none \
         of the last three",
        socket_name(socket, struts),
        total - couple - carried,
        force - total
    ))
}

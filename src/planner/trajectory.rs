//! A planned motion as a look-up table at the control period (section 5.2 of the paper).

use super::{Machine, PathPoint, Plan, PlanError};
use crate::constraint_forces::{Detail, constraint_forces};
use crate::machine::{AXES, STRUTS, Setup};
use crate::recording::{Channel, Recording, Signals};

/// Recording of the plan with a row every `period` s: q, q̇, q̈, torques, strut forces, platform position, ṡ and s̈,
/// all at the same place of the path.
///
/// The motion is slowed down by less than one period in total, so that it ends on a row.
///
/// # Errors
///
/// [`PlanError::Place`] where the robot cannot follow the path.
pub fn trajectory(
    machine: &Machine,
    plan: &Plan,
    setup: &Setup,
    period: f64,
    name: &str,
) -> Result<Recording, PlanError> {
    let curve = &plan.curve;
    let rows = (plan.time / period).ceil().max(1.0);
    let stretch = rows * period / plan.time;
    let times: Vec<f64> = (0..=rows as usize).map(|k| k as f64 * period).collect();
    let [mut q, mut qd, mut qdd, mut tau]: [Vec<[f64; AXES]>; 4] = Default::default();
    let [mut upper, mut lower]: [Vec<[f64; STRUTS]>; 2] = Default::default();
    let mut ee: Vec<[f64; 3]> = Vec::new();
    for [s, speed, acceleration] in plan.profile.sample(times.iter().map(|t| t / stretch)) {
        let place = |pose| PlanError::Place {
            s: curve.way(s)[0],
            at: curve.at(s)[0].into(),
            reason: super::PlaceError::Pose(pose),
        };
        let plant = machine.plant();
        let point = PathPoint::new(&plant.geometry, curve, s).map_err(place)?;
        let motion = point.motion(&plant.geometry, speed / stretch, acceleration / (stretch * stretch));
        let own = plant.steady_states(0.0, &motion);
        let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        let loads = constraint_forces(plant, 0.0, &motion, &states, Detail::Complete).map_err(place)?.output();
        q.push(motion.q);
        qd.push(motion.qd);
        qdd.push(motion.qdd);
        tau.push(loads.tau);
        ee.push([point.r[0].x, point.r[0].y, point.r[0].z]);
        upper.push(std::array::from_fn(|s| loads.reactions.upper[s]));
        lower.push(std::array::from_fn(|s| loads.reactions.lower[s]));
    }
    let mut out = Signals::new(machine.plant().mechanism, times);
    out.set_rows(Channel::Angle, &q);
    out.set_rows(Channel::Rate, &qd);
    out.set_rows(Channel::Acceleration, &qdd);
    out.set_rows(Channel::Torque, &tau);
    out.set_rows(Channel::StrutUpper, &upper);
    out.set_rows(Channel::StrutLower, &lower);
    out.set_rows(Channel::EndEffector, &ee);
    Ok(Recording { name: name.into(), signals: out, setup: *setup })
}

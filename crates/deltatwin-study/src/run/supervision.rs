//! Which supervision would have noticed a failure, and how early.
//!
//! Thresholds are those of the scenario where it states them; the others are customary ones: a quarter of a drive's
//! torque as feedback, 0.02 rad (1.1°) of following error, and 80 % of the dislocation force as strut force (160 N of
//! 200 N in the shipped models: what ABB's own cycles need).

use deltatwin::constraint_forces::{Detail, constraint_forces};
use deltatwin::dynamics::Plant;
use deltatwin::machine::{STRUTS, Unit};
use deltatwin::model::Model;
use deltatwin::scenario::{DesiredMotion, Supervision};
use deltatwin::text::significant;
use deltatwin::twin::{Report, Sample, TripCause};

use super::verdict::Notice;

/// Customary threshold of the feedback torque, as a share of the drive's torque.
const FEEDBACK: f64 = 0.25;
/// Customary threshold of the following error, rad.
pub const ERROR: f64 = 0.02;
/// Customary threshold of strut forces, as a share of the dislocation force.
const STRUT: f64 = 0.8;
/// Spacing of the check of the plan, s.
const SPACING: f64 = 4e-3;

/// Threshold, and whether the scenario states it.
fn threshold(stated: Option<f64>, customary: f64) -> (f64, bool) {
    stated.map_or((customary, false), |limit| (limit, true))
}

/// All supervisions in the order in which they notice the failure at `failed` (s); those that never notice it last.
pub fn notices(
    model: &Model,
    supervision: &Supervision,
    (desired, believed): (&DesiredMotion, &Plant),
    report: &Report,
    failed: f64,
) -> Vec<Notice> {
    let machine = model.mechanism;
    let arms = machine.arms();
    let (torque, angle) = (machine.unit(Unit::NM), machine.unit(Unit::Rad));
    let mut out = Vec::new();
    let mut add = |what: String, stated: bool, time: Option<f64>| {
        out.push(Notice { what, stated, time, lead: time.map(|t| failed - t) });
    };
    let trace = &report.trace;
    let first = |beyond: &dyn Fn(&Sample) -> bool| trace.iter().find(|s| beyond(s)).map(|s| s.t);
    let (limit, stated) = threshold(supervision.torque, FEEDBACK * model.drives[0].max_torque);
    add(
        format!("feedback torque of an arm above {} {torque}", significant(limit, 3)),
        stated,
        first(&|s| s.feedback[..arms].iter().any(|f| f.abs() > limit)),
    );
    let (limit, stated) = threshold(supervision.tracking, ERROR);
    add(
        format!("following error of an arm above {} {angle}", significant(limit, 3)),
        stated,
        first(&|s| s.error[..arms].iter().any(|e| e.abs() > limit)),
    );
    if model.assembled {
        let limit = STRUT * model.sockets.dislocation_force;
        add(
            format!("strut force sensors above {} N", significant(limit, 3)),
            false,
            first(&|s| s.strut_force.iter().flatten().any(|f| f.abs() > limit)),
        );
        let refused = of_the_plan(believed, desired, failed).is_some_and(|force| force > limit);
        add(
            format!("strut forces of the plan above {} N, before the start", significant(limit, 3)),
            false,
            refused.then_some(0.0),
        );
        let lost = report.trip.filter(|(_, cause)| *cause == TripCause::Socket).map(|(t, _)| t);
        add("drives trip as a socket has left".into(), true, lost);
    }
    out.sort_by(|a, b| a.time.unwrap_or(f64::INFINITY).total_cmp(&b.time.unwrap_or(f64::INFINITY)));
    out
}

/// Largest strut force (N) that the controller's model predicts along the desired motion until `end` (s).
fn of_the_plan(believed: &Plant, desired: &DesiredMotion, end: f64) -> Option<f64> {
    let steps = (end / SPACING).ceil().max(1.0) as usize;
    let mut most = None;
    for k in 0..=steps {
        let Ok(joints) = desired.at(k as f64 * SPACING).joints(&believed.geometry) else { break };
        let Ok(motion) = believed.motion(&joints) else { break };
        let own = believed.steady_states(0.0, &motion);
        let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        let Ok(loads) = constraint_forces(believed, 0.0, &motion, &states, Detail::Complete) else { break };
        let peak = (0..STRUTS).map(|s| loads.lambda_p[s].abs().max(loads.lambda_s[s].abs())).fold(0.0, f64::max);
        most = Some(f64::max(most.unwrap_or(0.0), peak));
    }
    most
}

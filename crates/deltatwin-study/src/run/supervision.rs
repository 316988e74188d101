//! Which supervision would have noticed a failure, and how early.
//!
//! Thresholds are those of the scenario where it states them; the others are customary ones: a quarter of a drive's
//! torque as feedback, 0.02 rad (1.1°) of following error, and 80 % of the nominal dislocation force as strut force
//! (160 N of 200 N in the shipped models: what ABB's own cycles need) or, by the criterion of the sockets, a fifth of it as
//! margin. What a plan predicts is known before the motion starts.

use deltatwin::machine::Unit;
use deltatwin::scenario::DesiredMotion;
use deltatwin::text::significant;
use deltatwin::twin::{Clamps, Report, Sample, TripCause};

use super::Case;
use super::verdict::Notice;

/// Customary threshold of the feedback torque, as a share of the drive's torque.
const FEEDBACK: f64 = 0.25;
/// Customary threshold of the following error, rad.
pub const ERROR: f64 = 0.02;
/// Customary threshold of strut forces, as a share of the nominal dislocation force.
const STRUT: f64 = 0.8;
/// Spacing of the check of the plan, s.
const SPACING: f64 = 4e-3;

/// Threshold, and whether the scenario states it.
fn threshold(stated: Option<f64>, customary: f64) -> (f64, bool) {
    stated.map_or((customary, false), |limit| (limit, true))
}

/// All supervisions in the order in which they notice the failure at `failed` (s); those that never notice it last.
pub fn notices(case: &Case, desired: &DesiredMotion, report: &Report, failed: f64) -> Vec<Notice> {
    let (model, supervision) = (&case.model, &case.scenario.supervision);
    let machine = model.mechanism;
    let arms = machine.arms();
    let (torque, angle) = (machine.unit(Unit::NM), machine.unit(Unit::Rad));
    let mut out = Vec::new();
    let mut add = |what: String, stated: bool, time: Option<f64>| {
        out.push(Notice { what, stated, time, lead: time.map(|t| failed - t).filter(|lead| *lead >= 0.0) });
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
        let hold = case.nominal.dislocation_force;
        let (limit, left) = (STRUT * hold, (1.0 - STRUT) * hold);
        add(
            format!("strut force sensors above {} N", significant(limit, 3)),
            false,
            first(&|s| s.strut_force.iter().flatten().any(|f| f.abs() > limit)),
        );
        let plan = of_the_plan(case, desired);
        let refused = plan.is_some_and(|plan| plan.force > limit);
        add(
            format!("strut forces of the plan above {} N, before the start", significant(limit, 3)),
            false,
            refused.then_some(0.0),
        );
        let refused = plan.is_some_and(|plan| plan.margin < left);
        add(
            format!("margin of a socket in the plan below {} N, before the start", significant(left, 3)),
            false,
            refused.then_some(0.0),
        );
        let lost = report.trip.filter(|(_, cause)| *cause == TripCause::Socket).map(|(t, _)| t);
        add("drives trip as a socket has left".into(), true, lost);
    }
    out.sort_by(|a, b| a.time.unwrap_or(f64::INFINITY).total_cmp(&b.time.unwrap_or(f64::INFINITY)));
    out
}

/// What the controller's model predicts along a desired motion.
#[derive(Clone, Copy)]
struct Plan {
    /// Largest axial strut force, N.
    force: f64,
    /// Least margin of a nominal ball socket, N.
    margin: f64,
}

/// The prediction for the whole motion, which is known before it starts; `None` if it cannot be planned at all.
fn of_the_plan(case: &Case, desired: &DesiredMotion) -> Option<Plan> {
    let (believed, clamps) = (case.believed(), Clamps::watched(&case.nominal));
    let end = case.scenario.motion.length().unwrap_or(f64::INFINITY).min(case.scenario.duration);
    let steps = (end / SPACING).ceil().max(1.0) as usize;
    let mut plan = None;
    for k in 0..=steps {
        let joints = desired.at(k as f64 * SPACING).joints(&believed.geometry);
        let motion = joints.and_then(|joints| believed.motion(&joints));
        let Ok((output, margins)) = motion.and_then(|motion| clamps.along(&believed, 0.0, &motion)) else { break };
        let forces = output.reactions.upper.into_iter().chain(output.reactions.lower);
        let Plan { force, margin } = plan.unwrap_or(Plan { force: 0.0, margin: f64::INFINITY });
        plan = Some(Plan {
            force: forces.map(f64::abs).fold(force, f64::max),
            margin: margins.into_iter().fold(margin, f64::min),
        });
    }
    plan
}

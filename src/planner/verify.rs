//! Checks a found motion against the full nonlinear model on a grid finer than that of the plan.

use rayon::prelude::*;

use super::limits::{Limit, Limits, QUANTITIES};
use super::{Curve, Machine, PathPoint, PlaceError, PlanError, Profile};
use crate::model::AXES;

/// All limited quantities at a place, in units of what may be used (drive speeds, then as in [`Limit::affine`], then jerks).
pub const CHECKED: usize = AXES + QUANTITIES + AXES;

/// Number `k` of the checked quantities.
pub fn checked(k: usize) -> Limit {
    const JERK: usize = AXES + QUANTITIES;
    match k {
        0..AXES => Limit::Speed(k),
        AXES..JERK => Limit::affine(k - AXES),
        _ => Limit::Jerk(k - JERK),
    }
}

/// Use of the limits at a place within an interval.
#[derive(Clone, Debug)]
pub struct Use {
    /// Interval of the plan.
    pub interval: usize,
    /// Path parameter.
    pub s: f64,
    /// |value| over what may be used, per checked quantity.
    pub ratio: [f64; CHECKED],
    /// Values themselves.
    pub value: [f64; CHECKED],
}

/// Uses at `points` + 1 evenly spaced places of every interval, both ends included.
pub fn uses(
    machine: &Machine,
    curve: &Curve,
    limits: &Limits,
    profile: &Profile,
    points: usize,
) -> Result<Vec<Use>, PlanError> {
    let usable = limits.usable();
    let geometry = &machine.plant().geometry;
    let one = |k: usize| {
        let (interval, part) = (k / (points + 1), k % (points + 1));
        let h = profile.s[interval + 1] - profile.s[interval];
        let sigma = h * part as f64 / points as f64;
        let s = profile.s[interval] + sigma;
        let pace = profile.at(interval, sigma);
        let place = |source| PlanError::Place { s, at: curve.at(s)[0].into(), source };
        let point = PathPoint::new(geometry, curve, s).map_err(|e| place(PlaceError::Pose(e)))?;
        point.check(geometry).map_err(place)?;
        let speed = pace.z.sqrt();
        let motion = point.motion(geometry, speed, pace.acceleration);
        let loads = machine.loads(&motion).map_err(|e| place(PlaceError::Pose(e)))?;
        let mut value = [0.0; CHECKED];
        let mut ratio = [0.0; CHECKED];
        for i in 0..AXES {
            let [_, q1, q2, q3] = point.q.map(|q| q[i]);
            value[i] = motion.qd[i];
            ratio[i] = value[i].abs() / limits.speed[i];
            value[AXES + i] = motion.qdd[i];
            let jerk = AXES + QUANTITIES + i;
            value[jerk] = q3 * speed.powi(3) + 3.0 * q2 * speed * pace.acceleration + q1 * pace.jerk;
            ratio[jerk] = value[jerk].abs() / limits.jerk[i];
        }
        value[2 * AXES..AXES + QUANTITIES].copy_from_slice(&loads);
        for q in 0..QUANTITIES {
            ratio[AXES + q] = value[AXES + q].abs() / usable[q];
        }
        Ok(Use { interval, s, ratio, value })
    };
    (0..profile.pieces.len() * (points + 1)).into_par_iter().map(one).collect()
}

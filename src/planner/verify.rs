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

/// Places of an interval where a drive reverses at `s`: Coulomb friction changes there within δs = ε/(|q″| ṡ).
const AROUND: [f64; 7] = [-4.0, -1.5, -0.5, 0.0, 0.5, 1.5, 4.0];
/// Rate ε over which it changes, rad/s.
const REVERSAL: f64 = 0.02;

/// Places in interval `i`: `points` + 1 evenly spaced ones with both ends, and more where drives reverse.
fn places(machine: &Machine, curve: &Curve, profile: &Profile, i: usize, points: usize) -> Vec<f64> {
    let h = profile.s[i + 1] - profile.s[i];
    let mut out: Vec<f64> = (0..=points).map(|k| h * k as f64 / points as f64).collect();
    let rates =
        |sigma: f64| PathPoint::new(&machine.plant().geometry, curve, profile.s[i] + sigma).map(|p| [p.q[1], p.q[2]]);
    let (Ok([start, _]), Ok([end, _])) = (rates(0.0), rates(h)) else { return out };
    for axis in (0..AXES).filter(|&k| start[k] * end[k] < 0.0) {
        let (mut low, mut high) = (0.0, h);
        for _ in 0..30 {
            let middle = 0.5 * (low + high);
            match rates(middle) {
                Ok([rate, _]) if rate[axis] * start[axis] > 0.0 => low = middle,
                Ok(_) => high = middle,
                Err(_) => return out,
            }
        }
        let Ok([_, bend]) = rates(low) else { return out };
        let width = REVERSAL / (bend[axis].abs() * profile.at(i, low).z.sqrt()).max(f64::MIN_POSITIVE);
        out.extend(AROUND.map(|k| low + k * width).into_iter().filter(|sigma| (0.0..=h).contains(sigma)));
    }
    out.sort_by(f64::total_cmp);
    out
}

/// Uses at `points` + 1 evenly spaced places of every interval, both ends included, and where drives reverse.
pub fn uses(
    machine: &Machine,
    curve: &Curve,
    limits: &Limits,
    profile: &Profile,
    points: usize,
) -> Result<Vec<Use>, PlanError> {
    let usable = limits.usable();
    let geometry = &machine.plant().geometry;
    let one = |interval: usize, sigma: f64| {
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
    let interval = |i: usize| -> Result<Vec<Use>, PlanError> {
        places(machine, curve, profile, i, points).into_iter().map(|sigma| one(i, sigma)).collect()
    };
    let all: Vec<Vec<Use>> = (0..profile.pieces.len()).into_par_iter().map(interval).collect::<Result<_, _>>()?;
    Ok(all.into_iter().flatten().collect())
}

//! Check of a motion against the full nonlinear model on a grid finer than that of the plan.

use super::limits::{DYNAMIC, Limit, Limits, QUANTITIES};
use super::{Curve, Machine, PathPoint, PlaceError, PlanError, Profile};
use crate::machine::{axes_from, every_axis};
use crate::numerics::{bisect, parallel};

/// Number of checked quantities: drive speeds, then as in [`Limit::affine`], then drive jerks.
pub const CHECKED: usize = axes_from(JERK).end;
/// First of those as in [`Limit::affine`].
pub const AFFINE: usize = every_axis().end;
/// First drive jerk.
pub const JERK: usize = AFFINE + QUANTITIES;

/// The limit of checked quantity `k`.
pub fn checked(k: usize) -> Limit {
    match k {
        ..AFFINE => Limit::Speed(k),
        AFFINE..JERK => Limit::affine(k - AFFINE),
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
    /// |value| relative to the usable limit, per checked quantity.
    pub ratio: [f64; CHECKED],
    /// Values in the units of [`Limit::unit`].
    pub value: [f64; CHECKED],
}

impl Use {
    /// Every limit with its use.
    pub fn limits(&self) -> impl Iterator<Item = (Limit, f64)> + '_ {
        self.ratio.iter().enumerate().map(|(k, ratio)| (checked(k), *ratio))
    }
}

/// Distances of the checked places from a reversal of a drive or the telescope, in units of the distance δs = ε/(|q″|
/// ṡ) over which Coulomb friction changes sign.
const REVERSAL_OFFSETS: [f64; 13] = [-4.0, -2.5, -1.8, -1.3, -0.9, -0.5, 0.0, 0.5, 0.9, 1.3, 1.8, 2.5, 4.0];
/// Rate ε over which Coulomb friction changes sign, rad/s or m/s.
const REVERSAL_RATE: f64 = 0.02;

/// Places in interval `i`: `points` + 1 equally spaced ones including both ends, and additional ones at the ends of
/// the path and at reversals of a drive or the telescope.
fn places(machine: &Machine, curve: &Curve, profile: &Profile, i: usize, points: usize) -> Vec<f64> {
    let h = profile.s[i + 1] - profile.s[i];
    let mut out: Vec<f64> = (0..=points).map(|k| h * k as f64 / points as f64).collect();
    // Equally spaced in time where the motion departs or arrives with constant s⃛.
    let cubes = (1..points).map(|k| h * (k as f64 / points as f64).powi(3));
    match i {
        0 => out.extend(cubes),
        i if i + 1 == profile.pieces.len() => out.extend(cubes.map(|sigma| h - sigma)),
        _ => {}
    }
    let geometry = &machine.plant().geometry;
    // Rates of the drives, then of the telescope, with respect to s.
    const TELESCOPE: usize = every_axis().end;
    let rates = |sigma: f64| -> Option<[f64; TELESCOPE + 1]> {
        let point = PathPoint::new(geometry, curve, profile.s[i] + sigma).ok()?;
        let [a, b, c, d] = point.q[1];
        let axis = geometry.telescope_bar(&point.r[0].xyz()).normalize();
        Some([a, b, c, d, -axis.dot(&point.r[1].xyz())])
    };
    let (Some(start), Some(end)) = (rates(0.0), rates(h)) else { return out };
    for k in (0..=TELESCOPE).filter(|&k| start[k] * end[k] < 0.0) {
        let [low, _] = bisect([0.0, h], 30, |sigma| rates(sigma).is_some_and(|rate| rate[k] * start[k] > 0.0));
        let bend = (end[k] - start[k]) / h;
        let width = REVERSAL_RATE / (bend.abs() * profile.at(i, low).z.sqrt()).max(f64::MIN_POSITIVE);
        out.extend(REVERSAL_OFFSETS.map(|x| low + x * width).into_iter().filter(|sigma| (0.0..=h).contains(sigma)));
    }
    out.sort_by(f64::total_cmp);
    out
}

/// Uses of the limits by `profile` at `points` + 1 equally spaced places of every interval, both ends included, and
/// at reversals.
///
/// Torques and constraint forces are those of the full nonlinear model.
///
/// # Errors
///
/// [`PlanError::Place`] where the robot cannot follow the path.
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
        let place = |reason| PlanError::Place { s, at: curve.at(s)[0].into(), reason };
        let point = PathPoint::new(geometry, curve, s).map_err(|e| place(PlaceError::Pose(e)))?;
        point.check(geometry).map_err(place)?;
        let speed = pace.z.sqrt();
        let motion = point.motion(geometry, speed, pace.acceleration);
        let loads = machine.loads(&motion).map_err(|e| place(PlaceError::Pose(e)))?;
        let mut value = [0.0; CHECKED];
        let mut ratio = [0.0; CHECKED];
        for i in every_axis() {
            let [_, q1, q2, q3] = point.q.map(|q| q[i]);
            value[i] = motion.qd[i];
            ratio[i] = value[i].abs() / limits.speed[i];
            value[AFFINE + i] = motion.qdd[i];
            let jerk = JERK + i;
            value[jerk] = q3 * speed.powi(3) + 3.0 * q2 * speed * pace.acceleration + q1 * pace.jerk;
            ratio[jerk] = value[jerk].abs() / limits.jerk[i];
        }
        value[AFFINE + DYNAMIC..JERK].copy_from_slice(&loads);
        for q in 0..QUANTITIES {
            ratio[AFFINE + q] = value[AFFINE + q].abs() / usable[q];
        }
        Ok(Use { interval, s, ratio, value })
    };
    let interval = |i: usize| -> Result<Vec<Use>, PlanError> {
        places(machine, curve, profile, i, points).into_iter().map(|sigma| one(i, sigma)).collect()
    };
    let all: Vec<Vec<Use>> = parallel::map(profile.pieces.len(), interval).into_iter().collect::<Result<_, _>>()?;
    Ok(all.concat())
}

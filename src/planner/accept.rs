//! Evaluation of a motion's check: reduction of the usable shares for the next search, and acceptance of the motion.

use std::collections::BTreeMap;

use super::PlanError;
use super::limits::{DYNAMIC, QUANTITIES};
use super::plan::ALLOWED_USE;
use super::rows::Tightening;
use super::verify::{self, AFFINE, JERK, Use};

/// Use above which a limit is tightened for the next round.
const TIGHTENED_USE: f64 = 1.0003;

/// Whether a limit is exceeded; where it is, the usable share at both ends of the interval is divided by the excess.
pub(super) fn tighten(uses: &[Use], tightening: &mut Tightening) -> bool {
    let mut worst: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    // At rest at the ends of the path, separate rows apply.
    let still =
        |u: &Use, k: usize| u.value[..AFFINE].iter().all(|v| *v == 0.0) && (AFFINE + DYNAMIC..JERK).contains(&k);
    for u in uses {
        for (k, ratio) in u.ratio.iter().enumerate().filter(|(k, r)| **r > TIGHTENED_USE && !still(u, *k)) {
            let entry = worst.entry((u.interval, k)).or_insert(1.0);
            *entry = f64::max(*entry, *ratio);
        }
    }
    for (&(interval, k), ratio) in &worst {
        for grid_point in [interval, interval + 1] {
            match k {
                ..AFFINE => tightening.share[grid_point][QUANTITIES] /= ratio.powi(2),
                AFFINE..JERK => tightening.share[grid_point][k - AFFINE] /= ratio,
                _ => tightening.jerk[grid_point][k - JERK] /= ratio,
            }
        }
    }
    !worst.is_empty()
}

/// The uses, if none exceeds [`ALLOWED_USE`].
///
/// # Errors
///
/// [`PlanError::Violated`] with the limit that is exceeded most.
pub(super) fn accept(uses: Vec<Use>) -> Result<Vec<Use>, PlanError> {
    let all = uses.iter().flat_map(|u| u.ratio.iter().enumerate().map(move |(k, r)| (k, u.s, *r)));
    match all.max_by(|a, b| a.2.total_cmp(&b.2)) {
        Some((k, s, ratio)) if ratio.is_nan() || ratio > ALLOWED_USE => {
            Err(PlanError::Violated { limit: verify::checked(k), s, ratio })
        }
        _ => Ok(uses),
    }
}

//! What the check of a motion has to say: how much less room the next search gets, and whether the motion is a plan.

use std::collections::BTreeMap;

use super::PlanError;
use super::jerk::JerkRoom;
use super::limits::QUANTITIES;
use super::plan::ALLOWED;
use super::rows::Room;
use super::verify::{self, Use};
use crate::machine::AXES;

/// Use at which a limit is held tighter in the next round.
const TIGHTEN: f64 = 1.0003;

/// Leaves less room on both sides of every interval in which a limit is exceeded; whether there is one.
pub(super) fn tighten(uses: &[Use], room: &mut Room, jerk_room: &mut JerkRoom) -> bool {
    const JERK: usize = AXES + QUANTITIES;
    let mut worst: BTreeMap<(usize, usize), f64> = BTreeMap::new();
    // At rest at the ends rows of their own hold.
    let still = |u: &Use, k: usize| u.value[..AXES].iter().all(|v| *v == 0.0) && (2 * AXES..JERK).contains(&k);
    for u in uses {
        for (k, ratio) in u
            .ratio
            .iter()
            .enumerate()
            .filter(|(k, r)| **r > TIGHTEN && (*k < JERK || !jerk_room.is_empty()) && !still(u, *k))
        {
            let entry = worst.entry((u.interval, k)).or_insert(1.0);
            *entry = f64::max(*entry, *ratio);
        }
    }
    for (&(interval, k), ratio) in &worst {
        for station in [interval, interval + 1] {
            match k {
                0..AXES => room.share[station][QUANTITIES] /= ratio.powi(2),
                AXES..JERK => room.share[station][k - AXES] /= ratio,
                _ => jerk_room[station][k - JERK] /= ratio,
            }
        }
    }
    !worst.is_empty()
}

/// The uses if none is beyond what is allowed.
pub(super) fn accept(uses: Vec<Use>) -> Result<Vec<Use>, PlanError> {
    let all = uses.iter().flat_map(|u| u.ratio.iter().enumerate().map(move |(k, r)| (k, u.s, *r)));
    match all.max_by(|a, b| a.2.total_cmp(&b.2)) {
        Some((k, s, ratio)) if ratio.is_nan() || ratio > ALLOWED => {
            Err(PlanError::Violated { limit: verify::checked(k), s, ratio })
        }
        _ => Ok(uses),
    }
}

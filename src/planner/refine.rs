//! Where a grid is too coarse for the motion found on it.
//!
//! Along a fastest motion some limit is reached almost everywhere: with z and s̈ as states and s⃛ as input, time-optimal inputs
//! lie on the border of what is allowed. So the *idle time* ∫ |1 − u| dt, u the largest use of a limit at a place by the
//! full model, tends to zero with the length of the intervals. It is largest in intervals that are too long: at the ends of
//! the path, where s⃛ is constant over an interval, where the active limit changes, and where a limit is exceeded between two
//! grid points, which tightens the limits at both. Those intervals are split.

use super::Profile;
use super::verify::Use;

/// Change of the time by the last split, relative, at which the grid is fine enough.
pub const SETTLED: f64 = 2.5e-3;
/// Share of the idle time in the intervals that are split.
const SPLIT_SHARE: f64 = 0.7;
/// An interval is split into this many parts at most.
const MAX_PARTS: f64 = 6.0;

/// Idle time in every interval, s.
pub fn idle(profile: &Profile, uses: &[Use]) -> Vec<f64> {
    let mut out = vec![0.0; profile.pieces.len()];
    let apart = |u: &Use| (u.ratio.iter().fold(0.0f64, |m, r| m.max(*r)) - 1.0).abs();
    let speed = |u: &Use| profile.at(u.interval, u.s - profile.s[u.interval]).z.sqrt();
    for pair in uses.windows(2).filter(|pair| pair[0].interval == pair[1].interval) {
        let [from, to] = [&pair[0], &pair[1]];
        let (slow, length) = (speed(from) + speed(to), to.s - from.s);
        if slow > 0.0 {
            out[from.interval] += (apart(from) + apart(to)) * length / slow;
        }
    }
    out
}

/// Places of the grid of `profile` with new ones in the intervals that have most of the `idle` time.
///
/// The new grid has no more than `largest` intervals, unless the old one has.
pub fn split(profile: &Profile, idle: &[f64], largest: usize) -> Vec<f64> {
    let n = idle.len();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&a, &b| idle[b].total_cmp(&idle[a]));
    let mut rest = (1.0 - SPLIT_SHARE) * idle.iter().sum::<f64>();
    let few = |i: &&usize| {
        rest -= idle[**i];
        rest >= 0.0
    };
    let marked = n - order.iter().rev().take_while(few).count();
    // What an interval may keep: the mean of those that are not split.
    let kept = &order[marked.min(n - 1)..];
    let keep = kept.iter().map(|&i| idle[i]).sum::<f64>() / kept.len() as f64;
    let mut parts = vec![1; n];
    let mut total = n;
    for &i in &order[..marked] {
        let wanted = (idle[i] / keep).clamp(2.0, MAX_PARTS) as usize;
        parts[i] = wanted.min(1 + largest.saturating_sub(total));
        total += parts[i] - 1;
    }
    let mut places = vec![profile.s[0]];
    for (i, parts) in parts.into_iter().enumerate() {
        let [from, to] = [profile.s[i], profile.s[i + 1]];
        places.extend((1..parts).map(|k| from + (to - from) * k as f64 / parts as f64));
        places.push(to);
    }
    places
}

//! Power: the probability of naming an effect over its size, for each length of the recording.

use super::fragility::{Fragility, FragilityError, Trial, equal_groups, fit_lognormal};

/// One attempt to find a hidden effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attempt {
    /// Size of the effect, such as RMS over noise.
    pub size: f64,
    /// Length of the recording in s.
    pub length: f64,
    /// Whether the effect was named.
    pub named: bool,
}

/// Power at one length of the recording.
#[derive(Debug, Clone, PartialEq)]
pub struct PowerCurve {
    /// Length of the recording in s.
    pub length: f64,
    /// Attempts grouped by size, for points with intervals.
    pub groups: Vec<Trial>,
    /// Lognormal curve through the attempts themselves, or why there is none.
    pub fit: Result<Fragility, FragilityError>,
}

impl PowerCurve {
    /// Size that is named with a given probability, `[estimate, low, high]` with its 95 % interval; `None` without a
    /// fit.
    pub fn detectable(&self, probability: f64) -> Option<[f64; 3]> {
        self.fit.as_ref().ok().map(|fit| fit.demand(probability, 0.95))
    }
}

/// One curve per length, in ascending order, each with at most `groups` groups of sizes.
///
/// The probability of naming over the size has the form of a fragility: the size at which an effect becomes visible
/// differs from attempt to attempt by factors.
pub fn power_curves(attempts: &[Attempt], groups: usize) -> Vec<PowerCurve> {
    let mut sorted: Vec<&Attempt> = attempts.iter().filter(|a| a.length.is_finite()).collect();
    sorted.sort_by(|a, b| a.length.total_cmp(&b.length));
    let curve = |same: &[&Attempt]| {
        let outcomes: Vec<(f64, bool)> = same.iter().map(|a| (a.size, a.named)).collect();
        let single = |&(demand, named): &(f64, bool)| Trial { demand, failures: usize::from(named), of: 1 };
        let trials: Vec<Trial> = outcomes.iter().map(single).collect();
        PowerCurve { length: same[0].length, groups: equal_groups(&outcomes, groups), fit: fit_lognormal(&trials) }
    };
    sorted.chunk_by(|a, b| a.length == b.length).map(curve).collect()
}

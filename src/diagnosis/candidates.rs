//! Evidence about every candidate, found or not, with p value and probability from the same ranking.

use super::answer::Named;
use super::search::Found;
use super::search::lag::DELAY;
use crate::evidence::{Assessment, Visibility};

/// Evidence about one candidate.
#[derive(Clone, Debug)]
pub struct CandidateReport {
    /// Its name.
    pub name: String,
    /// Probability that it is missing: for a found effect its own, else the largest in place of a found effect.
    pub probability: f64,
    /// Share of the explainable error of the fitted recordings that it would explain as the only addition.
    pub explained: f64,
    /// Family-wise p value with everything else found in the model.
    pub p_adjusted: f64,
    /// Whether the data could reveal it at its usual size, or do at the size that they suggest.
    pub visible: bool,
    /// Parameters that imitate it, at most five.
    pub absorbed_by: Vec<String>,
    /// Final status.
    pub standing: Standing,
    /// Reason why these data cannot test it; `None` if they can.
    pub untestable: Option<Untestable>,
}

/// Final status of a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// It is named.
    Found,
    /// The data do not distinguish it from a named effect.
    Rival,
    /// It was found, but a formula explains more.
    Doubted,
    /// It is part of the model as the delay with which the torques were recorded.
    InModel,
    /// It was found, but not confirmed on the validation data.
    Refused,
    /// It is significant but too small to be reported.
    Trifle,
    /// It is not significant with everything else found in the model.
    NotNeeded,
    /// These data cannot reveal it.
    Untestable,
}

impl std::fmt::Display for Standing {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Found => "found",
            Self::Rival => "cannot be told apart",
            Self::Doubted => "formula explains more",
            Self::InModel => "in the model as a lag",
            Self::Refused => "does not stand",
            Self::Trifle => "too small to matter",
            Self::NotNeeded => "not needed",
            Self::Untestable => "not testable here",
        })
    }
}

/// Reason why data cannot test an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Untestable {
    /// The motion does not excite it.
    NotExcited,
    /// The model's own parameters imitate it.
    Imitated,
    /// At its usual size it is below the noise.
    TooWeak,
    /// The recordings have too few rows.
    TooFewRows,
    /// Inverse dynamics along a measured motion does not contain it.
    TwinOnly,
}

impl Untestable {
    /// All reasons.
    pub const ALL: [Self; 5] = [Self::NotExcited, Self::Imitated, Self::TooWeak, Self::TooFewRows, Self::TwinOnly];
}

impl std::fmt::Display for Untestable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::NotExcited => "nothing in this motion brings it about",
            Self::Imitated => "the model's own parameters imitate it",
            Self::TooWeak => "at its usual size it drowns in the noise",
            Self::TooFewRows => "there are too few rows",
            Self::TwinOnly => "acts in the twin only, no measured motion shows it",
        })
    }
}

/// Share of a candidate's energy outside the span of the parameters below which imitation counts as the reason.
const IMITATED: f64 = 0.2;

fn untestable(a: &Assessment) -> Option<Untestable> {
    match a.visibility {
        Visibility::Visible => None,
        Visibility::Empty => Some(Untestable::NotExcited),
        Visibility::InBaseSpan => Some(Untestable::Imitated),
        Visibility::TooWeak if a.tolerance < IMITATED => Some(Untestable::Imitated),
        Visibility::TooWeak => Some(Untestable::TooWeak),
        Visibility::TooFewRows => Some(Untestable::TooFewRows),
    }
}

/// Reports of all candidates, named ones first.
pub(super) fn reports(found: &Found, effects: &[Named], sets: &[Vec<String>]) -> Vec<CandidateReport> {
    let Found { all, outcome, settings, .. } = found;
    let lag = found.sampling_lag.map(|_| DELAY);
    let report = |alone: &Assessment| {
        let name = &alone.name;
        let own = outcome.findings.iter().find(|f| f.chosen.candidate == alone.candidate);
        let beside = own.map_or(&outcome.remaining, |f| &f.ranking).of(alone.candidate);
        let named = effects.iter().find(|e| e.name == *name);
        let probability = match named {
            Some(named) => named.confidence.probability(),
            None => effects.iter().map(|e| e.confidence.probability_of(name)).fold(0.0, f64::max),
        };
        // What the data show is testable by them, whatever its usual size.
        let reason = untestable(alone).filter(|_| !alone.passes(settings));
        let standing = match beside {
            _ if named.is_some() => Standing::Found,
            _ if sets.iter().any(|set| set.contains(name)) => Standing::Rival,
            _ if own.is_some() => Standing::Doubted,
            _ if lag == Some(name.as_str()) => Standing::InModel,
            _ if reason.is_some() => Standing::Untestable,
            None => Standing::Refused,
            Some(a) if a.p_adjusted < settings.alpha => Standing::Trifle,
            Some(_) => Standing::NotNeeded,
        };
        CandidateReport {
            name: name.clone(),
            probability,
            explained: alone.explained_share.unwrap_or(0.0).clamp(0.0, 1.0),
            p_adjusted: beside.unwrap_or(alone).p_adjusted,
            visible: alone.is_revealed(settings),
            absorbed_by: alone.absorbed_by.iter().map(|x| x.parameter.clone()).collect(),
            standing,
            untestable: reason.filter(|_| standing == Standing::Untestable),
        }
    };
    let mut reports: Vec<CandidateReport> = all.order.iter().map(|&i| report(&all.candidates[i])).collect();
    let place = |r: &CandidateReport| effects.iter().position(|e| e.name == r.name).unwrap_or(effects.len());
    // Testable candidates keep the order of their likelihood, untestable ones follow.
    reports.sort_by_key(|r| (place(r), r.standing != Standing::Rival, r.standing == Standing::Untestable));
    reports
}

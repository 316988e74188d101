//! What a diagnosis answers.

use super::budget::{Budget, Change};
use super::candidates::CandidateReport;
use super::conclusion::explained;
use super::confidence::Confidence;
use super::experiment::NextExperiment;
use super::fitting::Work;
use super::left::Left;
use super::unknown::Unexplained;
use crate::dynamics::Channel;
use crate::identification::fit::Estimate;
use crate::model::Model;

/// Conclusion of a diagnosis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// Nothing is missing.
    None,
    /// One effect is missing.
    Effect,
    /// More than one effect is missing.
    Several,
    /// Something is missing, and the data do not tell which of several effects.
    Ambiguous,
    /// Something is missing that no known effect explains.
    Unknown,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::None => "none",
            Self::Effect => "effect",
            Self::Several => "several",
            Self::Ambiguous => "ambiguous",
            Self::Unknown => "unknown",
        })
    }
}

/// What is missing.
#[derive(Clone)]
pub struct Diagnosis {
    /// Conclusion.
    pub verdict: Verdict,
    /// Channels of the following arrays.
    pub channels: Vec<Channel>,
    /// Standard deviation of the sensor noise.
    pub noise_floor: Vec<f64>,
    /// RMS residual of the refitted model without new effects; on held-out data where given.
    pub rms_before: Vec<f64>,
    /// The same with the found effects.
    pub rms_after: Vec<f64>,
    /// Effects that are missing, in the order found.
    pub effects: Vec<Named>,
    /// All candidates, best first.
    pub candidates: Vec<CandidateReport>,
    /// Sets of effects the data cannot tell apart.
    pub indistinguishable: Vec<Vec<String>>,
    /// Effects the data could not show at their usual size.
    pub unseen: Vec<String>,
    /// Parameters of the other candidates that no channel shows at all, such as the height of a payload without strut forces.
    pub unseen_parameters: Vec<String>,
    /// Those of them that act in the twin only.
    pub twin_only: Vec<String>,
    /// What to measure to tell the members of a set apart, or to see what these data cannot show.
    pub next_experiment: Option<NextExperiment>,
    /// What each found effect explains.
    pub budget: Budget,
    /// Parameters that the found effects moved.
    pub changes: Vec<Change>,
    /// All parameters before and after.
    pub parameters: [Vec<Estimate>; 2],
    /// What is left with everything that was found, and whether something unknown acts beside the effects named.
    pub left: Left,
    /// Names of what the time did not allow to try.
    pub not_tried: Vec<String>,
    /// What no known effect explains: for [`Verdict::Unknown`], with the formula in the model; beside named effects that
    /// stand, with the formula as a proposal.
    pub unexplained: Option<Unexplained>,
    /// By how much the torques come late, s, if it is less than half a sample: no effect, but part of the model.
    pub sampling_lag: Option<f64>,
    /// The refitted model with the found effects, which its history tells of, and with a formula for what they do not explain.
    pub model: Model,
    /// What it cost.
    pub work: Work,
}

/// A missing effect.
#[derive(Clone, Debug)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// What would have been said, had something else been true.
    pub confidence: Confidence,
    /// Share of the explainable error it explains.
    pub explained: f64,
    /// Its parameters.
    pub parameters: Vec<Estimate>,
}

impl Diagnosis {
    /// Share of the explainable error, on the data judged by, that goes with everything that was found.
    pub fn explained(&self) -> f64 {
        explained(&self.rms_before, &self.rms_before, &self.rms_after, &self.noise_floor)
    }

    /// The same with a formula that no effect of the library is, where there is one.
    pub fn explained_with_formula(&self) -> f64 {
        let after = self.unexplained.as_ref().map_or(&self.rms_after, |u| &u.rms);
        explained(&self.rms_before, &self.rms_before, after, &self.noise_floor)
    }

    /// Whether something unknown acts beside the effects that are named.
    pub fn unknown_beside(&self) -> bool {
        self.left.beside
    }
}

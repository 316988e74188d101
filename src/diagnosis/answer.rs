//! Result of a diagnosis.

use nalgebra::DMatrix;

use super::alone::Alone;
use super::budget::{Budget, Change};
use super::candidates::CandidateReport;
use super::conclusion::explained;
use super::confidence::Confidence;
use super::experiment::NextExperiment;
use super::fitting::Work;
use super::left::Left;
use super::unknown::Unexplained;
use crate::evidence::TooFew;
use crate::identification::Repeats;
use crate::identification::fit::Estimate;
use crate::model::Model;
use crate::recording::Channel;

/// Conclusion of a diagnosis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// No effect is missing.
    None,
    /// One effect is missing.
    Effect,
    /// Several effects are missing.
    Several,
    /// At least one effect is missing, and the data do not determine which of several.
    Ambiguous,
    /// An effect is missing that the library does not contain.
    Unknown,
    /// The time was up before it was clear whether an effect is missing, or whether a known one explains what is left.
    Undecided,
}

impl std::fmt::Display for Verdict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::None => "none",
            Self::Effect => "effect",
            Self::Several => "several",
            Self::Ambiguous => "ambiguous",
            Self::Unknown => "unknown",
            Self::Undecided => "undecided",
        })
    }
}

/// Result of a diagnosis.
#[derive(Clone)]
pub struct Diagnosis {
    /// Conclusion.
    pub verdict: Verdict,
    /// Channels, in the order of the following arrays.
    pub channels: Vec<Channel>,
    /// Standard deviation of the sensor noise, N·m or N.
    pub noise_floor: Vec<f64>,
    /// RMS residual of the refitted model without new effects, N·m or N; on held-out data where given.
    pub rms_before: Vec<f64>,
    /// RMS residual with the found effects, N·m or N; on held-out data where given.
    pub rms_after: Vec<f64>,
    /// Missing effects, in the order found.
    pub effects: Vec<Named>,
    /// All candidates, best first.
    pub candidates: Vec<CandidateReport>,
    /// What the best of them explain as the only addition, at every moment.
    pub alone: Alone,
    /// Sets of effects that the data cannot distinguish.
    pub indistinguishable: Vec<Vec<String>>,
    /// Effects that the data could not reveal at their usual size.
    pub unseen: Vec<String>,
    /// Parameters of the other candidates without influence on any channel, such as the height of a payload without
    /// strut forces.
    pub unseen_parameters: Vec<String>,
    /// Effects of `unseen` that exist in the twin only.
    pub twin_only: Vec<String>,
    /// Experiment that would distinguish the members of a set, or reveal effects that these data cannot.
    pub next_experiment: Option<NextExperiment>,
    /// Error budget of the found effects.
    pub budget: Budget,
    /// Parameters that the found effects changed significantly.
    pub changes: Vec<Change>,
    /// All parameters before and after.
    pub parameters: [Vec<Estimate>; 2],
    /// Covariance of those after, as in [`Fit`](crate::identification::Fit).
    pub covariance: DMatrix<f64>,
    /// Residual with everything found, and whether an unknown effect acts in addition to the named ones.
    pub left: Left,
    /// Set if the recordings have too few rows to test any effect.
    pub too_few: Option<TooFew>,
    /// Time over which the coarsest angles are smoothed, s, where that hides reversals: friction around them and faster motion
    /// leave an error that is not the machine's.
    pub smoothing: Option<f64>,
    /// Whether the permitted work, and not the time, ended the search.
    pub is_work_spent: bool,
    /// Names of effects and steps that were not tried, as the time or the permitted work was spent.
    pub not_tried: Vec<String>,
    /// What repeats of the residual with everything found, and what does not; `None` where no motion repeats.
    pub repeats: Option<Repeats>,
    /// Error that no known effect explains: for [`Verdict::Unknown`] with the formula in the model, in addition to
    /// confirmed effects with the formula as a proposal.
    pub unexplained: Option<Unexplained>,
    /// Delay of the torques, s, if it is at most half a sample: part of the model instead of an effect.
    pub sampling_lag: Option<f64>,
    /// The refitted model with the found effects, recorded in its history, and with a formula for the error that they
    /// do not explain.
    pub model: Model,
    /// What it cost.
    pub work: Work,
}

/// A missing effect.
#[derive(Clone, Debug)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// Posterior probabilities of the effect and its alternatives.
    pub confidence: Confidence,
    /// Share of the explainable error that it explains.
    pub explained: f64,
    /// Its parameters.
    pub parameters: Vec<Estimate>,
}

impl Diagnosis {
    /// Share of the explainable error that all found effects explain, on the data used for validation.
    pub fn explained(&self) -> f64 {
        explained(&self.rms_before, &self.rms_before, &self.rms_after, &self.noise_floor)
    }

    /// Share of the explainable error that all found effects and the empirical formula, if any, explain.
    pub fn explained_with_formula(&self) -> f64 {
        let after = self.unexplained.as_ref().map_or(&self.rms_after, |u| &u.residuals.rms);
        explained(&self.rms_before, &self.rms_before, after, &self.noise_floor)
    }

    /// Whether an unknown effect acts in addition to the named ones.
    pub fn unknown_beside(&self) -> bool {
        self.left.beside
    }
}

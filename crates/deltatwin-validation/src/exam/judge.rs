//! Answer of the diagnosis about a campaign, and its grade.

use std::collections::BTreeMap;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use super::outside::Outside;
use deltatwin::diagnosis::{self, Diagnosis, diagnose};
use deltatwin::effects;
use deltatwin::identification::Dataset;
use deltatwin::identification::fit::Estimate;
use deltatwin::model::Model;
use deltatwin::recording::Recording;

/// Largest indistinguishable set that counts as naming its effects.
pub const LARGEST_SET: usize = 3;
/// Claimed probability from which a wrong name is confidently wrong.
pub const CONFIDENT: f64 = 0.9;

/// Truth of a campaign, as far as the grading needs it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Truth {
    /// Names of the hidden effects.
    pub effects: Vec<String>,
    /// Values of their parameters, by `effect.parameter`, as far as they are stated under the library's names.
    pub values: Vec<(String, f64)>,
    /// Part of the machine where the law outside the library acts, if stated.
    pub place: Option<String>,
    /// Name of the law outside the library, if stated.
    pub law: Option<String>,
    /// Share of it that no sum of the search's laws represents, if stated.
    pub unspanned: Option<f64>,
    /// Largest ratio of held-out RMS residual to noise floor of the robot's own model, if stated.
    pub attainable: Option<f64>,
    /// Size, if stated.
    pub size: Option<String>,
    /// Kind of noise, if stated.
    pub noise: Option<String>,
    /// Expected ratio of RMS residual to noise on the channel that determined the size of the first effect, if
    /// stated.
    pub rise: Option<f64>,
    /// Whether an effect could not be made as large as requested.
    pub limited: bool,
}

/// Answer of the diagnosis.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Answer {
    /// `none`, `effect`, `several`, `ambiguous` or `unknown`.
    pub verdict: String,
    /// Effects in the order named.
    pub effects: Vec<Named>,
    /// Indistinguishable sets.
    pub indistinguishable: Vec<Vec<String>>,
    /// Channels, in the order of the following arrays.
    pub channels: Vec<String>,
    /// RMS residual of the refitted model on the held-out motion, N·m or N.
    pub rms_before: Vec<f64>,
    /// RMS residual with everything found, N·m or N.
    pub rms_after: Vec<f64>,
    /// Standard deviation of the sensor noise, N·m or N.
    pub noise_floor: Vec<f64>,
    /// Part of the machine where an unknown effect acts.
    #[serde(default)]
    pub location: Option<String>,
    /// Share of the explainable held-out error that its formula explains.
    #[serde(default)]
    pub formula: Option<f64>,
    /// Elapsed time of the diagnosis including derivatives, s.
    pub seconds: f64,
    /// Reason why there is no answer.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub failure: Option<String>,
}

/// An effect that was named.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Named {
    /// Its name.
    pub name: String,
    /// Claimed probability.
    pub probability: f64,
    /// Share of the explainable error it explains.
    pub explained: f64,
    /// Value and standard error of its parameters.
    pub parameters: BTreeMap<String, (f64, Option<f64>)>,
}

/// Diagnosis of the effect that `model` lacks, from a recording and one for validation.
pub fn judge(model: &Model, [measurement, validation]: &[Recording; 2]) -> Answer {
    let start = Instant::now();
    let (dataset, held_out) = (Dataset::new(measurement), Dataset::new(validation));
    let result = diagnose(model, &[dataset], &[held_out], &mut |_| {});
    let seconds = start.elapsed().as_secs_f64();
    match result {
        Ok(diagnosis) => Answer { seconds, ..Answer::from(&diagnosis) },
        Err(e) => Answer { verdict: "failed".into(), failure: Some(e.to_string()), seconds, ..Answer::default() },
    }
}

impl From<&Diagnosis> for Answer {
    fn from(d: &Diagnosis) -> Self {
        // At the end of a range, the standard error is the one of the unconstrained estimate.
        let std = |p: &Estimate| Some(p.std).filter(|s| s.is_finite() && p.bound().is_none());
        let named = |e: &diagnosis::Named| Named {
            name: e.name.clone(),
            probability: e.confidence.probability(),
            explained: e.explained,
            parameters: e.parameters.iter().map(|p| (p.name.clone(), (p.value, std(p)))).collect(),
        };
        Self {
            verdict: d.verdict.to_string(),
            effects: d.effects.iter().map(named).collect(),
            indistinguishable: d.indistinguishable.clone(),
            channels: d.channels.iter().map(ToString::to_string).collect(),
            rms_before: d.rms_before.clone(),
            rms_after: d.rms_after.clone(),
            noise_floor: d.noise_floor.clone(),
            location: d.unexplained.as_ref().map(|u| u.location.clone()),
            formula: d.unexplained.as_ref().and_then(|u| {
                let energy = |rms: &[f64]| -> f64 {
                    rms.iter().zip(&d.noise_floor).map(|(r, f)| (r / f).powi(2) - 1.0).sum::<f64>()
                };
                let (before, after) = (energy(&d.rms_before), energy(&u.residuals.rms));
                (before > 0.0).then(|| (1.0 - after / before).clamp(0.0, 1.0))
            }),
            ..Self::default()
        }
    }
}

impl Answer {
    /// Largest ratio of held-out RMS residual to noise with everything found; `None` without channels.
    pub fn held_out_ratio(&self) -> Option<f64> {
        let ratios = self.rms_after.iter().zip(&self.noise_floor).map(|(r, f)| r / f);
        ratios.fold(None, |worst, r| Some(worst.map_or(r, |w: f64| w.max(r))))
    }

    /// Whether `name` was named, alone or in a set of at most [`LARGEST_SET`].
    fn names(&self, name: &str) -> bool {
        self.effects.iter().any(|e| e.name == name) || self.in_small_set(name)
    }

    /// Whether `name` is in a set of at most [`LARGEST_SET`].
    pub fn in_small_set(&self, name: &str) -> bool {
        self.indistinguishable.iter().any(|set| set.len() <= LARGEST_SET && set.iter().any(|n| n == name))
    }
}

/// Grade of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Grade {
    /// Correct: the effect named first or in a set of at most three, unless the verdict is `unknown`; `none` for
    /// nothing; `unknown` for a law outside the library, or the effect of which it is a case.
    Right,
    /// One of two effects was named.
    Half,
    /// The verdict was `none`, `unknown` or `undecided` although an effect is hidden, or `undecided` where none is.
    Missed,
    /// Another effect was named.
    Wrong,
    /// Another effect was named alone with a probability of 0.9 or more.
    ConfidentlyWrong,
    /// There was no answer.
    Failed,
}

/// Kind of question that a truth poses.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Question {
    /// Nothing is hidden.
    Nothing,
    /// One effect of the library is hidden.
    One,
    /// Several effects of the library are hidden.
    Several,
    /// A law outside the library is hidden.
    Outside,
}

impl Question {
    /// Kind of question of a truth.
    pub fn of(truth: &Truth) -> Self {
        // Laws outside the library are hidden as formulas.
        let known = |name: &String| effects::find(name).is_some_and(|effect| effect.formula().is_none());
        match truth.effects.len() {
            0 => Self::Nothing,
            _ if !truth.effects.iter().all(known) => Self::Outside,
            1 => Self::One,
            _ => Self::Several,
        }
    }
}

impl std::fmt::Display for Grade {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Right => "right",
            Self::Half => "half",
            Self::Missed => "missed",
            Self::Wrong => "wrong",
            Self::ConfidentlyWrong => "confidently wrong",
            Self::Failed => "failed",
        })
    }
}

impl Grade {
    /// Grade of an answer.
    pub fn of(truth: &Truth, answer: &Answer) -> Self {
        if answer.failure.is_some() {
            return Self::Failed;
        }
        let wrong = || {
            let certain = answer.indistinguishable.is_empty()
                && !matches!(answer.verdict.as_str(), "unknown" | "undecided")
                && answer.effects.first().is_some_and(|e| e.probability >= CONFIDENT);
            if certain { Self::ConfidentlyWrong } else { Self::Wrong }
        };
        let named = |name: &str| answer.effects.first().is_some_and(|e| e.name == name) || answer.in_small_set(name);
        if answer.verdict == "undecided" && answer.effects.is_empty() {
            return Self::Missed;
        }
        let named_nothing = matches!(answer.verdict.as_str(), "none" | "unknown");
        match Question::of(truth) {
            Question::Nothing if answer.verdict == "none" => Self::Right,
            Question::Nothing => wrong(),
            Question::Outside if answer.verdict == "unknown" => Self::Right,
            Question::Outside if truth.law.as_deref().and_then(Outside::case_of).is_some_and(named) => Self::Right,
            Question::Outside if answer.verdict == "none" => Self::Missed,
            Question::Outside => wrong(),
            Question::One => {
                let name = &truth.effects[0];
                match named_nothing {
                    true => Self::Missed,
                    false if named(name) => Self::Right,
                    false => wrong(),
                }
            }
            Question::Several => {
                let found = truth.effects.iter().filter(|n| answer.names(n)).count();
                match found {
                    _ if named_nothing => Self::Missed,
                    0 => wrong(),
                    n if n == truth.effects.len() => Self::Right,
                    _ => Self::Half,
                }
            }
        }
    }
}

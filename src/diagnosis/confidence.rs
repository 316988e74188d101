//! Posterior probabilities of a named effect and its alternatives; the draws are those of
//! [`crate::evidence::confusion`].

use crate::evidence::{self, Finding, Problem, Settings};

/// Number of draws per truth.
const DRAWS: usize = 200;

/// Posterior probabilities of a named effect and its alternatives.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Confidence {
    /// Number of draws per truth.
    pub draws: usize,
    /// The alternatives, the named effect first.
    pub truths: Vec<Truth>,
}

/// An alternative taken as the truth, at its estimated size.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Name of the effect; `none` for the null.
    pub name: String,
    /// Share of the draws in which the named effect is ranked first.
    pub said: f64,
    /// Posterior probability of this truth given the ranking, with equal priors.
    pub probability: f64,
}

impl Confidence {
    /// Posterior probabilities for a finding of `problem`; empty if its ranking has no winner.
    ///
    /// # Errors
    /// If the problem is inconsistent, too short for the tests, or not finite.
    pub fn of(finding: &Finding, problem: &Problem, settings: &Settings) -> Result<Self, evidence::Error> {
        let Some(c) = evidence::confusion(problem, &finding.ranking, settings, DRAWS)? else {
            return Ok(Self::default());
        };
        let name = |truth: &Option<usize>| truth.map_or("none".into(), |j| problem.candidates[j].name.clone());
        let one = |((truth, counts), probability): ((&Option<usize>, &Vec<usize>), f64)| Truth {
            name: name(truth),
            said: counts[0] as f64 / c.runs as f64,
            probability,
        };
        let truths = c.truths.iter().zip(&c.counts).zip(c.probabilities()).map(one).collect();
        Ok(Self { draws: c.runs, truths })
    }

    /// Scales all probabilities by `share`; the rest belongs to unknown effects.
    pub fn doubt(&mut self, share: f64) {
        self.truths.iter_mut().for_each(|truth| truth.probability *= share);
    }

    /// Posterior probability of the named effect.
    pub fn probability(&self) -> f64 {
        self.truths.first().map_or(0.0, |t| t.probability)
    }

    /// Posterior probability of the effect `name`; zero if it is no alternative.
    pub fn probability_of(&self, name: &str) -> f64 {
        self.truths.iter().find(|t| t.name == name).map_or(0.0, |t| t.probability)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubt_leaves_room_for_what_nobody_knows() {
        let truth = |name: &str, probability| Truth { name: name.into(), said: 1.0, probability };
        let mut confidence = Confidence { draws: 200, truths: vec![truth("air_drag", 0.75), truth("none", 0.25)] };
        confidence.doubt(0.4);
        approx::assert_relative_eq!(confidence.probability(), 0.3);
        approx::assert_relative_eq!(confidence.probability_of("none"), 0.1);
    }
}

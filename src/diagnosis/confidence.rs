//! How far a name can be trusted, in the robot's terms; the draws stand in [`crate::evidence::confusion`].

use crate::evidence::{self, Finding, Problem, Settings};

/// Draws per truth.
const DRAWS: usize = 200;

/// What would have been said, had something else been true.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Confidence {
    /// Draws per truth.
    pub draws: usize,
    /// The truths tried, the named effect first.
    pub truths: Vec<Truth>,
}

/// A truth that was tried, at the size the data give it.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Name of the effect; `none` if nothing is missing.
    pub name: String,
    /// Share of the draws in which the named effect is named.
    pub said: f64,
    /// Probability of this truth now that it was named, all truths being equally likely before.
    pub probability: f64,
}

impl Confidence {
    /// Of a finding of `problem`.
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

    /// Leaves `share` of the probabilities to the truths that were tried, the rest to what nobody knows.
    pub fn doubt(&mut self, share: f64) {
        self.truths.iter_mut().for_each(|truth| truth.probability *= share);
    }

    /// Probability of the named effect.
    pub fn probability(&self) -> f64 {
        self.truths.first().map_or(0.0, |t| t.probability)
    }

    /// Probability of the effect called `name`.
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

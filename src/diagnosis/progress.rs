//! Reports of a diagnosis that goes on.

use crate::evidence::Ranking;

/// What a diagnosis reports while it goes on.
#[derive(Clone, Copy, Debug)]
pub enum Progress<'a> {
    /// A step begins.
    Step(&'a str),
    /// Number of candidates with which the step is done; it grows within a step.
    Candidates {
        /// Candidates done.
        done: usize,
        /// All candidates of the step.
        of: usize,
    },
    /// All candidates, most likely first, before any is fitted; again where the model has changed since.
    Ranked(&'a [Promise]),
}

impl Progress<'_> {
    /// What to show of it during `step`, the last one that began.
    pub fn text(&self, step: &str) -> String {
        match self {
            Self::Step(what) => (*what).into(),
            Self::Candidates { done, of } => format!("{step}: candidate {done} of {of}"),
            Self::Ranked(_) => step.into(),
        }
    }
}

/// What a candidate promises as the only addition, by the linear problem.
#[derive(Clone, Debug, PartialEq)]
pub struct Promise {
    /// Its name.
    pub name: String,
    /// Share of the error above the noise of the fitted recordings that it would explain, from 0 to 1.
    pub explained: f64,
    /// Family-wise p value.
    pub p_adjusted: f64,
}

/// Promises of all candidates of a ranking.
pub(super) fn promises(ranking: &Ranking) -> Vec<Promise> {
    let promise = |&i: &usize| {
        let a = &ranking.candidates[i];
        let explained = a.explained_share.unwrap_or(0.0).clamp(0.0, 1.0);
        Promise { name: a.name.clone(), explained, p_adjusted: a.p_adjusted }
    };
    ranking.order.iter().map(promise).collect()
}

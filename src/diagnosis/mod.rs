//! Diagnosis of missing effects: refits the model, tests every absent effect and adds those that the data require.
//!
//! The statistics are in [`crate::evidence`]; this module formulates the hypotheses for the robot and interprets the
//! outcome.

mod add;
mod alone;
mod answer;
pub mod budget;
pub mod candidates;
pub mod change;
mod conclusion;
pub mod confidence;
mod error;
pub mod experiment;
mod fitting;
mod judge;
pub mod left;
mod missing;
mod orders;
mod problem;
pub mod progress;
mod search;
pub mod unknown;

pub use add::{Addition, add, add_with};
pub use alone::Alone;
pub use answer::{Diagnosis, Named, Verdict};
pub use candidates::CandidateReport;
use conclusion::Conclusion;
pub use conclusion::parameters_of;
pub use error::DiagnosisError;
pub use experiment::NextExperiment;
pub use fitting::{Clock, Options, Work};
use fitting::{Fitting, Stage};
use judge::Judge;
pub use left::Left;
pub use progress::Progress;
pub use unknown::Unexplained;

use crate::dynamics::in_configuration;
use crate::identification::{Dataset, check_together};
use crate::model::Model;

/// Diagnosis of the effects that `model` lacks to explain `datasets`, validated on `held_out` where given.
///
/// All parameters are fitted without a time limit; `progress` is called at each step.
///
/// # Errors
/// If there are no data, recordings differ in configuration or channels, or the model cannot be fitted to them.
pub fn diagnose(
    model: &Model,
    datasets: &[Dataset],
    held_out: &[Dataset],
    progress: &mut dyn FnMut(Progress),
) -> Result<Diagnosis, DiagnosisError> {
    diagnose_with(model, datasets, held_out, &Options::default(), progress)
}

/// Diagnosis as [`diagnose`], with known parameters, a time limit and effects outside the registry.
///
/// # Errors
/// As [`diagnose`]; [`DiagnosisError::Stopped`] once the clock is infinite.
pub fn diagnose_with(
    model: &Model,
    datasets: &[Dataset],
    held_out: &[Dataset],
    options: &Options,
    progress: &mut dyn FnMut(Progress),
) -> Result<Diagnosis, DiagnosisError> {
    check(datasets, held_out)?;
    let means = fitting::means(datasets);
    let fitting = Fitting::new(model, datasets, options).with_means(&means).with_repeats(model)?;
    let judge = Judge::new(&fitting, model, held_out)?;
    progress(Progress::Step("refit"));
    let refitted = fitting.refit(model, options)?;
    fitting.go_on()?;
    let mounted = in_configuration(model, &datasets[0].setup);
    let mut candidates = missing::testable(&mounted, &refitted, datasets, fitting.candidates);
    let mut found = search::find(refitted, &judge, &candidates, progress)?;
    fitting.go_on()?;
    progress(Progress::Step("confidence"));
    let mut conclusion = Conclusion::new(&found, &judge)?;
    progress(Progress::Step("what is left"));
    if found.all.too_few.is_some() {
        // A law of its own needs more than a known effect.
    } else if fitting.has_time_for(Stage::UnknownLaw) {
        conclusion.revise(unknown::explain(&found, &judge, progress)?);
        if let Some(formula) = conclusion.formula_alone(&judge) {
            // What the unknown law hides is looked for next to it.
            fitting.search_next_to_formula();
            progress(Progress::Step("effects next to the formula"));
            let is_absent = |name: &str| formula.model.effects.iter().all(|a| a.effect.name() != name);
            let others: Vec<_> = candidates.iter().filter(|c| is_absent(c[0].effect.name())).cloned().collect();
            let anew = search::find(formula.clone(), &judge, &others, progress)?;
            if conclusion.is_as_well(&anew, &judge) {
                found = conclusion.name_next_to_formula((found.start, found.sampling_lag), anew, &judge)?;
                candidates = others;
            }
        }
    } else {
        conclusion.not_tried.push("a law outside the library".into());
    }
    fitting.go_on()?;
    conclusion.weigh_the_rest(&found, &judge)?;
    fitting.go_on()?;
    conclusion.settle();
    let left = Left::of(&conclusion, &judge)?;
    progress(Progress::Step("next experiment"));
    let mut next = None;
    if fitting.has_time_for(Stage::NextExperiment) {
        next = experiment::next(&conclusion, &found, &candidates, &fitting);
    } else {
        conclusion.not_tried.push("the next experiment".into());
    }
    fitting.go_on()?;
    conclusion.answer(found, left, next, (&mounted, &candidates), &judge)
}

fn check(datasets: &[Dataset], held_out: &[Dataset]) -> Result<(), DiagnosisError> {
    if datasets.is_empty() {
        return Err(DiagnosisError::NoData);
    }
    Ok(check_together(datasets.iter().chain(held_out))?)
}

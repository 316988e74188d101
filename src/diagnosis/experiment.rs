//! Experiment that resolves the open questions of a diagnosis: which of several effects is present, or whether one is
//! present.

use std::ops::Range;

use super::answer::Verdict;
use super::conclusion::Conclusion;
use super::fitting::Fitting;
use super::problem;
use super::search::{Found, without_effects};
use crate::effects::ActiveEffect;
use crate::evidence::whiten::ArFilter;
use crate::evidence::{Assessment, Finding};
use crate::excitation::experiments::{Bench, Experiment};
use crate::excitation::prospect::{
    Comparison, Information, Noise, Prospect, SURE, chance, in_words, prospect, ranked, which,
};
use crate::identification::Dataset;
use crate::identification::dataset::stride_for;
use crate::model::Model;
use crate::numerics::parallel;

/// A proposed experiment.
#[derive(Clone, Debug)]
pub struct NextExperiment {
    /// Description of the experiment and its purpose, one sentence.
    pub what: String,
    /// Name of its kind.
    pub kind: &'static str,
    /// The two effects that are the hardest to distinguish, or the single effect to be revealed.
    pub pair: Vec<String>,
    /// δ² of the pair for the experiment as planned, combined with the present data where possible.
    pub noncentrality: f64,
    /// Power of the experiment as planned.
    pub chance: f64,
    /// Duration as planned, s.
    pub duration: f64,
    /// Duration for a power of 95 %, s; `None` if no duration suffices.
    pub seconds: Option<f64>,
    /// The planned experiment.
    pub experiment: Experiment,
    /// Alternatives, best first: kind, power, duration needed in s.
    pub others: Vec<(&'static str, f64, Option<f64>)>,
}

/// Context of the open questions.
pub struct Open<'a> {
    /// Current model of the machine, without the effects in question.
    pub model: &'a Model,
    /// Effects whose parameters are known.
    pub fixed: &'a [String],
    /// The data.
    pub datasets: &'a [Dataset],
    /// Whitening filter of each channel for the noise left by the best model.
    pub filters: &'a [ArFilter],
    /// Number of samples averaged before the filters apply.
    pub stride: usize,
    /// Number of blocks of the tests.
    pub blocks: usize,
}

/// Handling time of any experiment in addition to its duration, s.
const HANDLING: f64 = 600.0;
/// Number of effects that a proposal describes.
const SPOKEN: usize = 2;
/// Number of alternatives that are reported.
const MENTIONED: usize = 4;
/// Number of samples of the present data used, and of a window of about a tenth of a second.
const SAMPLES: usize = 2000;
const WINDOW: usize = 100;

impl Open<'_> {
    /// Experiment that distinguishes the first of `rivals` from the others at their fitted sizes; `None` if none can
    /// be planned.
    pub fn tell(&self, rivals: &[ActiveEffect]) -> Option<NextExperiment> {
        let plans = self.plans(rivals);
        // Rivals that no experiment of any duration distinguishes are ignored.
        let hopeless = |c: &Comparison| plans.iter().all(|p| p.of(&[*c], rivals).seconds.is_none());
        let pairs: Vec<Vec<Comparison>> = which(rivals.len()).chunks(2).map(<[_]>::to_vec).collect();
        let (alike, pairs): (Vec<_>, Vec<_>) = pairs.into_iter().partition(|both| both.iter().any(hopeless));
        let comparisons = if pairs.is_empty() { alike.concat() } else { pairs.concat() };
        let name = |i: usize| rivals[i].effect.name();
        let promise = |i: usize| (plans[i].experiment.clone(), plans[i].of(&comparisons, rivals));
        let ranked = ranked(parallel::map(plans.len(), promise).into_iter());
        let (experiment, promise) = ranked.first()?;
        let others: Vec<&str> = pairs.iter().map(|both| name(both[0].1.unwrap_or(0))).collect();
        let what = match others.is_empty() {
            true => format!(
                "{}, the best try: no known one distinguishes {} from its rivals",
                in_words(experiment),
                name(0)
            ),
            false => format!(
                "{}. It would distinguish {} from {}, {}",
                in_words(experiment),
                name(0),
                others.join(", "),
                chance(promise)
            ),
        };
        let (a, rival) = promise.worst;
        Some(NextExperiment {
            what,
            pair: [Some(a), rival].into_iter().flatten().map(|i| name(i).to_string()).collect(),
            ..proposal(experiment, promise, &ranked)
        })
    }

    /// Experiment that reveals `unseen` effects of their usual size at the least time per effect; `None` if none
    /// does.
    pub fn see(&self, unseen: &[ActiveEffect]) -> Option<NextExperiment> {
        let plans = self.plans(unseen);
        let shown = |i: usize| -> (Experiment, Vec<(usize, Prospect)>) {
            let one = |a: usize| (a, plans[i].of(&[(a, None)], unseen));
            let shown = (0..unseen.len()).map(one).filter(|(_, p)| p.chance >= SURE).collect();
            (plans[i].experiment.clone(), shown)
        };
        let mut all = parallel::map(plans.len(), shown);
        all.retain(|(_, shown)| !shown.is_empty());
        // Time per effect revealed.
        let cost = |(e, shown): &(Experiment, Vec<(usize, Prospect)>)| {
            (HANDLING + e.kind.preparation() + e.length) / shown.len() as f64
        };
        all.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
        let (experiment, shown) = all.first()?;
        let effects: Vec<&ActiveEffect> = shown.iter().map(|(a, _)| &unseen[*a]).collect();
        let ranked: Vec<_> = all.iter().map(|(e, s)| (e.clone(), hardest(s))).collect();
        let promise = hardest(shown);
        Some(NextExperiment {
            what: format!("{}. It would show {}: {}", in_words(experiment), chance(&promise), listed(&effects)),
            pair: vec![unseen[promise.worst.0].effect.name().to_string()],
            ..proposal(experiment, &promise, &ranked)
        })
    }

    /// Every experiment of the catalogue with the information of its data about `effects`.
    fn plans(&self, effects: &[ActiveEffect]) -> Vec<Plan> {
        let Some(first) = self.datasets.first() else { return Vec::new() };
        let channels = first.channels.clone();
        let filters = channels.iter().copied().zip(self.filters.iter().cloned()).collect();
        let noise = Noise { filters, dt: self.stride as f64 * first.dt };
        let mut present = Information::default();
        for dataset in self.datasets {
            let (part, weight) = self.coarse(dataset);
            if let Ok(information) = Information::along(self.model, self.fixed, effects, &part, &noise) {
                present.add(&information, weight);
            }
        }
        let (model, setup, datasets) = (self.model, first.setup, self.datasets);
        let bench = Bench { model, setup, channels, noise: &noise, datasets, seed: SEED };
        let catalogue = bench.catalogue();
        let own = |i: usize| Information::along(model, self.fixed, effects, &catalogue[i].dataset, &noise).ok();
        let own = parallel::map(catalogue.len(), own);
        let plan = |(experiment, own): (Experiment, Option<Information>)| {
            Some(Plan { experiment, own: own?, present: present.clone(), blocks: self.blocks })
        };
        catalogue.into_iter().zip(own).filter_map(plan).collect()
    }

    /// Equally spaced windows of an averaged dataset, and the ratio of the whole to the sampled part.
    fn coarse(&self, dataset: &Dataset) -> (Dataset, f64) {
        let averaged = dataset.averaged(self.stride);
        let windows: Vec<Range<usize>> = averaged.blocks(WINDOW.min(averaged.len())).collect();
        let every = stride_for(windows.len() * WINDOW, SAMPLES / self.datasets.len().max(1));
        let mut part = averaged.empty();
        for window in windows.into_iter().step_by(every) {
            let start = part.len();
            part.t.extend(&averaged.t[window.clone()]);
            part.joints.extend(&averaged.joints[window]);
            part.segments.push(start..part.len());
        }
        part.measured = vec![vec![0.0; part.len()].into(); part.channels.len()];
        let weight = averaged.len() as f64 / part.len().max(1) as f64;
        (part, weight)
    }
}

/// The first effects with what they are, and the number of the others.
fn listed(effects: &[&ActiveEffect]) -> String {
    let spoken = |a: &&ActiveEffect| format!("{} ({})", a.effect.spec().about.summary, a.effect.name());
    let first: Vec<String> = effects.iter().take(SPOKEN).map(spoken).collect();
    let more = match effects.len().saturating_sub(SPOKEN) {
        0 => String::new(),
        n => format!("; and {n} more"),
    };
    format!("{}{more}", first.join("; "))
}

/// Experiment that distinguishes the members of the first set; without a set, one that reveals what the data could
/// not.
pub(super) fn next(
    conclusion: &Conclusion,
    found: &Found,
    candidates: &[Vec<ActiveEffect>],
    fitting: &Fitting,
) -> Option<NextExperiment> {
    let ranking = &found.outcome.remaining;
    let end = &conclusion.end.fit.model;
    let open = |model| Open {
        model,
        fixed: fitting.fixed,
        datasets: fitting.datasets,
        filters: &ranking.filters,
        stride: problem::block(fitting.datasets),
        blocks: ranking.blocks,
    };
    if conclusion.verdict == Verdict::Unknown {
        return None;
    }
    match found.outcome.findings.iter().find(|f| f.ranking.confidence_set().len() > 1) {
        Some(finding) => {
            let rivals = rivals(finding, end, candidates);
            let names: Vec<&str> = rivals.iter().map(|a| a.effect.name()).collect();
            // An effect that imitates the others has moved the parameters of the model with it.
            let without = match found.outcome.findings.len() {
                1 => found.start.fit.model.clone(),
                _ => without_effects(end, &names),
            };
            open(&without).tell(&rivals)
        }
        None => {
            let unseen = ranking.candidates.iter().filter(|a| !a.is_revealed(&found.settings));
            let effects: Vec<ActiveEffect> =
                unseen.map(|a| candidates[a.candidate][a.variant].at_nominal_size()).collect();
            if effects.is_empty() { None } else { open(end).see(&effects) }
        }
    }
}

/// The effects that the data do not distinguish, starting with the one that was added: as fitted if it is in the
/// model, else with the size estimated by its test.
fn rivals(finding: &Finding, model: &Model, candidates: &[Vec<ActiveEffect>]) -> Vec<ActiveEffect> {
    let own = finding.chosen.candidate;
    let with_size = |a: &&Assessment| {
        let fitted = model.effects.iter().find(|e| e.effect.name() == a.name).filter(|_| a.candidate == own);
        let estimated = a.coefficients.iter().map(|c| (c.name.clone(), c.value));
        fitted.cloned().unwrap_or_else(|| sized(&candidates[a.candidate][a.variant], estimated))
    };
    let mut set = finding.ranking.confidence_set();
    set.sort_by_key(|a| a.candidate != own);
    set.iter().map(with_size).collect()
}

/// Seed of the proposed random motions.
const SEED: u64 = 17;

struct Plan {
    experiment: Experiment,
    own: Information,
    present: Information,
    blocks: usize,
}

impl Plan {
    fn of(&self, comparisons: &[Comparison], effects: &[ActiveEffect]) -> Prospect {
        prospect(comparisons, effects, Some(&self.present), (&self.own, &self.experiment), self.blocks)
    }
}

/// The prospect with the least power.
fn hardest(all: &[(usize, Prospect)]) -> Prospect {
    let least = all.iter().min_by(|a, b| a.1.chance.total_cmp(&b.1.chance));
    least.map(|(_, p)| p.clone()).expect("at least one effect is shown")
}

fn proposal(experiment: &Experiment, promise: &Prospect, ranked: &[(Experiment, Prospect)]) -> NextExperiment {
    let other = |(e, p): &(Experiment, Prospect)| (e.kind.name(), p.chance, p.seconds);
    NextExperiment {
        what: String::new(),
        kind: experiment.kind.name(),
        pair: Vec::new(),
        noncentrality: promise.noncentrality,
        chance: promise.chance,
        duration: experiment.length,
        seconds: promise.seconds,
        experiment: experiment.clone(),
        others: ranked.iter().skip(1).take(MENTIONED).map(other).collect(),
    }
}

/// `active` with the sizes estimated by the evidence as `(name, value)`, each name with its effect as prefix, within the ranges of
/// the law: estimates of what the data hardly determine leave them.
pub fn sized(active: &ActiveEffect, coefficients: impl Iterator<Item = (String, f64)>) -> ActiveEffect {
    let mut sized = active.clone();
    let entries = active.entries();
    for (name, value) in coefficients {
        let own = |e: &crate::effects::Entry| name == e.full_name();
        if let Some(i) = entries.iter().position(own) {
            let (low, high) = entries[i].parameter.range;
            sized.values[i] = value.clamp(low, high);
        }
    }
    sized
}

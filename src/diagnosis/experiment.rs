//! The experiment that would answer what the data leave open: which of several effects it is, or whether one is there at
//! all.

use std::ops::Range;

use rayon::prelude::*;

use super::answer::Verdict;
use super::conclusion::Conclusion;
use super::fitting::Fitting;
use super::problem;
use super::search::{Found, without_effects};
use crate::effects::ActiveEffect;
use crate::evidence::whiten::ArFilter;
use crate::evidence::{Assessment, Finding, Visibility};
use crate::excitation::experiments::{Bench, Experiment};
use crate::excitation::prospect::{Comparison, Information, Noise, Prospect, SURE, in_words, prospect, ranked, which};
use crate::identification::Dataset;
use crate::identification::dataset::stride_for;
use crate::model::Model;

/// A proposed experiment.
#[derive(Clone, Debug)]
pub struct NextExperiment {
    /// What to do and why, a sentence.
    pub what: String,
    /// Name of its kind.
    pub kind: &'static str,
    /// The two effects that are the hardest to tell apart, or the one effect that could be seen.
    pub pair: Vec<String>,
    /// δ² of the pair, of the experiment as planned, with the present data where they can be used together.
    pub noncentrality: f64,
    /// Chance of the answer from the experiment as planned.
    pub chance: f64,
    /// Length as planned, s.
    pub duration: f64,
    /// Time for a chance of 95 %, s; none if that would take for ever.
    pub seconds: Option<f64>,
    /// The experiment itself.
    pub experiment: Experiment,
    /// The others, best first: kind, chance, time needed.
    pub others: Vec<(&'static str, f64, Option<f64>)>,
}

/// What the data leave open.
pub struct Open<'a> {
    /// The machine as far as it is known, without the effects in question.
    pub model: &'a Model,
    /// Effects whose parameters are known.
    pub fixed: &'a [String],
    /// The data.
    pub datasets: &'a [Dataset],
    /// The noise left by the best model, as whitening filter of each channel.
    pub filters: &'a [ArFilter],
    /// Samples averaged into one before the filters apply.
    pub stride: usize,
    /// Blocks of time of the tests.
    pub blocks: usize,
}

/// Time that any experiment takes beside its own, s.
const HANDLING: f64 = 600.0;
/// Experiments worth mentioning beside the best.
const MENTIONED: usize = 4;
/// Samples of the present data used, in windows of a tenth of a second or so.
const SAMPLES: usize = 2000;
const WINDOW: usize = 100;

impl Open<'_> {
    /// The experiment that tells the first of `rivals`, by their fitted sizes, from the others.
    pub fn tell(&self, rivals: &[ActiveEffect]) -> Option<NextExperiment> {
        let plans = self.plans(rivals);
        // Rivals that no experiment could tell from the first, however long, set no standard.
        let hopeless = |c: &Comparison| plans.iter().all(|p| p.of(&[*c], rivals).seconds.is_none());
        let pairs: Vec<Vec<Comparison>> = which(rivals.len()).chunks(2).map(<[_]>::to_vec).collect();
        let (alike, pairs): (Vec<_>, Vec<_>) = pairs.into_iter().partition(|both| both.iter().any(hopeless));
        let comparisons = if pairs.is_empty() { alike.concat() } else { pairs.concat() };
        let name = |i: usize| rivals[i].effect.name();
        let promises: Vec<_> = plans.par_iter().map(|p| (p.experiment.clone(), p.of(&comparisons, rivals))).collect();
        let ranked = ranked(promises.into_iter());
        let (experiment, promise) = ranked.first()?;
        let others: Vec<&str> = pairs.iter().map(|both| name(both[0].1.unwrap_or(0))).collect();
        let goal = match others.is_empty() {
            true => format!("no known experiment tells {} from its rivals; the best try", name(0)),
            false => format!("to tell {} from {}", name(0), others.join(", ")),
        };
        let (a, rival) = promise.worst;
        Some(NextExperiment {
            what: format!("{goal}: {}", in_words(experiment, promise)),
            pair: [Some(a), rival].into_iter().flatten().map(|i| name(i).to_string()).collect(),
            ..proposal(experiment, promise, &ranked)
        })
    }

    /// The experiment that shows most of `unseen`, effects of their usual size.
    pub fn see(&self, unseen: &[ActiveEffect]) -> Option<NextExperiment> {
        let plans = self.plans(unseen);
        let shown = |plan: &Plan| -> Vec<(usize, Prospect)> {
            let one = |a: usize| (a, plan.of(&[(a, None)], unseen));
            (0..unseen.len()).map(one).filter(|(_, p)| p.chance >= SURE).collect()
        };
        let mut all: Vec<(Experiment, Vec<(usize, Prospect)>)> =
            plans.par_iter().map(|p| (p.experiment.clone(), shown(p))).filter(|(_, s)| !s.is_empty()).collect();
        // Time per effect that is shown.
        let cost = |(e, shown): &(Experiment, Vec<(usize, Prospect)>)| {
            (HANDLING + e.kind.preparation() + e.length) / shown.len() as f64
        };
        all.sort_by(|a, b| cost(a).total_cmp(&cost(b)));
        let (experiment, shown) = all.first()?;
        let names: Vec<String> = shown.iter().map(|(a, _)| unseen[*a].effect.name().to_string()).collect();
        let ranked: Vec<_> = all.iter().map(|(e, s)| (e.clone(), hardest(s))).collect();
        let promise = hardest(shown);
        Some(NextExperiment {
            what: format!("to see whether there is {}: {}", names.join(", "), in_words(experiment, &promise)),
            pair: vec![unseen[promise.worst.0].effect.name().to_string()],
            ..proposal(experiment, &promise, &ranked)
        })
    }

    /// Every experiment of the catalogue with what its data will hold about `effects`.
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
        let plan = |experiment: Experiment| {
            let own = Information::along(model, self.fixed, effects, &experiment.dataset, &noise).ok()?;
            Some(Plan { experiment, own, present: present.clone(), blocks: self.blocks })
        };
        bench.catalogue().into_par_iter().filter_map(plan).collect()
    }

    /// Evenly spread windows of a dataset, averaged, and the share of the whole that they stand for, inverted.
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
        part.measured = vec![vec![0.0; part.len()]; part.channels.len()];
        let weight = averaged.len() as f64 / part.len().max(1) as f64;
        (part, weight)
    }
}

/// The experiment that tells the members of the first set apart; without a set, the one that shows what the data could not.
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
        stride: problem::BLOCK,
        blocks: ranking.blocks,
    };
    if conclusion.verdict == Verdict::Unknown {
        return None;
    }
    match found.outcome.findings.iter().find(|f| f.ranking.confidence_set().len() > 1) {
        Some(finding) => {
            let rivals = rivals(finding, end, candidates);
            let names: Vec<&str> = rivals.iter().map(|a| a.effect.name()).collect();
            open(&without_effects(end, &names)).tell(&rivals)
        }
        None => {
            let unseen = ranking.candidates.iter().filter(|a| a.visibility != Visibility::Visible);
            let effects: Vec<ActiveEffect> =
                unseen.map(|a| candidates[a.candidate][a.variant].at_nominal_size()).collect();
            if effects.is_empty() { None } else { open(end).see(&effects) }
        }
    }
}

/// The effects that the data do not tell apart, the one that was added first: as fitted if it is in the model, else of the
/// size that its test found.
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

/// Seed of the random motions that are proposed.
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

/// The least certain of several prospects.
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

/// `active` with the sizes that the evidence found for it, `(name, value)` with the effect's name before each.
pub fn sized(active: &ActiveEffect, coefficients: impl Iterator<Item = (String, f64)>) -> ActiveEffect {
    let mut sized = active.clone();
    let entries = active.entries();
    for (name, value) in coefficients {
        let own = |e: &crate::effects::Entry| name == e.full_name();
        if let Some(i) = entries.iter().position(own) {
            sized.values[i] = value;
        }
    }
    sized
}

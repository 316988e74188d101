//! Expected outcome of an experiment that has not been performed.
//!
//! The columns of all parameters and of the effects in question along the planned motion give inner products
//! ([`Information`]); those of existing data are added parameter by parameter. They determine the non-centrality of
//! the comparison of effects ([`crate::evidence::separation`]), its power, and, as information grows with time, the
//! time needed.

use nalgebra::{DMatrix, DVector};

use super::experiments::Experiment;
use crate::effects::{ActiveEffect, Role};
use crate::evidence::separation;
use crate::evidence::whiten::ArFilter;
use crate::identification::Dataset;
use crate::identification::prediction::{Channels, columns_with};
use crate::kinematics::KinematicsError;
use crate::model::Model;
use crate::numerics::{bisect, halvings};
use crate::recording::Channel;

/// Power that counts as certain.
pub const SURE: f64 = 0.95;
/// Level of the test for the presence of an effect.
const ALPHA: f64 = 0.05;
/// Range of the ratio of an experiment's duration to the planned one.
const STRETCH: [f64; 2] = [1e-2, 1e3];
/// Relative accuracy of the time needed.
const RESOLUTION: f64 = 0.05;

/// Whitening filter of each channel.
#[derive(Clone, Debug)]
pub struct Noise {
    /// Channels whose noise is known.
    pub filters: Vec<(Channel, ArFilter)>,
    /// Sampling period that the filters belong to, s.
    pub dt: f64,
}

impl Noise {
    /// White noise of a model's sensors, averaged from the model's sampling period to `dt` (s).
    pub fn of(model: &Model, channels: &[Channel], dt: f64) -> Self {
        let filters = channels.iter().map(|&c| (c, white(model, c, dt))).collect();
        Self { filters, dt }
    }

    fn filter(&self, model: &Model, channel: Channel) -> ArFilter {
        let known = self.filters.iter().find(|(c, _)| *c == channel).map(|(_, f)| f.clone());
        known.unwrap_or_else(|| white(model, channel, self.dt))
    }
}

fn white(model: &Model, channel: Channel, dt: f64) -> ArFilter {
    let sigma = channel.drive().map_or(model.noise.strut_force, |i| model.noise.torque[i]);
    ArFilter::scale(sigma / (dt / model.sample_time).max(1.0).sqrt())
}

/// Inner products of whitened columns, each with the name of its parameter.
#[derive(Clone, Debug, Default)]
pub struct Information {
    names: Vec<String>,
    gram: DMatrix<f64>,
}

impl Information {
    /// Inner products along a dataset of the columns of the parameters of `model`, except those of `fixed` effects,
    /// and of `effects`, which are not in it. An effect that does not act in the dataset's configuration has no
    /// columns.
    ///
    /// # Errors
    /// The error of the kinematics for a pose outside the workspace, or of a force law that gives no finite value.
    pub fn along(
        model: &Model,
        fixed: &[String],
        effects: &[ActiveEffect],
        dataset: &Dataset,
        noise: &Noise,
    ) -> Result<Self, KinematicsError> {
        let plant = dataset.plant(model);
        let mut names = Vec::new();
        let mut stacked: Vec<Vec<f64>> = Vec::new();
        let mut keep = |name: String, column: &Channels| {
            let values = column.concat();
            if values.iter().any(|v| *v != 0.0) {
                names.push(name);
                stacked.push(values);
            }
        };
        let mounted: Vec<ActiveEffect> = effects.iter().filter(|a| plant.has(a.effect.acts_on())).cloned().collect();
        // Shape parameters are fitted as well, so their columns are needed.
        let mut all = columns_with(&plant, dataset, &mounted)?;
        let own = all.split_off(all.len() - mounted.len());
        let parameters = plant.parameters();
        for k in parameters.free(fixed) {
            keep(parameters[k].name.clone(), parameters.pick(k, &all));
        }
        for (active, own) in mounted.iter().zip(own) {
            let entries = active.entries();
            for (entry, column) in entries.iter().zip(&own).filter(|(e, _)| e.parameter.role != Role::Fixed) {
                keep(entry.full_name(), column);
            }
        }
        let filters: Vec<ArFilter> = dataset.channels.iter().map(|&c| noise.filter(model, c)).collect();
        let columns: Vec<&[f64]> = stacked.iter().map(Vec::as_slice).collect();
        let gram = separation::information(&columns, dataset.len(), &dataset.segments, &filters);
        Ok(Self { names, gram })
    }

    /// Adds `factor` times `other`, parameter by parameter.
    pub fn add(&mut self, other: &Self, factor: f64) {
        let place: Vec<usize> = other
            .names
            .iter()
            .map(|name| {
                self.names.iter().position(|n| n == name).unwrap_or_else(|| {
                    self.names.push(name.clone());
                    self.names.len() - 1
                })
            })
            .collect();
        self.gram.resize_mut(self.names.len(), self.names.len(), 0.0);
        for (i, &a) in place.iter().enumerate() {
            for (j, &b) in place.iter().enumerate() {
                self.gram[(a, b)] += factor * other.gram[(i, j)];
            }
        }
    }

    /// Columns of `effect` with its sizes: the values of linear parameters, zero for others that are fitted as well.
    fn own(&self, active: &ActiveEffect) -> (Vec<usize>, DVector<f64>) {
        let (mut place, mut sizes) = (Vec::new(), Vec::new());
        for (entry, value) in active.entries().iter().zip(&active.values) {
            let name = entry.full_name();
            if let Some(i) = self.names.iter().position(|n| *n == name) {
                place.push(i);
                sizes.push(if entry.parameter.role == Role::Linear { *value } else { 0.0 });
            }
        }
        (place, DVector::from_vec(sizes))
    }

    /// δ² of effect `a` relative to the model alone, or with a rival in `effects` relative to model and rival.
    fn noncentrality(&self, effects: &[ActiveEffect], a: usize, rival: Option<usize>) -> f64 {
        let all: Vec<Vec<usize>> = effects.iter().map(|e| self.own(e).0).collect();
        let (own, sizes) = self.own(&effects[a]);
        let base = (0..self.names.len()).filter(|i| all.iter().all(|columns| !columns.contains(i)));
        let imitators: Vec<usize> = base.chain(rival.iter().flat_map(|&k| all[k].iter().copied())).collect();
        if own.is_empty() { 0.0 } else { separation::noncentrality(&self.gram, &own, &sizes, &imitators) }
    }
}

/// An effect and its alternative: a rival, or with `None` the model without both.
pub type Comparison = (usize, Option<usize>);

/// Comparisons of the first of `effects` with every other one, in both directions.
pub fn which(effects: usize) -> Vec<Comparison> {
    (1..effects).flat_map(|k| [(0, Some(k)), (k, Some(0))]).collect()
}

/// Expected outcome of an experiment.
#[derive(Clone, Debug)]
pub struct Prospect {
    /// The comparison with the least power.
    pub worst: Comparison,
    /// Its δ² for the whole experiment as planned.
    pub noncentrality: f64,
    /// Its power for the experiment as planned.
    pub chance: f64,
    /// Duration for a power of [`SURE`], s; `None` if no duration suffices.
    pub seconds: Option<f64>,
}

/// Expected outcome of an experiment with the information `new` in addition to `present`, with `blocks` blocks.
///
/// # Panics
/// If `comparisons` is empty.
pub fn prospect(
    comparisons: &[Comparison],
    effects: &[ActiveEffect],
    present: Option<&Information>,
    (new, experiment): (&Information, &Experiment),
    blocks: usize,
) -> Prospect {
    let after = |times: f64| {
        let mut sum = present.filter(|_| !experiment.alone).cloned().unwrap_or_default();
        sum.add(new, times * experiment.weight);
        let one = |&worst: &Comparison| {
            let (a, rival) = worst;
            let noncentrality = sum.noncentrality(effects, a, rival);
            let chance = match rival {
                Some(_) => separation::chance(noncentrality, blocks),
                None => separation::chance_to_see(noncentrality, sum.own(&effects[a]).0.len(), blocks, ALPHA),
            };
            Prospect { worst, noncentrality, chance, seconds: None }
        };
        let all = comparisons.iter().map(one);
        all.min_by(|x, y| x.chance.total_cmp(&y.chance).then(x.noncentrality.total_cmp(&y.noncentrality)))
            .expect("something to compare")
    };
    let [low, high] = STRETCH.map(f64::ln);
    let sure = |log: f64| after(log.exp()).chance >= SURE;
    let last = || bisect([low, high], halvings(high - low, RESOLUTION), |log| !sure(log))[1];
    let seconds = sure(high).then(|| last().exp() * experiment.length);
    Prospect { seconds, ..after(1.0) }
}

/// Duration below which the handling of an experiment dominates, s.
const SHORT: f64 = 60.0;

/// Experiments by ascending cost (preparation and time needed, at least a minute); equal cost by descending δ², per
/// second where no duration suffices.
pub fn ranked(all: impl Iterator<Item = (Experiment, Prospect)>) -> Vec<(Experiment, Prospect)> {
    let mut all: Vec<(Experiment, Prospect)> = all.collect();
    let cost = |(e, p): &(Experiment, Prospect)| {
        p.seconds.map_or(f64::INFINITY, |s| e.kind.preparation() + s.max(e.length).max(SHORT))
    };
    let promise = |(e, p): &(Experiment, Prospect)| p.noncentrality / if p.seconds.is_some() { 1.0 } else { e.length };
    all.sort_by(|a, b| cost(a).total_cmp(&cost(b)).then(promise(b).total_cmp(&promise(a))));
    all
}

/// Description of an experiment with its length, for a sentence.
pub fn in_words(experiment: &Experiment) -> String {
    format!("{} for {}", experiment.what, duration(experiment.length))
}

/// The chance that an experiment shows something, and the length for 95 %.
pub fn chance(promise: &Prospect) -> String {
    let needed = match promise.seconds {
        Some(s) if s < 1.0 => "95 % after less than 1 s".into(),
        Some(s) => format!("95 % after {}", duration(s)),
        None => "no length is enough for 95 %".into(),
    };
    format!("with a chance of {:.0} % ({needed})", 100.0 * promise.chance)
}

/// Duration as text.
pub fn duration(seconds: f64) -> String {
    match seconds {
        s if s < 10.0 => format!("{s:.1} s"),
        s if s < 300.0 => format!("{s:.0} s"),
        s => format!("{:.0} min", s / 60.0),
    }
}

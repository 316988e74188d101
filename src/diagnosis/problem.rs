//! Statistical problem of a model and its recordings: residuals, columns of its parameters, and columns of every
//! effect that it lacks.

use std::ops::Range;
use std::sync::{Arc, PoisonError};

use super::DiagnosisError;
use super::change::can_change;
use super::fitting::Fitting;
use super::progress::Progress;
use crate::dynamics::Plant;
use crate::effects::{ActiveEffect, Entry, Kind, Param, Role};
use crate::evidence::{Candidate, Channel, Column, Problem, Variant};
use crate::identification::dataset::{averaged_segments, runs};
use crate::identification::fit::{Fit, FitError, kinematics, nominal_size};
use crate::identification::prediction::{CandidateColumns, Channels, Laws, own_columns, reported};
use crate::identification::{Dataset, KeptColumns, NoiseLevel, Residuals};
use crate::kinematics::KinematicsError;
use crate::machine::Mechanism;
use crate::model::Model;
use crate::recording::Channel::Torque;
use crate::recording::{Series, Signals};

/// Error next to reversals from which it is an effect's, and not that of smoothing the motion: root mean square in units of
/// the noise, and share of the error above the noise. Elastic gears left 16 and 0.37 to 0.39. Smaller in one of both were a
/// wrong strut length over coarse encoders (4 and 0.66), friction at low speed (4 and 0.4), and sockets (8 and 0.14).
const REAL: (f64, f64) = (10.0, 1.0 / 3.0);

/// Time over which the samples of a lone axis are averaged, s: it keeps nine tenths of the amplitude at 125 Hz, as the
/// ripple of its motor.
const AVERAGED: f64 = 2e-3;

/// Number of samples of a robot that are averaged, and longest time, s: most of its laws are slower than 25 Hz, and the noise
/// model reaches further back.
const ROBOT: (usize, f64) = (5, 20e-3);

/// Number of samples averaged into one; one sample of slow recordings.
pub fn block(datasets: &[Dataset]) -> usize {
    let of = |t: &Dataset| match t.channels.iter().filter(|c| c.drive().is_some()).count() {
        1 => t.stride(AVERAGED),
        _ => t.stride(ROBOT.1).min(ROBOT.0),
    };
    datasets.iter().map(of).min().unwrap_or(1)
}

/// Share of its usual magnitude below which an effect is not of practical interest.
const WORTH_CARING: f64 = 0.3;

/// RMS contribution of an effect of usual magnitude on a lone axis, relative to the measured torque or force.
const USUAL_SHARE: f64 = 0.1;

/// Shapes of candidates whose columns are computed together: laws on the known motion and sensors on the known torques, and
/// effects that act through the entire prediction.
const LAWS: usize = 32;
const WHOLES: usize = 4;

/// Fits whose columns are kept.
const KEPT: usize = 6;

impl Fitting<'_> {
    /// Linearised problem of a fit: residuals and columns of its parameters and of the candidates, averaged over
    /// [`block`] samples; those next to reversals count where the error there is real. Fixed parameters are omitted; the
    /// others are restricted by the active consistency constraints according to `edges`. `progress` is called with the number
    /// of candidates whose columns are computed.
    pub fn problem(
        &self,
        fit: &Fit,
        candidates: &[Vec<ActiveEffect>],
        edges: Edges,
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Problem, DiagnosisError> {
        let (rms, share) = fit.residuals.uncounted(&self.noise.of_each);
        let is_real = rms > REAL.0 && share > REAL.1;
        let (segments, samples) = if is_real { segments(self.datasets) } else { determined(self.datasets) };
        let base = self.base(fit, edges)?;
        let columns = self.candidate_columns(&fit.model, candidates, progress)?;
        let mut columns = columns.into_iter();
        let mut candidate = |shapes: &Vec<ActiveEffect>| {
            let variant = |active| Variant { label: label(active), columns: columns.next().expect("one per shape") };
            Candidate { name: shapes[0].effect.name().into(), variants: shapes.iter().map(variant).collect() }
        };
        Ok(Problem {
            channels: self.channels(),
            samples,
            segments,
            y: self.residual_series(&fit.residuals),
            base,
            candidates: candidates.iter().map(&mut candidate).collect(),
        })
    }

    /// The problem of a fit that differs from the one of `problem` in its parameters and by the delay `late` of all
    /// torques. The columns of the `candidates` are delayed as those of the model are; only sensors, which may follow
    /// torques faster than the averages, are computed again.
    pub fn delayed(
        &self,
        problem: &Problem,
        candidates: &[Vec<ActiveEffect>],
        (fit, late): (&Fit, &ActiveEffect),
        edges: Edges,
    ) -> Result<Problem, DiagnosisError> {
        let datasets = self.datasets;
        let is_sensor = |shapes: &Vec<ActiveEffect>| shapes[0].effect.kind() == Kind::Sensor;
        let sensors: Vec<Vec<ActiveEffect>> = candidates.iter().filter(|shapes| is_sensor(shapes)).cloned().collect();
        let base = self.base(fit, edges)?;
        let columns = self.candidate_columns(&fit.model, &sensors, &mut |_| {})?;
        let mut next = Problem { y: self.residual_series(&fit.residuals), base, ..problem.clone() };
        let mut columns = columns.into_iter();
        for (candidate, shapes) in next.candidates.iter_mut().zip(candidates) {
            for variant in &mut candidate.variants {
                if is_sensor(shapes) {
                    variant.columns = columns.next().expect("one per shape");
                } else {
                    variant.columns.iter_mut().for_each(|column| report(datasets, late, &mut column.values));
                }
            }
        }
        Ok(next)
    }

    /// Linearised problem of a change after the first `before` recordings: the columns of the candidates are zero in
    /// these. The candidates are the effects of the model, each with its linear parameters, and those of `absent`.
    pub fn change(
        &self,
        model: &Model,
        before: usize,
        absent: &[Vec<ActiveEffect>],
    ) -> Result<Problem, DiagnosisError> {
        let datasets = self.datasets;
        let (segments, samples) = determined(datasets);
        let first = self::segments(&datasets[..before]).1;
        let later = |column: &Column| {
            let mut values = column.values.clone();
            values.chunks_mut(samples).for_each(|channel| channel[..first].fill(0.0));
            Column { values, ..column.clone() }
        };
        let owned = self.owned_columns(model)?;
        let columns = self.candidate_columns(model, absent, &mut |_| {})?;
        let mut candidates: Vec<Candidate> = Vec::new();
        for o in owned.iter().filter(|o| o.linear.is_some() && can_change(o.param.effect)) {
            let column = Column { magnitude: WORTH_CARING * o.column.magnitude, ..later(&o.column) };
            match candidates.last_mut().filter(|c| c.name == o.param.effect) {
                Some(own) => own.variants[0].columns.push(column),
                None => {
                    let variant = Variant { label: String::new(), columns: vec![column] };
                    candidates.push(Candidate { name: o.param.effect.into(), variants: vec![variant] });
                }
            }
        }
        let mut columns = columns.iter();
        let mut next = || columns.next().expect("one per shape").iter().map(later).collect();
        candidates.extend(absent.iter().map(|shapes| Candidate {
            name: shapes[0].effect.name().into(),
            variants: shapes.iter().map(|active| Variant { label: label(active), columns: next() }).collect(),
        }));
        Ok(Problem {
            channels: self.channels(),
            samples,
            segments,
            y: self.residual_series(&Residuals::new(model, datasets)?),
            base: owned.into_iter().map(|o| o.column).chain(self.blurred_reversals()).collect(),
            candidates,
        })
    }

    /// Columns of the parameters of a fit that are not fixed, along its active consistency constraints, and of the smoothing
    /// error at reversals.
    pub fn base(&self, fit: &Fit, edges: Edges) -> Result<Vec<Column>, FitError> {
        let owned = self.columns_of(fit)?.iter().filter(|o| !self.is_fixed(o.param)).cloned().collect();
        Ok(along_edges(owned, fit, edges).into_iter().chain(self.blurred_reversals()).collect())
    }

    /// Columns of all estimated parameters of a fit, as [`Self::owned_columns`]; the last [`KEPT`] fits keep theirs.
    pub fn columns_of(&self, fit: &Fit) -> Result<OwnedColumns, FitError> {
        let kept = || self.columns.lock().unwrap_or_else(PoisonError::into_inner);
        let is_of_fit = |(residuals, _): &&(Arc<Residuals>, OwnedColumns)| Arc::ptr_eq(residuals, &fit.residuals);
        let known = kept().iter().find(is_of_fit).map(|(_, columns)| Arc::clone(columns));
        if let Some(columns) = known {
            return Ok(columns);
        }
        let made = Arc::new(self.owned_columns(&fit.model)?);
        let mut kept = kept();
        if kept.len() == KEPT {
            kept.remove(0);
        }
        kept.push((Arc::clone(&fit.residuals), Arc::clone(&made)));
        Ok(made)
    }

    /// Columns of all estimated parameters of a model except those that the motion does not excite.
    pub fn owned_columns(&self, model: &Model) -> Result<Vec<Owned>, FitError> {
        let plants: Vec<Plant> = self.datasets.iter().map(|t| t.plant(model)).collect();
        let parameters = plants[0].parameters();
        let all = self.each(&plants, own_columns)?;
        let free = parameters.free(&[]).into_iter().map(|k| (k, &parameters[k]));
        let owned = free.map(|(k, p)| Owned {
            param: p.param,
            linear: (p.role == Role::Linear).then_some(p.value),
            column: Column {
                name: p.name.clone(),
                values: stack(&self.noise, all.iter().map(|dataset| parameters.pick(k, dataset))),
                magnitude: nominal_size(p),
            },
        });
        Ok(owned.filter(|o| o.column.values.iter().any(|v| (v * o.column.magnitude).abs() > NOT_EXCITED)).collect())
    }

    /// Columns of the linear parameters of each shape of the candidates in sequence, added to the model with its initial
    /// values. Between groups of shapes the diagnosis may be stopped, and `progress` is called with the candidates done.
    fn candidate_columns(
        &self,
        model: &Model,
        candidates: &[Vec<ActiveEffect>],
        progress: &mut dyn FnMut(Progress),
    ) -> Result<Vec<Vec<Column>>, DiagnosisError> {
        let measured = rms(self.datasets.iter().flat_map(|t| t.measured[0].iter().copied()));
        let magnitude = |e: &Entry, values: &[f64]| match model.mechanism {
            Mechanism::Delta { .. } => WORTH_CARING * e.parameter.default.abs(),
            // The usual size on a lone axis is relative to its torque, because its limits are often estimates.
            Mechanism::Axis(_) => WORTH_CARING * USUAL_SHARE * measured / rms(values.iter().copied()),
        };
        let owners: Vec<usize> =
            candidates.iter().enumerate().flat_map(|(k, shapes)| std::iter::repeat_n(k, shapes.len())).collect();
        let mut left = vec![0; candidates.len()];
        let candidates = candidates.concat();
        let sources = sources(&candidates);
        let is_source = |i: &usize| sources[*i].contains(i);
        (0..owners.len()).filter(is_source).for_each(|i| left[owners[i]] += 1);
        let kind = |i: &usize| candidates[*i].effect.kind();
        let is_whole = |i: &usize| kind(i).acts_on_the_whole() && kind(i) != Kind::Sensor;
        let (wholes, laws): (Vec<usize>, Vec<usize>) = (0..candidates.len()).filter(is_source).partition(is_whole);
        let mut columns = vec![Vec::new(); candidates.len()];
        let plants: Vec<Plant> = self.datasets.iter().map(|t| t.plant(model)).collect();
        let along = self.each(&plants, CandidateColumns::new)?;
        for group in laws.chunks(LAWS).chain(wholes.chunks(WHOLES)) {
            self.go_on()?;
            let own: Vec<ActiveEffect> = group.iter().map(|&i| candidates[i].clone()).collect();
            let all = self.datasets.iter().zip(&along).map(|(t, along)| along.of(&own).map_err(kinematics(t)));
            let all: Vec<Vec<Vec<Channels>>> = all.collect::<Result<_, FitError>>()?;
            for (j, &i) in group.iter().enumerate() {
                let column = |(k, e): (usize, Entry)| {
                    let values = stack(&self.noise, all.iter().map(|dataset| &dataset[j][k]));
                    let size = magnitude(&e, &values);
                    Column { name: e.full_name(), values, magnitude: if size.is_finite() { size } else { 0.0 } }
                };
                columns[i] = linear(&candidates[i]).map(column).collect();
                left[owners[i]] -= 1;
            }
            progress(Progress::Candidates { done: left.iter().filter(|n| **n == 0).count(), of: left.len() });
        }
        let of = |own: &Vec<usize>| own.iter().enumerate().map(|(k, &source)| columns[source][k].clone()).collect();
        Ok(sources.iter().map(of).collect())
    }

    /// What `of` makes of the plant of every recording, with the length of a [`block`] and the columns that are known.
    fn each<'p, T>(
        &'p self,
        plants: &'p [Plant],
        of: impl Fn(&'p Plant, &'p Dataset, usize, Laws) -> Result<T, KinematicsError>,
    ) -> Result<Vec<T>, FitError> {
        let block = block(self.datasets);
        let one = |(kept, plant): (&'p KeptColumns, &'p Plant)| {
            let made = kept.laws(plant).and_then(|known| of(plant, kept.dataset, block, known));
            made.map_err(kinematics(kept.dataset))
        };
        self.kept.iter().zip(plants).map(one).collect()
    }

    /// Columns of the smoothing error of friction at the reversals of recordings that do not resolve them.
    ///
    /// Friction jumps when an axis reverses; that of the smoothed rate changes over a time that the recording does not tell.
    /// The difference is odd about the reversal and decays away from it, as s·sgn(t − t_r)·exp(−|t − t_r|/T), s the new
    /// direction, with one column per time constant T between two samples and the half width of the differentiation.
    pub fn blurred_reversals(&self) -> Vec<Column> {
        let datasets = self.datasets;
        if !datasets.iter().any(Dataset::blurs_reversals) {
            return Vec::new();
        }
        let block = block(datasets);
        let drives: Vec<usize> = datasets[0].channels.iter().filter_map(|c| c.drive()).collect();
        let mut all = Vec::new();
        for &drive in &drives {
            let reach = datasets.iter().map(|t| t.half_width[drive] as f64 * t.dt).fold(0.0, f64::max);
            let least = 2.0 * datasets.iter().map(|t| t.dt).fold(0.0, f64::max);
            for k in 0..BLURS {
                let decay = least * (reach / least).max(1.0).powf(k as f64 / (BLURS - 1) as f64);
                let blurred = |t: &Dataset| {
                    let mut channels = vec![vec![0.0; t.blocks(block).count()]; t.channels.len()];
                    channels[drive] = t.means(&blur(t, drive, decay), block);
                    channels
                };
                let parts: Vec<Channels> = datasets.iter().map(blurred).collect();
                let values = stack(&self.noise, parts.iter());
                if values.iter().any(|v| *v != 0.0) {
                    all.push(Column { name: format!("reversals {}.{}", drive + 1, k + 1), values, magnitude: 0.0 });
                }
            }
        }
        all
    }

    /// Residuals of the fitted recordings as one series.
    pub fn residual_series(&self, residuals: &Residuals) -> Series {
        residual_series(self.datasets, &self.noise, residuals)
    }

    /// Channels with the noise of their means over [`block`] samples.
    fn channels(&self) -> Vec<Channel> {
        let scale = (block(self.datasets) as f64).sqrt();
        let sigma = |c: usize| self.noise_of_means.get(c).copied().flatten().unwrap_or(self.noise.pooled[c] / scale);
        let channels = self.datasets[0].channels.iter().enumerate();
        channels.map(|(c, channel)| Channel { name: channel.to_string(), noise_sigma: Some(sigma(c)) }).collect()
    }
}

/// Applies an effect on the reported torques to a column, which has the samples of all datasets for one channel after the
/// other.
pub fn report(datasets: &[Dataset], sensor: &ActiveEffect, values: &mut [f64]) {
    let block = block(datasets);
    let samples = values.len() / datasets[0].channels.len();
    let drives = datasets[0].channels.iter().filter(|c| c.drive().is_some()).count();
    let mut first = 0;
    for dataset in datasets {
        let own = averaged_segments(std::slice::from_ref(dataset), block);
        let recorded = dataset.segments.iter().filter(|s| s.len() >= block);
        for (segment, recorded) in own.iter().map(|s| first + s.start..first + s.end).zip(recorded) {
            let times = (0..segment.len()).map(|k| k as f64 * block as f64 * dataset.dt).collect();
            let mut ideal = Signals::new(sensor.host.mechanism, times);
            let own = |axis: usize| axis * samples + segment.start..axis * samples + segment.end;
            (0..drives).for_each(|axis| ideal.set(Torque(axis), values[own(axis)].to_vec()));
            let signals = reported(ideal, &[sensor], !dataset.motion_before(recorded.start).is_empty());
            (0..drives).for_each(|axis| values[own(axis)].copy_from_slice(&signals[Torque(axis)]));
        }
        first += own.last().map_or(0, |s| s.end);
    }
}

/// Linear parameters of an effect with their places among its values.
fn linear(active: &ActiveEffect) -> impl Iterator<Item = (usize, Entry)> {
    active.entries().into_iter().enumerate().filter(|(_, e)| e.parameter.role == Role::Linear)
}

/// For each linear parameter of each shape the first shape with the same column, its own where no earlier one is alike.
fn sources(shapes: &[ActiveEffect]) -> Vec<Vec<usize>> {
    let of_item = |active: &ActiveEffect, item: usize| -> Vec<f64> {
        let entries = active.entries().into_iter().zip(&active.values);
        entries.filter(|(e, _)| e.parameter.role != Role::Linear && e.param.item == item).map(|(_, v)| *v).collect()
    };
    let is_alike = |a: &ActiveEffect, b: &ActiveEffect, item: usize| {
        a.effect.name() == b.effect.name() && of_item(a, item) == of_item(b, item)
    };
    let source = |i: usize, item: usize| match shapes[i].effect.spec().search.is_by_item {
        true => (0..i).find(|&j| is_alike(&shapes[j], &shapes[i], item)).unwrap_or(i),
        false => i,
    };
    (0..shapes.len()).map(|i| linear(&shapes[i]).map(|(_, e)| source(i, e.param.item)).collect()).collect()
}

fn label(active: &ActiveEffect) -> String {
    let shape = active.entries().into_iter().zip(&active.values).find(|(e, _)| e.parameter.role == Role::Shape);
    shape.map_or_else(String::new, |(e, v)| format!("{} = {v} {}", e.name, e.parameter.unit))
}

/// Column with the identity of its parameter.
#[derive(Clone)]
pub struct Owned {
    /// The parameter.
    pub param: Param,
    /// Present value; `None` for a parameter that enters nonlinearly.
    pub linear: Option<f64>,
    /// The column.
    pub column: Column,
}

/// Columns of all parameters of a fit.
pub type OwnedColumns = Arc<Vec<Owned>>;

/// Contribution of a parameter of usual size below which it counts as not excited, N·m or N.
const NOT_EXCITED: f64 = 1e-9;

/// Restriction of the parameters by the active consistency constraints of a fit.
///
/// If the model lacks an effect, some of these constraints may become inactive after its addition; tests of a
/// candidate do not determine which.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Edges {
    /// One restricted direction: the sum of all constraint normals.
    Together,
    /// One restricted direction per constraint.
    Apart,
}

/// Restricts the parameters to directions along the active consistency constraints of a fit.
pub fn along_edges(mut base: Vec<Owned>, fit: &Fit, edges: Edges) -> Vec<Column> {
    restrict(&mut base, fit, edges);
    base.into_iter().map(|o| o.column).collect()
}

/// A parameter that follows others: its name, and their names with the factors of its change.
pub type Follower = (String, Vec<(String, f64)>);

/// Parameters that [`along_edges`] leaves out of `base`, in the order in which it does so.
pub fn followers(mut base: Vec<Owned>, fit: &Fit, edges: Edges) -> Vec<Follower> {
    restrict(&mut base, fit, edges)
}

fn restrict(base: &mut Vec<Owned>, fit: &Fit, edges: Edges) -> Vec<Follower> {
    match edges {
        Edges::Together => along_edge(base, &fit.edges.concat()).into_iter().collect(),
        Edges::Apart => fit.edges.iter().filter_map(|edge| along_edge(base, edge)).collect(),
    }
}

/// Restricts the parameters to directions along one constraint, given by its normal force per parameter. Returns the
/// parameter that follows the others.
///
/// With the normal force n, a step d along the constraint has n·d = 0: the parameter with the largest force depends
/// on the others, d_k = −Σ n_j/n_k·d_j, and its column is added to theirs.
fn along_edge(base: &mut Vec<Owned>, edge: &[(Param, f64)]) -> Option<Follower> {
    let pull = |o: &Owned| edge.iter().find(|(param, _)| *param == o.param).map_or(0.0, |(_, n)| *n);
    let weight = |o: &Owned| (pull(o) * o.column.magnitude).abs();
    let most = (0..base.len()).max_by(|&a, &b| weight(&base[a]).total_cmp(&weight(&base[b])));
    let k = most.filter(|&k| weight(&base[k]) > 0.0)?;
    let fixed = base.remove(k);
    let mut factors = Vec::new();
    for o in base.iter_mut() {
        let share = pull(o) / pull(&fixed);
        if share != 0.0 {
            o.column.values.iter_mut().zip(&fixed.column.values).for_each(|(x, h)| *x -= share * h);
            factors.push((o.column.name.clone(), -share));
        }
    }
    Some((fixed.column.name, factors))
}

/// Root mean square; NaN without values.
fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0usize), |(sum, n), x| (sum + x * x, n + 1));
    (sum / n as f64).sqrt()
}

/// Number of time constants of the smoothing error at reversals.
const BLURS: usize = 4;

/// Smoothing error at the reversals of a drive with the time constant `decay`, s, per unit of friction.
fn blur(dataset: &Dataset, drive: usize, decay: f64) -> Vec<f64> {
    let rate = |k: usize| dataset.joints[k].qd[drive];
    let reversals: Vec<usize> = dataset.reversals(drive).collect();
    let near = |k: usize| {
        let next = reversals.partition_point(|r| *r <= k);
        let both = [next.checked_sub(1), Some(next)].into_iter().flatten().filter_map(|i| reversals.get(i));
        both.copied().min_by_key(|r| r.abs_diff(k))
    };
    let value = |k: usize| {
        let reversal = near(k)?;
        let time = dataset.t[k] - 0.5 * (dataset.t[reversal - 1] + dataset.t[reversal]);
        Some(rate(reversal).signum() * time.signum() * (-time.abs() / decay).exp())
    };
    (0..dataset.len()).map(|k| value(k).unwrap_or(0.0)).collect()
}

/// Parameters without influence on any channel, of candidates other than the `unseen` effects.
pub fn not_excited(problem: &Problem, unseen: &[String]) -> Vec<String> {
    let silent = |c: &&Column| c.values.iter().all(|v| (v * c.magnitude).abs() <= NOT_EXCITED);
    let candidates = problem.candidates.iter().filter(|c| !unseen.contains(&c.name));
    candidates
        .flat_map(|c| c.variants.first())
        .flat_map(|v| &v.columns)
        .filter(silent)
        .map(|c| c.name.clone())
        .collect()
}

/// Averaged segments of all datasets in sequence, and their total length.
pub fn segments(datasets: &[Dataset]) -> (Vec<Range<usize>>, usize) {
    let averaged = averaged_segments(datasets, block(datasets));
    let samples = averaged.last().map_or(0, |s| s.end);
    (averaged, samples)
}

/// Their parts away from reversals, where the smoothed motion is the motion, and the total length of all.
pub fn determined(datasets: &[Dataset]) -> (Vec<Range<usize>>, usize) {
    let (averaged, samples) = segments(datasets);
    let mut is_away = vec![true; samples];
    let mut first = 0;
    for dataset in datasets {
        let near = dataset.blocks_near_reversals(block(datasets));
        near.into_iter().for_each(|n| is_away[first + n.start..first + n.end].fill(false));
        first += dataset.blocks(block(datasets)).count();
    }
    let away = |s: &Range<usize>| runs(&is_away[s.clone()], s.start);
    (averaged.iter().flat_map(away).collect(), samples)
}

/// Residuals of datasets with their noise as one series, averaged over [`block`] samples.
pub fn residual_series(datasets: &[Dataset], noise: &NoiseLevel, residuals: &Residuals) -> Series {
    let block = block(datasets);
    let averaged = |(t, series): (&Dataset, &Channels)| series.iter().map(|own| t.means(own, block)).collect();
    let parts: Vec<Channels> = datasets.iter().zip(&residuals.series).map(averaged).collect();
    stack(noise, parts.iter())
}

/// One series: channel by channel, dataset by dataset.
///
/// Every recording weighs by its own noise: its part is scaled to the pooled noise of the channel.
fn stack<'a>(noise: &NoiseLevel, datasets: impl Iterator<Item = &'a Channels>) -> Series {
    let datasets: Vec<&Channels> = datasets.collect();
    let mut series = Vec::new();
    for (c, pooled) in noise.pooled.iter().enumerate() {
        for (own, sigma) in datasets.iter().zip(&noise.of_each) {
            series.extend(own[c].iter().map(|x| pooled / sigma[c] * x));
        }
    }
    series.into()
}

#[cfg(test)]
mod tests {
    use super::super::missing::variants;
    use super::*;
    use crate::effects::find;
    use crate::model::testing::irb360;

    #[test]
    fn directions_that_swing_by_themselves_need_no_column_for_every_pair() {
        let frames = variants(&irb360(), find("frame_compliance").unwrap());
        let sources = sources(&frames);
        let own = |i: &usize| sources[*i].contains(i);
        assert_eq!((frames.len(), (0..frames.len()).filter(own).count()), (16, 4));
        for (i, own) in sources.iter().enumerate() {
            assert_eq!(own.len(), 2);
            for (direction, &source) in own.iter().enumerate() {
                let frequency = |i: usize| frames[i].values[2 + direction];
                assert_eq!(frequency(source), frequency(i), "shape {i}");
            }
        }
        // Shapes of all drives together are columns of their own.
        let friction = variants(&irb360(), find("drive_stribeck").unwrap());
        assert!(self::sources(&friction).iter().enumerate().all(|(i, own)| own.iter().all(|source| *source == i)));
    }
}

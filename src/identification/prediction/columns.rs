//! Derivatives of the predicted channels with respect to parameters, for many effects in one pass over the motion, at
//! every sample or averaged over short blocks.
//!
//! Force laws and inertia are evaluated at every sample, because friction jumps within a block; their nonlinear
//! parameters use finite differences of the law. Effects that act through the entire prediction use finite
//! differences of the prediction: at the blocks' middle samples where the difference is smooth (lengths, offsets), at
//! every sample where it follows the jumps of friction (sensors, deflections of gears). Behind elastic gears all
//! columns depend on all previous samples: see [`gears`].

mod differences;
mod laws;

use std::borrow::Cow;
use std::sync::OnceLock;

use self::differences::Differences;
use self::laws::linear;
pub(super) use self::laws::terms;
use super::{
    Channels, InternalStates, Joints, Laws, gear_springs, gears, ideal, joints, observe, observe_apart, predict,
};
use crate::dynamics::Plant;
use crate::effects::{ActiveEffect, Entry, Role};
use crate::identification::Dataset;
use crate::kinematics::KinematicsError;
use crate::numerics::parallel;

/// Number of effects whose columns at every sample are kept in memory at a time.
const GROUP: usize = 8;

/// An effect whose columns are requested.
#[derive(Clone, Copy)]
struct Wanted<'a> {
    active: &'a ActiveEffect,
    /// Whether it is a candidate, treated as if it were in the plant with the values it has.
    is_candidate: bool,
    /// Whether the columns of nonlinear parameters are requested as well; they are zero otherwise.
    shapes: bool,
}

impl<'a> Wanted<'a> {
    /// All effects of a plant; `rigid` are its rigid bodies.
    fn own(plant: &'a Plant, rigid: &'a ActiveEffect) -> Vec<Self> {
        let own = std::iter::once(rigid).chain(&plant.effects);
        own.map(|active| Self { active, is_candidate: false, shapes: true }).collect()
    }

    fn has_column(&self, entry: &Entry) -> bool {
        match entry.parameter.role {
            Role::Fixed => false,
            Role::Linear => true,
            Role::Shape => self.shapes,
        }
    }
}

/// Derivatives of the predicted channels with respect to parameters: `[parameter][channel][sample]`.
///
/// Without `candidate`: all parameters of the plant, in the order of [`Plant::parameters`] (zero series for fixed
/// ones). With a candidate effect: its parameters, as if it were in the plant with the values it has; for a sensor
/// with non-zero values, secants from zero to these values.
///
/// # Errors
/// [`KinematicsError`] if a pose is impossible for the plant's geometry or a law gives no finite value.
pub fn columns(
    plant: &Plant,
    dataset: &Dataset,
    candidate: Option<&ActiveEffect>,
) -> Result<Vec<Channels>, KinematicsError> {
    let rigid = plant.rigid_bodies();
    let wanted = match candidate {
        Some(active) => vec![Wanted { active, is_candidate: true, shapes: true }],
        None => Wanted::own(plant, &rigid),
    };
    Ok(along(dataset, &Moved::new(joints(plant, dataset)?.following()), &wanted, 1)?.into_iter().flatten().collect())
}

/// Predicted channels of a plant along a dataset, and their derivatives with respect to all its parameters; `known` are
/// columns of its laws in the dataset.
///
/// # Errors
/// As [`columns`].
pub fn prediction_and_columns(
    plant: &Plant,
    dataset: &Dataset,
    known: Laws,
) -> Result<(Channels, Vec<Channels>), KinematicsError> {
    let joints = joints(plant, dataset)?;
    let known = known.completed(dataset, &joints)?;
    let moved = Moved::new(joints.knowing(known).following());
    let rigid = plant.rigid_bodies();
    let columns = along(dataset, &moved, &Wanted::own(plant, &rigid), 1)?.into_iter().flatten().collect();
    let mut predicted = moved.into_unobserved(dataset)?;
    observe(plant, dataset, &mut predicted);
    Ok((predicted, columns))
}

/// Columns of all parameters of a plant, `[effect][parameter][channel][block]`, averaged over `block` samples; the first
/// effect is `rigid_bodies`. `known` are columns of the plant's laws in the dataset. The loads that
/// laws read are those of the plant: columns times values are the contribution of a law, not derivatives.
///
/// # Errors
/// As [`columns`].
pub fn own_columns(
    plant: &Plant,
    dataset: &Dataset,
    block: usize,
    known: Laws,
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    averaged(plant, dataset, &Wanted::own(plant, &plant.rigid_bodies()), block, known)
}

/// Columns of all parameters of a plant, as [`own_columns`] at every sample, followed by those of candidates as if each were
/// in the plant with the values it has.
///
/// # Errors
/// As [`columns`].
pub fn columns_with(
    plant: &Plant,
    dataset: &Dataset,
    candidates: &[ActiveEffect],
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    let rigid = plant.rigid_bodies();
    let mut wanted = Wanted::own(plant, &rigid);
    wanted.extend(candidates.iter().map(|active| Wanted { active, is_candidate: true, shapes: true }));
    averaged(plant, dataset, &wanted, 1, Laws::default())
}

/// Columns of the linear parameters of candidates along a dataset, as if each were in the plant with the values it has; what
/// all candidates share is computed once.
pub struct CandidateColumns<'a> {
    dataset: &'a Dataset,
    moved: Moved<'a>,
    block: usize,
}

impl<'a> CandidateColumns<'a> {
    /// Along `dataset`, averaged over `block` samples; `known` are columns of the plant's laws in the dataset.
    ///
    /// # Errors
    /// As [`columns`].
    pub fn new(plant: &'a Plant, dataset: &'a Dataset, block: usize, known: Laws) -> Result<Self, KinematicsError> {
        Ok(Self { dataset, moved: Moved::new(joints(plant, dataset)?.knowing(known)), block })
    }

    /// `[candidate][parameter][channel][block]`; columns of shape parameters are zero.
    ///
    /// # Errors
    /// [`KinematicsError`] if a law gives no finite value.
    pub fn of(&self, candidates: &[ActiveEffect]) -> Result<Vec<Vec<Channels>>, KinematicsError> {
        let wanted = |active| Wanted { active, is_candidate: true, shapes: false };
        along(self.dataset, &self.moved, &candidates.iter().map(wanted).collect::<Vec<_>>(), self.block)
    }
}

fn averaged(
    plant: &Plant,
    dataset: &Dataset,
    wanted: &[Wanted],
    block: usize,
    known: Laws,
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    along(dataset, &Moved::new(joints(plant, dataset)?.knowing(known)), wanted, block)
}

/// Motion of the joints with the channels before the sensors, which are computed at the first request.
struct Moved<'a> {
    joints: Joints<'a>,
    unobserved: OnceLock<Channels>,
}

impl<'a> Moved<'a> {
    fn new(joints: Joints<'a>) -> Self {
        Self { joints, unobserved: OnceLock::new() }
    }

    /// Predicted channels at every sample before the sensors.
    fn unobserved(&self, dataset: &Dataset) -> Result<&Channels, KinematicsError> {
        if let Some(known) = self.unobserved.get() {
            return Ok(known);
        }
        let made = ideal(self.joints.plant, dataset, &self.joints)?;
        Ok(self.unobserved.get_or_init(|| made))
    }

    fn into_unobserved(self, dataset: &Dataset) -> Result<Channels, KinematicsError> {
        self.unobserved(dataset)?;
        Ok(self.unobserved.into_inner().unwrap_or_default())
    }
}

/// Columns of the plant of the moved joints.
fn along(
    dataset: &Dataset,
    moved: &Moved,
    wanted: &[Wanted],
    block: usize,
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    let joints = &moved.joints;
    let springs = gear_springs(joints.plant).filter(|_| !dataset.is_empty());
    let Some(springs) = springs else { return at_joints(dataset, moved, wanted, block) };
    let passage = gears::Passage::new(dataset, joints, &springs)?;
    let mut all = Vec::with_capacity(wanted.len());
    for group in wanted.chunks(GROUP) {
        let mut columns = at_joints(dataset, moved, group, 1)?;
        for (wanted, columns) in group.iter().zip(&mut columns) {
            passage.pass(wanted.active, columns);
        }
        let averaged = |columns: Vec<Channels>| columns.into_iter().map(|c| means(dataset, c, block)).collect();
        all.extend(columns.into_iter().map(averaged));
    }
    Ok(all)
}

/// Columns at the given motion of the joints; those of effects that act through the entire prediction are exact.
fn at_joints(
    dataset: &Dataset,
    moved: &Moved,
    wanted: &[Wanted],
    block: usize,
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    let is_whole = |i: &usize| wanted[*i].active.effect.kind().acts_on_the_whole();
    let (wholes, laws): (Vec<usize>, Vec<usize>) = (0..wanted.len()).partition(is_whole);
    let mut columns = vec![Vec::new(); wanted.len()];
    let own: Vec<Wanted> = laws.iter().map(|&i| wanted[i]).collect();
    for (i, own) in laws.into_iter().zip(of_laws(dataset, moved, &own, block)?) {
        columns[i] = own;
    }
    if !wholes.is_empty() {
        let differences = Differences::new(dataset, moved, block)?;
        let found = parallel::map(wholes.len(), |k| differences.columns(&wanted[wholes[k]]));
        for (i, found) in wholes.into_iter().zip(found) {
            columns[i] = found?;
        }
    }
    Ok(columns)
}

/// Columns of force laws and inertia.
fn of_laws(
    dataset: &Dataset,
    moved: &Moved,
    wanted: &[Wanted],
    block: usize,
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    let joints = &moved.joints;
    let shifted: Vec<ActiveEffect> = wanted.iter().filter(|w| w.shapes).flat_map(|w| shaped(w.active)).collect();
    let effects: Vec<&ActiveEffect> = wanted.iter().map(|w| w.active).chain(&shifted).collect();
    let mut columns = linear(&effects, dataset, moved, block)?;
    let gears = gear_springs(joints.plant).unwrap_or_default();
    let on_motors: Vec<usize> = (0..effects.len()).filter(|&i| gears::acts_on_motors(effects[i], &gears)).collect();
    if !on_motors.is_empty() {
        let those: Vec<&ActiveEffect> = on_motors.iter().map(|&i| effects[i]).collect();
        let turned = linear(&those, dataset, &Moved::new(joints.of_encoders()), block)?;
        on_motors.into_iter().zip(turned).for_each(|(i, turned)| columns[i] = turned);
    }
    let mut shifted = columns.split_off(wanted.len()).into_iter();
    for (wanted, columns) in wanted.iter().zip(&mut columns).filter(|(w, _)| w.shapes) {
        let unmoved = weighted(columns, &wanted.active.values);
        for (k, entry) in wanted.active.entries().iter().enumerate().filter(|(_, e)| e.parameter.role == Role::Shape) {
            let step = difference(entry);
            let mut values = wanted.active.values.clone();
            values[k] += step;
            let there = shifted.next().expect("one copy per shape parameter");
            columns[k] = slope(&weighted(&there, &values), &unmoved, step);
        }
    }
    Ok(columns)
}

/// Difference quotient of two predictions.
fn slope(there: &Channels, here: &Channels, step: f64) -> Channels {
    let one = |(t, h): (&Vec<f64>, &Vec<f64>)| t.iter().zip(h).map(|(t, h)| (t - h) / step).collect();
    there.iter().zip(here).map(one).collect()
}

fn means(dataset: &Dataset, column: Channels, block: usize) -> Channels {
    if block == 1 { column } else { column.iter().map(|x| dataset.means(x, block)).collect() }
}

/// The dataset at the middle samples of blocks.
fn middle(dataset: &Dataset, block: usize) -> Cow<'_, Dataset> {
    if block == 1 { Cow::Borrowed(dataset) } else { Cow::Owned(dataset.averaged(block)) }
}

/// Step of a parameter for finite differences of predictions.
fn difference(entry: &Entry) -> f64 {
    1e-4 * entry.parameter.default.abs().max(1e-6)
}

/// Copies of a force law, each with one shape parameter changed by a step.
fn shaped(active: &ActiveEffect) -> Vec<ActiveEffect> {
    let shapes = active.entries().into_iter().enumerate().filter(|(_, e)| e.parameter.role == Role::Shape);
    shapes
        .map(|(k, entry)| {
            let mut copy = active.clone();
            copy.values[k] += difference(&entry);
            copy
        })
        .collect()
}

/// Σ valuesₖ·columnₖ.
fn weighted(columns: &[Channels], values: &[f64]) -> Channels {
    let Some(first) = columns.first() else { return Channels::new() };
    let mut sum: Channels = first.iter().map(|s| vec![0.0; s.len()]).collect();
    add_weighted(&mut sum, columns, values);
    sum
}

/// Adds Σ valuesₖ·columnₖ to a sum.
pub(super) fn add_weighted(sum: &mut Channels, columns: &[Channels], values: &[f64]) {
    for (column, value) in columns.iter().zip(values).filter(|(_, v)| **v != 0.0) {
        for (total, series) in sum.iter_mut().zip(column) {
            for (t, x) in total.iter_mut().zip(series) {
                *t += value * x;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::effects::{REGISTRY, rigid_bodies};
    use crate::kinematics::JointState;
    use crate::machine::Setup;
    use crate::model::testing::irb360;
    use crate::recording::Channel;

    const DT: f64 = 4e-4;
    const BLOCK: usize = 5;

    /// 0.8 s of all axes below 3 Hz, in two segments whose lengths are no multiples of the block.
    pub(super) fn dataset() -> Dataset {
        let at = |k: usize| {
            let t = k as f64 * DT;
            let wave = |i: usize| (0.2 + 0.1 * i as f64, 11.0 + 3.0 * i as f64);
            JointState {
                q: std::array::from_fn(|i| wave(i).0 * (wave(i).1 * t).sin()),
                qd: std::array::from_fn(|i| wave(i).0 * wave(i).1 * (wave(i).1 * t).cos()),
                qdd: std::array::from_fn(|i| -wave(i).0 * wave(i).1.powi(2) * (wave(i).1 * t).sin()),
            }
        };
        let channels = Channel::TORQUES.into_iter().chain([Channel::StrutUpper(0)]).collect();
        Dataset {
            measured: vec![(0..2003).map(f64::from).collect(); 5],
            segments: vec![0..1001, 1001..2003],
            half_width: [10; 4],
            ..Dataset::exact(Default::default(), Setup::default(), channels, DT, (0..2003).map(at).collect())
        }
    }

    #[test]
    fn blocks_keep_to_segments() {
        let middle = dataset().averaged(BLOCK);
        assert_eq!(middle.segments, vec![0..200, 200..400]);
        assert_eq!(middle.len(), 400);
        assert_eq!(middle.measured[0][199..201], [997.0, 1003.0]);
        approx::assert_relative_eq!(middle.t[200], 1003.0 * DT);
        assert_eq!(middle.half_width, [4; 4]);
    }

    /// Force laws agree to rounding; differences at the middle deviate from the mean over a block by c̈·(5·dt)²/24,
    /// and by jumps of friction within it.
    #[test]
    fn averages_of_the_columns() {
        let model = irb360();
        let dataset = dataset();
        let plant = Plant::new(&model, &dataset.setup);
        let known = |e: &&Arc<dyn crate::effects::Effect>| {
            e.name() != rigid_bodies::NAME
                && e.spec().identifiable
                && model.effects.iter().all(|a| a.effect.name() != e.name())
        };
        let candidates: Vec<ActiveEffect> =
            REGISTRY.iter().filter(known).map(|e| ActiveEffect::absent_on(Arc::clone(e), model.host())).collect();
        let mut all = own_columns(&plant, &dataset, BLOCK, Laws::default()).unwrap();
        let own = all.len();
        let along = CandidateColumns::new(&plant, &dataset, BLOCK, Laws::default()).unwrap();
        all.extend(along.of(&candidates).unwrap());
        let mut expected = vec![columns(&plant, &dataset, None).unwrap()];
        expected.extend(candidates.iter().map(|c| columns(&plant, &dataset, Some(c)).unwrap()));
        let flat: Vec<&Channels> = all[..own].iter().flatten().collect();
        assert_eq!(flat.len(), expected[0].len());
        for (j, expected) in expected.iter().enumerate() {
            let got: Vec<&Channels> = if j == 0 { flat.clone() } else { all[own + j - 1].iter().collect() };
            let active = j.checked_sub(1).map(|j| &candidates[j]);
            let smooth = active.is_some_and(|a| a.effect.kind().acts_on_the_whole());
            let shape = |k: usize| active.is_some_and(|a| a.entries()[k].parameter.role == Role::Shape);
            for (k, (got, expected)) in got.iter().zip(expected).enumerate().filter(|(k, _)| !shape(*k)) {
                let (mut error, mut size) = (0.0, 0.0);
                for (got, expected) in got.iter().zip(expected) {
                    for (x, b) in got.iter().zip(dataset.blocks(BLOCK)) {
                        let mean = expected[b].iter().sum::<f64>() / BLOCK as f64;
                        error += (x - mean) * (x - mean);
                        size += mean * mean;
                    }
                }
                let limit: f64 = if smooth { 0.05 } else { 1e-9 };
                let name = active.map_or("own", |a| a.effect.name());
                assert!(error <= limit * limit * size, "{name} {k}: {:.1e}", (error / size).sqrt());
            }
        }
    }

    /// Columns of a linear parameter depend on shape values of its own item alone where an effect says so.
    #[test]
    fn items_that_act_by_themselves_do() {
        let (model, dataset) = (irb360(), dataset());
        let plant = Plant::new(&model, &dataset.setup);
        let along = CandidateColumns::new(&plant, &dataset, BLOCK, Laws::default()).unwrap();
        let by_item = REGISTRY.iter().filter(|e| e.spec().search.is_by_item);
        for effect in by_item {
            let active = ActiveEffect::absent_on(Arc::clone(effect), model.host());
            let entries = active.entries();
            let items = entries.iter().map(|e| e.param.item).max().unwrap() + 1;
            let here = along.of(std::slice::from_ref(&active)).unwrap().remove(0);
            for item in 0..items {
                let mut other = active.clone();
                for (value, e) in other.values.iter_mut().zip(&entries) {
                    *value *= if e.parameter.role == Role::Shape && e.param.item != item { 1.3 } else { 1.0 };
                }
                assert_ne!(other.values, active.values);
                let there = along.of(&[other]).unwrap().remove(0);
                let linear = |k: &usize| entries[*k].parameter.role == Role::Linear;
                for k in (0..entries.len()).filter(linear) {
                    let is_same = here[k] == there[k];
                    assert_eq!(is_same, entries[k].param.item == item, "{}", entries[k].full_name());
                }
            }
        }
        assert!(REGISTRY.iter().any(|e| e.spec().search.is_by_item));
    }
}

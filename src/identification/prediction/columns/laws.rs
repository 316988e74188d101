//! Columns of the linear parameters of laws: regressors of their forces, projected onto the channels.

use std::ops::Range;

use super::{Channels, InternalStates, Joints, Moved, means, middle, observe_apart};
use crate::dynamics::{ChannelMap, Feedback, Output, Plant, Sample, add_regressor, reads_loads};
use crate::effects::{ActiveEffect, Kind, Part, Spec};
use crate::identification::Dataset;
use crate::kinematics::{KinematicsError, Motion};
use crate::numerics::parallel;

/// Number of blocks processed together.
const CHUNK: usize = 64;

/// Columns of the linear parameters at the given motion of the joints as the sensors show them; zero for all others.
pub(super) fn linear(
    effects: &[&ActiveEffect],
    dataset: &Dataset,
    moved: &Moved,
    block: usize,
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    let (joints, plant) = (&moved.joints, moved.joints.plant);
    let known: Vec<Option<Vec<Channels>>> = effects.iter().map(|a| joints.known.of(plant, a, dataset.len())).collect();
    let open: Vec<&ActiveEffect> =
        effects.iter().zip(&known).filter(|(_, known)| known.is_none()).map(|(a, _)| *a).collect();
    let mut computed = terms(&open, dataset, joints, block)?.into_iter();
    let averaged = |columns: Vec<Channels>| columns.into_iter().map(|c| means(dataset, c, block)).collect();
    let mut columns: Vec<Vec<Channels>> =
        known.into_iter().map(|known| known.map_or_else(|| computed.next().unwrap_or_default(), averaged)).collect();
    if plant.observes() {
        see(dataset, moved, block, &mut columns)?;
    }
    Ok(columns)
}

/// Columns of the linear parameters at the given motion of the joints before the sensors; zero for all others.
pub(in super::super) fn terms(
    effects: &[&ActiveEffect],
    dataset: &Dataset,
    joints: &Joints,
    block: usize,
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    let plant = joints.plant;
    let (on_drives, others): (Vec<_>, Vec<_>) = effects.iter().partition(|a| plant.assembled && is_on_drives(a));
    // Laws that follow a drive torque act on other channels, too.
    let follow_torques = joints.follow && plant.effects.iter().any(|a| a.effect.spec().reads.torque);
    if on_drives.is_empty() || follow_torques {
        return terms_of(effects, dataset, joints, block);
    }
    // A torque of a drive does work in the virtual motion of its own channel alone, with the linkage or without.
    let lone = Plant { assembled: false, effects: Vec::new(), ..plant.clone() };
    let mut on_drives = terms_of(&on_drives, dataset, &joints.on(&lone), block)?.into_iter();
    let mut others = terms_of(&others, dataset, joints, block)?.into_iter();
    let of = |a: &&ActiveEffect| if is_on_drives(a) { on_drives.next() } else { others.next() };
    Ok(effects.iter().filter_map(of).collect())
}

/// Whether a law depends on the motion of the drives alone and acts on them.
fn is_on_drives(active: &ActiveEffect) -> bool {
    let Spec { kind, acts_on, reads, .. } = active.effect.spec();
    let is_law = *kind == Kind::Force && !reads.inertia && !reads.torque && !reads.reactions;
    is_law && !active.states_read_reactions() && matches!(acts_on, Part::Drives | Part::Axis4 | Part::FourthDrive)
}

/// Loads for laws that do not depend on them.
static UNLOADED: Output = Output::ZERO;

/// [`terms`] on the plant of `joints`.
fn terms_of(
    effects: &[&ActiveEffect],
    dataset: &Dataset,
    joints: &Joints,
    block: usize,
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    let plant = joints.plant;
    let widths: Vec<usize> = effects.iter().map(|a| a.values.len()).collect();
    let total: usize = widths.iter().sum();
    let channels = dataset.channels.len();
    if total == 0 || channels == 0 {
        return Ok(widths.iter().map(|width| vec![Channels::new(); *width]).collect());
    }
    let states = InternalStates::along(plant, effects, dataset, joints)?;
    let follow = joints.follow && plant.effects.iter().any(reads_loads);
    let loads = match follow || effects.iter().any(|a| reads_loads(a)) {
        true => Some(joints.loads(dataset)?),
        false => None,
    };
    let blocks: Vec<Range<usize>> = dataset.blocks(block).collect();
    let sum = |range: &Range<usize>,
               (motion, map, feedback): &mut (Motion, ChannelMap, Option<Feedback>),
               out: &mut [f64]| {
        for k in range.clone() {
            joints.set_motion(k, motion)?;
            map.set(&plant.geometry, motion, plant.assembled)?;
            let of_sample = loads.map_or(&UNLOADED, |loads| &loads.of_samples[k]);
            if let (Some(feedback), Some(loads)) = (feedback.as_mut(), loads) {
                let at = (dataset.t[k], &*motion);
                feedback.add_to(map, plant, at, &loads.states.at(k), of_sample).map_err(|e| e.at_sample(k))?;
            }
            let mut at = 0;
            for (i, (active, width)) in effects.iter().zip(&widths).enumerate() {
                let state = states.of(k, i);
                let rows = &mut out[at * channels..(at + width) * channels];
                let sample = Sample { t: dataset.t[k], motion, loads: of_sample };
                add_regressor(plant, active, &sample, state, map, rows).map_err(|e| e.at_sample(k))?;
                at += width;
            }
        }
        Ok(())
    };
    // Chunks keep the transposition from rows, one per block, to series in the cache.
    let chunks: Vec<&[Range<usize>]> = blocks.chunks(CHUNK).collect();
    let series_of = |i: usize| -> Result<Vec<f64>, KinematicsError> {
        let map = ChannelMap::without_motion(&dataset.channels);
        let mut there = (Motion::REST, map, if follow { Feedback::of(plant) } else { None });
        let (width, length) = (total * channels, chunks[i].len());
        let mut rows = vec![0.0; length * width];
        for (range, row) in chunks[i].iter().zip(rows.chunks_exact_mut(width)) {
            sum(range, &mut there, row)?;
        }
        let mut series = vec![0.0; length * width];
        for (place, means) in series.chunks_exact_mut(length).enumerate() {
            for (mean, row) in means.iter_mut().zip(rows.chunks_exact(width)) {
                *mean = row[place] / block as f64;
            }
        }
        Ok(series)
    };
    let chunks: Vec<Vec<f64>> =
        parallel::map(chunks.len(), series_of).into_iter().collect::<Result<_, KinematicsError>>()?;
    let series = |column: usize, c: usize| -> Vec<f64> {
        let place = column * channels + c;
        let mut out = Vec::with_capacity(blocks.len());
        for series in &chunks {
            let length = series.len() / (total * channels);
            out.extend_from_slice(&series[place * length..(place + 1) * length]);
        }
        out
    };
    let mut columns = parallel::map(total, |p| (0..channels).map(|c| series(p, c)).collect()).into_iter();
    Ok(widths.iter().map(|w| columns.by_ref().take(*w).collect()).collect())
}

/// Step of a derivative of the sensors, relative to the largest value of a channel.
const SENSOR_STEP: f64 = 1e-4;

/// Turns derivatives of the ideal channels into those of the observed ones.
fn see(dataset: &Dataset, moved: &Moved, block: usize, columns: &mut [Vec<Channels>]) -> Result<(), KinematicsError> {
    let plant = moved.joints.plant;
    let middle = middle(dataset, block);
    let affine = plant.effects.iter().filter_map(|a| a.effect.sensor()).all(|sensor| sensor.is_affine());
    // Affine sensors have the same derivative everywhere.
    let here = match affine {
        true => vec![vec![0.0; middle.len()]; dataset.channels.len()],
        false => means(dataset, moved.unobserved(dataset)?.clone(), block),
    };
    let mut seen = here.clone();
    observe_apart(plant, &middle, &mut seen);
    let largest = |series: &Channels| series.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
    let size = largest(&here);
    let mut columns: Vec<&mut Channels> = columns.iter_mut().flatten().collect();
    parallel::each(&mut columns, |_, column| {
        let own = largest(column);
        let step = if affine || size * own == 0.0 { 1.0 } else { SENSOR_STEP * size / own };
        for (x, h) in column.iter_mut().flatten().zip(here.iter().flatten()) {
            *x = h + step * *x;
        }
        observe_apart(plant, &middle, column);
        for (x, s) in column.iter_mut().flatten().zip(seen.iter().flatten()) {
            *x = (*x - s) / step;
        }
    });
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::tests::dataset;
    use super::super::{columns, joints, predict, slope};
    use super::*;
    use crate::dynamics::set_parameters;
    use crate::effects::{REGISTRY, Role};
    use crate::model::testing::irb360;

    /// Columns of all linear parameters are the derivatives of the prediction, by differences across its values, where laws
    /// depend on strut forces or torques that the parameters change.
    #[test]
    fn columns_follow_the_loads_that_laws_read() {
        let (mut model, dataset) = (irb360(), dataset());
        for name in ["ball_socket_load_dependent", "gear_efficiency"] {
            let effect = crate::effects::find(name).unwrap();
            model.effects.push(ActiveEffect::absent_on(effect, model.host()).at_nominal_size());
        }
        let plant = Plant::new(&model, &dataset.setup);
        let found = columns(&plant, &dataset, None).unwrap();
        let parameters = plant.parameters();
        let there = |k: usize, by: f64| {
            let mut values = parameters.values();
            values[k] += by;
            let mut model = model.clone();
            set_parameters(&mut model, &values);
            predict(&Plant::new(&model, &dataset.setup), &dataset).unwrap()
        };
        let linear = |k: &usize| parameters[*k].role == Role::Linear && found[*k].iter().flatten().any(|x| *x != 0.0);
        for k in (0..parameters.len()).filter(linear) {
            let step = 1e-4 * parameters[k].value.abs().max(1e-3);
            let expected = slope(&there(k, step), &there(k, -step), 2.0 * step);
            let (mut apart, mut size) = (0.0, 0.0);
            for (x, y) in found[k].iter().flatten().zip(expected.iter().flatten()) {
                apart += (x - y) * (x - y);
                size += y * y;
            }
            let (apart, size) = (f64::sqrt(apart), f64::sqrt(size));
            assert!(apart < 1e-4 * size + 1e-9, "{}: {apart:.1e} of {size:.1e}", parameters[k].name);
        }
    }

    /// Laws on the drives have the columns that follow from the motion of the whole linkage, strut forces included.
    #[test]
    fn laws_on_the_drives_need_no_linkage() {
        let (model, dataset) = (irb360(), dataset());
        let plant = Plant::new(&model, &dataset.setup);
        let joints = joints(&plant, &dataset).unwrap();
        let all: Vec<ActiveEffect> =
            REGISTRY.iter().map(|e| ActiveEffect::absent_on(Arc::clone(e), model.host()).at_nominal_size()).collect();
        let on_drives: Vec<&ActiveEffect> = all.iter().filter(|a| is_on_drives(a)).collect();
        assert!(on_drives.len() > 8 && on_drives.iter().any(|a| a.effect.name() == "axis4_friction"));
        let alone = terms(&on_drives, &dataset, &joints, 1).unwrap();
        let whole = terms_of(&on_drives, &dataset, &joints, 1).unwrap();
        for (active, (alone, whole)) in on_drives.iter().zip(alone.iter().zip(&whole)) {
            let apart = alone.iter().flatten().flatten().zip(whole.iter().flatten().flatten());
            let worst = apart.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-12, "{}: {worst:.1e}", active.effect.name());
        }
    }
}

//! Columns averaged over short blocks of samples, for many effects in one pass over the motion.
//!
//! Force laws and inertia are evaluated at every sample, as friction jumps within a block. What acts through a whole
//! prediction is differenced: at the blocks' middle samples where the difference is smooth (lengths, offsets), at every
//! sample where it follows the jumps of friction (sensors, deflections of gears).

use std::ops::Range;

use rayon::prelude::*;

use super::{
    Channels, Joints, OwnStates, columns_along, difference, gear_columns, gear_springs, ideal, joints, observe,
    predict, shaped, weighted, with,
};
use crate::dynamics::{ChannelMap, Output, Plant, add_regressor, inverse_dynamics};
use crate::effects::{ActiveEffect, Kind, Role};
use crate::identification::Trace;
use crate::kinematics::KinematicsError;

/// Blocks handled together.
const CHUNK: usize = 64;

/// Columns of all parameters of a plant and of candidates, `[effect][parameter][channel][block]`, averaged over `block`
/// samples. The plant's effects come first, `rigid_bodies` before all; shape parameters of candidates have zero columns.
pub fn averaged_columns(
    plant: &Plant,
    trace: &Trace,
    candidates: &[ActiveEffect],
    block: usize,
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    let joints = joints(plant, trace)?;
    let rigid = plant.rigid_bodies();
    let own: Vec<&ActiveEffect> = std::iter::once(&rigid).chain(&plant.effects).collect();
    let all: Vec<&ActiveEffect> = own.iter().copied().chain(candidates).collect();
    let moved: Vec<ActiveEffect> = own.iter().flat_map(|a| shaped(a)).collect();
    let along: Vec<&ActiveEffect> = all.iter().copied().chain(&moved).collect();
    let mut linear = linear(plant, &along, trace, &joints, block)?;
    let mut moved = linear.split_off(all.len()).into_iter();
    for (active, columns) in own.iter().zip(&mut linear).filter(|(a, _)| !a.effect.kind().acts_on_the_whole()) {
        let unmoved = weighted(columns, &active.values);
        for (k, entry) in active.entries().iter().enumerate().filter(|(_, e)| e.parameter.role == Role::Shape) {
            let step = difference(entry);
            let mut values = active.values.clone();
            values[k] += step;
            let moved = moved.next().expect("one copy per shape parameter");
            columns[k] = slope(&weighted(&moved, &values), &unmoved, step);
        }
    }
    let wholes: Vec<usize> = (0..all.len()).filter(|&at| all[at].effect.kind().acts_on_the_whole()).collect();
    if !wholes.is_empty() {
        let differences = Differences::new(plant, trace, &joints, block)?;
        let of = |&at: &usize| differences.columns(all[at], at >= own.len(), &linear[at]);
        let found: Vec<Vec<Channels>> = wholes.par_iter().map(of).collect::<Result<_, KinematicsError>>()?;
        wholes.into_iter().zip(found).for_each(|(at, columns)| linear[at] = columns);
    }
    if gear_springs(plant).is_some() {
        // What the gears pass on depends on all samples before.
        let mut exact = columns_along(plant, trace, None, &joints)?.into_iter();
        for (active, columns) in own.iter().zip(&mut linear) {
            for column in columns.iter_mut().take(active.values.len()) {
                let all = exact.next().expect("one per parameter");
                *column = all.iter().map(|x| trace.means(x, block)).collect();
            }
        }
    }
    Ok(linear)
}

/// Quotients of the difference of two predictions and the step between them.
fn slope(there: &Channels, here: &Channels, step: f64) -> Channels {
    let one = |(t, h): (&Vec<f64>, &Vec<f64>)| t.iter().zip(h).map(|(t, h)| (t - h) / step).collect();
    there.iter().zip(here).map(one).collect()
}

/// Columns of what acts through a whole prediction.
struct Differences<'a> {
    plant: &'a Plant,
    trace: &'a Trace,
    block: usize,
    /// The blocks' middle samples and the prediction there.
    middle: Trace,
    plain: Channels,
    /// Prediction at every sample before and after the sensors.
    unobserved: Channels,
    observed: Channels,
}

impl<'a> Differences<'a> {
    fn new(plant: &'a Plant, trace: &'a Trace, joints: &Joints, block: usize) -> Result<Self, KinematicsError> {
        let middle = trace.averaged(block);
        let plain = predict(plant, &middle)?;
        let unobserved = ideal(plant, trace, joints)?;
        let mut observed = unobserved.clone();
        observe(plant, trace, &mut observed);
        Ok(Self { plant, trace, block, middle, plain, unobserved, observed })
    }

    /// Columns of all parameters of an effect; those of fixed ones, and of a candidate's shape, are as in `none`.
    fn columns(
        &self,
        active: &ActiveEffect,
        is_candidate: bool,
        none: &[Channels],
    ) -> Result<Vec<Channels>, KinematicsError> {
        let kind = active.effect.kind();
        if active.has_gears() {
            // Those the plant has pass on all the rest, too: they are handled with it.
            return if is_candidate { self.of_gears(active) } else { Ok(none.to_vec()) };
        }
        let mut columns = none.to_vec();
        for (k, entry) in active.entries().iter().enumerate() {
            match entry.parameter.role {
                Role::Fixed => continue,
                Role::Shape if is_candidate => continue,
                Role::Linear | Role::Shape => (),
            }
            let step = difference(entry);
            let changed = with(self.plant, active, Some((k, step)), is_candidate);
            columns[k] = if kind == Kind::Sensor {
                let mut seen = self.unobserved.clone();
                observe(&changed, self.trace, &mut seen);
                self.means(&slope(&seen, &self.observed, step))
            } else {
                slope(&predict(&changed, &self.middle)?, &self.plain, step)
            };
        }
        Ok(columns)
    }

    fn of_gears(&self, active: &ActiveEffect) -> Result<Vec<Channels>, KinematicsError> {
        let columns = gear_columns(self.plant, self.trace, active, &self.observed)?;
        Ok(columns.iter().map(|column| self.means(column)).collect())
    }

    fn means(&self, column: &Channels) -> Channels {
        column.iter().map(|x| self.trace.means(x, self.block)).collect()
    }
}

/// Columns of the linear parameters; zero for all others.
fn linear(
    plant: &Plant,
    effects: &[&ActiveEffect],
    trace: &Trace,
    joints: &Joints,
    block: usize,
) -> Result<Vec<Vec<Channels>>, KinematicsError> {
    let states = OwnStates::along(plant, effects, trace, joints)?;
    let plant_effects: Vec<&ActiveEffect> = plant.effects.iter().collect();
    let plant_states = OwnStates::along(plant, &plant_effects, trace, joints)?;
    let reads_reactions = effects.iter().any(|a| a.effect.reads_reactions());
    let reads = reads_reactions || effects.iter().any(|a| a.effect.reads_torque());
    let widths: Vec<usize> = effects.iter().map(|a| a.values.len()).collect();
    let total: usize = widths.iter().sum();
    let channels = trace.channels.len();
    let blocks: Vec<Range<usize>> = trace.blocks(block).collect();
    let sum = |range: &Range<usize>, out: &mut [f64]| {
        for k in range.clone() {
            let motion = joints.motion(k)?;
            let loads = if reads {
                inverse_dynamics(plant, trace.t[k], &motion, &plant_states.at(k), reads_reactions)?
            } else {
                Output::default()
            };
            let map = ChannelMap::new(&plant.geometry, &motion, plant.assembled, &trace.channels)?;
            let mut at = 0;
            for (i, (active, width)) in effects.iter().zip(&widths).enumerate() {
                let state = states.of(k, i);
                let rows = &mut out[at * channels..(at + width) * channels];
                add_regressor(plant, active, trace.t[k], &motion, &loads, state, &map, rows);
                at += width;
            }
        }
        Ok(())
    };
    // Chunks keep the transposition from rows to series in the cache.
    let chunks: Vec<Vec<f64>> = blocks
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut rows = vec![0.0; chunk.len() * total * channels];
            for (range, row) in chunk.iter().zip(rows.chunks_exact_mut(total * channels)) {
                sum(range, row)?;
            }
            Ok(rows)
        })
        .collect::<Result<_, KinematicsError>>()?;
    let series = |column: usize, c: usize| -> Vec<f64> {
        let mut out = Vec::with_capacity(blocks.len());
        for rows in &chunks {
            out.extend(rows.chunks_exact(total * channels).map(|row| row[column * channels + c] / block as f64));
        }
        out
    };
    let mut columns: Vec<Channels> =
        (0..total).into_par_iter().map(|p| (0..channels).map(|c| series(p, c)).collect()).collect();
    if plant.observes() {
        let middle = trace.averaged(block);
        let mut zero: Channels = vec![vec![0.0; blocks.len()]; channels];
        observe(plant, &middle, &mut zero);
        columns.par_iter_mut().for_each(|column| {
            observe(plant, &middle, column);
            for (x, z) in column.iter_mut().flatten().zip(zero.iter().flatten()) {
                *x -= z;
            }
        });
    }
    let mut columns = columns.into_iter();
    Ok(widths.iter().map(|w| columns.by_ref().take(*w).collect()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Channel;
    use crate::effects::{REGISTRY, rigid_bodies};
    use crate::identification::prediction::columns;
    use crate::kinematics::JointState;
    use crate::recording::Setup;

    const DT: f64 = 4e-4;
    const BLOCK: usize = 5;

    /// 0.8 s of all axes below 3 Hz, in two segments with odd ends.
    fn trace() -> Trace {
        let at = |k: usize| {
            let t = k as f64 * DT;
            let wave = |i: usize| (0.2 + 0.1 * i as f64, 11.0 + 3.0 * i as f64);
            JointState {
                q: std::array::from_fn(|i| wave(i).0 * (wave(i).1 * t).sin()),
                qd: std::array::from_fn(|i| wave(i).0 * wave(i).1 * (wave(i).1 * t).cos()),
                qdd: std::array::from_fn(|i| -wave(i).0 * wave(i).1.powi(2) * (wave(i).1 * t).sin()),
            }
        };
        Trace {
            name: "made".into(),
            setup: Setup::default(),
            t: (0..2003).map(|k| k as f64 * DT).collect(),
            joints: (0..2003).map(at).collect(),
            channels: Channel::TORQUES.into_iter().chain([Channel::StrutUpper(0)]).collect(),
            measured: vec![(0..2003).map(f64::from).collect(); 5],
            segments: vec![0..1001, 1001..2003],
            dt: DT,
            readings: crate::identification::EncoderReadings::default(),
            half_width: [10; 4],
        }
    }

    #[test]
    fn blocks_keep_to_segments() {
        let middle = trace().averaged(BLOCK);
        assert_eq!(middle.segments, vec![0..200, 200..400]);
        assert_eq!(middle.len(), 400);
        assert_eq!(middle.measured[0][199..201], [997.0, 1003.0]);
        approx::assert_relative_eq!(middle.t[200], 1003.0 * DT);
        assert_eq!(middle.half_width, [3; 4]);
    }

    /// Force laws to rounding; differences at the middle differ from the mean over a block by c̈·(5·dt)²/24, and by
    /// friction that jumps in between.
    #[test]
    fn averages_of_the_columns() {
        let model = crate::model::Model::read(std::path::Path::new("models/irb360-6-1600.toml")).unwrap();
        let trace = trace();
        let plant = Plant::new(&model, &trace.setup);
        let known = |e: &&&'static dyn crate::effects::Effect| {
            e.name() != rigid_bodies::NAME
                && e.identifiable()
                && model.effects.iter().all(|a| a.effect.name() != e.name())
        };
        let candidates: Vec<ActiveEffect> =
            REGISTRY.iter().filter(known).map(|e| ActiveEffect::absent_on(*e, model.host())).collect();
        let all = averaged_columns(&plant, &trace, &candidates, BLOCK).unwrap();
        let mut expected = vec![columns(&plant, &trace, None).unwrap()];
        expected.extend(candidates.iter().map(|c| columns(&plant, &trace, Some(c)).unwrap()));
        let own = all.len() - candidates.len();
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
                    for (x, b) in got.iter().zip(trace.blocks(BLOCK)) {
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
}

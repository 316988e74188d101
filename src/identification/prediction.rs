//! What a plant predicts for a trace, and how that changes with each parameter.
//!
//! A trace holds what the encoders read. What lies between encoder and joint ([`Kind::Encoder`]) is taken off first:
//! constant offsets, then the deflection of elastic gears ([`gears`]). With θ the encoder angle less its offset, q the
//! joint's, J the rotor's inertia and ID the inverse dynamics with the rotor on the arm, τ = ID(q, q̇, q̈) + J·(θ̈ − q̈).
//!
//! Own states of force laws are integrated along the measured motion.

mod averaged;
mod gears;
mod states;

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

use self::states::OwnStates;
use super::Trace;
use crate::dynamics::{Channel, Output, Plant, inverse_dynamics, regressor};
use crate::effects::{ActiveEffect, Entry, GearSpring, Kind, Role};
use crate::kinematics::{JointState, KinematicsError, Motion};
use crate::model::AXES;
use crate::recording::Signals;

pub use averaged::averaged_columns;

/// Series of every channel, in the order of the trace's channels.
pub type Channels = Vec<Vec<f64>>;

/// Joint motion of the mechanism at every sample. The motion of all bodies takes kilobytes: it is computed where it is
/// needed.
struct Joints<'a> {
    plant: &'a Plant,
    states: Cow<'a, [JointState]>,
    /// What the encoders read, less constant offsets; another motion where a gear gives way.
    encoders: Cow<'a, [JointState]>,
}

impl Joints<'_> {
    /// Motion of all bodies at sample `k`.
    fn motion(&self, k: usize) -> Result<Motion, KinematicsError> {
        self.plant.motion(&self.states[k])
    }

    /// As if the encoders sat on the joints.
    fn of_encoders(&self) -> Joints<'_> {
        let encoders = || Cow::Borrowed(self.encoders.as_ref());
        Joints { plant: self.plant, states: encoders(), encoders: encoders() }
    }
}

/// Whether a prediction at one sample needs only samples around it (see [`reach`]); own states and elastic gears need
/// all before.
pub fn is_local(plant: &Plant) -> bool {
    let at_rest = |a: &ActiveEffect| a.states() == 0 || a.effect.kind() == Kind::Encoder;
    plant.effects.iter().all(at_rest) && gear_springs(plant).is_none()
}

/// Samples on either side that a local prediction needs: sensors shift by less.
fn reach(plant: &Plant) -> usize {
    if plant.observes() { 256 } else { 0 }
}

/// Predicted channels of a plant along a trace, and their derivatives by all its parameters.
pub fn prediction_and_columns(plant: &Plant, trace: &Trace) -> Result<(Channels, Vec<Channels>), KinematicsError> {
    let joints = joints(plant, trace)?;
    let predicted = predict_along(plant, trace, &joints)?;
    Ok((predicted, columns_along(plant, trace, None, &joints)?))
}

/// Predicted channels of a plant along a trace.
pub fn predict(plant: &Plant, trace: &Trace) -> Result<Channels, KinematicsError> {
    if !is_local(plant) || trace.len() <= CHUNK {
        return predict_along(plant, trace, &joints(plant, trace)?);
    }
    let starts: Vec<usize> = (0..trace.len()).step_by(CHUNK).collect();
    let pieces: Vec<Channels> = starts
        .into_par_iter()
        .map(|start| {
            let range = start..(start + CHUNK).min(trace.len());
            let (around, shift) = surroundings(plant, trace, &range);
            let mut piece = predict_along(plant, &around, &joints(plant, &around)?)?;
            piece.iter_mut().for_each(|series| *series = series[shift..shift + range.len()].to_vec());
            Ok(piece)
        })
        .collect::<Result<_, KinematicsError>>()?;
    let whole = |c: usize| pieces.iter().flat_map(|p| &p[c]).copied().collect();
    Ok((0..trace.channels.len()).map(whole).collect())
}

/// The samples that a local prediction in `range` needs, and where `range` starts in them.
pub fn surroundings(plant: &Plant, trace: &Trace, range: &Range<usize>) -> (Trace, usize) {
    let reach = reach(plant);
    if gear_springs(plant).is_some() {
        // Once for all windows.
        trace.ringing();
    }
    let outer = range.start.saturating_sub(reach)..(range.end + reach).min(trace.len());
    let shift = range.start - outer.start;
    (trace.window(outer), shift)
}

/// Motion of the mechanism: that of the encoders less what lies between them and the joints.
fn joints<'a>(plant: &'a Plant, trace: &'a Trace) -> Result<Joints<'a>, KinematicsError> {
    let mut offset = [0.0; AXES];
    for active in &plant.effects {
        active.effect.encoder(&active.values(), &active.effect.initial_state(&active.values()), &mut offset);
    }
    let joint = |j: &JointState| JointState { q: std::array::from_fn(|i| j.q[i] - offset[i]), ..*j };
    let states = match offset == [0.0; AXES] {
        true => Cow::Borrowed(trace.joints.as_slice()),
        false => Cow::Owned(trace.joints.iter().map(joint).collect()),
    };
    let rigid = Joints { plant, encoders: states.clone(), states };
    match gear_springs(plant) {
        Some(gears) => gears::deflected(trace, &rigid, &gears),
        None => Ok(rigid),
    }
}

fn gear_springs(plant: &Plant) -> Option<[GearSpring; AXES]> {
    plant.effects.iter().find_map(|a| a.effect.gear_springs(&a.values()))
}

fn predict_along(plant: &Plant, trace: &Trace, joints: &Joints) -> Result<Channels, KinematicsError> {
    let mut series = ideal(plant, trace, joints)?;
    observe(plant, trace, &mut series);
    Ok(series)
}

/// Predicted channels before the sensors change them.
fn ideal(plant: &Plant, trace: &Trace, joints: &Joints) -> Result<Channels, KinematicsError> {
    let gears = gear_springs(plant).unwrap_or_default();
    let behind = gears::behind(plant, &gears);
    let effects: Vec<&ActiveEffect> = behind.effects.iter().collect();
    let own = OwnStates::along(&behind, &effects, trace, joints)?;
    let with_struts = trace.channels.iter().any(|c| c.drive().is_none());
    let mut outputs: Vec<Output> = (0..trace.len())
        .into_par_iter()
        .map(|k| {
            let mut out = inverse_dynamics(&behind, trace.t[k], &joints.motion(k)?, &own.at(k), with_struts)?;
            for (i, gear) in gears.iter().enumerate() {
                // The rotor moves with the encoder, not with the arm.
                out.tau[i] += gear.rotor_inertia * (joints.encoders[k].qdd[i] - joints.states[k].qdd[i]);
            }
            Ok(out)
        })
        .collect::<Result<_, KinematicsError>>()?;
    if gears.iter().any(|g| g.friction_at_motor) {
        for (out, friction) in outputs.iter_mut().zip(at_motors(plant, &behind, &own, trace, joints)?) {
            out.tau.iter_mut().zip(friction).for_each(|(tau, f)| *tau += f);
        }
    }
    let series: Channels =
        trace.channels.iter().map(|channel| outputs.iter().map(|o| channel_value(*channel, o)).collect()).collect();
    Ok(series)
}

/// Torques of what acts on the motors' side at every sample: the difference that it makes at the encoders' motion.
fn at_motors(
    plant: &Plant,
    behind: &Plant,
    own_behind: &OwnStates,
    trace: &Trace,
    joints: &Joints,
) -> Result<Vec<[f64; AXES]>, KinematicsError> {
    let encoders = joints.of_encoders();
    let effects: Vec<&ActiveEffect> = plant.effects.iter().collect();
    let own = OwnStates::along(plant, &effects, trace, &encoders)?;
    let difference = |k: usize| {
        let motion = encoders.motion(k)?;
        let with = inverse_dynamics(plant, trace.t[k], &motion, &own.at(k), false)?.tau;
        let without = inverse_dynamics(behind, trace.t[k], &motion, &own_behind.at(k), false)?.tau;
        Ok(std::array::from_fn(|i| with[i] - without[i]))
    };
    (0..trace.len()).into_par_iter().map(difference).collect()
}

fn channel_value(channel: Channel, output: &Output) -> f64 {
    match channel {
        Channel::Torque(axis) | Channel::Force(axis) => output.tau[axis],
        Channel::StrutUpper(s) => output.reactions.upper[s],
        Channel::StrutLower(s) => output.reactions.lower[s],
    }
}

/// Passes the torque channels through the plant's sensor effects.
fn observe(plant: &Plant, trace: &Trace, series: &mut Channels) {
    if !plant.observes() {
        return;
    }
    let drives = plant.mechanism.axes();
    for segment in &trace.segments {
        let torque = |i: usize, k: usize| if i < drives { series[i][k] } else { 0.0 };
        let mut signals = Signals {
            t: trace.t[segment.clone()].to_vec(),
            tau: segment.clone().map(|k| std::array::from_fn(|i| torque(i, k))).collect(),
            ..Signals::default()
        };
        for active in &plant.effects {
            active.effect.observe(&active.values(), &mut signals);
        }
        for (k, tau) in segment.clone().zip(&signals.tau) {
            for i in 0..drives {
                series[i][k] = tau[i];
            }
        }
    }
}

/// Derivatives of the predicted channels by parameter: `[parameter][channel][sample]`.
///
/// With `candidate` None: all parameters of the plant, in the order of [`Plant::parameters`] (zero series for fixed
/// ones). With a candidate effect: its parameters, as if it stood in the plant with the values it has.
pub fn columns(
    plant: &Plant,
    trace: &Trace,
    candidate: Option<&ActiveEffect>,
) -> Result<Vec<Channels>, KinematicsError> {
    columns_along(plant, trace, candidate, &joints(plant, trace)?)
}

fn columns_along(
    plant: &Plant,
    trace: &Trace,
    candidate: Option<&ActiveEffect>,
    joints: &Joints,
) -> Result<Vec<Channels>, KinematicsError> {
    if let Some(active) = candidate.filter(|a| a.has_gears()) {
        return gear_columns(plant, trace, active, &predict(plant, trace)?);
    }
    let rigid = plant.rigid_bodies();
    let effects: Vec<&ActiveEffect> = match candidate {
        Some(active) => vec![active],
        None => std::iter::once(&rigid).chain(&plant.effects).collect(),
    };
    // Force laws with a shape moved by a step go along: only their own contribution changes.
    let shaped: Vec<ActiveEffect> = effects.iter().flat_map(|active| shaped(active)).collect();
    let along: Vec<&ActiveEffect> = effects.iter().copied().chain(&shaped).collect();
    let mut out = linear_columns(plant, &along, trace, joints)?;
    let at_motor = gear_springs(plant).is_some_and(|gears| gears.iter().any(|g| g.friction_at_motor));
    if at_motor && along.iter().any(|a| gears::acts_on_motors(a)) {
        let mut turned = linear_columns(plant, &along, trace, &joints.of_encoders())?;
        let mut at = 0;
        for active in &along {
            let own = at..at + active.values.len();
            at = own.end;
            if gears::acts_on_motors(active) {
                out[own.clone()].swap_with_slice(&mut turned[own]);
            }
        }
    }
    let mut moved_shapes = out.split_off(effects.iter().map(|a| a.values.len()).sum());
    let mut at = 0;
    let mut unobserved: Option<Channels> = None;
    for active in &effects {
        let own: Vec<usize> = (at..at + active.values.len()).collect();
        let mut unmoved: Option<Channels> = None;
        let whole = active.effect.kind().acts_on_the_whole();
        if active.has_gears() {
            at += active.values.len();
            continue;
        }
        let mut moved_wholes = match active.effect.kind() {
            Kind::Geometry | Kind::Encoder => moved_predictions(plant, trace, active, candidate.is_some())?,
            _ => Vec::new(),
        };
        for (k, entry) in active.entries().iter().enumerate() {
            if entry.parameter.role != Role::Shape && !(whole && entry.parameter.role == Role::Linear) {
                continue;
            }
            let step = difference(entry);
            let changed = |step| with(plant, active, step, candidate.is_some());
            let moved = if active.effect.kind() == Kind::Sensor {
                // Sensors act on what the mechanism does anyway.
                if unobserved.is_none() {
                    unobserved = Some(ideal(plant, trace, joints)?);
                }
                let seen = |plant: Plant| {
                    let mut series = unobserved.clone().unwrap_or_default();
                    observe(&plant, trace, &mut series);
                    series
                };
                if unmoved.is_none() {
                    unmoved = Some(seen(changed(None)));
                }
                seen(changed(Some((k, step))))
            } else if whole {
                std::mem::take(&mut moved_wholes[k])
            } else {
                let columns: Vec<Channels> = moved_shapes.drain(..active.values.len()).collect();
                let mut values = active.values.clone();
                values[k] += step;
                weighted(&columns, &values)
            };
            if unmoved.is_none() {
                unmoved = Some(if whole {
                    predict(&changed(None), trace)?
                } else {
                    weighted(&own.iter().map(|&i| &out[i]).collect::<Vec<_>>(), &active.values)
                });
            }
            let reference = unmoved.as_ref().expect("set above");
            let slope = |(m, r): (&f64, &f64)| (m - r) / step;
            out[at + k] = moved.iter().zip(reference).map(|(m, r)| m.iter().zip(r).map(slope).collect()).collect();
        }
        at += active.values.len();
    }
    if let Some(gears) = gear_springs(plant) {
        let (mut bent, mut compliances, mut at) = (Vec::new(), 0..0, 0);
        for active in &effects {
            let own = at..at + active.values.len();
            at = own.end;
            if active.has_gears() {
                // The compliances come first.
                compliances = bent.len()..bent.len() + plant.mechanism.arms();
                bent.extend(own.start..own.start + compliances.len());
                continue;
            }
            let untouched = active.effect.kind().acts_on_the_whole() || (at_motor && gears::acts_on_motors(active));
            if !untouched {
                bent.extend(own);
            }
        }
        let mut columns: Vec<Channels> = bent.iter().map(|&i| std::mem::take(&mut out[i])).collect();
        gears::through_gears(trace, joints, &gears, &mut columns, compliances)?;
        bent.into_iter().zip(columns).for_each(|(i, column)| out[i] = column);
    }
    Ok(out)
}

/// Columns of elastic gears that `plant`, which predicts `rigid`, does not have yet.
///
/// Gears that ring leave nothing of what infinitesimally elastic ones would do: the columns are secants, from rigid
/// gears to those of `active` (of usual size if they are rigid, too). The change of a channel is put down to the gear of
/// its own limb.
fn gear_columns(
    plant: &Plant,
    trace: &Trace,
    active: &ActiveEffect,
    rigid: &Channels,
) -> Result<Vec<Channels>, KinematicsError> {
    let rigid_gears = active.effect.gear_springs(&active.values()).is_none();
    let there = if rigid_gears { active.at_usual_size() } else { active.clone() };
    let elastic = predict(&with(plant, &there, None, true), trace)?;
    let column = |(arm, (entry, value)): (usize, (Entry, &f64))| -> Channels {
        let of = |(c, (e, r)): (usize, (&Vec<f64>, &Vec<f64>))| {
            let own = entry.parameter.role == Role::Linear && trace.channels[c].limb() == arm;
            e.iter().zip(r).map(|(e, r)| if own { (e - r) / value } else { 0.0 }).collect()
        };
        elastic.iter().zip(rigid).enumerate().map(of).collect()
    };
    Ok(there.entries().into_iter().zip(&there.values).enumerate().map(column).collect())
}

/// Predictions with each estimated parameter of an effect moved by its step; nothing for fixed ones.
fn moved_predictions(
    plant: &Plant,
    trace: &Trace,
    active: &ActiveEffect,
    is_candidate: bool,
) -> Result<Vec<Channels>, KinematicsError> {
    let moved = |(k, entry): (usize, &Entry)| match entry.parameter.role {
        Role::Fixed => Ok(Channels::new()),
        _ => predict(&with(plant, active, Some((k, difference(entry))), is_candidate), trace),
    };
    active.entries().par_iter().enumerate().map(moved).collect()
}

/// Step of a parameter for differences of predictions.
fn difference(entry: &Entry) -> f64 {
    1e-4 * entry.parameter.default.abs().max(1e-6)
}

/// Copies of a force law, each with one shape parameter moved by a step.
fn shaped(active: &ActiveEffect) -> Vec<ActiveEffect> {
    if active.effect.kind().acts_on_the_whole() {
        return Vec::new();
    }
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
fn weighted<C: std::borrow::Borrow<Channels>>(columns: &[C], values: &[f64]) -> Channels {
    let first = columns[0].borrow();
    let mut sum: Channels = first.iter().map(|s| vec![0.0; s.len()]).collect();
    for (column, value) in columns.iter().zip(values).filter(|(_, v)| **v != 0.0) {
        for (total, series) in sum.iter_mut().zip(column.borrow()) {
            for (t, x) in total.iter_mut().zip(series) {
                *t += value * x;
            }
        }
    }
    sum
}

/// The plant with a candidate in place, or with one of its own effects changed by a step.
fn with(plant: &Plant, active: &ActiveEffect, step: Option<(usize, f64)>, is_candidate: bool) -> Plant {
    let mut changed = active.clone();
    if let Some((k, step)) = step {
        changed.values[k] += step;
    }
    let mut plant = plant.clone();
    if active.effect.kind() == Kind::Geometry {
        if !is_candidate {
            // The plant's geometry already holds the present values: apply the difference only.
            for (new, old) in changed.values.iter_mut().zip(&active.values) {
                *new -= old;
            }
        }
        changed.effect.geometry(&changed.values(), &mut plant.geometry);
    } else if is_candidate {
        plant.effects.push(changed);
    } else if let Some(own) = plant.effects.iter_mut().find(|a| a.effect.name() == active.effect.name()) {
        *own = changed;
    }
    if active.effect.kind() == Kind::Encoder {
        plant.sum_inertia();
    }
    plant
}

/// Samples of which the columns are computed together.
const CHUNK: usize = 1024;

fn linear_columns(
    plant: &Plant,
    effects: &[&ActiveEffect],
    trace: &Trace,
    joints: &Joints,
) -> Result<Vec<Channels>, KinematicsError> {
    let own = OwnStates::along(plant, effects, trace, joints)?;
    let plant_effects: Vec<&ActiveEffect> = plant.effects.iter().collect();
    let plant_own = OwnStates::along(plant, &plant_effects, trace, joints)?;
    let reads_reactions = effects.iter().any(|a| a.effect.reads_reactions());
    let reads = reads_reactions || effects.iter().any(|a| a.effect.reads_torque());
    let total: usize = effects.iter().map(|a| a.values.len()).sum();
    let channels = trace.channels.len();
    let samples: Vec<usize> = (0..trace.len()).collect();
    // Chunks keep the transposition from rows to series in the cache.
    let mut chunks: Vec<Vec<Vec<f64>>> = samples
        .par_chunks(CHUNK)
        .map(|chunk| {
            let mut series = vec![Vec::with_capacity(chunk.len()); total * channels];
            for &k in chunk {
                let motion = joints.motion(k)?;
                let loads = if reads {
                    inverse_dynamics(plant, trace.t[k], &motion, &plant_own.at(k), reads_reactions)?
                } else {
                    Output::default()
                };
                let rows = regressor(plant, effects, trace.t[k], &motion, &loads, &own.at(k), &trace.channels)?;
                for p in 0..total {
                    for c in 0..channels {
                        series[p * channels + c].push(rows[(c, p)]);
                    }
                }
            }
            Ok(series)
        })
        .collect::<Result<_, KinematicsError>>()?;
    let whole = |p: usize, c: usize| chunks.iter().flat_map(|chunk| &chunk[p * channels + c]).copied().collect();
    let mut out: Vec<Channels> = if chunks.len() == 1 {
        let mut only = chunks.remove(0).into_iter();
        (0..total).map(|_| only.by_ref().take(channels).collect()).collect()
    } else {
        (0..total).into_par_iter().map(|p| (0..channels).map(|c| whole(p, c)).collect()).collect()
    };
    if plant.observes() {
        let mut zero: Channels = vec![vec![0.0; trace.len()]; trace.channels.len()];
        observe(plant, trace, &mut zero);
        out.par_iter_mut().for_each(|column| {
            observe(plant, trace, column);
            for (series, zero) in column.iter_mut().zip(&zero) {
                for (x, z) in series.iter_mut().zip(zero) {
                    *x -= z;
                }
            }
        });
    }
    Ok(out)
}

#[cfg(test)]
mod tests;

//! What a plant predicts for a trace, and how that changes with each parameter.
//!
//! A trace holds what the encoders read. What lies between encoder and joint ([`Kind::Encoder`]) is taken off first:
//! constant offsets o, then the deflection of elastic gears. With θ the encoder angle less its offset, J the rotor's
//! inertia and c the compliance, the exact inverse is q = θ − δ, δ = c·(τ − J·θ̈), τ = ID(q, q̇, q̈) + J·δ̈, ID the inverse
//! dynamics with the rotor on the arm. δ is taken from τ = ID(θ, θ̇, θ̈) instead, smoothed and differentiated like the
//! angles: exact to first order in c, and valid below the ringing of the gears, which a measured motion does not
//! determine. Their damper, a shift of δ by c·d (under a millisecond), is of second order and left out.
//!
//! Own states of force laws are integrated along the measured motion.

mod averaged;

use std::ops::Range;

use rayon::prelude::*;

use super::Trace;
use super::filtering::Kernel;
use crate::dynamics::{Channel, Output, Plant, inverse_dynamics, regressor};
use crate::effects::{ActiveEffect, Entry, GearSpring, Instant, Kind, Role};
use crate::kinematics::{JointState, KinematicsError, Motion, Reactions, SocketSet};
use crate::model::AXES;
use crate::recording::Signals;

pub use averaged::averaged_columns;

/// Series of every channel, in the order of the trace's channels.
pub type Channels = Vec<Vec<f64>>;

/// Own states of each effect at each sample: `[sample][effect]`, empty where no effect has states.
type OwnStates = Vec<Vec<Vec<f64>>>;

/// Whether a prediction at one sample needs only samples around it (see [`reach`]); own states need all before.
pub fn is_local(plant: &Plant) -> bool {
    plant.effects.iter().all(|a| a.states() == 0 || a.effect.kind() == Kind::Encoder)
}

/// Samples on either side that a local prediction needs: sensors shift by less, deflections are smoothed over less.
fn reach(plant: &Plant) -> usize {
    if plant.observes() || gear_springs(plant).is_some() { 256 } else { 0 }
}

/// Predicted channels of a plant along a trace, and their derivatives by all its parameters.
pub fn prediction_and_columns(plant: &Plant, trace: &Trace) -> Result<(Channels, Vec<Channels>), KinematicsError> {
    let motions = motions(plant, trace)?;
    let predicted = predict_along(plant, trace, &motions)?;
    Ok((predicted, columns_along(plant, trace, None, &motions)?))
}

/// Predicted channels of a plant along a trace.
pub fn predict(plant: &Plant, trace: &Trace) -> Result<Channels, KinematicsError> {
    if !is_local(plant) || trace.len() <= CHUNK {
        let motions = motions(plant, trace)?;
        return predict_along(plant, trace, &motions);
    }
    // In pieces: the motion of all bodies takes kilobytes per sample.
    let starts: Vec<usize> = (0..trace.len()).step_by(CHUNK).collect();
    let pieces: Vec<Channels> = starts
        .into_par_iter()
        .map(|start| {
            let range = start..(start + CHUNK).min(trace.len());
            let (around, shift) = surroundings(plant, trace, &range);
            let mut piece = predict_along(plant, &around, &motions(plant, &around)?)?;
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
    let outer = range.start.saturating_sub(reach)..(range.end + reach).min(trace.len());
    let shift = range.start - outer.start;
    (trace.window(outer), shift)
}

/// Motion of the mechanism: that of the encoders less what lies between them and the joints.
fn motions(plant: &Plant, trace: &Trace) -> Result<Vec<Motion>, KinematicsError> {
    let mut offset = [0.0; AXES];
    for active in &plant.effects {
        active.effect.encoder(&active.values(), &active.effect.initial_state(&active.values()), &mut offset);
    }
    let joint = |j: &JointState| JointState { q: std::array::from_fn(|i| j.q[i] - offset[i]), ..*j };
    let rigid: Vec<Motion> = trace.joints.par_iter().map(|j| plant.motion(&joint(j))).collect::<Result<_, _>>()?;
    match gear_springs(plant) {
        Some(gears) => deflected(plant, trace, &rigid, &gears),
        None => Ok(rigid),
    }
}

fn gear_springs(plant: &Plant) -> Option<[GearSpring; AXES]> {
    plant.effects.iter().find_map(|a| a.effect.gear_springs(&a.values()))
}

/// Shortest half width over which deflections are smoothed, s: a third of the gears' period leaves the ringing out.
const DEFLECTION_HALF_WIDTH: f64 = 4e-3;

/// Joint motion behind elastic gears that is `rigid` at the encoders.
fn deflected(
    plant: &Plant,
    trace: &Trace,
    rigid: &[Motion],
    gears: &[GearSpring; AXES],
) -> Result<Vec<Motion>, KinematicsError> {
    let effects: Vec<&ActiveEffect> = plant.effects.iter().collect();
    let states = own_states(plant, &effects, trace, rigid);
    let torque: Vec<[f64; AXES]> = (0..trace.len())
        .into_par_iter()
        .map(|k| {
            let own = slices(&states, k, effects.len());
            Ok(inverse_dynamics(plant, trace.t[k], &rigid[k], &own, false)?.tau)
        })
        .collect::<Result<_, KinematicsError>>()?;
    let mut joints: Vec<JointState> = rigid.iter().map(|m| JointState { q: m.q, qd: m.qd, qdd: m.qdd }).collect();
    let least = (DEFLECTION_HALF_WIDTH / trace.dt).round() as usize;
    for (i, gear) in gears.iter().enumerate().filter(|(_, g)| g.compliance != 0.0) {
        let kernel = Kernel::new(trace.half_width[i].max(least));
        for segment in &trace.segments {
            let deflection: Vec<f64> = segment
                .clone()
                .map(|k| gear.compliance * (torque[k][i] - gear.rotor_inertia * rigid[k].qdd[i]))
                .collect();
            let padded = reflected(&deflection, kernel.half_width);
            for (derivative, scale) in [(0, 1.0), (1, 1.0 / trace.dt), (2, 1.0 / (trace.dt * trace.dt))] {
                for (joint, x) in joints[segment.clone()].iter_mut().zip(kernel.apply(derivative, &padded)) {
                    let target = [&mut joint.q, &mut joint.qd, &mut joint.qdd];
                    target[derivative][i] -= x * scale;
                }
            }
        }
    }
    joints.par_iter().map(|j| plant.motion(j)).collect()
}

/// A series with `m` samples more at either end, turned about the end points: value and slope go on.
fn reflected(x: &[f64], m: usize) -> Vec<f64> {
    let Some(last) = x.len().checked_sub(1) else { return Vec::new() };
    let before = (1..=m).rev().map(|k| 2.0 * x[0] - x[k.min(last)]);
    let after = (1..=m).map(|k| 2.0 * x[last] - x[last.saturating_sub(k)]);
    before.chain(x.iter().copied()).chain(after).collect()
}

fn predict_along(plant: &Plant, trace: &Trace, motions: &[Motion]) -> Result<Channels, KinematicsError> {
    let mut series = ideal(plant, trace, motions)?;
    observe(plant, trace, &mut series);
    Ok(series)
}

/// Predicted channels before the sensors change them.
fn ideal(plant: &Plant, trace: &Trace, motions: &[Motion]) -> Result<Channels, KinematicsError> {
    let effects: Vec<&ActiveEffect> = plant.effects.iter().collect();
    let states = own_states(plant, &effects, trace, motions);
    let with_struts = trace.channels.iter().any(|c| c.drive().is_none());
    let gears = gear_springs(plant).unwrap_or_default();
    let outputs: Vec<_> = (0..trace.len())
        .into_par_iter()
        .map(|k| {
            let own = slices(&states, k, effects.len());
            let mut out = inverse_dynamics(plant, trace.t[k], &motions[k], &own, with_struts)?;
            for (i, gear) in gears.iter().enumerate() {
                // The rotor moves with the encoder, not with the arm.
                out.tau[i] += gear.rotor_inertia * (trace.joints[k].qdd[i] - motions[k].qdd[i]);
            }
            Ok(out)
        })
        .collect::<Result<_, _>>()?;
    let series: Channels = trace
        .channels
        .iter()
        .map(|channel| {
            let value = |o: &Output| match *channel {
                Channel::Torque(axis) | Channel::Force(axis) => o.tau[axis],
                Channel::StrutUpper(s) => o.reactions.upper[s],
                Channel::StrutLower(s) => o.reactions.lower[s],
            };
            outputs.iter().map(value).collect()
        })
        .collect();
    Ok(series)
}

fn slices(states: &OwnStates, k: usize, effects: usize) -> Vec<&[f64]> {
    if states.is_empty() { vec![&[]; effects] } else { states[k].iter().map(Vec::as_slice).collect() }
}

/// Integrates the effects' own states along the measured motion; those of [`Kind::Encoder`] rest.
fn own_states(plant: &Plant, effects: &[&ActiveEffect], trace: &Trace, motions: &[Motion]) -> OwnStates {
    if effects.iter().all(|a| a.states() == 0) {
        return Vec::new();
    }
    let mut now: Vec<Vec<f64>> = effects.iter().map(|a| a.effect.initial_state(&a.values())).collect();
    let none = Reactions::default();
    let rate = |active: &ActiveEffect, k: usize, state: &[f64]| {
        let (mut rate, mut slope) = (vec![0.0; state.len()], vec![0.0; state.len()]);
        let at = Instant {
            t: trace.t[k],
            motion: &motions[k],
            bodies: &plant.bodies,
            gravity: plant.gravity,
            reactions: &none,
            state,
            torque: [0.0; 4],
            closed: SocketSet::ALL,
        };
        active.effect.state_rate(&active.values(), &at, &mut rate, &mut slope);
        (rate, slope)
    };
    let mut out = Vec::with_capacity(trace.len());
    for k in 0..trace.len() {
        if k > 0 {
            let h = trace.t[k] - trace.t[k - 1];
            for (active, x) in effects.iter().zip(&mut now) {
                if !x.is_empty() && active.effect.kind() != Kind::Encoder {
                    *x = exponential_heun(x, h, |end, state| rate(active, k - 1 + usize::from(end), state));
                }
            }
        }
        out.push(now.clone());
    }
    out
}

/// One step of ẋ = f(t, x): exact for f linear in x with constant slope λ, second order otherwise, stable for λ·h → −∞;
/// Heun's method for λ = 0.
///
/// `rate(end, x)` gives f and λ = ∂f_i/∂x_i at the start or the end of the step. λ is the mean of both, so that a slope that
/// varies with the motion enters by its integral.
fn exponential_heun(x: &[f64], h: f64, rate: impl Fn(bool, &[f64]) -> (Vec<f64>, Vec<f64>)) -> Vec<f64> {
    let (first, slope) = rate(false, x);
    let ahead: Vec<f64> = (0..x.len()).map(|i| x[i] + h * phi(h * slope[i]).0 * first[i]).collect();
    let (second, slope_ahead) = rate(true, &ahead);
    (0..x.len())
        .map(|i| {
            let lambda = 0.5 * (slope[i] + slope_ahead[i]);
            let (phi_1, phi_2) = phi(h * lambda);
            let change = second[i] - first[i] - lambda * (ahead[i] - x[i]);
            x[i] + h * (phi_1 * first[i] + phi_2 * change)
        })
        .collect()
}

/// φ₁(z) = (eᶻ − 1)/z and φ₂(z) = (eᶻ − 1 − z)/z².
fn phi(z: f64) -> (f64, f64) {
    if z.abs() < 1e-2 {
        let phi_2 = 0.5 + z * (1.0 / 6.0 + z * (1.0 / 24.0 + z * (1.0 / 120.0 + z / 720.0)));
        (1.0 + z * phi_2, phi_2)
    } else {
        (z.exp_m1() / z, (z.exp_m1() - z) / (z * z))
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
    columns_along(plant, trace, candidate, &motions(plant, trace)?)
}

fn columns_along(
    plant: &Plant,
    trace: &Trace,
    candidate: Option<&ActiveEffect>,
    motions: &[Motion],
) -> Result<Vec<Channels>, KinematicsError> {
    let rigid = plant.rigid_bodies();
    let effects: Vec<&ActiveEffect> = match candidate {
        Some(active) => vec![active],
        None => std::iter::once(&rigid).chain(&plant.effects).collect(),
    };
    // Force laws with a shape moved by a step go along: only their own contribution changes.
    let shaped: Vec<ActiveEffect> = effects.iter().flat_map(|active| shaped(active)).collect();
    let along: Vec<&ActiveEffect> = effects.iter().copied().chain(&shaped).collect();
    let mut out = linear_columns(plant, &along, trace, motions)?;
    let mut moved_shapes = out.split_off(effects.iter().map(|a| a.values.len()).sum());
    let mut at = 0;
    let mut unobserved: Option<Channels> = None;
    for active in &effects {
        let own: Vec<usize> = (at..at + active.values.len()).collect();
        let mut unmoved: Option<Channels> = None;
        for (k, entry) in active.entries().iter().enumerate() {
            let whole = active.effect.kind().acts_on_the_whole();
            if entry.parameter.role != Role::Shape && !(whole && entry.parameter.role == Role::Linear) {
                continue;
            }
            let step = difference(entry);
            let changed = |step| with(plant, active, step, candidate.is_some());
            let moved = if active.effect.kind() == Kind::Sensor {
                // Sensors act on what the mechanism does anyway.
                if unobserved.is_none() {
                    unobserved = Some(ideal(plant, trace, motions)?);
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
                predict(&changed(Some((k, step))), trace)?
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
    Ok(out)
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
    motions: &[Motion],
) -> Result<Vec<Channels>, KinematicsError> {
    let states = own_states(plant, effects, trace, motions);
    let plant_effects: Vec<&ActiveEffect> = plant.effects.iter().collect();
    let plant_states = own_states(plant, &plant_effects, trace, motions);
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
                let loads = if reads {
                    let own = slices(&plant_states, k, plant.effects.len());
                    inverse_dynamics(plant, trace.t[k], &motions[k], &own, reads_reactions)?
                } else {
                    Output::default()
                };
                let own = slices(&states, k, effects.len());
                let rows = regressor(plant, effects, trace.t[k], &motions[k], &loads, &own, &trace.channels)?;
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

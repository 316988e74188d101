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

use std::ops::Range;

use rayon::prelude::*;

use super::Trace;
use super::filtering::Kernel;
use crate::dynamics::{Channel, Output, Plant, inverse_dynamics, regressor};
use crate::effects::{ActiveEffect, Entry, GearSpring, Instant, Kind, Role};
use crate::kinematics::{JointState, KinematicsError, Motion, Reactions, SocketSet};
use crate::model::AXES;
use crate::recording::Signals;

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
mod tests {
    use super::*;
    use crate::effects::find;
    use crate::recording::{Configuration, Setup};

    const DT: f64 = 4e-4;

    fn trace(joints: Vec<JointState>, setup: Setup) -> Trace {
        Trace {
            name: "made".into(),
            setup,
            t: (0..joints.len()).map(|k| k as f64 * DT).collect(),
            channels: Channel::TORQUES.to_vec(),
            measured: vec![vec![0.0; joints.len()]; AXES],
            segments: std::iter::once(0..joints.len()).collect(),
            dt: DT,
            half_width: [3; AXES],
            joints,
        }
    }

    /// The shipped robot without friction, its arms and rotor alone.
    fn arms(name: &str, blocks: &[&[f64]]) -> (Plant, Setup) {
        let mut model = crate::model::Model::read(std::path::Path::new("models/irb360-6-1600.toml")).unwrap();
        model.effects = vec![ActiveEffect::new(find(name).unwrap(), blocks)];
        let setup = Setup { configuration: Configuration::Disassembled, ..Setup::default() };
        (Plant::new(&model, &setup), setup)
    }

    fn rms(x: impl Iterator<Item = f64>) -> f64 {
        let squares: Vec<f64> = x.map(|x| x * x).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    }

    #[test]
    fn steep_hysteresis_follows_the_closed_form_at_every_angle() {
        // q = ½(1 − cos 20t): 10 rad/s, so λ·h reaches −10·4e-4/4.4e-4 = −9, where Heun's method diverges.
        // A reversal between two samples is known to q̈·h²/4 = 8e-6 rad only, which is an error of z of 8e-6/δ at most.
        for angle in [4.4e-5, 4.4e-4, 0.02] {
            let at = |t: f64| JointState {
                q: [0.5 * (1.0 - (20.0 * t).cos()); 4],
                qd: [10.0 * (20.0 * t).sin(); 4],
                qdd: [200.0 * (20.0 * t).cos(); 4],
            };
            let (plant, setup) = arms("backlash_hysteresis", &[&[1.0; 3], &[angle]]);
            let trace = trace((0..2500).map(|k| at(f64::from(k) * DT)).collect(), setup);
            let motions = motions(&plant, &trace).unwrap();
            let states = own_states(&plant, &[&plant.effects[0]], &trace, &motions);
            // z = s − (s − z_r)·exp(−|q − q_r|/δ) since the last reversal r.
            let half_period = std::f64::consts::PI / 20.0;
            let mut worst = 0f64;
            let (mut reversed, mut leg) = (0.0, 0);
            for (k, own) in states.iter().enumerate() {
                let now = (trace.t[k] / half_period) as usize;
                while leg < now {
                    let sign = if leg % 2 == 0 { 1.0 } else { -1.0 };
                    reversed = sign - (sign - reversed) * (-1.0 / angle).exp();
                    leg += 1;
                }
                let sign = if leg % 2 == 0 { 1.0 } else { -1.0 };
                let travelled = (trace.joints[k].q[0] - (leg % 2) as f64).abs();
                let exact = sign - (sign - reversed) * (-travelled / angle).exp();
                worst = worst.max((own[0][0] - exact).abs());
                assert!(own[0][0].abs() < 1.0 + 1e-3);
            }
            println!("δ = {angle} rad: {worst:.1e}");
            assert!(worst < 8.1e-6 / angle, "δ = {angle}: {worst:e}");
        }
    }

    #[test]
    fn steps_are_exact_for_linear_laws_and_of_second_order_else() {
        // ẋ = −500·(x − 2): one step of 0.1 s from 0 gives 2·(1 − e⁻⁵⁰).
        let x = exponential_heun(&[0.0], 0.1, |_, x| (vec![-500.0 * (x[0] - 2.0)], vec![-500.0]));
        approx::assert_relative_eq!(x[0], 2.0, epsilon = 1e-14);
        // ẋ = −x², x(0) = 1: x(1) = ½. Halving the step quarters the error, also with half the true slope stated.
        let error = |steps: u32, share: f64| {
            let h = 1.0 / f64::from(steps);
            let law = |_: bool, x: &[f64]| (vec![-x[0] * x[0]], vec![-2.0 * share * x[0]]);
            let mut x = vec![1.0];
            for _ in 0..steps {
                x = exponential_heun(&x, h, law);
            }
            (x[0] - 0.5).abs()
        };
        for share in [0.0, 0.5, 1.0] {
            let ratio = error(100, share) / error(200, share);
            assert!((3.8..4.2).contains(&ratio), "{ratio} at {share}");
        }
    }

    #[test]
    fn encoder_offset_is_taken_off_the_recorded_angles() {
        let (shifted, setup) = arms("joint_zero_offset", &[&[0.01, -0.02, 0.0, 0.0]]);
        let (plain, _) = arms("joint_zero_offset", &[&[0.0; 4]]);
        let at = |q: [f64; 4]| JointState { q, qd: [1.0; 4], qdd: [2.0; 4] };
        let read = predict(&shifted, &trace(vec![at([0.51, 0.38, 0.3, 0.0]); 10], setup)).unwrap();
        let truth = predict(&plain, &trace(vec![at([0.5, 0.4, 0.3, 0.0]); 10], setup)).unwrap();
        for (a, b) in read.iter().flatten().zip(truth.iter().flatten()) {
            approx::assert_relative_eq!(a, b, epsilon = 1e-12);
        }
    }

    /// One arm behind an elastic gear, driven by a controller on the motor side: what the encoder reads, and the torque.
    fn elastic_arm(plant: &Plant, compliance: f64, damping: f64, rotor: f64) -> (Vec<JointState>, Vec<f64>) {
        let rigid = |q: f64, qdd: f64| {
            let joints = JointState { q: [q, 0.0, 0.0, 0.0], qd: [0.0; 4], qdd: [qdd, 0.0, 0.0, 0.0] };
            let motion = plant.motion(&joints).unwrap();
            inverse_dynamics(plant, 0.0, &motion, &[&[]], false).unwrap().tau[0]
        };
        let inertia = rigid(0.0, 1.0) - rigid(0.0, 0.0) - rotor;
        let wanted = |t: f64| {
            let waves = [(0.20, 9.0), (0.05, 21.0), (0.02, 33.0)];
            // Faded in over half a second, so that nothing rings.
            let fade = 1.0 - (-(t / 0.25).powi(4)).exp();
            0.5 + fade * waves.iter().map(|(a, w)| a * (w * t).sin()).sum::<f64>()
        };
        let torque = |t: f64, x: &[f64; 4]| {
            let h = 1e-5;
            let rate = (wanted(t + h) - wanted(t - h)) / (2.0 * h);
            let acceleration = (wanted(t + h) - 2.0 * wanted(t) + wanted(t - h)) / (h * h);
            let feed = rigid(wanted(t), acceleration);
            feed + 60.0 * (wanted(t) - x[0] - x[2]) + 8.0 * (rate - x[1] - x[3])
        };
        // x = (q, q̇, δ, δ̇)
        let law = |t: f64, x: &[f64; 4]| {
            let transmitted = x[2] / compliance + damping * x[3];
            let arm = (transmitted - rigid(x[0], 0.0)) / inertia;
            [x[1], arm, x[3], (torque(t, x) - transmitted) / rotor - arm]
        };
        let moved = |x: &[f64; 4], d: &[f64; 4], h: f64| std::array::from_fn(|i| x[i] + h * d[i]);
        let start = compliance * rigid(0.5, 0.0);
        let mut x = [0.5 - start, 0.0, start, 0.0];
        let (mut joints, mut torques) = (Vec::new(), Vec::new());
        for k in 0..7500 {
            let t = f64::from(k) * DT;
            let d = law(t, &x);
            joints.push(JointState {
                q: [x[0] + x[2], 0.0, 0.0, 0.0],
                qd: [x[1] + x[3], 0.0, 0.0, 0.0],
                qdd: [d[1] + d[3], 0.0, 0.0, 0.0],
            });
            torques.push(torque(t, &x));
            for s in 0..4 {
                let (h, t) = (DT / 4.0, t + f64::from(s) * DT / 4.0);
                let a = law(t, &x);
                let b = law(t + 0.5 * h, &moved(&x, &a, 0.5 * h));
                let c = law(t + 0.5 * h, &moved(&x, &b, 0.5 * h));
                let d = law(t + h, &moved(&x, &c, h));
                x = std::array::from_fn(|i| x[i] + h / 6.0 * (a[i] + 2.0 * b[i] + 2.0 * c[i] + d[i]));
            }
        }
        (joints, torques)
    }

    #[test]
    fn elastic_drive_is_seen_through_the_encoder_and_its_compliance_comes_back() {
        const COMPLIANCE: f64 = 1.5e-4;
        let (rigid, setup) = arms("drive_elasticity", &[&[0.0; 3], &[20.0], &[0.18]]);
        let (elastic, _) = arms("drive_elasticity", &[&[COMPLIANCE, 0.0, 0.0], &[20.0], &[0.18]]);
        let (joints, torque) = elastic_arm(&rigid, COMPLIANCE, 20.0, 0.18);
        let trace = trace(joints, setup);
        let inside = 100..torque.len() - 100;
        let residual = |plant: &Plant| -> Vec<f64> {
            let predicted = predict(plant, &trace).unwrap();
            inside.clone().map(|k| torque[k] - predicted[0][k]).collect()
        };
        let (before, after) = (residual(&rigid), residual(&elastic));
        let column = &columns(&rigid, &trace, None).unwrap()[rigid.rigid_bodies().values.len()][0];
        let column = &column[inside];
        let product: f64 = column.iter().zip(&before).map(|(c, r)| c * r).sum();
        let estimate = product / column.iter().map(|c| c * c).sum::<f64>();
        let (before, after) = (rms(before.into_iter()), rms(after.into_iter()));
        println!("rigid {before:.4} N·m, elastic {after:.4} N·m, compliance {estimate:.3e}");
        assert!(after < 0.1 * before, "{before} {after}");
        assert!((estimate / COMPLIANCE - 1.0).abs() < 0.1, "{estimate:e}");
    }
}

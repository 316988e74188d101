//! Internal states of effects, integrated along a measured motion.

use super::Joints;
use crate::dynamics::Plant;
use crate::effects::{ActiveEffect, Instant, Kind, Role};
use crate::identification::Dataset;
use crate::kinematics::{KinematicsError, Motion, Reactions};
use crate::machine::Part;

/// Internal states of several effects at each sample.
pub(super) struct InternalStates {
    /// Start of each effect's states among those of a sample, followed by the end of the last.
    starts: Vec<usize>,
    /// Values sample by sample; empty if no effect has states.
    values: Vec<f64>,
}

impl InternalStates {
    /// Integrates the effects' internal states along a motion, also where its samples were left out; those of
    /// [`Kind::Encoder`] stay constant. States that depend on strut forces take those of the plant with these effects.
    pub(super) fn along(
        plant: &Plant,
        effects: &[&ActiveEffect],
        dataset: &Dataset,
        joints: &Joints,
    ) -> Result<Self, KinematicsError> {
        let mut starts = vec![0];
        starts.extend(effects.iter().scan(0, |end, a| {
            *end += a.states();
            Some(*end)
        }));
        let width = starts[effects.len()];
        if width == 0 || dataset.is_empty() {
            return Ok(Self { starts, values: Vec::new() });
        }
        let moving = |a: &ActiveEffect| a.states() > 0 && a.effect.kind() != Kind::Encoder;
        if !effects.iter().any(|a| moving(a)) {
            let initial: Vec<f64> = effects.iter().flat_map(|a| a.initial_state()).collect();
            return Ok(Self { starts, values: initial.repeat(dataset.len()) });
        }
        let host = host(plant, effects);
        // Candidates that add nothing leave the forces of the plant.
        let adds_nothing = |host: &Plant| {
            std::ptr::eq(plant, joints.plant)
                && !plant.effects.iter().any(ActiveEffect::states_read_reactions)
                && host.effects[plant.effects.len()..].iter().all(is_absent)
        };
        let of_plant = host.as_ref().filter(|host| adds_nothing(host)).and_then(|_| joints.loads(dataset).ok());
        let host = host.filter(|_| of_plant.is_none());
        let of_host: Vec<&ActiveEffect> = host.iter().flat_map(|host| &host.effects).collect();
        let all = [effects, &of_host].concat();
        let mut motions = [Motion::REST; 2];
        joints.set_motion(0, &mut motions[0])?;
        let resting = match (of_plant, &host) {
            (Some(loads), _) => loads.of_samples[0].reactions,
            (None, Some(host)) => host.resting_reactions(dataset.t[0], &motions[0]),
            (None, None) => Reactions::ZERO,
        };
        let first = Instant { reactions: &resting, ..plant.instant(dataset.t[0], &motions[0], &[]) };
        let start = |a: &&ActiveEffect| if moving(a) { a.steady_state(&first) } else { a.initial_state() };
        let mut now: Vec<Vec<f64>> = all.iter().map(start).collect();
        // States on the drives, and those of effects without action, do not change the forces of the struts.
        let keeps_forces =
            of_host.iter().all(|a| a.states() == 0 || a.effect.acts_on() == Part::Drives || is_absent(a));
        let mut forces = [Reactions::ZERO; 2];
        let mut values = Vec::with_capacity(dataset.len() * width);
        let (mut before, mut place) = (dataset.t[0], 0);
        for k in 0..dataset.len() {
            let left_out = dataset.motion_before(k).iter().map(|(t, joint)| (*t, joints.plant.behind_encoders(joint)));
            let sample = std::iter::once((dataset.t[k], joints.states[k]));
            for (t, joint) in left_out.chain(sample).filter(|_| k > 0) {
                let is_first = place == 0;
                place += 1;
                let (here, there) = (place % 2, (place + 1) % 2);
                joints.plant.set_motion(&joint, &mut motions[here])?;
                let ends = [plant.instant(before, &motions[there], &[]), plant.instant(t, &motions[here], &[])];
                if let Some(loads) = of_plant {
                    forces = [loads.of_samples[k - 1].reactions, loads.of_samples[k].reactions];
                } else if let Some(host) = &host {
                    let states: Vec<&[f64]> = now[effects.len()..].iter().map(Vec::as_slice).collect();
                    let at_end = |i: usize| host.reactions(ends[i].t, ends[i].motion, &states);
                    forces = [if !is_first && keeps_forces { forces[1] } else { at_end(0) }, at_end(1)];
                }
                let ends: [Instant; 2] = std::array::from_fn(|i| Instant { reactions: &forces[i], ..ends[i] });
                let rate = |active: &ActiveEffect, end: bool, state: &[f64]| {
                    let (mut rate, mut slope) = (vec![0.0; state.len()], vec![0.0; state.len()]);
                    active.state_rate(&Instant { state, ..ends[usize::from(end)] }, &mut rate, &mut slope);
                    (rate, slope)
                };
                let h = t - before;
                let step = |(active, x): (&&ActiveEffect, &Vec<f64>)| {
                    if !moving(active) {
                        return x.clone();
                    }
                    let known = active.step_along(&Instant { state: x, ..ends[0] }, &Instant { state: x, ..ends[1] });
                    known.unwrap_or_else(|| exponential_heun(x, h, |end, state| rate(active, end, state)))
                };
                now = all.iter().zip(&now).map(step).collect();
                before = t;
            }
            values.extend(now[..effects.len()].iter().flatten());
        }
        Ok(Self { starts, values })
    }

    /// States of effect `i` at sample `k`.
    pub(super) fn of(&self, k: usize, i: usize) -> &[f64] {
        let width = self.starts[self.starts.len() - 1];
        self.values.get(k * width + self.starts[i]..k * width + self.starts[i + 1]).unwrap_or(&[])
    }

    /// States of all effects at sample `k`.
    pub(super) fn at(&self, k: usize) -> Vec<&[f64]> {
        (0..self.starts.len() - 1).map(|i| self.of(k, i)).collect()
    }
}

/// Whether all linear parameters of an effect are zero.
fn is_absent(active: &ActiveEffect) -> bool {
    let mut all = active.entries().into_iter().zip(&active.values);
    all.all(|(entry, value)| entry.parameter.role != Role::Linear || *value == 0.0)
}

/// The plant with those of `effects` whose states depend on strut forces, as if they were in it; `None` without any.
fn host(plant: &Plant, effects: &[&ActiveEffect]) -> Option<Plant> {
    let mut host: Option<Plant> = None;
    for active in effects.iter().filter(|a| a.states_read_reactions()) {
        let host = host.get_or_insert_with(|| plant.clone());
        if host.effects.iter().all(|a| a.effect.name() != active.effect.name()) {
            host.effects.push((*active).clone());
        }
    }
    host
}

/// One step of the exponential Heun method for ẋ = f(t, x): exact for f linear in x with constant slope λ, otherwise
/// of second order, and stable for λ·h → −∞; Heun's method for λ = 0.
///
/// `rate(end, x)` gives f and λ = ∂f_i/∂x_i at the start or the end of the step. λ is the mean of both, so that a
/// slope that varies with the motion enters by its integral.
pub(super) fn exponential_heun(x: &[f64], h: f64, rate: impl Fn(bool, &[f64]) -> (Vec<f64>, Vec<f64>)) -> Vec<f64> {
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

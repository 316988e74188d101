//! Internal states of effects, integrated along a measured motion.

use super::Joints;
use crate::dynamics::Plant;
use crate::effects::{ActiveEffect, Instant, Kind};
use crate::identification::Dataset;
use crate::kinematics::{KinematicsError, Reactions, SocketSet};

/// Internal states of several effects at each sample.
pub(super) struct InternalStates {
    /// Start of each effect's states among those of a sample, followed by the end of the last.
    starts: Vec<usize>,
    /// Values sample by sample; empty if no effect has states.
    values: Vec<f64>,
}

impl InternalStates {
    /// Integrates the effects' internal states along a motion; those of [`Kind::Encoder`] stay constant.
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
        let mut now: Vec<Vec<f64>> = effects.iter().map(|a| a.initial_state()).collect();
        let moving = |a: &ActiveEffect| a.states() > 0 && a.effect.kind() != Kind::Encoder;
        if !effects.iter().any(|a| moving(a)) {
            return Ok(Self { starts, values: now.concat().repeat(dataset.len()) });
        }
        let none = Reactions::default();
        let mut motions = [joints.motion(0)?; 2];
        let mut values = Vec::with_capacity(dataset.len() * width);
        for k in 0..dataset.len() {
            if k > 0 {
                motions = [motions[1], joints.motion(k)?];
                let rate = |active: &ActiveEffect, end: bool, state: &[f64]| {
                    let (mut rate, mut slope) = (vec![0.0; state.len()], vec![0.0; state.len()]);
                    let at = Instant {
                        t: dataset.t[k - 1 + usize::from(end)],
                        motion: &motions[usize::from(end)],
                        bodies: &plant.bodies,
                        payload: &plant.payload,
                        gravity: plant.gravity,
                        reactions: &none,
                        state,
                        torque: [0.0; 4],
                        closed: SocketSet::ALL,
                    };
                    active.state_rate(&at, &mut rate, &mut slope);
                    (rate, slope)
                };
                let h = dataset.t[k] - dataset.t[k - 1];
                for (active, x) in effects.iter().zip(&mut now).filter(|(a, _)| moving(a)) {
                    *x = exponential_heun(x, h, |end, state| rate(active, end, state));
                }
            }
            values.extend(now.iter().flatten());
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

//! Encoders, torque and force sensors.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};

use super::Snapshot;
use super::constraints::ROWS;
use super::controller::quantised;
use crate::kinematics::motion::SOCKETS;
use crate::machine::bodies::PLATFORM;
use crate::machine::{AXES, STRUTS, Setup};
use crate::model::Model;
use crate::recording::Signals;
use crate::scenario;

/// Sensors of the machine.
pub(super) struct Sensors<'a> {
    model: &'a Model,
    fitted: scenario::Sensors,
    /// Whether there is a platform to be measured.
    assembled: bool,
    torque_noise: [f64; AXES],
    rng: Option<ChaCha8Rng>,
}

impl<'a> Sensors<'a> {
    /// Sensors of a machine; without a seed neither noise nor quantisation.
    pub fn new(model: &'a Model, setup: &Setup, fitted: scenario::Sensors, assembled: bool, seed: Option<u64>) -> Self {
        Self {
            model,
            fitted,
            assembled,
            torque_noise: setup.torque_noise.unwrap_or(model.noise.torque),
            rng: seed.map(ChaCha8Rng::seed_from_u64),
        }
    }

    /// Encoder readings for angles `q`, rad.
    pub fn angles(&self, q: &[f64; AXES]) -> [f64; AXES] {
        if self.rng.is_none() {
            return *q;
        }
        let axes = self.model.mechanism.axes();
        std::array::from_fn(|i| if i < axes { quantised(q[i], &self.model.drives[i]) } else { q[i] })
    }

    /// Reserves memory for `samples` samples.
    pub fn reserve(&self, signals: &mut Signals, samples: usize) {
        let fitted = &self.fitted;
        signals.t.reserve(samples);
        signals.q.reserve(samples);
        signals.tau.reserve(samples);
        for s in 0..STRUTS {
            signals.strut_upper[s] = fitted.strut_upper[s].then(|| Vec::with_capacity(samples));
            signals.strut_lower[s] = fitted.strut_lower[s].then(|| Vec::with_capacity(samples));
        }
        signals.ee = (fitted.ee && self.assembled).then(|| Vec::with_capacity(samples));
        signals.qd = fitted.velocity.then(|| Vec::with_capacity(samples));
        signals.qdd = fitted.acceleration.then(|| Vec::with_capacity(samples));
        signals.socket_margin = fitted.sockets.then(|| Vec::with_capacity(samples));
        signals.multipliers = fitted.multipliers.then(|| Vec::with_capacity(samples));
        signals.link_q = fitted.links.then(|| Vec::with_capacity(samples));
        signals.link_qd = fitted.links.then(|| Vec::with_capacity(samples));
    }

    /// Appends one sample, without noise.
    pub fn record(
        &self,
        signals: &mut Signals,
        (t, q, tau): (f64, &[f64; AXES], &[f64; AXES]),
        snapshot: &Snapshot,
        margins: &[f64; SOCKETS],
        multipliers: Option<[f64; ROWS]>,
    ) {
        let motion = &snapshot.motion;
        signals.t.push(t);
        signals.q.push(*q);
        signals.tau.push(*tau);
        for s in 0..STRUTS {
            if let Some(channel) = &mut signals.strut_upper[s] {
                channel.push(snapshot.reactions.upper[s]);
            }
            if let Some(channel) = &mut signals.strut_lower[s] {
                channel.push(snapshot.reactions.lower[s]);
            }
        }
        if let Some(ee) = &mut signals.ee {
            ee.push(motion.bodies[PLATFORM].position.into());
        }
        if let Some(qd) = &mut signals.qd {
            qd.push(snapshot.encoder_rate);
        }
        if let Some(qdd) = &mut signals.qdd {
            qdd.push(snapshot.encoder_acceleration);
        }
        if let Some(margin) = &mut signals.socket_margin {
            margin.push(*margins);
        }
        if let (Some(channel), Some(lambda)) = (&mut signals.multipliers, multipliers) {
            channel.push(lambda);
        }
        if let (Some(angles), Some(rates)) = (&mut signals.link_q, &mut signals.link_qd) {
            angles.push(motion.q);
            rates.push(motion.qd);
        }
    }

    /// Adds white noise to torques and forces.
    pub fn add_noise(&mut self, signals: &mut Signals) {
        let Some(rng) = &mut self.rng else { return };
        for tau in &mut signals.tau {
            for (x, sigma) in tau.iter_mut().zip(self.torque_noise).take(self.model.mechanism.axes()) {
                *x += normal(sigma).sample(rng);
            }
        }
        let force = normal(self.model.noise.strut_force);
        for x in signals.strut_upper.iter_mut().chain(&mut signals.strut_lower).flatten().flatten() {
            *x += force.sample(rng);
        }
    }
}

fn normal(sigma: f64) -> Normal<f64> {
    Normal::new(0.0, sigma.max(0.0)).expect("a finite standard deviation")
}

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
    /// Generators of the noise of torques and of strut forces, independent, so that a run may be reported in pieces.
    noise: Option<[ChaCha8Rng; 2]>,
}

impl<'a> Sensors<'a> {
    /// Sensors of a machine; without a seed neither noise nor quantisation.
    pub fn new(model: &'a Model, setup: &Setup, fitted: scenario::Sensors, assembled: bool, seed: Option<u64>) -> Self {
        Self {
            model,
            fitted,
            assembled,
            torque_noise: setup.torque_noise.unwrap_or(model.noise.torque),
            noise: seed.map(|seed| {
                [0, 1].map(|stream| {
                    let mut generator = ChaCha8Rng::seed_from_u64(seed);
                    generator.set_stream(stream);
                    generator
                })
            }),
        }
    }

    /// Encoder readings for angles `q`, rad.
    pub fn angles(&self, q: &[f64; AXES]) -> [f64; AXES] {
        if self.noise.is_none() {
            return *q;
        }
        let axes = self.model.mechanism.axes();
        std::array::from_fn(|i| if i < axes { quantised(q[i], &self.model.drives[i]) } else { q[i] })
    }

    /// Empty signals with the channels that are recorded.
    pub fn channels(&self) -> Signals {
        let fitted = &self.fitted;
        Signals {
            mechanism: self.model.mechanism,
            strut_upper: fitted.strut_upper.map(|fitted| fitted.then(Vec::new)),
            strut_lower: fitted.strut_lower.map(|fitted| fitted.then(Vec::new)),
            ee: (fitted.ee && self.assembled).then(Vec::new),
            qd: fitted.velocity.then(Vec::new),
            qdd: fitted.acceleration.then(Vec::new),
            socket_margin: fitted.sockets.then(Vec::new),
            multipliers: fitted.multipliers.then(Vec::new),
            link_q: fitted.links.then(Vec::new),
            link_qd: fitted.links.then(Vec::new),
            ..Signals::default()
        }
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

    /// Adds white noise to torques and forces; consecutive pieces of a run get the noise of the whole.
    pub fn add_noise(&mut self, signals: &mut Signals) {
        let Some([of_torque, of_force]) = &mut self.noise else { return };
        for tau in &mut signals.tau {
            for (x, sigma) in tau.iter_mut().zip(self.torque_noise).take(self.model.mechanism.axes()) {
                *x += normal(sigma).sample(of_torque);
            }
        }
        let force = normal(self.model.noise.strut_force);
        let mut channels: Vec<&mut Vec<f64>> =
            signals.strut_upper.iter_mut().chain(&mut signals.strut_lower).flatten().collect();
        for i in 0..signals.t.len() {
            for channel in &mut channels {
                channel[i] += force.sample(of_force);
            }
        }
    }
}

fn normal(sigma: f64) -> Normal<f64> {
    Normal::new(0.0, sigma.max(0.0)).expect("a finite standard deviation")
}

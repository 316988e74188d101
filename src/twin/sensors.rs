//! Encoders, torque and force sensors.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, Normal};

use super::Snapshot;
use super::constraints::ROWS;
use super::controller::quantised;
use crate::machine::{PerAxis, PerSocket, Setup};
use crate::model::Model;
use crate::recording::{Channel, FAMILIES, Signals};
use crate::scenario;

/// What is measured at one instant.
pub(super) struct Reading<'a> {
    /// Encoder readings, rad.
    pub q: PerAxis<f64>,
    /// Drive torques, N·m.
    pub tau: PerAxis<f64>,
    /// State of the machine.
    pub snapshot: &'a Snapshot,
    /// Remaining force margins of the sockets, N.
    pub margins: &'a PerSocket<f64>,
    /// Load of a single axis, N·m or N.
    pub load: f64,
    /// Multipliers of the constraint rows, if they are recorded.
    pub multipliers: Option<[f64; ROWS]>,
}

/// Sensors of the machine.
pub(super) struct Sensors<'a> {
    model: &'a Model,
    fitted: scenario::Sensors,
    /// Whether there is a platform to be measured.
    assembled: bool,
    torque_noise: PerAxis<f64>,
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
    pub fn angles(&self, q: &PerAxis<f64>) -> PerAxis<f64> {
        if self.noise.is_none() {
            return *q;
        }
        let axes = self.model.mechanism.axes();
        std::array::from_fn(|i| if i < axes { quantised(q[i], &self.model.drives[i]) } else { q[i] })
    }

    /// Empty signals with the channels that are recorded.
    pub fn channels(&self) -> Signals {
        let Self { model, fitted, assembled, .. } = self;
        let mut signals = Signals::new(model.mechanism, Vec::new());
        let all = FAMILIES.iter().flat_map(|family| family.channels(model.mechanism));
        let is_fitted = |channel: &Channel| match *channel {
            Channel::Angle(_) | Channel::Torque(_) => true,
            Channel::StrutUpper(s) => fitted.strut_upper[s],
            Channel::StrutLower(s) => fitted.strut_lower[s],
            Channel::EndEffector(_) => fitted.ee && *assembled,
            Channel::Rate(_) => fitted.velocity,
            Channel::Acceleration(_) => fitted.acceleration,
            Channel::MarginUpper(_) | Channel::MarginLower(_) => fitted.sockets,
            Channel::Multiplier(_) => fitted.multipliers,
            Channel::LinkAngle(_) | Channel::LinkRate(_) => fitted.links,
            Channel::Load(axis) => fitted.load && axis == 0 && model.mechanism.axes() == 1,
            Channel::FlangeForce(_) => false,
        };
        all.filter(is_fitted).for_each(|channel| signals.set(channel, Vec::new()));
        signals
    }

    /// Appends one sample, without noise.
    pub fn record(&self, signals: &mut Signals, t: f64, reading: &Reading) {
        let Reading { q, tau, snapshot, margins, load, multipliers } = reading;
        signals.t.push(t);
        for (channel, values) in signals.series_mut() {
            values.push(match channel {
                Channel::Angle(i) => q[i],
                Channel::Torque(i) => tau[i],
                Channel::Rate(i) => snapshot.encoder_rate[i],
                Channel::Acceleration(i) => snapshot.encoder_acceleration[i],
                Channel::LinkAngle(i) => snapshot.motion.q[i],
                Channel::LinkRate(i) => snapshot.motion.qd[i],
                Channel::StrutUpper(s) => snapshot.reactions.upper[s],
                Channel::StrutLower(s) => snapshot.reactions.lower[s],
                Channel::EndEffector(k) => snapshot.motion.origin(&self.model.geometry.plate)[k],
                Channel::MarginUpper(s) => margins[s],
                Channel::MarginLower(s) => margins[self.model.mechanism.struts() + s],
                Channel::Multiplier(row) => multipliers.map_or(0.0, |lambda| lambda[row]),
                Channel::Load(_) => *load,
                Channel::FlangeForce(_) => 0.0,
            });
        }
    }

    /// Adds white noise to torques and forces; consecutive pieces of a run get the noise of the whole.
    pub fn add_noise(&mut self, signals: &mut Signals) {
        let Some([of_torque, of_force]) = &mut self.noise else { return };
        let (torque, force) = (self.torque_noise, self.model.noise.strut_force);
        let is_torque = |channel: Channel| channel.drive().is_some();
        let is_force = |channel: Channel| matches!(channel, Channel::StrutUpper(_) | Channel::StrutLower(_));
        add(signals, is_torque, of_torque, |i| torque[i]);
        add(signals, is_force, of_force, |_| force);
    }
}

/// Adds white noise to the channels of one kind, sample by sample; `sigma` is that of a channel by its place.
fn add(signals: &mut Signals, is: impl Fn(Channel) -> bool, random: &mut ChaCha8Rng, sigma: impl Fn(usize) -> f64) {
    let samples = signals.len();
    let own = signals.series_mut().filter(|(channel, _)| is(*channel));
    let mut noisy: Vec<_> = own.map(|(channel, values)| (normal(sigma(channel.index())), values)).collect();
    for k in 0..samples {
        for (noise, values) in &mut noisy {
            values[k] += noise.sample(random);
        }
    }
}

fn normal(sigma: f64) -> Normal<f64> {
    Normal::new(0.0, sigma.max(0.0)).expect("a finite standard deviation")
}

//! Instants of a recording and the model's predictions there.

use std::sync::atomic::{AtomicBool, Ordering};

use nalgebra::Vector3;

use crate::dynamics::{Output, Plant, inverse_dynamics};
use crate::effects::Kind;
use crate::identification::Dataset;
use crate::identification::dataset::stride_for;
use crate::identification::least_squares::least_squares;
use crate::kinematics::{JointState, KinematicsError, Motion};
use crate::machine::Inertia;
use crate::machine::bodies::END_EFFECTOR;
use crate::model::Model;
use crate::numerics::parallel;
use crate::recording::Channel;

/// Largest lag considered, s.
pub const LONGEST_LAG: f64 = 0.025;

/// Steepness of the friction feature, s/rad (eq. 48).
const STEEPNESS: f64 = 100.0;

/// Number of instants predicted by one core at a time.
const CHUNK: usize = 16;

/// Samples of a dataset spread over its duration, at least the largest lag away from the ends of segments.
pub struct Instants<'a> {
    /// The recording.
    pub dataset: &'a Dataset,
    /// Indices of the samples in the dataset.
    pub at: Vec<usize>,
    /// Largest lag, samples.
    pub reach: usize,
}

impl<'a> Instants<'a> {
    /// At most `count` equally spaced instants.
    pub fn of(dataset: &'a Dataset, count: usize) -> Self {
        let reach = if dataset.dt > 0.0 { (LONGEST_LAG / dataset.dt).round() as usize } else { 0 };
        let shortest = dataset.segments.iter().map(|s| s.len()).max().unwrap_or(0);
        let reach = reach.min(shortest / 4);
        let inner =
            dataset.segments.iter().flat_map(|s| s.start + reach..s.end.saturating_sub(reach).max(s.start + reach));
        let inner: Vec<usize> = inner.collect();
        let stride = stride_for(inner.len(), count);
        Self { dataset, at: inner.into_iter().step_by(stride).collect(), reach }
    }

    /// Every `stride`-th instant.
    pub fn thinned(&self, stride: usize) -> Self {
        Self { dataset: self.dataset, at: self.at.iter().step_by(stride).copied().collect(), reach: self.reach }
    }

    /// Joint motion at the instants, transformed by `change`.
    pub fn joints(&self, change: impl Fn(&JointState) -> JointState) -> Vec<JointState> {
        self.at.iter().map(|&k| change(&self.dataset.joints[k])).collect()
    }

    /// Measured values of a channel, `lag` samples later.
    pub fn measured(&self, channel: usize, lag: isize) -> Vec<f64> {
        let series = &self.dataset.measured[channel];
        self.at.iter().map(|&k| series[k.saturating_add_signed(lag).min(series.len() - 1)]).collect()
    }
}

/// Plant of the gate: rigid bodies, payload and force laws without internal states. Encoder effects, sensor effects
/// and internal states change the predictions by less than what the gate detects.
pub fn plain(model: &Model, dataset: &Dataset) -> Plant {
    let mut plant = dataset.plant(model);
    plant.effects.retain(|a| a.states() == 0 && !matches!(a.effect.kind(), Kind::Sensor | Kind::Encoder));
    plant
}

/// The plant with an additional kilogram of payload at the payload's centre of mass.
pub fn heavier(plant: &Plant) -> Plant {
    carrying(plant, Inertia::point(1.0, plant.payload.com))
}

/// The plant with an additional `load` at its flange, in the end-effector frame.
pub fn carrying(plant: &Plant, load: Inertia) -> Plant {
    let mut loaded = plant.clone();
    let (carrier, load) = loaded.carrier(END_EFFECTOR, load);
    loaded.bodies[carrier] += load;
    loaded
}

/// The plant with a first moment of 0.1 kg·m more at its flange, along x and along y.
pub fn shifted(plant: &Plant) -> [Plant; 2] {
    [Vector3::x(), Vector3::y()].map(|e| carrying(plant, Inertia { first_moment: 0.1 * e, ..Inertia::ZERO }))
}

/// Rate of an axis in rad/s and its smooth sign, over which viscous and Coulomb friction are regressed.
pub fn friction(joints: &[JointState], axis: usize) -> [Vec<f64>; 2] {
    let rates: Vec<f64> = joints.iter().map(|j| j.qd[axis]).collect();
    let signs = rates.iter().map(|r| (STEEPNESS * r).tanh()).collect();
    [rates, signs]
}

/// The part of a torque that neither a constant nor multiples of `features`, such as the [`friction`] of its axis, explain;
/// `None` with too few samples.
pub fn beyond(torque: &[f64], features: &[Vec<f64>]) -> Option<Vec<f64>> {
    let ones = vec![1.0; torque.len()];
    let all: Vec<&[f64]> = std::iter::once(&ones).chain(features).map(Vec::as_slice).collect();
    let beta = least_squares(&all, torque)?.beta;
    let explained = |k: usize| beta.iter().zip(&all).map(|(b, feature)| b * feature[k]).sum::<f64>();
    Some(torque.iter().enumerate().map(|(k, y)| y - explained(k)).collect())
}

/// Predictions at a set of instants: one series per channel of the dataset, and which poses are reachable.
pub struct Predicted {
    /// Series by channel over the reachable instants.
    pub series: Vec<Vec<f64>>,
    /// Whether the pose of each instant is reachable.
    pub possible: Vec<bool>,
    /// Whether a force law gives no finite value at an instant with a reachable pose.
    pub lawless: bool,
}

impl Predicted {
    /// Predictions of the channels for joint motions.
    pub fn new(plant: &Plant, channels: &[Channel], t: f64, joints: &[JointState]) -> Self {
        let struts = channels.iter().any(|c| c.drive().is_none());
        let states: Vec<&[f64]> = plant.effects.iter().map(|_| &[][..]).collect();
        let lawless = AtomicBool::new(false);
        let output = |motion: &mut Motion, joints: &JointState| {
            plant.set_motion(joints, motion).ok()?;
            match inverse_dynamics(plant, t, motion, &states, struts) {
                Ok(out) if channels.iter().all(|c| out.of(*c).is_finite()) => Some(out),
                Ok(_) | Err(KinematicsError::Law(_)) => {
                    lawless.store(true, Ordering::Relaxed);
                    None
                }
                Err(_) => None,
            }
        };
        let chunks: Vec<&[JointState]> = joints.chunks(CHUNK).collect();
        let outputs: Vec<Option<Output>> = parallel::map(chunks.len(), |i| {
            let mut motion = Motion::REST;
            chunks[i].iter().map(|joints| output(&mut motion, joints)).collect::<Vec<_>>()
        })
        .concat();
        let series = |c: &Channel| outputs.iter().flatten().map(|o| o.of(*c)).collect();
        Self {
            series: channels.iter().map(series).collect(),
            possible: outputs.iter().map(Option::is_some).collect(),
            lawless: lawless.into_inner(),
        }
    }

    /// Share of the instants with a reachable pose.
    pub fn share(&self) -> f64 {
        self.possible.iter().filter(|p| **p).count() as f64 / self.possible.len().max(1) as f64
    }

    /// The values at the reachable instants.
    pub fn of(&self, values: Vec<f64>) -> Vec<f64> {
        values.into_iter().zip(&self.possible).filter(|(_, p)| **p).map(|(v, _)| v).collect()
    }
}

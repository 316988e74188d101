//! Noise of recordings: of each channel, of its means, and pooled over a set.

use super::Dataset;
use super::dataset::{averaged_segments, stride_for};
use crate::dynamics::steady_inverse_dynamics;
use crate::evidence::noise::difference_sigma;
use crate::model::Model;

/// Duration of means, s, whose differences still show noise only: a torque is smooth over a few of them.
const SMOOTH: f64 = 2e-3;
/// Number of instants at which the influence of an acceleration is computed.
const INSTANTS: usize = 100;

/// Standard deviations of the noise, N·m or N.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct NoiseLevel {
    /// Of each channel of each recording: `[recording][channel]`. They weigh the recordings of a fit.
    pub of_each: Vec<Vec<f64>>,
    /// Of each channel over all samples of all recordings, √(Σ n σ² / Σ n): RMS residual of the true model.
    pub pooled: Vec<f64>,
}

impl NoiseLevel {
    /// Noise of `datasets`, all with the same channels; empty without any.
    pub fn of(model: &Model, datasets: &[Dataset]) -> Self {
        let of_each: Vec<Vec<f64>> = datasets.iter().map(|t| t.noise(model)).collect();
        let samples = datasets.iter().map(Dataset::len).sum::<usize>() as f64;
        let pooled = |c: usize| {
            let squares = datasets.iter().zip(&of_each).map(|(t, sigma)| t.len() as f64 * sigma[c].powi(2));
            (squares.sum::<f64>() / samples).sqrt()
        };
        let channels = of_each.first().map_or(0, Vec::len);
        // The root of a square is not quite the number itself.
        let pooled = if let [one] = &of_each[..] { one.clone() } else { (0..channels).map(pooled).collect() };
        Self { of_each, pooled }
    }
}

impl Dataset {
    /// Noise standard deviation of each channel's residual: of its sensor, and of the accelerations by coarse angles.
    pub fn noise(&self, model: &Model) -> Vec<f64> {
        let of = |(sensor, angles): (f64, f64)| sensor.hypot(angles);
        self.sensor_noise(model).into_iter().zip(self.noise_by_angles(model)).map(of).collect()
    }

    /// RMS error of each predicted channel, N·m or N, by the standard errors of the accelerations.
    ///
    /// A channel changes by h_j = ∂τ/∂q̈_j with the acceleration of axis j, on which it depends linearly.
    fn noise_by_angles(&self, model: &Model) -> Vec<f64> {
        let mut squares = vec![0.0; self.channels.len()];
        let plant = self.plant(model);
        let stride = stride_for(self.len(), INSTANTS);
        let with_struts = self.channels.iter().any(|c| c.drive().is_none());
        let channels = |k: usize, axis: usize, by: f64| {
            let mut joints = self.joints[k];
            joints.qdd[axis] += by;
            let motion = plant.motion(&joints)?;
            steady_inverse_dynamics(&plant, self.t[k], &motion, with_struts)
        };
        let axes = (0..self.mechanism.axes()).filter(|&axis| self.accuracy[axis].acceleration > 0.0);
        for (axis, k) in axes.flat_map(|axis| (0..self.len()).step_by(stride).map(move |k| (axis, k))) {
            let error = self.accuracy[axis].acceleration;
            // A pose that the machine cannot take is reported by the prediction.
            let (Ok(less), Ok(more)) = (channels(k, axis, -error), channels(k, axis, error)) else { continue };
            for (sum, channel) in squares.iter_mut().zip(&self.channels) {
                *sum += (0.5 * (more.of(*channel) - less.of(*channel))).powi(2);
            }
        }
        let instants = self.len().div_ceil(stride).max(1) as f64;
        squares.into_iter().map(|sum| (sum / instants).sqrt()).collect()
    }

    /// Noise standard deviation of each channel's sensor: from the setup, else estimated from the channel's differences, else
    /// from the model.
    fn sensor_noise(&self, model: &Model) -> Vec<f64> {
        let sigma = |c: usize| {
            let drive = self.channels[c].drive();
            let stated = drive.zip(self.setup.torque_noise).map(|(i, stated)| stated[i]).filter(|s| *s > 0.0);
            let stated = stated.filter(|_| self.loads.is_none());
            let seen = || difference_sigma(&self.borne(c), &self.segments, 4).filter(|s| *s > 0.0);
            stated.or_else(seen).unwrap_or(drive.map_or(model.noise.strut_force, |i| model.noise.torque[i]))
        };
        (0..self.channels.len()).map(sigma).collect()
    }

    /// Standard deviation of the noise in means over `block` samples of each channel: σ/√n of white noise of the
    /// [`Self::noise`] σ, n = `block`.
    ///
    /// Noise with memory averages less. Its means over m samples, `SMOOTH` long, scatter by σ_m > σ/√m; a mean over n
    /// samples contains n/m of them and scatters by σ_m·√(m/n). Of a memory as long as m it is a lower bound, as
    /// [`difference_sigma`] sees neighbouring means only: of AR(1) noise a = 0.6 at 2.5 kHz 1.27 σ/√n instead of 2 σ/√n.
    ///
    /// Errors of the accelerations are largest at the inverse of the smoothing's time scale w: a wave of that frequency has
    /// the mean square ½·sinc²(T/2w) in means over T, here 1/(1 + ½·(T/w)²) of it.
    pub fn noise_of_means(&self, model: &Model, block: usize) -> Vec<f64> {
        let inner = self.stride(SMOOTH).min(block);
        let segments = averaged_segments(std::slice::from_ref(self), inner);
        let of = |(c, sigma): (usize, f64)| {
            let seen = difference_sigma(&self.means(&self.borne(c), inner), &segments, 4).unwrap_or(0.0);
            (sigma / (block as f64).sqrt()).max(seen * (inner as f64 / block as f64).sqrt())
        };
        let width = self.accuracy.iter().fold(0.0f64, |most, own| most.max(own.width));
        let waves = block as f64 * self.dt / width.max(f64::MIN_POSITIVE);
        let kept = (1.0 + 0.5 * waves.powi(2)).sqrt().recip();
        let sensor = self.sensor_noise(model).into_iter().enumerate().map(of);
        sensor.zip(self.noise_by_angles(model)).map(|(sensor, angles)| sensor.hypot(kept * angles)).collect()
    }
}

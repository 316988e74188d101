//! Comparison of model and measurement, with the patterns of the residual.

mod bursts;
mod findings;
mod hysteresis;
mod place;
mod spectrum;

use crate::identification::fit::{FitError, kinematics};
use crate::identification::{Dataset, HeldOut, NoiseLevel, Repeats, Residuals, check_together};
use crate::machine::Mechanism;
use crate::model::Model;
use crate::recording::Channel;

/// Residuals of a model without refitting.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Kind of machine.
    pub mechanism: Mechanism,
    /// Channels, in the order of the following arrays.
    pub channels: Vec<Channel>,
    /// RMS residual, N·m or N.
    pub rms: Vec<f64>,
    /// Pooled standard deviation of the sensor noise, N·m or N.
    pub noise_floor: Vec<f64>,
    /// What repeats from lap to lap and what does not; `None` where no motion repeats.
    pub repeats: Option<Repeats>,
    /// Errors on held-out data; `None` without such data.
    pub held_out: Option<HeldOut>,
    /// Patterns of the residual, largest share first.
    pub findings: Vec<Finding>,
}

/// Place or quantity at which the residual concentrates.
#[derive(Clone, Debug)]
pub struct Finding {
    /// Channel.
    pub channel: Channel,
    /// Kind of place: `mean`, `joint speed`, `joint angle`, `joint acceleration`, `hysteresis`, `time`, `reversal`,
    /// `bursts`, `workspace` or `frequency`; of a diagnosis also `order`, a line over the joint angle.
    pub place: String,
    /// Share of the channel's mean square residual explained by the place, beyond chance and beyond the preceding
    /// findings.
    pub share: f64,
    /// One sentence.
    pub sentence: String,
}

impl Comparison {
    /// RMS residual and noise floor on the held-out data, or on the fitted ones without any.
    pub fn judged(&self) -> (&[f64], &[f64]) {
        self.held_out.as_ref().map_or((&self.rms, &self.noise_floor), |h| (&h.rms, &h.noise_floor))
    }

    /// Largest ratio of RMS residual to noise, over fitted and held-out data, with its channel; `None` without noise.
    pub fn worst(&self) -> Option<(Channel, f64)> {
        let held = self.held_out.iter().map(|h| (&h.rms, &h.noise_floor));
        let sets = std::iter::once((&self.rms, &self.noise_floor)).chain(held);
        let ratios = sets.flat_map(|(rms, floor)| self.channels.iter().zip(rms.iter().zip(floor).map(|(r, n)| r / n)));
        let all = ratios.map(|(c, ratio)| (*c, ratio)).filter(|(_, ratio)| ratio.is_finite());
        all.max_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// Ratio of RMS to noise from which a channel is examined: pure noise has no pattern.
const MORE_THAN_NOISE: f64 = 1.02;

/// Comparison of a model with recordings.
///
/// # Errors
/// If recordings differ in configuration or channels, or the model's geometry cannot reach a pose.
///
/// # Panics
/// If `datasets` is empty.
pub fn compare(model: &Model, datasets: &[Dataset], held_out: &[Dataset]) -> Result<Comparison, FitError> {
    check_together(datasets.iter().chain(held_out))?;
    compare_with(model, datasets, held_out, &Residuals::new(model, datasets)?)
}

/// As [`compare`], with the `residuals` of the model on `datasets`, as a fit returns them.
///
/// # Errors
/// As [`compare`].
///
/// # Panics
/// If `datasets` is empty or the residuals are of other recordings.
pub fn compare_with(
    model: &Model,
    datasets: &[Dataset],
    held_out: &[Dataset],
    residuals: &Residuals,
) -> Result<Comparison, FitError> {
    check_together(datasets.iter().chain(held_out))?;
    let rms = residuals.rms.clone();
    let (noise, repeats) = NoiseLevel::of(model, datasets).with_repeats(datasets, residuals);
    let noise_floor = noise.pooled;
    let held_out = HeldOut::new(model, held_out)?;
    let channels = datasets[0].channels.clone();
    let loud = |c: &usize| rms[*c] > MORE_THAN_NOISE * noise_floor[*c];
    let platform = if (0..channels.len()).any(|c| loud(&c)) { platform(model, datasets)? } else { Vec::new() };
    let mut found: Vec<Finding> = Vec::new();
    for c in (0..channels.len()).filter(loud) {
        found.extend(findings::of_channel(channels[c], datasets, &platform, residuals.channel(c), noise_floor[c]));
    }
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    Ok(Comparison { mechanism: model.mechanism, channels, rms, noise_floor, repeats, held_out, findings: found })
}

/// Patterns of the residual of channel `c` of a model on recordings, largest share first.
///
/// # Errors
/// If the model's geometry cannot reach a pose.
///
/// # Panics
/// If there are no datasets or no channel `c`.
pub fn patterns(
    model: &Model,
    datasets: &[Dataset],
    residuals: &Residuals,
    c: usize,
) -> Result<Vec<Finding>, FitError> {
    let (channel, noise) = (datasets[0].channels[c], NoiseLevel::of(model, datasets).pooled[c]);
    let mut found = findings::of_channel(channel, datasets, &platform(model, datasets)?, residuals.channel(c), noise);
    found.sort_by(|a, b| b.share.total_cmp(&a.share));
    Ok(found)
}

/// Centre of the platform at every sample of all datasets, m; empty without a platform.
fn platform(model: &Model, datasets: &[Dataset]) -> Result<Vec<[f64; 3]>, FitError> {
    let mut points = Vec::new();
    for dataset in datasets {
        let plant = dataset.plant(model);
        if !plant.assembled {
            return Ok(Vec::new());
        }
        for j in &dataset.joints {
            points.push(plant.geometry.forward(&j.q).map_err(kinematics(dataset))?.into());
        }
    }
    Ok(points)
}

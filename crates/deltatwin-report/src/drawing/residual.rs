//! Figures of what models leave of a recording: over time, over the motion, and as spectra.

use deltatwin::identification::{Dataset, FitError, Residuals, predict};
use deltatwin::model::Model;
use deltatwin::numerics::fourier;
use deltatwin::recording::Channel;

use crate::{Color, Curve, Figure, Panel, Role, Style, panels, scatter_binned, spectrum};

/// A model under a name; several of them are stages of the same machine's model.
pub struct Stage<'a> {
    /// Which stage it is, and with that its colour.
    pub role: Role,
    /// Name in the legends.
    pub name: &'a str,
    /// The model.
    pub model: &'a Model,
}

/// Number of bins of a residual over an angle or a speed.
const BINS: usize = 60;

/// Ratio of RMS to noise from which the residual of a channel is drawn over the motion and as a spectrum.
const ABOVE: f64 = 1.15;

/// Figures with the stems of their files: measured and predicted channels, residuals on their own scale with the band of
/// the `noise` (one standard deviation per channel), and of every drive whose first residual exceeds the noise the residual
/// over its angle, over its speed, and its spectrum.
///
/// # Errors
/// [`FitError`] if a model cannot follow the recording.
pub fn figures(stages: &[Stage], dataset: &Dataset, noise: &[f64]) -> Result<Vec<(String, Figure)>, FitError> {
    let Some(last) = stages.last() else { return Ok(Vec::new()) };
    let mut left = Vec::new();
    for stage in stages {
        left.push(Residuals::new(stage.model, std::slice::from_ref(dataset))?);
    }
    let predicted =
        predict(&dataset.plant(last.model), dataset).map_err(deltatwin::identification::fit::kinematics(dataset))?;
    let series = |stage: usize, channel: usize| left[stage].series[0][channel].clone();
    let drawn = Drawn { stages, dataset, noise };
    let mut figures =
        vec![("measured".to_string(), drawn.torques(last, &predicted)), ("left".into(), drawn.over_time(&series))];
    for (c, &channel) in dataset.channels.iter().enumerate() {
        let Some(axis) = channel.drive().filter(|_| left[0].rms[c] > ABOVE * noise[c]) else { continue };
        let of = |f: &dyn Fn(usize) -> f64| (0..dataset.len()).map(f).collect::<Vec<f64>>();
        let unit = Channel::Angle(axis).unit(dataset.mechanism);
        let angle = of(&|k| dataset.joints[k].q[axis]);
        let speed = of(&|k| dataset.joints[k].qd[axis]);
        let places = [("angle", unit.to_string(), angle), ("speed", format!("{unit}/s"), speed)];
        for (what, unit, x) in places {
            let figure = drawn.over(c, channel, (&format!("axis {} {what} / {unit}", axis + 1), x), &series);
            figures.push((format!("{channel}-{what}"), figure));
        }
        figures.push((format!("{channel}-spectrum"), drawn.spectrum(c, channel, &series)));
    }
    Ok(figures)
}

struct Drawn<'a> {
    stages: &'a [Stage<'a>],
    dataset: &'a Dataset,
    noise: &'a [f64],
}

type Series<'a> = &'a dyn Fn(usize, usize) -> Vec<f64>;

impl Drawn<'_> {
    fn panels(&self, title: &str, curves: impl Fn(usize) -> Vec<Curve>) -> Figure {
        let panel = |(c, channel): (usize, &Channel)| Panel {
            title: channel.title(self.dataset.mechanism),
            y_label: channel.unit(self.dataset.mechanism).to_string(),
            curves: curves(c),
        };
        let all: Vec<Panel> = self.dataset.channels.iter().enumerate().map(panel).collect();
        panels(title, "time / s", &all)
    }

    fn torques(&self, last: &Stage, predicted: &[Vec<f64>]) -> Figure {
        let t = &self.dataset.t;
        self.panels("Measured and predicted", |c| {
            vec![
                Curve::new("measured", t.clone(), self.dataset.measured[c].to_vec()).color(Color::MEASURED),
                Curve::new(last.name, t.clone(), predicted[c].clone()).color(last.role.color()).style(Style::Thin),
            ]
        })
    }

    fn over_time(&self, left: Series) -> Figure {
        let t = &self.dataset.t;
        let ends: Vec<f64> = t.first().into_iter().chain(t.last()).copied().collect();
        self.panels("What is left", |c| {
            let one = |(s, stage): (usize, &Stage)| {
                Curve::new(stage.name, t.clone(), left(s, c)).color(stage.role.color()).style(Style::Thin)
            };
            let mut curves: Vec<Curve> = self.stages.iter().enumerate().map(one).collect();
            for side in [-1.0, 1.0] {
                let band = vec![side * self.noise[c]; ends.len()];
                curves.push(Curve::new("noise", ends.clone(), band).color(Color::NOISE).style(Style::Dashed));
            }
            curves
        })
    }

    fn over(&self, c: usize, channel: Channel, (label, x): (&str, Vec<f64>), left: Series) -> Figure {
        let one = |(s, stage): (usize, &Stage)| Curve::new(stage.name, x.clone(), left(s, c)).color(stage.role.color());
        let curves: Vec<Curve> = self.stages.iter().enumerate().map(one).collect();
        let title = format!("Residual of {}", channel.title(self.dataset.mechanism));
        scatter_binned(&title, label, &format!("residual / {}", channel.unit(self.dataset.mechanism)), &curves, BINS)
    }

    fn spectrum(&self, c: usize, channel: Channel, left: Series) -> Figure {
        let longest = self.dataset.segments.iter().max_by_key(|s| s.len()).cloned().unwrap_or(0..0);
        let one = |(s, stage): (usize, &Stage)| {
            let (frequency, amplitude) =
                amplitude_spectrum(&left(s, c)[longest.clone()], self.dataset.period(&longest));
            Curve::new(stage.name, frequency, amplitude).color(stage.role.color())
        };
        let curves: Vec<Curve> = self.stages.iter().enumerate().map(one).collect();
        let title = format!("Residual of {}", channel.title(self.dataset.mechanism));
        spectrum(
            &title,
            "frequency / Hz",
            &format!("amplitude / {}", channel.unit(self.dataset.mechanism)),
            &curves,
            &[],
        )
    }
}

/// Single-sided amplitude spectrum of a series without its mean, and its frequencies in Hz; `dt` is the sampling period in
/// s.
pub fn amplitude_spectrum(x: &[f64], dt: f64) -> (Vec<f64>, Vec<f64>) {
    let n = x.len();
    let frequency = |k: usize| k as f64 / (n as f64 * dt);
    let power = fourier::power(x.to_vec());
    power.iter().enumerate().skip(1).map(|(k, p)| (frequency(k), 2.0 * p.sqrt() / n as f64)).unzip()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_amplitude_of_a_wave_is_at_its_frequency() {
        // 3·sin(2π·5 Hz·t) + 7 over 2 s at 100 Hz: line 10.
        let x: Vec<f64> =
            (0..200).map(|k| 3.0 * (std::f64::consts::TAU * 5.0 * f64::from(k) / 100.0).sin() + 7.0).collect();
        let (frequency, amplitude) = amplitude_spectrum(&x, 0.01);
        assert_eq!(frequency[9], 5.0);
        assert!((amplitude[9] - 3.0).abs() < 1e-12 && amplitude.iter().filter(|a| **a > 1e-9).count() == 1);
        assert!(amplitude_spectrum(&[], 0.01).0.is_empty());
    }
}

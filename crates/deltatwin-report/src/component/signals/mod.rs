//! Measured channels and residuals of a recording as data of the page, and the panels that show them: over time, over the
//! motion, over frequency and over the workspace, and the robot. `assets/page.js` reads what is written here.

mod explained;
mod map;
mod pack;
mod places;
mod robot;

use std::fmt::Write as _;

use deltatwin::identification::fit::kinematics;
use deltatwin::identification::{Dataset, FitError, Residuals, predict, residuals::rms};
use deltatwin::kinematics::JointState;
use deltatwin::machine::Unit;
use deltatwin::recording::Channel;
use serde_json::{Value, json};

use crate::Report;
use crate::drawing::residual::Stage;
use crate::html::escape;
pub use explained::{Addition, Alternatives};
use pack::Packed;

/// Largest number of samples of a page's recording; a longer one is thinned to its extremes, and the page says so.
const MOST_SAMPLES: usize = 60_000;

/// Steps of the stored numbers per standard deviation of the noise.
const STEPS: f64 = 24.0;

/// Signals of a recording with what several models leave of it.
pub struct Signals {
    header: Value,
    data: String,
    note: String,
}

impl Signals {
    /// The recording `dataset` and its residuals to the models of `stages`, with the `noise` of every channel (standard
    /// deviation, N·m or N).
    ///
    /// # Errors
    /// If a model cannot follow the recording.
    pub fn of(stages: &[Stage], dataset: &Dataset, noise: &[f64]) -> Result<Self, FitError> {
        let mut predicted = Vec::new();
        for stage in stages {
            predicted.push(predict(&dataset.plant(stage.model), dataset).map_err(kinematics(dataset))?);
        }
        let left: Vec<Vec<Vec<f64>>> = predicted.iter().map(|p| Residuals::of(dataset, p).series.remove(0)).collect();
        let stride = dataset.len().div_ceil(MOST_SAMPLES).max(1);
        let mut packed = Packed::new(kept(dataset, &left, stride));
        let time = packed.time(&dataset.t, dataset.dt);
        let channel = |(c, channel): (usize, &Channel)| {
            let floor = noise.get(c).copied().unwrap_or(0.0);
            let step = |series: &[f64]| step(series, floor);
            let measured = packed.add(&dataset.measured[c], step(&dataset.measured[c]), 1);
            let models: Vec<Value> = predicted.iter().map(|p| packed.add(&p[c], step(&p[c]), 2)).collect();
            json!({
                "name": channel.title(dataset.mechanism),
                "key": channel.to_string(),
                "drive": channel.drive(),
                "unit": channel.unit(dataset.mechanism).to_string(),
                "noise": floor,
                "measured": measured,
                "models": models,
                "rms": left.iter().map(|l| rms(&l[c])).collect::<Vec<_>>(),
            })
        };
        let channels: Vec<Value> = dataset.channels.iter().enumerate().map(channel).collect();
        let mut joints = |per: &str, of: &dyn Fn(&JointState, usize) -> f64| -> Vec<Value> {
            let one = |(axis, unit): (usize, Unit)| {
                let series: Vec<f64> = dataset.joints.iter().map(|j| of(j, axis)).collect();
                let packed = packed.add(&series, step(&series, 0.0), 2);
                json!({"name": format!("axis {}", axis + 1), "unit": format!("{unit}{per}"), "series": packed})
            };
            drives(dataset).map(one).collect()
        };
        let angles = joints("", &|j, axis| j.q[axis]);
        let rates = joints("/s", &|j, axis| j.qd[axis]);
        let robot = stages.last().map_or(Value::Null, |s| robot::of(s.model, dataset, &mut packed));
        let header = json!({
            "recording": dataset.name,
            "samples": packed.len(),
            "time": time,
            "breaks": packed.breaks(dataset),
            "stages": stages.iter().map(|s| s.name).collect::<Vec<_>>(),
            "roles": stages.iter().map(|s| s.role.class()).collect::<Vec<_>>(),
            "channels": channels,
            "angles": angles,
            "rates": rates,
            "robot": robot,
            "places": places::of(dataset, &left),
            "maps": stages.last().map_or(Value::Null, |s| map::of(s.model, dataset, &left, noise)),
        });
        let note = match stride {
            1 => format!("All {} samples of {} are in this page", dataset.len(), dataset.name),
            _ => format!(
                "{} has {} samples; of every {stride} the page has those with the largest and the smallest residual",
                dataset.name,
                dataset.len()
            ),
        };
        Ok(Self { header, data: packed.text(), note: format!("{note}, to 1/{STEPS} of the noise.") })
    }

    /// With what additions to a model explain in any range of time of `dataset`.
    pub fn explained(mut self, by: &Alternatives, dataset: &Dataset, noise: &[f64]) -> Self {
        self.header["explained"] = explained::of(by, &dataset.t, noise);
        self
    }
}

/// Adds the panels of `signals` to a page, which becomes interactive.
pub fn add(report: &mut Report, signals: &Signals) {
    report.interactive();
    // In a script element only `<` could end the text.
    let header = signals.header.to_string().replace('<', "\\u003c");
    let mut html = String::from("<section class=\"signals\" data-signals>\n");
    let _ = write!(
        html,
        "<script type=\"application/json\" class=\"signals-header\">{header}</script>\n\
         <script type=\"application/octet-stream\" class=\"signals-data\">{}</script>\n\
         <noscript><p class=\"callout warning\">The curves need JavaScript; the numbers above do not.</p></noscript>\n\
         <div class=\"signals-panels\"></div>\n<p class=\"small\">{}</p>\n</section>",
        signals.data,
        escape(&signals.note)
    );
    report.push(html);
}

/// Drives of the recording: index and unit of the joint.
fn drives(dataset: &Dataset) -> impl Iterator<Item = (usize, Unit)> + '_ {
    let unit = Channel::Angle(0).unit(dataset.mechanism);
    dataset.channels.iter().filter_map(move |c| Some((c.drive()?, unit)))
}

/// Step with which a series is stored: a fraction of the noise, or of its range without noise; sixteen bits reach its
/// ends.
fn step(series: &[f64], noise: f64) -> f64 {
    let largest = series.iter().filter(|x| x.is_finite()).fold(0.0, |m: f64, x| m.max(x.abs()));
    let fine = if noise > 0.0 && noise.is_finite() { noise / STEPS } else { largest / 30_000.0 };
    fine.max(largest / 32_000.0).max(f64::MIN_POSITIVE)
}

/// Indices of the samples in the page: all, or of every `stride` those where the residuals' sum over the channels, in
/// units of their RMS, is largest and smallest.
fn kept(dataset: &Dataset, left: &[Vec<Vec<f64>>], stride: usize) -> Vec<usize> {
    let Some(first) = left.first().filter(|_| stride > 1) else { return (0..dataset.len()).collect() };
    let scales: Vec<f64> = first.iter().map(|series| rms(series).max(f64::MIN_POSITIVE)).collect();
    let sum = |k: usize| first.iter().zip(&scales).map(|(series, scale)| series[k] / scale).sum::<f64>();
    let mut kept = Vec::new();
    for start in (0..dataset.len()).step_by(2 * stride) {
        let range = start..(start + 2 * stride).min(dataset.len());
        let smallest = range.clone().min_by(|a, b| sum(*a).total_cmp(&sum(*b)));
        let largest = range.max_by(|a, b| sum(*a).total_cmp(&sum(*b)));
        let mut pair: Vec<usize> = smallest.into_iter().chain(largest).collect();
        pair.sort_unstable();
        pair.dedup();
        kept.extend(pair);
    }
    kept
}

//! Residual of a model along a stream of samples, window by window.

use crate::dynamics::Plant;
use crate::identification::fit::{FitError, kinematics};
use crate::identification::prediction::Channels;
use crate::identification::{Dataset, Residuals, predict};
use crate::machine::{Mechanism, PerAxis, Setup};
use crate::model::Model;
use crate::recording::{Recording, Signals, sample_time};
use crate::twin::Clamps;

/// Duration of a window, s, and its least number of samples.
const WINDOW: (f64, usize) = (1.0, 50);
/// Samples on either side that differentiation needs: at least this time, s, and this number.
const MARGIN: (f64, usize) = (0.1, 40);
/// Duration of a block over which the residual is averaged, s.
const BLOCK: f64 = 20e-3;
/// Number of samples from which the sampling period is found.
const FIRST: usize = 64;
/// Step in time, in sampling periods, above which there is a gap.
const GAP: f64 = 1.5;
/// Number of instants of a window at which the loads are computed.
const INSTANTS: usize = 50;

/// One sample of a machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time, s.
    pub t: f64,
    /// Joint angles, rad (m for a sliding axis).
    pub q: PerAxis<f64>,
    /// Drive torques at the gear output, N·m (N for a sliding axis).
    pub tau: PerAxis<f64>,
}

/// Loads that no sensor sees, from the model along the measured motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Loads {
    /// Axial force of largest magnitude at the elbow end of each strut, tension positive, N.
    pub strut_upper: Vec<f64>,
    /// The same at the platform end.
    pub strut_lower: Vec<f64>,
    /// Least margin of each ball socket against dislocation, see [`Clamps::margins`], N: six at the elbows, six at the
    /// platform.
    pub margin: Vec<f64>,
}

/// One window of the residual.
#[derive(Clone, Debug)]
pub struct Window {
    /// Start and end, s.
    pub t: [f64; 2],
    /// Whether it follows the previous window without a gap.
    pub follows: bool,
    /// Motion and measured channels.
    pub dataset: Dataset,
    /// Measured − predicted, N·m or N, per channel and sample.
    pub residual: Channels,
    /// Means of the residual over blocks of 20 ms, per channel.
    pub means: Channels,
    /// Loads on struts and sockets, for a robot with struts.
    pub loads: Option<Loads>,
}

/// Residual of a model along a stream.
#[derive(Clone)]
pub struct Sliding {
    model: Model,
    plant: Plant,
    setup: Setup,
    pending: Vec<Sample>,
    /// Sampling period, s, once it is known.
    dt: Option<f64>,
    follows: bool,
}

impl Sliding {
    /// Residual of `model` under the given setup.
    pub fn new(model: &Model, setup: &Setup) -> Self {
        let plant = Plant::new(model, setup);
        Self { model: model.clone(), plant, setup: *setup, pending: Vec::new(), dt: None, follows: false }
    }

    /// Sampling period, s; `None` before the first 64 samples.
    pub fn sample_time(&self) -> Option<f64> {
        self.dt
    }

    /// Adds a sample that is later than all previous ones; returns the window that it completes.
    ///
    /// After a gap a new window begins, and the incomplete one before it is dropped.
    ///
    /// # Errors
    /// If the machine cannot be at a measured pose; the window is dropped.
    pub fn push(&mut self, sample: Sample) -> Result<Option<Window>, FitError> {
        let dt = *self.dt.get_or_insert(f64::INFINITY);
        if self.pending.last().is_some_and(|last| sample.t - last.t > GAP * dt) {
            self.pending.clear();
            self.follows = false;
        }
        self.pending.push(sample);
        if !dt.is_finite() {
            let known = self.pending.len() >= FIRST;
            self.dt = known.then(|| sample_time(&self.pending.iter().map(|s| s.t).collect::<Vec<_>>()));
            return Ok(None);
        }
        let samples = |(time, least): (f64, usize)| ((time / dt).round() as usize).max(least);
        let (window, margin) = (samples(WINDOW), samples(MARGIN));
        if self.pending.len() < window + 2 * margin {
            return Ok(None);
        }
        let made = self.window(window, margin, dt);
        self.follows = made.as_ref().is_ok_and(Option::is_some);
        self.pending.drain(..window);
        made
    }

    /// The window of `count` samples after the first `margin` pending ones; `None` if differentiation leaves too little.
    fn window(&self, count: usize, margin: usize, dt: f64) -> Result<Option<Window>, FitError> {
        let recording = recording_of(&self.pending, self.plant.mechanism, &self.setup);
        let all = Dataset::new(&recording);
        let core = [self.pending[margin].t, self.pending[margin + count].t];
        let inside = |t: &f64| *t >= core[0] && *t < core[1];
        let (Some(first), Some(last)) = (all.t.iter().position(inside), all.t.iter().rposition(inside)) else {
            return Ok(None);
        };
        let predicted = predict(&self.plant, &all).map_err(kinematics(&all))?;
        let range = first..last + 1;
        let whole = Residuals::of(&all, &predicted).series.remove(0);
        let dataset = all.window(range.clone());
        let residual: Channels = whole.iter().map(|series| series[range.clone()].to_vec()).collect();
        let block = ((BLOCK / dt).round() as usize).max(1);
        let means: Channels = residual.iter().map(|series| dataset.means(series, block)).collect();
        if means.iter().any(Vec::is_empty) {
            return Ok(None);
        }
        let loads = self.loads(&dataset)?;
        Ok(Some(Window { t: core, follows: self.follows, dataset, residual, means, loads }))
    }

    /// Loads on struts and sockets over the window.
    fn loads(&self, dataset: &Dataset) -> Result<Option<Loads>, FitError> {
        if !self.plant.assembled {
            return Ok(None);
        }
        let clamps = Clamps::watched(&self.model.sockets);
        let struts = self.plant.mechanism.struts();
        let mut loads = Loads {
            strut_upper: vec![0.0; struts],
            strut_lower: vec![0.0; struts],
            margin: vec![f64::INFINITY; 2 * struts],
        };
        for k in (0..dataset.len()).step_by((dataset.len() / INSTANTS).max(1)) {
            let motion = self.plant.motion(&dataset.joints[k]);
            let found = motion.and_then(|motion| clamps.along(&self.plant, dataset.t[k], &motion));
            let (output, margins) = found.map_err(kinematics(dataset))?;
            for (largest, forces) in
                [(&mut loads.strut_upper, output.reactions.upper), (&mut loads.strut_lower, output.reactions.lower)]
            {
                largest.iter_mut().zip(forces).filter(|(l, f)| f.abs() > l.abs()).for_each(|(l, f)| *l = f);
            }
            for s in self.plant.sockets().iter() {
                loads.margin[s] = loads.margin[s].min(margins[s]);
            }
        }
        Ok(Some(loads))
    }
}

/// A recording of `samples`, with a segment for every stretch without a gap.
pub fn recording_of(samples: &[Sample], mechanism: Mechanism, setup: &Setup) -> Recording {
    let t: Vec<f64> = samples.iter().map(|s| s.t).collect();
    let dt = sample_time(&t);
    let starts = (1..t.len()).filter(|&k| t[k] - t[k - 1] > GAP * dt);
    let bounds: Vec<usize> = std::iter::once(0).chain(starts).chain([t.len()]).collect();
    let segments = bounds.windows(2).map(|b| b[0]..b[1]).filter(|s| !s.is_empty()).collect();
    let (q, tau): (Vec<_>, Vec<_>) = samples.iter().map(|s| (s.q, s.tau)).unzip();
    let mut signals = Signals::of_drives(mechanism, t, &q, &tau);
    signals.segments = segments;
    Recording { name: "stream".into(), signals, setup: *setup }
}

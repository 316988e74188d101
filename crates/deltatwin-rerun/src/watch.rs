//! Display of a running machine: its motion, residual against the healthy one, level of the alarm, and loads.
//!
//! Windows pass through a queue of bounded length to a thread of their own. With a slow viewer windows are dropped, and the
//! rest once it is gone; the watch is not affected.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use crate::scene::{Assets, Level, Live, Note, Scene, Series, Viewer, drives, socket_margins};
use crate::sigma::{BLOCK, LEGEND, in_sigma, means};
use deltatwin::dynamics::Plant;
use deltatwin::machine::{PerAxis, Setup, Unit};
use deltatwin::model::Model;
use deltatwin::monitoring::Observation;
use deltatwin::twin::Clamps;
use deltatwin_io::outside::Access;

/// Number of windows that wait.
const QUEUE: usize = 10;
/// Frame rate, Hz.
const FRAMES: f64 = 25.0;
const MEAN: [u8; 3] = [230, 70, 60];
const USUAL: [u8; 3] = [130, 135, 140];
const ALARM: [u8; 3] = [240, 200, 60];

/// What the thread gets: a window, or words.
enum Update {
    Window(Box<(Observation, Vec<f64>)>),
    Note(Note),
}

/// A stream of a watch to a viewer.
pub struct Broadcast {
    queue: SyncSender<Update>,
}

impl Broadcast {
    /// Opens the stream of the machine of `model`.
    ///
    /// # Errors
    /// If no viewer answers or none can be started.
    pub fn open(viewer: &Viewer, model: &Model, setup: &Setup) -> Result<Self, String> {
        let assets = Assets::of(model, Access::PROJECT).map_err(|e| format!("{e:#}"))?;
        let shown = Shown { plant: Plant::new(model, setup), clamps: Clamps::watched(&model.sockets), assets };
        let live = Live::open(viewer, "watch", &shown.layout(&model.name)).map_err(|e| e.to_string())?;
        let (queue, waiting) = sync_channel(QUEUE);
        let name = model.name.clone();
        let work = move || shown.forward(live, &name, &waiting);
        std::thread::Builder::new().name("viewer".into()).spawn(work).map_err(|e| e.to_string())?;
        Ok(Self { queue })
    }

    /// Shows a window, with the healthy RMS of each channel's means over 20 ms, if it is known.
    pub fn observed(&self, observation: &Observation, healthy: &[f64]) {
        // Dropped while the viewer is slow, and for good once it is gone.
        self.queue.try_send(Update::Window(Box::new((observation.clone(), healthy.to_vec())))).ok();
    }

    /// Shows a line at time `t`, s.
    pub fn say(&self, t: f64, text: &str, is_alarm: bool) {
        let level = if is_alarm { Level::Error } else { Level::Info };
        self.queue.try_send(Update::Note(Note { t, level, text: text.into() })).ok();
    }
}

/// The machine that is shown.
struct Shown {
    plant: Plant,
    clamps: Clamps,
    assets: Assets,
}

impl Shown {
    fn forward(&self, mut live: Live, name: &str, waiting: &Receiver<Update>) {
        for update in waiting {
            let piece = match update {
                Update::Window(window) => self.piece(&window.0, &window.1, name),
                Update::Note(note) => {
                    let mut scene = self.layout(name);
                    scene.notes.push(note);
                    scene
                }
            };
            if live.send(&piece).is_err() {
                return;
            }
        }
        live.finish().ok();
    }

    /// A piece without content that has all parts.
    fn layout(&self, name: &str) -> Scene<'_> {
        let mut scene = Scene::new(self.plant.mechanism, &self.plant.geometry, Vec::new(), Vec::new());
        scene.series = self.curves(&[], &PerAxis::<Vec<_>>::default(), &[]);
        scene.series.push(level(Vec::new(), Vec::new()));
        scene.series.extend(drives(self.plant.mechanism, &[], |_| (Vec::new(), Vec::new())));
        scene.eventful = true;
        scene.assets = Some(&self.assets);
        scene.text = Some(format!("### {name}, live\n{LEGEND}"));
        scene
    }

    /// Curves of the residual and of the healthy band, two standard deviations wide.
    fn curves(&self, times: &[f64], means: &[Vec<f64>], healthy: &[f64]) -> Vec<Series> {
        let unit = self.plant.mechanism.unit(Unit::NM);
        let mut series = Vec::new();
        for i in 0..self.plant.mechanism.axes() {
            let mut add = |name: &str, values: Vec<f64>, color, label: &str| {
                let path = format!("residual/axis{}/{name}", i + 1);
                series.push(Series::new(path, times.to_vec(), values, color, format!("{label} [{unit}]")));
            };
            add("mean", means[i].clone(), MEAN, "mean over 20 ms");
            let band = healthy.get(i).copied().unwrap_or(0.0);
            for (name, sign) in [("usual_above", 2.0), ("usual_below", -2.0)] {
                add(name, vec![sign * band; times.len()], USUAL, "twice the healthy RMS of it");
            }
        }
        series
    }

    fn piece(&self, observation: &Observation, healthy: &[f64], name: &str) -> Scene<'_> {
        let window = &observation.window;
        let dataset = &window.dataset;
        let stride = dataset.stride(1.0 / FRAMES);
        let frames: Vec<usize> = (0..dataset.len()).step_by(stride).collect();
        let poses: Option<Vec<_>> = frames
            .iter()
            .map(|&k| self.plant.motion(&dataset.joints[k]).ok().map(|m| m.shown(self.plant.mechanism)))
            .collect();
        let Some(poses) = poses else { return self.layout(name) };
        let times: Vec<f64> = frames.iter().map(|&k| dataset.t[k]).collect();
        let (axes, block) = (self.plant.mechanism.axes(), dataset.stride(BLOCK));
        let means: Vec<Vec<f64>> = window.residual[..axes].iter().map(|series| means(series, &frames, block)).collect();
        let mut scene = Scene::new(self.plant.mechanism, &self.plant.geometry, times.clone(), poses);
        scene.eventful = true;
        scene.assets = Some(&self.assets);
        scene.text = Some(format!("### {name}, live\n{LEGEND}"));
        scene.series = self.curves(&times, &means, healthy);
        if let Some((_, value)) = observation.level {
            scene.series.push(level(vec![window.t[1]], vec![value]));
        }
        scene.series.extend(drives(self.plant.mechanism, &times, |i| {
            let of = |k: &usize| dataset.joints[*k].q[i];
            (frames.iter().map(|&k| dataset.measured[i][k]).collect(), frames.iter().map(of).collect())
        }));
        scene.residual = Some(in_sigma(&means, healthy));
        if let Some(loads) = &window.loads {
            scene.series.push(socket_margins(&[window.t[1]], self.plant.mechanism.struts(), &[&loads.margin]));
            scene.used = Some(vec![self.clamps.used(&loads.margin); frames.len()]);
        }
        scene
    }
}

/// Curve of the level of the alarm.
fn level(times: Vec<f64>, values: Vec<f64>) -> Series {
    Series::new("level/alarm/level".into(), times, values, ALARM, "level, alarm above 1".into())
}

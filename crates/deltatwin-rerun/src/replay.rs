//! Display of a recording in Rerun: moving robot with measured and predicted torques, its residual and its loads.

use std::borrow::Cow;
use std::path::Path;
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic, miette};
use nalgebra::Isometry3;

use crate::ghost;
use crate::scene::{self, After, Assets, Live, Scene, Series, Viewer, measured, write_rrd};
use crate::sigma::{BLOCK, LEGEND, in_sigma, means};
use deltatwin::dynamics::Plant;
use deltatwin::identification::{Dataset, Residuals, predict};
use deltatwin::kinematics::{JointState, KinematicsError};
use deltatwin::machine::bodies::SLOTS;
use deltatwin::machine::{PerAxis, PerSocket, Unit};
use deltatwin::model::Model;
use deltatwin::recording::{Contact, Contacts, Recording};
use deltatwin::twin::Clamps;
use deltatwin_io::outside::Access;

/// Duration of a piece of a stream, s: what it adds to the latency.
const PIECE: f64 = 0.05;
/// Duration of a piece that is streamed as fast as it goes, s.
const WHOLE: f64 = 1.0;
/// Half width of the band of the noise, standard deviations.
const BAND: f64 = 2.0;
const PREDICTED: [u8; 3] = [225, 225, 225];
const RESIDUAL: [u8; 3] = [120, 75, 75];
const MEAN: [u8; 3] = [230, 70, 60];
const AFTER: [u8; 3] = [80, 190, 110];
const NOISE: [u8; 3] = [130, 135, 140];

/// A recording with the models that it is compared with.
pub struct Replay<'a> {
    /// The recording.
    pub recording: &'a Recording,
    /// Its smoothed motion, if it is known already.
    pub dataset: Option<&'a Dataset>,
    /// Contacts during the recording, in order of time.
    pub contacts: &'a [Contacts],
    /// The model.
    pub model: &'a Model,
    /// A later model, whose residual is shown beside.
    pub beside: Option<&'a Model>,
    /// Where the meshes that the model names may be.
    pub access: Access,
}

impl Replay<'_> {
    /// Writes an `.rrd` file.
    ///
    /// # Errors
    /// If the prediction or the kinematics fail, or the file cannot be written.
    pub fn write(&self, path: &Path) -> miette::Result<()> {
        let (plant, assets) = (Plant::along(self.model, self.recording), Assets::of(self.model, self.access)?);
        write_rrd(path, &self.recording.name, &self.scene(&plant, &assets)?).into_diagnostic()
    }

    /// Streams to a viewer, `pace` seconds of the recording per second or as fast as it goes, until it ends or `goes_on`
    /// is false.
    ///
    /// # Errors
    /// If the prediction or the kinematics fail, or the viewer does not answer.
    pub fn stream(&self, viewer: &Viewer, pace: Option<f64>, goes_on: &dyn Fn() -> bool) -> miette::Result<()> {
        let (plant, assets) = (Plant::along(self.model, self.recording), Assets::of(self.model, self.access)?);
        let scene = self.scene(&plant, &assets)?;
        let (Some(&first), Some(&last)) = (scene.times.first(), scene.times.last()) else {
            return Err(miette!("{}: has no frames", self.recording.name));
        };
        let problem = |e: Box<dyn std::error::Error + Send + Sync>| miette!("{e}");
        let mut live = Live::open(viewer, &self.recording.name, &scene).map_err(problem)?;
        let start = Instant::now();
        let mut from = first;
        while from <= last && goes_on() {
            let to = from + pace.map_or(WHOLE, |pace| PIECE * pace.max(1.0));
            if let Some(pace) = pace {
                let due = Duration::try_from_secs_f64((to - first) / pace).unwrap_or(Duration::MAX);
                std::thread::sleep(due.saturating_sub(start.elapsed()));
            }
            live.send(&scene.between(from, to)).map_err(problem)?;
            from = to;
        }
        live.finish().map_err(problem)
    }

    fn scene<'p>(&self, plant: &'p Plant, assets: &'p Assets) -> miette::Result<Scene<'p>> {
        let dataset = self.dataset.map_or_else(|| Cow::Owned(Dataset::new(self.recording)), Cow::Borrowed);
        let dataset = &*dataset;
        let predicted = predict(plant, dataset).into_diagnostic()?;
        let noise = dataset.noise(self.model);
        let left = Residuals::of(dataset, &predicted);
        let later = self.beside.map(|model| Residuals::new(model, std::slice::from_ref(dataset))).transpose();
        let later = later.into_diagnostic()?;
        // One frame per mean of the residual.
        let block = dataset.stride(BLOCK);
        let sigma = dataset.noise_of_means(self.model, block);
        let frames: Vec<usize> = (0..dataset.len()).step_by(block).collect();
        let times: Vec<f64> = frames.iter().map(|&k| dataset.t[k]).collect();
        let poses = frames.iter().map(|&k| plant.motion(&dataset.joints[k]).map(|m| m.shown(plant.mechanism)));
        let poses = poses.collect::<Result<Vec<_>, _>>().into_diagnostic()?;
        let axes = plant.mechanism.axes();
        let averaged = |residuals: &Residuals| -> Vec<Vec<f64>> {
            residuals.series[0][..axes].iter().map(|series| means(series, &frames, block)).collect()
        };
        let (before, after) = (averaged(&left), later.as_ref().map(averaged));
        let mut series = Vec::new();
        let unit = plant.mechanism.unit(Unit::NM);
        for i in 0..axes {
            let mut add = |name: &str, times: &[f64], values: Vec<f64>, color, label: &str| {
                let path = format!("residual/axis{}/{name}", i + 1);
                series.push(Series::new(path, times.to_vec(), values, color, format!("{label} [{unit}]")));
            };
            let band = BAND * sigma[i];
            for (name, sign) in [("noise_above", 1.0), ("noise_below", -1.0)] {
                add(name, &times, vec![sign * band; times.len()], NOISE, "2 σ of the noise in it");
            }
            add("mean", &times, before[i].clone(), MEAN, "mean over 20 ms");
            if let Some(after) = &after {
                add("after", &times, after[i].clone(), AFTER, "mean, later model");
            }
        }
        series.extend(measured(self.recording));
        for i in 0..axes {
            let (path, label) = (format!("torque/axis{}/model", i + 1), format!("model [{unit}]"));
            let (times, values) = (dataset.t.clone(), predicted[i].clone());
            series.push(Series::new(path, times, values, PREDICTED, label));
        }
        for i in 0..axes {
            let (path, label) = (format!("samples/axis{}/residual", i + 1), format!("residual [{unit}]"));
            let (times, values) = (dataset.t.clone(), left.series[0][i].clone());
            series.push(Series::new(path, times, values, RESIDUAL, label));
        }
        let rows = |means: &[Vec<f64>]| -> Vec<PerAxis<f64>> {
            (0..frames.len()).map(|f| std::array::from_fn(|i| means.get(i).map_or(0.0, |mean| mean[f]))).collect()
        };
        let joints: Vec<JointState> = frames.iter().map(|&k| dataset.joints[k]).collect();
        let beside = self.beside.map(|model| Plant::along(model, self.recording)).zip(after);
        let ghosts = Ghosts::of(plant, &times, &joints, &rows(&before))?;
        let after = beside.map(|(later, means)| {
            let ghost = ghosts.beside(&later, &rows(&means))?;
            Ok::<_, miette::Report>(After { name: self.news(), residual: in_sigma(&means, &sigma), ghost: Some(ghost) })
        });
        let mut scene = Scene::new(plant.mechanism, &plant.geometry, times.clone(), poses);
        scene.residual = Some(in_sigma(&before, &sigma));
        scene.used = used(self.model, plant, dataset, &frames).into_diagnostic()?;
        scene.series = series;
        scene.text = Some(self.text(&left, later.as_ref(), &noise, unit) + &ghosts.text());
        scene.ghost_name = ghosts.name();
        scene.contacts = (!self.contacts.is_empty()).then(|| strongest(self.contacts, &scene.times));
        scene.after = after.transpose()?;
        scene.ghost = Some(ghosts.poses);
        scene.assets = Some(assets);
        Ok(scene)
    }

    /// What the later model has that the first one lacks.
    fn news(&self) -> String {
        let known = |name: &str| self.model.effects.iter().any(|own| own.effect.name() == name);
        let effects = self.beside.iter().flat_map(|later| later.effects.iter());
        let added = effects.filter(|active| !known(active.effect.name()));
        let added: Vec<&str> = added.map(|active| active.effect.spec().about.summary).collect();
        if added.is_empty() { "with other parameters".into() } else { format!("with {}", added.join("; ")) }
    }

    /// What is left of every axis, and what the colours mean.
    fn text(&self, left: &Residuals, later: Option<&Residuals>, noise: &[f64], unit: Unit) -> String {
        let mut text = format!("### {} against {}\n\n", self.recording.name, self.model.name);
        text += &match later {
            Some(_) => {
                let name = self.news();
                format!("**After**: {name}.\n\n| RMS, {unit} | before | after | noise |\n|---|---|---|---|\n")
            }
            None => format!("| RMS, {unit} | left | noise |\n|---|---|---|\n"),
        };
        for (i, (rms, noise)) in left.rms.iter().zip(noise).enumerate().take(self.recording.signals.mechanism.axes()) {
            let after = later.map_or(String::new(), |l| format!(" {:.4} |", l.rms[i]));
            text += &format!("| axis {} | {rms:.4} |{after} {noise:.4} |\n", i + 1);
        }
        text + LEGEND + if self.contacts.is_empty() { "" } else { ARROWS }
    }
}

/// Where the models would be, see [`ghost`].
struct Ghosts<'a> {
    times: &'a [f64],
    joints: &'a [JointState],
    factor: f64,
    poses: Vec<[Isometry3<f64>; SLOTS]>,
}

impl<'a> Ghosts<'a> {
    /// The ghost of the first model, which sets the factor.
    fn of(
        plant: &Plant,
        times: &'a [f64],
        joints: &'a [JointState],
        residual: &[PerAxis<f64>],
    ) -> miette::Result<Self> {
        let deviations = ghost::deviations(plant, times, joints, residual).into_diagnostic()?;
        let factor = ghost::factor(plant, &deviations);
        let poses = ghost::poses(plant, joints, &deviations, factor).into_diagnostic()?;
        Ok(Self { times, joints, factor, poses })
    }

    /// The ghost of a later model with the same factor.
    fn beside(&self, later: &Plant, residual: &[PerAxis<f64>]) -> miette::Result<Vec<[Isometry3<f64>; SLOTS]>> {
        let deviations = ghost::deviations(later, self.times, self.joints, residual).into_diagnostic()?;
        ghost::poses(later, self.joints, &deviations, self.factor).into_diagnostic()
    }

    fn name(&self) -> String {
        if self.factor > 1.0 { format!("model, deviation × {}", self.factor) } else { "model".into() }
    }

    fn text(&self) -> String {
        let enlarged = if self.factor > 1.0 { format!(", **enlarged {} times**", self.factor) } else { String::new() };
        format!(
            "\n**Ghost** (blue): where the model would be under the measured torques; every {} s it is put back to the \
             measured state. Its deviation is shown{enlarged}, where it is more than 1 mm.\n",
            ghost::RELEASE
        )
    }
}

/// What the arrows are.
pub(crate) const ARROWS: &str = "\n**Arrows**: contact forces on the robot, 2 mm per N.\n";

/// Contacts up to each of `times` (s) since the one before, or after it if it is the last: of every pair of bodies the one
/// with the largest force.
fn strongest(contacts: &[Contacts], times: &[f64]) -> Vec<Vec<scene::Contact>> {
    let mut rest = contacts.iter().peekable();
    let up_to = |k: usize| {
        // Times of a bag are rounded to nanoseconds.
        let end = if k + 1 < times.len() { times[k] + 1e-9 } else { f64::INFINITY };
        let mut pairs: Vec<&Contact> = Vec::new();
        while let Some(Contacts { pairs: now, .. }) = rest.next_if(|c| c.t <= end) {
            for contact in now {
                match pairs.iter_mut().find(|known| known.bodies == contact.bodies) {
                    Some(known) if known.force.norm() >= contact.force.norm() => {}
                    Some(known) => *known = contact,
                    None => pairs.push(contact),
                }
            }
        }
        pairs.iter().map(|c| scene::Contact { at: c.at, force: c.force }).collect()
    };
    (0..times.len()).map(up_to).collect()
}

/// Share of its hold that every socket uses at each of `frames`, from the model's forces; `None` without struts.
fn used(
    model: &Model,
    plant: &Plant,
    dataset: &Dataset,
    frames: &[usize],
) -> Result<Option<Vec<PerSocket<f64>>>, KinematicsError> {
    if !plant.assembled {
        return Ok(None);
    }
    let clamps = Clamps::watched(&model.sockets);
    let of = |&k: &usize| {
        let (_, margins) = clamps.along(plant, dataset.t[k], &plant.motion(&dataset.joints[k])?)?;
        Ok(clamps.used(&margins))
    };
    frames.iter().map(of).collect::<Result<Vec<_>, _>>().map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltatwin::machine::{Setup, each};
    use deltatwin::recording::Signals;
    use nalgebra::Vector3;

    /// A robot at rest whose torques are off by 0.5, 0, −0.2, 0 N·m of what the model says, with noise of 0.1 N·m; 50
    /// samples of 400 µs average to 0.1/√50 N·m.
    #[test]
    fn a_residual_of_known_size_has_the_known_number_of_sigmas() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models/irb360-6-1600.toml");
        let model = deltatwin_io::model::read(&file).unwrap();
        let t = (0..2_500).map(|k| f64::from(k) * 4e-4).collect();
        let signals = Signals::of_drives(model.mechanism, t, &[[0.3, 0.4, 0.5, 0.2]; 2_500], &[each(0.0); 2_500]);
        let setup = Setup { torque_noise: Some(each(0.1)), ..Setup::default() };
        let mut recording = Recording { signals, setup, ..Recording::default() };
        let plant = Plant::along(&model, &recording);
        let predicted = predict(&plant, &Dataset::new(&recording)).unwrap();
        let off = [0.5, 0.0, -0.2, 0.0];
        for (tau, (predicted, off)) in recording.signals.torques_mut().zip(predicted.iter().zip(off)) {
            tau.fill(predicted[0] + off);
        }
        let replay = Replay {
            recording: &recording,
            dataset: None,
            contacts: &[],
            model: &model,
            beside: None,
            access: Access::PROJECT,
        };
        let assets = Assets::of(&model, replay.access).unwrap();
        let scene = replay.scene(&plant, &assets).unwrap();
        let expected = off.map(|off| off * 50f64.sqrt() / 0.1);
        for shown in scene.residual.unwrap() {
            assert!(shown.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-6), "{shown:?} {expected:?}");
        }
        let band = scene.series.iter().find(|s| s.path == "residual/axis1/noise_above").unwrap();
        assert!((band.values[0] - 2.0 * 0.1 / 50f64.sqrt()).abs() < 1e-12);
    }

    #[test]
    fn the_strongest_contact_of_a_pair_is_shown_in_the_next_frame() {
        let contact = |what: &str, newton: f64| Contact {
            bodies: ["platform".into(), what.into()],
            at: Vector3::zeros(),
            normal: Vector3::z(),
            force: Vector3::z() * newton,
        };
        let contacts = [
            Contacts { t: 0.01, pairs: vec![contact("table", 5.0)] },
            Contacts { t: 0.02, pairs: vec![contact("table", 9.0), contact("block", 1.0)] },
            Contacts { t: 0.03, pairs: vec![contact("table", 7.0)] },
            Contacts { t: 0.05, pairs: Vec::new() },
            Contacts { t: 0.07, pairs: vec![contact("table", 2.0)] },
        ];
        let forces = |of: &Vec<scene::Contact>| of.iter().map(|c| c.force.z).collect::<Vec<f64>>();
        let shown: Vec<Vec<f64>> = strongest(&contacts, &[0.0, 0.02, 0.04, 0.06]).iter().map(forces).collect();
        assert_eq!(shown, [vec![], vec![9.0, 1.0], vec![7.0], vec![2.0]]);
    }
}

//! Provenance of a simulated or measured recording and data for its display: the [`Context`] of its bag.

use std::collections::BTreeMap;
use std::path::Path;

use super::{ContactBody, Event, EventKind, Frame, Options, Report};
use crate::cell::urdf;
use crate::dynamics::Plant;
use crate::kinematics::JointState;
use crate::machine::bodies::{ROTOR, TELESCOPE_UPPER, body_name};
use crate::machine::{Mechanism, Setup};
use crate::model::Model;
use crate::recording::{Attachment, Contact, Contacts, Context, Level, Note, Poses, Recording, Signals};
use crate::scenario::Scenario;

/// Time between the poses of a measurement, s, as between the frames of a simulated run.
const PERIOD: f64 = 0.01;
/// Time by which a pose may be early, s: times of a bag are rounded to nanoseconds.
const EARLY: f64 = 1e-9;

/// Provenance known before a run: program, files and seed, with the contents of the files.
///
/// `text` is the content of the scenario's `file`, which is attached. Files are named without folders, so that the same
/// run produces the same bytes in any folder.
pub fn origin(scenario: &Scenario, (file, text): (&Path, Option<&str>), machine: &Model, planning: &Model) -> Context {
    let mut command = format!("deltatwin simulate {}", name(file));
    if machine.path.as_ref().is_some_and(|p| *p != scenario.model) {
        command += &format!(" --model {}", model_name(machine));
    }
    let provenance = BTreeMap::from([
        ("program".into(), "deltatwin".into()),
        ("version".into(), env!("CARGO_PKG_VERSION").into()),
        ("command".into(), command),
        ("scenario".into(), name(file)),
        ("model".into(), model_name(machine)),
        ("controller_model".into(), model_name(planning)),
        ("seed".into(), scenario.seed.to_string()),
        ("time".into(), "t = 0 is a fixed instant, not the time of the simulation".into()),
    ]);
    let mut attachments = Vec::new();
    if let Some(text) = text {
        attachments.push(toml(name(file), text));
    }
    for model in [machine, planning] {
        let named = model_name(model);
        if let Some(source) = model.source.as_deref().filter(|_| attachments.iter().all(|a| a.name != named)) {
            attachments.push(toml(named, source));
        }
    }
    Context { provenance, attachments, description: urdf(machine), ..Context::default() }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

fn model_name(model: &Model) -> String {
    model.path.as_deref().map_or(model.name.clone(), name)
}

fn toml(name: String, text: &str) -> Attachment {
    Attachment { name, media_type: "application/toml".into(), content: text.as_bytes().to_vec() }
}

/// What is known before the first sample of a recording that `command` writes: program and command; of the machine of
/// `model`, if it is known, also the model file and, assembled as in `setup`, the URDF.
pub fn measured(command: &str, model: Option<&Model>, setup: &Setup) -> Context {
    let facts = [("program", "deltatwin"), ("version", env!("CARGO_PKG_VERSION")), ("command", command)];
    let mut provenance: BTreeMap<String, String> = facts.map(|(key, fact)| (key.into(), fact.into())).into();
    let Some(model) = model else { return Context { provenance, ..Context::default() } };
    provenance.insert("model".into(), model_name(model));
    let attachments = model.source.iter().map(|text| toml(model_name(model), text)).collect();
    let description = Plant::new(model, setup).assembled.then(|| urdf(model)).flatten();
    Context { provenance, attachments, description, ..Context::default() }
}

/// The [`measured()`] context of a whole recording, with the poses of the links.
pub fn of_recording(command: &str, model: Option<&Model>, recording: &Recording) -> Context {
    let poses = model.map(|model| Links::new(model, &recording.setup).poses(&recording.signals));
    Context { poses: poses.unwrap_or_default(), ..measured(command, model, &recording.setup) }
}

/// Poses of a machine's links along measured angles, piece by piece.
pub struct Links {
    plant: Plant,
    /// Time of the next pose, s.
    due: f64,
}

impl Links {
    /// Links of the machine of `model` in `setup`.
    pub fn new(model: &Model, setup: &Setup) -> Self {
        Self { plant: Plant::new(model, setup), due: f64::NEG_INFINITY }
    }

    /// Poses every 10 ms along the next samples; none of a disassembled machine, nor at angles that it cannot have.
    pub fn poses(&mut self, signals: &Signals) -> Vec<Poses> {
        if !self.plant.assembled {
            return Vec::new();
        }
        let mut found = Vec::new();
        for (&t, q) in signals.t.iter().zip(signals.q().iter()).filter(|(t, _)| t.is_finite()) {
            if t < self.due - EARLY {
                continue;
            }
            // On the same grid while there are no gaps.
            self.due = if self.due + PERIOD > t { self.due + PERIOD } else { t + PERIOD };
            let Ok(motion) = self.plant.motion(&JointState { q, ..JointState::default() }) else { continue };
            let bodies = motion.shown(self.plant.mechanism);
            found.push(Poses { t, frames: links(self.plant.mechanism).map(|b| (body_name(b), bodies[b])).collect() });
        }
        found
    }
}

/// Bodies that are links of an assembled machine's URDF.
fn links(machine: Mechanism) -> impl Iterator<Item = usize> {
    let last = match machine {
        Mechanism::Delta { telescope: true, .. } => TELESCOPE_UPPER + 2,
        _ => ROTOR - 1,
    };
    (0..last).filter(|b| *b != ROTOR)
}

/// The provenance with poses, contacts and events of the run added.
pub fn with_run(mut origin: Context, machine: &Model, options: &Options, report: &Report) -> Context {
    origin.poses = report.frames.iter().filter_map(|f| poses(machine, options, f)).collect();
    origin.contacts = report.frames.iter().map(|f| contacts(options, f)).collect();
    origin.events = report.events.iter().map(note).collect();
    origin
}

/// Poses of the robot's links and of the objects in a frame; `None` without a robot that has them.
pub fn poses(machine: &Model, options: &Options, frame: &Frame) -> Option<Poses> {
    if !machine.assembled {
        return None;
    }
    let bodies = links(machine.mechanism).map(|b| (body_name(b), frame.bodies[b]));
    let objects = (0..options.objects.len()).zip(&frame.objects).map(|(o, pose)| (object_name(options, o), *pose));
    Some(Poses { t: frame.t, frames: bodies.chain(objects).collect() })
}

/// Frame name of object `object`; those beyond the listed ones are the robot's own frame.
fn object_name(options: &Options, object: usize) -> String {
    options.objects.get(object).map_or_else(|| "frame".into(), |o| format!("object/{}", o.name))
}

/// Contacts of the robot since the previous frame, of every pair the strongest.
pub fn contacts(options: &Options, frame: &Frame) -> Contacts {
    let name = |body: ContactBody| match body {
        ContactBody::Link(link) => body_name(link),
        ContactBody::Object(object) => object_name(options, object),
    };
    let pairs = frame.contacts.iter().map(|touch| Contact {
        bodies: [name(touch.link), name(touch.other)],
        at: touch.at,
        normal: touch.normal.try_normalize(0.0).unwrap_or_default(),
        force: touch.push,
    });
    Contacts { t: frame.t, pairs: pairs.collect() }
}

/// An event as a log entry.
pub fn note(event: &Event) -> Note {
    let level = match event.kind {
        EventKind::Dislocation | EventKind::Singular => Level::Error,
        EventKind::Trip | EventKind::Contact | EventKind::Stop => Level::Warning,
        EventKind::Pick | EventKind::Release | EventKind::Rest => Level::Info,
    };
    Note { t: event.t, level, text: format!("{:.6} s  {}: {}", event.t, event.kind.name(), event.what) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Configuration;
    use crate::model::testing::irb360;
    use crate::recording::Channel;

    /// At 2.5 kHz in pieces with a gap, an angle that cannot be among them: every 25th sample has a pose, of the links that
    /// the URDF names.
    #[test]
    fn links_follow_measured_angles() {
        // Struts of 0.45 m do not reach from arms that are this far apart: the elbows' circle has a radius of 0.51 m.
        let mut model = irb360();
        model.geometry.limbs.iter_mut().for_each(|limb| limb.strut_length = 0.45);
        let plant = Plant::new(&model, &Setup::default());
        let mut links = Links::new(&model, &Setup::default());
        let angle = |t: f64| [1.2 + t, 1.2, 1.2 - t, 2.0 * t];
        let piece = |from: f64, count: u32| {
            let t: Vec<f64> = (0..count).map(|k| from + 4e-4 * f64::from(k)).collect();
            let q: Vec<_> = t.iter().map(|&t| angle(t)).collect();
            Signals::of_drives(model.mechanism, t, &q, &q)
        };
        let mut first = piece(0.0, 60);
        for (axis, lost) in [-1.5, 1.7, 1.7, 0.0].into_iter().enumerate() {
            first.get_mut(Channel::Angle(axis)).unwrap()[25] = lost;
        }
        let all = [first, piece(0.024, 20), piece(0.1, 30)].map(|signals| links.poses(&signals));
        let times: Vec<f64> = all.iter().flatten().map(|pose| pose.t).collect();
        let expected = [0.0, 0.02, 0.03, 0.1, 0.11];
        assert_eq!(times.len(), expected.len(), "{times:?}");
        assert!(times.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{times:?}");
        let urdf = urdf(&model).unwrap();
        for pose in all.iter().flatten() {
            let motion = plant.motion(&JointState { q: angle(pose.t), ..JointState::default() }).unwrap();
            assert_eq!(pose.frames.len(), 13);
            for (name, at) in &pose.frames {
                assert!(urdf.contains(&format!("<link name=\"{name}\"")), "{name}");
                let body = (0..motion.bodies.len()).find(|b| body_name(*b) == *name).unwrap();
                assert!((at.translation.vector - motion.bodies[body].position).norm() < 1e-12, "{name}");
            }
        }
        let apart = Setup { configuration: Configuration::Disassembled, ..Setup::default() };
        assert!(Links::new(&model, &apart).poses(&piece(0.0, 60)).is_empty());
        assert!(measured("x", Some(&model), &apart).description.is_none());
    }
}

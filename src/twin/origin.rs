//! Provenance of a simulated recording and data for its display: the [`Context`] of its bag.

use std::collections::BTreeMap;
use std::path::Path;

use super::{ContactBody, Event, EventKind, Frame, Options, Report};
use crate::cell::urdf;
use crate::machine::Mechanism;
use crate::machine::bodies::{ROTOR, TELESCOPE_UPPER, body_name};
use crate::model::Model;
use crate::recording::{Attachment, Contact, Contacts, Context, Level, Note, Poses};
use crate::scenario::Scenario;

/// Provenance known before a run: program, files and seed, with the contents of the files.
///
/// `text` is the content of the scenario's `file`, which is attached. Files are named without folders, so that the same
/// run produces the same bytes in any folder.
pub fn origin(scenario: &Scenario, (file, text): (&Path, Option<&str>), machine: &Model, planning: &Model) -> Context {
    let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let model_name = |model: &Model| model.path.as_deref().map_or(model.name.clone(), name);
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
    let toml = |name: String, text: &str| Attachment {
        name,
        media_type: "application/toml".into(),
        content: text.as_bytes().to_vec(),
    };
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
    let last = match machine.mechanism {
        Mechanism::Delta { telescope: true, .. } => TELESCOPE_UPPER + 2,
        _ => ROTOR - 1,
    };
    let bodies = (0..last).filter(|b| *b != ROTOR).map(|b| (body_name(b), frame.bodies[b]));
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

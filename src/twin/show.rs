//! A run as a Rerun file, with everything where it really was.

use std::path::Path;

use super::{Event, EventKind, Frame, Options, Report};
use crate::model::{Geometry, STRUTS};
use crate::recording::rerun::{Level, Note, Scene, Thing, measured, socket_margins, strut_force, write_rrd};
use crate::recording::{Recording, WriteError};

/// Writes the frames of `report` as an `.rrd` file, with curves of what was recorded and of the loads on the struts.
pub(super) fn write(
    path: &Path,
    geometry: &Geometry,
    options: &Options,
    recording: &Recording,
    report: &Report,
) -> Result<(), WriteError> {
    let frames = &report.frames;
    let times: Vec<f64> = frames.iter().map(|f| f.t).collect();
    let mut scene = Scene::new(geometry, times.clone(), frames.iter().map(|f| f.bodies).collect());
    scene.loose = Some(frames.iter().map(loose).collect());
    scene.payload = options.payload_shape.map(|p| (p.shape, p.centre));
    let thing = |(i, object)| Thing { object, poses: frames.iter().map(|f| f.objects[i]).collect() };
    scene.things = options.objects.iter().enumerate().map(thing).collect();
    scene.notes = report.events.iter().map(note).collect();
    scene.series = measured(recording);
    // Where nothing is measured, the truth.
    let signals = &recording.signals;
    for s in 0..STRUTS {
        for (end, sensors) in [&signals.strut_upper, &signals.strut_lower].into_iter().enumerate() {
            if sensors[s].is_none() {
                let force = frames.iter().map(|f| f.strut_force[end][s]).collect();
                scene.series.push(strut_force(s, end, times.clone(), force));
            }
        }
    }
    if signals.socket_margin.is_none() {
        let margins: Vec<_> = frames.iter().map(|f| f.socket_margin).collect();
        scene.series.extend(socket_margins(&times, &margins));
    }
    write_rrd(path, &recording.name, &scene)
}

/// Struts with an open socket.
fn loose(frame: &Frame) -> [bool; STRUTS] {
    std::array::from_fn(|s| !(frame.closed.contains(s) && frame.closed.contains(STRUTS + s)))
}

fn note(event: &Event) -> Note {
    let level = match event.kind {
        EventKind::Dislocation | EventKind::Singular => Level::Error,
        EventKind::Trip | EventKind::Contact => Level::Warning,
        EventKind::Pick | EventKind::Release | EventKind::Rest => Level::Info,
    };
    Note { t: event.t, level, text: format!("{:.6} s  {}: {}", event.t, event.kind.name(), event.what) }
}

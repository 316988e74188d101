//! Scenes for Rerun, with moving robot, surroundings and signals: as a recording (`.rrd`), or live in a viewer.

mod assets;
mod base;
mod contacts;
mod content;
mod known;
mod layout;
mod live;
mod mesh;
mod paint;
mod robot;
mod solids;
mod things;
mod trail;

use std::io::Write;
use std::path::Path;

use nalgebra::{Isometry3, Vector3};
use rerun::components::Color;
use rerun::{RecordingStream, TimeColumn, archetypes as a};

pub use assets::Assets;
pub use content::{
    After, Contact, Level, Line, Note, Scene, Series, Thing, drives, measured, socket_margins, strut_force,
    strut_forces,
};
pub use live::{Live, Viewer};

use deltatwin::machine::PerAxis;
use deltatwin_io::file::{self, WriteError};
use known::Known;
use layout::layout;

/// Name of the timeline (s).
const TIME: &str = "time";
const APPLICATION: &str = "deltatwin";
/// Entity path of the log of events.
const EVENTS: &str = "events";
/// Entity path of the text.
const TEXT: &str = "verdict";

/// Colours of axes 1–4 in plots.
const AXIS: PerAxis<[u8; 3]> = [[76, 140, 220], [235, 125, 40], [90, 175, 95], [170, 105, 200]];

/// Writes a scene with a layout as an `.rrd` file; an existing file is replaced.
///
/// The recording is assembled in memory, because the SDK's own file writer does not report a failed write, e.g. on a
/// full disk.
///
/// # Errors
/// [`WriteError::Invalid`] if the scene is inconsistent or cannot be encoded, [`WriteError::Io`] if the file cannot be
/// written.
pub fn write_rrd(path: &Path, name: &str, scene: &Scene) -> Result<(), WriteError> {
    scene.check().map_err(|problem| WriteError::invalid(path, problem))?;
    let bytes = encode(name, scene).map_err(|e| WriteError::invalid(path, e.to_string()))?;
    file::replace(path, |out| out.write_all(&bytes))
}

/// Why something cannot be shown.
pub type Problem = Box<dyn std::error::Error + Send + Sync>;
type Outcome = Result<(), Problem>;

fn encode(name: &str, scene: &Scene) -> Result<Vec<u8>, Problem> {
    let builder = rerun::RecordingStreamBuilder::new(APPLICATION).recording_name(name).enabled(true);
    let (rec, storage) = builder.memory()?;
    layout(scene).send(&rec)?;
    shapes(&rec, scene)?;
    trail::whole(&rec, scene)?;
    motion(&rec, scene, &mut Known::default())?;
    Ok(storage.drain_as_bytes()?)
}

/// Logs the static content: robot, surroundings, and the style of the curves.
fn shapes(rec: &RecordingStream, scene: &Scene) -> Outcome {
    rec.log_static("world", &a::ViewCoordinates::RIGHT_HAND_Z_UP())?;
    base::shapes(rec, scene)?;
    robot::shapes(rec, scene)?;
    things::things(rec, scene)?;
    trail::legend(rec, scene)?;
    if let Some(text) = &scene.text {
        rec.log_static(TEXT, &a::TextDocument::from_markdown(text.as_str()))?;
    }
    scene.series.iter().try_for_each(|s| style(rec, s))
}

/// Logs the time-dependent content.
fn motion(rec: &RecordingStream, scene: &Scene, known: &mut Known) -> Outcome {
    if !scene.times.is_empty() {
        robot::poses(rec, scene)?;
        robot::appearance(rec, scene, known)?;
        paint::colors(rec, scene, known)?;
        contacts::arrows(rec, scene, known)?;
    }
    scene.series.iter().try_for_each(|s| curve(rec, s))?;
    events(rec, &scene.notes)
}

fn style(rec: &RecordingStream, s: &Series) -> Outcome {
    let style = a::SeriesLines::new()
        .with_names(s.lines.iter().map(|line| line.label.as_str()))
        .with_colors(s.lines.iter().map(|line| color(line.color)))
        .with_widths(vec![1.5f32; s.lines.len()]);
    rec.log_static(s.path.as_str(), &style)?;
    Ok(())
}

fn curve(rec: &RecordingStream, s: &Series) -> Outcome {
    if s.times.is_empty() {
        return Ok(());
    }
    let values = a::Scalars::new(s.values.iter().copied()).columns(vec![s.lines.len(); s.times.len()])?;
    rec.send_columns(s.path.as_str(), [frames(&s.times)], values)?;
    Ok(())
}

fn events(rec: &RecordingStream, notes: &[Note]) -> Outcome {
    if notes.is_empty() {
        return Ok(());
    }
    let times = TimeColumn::new_duration_secs(TIME, notes.iter().map(|n| n.t));
    let level = |note: &Note| match note.level {
        Level::Info => "INFO",
        Level::Warning => "WARN",
        Level::Error => "ERROR",
    };
    let lines = a::TextLog::update_fields()
        .with_many_text(notes.iter().map(|n| n.text.as_str()))
        .with_many_level(notes.iter().map(level));
    rec.send_columns(EVENTS, [times], lines.columns_of_unit_batches()?)?;
    Ok(())
}

fn color([r, g, b]: [u8; 3]) -> Color {
    Color::from_rgb(r, g, b)
}

fn frames(times: &[f64]) -> TimeColumn {
    TimeColumn::new_duration_secs(TIME, times.iter().copied())
}

fn quaternion(pose: &Isometry3<f64>) -> rerun::Quaternion {
    let [x, y, z, w] = pose.rotation.coords.map(|v| v as f32).into();
    rerun::Quaternion::from_xyzw([x, y, z, w])
}

fn point(v: Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

/// Entities of a scene, as a file and as pieces of a stream.
#[cfg(test)]
fn entities(scene: &Scene) -> std::collections::BTreeSet<String> {
    use rerun::external::re_log_types::LogMsg;
    use rerun::log::Chunk;
    let (rec, storage) = rerun::RecordingStreamBuilder::new(APPLICATION).enabled(true).memory().unwrap();
    shapes(&rec, scene).unwrap();
    trail::whole(&rec, scene).unwrap();
    motion(&rec, scene, &mut Known::default()).unwrap();
    for piece in [scene.between(f64::MIN, scene.times[0] + 1e-9), scene.between(scene.times[0] + 1e-9, f64::MAX)] {
        trail::end(&rec, &piece, &mut Known::default()).unwrap();
        motion(&rec, &piece, &mut Known::default()).unwrap();
    }
    let of = |message: LogMsg| match message {
        LogMsg::ArrowMsg(_, arrow) => Some(Chunk::from_arrow_msg(&arrow).unwrap().entity_path().to_string()),
        _ => None,
    };
    storage.take().into_iter().filter_map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};

    use deltatwin::cell::{Mobility, Object, Shape, Surface};
    use deltatwin::kinematics::{JointState, Motion};
    use deltatwin::machine::{Actuator, Delta, Geometry, Mechanism, each};
    use deltatwin::recording::{Channel, Recording, Signals};

    /// The machine with arms at angle `phi` (rad), and axis 4 rotating.
    fn lift(g: &Geometry, phi: f64) -> Motion {
        let joints = JointState { q: [phi, 0.8 * phi, phi + 0.1, 2.0 * phi], ..JointState::default() };
        Motion::assembled(g, &joints).expect("a pose within reach")
    }

    fn geometry() -> Geometry {
        let lengths = Delta {
            actuator: Actuator::Revolute,
            base_radius: 0.2,
            arm_length: 0.35,
            strut_length: 0.95,
            platform_radius: 0.05,
            pair_distance: 0.09,
            arm_limits: [-0.9, 1.9],
        };
        Geometry {
            mounting_height: 0.275,
            upper_hooke_height: 0.05,
            lower_hooke_height: 0.03,
            flange_height: -0.05,
            telescope_limits: [0.65, 1.25],
            ..Geometry::delta(lengths)
        }
    }

    /// Ghost and contacts appear where there are any, and a later model has a robot of its own.
    #[test]
    fn what_is_compared_has_entities_of_its_own() {
        let g = geometry();
        let times = vec![0.0, 0.02];
        let poses = |phi: f64| vec![lift(&g, phi).poses(), lift(&g, 0.3).poses()];
        let mut scene = Scene::new(Mechanism::default(), &g, times.clone(), poses(0.3));
        let has = |scene: &Scene, entity: &str| entities(scene).contains(entity);
        assert!(!has(&scene, "/world/ghost/arm1") && !has(&scene, "/world/contacts") && !has(&scene, "/world/legend"));
        scene.residual = Some(vec![each(0.0); 2]);
        scene.ghost = Some(poses(0.4));
        scene.ghost_name = "model".into();
        scene.after = Some(After { name: "with more".into(), residual: vec![each(9.0); 2], ghost: None });
        let contact = Contact { at: Vector3::new(0.0, 0.0, -1.0), force: Vector3::new(0.0, 0.0, 50.0) };
        scene.contacts = Some(vec![vec![contact, contact], vec![contact]]);
        for entity in
            ["ghost/arm1", "ghost", "contacts", "legend", "after/robot/arm1", "after/path", "robot/springs/pair1_upper"]
        {
            assert!(has(&scene, &format!("/world/{entity}")), "{entity}: {:?}", entities(&scene));
        }
        assert!(!has(&scene, "/world/ghost/strut1/sockets") && !has(&scene, "/world/after/ghost"));
        scene.contacts = Some(vec![vec![]]);
        assert_eq!(scene.check().unwrap_err(), "contacts: 1 values for 2 times");
    }

    /// A write to a full disk must return an error; the SDK's file writer blocked in this case.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_disk_is_an_error() {
        let full = Path::new("/dev/full");
        let mut out = std::fs::OpenOptions::new().write(true).open(full).unwrap();
        let g = geometry();
        let motion = Motion::disassembled(&g, &JointState::default());
        let scene = Scene::new(Mechanism::default(), &g, vec![0.0], vec![motion.poses()]);
        let bytes = encode("full", &scene).unwrap();
        assert!(out.write_all(&bytes).is_err());
        // A folder in which files cannot be created.
        assert!(write_rrd(Path::new("/proc/full.rrd"), "full", &scene).is_err());
    }

    #[test]
    fn a_scene_is_written() {
        let g = geometry();
        let times: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.02).collect();
        let motions: Vec<Motion> = times.iter().map(|t| lift(&g, 0.3 + 0.4 * (3.0 * t).sin())).collect();
        let residual: Vec<PerAxis<f64>> = times.iter().map(|t| [0.0, 3.5, 3.0 * t, 9.0]).collect();
        let mut recording = Recording::default();
        let q: Vec<_> = motions.iter().map(|m| m.q).collect();
        let tau: Vec<_> = times.iter().map(|t| each(9.0 * t.sin())).collect();
        let margins: Vec<_> = times.iter().map(|t| [200.0 - t; 6]).collect();
        recording.signals = Signals::of_drives(Default::default(), times.clone(), &q, &tau);
        recording.signals.set(Channel::StrutUpper(0), times.iter().map(|t| 30.0 * t.cos()).collect());
        recording.signals.set_rows(Channel::MarginUpper, &margins);
        recording.signals.set_rows(Channel::MarginLower, &margins);
        let can = Object {
            name: "can / 1".into(),
            shape: Shape::Cylinder { radius: 0.03, height: 0.1 },
            mobility: Mobility::Free { mass: 0.5 },
            position: Vector3::zeros(),
            yaw: 0.0,
            surface: Surface::default(),
        };
        let fall = |t: &f64| Isometry3::translation(0.0, 0.0, -1.0 - t);
        let mut scene =
            Scene::new(Mechanism::default(), &g, times.clone(), motions.iter().map(Motion::poses).collect());
        scene.series = measured(&recording);
        scene.residual = Some(residual);
        scene.loose = Some(times.iter().map(|t| [*t > 1.0; 8]).collect());
        scene.payload = Some((Shape::Sphere { radius: 0.05 }, Vector3::new(0.0, 0.0, -0.05)));
        scene.things = vec![Thing { object: &can, poses: times.iter().map(fall).collect() }];
        scene.notes = vec![Note { t: 1.0, level: Level::Error, text: "dislocation: strut 1 upper".into() }];
        assert_eq!(scene.series.len(), 10);
        let model = times.iter().map(|t| 8.0 * t.sin()).collect();
        scene.series.push(Series::new(
            "torque/axis1/model".into(),
            times.clone(),
            model,
            [120; 3],
            "model [N·m]".into(),
        ));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.rrd");
        write_rrd(&path, "lift", &scene).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes.starts_with(b"RRF2") && bytes.len() > 20_000, "{} bytes", bytes.len());

        scene.things[0].poses.pop();
        let e = write_rrd(&path, "lift", &scene).unwrap_err().to_string();
        assert!(e.contains("can / 1: 99 values for 100 times"), "{e}");
        scene.things.clear();
        scene.series[0].values.pop();
        let e = write_rrd(&path, "lift", &scene).unwrap_err().to_string();
        assert!(e.contains("torque/axis1/measured: 99 values for 100 times"), "{e}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

//! Display of a simulated run in Rerun, with the true poses.

use std::path::Path;

use nalgebra::Isometry3;

use crate::replay::ARROWS;
use crate::scene::{
    Assets, Contact, Scene, Series, Thing, measured, socket_margins, strut_force, strut_forces, write_rrd,
};
use deltatwin::dynamics::Plant;
use deltatwin::machine::bodies::SLOTS;
use deltatwin::machine::{Part, PerStrut};
use deltatwin::recording::{Channel, Recording, Signals};
use deltatwin::scenario::DesiredMotion;
use deltatwin::twin::origin::note;
use deltatwin::twin::{Event, Frame, Options, Report};
use deltatwin_io::file::WriteError;

/// What a run is, besides its frames.
#[derive(Clone)]
pub struct Stage {
    /// The machine.
    pub plant: Plant,
    /// Conditions of the run.
    pub options: Options,
    /// Motion that the controller wants, which is shown as a ghost.
    pub desired: Option<DesiredMotion>,
    /// Meshes of the machine.
    pub assets: Assets,
}

impl Stage {
    /// Writes the frames of `report` as an `.rrd` file, with curves of the recorded signals and of the strut loads.
    ///
    /// # Errors
    /// As for [`write_rrd`].
    pub fn write(&self, path: &Path, recording: &Recording, report: &Report) -> Result<(), WriteError> {
        let mut scene = self.scene(&report.frames, &report.events);
        scene.series = measured(recording);
        scene.series.extend(self.loads(&report.frames, &recording.signals));
        write_rrd(path, &recording.name, &scene)
    }

    /// Scene of frames and events, without curves.
    ///
    /// # Panics
    /// If a frame has fewer objects than the options.
    pub fn scene(&self, frames: &[Frame], events: &[Event]) -> Scene<'_> {
        let Self { plant, options, .. } = self;
        let times = frames.iter().map(|f| f.t).collect();
        let mut scene = Scene::new(plant.mechanism, &plant.geometry, times, frames.iter().map(|f| f.bodies).collect());
        scene.loose = Some(frames.iter().map(|frame| loose(frame, plant.mechanism.struts())).collect());
        scene.used =
            options.clamps.as_ref().map(|clamps| frames.iter().map(|f| clamps.used(&f.socket_margin)).collect());
        scene.payload = options.payload_shape.clone().map(|p| (p.shape, p.centre));
        let thing = |(i, object)| Thing { object, poses: frames.iter().map(|f| f.objects[i]).collect() };
        scene.things = options.objects.iter().enumerate().map(thing).collect();
        scene.notes = events.iter().map(note).collect();
        scene.ghost = self.desired.as_ref().map(|desired| frames.iter().map(|f| self.wanted(desired, f)).collect());
        scene.ghost_name = "desired motion".into();
        scene.contacts = Some(frames.iter().map(touches).collect());
        scene.assets = Some(&self.assets);
        scene.text = Some([LEGEND, ARROWS].concat());
        scene
    }

    /// Poses in the desired motion at the time of a frame; those of the frame where it cannot be reached.
    fn wanted(&self, desired: &DesiredMotion, frame: &Frame) -> [Isometry3<f64>; SLOTS] {
        let joints = desired.at(frame.t).joints(&self.plant.geometry);
        let motion = joints.and_then(|joints| self.plant.motion(&joints));
        motion.map_or(frame.bodies, |motion| motion.shown(self.plant.mechanism))
    }

    /// Curves of the true loads on struts and sockets that `signals` do not contain.
    pub fn loads(&self, frames: &[Frame], signals: &Signals) -> Vec<Series> {
        if !self.plant.has(Part::Linkage) {
            return Vec::new();
        }
        let times: Vec<f64> = frames.iter().map(|f| f.t).collect();
        let mut series = Vec::new();
        for s in 0..self.plant.mechanism.struts() {
            let known = [Channel::StrutUpper(s), Channel::StrutLower(s)].map(|end| signals.get(end).is_some());
            match known {
                [true, true] => {}
                [false, false] => {
                    let forces = frames.iter().map(|f| [f.strut_force[0][s], f.strut_force[1][s]]);
                    series.push(strut_forces(s, times.clone(), forces));
                }
                [upper, _] => {
                    let end = usize::from(upper);
                    let force = frames.iter().map(|f| f.strut_force[end][s]).collect();
                    series.push(strut_force(s, end, times.clone(), force));
                }
            }
        }
        if self.plant.assembled && signals.get(Channel::MarginLower(0)).is_none() {
            let margins: Vec<_> = frames.iter().map(|f| &f.socket_margin[..]).collect();
            series.push(socket_margins(&times, self.plant.mechanism.struts(), &margins));
        }
        series
    }
}

/// What colours and ghost mean.
const LEGEND: &str = "**Struts and cups**: load against hold, grey up to a half, yellow at three quarters, red at the \
    limit; a strut that is off is red. **Ghost** (blue): the desired motion, where the robot is more than 1 mm from it.\n";

/// Contacts of a frame.
fn touches(frame: &Frame) -> Vec<Contact> {
    frame.contacts.iter().map(|touch| Contact { at: touch.at, force: touch.push }).collect()
}

/// Struts with an open socket.
fn loose(frame: &Frame, struts: usize) -> PerStrut<bool> {
    std::array::from_fn(|s| s < struts && !(frame.closed.contains(s) && frame.closed.contains(struts + s)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use deltatwin::machine::each;
    use deltatwin::twin::{NewContacts, simulate};
    use deltatwin_io::{model, scenario};

    /// The platform has collided with the block and two limbs are detached.
    #[test]
    fn a_crash_is_shown_as_it_was() {
        let scenario = scenario::read(Path::new("../../scenarios/crash.toml")).unwrap();
        let model = model::read(&scenario.model).unwrap();
        let motion = scenario.motion(&model).unwrap();
        let plant = Plant::new(&model, &scenario.setup);
        let run = |frames| {
            let contacts = Some(deltatwin_cell::contacts as NewContacts);
            let options = Options { duration: 0.28, frames, contacts, ..Options::of(&scenario, &model) };
            let desired = |t: f64| motion.at(t);
            let (recording, report) =
                simulate(&model, &scenario.setup, &plant, &desired, &options, &mut |_| true).unwrap();
            (options, recording, report)
        };
        let (options, recording, report) = run(Some(0.01));
        assert_eq!(recording, run(None).1, "looking changes nothing");
        let frames = &report.frames;
        assert_eq!(frames.len(), 28);
        assert!(frames.iter().enumerate().all(|(k, f)| (f.t - 0.01 * k as f64).abs() < 1e-9 && f.objects.len() == 2));
        assert_eq!(loose(&frames[22], 6), each(false));
        assert_eq!(loose(&frames[27], 6)[..6], [false, false, true, true, true, true]);
        assert_eq!((frames[27].socket_margin[8], frames[27].strut_force[1][2]), (0.0, 0.0));

        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("crash.rrd");
        let stage = Stage { plant: plant.clone(), options, desired: Some(motion.clone()), assets: Assets::default() };
        stage.write(&path, &recording, &report).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes.starts_with(b"RRF2") && bytes.len() > 100_000, "{} bytes", bytes.len());
    }
}

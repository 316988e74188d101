//! Content of a scene, independent of its source.

use nalgebra::{Isometry3, Vector3};

use super::AXIS;
use super::assets::Assets;
use deltatwin::cell::{Object, Shape};
use deltatwin::machine::bodies::SLOTS;
use deltatwin::machine::{Geometry, Mechanism, PerAxis, PerSocket, PerStrut, Unit};
use deltatwin::recording::{Channel, Recording};
pub use deltatwin::recording::{Level, Note};

/// A moving robot, the objects around it, and curves.
pub struct Scene<'a> {
    /// Time of each frame, s, increasing; 50 frames per second are sufficient.
    pub times: Vec<f64>,
    /// Poses of the body frames in the inertial frame, one set per frame.
    pub bodies: Vec<[Isometry3<f64>; SLOTS]>,
    /// Kind of machine.
    pub machine: Mechanism,
    /// Geometry of the robot.
    pub geometry: &'a Geometry,
    /// Mean torque residual over 20 ms per frame and axis, in standard deviations σ of the noise of such a mean; colours
    /// arms and telescope from green (1 σ) to red (6 σ).
    pub residual: Option<Vec<PerAxis<f64>>>,
    /// Other poses of the robot, one set per frame, that are shown as a ghost where they differ.
    pub ghost: Option<Vec<[Isometry3<f64>; SLOTS]>>,
    /// What the ghost is, for the legend.
    pub ghost_name: String,
    /// What a later model leaves.
    pub after: Option<After>,
    /// Contacts, per frame.
    pub contacts: Option<Vec<Vec<Contact>>>,
    /// Meshes of the user.
    pub assets: Option<&'a Assets>,
    /// Share of its hold that each socket uses, per frame: six at the elbows, six at the platform; 1 is the limit.
    pub used: Option<Vec<PerSocket<f64>>>,
    /// Struts with an open socket, per frame.
    pub loose: Option<Vec<PerStrut<bool>>>,
    /// Shape of the payload and its centre in the end effector's frame, m.
    pub payload: Option<(Shape, Vector3<f64>)>,
    /// Objects around the robot.
    pub things: Vec<Thing<'a>>,
    /// Curves, each with its own times.
    pub series: Vec<Series>,
    /// Events.
    pub notes: Vec<Note>,
    /// Whether to reserve a view for events that may follow.
    pub eventful: bool,
    /// What there is to say about all of it, as Markdown.
    pub text: Option<String>,
}

/// What a later model leaves, next to the first.
pub struct After {
    /// What the later model has in addition, in words.
    pub name: String,
    /// Torque residual like [`Scene::residual`].
    pub residual: Vec<PerAxis<f64>>,
    /// Poses like [`Scene::ghost`].
    pub ghost: Option<Vec<[Isometry3<f64>; SLOTS]>>,
}

/// A contact of the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Place in the inertial frame, m.
    pub at: Vector3<f64>,
    /// Force on the robot in the inertial frame, N.
    pub force: Vector3<f64>,
}

/// An object with its pose in every frame.
pub struct Thing<'a> {
    /// The object.
    pub object: &'a Object,
    /// Poses in the inertial frame, one per frame.
    pub poses: Vec<Isometry3<f64>>,
}

/// Curves over the same time, which are one entity.
#[derive(Clone, Debug)]
pub struct Series {
    /// Path of tab, plot and curve, e.g. `torque/axis1/measured`, or of tab and plot.
    pub path: String,
    /// Times, s.
    pub times: Vec<f64>,
    /// Values, as many in a row for each time as there are lines.
    pub values: Vec<f64>,
    /// The curves.
    pub lines: Vec<Line>,
}

/// Look of a curve.
#[derive(Clone, Debug)]
pub struct Line {
    /// Red, green, blue.
    pub color: [u8; 3],
    /// Legend with unit, e.g. `measured [N·m]`.
    pub label: String,
}

impl Series {
    /// A single curve.
    pub fn new(path: String, times: Vec<f64>, values: Vec<f64>, color: [u8; 3], label: String) -> Self {
        Self { path, times, values, lines: vec![Line { color, label }] }
    }
}

impl<'a> Scene<'a> {
    /// A machine without surroundings and curves, with poses `bodies` at `times` (s).
    pub fn new(
        machine: Mechanism,
        geometry: &'a Geometry,
        times: Vec<f64>,
        bodies: Vec<[Isometry3<f64>; SLOTS]>,
    ) -> Self {
        Self {
            times,
            bodies,
            machine,
            geometry,
            residual: None,
            ghost: None,
            ghost_name: String::new(),
            after: None,
            contacts: None,
            assets: None,
            used: None,
            loose: None,
            payload: None,
            things: Vec::new(),
            series: Vec::new(),
            notes: Vec::new(),
            eventful: false,
            text: None,
        }
    }

    /// The part from `from` to before `to`, s, as a piece of a stream.
    pub fn between(&self, from: f64, to: f64) -> Self {
        let inside = |times: &[f64]| times.partition_point(|t| *t < from)..times.partition_point(|t| *t < to);
        let frames = inside(&self.times);
        let thing = |thing: &Thing<'a>| Thing { object: thing.object, poses: thing.poses[frames.clone()].to_vec() };
        let series = |s: &Series| {
            let range = inside(&s.times);
            let width = s.lines.len();
            let values = s.values[range.start * width..range.end * width].to_vec();
            Series { path: s.path.clone(), times: s.times[range].to_vec(), values, lines: s.lines.clone() }
        };
        Scene {
            times: self.times[frames.clone()].to_vec(),
            bodies: self.bodies[frames.clone()].to_vec(),
            machine: self.machine,
            geometry: self.geometry,
            residual: self.residual.as_ref().map(|all| all[frames.clone()].to_vec()),
            ghost: self.ghost.as_ref().map(|all| all[frames.clone()].to_vec()),
            ghost_name: self.ghost_name.clone(),
            after: self.after.as_ref().map(|after| After {
                name: after.name.clone(),
                residual: after.residual[frames.clone()].to_vec(),
                ghost: after.ghost.as_ref().map(|all| all[frames.clone()].to_vec()),
            }),
            contacts: self.contacts.as_ref().map(|all| all[frames.clone()].to_vec()),
            assets: self.assets,
            used: self.used.as_ref().map(|all| all[frames.clone()].to_vec()),
            loose: self.loose.as_ref().map(|all| all[frames.clone()].to_vec()),
            payload: self.payload.clone(),
            things: self.things.iter().map(thing).collect(),
            series: self.series.iter().map(series).collect(),
            notes: self.notes.iter().filter(|n| n.t >= from && n.t < to).cloned().collect(),
            eventful: self.eventful,
            text: self.text.clone(),
        }
    }

    /// Checks the consistency of the numbers of values.
    pub(super) fn check(&self) -> Result<(), String> {
        let frames = self.times.len();
        let expect = |what: &str, count: usize, wanted: usize| {
            (count == wanted).then_some(()).ok_or_else(|| format!("{what}: {count} values for {wanted} times"))
        };
        expect("bodies", self.bodies.len(), frames)?;
        expect("residual", self.residual.as_ref().map_or(frames, Vec::len), frames)?;
        expect("ghost", self.ghost.as_ref().map_or(frames, Vec::len), frames)?;
        let after = self.after.as_ref();
        expect("later residual", after.map_or(frames, |after| after.residual.len()), frames)?;
        let ghost = after.and_then(|after| after.ghost.as_ref());
        expect("later ghost", ghost.map_or(frames, Vec::len), frames)?;
        expect("contacts", self.contacts.as_ref().map_or(frames, Vec::len), frames)?;
        expect("used hold", self.used.as_ref().map_or(frames, Vec::len), frames)?;
        expect("loose struts", self.loose.as_ref().map_or(frames, Vec::len), frames)?;
        self.things.iter().try_for_each(|thing| expect(&thing.object.name, thing.poses.len(), frames))?;
        self.series.iter().try_for_each(|s| expect(&s.path, s.values.len(), s.lines.len() * s.times.len()))
    }
}

/// Curves of the recorded signals: torques, joint angles, strut forces, socket margins.
pub fn measured(recording: &Recording) -> Vec<Series> {
    let s = &recording.signals;
    let mut series = Vec::new();
    series.extend(drives(s.mechanism, &s.t, |k| (s[Channel::Torque(k)].to_vec(), s[Channel::Angle(k)].to_vec())));
    for (channel, force) in s.series() {
        let (strut, end) = match channel {
            Channel::StrutUpper(strut) => (strut, 0),
            Channel::StrutLower(strut) => (strut, 1),
            _ => continue,
        };
        series.push(strut_force(strut, end, s.t.clone(), force.to_vec()));
    }
    let sockets: Option<Vec<&[f64]>> = Channel::of_sockets(s.mechanism).into_iter().map(|c| s.get(c)).collect();
    if let Some(sockets) = sockets.filter(|sockets| !sockets.is_empty()) {
        let rows: Vec<Vec<f64>> = (0..s.len()).map(|k| sockets.iter().map(|margin| margin[k]).collect()).collect();
        series.push(socket_margins(&s.t, s.mechanism.struts(), &rows.iter().map(Vec::as_slice).collect::<Vec<_>>()));
    }
    series
}

/// Curves of torques and joint angles; `of` returns both for an axis.
pub fn drives(machine: Mechanism, times: &[f64], of: impl Fn(usize) -> (Vec<f64>, Vec<f64>)) -> Vec<Series> {
    let (torque, angle) = (machine.unit(Unit::NM), machine.unit(Unit::Rad));
    let curve = |path: String, values, color, label: String| Series::new(path, times.to_vec(), values, color, label);
    let mut torques = Vec::new();
    let mut angles = Vec::new();
    for k in 0..machine.axes() {
        let (tau, q) = of(k);
        let axis = k + 1;
        torques.push(curve(format!("torque/axis{axis}/measured"), tau, AXIS[k], format!("measured [{torque}]")));
        angles.push(curve(format!("joints/axis{axis}/angle"), q, AXIS[k], format!("q{axis} [{angle}]")));
    }
    torques.append(&mut angles);
    torques
}

/// Curve of the axial force at the upper (`end` 0) or lower (1) end of strut `strut` (from 0).
///
/// # Panics
/// If `end` is neither 0 nor 1.
pub fn strut_force(strut: usize, end: usize, times: Vec<f64>, values: Vec<f64>) -> Series {
    let name = ENDS[end];
    let path = format!("struts/strut{}/{name}", strut + 1);
    Series::new(path, times, values, end_color(strut, end), format!("{name} end [N]"))
}

/// Colour of the limit of the margins.
const OFF: [u8; 3] = [225, 40, 60];
/// Names of the ends of a strut: at the elbow, at the platform.
const ENDS: [&str; 2] = ["upper", "lower"];

fn end_color(strut: usize, end: usize) -> [u8; 3] {
    shaded(strut / 2, [1.0, 0.6][end])
}

/// Curves of the axial forces at both ends of strut `strut` (from 0), `forces` at the upper and the lower end per time.
pub fn strut_forces(strut: usize, times: Vec<f64>, forces: impl Iterator<Item = [f64; 2]>) -> Series {
    let line = |end: usize| Line { color: end_color(strut, end), label: format!("{} end [N]", ENDS[end]) };
    let path = format!("struts/strut{}/force", strut + 1);
    Series { path, times, values: forces.flatten().collect(), lines: vec![line(0), line(1)] }
}

/// Curves of the margins of the sockets of a robot with this number of struts and of the limit, in one plot; `margins` per
/// time, of which the first 2·`struts` count.
pub fn socket_margins(times: &[f64], struts: usize, margins: &[&[f64]]) -> Series {
    let line = |s: usize| {
        let (strut, end) = (s % struts, s / struts);
        Line {
            color: shaded(strut / 2, 1.0 - 0.2 * (strut % 2) as f64 - 0.4 * end as f64),
            label: format!("strut {} {} [N]", strut + 1, ENDS[end]),
        }
    };
    let off = Line { color: OFF, label: "limit [N]".into() };
    let values = margins.iter().flat_map(|margins| margins[..2 * struts].iter().copied().chain([0.0])).collect();
    let lines = (0..2 * struts).map(line).chain([off]).collect();
    Series { path: "sockets/socket_margin/margins".into(), times: times.to_vec(), values, lines }
}

fn shaded(limb: usize, shade: f64) -> [u8; 3] {
    AXIS[limb].map(|c| (f64::from(c) * shade) as u8)
}

//! Content of a scene, independent of its source.

use nalgebra::{Isometry3, Vector3};

use super::AXIS;
use deltatwin::cell::{Object, Shape};
use deltatwin::machine::bodies::BODIES;
use deltatwin::machine::{AXES, Geometry, Mechanism, STRUTS, Unit};
use deltatwin::recording::Recording;
pub use deltatwin::recording::{Level, Note};

/// A moving robot, the objects around it, and curves.
pub struct Scene<'a> {
    /// Time of each frame, s, increasing; 50 frames per second are sufficient.
    pub times: Vec<f64>,
    /// Poses of the body frames in the inertial frame, one set per frame.
    pub bodies: Vec<[Isometry3<f64>; BODIES]>,
    /// Kind of machine.
    pub machine: Mechanism,
    /// Geometry of the robot.
    pub geometry: &'a Geometry,
    /// Torque residual per frame and axis, in standard deviations of the sensor noise; colours arms and telescope from
    /// green (noise) to red (6 σ).
    pub residual: Option<Vec<[f64; AXES]>>,
    /// Share of its hold that each socket uses, per frame: six at the elbows, six at the platform; 1 is the limit.
    pub used: Option<Vec<[f64; 2 * STRUTS]>>,
    /// Struts with an open socket, per frame.
    pub loose: Option<Vec<[bool; STRUTS]>>,
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

/// An object with its pose in every frame.
pub struct Thing<'a> {
    /// The object.
    pub object: &'a Object,
    /// Poses in the inertial frame, one per frame.
    pub poses: Vec<Isometry3<f64>>,
}

/// A curve over time.
#[derive(Clone, Debug)]
pub struct Series {
    /// Path of tab, plot and curve, e.g. `torque/axis1/measured`.
    pub path: String,
    /// Times, s.
    pub times: Vec<f64>,
    /// Values, one per time.
    pub values: Vec<f64>,
    /// Red, green, blue.
    pub color: [u8; 3],
    /// Legend with unit, e.g. `measured [N·m]`.
    pub label: String,
}

impl<'a> Scene<'a> {
    /// A machine without surroundings and curves, with poses `bodies` at `times` (s).
    pub fn new(
        machine: Mechanism,
        geometry: &'a Geometry,
        times: Vec<f64>,
        bodies: Vec<[Isometry3<f64>; BODIES]>,
    ) -> Self {
        Self {
            times,
            bodies,
            machine,
            geometry,
            residual: None,
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
            Series { times: s.times[range.clone()].to_vec(), values: s.values[range].to_vec(), ..s.clone() }
        };
        Scene {
            times: self.times[frames.clone()].to_vec(),
            bodies: self.bodies[frames.clone()].to_vec(),
            machine: self.machine,
            geometry: self.geometry,
            residual: self.residual.as_ref().map(|all| all[frames.clone()].to_vec()),
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
        expect("used hold", self.used.as_ref().map_or(frames, Vec::len), frames)?;
        expect("loose struts", self.loose.as_ref().map_or(frames, Vec::len), frames)?;
        self.things.iter().try_for_each(|thing| expect(&thing.object.name, thing.poses.len(), frames))?;
        self.series.iter().try_for_each(|s| expect(&s.path, s.values.len(), s.times.len()))
    }
}

/// Curves of the recorded signals: torques, joint angles, strut forces, socket margins.
pub fn measured(recording: &Recording) -> Vec<Series> {
    let s = &recording.signals;
    let mut series = Vec::new();
    series.extend(drives(s.mechanism, &s.t, |k| {
        (s.tau.iter().map(|v| v[k]).collect(), s.q.iter().map(|v| v[k]).collect())
    }));
    for (end, forces) in [&s.strut_upper, &s.strut_lower].into_iter().enumerate() {
        for (i, force) in forces.iter().enumerate() {
            let Some(force) = force else { continue };
            series.push(strut_force(i, end, s.t.clone(), force.clone()));
        }
    }
    if let Some(margins) = &s.socket_margin {
        series.extend(socket_margins(&s.t, margins));
    }
    series
}

/// Curves of torques and joint angles; `of` returns both for an axis.
pub fn drives(machine: Mechanism, times: &[f64], of: impl Fn(usize) -> (Vec<f64>, Vec<f64>)) -> Vec<Series> {
    let (torque, angle) = (machine.unit(Unit::NM), machine.unit(Unit::Rad));
    let curve =
        |path: String, values, color, label: String| Series { path, times: times.to_vec(), values, color, label };
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
    let name = ["upper", "lower"][end];
    Series {
        path: format!("struts/strut{}/{name}", strut + 1),
        times,
        values,
        color: shaded(strut / 2, [1.0, 0.6][end]),
        label: format!("{name} end [N]"),
    }
}

/// Curves of the margins of the twelve sockets, in one plot.
pub fn socket_margins(times: &[f64], margins: &[[f64; 2 * STRUTS]]) -> Vec<Series> {
    let curve = |s: usize| {
        let (strut, end) = (s % STRUTS, if s < STRUTS { "upper" } else { "lower" });
        Series {
            path: format!("sockets/socket_margin/strut{}_{end}", strut + 1),
            times: times.to_vec(),
            values: margins.iter().map(|m| m[s]).collect(),
            color: shaded(strut / 2, 1.0 - 0.2 * (strut % 2) as f64 - 0.4 * (s / STRUTS) as f64),
            label: format!("strut {} {end} [N]", strut + 1),
        }
    };
    (0..2 * STRUTS).map(curve).collect()
}

fn shaded(limb: usize, shade: f64) -> [u8; 3] {
    AXIS[limb].map(|c| (f64::from(c) * shade) as u8)
}

//! ROS 2 messages of a recording, with their definitions.
//!
//! Definitions follow `common_interfaces`, `geometry2` and `rcl_interfaces` of ROS 2 Humble to Jazzy, which agree.

use deltatwin::recording::Contact;
use nalgebra::{Isometry3, Vector3};

use super::cdr::{Reader, Writer};

/// Nanoseconds per second.
pub(super) const SECOND: i64 = 1_000_000_000;

/// Definition of a message type as stored in MCAP: its own fields, then those of every nested type.
pub(super) struct Definition {
    pub name: &'static str,
    pub text: &'static str,
}

macro_rules! types {
    ($($part:expr),+) => { concat!($($part, "================================================================================\n",)+ "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n") };
}

pub(super) const JOINT_STATE: Definition = Definition {
    name: "sensor_msgs/msg/JointState",
    text: types!(
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n",
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    ),
};

pub(super) const POINT: Definition = Definition {
    name: "geometry_msgs/msg/PointStamped",
    text: types!(
        "std_msgs/Header header\ngeometry_msgs/Point point\n",
        "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n",
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    ),
};

pub(super) const WRENCH: Definition = Definition {
    name: "geometry_msgs/msg/WrenchStamped",
    text: types!(
        "std_msgs/Header header\ngeometry_msgs/Wrench wrench\n",
        "MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
        "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    ),
};

pub(super) const TRAJECTORY: Definition = Definition {
    name: "trajectory_msgs/msg/JointTrajectory",
    text: types!(
        "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint[] points\n",
        "MSG: trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\n\
         float64[] accelerations\nfloat64[] effort\nbuiltin_interfaces/Duration time_from_start\n",
        "MSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n",
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    ),
};

pub(super) const TRANSFORMS: Definition = Definition {
    name: "tf2_msgs/msg/TFMessage",
    text: types!(
        "geometry_msgs/TransformStamped[] transforms\n",
        "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\nstring child_frame_id\n\
         geometry_msgs/Transform transform\n",
        "MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n",
        "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
        "MSG: geometry_msgs/Quaternion\nfloat64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    ),
};

pub(super) const CONTACTS: Definition = Definition {
    name: "gazebo_msgs/msg/ContactsState",
    text: types!(
        "std_msgs/Header header\ngazebo_msgs/ContactState[] states\n",
        "MSG: gazebo_msgs/ContactState\nstring info\nstring collision1_name\nstring collision2_name\n\
         geometry_msgs/Wrench[] wrenches\ngeometry_msgs/Wrench total_wrench\n\
         geometry_msgs/Vector3[] contact_positions\ngeometry_msgs/Vector3[] contact_normals\nfloat64[] depths\n",
        "MSG: geometry_msgs/Wrench\ngeometry_msgs/Vector3 force\ngeometry_msgs/Vector3 torque\n",
        "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
        "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    ),
};

pub(super) const LOG: Definition = Definition {
    name: "rcl_interfaces/msg/Log",
    text: types!(
        "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte FATAL=50\nbuiltin_interfaces/Time stamp\n\
         uint8 level\nstring name\nstring msg\nstring file\nstring function\nuint32 line\n"
    ),
};

pub(super) const STRING: Definition = Definition { name: "std_msgs/msg/String", text: "string data\n" };

/// Whether `name` is the known type, with or without `/msg/` between package and name.
pub(super) fn is_type(name: &str, known: &Definition) -> bool {
    name == known.name || name == known.name.replace("/msg/", "/")
}

fn stamp(w: &mut Writer, time: i64) {
    w.u32((time / SECOND) as u32);
    w.u32((time % SECOND) as u32);
}

fn header(w: &mut Writer, time: i64, frame: &str) {
    stamp(w, time);
    w.string(frame);
}

fn read_header(r: &mut Reader) -> Option<i64> {
    let (sec, nanosec) = (r.u32()? as i32, r.u32()?);
    r.string()?;
    Some(i64::from(sec) * SECOND + i64::from(nanosec))
}

/// A `sensor_msgs/msg/JointState` being read, without its numbers.
pub(super) struct RawState<'a> {
    /// ns since 1970-01-01 UTC.
    pub stamp: i64,
    /// Number of positions, velocities and efforts.
    pub counts: [usize; 3],
    names: &'a [u8],
    little: bool,
}

/// Which numbers of a joint state are wanted, and where they are appended: positions, velocities and efforts in this
/// order, or efforts alone.
pub(super) enum Numbers<'a> {
    All(&'a mut Vec<f64>),
    Efforts(&'a mut Vec<f64>),
}

/// The names of the joints of a message, as they are in its bytes.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct JointNames {
    bytes: Vec<u8>,
    little: bool,
}

impl<'a> RawState<'a> {
    /// The message, its numbers appended to `numbers`; `None` if it cannot be decoded.
    pub fn parse(data: &'a [u8], numbers: &mut Numbers) -> Option<Self> {
        let mut r = Reader::new(data)?;
        let stamp = read_header(&mut r)?;
        let names = r.raw_strings()?;
        let counts = match numbers {
            Numbers::All(out) => [r.numbers(Some(out))?, r.numbers(Some(out))?, r.numbers(Some(out))?],
            Numbers::Efforts(out) => [r.numbers(None)?, r.numbers(None)?, r.numbers(Some(out))?],
        };
        Some(Self { stamp, counts, names, little: r.is_little() })
    }

    /// Whether the joints have these names.
    pub fn has(&self, names: &JointNames) -> bool {
        self.names == names.bytes && self.little == names.little
    }

    /// The names of the joints.
    pub fn names(&self) -> JointNames {
        JointNames { bytes: self.names.to_vec(), little: self.little }
    }
}

impl JointNames {
    /// The names as texts.
    pub fn texts(&self) -> Vec<String> {
        Reader::bare(&self.bytes, self.little).strings().unwrap_or_default()
    }

    /// Size of the names, bytes.
    pub fn len(&self) -> usize {
        self.bytes.len()
    }
}

/// Encodes a `sensor_msgs/msg/JointState`.
pub(super) fn joint_state(time: i64, name: &[String], [position, velocity, effort]: [&[f64]; 3]) -> Vec<u8> {
    let mut w = Writer::default();
    header(&mut w, time, "");
    w.strings(name);
    w.f64s(position);
    w.f64s(velocity);
    w.f64s(effort);
    w.finish()
}

/// Encodes a `geometry_msgs/msg/PointStamped` in `frame`.
pub(super) fn point(time: i64, frame: &str, point: &[f64]) -> Vec<u8> {
    let mut w = Writer::default();
    header(&mut w, time, frame);
    point.iter().for_each(|x| w.f64(*x));
    w.finish()
}

/// Encodes a `geometry_msgs/msg/WrenchStamped` with a force in `frame`.
pub(super) fn wrench(time: i64, frame: &str, force: &[f64]) -> Vec<u8> {
    point(time, frame, &[force, &[0.0; 3]].concat())
}

/// Coordinates of a `geometry_msgs/msg/PointStamped`.
pub(super) fn parse_point(data: &[u8]) -> Option<[f64; 3]> {
    let mut r = Reader::new(data)?;
    read_header(&mut r)?;
    Some([r.f64()?, r.f64()?, r.f64()?])
}

/// Force of a `geometry_msgs/msg/WrenchStamped`, which begins as a point does.
pub(super) fn parse_force(data: &[u8]) -> Option<[f64; 3]> {
    parse_point(data)
}

/// Encodes a `trajectory_msgs/msg/JointTrajectory` with a single point that has accelerations only.
pub(super) fn accelerations(time: i64, joints: &[String], accelerations: &[f64]) -> Vec<u8> {
    let mut w = Writer::default();
    header(&mut w, time, "");
    w.strings(joints);
    w.u32(1);
    w.f64s(&[]);
    w.f64s(&[]);
    w.f64s(accelerations);
    w.f64s(&[]);
    stamp(&mut w, 0);
    w.finish()
}

/// Accelerations of the first point of a `trajectory_msgs/msg/JointTrajectory`.
pub(super) fn parse_accelerations(data: &[u8]) -> Option<Vec<f64>> {
    let mut r = Reader::new(data)?;
    read_header(&mut r)?;
    r.strings()?;
    if r.u32()? == 0 {
        return None;
    }
    r.f64s()?;
    r.f64s()?;
    r.f64s()
}

/// Encodes a `tf2_msgs/msg/TFMessage` with poses of frames in `parent`.
pub(super) fn transforms<'a>(
    time: i64,
    parent: &str,
    poses: impl ExactSizeIterator<Item = (&'a str, Isometry3<f64>)>,
) -> Vec<u8> {
    let mut w = Writer::default();
    w.u32(poses.len() as u32);
    for (child, pose) in poses {
        header(&mut w, time, parent);
        w.string(child);
        pose.translation.vector.iter().for_each(|x| w.f64(*x));
        // nalgebra stores (i, j, k, w), the order of the message.
        pose.rotation.coords.iter().for_each(|x| w.f64(*x));
    }
    w.finish()
}

/// Encodes a `gazebo_msgs/msg/ContactsState` in `frame`, with one point and its wrench per pair.
pub(super) fn contacts(time: i64, frame: &str, pairs: &[Contact]) -> Vec<u8> {
    let mut w = Writer::default();
    let vectors = |w: &mut Writer, all: &[&Vector3<f64>]| all.iter().copied().flatten().for_each(|x| w.f64(*x));
    let none = Vector3::zeros();
    header(&mut w, time, frame);
    w.u32(pairs.len() as u32);
    for Contact { bodies, at, normal, force } in pairs {
        w.string("");
        bodies.iter().for_each(|name| w.string(name));
        w.u32(1);
        // The wrench at the point, then the sum of them.
        vectors(&mut w, &[force, &none, force, &none]);
        for place in [at, normal] {
            w.u32(1);
            vectors(&mut w, &[place]);
        }
        w.f64s(&[]);
    }
    w.finish()
}

/// Contacts of a `gazebo_msgs/msg/ContactsState`: of every pair the first point with the sum of its forces.
pub(super) fn parse_contacts(data: &[u8]) -> Option<Vec<Contact>> {
    let mut r = Reader::new(data)?;
    read_header(&mut r)?;
    (0..r.u32()?).map(|_| parse_contact(&mut r)).collect()
}

fn parse_contact(r: &mut Reader) -> Option<Contact> {
    r.string()?;
    let bodies = [r.string()?, r.string()?];
    for _ in 0..r.u32()? {
        r.vector()?;
        r.vector()?;
    }
    let force = r.vector()?;
    r.vector()?;
    let (mut at, mut normal) = (None, None);
    for first in [&mut at, &mut normal] {
        for _ in 0..r.u32()? {
            let vector = r.vector()?;
            first.get_or_insert(vector);
        }
    }
    r.numbers(None)?;
    Some(Contact { bodies, at: at?, normal: normal.unwrap_or_default(), force })
}

/// Encodes a `rcl_interfaces/msg/Log`; `level` is 10, 20, 30, 40 or 50.
pub(super) fn log(time: i64, level: u8, text: &str) -> Vec<u8> {
    let mut w = Writer::default();
    stamp(&mut w, time);
    w.u8(level);
    w.string("deltatwin");
    w.string(text);
    w.string("");
    w.string("");
    w.u32(0);
    w.finish()
}

/// Encodes a `std_msgs/msg/String`.
pub(super) fn string(text: &str) -> Vec<u8> {
    let mut w = Writer::default();
    w.string(text);
    w.finish()
}

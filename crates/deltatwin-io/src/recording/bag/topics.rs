//! Topics of a recording, with the meaning of their messages.
//!
//! | topic | message | content |
//! |---|---|---|
//! | `/joint_states` | `sensor_msgs/msg/JointState` | `axis1…4`: angle, rate, torque at the gear output |
//! | `/loads` | `sensor_msgs/msg/JointState` | `load1…4`, effort: load at the output of an axis, N·m or N |
//! | `/strut_forces` | `sensor_msgs/msg/JointState` | `strut1_upper…strut6_lower`, effort: axial force, tension positive, N |
//! | `/socket_margins` | `sensor_msgs/msg/JointState` | `margin1_upper…margin6_lower`, effort: remaining force margin, N |
//! | `/multipliers` | `sensor_msgs/msg/JointState` | `lambda_…` of [`deltatwin::recording::multiplier_names`], effort: N or N·m |
//! | `/links` | `sensor_msgs/msg/JointState` | `link1…4`: angle and rate of the links behind elastic gears |
//! | `/end_effector` | `geometry_msgs/msg/PointStamped` | centre of the platform's ball plane in `base`, m |
//! | `/flange_force` | `geometry_msgs/msg/WrenchStamped` | force on the flange in `base`, N |
//! | `/joint_acceleration` | `trajectory_msgs/msg/JointTrajectory` | one point with accelerations, rad/s² |
//! | `/tf` | `tf2_msgs/msg/TFMessage` | poses of links and objects in `base` |
//! | `/contacts` | `gazebo_msgs/msg/ContactsState` | contacts of the robot in `base`: bodies, point, normal, force on the first |
//! | `/robot_description` | `std_msgs/msg/String` | URDF |
//! | `/events` | `rcl_interfaces/msg/Log` | events |
//!
//! Which channel is where follows from [`FAMILIES`]. Strut forces, margins, end effector and accelerations are also read
//! as JSON: `{"upper": [6], "lower": [6]}`, `{"x", "y", "z"}`, `{"acceleration": [axes]}`.

use serde::Deserialize;

use deltatwin::machine::{Mechanism, SixStruts};
use deltatwin::recording::{Channel, FAMILIES, Family, Field};

pub(super) const JOINTS: &str = "/joint_states";
pub(super) const TF: &str = "/tf";
pub(super) const CONTACTS: &str = "/contacts";
pub(super) const DESCRIPTION: &str = "/robot_description";
pub(super) const EVENTS: &str = "/events";

/// Frame in which poses, points and forces are given.
pub(super) const BASE: &str = "base";

/// Families of channels in the messages of a topic.
fn families(topic: &str) -> impl Iterator<Item = &'static Family> {
    const TABLE: &[Family] = &FAMILIES;
    TABLE.iter().filter(move |family| family.topic == topic)
}

/// Topics with channels, each once, the joint states last: they complete a sample.
pub(super) fn all() -> Vec<&'static str> {
    let mut topics: Vec<&str> = FAMILIES.iter().map(|family| family.topic).filter(|topic| *topic != JOINTS).collect();
    topics.dedup();
    topics.push(JOINTS);
    topics
}

/// Whether a topic accompanies the joint states.
pub(super) fn is_optional(topic: &str) -> bool {
    topic != JOINTS && families(topic).next().is_some()
}

/// Channels of a topic on a machine, in order, with their places in a message.
pub(super) fn channels(topic: &str, machine: Mechanism) -> impl Iterator<Item = (Field, Channel)> {
    families(topic).flat_map(move |family| family.channels(machine).map(|channel| (family.field, channel)))
}

/// Names of the joints in the messages of `channels` of one topic: those of axes and links where these move, else those
/// of the channels.
pub(super) fn names(channels: &[(Field, Channel)]) -> Vec<String> {
    let stem = match channels.first() {
        Some((_, Channel::LinkAngle(_) | Channel::LinkRate(_))) => "link",
        Some((field, channel)) if channel.family().is_of_axes() && *field != Field::Effort => "axis",
        _ => return channels.iter().map(|(_, channel)| channel.to_string()).collect(),
    };
    let first = channels[0].0;
    let one = channels.iter().filter(|(field, _)| *field == first);
    one.map(|(_, channel)| format!("{stem}{}", channel.index() + 1)).collect()
}

/// Values of [`channels`] in one message in JSON, `None` where not measured; `None` as a whole if it cannot be decoded.
pub(super) fn decode_json(topic: &str, data: &[u8]) -> Option<Vec<Option<f64>>> {
    let (field, first) = channels(topic, Mechanism::default()).next()?;
    match (field, first) {
        (_, Channel::StrutUpper(_) | Channel::MarginUpper(_)) => {
            let ends: Ends = serde_json::from_slice(data).ok()?;
            Some([ends.upper, ends.lower].concat())
        }
        (Field::Point, _) => {
            let p: Point = serde_json::from_slice(data).ok()?;
            Some([p.x, p.y, p.z].map(Some).to_vec())
        }
        (Field::Accelerations, _) => {
            let a: Acceleration = serde_json::from_slice(data).ok()?;
            Some(a.acceleration.into_iter().map(Some).collect())
        }
        _ => None,
    }
}

#[derive(Deserialize)]
struct Ends {
    upper: SixStruts<Option<f64>>,
    lower: SixStruts<Option<f64>>,
}

#[derive(Deserialize)]
struct Point {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Deserialize)]
struct Acceleration {
    acceleration: Vec<f64>,
}

//! Topics of a recording, with the meaning of their messages.
//!
//! | topic | message | content |
//! |---|---|---|
//! | `/joint_states` | `sensor_msgs/msg/JointState` | `axis1…4`: angle, rate, torque at the gear output |
//! | `/strut_forces` | `sensor_msgs/msg/JointState` | `strut1_upper…strut6_lower`, effort: axial force, tension positive, N |
//! | `/socket_margins` | `sensor_msgs/msg/JointState` | `margin1_upper…margin6_lower`, effort: remaining force margin, N |
//! | `/multipliers` | `sensor_msgs/msg/JointState` | `lambda_…` of [`multiplier_names`], effort: N or N·m |
//! | `/links` | `sensor_msgs/msg/JointState` | `link1…4`: angle and rate of the links behind elastic gears |
//! | `/end_effector` | `geometry_msgs/msg/PointStamped` | centre of the platform's ball plane in `base`, m |
//! | `/joint_acceleration` | `trajectory_msgs/msg/JointTrajectory` | one point with accelerations, rad/s² |
//! | `/tf` | `tf2_msgs/msg/TFMessage` | poses of links and objects in `base` |
//! | `/contacts` | `gazebo_msgs/msg/ContactsState` | contacts of the robot in `base`: bodies, point, normal, force on the first |
//! | `/robot_description` | `std_msgs/msg/String` | URDF |
//! | `/events` | `rcl_interfaces/msg/Log` | events |
//!
//! Strut forces, margins, end effector and accelerations are also read as JSON: `{"upper": [6], "lower": [6]}`, `{"x",
//! "y", "z"}`, `{"acceleration": [axes]}`.

use serde::Deserialize;

use deltatwin::machine::STRUTS;
use deltatwin::recording::multiplier_names;

use crate::recording::check;

pub(super) const JOINTS: &str = "/joint_states";
pub(super) const STRUT_FORCES: &str = "/strut_forces";
pub(super) const END_EFFECTOR: &str = "/end_effector";
pub(super) const ACCELERATION: &str = "/joint_acceleration";
pub(super) const SOCKET_MARGINS: &str = "/socket_margins";
pub(super) const MULTIPLIERS: &str = "/multipliers";
pub(super) const LINKS: &str = "/links";
pub(super) const TF: &str = "/tf";
pub(super) const CONTACTS: &str = "/contacts";
pub(super) const DESCRIPTION: &str = "/robot_description";
pub(super) const EVENTS: &str = "/events";

/// Frame in which poses and points are given.
pub(super) const BASE: &str = "base";

/// Topics that may accompany the joint states.
pub(super) const OPTIONAL: [&str; 6] = [STRUT_FORCES, END_EFFECTOR, ACCELERATION, SOCKET_MARGINS, MULTIPLIERS, LINKS];

/// Whether a topic accompanies the joint states.
pub(super) fn is_optional(topic: &str) -> bool {
    OPTIONAL.contains(&topic)
}

/// Columns of a topic, by their CSV names.
pub(super) fn columns(topic: &str, axes: usize) -> Vec<String> {
    match topic {
        STRUT_FORCES => strut_names(),
        SOCKET_MARGINS => check::margin_names().to_vec(),
        MULTIPLIERS => multiplier_names().to_vec(),
        LINKS => ["link_q", "link_qd"].iter().flat_map(|stem| (1..=axes).map(move |k| format!("{stem}{k}"))).collect(),
        END_EFFECTOR => ["ee_x", "ee_y", "ee_z"].map(String::from).to_vec(),
        _ => (1..=axes).map(|k| format!("qdd{k}")).collect(),
    }
}

/// Names of the strut forces, six at the elbows, then six at the platform.
pub(super) fn strut_names() -> Vec<String> {
    let names = |end| (1..=STRUTS).map(move |s| format!("strut{s}_{end}"));
    names("upper").chain(names("lower")).collect()
}

/// Values of [`columns`] in one message in JSON, `None` where not measured; `None` as a whole if it cannot be decoded.
pub(super) fn decode_json(topic: &str, data: &[u8]) -> Option<Vec<Option<f64>>> {
    match topic {
        MULTIPLIERS | LINKS => None,
        STRUT_FORCES | SOCKET_MARGINS => {
            let ends: Ends = serde_json::from_slice(data).ok()?;
            Some([ends.upper, ends.lower].concat())
        }
        END_EFFECTOR => {
            let p: Point = serde_json::from_slice(data).ok()?;
            Some([p.x, p.y, p.z].map(Some).to_vec())
        }
        _ => {
            let a: Acceleration = serde_json::from_slice(data).ok()?;
            Some(a.acceleration.into_iter().map(Some).collect())
        }
    }
}

#[derive(Deserialize)]
struct Ends {
    upper: [Option<f64>; STRUTS],
    lower: [Option<f64>; STRUTS],
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

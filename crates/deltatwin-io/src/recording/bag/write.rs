//! Recordings as MCAP with the profile `ros2`: every message is CDR of a standard type.

use std::collections::BTreeMap;
use std::path::Path;

use deltatwin::machine::STRUTS;
use deltatwin::recording::{Context, Level, Recording, Signals, multiplier_names};
use mcap::records::{MessageHeader, Metadata};

use super::messages::{self, Definition, JointState, SECOND};
use super::{EPOCH, MECHANISMS, topics};
use crate::file::{self, WriteError};
use crate::recording::{check, setup};

/// Last second that a ROS 2 time can represent.
const LAST: i64 = i32::MAX as i64;

/// Writes a recording with its context; times are rounded to nanoseconds.
///
/// # Errors
/// [`WriteError::Invalid`] for inconsistent signals or a time that ROS 2 cannot represent, [`WriteError::Io`] if the
/// file cannot be written.
pub fn write(path: &Path, recording: &Recording, context: &Context) -> Result<(), WriteError> {
    let signals = &recording.signals;
    check::columns(signals).map_err(|e| WriteError::invalid(path, e))?;
    let zero = signals.start.unwrap_or(EPOCH);
    let second = |t: f64| zero as f64 / 1e9 + t;
    if let Some(t) = signals.t.iter().find(|t| t.abs() >= 1e8 || !(0.0..LAST as f64).contains(&second(**t))) {
        return Err(WriteError::invalid(path, format!("time {t} s is out of range")));
    }
    file::replace(path, |out| {
        write_records(out, recording, zero, context).map_err(|e| match e {
            mcap::McapError::Io(e) => e,
            other => std::io::Error::other(other),
        })
    })
}

fn write_records<W: std::io::Write + std::io::Seek>(
    out: W,
    recording: &Recording,
    zero: i64,
    context: &Context,
) -> mcap::McapResult<()> {
    let signals = &recording.signals;
    let mut bag = Bag::new(out, zero)?;
    bag.metadata("setup", [("toml", setup::to_toml(&recording.setup))])?;
    bag.metadata("run", [("zero_ns", zero.to_string())])?;
    let machine = MECHANISMS.iter().find(|(_, m)| *m == signals.mechanism).map_or("", |(name, _)| name);
    bag.metadata("machine", [("mechanism", machine.into())])?;
    if !context.provenance.is_empty() {
        bag.metadata("provenance", context.provenance.iter().map(|(k, v)| (k.as_str(), v.clone())))?;
    }
    for a in &context.attachments {
        bag.writer.attach(&mcap::Attachment {
            log_time: zero as u64,
            create_time: zero as u64,
            name: a.name.clone(),
            media_type: a.media_type.clone(),
            data: a.content.as_slice().into(),
        })?;
    }
    let first = signals.t.first().copied().unwrap_or(0.0);
    if let Some(urdf) = &context.description {
        let id = bag.channel(topics::DESCRIPTION, &messages::STRING)?;
        bag.message(id, bag.time(first), &messages::string(urdf))?;
    }
    samples(&mut bag, signals, context)?;
    bag.writer.finish()?;
    Ok(())
}

/// Writes the samples, with poses and events in order of time.
fn samples<W: std::io::Write + std::io::Seek>(
    bag: &mut Bag<W>,
    signals: &Signals,
    context: &Context,
) -> mcap::McapResult<()> {
    let axes = signals.mechanism.axes();
    let joint_names: Vec<String> = (1..=axes).map(|k| format!("axis{k}")).collect();
    let joints = bag.channel(topics::JOINTS, &messages::JOINT_STATE)?;
    let (strut_names, strut_forces): (Vec<String>, Vec<&Vec<f64>>) = topics::strut_names()
        .into_iter()
        .zip(signals.strut_upper.iter().chain(&signals.strut_lower))
        .filter_map(|(name, force)| Some((name, force.as_ref()?)))
        .unzip();
    let margin_names = check::margin_names();
    let struts = bag.channel_if(!strut_names.is_empty(), topics::STRUT_FORCES, &messages::JOINT_STATE)?;
    let point = bag.channel_if(signals.ee.is_some(), topics::END_EFFECTOR, &messages::POINT)?;
    let acceleration = bag.channel_if(signals.qdd.is_some(), topics::ACCELERATION, &messages::TRAJECTORY)?;
    let margins = bag.channel_if(signals.socket_margin.is_some(), topics::SOCKET_MARGINS, &messages::JOINT_STATE)?;
    let multiplier_names = multiplier_names();
    let multipliers = bag.channel_if(signals.multipliers.is_some(), topics::MULTIPLIERS, &messages::JOINT_STATE)?;
    let link_names: Vec<String> = (1..=axes).map(|k| format!("link{k}")).collect();
    let links = signals.link_q.as_ref().zip(signals.link_qd.as_ref());
    let link = bag.channel_if(links.is_some(), topics::LINKS, &messages::JOINT_STATE)?;
    let tf = bag.channel_if(!context.poses.is_empty(), topics::TF, &messages::TRANSFORMS)?;
    let events = bag.channel_if(!context.events.is_empty(), topics::EVENTS, &messages::LOG)?;
    let (mut poses, mut notes) = (context.poses.iter().peekable(), context.events.iter().peekable());
    for i in 0..=signals.len() {
        // Poses and events after the last sample are written at the end.
        let until = signals.t.get(i).map_or(i64::MAX, |t| bag.time(*t));
        while let (Some(id), Some(p)) = (tf, poses.next_if(|p| bag.time(p.t) <= until)) {
            let time = bag.time(p.t);
            let frames = p.frames.iter().map(|(name, pose)| (name.as_str(), *pose));
            bag.message(id, time, &messages::transforms(time, topics::BASE, frames))?;
        }
        while let (Some(id), Some(note)) = (events, notes.next_if(|n| bag.time(n.t) <= until)) {
            let time = bag.time(note.t);
            bag.message(id, time, &messages::log(time, severity(note.level), &note.text))?;
        }
        if i == signals.len() {
            break;
        }
        // The joint states come last: they complete a sample.
        if let Some(id) = struts {
            let forces: Vec<f64> = strut_forces.iter().map(|f| f[i]).collect();
            bag.message(id, until, &JointState::encode(until, &strut_names, [&[], &[], &forces]))?;
        }
        if let (Some(id), Some(ee)) = (point, &signals.ee) {
            bag.message(id, until, &messages::point(until, topics::BASE, ee[i]))?;
        }
        if let (Some(id), Some(qdd)) = (acceleration, &signals.qdd) {
            bag.message(id, until, &messages::accelerations(until, &joint_names, &qdd[i][..axes]))?;
        }
        if let (Some(id), Some(margin)) = (margins, &signals.socket_margin) {
            let values: &[f64; 2 * STRUTS] = &margin[i];
            bag.message(id, until, &JointState::encode(until, &margin_names, [&[], &[], values]))?;
        }
        if let (Some(id), Some(values)) = (multipliers, &signals.multipliers) {
            bag.message(id, until, &JointState::encode(until, &multiplier_names, [&[], &[], &values[i]]))?;
        }
        if let (Some(id), Some((q, qd))) = (link, links) {
            let state = [&q[i][..axes], &qd[i][..axes], &[]];
            bag.message(id, until, &JointState::encode(until, &link_names, state))?;
        }
        let velocity = signals.qd.as_ref().map_or(&[][..], |qd| &qd[i][..axes]);
        let state = [&signals.q[i][..axes], velocity, &signals.tau[i][..axes]];
        bag.message(joints, until, &JointState::encode(until, &joint_names, state))?;
    }
    Ok(())
}

/// Level of `rcl_interfaces/msg/Log`.
fn severity(level: Level) -> u8 {
    match level {
        Level::Info => 20,
        Level::Warning => 30,
        Level::Error => 40,
    }
}

/// An MCAP file being written, with one chunk per second.
struct Bag<W: std::io::Write + std::io::Seek> {
    writer: mcap::Writer<W>,
    /// Instant of t = 0, ns since 1970.
    zero: i64,
    second: Option<i64>,
    /// Number of messages so far per channel.
    sequence: BTreeMap<u16, u32>,
}

impl<W: std::io::Write + std::io::Seek> Bag<W> {
    fn new(out: W, zero: i64) -> mcap::McapResult<Self> {
        let writer = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("deltatwin ", env!("CARGO_PKG_VERSION")))
            .compression(Some(mcap::Compression::Zstd))
            .chunk_size(Some(256 * 1024))
            .create(out)?;
        Ok(Self { writer, zero, second: None, sequence: BTreeMap::new() })
    }

    fn metadata<'k>(&mut self, name: &str, pairs: impl IntoIterator<Item = (&'k str, String)>) -> mcap::McapResult<()> {
        let metadata = pairs.into_iter().map(|(k, v)| (k.to_string(), v)).collect();
        self.writer.write_metadata(&Metadata { name: name.into(), metadata })
    }

    fn channel(&mut self, topic: &str, definition: &Definition) -> mcap::McapResult<u16> {
        let schema = self.writer.add_schema(definition.name, "ros2msg", definition.text.as_bytes())?;
        self.writer.add_channel(schema, topic, "cdr", &BTreeMap::new())
    }

    fn channel_if(&mut self, present: bool, topic: &str, definition: &Definition) -> mcap::McapResult<Option<u16>> {
        present.then(|| self.channel(topic, definition)).transpose()
    }

    /// Bag time of time `t` (s) of the run, ns since 1970.
    fn time(&self, t: f64) -> i64 {
        self.zero + (t * 1e9).round() as i64
    }

    fn message(&mut self, channel_id: u16, time: i64, data: &[u8]) -> mcap::McapResult<()> {
        if self.second.replace(time / SECOND).is_some_and(|s| s != time / SECOND) {
            self.writer.flush()?;
        }
        let sequence = self.sequence.entry(channel_id).or_default();
        let header =
            MessageHeader { channel_id, sequence: *sequence, log_time: time as u64, publish_time: time as u64 };
        *sequence += 1;
        self.writer.write_to_known_channel(&header, data)
    }
}

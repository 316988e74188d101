//! Recordings as MCAP with the profile `ros2`: every message is CDR of a standard type.
//!
//! Chunks are short and written whole, so that a file whose writer was killed ends with at most one incomplete chunk.

use std::collections::{BTreeMap, VecDeque};
use std::io::{Seek, Write};

use deltatwin::recording::{Channel, Contacts, Context, Field, Level, Note, Poses, Recording, Signals};
use mcap::records::{MessageHeader, Metadata};

use super::messages::{self, Definition, SECOND};
use super::{EPOCH, MECHANISMS, topics};
use crate::recording::recorder::Head;
use crate::recording::{check, setup};

/// Last second that a ROS 2 time can represent.
const LAST: i64 = i32::MAX as i64;
/// Size of the messages after which a chunk is written, bytes: a tenth of a second of four axes at 2.5 kHz.
const CHUNK: usize = 1 << 16;

/// Writes a whole recording with its context; times are rounded to nanoseconds.
///
/// # Errors
/// A description of inconsistent signals or of a time that ROS 2 cannot represent, or what the operating system says.
pub fn write(out: impl Write + Seek, recording: &Recording, context: &Context) -> std::io::Result<()> {
    let Recording { signals, setup, .. } = recording;
    let head = Head { mechanism: signals.mechanism, start: signals.start, setup, context };
    let mut bag = Writer::new(out, &head)?;
    bag.append(signals, &context.poses, &context.contacts, &context.events)?;
    bag.finish()
}

/// A bag being written.
pub(in crate::recording) struct Writer<W: Write + Seek> {
    bag: Bag<W>,
    description: Option<String>,
    /// Those of the samples, from the first sample on.
    topics: Option<Vec<Topic>>,
    poses: Track<Poses>,
    contacts: Track<Contacts>,
    /// Whether the last contacts that were written are any.
    touching: bool,
    notes: Track<Note>,
    /// Number of samples so far.
    samples: usize,
}

/// What happened between samples and is not written yet, with its channel.
struct Track<T> {
    channel: Option<u16>,
    waiting: VecDeque<T>,
}

impl<T> Default for Track<T> {
    fn default() -> Self {
        Self { channel: None, waiting: VecDeque::new() }
    }
}

impl<T> Track<T> {
    /// The channel, registered when it is first needed.
    fn channel<W: Write + Seek>(
        &mut self,
        bag: &mut Bag<W>,
        topic: &str,
        definition: &Definition,
    ) -> mcap::McapResult<u16> {
        match self.channel {
            Some(id) => Ok(id),
            None => Ok(*self.channel.insert(bag.channel(topic, definition)?)),
        }
    }
}

/// A topic of the samples.
struct Topic {
    id: u16,
    channels: Vec<(Field, Channel)>,
    /// Names of the joints in a message.
    names: Vec<String>,
}

impl<W: Write + Seek> Writer<W> {
    /// A bag that begins with what is known before the first sample.
    pub fn new(out: W, head: &Head) -> std::io::Result<Self> {
        Self::begin(out, head).map_err(plain)
    }

    fn begin(out: W, head: &Head) -> mcap::McapResult<Self> {
        let Context { provenance, attachments, description, .. } = head.context;
        let zero = head.start.unwrap_or(EPOCH);
        let mut bag = Bag::new(out, zero)?;
        bag.metadata("setup", [("toml", setup::to_toml(head.setup))])?;
        bag.metadata("run", [("zero_ns", zero.to_string())])?;
        let machine = MECHANISMS.iter().find(|(_, m)| *m == head.mechanism).map_or("", |(name, _)| name);
        bag.metadata("machine", [("mechanism", machine.into())])?;
        if !provenance.is_empty() {
            bag.metadata("provenance", provenance.iter().map(|(k, v)| (k.as_str(), v.clone())))?;
        }
        for a in attachments {
            bag.writer.attach(&mcap::Attachment {
                log_time: zero as u64,
                create_time: zero as u64,
                name: a.name.clone(),
                media_type: a.media_type.clone(),
                data: a.content.as_slice().into(),
            })?;
        }
        Ok(Self {
            bag,
            description: description.clone(),
            topics: None,
            poses: Track::default(),
            contacts: Track::default(),
            touching: false,
            notes: Track::default(),
            samples: 0,
        })
    }

    /// Appends samples with the poses, contacts and events among them, each in order of time.
    ///
    /// # Errors
    /// As [`write`].
    pub fn append(
        &mut self,
        signals: &Signals,
        poses: &[Poses],
        contacts: &[Contacts],
        notes: &[Note],
    ) -> std::io::Result<()> {
        check::check(signals, self.samples).map_err(std::io::Error::other)?;
        let second = |t: f64| self.bag.zero as f64 / 1e9 + t;
        if let Some(t) = signals.t.iter().find(|t| t.abs() >= 1e8 || !(0.0..LAST as f64).contains(&second(**t))) {
            return Err(std::io::Error::other(format!("time {t} s is out of range")));
        }
        self.poses.waiting.extend(poses.iter().cloned());
        self.contacts.waiting.extend(contacts.iter().cloned());
        self.notes.waiting.extend(notes.iter().cloned());
        self.samples(signals).map_err(plain)
    }

    /// Ends the chunk begun, so that everything appended so far is handed on.
    pub fn end_chunk(&mut self) -> std::io::Result<()> {
        self.bag.end_chunk().map_err(plain)
    }

    /// Writes what comes after the last sample, and the index.
    pub fn finish(mut self) -> std::io::Result<()> {
        self.until(i64::MAX).map_err(plain)?;
        self.bag.writer.finish().map_err(plain).map(drop)
    }

    fn samples(&mut self, signals: &Signals) -> mcap::McapResult<()> {
        if self.topics.is_none()
            && let Some(first) = signals.t.first()
        {
            if let Some(urdf) = self.description.take() {
                let id = self.bag.channel(topics::DESCRIPTION, &messages::STRING)?;
                self.bag.message(id, self.bag.time(*first), &messages::string(&urdf))?;
            }
            self.topics = Some(Topic::of(&mut self.bag, signals)?);
            // The definitions alone make the first chunk: without them, nothing could be read.
            self.bag.end_chunk()?;
        }
        for (i, t) in signals.t.iter().enumerate() {
            let time = self.bag.time(*t);
            self.until(time)?;
            for topic in self.topics.iter().flatten() {
                self.bag.message(topic.id, time, &topic.message(signals, i, time))?;
            }
        }
        self.samples += signals.len();
        Ok(())
    }

    /// Writes the poses, contacts and events up to `time`; contacts while there are any, and once that there are none.
    fn until(&mut self, time: i64) -> mcap::McapResult<()> {
        let Self { bag, poses, contacts, touching, notes, .. } = self;
        while poses.waiting.front().is_some_and(|p| bag.time(p.t) <= time) {
            let Some(Poses { t, frames }) = poses.waiting.pop_front() else { break };
            let id = poses.channel(bag, topics::TF, &messages::TRANSFORMS)?;
            let frames = frames.iter().map(|(name, pose)| (name.as_str(), *pose));
            bag.message(id, bag.time(t), &messages::transforms(bag.time(t), topics::BASE, frames))?;
        }
        while contacts.waiting.front().is_some_and(|c| bag.time(c.t) <= time) {
            let Some(Contacts { t, pairs }) = contacts.waiting.pop_front() else { break };
            if std::mem::replace(touching, !pairs.is_empty()) || *touching {
                let id = contacts.channel(bag, topics::CONTACTS, &messages::CONTACTS)?;
                bag.message(id, bag.time(t), &messages::contacts(bag.time(t), topics::BASE, &pairs))?;
            }
        }
        while notes.waiting.front().is_some_and(|n| bag.time(n.t) <= time) {
            let Some(Note { t, level, text }) = notes.waiting.pop_front() else { break };
            let id = notes.channel(bag, topics::EVENTS, &messages::LOG)?;
            bag.message(id, bag.time(t), &messages::log(bag.time(t), severity(level), &text))?;
        }
        Ok(())
    }
}

impl Topic {
    /// Registers the topics of the channels that `signals` have.
    fn of<W: Write + Seek>(bag: &mut Bag<W>, signals: &Signals) -> mcap::McapResult<Vec<Self>> {
        let mut found = Vec::new();
        for topic in topics::all() {
            let recorded = |(_, channel): &(Field, Channel)| signals.get(*channel).is_some();
            let channels: Vec<_> = topics::channels(topic, signals.mechanism).filter(recorded).collect();
            let Some((field, _)) = channels.first() else { continue };
            let definition = match field {
                Field::Position | Field::Velocity | Field::Effort => &messages::JOINT_STATE,
                Field::Accelerations => &messages::TRAJECTORY,
                Field::Point => &messages::POINT,
                Field::Force => &messages::WRENCH,
            };
            let names = topics::names(&channels);
            found.push(Self { id: bag.channel(topic, definition)?, channels, names });
        }
        Ok(found)
    }

    /// The message of sample `i`.
    fn message(&self, signals: &Signals, i: usize, time: i64) -> Vec<u8> {
        let of = |wanted: Field| -> Vec<f64> {
            let own = self.channels.iter().filter(|(field, _)| *field == wanted);
            own.map(|(_, channel)| signals[*channel][i]).collect()
        };
        match self.channels[0].0 {
            field @ Field::Accelerations => messages::accelerations(time, &self.names, &of(field)),
            field @ Field::Point => messages::point(time, topics::BASE, &of(field)),
            field @ Field::Force => messages::wrench(time, topics::BASE, &of(field)),
            Field::Position | Field::Velocity | Field::Effort => {
                let [position, velocity, effort] = [Field::Position, Field::Velocity, Field::Effort].map(of);
                messages::joint_state(time, &self.names, [&position, &velocity, &effort])
            }
        }
    }
}

/// Level of `rcl_interfaces/msg/Log`.
fn severity(level: Level) -> u8 {
    match level {
        Level::Info => 20,
        Level::Warning => 30,
        Level::Error => 40,
    }
}

fn plain(error: mcap::McapError) -> std::io::Error {
    match error {
        mcap::McapError::Io(e) => e,
        other => std::io::Error::other(other),
    }
}

/// An MCAP file being written, with a chunk per second or [`CHUNK`], whichever ends first.
struct Bag<W: Write + Seek> {
    writer: mcap::Writer<W>,
    /// Instant of t = 0, ns since 1970.
    zero: i64,
    second: Option<i64>,
    /// Size of the messages in the chunk begun, bytes.
    begun: usize,
    /// Number of messages so far per channel.
    sequence: BTreeMap<u16, u32>,
}

impl<W: Write + Seek> Bag<W> {
    fn new(out: W, zero: i64) -> mcap::McapResult<Self> {
        let writer = mcap::WriteOptions::new()
            .profile("ros2")
            .library(concat!("deltatwin ", env!("CARGO_PKG_VERSION")))
            .compression(Some(mcap::Compression::Zstd))
            .chunk_size(None)
            .disable_seeking(true)
            .create(out)?;
        Ok(Self { writer, zero, second: None, begun: 0, sequence: BTreeMap::new() })
    }

    fn metadata<'k>(&mut self, name: &str, pairs: impl IntoIterator<Item = (&'k str, String)>) -> mcap::McapResult<()> {
        let metadata = pairs.into_iter().map(|(k, v)| (k.to_string(), v)).collect();
        self.writer.write_metadata(&Metadata { name: name.into(), metadata })
    }

    fn channel(&mut self, topic: &str, definition: &Definition) -> mcap::McapResult<u16> {
        let schema = self.writer.add_schema(definition.name, "ros2msg", definition.text.as_bytes())?;
        self.writer.add_channel(schema, topic, "cdr", &BTreeMap::new())
    }

    /// Bag time of time `t` (s) of the run, ns since 1970.
    fn time(&self, t: f64) -> i64 {
        self.zero + (t * 1e9).round() as i64
    }

    fn message(&mut self, channel_id: u16, time: i64, data: &[u8]) -> mcap::McapResult<()> {
        let is_new_second = self.second.replace(time / SECOND).is_some_and(|s| s != time / SECOND);
        if is_new_second || self.begun >= CHUNK {
            self.end_chunk()?;
        }
        self.begun += data.len();
        let sequence = self.sequence.entry(channel_id).or_default();
        let header =
            MessageHeader { channel_id, sequence: *sequence, log_time: time as u64, publish_time: time as u64 };
        *sequence = sequence.wrapping_add(1);
        self.writer.write_to_known_channel(&header, data)
    }

    fn end_chunk(&mut self) -> mcap::McapResult<()> {
        self.begun = 0;
        self.writer.flush()
    }
}

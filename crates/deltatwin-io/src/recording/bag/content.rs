//! Content of a bag of any kind: messages by topic, decoded as they come, and the metadata of the run.

mod rows;
mod states;

use std::collections::{BTreeMap, HashMap, HashSet};
use std::path::Path;

pub(super) use self::rows::Rows;
pub(super) use self::states::{Shape, States};
use deltatwin::recording::Contact;

use super::messages::{self, JOINT_STATE, is_type, parse_contacts};
use super::topics;
use crate::recording::ReadError;

/// Number of topics that an error lists.
const TOLD: usize = 20;
/// Memory of a topic and of a message besides its text and numbers, bytes.
const TOPIC: usize = 300;
const MESSAGE: usize = 32;

/// Usable messages of a bag, independent of its file format.
pub(super) struct Content {
    /// Metadata records by name.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Usable topics in file order.
    pub streams: Vec<Stream>,
    /// Encoding of a topic with joint states that cannot be decoded.
    pub unread: Option<String>,
    /// Whether the file is truncated or damaged.
    pub cut: bool,
    wanted: Wanted,
    /// Names of all topics, and those that an error lists.
    topics: HashSet<String>,
    told: Vec<String>,
    /// Streams by topic and encoding.
    known: HashMap<(String, Encoding), usize>,
    /// Memory held and allowed, bytes.
    held: usize,
    allowed: usize,
}

/// The messages of one topic.
pub(super) struct Stream {
    pub topic: String,
    /// Log time of each message, ns, in file order.
    pub times: Vec<u64>,
    pub messages: Messages,
}

/// Decoded messages.
pub(super) enum Messages {
    /// Joint states of the robot or of another device.
    States(States),
    /// Values that accompany the joint states.
    Rows(Rows),
    /// Contacts of the robot.
    Contacts(Vec<Vec<Contact>>),
}

/// What of a bag is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wanted {
    /// Joint states and what accompanies them.
    Signals,
    /// Contacts of the robot.
    Contacts,
}

/// Encoding of the messages of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Encoding {
    Cdr,
    Json,
}

/// The content needs more memory than is allowed, bytes.
#[derive(Debug)]
pub(super) struct Full {
    pub allowed: usize,
}

impl Full {
    pub fn error(&self, path: &Path) -> ReadError {
        let problem = format!("its messages need more than {} MB of memory", self.allowed >> 20);
        ReadError::content(path, problem, "a shorter recording, or a larger --max-memory")
    }
}

impl Content {
    /// Nothing yet, which may grow to `allowed` bytes of memory.
    pub fn new(wanted: Wanted, allowed: usize) -> Self {
        Self {
            metadata: BTreeMap::new(),
            streams: Vec::new(),
            unread: None,
            cut: false,
            wanted,
            topics: HashSet::new(),
            told: Vec::new(),
            known: HashMap::new(),
            held: 0,
            allowed,
        }
    }

    /// The error of needing more memory than is allowed.
    pub fn full(&self) -> Full {
        Full { allowed: self.allowed }
    }

    /// Registers a topic; returns the index of its stream if it is usable.
    ///
    /// # Errors
    /// [`Full`] if there are too many.
    pub fn announce(&mut self, topic: &str, type_name: &str, encoding: &str) -> Result<Option<usize>, Full> {
        if !self.topics.contains(topic) {
            self.hold(topic.len() + TOPIC)?;
            self.topics.insert(topic.into());
            if self.told.len() < TOLD {
                self.told.push(topic.into());
            }
        }
        if self.wanted == Wanted::Contacts {
            let is_usable = encoding == "cdr" && topic == topics::CONTACTS && is_type(type_name, &messages::CONTACTS);
            return if is_usable { self.stream(topic, Encoding::Cdr).map(Some) } else { Ok(None) };
        }
        let is_state = is_type(type_name, &JOINT_STATE);
        let encoding = match encoding {
            "cdr" if is_state || topics::is_optional(topic) => Encoding::Cdr,
            "json" if topics::is_optional(topic) => Encoding::Json,
            other => {
                if is_state {
                    self.unread = Some(other.into());
                }
                return Ok(None);
            }
        };
        self.stream(topic, encoding).map(Some)
    }

    /// The stream of a topic in `encoding`, a new one if there is none.
    fn stream(&mut self, topic: &str, encoding: Encoding) -> Result<usize, Full> {
        let key = (topic.to_string(), encoding);
        if let Some(stream) = self.known.get(&key) {
            return Ok(*stream);
        }
        self.hold(topic.len() + TOPIC)?;
        let messages = match self.wanted {
            Wanted::Contacts => Messages::Contacts(Vec::new()),
            Wanted::Signals if topics::is_optional(topic) => Messages::Rows(Rows::new(topic, encoding)),
            Wanted::Signals => Messages::States(States::default()),
        };
        self.streams.push(Stream { topic: topic.into(), times: Vec::new(), messages });
        self.known.insert(key, self.streams.len() - 1);
        Ok(self.streams.len() - 1)
    }

    /// Appends a message to a stream; of values that accompany the joint states, only those that can be decoded.
    ///
    /// # Errors
    /// [`Full`] if memory does not suffice.
    pub fn push(&mut self, stream: usize, time: u64, data: &[u8]) -> Result<(), Full> {
        let Stream { times, messages, .. } = &mut self.streams[stream];
        let added = match messages {
            Messages::States(states) => Some(states.push(data)),
            Messages::Rows(rows) => rows.push(data),
            Messages::Contacts(all) => parse_contacts(data).map(|contacts| {
                let names = contacts.iter().flat_map(|c| &c.bodies).map(String::len).sum::<usize>();
                let bytes = size_of::<Vec<Contact>>() + contacts.len() * size_of::<Contact>() + names;
                all.push(contacts);
                bytes
            }),
        };
        if let Some(bytes) = added {
            times.push(time);
            self.hold(bytes + MESSAGE)?;
        }
        Ok(())
    }

    /// Counts memory, bytes.
    ///
    /// # Errors
    /// [`Full`] if it does not suffice.
    pub fn hold(&mut self, bytes: usize) -> Result<(), Full> {
        self.held += bytes;
        if self.held > self.allowed { Err(self.full()) } else { Ok(()) }
    }

    /// Names of the first topics, for an error.
    pub fn topics(&self) -> String {
        let more = self.topics.len() - self.told.len();
        self.told.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
    }

    /// Sorts the messages of every stream by log time, unless they are in order by their stamps; returns the number of
    /// those that were not at their place.
    pub fn sort(&mut self) -> usize {
        let mut moved = 0;
        for Stream { times, messages, .. } in &mut self.streams {
            if times.is_sorted() || matches!(messages, Messages::States(states) if states.is_sorted()) {
                continue;
            }
            let mut latest = 0;
            for &time in times.iter() {
                moved += usize::from(time < latest);
                latest = latest.max(time);
            }
            let mut order: Vec<usize> = (0..times.len()).collect();
            order.sort_by_key(|&i| times[i]);
            *times = order.iter().map(|&i| times[i]).collect();
            match messages {
                Messages::States(states) => states.reorder(&order),
                Messages::Rows(rows) => rows.reorder(&order),
                Messages::Contacts(all) => *all = order.iter().map(|&i| std::mem::take(&mut all[i])).collect(),
            }
        }
        moved
    }
}

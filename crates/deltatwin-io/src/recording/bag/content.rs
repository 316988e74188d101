//! Content of a bag of any kind: messages by topic, and the metadata of the run.

use std::collections::BTreeMap;

use super::messages::{JOINT_STATE, is_type};
use super::topics;

/// Usable messages of a bag, independent of its file format.
#[derive(Default)]
pub(super) struct Content {
    /// Metadata records by name.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
    /// Usable topics in file order.
    pub streams: Vec<Stream>,
    /// Names of all topics.
    pub topics: Vec<String>,
    /// Encoding of a topic with joint states that cannot be decoded.
    pub unread: Option<String>,
    /// Whether the file is truncated or damaged.
    pub cut: bool,
}

/// The messages of one topic.
pub(super) struct Stream {
    pub topic: String,
    pub encoding: Encoding,
    /// Log time (ns) and data in file order.
    pub messages: Vec<(u64, Vec<u8>)>,
}

/// Encoding of the messages of a topic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    Cdr,
    Json,
}

impl Content {
    /// Registers a topic; returns the index of its stream if it is usable.
    pub fn announce(&mut self, topic: &str, type_name: &str, encoding: &str) -> Option<usize> {
        if !self.topics.iter().any(|t| t == topic) {
            self.topics.push(topic.into());
        }
        let is_state = is_type(type_name, &JOINT_STATE);
        let encoding = match encoding {
            "cdr" if is_state || topics::is_optional(topic) => Encoding::Cdr,
            "json" if topics::is_optional(topic) => Encoding::Json,
            other => {
                if is_state {
                    self.unread = Some(other.into());
                }
                return None;
            }
        };
        let same = |s: &Stream| s.topic == topic && s.encoding == encoding;
        Some(self.streams.iter().position(same).unwrap_or_else(|| {
            self.streams.push(Stream { topic: topic.into(), encoding, messages: Vec::new() });
            self.streams.len() - 1
        }))
    }

    /// Appends the content of a later part of the same bag.
    pub fn append(&mut self, part: Self) {
        self.metadata.extend(part.metadata);
        for stream in part.streams {
            match self.streams.iter_mut().find(|s| s.topic == stream.topic && s.encoding == stream.encoding) {
                Some(own) => own.messages.extend(stream.messages),
                None => self.streams.push(stream),
            }
        }
        for topic in part.topics {
            if !self.topics.contains(&topic) {
                self.topics.push(topic);
            }
        }
        self.unread = self.unread.take().or(part.unread);
        self.cut |= part.cut;
    }
}

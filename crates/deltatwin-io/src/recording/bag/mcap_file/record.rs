//! Records of MCAP: an opcode, a length of eight bytes and fields; parsed strictly, so that damage shows.
//!
//! Layout: specification of MCAP version 0, <https://mcap.dev/spec>.

use std::collections::BTreeMap;

/// Size of opcode and length, bytes.
pub const HEADER: u64 = 9;
/// Size of the fields of a chunk before its compression and its records, bytes.
const CHUNK_FIELDS: u64 = 28 + 4 + 8;

pub const CHUNK: u8 = 0x06;

/// A record whose fields fill it exactly.
pub enum Record<'a> {
    Schema {
        id: u16,
        name: String,
    },
    Channel {
        id: u16,
        schema: u16,
        topic: String,
        encoding: String,
    },
    Message {
        channel: u16,
        time: u64,
        data: &'a [u8],
    },
    Chunk(Chunk<'a>),
    /// Log times of a channel's messages in the chunk before, ns.
    MessageIndex {
        channel: u16,
        times: Vec<u64>,
    },
    Statistics {
        messages: BTreeMap<u16, u64>,
    },
    Metadata {
        name: String,
        pairs: BTreeMap<String, String>,
    },
    /// The end of the data, or of the file.
    End,
    /// One that holds nothing of the recording.
    Other,
}

/// A chunk: records, usually compressed.
pub struct Chunk<'a> {
    /// Smallest and largest log time, ns.
    pub times: (u64, u64),
    /// Size of the records, bytes.
    pub size: u64,
    /// CRC-32 of the records, 0 if unknown.
    pub crc: u32,
    pub compression: String,
    pub records: &'a [u8],
}

impl<'a> Record<'a> {
    /// The record with this `opcode` and `body`; `None` if it is damaged.
    pub fn parse(opcode: u8, body: &'a [u8]) -> Option<Self> {
        let mut fields = Fields(body);
        let record = match opcode {
            0x01 => {
                fields.string()?;
                fields.string()?;
                Self::Other
            }
            0x02 => {
                fields.take(20)?;
                Self::End
            }
            0x03 => {
                let (id, name) = (fields.u16()?, fields.string()?);
                fields.string()?;
                fields.block()?;
                Self::Schema { id, name }
            }
            0x04 => {
                let (id, schema) = (fields.u16()?, fields.u16()?);
                let (topic, encoding) = (fields.string()?, fields.string()?);
                fields.block()?;
                Self::Channel { id, schema, topic, encoding }
            }
            0x05 => {
                let channel = fields.u16()?;
                fields.take(4)?;
                let time = fields.u64()?;
                fields.take(8)?;
                Self::Message { channel, time, data: std::mem::take(&mut fields.0) }
            }
            CHUNK => Self::Chunk(fields.chunk()?),
            0x07 => {
                let channel = fields.u16()?;
                let entries = fields.block()?;
                let (entries, rest) = entries.as_chunks::<16>();
                if !rest.is_empty() {
                    return None;
                }
                let time = |entry: &[u8; 16]| entry.first_chunk().map(|time| u64::from_le_bytes(*time));
                Self::MessageIndex { channel, times: entries.iter().filter_map(time).collect() }
            }
            0x0b => {
                fields.take(8 + 2 + 4 * 4 + 2 * 8)?;
                let mut counts = Fields(fields.block()?);
                let mut messages = BTreeMap::new();
                while !counts.0.is_empty() {
                    messages.insert(counts.u16()?, counts.u64()?);
                }
                Self::Statistics { messages }
            }
            0x0c => {
                let name = fields.string()?;
                let mut entries = Fields(fields.block()?);
                let mut pairs = BTreeMap::new();
                while !entries.0.is_empty() {
                    pairs.insert(entries.string()?, entries.string()?);
                }
                Self::Metadata { name, pairs }
            }
            0x0f => {
                fields.take(4)?;
                Self::End
            }
            // Attachments, indexes of the summary, and private records.
            0x08..=0x0a | 0x0d | 0x0e | 0x80.. => return Some(Self::Other),
            _ => return None,
        };
        fields.0.is_empty().then_some(record)
    }
}

/// Whether records with this `opcode` hold nothing that is read.
pub fn is_skipped(opcode: u8) -> bool {
    matches!(opcode, 0x08..=0x0a | 0x0d | 0x0e | 0x80..)
}

/// Whether `start`, the beginning of a body of `length` bytes, can be that of a chunk.
pub fn starts_chunk(start: &[u8], length: u64) -> bool {
    let mut fields = Fields(start);
    let mut sizes = || -> Option<bool> {
        let (first, last) = (fields.u64()?, fields.u64()?);
        fields.take(12)?;
        let compression = fields.string()?;
        let stated = fields.u64()?;
        let known = ["", "zstd", "lz4"].contains(&compression.as_str());
        Some(known && first <= last && stated.checked_add(CHUNK_FIELDS + compression.len() as u64) == Some(length))
    };
    sizes().unwrap_or(false)
}

/// Fields yet to be read; every read past the end is `None`.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.take(N)?.try_into().ok()
    }

    fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    /// Bytes after their number.
    fn block(&mut self) -> Option<&'a [u8]> {
        let count = self.u32()? as usize;
        self.take(count)
    }

    fn string(&mut self) -> Option<String> {
        std::str::from_utf8(self.block()?).ok().map(String::from)
    }

    fn chunk(&mut self) -> Option<Chunk<'a>> {
        let times = (self.u64()?, self.u64()?);
        let (size, crc, compression) = (self.u64()?, self.u32()?, self.string()?);
        let count = usize::try_from(self.u64()?).ok()?;
        Some(Chunk { times, size, crc, compression, records: self.take(count)? })
    }
}

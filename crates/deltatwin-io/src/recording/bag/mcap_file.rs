//! Bags in MCAP, including truncated or damaged ones.

use std::collections::HashMap;
use std::path::Path;

use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::EXPECTED;
use super::content::Content;
use crate::recording::ReadError;

/// First bytes of an MCAP file.
pub(super) const MAGIC: &[u8] = b"\x89MCAP0\r\n";
/// Size above which records and chunks count as damaged, bytes.
const LARGEST_RECORD: usize = 256 << 20;

/// Reads a file up to its end or its last complete chunk.
pub(super) fn read(path: &Path, warnings: &mut Vec<String>) -> Result<Content, ReadError> {
    let bytes = std::fs::read(path).map_err(|e| ReadError::io(path, e))?;
    if bytes.is_empty() {
        return Err(ReadError::content(path, "is empty", EXPECTED));
    }
    if !bytes.starts_with(MAGIC) {
        return Err(ReadError::content(path, "is not an MCAP file", EXPECTED));
    }
    Ok(collect(&bytes, warnings))
}

fn collect(bytes: &[u8], warnings: &mut Vec<String>) -> Content {
    let mut found = Content::default();
    let mut schemas: HashMap<u16, String> = HashMap::new();
    let mut channels: HashMap<u16, usize> = HashMap::new();
    let mut ended = false;
    for record in Records::new(bytes) {
        let record = match record {
            Ok(record) => record,
            Err(e) => {
                if !ended {
                    warnings.push(format!("file is cut short or damaged: {e}"));
                    found.cut = true;
                }
                ended = true;
                break;
            }
        };
        match record {
            Record::Schema { header, .. } => {
                schemas.insert(header.id, header.name);
            }
            Record::Channel(c) => {
                let type_name = schemas.get(&c.schema_id).map_or("", String::as_str);
                if let Some(stream) = found.announce(&c.topic, type_name, &c.message_encoding) {
                    channels.insert(c.id, stream);
                }
            }
            Record::Message { header, data } => {
                if let Some(&stream) = channels.get(&header.channel_id) {
                    found.streams[stream].messages.push((header.log_time, data.into_owned()));
                }
            }
            Record::Metadata(m) => {
                found.metadata.insert(m.name, m.metadata);
            }
            Record::DataEnd(_) => ended = true,
            _ => {}
        }
    }
    if !ended {
        warnings.push("file is cut short: it ends without a footer".into());
        found.cut = true;
    }
    found
}

/// Iterator over the records of a file, including those inside chunks.
struct Records<'a> {
    rest: &'a [u8],
    reader: LinearReader,
}

impl<'a> Records<'a> {
    fn new(content: &'a [u8]) -> Self {
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(LARGEST_RECORD);
        Self { rest: content, reader: LinearReader::new_with_options(options) }
    }
}

impl Iterator for Records<'_> {
    type Item = mcap::McapResult<Record<'static>>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            match self.reader.next_event()? {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    let (now, rest) = self.rest.split_at(wanted.min(self.rest.len()));
                    self.reader.insert(now.len()).copy_from_slice(now);
                    self.reader.notify_read(now.len());
                    self.rest = rest;
                }
                Ok(LinearReadEvent::Record { data, opcode }) => {
                    return Some(mcap::read::parse_record(opcode, data).map(Record::into_owned));
                }
                Err(e) => return Some(Err(e)),
            }
        }
    }
}

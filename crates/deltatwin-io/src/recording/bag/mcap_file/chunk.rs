//! Content of a chunk, decompressed within bounds.

use std::borrow::Cow;
use std::io::Read;

use super::record::Chunk;

/// Most bytes that a file may expand to, per byte of it: ten times what joint states at rest compress to.
const MOST_EXPANSION: u64 = 100;
/// What even the shortest file may expand to, bytes.
const FREE: u64 = 16 << 20;

/// Bytes that the chunks of a file may still expand to.
pub struct Allowance(u64);

/// Why a chunk was left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// It cannot be decompressed, or its content is not what was written.
    Damaged,
    /// It is longer than the file can justify.
    Bloated,
}

impl Allowance {
    /// That of a file of `length` bytes.
    pub fn of(length: u64) -> Self {
        Self(length.saturating_mul(MOST_EXPANSION).saturating_add(FREE))
    }

    /// Allows for `length` more bytes of a file that grows.
    pub fn grow(&mut self, length: u64) {
        self.0 = self.0.saturating_add(length.saturating_mul(MOST_EXPANSION));
    }

    /// The records of `chunk`; memory grows with what is there, not with the size that is stated.
    pub fn records<'a>(&mut self, chunk: &Chunk<'a>) -> Result<Cow<'a, [u8]>, Fault> {
        let records: Cow<[u8]> = match chunk.compression.as_str() {
            "" => chunk.records.into(),
            "zstd" => {
                let reader = zstd::stream::read::Decoder::with_buffer(chunk.records).map_err(|_| Fault::Damaged)?;
                self.expanded(reader, chunk.size)?.into()
            }
            "lz4" => {
                let reader = lz4::Decoder::new(chunk.records).map_err(|_| Fault::Damaged)?;
                self.expanded(reader, chunk.size)?.into()
            }
            _ => return Err(Fault::Damaged),
        };
        let is_whole = records.len() as u64 == chunk.size;
        let is_same = chunk.crc == 0 || crc32fast::hash(&records) == chunk.crc;
        if is_whole && is_same { Ok(records) } else { Err(Fault::Damaged) }
    }

    fn expanded(&mut self, reader: impl Read, stated: u64) -> Result<Vec<u8>, Fault> {
        if stated > self.0 {
            return Err(Fault::Bloated);
        }
        let mut out = Vec::new();
        // One more than stated, so that a longer content shows.
        let ended = reader.take(stated + 1).read_to_end(&mut out);
        self.0 = self.0.saturating_sub(out.len() as u64);
        ended.map_err(|_| Fault::Damaged)?;
        Ok(out)
    }
}

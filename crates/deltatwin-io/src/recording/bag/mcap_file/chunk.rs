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
            "lz4" => self.expanded(lz4_flex::frame::FrameDecoder::new(chunk.records), chunk.size)?.into(),
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

#[cfg(test)]
mod tests {
    use base64::Engine;
    use base64::prelude::BASE64_STANDARD;

    use super::*;

    /// "0;1;4;9; … 3481;" three times, by the reference implementation (1.9.4): linked blocks, all checksums, size stated.
    const FRAME: &str = "BCJNGHxA+gIAAAAAAADB/AAAAPBhMDsxOzQ7OTsxNjsyNTszNjs0OTs2NDs4MTsxMDA7MTIxOzE0NDsxNjk7MTk2OzIyNTsyNTY7\
        Mjg5OzMyNDszNjE7NDAwOzQ0MTs0ODQ7NTI5OzU3Njs2MjU7Njc2OzcyOTs3ODQ7ODQxOzkwMDs5NlgA4DI0OzEwODk7MTE1NjsxVABwMTI5NjsxM2YAEDRv\
        ABA1eAAQNoEAEDaKAHA3NjQ7MTg0hABQMzY7MjCGABAxsgDwBjIwOTsyMzA0OzI0MDE7MjUwMDsyNgoAEDcUABA4HgBQOTE2OzMyAEAzMTM2tQDPOTszMzY0\
        OzM0ODE7/gD/5VAzNDgxOxXLRlgAAAAApme+Kw==";

    fn records(frame: &[u8], size: u64) -> Result<Vec<u8>, Fault> {
        let chunk = Chunk { times: (0, 0), size, crc: 0, compression: "lz4".into(), records: frame };
        Allowance::of(frame.len() as u64).records(&chunk).map(Cow::into_owned)
    }

    #[test]
    fn a_frame_of_the_reference_implementation_of_lz4_is_read() {
        let frame = BASE64_STANDARD.decode(FRAME).unwrap();
        let squares: String = (0..60).map(|k| format!("{};", k * k)).collect();
        assert_eq!(records(&frame, 762).unwrap(), squares.repeat(3).into_bytes());
        // Shorter than stated, cut, and with one bit changed in a block.
        assert_eq!(records(&frame, 763), Err(Fault::Damaged));
        assert_eq!(records(&frame[..200], 762), Err(Fault::Damaged));
        let mut changed = frame;
        changed[40] ^= 1;
        assert_eq!(records(&changed, 762), Err(Fault::Damaged));
    }
}

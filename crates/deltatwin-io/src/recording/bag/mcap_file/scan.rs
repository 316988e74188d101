//! Records of a file one after the other, beyond damaged places.

use std::io::{self, Read, Seek, SeekFrom};
use std::ops::Range;

use super::record::{CHUNK, HEADER, Record, is_skipped, starts_chunk};

/// Size up to which a record that is no chunk can be found again behind a damaged place, bytes.
const FINDABLE: u64 = 1 << 20;
/// Size above which a record counts as damaged, bytes.
const LARGEST: u64 = 256 << 20;
/// Bytes read in search of records, per byte of the file, after which only chunks are found.
const MOST_SEARCH: u64 = 4;
/// Number of bytes of a chunk that tell whether it is one.
const CHUNK_START: usize = 64;
/// Number of bytes that are searched at once.
const WINDOW: usize = 1 << 16;

/// What is at a place of a file.
pub enum Place {
    /// The record of this opcode with its body in [`Scan::body`].
    Record(u8),
    /// Bytes that are no records, up to the next record.
    Damage(Range<u64>),
    /// The end; of a file that is cut short with the number of bytes of its last, incomplete record.
    End { incomplete: u64 },
}

/// A file being read from record to record.
pub struct Scan<R> {
    source: R,
    at: u64,
    end: u64,
    /// Begin of the last record, unless it is known to be intact: behind a damaged length, what follows is no record.
    doubtful: Option<u64>,
    body: Vec<u8>,
    /// Bytes that may still be read in search of records behind damaged places.
    search: u64,
}

impl<R: Read + Seek> Scan<R> {
    /// The records from `at` on in `source`, which has `end` bytes of records.
    pub fn new(source: R, at: u64, end: u64) -> Self {
        Self { source, at, end, doubtful: None, body: Vec::new(), search: MOST_SEARCH.saturating_mul(end) }
    }

    /// Where the next record begins.
    pub fn at(&self) -> u64 {
        self.at
    }

    /// The body of the last record.
    pub fn body(&self) -> &[u8] {
        &self.body
    }

    /// Tells that the last record was intact, as a checksum says.
    pub fn trust(&mut self) {
        self.doubtful = None;
    }

    /// Tells that the last record was none.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn mistrust(&mut self) -> io::Result<Place> {
        let from = self.doubtful.take().unwrap_or(self.at);
        self.behind(from)
    }

    /// The next record or damaged place; records that are not read have no body.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn next(&mut self) -> io::Result<Place> {
        let from = self.at;
        if self.end - from < HEADER {
            return Ok(Place::End { incomplete: self.end - from });
        }
        let (opcode, length) = self.header(from)?;
        if !(0x01..=0x0f).contains(&opcode) && opcode < 0x80 {
            return self.mistrust();
        }
        if length > self.end - from - HEADER {
            // A damaged length, or the last record of a file that is cut short.
            let place = self.mistrust()?;
            return Ok(match place {
                Place::Damage(range) if range.end == self.end && range.start == from => {
                    Place::End { incomplete: self.end - from }
                }
                other => other,
            });
        }
        if length > LARGEST {
            return self.mistrust();
        }
        self.doubtful = Some(from);
        self.body.clear();
        if is_skipped(opcode) {
            self.source.seek(SeekFrom::Current(length as i64))?;
        } else {
            (&mut self.source).take(length).read_to_end(&mut self.body)?;
        }
        self.at = from + HEADER + length;
        Ok(Place::Record(opcode))
    }

    /// Opcode and length of the record at `from`; reading goes on behind them.
    fn header(&mut self, from: u64) -> io::Result<(u8, u64)> {
        self.source.seek(SeekFrom::Start(from))?;
        let mut bytes = [0; HEADER as usize];
        self.source.read_exact(&mut bytes)?;
        let [opcode, length @ ..] = bytes;
        Ok((opcode, u64::from_le_bytes(length)))
    }

    /// The damaged place from `from` to the next record behind it, where reading goes on.
    fn behind(&mut self, from: u64) -> io::Result<Place> {
        self.doubtful = None;
        let mut window = vec![0; WINDOW + CHUNK_START];
        let mut start = from + 1;
        while start < self.end {
            self.source.seek(SeekFrom::Start(start))?;
            let wanted = window.len().min((self.end - start) as usize);
            self.source.read_exact(&mut window[..wanted])?;
            for offset in 0..wanted.min(WINDOW) {
                if self.begins_record(start + offset as u64, &window[offset..wanted])? {
                    self.at = start + offset as u64;
                    return Ok(Place::Damage(from..self.at));
                }
            }
            start += WINDOW as u64;
        }
        self.at = self.end;
        Ok(Place::Damage(from..self.end))
    }

    /// Whether an intact record begins at `at`, where `bytes` are.
    fn begins_record(&mut self, at: u64, bytes: &[u8]) -> io::Result<bool> {
        let Some((&opcode, rest)) = bytes.split_first() else { return Ok(false) };
        // Skipped records are not parsed: nothing would tell them from noise.
        if !(0x02..=0x0f).contains(&opcode) || is_skipped(opcode) {
            return Ok(false);
        }
        let Some((length, start)) = rest.split_first_chunk::<8>() else { return Ok(false) };
        let length = u64::from_le_bytes(*length);
        if length > self.end - at - HEADER {
            return Ok(false);
        }
        if opcode == CHUNK {
            return Ok(starts_chunk(start, length));
        }
        // An empty record of a few zeros is likely by chance.
        if !(4..=FINDABLE).contains(&length) || self.search < length {
            return Ok(false);
        }
        self.search -= length;
        let mut body = vec![0; length as usize];
        self.source.seek(SeekFrom::Start(at + HEADER))?;
        self.source.read_exact(&mut body)?;
        if Record::parse(opcode, &body).is_none() {
            return Ok(false);
        }
        // Any bytes are a message: what follows must be a record, too.
        let next = at + HEADER + length;
        if next == self.end {
            return Ok(true);
        }
        if self.end - next < HEADER {
            return Ok(false);
        }
        let (opcode, length) = self.header(next)?;
        Ok((0x02..=0x0f).contains(&opcode) && length <= self.end - next - HEADER)
    }
}

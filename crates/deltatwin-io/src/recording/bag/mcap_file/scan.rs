//! Records of a file one after the other, beyond damaged places; of one that grows as far as it is there.

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
    /// The end; of a file that is cut short or grows with the number of bytes of its last, incomplete record.
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
    /// Whether more bytes may follow.
    grows: bool,
    /// A damaged place whose end is not there yet: its begin, and from where the search goes on.
    lost: Option<(u64, u64)>,
    /// Up to where no record was found behind an incomplete one.
    looked: u64,
}

/// The last bytes of a file that grows.
#[derive(Default)]
pub struct Window {
    bytes: Vec<u8>,
    /// Place of the first of them in the file.
    base: u64,
    at: u64,
}

impl Read for Window {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let begin = usize::try_from(self.at.saturating_sub(self.base)).unwrap_or(usize::MAX);
        let count = self.bytes.get(begin..).unwrap_or_default().read(out)?;
        self.at += count as u64;
        Ok(count)
    }
}

impl Seek for Window {
    fn seek(&mut self, place: SeekFrom) -> io::Result<u64> {
        let (from, by) = match place {
            SeekFrom::Start(at) => (at, 0),
            SeekFrom::Current(by) => (self.at, by),
            SeekFrom::End(by) => (self.base + self.bytes.len() as u64, by),
        };
        self.at = from.checked_add_signed(by).ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at)
    }
}

impl Scan<Window> {
    /// The records from `at` on in a file that grows and is empty yet.
    pub fn growing(at: u64) -> Self {
        Self { grows: true, ..Self::new(Window::default(), at, 0) }
    }

    /// Appends bytes of the file, and forgets those that are done with.
    pub fn grow(&mut self, bytes: &[u8]) {
        let needed = self.lost.map_or(self.doubtful.unwrap_or(self.at), |(_, from)| from);
        let window = &mut self.source;
        let done = usize::try_from(needed.saturating_sub(window.base)).unwrap_or(usize::MAX).min(window.bytes.len());
        window.bytes.drain(..done);
        window.base += done as u64;
        window.bytes.extend(bytes);
        self.end += bytes.len() as u64;
        self.search = self.search.saturating_add(MOST_SEARCH.saturating_mul(bytes.len() as u64));
    }
}

impl<R: Read + Seek> Scan<R> {
    /// The records from `at` on in `source`, which has `end` bytes of records.
    pub fn new(source: R, at: u64, end: u64) -> Self {
        let search = MOST_SEARCH.saturating_mul(end);
        Self { source, at, end, doubtful: None, body: Vec::new(), search, grows: false, lost: None, looked: 0 }
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
        self.behind(from, from + 1)
    }

    /// The next record or damaged place; records that are not read have no body.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn next(&mut self) -> io::Result<Place> {
        if let Some((from, start)) = self.lost {
            return self.behind(from, start);
        }
        let from = self.at;
        if self.end.saturating_sub(from) < HEADER {
            return Ok(Place::End { incomplete: self.end.saturating_sub(from) });
        }
        let (opcode, length) = self.header(from)?;
        if !(0x01..=0x0f).contains(&opcode) && opcode < 0x80 {
            return self.mistrust();
        }
        if length > self.end - from - HEADER {
            if self.grows {
                return self.incomplete(opcode, length);
            }
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

    /// Waits for the rest of the record at hand, unless others follow: then its length is damaged.
    fn incomplete(&mut self, opcode: u8, length: u64) -> io::Result<Place> {
        let waits = Place::End { incomplete: self.end - self.at };
        let mut start = Vec::new();
        (&mut self.source).take(CHUNK_START as u64).read_to_end(&mut start)?;
        let is_chunk = start.len() < CHUNK_START || starts_chunk(&start, length);
        if opcode == CHUNK && is_chunk && length <= LARGEST {
            return Ok(waits);
        }
        let from = self.doubtful.unwrap_or(self.at);
        let start = self.looked.max(from + 1);
        match self.find(start)? {
            Some(at) => {
                (self.at, self.doubtful, self.looked) = (at, None, 0);
                Ok(Place::Damage(from..at))
            }
            None => {
                self.looked = self.resumed(start);
                Ok(waits)
            }
        }
    }

    /// Where a search that began at `start` goes on once there is more: a record may begin in what was seen last.
    fn resumed(&self, start: u64) -> u64 {
        self.end.saturating_sub(WINDOW as u64).max(start)
    }

    /// The damaged place from `from` to the next record behind it, where reading goes on; `start` is the earliest.
    fn behind(&mut self, from: u64, start: u64) -> io::Result<Place> {
        (self.doubtful, self.lost, self.looked) = (None, None, 0);
        let found = self.find(start)?;
        if found.is_none() && self.grows {
            self.lost = Some((from, self.resumed(start)));
            return Ok(Place::End { incomplete: self.end - from });
        }
        self.at = found.unwrap_or(self.end);
        Ok(Place::Damage(from..self.at))
    }

    /// Where the first intact record from `start` on begins.
    fn find(&mut self, mut start: u64) -> io::Result<Option<u64>> {
        let mut window = vec![0; WINDOW + CHUNK_START];
        while start < self.end {
            self.source.seek(SeekFrom::Start(start))?;
            let wanted = window.len().min((self.end - start) as usize);
            self.source.read_exact(&mut window[..wanted])?;
            for offset in 0..wanted.min(WINDOW) {
                if self.begins_record(start + offset as u64, &window[offset..wanted])? {
                    return Ok(Some(start + offset as u64));
                }
            }
            start += WINDOW as u64;
        }
        Ok(None)
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
        let is_there = length <= self.end - at - HEADER;
        if opcode == CHUNK && (is_there || self.grows) {
            return Ok(length <= LARGEST && starts_chunk(start, length));
        }
        if !is_there {
            return Ok(false);
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

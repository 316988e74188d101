//! Bags in MCAP, including truncated and damaged ones.
//!
//! Of a damaged file everything but the damaged chunks is read, and what is missing is counted.

mod chunk;
mod loss;
mod record;
mod scan;

use std::collections::{BTreeMap, HashMap};
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use self::chunk::{Allowance, Fault};
use self::loss::Losses;
use self::record::{HEADER, Record};
use self::scan::{Place, Scan, Window};
use super::EXPECTED;
use super::content::{Content, Full};
use crate::file;
use crate::recording::ReadError;

/// First and last bytes of an MCAP file.
pub(super) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

/// Appends the content of a file to `found`, up to its end or its last complete chunk.
///
/// # Errors
/// A [`ReadError`] if the file cannot be read, is no MCAP file, or holds more than memory may.
pub(super) fn read(path: &Path, found: &mut Content, warnings: &mut Vec<String>) -> Result<(), ReadError> {
    let failed = |e| ReadError::io(path, e);
    let mut file = file::open(path).map_err(failed)?;
    let length = file.metadata().map_err(failed)?.len();
    if length == 0 {
        return Err(ReadError::content(path, "is empty", EXPECTED));
    }
    let mut magic = [0; MAGIC.len()];
    let start = MAGIC.len() as u64;
    let is_marked = file.read_exact(&mut magic).is_ok() && begins(&magic);
    if is_marked && magic != *MAGIC {
        warnings.push("its first bytes are damaged".into());
    }
    let has_end = length >= 2 * start
        && file.seek(SeekFrom::Start(length - start)).and_then(|_| file.read_exact(&mut magic)).is_ok()
        && magic == *MAGIC;
    if !is_marked && !has_end {
        return Err(ReadError::content(path, "is not an MCAP file", EXPECTED));
    }
    let end = if has_end { length - start } else { length };
    let mut source = BufReader::with_capacity(1 << 16, file);
    let mut collector = Collector::new(&mut *found, Allowance::of(length));
    let stopped = |stopped| match stopped {
        Stopped::Io(e) => ReadError::io(path, e),
        Stopped::Full(full) => full.error(path),
    };
    if let Some(summary) = summary(&mut source, end).filter(|_| has_end) {
        collector.definitions(Scan::new(&mut source, summary, end)).map_err(stopped)?;
    }
    collector.collect(&mut Scan::new(source, start, end)).map_err(stopped)?;
    let told = collector.told();
    found.cut |= !told.is_empty();
    warnings.extend(told);
    let moved = found.sort();
    if moved > 0 {
        warnings.push(format!("{moved} messages come after later ones: sorted by their log times"));
    }
    Ok(())
}

/// Whether a file that begins with `start` is an MCAP file: at most two of its first eight bytes are damaged.
pub fn begins(start: &[u8]) -> bool {
    start.len() >= MAGIC.len() && MAGIC.iter().zip(start).filter(|(a, b)| a == b).count() + 2 >= MAGIC.len()
}

/// An MCAP file that grows, or that comes through a pipe.
pub(super) struct Growing<S> {
    scan: Scan<Window>,
    collector: Collector<S>,
}

impl<S: Sink> Growing<S> {
    /// A file of which nothing is there yet.
    pub fn new(found: S) -> Self {
        Self { scan: Scan::growing(MAGIC.len() as u64), collector: Collector::new(found, Allowance::of(0)) }
    }

    /// Reads the definitions of channels at the end of a file that is complete: the first ones may be damaged.
    pub fn definitions(&mut self, mut file: impl Read + Seek) {
        // A file without them, such as one that grows, has them at its beginning only.
        let Ok(end) = file.seek(SeekFrom::End(-(MAGIC.len() as i64))) else { return };
        if let Some(summary) = summary(&mut file, end) {
            let _ = self.collector.definitions(Scan::new(file, summary, end));
        }
    }

    /// Reads the next bytes of the file.
    ///
    /// # Errors
    /// [`Full`], if what is found says so.
    pub fn feed(&mut self, bytes: &[u8]) -> Result<(), Full> {
        self.scan.grow(bytes);
        self.collector.allowance.grow(bytes.len() as u64);
        match self.collector.collect(&mut self.scan) {
            // All reading is from memory.
            Ok(()) | Err(Stopped::Io(_)) => Ok(()),
            Err(Stopped::Full(full)) => Err(full),
        }
    }

    /// What was found.
    pub fn found(&mut self) -> &mut S {
        &mut self.collector.found
    }

    /// Whether the end of the data was read.
    pub fn has_ended(&self) -> bool {
        self.collector.ended
    }

    /// What was left out since the last call.
    pub fn faults(&mut self) -> Vec<String> {
        let Collector { losses, channels, zero, ended, .. } = &mut self.collector;
        losses.news(*ended, *zero, &|channel| name(channels, channel))
    }
}

/// What takes the content of a file.
pub(super) trait Sink {
    /// Registers a topic; returns the index of its stream if it is wanted.
    ///
    /// # Errors
    /// [`Full`] if there are too many.
    fn announce(&mut self, topic: &str, type_name: &str, encoding: &str) -> Result<Option<usize>, Full>;

    /// Takes a message of a stream with its log time, ns.
    ///
    /// # Errors
    /// [`Full`] if memory does not suffice.
    fn push(&mut self, stream: usize, time: u64, data: &[u8]) -> Result<(), Full>;

    /// Takes a metadata record.
    fn note(&mut self, name: String, pairs: BTreeMap<String, String>);
}

impl Sink for &mut Content {
    fn announce(&mut self, topic: &str, type_name: &str, encoding: &str) -> Result<Option<usize>, Full> {
        Content::announce(self, topic, type_name, encoding)
    }

    fn push(&mut self, stream: usize, time: u64, data: &[u8]) -> Result<(), Full> {
        Content::push(self, stream, time, data)
    }

    fn note(&mut self, name: String, pairs: BTreeMap<String, String>) {
        self.metadata.insert(name, pairs);
    }
}

/// Where the definitions at the end of a file begin, as its footer says.
fn summary(source: &mut (impl Read + Seek), end: u64) -> Option<u64> {
    const FOOTER: usize = HEADER as usize + 20;
    let mut footer = [0; FOOTER];
    source.seek(SeekFrom::Start(end.checked_sub(FOOTER as u64)?)).ok()?;
    source.read_exact(&mut footer).ok()?;
    let at = u64::from_le_bytes(*footer[HEADER as usize..].first_chunk()?);
    (footer[0] == 0x02 && at >= MAGIC.len() as u64 && at < end).then_some(at)
}

/// Why reading stopped before the end.
enum Stopped {
    Io(std::io::Error),
    Full(Full),
}

impl From<std::io::Error> for Stopped {
    fn from(e: std::io::Error) -> Self {
        Self::Io(e)
    }
}

impl From<Full> for Stopped {
    fn from(full: Full) -> Self {
        Self::Full(full)
    }
}

/// Content of a file being gathered.
struct Collector<S> {
    found: S,
    /// Instant of t = 0 that the file states, ns.
    zero: Option<i64>,
    allowance: Allowance,
    schemas: HashMap<u16, String>,
    /// Topic of every channel, and its stream if it is read.
    channels: Channels,
    losses: Losses,
    /// Whether the part with the messages has ended.
    ended: bool,
    incomplete: u64,
}

type Channels = HashMap<u16, (String, Option<usize>)>;

/// The name of a channel, for a message.
fn name(channels: &Channels, channel: u16) -> String {
    channels.get(&channel).map_or_else(|| format!("channel {channel}"), |(topic, _)| format!("`{topic}`"))
}

impl<S: Sink> Collector<S> {
    fn new(found: S, allowance: Allowance) -> Self {
        let (schemas, channels) = (HashMap::new(), HashMap::new());
        Self { found, zero: None, allowance, schemas, channels, losses: Losses::default(), ended: false, incomplete: 0 }
    }

    /// Reads the definitions of channels that the file repeats at its end: the first ones may be damaged.
    fn definitions(&mut self, mut scan: Scan<impl Read + Seek>) -> Result<(), Stopped> {
        while let Place::Record(opcode) = scan.next()? {
            match Record::parse(opcode, scan.body()) {
                Some(record @ (Record::Schema { .. } | Record::Channel { .. })) => self.record(record)?,
                Some(_) => {}
                None => break,
            }
        }
        Ok(())
    }

    /// Reads all records that are there.
    fn collect(&mut self, scan: &mut Scan<impl Read + Seek>) -> Result<(), Stopped> {
        let mut next = None;
        loop {
            let place = match next.take() {
                Some(place) => place,
                None => scan.next()?,
            };
            let opcode = match place {
                Place::Record(opcode) => opcode,
                Place::Damage(bytes) => {
                    self.losses.skipped(bytes);
                    continue;
                }
                Place::End { incomplete } => {
                    self.incomplete = incomplete;
                    return Ok(());
                }
            };
            let end = scan.at();
            let start = end - scan.body().len() as u64 - HEADER;
            match Record::parse(opcode, scan.body()) {
                None => next = Some(scan.mistrust()?),
                Some(Record::Chunk(chunk)) => match self.allowance.records(&chunk) {
                    Ok(records) => {
                        let times = chunk.times;
                        self.inside(&records)?;
                        drop(records);
                        self.losses.intact(times.1);
                        scan.trust();
                    }
                    Err(fault) => {
                        self.losses.chunk(start..end, chunk.times, fault == Fault::Bloated);
                        // Its own fields may be what is damaged; if the next record is one, they are not.
                    }
                },
                Some(record) => {
                    let is_certain = !matches!(record, Record::Message { .. } | Record::Other);
                    self.record(record)?;
                    if is_certain {
                        scan.trust();
                    }
                }
            }
        }
    }

    /// The records inside a chunk, which its checksum or its size has shown to be whole.
    fn inside(&mut self, mut records: &[u8]) -> Result<(), Stopped> {
        while let Some((header, rest)) = records.split_first_chunk::<{ HEADER as usize }>() {
            let [opcode, length @ ..] = *header;
            let Some((body, rest)) =
                usize::try_from(u64::from_le_bytes(length)).ok().and_then(|n| rest.split_at_checked(n))
            else {
                self.losses.torn();
                return Ok(());
            };
            match Record::parse(opcode, body) {
                // A chunk holds schemas, channels and messages.
                Some(record @ (Record::Schema { .. } | Record::Channel { .. } | Record::Message { .. })) => {
                    self.record(record)?;
                }
                Some(_) => {}
                None => self.losses.torn(),
            }
            records = rest;
        }
        Ok(())
    }

    fn record(&mut self, record: Record) -> Result<(), Stopped> {
        match record {
            Record::Schema { id, name } => {
                self.schemas.insert(id, name);
            }
            Record::Channel { id, schema, topic, encoding } => {
                let type_name = self.schemas.get(&schema).map_or("", String::as_str);
                let stream = self.found.announce(&topic, type_name, &encoding)?;
                self.channels.insert(id, (topic, stream));
            }
            Record::Message { channel, time, data } => {
                self.losses.message(channel, time);
                if let Some((_, Some(stream))) = self.channels.get(&channel) {
                    self.found.push(*stream, time, data)?;
                }
            }
            Record::MessageIndex { channel, times } => self.losses.index(channel, &times),
            Record::Statistics { messages } => self.losses.total(messages),
            Record::Metadata { name, pairs } => {
                if name == "run" {
                    self.zero = pairs.get("zero_ns").and_then(|zero| zero.parse().ok());
                }
                self.found.note(name, pairs);
            }
            Record::End => self.ended = true,
            Record::Chunk(_) | Record::Other => {}
        }
        Ok(())
    }

    /// Warnings about what is missing.
    fn told(self) -> Vec<String> {
        let mut told = self.losses.sentences(self.zero, &|channel| name(&self.channels, channel));
        if !self.ended {
            let rest = match self.incomplete {
                0 => String::new(),
                bytes => format!(", and its last {bytes} bytes are incomplete"),
            };
            told.push(format!("file is cut short: it ends without a footer{rest}"));
        }
        told
    }
}

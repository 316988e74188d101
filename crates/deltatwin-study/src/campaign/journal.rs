//! Rows on the disk as they come, in any order, so that a killed run of a chunk goes on where it was.
//!
//! A record is its length in bytes, its content and the first eight bytes of the content's SHA-256. The first record
//! names the campaign and the chunk. What follows the last whole record, torn by a kill or a power cut, is cut off.

use std::fs::{File, OpenOptions};
use std::io::{self, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest as _, Sha256};

use super::table::Value;

/// Longest record, bytes.
const LONGEST: u32 = 1 << 26;
/// Bytes between two forced writes to the disk.
const SYNC: u64 = 1 << 20;

/// An open journal.
pub struct Journal {
    file: File,
    path: PathBuf,
    /// Position of the record of each run from `first` on; zero for one that is not there.
    places: Vec<u64>,
    first: u64,
    end: u64,
    synced: u64,
}

/// Why a journal cannot be used.
#[derive(Debug)]
pub enum Fault {
    /// The file system failed.
    Io(io::Error),
    /// Another process has it open.
    Taken,
    /// It is of another campaign.
    Foreign,
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

impl Journal {
    /// The journal at `path` of the runs from `first` on; a new one if there is none. `title` names what it is about.
    pub fn open(path: &Path, title: &str, first: u64) -> Result<Self, Fault> {
        let file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(path)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(std::fs::TryLockError::WouldBlock) => return Err(Fault::Taken),
            Err(std::fs::TryLockError::Error(error)) => return Err(Fault::Io(error)),
        }
        let mut journal = Self { file, path: path.into(), places: Vec::new(), first, end: 0, synced: 0 };
        journal.recover(title)?;
        Ok(journal)
    }

    fn recover(&mut self, title: &str) -> Result<(), Fault> {
        let mut reader = BufReader::new(&self.file);
        let mut places = Vec::new();
        let mut end = 0;
        while let Some(content) = record(&mut reader)? {
            if end == 0 {
                if content != title.as_bytes() {
                    return Err(Fault::Foreign);
                }
            } else if let Some((run, _)) = decode(&content) {
                places.push((run, end));
            }
            end += 12 + content.len() as u64;
        }
        self.end = end;
        for (run, place) in places {
            self.place(run, place);
        }
        self.file.set_len(end)?;
        if end == 0 {
            self.append(title.as_bytes())?;
        }
        Ok(())
    }

    fn place(&mut self, run: u64, place: u64) {
        let Some(index) = run.checked_sub(self.first).and_then(|index| usize::try_from(index).ok()) else { return };
        if index >= self.places.len() {
            self.places.resize(index + 1, 0);
        }
        self.places[index] = place;
    }

    /// Whether a run is there.
    pub fn has(&self, run: u64) -> bool {
        run.checked_sub(self.first).and_then(|k| self.places.get(usize::try_from(k).ok()?)).is_some_and(|p| *p > 0)
    }

    /// The runs that are there, in order.
    pub fn runs(&self) -> impl Iterator<Item = u64> {
        (self.first..).zip(&self.places).filter(|(_, place)| **place > 0).map(|(run, _)| run)
    }

    /// Appends the row of a run.
    pub fn write(&mut self, run: u64, row: &[Value]) -> io::Result<()> {
        let place = self.end;
        self.append(&encode(run, row))?;
        self.place(run, place);
        Ok(())
    }

    fn append(&mut self, content: &[u8]) -> io::Result<()> {
        let mut bytes = Vec::with_capacity(content.len() + 12);
        bytes.extend((content.len() as u32).to_le_bytes());
        bytes.extend(content);
        bytes.extend(check(content));
        self.file.seek(SeekFrom::Start(self.end))?;
        self.file.write_all(&bytes)?;
        self.end += bytes.len() as u64;
        if self.end - self.synced > SYNC {
            self.sync()?;
        }
        Ok(())
    }

    /// Forces everything to the disk.
    pub fn sync(&mut self) -> io::Result<()> {
        self.synced = self.end;
        self.file.sync_data()
    }

    /// The row of a run that is there.
    pub fn row(&self, run: u64) -> io::Result<Vec<Value>> {
        let gone = || io::Error::new(io::ErrorKind::InvalidData, format!("the row of run {run} is not there"));
        if !self.has(run) {
            return Err(gone());
        }
        let mut file = &self.file;
        file.seek(SeekFrom::Start(self.places[(run - self.first) as usize]))?;
        let content = record(&mut file)?.ok_or_else(gone)?;
        decode(&content).filter(|(found, _)| *found == run).map(|(_, row)| row).ok_or_else(gone)
    }

    /// Removes the file.
    pub fn remove(self) -> io::Result<()> {
        std::fs::remove_file(&self.path)
    }
}

/// The content of the next record; `None` at the end or at a torn or damaged record.
fn record(reader: &mut impl Read) -> io::Result<Option<Vec<u8>>> {
    let mut length = [0; 4];
    if !filled(reader, &mut length)? {
        return Ok(None);
    }
    let length = u32::from_le_bytes(length);
    if length > LONGEST {
        return Ok(None);
    }
    let (mut content, mut sum) = (vec![0; length as usize], [0; 8]);
    let whole = filled(reader, &mut content)? && filled(reader, &mut sum)? && check(&content) == sum;
    Ok(whole.then_some(content))
}

/// Whether the whole buffer could be read before the end.
fn filled(reader: &mut impl Read, buffer: &mut [u8]) -> io::Result<bool> {
    match reader.read_exact(buffer) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => Ok(false),
        Err(error) => Err(error),
    }
}

fn check(content: &[u8]) -> [u8; 8] {
    let hash = Sha256::digest(content);
    std::array::from_fn(|k| hash[k])
}

fn encode(run: u64, row: &[Value]) -> Vec<u8> {
    let mut out = run.to_le_bytes().to_vec();
    for value in row {
        match value {
            Value::Missing => out.push(0),
            Value::Float(x) => {
                out.push(1);
                out.extend(x.to_bits().to_le_bytes());
            }
            Value::Integer(n) => {
                out.push(2);
                out.extend(n.to_le_bytes());
            }
            Value::Text(text) => {
                out.push(3);
                out.extend((text.len() as u32).to_le_bytes());
                out.extend(text.as_bytes());
            }
            Value::Flag(flag) => out.extend([4, u8::from(*flag)]),
        }
    }
    out
}

fn decode(mut content: &[u8]) -> Option<(u64, Vec<Value>)> {
    fn take<const N: usize>(content: &mut &[u8]) -> Option<[u8; N]> {
        let (head, rest) = content.split_first_chunk::<N>()?;
        *content = rest;
        Some(*head)
    }
    let run = u64::from_le_bytes(take(&mut content)?);
    let mut row = Vec::new();
    while let Some([tag]) = take(&mut content) {
        row.push(match tag {
            0 => Value::Missing,
            1 => Value::Float(f64::from_bits(u64::from_le_bytes(take(&mut content)?))),
            2 => Value::Integer(i64::from_le_bytes(take(&mut content)?)),
            3 => {
                let length = u32::from_le_bytes(take(&mut content)?) as usize;
                let (text, rest) = content.split_at_checked(length)?;
                content = rest;
                Value::Text(String::from_utf8(text.to_vec()).ok()?)
            }
            4 => Value::Flag(take::<1>(&mut content)? == [1]),
            _ => return None,
        });
    }
    Some((run, row))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(i: u64) -> Vec<Value> {
        vec![Value::Float(0.1 * i as f64), Value::Missing, format!("µ {i}").into(), Value::Flag(i.is_multiple_of(2))]
    }

    #[test]
    fn rows_survive_a_torn_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let mut journal = Journal::open(&path, "study", 10).unwrap();
        for run in [12, 10, 29, 11] {
            journal.write(run, &row(run)).unwrap();
        }
        assert!(matches!(Journal::open(&path, "study", 10), Err(Fault::Taken)));
        drop(journal);
        let whole = std::fs::read(&path).unwrap();
        for torn in 0..whole.len() {
            std::fs::write(&path, &whole[..torn]).unwrap();
            let mut journal = Journal::open(&path, "study", 10).unwrap();
            for run in [12, 10, 29, 11] {
                if !journal.has(run) {
                    journal.write(run, &row(run)).unwrap();
                }
                assert_eq!(journal.row(run).unwrap(), row(run));
            }
            assert_eq!(journal.runs().collect::<Vec<_>>(), [10, 11, 12, 29]);
            assert!(!journal.has(13) && !journal.has(9) && !journal.has(30));
            assert!(journal.row(13).is_err());
        }
        assert!(matches!(Journal::open(&path, "other", 10), Err(Fault::Foreign)));
    }

    #[test]
    fn damage_in_the_middle_loses_what_follows_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("journal");
        let mut journal = Journal::open(&path, "study", 0).unwrap();
        (0..3).for_each(|run| journal.write(run, &row(run)).unwrap());
        let middle = journal.places[1] as usize + 6;
        drop(journal);
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[middle] ^= 1;
        std::fs::write(&path, bytes).unwrap();
        let journal = Journal::open(&path, "study", 0).unwrap();
        assert_eq!((journal.has(0), journal.has(1), journal.has(2)), (true, false, false));
        journal.remove().unwrap();
        assert!(!path.exists());
    }
}

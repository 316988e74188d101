//! Samples of a file that grows or of a pipe: CSV with the columns of a recording, or MCAP.

use std::fs::{File, OpenOptions};
use std::io::{ErrorKind, Read, Seek};
use std::path::{Path, PathBuf};

use deltatwin::machine::PerAxis;
use deltatwin_io::recording::{JointSample, Tail, begins_mcap};
use thiserror::Error;

use crate::stamped::{Stamped, nanoseconds};

/// Most bytes read at once.
const PIECE: usize = 4 << 20;
/// Bytes asked for at a time.
const BLOCK: usize = 1 << 16;
/// Longest line of a CSV file, bytes.
const LINE: usize = 1 << 20;
/// Number of bytes that show which format a file has.
const START: usize = 8;

/// Reason why a file cannot be followed.
#[derive(Debug, Error)]
pub enum FollowError {
    /// The file cannot be opened or read.
    #[error("{}: cannot be read: {reason}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Error of the operating system.
        reason: std::io::Error,
    },
    /// The content is not usable.
    #[error("{}: {problem}", file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// What is wrong, and what was expected.
        problem: String,
    },
}

/// A file that is read as it grows.
pub struct Follower {
    path: PathBuf,
    file: File,
    axes: usize,
    read: u64,
    content: Content,
    /// Lines that were left out: line number and reason.
    faults: Vec<String>,
}

enum Content {
    Unknown(Vec<u8>),
    Csv(Csv),
    Mcap(Box<Tail>),
}

#[derive(Default)]
struct Csv {
    partial: Vec<u8>,
    line: usize,
    /// Separator, and the places of time, angles and torques.
    columns: Option<(char, Vec<usize>)>,
}

impl Follower {
    /// Opens the file of a machine with `axes` axes, from its beginning; a pipe without waiting for its other end.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub fn open(path: &Path, axes: usize) -> Result<Self, FollowError> {
        let mut options = OpenOptions::new();
        options.read(true);
        #[cfg(unix)]
        std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, rustix::fs::OFlags::NONBLOCK.bits() as i32);
        let file = options.open(path).map_err(|reason| FollowError::Io { file: path.into(), reason })?;
        let content = Content::Unknown(Vec::new());
        Ok(Self { path: path.into(), file, axes, read: 0, content, faults: Vec::new() })
    }

    /// Samples written since the last call, at most some megabytes of them; empty if there are none.
    ///
    /// # Errors
    /// If the file cannot be read or is not a recording.
    pub fn poll(&mut self) -> Result<Vec<Stamped>, FollowError> {
        let io = |reason| FollowError::Io { file: self.path.clone(), reason };
        let metadata = self.file.metadata().map_err(io)?;
        if metadata.is_file() && metadata.len() < self.read {
            // Written anew.
            self.file.rewind().map_err(io)?;
            (self.read, self.content) = (0, Content::Unknown(Vec::new()));
        }
        let bytes = available(&mut self.file).map_err(io)?;
        self.read += bytes.len() as u64;
        self.feed(&bytes).map_err(|problem| FollowError::Content { file: self.path.clone(), problem })
    }

    /// Whether the file says that it is complete.
    pub fn has_ended(&self) -> bool {
        matches!(&self.content, Content::Mcap(tail) if tail.has_ended())
    }

    /// Faults since the last call: what was left out, and why.
    pub fn faults(&mut self) -> Vec<String> {
        let mut faults = std::mem::take(&mut self.faults);
        if let Content::Mcap(tail) = &mut self.content {
            faults.extend(tail.faults());
        }
        faults
    }

    fn feed(&mut self, bytes: &[u8]) -> Result<Vec<Stamped>, String> {
        if let Content::Unknown(start) = &mut self.content {
            start.extend(bytes);
            if start.len() < START {
                return Ok(Vec::new());
            }
            let start = std::mem::take(start);
            if !begins_mcap(&start) {
                self.content = Content::Csv(Csv::default());
                return self.feed(&start);
            }
            let mut tail = Tail::new(self.axes);
            if let Some(file) = File::open(&self.path).ok().filter(|f| f.metadata().is_ok_and(|m| m.is_file())) {
                tail.definitions(file);
            }
            self.content = Content::Mcap(Box::new(tail));
            return self.feed(&start[START..]);
        }
        match &mut self.content {
            Content::Mcap(tail) => Ok(tail.feed(bytes).iter().filter_map(sample).collect()),
            Content::Csv(csv) => csv.feed(bytes, self.axes, &mut self.faults),
            Content::Unknown(_) => Ok(Vec::new()),
        }
    }
}

/// The bytes that are there now, at most [`PIECE`].
fn available(file: &mut File) -> std::io::Result<Vec<u8>> {
    let (mut out, mut block) = (Vec::new(), vec![0; BLOCK]);
    while out.len() < PIECE {
        match file.read(&mut block) {
            Ok(0) => break,
            Ok(count) => out.extend(&block[..count]),
            // A pipe that is empty.
            Err(e) if e.kind() == ErrorKind::WouldBlock => break,
            Err(e) if e.kind() == ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
    Ok(out)
}

/// A sample of a bag; `None` if a value is not finite.
fn sample(joints: &JointSample) -> Option<Stamped> {
    let all = |values: &[f64]| -> PerAxis<f64> { std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0)) };
    let finite = joints.q.iter().chain(&joints.tau).all(|x| x.is_finite());
    finite.then(|| Stamped { time: joints.time, q: all(&joints.q), tau: all(&joints.tau) })
}

impl Csv {
    fn feed(&mut self, bytes: &[u8], axes: usize, faults: &mut Vec<String>) -> Result<Vec<Stamped>, String> {
        self.partial.extend(bytes);
        let mut found = Vec::new();
        let partial = std::mem::take(&mut self.partial);
        let mut rest = partial.as_slice();
        while let Some(end) = rest.iter().position(|b| *b == b'\n') {
            let line = String::from_utf8_lossy(&rest[..end]);
            rest = &rest[end + 1..];
            self.line += 1;
            if line.trim().is_empty() {
                continue;
            }
            match &self.columns {
                None => self.columns = Some(header(&line, axes)?),
                Some((separator, places)) => match row(&line, *separator, places, axes) {
                    Ok(sample) => found.push(sample),
                    Err(problem) => faults.push(format!("line {}: {problem}; left out", self.line)),
                },
            }
        }
        if rest.len() > LINE {
            return Err(format!("line {} is longer than {LINE} bytes; expected a CSV or MCAP file", self.line + 1));
        }
        self.partial = rest.to_vec();
        Ok(found)
    }
}

/// Separator and places of `t`, `q1`…, `tau1`… in a header.
fn header(line: &str, axes: usize) -> Result<(char, Vec<usize>), String> {
    let line = line.trim_start_matches('\u{feff}');
    let separator = if line.contains(';') { ';' } else { ',' };
    let names: Vec<&str> = line.split(separator).map(str::trim).collect();
    let wanted = std::iter::once("t".to_string())
        .chain((1..=axes).map(|k| format!("q{k}")))
        .chain((1..=axes).map(|k| format!("tau{k}")));
    let place = |name: String| {
        names.iter().position(|n| *n == name).ok_or_else(|| {
            format!("has no column `{name}`; expected t, q1…q{axes}, tau1…tau{axes} in s, rad and N·m (`deltatwin import` writes them)")
        })
    };
    Ok((separator, wanted.map(place).collect::<Result<_, _>>()?))
}

fn row(line: &str, separator: char, places: &[usize], axes: usize) -> Result<Stamped, String> {
    let cells: Vec<&str> = line.split(separator).map(str::trim).collect();
    let cell = |place: &usize| cells.get(*place).ok_or_else(|| format!("has {} values", cells.len()));
    let value = |place: &usize| {
        let cell = cell(place)?;
        let number = cell.parse::<f64>().ok().filter(|x| x.is_finite());
        number.ok_or_else(|| format!("`{cell}` is not a number"))
    };
    let (time, places) = places.split_first().ok_or("has no columns")?;
    let time = cell(time)?;
    let time = nanoseconds(time).ok_or_else(|| format!("`{time}` is not a time in s"))?;
    let values: Vec<f64> = places.iter().map(value).collect::<Result<_, String>>()?;
    let all =
        |first: usize| -> PerAxis<f64> { std::array::from_fn(|i| if i < axes { values[first + i] } else { 0.0 }) };
    Ok(Stamped { time, q: all(0), tau: all(axes) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    #[test]
    fn rows_come_once_they_are_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let mut out = File::create(&path).unwrap();
        let mut follower = Follower::open(&path, 1).unwrap();
        assert!(follower.poll().unwrap().is_empty());
        write!(out, "tau1,t,q1\n1.5,0.0,0.1\n2.5,0.").unwrap();
        let expected =
            |t: f64, q, tau| Stamped { time: (t * 1e9) as i64, q: [q, 0.0, 0.0, 0.0], tau: [tau, 0.0, 0.0, 0.0] };
        assert_eq!(follower.poll().unwrap(), [expected(0.0, 0.1, 1.5)]);
        assert!(follower.poll().unwrap().is_empty());
        write!(out, "01,0.2\nx,0.02,0.3\n1\n3.5,0.03,0.4\n").unwrap();
        assert_eq!(follower.poll().unwrap(), [expected(0.01, 0.2, 2.5), expected(0.03, 0.4, 3.5)]);
        assert_eq!(follower.faults(), ["line 4: `x` is not a number; left out", "line 5: has 1 values; left out"]);
        // Written anew, with another order of columns.
        std::fs::write(&path, "t;q1;tau1\n5;6;7\n").unwrap();
        assert_eq!(follower.poll().unwrap(), [expected(5.0, 6.0, 7.0)]);
    }

    #[test]
    fn other_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let refused = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            Follower::open(&path, 4).unwrap().poll().unwrap_err().to_string()
        };
        assert!(refused(b"time,q1\n1,2\n").contains("has no column `t`; expected t, q1…q4"));
        assert!(refused(&vec![b'x'; 2 * LINE]).contains("longer than"));
        assert!(matches!(Follower::open(&folder.path().join("none"), 4), Err(FollowError::Io { .. })));
    }
}

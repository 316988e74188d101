//! Recordings as ROS 2 bags: MCAP is written and read, SQLite (`.db3`) and bag folders are read.
//!
//! [`topics`] lists the topics. MCAP metadata: `setup` holds the setup as TOML, `run` the instant of t = 0, `machine`
//! the kind of machine, `provenance` the origin of the run.

mod cdr;
mod content;
mod folder;
mod mcap_file;
mod messages;
mod read;
mod sqlite_file;
mod tail;
mod topics;
mod write;

pub use mcap_file::begins as begins_mcap;
pub use read::{contacts, read};
pub use tail::{JointSample, Tail};
pub(in crate::recording) use write::Writer;
pub use write::write;

use std::io::Read;
use std::path::Path;

use deltatwin::machine::{Axis, Effort, Joint, Mechanism};

use self::content::Content;
use self::messages::SECOND;
use super::ReadError;
use crate::file;

const EXPECTED: &str = "an MCAP file with sensor_msgs/msg/JointState messages, or a bag of ROS 2";

/// Instant of t = 0 for a run without a real one, ns since 1970: 2023-11-14, a constant, so that the same run produces
/// the same bytes.
const EPOCH: i64 = 1_700_000_000 * SECOND;

const MECHANISMS: [(&str, Mechanism); 7] = [
    ("delta", Mechanism::delta(true)),
    ("delta without telescope", Mechanism::delta(false)),
    ("linear delta", Mechanism::LINEAR_DELTA),
    ("revolute axis", Mechanism::axis(Joint::Revolute)),
    ("prismatic axis", Mechanism::axis(Joint::Prismatic)),
    ("revolute axis in ampere", Mechanism::Axis(Axis { joint: Joint::Revolute, effort: Effort::Current })),
    ("prismatic axis in ampere", Mechanism::Axis(Axis { joint: Joint::Prismatic, effort: Effort::Current })),
];

/// Kinds of bag files.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    Mcap,
    Sqlite,
}

/// Kind of a file by its first bytes, or by its name if these are not conclusive.
fn kind_of(path: &Path) -> Option<Kind> {
    let mut start = [0; mcap_file::MAGIC.len()];
    let read = file::open(path).and_then(|mut f| f.read_exact(&mut start));
    if read.is_ok() && mcap_file::begins(&start) {
        return Some(Kind::Mcap);
    }
    if read.is_ok() && sqlite_file::MAGIC.starts_with(&start) {
        return Some(Kind::Sqlite);
    }
    let extension = path.extension()?.to_ascii_lowercase();
    match extension.to_str()? {
        "mcap" => Some(Kind::Mcap),
        "db3" => Some(Kind::Sqlite),
        _ => None,
    }
}

/// Whether `path` is a bag: a folder, or an MCAP or SQLite file by its first bytes or its name.
pub fn is_bag(path: &Path) -> bool {
    path.is_dir() || kind_of(path).is_some()
}

/// Appends the content of an MCAP or SQLite file to `found`.
fn read_file(path: &Path, found: &mut Content, warnings: &mut Vec<String>) -> Result<(), ReadError> {
    match kind_of(path) {
        Some(Kind::Sqlite) => sqlite_file::read(path, found, warnings),
        _ => mcap_file::read(path, found, warnings),
    }
}

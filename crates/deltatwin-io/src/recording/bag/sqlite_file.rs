//! Bags in SQLite (`.db3`), the default format of rosbag2 up to ROS 2 Humble.

use std::collections::HashMap;
use std::path::Path;

use rusqlite::{Connection, OpenFlags};

use super::EXPECTED;
use super::content::{Content, Full};
use crate::file;
use crate::recording::ReadError;

/// First bytes of an SQLite file.
pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";

/// Most bytes that the rows of a file may have, per byte of it: more come from no table.
const MOST_EXPANSION: u64 = 100;

/// Appends the content of a file to `found`; of a damaged one as far as possible.
pub(super) fn read(path: &Path, found: &mut Content, warnings: &mut Vec<String>) -> Result<(), ReadError> {
    let bad = |e: rusqlite::Error| ReadError::content(path, format!("cannot be read as a bag: {e}"), EXPECTED);
    let full = |full: Full| full.error(path);
    let length = file::open(path).and_then(|f| f.metadata()).map_err(|e| ReadError::io(path, e))?.len();
    let mut allowance = length.saturating_mul(MOST_EXPANSION);
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags).map_err(bad)?;
    for name in ["topics", "messages"] {
        let query =
            "SELECT count(*) FROM sqlite_master WHERE name = ?1 AND type = 'table' AND sql LIKE 'CREATE TABLE%'";
        let tables: i64 = connection.query_row(query, [name], |row| row.get(0)).map_err(bad)?;
        if tables != 1 {
            return Err(ReadError::content(path, format!("cannot be read as a bag: no table `{name}`"), EXPECTED));
        }
    }
    let mut streams: HashMap<i64, usize> = HashMap::new();
    let mut topics = connection.prepare("SELECT id, name, type, serialization_format FROM topics").map_err(bad)?;
    let rows = topics
        .query_map([], |row| Ok((row.get(0)?, row.get::<_, String>(1)?, row.get::<_, String>(2)?, row.get(3)?)))
        .map_err(bad)?;
    for row in rows {
        let (id, name, type_name, format): (i64, String, String, String) = row.map_err(bad)?;
        if let Some(stream) = found.announce(&name, &type_name, &format).map_err(full)? {
            streams.insert(id, stream);
        }
    }
    // In file order, not in order of time: sorting would need all of a damaged file.
    let mut messages = connection.prepare("SELECT topic_id, timestamp, data FROM messages").map_err(bad)?;
    let mut rows = messages.query([]).map_err(bad)?;
    loop {
        let row = match rows.next() {
            Ok(Some(row)) => row,
            Ok(None) => break,
            Err(e) => {
                warnings.push(format!("file is cut short or damaged: {e}"));
                found.cut = true;
                break;
            }
        };
        let Some(&stream) = streams.get(&row.get::<_, i64>(0).map_err(bad)?) else { continue };
        let time: i64 = row.get(1).map_err(bad)?;
        let time = u64::try_from(time)
            .map_err(|_| ReadError::content(path, format!("has a message at {time} ns"), "times in ns since 1970"))?;
        let data = row.get_ref(2).map_err(bad)?;
        let data = data.as_blob().map_err(|e| bad(e.into()))?;
        allowance = allowance.checked_sub(data.len() as u64 + 1).ok_or_else(|| {
            ReadError::content(path, format!("has rows of more than {MOST_EXPANSION} times its size"), EXPECTED)
        })?;
        found.push(stream, time, data).map_err(full)?;
    }
    found.sort();
    Ok(())
}

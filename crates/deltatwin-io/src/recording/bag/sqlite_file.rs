//! Bags in SQLite (`.db3`), the default format of rosbag2 up to ROS 2 Humble.

use std::collections::HashMap;
use std::path::Path;

use rusqlite::{Connection, OpenFlags};

use super::EXPECTED;
use super::content::Content;
use crate::recording::ReadError;

/// First bytes of an SQLite file.
pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";

/// Reads a file; a damaged one as far as possible.
pub(super) fn read(path: &Path, warnings: &mut Vec<String>) -> Result<Content, ReadError> {
    let bad = |e: rusqlite::Error| ReadError::content(path, format!("cannot be read as a bag: {e}"), EXPECTED);
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags).map_err(bad)?;
    let mut found = Content::default();
    let mut streams: HashMap<i64, usize> = HashMap::new();
    let mut topics = connection.prepare("SELECT id, name, type, serialization_format FROM topics").map_err(bad)?;
    let rows = topics
        .query_map([], |row| Ok((row.get(0)?, row.get::<_, String>(1)?, row.get::<_, String>(2)?, row.get(3)?)))
        .map_err(bad)?;
    for row in rows {
        let (id, name, type_name, format): (i64, String, String, String) = row.map_err(bad)?;
        if let Some(stream) = found.announce(&name, &type_name, &format) {
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
        found.streams[stream].messages.push((time, row.get(2).map_err(bad)?));
    }
    for stream in &mut found.streams {
        stream.messages.sort_by_key(|(time, _)| *time);
    }
    Ok(found)
}

//! Bags in SQLite (`.db3`), the default format of rosbag2 up to ROS 2 Humble.

use std::collections::HashMap;
use std::path::Path;

use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::{Connection, ErrorCode, OpenFlags};

use super::EXPECTED;
use super::content::{Content, Full};
use crate::file;
use crate::recording::ReadError;

/// First bytes of an SQLite file.
pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";

/// Most bytes that the rows of a file may have, and most steps of SQLite's machine, per byte of it: more come from no
/// table.
const MOST_EXPANSION: u64 = 100;
/// Steps of SQLite's machine between two looks at their number, and looks for the schema of any file.
const STEPS: i32 = 1000;
const LOOKS: u64 = 1000;
/// Longest statement of a schema, bytes, deepest expression and most columns: a bag is far below.
const SCHEMA: [(Limit, i32); 4] = [
    (Limit::SQLITE_LIMIT_SQL_LENGTH, 1 << 20),
    (Limit::SQLITE_LIMIT_EXPR_DEPTH, 50),
    (Limit::SQLITE_LIMIT_COLUMN, 100),
    (Limit::SQLITE_LIMIT_ATTACHED, 0),
];

/// Opens a file of `length` bytes that nobody vouches for: it may compute nothing, and its values are at most `longest`
/// bytes long.
fn open(path: &Path, length: u64, longest: i32) -> rusqlite::Result<Connection> {
    let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(path, flags)?;
    let mut left = (length.saturating_mul(MOST_EXPANSION) / STEPS as u64).saturating_add(LOOKS);
    connection.progress_handler(
        STEPS,
        Some(move || {
            left = left.saturating_sub(1);
            left == 0
        }),
    )?;
    connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, longest)?;
    SCHEMA.iter().try_for_each(|(limit, most)| connection.set_limit(*limit, *most).map(drop))?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
    Ok(connection)
}

/// What keeps `name` from being a table of stored values; `None` if it is one.
fn unusable(connection: &Connection, name: &str) -> rusqlite::Result<Option<String>> {
    let query = "SELECT count(*) FROM sqlite_master WHERE name = ?1 AND type = 'table' AND sql LIKE 'CREATE TABLE%'";
    if connection.query_row(query, [name], |row| row.get::<_, i64>(0))? != 1 {
        return Ok(Some(format!("no table `{name}`")));
    }
    let mut computed = None;
    connection.pragma(None, "table_xinfo", name, |row| {
        if row.get::<_, i64>("hidden")? != 0 {
            computed = Some(format!("column `{}` of the table `{name}` is computed", row.get::<_, String>("name")?));
        }
        Ok(())
    })?;
    Ok(computed)
}

/// Appends the content of a file to `found`; of a damaged one as far as possible.
pub(super) fn read(path: &Path, found: &mut Content, warnings: &mut Vec<String>) -> Result<(), ReadError> {
    let length = file::open(path).and_then(|f| f.metadata()).map_err(|e| ReadError::io(path, e))?.len();
    // Text of two bytes per character may become half as long again.
    let whole = length.saturating_mul(2).saturating_add(1 << 20);
    let memory = found.full();
    let longest = i32::try_from(whole.min(memory.allowed as u64)).unwrap_or(i32::MAX);
    let bad = |e: rusqlite::Error| {
        let reason = match e.sqlite_error_code() {
            Some(ErrorCode::TooBig) if (memory.allowed as u64) < whole => return memory.error(path),
            Some(ErrorCode::TooBig) => format!("a value has more than {longest} bytes"),
            Some(ErrorCode::OperationInterrupted) => "it takes more steps than a table of its size".into(),
            _ => e.to_string(),
        };
        ReadError::content(path, format!("cannot be read as a bag: {reason}"), EXPECTED)
    };
    let full = |full: Full| full.error(path);
    let mut allowance = length.saturating_mul(MOST_EXPANSION);
    let mut spend = |bytes: usize| -> Result<(), ReadError> {
        allowance = allowance.checked_sub(bytes as u64 + 1).ok_or_else(|| {
            ReadError::content(path, format!("has rows of more than {MOST_EXPANSION} times its size"), EXPECTED)
        })?;
        Ok(())
    };
    let connection = open(path, length, longest).map_err(bad)?;
    for name in ["topics", "messages"] {
        if let Some(problem) = unusable(&connection, name).map_err(bad)? {
            return Err(ReadError::content(path, format!("cannot be read as a bag: {problem}"), EXPECTED));
        }
    }
    let mut streams: HashMap<i64, usize> = HashMap::new();
    let mut topics = connection.prepare("SELECT id, name, type, serialization_format FROM topics").map_err(bad)?;
    let rows = topics
        .query_map([], |row| Ok((row.get(0)?, row.get::<_, String>(1)?, row.get::<_, String>(2)?, row.get(3)?)))
        .map_err(bad)?;
    for row in rows {
        let (id, name, type_name, format): (i64, String, String, String) = row.map_err(bad)?;
        spend(name.len() + type_name.len() + format.len())?;
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
            Err(e) if matches!(e.sqlite_error_code(), Some(ErrorCode::TooBig | ErrorCode::OperationInterrupted)) => {
                return Err(bad(e));
            }
            Err(e) => {
                warnings.push(format!("file is cut short or damaged: {e}"));
                found.cut = true;
                break;
            }
        };
        spend(0)?;
        let Some(&stream) = streams.get(&row.get::<_, i64>(0).map_err(bad)?) else { continue };
        let time: i64 = row.get(1).map_err(bad)?;
        let time = u64::try_from(time)
            .map_err(|_| ReadError::content(path, format!("has a message at {time} ns"), "times in ns since 1970"))?;
        let data = row.get_ref(2).map_err(bad)?;
        let data = data.as_blob().map_err(|e| bad(e.into()))?;
        spend(data.len())?;
        found.push(stream, time, data).map_err(full)?;
    }
    found.sort();
    Ok(())
}

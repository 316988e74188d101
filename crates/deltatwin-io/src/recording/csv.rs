//! Recordings as CSV: a header row with the names of the columns in any order.
//!
//! Required: `t`, and `q1…, tau1…` of every axis of the machine (one, three or four), in SI units; other names and
//! units are recognised as far as [`super::columns`] supports them. Optional: `strut1_upper…strut6_upper`,
//! `strut1_lower…strut6_lower`, `ee_x, ee_y, ee_z`, `qd1…qd4`, `qdd1…qdd4`, `margin1_upper…margin6_upper,
//! margin1_lower…margin6_lower`, `link_q1…4`, `link_qd1…4` and the `lambda_…` of
//! [`multiplier_names`](deltatwin::recording::multiplier_names). Separators, encodings and lines around the header are
//! those that [`super::dialect`] finds.

use std::borrow::Cow;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;

use deltatwin::machine::{Effort, Mechanism};
use deltatwin::recording::Signals;

use super::check::{self, Table};
use super::columns::{Frame, Layout};
use super::dialect::{Dialect, Plain};
use super::epoch::Clock;
use super::{ReadError, Reading, memory};
use crate::file;

/// Description of the expected file of a machine.
fn expected(axes: usize) -> String {
    let columns = if axes == 1 { "t, q1, tau1".into() } else { format!("t, q1…q{axes}, tau1…tau{axes}") };
    format!("CSV with the columns {columns} and numbers below")
}

/// Number of unknown columns that are listed.
const UNKNOWN: usize = 8;
/// Largest number of columns.
const MOST_COLUMNS: usize = 10_000;
/// Number of bytes from which the format of a file is determined.
const HEAD: usize = 1 << 16;
/// Nanoseconds per second.
const SECOND: i64 = 1_000_000_000;

/// Signals of a CSV file, and warnings about what was repaired.
///
/// `how.machine` is the expected machine; `None` means the one inferred from the columns. `how.maps` assign columns to
/// channels where the names do not.
///
/// # Errors
/// A [`ReadError`] if the file cannot be read, or for columns, units, cells or times that are not valid, with line and
/// column.
pub fn read(path: &Path, how: &Reading) -> Result<(Signals, Vec<String>), ReadError> {
    let file = file::open(path).map_err(|e| ReadError::io(path, e))?;
    let bytes = file.metadata().map_or(0, |m| m.len()) as usize;
    let mut source = BufReader::with_capacity(HEAD, file);
    let head = source.fill_buf().map_err(|e| ReadError::io(path, e))?.to_vec();
    // Growth of the columns would leave unused memory; reserve the estimated size.
    let lines = head.iter().filter(|b| **b == b'\n').count();
    let rows = bytes.checked_div(head.len().checked_div(lines).unwrap_or(0)).unwrap_or(0);
    let (table, mut warnings) = table(path, &head, source, rows + rows / 50, how)?;
    let (signals, noticed) = check::signals(table)?;
    warnings.extend(noticed);
    Ok((signals, warnings))
}

/// Writes the signals with the shortest decimals that read back exactly.
///
/// # Errors
/// A description of inconsistent signals, or what the operating system says.
pub fn write(out: impl Write, signals: &Signals) -> std::io::Result<()> {
    let mut writer = Writer::new(out, 0);
    writer.append(signals)?;
    writer.finish()
}

/// A file being written, line by line.
pub(super) struct Writer<W: Write> {
    out: W,
    /// Instant of t = 0, ns since 1970; zero if times are to be written as they are.
    zero: i64,
    /// Number of lines of samples so far.
    samples: usize,
}

impl<W: Write> Writer<W> {
    pub fn new(out: W, zero: i64) -> Self {
        Self { out, zero, samples: 0 }
    }

    /// Appends samples, below the names of their columns if they are the first.
    ///
    /// # Errors
    /// As [`write`].
    pub fn append(&mut self, signals: &Signals) -> std::io::Result<()> {
        let Self { out, zero, samples } = self;
        if signals.is_empty() {
            return Ok(());
        }
        check::check(signals, *samples).map_err(std::io::Error::other)?;
        if *samples == 0 {
            write!(out, "t")?;
            for (channel, _) in signals.series() {
                // The unit of a current is not that of the format.
                let is_current = signals.mechanism.effort() == Effort::Current && channel.drive().is_some();
                write!(out, ",{channel}{}", if is_current { " [A]" } else { "" })?;
            }
            writeln!(out)?;
        }
        let mut line = String::new();
        for (i, t) in signals.t.iter().enumerate() {
            line.clear();
            line += &if *zero == 0 { shortest(*t) } else { since_1970(*zero, *t) };
            for (_, values) in signals.series() {
                line.push(',');
                line += &shortest(values[i]);
            }
            line.push('\n');
            out.write_all(line.as_bytes())?;
        }
        *samples += signals.len();
        Ok(())
    }

    /// Hands the last lines on.
    ///
    /// # Errors
    /// The error of the operating system.
    pub fn finish(mut self) -> std::io::Result<()> {
        self.out.flush()
    }
}

/// The time `t` (s) after `zero` (ns since 1970) in seconds since 1970, to the nanosecond.
fn since_1970(zero: i64, t: f64) -> String {
    let time = zero.saturating_add((t * 1e9).round() as i64);
    format!("{}.{:09}", time.div_euclid(SECOND), time.rem_euclid(SECOND))
}

/// Shortest decimal that reads back as the same number.
fn shortest(v: f64) -> String {
    let mut text = format!("{v:?}");
    if text.ends_with(".0") {
        text.truncate(text.len() - 2);
    }
    text
}

/// The table of about `about` rows in `source`, whose first bytes are `head`.
///
/// Cells are parsed directly into columns, so that the text of a long recording is never held in memory.
fn table(
    path: &Path,
    head: &[u8],
    source: impl BufRead,
    about: usize,
    how: &Reading,
) -> Result<(Table, Vec<String>), ReadError> {
    let whole = head.len() < HEAD;
    let dialect = Dialect::of(head, whole);
    let any = || expected(how.machine.unwrap_or_default().axes());
    if head.iter().all(u8::is_ascii_whitespace) {
        return Err(ReadError::content(path, "is empty", any()));
    }
    let binary = || ReadError::content(path, "is binary, not text", any());
    if dialect.is_binary(head) {
        return Err(binary());
    }
    let delimiter = dialect.delimiter();
    let source = Plain::new(source, &dialect).map_err(|e| ReadError::io(path, e))?;
    let mut reader =
        ::csv::ReaderBuilder::new().delimiter(delimiter).flexible(true).trim(::csv::Trim::All).from_reader(source);
    let broken = |e: ::csv::Error| match e.kind() {
        ::csv::ErrorKind::Utf8 { .. } => binary(),
        ::csv::ErrorKind::Io(e) if e.kind() == std::io::ErrorKind::InvalidData => binary(),
        _ => ReadError::content(path, e.to_string(), any()),
    };
    let names: Vec<String> = reader.headers().map_err(broken)?.iter().map(str::to_string).collect();
    if names.len() > MOST_COLUMNS {
        let problem = format!("has {} columns", names.len());
        return Err(ReadError::content(path, problem, format!("at most {MOST_COLUMNS}")));
    }

    let (layout, machine, mut warnings) = layout(path, &names, how)?;
    warnings.splice(0..0, dialect.notes.iter().cloned());
    let axes = machine.axes();
    let used = layout.used();
    let time = layout.time();
    let mut clock = Clock::default();
    let mut values = vec![Vec::new(); names.len()];
    let most = memory::for_messages(how.max_memory) / (size_of::<f64>() * (used.len() + 1));
    // Where the size of the file says nothing, such as of one with holes, the columns grow as they are read.
    let about = if about <= most { about } else { 0 };
    used.iter().for_each(|&i| values[i].reserve_exact(about));
    let mut rows = Vec::with_capacity(about);
    let mut record = ::csv::StringRecord::new();
    while reader.read_record(&mut record).map_err(broken)? {
        let line = record.position().map_or(0, |p| p.line()).saturating_sub(dialect.added());
        if record.len() != names.len() {
            let (cells, wanted) = (record.len(), names.len());
            let is_last = !matches!(reader.read_record(&mut record), Ok(true));
            if is_last && cells < wanted && !rows.is_empty() {
                // As the end of a writer leaves it.
                warnings
                    .push(format!("file is cut short: its last line, {line}, has {cells} of {wanted} cells: left out"));
                break;
            }
            let problem = format!("line {line} has {cells} cells");
            return Err(ReadError::content(path, problem, format!("{wanted} cells as in the header")));
        }
        if rows.len() >= most {
            let problem = format!("has more than {most} rows, for which memory does not suffice");
            return Err(ReadError::content(path, problem, "a shorter recording, or a larger --max-memory"));
        }
        rows.push(line);
        for &i in &used {
            let is_time = time.is_some_and(|(column, _)| column == i);
            let exact = if is_time { clock.since_start(&decimal(&record[i], delimiter)) } else { None };
            let value = exact.or_else(|| number(&record[i], delimiter));
            values[i].push(value.ok_or_else(|| ReadError::Value {
                file: path.into(),
                row: format!("line {line}"),
                column: names[i].clone(),
                problem: match &record[i] {
                    "" => "the cell is empty".into(),
                    cell => format!("`{}`", cell.chars().take(40).collect::<String>()),
                },
                expected: "a finite number".into(),
            })?);
        }
    }
    if rows.is_empty() {
        return Err(ReadError::content(path, "has a header but no samples", expected(axes)));
    }
    let t = match (time, how.rate) {
        (Some((column, stated)), _) => {
            let (t, noticed) = clock.seconds(&values[column], stated);
            warnings.extend(noticed.map(|what| format!("`{}` {what}", layout.text(column))));
            t
        }
        (None, rate) => (0..rows.len()).map(|k| k as f64 / rate.unwrap_or(1.0)).collect(),
    };
    Ok((layout.apply(t, values, rows, Frame { file: path, row: "line", machine, timed: false }), warnings))
}

/// Assignment of columns to channels, the machine, and notes on what is omitted or guessed.
fn layout(path: &Path, names: &[String], how: &Reading) -> Result<(Layout, Mechanism, Vec<String>), ReadError> {
    let mut layout = Layout::new(path, names, how)?;
    let machine = how.machine.unwrap_or_else(|| layout.machine());
    let axes = machine.axes();
    if how.machine.is_none() {
        layout.check(path, machine)?;
    }
    let mut guessed = Vec::new();
    match (how.rate, layout.has("t")) {
        (Some(rate), false) => guessed.push(format!("no column of time: the rows are taken as {rate} per second")),
        (Some(rate), true) => guessed.push(format!("--rate {rate} ignored: there is a column of time")),
        _ => {}
    }
    for wanted in check::required(axes) {
        let rated = wanted == "t" && how.rate.is_some();
        if !rated && !layout.has(&wanted) {
            let mut found: String = names.join(", ").chars().take(200).collect();
            if found.len() < names.join(", ").len() {
                found.push('…');
            }
            let problem = format!("has no column `{wanted}` (columns: {found})");
            let rate = if wanted == "t" { ", --rate HZ does without" } else { "" };
            let hint = format!("{}; --map \"{wanted}=COLUMN\" names another one{rate}", expected(axes));
            return Err(ReadError::content(path, problem, hint));
        }
    }
    let quoted = |i: &usize| format!("`{}`", layout.text(*i));
    let unknown: Vec<_> = layout.unused.iter().map(quoted).collect();
    let foreign = |name: &str| check::foreign(name, axes);
    let extra: Vec<_> = names.iter().filter(|n| foreign(n)).map(|n| format!("`{n}`")).collect();
    if let Some(ratio) = how.gear_ratio {
        layout.behind_gear(ratio);
    }
    let mut warnings = std::mem::take(&mut layout.notes);
    warnings.extend(guessed);
    if machine.effort() == Effort::Current {
        warnings.push("the current stands for the torque: all results are per torque constant, in A".into());
    }
    if !unknown.is_empty() {
        let shown = unknown.iter().take(UNKNOWN).cloned().collect::<Vec<_>>().join(", ");
        let more = unknown.len().saturating_sub(UNKNOWN);
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        warnings.push(format!("unknown columns ignored: {shown}{more}"));
    }
    if !extra.is_empty() {
        let has = if axes == 1 { "one axis".into() } else { format!("{axes} axes") };
        warnings.push(format!("columns {} ignored: the machine has {has}", extra.join(", ")));
    }
    layout.retain(|name| !foreign(name));
    Ok((layout, machine, warnings))
}

/// The cell with a decimal point.
fn decimal(cell: &str, delimiter: u8) -> Cow<'_, str> {
    if delimiter != b',' && cell.contains(',') { cell.replacen(',', ".", 1).into() } else { cell.into() }
}

/// The finite number in a cell, with a decimal point or comma.
pub(super) fn number(cell: &str, delimiter: u8) -> Option<f64> {
    let value: f64 = match cell.parse() {
        Ok(value) => value,
        Err(_) => decimal(cell, delimiter).parse().ok()?,
    };
    value.is_finite().then_some(value)
}

//! Assignment of a file's columns to channels, with units: by column names, by `[columns]` of the sidecar, by `--map`.
//!
//! Names are evaluated first; then each mapping replaces the channels it mentions, based on columns of the file or on
//! the channels assigned so far. Every assignment is affine: channel = `factor`·column + `offset`, with a delay.

mod channel;
mod delay;
mod mapping;
mod unit;

pub use mapping::Mapping;
pub use unit::{Quantity, Unit};

use std::path::Path;

use deltatwin::machine::{AXES, Mechanism};

use self::channel::{Guess, Header, guess, quantities};
use self::mapping::Assignment;
use super::ReadError;
use super::check::{Column, Table, known};

/// Source of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Source {
    /// Index of the column in the file.
    column: usize,
    factor: f64,
    offset: f64,
    /// Delay after which the value is stored in the file, s.
    delay: f64,
}

/// Channels of a file with their source columns.
pub(super) struct Layout {
    headers: Vec<Header>,
    channels: Vec<(String, Source)>,
    /// Descriptions of assignments that are not obvious from the names.
    pub notes: Vec<String>,
    /// Columns that are the source of no channel.
    pub unused: Vec<usize>,
}

impl Layout {
    /// Layout of a file with columns of these `names`, for a machine if it is known.
    ///
    /// # Errors
    /// A [`ReadError`] for two columns of one channel, an unknown or unsuitable unit, or a mapping from a column that
    /// does not exist.
    pub fn new(file: &Path, names: &[String], maps: &[Mapping], machine: Option<Mechanism>) -> Result<Self, ReadError> {
        let headers: Vec<Header> = names.iter().map(|n| Header::new(n)).collect();
        let claims = claims(&headers);
        let reader = Reader { file, headers: &headers, claims: &claims, machine };
        let mut channels = reader.by_name(maps)?;
        for map in maps {
            channels = reader.mapped(&channels, map)?;
        }
        let mut notes = Vec::new();
        let guessed: Vec<String> = channels.iter().filter_map(|(name, s)| note(name, s, &headers)).collect();
        if !guessed.is_empty() {
            notes.push(format!("columns read as: {}", guessed.join(", ")));
        }
        let used = |i: &usize| channels.iter().any(|(_, s)| s.column == *i);
        let unused = (0..headers.len()).filter(|i| !used(i)).collect();
        Ok(Self { headers, channels, notes, unused })
    }

    /// Whether the channel exists.
    pub fn has(&self, channel: &str) -> bool {
        self.channels.iter().any(|(name, _)| name == channel)
    }

    /// Removes the channels for which `keep` is false.
    pub fn retain(&mut self, keep: impl Fn(&str) -> bool) {
        self.channels.retain(|(name, _)| keep(name));
    }

    /// Column index of the time, and its unit in s.
    pub fn time(&self) -> Option<(usize, f64)> {
        self.channels.iter().find(|(name, _)| name == "t").map(|(_, s)| (s.column, s.factor))
    }

    /// Indices of the columns that are read.
    pub fn used(&self) -> Vec<usize> {
        let mut used: Vec<usize> = self.channels.iter().map(|(_, s)| s.column).collect();
        used.sort_unstable();
        used.dedup();
        used
    }

    /// Header text of a column.
    pub fn text(&self, column: usize) -> &str {
        &self.headers[column].text
    }

    /// Table of the channels, in file order; `t` is already in seconds.
    pub fn apply(&self, t: Vec<f64>, columns: &[Vec<f64>], rows: Vec<u64>, into: Frame) -> Table {
        let channels = || self.channels.iter().filter(|(name, _)| name != "t");
        let delays: Vec<f64> = channels().map(|(_, s)| s.delay).collect();
        let mut found: Vec<Column> =
            channels().map(|(name, s)| Column { name: name.clone(), values: affine(&columns[s.column], s) }).collect();
        let (mut t, mut rows) = (t, rows);
        if delays.iter().any(|d| *d != 0.0) {
            delay::remove(&mut t, &mut rows, &mut found, &delays);
        }
        Table { file: into.file.into(), row: into.row, rows, t, columns: found, machine: into.machine }
    }
}

/// Properties of a table besides its samples.
pub(super) struct Frame<'a> {
    pub file: &'a Path,
    pub row: &'static str,
    pub machine: Mechanism,
}

/// The table with remapped channels, and descriptions of the assignments.
pub(super) fn remap(table: Table, maps: &[Mapping]) -> Result<(Table, Vec<String>), ReadError> {
    if maps.is_empty() {
        return Ok((table, Vec::new()));
    }
    let Table { file, row, rows, t, columns, machine } = table;
    let mut names = vec!["t".to_string()];
    let mut values = vec![t];
    for c in columns {
        names.push(c.name);
        values.push(c.values);
    }
    let layout = Layout::new(&file, &names, maps, Some(machine))?;
    let t = layout.channels.iter().find(|(name, _)| name == "t").map(|(_, s)| affine(&values[s.column], s));
    let table = layout.apply(t.unwrap_or_default(), &values, rows, Frame { file: &file, row, machine });
    Ok((table, layout.notes))
}

fn affine(values: &[f64], s: &Source) -> Vec<f64> {
    if (s.factor, s.offset) == (1.0, 0.0) {
        return values.to_vec();
    }
    values.iter().map(|v| s.factor * v + s.offset).collect()
}

/// The channel inferred for each column from its name.
fn claims(headers: &[Header]) -> Vec<Option<String>> {
    let guesses: Vec<Option<Guess>> =
        headers.iter().map(|h| if known(&h.base) { None } else { guess(&h.base) }).collect();
    let numbers = |stem: &str| {
        let of = |g: &Option<Guess>| match g {
            Some(Guess::Axis(s, n)) if *s == stem => *n,
            _ => None,
        };
        guesses.iter().filter_map(of).collect::<Vec<_>>()
    };
    headers
        .iter()
        .zip(&guesses)
        .map(|(h, g)| match g {
            None => known(&h.base).then(|| h.base.clone()),
            Some(Guess::Time) => Some("t".into()),
            // Some files number axes from zero. A name without number belongs to the only axis.
            Some(Guess::Axis(stem, n)) => {
                let numbers = numbers(stem);
                let first = usize::from(numbers.contains(&0));
                let k = match n {
                    Some(n) => n + first,
                    None if numbers.is_empty() => 1,
                    None => return None,
                };
                (1..=AXES).contains(&k).then(|| format!("{stem}{k}"))
            }
        })
        .collect()
}

/// Description of a channel's source; `None` if the column name is that of the channel.
fn note(channel: &str, s: &Source, headers: &[Header]) -> Option<String> {
    let header = &headers[s.column];
    if header.base == channel && (s.factor, s.offset, s.delay) == (1.0, 0.0, 0.0) {
        return None;
    }
    let mut text = format!("{channel} = ");
    let stated = header.unit.as_deref().and_then(Unit::find).map_or(1.0, |u| u.factor);
    if s.factor != stated {
        text += &format!("{} × ", s.factor);
    }
    text += &format!("`{}`", header.text);
    if s.offset != 0.0 {
        text += &format!(" {} {}", if s.offset > 0.0 { '+' } else { '−' }, s.offset.abs());
    }
    if s.delay != 0.0 {
        text += &format!(" {} ms later", 1e3 * s.delay);
    }
    Some(text)
}

/// Lookup of columns of one file.
struct Reader<'a> {
    file: &'a Path,
    headers: &'a [Header],
    claims: &'a [Option<String>],
    machine: Option<Mechanism>,
}

type Channels = Vec<(String, Source)>;

impl Reader<'_> {
    fn refuse(&self, problem: String, expected: impl Into<String>) -> ReadError {
        ReadError::content(self.file, problem, expected)
    }

    /// Channels assigned by column names, without those set by a mapping.
    fn by_name(&self, maps: &[Mapping]) -> Result<Channels, ReadError> {
        let mapped = |channel: &str| maps.iter().flat_map(|m| &m.0).any(|a| a.channel == channel);
        let mut channels: Channels = Vec::new();
        for (i, claim) in self.claims.iter().enumerate() {
            let Some(channel) = claim else { continue };
            if let Some((_, other)) = channels.iter().find(|(name, _)| name == channel) {
                if mapped(channel) {
                    continue;
                }
                return Err(self.twice(channel, other.column, i));
            }
            match self.stated(channel, i) {
                Ok(factor) => {
                    channels.push((channel.clone(), Source { column: i, factor, offset: 0.0, delay: 0.0 }));
                }
                Err(_) if mapped(channel) => {}
                Err(e) => return Err(e),
            }
        }
        Ok(channels)
    }

    fn twice(&self, channel: &str, first: usize, second: usize) -> ReadError {
        let [a, b] = [first, second].map(|i| self.headers[i].text.as_str());
        if a == b {
            return self.refuse(format!("has two columns `{a}`"), "every column once");
        }
        let problem = format!("columns `{a}` and `{b}` both look like `{channel}`");
        self.refuse(problem, format!("one of them, such as with --map \"{channel}='{a}'\""))
    }

    /// SI units per unit of column `i`, the source of `channel`, as stated in its header.
    fn stated(&self, channel: &str, i: usize) -> Result<f64, ReadError> {
        let header = &self.headers[i];
        let Some(text) = &header.unit else { return Ok(1.0) };
        self.suitable(channel, &header.text, text, Unit::find(text), false)
    }

    fn suitable(
        &self,
        channel: &str,
        column: &str,
        text: &str,
        unit: Option<Unit>,
        scaled: bool,
    ) -> Result<f64, ReadError> {
        let wanted = quantities(channel, self.machine);
        let expected = || format!("one of {} for {channel}", Unit::names(wanted));
        let Some(unit) = unit else {
            return Err(self.refuse(format!("column `{column}`: `{text}` is no unit that is known"), expected()));
        };
        if wanted.contains(&unit.quantity) || (unit.quantity == Quantity::Signal && scaled) {
            return Ok(unit.factor);
        }
        if unit.quantity == Quantity::Signal {
            let name = column.split(['[', '(']).next().unwrap_or(column).trim();
            let problem = format!("column `{column}` is in {}, which is no unit of {channel}", unit.name);
            let factor = format!("a factor to SI, such as --map \"{channel}='{name}'[{}]*0.12\"", unit.name);
            return Err(self.refuse(problem, factor));
        }
        Err(self.refuse(format!("column `{column}`: {} is no unit of {channel}", unit.name), expected()))
    }

    fn mapped(&self, before: &Channels, map: &Mapping) -> Result<Channels, ReadError> {
        let mut channels = before.clone();
        for a in &map.0 {
            let source = self.source(before, a)?;
            match channels.iter_mut().find(|(name, _)| *name == a.channel) {
                Some((_, s)) => *s = source,
                None => channels.push((a.channel.clone(), source)),
            }
        }
        Ok(channels)
    }

    /// Source of an assignment: a channel assigned so far, or a column of the file.
    fn source(&self, before: &Channels, a: &Assignment) -> Result<Source, ReadError> {
        let channel = before.iter().find(|(name, _)| *name == a.column).map(|(_, s)| *s);
        if let (Some(s), None) = (channel, a.unit) {
            let (factor, offset) = (a.factor * s.factor, a.factor * s.offset + a.offset);
            return Ok(Source { column: s.column, factor, offset, delay: s.delay + a.delay });
        }
        let texts = self.headers.iter().position(|h| h.text == a.column);
        let bases = self.headers.iter().position(|h| h.base == a.column);
        // A channel whose column has another name, such as `q1` for `position_1`.
        let plain = channel.filter(|s| self.claims[s.column].as_deref() == Some(&a.column)).map(|s| s.column);
        let Some(column) = texts.or(bases).or(plain) else {
            let columns: Vec<&str> = self.headers.iter().map(|h| h.text.as_str()).collect();
            let mut columns: String = columns.join(", ").chars().take(200).collect();
            if columns.chars().count() == 200 {
                columns.push('…');
            }
            let problem = format!(
                "`{}` is mapped (--map, or [columns] of the setup) to the column `{}`, which is not there",
                a.channel, a.column
            );
            return Err(self.refuse(problem, format!("one of its columns (in quotes where need be): {columns}")));
        };
        let header = &self.headers[column];
        let scaled = a.factor != 1.0;
        let unit = match (&a.unit, &header.unit) {
            (Some(unit), _) => self.suitable(&a.channel, &a.column, unit.name, Some(*unit), scaled)?,
            (None, Some(text)) => self.suitable(&a.channel, &header.text, text, Unit::find(text), scaled)?,
            (None, None) => 1.0,
        };
        Ok(Source { column, factor: unit * a.factor, offset: unit * a.offset, delay: a.delay })
    }
}

#[cfg(test)]
mod tests;

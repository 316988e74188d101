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

use deltatwin::machine::{Axis, Effort, Joint, Mechanism, every_axis};

use self::channel::{CURRENT, Guess, Header, guess, quantities, slides};
use self::mapping::Assignment;
use super::check::{self, Column, Table, known};
use super::{ReadError, Reading};

/// Source of a channel.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Source {
    /// Index of the column in the file.
    column: usize,
    factor: f64,
    offset: f64,
    /// Delay after which the value is stored in the file, s.
    delay: f64,
    /// Quantity of the channel, where a unit states it.
    quantity: Option<Quantity>,
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
    /// Layout of a file with columns of these `names`, for the machine of `how` if it is known.
    ///
    /// # Errors
    /// A [`ReadError`] for two columns of one channel, an unknown or unsuitable unit, or a mapping from a column that
    /// does not exist.
    pub fn new(file: &Path, names: &[String], how: &Reading) -> Result<Self, ReadError> {
        let Reading { maps, machine, .. } = *how;
        let mut headers: Vec<Header> = names.iter().map(|n| Header::new(n)).collect();
        let mut notes = Vec::new();
        let claims = claims(&mut headers, how.joint, &mut notes);
        let reader = Reader { file, headers: &headers, claims: &claims, machine };
        let mut channels = reader.by_name(maps)?;
        for map in maps {
            channels = reader.mapped(&channels, map)?;
        }
        let guessed: Vec<String> = channels.iter().filter_map(|(name, s)| note(name, s, &headers)).collect();
        if !guessed.is_empty() {
            notes.push(format!("columns read as\n  {}", guessed.join(",\n  ")));
        }
        let used = |i: &usize| channels.iter().any(|(_, s)| s.column == *i);
        let unused = (0..headers.len()).filter(|i| !used(i)).collect();
        Ok(Self { headers, channels, notes, unused })
    }

    /// The machine whose axes have columns, see [`check::machine`]; for a single axis, joint and effort follow from the
    /// units of its columns.
    pub fn machine(&self) -> Mechanism {
        let Mechanism::Axis(plain) = check::machine(|name| self.has(name)) else {
            return check::machine(|name| self.has(name));
        };
        let stated = |wanted: &[Quantity]| {
            let of = |name: &str| self.channels.iter().find(|(n, _)| n == name).and_then(|(_, s)| s.quantity);
            ["q1", "qd1", "qdd1", "tau1"].iter().filter_map(|name| of(name)).any(|q| wanted.contains(&q))
        };
        // Where no unit tells, a name such as `Force` does.
        let turns = [Quantity::Angle, Quantity::AngularRate, Quantity::AngularAcceleration, Quantity::Torque];
        let named = |(_, s): &(String, Source)| slides(&self.headers[s.column].base);
        let slides = stated(&[Quantity::Length, Quantity::Velocity, Quantity::Acceleration, Quantity::Force])
            || (!stated(&turns) && self.channels.iter().any(named));
        let effort = if stated(&[Quantity::Current]) { Effort::Current } else { plain.effort };
        Mechanism::Axis(Axis { joint: if slides { Joint::Prismatic } else { plain.joint }, effort })
    }

    /// Checks that the units of all channels are those of a machine that was inferred after the channels were assigned.
    ///
    /// # Errors
    /// A [`ReadError`] that names the first column with another quantity, and what was expected.
    pub fn check(&self, file: &Path, machine: Mechanism) -> Result<(), ReadError> {
        for (channel, source) in &self.channels {
            let header = &self.headers[source.column];
            let wanted = quantities(channel, Some(machine));
            let Some(quantity) = source.quantity.filter(|q| !wanted.contains(q)) else { continue };
            let reader = Reader { file, headers: &self.headers, claims: &[], machine: Some(machine) };
            return Err(reader.unsuitable(channel, &header.text, quantity));
        }
        Ok(())
    }

    /// Refers angles, rates and accelerations, and torques where they are no currents, to the output of a gear.
    pub fn behind_gear(&mut self, ratio: f64) {
        for (name, source) in &mut self.channels {
            let factor = match name.trim_end_matches(|c: char| c.is_ascii_digit()) {
                "q" | "qd" | "qdd" => 1.0 / ratio,
                "tau" if source.quantity != Some(Quantity::Current) => ratio,
                _ => continue,
            };
            source.factor *= factor;
            source.offset *= factor;
        }
        self.notes.push(format!(
            "taken for the motor's side of a gear of {ratio}: angles and rates divided by it, torques multiplied (currents \
             are left as they are: the torque constant then is that at the joint)"
        ));
    }

    /// Whether the channel exists.
    pub fn has(&self, channel: &str) -> bool {
        self.channels.iter().any(|(name, _)| name == channel)
    }

    /// The channel that each of `columns` columns is read as; of several the first.
    pub fn by_column(&self, columns: usize) -> Vec<Option<String>> {
        let of = |i: usize| self.channels.iter().find(|(_, s)| s.column == i).map(|(name, _)| name.clone());
        (0..columns).map(of).collect()
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

    /// Table of the channels, in file order; `t` is already in seconds. A column is moved into the last channel that it
    /// is the source of, so that a long recording is not held twice.
    pub fn apply(&self, t: Vec<f64>, mut columns: Vec<Vec<f64>>, rows: Vec<u64>, into: Frame) -> Table {
        let channels: Vec<_> = self.channels.iter().filter(|(name, _)| name != "t").collect();
        let delays: Vec<f64> = channels.iter().map(|(_, s)| s.delay).collect();
        let mut found = Vec::with_capacity(channels.len());
        for (k, (name, s)) in channels.iter().enumerate() {
            let again = channels[k + 1..].iter().any(|(_, other)| other.column == s.column);
            let column = &mut columns[s.column];
            let values = if again { column.clone() } else { std::mem::take(column) };
            found.push(Column { name: name.clone(), values: affine(values, s) });
        }
        drop(columns);
        let (mut t, mut rows) = (t, rows);
        if delays.iter().any(|d| *d != 0.0) {
            delay::remove(&mut t, &mut rows, &mut found, &delays);
        }
        let is_stated = |(name, s): &(String, Source)| name == "t" && s.quantity.is_some();
        let timed = into.timed || self.channels.iter().any(is_stated);
        Table { file: into.file.into(), row: into.row, rows, t, timed, columns: found, machine: into.machine }
    }
}

/// Properties of a table besides its samples.
pub(super) struct Frame<'a> {
    pub file: &'a Path,
    pub row: &'static str,
    pub machine: Mechanism,
    pub timed: bool,
}

/// The table with remapped channels, and descriptions of the assignments.
pub(super) fn remap(table: Table, how: &Reading) -> Result<(Table, Vec<String>), ReadError> {
    if how.maps.is_empty() && how.gear_ratio.is_none() {
        return Ok((table, Vec::new()));
    }
    let Table { file, row, rows, t, timed, columns, machine } = table;
    let mut names = vec!["t".to_string()];
    let mut values = vec![t];
    for c in columns {
        names.push(c.name);
        values.push(c.values);
    }
    let mut layout = Layout::new(&file, &names, &Reading { machine: Some(machine), joint: None, ..*how })?;
    if let Some(ratio) = how.gear_ratio {
        layout.behind_gear(ratio);
    }
    let t = layout.channels.iter().find(|(name, _)| name == "t").map(|(_, s)| affine(values[s.column].clone(), s));
    let table = layout.apply(t.unwrap_or_default(), values, rows, Frame { file: &file, row, machine, timed });
    Ok((table, layout.notes))
}

fn affine(mut values: Vec<f64>, s: &Source) -> Vec<f64> {
    if (s.factor, s.offset) != (1.0, 0.0) {
        values.iter_mut().for_each(|v| *v = s.factor * *v + s.offset);
    }
    values
}

/// The channel inferred for each column from its name; a motor current without a unit gets that of ampere.
///
/// Numbers of axes may start from zero; a name without number belongs to the only axis, and so does the only number of
/// a file. A current stands for the torque of an axis without one.
fn claims(headers: &mut [Header], joint: Option<&str>, notes: &mut Vec<String>) -> Vec<Option<String>> {
    // Of one axis of several, the names of the format are as good as any.
    let chosen: Option<usize> = joint.and_then(|j| j.trim_start_matches(|c: char| !c.is_ascii_digit()).parse().ok());
    let guessed = |h: &Header| if known(&h.base) && chosen.is_none() { None } else { guess(&h.base) };
    let of_joint = |g: &Guess| match (g, chosen) {
        (Guess::Axis(_, n), Some(chosen)) => *n == Some(chosen),
        _ => true,
    };
    let guesses: Vec<Option<Guess>> = headers.iter().map(|h| guessed(h).filter(of_joint)).collect();
    let named: Vec<usize> =
        guesses.iter().flatten().filter_map(|g| if let Guess::Axis(_, n) = g { *n } else { None }).collect();
    let own = headers.iter().any(|h| known(&h.base) && h.base != "t");
    // An axis cut out of a robot keeps its number.
    let only = named.first().copied().filter(|n| *n > 1 && !own && named.iter().all(|m| m == n));
    if let (Some(only), None) = (only, chosen) {
        notes.push(format!("only axis {only} has columns: read as the lone axis 1"));
    }
    let only = chosen.or(only);
    let numbers = |stem: &str| {
        let of = |g: &Option<Guess>| match g {
            Some(Guess::Axis(s, n)) if *s == stem => *n,
            _ => None,
        };
        guesses.iter().filter_map(of).collect::<Vec<_>>()
    };
    let axis = |stem: &str, n: &Option<usize>| {
        let numbers = numbers(stem);
        let first = usize::from(numbers.contains(&0));
        let k = match n {
            Some(n) if Some(*n) == only => 1,
            Some(n) => n + first,
            None if numbers.is_empty() => 1,
            None => return None,
        };
        (1..=every_axis().end).contains(&k).then_some(k)
    };
    let mut claims: Vec<Option<String>> = headers
        .iter()
        .zip(&guesses)
        .map(|(h, g)| match g {
            None => (known(&h.base) && chosen.is_none()).then(|| h.base.clone()),
            Some(Guess::Time) => Some("t".into()),
            Some(Guess::Axis(CURRENT, _)) => None,
            Some(Guess::Axis(stem, n)) => axis(stem, n).map(|k| format!("{stem}{k}")),
        })
        .collect();
    for (i, g) in guesses.iter().enumerate() {
        let Some(Guess::Axis(CURRENT, n)) = g else { continue };
        headers[i].unit.get_or_insert_with(|| "A".into());
        let Some(channel) = axis(CURRENT, n).map(|k| format!("tau{k}")) else { continue };
        if !claims.contains(&Some(channel.clone())) {
            claims[i] = Some(channel);
        }
    }
    claims
}

/// Description of a channel's source; `None` if the column name is that of the channel.
fn note(channel: &str, s: &Source, headers: &[Header]) -> Option<String> {
    let header = &headers[s.column];
    if header.base == channel && (s.factor, s.offset, s.delay) == (1.0, 0.0, 0.0) {
        return None;
    }
    let mut text = format!("{channel:<5} = ");
    let stated = header.unit.as_deref().and_then(Unit::find).map_or(1.0, |u| u.factor);
    if s.factor != stated {
        text += &format!("{} × ", in_digits(s.factor));
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

/// A factor with at most six digits, or as the fraction of π that it is.
fn in_digits(factor: f64) -> String {
    use std::f64::consts::PI;
    let fractions = [(PI / 180.0, "π/180"), (PI / 30.0, "π/30"), (2.0 * PI, "2π")];
    let sign = if factor < 0.0 { "−" } else { "" };
    let is_it = |value: f64| (factor.abs() / value - 1.0).abs() < 1e-9;
    match fractions.into_iter().find(|(value, _)| is_it(*value)) {
        Some((_, text)) => format!("{sign}{text}"),
        None => {
            let short = format!("{:.5e}", factor).parse().unwrap_or(factor);
            if (1e-4..1e6).contains(&factor.abs()) { format!("{short}") } else { format!("{short:e}") }
        }
    }
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
                Ok((factor, quantity)) => {
                    let source = Source { column: i, factor, offset: 0.0, delay: 0.0, quantity };
                    channels.push((channel.clone(), source));
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

    /// SI units per unit of column `i`, the source of `channel`, as stated in its header, and their quantity.
    fn stated(&self, channel: &str, i: usize) -> Result<(f64, Option<Quantity>), ReadError> {
        let header = &self.headers[i];
        let Some(text) = &header.unit else { return Ok((1.0, None)) };
        self.suitable(channel, &header.text, text, Unit::find(text), false)
    }

    /// SI units per unit of a column for `channel`, and the quantity that results; `scaled` if a factor turns a signal
    /// into a torque.
    fn suitable(
        &self,
        channel: &str,
        column: &str,
        text: &str,
        unit: Option<Unit>,
        scaled: bool,
    ) -> Result<(f64, Option<Quantity>), ReadError> {
        let wanted = quantities(channel, self.machine);
        let Some(unit) = unit else {
            let expected = format!("one of {} for {channel}", Unit::names(wanted));
            return Err(self.refuse(format!("column `{column}`: `{text}` is no unit that is known"), expected));
        };
        if wanted.contains(&unit.quantity) {
            return Ok((unit.factor, Some(unit.quantity)));
        }
        let signal = matches!(unit.quantity, Quantity::Signal | Quantity::Current);
        if signal && scaled {
            return Ok((unit.factor, None));
        }
        // Whether the machine is a single axis, whose current may stand for its torque, is not known yet.
        if unit.quantity == Quantity::Current && self.machine.is_none() && wanted.contains(&Quantity::Torque) {
            return Ok((unit.factor, Some(Quantity::Current)));
        }
        Err(self.unsuitable_unit(channel, column, unit))
    }

    fn unsuitable_unit(&self, channel: &str, column: &str, unit: Unit) -> ReadError {
        let wanted = quantities(channel, self.machine);
        let name = column.split(['[', '(']).next().unwrap_or(column).trim();
        if matches!(unit.quantity, Quantity::Signal | Quantity::Current) {
            let problem = format!("column `{column}` is in {}, which is no unit of {channel}", unit.name);
            let lone = match self.machine {
                Some(Mechanism::Axis(_)) if unit.quantity == Quantity::Current => {
                    ", or a model in ampere (effort = \"A\"), which `deltatwin new axis` makes"
                }
                _ => "",
            };
            let found = " (with *1 `check --model` finds it)";
            let (share, found) = match unit.name {
                "%" => (", the rated torque at the joint / 100", found),
                "‰" => (", the rated torque at the joint / 1000", found),
                "inc" => (", the torque of a count at the joint", found),
                _ => ("", ""),
            };
            let unit = unit.name;
            let factor =
                format!("a factor to SI{share}, such as --map \"{channel}='{name}'[{unit}]*0.12\"{found}{lone}");
            return self.refuse(problem, factor);
        }
        let expected = match (wanted, unit.quantity) {
            ([Quantity::Force], Quantity::Torque) => {
                format!("a force at the slide, such as with --map \"{channel}='{name}'[N]*RATIO\", RATIO in rad/m")
            }
            ([Quantity::Current], _) => "A, as the model is in ampere (effort = \"A\")".into(),
            _ => format!("one of {} for {channel}", Unit::names(wanted)),
        };
        self.refuse(format!("column `{column}`: {} is no unit of {channel}", unit.name), expected)
    }

    /// Error for a channel whose quantity is not one of the machine's.
    fn unsuitable(&self, channel: &str, column: &str, quantity: Quantity) -> ReadError {
        let stated = self.headers.iter().find(|h| h.text == column).and_then(|h| Unit::find(h.unit.as_deref()?));
        let unit = stated.filter(|u| u.quantity == quantity).or_else(|| Unit::of(quantity));
        unit.map_or_else(
            || self.refuse(format!("column `{column}` is no {channel}"), "another unit"),
            |unit| self.unsuitable_unit(channel, column, unit),
        )
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
            // A factor on a current is its torque constant, unless the machine is one in ampere.
            let quantity = s.quantity.filter(|q| *q != Quantity::Current || !self.scales(a));
            return Ok(Source { column: s.column, factor, offset, delay: s.delay + a.delay, quantity });
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
        let scaled = self.scales(a);
        let (unit, quantity) = match (&a.unit, &header.unit) {
            (Some(unit), _) => self.suitable(&a.channel, &a.column, unit.name, Some(*unit), scaled)?,
            (None, Some(text)) => self.suitable(&a.channel, &header.text, text, Unit::find(text), scaled)?,
            (None, None) => (1.0, None),
        };
        Ok(Source { column, factor: unit * a.factor, offset: unit * a.offset, delay: a.delay, quantity })
    }

    /// Whether an assignment scales its column to another quantity, on a machine that is not in ampere.
    fn scales(&self, a: &Assignment) -> bool {
        a.scaled && self.machine.is_none_or(|m| m.effort() == Effort::Force)
    }
}

#[cfg(test)]
mod tests;

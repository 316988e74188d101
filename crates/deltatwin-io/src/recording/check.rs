//! Conversion of columns to signals, with checks and repairs.

mod channels;
mod names;
mod plausible;
mod sampling;

use std::path::PathBuf;

use deltatwin::machine::Mechanism;
use deltatwin::recording::Signals;

pub(super) use self::channels::check;
pub(super) use self::names::{foreign, known, machine, required};
use super::ReadError;

/// Smallest number of samples of a recording and of a stretch between gaps: the widest polynomial of the derivatives, three
/// samples either side, and as many more as a law has parameters.
const MIN_SAMPLES: usize = 10;

/// Columns of a file, one per channel.
pub(super) struct Table {
    pub file: PathBuf,
    /// Word for a row in messages, e.g. `line`.
    pub row: &'static str,
    /// Row number of each sample.
    pub rows: Vec<u64>,
    pub t: Vec<f64>,
    /// Whether the unit of time is stated.
    pub timed: bool,
    pub columns: Vec<Column>,
    /// Machine whose axes the file must contain.
    pub machine: Mechanism,
}

/// One channel, named as in CSV.
pub(super) struct Column {
    pub name: String,
    pub values: Vec<f64>,
}

/// Checks and repairs `table`; also returns warnings.
pub(super) fn signals(mut table: Table) -> Result<(Signals, Vec<String>), ReadError> {
    let mut warnings = Vec::new();
    table.finite()?;
    table.repeated(&mut warnings);
    table.increasing()?;
    if table.t.len() < MIN_SAMPLES {
        let problem = format!("has only {} samples", table.t.len());
        return Err(ReadError::content(&table.file, problem, format!("at least {MIN_SAMPLES}")));
    }
    table.units(&mut warnings)?;
    table.constant(&mut warnings)?;
    table.unwrap_axis4(&mut warnings);
    table.fast_axis4(&mut warnings);
    table.jumps(&mut warnings);
    table.rates(&mut warnings)?;
    for k in 1..=table.machine.axes() {
        table.clipped(k, &mut warnings);
        table.frozen(k, &mut warnings);
    }
    let segments = table.sampling(&mut warnings)?;
    Ok((table.into_signals(segments, &mut warnings), warnings))
}

impl Table {
    fn column(&self, name: &str) -> Option<&[f64]> {
        self.columns.iter().find(|c| c.name == name).map(|c| c.values.as_slice())
    }

    fn at(&self, i: usize) -> String {
        match self.rows.get(i) {
            Some(row) => format!("{} {row}", self.row),
            None => format!("{} {}", self.row, i + 1),
        }
    }

    fn value_error(
        &self,
        i: usize,
        column: &str,
        problem: impl Into<String>,
        expected: impl Into<String>,
    ) -> ReadError {
        ReadError::Value {
            file: self.file.clone(),
            row: self.at(i),
            column: column.into(),
            problem: problem.into(),
            expected: expected.into(),
        }
    }

    fn finite(&self) -> Result<(), ReadError> {
        let t = ("t", self.t.as_slice());
        let others = self.columns.iter().map(|c| (c.name.as_str(), c.values.as_slice()));
        for (name, values) in std::iter::once(t).chain(others) {
            if let Some(i) = values.iter().position(|v| !v.is_finite()) {
                return Err(self.value_error(i, name, values[i].to_string(), "a finite number"));
            }
        }
        Ok(())
    }

    /// Drops rows identical to the previous one, time included.
    fn repeated(&mut self, warnings: &mut Vec<String>) {
        let same = |v: &[f64], i: usize| v[i] == v[i - 1];
        let again = |i: usize| i > 0 && same(&self.t, i) && self.columns.iter().all(|c| same(&c.values, i));
        let kept: Vec<usize> = (0..self.t.len()).filter(|&i| !again(i)).collect();
        let dropped = self.t.len() - kept.len();
        if dropped == 0 {
            return;
        }
        let first = (0..self.t.len()).find(|&i| again(i)).map_or(String::new(), |i| self.at(i));
        warnings.push(format!("{dropped} samples repeat the one before, first at {first}: dropped"));
        let cut = |v: &[f64]| kept.iter().map(|&i| v[i]).collect();
        self.t = cut(&self.t);
        for c in &mut self.columns {
            c.values = cut(&c.values);
        }
        if !self.rows.is_empty() {
            self.rows = kept.iter().map(|&i| self.rows[i]).collect();
        }
    }

    fn increasing(&self) -> Result<(), ReadError> {
        let Some(i) = self.t.windows(2).position(|w| w[1] <= w[0]) else {
            return Ok(());
        };
        let (before, after) = (self.t[i], self.t[i + 1]);
        let (problem, expected) = if after == before {
            (format!("{after} s for the second time"), "increasing time with enough digits")
        } else {
            (format!("time goes back from {before} s to {after} s"), "increasing time")
        };
        Err(self.value_error(i + 1, "t", problem, expected))
    }
}

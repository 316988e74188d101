//! A look at the columns of a table before it is a recording: names, units, assignment, samples.

use std::io::{BufRead, BufReader};
use std::path::Path;

use super::columns::Layout;
use super::dialect::{Dialect, Plain};
use super::{ReadError, Reading};

/// Columns of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct Preview {
    /// The columns in the order of the file.
    pub columns: Vec<PreviewColumn>,
    /// Number of rows below the names.
    pub rows: usize,
    /// What stands in the way of reading the columns as channels; `None` if nothing does so far.
    pub problem: Option<String>,
}

/// A column of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct PreviewColumn {
    /// Its name with the unit, as in the file.
    pub name: String,
    /// The channel that it is read as; `None` if it is not read.
    pub channel: Option<String>,
    /// Smallest and largest value of the successive stretches of the file; NaN where no cell is a number.
    pub stretches: Vec<[f64; 2]>,
    /// Its first cells as text.
    pub first: Vec<String>,
}

/// Number of stretches in which a column is shown.
const STRETCHES: usize = 400;
/// Number of cells shown as text.
const FIRST: usize = 3;
/// Number of bytes from which the form of a file is determined, as for reading it.
const HEAD: usize = 1 << 16;

/// The columns of the table of text at `path`, assigned to channels as [`read_as`](super::read_as) would. Cells that are no
/// numbers and rows of another length are no error here.
///
/// # Errors
/// If the file cannot be read or is not text.
pub fn preview(path: &Path, how: &Reading) -> Result<Preview, ReadError> {
    let file = std::fs::File::open(path).map_err(|e| ReadError::io(path, e))?;
    let mut source = BufReader::with_capacity(HEAD, file);
    let head = source.fill_buf().map_err(|e| ReadError::io(path, e))?.to_vec();
    let dialect = Dialect::of(&head, head.len() < HEAD);
    let text = || ReadError::content(path, "is not a table of text", "names of columns and numbers below");
    if dialect.is_binary(&head) || head.iter().all(u8::is_ascii_whitespace) {
        return Err(text());
    }
    let plain = Plain::new(source, &dialect).map_err(|e| ReadError::io(path, e))?;
    let mut reader = ::csv::ReaderBuilder::new()
        .delimiter(dialect.delimiter())
        .flexible(true)
        .trim(::csv::Trim::All)
        .from_reader(plain);
    let names: Vec<String> = reader.headers().map_err(|_| text())?.iter().map(str::to_string).collect();
    let (channels, problem) = match Layout::new(path, &names, how) {
        Ok(layout) => (layout.by_column(names.len()), None),
        Err(e) => (vec![None; names.len()], Some(e.to_string())),
    };
    let mut values = vec![Vec::new(); names.len()];
    let mut first = vec![Vec::new(); names.len()];
    let mut record = ::csv::StringRecord::new();
    let mut rows = 0;
    while reader.read_record(&mut record).map_err(|_| text())? {
        for (i, cell) in record.iter().enumerate().take(names.len()) {
            values[i].push(super::csv::number(cell, dialect.delimiter()).unwrap_or(f64::NAN));
            if rows < FIRST {
                first[i].push(cell.chars().take(24).collect());
            }
        }
        rows += 1;
    }
    let column = |i: usize| PreviewColumn {
        name: names[i].clone(),
        channel: channels[i].clone(),
        stretches: stretches(&values[i]),
        first: first[i].clone(),
    };
    let columns = (0..names.len()).map(column).collect();
    Ok(Preview { columns, rows, problem })
}

/// Smallest and largest value of successive stretches.
fn stretches(values: &[f64]) -> Vec<[f64; 2]> {
    let size = values.len().div_ceil(STRETCHES).max(1);
    let of = |part: &[f64]| {
        let ends = part.iter().filter(|x| x.is_finite()).fold(None, |ends: Option<[f64; 2]>, &x| {
            Some(ends.map_or([x, x], |[low, high]| [low.min(x), high.max(x)]))
        });
        ends.unwrap_or([f64::NAN; 2])
    };
    values.chunks(size).map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str, maps: &[super::super::Mapping]) -> Preview {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.csv");
        std::fs::write(&path, text).unwrap();
        preview(&path, &Reading { maps, ..Reading::default() }).unwrap()
    }

    #[test]
    fn columns_are_shown_with_what_they_are_read_as() {
        let text = "time_ms;Winkel 1 [deg];strange;note\n0;1,5;7;a\n1;-2,5;8;b\n2;x;9;c\n";
        let p = of(text, &[]);
        assert_eq!((p.rows, p.columns.len()), (3, 4));
        assert_eq!(p.columns[0].channel.as_deref(), Some("t"));
        assert_eq!(p.columns[1].channel.as_deref(), Some("q1"));
        assert_eq!((p.columns[2].channel.as_deref(), &p.columns[1].stretches[1]), (None, &[-2.5, -2.5]));
        assert!(p.columns[3].stretches[0][0].is_nan() && p.columns[3].first == ["a", "b", "c"]);
        let mapped = of(text, &["tau1=strange[Nm]*-1".parse().unwrap()]);
        assert_eq!(mapped.columns[2].channel.as_deref(), Some("tau1"));
        let wrong = of(text, &["tau1=absent".parse().unwrap()]);
        assert!(wrong.problem.unwrap().contains("absent") && wrong.columns.len() == 4);
    }

    #[test]
    fn no_peak_is_lost() {
        let mut text = String::from("t,q1\n");
        (0..10_000).for_each(|k| text += &format!("{k},{}\n", if k == 4321 { 99 } else { 0 }));
        let p = of(&text, &[]);
        assert!(p.columns[1].stretches.len() <= STRETCHES);
        assert_eq!(p.columns[1].stretches.iter().filter(|s| s[1] == 99.0).count(), 1);
    }
}

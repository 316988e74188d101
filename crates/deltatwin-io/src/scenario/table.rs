//! Look-up tables of motions: CSV with `t` and either `x, y, z, psi` of the platform or the joint angles `q1…q4`, as
//! far as the machine has them.

use std::path::Path;

use deltatwin::scenario::motion::table::Table;

use crate::file;

const PLATFORM: [&str; 4] = ["x", "y", "z", "psi"];
const JOINTS: [&str; 4] = ["q1", "q2", "q3", "q4"];
const EXPECTED: &str =
    "expected CSV with the columns t, x, y, z, psi or t, q1, q2, q3, q4, as far as the machine has them";
/// Smallest time between rows, s.
const NEAREST: f64 = 1e-9;
/// Size of the longest table, bytes: more than an hour at 2.5 kHz.
const LONGEST: u64 = 1 << 30;

/// Reads a look-up table from the file `path`; see [`Table`] for `moving`.
///
/// # Errors
/// A description of the fault, with line and column where applicable.
pub(super) fn read(path: &Path, moving: bool) -> Result<Table, String> {
    let content = file::bytes(path, LONGEST).map_err(|e| format!("cannot be read: {e}"))?;
    let text = String::from_utf8(content).map_err(|_| format!("is not text; {EXPECTED}"))?;
    parse(&text, path, moving)
}

/// Reads a look-up table from `text`, which is the content of `file`.
///
/// # Errors
/// A description of the fault, with line and column where applicable.
pub(super) fn parse(text: &str, file: &Path, moving: bool) -> Result<Table, String> {
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(text.trim_start_matches('\u{feff}').as_bytes());
    let header = reader.headers().map_err(|e| e.to_string())?.clone();
    let column = |name: &str| header.iter().position(|h| h == name);
    // The last columns may be missing if there are no others: the machine does not have these axes.
    let all = |names: [&str; 4], fewer: &[usize]| {
        let found: Vec<usize> = names.iter().map_while(|name| column(name)).collect();
        let alone = fewer.contains(&found.len()) && header.len() == found.len() + 1;
        (found.len() == 4 || alone).then_some(found)
    };
    let (time, joints, columns) = match (column("t"), all(PLATFORM, &[3]), all(JOINTS, &[1, 3])) {
        (Some(t), Some(columns), None) => (t, false, columns),
        (Some(t), None, Some(columns)) => (t, true, columns),
        (Some(_), Some(_), Some(_)) => return Err(format!("has platform and joint columns; {EXPECTED}")),
        _ => {
            let found: String = header.iter().collect::<Vec<_>>().join(", ").chars().take(200).collect();
            return Err(format!("has the columns {found}; {EXPECTED}"));
        }
    };
    let mut table = Table { file: file.into(), joints, t: vec![], rows: vec![], moving };
    for record in reader.records() {
        let record = record.map_err(|e| e.to_string())?;
        let line = record.position().map_or(0, csv::Position::line);
        let number = |column: usize| {
            let cell = record.get(column).unwrap_or_default();
            match cell.parse::<f64>() {
                Ok(v) if v.is_finite() && v.abs() <= 1e6 => Ok(v),
                _ => {
                    let name = &header[column];
                    Err(format!("line {line}, column `{name}` is \"{cell}\"; expected a number up to 1e6"))
                }
            }
        };
        let t = number(time)?;
        if let Some(last) = table.t.last().filter(|last| t <= **last + NEAREST) {
            return Err(format!("line {line}, column `t` is {t} after {last}; expected increasing times"));
        }
        table.t.push(t);
        let mut row = [0.0; 4];
        for (value, column) in row.iter_mut().zip(&columns) {
            *value = number(*column)?;
        }
        table.rows.push(row);
    }
    if table.t.len() < 2 {
        return Err(format!("has {} row(s); expected two or more", table.t.len()));
    }
    let start = table.t[0];
    table.t.iter_mut().for_each(|t| *t -= start);
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Result<Table, String> {
        parse(text, Path::new("table.csv"), false)
    }

    #[test]
    fn mistakes_are_named_with_their_line() {
        let good = "# comment\nt,x,y,z,psi\n0,0,0,-1,0\n0.1,0.01,0,-1,0\n0.2,0.02,0,-1,0\n";
        assert_eq!(table(good).unwrap().rows[1], [0.01, 0.0, -1.0, 0.0]);
        for (from, to, expected) in [
            ("0.2,", "0.1,", "line 5, column `t` is 0.1 after 0.1"),
            ("0.1,", "0.3,", "line 5, column `t`"),
            ("0.01", "NaN", "line 4, column `x` is \"NaN\""),
            ("0.01", "fast", "line 4, column `x` is \"fast\""),
            ("0.02,", "", "line: 5"),
            ("psi", "phi", "has the columns t, x, y, z, phi"),
        ] {
            let e = table(&good.replacen(from, to, 1)).unwrap_err();
            assert!(e.contains(expected), "{e}");
        }
        assert!(table("t,x,y,z,psi\n0,0,0,-1,0\n").unwrap_err().contains("1 row(s)"));
        assert!(table("t,q1,q2,q3,q4,x,y,z,psi\n").unwrap_err().contains("platform and joint"));
        assert!(table("t,q1,q2,q3,q4,tau1\n1,0,0,0,0,9\n2,0,0,0,1,9\n").unwrap().joints);
        assert!(table("").is_err());
        // Fewer columns for a machine with fewer axes, but no misspelt ones.
        let [x, q] = ["t,x,y,z\n0,0,0,-1\n1,0,0,-1\n", "t,q1\n0,0.5\n1,0\n"].map(|text| table(text).unwrap());
        assert!(!x.joints && q.joints && x.rows[0] == [0.0, 0.0, -1.0, 0.0] && q.rows[0] == [0.5, 0.0, 0.0, 0.0]);
        assert!(table("t,q1,q2\n0,0,0\n1,0,0\n").is_err());
    }
}

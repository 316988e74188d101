//! Covariance of a fitted model, in a table beside its file: a row and a column per parameter.

use std::path::{Path, PathBuf};

use deltatwin::identification::uncertainty::Uncertainty;
use nalgebra::DMatrix;

use crate::file::{self, replace_text};

/// First columns of the table.
const HEAD: &str = "parameter";
/// Size of the longest table, bytes.
const LONGEST: u64 = 1 << 26;

/// File of the covariance of the model in `model`: `better.toml` has `better.covariance.csv`.
pub fn beside(model: &Path) -> PathBuf {
    model.with_extension("covariance.csv")
}

/// Writes the covariance of the model in the file `model` beside it: `parameter` and one column per parameter, in
/// products of their units.
///
/// # Errors
/// If the file cannot be written.
pub fn write(uncertainty: &Uncertainty, model: &Path) -> std::io::Result<()> {
    let mut text = format!("{HEAD},{}\n", uncertainty.names.join(","));
    for (name, row) in uncertainty.names.iter().zip(uncertainty.covariance.row_iter()) {
        text += name;
        for x in row.iter() {
            text += &format!(",{x:e}");
        }
        text.push('\n');
    }
    replace_text(&beside(model), &text)
}

/// The covariance of the model in the file `model`.
///
/// # Errors
/// If the table beside it cannot be read, is not square, or holds something that is no finite number: file, row, column
/// and value.
pub fn read(model: &Path) -> Result<Uncertainty, String> {
    let path = beside(model);
    let said = |what: String| format!("{}: {what}", path.display());
    let bytes = file::bytes(&path, LONGEST)
        .map_err(|e| said(format!("{e}; expected the covariance that `identify -o` writes beside its model")))?;
    let text = String::from_utf8(bytes).map_err(|_| said("is not UTF-8".into()))?;
    let mut lines = text.lines();
    let head = lines.next().unwrap_or_default();
    let names: Vec<String> = match head.split_once(',') {
        Some((HEAD, names)) => names.split(',').map(String::from).collect(),
        _ => return Err(said(format!("row 1 begins with `{head:.40}`; expected `{HEAD}` and the parameters' names"))),
    };
    let mut numbers = Vec::new();
    for (k, line) in lines.enumerate() {
        let row = k + 2;
        let mut cells = line.split(',');
        let own = cells.next().unwrap_or_default();
        if names.get(k).is_none_or(|name| name != own) {
            let expected = names.get(k).map_or("the end", String::as_str);
            return Err(said(format!("row {row} is of `{own:.40}`; expected {expected}, as in the first row")));
        }
        let values: Vec<&str> = cells.collect();
        if values.len() != names.len() {
            return Err(said(format!("row {row} has {} numbers; expected {}", values.len(), names.len())));
        }
        for (name, cell) in names.iter().zip(values) {
            let number: Option<f64> = cell.parse().ok().filter(|x: &f64| x.is_finite());
            let wrong = || said(format!("row {row}, column {name}: `{cell:.40}`; expected a finite number"));
            numbers.push(number.ok_or_else(wrong)?);
        }
    }
    if numbers.len() != names.len() * names.len() {
        return Err(said(format!("has {} of {} rows; is it cut short?", numbers.len() / names.len(), names.len())));
    }
    Ok(Uncertainty { covariance: DMatrix::from_row_slice(names.len(), names.len(), &numbers), names })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_covariance_comes_back_as_it_was_and_mistakes_have_a_place() {
        let folder = tempfile::tempdir().unwrap();
        let model = folder.path().join("better.toml");
        let names = vec!["a.x".to_string(), "b.y_1".to_string()];
        let covariance = DMatrix::from_row_slice(2, 2, &[1.0 / 3.0, -1e-17, -1e-17, 7.25e-6]);
        let uncertainty = Uncertainty { names, covariance };
        write(&uncertainty, &model).unwrap();
        assert_eq!(read(&model).unwrap(), uncertainty);
        let good = std::fs::read_to_string(beside(&model)).unwrap();
        for (from, to, expected) in [
            ("parameter", "name", "row 1 begins with `name"),
            ("7.25e-6", "much", "row 3, column b.y_1: `much`"),
            ("7.25e-6", "inf", "row 3, column b.y_1: `inf`"),
            ("\nb.y_1", "\nc", "row 3 is of `c`; expected b.y_1"),
            (",7.25e-6", "", "row 3 has 1 numbers; expected 2"),
            ("b.y_1,-1e-17,7.25e-6\n", "", "has 1 of 2 rows"),
        ] {
            std::fs::write(beside(&model), good.replacen(from, to, 1)).unwrap();
            let error = read(&model).unwrap_err();
            assert!(error.contains(expected) && error.contains("better.covariance.csv"), "{to}: {error}");
        }
        assert!(read(&folder.path().join("other.toml")).unwrap_err().contains("identify -o"));
    }
}

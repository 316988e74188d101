//! Page with one section per table or figure of the paper, as Markdown and as JSON.

use std::fmt::Write as _;

use serde_json::{Value, json};

use deltatwin::text::significant;
use deltatwin_report::{Callout, Figure, Report};

/// An estimate with an optional standard error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Value.
    pub value: f64,
    /// Standard error; infinite if the data do not determine the value individually.
    pub std: Option<f64>,
}

impl Estimate {
    /// Estimate with a standard error.
    pub fn new(value: f64, std: f64) -> Self {
        Self { value, std: Some(std) }
    }

    /// Estimate without a standard error.
    pub fn plain(value: f64) -> Self {
        Self { value, std: None }
    }

    fn text(&self) -> String {
        match self.std {
            None => significant(self.value, 4),
            Some(std) if std.is_finite() && std > 0.0 => {
                // Digits up to the second one of the standard error.
                let decimals = (1 - std.log10().floor() as i32).max(0) as usize;
                match decimals {
                    0..=6 => format!("{:.decimals$} ± {std:.decimals$}", self.value),
                    _ => format!("{} ± {}", significant(self.value, 4), significant(std, 2)),
                }
            }
            Some(_) => format!("{} (not alone)", significant(self.value, 4)),
        }
    }
}

/// A quantity with its estimates, the twin's true value and the paper's value.
#[derive(Clone, Debug, PartialEq)]
pub struct Row {
    /// Name of the quantity.
    pub quantity: String,
    /// Its unit.
    pub unit: String,
    /// One estimate per column of the table.
    pub ours: Vec<Option<Estimate>>,
    /// The twin's own value.
    pub truth: Option<f64>,
    /// The paper's value.
    pub paper: Option<f64>,
}

impl Row {
    /// A row with a single estimate.
    pub fn new(quantity: impl Into<String>, unit: impl ToString, ours: Estimate) -> Self {
        Self { quantity: quantity.into(), unit: unit.to_string(), ours: vec![Some(ours)], truth: None, paper: None }
    }

    /// The row with the twin's own value.
    #[must_use]
    pub fn truth(mut self, truth: f64) -> Self {
        self.truth = Some(truth);
        self
    }

    /// The row with the paper's value.
    #[must_use]
    pub fn paper(mut self, paper: f64) -> Self {
        self.paper = Some(paper);
        self
    }

    /// Difference of the estimate in `column` and the truth, in standard errors.
    pub fn errors(&self, column: usize) -> Option<f64> {
        let Estimate { value, std } = self.ours.get(column).copied().flatten()?;
        Some((value - self.truth?) / std.filter(|s| s.is_finite())?)
    }
}

/// Table of estimates next to the paper's values.
#[derive(Clone, Debug, PartialEq)]
pub struct Comparison {
    /// Titles of the estimate columns.
    pub titles: Vec<String>,
    /// Rows.
    pub rows: Vec<Row>,
}

impl Comparison {
    /// A table with one estimate column.
    pub fn new(title: &str, rows: Vec<Row>) -> Self {
        Self { titles: vec![title.into()], rows }
    }

    /// The rows whose estimate in `column` differs from the truth by more than three standard errors, and the number
    /// of rows with both.
    pub fn misses(&self, column: usize) -> (Vec<&str>, usize) {
        let judged: Vec<(&str, f64)> =
            self.rows.iter().filter_map(|r| Some((r.quantity.as_str(), r.errors(column)?))).collect();
        (judged.iter().filter(|(_, e)| e.abs() > 3.0).map(|(name, _)| *name).collect(), judged.len())
    }

    /// [`Comparison::misses`] as a sentence.
    pub fn hits(&self, column: usize) -> String {
        match self.misses(column) {
            (missed, n) if missed.is_empty() => {
                format!("All {n} estimates lie within three standard errors of the twin's own values.")
            }
            (missed, n) => format!(
                "{} of {n} estimates lie within three standard errors of the twin's own values, not {}.",
                n - missed.len(),
                missed.join(", ")
            ),
        }
    }

    /// Headers and cells of the table.
    fn cells(&self) -> (Vec<String>, Vec<Vec<String>>) {
        let truth = self.rows.iter().any(|r| r.truth.is_some());
        let paper = self.rows.iter().any(|r| r.paper.is_some());
        let mut header = vec!["quantity".to_string()];
        header.extend(self.titles.iter().cloned());
        header.extend(truth.then(|| "twin's truth".into()));
        header.extend(paper.then(|| "paper".into()));
        header.push("unit".into());
        let number = |x: Option<f64>| x.map_or("–".into(), |x| significant(x, 4));
        let row = |row: &Row| {
            let mut cells = vec![row.quantity.clone()];
            cells.extend(row.ours.iter().map(|e| e.map_or("–".into(), |e| e.text())));
            cells.extend(truth.then(|| number(row.truth)));
            cells.extend(paper.then(|| number(row.paper)));
            cells.push(row.unit.clone());
            cells
        };
        (header, self.rows.iter().map(row).collect())
    }

    fn markdown(&self) -> String {
        let (header, rows) = self.cells();
        let last = header.len() - 1;
        let mut out = format!("| {} |\n|", header.join(" | "));
        for k in 0..header.len() {
            out += if k == 0 || k == last { "---|" } else { "---:|" };
        }
        out.push('\n');
        for cells in rows {
            let _ = writeln!(out, "| {} |", cells.join(" | "));
        }
        out
    }

    fn json(&self) -> Value {
        let estimate = |e: &Option<Estimate>| match e {
            Some(e) => json!({ "value": e.value, "std": e.std.filter(|s| s.is_finite()) }),
            None => Value::Null,
        };
        let rows: Vec<Value> = self
            .rows
            .iter()
            .map(|r| {
                let ours: Vec<Value> = r.ours.iter().map(estimate).collect();
                json!({ "quantity": r.quantity, "unit": r.unit, "ours": ours, "truth": r.truth, "paper": r.paper })
            })
            .collect();
        json!({ "columns": self.titles, "rows": rows })
    }
}

/// A figure with its file name, without extension, and caption.
pub struct Plot {
    /// File stem.
    pub name: &'static str,
    /// The figure.
    pub figure: Figure,
    /// Caption.
    pub caption: String,
}

/// One table or figure of the paper.
pub struct Section {
    /// Key in JSON, e.g. `table_1`.
    pub key: &'static str,
    /// Heading.
    pub title: String,
    /// Description of the experiment.
    pub text: String,
    /// Tables.
    pub tables: Vec<Comparison>,
    /// Figures.
    pub plots: Vec<Plot>,
    /// Agreement with the paper, and the reasons for differences.
    pub agreement: String,
}

impl Section {
    /// The section as Markdown; figures are referenced by file name.
    pub fn markdown(&self) -> String {
        let mut out = format!("## {}\n\n{}\n\n", self.title, self.text);
        for table in &self.tables {
            out += &format!("{}\n", table.markdown());
        }
        for plot in &self.plots {
            let _ = write!(out, "![{}]({}.svg)\n\n*{}*\n\n", plot.figure.title(), plot.name, plot.caption);
        }
        if !self.agreement.is_empty() {
            let _ = write!(out, "**Agreement.** {}\n\n", self.agreement);
        }
        out
    }

    /// Adds the section to a page.
    pub fn add_to(&self, page: &mut Report) {
        page.anchored(&self.key.replace('_', "-"), &self.title).paragraph(&self.text);
        for table in &self.tables {
            let (header, rows) = table.cells();
            page.table(&header, &rows);
        }
        for plot in &self.plots {
            page.figure(&plot.figure, &plot.caption);
        }
        if !self.agreement.is_empty() {
            page.callout(Callout::Note, &self.agreement);
        }
    }

    /// Tables and agreement as JSON.
    pub fn json(&self) -> Value {
        let tables: Vec<Value> = self.tables.iter().map(Comparison::json).collect();
        json!({ "title": self.title, "tables": tables, "agreement": self.agreement })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_show_what_is_known_of_them() {
        assert_eq!(Estimate::new(0.15024, 0.00031).text(), "0.15024 ± 0.00031");
        assert_eq!(Estimate::new(12.3456, 2.0).text(), "12.3 ± 2.0");
        assert_eq!(Estimate::new(1.93e-5, 4.4e-8).text(), "1.930e-5 ± 4.4e-8");
        assert_eq!(Estimate::plain(0.1234567).text(), "0.1235");
        assert_eq!(Estimate::new(2.0, f64::INFINITY).text(), "2.000 (not alone)");
    }

    #[test]
    fn a_table_beside_the_paper() {
        let near = Row::new("m", "kg", Estimate::new(1.0, 0.1)).truth(1.2).paper(1.12);
        let far = Row::new("c", "m", Estimate::new(1.0, 0.1)).truth(1.4);
        let table = Comparison::new("identified", vec![near, far]);
        let text = "| quantity | identified | twin's truth | paper | unit |\n|---|---:|---:|---:|---|\n\
                    | m | 1.00 ± 0.10 | 1.200 | 1.120 | kg |\n| c | 1.00 ± 0.10 | 1.400 | – | m |\n";
        assert_eq!(table.markdown(), text);
        assert_eq!(table.misses(0), (vec!["c"], 2));
        assert!(table.hits(0).starts_with("1 of 2 estimates lie") && table.hits(0).ends_with("not c."));
    }
}

//! Pictures of a study, each as SVG, and all of them in one page.

mod boundary;
mod causes;
mod chance;
mod failure;
mod hand;
pub mod importance;
mod naming;

use std::path::PathBuf;

use deltatwin::text::significant;
use deltatwin_analysis::page::{Origin, end};
use deltatwin_io::study::{Factor, Range};
use deltatwin_report::{Callout, Figure, KeyNumber, StudyPage, StudySection, study_page};
use deltatwin_study::campaign::Table;
use deltatwin_study::conduct::{Conduct, Summary};
use deltatwin_study::statistics::{Ended, Subset, wilson};
use miette::{IntoDiagnostic, WrapErr};

use super::told::without_verdict;
use super::{Args, command};
use crate::terminal::{origin_of, write_figure};

/// A figure with the name of its file and its caption.
pub struct Picture {
    /// Name of the file, without extension.
    pub name: String,
    /// The figure.
    pub figure: Figure,
    /// What it shows.
    pub caption: String,
}

/// Confidence of intervals.
const CONFIDENCE: f64 = 0.95;

/// A study with the columns that pictures need.
pub struct Shown<'s> {
    /// The study.
    pub conduct: &'s Conduct,
    /// Columns of the table.
    pub table: Table,
    /// Column of the margin that the study is about.
    pub margin: String,
}

impl<'s> Shown<'s> {
    /// The columns of a finished study.
    pub fn of(conduct: &'s Conduct) -> miette::Result<Self> {
        let margin = conduct.columns.headings[conduct.columns.margin].name.clone();
        let own = (!COLUMNS.contains(&margin.as_str())).then_some(margin.as_str());
        let names = conduct.study.factors.iter().map(|f| f.name.as_str()).chain(COLUMNS).chain(own);
        let table = conduct.picked(&names.collect::<Vec<_>>())?;
        Ok(Self { conduct, table, margin })
    }
}

impl Shown<'_> {
    /// The numbers of a column; NaN where there is none.
    pub fn numbers(&self, name: &str) -> Vec<f64> {
        self.table.column(name).map_or_else(Vec::new, |column| self.table.numbers(column))
    }

    /// The texts of a column; empty where there is none.
    pub fn texts(&self, name: &str) -> Vec<&str> {
        let Some(column) = self.table.column(name) else { return Vec::new() };
        let text = |row: &'_ Vec<deltatwin_study::campaign::Value>| match &row[column] {
            deltatwin_study::campaign::Value::Text(text) => Some(text.len()),
            _ => None,
        };
        self.table
            .rows
            .iter()
            .map(|row| match (&row[column], text(row)) {
                (deltatwin_study::campaign::Value::Text(text), Some(_)) => text.as_str(),
                _ => "",
            })
            .collect()
    }

    /// Whether each run failed; `None` for one without a verdict.
    pub fn failed(&self) -> Vec<Option<bool>> {
        let Some(column) = self.table.column("survived") else { return Vec::new() };
        let of = |row: &Vec<deltatwin_study::campaign::Value>| match row[column] {
            deltatwin_study::campaign::Value::Flag(survived) => Some(!survived),
            _ => None,
        };
        self.table.rows.iter().map(of).collect()
    }

    /// Factors whose values are numbers and differ.
    pub fn numeric(&self) -> Vec<&Factor> {
        let varies = |factor: &&Factor| match &factor.range {
            Range::Levels(all) => all.len() > 1 && all.iter().all(|level| level.number.is_some()),
            _ => true,
        };
        self.conduct.study.factors.iter().filter(varies).collect()
    }
}

/// Name of a factor with its unit, for an axis.
pub fn label(factor: &Factor) -> String {
    let name = factor.name.replace('_', " ");
    match factor.unit.as_str() {
        "" | "1" => name,
        unit => format!("{name} / {unit}"),
    }
}

/// Columns that pictures need besides the factors.
const COLUMNS: [&str; 16] = [
    "run",
    "survived",
    "cause",
    "part",
    "first_socket",
    "margin",
    "margin_socket",
    "strut_force",
    "hand_force",
    "hand_margin",
    "picks_per_minute",
    "reach",
    "reach_high",
    "lead",
    "noticed_by",
    "named",
];

/// Writes the pictures and the page of a study; returns their files, the page first.
pub fn write(
    args: &Args,
    conduct: &Conduct,
    summary: &Summary,
    subset: Option<&Subset>,
) -> miette::Result<Vec<PathBuf>> {
    let shown = Shown::of(conduct)?;
    let mut sections = Vec::new();
    let mut add =
        |heading: &str, text: String, pictures: Vec<Picture>, table: Option<(Vec<String>, Vec<Vec<String>>)>| {
            if !pictures.is_empty() || table.is_some() {
                sections.push((heading.to_string(), text, pictures, table));
            }
        };
    add("Where it fails, and of what", String::new(), causes::maps(&shown), None);
    let (pictures, text) = boundary::diagrams(&shown);
    add("What can be carried", text, pictures, None);
    add("How probable a failure is", String::new(), chance::curves(&shown), None);
    add("What matters", String::new(), importance::figures(&shown), None);
    let failures = failure::examples(&shown);
    add(
        "What the diagnosis names",
        "From the recording of each run, up to its failure, with the controller's model: encoders and torques alone."
            .into(),
        Vec::new(),
        naming::table(&shown),
    );
    add("How it fails", failures.text, failures.pictures, None);
    let (pictures, reasons) = hand::comparison(&shown);
    add(
        "Beside the estimate by hand",
        "By hand: the largest tilting torque of the payload about the platform, divided by the distance of a pair of \
         struts."
            .into(),
        pictures,
        reasons,
    );
    let mut files = vec![args.output.clone().unwrap_or_default().join("study.html")];
    let mut page = StudyPage {
        title: conduct.study.title.clone().unwrap_or_else(|| conduct.study.name.clone()),
        subtitle: subtitle(conduct, summary),
        numbers: numbers(summary, subset),
        answers: answers(summary, subset),
        fmea: failures.fmea,
        commands: commands(args, summary),
        sections: Vec::new(),
    };
    for (heading, text, pictures, table) in sections {
        let mut figures = Vec::new();
        for picture in pictures {
            let file = files[0].with_file_name(format!("{}.svg", picture.name));
            write_figure(&file, &picture.figure)?;
            files.push(file);
            figures.push((picture.figure, picture.caption));
        }
        page.sections.push(StudySection { heading, text, figures, table });
    }
    let mut page = study_page(&page);
    end(&mut page, &provenance(args, conduct)?);
    page.write(&files[0]).into_diagnostic().wrap_err("the page cannot be written")?;
    Ok(files)
}

/// Command and files of the study.
fn provenance(args: &Args, conduct: &Conduct) -> miette::Result<Origin> {
    origin_of("study", &[("study", &args.study), ("scenario", conduct.study.scenario())])
}

fn subtitle(conduct: &Conduct, summary: &Summary) -> String {
    let study = &conduct.study;
    let factors: Vec<&str> = study.factors.iter().map(|f| f.name.as_str()).collect();
    let scenario = study.scenario().file_name().unwrap_or_default().to_string_lossy();
    format!(
        "{} of {} on {scenario}, {} rows, seed {}, digest {}",
        study.design.name().replace('_', " "),
        factors.join(", "),
        summary.runs,
        study.seed,
        conduct.campaign.digest.hex().chars().take(12).collect::<String>()
    )
}

fn numbers(summary: &Summary, subset: Option<&Subset>) -> Vec<KeyNumber> {
    let mut numbers = Vec::new();
    let answered = summary.runs - summary.errors;
    if let Some(subset) = subset {
        let [low, high] = subset.interval(CONFIDENCE);
        let label = if subset.ended == Ended::Reached { "probability of failure" } else { "its upper bound" };
        numbers.push(KeyNumber {
            value: significant(subset.probability, 2),
            label: label.into(),
            note: format!(
                "{} to {}, c.o.v. {}, {} runs",
                significant(low, 2),
                significant(high, 2),
                significant(subset.variation, 2),
                subset.evaluations
            ),
        });
    } else if answered > 0 && summary.boundary.is_none() {
        let [low, high] = wilson(summary.failed as usize, answered as usize, CONFIDENCE).map(|x| 1e2 * x);
        numbers.push(KeyNumber {
            value: format!("{:.1} %", 1e2 * summary.failed as f64 / answered as f64),
            label: "of the runs fail".into(),
            note: format!("{} of {answered}; 95 % interval {low:.1} to {high:.1} %", summary.failed),
        });
    }
    if summary.errors > 0 {
        numbers.push(KeyNumber {
            value: summary.errors.to_string(),
            label: "runs have no verdict".into(),
            note: without_verdict(summary, subset),
        });
    }
    if let Some((cause, count)) = summary.causes.first() {
        numbers.push(KeyNumber {
            value: cause.clone(),
            label: "is the most frequent cause".into(),
            note: format!("{count} of {} failures", summary.failed),
        });
    }
    if let Some((run, margin)) = summary.worst {
        numbers.push(KeyNumber {
            value: significant(margin, 3),
            label: "is the least margin".into(),
            note: format!("run {run}; 1 unloaded, 0 at the limit"),
        });
    }
    if let Some((count, median)) = summary.noticed {
        numbers.push(KeyNumber {
            value: format!("{:.0} ms", 1e3 * median),
            label: "lead of the first supervision".into(),
            note: format!("median of {count} failures that are noticed before"),
        });
    }
    numbers
}

fn answers(summary: &Summary, subset: Option<&Subset>) -> Vec<(Callout, String)> {
    let mut answers = Vec::new();
    if summary.failed == 0 && summary.errors == 0 && summary.boundary.is_none() {
        answers.push((Callout::Good, "No run failed.".into()));
    }
    if let Some((run, reason)) = &summary.first_error {
        let text = format!("{}. Run {run}: {reason}", without_verdict(summary, subset));
        answers.push((Callout::Bad, text));
    }
    if let Some((_, rising)) = summary.boundary.filter(|(_, rising)| *rising > 0) {
        let text = format!("Along {rising} ray(s) the margin does not fall all the way; there may be other crossings.");
        answers.push((Callout::Note, text));
    }
    answers
}

fn commands(args: &Args, summary: &Summary) -> Vec<(String, String)> {
    let mut commands = vec![("The whole study".to_string(), command(args, ""))];
    if let Some((run, _)) = summary.worst {
        let options = format!("--run {run} --mcap run-{run}.mcap");
        commands.push(("The run of the least margin, as a recording".into(), command(args, &options)));
    }
    commands
}

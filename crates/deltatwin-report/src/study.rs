//! Page of a failure study.

use super::figure::Figure;
use super::html::{Callout, Report};

/// A number that answers a question of the study.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KeyNumber {
    /// Value with unit, such as `3.1 %`.
    pub value: String,
    /// What it is.
    pub label: String,
    /// Interval, method or comparison; may be empty.
    pub note: String,
}

/// One section: text, figures with captions, a table.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StudySection {
    /// Heading.
    pub heading: String,
    /// Text; an empty line starts another paragraph.
    pub text: String,
    /// Figures with their captions.
    pub figures: Vec<(Figure, String)>,
    /// Headers and rows of a table below the figures.
    pub table: Option<(Vec<String>, Vec<Vec<String>>)>,
}

/// One failure mode.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FmeaRow {
    /// Cause.
    pub cause: String,
    /// Effect at the part itself.
    pub local: String,
    /// Effect on robot and payload.
    pub end: String,
    /// Supervision that notices it first.
    pub detection: String,
    /// Time from there to the failure, s; `None` if it is not noticed before.
    pub lead: Option<f64>,
    /// Number of runs that failed in this way.
    pub runs: usize,
    /// One of them.
    pub example: Option<u64>,
}

/// Content of the page of a study.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct StudyPage {
    /// Title.
    pub title: String,
    /// Line below it, such as model, design and number of runs.
    pub subtitle: String,
    /// Numbers at the top.
    pub numbers: Vec<KeyNumber>,
    /// Answers in a sentence each, with how good they are.
    pub answers: Vec<(Callout, String)>,
    /// Sections.
    pub sections: Vec<StudySection>,
    /// Failure modes and effects; those of most runs come first.
    pub fmea: Vec<FmeaRow>,
    /// Commands that repeat the study or one of its runs, each with what it does.
    pub commands: Vec<(String, String)>,
}

/// One self-contained page: numbers, answers, sections, failure modes, and how to repeat it.
pub fn study_page(page: &StudyPage) -> Report {
    let mut report = Report::new(&page.title, &page.subtitle);
    if !page.numbers.is_empty() {
        let tiles: Vec<[&str; 3]> = page.numbers.iter().map(|n| [&*n.value, &*n.label, &*n.note]).collect();
        report.tiles(&tiles);
    }
    for (kind, answer) in &page.answers {
        report.callout(*kind, answer);
    }
    let mut links: Vec<(String, String)> =
        page.sections.iter().enumerate().map(|(k, s)| (format!("section-{}", k + 1), s.heading.clone())).collect();
    if !page.fmea.is_empty() {
        links.push(("failure-modes".into(), "Failure modes and effects".into()));
    }
    if !page.commands.is_empty() {
        links.push(("repeat".into(), "Repeat it".into()));
    }
    if links.len() > 2 {
        report.contents(&links);
    }
    for (section, (id, _)) in page.sections.iter().zip(&links) {
        report.anchored(id, &section.heading).paragraph(&section.text);
        for (figure, caption) in &section.figures {
            report.figure(figure, caption);
        }
        if let Some((headers, rows)) = &section.table {
            let is_long = rows.iter().flatten().any(|cell| cell.chars().count() > LONG);
            if is_long {
                report.cards(headers, rows)
            } else {
                report.table(headers, rows)
            };
        }
    }
    if !page.fmea.is_empty() {
        report.anchored("failure-modes", "Failure modes and effects");
        failure_modes(&mut report, &page.fmea);
    }
    if !page.commands.is_empty() {
        report.anchored("repeat", "Repeat it");
        let lines: Vec<String> = page.commands.iter().map(|(what, command)| format!("# {what}\n{command}")).collect();
        report.commands(&lines.join("\n\n"));
    }
    report
}

/// Characters of a cell from which a table is one of texts, whose rows are cards on narrow screens.
const LONG: usize = 60;

/// Table of the failure modes, those of most runs first.
fn failure_modes(report: &mut Report, rows: &[FmeaRow]) {
    let mut sorted: Vec<&FmeaRow> = rows.iter().collect();
    sorted.sort_by_key(|row| std::cmp::Reverse(row.runs));
    let cells = |row: &&FmeaRow| {
        let runs = match row.example {
            Some(run) if row.runs > 0 => format!("{} (such as run {run})", row.runs),
            _ => row.runs.to_string(),
        };
        [&row.cause, &row.local, &row.end, &row.detection].map(String::clone).into_iter().chain([lead(row.lead), runs])
    };
    let rows: Vec<Vec<String>> = sorted.iter().map(|row| cells(row).collect()).collect();
    report.cards(&["cause", "local effect", "end effect", "first noticed by", "lead time", "runs"], &rows);
}

/// Lead time as text.
fn lead(lead: Option<f64>) -> String {
    match lead {
        None => "not before".into(),
        Some(lead) if lead < 1.0 => format!("{:.1} ms before", 1e3 * lead),
        Some(lead) => format!("{lead:.2} s before"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_has_numbers_links_and_failure_modes_in_order() {
        let row = |cause: &str, runs, lead| FmeaRow { cause: cause.into(), runs, lead, ..FmeaRow::default() };
        let mut worst = row("tilting <torque>", 40, Some(0.0123));
        worst.example = Some(4002);
        let section = StudySection { heading: "Where it fails".into(), ..StudySection::default() };
        let page = StudyPage {
            title: "Study".into(),
            numbers: vec![KeyNumber { value: "3.1 %".into(), label: "fail".into(), note: "2.8–3.5 %".into() }],
            answers: vec![(Callout::Bad, "It falls apart.".into())],
            sections: vec![section],
            fmea: vec![row("rare", 1, None), worst, row("late", 3, None)],
            commands: vec![("run 4002 again".into(), "deltatwin study s.toml --run 4002".into())],
            ..StudyPage::default()
        };
        let html = study_page(&page).render();
        for text in [
            "<b>3.1 %</b><span>fail</span><small>2.8–3.5 %</small>",
            "<a href=\"#section-1\">Where it fails</a>",
            "<h2 id=\"section-1\">",
            "<h2 id=\"failure-modes\">",
            "tilting &lt;torque&gt;",
            "<td data-label=\"lead time\">12.3 ms before</td><td data-label=\"runs\">40 (such as run 4002)</td>",
            "not before",
            "<pre># run 4002 again\ndeltatwin study s.toml --run 4002</pre>",
        ] {
            assert!(html.contains(text), "{text}");
        }
        let at = |text: &str| html.find(text).unwrap();
        assert!(at("tilting") < at(">late<") && at(">late<") < at(">rare<"));
        assert!(!study_page(&StudyPage::default()).render().contains("<nav>"));
    }
}

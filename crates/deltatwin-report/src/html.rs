//! Self-contained HTML page of text, tables and figures.

use std::fmt::Write as _;
use std::io;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use deltatwin_io::file::replace_text;
use sha2::{Digest, Sha256};

use super::figure::Figure;

/// Kind of a highlighted remark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Callout {
    /// Neutral information.
    Note,
    /// Positive result.
    Good,
    /// Warning.
    Warning,
    /// Failure.
    Bad,
}

impl Callout {
    fn class(self) -> &'static str {
        match self {
            Self::Note => "note",
            Self::Good => "good",
            Self::Warning => "warning",
            Self::Bad => "bad",
        }
    }
}

/// HTML page under construction; all text is escaped.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    title: String,
    subtitle: String,
    body: String,
    figures: usize,
    /// Whether the page has curves that are drawn by the scripts of `assets`.
    interactive: bool,
}

impl Report {
    /// Empty page with a title.
    pub fn new(title: impl Into<String>, subtitle: impl Into<String>) -> Self {
        Self { title: title.into(), subtitle: subtitle.into(), body: String::new(), figures: 0, interactive: false }
    }

    /// Adds a section heading.
    pub fn heading(&mut self, text: &str) -> &mut Self {
        self.push(format!("<h2>{}</h2>", escape(text)))
    }

    /// Adds a section heading that links can address as `#id`; `id` consists of letters, digits and hyphens.
    pub fn anchored(&mut self, id: &str, text: &str) -> &mut Self {
        self.push(format!("<h2 id=\"{}\">{}</h2>", escape(id), escape(text)))
    }

    /// Adds a row of links to headings, as pairs of id and text.
    pub fn contents(&mut self, links: &[(String, String)]) -> &mut Self {
        let link = |(id, text): &(String, String)| format!("<a href=\"#{}\">{}</a>", escape(id), escape(text));
        let links: Vec<String> = links.iter().map(link).collect();
        self.push(format!("<nav>{}</nav>", links.join("\n")))
    }

    /// Adds large numbers side by side: value, label, note.
    pub fn tiles(&mut self, tiles: &[[&str; 3]]) -> &mut Self {
        let tile = |[value, label, note]: &[&str; 3]| {
            let (value, label, note) = (escape(value), escape(label), escape(note));
            format!("<div><b>{value}</b><span>{label}</span><small>{note}</small></div>")
        };
        let tiles: Vec<String> = tiles.iter().map(tile).collect();
        self.push(format!("<div class=\"tiles\">\n{}\n</div>", tiles.join("\n")))
    }

    /// Adds lines to be typed into a terminal.
    pub fn commands(&mut self, text: &str) -> &mut Self {
        self.push(format!("<pre>{}</pre>", escape(text)))
    }

    /// Adds a table of texts that becomes one card per row on a narrow screen.
    pub fn cards<H: AsRef<str>, R: AsRef<[String]>>(&mut self, headers: &[H], rows: &[R]) -> &mut Self {
        let head: String = headers.iter().map(|h| format!("<th>{}</th>", escape(h.as_ref()))).collect();
        let cell = |(header, text): (&H, &String)| {
            format!("<td data-label=\"{}\">{}</td>", escape(header.as_ref()), escape(text))
        };
        let row = |row: &R| {
            let cells: String = headers.iter().zip(row.as_ref()).map(cell).collect();
            format!("<tr>{cells}</tr>\n")
        };
        let body: String = rows.iter().map(row).collect();
        let table = format!("<table class=\"cards\">\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}</tbody></table>");
        self.push(table)
    }

    /// Adds a paragraph; an empty line in `text` starts another.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        for part in text.split("\n\n").filter(|p| !p.trim().is_empty()) {
            self.push(format!("<p>{}</p>", escape(part.trim())));
        }
        self
    }

    /// Adds a list of sentences.
    pub fn list(&mut self, items: &[String]) -> &mut Self {
        let items: String = items.iter().map(|item| format!("<li>{}</li>\n", escape(item))).collect();
        self.push(format!("<ul>\n{items}</ul>"))
    }

    /// Adds a table; numeric columns are right-aligned, short rows are padded.
    pub fn table<H, R, C>(&mut self, headers: &[H], rows: &[R]) -> &mut Self
    where
        H: AsRef<str>,
        R: AsRef<[C]>,
        C: AsRef<str>,
    {
        let widest = rows.iter().map(|r| r.as_ref().len()).max().unwrap_or(0);
        let columns = headers.len().max(widest);
        let cell = |row: &R, k: usize| row.as_ref().get(k).map_or(String::new(), |c| c.as_ref().into());
        let class: Vec<&str> = (0..columns)
            .map(|k| {
                let cells: Vec<String> = rows.iter().map(|r| cell(r, k)).collect();
                let numbers = cells.iter().all(|c| numeric(c)) && cells.iter().any(|c| has_digit(c));
                if numbers { " class=\"n\"" } else { "" }
            })
            .collect();
        let name: Vec<&str> = headers.iter().map(AsRef::as_ref).collect();
        let mut html = format!("{}<table>\n<thead><tr>", wide(&name.join(", ")));
        for k in 0..columns {
            let text = headers.get(k).map_or("", AsRef::as_ref);
            let _ = write!(html, "<th{}>{}</th>", class[k], escape(text));
        }
        html.push_str("</tr></thead>\n<tbody>\n");
        for row in rows {
            html.push_str("<tr>");
            for k in 0..columns {
                let _ = write!(html, "<td{}>{}</td>", class[k], escape(&cell(row, k)));
            }
            html.push_str("</tr>\n");
        }
        html.push_str("</tbody></table></div>");
        self.push(html)
    }

    /// Adds a figure with a numbered caption; on a screen its curves, if it has any, can be zoomed.
    pub fn figure(&mut self, figure: &Figure, caption: &str) -> &mut Self {
        self.figures += 1;
        let (n, svg, caption) = (self.figures, figure.svg(), escape(caption));
        let live = figure.live().map_or(String::new(), |data| {
            self.interactive = true;
            // In a script element only `<` could end the text.
            let data = data.replace('<', "\\u003c");
            format!("<script type=\"application/json\" class=\"curves\">{data}</script>\n")
        });
        self.push(format!(
            "<figure id=\"figure-{n}\">\n<div class=\"drawing\" tabindex=\"0\" role=\"group\" aria-label=\"figure {n}\">{svg}</div>\n{live}<figcaption><b>Figure {n}.</b> {caption}</figcaption>\n</figure>"
        ))
    }

    /// Adds a highlighted remark.
    pub fn callout(&mut self, kind: Callout, text: &str) -> &mut Self {
        self.push(format!("<div class=\"callout {}\">{}</div>", kind.class(), escape(text)))
    }

    /// Gives the page the scripts that draw curves.
    pub(crate) fn interactive(&mut self) {
        self.interactive = true;
    }

    /// Content of the page without its frame, for a page that has style and scripts of its own.
    pub fn fragment(&self) -> &str {
        &self.body
    }

    /// Adds the [`Self::fragment`] of another page, as it is; a page with curves becomes interactive.
    pub fn fragment_of(&mut self, fragment: &str) -> &mut Self {
        self.interactive |= fragment.contains("data-signals") || fragment.contains("class=\"curves\"");
        self.push(fragment.into())
    }

    /// The complete page.
    ///
    /// Its security policy lets nothing be loaded, and no script run but those of `assets`, named by their hashes: a
    /// text from a file that looked like a script would still not be executed.
    pub fn render(&self) -> String {
        let title = escape(&self.title);
        let subtitle = match self.subtitle.trim() {
            "" => String::new(),
            text => format!("<p class=\"subtitle\">{}</p>\n", escape(text)),
        };
        let own: &[&str] = if self.interactive { &[UPLOT, PAGE] } else { &[] };
        let licence = if self.interactive { format!("<!-- uPlot 1.6.32\n{UPLOT_LICENCE}-->\n") } else { String::new() };
        let scripts: String = own.iter().map(|script| format!("<script>{script}</script>\n")).collect();
        let policy = policy(own);
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n\
             <title>{title}</title>\n<style>{}</style>\n</head>\n<body>\n<main>\n\
             <header>\n<h1>{title}</h1>\n{subtitle}</header>\n{}</main>\n{licence}{scripts}</body>\n</html>\n",
            style(),
            self.body
        )
    }

    /// Writes the page to `path` atomically: a reader sees either the old or the complete new file.
    ///
    /// # Errors
    ///
    /// If the folder is missing or not writable; the message names the file.
    pub fn write(&self, path: impl AsRef<Path>) -> io::Result<()> {
        let path = path.as_ref();
        let named = |e: io::Error| io::Error::new(e.kind(), format!("{}: {e}", path.display()));
        replace_text(path, &self.render()).map_err(named)
    }

    /// Adds an element whose texts are escaped.
    pub(crate) fn push(&mut self, html: String) -> &mut Self {
        self.body.push_str(&html);
        self.body.push('\n');
        self
    }
}

/// Security policy of a page that runs the given scripts alone and loads nothing.
pub fn policy(scripts: &[&str]) -> String {
    let hash = |script: &&str| format!(" 'sha256-{}'", STANDARD.encode(Sha256::digest(script.as_bytes())));
    let own: String = scripts.iter().map(hash).collect();
    let own = if own.is_empty() { " 'none'".into() } else { own };
    format!(
        "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'; script-src{own}"
    )
}

/// Scripts that draw the curves: uPlot 1.6.32 (MIT, `assets/uplot/LICENSE`), and the page's own.
pub const UPLOT: &str = include_str!("../assets/uplot/uPlot.iife.min.js");
const UPLOT_LICENCE: &str = include_str!("../assets/uplot/LICENSE");
/// Reads the data of [`crate::component::signals`] and draws them.
pub const PAGE: &str = include_str!("../assets/page.js");
/// Style of every page: palette, texts and tables, curves and the components of pages about models.
pub fn style() -> String {
    [&super::figure::style(), CSS, CURVES_CSS].concat()
}

const CURVES_CSS: &str = concat!(include_str!("../assets/uplot/uPlot.min.css"), include_str!("../assets/page.css"));

/// `text` escaped for an HTML element or a quoted attribute; control characters become spaces.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            '\n' => out.push('\n'),
            c if c.is_control() => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

/// Begin of a box called `name` that scrolls sideways, also by keyboard.
pub(crate) fn wide(name: &str) -> String {
    format!("<div class=\"wide\" tabindex=\"0\" role=\"group\" aria-label=\"{}\">", escape(name))
}

fn has_digit(text: &str) -> bool {
    text.chars().any(|c| c.is_ascii_digit())
}

/// Whether a cell is a number, possibly with a unit or relation, or a placeholder.
fn numeric(text: &str) -> bool {
    let text = text.trim();
    if matches!(text, "" | "-" | "–" | "—") {
        return true;
    }
    let text = text.trim_start_matches(['<', '>', '≤', '≥', '±', '~', ' ', '+', '-', '−']);
    text.starts_with(|c: char| c.is_ascii_digit() || c == '.') && text.chars().count() <= 24
}

const CSS: &str = "
:root { color-scheme: light dark; }
* { box-sizing: border-box; }
body { margin: 0; background: #fff; color: #22262b; font: 16px/1.55 system-ui, -apple-system, 'Segoe UI', Roboto, 'Helvetica Neue', Arial, sans-serif; }
main { max-width: 1000px; margin: 0 auto; padding: 2rem 1.5rem 4rem; }
header { border-bottom: 2px solid #22262b; margin-bottom: 1.5rem; padding-bottom: .75rem; }
h1 { font-size: 1.8rem; line-height: 1.2; margin: 0; }
h2 { font-size: 1.25rem; margin: 2.2rem 0 .6rem; }
p { max-width: 46rem; margin: .7rem 0; }
.subtitle { color: #5a626b; margin: .4rem 0 0; }
figure { margin: 1.5rem 0; }
figure svg { display: block; width: 100%; height: auto; font-family: inherit; }
figcaption { color: #444b53; font-size: .9rem; max-width: 46rem; margin: .4rem 0 0 .75rem; }
.wide { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-size: .93rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .35rem .9rem .35rem .2rem; border-bottom: 1px solid #e3e6ea; vertical-align: top; }
th { border-bottom: 2px solid #b4bac1; white-space: nowrap; }
th.n, td.n { text-align: right; padding: .35rem .2rem .35rem .9rem; white-space: nowrap; }
.callout { border-left: 4px solid var(--quiet); background: var(--soft); padding: .7rem 1rem; margin: 1.1rem 0; white-space: pre-line; }
.callout.good { border-color: var(--good); background: #f3f8ee; }
.callout.warning { border-color: var(--amber); background: #fdf7ea; }
.callout.bad { border-color: var(--bad); background: #fcf1f0; }
nav { display: flex; flex-wrap: wrap; gap: .3rem 1.1rem; margin: 1rem 0; font-size: .93rem; }
a { color: #00629b; }
pre { background: #f4f6f8; padding: .7rem 1rem; white-space: pre-wrap; overflow-wrap: anywhere; font-size: .87rem; line-height: 1.5; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(11rem, 1fr)); gap: .8rem; margin: 1.2rem 0; }
.tiles div { border: 1px solid #d5dae0; border-radius: 6px; padding: .6rem .8rem; display: flex; flex-direction: column; }
.tiles b { font-size: 1.5rem; line-height: 1.25; font-variant-numeric: tabular-nums; }
.tiles small { color: #5a626b; }
table.cards { width: 100%; margin: 1rem 0; }
table.cards td { padding-right: 1.1rem; }
@media (max-width: 700px) {
  main { padding: 1.2rem .8rem 3rem; }
  h1 { font-size: 1.45rem; }
  .drawing { overflow-x: auto; }
  figure svg { min-width: 700px; }
  figcaption { margin-left: 0; }
  .tiles { grid-template-columns: repeat(auto-fit, minmax(8.5rem, 1fr)); }
  table.cards thead { display: none; }
  table.cards tr { display: block; border: 1px solid #d5dae0; border-radius: 6px; margin: .8rem 0; padding: .3rem .8rem; }
  table.cards td { display: grid; grid-template-columns: 6.5rem 1fr; gap: .6rem; border: 0; padding: .25rem 0; }
  table.cards td::before { content: attr(data-label); color: #5a626b; }
}
@media screen and (prefers-color-scheme: dark) {
  body { background: #14171a; color: #e2e6ea; }
  header, th { border-color: #8a939c; }
  td, .tiles div, table.cards tr { border-color: #3a4149; }
  a { color: #6cbcf0; }
  pre { background: #1f2429; }
  .subtitle, figcaption, .tiles small, table.cards td::before { color: #a7b0b9; }
  .callout.good { background: #1b2912; }
  .callout.warning { background: #2e2613; }
  .callout.bad { background: #331a17; }
  figure svg :not(text)[fill='#FFFFFF'] { fill: #14171a; }
  figure svg :not(text)[stroke='#FFFFFF'] { stroke: #14171a; }
  figure svg [fill='#22262B'] { fill: #e2e6ea; }
  figure svg [stroke='#22262B'] { stroke: #e2e6ea; }
  figure svg [fill='#5A626B'] { fill: #a7b0b9; }
  figure svg [stroke='#E3E6EA'] { stroke: #2b3138; }
  figure svg [stroke='#F0F2F4'] { stroke: #22272c; }
  figure svg [stroke='#B4BAC1'] { stroke: #57606a; }
  figure svg [fill='#B4BAC1'] { fill: #57606a; }
  figure svg [fill='#3B3B3B'] { fill: #6c747c; }
  figure svg [fill='#0072B2'] { fill: #2079c2; }
}
@page { margin: 14mm 12mm; }
@media print {
  body { font-size: 10.5pt; }
  main { max-width: none; padding: 0; }
  figure, .callout, tr, .tiles div { break-inside: avoid; }
  nav { display: none; }
  .wide { overflow: visible; }
  table { font-size: .8rem; }
  td, th { overflow-wrap: anywhere; white-space: normal !important; }
  td.n, th.n, td.unit { overflow-wrap: normal; }
  td.unit { white-space: nowrap !important; }
  .tiles { grid-template-columns: repeat(4, 1fr); }
  .tiles b { font-size: 1.2rem; }
  h2, h2 + p { break-after: avoid; }
  .callout { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
}
";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figure::{Curve, time_series};

    #[test]
    fn text_is_escaped_everywhere() {
        let evil = "<script>alert(\"1 & '2'\")</script>\u{7}";
        let figure = time_series(evil, evil, evil, &[Curve::new(evil, vec![0.0, 1.0], vec![0.0, 1.0])]);
        let mut report = Report::new(evil, evil);
        report.heading(evil).paragraph(evil).callout(Callout::Bad, evil);
        report.table(&[evil], &[[evil]]).figure(&figure, evil);
        let page = report.render();
        assert!(!page.contains("<script>alert"));
        assert!(!page.contains('\u{7}'));
        assert!(page.contains("&lt;script&gt;alert(&quot;1 &amp; &#39;2&#39;&quot;)&lt;/script&gt;"));
    }

    #[test]
    fn tables_align_numbers_and_fill_rows() {
        let mut report = Report::new("t", "");
        report.table(&["name", "rms"], &[vec!["axis 1", "0.12 Nm"], vec!["axis 2", "–"], vec!["x"]]);
        let page = report.render();
        assert!(page.contains("<th>name</th><th class=\"n\">rms</th>"));
        assert!(page.contains("<td>x</td><td class=\"n\"></td>"));
        assert!(!page.contains("subtitle\">"));
        let none: [[&str; 0]; 0] = [];
        Report::new("", "").table::<&str, _, _>(&[], &none).render();
    }

    #[test]
    fn writing_replaces_the_file_and_leaves_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("report.html");
        Report::new("one", "").write(&path).unwrap();
        let mut second = Report::new("two", "");
        second.paragraph("first\n\nsecond");
        second.write(&path).unwrap();
        assert_eq!(std::fs::read_to_string(&path).unwrap(), second.render());
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
        let missing = folder.path().join("none").join("report.html");
        let error = second.write(&missing).unwrap_err();
        assert!(error.to_string().contains("report.html"));
    }
}

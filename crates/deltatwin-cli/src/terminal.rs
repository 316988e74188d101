//! Common terminal functions: text on stdout, warnings and progress on stderr, aligned tables, interruption.

use std::io::{ErrorKind, Write};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, WrapErr, miette};
use serde_json::{Value, json};

use deltatwin::identification::repeats::{Repeats, Share, with_error};
use deltatwin::machine::Mechanism;
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin::text::significant;
use deltatwin_analysis::Inputs;
use deltatwin_analysis::folder::Input;
use deltatwin_analysis::page::Origin;
use deltatwin_io::{file, model};
use deltatwin_report::Figure;

mod bars;
mod text;

pub use bars::error_bars;
pub use deltatwin_analysis::json::{estimates, insert_channels, path};
use text::FIRM;
use text::harmless;
pub use text::{WIDTH, command, grouped, hanging, without_login, wrapped};

/// Exit status: success.
pub const DONE: u8 = 0;
/// Exit status: negative answer.
pub const BAD_ANSWER: u8 = 1;
/// Exit status: invalid input.
pub const BAD_INPUT: u8 = 2;
/// Exit status: interrupted by the user.
pub const INTERRUPTED: u8 = 130;

static SAID: AtomicBool = AtomicBool::new(false);

/// Whether anything has been printed on stdout.
pub fn has_said() -> bool {
    SAID.load(Ordering::Relaxed)
}

/// Prints a line on stdout; a closed pipe is no error.
pub fn say(text: impl std::fmt::Display) -> miette::Result<()> {
    SAID.store(true, Ordering::Relaxed);
    let mut out = std::io::stdout().lock();
    match writeln!(out, "{}", harmless(&text.to_string())).and_then(|()| out.flush()) {
        Err(e) if e.kind() != ErrorKind::BrokenPipe => Err(e).into_diagnostic(),
        _ => Ok(()),
    }
}

/// Prints a line on stderr; if nobody can read it there, the exit status still tells.
pub fn complain(text: impl std::fmt::Display) {
    let _ = writeln!(std::io::stderr().lock(), "{}", harmless(&text.to_string()));
}

/// Prints warnings on stderr.
pub fn warn(warnings: &[String]) {
    for w in warnings {
        complain(format!("warning: {w}"));
    }
}

/// An error and its causes as JSON: message, causes and help.
pub fn error_json(report: &miette::Report) -> Value {
    let causes: Vec<String> = report.chain().skip(1).map(ToString::to_string).collect();
    json!({ "message": report.to_string().trim(), "causes": causes, "help": report.help().map(|h| h.to_string()) })
}

/// A progress bar on stderr from 0 to `length`; invisible if stderr is no terminal.
pub fn bar(what: &str, length: u64) -> ProgressBar {
    let style = "{prefix:>10} [{bar:40}] {percent:>3} % {eta} left";
    let bar = ProgressBar::new(length);
    bar.set_style(ProgressStyle::with_template(style).expect("a valid template"));
    bar.set_prefix(what.to_string());
    bar
}

/// A spinner on stderr; invisible if stderr is no terminal.
pub fn spinner(what: &str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner();
    spinner.set_style(ProgressStyle::with_template("{spinner} {msg} {elapsed}").expect("a valid template"));
    spinner.set_message(what.to_string());
    spinner.enable_steady_tick(Duration::from_millis(100));
    spinner
}

static STOP: AtomicBool = AtomicBool::new(false);

/// Time that a command has to end by itself, s.
const GRACE: f64 = 0.8;

/// Installs a handler for Ctrl-C and the request to terminate that sets the flag of [`interrupted`]; a second one, or
/// almost a second without an end, ends the process.
pub fn catch_interrupt() -> miette::Result<()> {
    let stop = || {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(INTERRUPTED));
        }
        std::thread::spawn(|| {
            std::thread::sleep(Duration::from_secs_f64(GRACE));
            complain("interrupted; what was written until now is kept");
            std::process::exit(i32::from(INTERRUPTED));
        });
    };
    ctrlc::set_handler(stop).into_diagnostic()
}

/// Ends the process after `limit` s; a command that asks whether it is [`interrupted`] can end in good order before.
pub fn end_after(limit: f64) {
    let wait = |seconds: f64| std::thread::sleep(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX));
    std::thread::spawn(move || {
        wait((limit - GRACE).max(limit / 2.0));
        STOP.store(true, Ordering::Relaxed);
        wait(GRACE.min(limit / 2.0));
        complain(format!("the time limit of {limit} s is over; what was written until now is kept"));
        std::process::exit(i32::from(BAD_ANSWER));
    });
}

/// Whether Ctrl-C was pressed.
pub fn interrupted() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// Checks that an output file is none of the inputs, has one of the `extensions` and an existing folder.
pub fn check_output(output: &Path, inputs: &[&Path], extensions: &[&str]) -> miette::Result<()> {
    let extension = output.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
    if !extensions.contains(&extension.as_str()) {
        let expected = extensions.iter().map(|e| format!(".{e}")).collect::<Vec<_>>().join(" or ");
        return Err(miette!("{}: cannot be written; expected a name ending in {expected}", output.display()));
    }
    let folder = output.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if !folder.is_dir() {
        return Err(miette!("{}: cannot be written: there is no folder {}", output.display(), folder.display()));
    }
    let same = |input: &&Path| match (output.canonicalize(), input.canonicalize()) {
        (Ok(a), Ok(b)) => a == b,
        _ => false,
    };
    if inputs.iter().any(same) {
        return Err(miette!("{} is an input; expected another name for the output", output.display()));
    }
    Ok(())
}

/// Reads the model of an assembled delta robot.
pub fn assembled_robot(file: &Path) -> miette::Result<Model> {
    let model = model::read(file)?;
    if !model.assembled || !matches!(model.mechanism, Mechanism::Delta { .. }) {
        return Err(miette!("{}: expected the model of an assembled delta robot", file.display()));
    }
    Ok(model)
}

/// Writes an SVG file.
pub fn write_figure(target: &Path, figure: &Figure) -> miette::Result<()> {
    Ok(file::replace(target, |out| out.write_all(figure.svg().as_bytes()))?)
}

/// Today's date, `2026-11-22` (UTC).
pub fn today() -> String {
    jiff::Timestamp::now().strftime("%Y-%m-%d").to_string()
}

/// Where the results of this command come from: the command line, program and date, and the inputs with their hashes.
///
/// # Errors
/// If an input cannot be read.
pub fn origin(stage: &str, model: Option<&Path>, inputs: &Inputs, warnings: &[String]) -> miette::Result<Origin> {
    Ok(Origin { inputs: Input::all(model, inputs)?, warnings: warnings.to_vec(), ..origin_of(stage, &[])? })
}

/// Where the results of this command come from, whose inputs are `files`, each with its role.
///
/// # Errors
/// If a file cannot be read.
pub fn origin_of(stage: &str, files: &[(&'static str, &Path)]) -> miette::Result<Origin> {
    let rest = std::env::args_os().skip(1).map(|word| word.to_string_lossy().into_owned());
    Ok(Origin {
        command: std::iter::once("deltatwin".to_string()).chain(rest.map(|word| without_login(&word))).collect(),
        stage: stage.into(),
        version: env!("CARGO_PKG_VERSION").into(),
        date: today(),
        inputs: files.iter().map(|(role, file)| input(role, file)).collect::<miette::Result<_>>()?,
        ..Origin::default()
    })
}

/// A file that went into results, with its `role` and hash.
///
/// # Errors
/// If it cannot be read.
pub fn input(role: &'static str, file: &Path) -> miette::Result<Input> {
    Input::of(role, file).into_diagnostic().wrap_err_with(|| format!("{}: cannot be read", file.display()))
}

/// Prints what repeats of a residual from lap to lap and what does not.
pub fn say_repeats(repeats: &Repeats) -> miette::Result<()> {
    say(format!("\n{}", Table::of_repeats(repeats)))?;
    let mut notes =
        repeats.channels.iter().flat_map(|s| s.notes().into_iter().map(|note| format!("{}: {note}", s.channel)));
    notes.try_for_each(|note| say(wrapped(&note, 2)))
}

/// Rows of text in aligned columns; the first column is left-aligned.
pub struct Table {
    rows: Vec<Vec<String>>,
    left: Vec<usize>,
}

impl Table {
    /// A table with a header; the first column and those in `left` are left-aligned.
    pub fn new(header: &[&str], left: &[usize]) -> Self {
        Self { rows: vec![header.iter().map(|h| h.to_string()).collect()], left: left.to_vec() }
    }

    /// Adds a row.
    pub fn row(&mut self, cells: impl IntoIterator<Item = String>) {
        self.rows.push(cells.into_iter().collect());
    }

    /// Table of what repeats of a residual from lap to lap and what does not.
    pub fn of_repeats(repeats: &Repeats) -> Self {
        let first = format!("RMS, {}", repeats.laps());
        let mut table = Self::new(&[&first, "residual", "repeats (model)", "differs (noise)", ""], &[4]);
        for Share { channel, mechanism: m, parts: p, .. } in &repeats.channels {
            let values = [significant(p.rms, 4), with_error(p.repeats), with_error(p.noise)];
            table.row([channel.title(*m)].into_iter().chain(values).chain([channel.unit(*m).to_string()]));
        }
        table
    }

    /// Table of per-channel values with unit, one row per channel; missing series have no column.
    pub fn of_channels(machine: Mechanism, channels: &[Channel], series: &[(&str, Option<&[f64]>)]) -> Self {
        let series: Vec<_> = series.iter().filter_map(|(title, v)| v.map(|v| (*title, v))).collect();
        let header: Vec<&str> =
            std::iter::once("RMS error").chain(series.iter().map(|s| s.0)).chain(std::iter::once("")).collect();
        let mut table = Self::new(&header, &[series.len() + 1]);
        for (c, &channel) in channels.iter().enumerate() {
            let values = series.iter().map(|(_, v)| significant(v[c], 4));
            table.row(
                std::iter::once(channel.title(machine))
                    .chain(values)
                    .chain(std::iter::once(channel.unit(machine).to_string())),
            );
        }
        table
    }
}

/// Least width for a text at the end of a row to be wrapped below itself.
const SHORTEST: usize = 20;

impl std::fmt::Display for Table {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let columns = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let width = |c: usize| self.rows.iter().filter_map(|r| r.get(c)).map(|s| s.chars().count()).max().unwrap_or(0);
        // Wider ones cannot be padded by the formatter.
        let widths: Vec<usize> = (0..columns).map(|c| width(c).min(usize::from(u16::MAX))).collect();
        for (r, row) in self.rows.iter().enumerate() {
            let mut line = String::new();
            for (c, cell) in row.iter().enumerate() {
                let w = widths[c];
                // A long text in the last column is wrapped below itself.
                let start = line.chars().count() + 2;
                let is_long = start + cell.chars().count() > WIDTH && start + SHORTEST <= WIDTH;
                if c > 0 && c + 1 == row.len() && self.left.contains(&c) && is_long {
                    line = hanging(cell, &format!("{line}  "), &" ".repeat(start));
                    continue;
                }
                line += &match c == 0 || self.left.contains(&c) {
                    true => format!("  {cell:<w$}"),
                    false => format!("  {cell:>w$}"),
                };
            }
            let end = if r + 1 == self.rows.len() { "" } else { "\n" };
            write!(f, "{}{end}", line.trim_end().replace(FIRM, " "))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_their_digits() {
        assert_eq!(significant(0.0, 4), "0");
        assert_eq!(significant(1.23456, 4), "1.235");
        assert_eq!(significant(-1234.56, 4), "-1235");
        assert_eq!(significant(0.00123456, 4), "0.001235");
        assert_eq!(significant(1.5e-9, 3), "1.50e-9");
        assert_eq!(significant(f64::INFINITY, 3), "—");
    }

    #[test]
    fn columns_are_aligned() {
        let mut table = Table::new(&["name", "x", "unit"], &[2]);
        table.row(["µ".into(), "1".into(), "N".into()]);
        table.row(["longer".into(), "10".into(), "N·m".into()]);
        assert_eq!(table.to_string(), "  name     x  unit\n  µ        1  N\n  longer  10  N·m");
    }

    #[test]
    fn a_cell_of_any_length_is_printed() {
        let mut table = Table::new(&["name", "x"], &[]);
        table.row(["n".repeat(70_000), "1".repeat(70_000)]);
        assert!(table.to_string().len() > 140_000);
    }

    #[test]
    fn a_long_last_column_runs_on_below_itself() {
        let mut table = Table::new(&["name", "because"], &[1]);
        table.row(["a".into(), "too many words for one line ".repeat(6)]);
        table.row(["b".into(), "few".into()]);
        let text = table.to_string();
        assert!(text.lines().count() > 3 && text.lines().all(|l| l.chars().count() <= WIDTH), "{text}");
        assert!(text.lines().nth(2).unwrap().starts_with("        "), "{text}");
    }
}

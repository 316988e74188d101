//! Text and commands wrapped to the width of the screen.

use std::borrow::Cow;

use deltatwin_analysis::page::quoted;
use textwrap::{Options, WordSplitter};

/// A space at which no line is broken.
pub(super) const FIRM: &str = "\u{a0}";

/// Width of all output, columns.
pub const WIDTH: usize = 100;

/// Text whose control characters are written as `\\u001b`, as JSON does: names in files must not steer a terminal.
pub(super) fn harmless(text: &str) -> Cow<'_, str> {
    let steers = |c: char| c.is_control() && c != '\n' && c != '\t' || ('\u{202a}'..='\u{202e}').contains(&c);
    if !text.contains(steers) {
        return text.into();
    }
    text.chars().map(|c| if steers(c) { format!("\\u{:04x}", c as u32) } else { c.to_string() }).collect()
}

/// Text without what follows `mqtt://` or `mqtts://`, up to the last apostrophe of the line: it may contain a password.
pub fn without_login(text: &str) -> String {
    let hidden = |line: &str| {
        let begin = ["mqtt://", "mqtts://"].iter().filter_map(|scheme| Some(line.find(scheme)? + scheme.len())).min();
        let Some(begin) = begin else { return line.to_string() };
        let end = line[begin..].rfind('\'').map_or("", |end| &line[begin + end..]);
        format!("{}***{end}", &line[..begin])
    };
    text.split('\n').map(hidden).collect::<Vec<_>>().join("\n")
}

/// Text wrapped at words to lines of [`WIDTH`], indented, with two more columns from the second line on.
pub fn wrapped(text: &str, indent: usize) -> String {
    hanging(text, &" ".repeat(indent), &" ".repeat(indent + 2))
}

/// Text wrapped to lines of [`WIDTH`], with the prefix `first` on the first line and `others` on the others.
pub fn hanging(text: &str, first: &str, others: &str) -> String {
    let options = Options::new(WIDTH)
        .initial_indent(first)
        .subsequent_indent(others)
        .break_words(false)
        .word_splitter(WordSplitter::NoHyphenation);
    textwrap::fill(text, options).replace(FIRM, " ")
}

/// A command wrapped to lines of [`WIDTH`] with line continuations for a shell.
pub fn command(words: &[String], indent: usize) -> String {
    let mut lines = vec![" ".repeat(indent)];
    for word in words.iter().map(|w| quoted(w)) {
        let line = lines.last().map_or(0, |l| l.chars().count());
        if line > indent && line + 1 + word.chars().count() + 2 > WIDTH {
            lines.push(" ".repeat(indent + 4));
        }
        if let Some(last) = lines.last_mut() {
            let gap = if last.trim().is_empty() { "" } else { " " };
            *last += &format!("{gap}{word}");
        }
    }
    lines.join(" \\\n")
}

/// Number of parameters per effect, in the order of the first of each, such as `drive_friction (3), rigid_bodies
/// (2)`.
pub fn grouped(parameters: &[String]) -> String {
    let mut groups: Vec<(&str, usize)> = Vec::new();
    for owner in parameters.iter().map(|p| p.split('.').next().unwrap_or(p)) {
        match groups.iter_mut().find(|(name, _)| *name == owner) {
            Some((_, count)) => *count += 1,
            None => groups.push((owner, 1)),
        }
    }
    groups.iter().map(|(name, count)| format!("{name}{FIRM}({count})")).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_fit_the_screen() {
        let text = wrapped(&"a long sentence of many words ".repeat(12), 2);
        assert!(text.lines().count() > 2 && text.lines().all(|l| l.chars().count() <= WIDTH), "{text}");
        assert!(text.starts_with("  a") && text.lines().nth(1).unwrap().starts_with("    "), "{text}");
    }

    #[test]
    fn escape_codes_are_shown_and_not_sent() {
        assert_eq!(harmless("run \u{1b}]0;x\u{7}\u{9b}2J\n\tok é"), "run \\u001b]0;x\\u0007\\u009b2J\n\tok é");
        assert!(matches!(harmless("plain"), Cow::Borrowed("plain")));
    }

    #[test]
    fn logins_are_not_shown() {
        let usage = "error: unexpected argument 'mqtts://u:it's secret@h' found\n\ntip: 'x'";
        assert_eq!(without_login(usage), "error: unexpected argument 'mqtts://***' found\n\ntip: 'x'");
        assert_eq!(without_login("mqtt://u:secret@h"), "mqtt://***");
    }

    #[test]
    fn commands_can_be_pasted() {
        let words: Vec<String> = ["deltatwin", "add", "my model.toml", "it's"].map(String::from).into();
        assert_eq!(command(&words, 2), r"  deltatwin add 'my model.toml' 'it'\''s'");
        let long: Vec<String> = (0..12).map(|i| format!("recordings/run-{i}.csv")).collect();
        let text = command(&long, 2);
        assert!(text.lines().all(|l| l.chars().count() <= WIDTH), "{text}");
        assert!(text.lines().rev().skip(1).all(|l| l.ends_with(" \\")), "{text}");
        assert_eq!(text.replace(" \\\n", " ").split_whitespace().collect::<Vec<_>>(), long);
    }

    #[test]
    fn parameters_are_grouped_by_their_owner() {
        let names = ["rigid_bodies.strut_mass", "drive_friction.viscous_1", "rigid_bodies.platform_mass"];
        let text = wrapped(&grouped(&names.map(String::from)), 0);
        assert_eq!(text, "rigid_bodies (2), drive_friction (1)");
    }
}

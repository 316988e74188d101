//! Quoted outputs and pictures of README and docs: made again by the command that stands beside them, and compared.
//!
//! Above every block of output and every picture stands a comment:
//!
//! ```text
//! <!-- output: deltatwin simulate scenarios/crash.toml; from: 0.2268 -->
//! <!-- picture: deltatwin plan … --figure figures; file: figures/speed.svg; slow -->
//! <!-- by hand: what it takes -->
//! ```
//!
//! `from` and `to` are words in the first and the last line that is quoted, `before` a command that comes first, `with:
//! NAME=FILE` a file of the repository under another name. What is `slow` is only made on demand:
//! `ACCEPT_SNAPSHOTS=1 cargo test -p deltatwin-cli --features full --test program documents` writes everything anew, `=quick` what is not
//! slow.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use crate::common;
use crate::snapshot::{accepts, how_to_accept};
use regex::Regex;
use tempfile::TempDir;

/// What a marker says about the block or picture below it.
struct Marker {
    /// Line of the comment, from 0.
    line: usize,
    /// Command, with `deltatwin` as its first word; none for what is made by hand.
    command: Option<String>,
    /// Words after it: key and value.
    options: Vec<(String, String)>,
}

impl Marker {
    fn option(&self, key: &str) -> Option<&str> {
        self.options.iter().find(|(k, _)| k == key).map(|(_, value)| value.as_str())
    }

    fn parse((line, text): (usize, &str)) -> Option<Self> {
        let inner = text.trim().strip_prefix("<!-- ")?.strip_suffix(" -->")?;
        let (kind, rest) = inner.split_once(':')?;
        let mut parts = rest.split(';').map(str::trim);
        let first = parts.next().unwrap_or_default();
        let command = match kind {
            "output" | "picture" => Some(first.to_string()),
            "by hand" => None,
            _ => return None,
        };
        let pair = |part: &str| {
            let (key, value) = part.split_once(':').unwrap_or((part, ""));
            (key.trim().to_string(), value.trim().to_string())
        };
        Some(Self { line, command, options: parts.map(pair).collect() })
    }
}

fn documents() -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = std::fs::read_dir("docs").unwrap().map(|e| e.unwrap().path()).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "md"));
    files.push("README.md".into());
    files.sort();
    files
}

/// A folder in which the commands of the documents run as they are written.
fn workplace(marker: &Marker) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for name in ["models", "scenarios", "recordings"] {
        std::os::unix::fs::symlink(common::root().join(name), folder.path().join(name)).unwrap();
    }
    for (_, pair) in marker.options.iter().filter(|(key, _)| key == "with") {
        let (name, file) = pair.split_once('=').expect("NAME=FILE");
        std::fs::copy(common::root().join(file), folder.path().join(name)).unwrap();
    }
    folder
}

/// What a command prints on stdout.
fn run(command: &str, folder: &Path) -> String {
    let mut words = command.split_whitespace();
    assert_eq!(words.next(), Some("deltatwin"), "{command}");
    let mut program = assert_cmd::Command::cargo_bin("deltatwin").unwrap();
    let output = program.args(words).current_dir(folder).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    assert!(
        output.status.code().is_some_and(|c| c < 2),
        "{command}\n{text}{}",
        String::from_utf8_lossy(&output.stderr)
    );
    text
}

static NUMBER: LazyLock<Regex> = LazyLock::new(|| Regex::new(r"-?\d+(?:\.\d+)?(?:e-?\d+)?").unwrap());

/// Whether two texts have the same words, and numbers that differ by no more than another machine's rounding makes of an
/// iteration: `share` of the number, or `least`.
fn alike(a: &str, b: &str, [share, least]: [f64; 2]) -> bool {
    let words = |text: &str| NUMBER.replace_all(text, "#").split_whitespace().collect::<Vec<_>>().join(" ");
    let numbers = |text: &str| NUMBER.find_iter(text).map(|m| m.as_str().parse().unwrap()).collect::<Vec<f64>>();
    let near = |(x, y): (&f64, &f64)| (x - y).abs() <= least.max(share * x.abs().max(y.abs()));
    words(a) == words(b) && numbers(a).iter().zip(&numbers(b)).all(near)
}

/// The lines of an output that a marker quotes.
fn quoted(marker: &Marker, output: &str) -> String {
    let lines: Vec<&str> = output.lines().collect();
    let at = |key: &str, from: usize| {
        let words = marker.option(key)?;
        let place = lines.iter().skip(from).position(|line| line.contains(words));
        Some(from + place.unwrap_or_else(|| panic!("no line has `{words}`:\n{output}")))
    };
    let first = at("from", 0).unwrap_or(0);
    let last = at("to", first).unwrap_or(lines.len() - 1);
    lines[first..=last].join("\n").trim_end().to_string()
}

/// The block of code below line `line`: its lines from and to, without the fences.
fn block(lines: &[&str], line: usize) -> std::ops::Range<usize> {
    let first = line + 2;
    assert_eq!(lines[line + 1], "```text", "line {}", line + 2);
    first..first + lines[first..].iter().position(|l| *l == "```").expect("an end")
}

/// Folder and output of a command that was run for a document; equal ones are run once.
type Made = BTreeMap<String, (TempDir, String)>;

fn make<'m>(made: &'m mut Made, marker: &Marker, command: &str) -> &'m (TempDir, String) {
    let of = |key: &str| marker.options.iter().filter(|(k, _)| k == key).map(|(_, v)| v.clone()).collect::<Vec<_>>();
    let name = format!("{:?} {:?} {command}", of("with"), of("before"));
    made.entry(name).or_insert_with(|| {
        let folder = workplace(marker);
        of("before").iter().for_each(|before| drop(run(before, folder.path())));
        let output = run(command, folder.path());
        (folder, output)
    })
}

/// Makes what the marker stands above, and compares it; the document with what is accepted.
fn check(document: &Path, text: &str, marker: &Marker, made: &mut Made) -> String {
    let Some(command) = &marker.command else { return text.into() };
    let (folder, output) = make(made, marker, command);
    let lines: Vec<&str> = text.lines().collect();
    if let Some(file) = marker.option("file") {
        let (_, target) = lines[marker.line + 1..]
            .iter()
            .find_map(|l| l.rsplit_once("]("))
            .unwrap_or_else(|| panic!("{}: no picture", document.display()));
        let target = document.with_file_name(target.trim_end_matches(')'));
        let made = std::fs::read_to_string(folder.path().join(file)).unwrap();
        if accepts() {
            std::fs::write(&target, &made).unwrap();
        }
        let committed = std::fs::read_to_string(&target).unwrap();
        // Coordinates are in twentieths of a pixel.
        assert!(alike(&made, &committed, [0.02, 20.0]), "{}: {}", target.display(), how_to_accept(&target));
        return text.into();
    }
    let (made, range) = (quoted(marker, output), block(&lines, marker.line));
    let committed = lines[range.clone()].join("\n");
    if accepts() {
        let all = [&lines[..range.start], &made.lines().collect::<Vec<_>>(), &lines[range.end..]].concat();
        return all.join("\n") + "\n";
    }
    let hint = how_to_accept(document);
    assert!(alike(&made, &committed, [0.05, 0.02]), "{}\n{committed}\n----\n{made}\n{hint}", document.display());
    text.into()
}

#[test]
fn what_the_documents_show_is_what_the_program_makes() {
    common::at_root();
    let (mut count, mut made) = (0, Made::new());
    for document in documents() {
        let mut text = std::fs::read_to_string(&document).unwrap();
        // From the last to the first, so that lines above keep their places.
        let mut markers: Vec<Marker> = text.lines().enumerate().filter_map(Marker::parse).collect();
        let slow_too = accepts() && std::env::var("ACCEPT_SNAPSHOTS").is_ok_and(|how| how != "quick");
        markers.retain(|m| m.command.is_some() && (slow_too || m.option("slow").is_none()));
        for marker in markers.iter().rev() {
            let begun = std::time::Instant::now();
            text = check(&document, &text, marker, &mut made);
            println!("{}: {:.1} s: {:?}", document.display(), begun.elapsed().as_secs_f64(), marker.command);
            count += 1;
        }
        if accepts() {
            std::fs::write(&document, text).unwrap();
        }
    }
    assert!(count >= 8, "{count}");
}

/// No block of output and no picture stands in the documents without a word on how it is made.
#[test]
fn every_output_and_picture_says_how_it_is_made() {
    common::at_root();
    let mut missing = Vec::new();
    for document in documents() {
        let text = std::fs::read_to_string(&document).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        for (k, line) in lines.iter().enumerate() {
            let is_picture = line.starts_with("![");
            if !is_picture && *line != "```text" {
                continue;
            }
            let above = k.checked_sub(1).and_then(|above| Marker::parse((above, lines[above])));
            if above.is_none() {
                missing.push(format!("{}:{}: {line}", document.display(), k + 1));
            }
        }
    }
    assert!(missing.is_empty(), "{missing:#?}");
}

#[test]
fn rounding_is_forgiven_and_other_numbers_are_not() {
    assert!(alike("axis 1  0.4028 N·m", "axis 1 0.4027 N·m", [0.05, 0.0]));
    assert!(!alike("axis 1 0.4028", "axis 1 0.5028", [0.05, 0.02]));
    assert!(!alike("axis one", "axis two", [0.05, 0.02]));
    let marker = Marker::parse((0, "<!-- output: deltatwin x; from: b; to: c -->")).unwrap();
    assert_eq!(quoted(&marker, "a\nb\nc\nd"), "b\nc");
}

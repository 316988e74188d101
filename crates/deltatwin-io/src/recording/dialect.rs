//! Form of a table of numbers as text: encoding, separator, lines before and after the names of the columns, comments.
//!
//! It is found by looking at the first lines: the data begin where lines follow each other that have the same number of
//! cells and numbers in them; the names are above, with a row of units between if there is one. What stands before is
//! left out. [`Plain`] then presents the file as CSV with one header row, with unchanged line numbers.

use std::io::{self, BufRead, Read};

use super::columns::Unit;

/// Encoding of the text of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    Utf8,
    Latin1,
    Utf16 { big_endian: bool },
}

/// What separates the cells of a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Separator {
    Byte(u8),
    /// Any number of spaces and tabs.
    Blanks,
}

/// Form of a table.
#[derive(Clone, Debug)]
pub(super) struct Dialect {
    encoding: Encoding,
    /// Bytes of the mark at the beginning.
    mark: usize,
    separator: Separator,
    /// Names of the columns, with the units of a row of its own in brackets; `None` if the first line with content has
    /// them and the data follow.
    header: Option<Vec<String>>,
    /// Index of the first line of data.
    first: usize,
    /// What was found that is not usual.
    pub notes: Vec<String>,
}

/// Lines at the beginning of the data that must have the same form.
const ALIKE: usize = 5;
/// Marks of comments at the beginning of a line.
const COMMENTS: [&str; 3] = ["#", "%", "//"];

impl Dialect {
    /// The form of a file from its first bytes; `whole` if these are the complete file.
    pub fn of(head: &[u8], whole: bool) -> Self {
        let (encoding, mark) = encoding(head, whole);
        let text = decode(&head[mark..], encoding);
        let mut lines: Vec<&str> = text.lines().collect();
        if !whole {
            // It may be cut off.
            lines.pop();
        }
        let mut notes = match encoding {
            Encoding::Utf8 => Vec::new(),
            Encoding::Latin1 => vec!["text in Latin-1, not UTF-8".to_string()],
            Encoding::Utf16 { .. } => vec!["text in UTF-16".to_string()],
        };
        let candidates = [Separator::Byte(b'\t'), Separator::Byte(b';'), Separator::Byte(b','), Separator::Blanks];
        let found = candidates.into_iter().filter_map(|s| Some((s, data(&lines, s)?)));
        // Of equal numbers of columns, the first separator.
        type Found = (Separator, (usize, usize));
        let wider = |best: Option<Found>, item: Found| Some(best.filter(|b| b.1.1 >= item.1.1).unwrap_or(item));
        let best = found.fold(None, wider);
        let Some((separator, (first, columns))) = best else {
            let header = lines.iter().find(|l| !l.trim().is_empty()).copied().unwrap_or_default();
            let count = |b: u8| header.bytes().filter(|c| *c == b).count();
            let byte = [b',', b';', b'\t'].into_iter().rev().max_by_key(|b| count(*b)).unwrap_or(b',');
            return Self { encoding, mark, separator: Separator::Byte(byte), header: None, first: 0, notes };
        };
        let header = header(&lines[..first], separator, columns, &mut notes);
        Self { encoding, mark, separator, header, first, notes }
    }

    /// Separator of the cells as presented by [`Plain`].
    pub fn delimiter(&self) -> u8 {
        match self.separator {
            Separator::Byte(byte) => byte,
            Separator::Blanks => b'\t',
        }
    }

    /// Lines that [`Plain`] puts before those of the file.
    pub fn added(&self) -> u64 {
        u64::from(self.header.is_some() && self.first == 0)
    }

    /// Whether the file is none of text.
    pub fn is_binary(&self, head: &[u8]) -> bool {
        !matches!(self.encoding, Encoding::Utf16 { .. }) && head.contains(&0)
    }

    /// The names of the columns as one line of CSV.
    fn header_line(&self, names: &[String]) -> String {
        let quoted: Vec<String> = names.iter().map(|n| format!("\"{}\"", n.replace('"', "\"\""))).collect();
        quoted.join(&char::from(self.delimiter()).to_string())
    }
}

/// Encoding of a file, and the number of bytes of its mark.
fn encoding(head: &[u8], whole: bool) -> (Encoding, usize) {
    match head {
        [0xef, 0xbb, 0xbf, ..] => (Encoding::Utf8, 3),
        [0xff, 0xfe, ..] => (Encoding::Utf16 { big_endian: false }, 2),
        [0xfe, 0xff, ..] => (Encoding::Utf16 { big_endian: true }, 2),
        _ => match std::str::from_utf8(head) {
            Ok(_) => (Encoding::Utf8, 0),
            // A character may be cut off at the end.
            Err(e) if !whole && e.error_len().is_none() => (Encoding::Utf8, 0),
            Err(_) => (Encoding::Latin1, 0),
        },
    }
}

fn decode(bytes: &[u8], encoding: Encoding) -> String {
    match encoding {
        Encoding::Utf8 => String::from_utf8_lossy(bytes).into_owned(),
        Encoding::Latin1 => bytes.iter().map(|b| char::from(*b)).collect(),
        Encoding::Utf16 { big_endian } => {
            let unit = |pair: &[u8]| match big_endian {
                true => u16::from_be_bytes([pair[0], pair[1]]),
                false => u16::from_le_bytes([pair[0], pair[1]]),
            };
            let units = bytes.chunks_exact(2).map(unit);
            char::decode_utf16(units).map(|c| c.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
        }
    }
}

/// The text after the mark of a comment; `None` for another line.
fn comment(line: &str) -> Option<&str> {
    let line = line.trim_start();
    COMMENTS.iter().find_map(|mark| line.strip_prefix(mark)).map(str::trim)
}

/// The cells of a line, without the quotes around them.
fn cells(line: &str, separator: Separator) -> Vec<&str> {
    let Separator::Byte(byte) = separator else { return line.split_whitespace().collect() };
    let mut quoted = false;
    let ends = |c: char| {
        quoted ^= c == '"';
        !quoted && c == char::from(byte)
    };
    line.split(ends).map(|c| c.trim().trim_matches('"').trim()).collect()
}

fn is_number(cell: &str, separator: Separator) -> bool {
    let plain = cell.parse::<f64>().is_ok();
    plain || (separator != Separator::Byte(b',') && cell.replacen(',', ".", 1).parse::<f64>().is_ok())
}

/// Whether a cell may stand beside numbers: a word, a date or a time of day, but no numbers with another separator.
fn is_text(cell: &str) -> bool {
    let letter = cell.chars().any(|c| c.is_alphabetic() && !matches!(c, 'e' | 'E'));
    let date = !cell.contains(' ') && cell.matches('-').count() == 2;
    cell.is_empty() || letter || date || cell.contains([':', '/'])
}

/// Number of cells of a line of data: at least two numbers, and not more texts than numbers; `None` for another line.
fn row(line: &str, separator: Separator) -> Option<usize> {
    if comment(line).is_some() {
        return None;
    }
    let cells = cells(line, separator);
    let (numbers, others): (Vec<&str>, Vec<&str>) = cells.iter().partition(|c| is_number(c, separator));
    let table = numbers.len() >= 2 && numbers.len() >= others.len() && others.iter().all(|c| is_text(c));
    table.then_some(cells.len())
}

/// Index of the first line of data and the number of columns; `None` if there are no lines of the same form, or if a
/// line of the same form is apart from them, which then is faulty itself.
fn data(lines: &[&str], separator: Separator) -> Option<(usize, usize)> {
    let filled: Vec<(usize, Option<usize>)> = lines
        .iter()
        .enumerate()
        .filter(|(_, l)| !l.trim().is_empty() && comment(l).is_none())
        .map(|(i, l)| (i, row(l, separator)))
        .collect();
    (0..filled.len()).find_map(|k| {
        let (first, columns) = (filled[k].0, filled[k].1?);
        let next = &filled[k..(k + ALIKE).min(filled.len())];
        let alike = next.iter().all(|(_, n)| *n == Some(columns));
        let apart = filled[..k].iter().any(|(_, n)| *n == Some(columns)) || (k > 0 && filled[k - 1].1.is_some());
        (alike && !apart).then_some((first, columns))
    })
}

/// Names of the columns above the data; `None` if they are the only line there and need no change.
fn header(above: &[&str], separator: Separator, columns: usize, notes: &mut Vec<String>) -> Option<Vec<String>> {
    let filled: Vec<&str> = above.iter().copied().filter(|l| !l.trim().is_empty()).collect();
    let split = |line: &str| -> Option<Vec<String>> {
        let found: Vec<String> =
            cells(comment(line).unwrap_or(line), separator).iter().map(|c| c.to_string()).collect();
        (found.len() == columns).then_some(found)
    };
    let mut back = filled.iter().rev().filter_map(|line| split(line));
    let nearest = back.next();
    let units = nearest.as_ref().filter(|cells| are_units(cells)).cloned();
    let names = if units.is_some() { back.next() } else { nearest };
    let Some(names) = names else {
        notes.push(format!("no names above the numbers: the columns are called column1 … column{columns}"));
        return Some((1..=columns).map(|k| format!("column{k}")).collect());
    };
    let read = 1 + usize::from(units.is_some());
    let left_out = filled.len().saturating_sub(read);
    if left_out > 0 {
        notes.push(format!("{left_out} line(s) above the names of the columns left out"));
    }
    let commented = filled.last().is_some_and(|l| comment(l).is_some());
    let Some(units) = units else {
        return (left_out > 0 || commented || separator == Separator::Blanks).then_some(names);
    };
    notes.push(format!("units from the line below the names: {}", units.join(", ")));
    let with_unit = |(name, unit): (&String, &String)| {
        let unit = bare(unit);
        let stated = name.contains('[') || name.contains('(');
        if unit.is_empty() || unit == "-" || stated { name.clone() } else { format!("{name} [{unit}]") }
    };
    Some(names.iter().zip(&units).map(with_unit).collect())
}

/// A unit without brackets around it.
fn bare(cell: &str) -> &str {
    cell.trim_matches(['[', ']', '(', ')', ' '])
}

/// Whether a line consists of units: at least one, and nothing else but empty cells, `-` and `1`.
fn are_units(cells: &[String]) -> bool {
    let known = |c: &&String| Unit::find(bare(c)).is_some();
    let nothing = |c: &String| matches!(bare(c), "" | "-" | "1" | "bool" | "none");
    // A lone `t` or `s` is a name; a line of units has two at least, or one beside empty cells.
    cells.iter().filter(known).count() >= 1 && cells.iter().all(|c| nothing(c) || known(&c))
}

/// Length above which a line is none, bytes.
const LONGEST_LINE: u64 = 1 << 20;
/// Length of the longest file in UTF-16, bytes.
const LONGEST_UTF16: u64 = 256 << 20;

/// A file presented as UTF-8 text with one header row, the separator of [`Dialect::delimiter`] and no comments.
///
/// Lines that are left out become empty, so that line numbers stay.
pub(super) struct Plain<'a, R> {
    source: R,
    dialect: &'a Dialect,
    /// Index of the next line.
    line: usize,
    out: Vec<u8>,
    given: usize,
    raw: Vec<u8>,
}

impl<'a, R: BufRead> Plain<'a, R> {
    /// The file `source`, from its first byte.
    ///
    /// # Errors
    /// If the source cannot be read.
    pub fn new(mut source: R, dialect: &'a Dialect) -> io::Result<Self> {
        let mut out = Vec::new();
        if let encoding @ Encoding::Utf16 { .. } = dialect.encoding {
            // Such files come from spreadsheets and are short: they are decoded as a whole.
            let mut bytes = Vec::new();
            (&mut source).take(LONGEST_UTF16).read_to_end(&mut bytes)?;
            if bytes.len() as u64 == LONGEST_UTF16 {
                return Err(io::Error::other("it is longer than a file in UTF-16 may be; expected UTF-8"));
            }
            let text = decode(bytes.get(dialect.mark..).unwrap_or_default(), encoding);
            for (i, line) in text.lines().enumerate() {
                out.extend(dialect.presented(i, line).as_bytes());
                out.push(b'\n');
            }
        } else {
            source.consume(dialect.mark);
        }
        Ok(Self { source, dialect, line: 0, out, given: 0, raw: Vec::new() })
    }
}

impl Dialect {
    /// Line `i` as presented.
    fn presented(&self, i: usize, line: &str) -> String {
        match &self.header {
            Some(names) if i < self.first => {
                // The names take the place of the last line above the data, or share the first line with them.
                return if i + 1 == self.first { self.header_line(names) } else { String::new() };
            }
            Some(names) if self.first == 0 && i == 0 => {
                return format!("{}\n{}", self.header_line(names), self.cells_of(line));
            }
            _ => {}
        }
        if comment(line).is_some() { String::new() } else { self.cells_of(line) }
    }

    fn cells_of(&self, line: &str) -> String {
        match self.separator {
            Separator::Blanks => line.split_whitespace().collect::<Vec<_>>().join("\t"),
            Separator::Byte(_) => line.to_string(),
        }
    }

    /// Whether lines are presented as they are.
    fn untouched(&self) -> bool {
        self.header.is_none() && self.encoding == Encoding::Utf8
    }
}

impl<R: BufRead> Read for Plain<'_, R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.given == self.out.len() {
            self.out.clear();
            self.given = 0;
            while self.out.len() < buffer.len() {
                self.raw.clear();
                if (&mut self.source).take(LONGEST_LINE).read_until(b'\n', &mut self.raw)? == 0 {
                    break;
                }
                if self.raw.len() as u64 == LONGEST_LINE {
                    return Err(io::Error::new(io::ErrorKind::InvalidData, "a line without end"));
                }
                let mark = |raw: &[u8]| COMMENTS.iter().any(|m| raw.trim_ascii_start().starts_with(m.as_bytes()));
                if self.dialect.untouched() && !mark(&self.raw) {
                    self.out.extend(&self.raw);
                } else {
                    let line = match self.dialect.encoding {
                        Encoding::Latin1 => decode(&self.raw, Encoding::Latin1),
                        _ => match std::str::from_utf8(&self.raw) {
                            Ok(line) => line.to_string(),
                            Err(e) => return Err(io::Error::new(io::ErrorKind::InvalidData, e)),
                        },
                    };
                    let line = line.trim_end_matches(['\n', '\r']);
                    self.out.extend(self.dialect.presented(self.line, line).as_bytes());
                    self.out.push(b'\n');
                }
                self.line += 1;
            }
        }
        let count = buffer.len().min(self.out.len() - self.given);
        buffer[..count].copy_from_slice(&self.out[self.given..self.given + count]);
        self.given += count;
        Ok(count)
    }
}

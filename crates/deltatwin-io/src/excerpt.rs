//! The part of a text that an error shows: long lines are cut around the place, so that it fits a screen.

use std::ops::Range;

use miette::{MietteError, MietteSpanContents, SourceCode, SourceSpan, SpanContents};

/// Characters of a longer line that are shown on both sides of the place.
const AROUND: usize = 80;
/// Lines of a longer place that are marked.
const LINES: usize = 20;
/// What stands for the rest of a line.
const REST: char = '…';

/// The text of a file with cut lines.
#[derive(Debug)]
pub(crate) struct Excerpt {
    name: String,
    text: String,
    /// Column of the place in the file, bytes from 0, if its line is cut.
    column: Option<usize>,
}

impl Excerpt {
    /// The text to be shown for an error about `place` (bytes) in the file `name`, and the place in it.
    pub fn new(name: &str, text: &str, place: Range<usize>) -> (Self, Range<usize>) {
        let start = text.floor_char_boundary(place.start);
        let end = text.floor_char_boundary(place.end.max(start));
        let end = text[start..end].match_indices('\n').nth(LINES).map_or(end, |(at, _)| start + at);
        let mut out = Self { name: name.into(), text: String::with_capacity(text.len()), column: None };
        let (mut shown, mut at) = (0..0, 0);
        for line in text.split_inclusive('\n') {
            let here = at..=at + line.len();
            let (from, to) = window(line, start.clamp(at, *here.end()) - at);
            if from > 0 {
                out.text.push(REST);
            }
            let mark = |p: usize| out.text.len() + (p - at).clamp(from, to) - from;
            if here.contains(&start) {
                shown.start = mark(start);
                out.column = (to - from < line.len()).then_some(start - at);
            }
            if here.contains(&end) {
                shown.end = mark(end);
            }
            out.text.push_str(&line[from..to]);
            if to < line.len() {
                out.text.push(REST);
                out.text.push('\n');
            }
            at += line.len();
        }
        (out, shown)
    }
}

/// The range of a line (bytes) that is shown: all of it, or what is around `centre`.
fn window(line: &str, centre: usize) -> (usize, usize) {
    if line.chars().nth(2 * AROUND).is_none() {
        return (0, line.len());
    }
    let from = line[..centre].char_indices().rev().nth(AROUND - 1).map_or(0, |(at, _)| at);
    let to = line[centre..].char_indices().nth(AROUND).map_or(line.len(), |(at, _)| centre + at);
    (from, to)
}

impl SourceCode for Excerpt {
    fn read_span<'a>(
        &'a self,
        span: &SourceSpan,
        before: usize,
        after: usize,
    ) -> Result<Box<dyn SpanContents<'a> + 'a>, MietteError> {
        let inner = self.text.read_span(span, before, after)?;
        // The columns of whole lines begin at 0.
        let column = self.column.filter(|_| before == 0).unwrap_or(inner.column());
        let (data, at) = (inner.data(), *inner.span());
        let contents =
            MietteSpanContents::new_named(self.name.clone(), data, at, inner.line(), column, inner.line_count());
        Ok(Box::new(contents.with_language("toml")))
    }
}

#[cfg(test)]
mod tests {
    use miette::SourceCode;
    use proptest::prelude::*;

    use super::*;

    /// What is shown of `text` around `place`: the lines, the marked text, and line and column from 1.
    fn shown(text: &str, place: Range<usize>) -> (String, String, usize, usize) {
        let (excerpt, place) = Excerpt::new("a.toml", text, place);
        let around = excerpt.read_span(&place.clone().into(), 1, 1).unwrap();
        let own = excerpt.read_span(&place.clone().into(), 0, 0).unwrap();
        let lines = String::from_utf8(around.data().to_vec()).unwrap();
        (lines, excerpt.text[place].into(), own.line() + 1, own.column() + 1)
    }

    #[test]
    fn a_far_column_is_stated_and_its_surroundings_are_shown() {
        let text = format!("a = 1\nx = \"{}\" z\nb = 2\n", "\t".repeat(70_000));
        let at = text.find(" z").unwrap() + 1;
        let (lines, marked, line, column) = shown(&text, at..at + 1);
        assert_eq!((marked.as_str(), line, column), ("z", 2, 70_008));
        assert_eq!(lines, format!("a = 1\n…{}\" z\nb = 2\n", "\t".repeat(AROUND - 2)));
    }

    #[test]
    fn short_lines_are_shown_as_they_are() {
        let all = ("a = 1\nb = true\nc = 3\n".to_string(), "true".to_string(), 2, 5);
        assert_eq!(shown("a = 1\nb = true\nc = 3\n", 10..14), all);
        assert_eq!(shown("", 0..0), (String::new(), String::new(), 1, 1));
    }

    proptest! {
        /// Any place in any text is found again, in lines that fit a screen.
        #[test]
        fn every_place_is_shown(
            parts in prop::collection::vec(("[\tx\n\ré𝄞\u{301} 漢\u{0}]", 1..3000usize), 0..6),
            start in 0.0..1.1,
            length in 0.0..1.1,
        ) {
            let text: String = parts.iter().map(|(part, count)| part.repeat(*count)).collect();
            let from = (text.len() as f64 * start) as usize;
            let to = from + (text.len() as f64 * length) as usize;
            let (lines, marked, line, column) = shown(&text, from..to);
            prop_assert!(lines.lines().all(|line| line.chars().count() <= 2 * AROUND + 2));
            let rest = &text[text.floor_char_boundary(from)..];
            let first = marked.split(['\n', REST]).next().unwrap_or_default();
            prop_assert!(rest.starts_with(first), "{first:?}");
            if !text.contains('\r') {
                let before = &text[..text.len() - rest.len()];
                prop_assert_eq!(line, before.matches('\n').count() + 1);
                prop_assert_eq!(column, before.len() - before.rfind('\n').map_or(0, |at| at + 1) + 1);
            }
        }
    }
}

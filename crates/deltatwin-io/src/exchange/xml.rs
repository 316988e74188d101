//! Elements of an XML file that is written.

use std::fmt;

/// An element with its attributes and what is in it.
pub(super) struct Element {
    name: &'static str,
    attributes: Vec<(&'static str, String)>,
    content: Vec<Node>,
}

enum Node {
    Element(Element),
    Comment(String),
}

impl Element {
    /// An empty element.
    pub fn new(name: &'static str) -> Self {
        Self { name, attributes: Vec::new(), content: Vec::new() }
    }

    /// The element with an attribute more.
    pub fn with(mut self, name: &'static str, value: impl Into<String>) -> Self {
        self.attributes.push((name, value.into()));
        self
    }

    /// The element with an attribute of numbers more.
    pub fn numbers<'a>(self, name: &'static str, values: impl IntoIterator<Item = &'a f64>) -> Self {
        // Without the sign of a zero, and in the fewest digits that are read as the same number.
        let words: Vec<String> = values.into_iter().map(|x| (x + 0.0).to_string()).collect();
        self.with(name, words.join(" "))
    }

    /// The element with another one in it.
    pub fn and(mut self, inner: Self) -> Self {
        self.content.push(Node::Element(inner));
        self
    }

    /// The element with others in it.
    pub fn all(self, inner: impl IntoIterator<Item = Self>) -> Self {
        inner.into_iter().fold(self, Self::and)
    }

    /// The element with a comment in it.
    pub fn note(mut self, text: &str) -> Self {
        // Two hyphens would end the comment.
        let kept = text.chars().filter(|c| !c.is_control());
        let apart = kept.fold(String::new(), |mut out, c| {
            if c == '-' && out.ends_with('-') {
                out.push(' ');
            }
            out.push(c);
            out
        });
        self.content.push(Node::Comment(apart));
        self
    }

    /// The text of a file with this element.
    pub fn file(&self) -> String {
        format!("<?xml version=\"1.0\" encoding=\"utf-8\"?>\n{}", Indented(self, 0))
    }
}

/// An element at a depth.
struct Indented<'a>(&'a Element, usize);

impl fmt::Display for Indented<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(Element { name, attributes, content }, depth) = self;
        let indent = "  ".repeat(*depth);
        write!(f, "{indent}<{name}")?;
        for (key, value) in attributes {
            write!(f, " {key}=\"{}\"", escaped(value))?;
        }
        if content.is_empty() {
            return writeln!(f, "/>");
        }
        writeln!(f, ">")?;
        for node in content {
            match node {
                Node::Element(inner) => Indented(inner, depth + 1).fmt(f)?,
                Node::Comment(text) => writeln!(f, "{indent}  <!-- {text} -->")?,
            }
        }
        writeln!(f, "{indent}</{name}>")
    }
}

/// `text` without characters that have a meaning in XML, or none at all.
fn escaped(text: &str) -> String {
    let kept = text.chars().filter(|c| !c.is_control());
    kept.fold(String::new(), |mut out, c| {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            c => out.push(c),
        }
        out
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_the_text_is_the_file_is_xml() {
        let hostile = "a\"><!-- --> & \u{1}b";
        let file =
            Element::new("r").with("n", hostile).note(hostile).and(Element::new("e").numbers("x", &[-0.0, 1e-9]));
        assert_eq!(
            file.file().lines().skip(1).collect::<Vec<_>>(),
            [
                "<r n=\"a&quot;&gt;&lt;!-- --&gt; &amp; b\">",
                "  <!-- a\"><!- - - -> & b -->",
                "  <e x=\"0 0.000000001\"/>",
                "</r>"
            ]
        );
    }
}

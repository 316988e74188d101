//! [`Mapping`]: assignment of a file's columns to channels, in text form: `t=Time[ms], q1=ActPos[deg],
//! tau1=Iq[A]*0.12`.
//!
//! ```text
//! mapping    = assignment { "," assignment }
//! assignment = channel "=" ["-"] [number "*"] column ["[" unit "]"] { ("*" | "/") number } [("+" | "-") number] ["@" delay]
//! ```
//!
//! `column` is the name of a column of the file, in quotes if it contains any of `,=[]*@` or ends like arithmetic, or
//! that of a channel that has already been assigned. Arithmetic is done in the column's unit, before conversion to SI.
//! `@4ms` uses the value stored 4 ms later in the file, which compensates a delay of 4 ms.

use std::fmt;
use std::str::FromStr;

use super::unit::Unit;
use crate::recording::check::known;

/// Assignment of columns to channels; channels not mentioned are found by their names.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mapping(pub(super) Vec<Assignment>);

/// A channel and its source: value = `factor`·column + `offset` in `unit`, `delay` later.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Assignment {
    pub channel: String,
    pub column: String,
    pub unit: Option<Unit>,
    pub factor: f64,
    pub offset: f64,
    /// Delay, s.
    pub delay: f64,
    /// Whether a factor is written, which may be 1.
    pub scaled: bool,
}

impl FromStr for Mapping {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut mapping = Self::default();
        for part in split(text)? {
            let (channel, source) =
                part.split_once('=').ok_or_else(|| format!("`{part}` has no `=`; expected CHANNEL=COLUMN"))?;
            mapping.assign(channel.trim(), source.trim())?;
        }
        if mapping.0.is_empty() {
            return Err("nothing is mapped; expected CHANNEL=COLUMN, such as q1=ActPos[deg]".into());
        }
        Ok(mapping)
    }
}

impl Mapping {
    /// Adds the assignment `channel = source`.
    ///
    /// # Errors
    /// A description of what was expected, for an unknown channel or a `source` that cannot be parsed.
    pub fn assign(&mut self, channel: &str, source: &str) -> Result<(), String> {
        if !known(channel) {
            return Err(format!(
                "`{channel}` is no channel; expected t, q1…q4, tau1…tau4, qd1…, qdd1…, strut1_upper…, ee_x…"
            ));
        }
        if self.0.iter().any(|a| a.channel == channel) {
            return Err(format!("`{channel}` is mapped twice; expected every channel once"));
        }
        let assignment = Parser(source).assignment(channel).map_err(|e| format!("`{channel}={source}`: {e}"))?;
        self.0.push(assignment);
        Ok(())
    }

    /// Whether there are no assignments.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

/// The assignments in the form that is parsed.
impl fmt::Display for Mapping {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, a) in self.0.iter().enumerate() {
            let plain = |c: char| c.is_alphanumeric() || matches!(c, '_' | '.');
            let quote = match &a.column {
                name if name.chars().all(plain) && name.starts_with(char::is_alphabetic) => "",
                name if name.contains('\'') => "\"",
                _ => "'",
            };
            let (comma, minus) = (if i > 0 { ", " } else { "" }, a.factor == -1.0 && !a.scaled);
            write!(f, "{comma}{}={}{quote}{}{quote}", a.channel, if minus { "-" } else { "" }, a.column)?;
            if let Some(unit) = a.unit {
                write!(f, "[{}]", unit.name)?;
            }
            if a.scaled {
                write!(f, "*{}", a.factor)?;
            }
            if a.offset != 0.0 {
                write!(f, "{}{}", if a.offset > 0.0 { "+" } else { "-" }, a.offset.abs())?;
            }
            if a.delay != 0.0 {
                write!(f, "@{}s", a.delay)?;
            }
        }
        Ok(())
    }
}

/// The assignments, separated by commas outside quotes and brackets.
fn split(text: &str) -> Result<Vec<&str>, String> {
    let mut parts = Vec::new();
    let (mut start, mut quote, mut depth) = (0, None, 0);
    for (i, c) in text.char_indices() {
        match (quote, c) {
            (Some(q), _) if c == q => quote = None,
            (Some(_), _) => {}
            (None, '\'' | '"') => quote = Some(c),
            (None, '[') => depth += 1,
            (None, ']') => depth -= 1,
            (None, ',') if depth == 0 => {
                parts.push(text[start..i].trim());
                start = i + 1;
            }
            _ => {}
        }
    }
    if let Some(q) = quote {
        return Err(format!("`{text}`: the quote {q} is not closed"));
    }
    parts.push(text[start..].trim());
    parts.retain(|p| !p.is_empty());
    Ok(parts)
}

/// The remaining text of a source.
struct Parser<'a>(&'a str);

impl<'a> Parser<'a> {
    fn assignment(mut self, channel: &str) -> Result<Assignment, String> {
        let (mut factor, mut scaled) = (1.0, false);
        if self.take('-') {
            factor = -1.0;
        }
        if let Some((value, rest)) = leading_number(self.0)
            && let Some(rest) = rest.trim_start().strip_prefix('*')
        {
            (factor, scaled) = (factor * value, true);
            self.0 = rest.trim_start();
        }
        let column = self.column()?;
        let unit = self.unit()?;
        let (mut offset, mut delay) = (0.0, 0.0);
        loop {
            if self.take('*') {
                factor *= self.number()?;
            } else if self.take('/') {
                factor /= self.number()?;
            } else {
                break;
            }
            scaled = true;
        }
        if self.take('+') {
            offset = self.number()?;
        } else if self.take('-') {
            offset = -self.number()?;
        }
        if self.take('@') {
            let sign = if self.take('-') { -1.0 } else { 1.0 };
            delay = sign * self.delay()?;
        }
        if !self.0.is_empty() {
            return Err(format!("`{}` is left over", self.0));
        }
        if !factor.is_finite() || factor == 0.0 || !offset.is_finite() {
            return Err(format!("factor {factor} and offset {offset}; expected finite numbers, the factor not zero"));
        }
        Ok(Assignment { channel: channel.into(), column, unit, factor, offset, delay, scaled })
    }

    fn take(&mut self, c: char) -> bool {
        match self.0.trim_start().strip_prefix(c) {
            Some(rest) => {
                self.0 = rest.trim_start();
                true
            }
            None => false,
        }
    }

    fn number(&mut self) -> Result<f64, String> {
        let sign = if self.take('-') { -1.0 } else { 1.0 };
        let (value, rest) = leading_number(self.0).ok_or_else(|| format!("`{}`; expected a number", self.0))?;
        self.0 = rest.trim_start();
        Ok(sign * value)
    }

    fn delay(&mut self) -> Result<f64, String> {
        let value = self.number()?;
        let text = std::mem::take(&mut self.0).trim();
        let unit = Unit::find(if text.is_empty() { "s" } else { text });
        match unit {
            Some(u) if u.quantity == super::Quantity::Time => Ok(value * u.factor),
            _ => Err(format!("`{text}` is no unit of time; expected s, ms, us or ns")),
        }
    }

    fn column(&mut self) -> Result<String, String> {
        if let Some(q) = self.0.chars().next().filter(|c| matches!(c, '\'' | '"')) {
            let inside = &self.0[1..];
            let end = inside.find(q).ok_or_else(|| format!("the quote {q} is not closed"))?;
            self.0 = inside[end + 1..].trim_start();
            return Ok(inside[..end].to_string());
        }
        let arithmetic = |rest: &str| rest.trim_start().starts_with(|c: char| c.is_ascii_digit() || c == '.');
        let ends = |(i, c): (usize, char)| match c {
            '[' | '*' | '@' => true,
            '+' | '-' | '/' => i > 0 && arithmetic(&self.0[i + 1..]),
            _ => false,
        };
        let end = self.0.char_indices().find(|&at| ends(at)).map_or(self.0.len(), |(i, _)| i);
        let (name, rest) = self.0.split_at(end);
        if name.trim().is_empty() || name.trim().parse::<f64>().is_ok() {
            return Err(format!("`{}`; expected the name of a column", self.0));
        }
        self.0 = rest;
        Ok(name.trim().to_string())
    }

    fn unit(&mut self) -> Result<Option<Unit>, String> {
        let Some(rest) = self.0.trim_start().strip_prefix('[') else { return Ok(None) };
        let (name, rest) = rest.split_once(']').ok_or("the bracket [ is not closed")?;
        self.0 = rest.trim_start();
        let unit = Unit::find(name)
            .ok_or_else(|| format!("`{name}` is no unit that is known; expected one such as rad, deg, ms, Nm"))?;
        Ok(Some(unit))
    }
}

/// The unsigned number at the start of `text`, and the remaining text.
fn leading_number(text: &str) -> Option<(f64, &str)> {
    let mut end = 0;
    let mut before = ' ';
    for (i, c) in text.char_indices() {
        let exponent = matches!(c, 'e' | 'E')
            && text[i + 1..].trim_start_matches(['+', '-']).starts_with(|d: char| d.is_ascii_digit())
            && i > 0;
        let sign = matches!(c, '+' | '-') && matches!(before, 'e' | 'E');
        if !(c.is_ascii_digit() || c == '.' || exponent || sign) {
            break;
        }
        before = c;
        end = i + c.len_utf8();
    }
    let value = text[..end].parse().ok()?;
    Some((value, &text[end..]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(text: &str) -> Assignment {
        text.parse::<Mapping>().unwrap().0.remove(0)
    }

    #[test]
    fn sources_are_taken_apart() {
        let m: Mapping = "t=Time[ms], q1=ActPos[deg], tau1=Iq[A]*0.12".parse().unwrap();
        let units: Vec<_> = m.0.iter().map(|a| (a.column.as_str(), a.unit.map(|u| u.name), a.factor)).collect();
        assert_eq!(units, [("Time", Some("ms"), 1.0), ("ActPos", Some("deg"), 1.0), ("Iq", Some("A"), 0.12)]);
        let a = one("tau1 = -33*tau_1");
        assert_eq!((a.column.as_str(), a.factor, a.offset), ("tau_1", -33.0, 0.0));
        let a = one("q1=q1/33-1.5e-1@-4ms");
        assert_eq!((a.column.as_str(), a.factor, a.offset, a.delay), ("q1", 1.0 / 33.0, -0.15, -0.004));
        let a = one("q2='Act Pos, 2 [raw]'[deg] + 90");
        assert_eq!((a.column.as_str(), a.unit.unwrap().name, a.offset), ("Act Pos, 2 [raw]", "deg", 90.0));
        assert_eq!(one("q3=joint_states/axis3/position").column, "joint_states/axis3/position");
        assert_eq!(one("tau2=act-torque @ 2 ms").column, "act-torque");
    }

    #[test]
    fn a_mapping_is_printed_as_it_is_read() {
        for text in
            ["t=Time[ms], q1=-ActPos[deg]-90@-4ms, tau1=trq[‰]*1", "tau1=-33*'a, b'[A]/7+0.5, q2=x", "q1=\"it's\"*1e-7"]
        {
            let mapping: Mapping = text.parse().unwrap();
            assert_eq!(mapping.to_string().parse::<Mapping>().unwrap(), mapping, "{mapping}");
        }
    }

    #[test]
    fn mistakes_say_what_was_expected() {
        let refused = |text: &str| text.parse::<Mapping>().unwrap_err();
        for (text, part) in [
            ("", "nothing is mapped"),
            ("q1", "no `=`"),
            ("x1=a", "`x1` is no channel"),
            ("q1=a, q1=b", "mapped twice"),
            ("q1=a[furlong]", "`furlong` is no unit"),
            ("q1=a*", "expected a number"),
            ("q1=a*0", "not zero"),
            ("q1=5", "name of a column"),
            ("q1='a", "not closed"),
            ("q1=a[deg", "not closed"),
            ("q1=a@4N", "no unit of time"),
            ("q1=a+1+2", "left over"),
        ] {
            assert!(refused(text).contains(part), "{text}: {}", refused(text));
        }
    }
}

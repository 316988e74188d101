//! Rows of results under named columns with units.

/// One column of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Column {
    /// Name, in snake_case.
    pub name: &'static str,
    /// Unit, "1" for a number without one, empty for texts and flags.
    pub unit: &'static str,
    /// Type of its values.
    pub kind: Kind,
}

impl Column {
    /// A column of floating-point numbers in a unit.
    pub const fn float(name: &'static str, unit: &'static str) -> Self {
        Self { name, unit, kind: Kind::Float }
    }

    /// A column of integers in a unit.
    pub const fn integer(name: &'static str, unit: &'static str) -> Self {
        Self { name, unit, kind: Kind::Integer }
    }

    /// A column of texts.
    pub const fn text(name: &'static str) -> Self {
        Self { name, unit: "", kind: Kind::Text }
    }

    /// A column of true and false.
    pub const fn flag(name: &'static str) -> Self {
        Self { name, unit: "", kind: Kind::Flag }
    }
}

/// Type of the values of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// 64-bit floating-point number.
    Float,
    /// 64-bit integer.
    Integer,
    /// UTF-8 text.
    Text,
    /// True or false.
    Flag,
}

/// One value of a row.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// Floating-point number.
    Float(f64),
    /// Integer.
    Integer(i64),
    /// Text.
    Text(String),
    /// True or false.
    Flag(bool),
    /// No value, whatever the column: null in the table.
    Missing,
}

impl Value {
    /// Type of the value; `None` of a missing one, which any column accepts.
    pub fn kind(&self) -> Option<Kind> {
        match self {
            Self::Float(_) => Some(Kind::Float),
            Self::Integer(_) => Some(Kind::Integer),
            Self::Text(_) => Some(Kind::Text),
            Self::Flag(_) => Some(Kind::Flag),
            Self::Missing => None,
        }
    }

    /// The number, of a floating-point number or an integer.
    pub fn number(&self) -> Option<f64> {
        match self {
            Self::Float(value) => Some(*value),
            Self::Integer(value) => Some(*value as f64),
            _ => None,
        }
    }
}

impl From<f64> for Value {
    fn from(value: f64) -> Self {
        Self::Float(value)
    }
}

impl From<i64> for Value {
    fn from(value: i64) -> Self {
        Self::Integer(value)
    }
}

impl From<bool> for Value {
    fn from(value: bool) -> Self {
        Self::Flag(value)
    }
}

impl From<&str> for Value {
    fn from(value: &str) -> Self {
        Self::Text(value.to_owned())
    }
}

impl From<String> for Value {
    fn from(value: String) -> Self {
        Self::Text(value)
    }
}

impl<T: Into<Self>> From<Option<T>> for Value {
    fn from(value: Option<T>) -> Self {
        value.map_or(Self::Missing, Into::into)
    }
}

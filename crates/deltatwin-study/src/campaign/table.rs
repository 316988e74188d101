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

/// Head of one column of a table whose columns are not known to the compiler.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Heading {
    /// Name.
    pub name: String,
    /// Unit, as in [`Column`].
    pub unit: String,
    /// Type of the values.
    pub kind: Kind,
}

impl Heading {
    /// A heading of a column named at run time.
    pub fn new(name: impl Into<String>, unit: impl Into<String>, kind: Kind) -> Self {
        Self { name: name.into(), unit: unit.into(), kind }
    }
}

impl From<Column> for Heading {
    fn from(column: Column) -> Self {
        Self::new(column.name, column.unit, column.kind)
    }
}

/// Rows under headings, all in memory.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    /// Headings.
    pub headings: Vec<Heading>,
    /// Rows, each with one value per heading.
    pub rows: Vec<Vec<Value>>,
}

impl Table {
    /// Index of the column with this name.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.headings.iter().position(|h| h.name == name)
    }

    /// The numbers of a column, NaN where there is none.
    pub fn numbers(&self, column: usize) -> Vec<f64> {
        self.rows.iter().map(|row| row[column].number().unwrap_or(f64::NAN)).collect()
    }
}

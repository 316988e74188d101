//! Factors of a study.

use std::ops::Range as Span;

/// Something that a study changes.
#[derive(Clone, Debug, PartialEq)]
pub struct Factor {
    /// Name, also of its column.
    pub name: String,
    /// Unit, "1" for none.
    pub unit: String,
    /// Keys whose values it changes, such as `payload.mass` or `model.sockets.dislocation_force`.
    pub keys: Vec<String>,
    /// How.
    pub change: Change,
    /// Its values.
    pub range: Range,
    /// Its value where nothing else sets it, if stated.
    pub nominal: Option<f64>,
    /// Place of its table in the file.
    pub(crate) place: Span<usize>,
}

/// How a factor changes a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// The value is replaced.
    Set,
    /// The value is multiplied.
    Multiply,
    /// The factor is added to the value.
    Add,
}

/// Values of a factor.
#[derive(Clone, Debug, PartialEq)]
pub enum Range {
    /// One of several.
    Levels(Vec<Level>),
    /// A number between two, `from` and `to`.
    Interval {
        /// First end.
        from: f64,
        /// Other end.
        to: f64,
    },
    /// A number drawn from a distribution.
    Distributed(Distribution),
}

/// One of the values that a factor may have.
#[derive(Clone, Debug, PartialEq)]
pub struct Level {
    /// The value as text.
    pub text: String,
    /// The value, of a number.
    pub number: Option<f64>,
    pub(crate) value: toml::Value,
}

/// A setting of a factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setting {
    /// A number.
    Number(f64),
    /// A level, from 0.
    Level(usize),
    /// As the scenario has it.
    Unset,
}

/// Distribution of a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distribution {
    /// Normal, cut off at `low` and `high`.
    Normal {
        /// Mean.
        mean: f64,
        /// Standard deviation.
        sigma: f64,
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
    },
    /// Log-normal: the logarithm is normal.
    LogNormal {
        /// Median.
        median: f64,
        /// Standard deviation of the natural logarithm.
        sigma: f64,
    },
    /// Uniform.
    Uniform {
        /// Smallest value.
        low: f64,
        /// Largest value.
        high: f64,
    },
    /// Triangular.
    Triangular {
        /// Smallest value.
        low: f64,
        /// Most probable value.
        mode: f64,
        /// Largest value.
        high: f64,
    },
    /// Weibull.
    Weibull {
        /// Scale, the quantile at 1 − 1/e.
        scale: f64,
        /// Shape.
        shape: f64,
    },
}

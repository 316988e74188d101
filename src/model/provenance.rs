//! Origin of the numbers of a fitted model.

use std::collections::BTreeMap;

/// Origin of fitted numbers in a model file: recordings, date and program.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Provenance {
    /// Command that fitted them, e.g. `identify`.
    pub command: String,
    /// Program with its version, e.g. `deltatwin 0.1.0`.
    pub program: String,
    /// Date of the fit, `2026-11-22`; set by the caller, since the library reads no clock.
    pub date: String,
    /// Recordings used for the fit.
    pub recordings: Vec<String>,
    /// Standard error of each parameter by its full name (`drive_friction.coulomb_1`); infinite if the data determine
    /// the parameter only in combination with others.
    errors: BTreeMap<String, f64>,
}

impl Provenance {
    /// Origin of a fit by `command` on `date`; `errors` pairs full parameter names with their standard errors.
    pub fn new(
        command: &str,
        date: String,
        recordings: Vec<String>,
        errors: impl IntoIterator<Item = (String, f64)>,
    ) -> Self {
        Self {
            command: command.into(),
            program: format!("{} {}", env!("CARGO_PKG_NAME"), env!("CARGO_PKG_VERSION")),
            date,
            recordings,
            errors: errors.into_iter().collect(),
        }
    }

    /// Standard error of the parameter with one of the given `names`; `None` if it was not fitted.
    pub fn error(&self, names: &[String]) -> Option<f64> {
        names.iter().find_map(|name| self.errors.get(name).copied())
    }

    /// Recordings, date and program as one phrase.
    pub fn source(&self) -> String {
        format!("{}{} on {} by {}", FITTED, self.recordings.join(", "), self.date, self.program)
    }
}

/// First words of the source of a fitted number.
pub const FITTED: &str = "fitted to ";

//! Where the numbers of a fitted model come from.

use std::collections::BTreeMap;

/// What a model file says of the numbers that a fit moved: made from which recordings, when and by what program.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Provenance {
    /// What moved them, e.g. `identify`.
    pub command: String,
    /// Program with its version, e.g. `deltatwin 0.1.0`.
    pub program: String,
    /// Day of the fit, `2026-11-22`. Handed in: a library has no clock.
    pub date: String,
    /// Recordings that were fitted to.
    pub recordings: Vec<String>,
    /// Standard error of each parameter, by its name with that of the effect before it (`drive_friction.coulomb_1`);
    /// infinite where the data do not determine it alone.
    errors: BTreeMap<String, f64>,
}

impl Provenance {
    /// Of a fit made by `command` on a day; `errors` are names of parameters with their standard errors.
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

    /// Standard error of a parameter that has one of some names, if it was fitted.
    pub fn error(&self, names: &[String]) -> Option<f64> {
        names.iter().find_map(|name| self.errors.get(name).copied())
    }

    /// Recordings, day and program in words.
    pub fn source(&self) -> String {
        format!("{}{} on {} by {}", FITTED, self.recordings.join(", "), self.date, self.program)
    }
}

/// How the source of a fitted number begins.
pub const FITTED: &str = "fitted to ";

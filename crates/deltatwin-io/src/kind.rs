//! Kind of a file, from its name and content.

use std::path::Path;

use miette::{IntoDiagnostic, Result, WrapErr, miette};
use toml::de::DeTable;

use crate::file;
use crate::model::shipped;
use crate::recording::bag::is_bag;

/// Kinds of files read by deltatwin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Description of a machine.
    Model,
    /// Description of a run.
    Scenario,
    /// Description of many runs.
    Study,
    /// Path along which a motion is planned.
    Path,
    /// Setup of a measurement.
    Setup,
    /// Measured or simulated run.
    Recording,
}

impl std::fmt::Display for Kind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.pad(match self {
            Self::Model => "model",
            Self::Scenario => "scenario",
            Self::Study => "study",
            Self::Path => "path",
            Self::Setup => "setup",
            Self::Recording => "recording",
        })
    }
}

/// Kind of the file at `path`: a TOML file by its keys, any other file is a recording.
///
/// # Errors
/// If `path` is a folder, a file that cannot be read, or a TOML file of no known kind.
pub fn kind(path: &Path) -> Result<Kind> {
    if path.is_dir() {
        return Err(miette!("{}: is a folder; expected a file", path.display()));
    }
    if shipped::named(path).is_some() {
        return Ok(Kind::Model);
    }
    if is_bag(path) || path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("toml")) {
        return Ok(Kind::Recording);
    }
    let text = file::text(path).into_diagnostic().wrap_err_with(|| format!("{}: cannot be read", path.display()))?;
    if path.to_string_lossy().ends_with(".setup.toml") {
        return Ok(Kind::Setup);
    }
    // Syntax errors are reported by the model reader.
    let Ok(table) = DeTable::parse(&text) else { return Ok(Kind::Model) };
    Kind::by_keys(table.get_ref()).ok_or_else(|| {
        miette!(
            "{}: is TOML of no kind that is known; expected a model ([geometry], [bodies], …), a scenario (model, \
             duration, [motion], …), a study ([[factors]], [design]), a path ([path], [limits], …) or a setup (configuration, [payload], …)",
            path.display()
        )
    })
}

/// Keys that only one kind of TOML file has at its top, in the order in which they decide.
const KEYS: [(Kind, &[&str]); 5] = [
    (Kind::Study, &["factors", "design"]),
    (Kind::Model, &["mechanism", "geometry", "bodies", "drives", "effects", "assembled"]),
    (Kind::Path, &["path", "limits", "search"]),
    (Kind::Scenario, &["motion", "duration", "controller_model", "model", "substeps"]),
    (Kind::Setup, &["configuration", "payload", "noise"]),
];

impl Kind {
    fn by_keys(table: &DeTable) -> Option<Self> {
        let has = |keys: &[&str]| keys.iter().any(|k| table.contains_key(*k));
        KEYS.iter().find(|(_, keys)| has(keys)).map(|(kind, _)| *kind)
    }

    /// What TOML is that has no key of the kind `expected`; none if it has one, or those of no other kind.
    pub(crate) fn instead_of(expected: Self, text: &str) -> Option<Self> {
        let table = DeTable::parse(text).ok()?;
        let (_, own) = KEYS.iter().find(|(kind, _)| *kind == expected)?;
        let is_own = own.iter().any(|k| table.get_ref().contains_key(*k));
        Self::by_keys(table.get_ref()).filter(|_| !is_own)
    }
}

//! State of a session, and its file `session.json`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use deltatwin_analysis::Inputs;
use deltatwin_io::file::replace_text;
use deltatwin_io::recording::Mapping;
use miette::{IntoDiagnostic, WrapErr, miette};
use serde::{Deserialize, Serialize};

/// Name of the file.
pub const FILE: &str = "session.json";
/// Version of its layout.
const SCHEMA_VERSION: u32 = 1;

/// State of a session; files are relative to its folder.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Session {
    /// Version of the layout of the file.
    pub schema_version: u32,
    /// Recordings in the order in which they came.
    pub recordings: Vec<Recording>,
    /// How they are read.
    pub how: How,
    /// Models, each from an earlier one.
    pub versions: Vec<Version>,
    /// Index of the model in use.
    pub current: Option<usize>,
    /// Results by stage: `check`, `fit`, `where`, `why`, `add`.
    pub stages: BTreeMap<String, StageResult>,
    /// Changes of data or reading so far: a result of earlier data is thrown away.
    pub generation: u64,
}

/// A recording of a session.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq, Eq)]
pub struct Recording {
    /// Its file.
    pub file: String,
    /// Whether the fit does not see it.
    pub held_out: bool,
}

/// How the recordings are read, as the options of the commands.
#[derive(Clone, Debug, Default, Serialize, Deserialize, PartialEq)]
#[serde(default)]
pub struct How {
    /// Texts of `--map`, applied in order.
    pub maps: Vec<String>,
    /// `--rate`, Hz.
    pub rate: Option<f64>,
    /// `--gear-ratio`.
    pub gear_ratio: Option<f64>,
    /// `--joint`.
    pub joint: Option<String>,
    /// `--payload-mass`, kg.
    pub payload_mass: Option<f64>,
    /// `--bandwidth`, Hz.
    pub bandwidth: Option<f64>,
    /// `--keep-zeros`.
    pub keep_zeros: bool,
    /// `--no-gate`.
    pub no_gate: bool,
}

/// A model of a session.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Version {
    /// Its file.
    pub file: String,
    /// What made it.
    pub what: String,
    /// The version that it was made from.
    pub parent: Option<usize>,
    /// The command that makes it.
    pub command: String,
    /// Its errors on the data of the session; `None` until the data are checked.
    pub errors: Option<Errors>,
}

/// RMS errors of a model, on held-out data if there are any.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Errors {
    /// Titles of the channels.
    pub channels: Vec<String>,
    /// Their units.
    pub units: Vec<String>,
    /// RMS residuals.
    pub rms: Vec<f64>,
    /// Standard deviations of the noise.
    pub noise_floor: Vec<f64>,
    /// Whether they are of held-out recordings.
    pub held_out: bool,
}

/// Result of a stage.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct StageResult {
    /// Whether it went well: the data belong to the model, the fit was possible.
    pub good: bool,
    /// One or two sentences.
    pub message: String,
    /// The command that gives the same result.
    pub command: String,
    /// The model that it is about.
    pub version: usize,
    /// Remedies of the check, to be applied with one click.
    #[serde(default)]
    pub remedies: Vec<Remedy>,
    /// Effects that the diagnosis names.
    #[serde(default)]
    pub named: Vec<String>,
    /// Files to be kept, such as the scenario of the next experiment.
    #[serde(default)]
    pub files: Vec<String>,
}

/// A remedy.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq)]
pub struct Remedy {
    /// The recording and what is wrong with it.
    pub sentence: String,
    /// Whether a fit would be meaningless without it.
    pub severe: bool,
    /// `map`, `payload_mass` or `words`.
    pub kind: String,
    /// Text of the option, or advice.
    pub text: String,
}

impl Default for Session {
    fn default() -> Self {
        Self {
            schema_version: SCHEMA_VERSION,
            recordings: Vec::new(),
            how: How::default(),
            versions: Vec::new(),
            current: None,
            stages: BTreeMap::new(),
            generation: 0,
        }
    }
}

impl Session {
    /// The session of `folder`, a new one if it has none.
    ///
    /// # Errors
    /// If the file cannot be read, is none of a session or of a later version.
    pub fn read(folder: &Path) -> miette::Result<Self> {
        let file = folder.join(FILE);
        if !file.exists() {
            return Ok(Self::default());
        }
        let named = || format!("{}: is no session", file.display());
        let text = std::fs::read_to_string(&file).into_diagnostic().wrap_err_with(named)?;
        let session: Self = serde_json::from_str(&text).into_diagnostic().wrap_err_with(named)?;
        if session.schema_version > SCHEMA_VERSION {
            let (found, known) = (session.schema_version, SCHEMA_VERSION);
            return Err(miette!("{}: is of layout {found}; expected at most {known}", file.display()));
        }
        let own = session.recordings.iter().map(|r| &r.file).chain(session.versions.iter().map(|v| &v.file));
        if let Some(file) = own.clone().find(|f| !inside(f)) {
            return Err(miette!(
                "{}: names the file `{file}`; expected one in its folder",
                folder.join(FILE).display()
            ));
        }
        let last = session.versions.len();
        let indices = session.current.iter().chain(session.versions.iter().flat_map(|v| &v.parent));
        if indices.into_iter().any(|k| *k >= last) {
            return Err(miette!("{}: names a version that there is not", folder.join(FILE).display()));
        }
        Ok(session)
    }

    /// Writes the session into `folder`.
    ///
    /// # Errors
    /// If the file cannot be written; the earlier one is then unchanged.
    pub fn write(&self, folder: &Path) -> miette::Result<()> {
        let text = serde_json::to_string_pretty(self).into_diagnostic()?;
        replace_text(&folder.join(FILE), &(text + "\n"))
            .into_diagnostic()
            .wrap_err_with(|| format!("{}: cannot be written", folder.join(FILE).display()))
    }

    /// The files of the recordings in `folder` and how they are read.
    ///
    /// # Errors
    /// If a mapping cannot be parsed.
    pub fn inputs(&self, folder: &Path) -> miette::Result<Inputs> {
        let files = |held_out: bool| -> Vec<PathBuf> {
            self.recordings.iter().filter(|r| r.held_out == held_out).map(|r| folder.join(&r.file)).collect()
        };
        let map = |text: &String| text.parse::<Mapping>().map_err(|e| miette!("--map \"{text}\": {e}"));
        Ok(Inputs {
            data: files(false),
            held_out: files(true),
            setup: None,
            maps: self.how.maps.iter().map(map).collect::<Result<_, _>>()?,
            joint: self.how.joint.clone(),
            rate: self.how.rate,
            gear_ratio: self.how.gear_ratio,
            payload_mass: self.how.payload_mass,
            bandwidth: self.how.bandwidth,
            keep_zeros: self.how.keep_zeros,
            no_gate: self.how.no_gate,
            max_memory: None,
        })
    }

    /// The data, their reading or the delivered model have changed: results and errors are of the past.
    pub fn changed(&mut self) {
        self.generation += 1;
        self.stages.clear();
        self.versions.iter_mut().for_each(|v| v.errors = None);
    }

    /// Versions from the first one to the one in use.
    pub fn chain(&self) -> Vec<usize> {
        let mut chain: Vec<usize> = Vec::new();
        let mut next = self.current;
        while let Some(k) = next.filter(|k| *k < self.versions.len() && !chain.contains(k)) {
            chain.push(k);
            next = self.versions[k].parent;
        }
        chain.reverse();
        chain
    }
}

/// Creates a folder of a session, and those that lead to it, for their owner alone.
///
/// # Errors
/// The error of the operating system.
pub(crate) fn private(folder: &Path) -> std::io::Result<()> {
    let mut builder = std::fs::DirBuilder::new();
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.recursive(true).create(folder)
}

/// Whether a path stays in the folder that it is relative to.
fn inside(file: &str) -> bool {
    let path = Path::new(file);
    path.components().all(|c| matches!(c, std::path::Component::Normal(_))) && path.components().next().is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn version(parent: Option<usize>) -> Version {
        Version { file: "models/a.toml".into(), what: "a".into(), parent, command: String::new(), errors: None }
    }

    #[test]
    fn a_session_comes_back_and_names_no_file_outside() {
        let folder = tempfile::tempdir().unwrap();
        let mut session =
            Session { versions: vec![version(None), version(Some(0))], current: Some(1), ..Session::default() };
        session.recordings.push(Recording { file: "data/run.csv".into(), held_out: true });
        session.how.maps.push("q1=a[deg]".into());
        session.write(folder.path()).unwrap();
        assert_eq!(Session::read(folder.path()).unwrap(), session);
        assert_eq!(session.chain(), [0, 1]);
        session.recordings[0].file = "../../secret".into();
        session.write(folder.path()).unwrap();
        assert!(Session::read(folder.path()).unwrap_err().to_string().contains("secret"));
        session.recordings.clear();
        session.current = Some(7);
        session.write(folder.path()).unwrap();
        assert!(Session::read(folder.path()).is_err());
        std::fs::write(folder.path().join(FILE), "no json").unwrap();
        assert!(Session::read(folder.path()).is_err());
    }

    #[test]
    fn a_loop_of_versions_ends() {
        let session =
            Session { versions: vec![version(Some(1)), version(Some(0))], current: Some(1), ..Session::default() };
        assert_eq!(session.chain().len(), 2);
    }
}

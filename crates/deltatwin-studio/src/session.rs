//! State of a session, and its file `session.json`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use deltatwin::machine::Setup;
use deltatwin_analysis::Inputs;
use deltatwin_analysis::folder::{Input, sha256};
use deltatwin_io::file::replace_text;
use deltatwin_io::recording::setup::{self, Sidecar};
use deltatwin_io::recording::{self, Mapping, Reading};
use deltatwin_report::Role;
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
    /// Changes of data or reading so far: work that began before the last one has no result.
    pub generation: u64,
    /// What the results depend on now.
    #[serde(default)]
    pub basis: Basis,
    /// Results by stage and what they depend on, `STAGE-HASH`: they come back with their inputs.
    #[serde(default)]
    pub kept: BTreeMap<String, StageResult>,
    /// Whether recordings that were left out were held out.
    #[serde(default)]
    pub left_out: BTreeMap<String, bool>,
    /// Versions of delivered models that were in use earlier, by the file of the first.
    #[serde(default)]
    pub earlier: BTreeMap<String, Vec<Version>>,
}

/// Hashes of what the results of stages depend on: the recordings with their setups, how they are read, and the delivered
/// model.
#[derive(Clone, Debug, Default, Serialize, Deserialize, PartialEq, Eq)]
pub struct Basis {
    /// With all recordings.
    pub all: String,
    /// With those that are fitted.
    pub fitted: String,
}

impl Basis {
    /// Name of the result of `stage`: the fit does not see what is held out.
    pub fn key(&self, stage: &str) -> String {
        let hash = if stage == "fit" { &self.fitted } else { &self.all };
        format!("{stage}-{}", hash.get(..DIGITS).unwrap_or_default())
    }
}

/// Digits of a hash in the names of results.
const DIGITS: usize = 16;
/// Names of the stages in order.
pub const STAGES: [&str; 5] = ["check", "fit", "where", "why", "add"];

/// A recording of a session.
#[derive(Clone, Debug, Serialize, Deserialize, PartialEq, Eq)]
pub struct Recording {
    /// Its file.
    pub file: String,
    /// Whether the fit does not see it.
    pub held_out: bool,
    /// SHA-256 of its content.
    #[serde(default)]
    pub sha256: String,
}

impl Recording {
    /// The `maps` of its sidecar in `folder`; none without one.
    ///
    /// # Errors
    /// If the sidecar cannot be read.
    pub fn maps(&self, folder: &Path) -> miette::Result<Vec<Mapping>> {
        let beside = setup::sidecar(&folder.join(&self.file));
        if beside.is_file() { Ok(Sidecar::read(&beside).into_diagnostic()?.maps) } else { Ok(Vec::new()) }
    }

    /// Mass of the payload that its sidecar in `folder` states, kg; `None` if it states no setup.
    ///
    /// # Errors
    /// If the sidecar cannot be read.
    pub fn payload_mass(&self, folder: &Path) -> miette::Result<Option<f64>> {
        let beside = setup::sidecar(&folder.join(&self.file));
        if !beside.is_file() {
            return Ok(None);
        }
        Ok(Sidecar::read(&beside).into_diagnostic()?.setup.map(|s| s.payload.mass))
    }

    /// Sets the `maps` of its sidecar in `folder`; a sidecar that then says nothing is removed.
    ///
    /// # Errors
    /// If the sidecar cannot be read or written.
    pub fn set_maps(&self, folder: &Path, maps: &[Mapping]) -> miette::Result<()> {
        self.rewrite(folder, |text, name| setup::with_maps(text, maps, name).into_diagnostic())
    }

    /// Sets the mass of the payload, kg, in its sidecar in `folder`. Where the sidecar states no setup, it gets that of the
    /// recording, read as `how` says.
    ///
    /// # Errors
    /// If the recording or its sidecar cannot be read, or the sidecar not written.
    pub fn set_payload_mass(&self, folder: &Path, how: &Reading, mass: f64) -> miette::Result<()> {
        let own = match self.payload_mass(folder)? {
            Some(_) => Setup::default(),
            None => recording::read_as(&folder.join(&self.file), how).into_diagnostic()?.0.setup,
        };
        self.rewrite(folder, |text, name| setup::with_payload_mass(text, &own, mass, name).into_diagnostic())
    }

    /// Writes its sidecar in `folder` with the text that `change` makes of the present one, empty without one.
    fn rewrite(&self, folder: &Path, change: impl FnOnce(&str, &str) -> miette::Result<String>) -> miette::Result<()> {
        let beside = setup::sidecar(&folder.join(&self.file));
        let text = if beside.is_file() { std::fs::read_to_string(&beside).into_diagnostic()? } else { String::new() };
        let text = change(&text, &beside.display().to_string())?;
        match text.trim().is_empty() {
            true if beside.is_file() => std::fs::remove_file(&beside).into_diagnostic(),
            true => Ok(()),
            false => replace_text(&beside, &text).into_diagnostic(),
        }
    }
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
    /// Its errors by the data they are of, see `Basis::all`.
    #[serde(default)]
    pub known: BTreeMap<String, Errors>,
}

impl Version {
    /// A version that is not made from another one.
    pub fn delivered(file: &str, what: &str) -> Self {
        let (file, what) = (file.into(), what.into());
        Self { file, what, parent: None, command: String::new(), errors: None, known: BTreeMap::new() }
    }

    /// Stage of the model, by which it is coloured.
    pub fn role(&self) -> Role {
        match self.parent {
            None => Role::Nominal,
            Some(_) if self.what.starts_with("+ ") => Role::Added,
            Some(_) => Role::Identified,
        }
    }
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
    /// The experiment that the diagnosis proposes.
    #[serde(default)]
    pub next: Option<String>,
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
    /// File of the recording, in whose sidecar a `map` or the mass is set.
    #[serde(default)]
    pub recording: String,
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
            basis: Basis::default(),
            kept: BTreeMap::new(),
            left_out: BTreeMap::new(),
            earlier: BTreeMap::new(),
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
        let mut session: Self = serde_json::from_str(&text).into_diagnostic().wrap_err_with(named)?;
        if session.schema_version > SCHEMA_VERSION {
            let (found, known) = (session.schema_version, SCHEMA_VERSION);
            return Err(miette!("{}: is of layout {found}; expected at most {known}", file.display()));
        }
        let versions = session.versions.iter().chain(session.earlier.values().flatten());
        let own = session.recordings.iter().map(|r| &r.file).chain(versions.map(|v| &v.file));
        if let Some(file) = own.clone().find(|f| !inside(f)) {
            return Err(miette!(
                "{}: names the file `{file}`; expected one in its folder",
                folder.join(FILE).display()
            ));
        }
        let lines = session.earlier.values().chain([&session.versions]);
        let whole = |line: &Vec<Version>| line.iter().flat_map(|v| v.parent).all(|k| k < line.len());
        if !lines.into_iter().all(whole) || session.current.is_some_and(|k| k >= session.versions.len()) {
            return Err(miette!("{}: names a version that there is not", folder.join(FILE).display()));
        }
        let is_hash = |hash: &String| hash.len() == 64 && hash.bytes().all(|b| b.is_ascii_hexdigit());
        if !is_hash(&session.basis.all) || !is_hash(&session.basis.fitted) {
            // Of an earlier program.
            session.basis = session.basis_of(folder).unwrap_or_default();
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

    /// After a change of the data, their reading or the delivered model: the results and errors that belong to them are
    /// in use, those of before are kept.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn changed(&mut self, folder: &Path) -> miette::Result<()> {
        let (before, now) = (self.basis.clone(), self.basis_of(folder)?);
        if before == now {
            return Ok(());
        }
        self.generation += 1;
        for (stage, result) in std::mem::take(&mut self.stages) {
            self.kept.insert(before.key(&stage), result);
        }
        for version in &mut self.versions {
            version.known.extend(version.errors.take().map(|errors| (before.all.clone(), errors)));
            version.errors = version.known.get(&now.all).cloned();
        }
        let known =
            STAGES.iter().filter_map(|stage| Some((stage.to_string(), self.kept.get(&now.key(stage))?.clone())));
        self.stages = known.collect();
        self.basis = now;
        Ok(())
    }

    fn basis_of(&mut self, folder: &Path) -> miette::Result<Basis> {
        let hash = |file: &Path| {
            let input = Input::of("", file).into_diagnostic();
            input.map(|i| i.sha256).wrap_err_with(|| format!("{}: cannot be read", file.display()))
        };
        let mut all = Vec::new();
        for recording in &mut self.recordings {
            let file = folder.join(&recording.file);
            if recording.sha256.is_empty() {
                recording.sha256 = hash(&file)?;
            }
            let beside = setup::sidecar(&file);
            let setup = if beside.is_file() { Some(hash(&beside)?) } else { None };
            all.push((recording.held_out, recording.file.clone(), recording.sha256.clone(), setup));
        }
        all.sort();
        let delivered = self.versions.first().map(|v| hash(&folder.join(&v.file)).map(|hash| (&v.file, hash)));
        let delivered = delivered.transpose()?;
        let of = |recordings: &[(bool, String, String, Option<String>)]| {
            serde_json::to_string(&(recordings, &self.how, &delivered)).map(|text| sha256(&text)).into_diagnostic()
        };
        let fitted = all.iter().take_while(|(held_out, ..)| !held_out).count();
        Ok(Basis { all: of(&all)?, fitted: of(&all[..fitted])? })
    }

    /// Makes `file` the first of the versions, with those that were made from it earlier.
    pub fn begin_with(&mut self, file: &str, what: &str) {
        if let Some(first) = self.versions.first() {
            self.earlier.insert(first.file.clone(), std::mem::take(&mut self.versions));
        }
        let known = self.earlier.remove(file);
        self.versions = known.unwrap_or_else(|| vec![Version::delivered(file, what)]);
        self.current = Some(0);
    }

    /// Adds a recording; of those that are new the first is fitted to, the others judge.
    pub fn add(&mut self, file: String) {
        if self.recordings.iter().any(|r| r.file == file) {
            return;
        }
        let some_fitted = self.recordings.iter().any(|r| !r.held_out);
        let held_out = some_fitted && self.left_out.remove(&file).unwrap_or(true);
        self.recordings.push(Recording { file, held_out, sha256: String::new() });
    }

    /// The index of a recording of the session.
    fn position(&self, index: Option<usize>) -> miette::Result<usize> {
        let count = self.recordings.len();
        index
            .filter(|k| *k < count)
            .ok_or_else(|| miette!("the session has {count} recordings; this is not one of them"))
    }

    /// Takes recording `index` out.
    ///
    /// # Errors
    /// If there is none.
    pub fn leave_out(&mut self, index: Option<usize>) -> miette::Result<()> {
        let index = self.position(index)?;
        let Recording { file, held_out, .. } = self.recordings.remove(index);
        self.left_out.insert(file, held_out);
        Ok(())
    }

    /// Changes the `maps` of the sidecar of recording `index` in `folder`.
    ///
    /// The maps that hold for all recordings are moved into all sidecars before: they were applied first.
    ///
    /// # Errors
    /// If there is no such recording, or a sidecar cannot be read or written.
    pub fn remap(
        &mut self,
        folder: &Path,
        index: Option<usize>,
        change: impl FnOnce(&mut Vec<Mapping>) -> miette::Result<()>,
    ) -> miette::Result<()> {
        let index = self.position(index)?;
        let common = self.inputs(folder)?.maps;
        let mut all: Vec<Vec<Mapping>> = Vec::new();
        for recording in &self.recordings {
            all.push([recording.maps(folder)?, common.clone()].concat());
        }
        change(&mut all[index])?;
        for (recording, maps) in self.recordings.iter().zip(&all) {
            if *maps != recording.maps(folder)? {
                recording.set_maps(folder, maps)?;
            }
        }
        self.how.maps.clear();
        Ok(())
    }

    /// Sets the mass of the payload, kg, of recording `index` in its sidecar in `folder`.
    ///
    /// A mass that holds for all recordings is moved into all sidecars before.
    ///
    /// # Errors
    /// If no recording has this index or the mass is negative; those of [`Recording::set_payload_mass`].
    pub fn weigh(&mut self, folder: &Path, index: Option<usize>, mass: f64) -> miette::Result<()> {
        let index = self.position(index)?;
        if !(mass >= 0.0 && mass.is_finite()) {
            return Err(miette!("the mass of a payload is {mass} kg; expected at least 0"));
        }
        let inputs = self.inputs(folder)?;
        let how = inputs.reading(None);
        for (k, recording) in self.recordings.iter().enumerate() {
            let own = if k == index { Some(mass) } else { self.how.payload_mass };
            own.map_or(Ok(()), |own| recording.set_payload_mass(folder, &how, own))?;
        }
        self.how.payload_mass = None;
        Ok(())
    }

    /// File of the result of `stage` as a part of a page; a result of an earlier program has the name of the stage.
    pub fn part(&self, folder: &Path, stage: &str) -> Option<PathBuf> {
        self.stages.get(stage)?;
        let stages = folder.join("stages");
        let own = stages.join(format!("{}.html", self.basis.key(stage)));
        Some(if own.is_file() { own } else { stages.join(format!("{stage}.html")) })
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
        Version { parent, ..Version::delivered("models/a.toml", "a") }
    }

    #[test]
    fn a_remedy_belongs_to_its_recording_and_can_be_undone() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("data")).unwrap();
        let mut session = Session::default();
        session.add("data/a.csv".into());
        session.add("data/b.csv".into());
        for r in &session.recordings {
            std::fs::write(folder.path().join(&r.file), "t,q1,tau1\n").unwrap();
        }
        let stated = "[payload]\nmass = 1.5 # kg\n";
        std::fs::write(folder.path().join("data/b.setup.toml"), stated).unwrap();
        let of = |session: &Session| -> Vec<Vec<String>> {
            let maps = |r: &Recording| r.maps(folder.path()).unwrap().iter().map(Mapping::to_string).collect();
            session.recordings.iter().map(maps).collect()
        };
        let remedy = |text: &str| {
            let map = text.parse::<Mapping>().unwrap();
            move |maps: &mut Vec<Mapping>| {
                maps.push(map);
                Ok(())
            }
        };
        let none: [&str; 0] = [];
        session.remap(folder.path(), Some(1), remedy("tau1=-tau1")).unwrap();
        assert_eq!(of(&session), [&none[..], &["tau1=-tau1"]]);
        // What holds for all was applied first, and stays first.
        session.how.maps.push("q1=q1+0.5".into());
        session.remap(folder.path(), Some(0), remedy("q1=-q1")).unwrap();
        assert_eq!(of(&session), [&["q1=q1+0.5", "q1=-q1"], &["tau1=-tau1", "q1=q1+0.5"]]);
        assert!(session.how.maps.is_empty());
        for k in [0, 1] {
            let clear = |maps: &mut Vec<Mapping>| {
                maps.clear();
                Ok(())
            };
            session.remap(folder.path(), Some(k), clear).unwrap();
        }
        assert!(!folder.path().join("data/a.setup.toml").exists());
        assert_eq!(std::fs::read_to_string(folder.path().join("data/b.setup.toml")).unwrap(), stated);
        assert!(
            session
                .remap(folder.path(), Some(2), remedy("q1=-q1"))
                .unwrap_err()
                .to_string()
                .contains("not one of them")
        );
    }

    #[test]
    fn the_payload_of_a_remedy_belongs_to_its_recording() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::create_dir(folder.path().join("data")).unwrap();
        let mut session = Session::default();
        for name in ["a", "b", "c"] {
            session.add(format!("data/{name}.csv"));
            let stated = "[payload]\nmass = 1.5 # kg\ncom = [0.0, 0.0, -0.1]\n";
            std::fs::write(folder.path().join(format!("data/{name}.setup.toml")), stated).unwrap();
        }
        let of = |session: &Session| -> Vec<Option<f64>> {
            session.recordings.iter().map(|r| r.payload_mass(folder.path()).unwrap()).collect()
        };
        session.weigh(folder.path(), Some(1), 2.5).unwrap();
        assert_eq!((of(&session), session.how.payload_mass), (vec![Some(1.5), Some(2.5), Some(1.5)], None));
        // What was stated for all recordings stays so for the others.
        session.how.payload_mass = Some(4.0);
        session.weigh(folder.path(), Some(0), 3.0).unwrap();
        assert_eq!((of(&session), session.how.payload_mass), (vec![Some(3.0), Some(4.0), Some(4.0)], None));
        let text = std::fs::read_to_string(folder.path().join("data/a.setup.toml")).unwrap();
        assert!(text.contains("com = [0.0, 0.0, -0.1]"), "{text}");
        for (index, mass) in [(3, 1.0), (0, -1.0)] {
            assert!(session.weigh(folder.path(), Some(index), mass).is_err());
        }
    }

    #[test]
    fn a_session_comes_back_and_names_no_file_outside() {
        let folder = tempfile::tempdir().unwrap();
        let mut session =
            Session { versions: vec![version(None), version(Some(0))], current: Some(1), ..Session::default() };
        session.recordings.push(Recording { file: "data/run.csv".into(), held_out: true, sha256: String::new() });
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

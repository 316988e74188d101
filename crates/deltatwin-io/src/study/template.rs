//! Scenario and models of a study, and the runs made of them.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use deltatwin::identification::uncertainty::Uncertainty;
use deltatwin::machine::Sockets;
use deltatwin::model::Model;
use deltatwin::scenario::Scenario;
use toml::{Table, Value};

use super::factor::{Change, Factor, Range, Setting};
use super::tree;
use crate::model::{self, uncertainty};
use crate::outside::Access;
use crate::scenario::{self, ScenarioError};
use crate::source::Problem;

/// Key of a factor whose levels are scenario files.
pub const SCENARIO: &str = "scenario";
/// Size of the longest file that a study names, bytes.
const LONGEST: u64 = 1 << 30;
/// Key of a factor that scales the speed of the whole motion.
pub const SPEED: &str = "speed_scale";
/// First steps of keys into model files.
const MODEL: &str = "model.";
const CONTROLLER: &str = "controller_model.";
/// Step of a key after which the number of a machine follows that is drawn from a model's covariance.
const DRAWN: &str = "drawn";
/// Largest number of such a machine.
const MOST_DRAWN: f64 = 1e9;
/// Smallest and largest scale of the speed.
const SPEEDS: [f64; 2] = [1e-3, 1e3];

/// What a run is made of.
#[derive(Clone)]
pub struct Files {
    /// Scenario.
    pub scenario: Scenario,
    /// Model of the machine.
    pub model: Model,
    /// Model of the feed-forward, if it is another.
    pub controller_model: Option<Model>,
    /// Ball sockets of the model file, before any change: what is known at the machine.
    pub nominal: Sockets,
    /// Folder to which the scenario's names of files are relative.
    pub folder: PathBuf,
    /// Text of the scenario, with everything but a scaled speed.
    pub text: String,
}

/// A scenario file as a tree.
#[derive(Clone)]
struct Base {
    path: PathBuf,
    tree: Table,
}

/// A model file as a tree, and read.
struct Source {
    tree: Table,
    model: Model,
}

/// Scenarios and models, before any change.
#[derive(Clone)]
pub(super) struct Template {
    bases: Vec<Base>,
    access: Access,
    contents: Vec<(String, Vec<u8>)>,
    models: Arc<Mutex<HashMap<PathBuf, Arc<Source>>>>,
    uncertainties: Arc<Mutex<HashMap<PathBuf, Arc<Uncertainty>>>>,
}

/// Changes of a model file, and the number of the machine drawn from its covariance.
#[derive(Default)]
struct Changes {
    keys: Vec<(String, Value, Change)>,
    drawn: u64,
}

impl Changes {
    fn set(&mut self, key: &str, value: &Value, change: Change) -> Result<(), String> {
        if key != DRAWN {
            self.keys.push((key.into(), value.clone(), change));
            return Ok(());
        }
        let number = value.as_float().or_else(|| value.as_integer().map(|n| n as f64));
        let number = number.filter(|n| (0.0..=MOST_DRAWN).contains(n) && change == Change::Set);
        self.drawn = number.ok_or_else(|| {
            format!("`{DRAWN}` is {value}; expected a number from 0 (the model itself) to {MOST_DRAWN:e}, set")
        })? as u64;
        Ok(())
    }

    fn is_empty(&self) -> bool {
        self.keys.is_empty() && self.drawn == 0
    }
}

/// What an error says, without its place in a text that nobody has written.
fn said(error: &ScenarioError) -> String {
    match error {
        ScenarioError::Content(problem) => problem.message.clone(),
        other => other.to_string(),
    }
}

fn said_of_model(error: &miette::Report) -> String {
    error.downcast_ref::<Problem>().map_or_else(|| error.to_string(), |problem| problem.message.clone())
}

impl Template {
    /// The scenarios in the files at `paths`, or the model of an experiment, and all files that they and the `study` name.
    pub fn read(
        (paths, experiment): (&[PathBuf], Option<&Path>),
        access: Access,
        study: &Table,
    ) -> Result<Self, ScenarioError> {
        let mut bases = Vec::new();
        for path in paths {
            let text = ScenarioError::text(path)?;
            scenario::parse_with(&text, path, access)
                .map_err(|e| e.unless_other(crate::kind::Kind::Scenario, &text, path))?;
            let tree = text
                .parse()
                .map_err(|e: toml::de::Error| ScenarioError::Io { file: path.clone(), reason: e.to_string() })?;
            bases.push(Base { path: path.clone(), tree });
        }
        let mut template =
            Self { bases, access, contents: Vec::new(), models: Arc::default(), uncertainties: Arc::default() };
        template.contents = template.all_contents(experiment, study)?;
        Ok(template)
    }

    pub fn scenario(&self) -> &Path {
        self.bases.first().map_or(Path::new(""), |base| &base.path)
    }

    pub fn contents(&self) -> &[(String, Vec<u8>)] {
        &self.contents
    }

    /// Study, scenarios and models with their keys in order, and all other files that they name.
    fn all_contents(&self, experiment: Option<&Path>, study: &Table) -> Result<Vec<(String, Vec<u8>)>, ScenarioError> {
        // Names as they are written, so that a study may be moved together with its files.
        let mut named = BTreeMap::new();
        for base in &self.bases {
            let folder = base.path.parent().unwrap_or(Path::new(""));
            for table in [&base.tree, study] {
                table.values().for_each(|value| self.files_in(value, folder, &mut named));
            }
        }
        if let Some(model) = experiment {
            named.insert("model".into(), model.to_path_buf());
        }
        let mut contents = vec![("study".to_string(), study.to_string().into_bytes())];
        contents.extend(self.bases.iter().map(|base| ("scenario".to_string(), base.tree.to_string().into_bytes())));
        for (name, file) in named.clone() {
            let covariance = uncertainty::beside(&file);
            if is_drawn(study) && covariance.is_file() && name.ends_with(".toml") {
                named.insert(uncertainty::beside(Path::new(&name)).to_string_lossy().into_owned(), covariance);
            }
        }
        for (name, file) in named {
            let bytes = crate::file::bytes(&file, LONGEST)
                .map_err(|e| ScenarioError::Io { file: file.clone(), reason: e.to_string() })?;
            let tree = std::str::from_utf8(&bytes).ok().filter(|_| file.extension().is_some_and(|e| e == "toml"));
            let bytes = tree
                .and_then(|text| text.parse::<Table>().ok())
                .map_or(bytes.clone(), |tree| tree.to_string().into_bytes());
            contents.push((name, bytes));
        }
        Ok(contents)
    }

    /// See [`super::Study::files`].
    pub fn files(&self, factors: &[Factor], settings: &[Setting], seed: Option<u64>) -> Result<Files, String> {
        let mut run = Run { model: Changes::default(), controller: Changes::default(), speed: 1.0, late: Vec::new() };
        let base = factors.iter().zip(settings).find_map(|(factor, setting)| match setting {
            Setting::Level(level) if factor.keys[0] == SCENARIO => Some(*level),
            _ => None,
        });
        let base = self.bases.get(base.unwrap_or(0)).ok_or("the study has no such scenario")?;
        let mut tree = base.tree.clone();
        if let Some(seed) = seed {
            tree.insert("seed".into(), Value::Integer(i64::try_from(seed).map_err(|e| e.to_string())?));
        }
        for (factor, setting) in factors.iter().zip(settings).filter(|(_, setting)| **setting != Setting::Unset) {
            run.set(&mut tree, factor, &value(factor, *setting)?)?;
        }
        for (key, value, change) in std::mem::take(&mut run.late) {
            complete(&mut tree, &key);
            tree::change(&mut tree, &key, &value, change)?;
        }
        let text = tree.to_string();
        let scenario = scenario::parse_with(&text, &base.path, self.access).map_err(|e| said(&e))?;
        let scenario = if run.speed == 1.0 { scenario } else { scenario.faster(run.speed) };
        let model = self.model(&scenario.model, &run.model)?;
        let other = scenario.controller_model.as_ref();
        let controller_model = match other {
            None if run.controller.is_empty() => None,
            other => Some(self.model(other.unwrap_or(&scenario.model), &run.controller)?),
        };
        let nominal = self.model(&scenario.model, &Changes::default())?.sockets;
        let folder = base.path.parent().unwrap_or(Path::new("")).to_path_buf();
        Ok(Files { scenario, model, controller_model, nominal, folder, text })
    }

    /// The model in a file, with changes.
    fn model(&self, path: &Path, changes: &Changes) -> Result<Model, String> {
        let known = self.models.lock().map_or(None, |models| models.get(path).cloned());
        let source = match known {
            Some(source) => source,
            None => {
                let model = model::read(path).map_err(|e| e.to_string())?;
                let text = model.source.as_deref().unwrap_or_default();
                let tree = text.parse().map_err(|e: toml::de::Error| e.to_string())?;
                let source = Arc::new(Source { tree, model });
                if let Ok(mut models) = self.models.lock() {
                    models.insert(path.into(), source.clone());
                }
                source
            }
        };
        if changes.is_empty() {
            return Ok(source.model.clone());
        }
        let name = || path.file_name().unwrap_or_default().to_string_lossy();
        // Drawn first, so that what a factor sets or multiplies is that of the drawn machine.
        let mut tree = match changes.drawn {
            0 => source.tree.clone(),
            number => {
                let uncertainty = self.uncertainty(path)?;
                let drawn = uncertainty.draw(&source.model, number).map_err(|e| format!("{}: {e}", name()))?;
                let text = source.model.source.as_deref().unwrap_or_default();
                let text = model::updated_text(text, &drawn).map_err(|e| format!("{}: {e}", name()))?;
                text.parse().map_err(|e: toml::de::Error| e.to_string())?
            }
        };
        for (key, value, change) in &changes.keys {
            tree::change(&mut tree, key, value, *change).map_err(|e| format!("{}: {e}", path.display()))?;
        }
        model::parse(&tree.to_string(), path).map_err(|e| format!("{}: {}", name(), said_of_model(&e)))
    }

    /// The covariance beside a model file.
    fn uncertainty(&self, path: &Path) -> Result<Arc<Uncertainty>, String> {
        let known = self.uncertainties.lock().map_or(None, |all| all.get(path).cloned());
        if let Some(known) = known {
            return Ok(known);
        }
        let read = Arc::new(uncertainty::read(path)?);
        if let Ok(mut all) = self.uncertainties.lock() {
            all.insert(path.into(), read.clone());
        }
        Ok(read)
    }
}

/// Changes of one run that are not made in the scenario's tree at once.
struct Run {
    model: Changes,
    controller: Changes,
    speed: f64,
    /// Changes of parts of values that other factors may determine.
    late: Vec<(String, Value, Change)>,
}

impl Run {
    fn set(&mut self, tree: &mut Table, factor: &Factor, value: &Value) -> Result<(), String> {
        for key in &factor.keys {
            let change = factor.change;
            if key == SCENARIO {
                // The base was chosen by it.
            } else if key == SPEED {
                let scale = value.as_float().or_else(|| value.as_integer().map(|n| n as f64));
                let [low, high] = SPEEDS;
                match scale.filter(|scale| (low..=high).contains(scale)) {
                    Some(scale) => self.speed *= scale,
                    None => return Err(format!("`{SPEED}` is {value}; expected a number from {low} to {high}")),
                }
            } else if let Some(key) = key.strip_prefix(CONTROLLER) {
                self.controller.set(key, value, change)?;
            } else if let Some(key) = key.strip_prefix(MODEL) {
                self.model.set(key, value, change)?;
            } else if completed(key) {
                self.late.push((key.clone(), value.clone(), change));
            } else {
                tree::change(tree, key, value, change)?;
            }
        }
        Ok(())
    }
}

/// Whether a study draws machines from the covariance of a model.
fn is_drawn(study: &Table) -> bool {
    let drawn = |key: &Value| key.as_str().is_some_and(|key| key.rsplit_once('.').is_some_and(|(_, end)| end == DRAWN));
    let keys = |factor: &Value| match factor.get("key") {
        Some(Value::Array(keys)) => keys.iter().any(drawn),
        Some(key) => drawn(key),
        None => false,
    };
    study.get("factors").and_then(Value::as_array).is_some_and(|factors| factors.iter().any(keys))
}

/// Whether a key is a part of an array that a scenario may omit.
fn completed(key: &str) -> bool {
    ["sockets.wear", "payload.com", "payload.grip"].iter().any(|array| key.starts_with(array))
}

/// Puts in what a scenario omits if `key` is a part of it: no wear, a centre of mass at the flange, the grip in the middle
/// of the box's top.
fn complete(tree: &mut Table, key: &str) {
    let mut steps = key.splitn(3, '.');
    let (Some(table), Some(array)) = (steps.next(), steps.next()) else { return };
    let Some(Value::Table(table)) = Some(tree.entry(table).or_insert_with(|| Value::Table(Table::new()))) else {
        return;
    };
    let number = |value: &Value| value.as_float().or_else(|| value.as_integer().map(|n| n as f64));
    let default = match array {
        "wear" => vec![0.0; 2 * deltatwin::machine::Mechanism::default().struts()],
        "com" => vec![0.0; 3],
        _ => {
            let height = table.get("box").and_then(|size| number(size.as_array()?.get(2)?));
            vec![0.0, 0.0, 0.5 * height.unwrap_or(0.0)]
        }
    };
    table.entry(array).or_insert_with(|| Value::Array(default.into_iter().map(Value::Float).collect()));
}

/// The value of a factor at a setting.
fn value(factor: &Factor, setting: Setting) -> Result<Value, String> {
    match (setting, &factor.range) {
        (Setting::Number(number), _) => Ok(Value::Float(number)),
        (Setting::Level(level), Range::Levels(levels)) => {
            levels.get(level).map(|level| level.value.clone()).ok_or_else(|| "there is no such level".into())
        }
        (Setting::Level(_) | Setting::Unset, _) => Err("a factor without levels has no level".into()),
    }
}

impl Template {
    /// Adds the files that a value names relative to `folder`, by the names that it gives them.
    fn files_in(&self, value: &Value, folder: &Path, found: &mut BTreeMap<String, PathBuf>) {
        match value {
            Value::String(name) => {
                let file = folder.join(name);
                if !name.is_empty() && file.is_file() && self.access.check(&folder.join("study"), &file).is_ok() {
                    found.insert(name.clone(), file);
                }
            }
            Value::Array(items) => items.iter().for_each(|item| self.files_in(item, folder, found)),
            Value::Table(table) => table.values().for_each(|item| self.files_in(item, folder, found)),
            _ => {}
        }
    }
}

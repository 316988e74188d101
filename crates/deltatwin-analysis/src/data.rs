//! Recordings used together: datasets of several files, restricted to their common channels.

use std::path::{Path, PathBuf};

use deltatwin::gate::{Finding, Problem, inspect};
use deltatwin::identification::bandwidth::{bandwidth, narrow};
use deltatwin::identification::derivatives::Method;
use deltatwin::identification::zeros::{Zero, zeros};
use deltatwin::identification::{Dataset, FitError, check_together};
use deltatwin::machine::{Mechanism, Unit};
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin::recording::Recording;
use deltatwin::text::{nearest, significant};
use deltatwin_io::recording::{self, Mapping, ReadError, Reading};
use miette::{Diagnostic, miette};
use serde_json::{Value, json};
use thiserror::Error;

/// Files of recordings and how they are read.
#[derive(Clone, Debug, Default)]
pub struct Inputs {
    /// Recordings to fit to.
    pub data: Vec<PathBuf>,
    /// Recordings that the fit does not see.
    pub held_out: Vec<PathBuf>,
    /// Setup of all recordings, instead of their sidecars.
    pub setup: Option<PathBuf>,
    /// Assignments of columns to channels, applied in order.
    pub maps: Vec<Mapping>,
    /// Joint of several that is read as a lone axis.
    pub joint: Option<String>,
    /// Samples per second of files without a column of time.
    pub rate: Option<f64>,
    /// Gear ratio of recordings of the motor's side.
    pub gear_ratio: Option<f64>,
    /// Bytes that a recording may take, instead of three quarters of what is free.
    pub max_memory: Option<u64>,
    /// Mass of the payload, kg, instead of what the setup states.
    pub payload_mass: Option<f64>,
    /// Cut-off of the accelerations of a lone axis, Hz; infinite for none, found from the recordings if `None`.
    pub bandwidth: Option<f64>,
    /// Whether the positions of a lone axis stay as recorded, even if recordings have other zeros.
    pub keep_zeros: bool,
    /// Whether a recording is fitted even if it does not belong to the model.
    pub no_gate: bool,
}

impl Inputs {
    /// Options for reading a recording of `machine`, which is inferred if `None`.
    pub fn reading(&self, machine: Option<Mechanism>) -> Reading<'_> {
        Reading {
            setup: self.setup.as_deref(),
            machine,
            maps: &self.maps,
            joint: self.joint.as_deref(),
            rate: self.rate,
            gear_ratio: self.gear_ratio,
            max_memory: self.max_memory,
        }
    }

    /// Files that no output may overwrite.
    pub fn files(&self) -> Vec<&Path> {
        self.data.iter().chain(&self.held_out).chain(&self.setup).map(PathBuf::as_path).collect()
    }

    /// The words of a command line that state the same inputs.
    pub fn words(&self) -> Vec<String> {
        let text = |file: &PathBuf| file.display().to_string();
        let mut words: Vec<String> = self.data.iter().map(text).collect();
        let mut option = |flag: &str, value: String| words.extend([flag.to_string(), value]);
        self.held_out.iter().for_each(|file| option("--held-out", text(file)));
        self.setup.iter().for_each(|file| option("--setup", text(file)));
        self.maps.iter().for_each(|map| option("--map", map.to_string()));
        self.joint.iter().for_each(|name| option("--joint", name.clone()));
        self.rate.iter().for_each(|rate| option("--rate", rate.to_string()));
        self.gear_ratio.iter().for_each(|ratio| option("--gear-ratio", ratio.to_string()));
        self.max_memory.iter().for_each(|bytes| option("--max-memory", bytes.to_string()));
        self.payload_mass.iter().for_each(|mass| option("--payload-mass", mass.to_string()));
        self.bandwidth.iter().for_each(|hz| words.extend(["--bandwidth".into(), hz.to_string()]));
        if self.keep_zeros {
            words.push("--keep-zeros".into());
        }
        if self.no_gate {
            words.push("--no-gate".into());
        }
        words
    }
}

/// Why recordings cannot be used together.
#[derive(Debug, Error, Diagnostic)]
pub enum DataError {
    /// A file cannot be read.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Read(#[from] ReadError),
    /// Two recordings differ in what they are of.
    #[error(transparent)]
    Unlike(#[from] FitError),
}

/// Datasets for fitting and for validation, all of one configuration and with the same channels.
pub struct Data {
    /// Datasets for fitting.
    pub datasets: Vec<Dataset>,
    /// Datasets for validation.
    pub held_out: Vec<Dataset>,
    /// Zeros of recordings that were joined to that of the first.
    pub zeros: Vec<Joined>,
    /// Warnings about repaired or omitted data.
    pub warnings: Vec<String>,
}

/// Zero of a recording that was joined to that of the first.
#[derive(Clone, Debug)]
pub struct Joined {
    /// Name of the recording.
    pub recording: String,
    /// Name of the first recording.
    pub to: String,
    /// Unit of the positions.
    pub unit: Unit,
    /// What was added to its positions.
    pub zero: Zero,
}

impl std::fmt::Display for Joined {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let sentence = self.zero.sentence([&self.recording, &self.to], self.unit);
        write!(f, "{sentence}; --keep-zeros leaves them")
    }
}

impl Joined {
    /// The zero as a JSON object.
    pub fn json(&self) -> Value {
        json!({
            "recording": self.recording,
            "to": self.to,
            "offset": self.zero.offset,
            "std": self.zero.std,
            "unit": self.unit.to_string(),
            "orders": self.zero.orders,
            "others": self.zero.others,
        })
    }
}

impl Data {
    /// Checks that the machine of the recordings has the effects to be held.
    ///
    /// # Errors
    /// The first name that `model` lacks there, with those it has.
    pub fn check_held(&self, held: &[String], model: &Model) -> miette::Result<()> {
        let parameters = self.datasets[0].plant(model).parameters();
        let mut own: Vec<&str> = parameters.iter().map(|p| p.param.effect).collect();
        own.dedup();
        let Some(name) = held.iter().find(|name| !own.contains(&name.as_str())) else { return Ok(()) };
        let hint = nearest(name, own.iter().copied()).map_or(String::new(), |n| format!("; did you mean `{n}`?"));
        Err(miette!("--hold {name}: the model has no such effect; expected one of {}{hint}", own.join(", ")))
    }

    /// Kind of machine of all datasets.
    pub fn mechanism(&self) -> Mechanism {
        self.datasets.first().map_or_else(Mechanism::default, |dataset| dataset.mechanism)
    }

    /// Channels of all datasets.
    pub fn channels(&self) -> &[Channel] {
        self.datasets.first().map_or(&[], |t| &t.channels)
    }

    /// Reads all recordings of a machine like `model`, restricted to their common channels.
    ///
    /// # Errors
    /// If a file cannot be read or its dataset is unusable, or recordings are of different configurations.
    pub fn read(inputs: &Inputs, model: &Model) -> Result<Self, DataError> {
        Self::read_with(inputs, model, Method::Reversals)
    }

    /// Reads all recordings like [`Self::read`], with angles differentiated by `method`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_with(inputs: &Inputs, model: &Model, method: Method) -> Result<Self, DataError> {
        let how = inputs.reading(Some(model.mechanism));
        let mut data = Self::read_each(inputs, |file, warnings| dataset_of(file, &how, model, method, warnings))?;
        check_together(data.datasets.iter().chain(&data.held_out))?;
        data.narrow(inputs.bandwidth, model.mechanism);
        if !inputs.keep_zeros {
            data.join(model.mechanism);
        }
        Ok(data)
    }

    /// A result as JSON with the `zeros` that were joined.
    pub fn with_zeros(&self, mut result: Value) -> Value {
        result["zeros"] = self.zeros.iter().map(Joined::json).collect();
        result
    }

    /// Low-passes the accelerations of a lone axis at the cut-off `stated`, Hz, or else where their torques no longer follow
    /// them in the recordings to fit to.
    fn narrow(&mut self, stated: Option<f64>, mechanism: Mechanism) {
        let found = stated.is_none().then(|| bandwidth(mechanism, &self.datasets)).flatten();
        let cut_off = found.or(stated.filter(|f| f.is_finite() && matches!(mechanism, Mechanism::Axis(_))));
        let Some(cut_off) = cut_off else { return };
        narrow(&mut self.datasets, cut_off);
        narrow(&mut self.held_out, cut_off);
        if found.is_some() {
            let text = significant(cut_off, 2);
            self.warnings.push(format!(
                "accelerations are low-passed at {text} Hz: what is faster, noise or ringing, does not show in the torque; \
                 --bandwidth HZ states another cut-off, --bandwidth inf none"
            ));
        }
    }

    /// Joins the zeros of all recordings of a lone axis to that of the first.
    fn join(&mut self, mechanism: Mechanism) {
        let count = self.datasets.len();
        let mut all: Vec<Dataset> = self.datasets.drain(..).chain(self.held_out.drain(..)).collect();
        for zero in zeros(mechanism, &all) {
            let to = all[0].name.clone();
            let dataset = &mut all[zero.recording];
            dataset.shift(0, zero.offset);
            let unit = mechanism.unit(Unit::Rad);
            self.zeros.push(Joined { recording: dataset.name.clone(), to, unit, zero });
        }
        self.warnings.extend(self.zeros.iter().map(Joined::to_string));
        self.held_out = all.split_off(count);
        self.datasets = all;
    }

    /// Reads all recordings of any machine, restricted to their common channels.
    ///
    /// # Errors
    /// If a file cannot be read or its dataset is unusable.
    pub fn of_any_machine(inputs: &Inputs) -> Result<Self, ReadError> {
        let how = inputs.reading(None);
        Self::read_each(inputs, |file, warnings| {
            dataset(recording::read_as(file, &how)?, file, Method::Reversals, warnings)
        })
    }

    fn read_each(
        inputs: &Inputs,
        read: impl Fn(&Path, &mut Vec<String>) -> Result<Dataset, ReadError>,
    ) -> Result<Self, ReadError> {
        let mut warnings = Vec::new();
        let mut datasets = Vec::new();
        for file in inputs.data.iter().chain(&inputs.held_out) {
            let mut dataset = read(file, &mut warnings)?;
            if let Some(mass) = inputs.payload_mass {
                dataset.setup.payload.mass = mass;
            }
            datasets.push(dataset);
        }
        warnings.extend(keep_common_channels(&mut datasets));
        let held_out = datasets.split_off(inputs.data.len());
        Ok(Self { datasets, held_out, zeros: Vec::new(), warnings })
    }
}

fn dataset(
    (recording, noticed): (Recording, Vec<String>),
    file: &Path,
    method: Method,
    warnings: &mut Vec<String>,
) -> Result<Dataset, ReadError> {
    warnings.extend(noticed);
    let dataset = Dataset::with(&recording, method);
    if dataset.is_empty() {
        let samples = recording.signals.len();
        return Err(ReadError::Content {
            file: file.into(),
            problem: format!("has {samples} samples, of which differentiation leaves none"),
            expected: "a longer stretch without gaps".into(),
        });
    }
    warnings.extend(dataset.on_times(&recording));
    warnings.extend(dataset.on_coarse_angles());
    warnings.extend(meaningless(file, &recording, &dataset));
    Ok(dataset)
}

fn dataset_of(
    file: &Path,
    how: &Reading,
    model: &Model,
    method: Method,
    warnings: &mut Vec<String>,
) -> Result<Dataset, ReadError> {
    let mut dataset = dataset(recording::read_as(file, how)?, file, method, warnings)?;
    let drives = Channel::of_drives(model.mechanism);
    if !model.assembled && dataset.channels.len() > drives.len() {
        warnings.push(format!("{}: strut forces left out, the model has no struts", dataset.name));
        dataset.restrict(&drives);
    }
    Ok(dataset)
}

/// Drops the channels that not all datasets have; returns warnings about them.
fn keep_common_channels(datasets: &mut [Dataset]) -> Vec<String> {
    let Some(first) = datasets.first() else { return Vec::new() };
    let in_all = |c: &Channel| datasets.iter().all(|t| t.channels.contains(c));
    let common: Vec<Channel> = first.channels.iter().copied().filter(in_all).collect();
    let mut warnings = Vec::new();
    for dataset in datasets {
        let dropped: Vec<String> =
            dataset.channels.iter().filter(|c| !common.contains(c)).map(Channel::to_string).collect();
        if !dropped.is_empty() {
            let what = dropped.join(", ");
            warnings.push(format!("{}: {what} left out, other recordings do not have it", dataset.name));
        }
        dataset.restrict(&common);
    }
    warnings
}

/// Warnings about a recording alone after which a fit says little, see [`inspect`].
pub fn meaningless(path: &Path, recording: &Recording, dataset: &Dataset) -> Vec<String> {
    let tells = |f: &&Finding| {
        matches!(
            f.problem,
            Problem::Unrelated | Problem::WeightAlone | Problem::TorqueSign | Problem::Noiseless | Problem::Repeated
        )
    };
    inspect(recording, dataset).iter().filter(tells).map(|f| warning(path, f)).collect()
}

/// A finding about the file at `path`, with its remedy.
pub fn warning(path: &Path, finding: &Finding) -> String {
    format!("{}: {}; remedy: {}", path.display(), finding.sentence, finding.remedy)
}

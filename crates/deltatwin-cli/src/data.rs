//! Recordings used together: datasets of several files, restricted to their common channels.

use std::path::{Path, PathBuf};

use crate::kind;
use deltatwin::dynamics::{Channel, Plant};
use deltatwin::identification::Dataset;
use deltatwin::identification::derivatives::Method;
use deltatwin::machine::Mechanism;
use deltatwin::model::Model;
use deltatwin::recording::Recording;
use deltatwin::text::nearest;
use deltatwin_io::recording::{self, Mapping, ReadError, Reading};
use miette::miette;

/// What several commands take as data.
#[derive(clap::Args, Clone, Debug)]
pub struct DataArgs {
    /// Recordings (CSV or MCAP), used together.
    #[arg(required = true, value_name = "DATA")]
    pub data: Vec<PathBuf>,
    /// A recording to judge by that the fit does not see; may be given several times.
    #[arg(long, value_name = "DATA")]
    pub held_out: Vec<PathBuf>,
    /// Setup of all recordings, instead of their sidecars `<stem>.setup.toml`.
    #[arg(long, value_name = "FILE")]
    pub setup: Option<PathBuf>,
    #[command(flatten)]
    pub columns: ColumnArgs,
    /// Mass of the payload in kg, instead of what the setup states.
    #[arg(long, value_name = "KG", value_parser = mass)]
    pub payload_mass: Option<f64>,
    /// Go on even if signs, factors, order or zeros of the columns say that the recording does not fit the model.
    #[arg(long)]
    pub no_gate: bool,
}

/// How the columns of recordings from elsewhere are read.
#[derive(clap::Args, Clone, Debug, Default)]
pub struct ColumnArgs {
    /// Which column is which channel, such as "t=Time[ms], q1=ActPos[deg], tau1=Iq[A]*0.12"; may be given several times,
    /// each working on what the one before has read.
    #[arg(long, value_name = "MAP")]
    pub map: Vec<Mapping>,
    /// Read one joint of several as a lone axis: its name in a bag, or its number in the names of the columns.
    #[arg(long, value_name = "NAME")]
    pub joint: Option<String>,
    /// Samples per second, for a file without a column of time.
    #[arg(long, value_name = "HZ", value_parser = positive)]
    pub rate: Option<f64>,
    /// The recording is of the motor's side of a gear: motor turns per turn of the joint, or rad of the motor per metre.
    #[arg(long, value_name = "N", value_parser = positive)]
    pub gear_ratio: Option<f64>,
    /// Memory for reading and analysing a recording, such as 2G or 500M, instead of three quarters of what is free.
    #[arg(long, value_name = "BYTES", value_parser = bytes)]
    pub max_memory: Option<u64>,
}

impl ColumnArgs {
    /// Options for reading a recording of `machine` (inferred if `None`) with the file `setup` in place of its sidecar.
    pub fn reading<'a>(&'a self, setup: Option<&'a Path>, machine: Option<Mechanism>) -> Reading<'a> {
        Reading {
            setup,
            machine,
            maps: &self.map,
            joint: self.joint.as_deref(),
            rate: self.rate,
            gear_ratio: self.gear_ratio,
            max_memory: self.max_memory,
        }
    }
}

/// The number above zero that `text` states.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("expected a number above 0".into()),
    }
}

/// The number of bytes that `text` states, with K, M, G or T for powers of 1024.
fn bytes(text: &str) -> Result<u64, String> {
    let (digits, shift) = match text.chars().last().map(|c| c.to_ascii_uppercase()) {
        Some('K') => (&text[..text.len() - 1], 10),
        Some('M') => (&text[..text.len() - 1], 20),
        Some('G') => (&text[..text.len() - 1], 30),
        Some('T') => (&text[..text.len() - 1], 40),
        _ => (text, 0),
    };
    let count = digits.parse::<u64>().ok().filter(|count| *count > 0);
    count.and_then(|count| count.checked_mul(1 << shift)).ok_or("expected a size such as 2G, 500M or 1000000".into())
}

fn mass(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (0.0..=100.0).contains(&x) => Ok(x),
        _ => Err("expected a number from 0 to 100".into()),
    }
}

/// Datasets for fitting and for validation, all with the same channels.
pub struct Data {
    /// Datasets for fitting.
    pub datasets: Vec<Dataset>,
    /// Datasets for validation.
    pub held_out: Vec<Dataset>,
    /// Warnings about repaired or omitted data.
    pub warnings: Vec<String>,
}

impl Data {
    /// Checks that the machine of the recordings has the effects to be held.
    ///
    /// # Errors
    /// The first name that `model` lacks there, with those it has.
    pub fn check_held(&self, held: &[String], model: &Model) -> miette::Result<()> {
        let parameters = Plant::new(model, &self.datasets[0].setup).parameters();
        let mut own: Vec<&str> = parameters.iter().map(|p| p.param.effect).collect();
        own.dedup();
        let Some(name) = held.iter().find(|name| !own.contains(&name.as_str())) else { return Ok(()) };
        let hint = nearest(name, own.iter().copied()).map_or(String::new(), |n| format!("; did you mean `{n}`?"));
        Err(miette!("--hold {name}: the model has no such effect; expected one of {}{hint}", own.join(", ")))
    }

    /// Channels of all datasets.
    pub fn channels(&self) -> &[Channel] {
        self.datasets.first().map_or(&[], |t| &t.channels)
    }

    /// Reads all recordings of a machine like `model`, restricted to their common channels.
    ///
    /// # Errors
    /// If a file cannot be read or its dataset is unusable.
    pub fn read(args: &DataArgs, model: &Model) -> Result<Self, ReadError> {
        Self::read_with(args, model, Method::Reversals)
    }

    /// Reads all recordings like [`Self::read`], with angles differentiated by `method`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_with(args: &DataArgs, model: &Model, method: Method) -> Result<Self, ReadError> {
        let how = args.columns.reading(args.setup.as_deref(), Some(model.mechanism));
        Self::read_each(args, |file, warnings| dataset_of(file, &how, model, method, warnings))
    }

    /// Reads all recordings of any machine, restricted to their common channels.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn of_any_machine(args: &DataArgs) -> Result<Self, ReadError> {
        let how = args.columns.reading(args.setup.as_deref(), None);
        Self::read_each(args, |file, warnings| {
            dataset(recording::read_as(file, &how)?, file, Method::Reversals, warnings)
        })
    }

    fn read_each(
        args: &DataArgs,
        read: impl Fn(&Path, &mut Vec<String>) -> Result<Dataset, ReadError>,
    ) -> Result<Self, ReadError> {
        let mut warnings = Vec::new();
        let mut datasets = Vec::new();
        for file in args.data.iter().chain(&args.held_out) {
            let mut dataset = read(file, &mut warnings)?;
            if let Some(mass) = args.payload_mass {
                dataset.setup.payload.mass = mass;
            }
            datasets.push(dataset);
        }
        warnings.extend(keep_common_channels(&mut datasets));
        let held_out = datasets.split_off(args.data.len());
        Ok(Self { datasets, held_out, warnings })
    }

    /// Input files, which no output may overwrite.
    pub fn inputs(args: &DataArgs) -> Vec<&Path> {
        args.data.iter().chain(&args.held_out).chain(&args.setup).map(PathBuf::as_path).collect()
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
    warnings.extend(kind::meaningless(file, &recording, &dataset));
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

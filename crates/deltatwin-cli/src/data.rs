//! What several commands take as data.

use std::path::{Path, PathBuf};

pub use deltatwin_analysis::{Data, Inputs};

use deltatwin::machine::Mechanism;
use deltatwin_io::outside::Access;
use deltatwin_io::recording::{Mapping, Reading};

/// What the scenarios, studies and paths of a command may name.
#[derive(clap::Args, Clone, Copy, Debug)]
pub struct Outside {
    /// Read files that scenarios and studies name outside of their project too, the folder with their `models/`.
    #[arg(long)]
    pub allow_outside: bool,
}

impl Outside {
    /// Access to the files that are named, solids among them.
    pub fn access(self) -> Access {
        Access { meshes: deltatwin_cell::mesh::read, anywhere: self.allow_outside }
    }
}

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
    /// Cut-off of a lone axis' accelerations in Hz, `inf` for none, instead of the one found from the recordings.
    #[arg(long, value_name = "HZ", value_parser = above_zero)]
    pub bandwidth: Option<f64>,
    /// Leave the positions of a lone axis as recorded; without it, recordings whose encoder counts from elsewhere than in
    /// the first are joined to that by weight and cogging.
    #[arg(long)]
    pub keep_zeros: bool,
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

impl DataArgs {
    /// The files and how they are read.
    pub fn inputs(&self) -> Inputs {
        let ColumnArgs { map, joint, rate, gear_ratio, max_memory } = self.columns.clone();
        Inputs {
            data: self.data.clone(),
            held_out: self.held_out.clone(),
            setup: self.setup.clone(),
            maps: map,
            joint,
            rate,
            gear_ratio,
            max_memory,
            payload_mass: self.payload_mass,
            bandwidth: self.bandwidth,
            keep_zeros: self.keep_zeros,
            no_gate: self.no_gate,
        }
    }
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

/// The number above zero, infinity included, that `text` states.
fn above_zero(text: &str) -> Result<f64, String> {
    text.parse::<f64>().ok().filter(|x| *x > 0.0).ok_or("expected a number above 0, or inf".into())
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

/// The mass in kg that `text` states.
pub fn mass(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (0.0..=100.0).contains(&x) => Ok(x),
        _ => Err("expected a number from 0 to 100".into()),
    }
}

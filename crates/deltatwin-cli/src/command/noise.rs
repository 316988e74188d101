//! `deltatwin noise`: covariance of the torque noise, at rest ([Gnad 2024], section 6.2.1) and from differences.

use nalgebra::DMatrix;
use serde_json::{Value, json};

use crate::data::{Data, DataArgs};
use crate::terminal::{BAD_ANSWER, DONE, Table, say, warn};
use deltatwin::evidence::noise::{covariance, difference_covariance, rests};
use deltatwin::identification::Dataset;
use deltatwin::machine::{PerAxis, Unit, each, every_axis};
use deltatwin::recording::Channel;
use deltatwin::text::significant;

/// Covariance of the torque noise, from rests and from differences.
#[derive(clap::Args, Clone, Debug)]
#[command(after_help = "Example: deltatwin noise static-poses.mcap")]
pub struct Args {
    #[command(flatten)]
    data: DataArgs,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Widest range of an angle at rest, rad: about ten encoder steps.
const BAND: PerAxis<f64> = each(6e-5);
/// Shortest interval at rest, and time discarded at its ends, s.
const SHORTEST: f64 = 0.05;
const SETTLING: f64 = 0.01;
/// Order of the differences.
const ORDER: usize = 4;

/// Torque noise of several recordings.
pub struct TorqueNoise {
    /// Covariance at rest, in the squared unit of the channels (N·m)²; `None` if the robot is never at rest.
    pub at_rest: Option<DMatrix<f64>>,
    /// Number of intervals at rest.
    pub rests: usize,
    /// Time at rest, s.
    pub rest_time: f64,
    /// Covariance from differences, likewise.
    pub differences: Option<DMatrix<f64>>,
    /// Channels of the drives of the rows and columns of the matrices.
    pub drives: Vec<Channel>,
    /// Unit of a torque.
    pub unit: Unit,
}

impl TorqueNoise {
    /// Noise of all datasets together.
    pub fn of(datasets: &[Dataset]) -> Self {
        let is_drive = |c: &&Channel| c.drive().is_some();
        let drives: Vec<Channel> =
            datasets.first().map_or_else(Vec::new, |t| t.channels.iter().filter(is_drive).copied().collect());
        let mut torques = vec![Vec::new(); drives.len()];
        let (mut segments, mut still, mut rest_time) = (Vec::new(), Vec::new(), 0.0);
        for dataset in datasets {
            let first = torques[0].len();
            let shifted = |r: &std::ops::Range<usize>| first + r.start..first + r.end;
            let angles: Vec<Vec<f64>> = every_axis().map(|i| dataset.joints.iter().map(|j| j.q[i]).collect()).collect();
            let samples = |time: f64| (time / dataset.dt).ceil() as usize;
            for rest in rests(&angles, &dataset.segments, &BAND, samples(SHORTEST)) {
                let inner = rest.start + samples(SETTLING)..rest.end - samples(SETTLING);
                rest_time += inner.len() as f64 * dataset.dt;
                still.push(shifted(&inner));
            }
            segments.extend(dataset.segments.iter().map(shifted));
            for (all, measured) in torques.iter_mut().zip(&dataset.measured) {
                all.extend(measured);
            }
        }
        let machine = datasets.first().map(|dataset| dataset.mechanism).unwrap_or_default();
        Self {
            unit: machine.unit(Unit::NM),
            at_rest: covariance(&torques, &still),
            rests: still.len(),
            rest_time,
            differences: difference_covariance(&torques, &segments, ORDER),
            drives,
        }
    }
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let data = Data::of_any_machine(&args.data.inputs())?;
    warn(&data.warnings);
    let datasets: Vec<Dataset> = data.datasets.into_iter().chain(data.held_out).collect();
    let noise = TorqueNoise::of(&datasets);
    if args.json {
        say(noise.json())?;
    } else {
        noise.print()?;
    }
    Ok(if noise.differences.is_some() { DONE } else { BAD_ANSWER })
}

impl TorqueNoise {
    fn json(&self) -> Value {
        let matrix = |m: &Option<DMatrix<f64>>| {
            m.as_ref().map(|m| m.row_iter().map(|r| r.iter().copied().collect()).collect::<Vec<Vec<f64>>>())
        };
        json!({
            "covariance_at_rest": matrix(&self.at_rest),
            "covariance_from_differences": matrix(&self.differences),
            "rests": self.rests,
            "rest_time": self.rest_time,
        })
    }

    fn print(&self) -> miette::Result<()> {
        let sigma = |m: &Option<DMatrix<f64>>, i: usize| {
            m.as_ref().map_or("—".into(), |m| significant(m[(i, i)].max(0.0).sqrt(), 4))
        };
        let correlation = |m: &Option<DMatrix<f64>>, i: usize, j: usize| {
            let of = |m: &DMatrix<f64>| m[(i, j)] / (m[(i, i)] * m[(j, j)]).sqrt();
            m.as_ref().map(of).filter(|r| r.is_finite()).map_or("—".into(), |r| format!("{r:.3}"))
        };
        let mut table = Table::new(&["Torque noise", "at rest", "from differences", "unit"], &[3]);
        for (i, drive) in self.drives.iter().enumerate() {
            let name = format!("axis {} standard deviation", drive.limb() + 1);
            table.row([name, sigma(&self.at_rest, i), sigma(&self.differences, i), self.unit.to_string()]);
        }
        for i in 0..self.drives.len() {
            for j in i + 1..self.drives.len() {
                let of = |m| correlation(m, i, j);
                let name = format!("axes {} and {} correlation", self.drives[i].limb() + 1, self.drives[j].limb() + 1);
                table.row([name, of(&self.at_rest), of(&self.differences), "".into()]);
            }
        }
        say(table)?;
        match self.rests {
            0 => say("\n  The robot never rests for 0.05 s"),
            n => say(format!("\n  {n} rests, {:.2} s", self.rest_time)),
        }
    }
}

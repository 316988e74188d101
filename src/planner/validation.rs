//! Execution of the planned motion by the twin: planned and executed torques, strut forces, acceleration (Figs. 16,
//! 17 of the paper).

use crate::dynamics::Plant;
use crate::machine::{AXES, STRUTS};
use crate::model::Model;
use crate::recording::{Recording, Signals};
use crate::scenario::motion::table::Table;
use crate::scenario::{DesiredMotion, Sensors};
use crate::twin::{Clamps, Event, NewContacts, Options, SimulationError, simulate};

/// Executed motion and its deviations from the plan.
pub struct Execution {
    /// Signals of the execution, without noise.
    pub recording: Recording,
    /// RMS and largest deviation of each drive torque, N·m.
    pub torque: [[f64; 2]; AXES],
    /// RMS and largest deviation of the upper strut forces, N.
    pub strut: [[f64; 2]; STRUTS],
    /// RMS and largest deviation of the end effector's acceleration, m/s².
    pub acceleration: [f64; 2],
    /// Largest magnitude of an upper strut force, N.
    pub peak_strut: f64,
    /// Least margin of a socket against dislocation, N.
    pub margin: f64,
    /// Events of the simulation.
    pub events: Vec<Event>,
}

/// Simulated time after the planned end, s.
const SETTLING_TIME: f64 = 0.02;

/// Simulated execution of the `planned` table by `machine`, with the feed-forward of `planning` and feedback.
///
/// Sockets dislocate at the dislocation force of the machine; detached parts collide with the rest where `contacts`
/// are solved.
///
/// # Errors
///
/// The error of the simulation.
pub fn execute(
    machine: &Model,
    planning: &Plant,
    planned: &Recording,
    contacts: Option<NewContacts>,
) -> Result<Execution, SimulationError> {
    let table = Table {
        file: Default::default(),
        joints: true,
        t: planned.signals.t.clone(),
        rows: planned.signals.q.clone(),
        moving: false,
    };
    let motion = DesiredMotion::Joints { course: table.course(), geometry: planning.geometry };
    let all = [true; STRUTS];
    let end = planned.signals.t.last().copied().unwrap_or_default();
    let options = Options {
        duration: end + SETTLING_TIME,
        substeps: 2,
        noise_seed: None,
        sensors: Sensors { strut_upper: all, strut_lower: all, ..Sensors::default() },
        clamps: Some(Clamps { armed: true, ..Clamps::watched(&machine.sockets) }),
        contacts,
        ..Options::default()
    };
    let (recording, report) = simulate(machine, &planned.setup, planning, &|t| motion.at(t), &options, &mut |_| true)?;
    let (want, got) = (&planned.signals, &recording.signals);
    let n = want.len().min(got.len());
    let differ = |pairs: &mut dyn Iterator<Item = f64>| {
        let (mut square, mut most, mut count) = (0.0, 0.0f64, 0.0);
        for d in pairs {
            square += d * d;
            most = most.max(d.abs());
            count += 1.0;
        }
        [(square / f64::max(count, 1.0)).sqrt(), most]
    };
    let upper = |signals: &Signals, s: usize, k: usize| signals.strut_upper[s].as_ref().map_or(0.0, |f| f[k]);
    let torque = std::array::from_fn(|i| differ(&mut (0..n).map(|k| got.tau[k][i] - want.tau[k][i])));
    let strut = std::array::from_fn(|s| differ(&mut (0..n).map(|k| upper(got, s, k) - upper(want, s, k))));
    let (a, b) = (acceleration(want), acceleration(got));
    let acceleration =
        differ(&mut a.iter().zip(&b).map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()));
    let peak_strut = got.strut_upper.iter().flatten().flatten().fold(0.0f64, |m, f| m.max(f.abs()));
    let margin = report.min_margin.into_iter().fold(f64::INFINITY, f64::min);
    Ok(Execution { torque, strut, acceleration, peak_strut, margin, events: report.events, recording })
}

/// Acceleration of the platform by central differences of its position at all inner samples, m/s²; empty without a
/// position.
pub fn acceleration(signals: &Signals) -> Vec<[f64; 3]> {
    let step = signals.sample_time();
    let Some(ee) = &signals.ee else { return Vec::new() };
    ee.windows(3).map(|w| std::array::from_fn(|i| (w[2][i] - 2.0 * w[1][i] + w[0][i]) / (step * step))).collect()
}

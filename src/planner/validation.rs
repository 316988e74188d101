//! Execution of the planned motion by the twin: planned and executed torques, strut forces, acceleration (Figs. 16,
//! 17 of the paper).

use std::collections::BTreeMap;

use super::{Limit, Limits};
use crate::constraint_forces::{Detail, constraint_forces};
use crate::dynamics::Plant;
use crate::kinematics::JointState;
use crate::machine::{Mechanism, PerAxis, every_axis};
use crate::model::Model;
use crate::recording::{Channel, Recording, Signals};
use crate::scenario::motion::table::Table;
use crate::scenario::{DesiredMotion, Sensors};
use crate::twin::{Clamps, Event, EventKind, NewContacts, Options, SimulationError, simulate};

/// Executed motion and its deviations from the plan.
pub struct Execution {
    /// Signals of the execution, without noise.
    pub recording: Recording,
    /// RMS and largest deviation of each drive torque, N·m.
    pub torque: PerAxis<[f64; 2]>,
    /// RMS and largest deviation of the upper strut forces, N.
    pub strut: Vec<[f64; 2]>,
    /// RMS and largest deviation of the end effector's acceleration, m/s².
    pub acceleration: [f64; 2],
    /// Largest magnitude of an upper strut force, N.
    pub peak_strut: f64,
    /// Least margin of a socket against dislocation, N.
    pub margin: f64,
    /// Events of the simulation.
    pub events: Vec<Event>,
    /// Largest magnitude of each load up to the first dislocation, in the unit of [`Limit::unit`]: torques and strut
    /// forces as executed, loads on the end effector's bearing from the executed motion.
    pub peaks: BTreeMap<Limit, f64>,
}

/// A load above its limit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Violation {
    /// The limit.
    pub limit: Limit,
    /// Largest magnitude of the load, in the unit of [`Limit::unit`].
    pub value: f64,
    /// What is allowed, without the margin.
    pub allowed: f64,
    /// Machine, which determines the unit and the title of the limit.
    pub machine: Mechanism,
}

impl std::fmt::Display for Violation {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { limit, value, allowed, machine } = self;
        write!(f, "{} reaches {value:.1} of {allowed:.1} {}", limit.title(*machine), limit.unit(*machine))
    }
}

/// Relative excess over a limit that is rounding: a torque is clipped at its limit.
const ROUNDING: f64 = 1e-9;

impl Execution {
    /// Torques and constraint forces above their `limits`. The margin does not count: it is there for the difference of
    /// plan and execution.
    pub fn violations(&self, limits: &Limits) -> Vec<Violation> {
        let of = |(&limit, &value): (&Limit, &f64)| {
            let (allowed, machine) = (limits.value(limit), self.recording.signals.mechanism);
            (value > (1.0 + ROUNDING) * allowed).then_some(Violation { limit, value, allowed, machine })
        };
        self.peaks.iter().filter_map(of).collect()
    }

    /// Whether the machine executes the plan within `limits`, with every socket on its ball and without an event.
    pub fn is_within(&self, limits: &Limits) -> bool {
        self.margin > 0.0 && self.events.is_empty() && self.violations(limits).is_empty()
    }
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
        rows: planned.signals.q().iter().collect(),
        moving: false,
    };
    let motion = DesiredMotion::Joints { course: table.course(), geometry: Box::new(planning.geometry) };
    let struts = machine.mechanism.struts();
    let all = std::array::from_fn(|s| s < struts);
    let end = planned.signals.t.last().copied().unwrap_or_default();
    let options = Options {
        duration: end + SETTLING_TIME,
        substeps: 2,
        noise_seed: None,
        sensors: Sensors {
            strut_upper: all,
            strut_lower: all,
            velocity: true,
            acceleration: true,
            ..Sensors::default()
        },
        clamps: Some(Clamps { armed: planning.is_closed_delta(), ..Clamps::watched(&machine.sockets) }),
        contacts,
        ..Options::default()
    };
    let (recording, report) = simulate(machine, &planned.setup, planning, &|t| motion.at(t), &options, &mut |_| true)?;
    let (want, got) = (&planned.signals, &recording.signals);
    let differ = |pairs: &mut dyn Iterator<Item = f64>| {
        let (mut square, mut most, mut count) = (0.0, 0.0f64, 0.0);
        for d in pairs {
            square += d * d;
            most = most.max(d.abs());
            count += 1.0;
        }
        [(square / f64::max(count, 1.0)).sqrt(), most]
    };
    let apart = |channel: Channel| differ(&mut got[channel].iter().zip(&want[channel]).map(|(a, b)| a - b));
    let axes = machine.mechanism.axes();
    let torque = std::array::from_fn(|i| if i < axes { apart(Channel::Torque(i)) } else { [0.0; 2] });
    let strut = (0..struts).map(|s| apart(Channel::StrutUpper(s))).collect();
    let (a, b) = (acceleration(want), acceleration(got));
    let acceleration =
        differ(&mut a.iter().zip(&b).map(|(a, b)| (0..3).map(|i| (a[i] - b[i]).powi(2)).sum::<f64>().sqrt()));
    let peak_strut = (0..struts).flat_map(|s| &got[Channel::StrutUpper(s)]).fold(0.0f64, |m, f| m.max(f.abs()));
    let margin = report.min_margin.into_iter().fold(f64::INFINITY, f64::min);
    let peaks = peaks(machine, &recording, &report.events);
    Ok(Execution { torque, strut, acceleration, peak_strut, margin, events: report.events, peaks, recording })
}

/// Largest magnitude of each load of an execution up to the first dislocation.
fn peaks(machine: &Model, recording: &Recording, events: &[Event]) -> BTreeMap<Limit, f64> {
    let plant = Plant::new(machine, &recording.setup);
    let signals = &recording.signals;
    let end = events.iter().find(|e| e.kind == EventKind::Dislocation).map_or(f64::INFINITY, |e| e.t);
    let mut peaks = BTreeMap::new();
    for k in (0..signals.len()).take_while(|&k| signals.t[k] < end) {
        let mut add = |limit: Limit, value: f64| {
            let peak = peaks.entry(limit).or_insert(0.0);
            *peak = f64::max(*peak, value.abs());
        };
        every_axis().for_each(|i| add(Limit::Torque(i), signals.tau().at(k)[i]));
        for (channel, values) in signals.series() {
            match channel {
                Channel::StrutLower(s) => add(Limit::LambdaP(s), values[k]),
                Channel::StrutUpper(s) => add(Limit::LambdaS(s), values[k]),
                _ => {}
            }
        }
        if let Some(bearing) = bearing(&plant, signals, k) {
            bearing.into_iter().enumerate().for_each(|(i, load)| add(Limit::LambdaE(i), load));
        }
    }
    peaks
}

/// λ_E of the executed motion at sample `k`; `None` where the assembled machine cannot be, and without a bearing.
fn bearing(plant: &Plant, signals: &Signals, k: usize) -> Option<[f64; 5]> {
    let (qd, qdd) = (signals.rows(Channel::Rate), signals.rows(Channel::Acceleration));
    if qd.is_empty() || qdd.is_empty() || !plant.is_closed_delta() {
        return None;
    }
    let motion = plant.motion(&JointState { q: signals.q().at(k), qd: qd.at(k), qdd: qdd.at(k) }).ok()?;
    let own = plant.steady_states(signals.t[k], &motion);
    let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
    let forces = constraint_forces(plant, signals.t[k], &motion, &states, Detail::Complete).ok()?;
    Some(forces.lambda_e)
}

/// Acceleration of the platform by central differences of its position at all inner samples, m/s²; empty without a
/// position.
pub fn acceleration(signals: &Signals) -> Vec<[f64; 3]> {
    let step = signals.sample_time();
    let ee: Vec<[f64; 3]> = signals.rows(Channel::EndEffector).iter().collect();
    ee.windows(3).map(|w| std::array::from_fn(|i| (w[2][i] - 2.0 * w[1][i] + w[0][i]) / (step * step))).collect()
}

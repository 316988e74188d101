//! Closed-loop run of the twin: trajectory, controller, machine, sensors, sockets and contacts.

mod advance;
mod reported;
mod start;

use self::advance::Meeting;
use self::reported::Reported;
pub use self::reported::{Piece, Receiver};
use super::contacts::{ContactWork, Contacts, Held, Touch};
use super::controller::Controller;
use super::machine::{Checkpoint, Snapshot, Twin};
use super::sensors::{Reading, Sensors};
use super::sockets::Clamps;
use super::torque::Torque;
use super::trace::{Sample, TripCause};
use super::wrench::Twist;
use super::{
    Cause, Event, EventKind, Frame, LARGEST_ENERGY_ERROR, Options, Pose, Report, SimulationError, SingularPose,
    constraints, energy,
};
use crate::dynamics::Plant;
use crate::kinematics::{JointState, Motion, Target};
use crate::machine::bodies::{END_EFFECTOR, PLATFORM, SLOTS};
use crate::machine::{
    Configuration, Inertia, Mechanism, PerAxis, PerSocket, Setup, Unit, each, every_axis, six_struts,
};
use crate::model::Model;
use crate::numerics::worst;
use crate::recording::{Recording, Signals};
use crate::scenario::{ActionKind, HoldTorque, Trip};

/// Kinetic energy below which everything counts as at rest, J, and the time for which it must stay below, s:
/// regularised friction creeps.
const REST_ENERGY: f64 = 1e-3;
const REST_TIME: f64 = 0.1;
/// Lower bound of the work to which the energy error is related, J.
const LEAST_WORK: f64 = 1e-3;
/// Tolerance of time comparisons, s.
const INSTANT: f64 = 1e-12;

/// Recording and report of a run of `model` under `setup` along `desired`, with the feed-forward of `controller_plant`.
///
/// With [`HoldTorque::Ramp`] the drive torques are linear over each period, so that a recorded torque is the one that
/// acts at its time stamp. `desired` is the desired motion of platform or joints; a machine without platform requires
/// joints. `progress` is called with the simulated time (s) once per sample; returning false ends the run.
///
/// # Errors
/// Those of [`simulate_until_failure`], and the failure that ends a run early.
pub fn simulate<T: Into<Target>>(
    model: &Model,
    setup: &Setup,
    controller_plant: &Plant,
    desired: &dyn Fn(f64) -> T,
    options: &Options,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<(Recording, Report), SimulationError> {
    let (recording, report, failure) =
        simulate_until_failure(model, setup, controller_plant, desired, options, progress)?;
    failure.map_or(Ok((recording, report)), Err)
}

/// Recording and report as from [`simulate`], with the failure if one ended the run early; they extend to that instant.
///
/// # Errors
/// A [`SimulationError`] if the run cannot start: the desired motion, the loops at the start, the inertia of a body,
/// the objects, or parts that the machine does not have.
pub fn simulate_until_failure<T: Into<Target>>(
    model: &Model,
    setup: &Setup,
    controller_plant: &Plant,
    desired: &dyn Fn(f64) -> T,
    options: &Options,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<(Recording, Report, Option<SimulationError>), SimulationError> {
    let mut whole = Whole { signals: Signals::default(), frames: Vec::new(), progress };
    let (mut report, failure) = simulate_into(model, setup, controller_plant, desired, options, &mut whole)?;
    report.frames = whole.frames;
    let recording = Recording { name: model.name.clone(), signals: whole.signals, setup: setup_of_run(model, setup) };
    Ok((recording, report, failure))
}

/// Report of a run whose samples and frames go to `receiver` while it lasts, with the failure if one ended the run
/// early. Memory does not grow with the duration, except by events, and by the trace if one is kept.
///
/// # Errors
/// Those of [`simulate_until_failure`].
pub fn simulate_into<T: Into<Target>>(
    model: &Model,
    setup: &Setup,
    controller_plant: &Plant,
    desired: &dyn Fn(f64) -> T,
    options: &Options,
    receiver: &mut dyn Receiver,
) -> Result<(Report, Option<SimulationError>), SimulationError> {
    let desired = |t: f64| desired(t).into();
    let mut run = Run::new(model, setup, controller_plant, &desired, options)?;
    let period = model.sample_time;
    let samples = (options.duration / period).round() as usize;
    let mut failure = None;
    for k in 0..samples {
        match run.sample(k) {
            Ok(true) => {}
            Ok(false) => break,
            Err(error) => {
                failure = Some(error);
                break;
            }
        }
        run.report.simulated = (k + 1) as f64 * period;
        if !run.pass_on(receiver, false) || !receiver.progress(run.report.simulated) {
            break;
        }
    }
    run.pass_on(receiver, true);
    Ok((run.finish(), failure))
}

/// The setup that a recording of a run of `model` under `setup` states.
pub fn setup_of_run(model: &Model, setup: &Setup) -> Setup {
    let assembled = Plant::new(model, setup).assembled;
    let configuration = match model.mechanism {
        Mechanism::Delta { .. } if !assembled => Configuration::Disassembled,
        _ => setup.configuration,
    };
    Setup { configuration, ..*setup }
}

/// Receiver that keeps a run as a whole.
struct Whole<'a> {
    signals: Signals,
    frames: Vec<Frame>,
    progress: &'a mut dyn FnMut(f64) -> bool,
}

impl Receiver for Whole<'_> {
    fn progress(&mut self, t: f64) -> bool {
        (self.progress)(t)
    }

    fn piece(&mut self, piece: Piece) -> bool {
        self.signals.extend(piece.signals);
        self.frames.extend(piece.frames);
        true
    }
}

/// A run in progress.
struct Run<'a> {
    options: &'a Options,
    desired: &'a dyn Fn(f64) -> Target,
    period: f64,
    twin: Twin,
    controller: Controller<'a>,
    sensors: Sensors<'a>,
    clamps: Clamps,
    contacts: Option<Box<dyn Contacts>>,
    held: Option<Inertia>,
    next_action: usize,
    /// Torque of the present control period.
    torque: Torque,
    /// Desired joint state at the present control instant.
    wanted: JointState,
    tripped: bool,
    checkpoint: Checkpoint,
    /// Contact wrenches at the present time.
    contact: [Twist; SLOTS],
    /// Contacts since the last frame, of every pair the strongest; without frames none.
    strongest: Vec<Touch>,
    /// Contacts and stops so far, with the time of the last one, s.
    touching: Vec<(Meeting, f64)>,
    rest_since: Option<f64>,
    rested: bool,
    /// Solution at the present time if it is known already.
    known: Option<Snapshot>,
    /// Length of the next step of a broken robot, s.
    pace: f64,
    /// Factor of all adapted steps by which the stated ones are shorter than usual.
    fineness: f64,
    /// Shortest step of a broken robot at present, s, if its contacts are evaluated at every stage.
    finest: Option<f64>,
    work: Vec<f64>,
    turned_over: f64,
    /// Number of frames so far; the number of events passed to the watcher follows.
    frames: usize,
    watched: usize,
    /// Frames and ideal signals that have not been passed on.
    kept: Vec<Frame>,
    signals: Signals,
    reported: Reported,
    report: Report,
}

impl<'a> Run<'a> {
    fn event(&mut self, t: f64, kind: EventKind, what: impl Into<String>) {
        self.report.events.push(Event { t, kind, what: what.into() });
    }

    /// One sample time: record, control, advance. False if the run has ended.
    fn sample(&mut self, k: usize) -> Result<bool, SimulationError> {
        let t = k as f64 * self.period;
        self.twin.set_time(t);
        self.act(t)?;
        let snapshot = match self.known.take() {
            Some(known) => known,
            None => match self.twin.evaluate(&self.torque) {
                Ok(snapshot) => snapshot,
                Err(SingularPose) => return self.stuck(t),
            },
        };
        let balance = self.twin.energy_balance_at(&snapshot.motion);
        if !balance.is_finite() {
            return self.stuck(t);
        }
        self.report.energy_error = self.report.energy_error.max(balance.abs());
        let margins = self.clamps.margins(&snapshot.motion, &snapshot.sockets, self.twin.closed());
        self.watch(&snapshot, &margins);
        self.keep_frame(t, &snapshot, &margins);
        self.trace(t, &snapshot, &margins);
        let tau = self.torque.at(t);
        let encoders = self.sensors.angles(&self.twin.encoders());
        let multipliers = if self.options.sensors.multipliers {
            let Ok(multipliers) = self.twin.multipliers(&snapshot) else { return self.stuck(t) };
            Some(multipliers)
        } else {
            None
        };
        let load = self.twin.plant().known_load(t).unwrap_or(0.0);
        let reading = Reading { q: encoders, tau, snapshot: &snapshot, margins: &margins, load, multipliers };
        self.sensors.record(&mut self.signals, t, &reading);
        if k.is_multiple_of(self.options.control_period) {
            self.control(t, &encoders, &tau)?;
        }
        let end = (k + 1) as f64 * self.period;
        if self.rested && self.next_action == self.options.actions.len() {
            self.stay(end, snapshot);
        } else if self.advance(end).is_err() {
            return self.stuck(t);
        }
        self.work.resize(self.twin.work().len(), 0.0);
        for (before, after) in self.work.iter_mut().zip(self.twin.work()) {
            self.turned_over += (after - *before).abs();
            *before = *after;
        }
        if self.tripped && !self.rested {
            self.look_for_rest();
        }
        Ok(!self.is_over())
    }

    /// Whether the load of a broken robot has landed long enough ago.
    fn is_over(&self) -> bool {
        let Some(after) = self.options.after_landing.filter(|_| self.tripped) else { return false };
        let landing = self.report.landing(self.options.objects.len());
        landing.is_some_and(|impact| self.twin.time() > impact.t + after)
    }

    /// An intact robot must not become singular; a broken one may end its run in a singular pose.
    fn stuck(&mut self, t: f64) -> Result<bool, SimulationError> {
        let failure = self.failure(t);
        if self.twin.is_whole() || !matches!(failure, SimulationError::Singular { cause: Cause::Rank, .. }) {
            return Err(failure);
        }
        self.event(t, EventKind::Singular, "the broken mechanism reached a pose without a unique motion");
        Ok(false)
    }

    /// Why the twin cannot be advanced: a law with a value that is not finite, a diverged solution, or a singular pose.
    fn failure(&self, t: f64) -> SimulationError {
        if let Some(source) = self.twin.fault() {
            return SimulationError::Law { source };
        }
        let motion = self.twin.motion();
        let gap = self.twin.energy_balance_at(&motion).abs();
        let closes = gap <= LARGEST_ENERGY_ERROR * self.turned_over.max(LEAST_WORK);
        let cause = if closes { Cause::Rank } else { Cause::Diverged };
        SimulationError::Singular { t, pose: pose(&motion, self.twin.plant().assembled), cause }
    }

    fn watch(&mut self, snapshot: &Snapshot, margins: &PerSocket<f64>) {
        let closed = self.twin.closed();
        let plant = self.twin.plant();
        // The length of an elastic strut is not a constraint.
        let rigid = plant.effects.iter().all(|a| a.strut_spring().is_none());
        let report = &mut self.report;
        let joints = plant.is_closed_delta().then(|| constraints::rows(&plant.geometry, &snapshot.motion));
        for (row, (gap, rate)) in joints.into_iter().flatten().enumerate() {
            let holds =
                constraints::socket(row).is_none_or(|s| closed.contains(s) && (rigid || six_struts().contains(&s)));
            if holds {
                report.max_loop_gap = report.max_loop_gap.max(gap.abs());
                report.max_loop_rate = report.max_loop_rate.max(rate.abs());
            }
        }
        if !self.tripped {
            for i in every_axis() {
                let error = (snapshot.motion.q[i] - self.wanted.q[i]).abs();
                report.tracking_error[i] = report.tracking_error[i].max(error);
            }
        }
        report.see_strut_forces(&snapshot.reactions);
        for s in closed.iter() {
            report.min_margin[s] = report.min_margin[s].min(margins[s]);
        }
    }

    /// Computes the torque of the next control period.
    fn control(&mut self, t: f64, encoders: &PerAxis<f64>, tau: &PerAxis<f64>) -> Result<(), SimulationError> {
        if self.tripped {
            return Ok(());
        }
        if !self.twin.is_whole() {
            self.trip(t, TripCause::Socket, "a socket has left its ball");
            return Ok(());
        }
        let span = self.period * self.options.control_period as f64;
        let trajectory = |reason| SimulationError::Trajectory { t, reason };
        let next = (self.desired)(t + span).joints(&self.twin.plant().geometry).map_err(trajectory)?;
        let command = self.controller.update(&self.wanted, encoders, &next).map_err(trajectory)?;
        if let Some(sample) = self.report.trace.last_mut() {
            sample.feedback = command.feedback;
            sample.error = std::array::from_fn(|i| self.wanted.q[i] - encoders[i]);
        }
        let limits = &self.options.supervision;
        let machine = self.twin.plant().mechanism;
        let (torque, angle) = (machine.unit(Unit::NM), machine.unit(Unit::Rad));
        for i in 0..machine.arms() {
            let (feedback, error) = (command.feedback[i].abs(), (self.wanted.q[i] - encoders[i]).abs());
            if let Some(limit) = limits.torque.filter(|limit| feedback > *limit) {
                self.trip(
                    t,
                    TripCause::Torque(i),
                    format!("feedback torque {feedback:.1} {torque} on axis {} exceeds {limit} {torque}", i + 1),
                );
                return Ok(());
            }
            if let Some(limit) = limits.tracking.filter(|limit| error > *limit) {
                self.trip(
                    t,
                    TripCause::Tracking(i),
                    format!("tracking error {error:.4} {angle} on axis {} exceeds {limit} {angle}", i + 1),
                );
                return Ok(());
            }
        }
        self.torque = match self.options.hold_torque {
            HoldTorque::Ramp => Torque::ramp(t, *tau, command.torque, span),
            HoldTorque::Hold => Torque::constant(command.torque),
        };
        self.wanted = next;
        Ok(())
    }

    fn trip(&mut self, t: f64, cause: TripCause, why: impl Into<String>) {
        self.report.trip = Some((t, cause));
        self.tripped = true;
        self.torque = Torque::default();
        if let Trip::Brake { torque } = self.options.supervision.trip {
            self.twin.set_brake(torque);
        }
        self.event(t, EventKind::Trip, why);
    }

    /// Performs the actions of the gripper up to time `t`.
    fn act(&mut self, t: f64) -> Result<(), SimulationError> {
        while let Some(action) = self.options.actions.get(self.next_action).filter(|a| a.t <= t + INSTANT) {
            self.next_action += 1;
            self.known = None;
            let Some(contacts) = &mut self.contacts else { continue };
            let failed = |reason| SimulationError::Cell { t, reason };
            let motion = self.twin.motion();
            let singular = SimulationError::Singular { t, pose: pose(&motion, true), cause: Cause::Rank };
            match action.kind {
                ActionKind::Pick(object) => {
                    let name = self.options.objects[object].name.clone();
                    let Held { inertia, position, twist } = contacts.pick(&name, &motion).map_err(failed)?;
                    // Its material point at the end effector's origin.
                    let lever = motion.bodies[END_EFFECTOR].position - position;
                    let velocity = twist.0 + twist.1.cross(&lever);
                    self.twin.attach(&inertia, &(velocity, twist.1)).map_err(|_| singular)?;
                    self.held = Some(inertia);
                    self.event(t, EventKind::Pick, name);
                }
                ActionKind::Release => {
                    let name = contacts.release(&motion).map_err(failed)?;
                    if let Some(inertia) = self.held.take() {
                        self.twin.detach(&inertia).map_err(|_| singular)?;
                    }
                    self.event(t, EventKind::Release, name);
                }
            }
        }
        Ok(())
    }

    /// Time between frames, s; `None` if nothing asks for any.
    fn spacing(&self) -> Option<f64> {
        self.options.frames.or(self.options.watcher.as_ref().map(|watcher| watcher.spacing))
    }

    fn keep_frame(&mut self, t: f64, snapshot: &Snapshot, margins: &PerSocket<f64>) {
        let watcher = self.options.watcher.as_ref();
        let Some(spacing) = self.spacing() else { return };
        if t + INSTANT < self.frames as f64 * spacing {
            return;
        }
        self.frames += 1;
        let motion = &snapshot.motion;
        let objects = self.contacts.as_ref().map_or_else(Vec::new, |c| c.poses(motion));
        // A robot that has come to rest makes no steps.
        let present = self.contacts.as_ref().map_or(&[][..], |c| c.touches());
        present.iter().for_each(|touch| touch.keep_in(&mut self.strongest));
        let frame = Frame {
            t,
            q: motion.q,
            tau: self.torque.at(t),
            bodies: motion.shown(self.twin.plant().mechanism),
            objects,
            closed: self.twin.closed(),
            strut_force: [snapshot.reactions.upper, snapshot.reactions.lower],
            socket_margin: *margins,
            contacts: std::mem::take(&mut self.strongest),
        };
        if let Some(watcher) = watcher {
            watcher.see(Some(&frame), &self.report.events[self.watched..]);
            self.watched = self.report.events.len();
        }
        if self.options.frames.is_some() {
            self.kept.push(frame);
        }
    }

    /// Keeps the loads of a sample until the drives trip.
    fn trace(&mut self, t: f64, snapshot: &Snapshot, margins: &PerSocket<f64>) {
        if !self.options.trace || self.tripped {
            return;
        }
        let motion = &snapshot.motion;
        let last = self.report.trace.last();
        let [feedback, error] = last.map_or([each(0.0); 2], |last| [last.feedback, last.error]);
        self.report.trace.push(Sample {
            t,
            q: motion.q,
            rate: motion.qd,
            torque: self.torque.at(t),
            feedback,
            error,
            telescope: motion.telescope.length,
            platform: motion.bodies[PLATFORM].position.into(),
            strut_force: [snapshot.reactions.upper, snapshot.reactions.lower],
            margin: *margins,
        });
    }

    fn kinetic_energy(&self) -> f64 {
        let objects = self.contacts.as_ref().map_or(0.0, |c| c.kinetic_energy());
        energy::kinetic(self.twin.plant(), &self.twin.motion()) + objects
    }

    fn look_for_rest(&mut self) {
        let t = self.twin.time();
        if self.kinetic_energy() > REST_ENERGY {
            self.rest_since = None;
        } else if t - *self.rest_since.get_or_insert(t) > REST_TIME {
            self.rested = true;
            let since = self.rest_since.unwrap_or(t);
            self.event(since, EventKind::Rest, "everything is at rest");
            self.halt();
        }
    }

    fn finish(mut self) -> Report {
        if let Some(watcher) = &self.options.watcher {
            watcher.see(None, &self.report.events[self.watched..]);
        }
        self.report.kinetic_energy = self.kinetic_energy();
        self.report.energy_error = worst(self.report.energy_error, self.twin.energy_balance());
        self.report.energy_error /= self.turned_over.max(LEAST_WORK);
        self.report.closed = self.twin.closed();
        self.report.unconverged = self.twin.unconverged();
        self.report.solutions = self.twin.solutions();
        self.report.corrections = self.twin.corrections();
        self.report.contacts = self.contacts.as_ref().map_or_else(ContactWork::default, |c| c.work());
        self.report
    }
}

/// Joint angles and platform position of a motion.
fn pose(motion: &Motion, assembled: bool) -> Pose {
    Pose { q: motion.q, platform: assembled.then(|| motion.bodies[PLATFORM].position.into()) }
}

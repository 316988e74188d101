//! A closed-loop run of the twin: trajectory, controller, machine, sensors, sockets and what the robot touches.

use nalgebra::{Rotation3, Vector3};

use super::contacts::{ContactBody, ContactWork, Contacts, Held, Surroundings};
use super::controller::Controller;
use super::machine::{Checkpoint, Snapshot, Twin};
use super::sensors::Sensors;
use super::sockets::{Clamps, socket_name};
use super::torque::Torque;
use super::wrench::{Load, STILL, Twist};
use super::{
    Cause, Event, EventKind, Frame, LARGEST_ENERGY_ERROR, Options, Pose, Report, SimulationError, SingularPose,
    constraints, energy, stops,
};
use crate::cell::CellError;
use crate::dynamics::{Plant, inverse_dynamics};
use crate::kinematics::motion::SOCKETS;
use crate::kinematics::{JointState, KinematicsError, Motion, SocketSet, Target};
use crate::machine::bodies::{BODIES, END_EFFECTOR, PLATFORM, body_name};
use crate::machine::{ARMS, AXES, Configuration, Inertia, Mechanism, STRUTS, Setup, Unit};
use crate::model::Model;
use crate::recording::{Recording, Signals};
use crate::scenario::{ActionKind, HoldTorque, Trip};

/// Time within which a dislocation is located, s.
const EVENT_TIME: f64 = 1e-7;
/// Kinetic energy below which everything rests, J, and for how long, s: what leans on regularised friction creeps.
const REST_ENERGY: f64 = 1e-3;
const REST_TIME: f64 = 0.1;
/// Work to which the energy error is related at least, J.
const LEAST_WORK: f64 = 1e-3;
/// A pair that has not touched for this long touches anew, s.
const CONTACT_PAUSE: f64 = 0.05;
/// Negative eigenvalue of a pseudo-inertia, relative to the body's size, that is not rounding.
const IMPOSSIBLE: f64 = 1e-9;
/// Slack of time comparisons, s.
const INSTANT: f64 = 1e-12;

/// Recording and report of a run of `model` under `setup` along `desired`, controlled by `controller_plant`'s feed-forward.
///
/// With [`HoldTorque::Ramp`] the drives ramp the torque linearly over each period, so a recorded torque is the one that
/// acts at its time stamp. `desired` says where platform or joints are to be; those of a machine without platform must be
/// joints. `progress` is called with the simulated time once per sample; returning false ends the run
/// there.
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

/// The same, with what was recorded until the run failed, if it did: a failure under way is handed back beside the
/// recording.
///
/// # Errors
/// If the run cannot begin.
pub fn simulate_until_failure<T: Into<Target>>(
    model: &Model,
    setup: &Setup,
    controller_plant: &Plant,
    desired: &dyn Fn(f64) -> T,
    options: &Options,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<(Recording, Report, Option<SimulationError>), SimulationError> {
    let desired = |t: f64| desired(t).into();
    let mut run = Run::new(model, setup, controller_plant, &desired, options)?;
    let period = model.sample_time;
    let samples = (options.duration / period).round() as usize;
    run.sensors.reserve(&mut run.signals, samples);
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
        if !progress(run.report.simulated) {
            break;
        }
    }
    let (recording, report) = run.finish(model, setup);
    Ok((recording, report, failure))
}

/// Refuses what only a platform or its struts can do.
fn possible_without_platform(options: &Options) -> Result<(), SimulationError> {
    let fitted = &options.sensors;
    for (what, asked) in [
        ("objects and what a gripper does", !options.objects.is_empty() || !options.actions.is_empty()),
        ("sockets that may leave their balls", options.clamps.is_some_and(|c| c.armed)),
        ("margins of sockets", fitted.sockets),
        ("strut force sensors", fitted.strut_upper.iter().chain(&fitted.strut_lower).any(|s| *s)),
    ] {
        if asked {
            return Err(SimulationError::Missing { what });
        }
    }
    Ok(())
}

/// A run under way.
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
    contact: [Twist; BODIES],
    /// What has met so far, and when last, s.
    touching: Vec<(Meeting, f64)>,
    rest_since: Option<f64>,
    rested: bool,
    work: Vec<f64>,
    turned_over: f64,
    /// Frames so far, and events that the watcher has seen.
    frames: usize,
    watched: usize,
    signals: Signals,
    report: Report,
}

/// What can meet again and again, of which only the beginnings are events.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Meeting {
    /// Two bodies that touch.
    Contact(ContactBody, ContactBody),
    /// A freedom and its stop, the upper one or not.
    Stop(usize, bool),
}

/// Whether `meeting`, which is on at time `t`, was not on all along; notes it in `known`.
fn begins(known: &mut Vec<(Meeting, f64)>, meeting: Meeting, t: f64) -> bool {
    match known.iter_mut().find(|(met, _)| *met == meeting) {
        Some((_, last)) => t - std::mem::replace(last, t) >= CONTACT_PAUSE,
        None => {
            known.push((meeting, t));
            true
        }
    }
}

/// What solves the contacts of a run; none where nothing can touch.
fn contacts(options: &Options, plant: &Plant, start: &Motion) -> Result<Option<Box<dyn Contacts>>, CellError> {
    if options.objects.is_empty() && !options.clamps.is_some_and(|c| c.armed) {
        return Ok(None);
    }
    let Some(new) = options.contacts else {
        return if options.objects.is_empty() { Ok(None) } else { Err(CellError::NoContacts) };
    };
    let surroundings = Surroundings {
        objects: &options.objects,
        payload: options.payload_shape.as_ref(),
        geometry: &plant.geometry,
        gravity: plant.gravity_vector(),
        start,
    };
    new(&surroundings).map(Some)
}

/// Joints in balance while the encoders read `wanted`, and the deflection of elastic gears there, rad: compliance times
/// transmitted torque.
fn balance(plant: &Plant, wanted: &JointState) -> Result<(JointState, [f64; AXES]), KinematicsError> {
    let mut own: Vec<Vec<f64>> = plant.effects.iter().map(|a| a.initial_state()).collect();
    let mut deflection = [0.0; AXES];
    for (k, active) in plant.effects.iter().enumerate() {
        let Some(gears) = active.gear_springs() else { continue };
        let states: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
        let torque = inverse_dynamics(plant, 0.0, &plant.motion(wanted)?, &states, false)?.tau;
        for (i, gear) in gears.iter().enumerate().filter(|(_, g)| g.is_elastic()) {
            deflection[i] = gear.compliance * (torque[i] - gear.rotor_inertia * wanted.qdd[i]);
        }
        own[k][..ARMS].copy_from_slice(&deflection[..ARMS]);
    }
    let mut joints = *wanted;
    let mut lead = [0.0; AXES];
    for (active, state) in plant.effects.iter().zip(&own) {
        active.encoder(state, &mut lead);
    }
    for (q, lead) in joints.q.iter_mut().zip(lead) {
        *q -= lead;
    }
    Ok((joints, deflection))
}

impl<'a> Run<'a> {
    fn new(
        model: &'a Model,
        setup: &Setup,
        controller_plant: &'a Plant,
        desired: &'a dyn Fn(f64) -> Target,
        options: &'a Options,
    ) -> Result<Self, SimulationError> {
        let plant = Plant::new(model, setup);
        let trajectory = |reason| SimulationError::Trajectory { t: 0.0, reason };
        if !plant.assembled {
            possible_without_platform(options)?;
        }
        let wanted = desired(0.0).joints(&plant.geometry).map_err(trajectory)?;
        let (joints, deflection) = balance(&plant, &wanted).map_err(trajectory)?;
        let motion = plant.motion(&joints).map_err(trajectory)?;
        for (body, inertia) in plant.bodies.0.iter().enumerate() {
            let size = inertia.mass.max(inertia.tensor.trace());
            if inertia.min_eigenvalue() < -IMPOSSIBLE * size.max(1e-3) {
                return Err(SimulationError::Body { body: body_name(body) });
            }
        }
        let contacts = contacts(options, &plant, &motion).map_err(|reason| SimulationError::Cell { t: 0.0, reason })?;
        let assembled = plant.assembled;
        let mut twin =
            Twin::formulated(plant, &motion, options.formulation).map_err(|_| singular_start(&motion, assembled))?;
        twin.deflect_gears(&deflection);
        let step = model.sample_time * options.control_period as f64;
        let controller = Controller::new(controller_plant, model.drives, options.gains, step);
        let torque = Torque::constant(controller.feed_forward(&wanted).map_err(trajectory)?);
        let clamps = match options.clamps {
            _ if !assembled => Clamps::none(),
            Some(clamps) => clamps,
            None => Clamps::watched(&model.sockets),
        };
        Ok(Self {
            options,
            desired,
            period: model.sample_time,
            twin,
            controller,
            sensors: Sensors::new(model, setup, options.sensors, assembled, options.noise_seed),
            clamps,
            contacts,
            held: None,
            next_action: 0,
            torque,
            wanted,
            tripped: false,
            checkpoint: Checkpoint::default(),
            contact: [STILL; BODIES],
            touching: Vec::new(),
            rest_since: None,
            rested: false,
            work: Vec::new(),
            turned_over: 0.0,
            frames: 0,
            watched: 0,
            signals: Signals { mechanism: model.mechanism, ..Signals::default() },
            report: Report {
                simulated: 0.0,
                steps: 0,
                solutions: 0,
                corrections: 0,
                contacts: ContactWork::default(),
                max_loop_gap: 0.0,
                max_loop_rate: 0.0,
                energy_error: 0.0,
                peak_strut_force: 0.0,
                min_margin: clamps.hold,
                tracking_error: [0.0; AXES],
                events: Vec::new(),
                frames: Vec::new(),
                closed: SocketSet::ALL,
                kinetic_energy: 0.0,
                unconverged: 0.0,
            },
        })
    }

    fn event(&mut self, t: f64, kind: EventKind, what: impl Into<String>) {
        self.report.events.push(Event { t, kind, what: what.into() });
    }

    /// One sample time: record, control, move on. False if the run cannot go on.
    fn sample(&mut self, k: usize) -> Result<bool, SimulationError> {
        let t = k as f64 * self.period;
        self.twin.set_time(t);
        self.act(t)?;
        let Ok(snapshot) = self.twin.evaluate(&self.torque) else { return self.stuck(t) };
        let balance = self.twin.energy_balance_at(&snapshot.motion);
        if !balance.is_finite() {
            return self.stuck(t);
        }
        self.report.energy_error = self.report.energy_error.max(balance.abs());
        let margins = self.clamps.margins(&snapshot.motion, &snapshot.sockets, self.twin.closed());
        self.watch(&snapshot, &margins);
        self.keep_frame(t, &snapshot, &margins);
        let tau = self.torque.at(t);
        let encoders = self.sensors.angles(&self.twin.encoders());
        let multipliers = if self.options.sensors.multipliers {
            let Ok(multipliers) = self.twin.multipliers(&snapshot) else { return self.stuck(t) };
            Some(multipliers)
        } else {
            None
        };
        self.sensors.record(&mut self.signals, (t, &encoders, &tau), &snapshot, &margins, multipliers);
        if k.is_multiple_of(self.options.control_period) {
            self.control(t, &encoders, &tau)?;
        }
        if self.advance(t + self.period).is_err() {
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
        Ok(true)
    }

    /// An intact robot must not get stuck; a broken one may lie where the equations end.
    fn stuck(&mut self, t: f64) -> Result<bool, SimulationError> {
        let failure = self.failure(t);
        if self.twin.closed() == SocketSet::ALL
            || !matches!(failure, SimulationError::Singular { cause: Cause::Rank, .. })
        {
            return Err(failure);
        }
        self.event(t, EventKind::Singular, "the broken mechanism reached a pose without a unique motion");
        Ok(false)
    }

    /// Why the twin goes no further: a law without a number, numbers that left the equations, or a singular pose.
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

    fn watch(&mut self, snapshot: &Snapshot, margins: &[f64; SOCKETS]) {
        let closed = self.twin.closed();
        let plant = self.twin.plant();
        // The length of an elastic strut is no constraint.
        let rigid = plant.effects.iter().all(|a| a.strut_spring().is_none());
        let report = &mut self.report;
        let joints = plant.assembled.then(|| constraints::rows(&plant.geometry, &snapshot.motion));
        for (row, (gap, rate)) in joints.into_iter().flatten().enumerate() {
            let holds = constraints::socket(row).is_none_or(|s| closed.contains(s) && (rigid || s < STRUTS));
            if holds {
                report.max_loop_gap = report.max_loop_gap.max(gap.abs());
                report.max_loop_rate = report.max_loop_rate.max(rate.abs());
            }
        }
        if !self.tripped {
            for i in 0..AXES {
                let error = (snapshot.motion.q[i] - self.wanted.q[i]).abs();
                report.tracking_error[i] = report.tracking_error[i].max(error);
            }
        }
        report.see_strut_forces(&snapshot.reactions);
        for s in closed.iter() {
            report.min_margin[s] = report.min_margin[s].min(margins[s]);
        }
    }

    /// Chooses the torque of the coming control period.
    fn control(&mut self, t: f64, encoders: &[f64; AXES], tau: &[f64; AXES]) -> Result<(), SimulationError> {
        if self.tripped {
            return Ok(());
        }
        if self.twin.closed() != SocketSet::ALL {
            self.trip(t, "a socket has left its ball");
            return Ok(());
        }
        let span = self.period * self.options.control_period as f64;
        let trajectory = |reason| SimulationError::Trajectory { t, reason };
        let next = (self.desired)(t + span).joints(&self.twin.plant().geometry).map_err(trajectory)?;
        let command = self.controller.update(&self.wanted, encoders, &next).map_err(trajectory)?;
        let limits = &self.options.supervision;
        let machine = self.twin.plant().mechanism;
        let (torque, angle) = (machine.unit(Unit::NM), machine.unit(Unit::Rad));
        for i in 0..machine.arms() {
            let (feedback, error) = (command.feedback[i].abs(), (self.wanted.q[i] - encoders[i]).abs());
            if let Some(limit) = limits.torque.filter(|limit| feedback > *limit) {
                self.trip(
                    t,
                    format!("feedback torque {feedback:.1} {torque} on axis {} exceeds {limit} {torque}", i + 1),
                );
                return Ok(());
            }
            if let Some(limit) = limits.tracking.filter(|limit| error > *limit) {
                self.trip(t, format!("tracking error {error:.4} {angle} on axis {} exceeds {limit} {angle}", i + 1));
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

    fn trip(&mut self, t: f64, why: impl Into<String>) {
        self.tripped = true;
        self.torque = Torque::default();
        if let Trip::Brake { torque } = self.options.supervision.trip {
            self.twin.set_brake(torque);
        }
        self.event(t, EventKind::Trip, why);
    }

    /// Moves on to `end`, opening sockets whose hold is exceeded.
    fn advance(&mut self, end: f64) -> Result<(), SingularPose> {
        let full = self.period / self.options.substeps as f64;
        while end - self.twin.time() > INSTANT {
            let mut h = full.min(end - self.twin.time());
            if end - self.twin.time() - h < 1e-3 * full {
                h = end - self.twin.time();
            }
            h = self.touch(h);
            let t = self.twin.time();
            if self.clamps.armed {
                self.twin.save(&mut self.checkpoint);
            }
            self.twin.step(h, &self.torque)?;
            self.report.steps += 1;
            if self.clamps.armed && self.weakest()? < 0.0 {
                self.open_sockets(h)?;
            }
            self.watch_stops();
            if let Some(contacts) = &mut self.contacts {
                contacts.advance(self.twin.time() - t, (self.twin.time() - t) / h);
                self.contact = self.twin.external_now();
            }
        }
        Ok(())
    }

    /// Contact wrenches over the coming step, which is shortened to resolve them.
    fn touch(&mut self, h: f64) -> f64 {
        let Some(contacts) = &mut self.contacts else { return h };
        let motion = self.twin.motion();
        let closed = self.twin.closed();
        if !contacts.near(&motion, closed, h) && self.contact.iter().all(|w| *w == STILL) {
            self.twin.set_external(Load::NONE);
            return h;
        }
        let n = (h / contacts.longest_step()).ceil().max(1.0);
        let h = h / n;
        // Wrenches go linearly to what they will be at the end of the step, so reactions are continuous in time.
        let ahead = extrapolated(&motion, h);
        let next = *contacts.wrenches(&ahead, closed);
        let t = self.twin.time();
        let load = if next.iter().chain(&self.contact).all(|w| *w == STILL) {
            Load::NONE
        } else {
            Load::ramp(t, &self.contact, &next, h)
        };
        self.twin.set_external(load);
        self.note_touches(t);
        h
    }

    /// Notes what touches since the contacts were last solved.
    fn note_touches(&mut self, t: f64) {
        let Self { contacts: Some(contacts), touching, report, .. } = self else { return };
        for touch in contacts.touches() {
            if begins(touching, Meeting::Contact(touch.link, touch.other), t) {
                let what = format!("{} touches {}", contacts.name(touch.link), contacts.name(touch.other));
                report.events.push(Event { t, kind: EventKind::Contact, what });
            }
        }
    }

    /// Notes joints that are in their hard stops.
    fn watch_stops(&mut self) {
        let (t, hits) = (self.twin.time(), *self.twin.hits());
        for (k, hit) in hits.iter().enumerate() {
            let Some(hit) = hit else { continue };
            if begins(&mut self.touching, Meeting::Stop(k, hit.above), t) {
                self.event(t, EventKind::Stop, stops::name(k, hit));
            }
        }
    }

    /// Smallest margin of the sockets that hold.
    fn weakest(&mut self) -> Result<f64, SingularPose> {
        let snapshot = self.twin.evaluate(&self.torque)?;
        let closed = self.twin.closed();
        let margins = self.clamps.margins(&snapshot.motion, &snapshot.sockets, closed);
        Ok(closed.iter().map(|s| margins[s]).fold(f64::INFINITY, f64::min))
    }

    /// Goes back to where a margin vanished within the last step of `h` and opens every socket that cannot hold there.
    fn open_sockets(&mut self, h: f64) -> Result<(), SingularPose> {
        let (mut before, mut after) = (0.0, h);
        while after - before > EVENT_TIME {
            let middle = 0.5 * (before + after);
            self.twin.restore(&self.checkpoint);
            self.twin.step(middle, &self.torque)?;
            if self.weakest()? < 0.0 { after = middle } else { before = middle }
        }
        self.twin.restore(&self.checkpoint);
        self.twin.step(after, &self.torque)?;
        let t = self.twin.time();
        // Each loss loads the others and takes the hold of its partner.
        loop {
            let snapshot = self.twin.evaluate(&self.torque)?;
            let closed = self.twin.closed();
            let margins = self.clamps.margins(&snapshot.motion, &snapshot.sockets, closed);
            let worst = closed.iter().min_by(|&a, &b| margins[a].total_cmp(&margins[b]));
            let Some(socket) = worst.filter(|&s| margins[s] < 0.0) else { return Ok(()) };
            let load = self.clamps.load(&snapshot.motion, &snapshot.sockets[socket], socket);
            let (hold, left) = (self.clamps.hold[socket], (margins[socket] + load.across).max(0.0));
            self.report.see_strut_forces(&snapshot.reactions);
            self.report.min_margin[socket] = self.report.min_margin[socket].min(margins[socket]);
            self.event(
                t,
                EventKind::Dislocation,
                format!(
                    "{}: {:.3} N across, hold {left:.3} of {hold:.1} N, pull {:.1} N",
                    socket_name(socket),
                    load.across,
                    load.pull
                ),
            );
            self.twin.open(socket)?;
            self.clamps.release(socket);
        }
    }

    /// What the gripper does by time `t`.
    fn act(&mut self, t: f64) -> Result<(), SimulationError> {
        while let Some(action) = self.options.actions.get(self.next_action).filter(|a| a.t <= t + INSTANT) {
            self.next_action += 1;
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

    fn keep_frame(&mut self, t: f64, snapshot: &Snapshot, margins: &[f64; SOCKETS]) {
        let watcher = self.options.watcher.as_ref();
        let Some(spacing) = self.options.frames.or(watcher.map(|w| w.spacing)) else { return };
        if t + INSTANT < self.frames as f64 * spacing {
            return;
        }
        self.frames += 1;
        let motion = &snapshot.motion;
        let objects = self.contacts.as_ref().map_or_else(Vec::new, |c| c.poses(motion));
        let frame = Frame {
            t,
            q: motion.q,
            tau: self.torque.at(t),
            bodies: motion.shown(self.twin.plant().mechanism),
            objects,
            closed: self.twin.closed(),
            strut_force: [snapshot.reactions.upper, snapshot.reactions.lower],
            socket_margin: *margins,
        };
        if let Some(watcher) = watcher {
            watcher.see(Some(&frame), &self.report.events[self.watched..]);
            self.watched = self.report.events.len();
        }
        if self.options.frames.is_some() {
            self.report.frames.push(frame);
        }
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
        }
    }

    fn finish(mut self, model: &Model, setup: &Setup) -> (Recording, Report) {
        if let Some(watcher) = &self.options.watcher {
            watcher.see(None, &self.report.events[self.watched..]);
        }
        let mut setup = *setup;
        if matches!(model.mechanism, Mechanism::Delta { .. }) && !self.twin.plant().assembled {
            setup.configuration = Configuration::Disassembled;
        }
        self.report.kinetic_energy = self.kinetic_energy();
        self.report.energy_error = self.report.energy_error.max(self.twin.energy_balance().abs());
        self.report.energy_error /= self.turned_over.max(LEAST_WORK);
        self.report.closed = self.twin.closed();
        self.report.unconverged = self.twin.unconverged();
        self.report.solutions = self.twin.solutions();
        self.report.corrections = self.twin.corrections();
        self.report.contacts = self.contacts.as_ref().map_or_else(ContactWork::default, |c| c.work());
        for active in &self.twin.plant().effects {
            active.observe(&mut self.signals);
        }
        self.sensors.add_noise(&mut self.signals);
        (Recording { name: model.name.clone(), signals: self.signals, setup }, self.report)
    }
}

/// The pose of a motion in words.
fn pose(motion: &Motion, assembled: bool) -> Pose {
    Pose { q: motion.q, platform: assembled.then(|| motion.bodies[PLATFORM].position.into()) }
}

fn singular_start(motion: &Motion, assembled: bool) -> SimulationError {
    SimulationError::Singular { t: 0.0, pose: pose(motion, assembled), cause: Cause::Rank }
}

/// Poses `h` seconds ahead at the present twists.
fn extrapolated(motion: &Motion, h: f64) -> Motion {
    let mut out = *motion;
    for body in &mut out.bodies {
        body.position += body.velocity * h;
        let turn: Vector3<f64> = body.angular_velocity * h;
        body.rotation = Rotation3::from_scaled_axis(turn).into_inner() * body.rotation;
    }
    for s in 0..STRUTS {
        out.strut_axis[s] = out.bodies[crate::machine::bodies::STRUT + s].rotation.column(0).into_owned();
    }
    out
}

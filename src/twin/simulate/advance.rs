//! Steps between two samples: contacts, stops and dislocations of ball sockets.

use nalgebra::{Rotation3, Vector3};

use super::{INSTANT, Run};
use crate::kinematics::Motion;
use crate::machine::bodies::{END_EFFECTOR, strut};
use crate::numerics::{halvings, try_bisect};
use crate::twin::Snapshot;
use crate::twin::contacts::ContactBody;
use crate::twin::sockets::socket_name;
use crate::twin::trace::{Dislocation, Impact};
use crate::twin::wrench::{Load, STILL};
use crate::twin::{Event, EventKind, SingularPose, energy, stops};

/// Time resolution of a dislocation, s.
const EVENT_TIME: f64 = 1e-7;
/// Time without contact after which a pair's next contact is a new event, s.
const CONTACT_PAUSE: f64 = 0.05;

/// Error of a position or velocity in one step of a broken robot to which its pace is adapted, m, rad, m/s or rad/s, and
/// the limits of the change from step to step.
const STEP_ERROR: f64 = 2e-6;
const SLOWEST: f64 = 0.3;
const FASTEST: f64 = 2.0;
/// Multiple of that error above which a step with contacts is refused.
const REFUSED: f64 = 8.0;

/// A contact or stop, of which only the beginnings are events.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Meeting {
    /// Two bodies that touch.
    Contact(ContactBody, ContactBody),
    /// A degree of freedom and whether it is at its upper stop.
    Stop(usize, bool),
}

impl Run<'_> {
    /// Advances to `end`, opening sockets whose hold force is exceeded.
    pub(super) fn advance(&mut self, end: f64) -> Result<(), SingularPose> {
        while end - self.twin.time() > INSTANT {
            let full = self.longest_step();
            let mut h = full.min(end - self.twin.time());
            if end - self.twin.time() - h < 1e-3 * full {
                h = end - self.twin.time();
            }
            h = self.touch(h);
            let t = self.twin.time();
            if self.clamps.armed || self.finest.is_some() {
                self.twin.save(&mut self.checkpoint);
            }
            self.known = None;
            if !self.try_step(h)? {
                continue;
            }
            self.report.steps += 1;
            if end - self.twin.time() <= INSTANT {
                self.twin.set_time(end);
            }
            if self.clamps.armed && self.weakest()? < 0.0 {
                self.open_sockets(h)?;
            }
            self.watch_stops();
            let done = self.twin.time() - t;
            if let Some(contacts) = &mut self.contacts {
                let share = if self.finest.is_some() { 1.0 } else { done / h };
                contacts.advance(done, share);
                self.contact = self.twin.external_now();
            }
            if self.finest.is_some() {
                self.note_touches(self.twin.time(), &self.twin.motion());
            }
        }
        Ok(())
    }

    /// Makes a step of `h` s; false if it is to be made again with a shorter one.
    fn try_step(&mut self, h: f64) -> Result<bool, SingularPose> {
        let made = self.step(h);
        if self.twin.is_whole() {
            return made.map(|()| true);
        }
        let error = if made.is_ok() { self.twin.step_error() } else { f64::INFINITY };
        let error = if error.is_nan() { f64::INFINITY } else { error };
        // Within a step a contact may begin, which its first stage cannot know.
        let coarse =
            self.finest.is_some_and(|finest| h > finest) && error > REFUSED * STEP_ERROR * self.fineness.powi(3);
        if coarse {
            self.twin.restore(&self.checkpoint);
        } else {
            made?;
        }
        self.set_pace(h, error);
        Ok(!coarse)
    }

    /// Advances the twin by `h` s, with the contacts as they are taken at present.
    fn step(&mut self, h: f64) -> Result<(), SingularPose> {
        match &mut self.contacts {
            Some(contacts) if self.finest.is_some() => self.twin.step_touching(h, &self.torque, contacts.as_mut()),
            _ => self.twin.step(h, &self.torque),
        }
    }

    /// Longest step at present, s: the given one, or the [`pace`](Self::set_pace) of a broken robot, which has no
    /// controller to be followed.
    fn longest_step(&self) -> f64 {
        let given = self.period / self.options.substeps as f64;
        if self.twin.is_whole() { given } else { self.pace.max(given) }
    }

    /// Adapts the pace of a broken robot to the estimated `error` of its last step, of `h` s: never finer than the given
    /// step, or than contacts require, and at most a sample time.
    fn set_pace(&mut self, h: f64, error: f64) {
        let given = self.period / self.options.substeps as f64;
        // The error is of the third power of the step.
        let factor = self.fineness * (STEP_ERROR / error.max(f64::MIN_POSITIVE)).cbrt();
        let finest = self.finest.map_or(given, |finest| finest.min(given));
        self.pace = (h * factor.clamp(SLOWEST, FASTEST)).clamp(finest, self.period);
    }

    /// Stops a robot that has come to rest: what would go on is the creep of regularised friction.
    pub(super) fn halt(&mut self) {
        self.twin.halt();
        self.known = None;
        if self.contact.iter().any(|w| *w != STILL) {
            self.twin.set_external(Load::constant(self.contact));
        }
    }

    /// Keeps a robot that has been stopped where it is until `end`, with the solution there.
    pub(super) fn stay(&mut self, end: f64, solution: Snapshot) {
        self.twin.set_time(end);
        self.known = Some(solution);
    }

    /// Updates the contact wrenches for the next step and returns its length, shortened to resolve them.
    fn touch(&mut self, h: f64) -> f64 {
        let Some(contacts) = &mut self.contacts else { return h };
        let motion = self.twin.motion();
        let closed = self.twin.closed();
        self.finest = None;
        if !contacts.near(&motion, closed, h) && self.contact.iter().all(|w| *w == STILL) {
            self.twin.set_external(Load::NONE);
            return h;
        }
        let longest = self.options.contact_steps * contacts.longest_step() * self.fineness;
        if !self.twin.is_whole() && contacts.resistances(&motion).is_some() {
            self.finest = Some(longest);
            return h.min(self.pace.max(longest));
        }
        let n = (h / longest).ceil().max(1.0);
        let h = h / n;
        // Wrenches are linear up to their values at the end of the step, so that reactions are continuous in time.
        let ahead = extrapolated(&motion, h);
        let next = *contacts.wrenches(&ahead, closed);
        let t = self.twin.time();
        let load = if next.iter().chain(&self.contact).all(|w| *w == STILL) {
            Load::NONE
        } else {
            Load::ramp(t, &self.contact, &next, h)
        };
        self.twin.set_external(load);
        self.note_touches(t, &motion);
        h
    }

    /// Records the contacts that are new since the last solution, and the strongest ones for the next frame.
    fn note_touches(&mut self, t: f64, motion: &Motion) {
        let is_seen = self.spacing().is_some();
        let Self { contacts: Some(contacts), touching, strongest, report, twin, .. } = self else { return };
        for touch in contacts.touches() {
            if is_seen {
                touch.keep_in(strongest);
            }
            if begins(touching, Meeting::Contact(touch.link, touch.other), t) {
                let names = [contacts.name(touch.link), contacts.name(touch.other)];
                let what = format!("{} touches {}", names[0], names[1]);
                report.events.push(Event { t, kind: EventKind::Contact, what });
                // A held object is part of the end effector.
                let link = if let ContactBody::Link(link) = touch.link { link } else { END_EFFECTOR };
                let body = &motion.bodies[link];
                report.impacts.push(Impact {
                    t,
                    link: touch.link,
                    other: touch.other,
                    names,
                    position: body.position,
                    velocity: body.velocity,
                    kinetic_energy: energy::of_body(&twin.plant().bodies[link], body),
                });
            }
        }
    }

    /// Records joints that have reached their hard stops.
    fn watch_stops(&mut self) {
        let (t, hits) = (self.twin.time(), *self.twin.hits());
        for (k, hit) in hits.iter().enumerate() {
            let Some(hit) = hit else { continue };
            if begins(&mut self.touching, Meeting::Stop(k, hit.above), t) {
                self.event(t, EventKind::Stop, stops::name(k, hit));
            }
        }
    }

    /// Smallest margin of the closed sockets, N; an error if one is not a number.
    fn weakest(&mut self) -> Result<f64, SingularPose> {
        let snapshot = self.twin.evaluate(&self.torque)?;
        let closed = self.twin.closed();
        let margins = self.clamps.margins(&snapshot.motion, &snapshot.sockets, closed);
        self.known = Some(snapshot);
        if closed.iter().any(|s| margins[s].is_nan()) {
            return Err(SingularPose);
        }
        Ok(closed.iter().map(|s| margins[s]).fold(f64::INFINITY, f64::min))
    }

    /// Returns to the zero of a margin within the last step of `h` s, and opens every socket that cannot hold there.
    fn open_sockets(&mut self, h: f64) -> Result<(), SingularPose> {
        let [_, after] = try_bisect([0.0, h], halvings(h, EVENT_TIME), |step| {
            self.twin.restore(&self.checkpoint);
            self.step(step)?;
            Ok(self.weakest()? >= 0.0)
        })?;
        self.known = None;
        self.twin.restore(&self.checkpoint);
        self.step(after)?;
        let t = self.twin.time();
        // Each open socket loads the others and removes the clamp force of its partner.
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
            self.report.dislocations.push(Dislocation {
                t,
                socket,
                across: load.across,
                hold: left,
                pull: load.pull,
                kinetic_energy: self.kinetic_energy(),
            });
            self.event(
                t,
                EventKind::Dislocation,
                format!(
                    "{}: {:.3} N across, hold {left:.3} of {hold:.1} N, pull {:.1} N",
                    socket_name(socket, self.twin.plant().mechanism.struts()),
                    load.across,
                    load.pull
                ),
            );
            self.twin.open(socket)?;
            self.clamps.release(socket);
        }
    }
}

/// Whether `meeting`, active at time `t`, has begun anew; records it in `known`.
fn begins(known: &mut Vec<(Meeting, f64)>, meeting: Meeting, t: f64) -> bool {
    match known.iter_mut().find(|(met, _)| *met == meeting) {
        Some((_, last)) => t - std::mem::replace(last, t) >= CONTACT_PAUSE,
        None => {
            known.push((meeting, t));
            true
        }
    }
}

/// The motion with poses extrapolated by `h` s at the present twists.
fn extrapolated(motion: &Motion, h: f64) -> Motion {
    let mut out = *motion;
    for body in &mut out.bodies {
        body.position += body.velocity * h;
        let turn: Vector3<f64> = body.angular_velocity * h;
        body.rotation = Rotation3::from_scaled_axis(turn).into_inner() * body.rotation;
    }
    for s in 0..motion.struts() {
        out.strut_axis[s] = out.bodies[strut(s)].rotation.column(0).into_owned();
    }
    out
}

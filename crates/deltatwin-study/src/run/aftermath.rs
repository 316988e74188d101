//! What happens from a failure on: order of the sockets, touchdowns.

use deltatwin::machine::bodies::{END_EFFECTOR, PLATFORM};
use deltatwin::scenario::Scenario;
use deltatwin::twin::{ContactBody, Impact, Report};

use super::AFTERMATH;
use super::clearance::picked;
use super::verdict::{Cause, Step, Touchdown};

/// What a run with the limits of the machine shows until `end` (s).
pub struct Aftermath<'a> {
    report: &'a Report,
    end: f64,
    /// Number of objects of the scenario; the robot's own frame follows.
    objects: usize,
    picked: Vec<usize>,
}

impl<'a> Aftermath<'a> {
    /// What `report` of a run of `scenario` shows until `end` (s): a broken robot is followed for [`AFTERMATH`], and for
    /// `after_landing` (s) once its load has landed.
    pub fn new(report: &'a Report, scenario: &Scenario, (end, after_landing): (f64, f64)) -> Self {
        let objects = scenario.objects.len();
        let landed = report.landing(objects).map_or(f64::INFINITY, |impact| impact.t + after_landing);
        let broken = report.dislocations.first().map_or(f64::INFINITY, |d| d.t + AFTERMATH);
        Self { report, end: end.min(landed).min(broken), objects, picked: picked(scenario) }
    }

    /// When the first socket left, s; infinite if none did.
    pub fn broken(&self) -> f64 {
        self.report.dislocations.first().filter(|d| d.t <= self.end).map_or(f64::INFINITY, |d| d.t)
    }

    /// Whether `t` (s) is within what the run shows.
    pub fn covers(&self, t: f64) -> bool {
        t <= self.end
    }

    /// Sockets that left, in order, with their times (s).
    pub fn opened(&self) -> Vec<(f64, usize)> {
        self.report.dislocations.iter().filter(|d| d.t <= self.end).map(|d| (d.t, d.socket)).collect()
    }

    /// First contact of the intact robot with an object that it does not pick.
    pub fn collision(&self) -> Option<&'a Impact> {
        let broken = self.report.dislocations.first().map_or(f64::INFINITY, |d| d.t);
        let unwanted = |body: ContactBody| match body {
            ContactBody::Object(object) => object < self.objects && !self.picked.contains(&object),
            ContactBody::Link(_) => false,
        };
        let is_robot = |body: ContactBody| matches!(body, ContactBody::Link(_));
        let impacts = self.report.impacts.iter().filter(|i| i.t <= self.end && i.t < broken);
        impacts.filter(|i| is_robot(i.link) && unwanted(i.other)).min_by(|a, b| a.t.total_cmp(&b.t))
    }

    /// Where the platform lands, itself or with the end effector that is fixed to it and carries the payload.
    pub fn platform(&self) -> Option<Touchdown> {
        let broken = self.report.dislocations.first()?.t;
        let is_plate = |body: ContactBody| matches!(body, ContactBody::Link(PLATFORM | END_EFFECTOR));
        let is_object = |body: ContactBody| matches!(body, ContactBody::Object(object) if object < self.objects);
        let mut impacts = self.report.impacts.iter().filter(|i| i.t >= broken);
        self.touchdown(impacts.find(|i| is_plate(i.link) && is_object(i.other)))
    }

    /// Where the end effector with its payload, or the held object, lands.
    pub fn payload(&self) -> Option<Touchdown> {
        self.touchdown(self.report.landing(self.objects))
    }

    fn touchdown(&self, impact: Option<&Impact>) -> Option<Touchdown> {
        let first = impact.filter(|i| i.t <= self.end)?;
        Some(Touchdown {
            time: first.t,
            position: first.position.into(),
            speed: first.velocity.norm(),
            energy: first.kinetic_energy,
            on: first.names[1].clone(),
        })
    }

    /// All steps from the failure on.
    pub fn sequence(&self, cause: &Cause) -> Vec<Step> {
        let first = Step { time: cause.time, what: format!("{}: {}", cause.kind.name(), cause.part) };
        let events = self.report.events.iter().filter(|e| e.t >= cause.time && e.t <= self.end);
        let steps = events.map(|e| Step { time: e.t, what: format!("{}: {}", e.kind.name(), e.what) });
        std::iter::once(first).chain(steps).collect()
    }
}

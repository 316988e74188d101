//! Margins of a run against every kind of cause.
//!
//! They are those of the *unlimited* machine: sockets that cannot open, drives that give any torque, no supervision, no
//! contacts. Up to the first limit it behaves exactly like the real one, and beyond it the margins continue to fall.
//! Where the real one meets an object or saturates a drive and stays whole, its own loads replace them.

use deltatwin::kinematics::Target;
use deltatwin::machine::Geometry;
use deltatwin::model::Model;
use deltatwin::scenario::{DesiredMotion, Supervision};
use deltatwin::twin::sockets::socket_name;
use deltatwin::twin::{Clamps, Sample};

use super::verdict::{Cause, CauseKind, Margin};

/// Kinds of causes whose margins are taken from the run with contacts and limited drives where it differs.
pub const LOADS: &[CauseKind] = &[CauseKind::Socket, CauseKind::Trip, CauseKind::Following];

/// The margin against one cause along a run, at its least so far.
struct Least {
    margin: Margin,
    /// First time with a negative margin, s.
    crossed: Option<(f64, String)>,
}

/// Least margins along a run, and when each was first negative.
#[derive(Default)]
pub struct Margins {
    found: Vec<Least>,
}

impl Margins {
    /// Takes the margin of one part at one time into account; the name of the part is only made where it is kept.
    pub fn see(&mut self, kind: CauseKind, time: f64, value: f64, part: impl Fn() -> String) {
        // A margin that is not a number would otherwise never be the least.
        let value = if value.is_nan() { f64::NEG_INFINITY } else { value };
        let least = match self.found.iter_mut().find(|l| l.margin.cause.kind == kind) {
            Some(least) => least,
            None => {
                let margin = Margin { cause: Cause { kind, part: part(), time }, value: f64::INFINITY };
                self.found.push(Least { margin, crossed: None });
                let last = self.found.len() - 1;
                &mut self.found[last]
            }
        };
        if value < least.margin.value {
            least.margin = Margin { cause: Cause { kind, part: part(), time }, value };
        }
        if value < 0.0 && least.crossed.is_none() {
            least.crossed = Some((time, part()));
        }
    }

    /// Forgets the margins against some kinds of cause.
    pub fn forget(&mut self, kinds: &[CauseKind]) {
        self.found.retain(|least| !kinds.contains(&least.margin.cause.kind));
    }

    /// First time with a negative margin against a kind of cause, s, and the part.
    pub fn crossed(&self, kind: CauseKind) -> Option<(f64, &str)> {
        let (time, part) = self.found.iter().find(|l| l.margin.cause.kind == kind)?.crossed.as_ref()?;
        Some((*time, part))
    }

    /// The cause whose margin was negative first, of those that end a motion: a drive at its limit need not.
    pub fn first_crossing(&self) -> Option<Cause> {
        let all = CauseKind::ALL
            .iter()
            .filter(|kind| **kind != CauseKind::Torque)
            .filter_map(|&kind| self.crossed(kind).map(|(time, part)| Cause { kind, part: part.into(), time }));
        all.min_by(|a, b| a.time.total_cmp(&b.time))
    }

    /// Least margin against any cause.
    pub fn least(&self) -> f64 {
        self.found.iter().map(|l| l.margin.value).fold(f64::INFINITY, f64::min)
    }

    /// Least margin of every kind, least first.
    pub fn sorted(&self) -> Vec<Margin> {
        let mut all: Vec<Margin> = self.found.iter().map(|l| l.margin.clone()).collect();
        all.sort_by(|a, b| a.value.total_cmp(&b.value).then(a.cause.kind.cmp(&b.cause.kind)));
        all
    }

    /// Takes all samples of a run on `model` into account.
    pub fn follow(&mut self, model: &Model, clamps: &Clamps, supervision: &Supervision, trace: &[Sample]) {
        let machine = model.mechanism;
        let (axes, arms) = (machine.axes(), machine.arms());
        self.loads(model, clamps, supervision, trace);
        for sample in trace {
            let t = sample.t;
            for i in 0..axes {
                let drive = &model.drives[i];
                self.see(CauseKind::Torque, t, 1.0 - sample.torque[i].abs() / drive.max_torque, || axis(i));
                self.see(CauseKind::Speed, t, 1.0 - sample.rate[i].abs() / drive.max_speed, || axis(i));
            }
            for i in 0..arms {
                let range = inside(sample.q[i], model.geometry.limbs[i].limits);
                self.see(CauseKind::Workspace, t, range, || format!("arm {}", i + 1));
            }
            if model.assembled && model.geometry.has_telescope() {
                let range = inside(sample.telescope, model.geometry.telescope_limits);
                self.see(CauseKind::Telescope, t, range, || "telescope".into());
            }
        }
    }

    /// Takes what contacts and saturated drives change into account: [`LOADS`].
    pub fn loads(&mut self, model: &Model, clamps: &Clamps, supervision: &Supervision, trace: &[Sample]) {
        for sample in trace {
            let t = sample.t;
            for i in 0..model.mechanism.arms() {
                if let Some(limit) = supervision.torque {
                    self.see(CauseKind::Trip, t, 1.0 - sample.feedback[i].abs() / limit, || axis(i));
                }
                if let Some(limit) = supervision.tracking {
                    self.see(CauseKind::Following, t, 1.0 - sample.error[i].abs() / limit, || axis(i));
                }
            }
            let struts = model.mechanism.struts();
            for s in (0..2 * struts).filter(|_| model.assembled) {
                let value = sample.margin[s] / holding(model, clamps, s);
                self.see(CauseKind::Socket, t, value, || socket_name(s, struts));
            }
        }
    }

    /// Takes the reach of the struts along a motion (`duration` in s, every `spacing` s) into account, by |cos| of the elbow's
    /// angle: beyond 1 the strut does not reach its place.
    pub fn reach(&mut self, geometry: &Geometry, motion: &DesiredMotion, duration: f64, spacing: f64) {
        let steps = (duration / spacing).ceil().max(1.0) as usize;
        for k in 0..=steps {
            let t = k as f64 * spacing;
            let Ok(Target::Platform(platform)) = motion.state(t) else { continue };
            for limb in 0..geometry.limbs.len() {
                let reached = geometry.elbow_cosine(limb, &platform.position, platform.psi[0]).abs();
                self.see(CauseKind::Workspace, t, 1.0 - reached, || format!("limb {}", limb + 1));
            }
        }
    }
}

/// Name of an axis.
fn axis(i: usize) -> String {
    format!("axis {}", i + 1)
}

/// Distance of `value` from the nearer of two limits, relative to half of the range; 1 in its middle.
fn inside(value: f64, [low, high]: [f64; 2]) -> f64 {
    (value - low).min(high - value) / (0.5 * (high - low))
}

/// Force to which the margin of a socket is related, N: its own hold, of an empty clamp that of the model.
pub fn holding(model: &Model, clamps: &Clamps, socket: usize) -> f64 {
    let hold = clamps.hold[socket];
    if hold > 0.0 { hold } else { model.sockets.dislocation_force }
}

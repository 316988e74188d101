//! Rows of a failure mode and effects analysis.

use deltatwin::scenario::sockets::{spring, spring_name};
use deltatwin::text::significant;
use deltatwin::twin::sockets::{partner, socket_name};

use super::Case;
use super::verdict::{CauseKind, Fmea, Notice, Touchdown, Verdict};

/// The row of a verdict whose other fields are complete.
pub fn row(case: &Case, verdict: &Verdict) -> Fmea {
    if verdict.survived {
        return Fmea {
            cause: format!("none; closest: {} ({})", verdict.cause.kind.name(), verdict.cause.part),
            local: format!("margin {}", significant(verdict.margin, 3)),
            end: "the motion is completed".into(),
            detection: "not needed".into(),
            lead: None,
        };
    }
    let noticed = noticed(verdict);
    Fmea {
        cause: cause(case, verdict),
        local: local(verdict),
        end: end(verdict),
        detection: match noticed {
            None => "nothing notices it".into(),
            Some(n) if n.lead.is_none() => format!("only afterwards: {}", n.what),
            Some(n) => n.what.clone(),
        },
        lead: noticed.and_then(|n| n.lead),
    }
}

/// The supervision that notices the failure first.
fn noticed(verdict: &Verdict) -> Option<&Notice> {
    verdict.supervision.iter().find(|n| n.time.is_some())
}

/// The defects of a scenario that bear on the failure, and the load.
fn cause(case: &Case, verdict: &Verdict) -> String {
    let scenario = &case.scenario;
    let mut reasons = Vec::new();
    let payload = &scenario.setup.payload;
    if let Some(believed) = scenario.believed_payload.filter(|b| b.mass != payload.mass || b.com != payload.com) {
        reasons.push(format!("{} kg carried, {} kg believed", payload.mass, believed.mass));
    }
    let (sockets, struts) = (verdict.sockets.len(), case.model.mechanism.struts());
    let socket = (0..sockets).find(|&s| socket_name(s, struts) == verdict.cause.part);
    if let Some(socket) = socket.filter(|_| verdict.cause.kind == CauseKind::Socket) {
        let sockets = &scenario.sockets;
        if sockets.wear[socket] > 0.0 {
            reasons.push(format!("{} worn by {:.0} %", socket_name(socket, struts), 1e2 * sockets.wear[socket]));
        }
        let spring = spring(socket, case.model.mechanism);
        if sockets.missing[spring] > 0 {
            reasons.push(format!("{} of 2 springs of {} missing", sockets.missing[spring], spring_name(spring)));
        }
        let [x, y] = [payload.com.x, payload.com.y];
        if payload.mass > 0.0 {
            reasons.push(format!(
                "{} kg, {:.0} mm beside and {:.0} mm below the flange",
                significant(payload.mass, 3),
                1e3 * x.hypot(y),
                -1e3 * payload.com.z
            ));
        }
    }
    let margin = verdict.margin_of(verdict.cause.kind).unwrap_or(verdict.margin);
    let load = match verdict.cause.kind {
        CauseKind::Contact => format!("{} on the path", verdict.cause.part),
        kind => format!("{} of {}: {:.0} % of the limit needed", kind.name(), verdict.cause.part, 1e2 * (1.0 - margin)),
    };
    reasons.push(load);
    if let Some(limit) = verdict.limit.as_ref().filter(|limit| limit.kind != verdict.cause.kind) {
        reasons.push(format!("{} of {} at its limit from {:.4} s on", limit.kind.name(), limit.part, limit.time));
    }
    reasons.join("; ")
}

/// Effect at the part.
fn local(verdict: &Verdict) -> String {
    let Some(&(time, first)) = verdict.opened.first() else {
        return match verdict.cause.kind {
            CauseKind::Trip | CauseKind::Following => format!("drives trip at {:.4} s", verdict.cause.time),
            CauseKind::Contact => format!("contact at {:.4} s: {}", verdict.cause.time, verdict.cause.part),
            CauseKind::Torque => format!("{} saturates from {:.4} s on", verdict.cause.part, verdict.cause.time),
            CauseKind::Socket => format!("{} would leave its ball at {:.4} s", verdict.cause.part, verdict.cause.time),
            _ => format!("{} is beyond its limit from {:.4} s on", verdict.cause.part, verdict.cause.time),
        };
    };
    let others = verdict.opened_at_once() - 1;
    let follow = match others {
        0 => String::new(),
        _ => {
            let pair = verdict.opened.iter().any(|(_, s)| *s == partner(first));
            let with = if pair { ", its partner among them" } else { "" };
            format!("; {others} more within 1 ms{with}")
        }
    };
    format!("{} leaves its ball at {time:.4} s{follow}", socket_name(first, verdict.sockets.len() / 2))
}

/// Effect on robot and payload.
fn end(verdict: &Verdict) -> String {
    if verdict.opened.is_empty() {
        return match verdict.cause.kind {
            CauseKind::Trip | CauseKind::Following | CauseKind::Contact => "the robot stops, whole".into(),
            CauseKind::Torque => "the robot falls behind its motion, whole".into(),
            _ => "the motion is refused before it starts".into(),
        };
    }
    let land = |what: &str, at: &Option<Touchdown>| {
        at.as_ref().map(|t| {
            let [x, y, _] = t.position;
            format!("{what} hits {} at {:.3} s, ({x:.2}, {y:.2}) m, with {} J", t.on, t.time, significant(t.energy, 3))
        })
    };
    let falls = verdict.platform.is_some() || verdict.payload.is_some();
    let fate = if falls { "falls" } else { "hangs loose" };
    let mut parts =
        vec![format!("{} of {} sockets open, the platform {fate}", verdict.opened.len(), verdict.sockets.len())];
    // A payload on the flange lands with the platform.
    let with_it = |at: &&Touchdown| verdict.payload.as_ref().is_none_or(|payload| payload.time != at.time);
    parts.extend(land("the platform", &verdict.platform.as_ref().filter(with_it).cloned()));
    parts.extend(land("the payload", &verdict.payload));
    parts.join("; ")
}

//! Summary of a model in one paragraph.

use super::Model;
use crate::machine::bodies::{BodyKind, SLOTS, body_kind, body_name};
use crate::machine::{Axis, Effort, Inertia, Joint, Mechanism};

/// Summary of the machine in one paragraph.
pub fn summary(model: &Model) -> String {
    let mut text = format!("{}: ", model.name);
    let axes = model.mechanism.axes();
    text += &match model.mechanism {
        Mechanism::Axis(Axis { joint, effort }) => {
            let joint = if joint == Joint::Revolute { "revolute" } else { "prismatic" };
            let unit = if effort == Effort::Current { ", in A: everything per torque constant" } else { "" };
            format!("a single {joint} axis{unit}")
        }
        Mechanism::Delta { telescope, .. } if model.assembled => {
            // Without a telescope the end effector is part of the platform.
            let fixed = usize::from(!telescope && !model.mechanism.plate_turns());
            let bodies = (0..SLOTS).filter(|&b| model.mechanism.has_body(b)).count() - fixed;
            let kind = match (model.mechanism.is_delta(), telescope) {
                (true, true) => "delta mechanism".to_string(),
                (true, false) => "delta mechanism without telescope".into(),
                (false, _) => format!("{} limbs and a plate", model.mechanism.limbs()),
            };
            let struts = model.mechanism.struts();
            format!(
                "{kind}, assembled; {bodies} bodies, {} freedoms ({axes} driven, {struts} strut spins)",
                axes + struts
            )
        }
        Mechanism::Delta { telescope, .. } => {
            let rotor = if telescope { " and the rotor" } else { "" };
            let arms = model.mechanism.arms();
            format!("delta mechanism, disassembled; {axes} bodies ({arms} arms{rotor}), {axes} freedoms")
        }
    };
    if let Some(home) = model.assembled.then(|| model.geometry.home()).flatten() {
        text += &format!(
            "; home pose q = 0: flange {:.4} m below the mounting plane",
            model.geometry.mounting_height - home.flange,
        );
        if model.mechanism.has_telescope() {
            text += &format!(", telescope {:.4} m long", home.telescope);
        }
    }
    let effects: Vec<&str> = model.effects.iter().map(|e| e.effect.name()).collect();
    text += &match effects[..] {
        [] => "; no effects".to_string(),
        _ => format!("; effects: {}", effects.join(", ")),
    };
    if matches!(model.mechanism, Mechanism::Axis(_)) {
        return text + ".";
    }
    if let Some((body, eigenvalue)) = least_eigenvalue(model) {
        text += &format!(
            "; every body physically consistent, smallest pseudo-inertia eigenvalue {eigenvalue:.3e} ({})",
            body_name(body)
        );
    }
    text + "."
}

/// The body with the smallest eigenvalue of the pseudo-inertia, among those with inertia, and that eigenvalue.
fn least_eigenvalue(model: &Model) -> Option<(usize, f64)> {
    (0..SLOTS)
        .filter(|&b| model.assembled || matches!(body_kind(b), BodyKind::Arm(_) | BodyKind::Rotor))
        .filter(|&b| model.bodies[b] != Inertia::ZERO)
        .map(|b| (b, model.bodies[b].min_eigenvalue()))
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

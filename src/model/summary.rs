//! Summary of a model in one paragraph.

use super::Model;
use crate::machine::bodies::{ARM, BODIES, ROTOR, STRUT, body_name};
use crate::machine::check::home;
use crate::machine::{ARMS, Axis, Effort, Inertia, Joint, Mechanism, STRUTS};

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
            let bodies = if telescope { BODIES } else { BODIES_WITHOUT_TELESCOPE };
            let without = if telescope { "" } else { " without telescope" };
            format!(
                "delta mechanism{without}, assembled; {bodies} bodies, {} freedoms ({axes} driven, {STRUTS} strut spins)",
                axes + STRUTS
            )
        }
        Mechanism::Delta { telescope, .. } => {
            let rotor = if telescope { " and the rotor" } else { "" };
            format!("delta mechanism, disassembled; {axes} bodies ({ARMS} arms{rotor}), {axes} freedoms")
        }
    };
    if let Some(home) = model.assembled.then(|| home(&model.geometry)).flatten() {
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

/// Number of arms, struts and platform with end effector.
const BODIES_WITHOUT_TELESCOPE: usize = ARMS + STRUTS + 1;

/// The body with the smallest eigenvalue of the pseudo-inertia, among those with inertia, and that eigenvalue.
fn least_eigenvalue(model: &Model) -> Option<(usize, f64)> {
    (0..BODIES)
        .filter(|&b| model.assembled || (ARM..STRUT).contains(&b) || b == ROTOR)
        .filter(|&b| model.bodies[b] != Inertia::ZERO)
        .map(|b| (b, model.bodies[b].min_eigenvalue()))
        .min_by(|a, b| a.1.total_cmp(&b.1))
}

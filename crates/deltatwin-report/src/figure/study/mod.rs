//! Figures of failure studies, from plain numbers.

mod cause_map;
mod contour;
mod hand;
mod importance;
mod payload_diagram;
mod probability;
#[cfg(test)]
mod tests;
mod timeline;

pub use cause_map::{CauseMap, CausePoint, cause_colors, cause_map};
pub use hand::{Comparison, hand_formula};
pub use importance::{Estimate, Importance, importance};
pub use payload_diagram::{PayloadDiagram, PayloadPanel, payload_diagram};
pub use probability::{Banded, ProbabilityCurve, fragility, power};
pub use timeline::{EventKind, FailureEvent, MOST_SOCKETS, SocketTrace, Timeline, timeline};

use super::canvas::{Align, Canvas, Lettering, text_width};
use super::color::{TEXT, WHITE};
use super::{HUGE, TICK_SIZE};

/// Text on a pale ground that keeps it readable over anything.
fn on_ground(c: &mut Canvas, text: &str, at: (f64, f64), lettering: Lettering) {
    let width = text_width(text, lettering.size);
    let before = match lettering.align {
        Align::Left => 0.0,
        Align::Middle => 0.5 * width,
        Align::Right => width,
    };
    let (start, end, half) = (-before - 2.0, width - before + 2.0, 0.62 * lettering.size);
    if lettering.upright {
        c.bar((at.0 - half, at.1 - end), (at.0 + half, at.1 - start), WHITE, 0.8);
    } else {
        c.bar((at.0 + start, at.1 - half), (at.0 + end, at.1 + half), WHITE, 0.8);
    }
    c.styled(text, at, lettering);
}

/// Small plain text.
fn small(align: Align) -> Lettering {
    Lettering::new(TICK_SIZE, TEXT, align)
}

fn usable(value: f64) -> bool {
    value.abs() < HUGE
}

//! Names of the columns.

use deltatwin::machine::{AXES, Joint, Mechanism, STRUTS};
use deltatwin::recording::multiplier_names;

/// Names of the required columns: time, and angle and torque of every axis.
pub(in crate::recording) fn required(axes: usize) -> impl Iterator<Item = String> {
    let of = move |name| (1..=axes).map(move |k| format!("{name}{k}"));
    std::iter::once("t".to_string()).chain(of("q")).chain(of("tau"))
}

/// Machine whose axes have columns: a single axis if only axis 1 has any, a delta robot without telescope if axis 4 has
/// none.
pub(in crate::recording) fn machine(has: impl Fn(&str) -> bool) -> Mechanism {
    let axis = |k: usize| has(&format!("q{k}")) || has(&format!("tau{k}"));
    match (axis(1), axis(2) || axis(3), axis(4)) {
        (true, false, false) => Mechanism::axis(Joint::Revolute),
        (_, true, false) => Mechanism::delta(false),
        _ => Mechanism::default(),
    }
}

/// Whether a column belongs to an axis beyond the first `axes`.
pub(in crate::recording) fn foreign(name: &str, axes: usize) -> bool {
    is_axis(name) && (axes + 1..=AXES).any(|k| name.ends_with(char::from(b'0' + k as u8)))
}

/// Whether the name is that of a known column.
pub(in crate::recording) fn known(name: &str) -> bool {
    let numbered = |stem: &str, n: usize| {
        name.strip_prefix(stem).is_some_and(|k| k.len() == 1 && k.parse().is_ok_and(|k: usize| (1..=n).contains(&k)))
    };
    let strut = |stem: &str, end: &str| {
        name.strip_prefix(stem)
            .and_then(|n| n.strip_suffix(end))
            .is_some_and(|k| k.len() == 1 && k.parse().is_ok_and(|k: usize| (1..=STRUTS).contains(&k)))
    };
    matches!(name, "t" | "ee_x" | "ee_y" | "ee_z")
        || ["q", "tau", "qd", "qdd", "link_q", "link_qd"].iter().any(|stem| numbered(stem, AXES))
        || strut("strut", "_upper")
        || strut("strut", "_lower")
        || strut("margin", "_upper")
        || strut("margin", "_lower")
        || (name.starts_with("lambda_") && multiplier_names().iter().any(|n| n == name))
}

/// Names of the columns of the socket margins: six upper, then six lower.
pub(in crate::recording) fn margin_names() -> [String; 2 * STRUTS] {
    std::array::from_fn(|s| format!("margin{}_{}", s % STRUTS + 1, if s < STRUTS { "upper" } else { "lower" }))
}

pub(super) fn is_axis(name: &str) -> bool {
    let stem = name.trim_end_matches(|c: char| c.is_ascii_digit());
    matches!(stem, "q" | "tau" | "qd" | "qdd")
}

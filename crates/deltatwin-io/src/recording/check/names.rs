//! Names of the columns.

use deltatwin::machine::{Joint, Mechanism};
use deltatwin::recording::Channel;

/// Names of the required columns: time, and angle and torque of every axis.
pub(in crate::recording) fn required(axes: usize) -> impl Iterator<Item = String> {
    let of = move |channel: fn(usize) -> Channel| (0..axes).map(move |k| channel(k).to_string());
    std::iter::once("t".to_string()).chain(of(Channel::Angle)).chain(of(Channel::Torque))
}

/// Machine whose axes have columns: a single axis if only axis 1 has any, a delta robot without telescope if axis 4 has
/// none.
pub(in crate::recording) fn machine(has: impl Fn(&str) -> bool) -> Mechanism {
    let axis = |k: usize| has(&Channel::Angle(k).to_string()) || has(&Channel::Torque(k).to_string());
    match (axis(0), axis(1) || axis(2), axis(3)) {
        (true, false, false) => Mechanism::axis(Joint::Revolute),
        (_, true, false) => Mechanism::delta(false),
        _ => Mechanism::default(),
    }
}

/// Whether a column belongs to an axis beyond the first `axes`.
pub(in crate::recording) fn foreign(name: &str, axes: usize) -> bool {
    Channel::named(name).is_some_and(|channel| channel.family().is_of_axes() && channel.index() >= axes)
}

/// Whether the name is that of a known column.
pub(in crate::recording) fn known(name: &str) -> bool {
    name == "t" || Channel::named(name).is_some()
}

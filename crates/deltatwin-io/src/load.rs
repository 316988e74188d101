//! The table `[load]` of a setup or scenario: what a single axis carries.

use std::fmt::Write as _;

use deltatwin::machine::Load;
use serde::Deserialize;
use toml::Spanned;

use crate::source::{Checked, Interval, Source};

/// Keys of the table.
#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct Keys {
    mass: Option<Spanned<f64>>,
    radius: Option<Spanned<f64>>,
    force: Option<Spanned<f64>>,
    torque: Option<Spanned<f64>>,
}

/// Reads the table.
///
/// # Errors
/// The first number outside its range, with its position.
pub(crate) fn read(file: &Source, keys: &Keys) -> Checked<Load> {
    let number =
        |key: &str, value: &Option<Spanned<f64>>, interval| file.maybe(&format!("load.{key}"), value, interval);
    let effort = |unit| Interval(-1e6, 1e6, unit);
    Ok(Load {
        mass: number("mass", &keys.mass, Interval(0.0, 1e5, "kg"))?.unwrap_or(0.0),
        radius: number("radius", &keys.radius, Interval(-100.0, 100.0, "m"))?,
        force: number("force", &keys.force, effort("N"))?.unwrap_or(0.0),
        torque: number("torque", &keys.torque, effort("N·m"))?.unwrap_or(0.0),
    })
}

/// The table as TOML, which reads back without loss; empty without a load.
pub(crate) fn to_toml(load: &Load) -> String {
    if load.is_none() {
        return String::new();
    }
    let mut text = String::from("\n[load] # of the axis, against positive motion\n");
    let Load { mass, radius, force, torque } = load;
    let numbers = [("mass", *mass, "kg, hangs"), ("force", *force, "N"), ("torque", *torque, "N·m")];
    for (key, value, unit) in numbers.into_iter().filter(|(_, value, _)| *value != 0.0) {
        let _ = writeln!(text, "{key} = {value:?} # {unit}");
    }
    if let Some(radius) = radius {
        let _ = writeln!(text, "radius = {radius:?} # m, of the drum");
    }
    text
}

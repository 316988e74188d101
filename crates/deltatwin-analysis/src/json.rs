//! Parts of results as JSON.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use deltatwin::identification::{Estimate, HeldOut};
use deltatwin::recording::Channel;

/// A path as JSON.
pub fn path(path: &Path) -> Value {
    json!(path.display().to_string())
}

/// Paths as JSON.
pub fn paths(files: &[PathBuf]) -> Value {
    files.iter().map(|f| path(f)).collect()
}

/// Estimates as `{name: {value, std, unit}}`; value and standard error are null if the data do not determine the
/// parameter individually.
pub fn estimates(parameters: &[Estimate]) -> Value {
    let entry = |p: &Estimate| {
        let (value, std) = if p.identified() { (Some(p.value), Some(p.std)) } else { (None, None) };
        (p.name.clone(), json!({"value": value, "std": std, "unit": p.unit.to_string()}))
    };
    Value::Object(parameters.iter().map(entry).collect())
}

/// Inserts per-channel values into a JSON object: the axes as `key`, the strut forces as `strut_<key>`.
pub fn insert_channels(object: &mut Map<String, Value>, key: &str, channels: &[Channel], values: &[f64]) {
    let axes = channels.iter().take_while(|c| c.drive().is_some()).count().min(values.len());
    object.insert(key.into(), json!(values[..axes]));
    if values.len() > axes {
        object.insert(format!("strut_{key}"), json!(values[axes..]));
    }
}

/// Inserts the errors on held-out data into a JSON object, and the noise there; both null without such data.
pub fn insert_held_out(object: &mut Map<String, Value>, channels: &[Channel], held_out: Option<&HeldOut>) {
    match held_out {
        Some(h) => {
            insert_channels(object, "held_out_rms", channels, &h.rms);
            insert_channels(object, "held_out_noise_floor", channels, &h.noise_floor);
        }
        None => object.extend(["held_out_rms", "held_out_noise_floor"].map(|key| (key.into(), Value::Null))),
    }
}

/// Names of channels as JSON.
pub fn channel_names(channels: &[Channel]) -> Value {
    channels.iter().map(|c| json!(c.to_string())).collect()
}

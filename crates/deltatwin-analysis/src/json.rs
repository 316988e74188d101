//! Parts of results as JSON.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use deltatwin::identification::repeats::{Drift, Repeats, Share};
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

/// What repeats of a residual from lap to lap; null where no motion repeats.
pub fn repeats(repeats: Option<&Repeats>) -> Value {
    let Some(all) = repeats else { return Value::Null };
    let channel = |s: &Share| {
        let change = s.drift.map(|drift| match drift {
            Drift::Friction(x) => json!({"of": "friction", "value": x}),
            Drift::Mean(x) => json!({"of": "mean", "value": x}),
            Drift::Other(x) => json!({"of": "other", "value": x}),
        });
        json!({
            "channel": s.channel.to_string(),
            "residual": s.parts.rms,
            "repeats": s.parts.repeats.0,
            "repeats_std": s.parts.repeats.1,
            "noise": s.parts.noise.0,
            "noise_std": s.parts.noise.1,
            "drift": s.parts.drift,
            "change": change,
            "is_floor": s.floor.is_some(),
            "sentence": s.sentence(),
        })
    };
    let channels: Vec<Value> = all.channels.iter().map(channel).collect();
    json!({"laps": all.laps, "recordings": all.recordings, "period": all.period, "channels": channels})
}

/// Names of channels as JSON.
pub fn channel_names(channels: &[Channel]) -> Value {
    channels.iter().map(|c| json!(c.to_string())).collect()
}

//! A campaign as a folder: `measurement.csv`, `validation.csv` with their setups, `truth.json`, `answer.json`.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};
use thiserror::Error;

use super::campaign::{Campaign, Case};
use super::judge::{Answer, Truth};
use super::outside::Outside;
use super::size::Hidden;
use deltatwin::dynamics::Plant;
use deltatwin::effects::Role;
use deltatwin::effects::formula::Place;
use deltatwin_io::file::{self, WriteError, replace_text};

/// File of the hidden effects.
pub const TRUTH: &str = "truth.json";
/// File of the diagnosis' answer.
pub const ANSWER: &str = "answer.json";
/// Recording for the diagnosis.
pub const MEASUREMENT: &str = "measurement";
/// Recording for the validation.
pub const VALIDATION: &str = "validation";

/// Reason why a campaign's folder cannot be used.
#[derive(Debug, Error)]
pub enum FolderError {
    /// The file system failed.
    #[error("{file}: {source}", file = .file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Cause.
        source: std::io::Error,
    },
    /// A recording cannot be written.
    #[error(transparent)]
    Write(#[from] WriteError),
    /// A file has unexpected content.
    #[error("{file}: {problem}; expected {expected}", file = .file.display())]
    Content {
        /// The file.
        file: PathBuf,
        /// Problem.
        problem: String,
        /// Expected content.
        expected: &'static str,
    },
}

/// Writes a campaign; the truth is written last and marks a complete folder.
///
/// # Errors
/// If a file cannot be written.
pub fn write(folder: &Path, campaign: &Campaign) -> Result<(), FolderError> {
    std::fs::create_dir_all(folder).map_err(|source| FolderError::Io { file: folder.into(), source })?;
    for (name, recording) in [(MEASUREMENT, &campaign.measurement), (VALIDATION, &campaign.validation)] {
        deltatwin_io::recording::write(recording, &folder.join(format!("{name}.csv")))?;
    }
    write_truth(folder, &truth(campaign, &campaign.case))
}

/// Writes the truth only.
///
/// # Errors
/// If the file cannot be written.
pub fn write_truth(folder: &Path, truth: &Value) -> Result<(), FolderError> {
    std::fs::create_dir_all(folder).map_err(|source| FolderError::Io { file: folder.into(), source })?;
    write_json(&folder.join(TRUTH), truth)
}

/// Truth of a campaign with the noise of `case`.
pub fn truth(campaign: &Campaign, case: &Case) -> Value {
    let plant = Plant::new(&campaign.robot, &campaign.measurement.setup);
    let hidden = |name: &str| campaign.hidden.iter().any(|h| h.active.effect.name() == name);
    let own = plant.parameters().into_iter().filter(|p| p.role != Role::Fixed && !hidden(p.param.effect));
    json!({
        "effects": campaign.hidden.iter().map(effect).collect::<Vec<_>>(),
        "outside": case.outside.map(|law| outside(law, campaign.unspanned)),
        "attainable": campaign.attainable,
        "size": case.size.name(),
        "seed": case.seed,
        "noise": case.noise.name(),
        "motion": case.motion.name(),
        "strut_sensor": case.strut_sensor,
        "payload": case.payload,
        "duration": case.duration,
        "parameters": own.map(|p| (p.name, json!(p.value))).collect::<Map<String, Value>>(),
    })
}

fn outside(law: Outside, unspanned: Option<f64>) -> Value {
    let source = law.source().map(|published| json!({"work": published.work, "place": published.place}));
    json!({"name": law.name, "at": law.at, "law": law.law, "source": source, "unspanned": unspanned})
}

fn effect(hidden: &Hidden) -> Value {
    let active = &hidden.active;
    let value = |(entry, value): (deltatwin::effects::Entry, &f64)| (entry.name, json!(value));
    json!({
        "name": active.effect.name(),
        "parameters": active.entries().into_iter().zip(&active.values).map(value).collect::<Map<String, Value>>(),
        "sized_by": hidden.rise.channel.to_string(),
        "rise": hidden.rise.ratios.iter().map(|(c, r)| (c.to_string(), json!(r))).collect::<Map<String, Value>>(),
        "limited": hidden.rise.limited,
    })
}

/// Reads the truth of a campaign, which may have been written by other software.
///
/// # Errors
/// If the file cannot be read or has no list of effects.
pub fn read_truth(folder: &Path) -> Result<Truth, FolderError> {
    let file = folder.join(TRUTH);
    let value = read_json(&file)?;
    let bad = |problem: &str, expected| FolderError::Content { file: file.clone(), problem: problem.into(), expected };
    let effects = value.get("effects").and_then(Value::as_array);
    let effects = effects.ok_or_else(|| bad("has no list `effects`", "{\"effects\": [{\"name\": …}], …}"))?;
    let mut truth = Truth {
        size: value.get("size").and_then(Value::as_str).map(str::to_string),
        noise: value.get("noise").and_then(Value::as_str).map(str::to_string),
        attainable: value.get("attainable").and_then(Value::as_f64),
        ..Truth::default()
    };
    let outside = |key: &str| value.get("outside").and_then(|o| o.get(key));
    truth.place = outside("at").and_then(Value::as_str).and_then(Place::named).map(Place::region);
    truth.law = outside("name").and_then(Value::as_str).map(str::to_string);
    truth.unspanned = outside("unspanned").and_then(Value::as_f64);
    for effect in effects {
        let name = effect.get("name").and_then(Value::as_str);
        let name = name.ok_or_else(|| bad("has an effect without `name`", "the name of every hidden effect"))?;
        truth.effects.push(name.into());
        let rise = |e: &Value| e.get("rise")?.get(e.get("sized_by")?.as_str()?)?.as_f64();
        truth.rise = truth.rise.or_else(|| rise(effect));
        truth.limited |= effect.get("limited").and_then(Value::as_bool).unwrap_or(false);
        for (key, v) in effect.get("parameters").and_then(Value::as_object).into_iter().flatten() {
            if let Some(v) = v.as_f64() {
                truth.values.push((format!("{name}.{key}"), v));
            }
        }
    }
    Ok(truth)
}

/// Writes the answer of the diagnosis.
///
/// # Errors
/// If the file cannot be written.
pub fn write_answer(folder: &Path, answer: &Answer) -> Result<(), FolderError> {
    let value = serde_json::to_value(answer).map_err(|e| FolderError::Content {
        file: folder.join(ANSWER),
        problem: e.to_string(),
        expected: "numbers",
    })?;
    write_json(&folder.join(ANSWER), &value)
}

/// Answer of the diagnosis; `None` if there is none yet.
///
/// # Errors
/// If the file cannot be read or has unexpected content.
pub fn read_answer(folder: &Path) -> Result<Option<Answer>, FolderError> {
    let file = folder.join(ANSWER);
    if !file.is_file() {
        return Ok(None);
    }
    let answer = serde_json::from_value(read_json(&file)?).map_err(|e| FolderError::Content {
        file: file.clone(),
        problem: e.to_string(),
        expected: "an answer as `deltatwin exam` writes it; delete the file to judge anew",
    })?;
    Ok(Some(answer))
}

/// Folders in `root` that contain a campaign, sorted by name; `root` itself if it is one.
///
/// # Errors
/// If a folder cannot be read.
pub fn campaigns(root: &Path) -> Result<Vec<PathBuf>, FolderError> {
    let io = |source| FolderError::Io { file: root.into(), source };
    if root.join(TRUTH).is_file() {
        return Ok(vec![root.into()]);
    }
    let mut found = Vec::new();
    for entry in std::fs::read_dir(root).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.join(TRUTH).is_file() {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

fn write_json(file: &Path, value: &Value) -> Result<(), FolderError> {
    let io = |source| FolderError::Io { file: file.into(), source };
    let text = serde_json::to_string_pretty(value).map_err(|e| io(e.into()))?;
    replace_text(file, &(text + "\n")).map_err(io)
}

fn read_json(file: &Path) -> Result<Value, FolderError> {
    let text = file::text(file).map_err(|source| FolderError::Io { file: file.into(), source })?;
    serde_json::from_str(&text).map_err(|e| FolderError::Content {
        file: file.into(),
        problem: format!("is no JSON: {e}"),
        expected: "{\"effects\": [{\"name\": …}], …}",
    })
}

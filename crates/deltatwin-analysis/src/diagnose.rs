//! A diagnosis as JSON.

use std::path::Path;

use serde_json::{Map, Value, json};

use crate::json::{channel_names, estimates, insert_channels, path, repeats};
use crate::{budget, sentence, unexplained};
use deltatwin::diagnosis::confidence::{Confidence, Truth};
use deltatwin::diagnosis::{CandidateReport, Diagnosis, Named, NextExperiment};

/// The diagnosis as a JSON object; `model` and `scenario` are the written files.
pub fn json(d: &Diagnosis, model: Option<&Path>, scenario: Option<&Path>) -> Value {
    let mut object = Map::new();
    object.insert("verdict".into(), json!(d.verdict.to_string()));
    object.insert("sentence".into(), json!(sentence::verdict(d)));
    object.insert("unknown_beside".into(), json!(d.unknown_beside()));
    object.insert("left".into(), json!(d.left.largest()));
    object.insert("left_at".into(), left(d));
    object.insert("channels".into(), channel_names(&d.channels));
    insert_channels(&mut object, "noise_floor", &d.channels, &d.noise_floor);
    insert_channels(&mut object, "rms_before", &d.channels, &d.rms_before);
    insert_channels(&mut object, "rms_after", &d.channels, &d.rms_after);
    object.insert("repeats".into(), repeats(d.repeats.as_ref()));
    object.insert("effects".into(), d.effects.iter().map(effect).collect());
    object.insert("candidates".into(), d.candidates.iter().map(candidate).collect());
    object.insert("indistinguishable".into(), json!(d.indistinguishable));
    object.insert("unseen".into(), json!(d.unseen));
    object.insert("unseen_parameters".into(), json!(d.unseen_parameters));
    object.insert("not_testable".into(), not_testable(d));
    object.insert("not_tried".into(), json!(d.not_tried));
    object.insert("smoothing".into(), json!(d.smoothing));
    object.insert("too_few".into(), json!(d.too_few.map(|few| json!({"rows": few.rows, "needed": few.needed}))));
    object.insert("sampling_lag".into(), json!(d.sampling_lag));
    object.insert("next_experiment".into(), d.next_experiment.as_ref().map_or(Value::Null, |e| next(e, scenario)));
    object.insert("budget".into(), budget::json(&d.budget));
    object.insert("parameters_before".into(), estimates(&d.parameters[0]));
    object.insert("parameters_after".into(), estimates(&d.parameters[1]));
    let unexplained = d.unexplained.as_ref().map(|u| unexplained::json(u, d.explained_with_formula()));
    object.insert("unexplained".into(), unexplained.unwrap_or(Value::Null));
    object.insert("model".into(), model.map_or(Value::Null, path));
    Value::Object(object)
}

/// The residual above the noise: channels with their ratio, and a description where no formula was found.
fn left(d: &Diagnosis) -> Value {
    let channel = |(channel, ratio)| json!({"channel": format!("{channel}"), "ratio": ratio});
    let channels: Vec<(deltatwin::recording::Channel, f64)> = d.left.channels(&d.channels);
    let looks = d.left.sight.as_ref();
    let looks = looks.map(|r| json!({"location": r.location, "shape": unexplained::shape(&r.shape, r.unit)}));
    let pattern = |p: &deltatwin::comparison::Finding| json!({"channel": p.channel.to_string(), "place": p.place, "share": p.share, "sentence": p.sentence});
    let patterns = d.left.patterns.iter().map(pattern).collect::<Vec<_>>();
    json!({"channels": channels.into_iter().map(channel).collect::<Vec<_>>(), "looks": looks, "patterns": patterns, "is_noise": d.left.is_noise})
}

fn effect(e: &Named) -> Value {
    json!({
        "name": e.name,
        "probability": e.confidence.probability(),
        "confusion": confusion(&e.confidence),
        "explained": e.explained,
        "parameters": estimates(&e.parameters),
    })
}

fn candidate(c: &CandidateReport) -> Value {
    json!({
        "name": c.name,
        "probability": c.probability,
        "explained": c.explained,
        "alone": c.explained,
        "p_adjusted": c.p_adjusted,
        "visible": c.visible,
        "absorbed_by": c.absorbed_by,
        "outcome": c.standing.to_string(),
    })
}

/// Untestable candidates with the reason.
fn not_testable(d: &Diagnosis) -> Value {
    let reason = |c: &CandidateReport| Some(json!({"name": c.name, "reason": c.untestable?.to_string()}));
    let twin_only = deltatwin::diagnosis::candidates::Untestable::TwinOnly.to_string();
    let beyond = d.twin_only.iter().map(|name| json!({"name": name, "reason": twin_only}));
    d.candidates.iter().filter_map(reason).chain(beyond).collect()
}

/// The proposed experiment.
fn next(e: &NextExperiment, scenario: Option<&Path>) -> Value {
    let other = |(kind, chance, seconds): &(&str, f64, Option<f64>)| json!({"kind": kind, "chance": chance, "seconds": seconds});
    json!({
        "what": e.what,
        "kind": e.kind,
        "pair": e.pair,
        "noncentrality": e.noncentrality,
        "chance": e.chance,
        "duration": e.duration,
        "seconds": e.seconds,
        "scenario": scenario.map(path),
        "others": e.others.iter().map(other).collect::<Vec<_>>(),
    })
}

fn confusion(c: &Confidence) -> Value {
    let truth = |t: &Truth| json!({ "truth": t.name, "said": t.said, "probability": t.probability });
    json!({ "draws": c.draws, "truths": c.truths.iter().map(truth).collect::<Vec<_>>() })
}

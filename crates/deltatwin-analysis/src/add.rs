//! An addition as JSON.

use std::path::Path;

use serde_json::{Map, Value};

use crate::budget;
use crate::json::{channel_names, estimates, insert_channels, path};
use deltatwin::diagnosis::budget::Budget;
use deltatwin::diagnosis::{Addition, Diagnosis, parameters_of};
use deltatwin::identification::Estimate;

/// The addition of one effect as a JSON object; `model` is the written file.
pub fn json(addition: &Addition, model: Option<&Path>) -> Value {
    let parameters = parameters_of(&addition.fit, &addition.effect);
    let errors = [&addition.parameters_before[..], &addition.fit.parameters];
    object(addition.effect.clone(), &addition.budget, &parameters, errors, model)
}

/// The addition of all effects that a diagnosis names, in the form of [`json`]; null if it names none. `effect` then has
/// all names.
pub fn of_diagnosis(d: &Diagnosis, model: Option<&Path>) -> Value {
    let added: Vec<&str> = d.budget.effects.iter().map(|(name, _)| name.as_str()).collect();
    if added.is_empty() {
        return Value::Null;
    }
    let parameters: Vec<Estimate> = d.effects.iter().flat_map(|e| e.parameters.clone()).collect();
    object(added.join(", "), &d.budget, &parameters, [&d.parameters[0], &d.parameters[1]], model)
}

fn object(
    effect: String,
    budget: &Budget,
    parameters: &[Estimate],
    [before, after]: [&[Estimate]; 2],
    model: Option<&Path>,
) -> Value {
    let mut object = Map::new();
    object.insert("effect".into(), effect.into());
    object.insert("channels".into(), channel_names(&budget.channels));
    insert_channels(&mut object, "rms_before", &budget.channels, &budget.rms_before);
    insert_channels(&mut object, "rms_after", &budget.channels, budget.rms_after());
    insert_channels(&mut object, "noise_floor", &budget.channels, &budget.noise_floor);
    object.insert("parameters".into(), estimates(parameters));
    object.insert("budget".into(), budget::json(budget));
    object.insert("parameters_before".into(), estimates(before));
    object.insert("parameters_after".into(), estimates(after));
    object.insert("model".into(), model.map_or(Value::Null, path));
    Value::Object(object)
}

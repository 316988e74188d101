//! Unknown effects as JSON.

use serde_json::{Value, json};

use deltatwin::diagnosis::Unexplained;
use deltatwin::diagnosis::unknown::Shape;
use deltatwin::effects::formula::Place;
use deltatwin::identification::Estimate;
use deltatwin::machine::Unit;

/// An unknown effect as JSON; `explained` is the share of the explainable error of the named effects and the formula.
pub fn json(u: &Unexplained, explained: f64) -> Value {
    let term = |(place, law, c): &(Place, String, Estimate)| json!({"name": c.name, "at": place.name(), "law": law, "coefficient": c.value, "std": finite(c.std), "unit": c.unit.to_string()});
    let s = &u.shape;
    json!({
        "location": u.location,
        "shares": u.shares.iter().map(|(place, share)| json!({"place": place, "share": share})).collect::<Vec<_>>(),
        "left": u.left,
        "explained": explained,
        "beside_named": u.beside_named,
        "in_model": u.replaces,
        "rms": u.residuals.rms,
        "shape": shape(s, u.unit),
        "parity": s.parity(),
        "odd_in_speed": s.odd,
        "period": s.period.map(|(value, variable)| json!({"value": value, "variable": variable})),
        "drift": s.drift,
        "jump": s.jump,
        "mean_power": s.power,
        "terms": u.terms.iter().map(term).collect::<Vec<_>>(),
        "formula": u.toml(),
    })
}

/// A shape as JSON.
pub fn shape(s: &Shape, unit: Unit) -> Value {
    json!({"variable": s.variable, "along_motion": s.along, "variable_unit": s.variable_unit(), "unit": unit.to_string(), "x": s.x, "mean": s.mean, "low": s.low, "high": s.high})
}

fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

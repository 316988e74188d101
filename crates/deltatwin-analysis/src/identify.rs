//! A fit and its errors, and it as JSON.

use std::path::Path;

use serde_json::{Map, Value, json};

use crate::json::{channel_names, estimates, insert_channels, insert_held_out, path};
use deltatwin::identification::consistency::min_eigenvalue;
use deltatwin::identification::fit::{Moved, Unidentified};
use deltatwin::identification::{BaseParameter, Fit, HeldOut, LimbTest};
use deltatwin::machine::bodies::{Inertia, body_name};
use deltatwin::model::Model;
use deltatwin::recording::Channel;

/// A fit with the errors that it leaves.
#[derive(Clone)]
pub struct Identification {
    /// The fit.
    pub fitted: Fit,
    /// Channels, in the order of the following arrays.
    pub channels: Vec<Channel>,
    /// Pooled standard deviation of the sensor noise, N·m or N.
    pub noise_floor: Vec<f64>,
    /// Errors on held-out data; `None` without such data.
    pub held_out: Option<HeldOut>,
    /// Whether the data demand limbs with their own parameters; `None` if not asked or without limbs.
    pub limbs: Option<LimbTest>,
}

impl Identification {
    /// RMS residual and noise floor on the held-out data, or on the fitted ones without any.
    pub fn judged(&self) -> (&[f64], &[f64]) {
        let fitted = (&self.fitted.residuals.rms[..], &self.noise_floor[..]);
        self.held_out.as_ref().map_or(fitted, |h| (&h.rms, &h.noise_floor))
    }

    /// The fit as a JSON object; `model` is the written file.
    pub fn json(&self, model: Option<&Path>) -> Value {
        let mut object = Map::new();
        object.insert("parameters".into(), estimates(&self.fitted.parameters));
        object.insert("base_parameters".into(), base(&self.fitted.base));
        let structure = &self.fitted.structure;
        object.insert("rank".into(), json!(structure.rank));
        object.insert("condition".into(), json!(structure.condition()));
        object.insert("singular_values".into(), json!(structure.singular_values.as_slice()));
        object.insert("unidentified".into(), unidentified(&self.fitted));
        object.insert("channels".into(), channel_names(&self.channels));
        insert_channels(&mut object, "rms", &self.channels, &self.fitted.residuals.rms);
        insert_held_out(&mut object, &self.channels, self.held_out.as_ref());
        insert_channels(&mut object, "noise_floor", &self.channels, &self.noise_floor);
        object.insert("min_pseudo_inertia_eigenvalue".into(), json!(min_eigenvalue(&self.fitted.model.bodies)));
        object.insert("pseudo_inertia_eigenvalues".into(), eigenvalues(&self.fitted.model));
        object.insert("consistency".into(), correction(&self.fitted));
        object.insert("limbs".into(), self.limbs.as_ref().map_or(Value::Null, |test| self.limbs_json(test)));
        object.insert("model".into(), model.map_or(Value::Null, path));
        Value::Object(object)
    }

    fn limbs_json(&self, test: &LimbTest) -> Value {
        let word = |own: bool| if own { "own" } else { "alike" };
        let differing: Map<String, Value> =
            test.differing.iter().map(|one| (one.name.clone(), json!(one.values))).collect();
        json!({
            "parameters": word(self.fitted.model.link_parameters.each_limb),
            "demanded": word(test.demanded),
            "error_own_over_alike": test.error,
            "t": test.t,
            "held_out": test.held_out,
            "differing": differing,
        })
    }
}

/// Smallest pseudo-inertia eigenvalue of every body with non-zero inertia.
fn eigenvalues(model: &Model) -> Value {
    let real = model.bodies.0.iter().enumerate().filter(|(_, b)| **b != Inertia::ZERO);
    Value::Object(real.map(|(b, inertia)| (body_name(b), json!(inertia.min_eigenvalue()))).collect())
}

/// The consistency correction and the moved parameters; null without a correction.
pub fn correction(fitted: &Fit) -> Value {
    let Some(c) = fitted.correction else { return Value::Null };
    let one =
        |m: &Moved| json!({"name": m.name, "free": m.free, "value": m.value, "std": m.std, "unit": m.unit.to_string()});
    let moved: Vec<Value> = fitted.moved.iter().map(one).collect();
    json!({"cost": c.cost, "duality_gap": c.gap, "moved": moved})
}

/// Parameters that the data do not determine, with the reason.
pub fn unidentified(fitted: &Fit) -> Value {
    let one = |u: &Unidentified| json!({"name": u.name, "reason": u.reason.to_string()});
    fitted.unidentified.iter().map(one).collect()
}

fn base(parameters: &[BaseParameter]) -> Value {
    let entry = |b: &BaseParameter| {
        let content =
            json!({"value": b.value, "std": b.std, "unit": b.unit.to_string(), "combination": b.combination()});
        (b.name.clone(), content)
    };
    Value::Object(parameters.iter().map(entry).collect())
}

//! The catalogue of effects.

use deltatwin::effects as library;
use deltatwin::effects::{REGISTRY, Role};
use pyo3::prelude::*;

/// A parameter of an effect.
#[pyclass(frozen, get_all, module = "deltatwin")]
#[derive(Clone)]
pub struct Parameter {
    pub name: String,
    pub unit: String,
    pub usual: f64,
    pub low: f64,
    pub high: f64,
    pub role: &'static str,
}

#[pymethods]
impl Parameter {
    fn __repr__(&self) -> String {
        format!("Parameter({} / {}, usual={}, {} to {})", self.name, self.unit, self.usual, self.low, self.high)
    }
}

/// An effect of the catalogue.
#[pyclass(frozen, get_all, module = "deltatwin")]
#[derive(Clone)]
pub struct Effect {
    pub name: &'static str,
    pub summary: &'static str,
    pub law: &'static str,
    pub shows: &'static str,
    pub source: &'static str,
    pub acts_on: &'static str,
    pub identifiable: bool,
    pub parameters: Vec<Parameter>,
}

impl From<&dyn library::Effect> for Effect {
    fn from(effect: &dyn library::Effect) -> Self {
        let spec = effect.spec();
        let role = |role: Role| match role {
            Role::Linear => "linear",
            Role::Shape => "shape",
            Role::Fixed => "fixed",
        };
        let parameter = |p: &library::Parameter| Parameter {
            name: p.name.to_string(),
            unit: p.unit.to_string(),
            usual: p.default,
            low: p.range.0,
            high: p.range.1,
            role: role(p.role),
        };
        Self {
            name: spec.name,
            summary: spec.about.summary,
            law: spec.about.law,
            shows: spec.about.shows,
            source: spec.about.source,
            acts_on: spec.acts_on.describe(),
            identifiable: spec.identifiable,
            parameters: spec.parameters.iter().map(parameter).collect(),
        }
    }
}

#[pymethods]
impl Effect {
    fn __repr__(&self) -> String {
        format!("Effect({}: {})", self.name, self.summary)
    }
}

/// The catalogue: every effect that models, the twin and the diagnosis know.
#[pyfunction]
pub fn effects() -> Vec<Effect> {
    REGISTRY.iter().map(|e| Effect::from(&**e)).collect()
}

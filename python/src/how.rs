//! Options of a fit, as the keywords of `identify` and `identify_payload` state them.

use std::collections::BTreeMap;

use deltatwin::identification::Method;
use deltatwin::identification::estimator::PRIOR_INFORMATION;
use deltatwin::identification::fit::{Consistency, Options, Weighing};
use deltatwin::identification::regularisation::GroupWeight;
use deltatwin::machine::{BodyParameters, LinkParameters};
use deltatwin::model;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::errors;
use crate::model::Model;

/// Keywords that choose by a word.
pub struct Words {
    pub weighing: String,
    pub method: String,
    pub limbs: String,
    pub bodies: String,
    pub derivatives: String,
}

/// How to fit.
pub struct How {
    /// Effects whose parameters are known.
    pub hold: Vec<String>,
    /// Whether outliers are downweighted.
    pub robust: bool,
    /// How rates and accelerations come from the angles.
    pub derivatives: Method,
    weighing: Weighing,
    consistency: Consistency,
    links: LinkParameters,
    prior: Option<model::Model>,
    information: f64,
    weights: Vec<GroupWeight>,
}

impl How {
    /// The options that the keywords state.
    ///
    /// # Errors
    /// `ValueError` for a word that is none of the known ones.
    pub fn new(words: &Words, hold: Vec<String>, robust: bool) -> PyResult<Self> {
        let links = LinkParameters {
            each_limb: word("limbs", &words.limbs, &[("alike", false), ("each", true)])?,
            bodies: word(
                "bodies",
                &words.bodies,
                &[
                    ("symmetric", BodyParameters::Symmetric),
                    ("aligned", BodyParameters::Aligned),
                    ("complete", BodyParameters::Complete),
                ],
            )?,
        };
        let derivatives = [
            ("paper", Method::Paper),
            ("polynomial", Method::Polynomial),
            ("smoother", Method::Smoother),
            ("reversals", Method::Reversals),
        ];
        let weighings = [("noise", Weighing::Noise), ("maximum", Weighing::Maximum)];
        let methods = [("cones", Consistency::Cones), ("log_cholesky", Consistency::LogCholesky)];
        Ok(Self {
            hold,
            robust,
            derivatives: word("derivatives", &words.derivatives, &derivatives)?,
            weighing: word("weighing", &words.weighing, &weighings)?,
            consistency: word("method", &words.method, &methods)?,
            links,
            prior: None,
            information: PRIOR_INFORMATION,
            weights: Vec::new(),
        })
    }

    /// The options with a prior, the weight of the regularisation, and weights of groups of parameters.
    ///
    /// # Errors
    /// `ValueError` for a weight that is not positive.
    pub fn regularised(
        self,
        prior: Option<PyRef<'_, Model>>,
        information: f64,
        gamma: Option<BTreeMap<String, f64>>,
    ) -> PyResult<Self> {
        let positive = |what: &str, weight: f64| {
            let refused = || PyValueError::new_err(format!("{what} is {weight}; expected a number above 0"));
            (weight > 0.0 && weight.is_finite()).then_some(weight).ok_or_else(refused)
        };
        let weight = |(group, weight): (String, f64)| {
            let weight = positive(&format!("gamma[{group:?}]"), weight)?;
            Ok(GroupWeight { group, weight })
        };
        let prior = prior.map(|prior| self.of((*prior.inner).clone()));
        Ok(Self {
            prior,
            information: positive("regularisation", information)?,
            weights: gamma.unwrap_or_default().into_iter().map(weight).collect::<PyResult<_>>()?,
            ..self
        })
    }

    /// The model with the parametrisation of the links that is asked for.
    pub fn of(&self, model: model::Model) -> model::Model {
        model::Model { link_parameters: self.links, ..model }
    }

    /// Refuses held effects that the model does not have.
    ///
    /// # Errors
    /// `ModelError`.
    pub fn check_hold(&self, py: Python, model: &model::Model) -> PyResult<()> {
        let own: Vec<&str> = model.effects.iter().map(|a| a.effect.name()).chain(["rigid_bodies"]).collect();
        let foreign = self.hold.iter().find(|name| !own.contains(&name.as_str()));
        foreign.map_or(Ok(()), |name| {
            let text = format!("hold: the model has no effect {name:?}; expected one of {}", own.join(", "));
            Err(errors::model_error(py, text))
        })
    }

    /// Options of the fit, which `stop` ends.
    pub fn options<'a>(&'a self, stop: &'a (dyn Fn() -> bool + Sync)) -> Options<'a> {
        Options {
            weighing: self.weighing,
            robust: self.robust,
            consistency: self.consistency,
            prior: self.prior.as_ref(),
            prior_information: Some(self.information),
            weights: &self.weights,
            fixed: &self.hold,
            stop: Some(stop),
            ..Options::default()
        }
    }
}

/// What a word stands for.
fn word<T: Copy>(what: &str, given: &str, all: &[(&str, T)]) -> PyResult<T> {
    all.iter().find(|(name, _)| *name == given).map(|(_, meaning)| *meaning).ok_or_else(|| {
        let known: Vec<&str> = all.iter().map(|(name, _)| *name).collect();
        PyValueError::new_err(format!("{what} is {given:?}; expected one of {}", known.join(", ")))
    })
}

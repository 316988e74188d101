//! Identification of the payload with a known robot (section 2.3.1 of the paper, End-effector).
//!
//! All parameters except those of the payload are held, so an error of the model becomes an error of the payload: the
//! empty robot should be identified first. All ten parameters of the payload are estimated. The prior is the stated
//! setup with its centre of mass and its tensor about the centre of mass; values that the data do not determine are
//! taken from it, at the estimated mass and centre.

use nalgebra::Vector3;
use std::sync::Arc;

use super::fit::{Fit, FitError, Options, fit_with};
use super::{Dataset, Estimate};
use crate::effects::{ActiveEffect, Part, payload};
use crate::machine::{Inertia, Payload, Setup};
use crate::model::Model;

/// Payload with standard errors.
#[derive(Clone)]
pub struct PayloadFit {
    /// Estimated payload in the form of a setup; values that the data do not determine are those of the recording's
    /// setup.
    pub payload: Payload,
    /// Mass, first moments and tensor about the flange centre.
    pub parameters: Vec<Estimate>,
    /// Underlying fit.
    pub fit: Fit,
}

/// Indices of the parameters.
const MASS: usize = 0;
const FIRST: usize = 1;
const TENSOR: usize = 4;
const XX: usize = TENSOR;
const ZZ: usize = TENSOR + 2;
const XZ: usize = TENSOR + 4;
const YZ: usize = TENSOR + 5;

/// Payload with which all `datasets` were recorded; their stated payload is the regularisation value.
///
/// # Errors
/// If a machine has no flange, and as [`fit_with`].
///
/// # Panics
/// If `datasets` is empty.
pub fn identify_payload(
    model: &Model,
    datasets: &[Dataset],
    noise: &[Vec<f64>],
    options: &Options,
) -> Result<PayloadFit, FitError> {
    if let Some(dataset) = datasets.iter().find(|t| !t.plant(model).has(Part::Linkage)) {
        return Err(FitError::NoFlange { recording: dataset.name.clone() });
    }
    let stated = datasets.first().map_or_else(Payload::default, |t| t.setup.payload);
    let empty = |t: &Dataset| Dataset { setup: Setup { payload: Payload::default(), ..t.setup }, ..t.clone() };
    let datasets: Vec<Dataset> = datasets.iter().map(empty).collect();
    let mut others: Vec<String> = datasets[0].plant(model).parameters().iter().map(|p| p.param.effect.into()).collect();
    others.dedup();
    let around = |prior: &Payload| {
        let with = loaded(model, prior);
        fit_with(&with, &datasets, noise, &Options { fixed: &others, prior: Some(&with), ..*options })
    };
    let first = around(&stated)?;
    let fit = around(&completed(&stated, &first.parameters))?;
    Ok(PayloadFit { payload: found(&fit.parameters), parameters: fit.parameters.clone(), fit })
}

/// The model with a payload as an additional effect.
fn loaded(model: &Model, load: &Payload) -> Model {
    let inertia = load.inertia();
    let moments = Payload { tensor: inertia.tensor, ..Payload::default() }.moments();
    let mut with = model.clone();
    let values: [&[f64]; 3] = [&[inertia.mass], inertia.first_moment.as_slice(), &moments];
    with.effects.push(ActiveEffect::new(Arc::new(payload::Payload), &values));
    with
}

/// Payload after a first estimate, with centre of mass and tensor as stated where the data do not determine them.
fn completed(stated: &Payload, estimates: &[Estimate]) -> Payload {
    let seen = |i: usize| estimates[i].identified();
    let first = found(estimates);
    if first.mass <= 0.0 {
        return *stated;
    }
    let com = Vector3::from_fn(|k, _| if seen(FIRST + k) { first.com[k] } else { stated.com[k] });
    let own = found_at(estimates, com);
    let zz = if seen(ZZ) { own.inertia_zz().max(0.0) } else { stated.inertia_zz() };
    // If only the vertical moment was stated, the tensor is scaled as a whole.
    let only_zz = *stated == Payload::new(stated.mass, stated.com, stated.inertia_zz());
    let mut completed = Payload { mass: first.mass, com, ..if only_zz { Payload::new(0.0, com, zz) } else { *stated } };
    completed.tensor[(2, 2)] = zz;
    for (place, (i, j)) in [(XZ, (0, 2)), (YZ, (1, 2))] {
        if seen(place) {
            (completed.tensor[(i, j)], completed.tensor[(j, i)]) = (own.tensor[(i, j)], own.tensor[(i, j)]);
        }
    }
    completed
}

/// Payload with the estimated parameters.
fn found(estimates: &[Estimate]) -> Payload {
    let com = |k: usize| estimates[FIRST + k].value / estimates[MASS].value;
    found_at(estimates, Vector3::new(com(0), com(1), com(2)))
}

/// Payload with the estimated parameters and the given centre of mass.
fn found_at(estimates: &[Estimate], com: Vector3<f64>) -> Payload {
    let mass = estimates[MASS].value;
    let about_flange = Payload::with_tensor(0.0, [0.0; 3], std::array::from_fn(|k| estimates[XX + k].value)).tensor;
    let tensor = about_flange - Inertia::point(mass, com).tensor;
    Payload { mass, com, tensor: 0.5 * (tensor + tensor.transpose()), ..Payload::default() }
}

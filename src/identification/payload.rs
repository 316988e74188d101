//! Identification of the payload with a known robot (paper section 2.3.1, End-effector).
//!
//! Everything but the payload's mass, first moment and Θ_zz stays as the model has it, so an error of the model is an error of the
//! payload: identify the empty robot first.

use nalgebra::Vector3;

use super::fit::{Fit, FitError, Options, fit_with};
use super::{Estimate, Trace};
use crate::dynamics::Plant;
use crate::effects::{ActiveEffect, payload};
use crate::model::Model;
use crate::recording::{Payload, Setup};

/// A payload with standard errors.
#[derive(Clone)]
pub struct PayloadFit {
    /// What was found, as a setup states it; what the data do not determine is as in the recording's setup.
    pub payload: Payload,
    /// Mass, first moments and Θ_zz about the flange's axis.
    pub parameters: Vec<Estimate>,
    /// The fit they come from.
    pub fit: Fit,
}

/// Finds the payload all `traces` were recorded with; their stated payload is the regularisation value.
pub fn identify_payload(
    model: &Model,
    traces: &[Trace],
    noise: &[Vec<f64>],
    options: &Options,
) -> Result<PayloadFit, FitError> {
    let stated = traces.first().map_or_else(Payload::default, |t| t.setup.payload);
    let inertia = stated.inertia();
    let mut with = model.clone();
    let first = inertia.first_moment.as_slice().to_vec();
    with.effects.push(ActiveEffect::new(&payload::Payload, &[&[inertia.mass], &first, &[inertia.tensor[(2, 2)]]]));
    let empty = |t: &Trace| Trace { setup: Setup { payload: Payload::default(), ..t.setup }, ..t.clone() };
    let traces: Vec<Trace> = traces.iter().map(empty).collect();
    let others: Vec<String> =
        Plant::new(model, &traces[0].setup).parameters().iter().map(|p| p.effect.into()).collect();
    let fit = fit_with(&with, &traces, noise, &Options { held: &others, ..*options })?;
    let value = |i: usize| fit.parameters[i].value;
    let mass = value(0);
    let com = Vector3::new(value(1), value(2), value(3)) / mass;
    let inertia_zz = value(4) - mass * (com.x * com.x + com.y * com.y);
    let payload = Payload { mass, com, inertia_zz: inertia_zz.max(0.0) };
    Ok(PayloadFit { payload, parameters: fit.parameters.clone(), fit })
}

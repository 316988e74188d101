//! Recordings given to a fit: datasets with common channels, checked against the model.

use std::ffi::CString;
use std::sync::Arc;

use deltatwin::gate::{combined, examine};
use deltatwin::identification::bandwidth::{bandwidth, narrow};
use deltatwin::identification::zeros::zeros;
use deltatwin::identification::{Dataset, Method, check_together};
use deltatwin::machine::{Mechanism, Unit};
use deltatwin::model;
use deltatwin::recording::Channel;
use pyo3::exceptions::{PyTypeError, PyUserWarning};
use pyo3::prelude::*;

use crate::errors;
use crate::recording::Recording;

/// Recordings for fitting and for validation.
pub struct Data {
    pub datasets: Vec<Dataset>,
    pub held_out: Vec<Dataset>,
}

/// What `of` makes of the recordings of an argument: one, or a sequence of them.
///
/// # Errors
/// `TypeError` for anything else.
pub fn each<T: Send>(
    object: Option<&Bound<'_, PyAny>>,
    name: &str,
    of: impl Fn(&Recording) -> T + Sync,
) -> PyResult<Vec<T>> {
    let Some(object) = object else { return Ok(Vec::new()) };
    let py = object.py();
    let made = |recording: &Bound<'_, Recording>| {
        let own = recording.get();
        py.detach(|| of(own))
    };
    if let Ok(one) = object.cast::<Recording>() {
        return Ok(vec![made(one)]);
    }
    let wrong = || PyTypeError::new_err(format!("{name}: expected a Recording, or a sequence of them"));
    let mut all = Vec::new();
    for item in object.try_iter().map_err(|_| wrong())? {
        all.push(made(item?.cast::<Recording>().map_err(|_| wrong())?));
    }
    Ok(all)
}

impl Data {
    /// The recordings restricted to their common channels, after a check that they can be of the model's machine.
    ///
    /// # Errors
    /// `DataError` if there are none, if one is too short, of another machine or another configuration, or if `gate` and its signs, factors,
    /// order or zeros do not fit the model.
    pub fn of(
        py: Python,
        model: &Arc<model::Model>,
        data: &Bound<'_, PyAny>,
        held_out: Option<&Bound<'_, PyAny>>,
        gate: bool,
    ) -> PyResult<Self> {
        Self::read(py, model, (data, held_out), Method::Reversals, gate)
    }

    /// As [`Self::of`] for what is fitted and what is held out, with angles differentiated by `method`.
    ///
    /// # Errors
    /// As [`Self::of`].
    pub fn read(
        py: Python,
        model: &Arc<model::Model>,
        (data, held_out): (&Bound<'_, PyAny>, Option<&Bound<'_, PyAny>>),
        method: Method,
        gate: bool,
    ) -> PyResult<Self> {
        let fitted = each(Some(data), "recordings", |r| r.dataset_by(method))?;
        let validated = each(held_out, "held_out", |r| r.dataset_by(method))?;
        let drives = Channel::of_drives(model.mechanism);
        let mut all: Vec<Dataset> = fitted.iter().chain(&validated).map(|d| (**d).clone()).collect();
        let Some(first) = all.first() else {
            return Err(errors::data_error(py, "no recording was given; expected at least one"));
        };
        let mut common = first.channels.clone();
        common.retain(|c| all.iter().all(|d| d.channels.contains(c)));
        if !model.assembled {
            common.retain(|c| c.drive().is_some());
        }
        for dataset in &mut all {
            let lacks = drives.iter().any(|c| !dataset.channels.contains(c));
            if dataset.is_empty() || lacks {
                let what = if lacks { "is of another kind of machine" } else { "has too few samples to differentiate" };
                let text = format!("{}: {what}; expected a recording of {}", dataset.name, model.name);
                return Err(errors::data_error(py, text));
            }
            dataset.restrict(&common);
        }
        check_together(&all).map_err(|e| errors::data_error(py, e))?;
        if gate {
            join(py, model.mechanism, &mut all)?;
            if let Some(cut_off) = py.detach(|| bandwidth(model.mechanism, &all[..fitted.len()])) {
                narrow(&mut all, cut_off);
            }
            let refused = py.detach(|| all.iter().find_map(|dataset| refusal(model, dataset)));
            if let Some(text) = refused {
                return Err(errors::data_error(py, text));
            }
        }
        let held_out = all.split_off(fitted.len());
        Ok(Self { datasets: all, held_out })
    }
}

/// Joins the zeros of the recordings of a lone axis to that of the first, with a warning about each.
fn join(py: Python, mechanism: Mechanism, all: &mut [Dataset]) -> PyResult<()> {
    for zero in py.detach(|| zeros(mechanism, all)) {
        let to = all[0].name.clone();
        let dataset = &mut all[zero.recording];
        dataset.shift(0, zero.offset);
        let name = dataset.name.clone();
        let sentence = zero.sentence([&name, &to], mechanism.unit(Unit::Rad));
        let text = CString::new(format!("{sentence}; gate=False leaves them")).unwrap_or_default();
        PyErr::warn(py, &py.get_type::<PyUserWarning>(), &text, 2)?;
    }
    Ok(())
}

/// Why a recording cannot be of the model's machine, with the remedy.
fn refusal(model: &model::Model, dataset: &Dataset) -> Option<String> {
    let found = examine(model, dataset);
    found.iter().any(|f| f.severe).then(|| {
        let lines: Vec<&str> = found.iter().map(|f| f.sentence.as_str()).collect();
        let remedy = combined(&found).map_or_else(|| found[0].remedy.to_string(), |map| map.to_string());
        let name = &dataset.name;
        format!(
            "{name}: does not fit the model {}: {}; remedy: {remedy}; gate=False goes on",
            model.name,
            lines.join("; ")
        )
    })
}

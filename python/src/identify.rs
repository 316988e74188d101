//! [`identify`] and [`compare`].

use std::collections::BTreeMap;
use std::sync::Arc;

use deltatwin::comparison;
use deltatwin::identification::estimator::PRIOR_INFORMATION;
use deltatwin::identification::fit::{Fit, FitError, fit_with};
use deltatwin::identification::{Dataset, HeldOut, NoiseLevel, Residuals};
use deltatwin::model;
use deltatwin::recording::Channel;
use deltatwin_report::Role;
use deltatwin_report::drawing::residual::{self, Stage};
use pyo3::prelude::*;

use crate::answer::{self, Estimate, Finding, Repeats};
use crate::data::Data;
use crate::how::{How, Words};
use crate::interrupt::{Bar, run};
use crate::law;
use crate::model::Model;
use crate::table::Table;

/// Result of an identification.
#[pyclass(frozen, module = "deltatwin")]
pub struct Identification {
    fit: Fit,
    channels: Vec<Channel>,
    noise: Vec<f64>,
    held_out: Option<HeldOut>,
}

#[pymethods]
impl Identification {
    #[getter]
    fn model(&self) -> Model {
        self.fit.model.clone().into()
    }

    #[getter]
    fn estimates(&self) -> Vec<Estimate> {
        self.fit.parameters.iter().map(Estimate::from).collect()
    }

    #[getter]
    fn parameters(&self) -> Table {
        answer::estimates("identified parameters", &self.estimates())
    }

    #[getter]
    fn base_parameters(&self) -> Table {
        let all: Vec<Estimate> = self
            .fit
            .base
            .iter()
            .map(|b| Estimate { name: b.combination(), value: b.value, std: b.std, unit: b.unit.to_string() })
            .collect();
        answer::estimates("base parameters", &all)
    }

    #[getter]
    fn unidentified(&self) -> Vec<(String, String)> {
        self.fit.unidentified.iter().map(|u| (u.name.clone(), u.reason.to_string())).collect()
    }

    #[getter]
    fn channels(&self) -> Vec<String> {
        self.channels.iter().map(Channel::to_string).collect()
    }

    #[getter]
    fn rms(&self) -> Vec<f64> {
        self.fit.residuals.rms.clone()
    }

    #[getter]
    fn held_out_rms(&self) -> Option<Vec<f64>> {
        self.held_out.as_ref().map(|h| h.rms.clone())
    }

    #[getter]
    fn held_out_noise_floor(&self) -> Option<Vec<f64>> {
        self.held_out.as_ref().map(|h| h.noise_floor.clone())
    }

    #[getter]
    fn noise_floor(&self) -> Vec<f64> {
        self.noise.clone()
    }

    #[getter]
    fn rank(&self) -> usize {
        self.fit.structure.rank
    }

    #[getter]
    fn condition(&self) -> f64 {
        self.fit.structure.condition()
    }

    #[getter]
    fn errors(&self) -> Table {
        let series = [
            ("rms", Some(&self.rms()[..])),
            ("held_out", self.held_out.as_ref().map(|h| &h.rms[..])),
            ("noise_floor", Some(&self.noise[..])),
        ];
        answer::errors(self.fit.model.mechanism, &self.channels, &series)
    }

    fn __repr__(&self) -> String {
        let rms: Vec<String> = self.fit.residuals.rms.iter().map(|x| format!("{x:.4}")).collect();
        format!(
            "Identification(parameters={}, base_parameters={}, condition={:.3}, rms=[{}])",
            self.fit.parameters.len(),
            self.rank(),
            self.condition(),
            rms.join(", ")
        )
    }

    fn _repr_html_(&self) -> String {
        self.errors()._repr_html_() + &self.parameters()._repr_html_()
    }
}

/// Result of a comparison.
#[pyclass(frozen, module = "deltatwin")]
pub struct Comparison {
    inner: comparison::Comparison,
    model: Arc<model::Model>,
    dataset: Dataset,
    residuals: Residuals,
}

#[pymethods]
impl Comparison {
    #[getter]
    fn channels(&self) -> Vec<String> {
        self.inner.channels.iter().map(Channel::to_string).collect()
    }

    #[getter]
    fn rms(&self) -> Vec<f64> {
        self.inner.rms.clone()
    }

    #[getter]
    fn held_out_rms(&self) -> Option<Vec<f64>> {
        self.inner.held_out.as_ref().map(|h| h.rms.clone())
    }

    #[getter]
    fn held_out_noise_floor(&self) -> Option<Vec<f64>> {
        self.inner.held_out.as_ref().map(|h| h.noise_floor.clone())
    }

    #[getter]
    fn noise_floor(&self) -> Vec<f64> {
        self.inner.noise_floor.clone()
    }

    #[getter]
    fn findings(&self) -> Vec<Finding> {
        self.inner.findings.iter().map(Finding::from).collect()
    }

    #[getter]
    fn repeats(&self) -> Option<Repeats> {
        self.inner.repeats.as_ref().map(Repeats::from)
    }

    #[getter]
    fn worst(&self) -> Option<(String, f64)> {
        self.inner.worst().map(|(channel, ratio)| (channel.to_string(), ratio))
    }

    #[getter]
    fn errors(&self) -> Table {
        let c = &self.inner;
        let series = [
            ("rms", Some(&c.rms[..])),
            ("held_out", c.held_out.as_ref().map(|h| &h.rms[..])),
            ("noise_floor", Some(&c.noise_floor[..])),
        ];
        answer::errors(c.mechanism, &c.channels, &series)
    }

    #[getter]
    fn residuals(&self) -> Table {
        let mut table = Table::new("residuals, measured - predicted");
        table.push("t", "s", crate::table::Series::Float(self.dataset.t.clone()));
        for (channel, values) in self.dataset.channels.iter().zip(&self.residuals.series[0]) {
            let unit = channel.unit(self.dataset.mechanism).to_string();
            table.push(&channel.to_string(), &unit, crate::table::Series::Float(values.clone()));
        }
        table
    }

    fn svg(&self) -> PyResult<String> {
        let stage = [Stage { role: Role::Nominal, name: "model", model: &self.model }];
        let figures = residual::figures(&stage, &self.dataset, &self.inner.noise_floor).map_err(|e| failed(&e))?;
        Ok(figures.get(1).map_or(String::new(), |(_, figure)| figure.svg().into()))
    }

    fn __repr__(&self) -> String {
        let ratio = |(rms, noise): (&f64, &f64)| format!("{:.2}", rms / noise);
        let ratios: Vec<String> = self.inner.rms.iter().zip(&self.inner.noise_floor).map(ratio).collect();
        let findings = self.inner.findings.len();
        format!("Comparison(rms / noise floor = [{}], findings={findings})", ratios.join(", "))
    }

    fn _repr_html_(&self) -> PyResult<String> {
        let mut html = self.errors()._repr_html_();
        html += &answer::picture(&self.svg()?);
        html += "<ul>";
        html.extend(
            self.inner.findings.iter().map(|f| format!("<li>{}</li>", deltatwin_report::html::escape(&f.sentence))),
        );
        Ok(html + "</ul>")
    }
}

/// The exception for a fit that is not possible.
pub fn failed(error: &FitError) -> PyErr {
    pyo3::exceptions::PyValueError::new_err(error.to_string())
}

/// Estimate the parameters of a model from recordings, with standard errors; every body stays physically consistent.
///
/// Parameters
/// ----------
/// model : Model
///     Model to start from.
/// recordings : Recording or sequence
///     What is fitted.
/// held_out : Recording or sequence, optional
///     What only judges.
/// hold : sequence of str
///     Effects whose parameters are known (``"rigid_bodies"`` for the links).
/// robust : bool
///     Outliers are downweighted.
/// weighing : str
///     What the rows are weighed with: ``"noise"`` of the channels, or their largest measured value, ``"maximum"``.
/// method : str
///     Way to physically consistent parameters, ``"cones"`` or ``"log_cholesky"``; both lead to the same ones.
/// prior : Model, optional
///     Model whose parameters are the regularisation values, instead of ``model`` itself.
/// regularisation : float
///     Weight of the regularisation: information per parameter, in units of its own size.
/// gamma : dict, optional
///     Weights of groups of parameters instead of ``regularisation``: ``"torque"``, ``"bodies"``, ``"friction"``, a kind
///     of body such as ``"arm"``, or an effect.
/// limbs : str
///     Whether the limbs of the assembled robot are ``"alike"`` or ``"each"`` has parameters of its own.
/// bodies : str
///     Parameters of each link of the assembled robot: ``"symmetric"``, ``"aligned"`` or ``"complete"``, all ten.
/// derivatives : str
///     How rates and accelerations come from the angles: ``"reversals"``, ``"smoother"``, ``"polynomial"`` or ``"paper"``.
/// gate : bool
///     Refuse recordings whose signs, factors, order or zeros cannot be those of the model.
/// progress : bool or function
///     A bar of tqdm if that is installed, or a function of what is done and the share that is done (NaN if not known).
///
/// Raises
/// ------
/// DataError
///     If a recording cannot be fitted, with the remedy.
/// ModelError
///     If ``hold`` names an effect that the model does not have.
/// ValueError
///     For a word or a number that is none of those above.
#[pyfunction]
#[pyo3(signature = (model, recordings, *, held_out = None, hold = Vec::new(), robust = false, weighing = "noise".into(),
                    method = "cones".into(), prior = None, regularisation = PRIOR_INFORMATION, gamma = None,
                    limbs = "alike".into(), bodies = "symmetric".into(), derivatives = "reversals".into(), gate = true,
                    progress = None))]
#[expect(clippy::too_many_arguments, reason = "the keywords of the function")]
pub fn identify(
    py: Python,
    model: &Model,
    recordings: &Bound<'_, PyAny>,
    held_out: Option<&Bound<'_, PyAny>>,
    hold: Vec<String>,
    robust: bool,
    weighing: String,
    method: String,
    prior: Option<PyRef<'_, Model>>,
    regularisation: f64,
    gamma: Option<BTreeMap<String, f64>>,
    limbs: String,
    bodies: String,
    derivatives: String,
    gate: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Identification> {
    let words = Words { weighing, method, limbs, bodies, derivatives };
    let how = How::new(&words, hold, robust)?.regularised(prior, regularisation, gamma)?;
    how.check_hold(py, &model.inner)?;
    let own = Arc::new(how.of((*model.inner).clone()));
    let data = Data::read(py, &own, (recordings, held_out), how.derivatives, gate)?;
    let bar = Bar::of(py, progress, "identify")?;
    law::evaluate(py, &own, &[], &data)?;
    let done = run(py, bar.function(), move |task| {
        let channels = data.datasets[0].channels.clone();
        let noise = NoiseLevel::measured(&own, &data.datasets)?;
        let stop = || task.stopped();
        let fit = fit_with(&own, &data.datasets, &noise.of_each, &how.options(&stop))?;
        let held_out = HeldOut::new(&fit.model, &data.held_out)?;
        Ok(Identification { fit, channels, noise: noise.pooled, held_out })
    })?;
    law::raised(py)?;
    done.map_err(|e: FitError| failed(&e))
}

/// Locate the error of a model: which axis, which phase, which place, which frequency.
///
/// Arguments and errors as for ``identify``. The result shows residuals in a notebook.
#[pyfunction]
#[pyo3(signature = (model, recordings, *, held_out = None, gate = true, progress = None))]
pub fn compare(
    py: Python,
    model: &Model,
    recordings: &Bound<'_, PyAny>,
    held_out: Option<&Bound<'_, PyAny>>,
    gate: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Comparison> {
    let data = Data::of(py, &model.inner, recordings, held_out, gate)?;
    let bar = Bar::of(py, progress, "compare")?;
    law::evaluate(py, &model.inner, &[], &data)?;
    let own = model.inner.clone();
    let done = run(py, bar.function(), move |_| {
        let inner = comparison::compare(&own, &data.datasets, &data.held_out)?;
        let dataset =
            data.held_out.last().or(data.datasets.last()).cloned().unwrap_or_else(|| data.datasets[0].clone());
        let residuals = Residuals::new(&own, std::slice::from_ref(&dataset))?;
        Ok(Comparison { inner, model: own, dataset, residuals })
    })?;
    law::raised(py)?;
    done.map_err(|e: FitError| failed(&e))
}

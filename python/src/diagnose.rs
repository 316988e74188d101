//! [`diagnose`] and [`add`].

use std::sync::Arc;
use std::time::Instant;

use deltatwin::diagnosis::{self, DiagnosisError, Options, Progress, add_with, diagnose_with, parameters_of};
use deltatwin::effects::Effect;
use deltatwin::identification::Dataset;
use deltatwin::model;
use deltatwin::recording::Channel;
use deltatwin_report::Role;
use deltatwin_report::drawing::residual::{self, Stage};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::answer::{self, Candidate, Change, Estimate, Named, Repeats};
use crate::data::Data;
use crate::interrupt::{Bar, run};
use crate::law::{self, Law};
use crate::model::Model;
use crate::table::{Series, Table};

/// Result of a diagnosis.
#[pyclass(frozen, module = "deltatwin")]
pub struct Diagnosis {
    inner: diagnosis::Diagnosis,
    before: Arc<model::Model>,
    dataset: Dataset,
}

#[pymethods]
impl Diagnosis {
    #[getter]
    fn verdict(&self) -> String {
        self.inner.verdict.to_string()
    }

    #[getter]
    fn model(&self) -> Model {
        self.inner.model.clone().into()
    }

    #[getter]
    fn effects(&self) -> Vec<Named> {
        self.inner.effects.iter().map(Named::from).collect()
    }

    #[getter]
    fn candidates(&self) -> Vec<Candidate> {
        self.inner.candidates.iter().map(Candidate::from).collect()
    }

    #[getter]
    fn ranking(&self) -> Table {
        let all = self.candidates();
        let mut table = Table::new("candidates, best first");
        table.push("name", "", Series::Text(all.iter().map(|c| Some(c.name.clone())).collect()));
        table.push("probability", "", Series::Float(all.iter().map(|c| c.probability).collect()));
        table.push("explained", "", Series::Float(all.iter().map(|c| c.explained).collect()));
        table.push("p_adjusted", "", Series::Float(all.iter().map(|c| c.p_adjusted).collect()));
        table.push("outcome", "", Series::Text(all.iter().map(|c| Some(c.outcome.clone())).collect()));
        table.push("reason", "", Series::Text(all.iter().map(|c| c.reason.clone()).collect()));
        table
    }

    #[getter]
    fn indistinguishable(&self) -> Vec<Vec<String>> {
        self.inner.indistinguishable.clone()
    }

    #[getter]
    fn not_tried(&self) -> Vec<String> {
        self.inner.not_tried.clone()
    }

    #[getter]
    fn next_experiment(&self) -> Option<String> {
        self.inner.next_experiment.as_ref().map(|next| next.what.clone())
    }

    #[getter]
    fn formula(&self) -> Option<String> {
        let own = self.inner.model.effects.iter().find_map(|a| Some((a.effect.formula()?, a)))?;
        self.inner.unexplained.as_ref()?;
        let term = |(term, value): (&deltatwin::effects::formula::Term, &f64)| {
            format!("{value} * {} at {}", term.law.text(), term.at.name())
        };
        Some(own.0.terms.iter().zip(&own.1.values).map(term).collect::<Vec<_>>().join(" + "))
    }

    #[getter]
    fn explained(&self) -> f64 {
        self.inner.explained()
    }

    #[getter]
    fn channels(&self) -> Vec<String> {
        self.inner.channels.iter().map(Channel::to_string).collect()
    }

    #[getter]
    fn rms_before(&self) -> Vec<f64> {
        self.inner.rms_before.clone()
    }

    #[getter]
    fn rms_after(&self) -> Vec<f64> {
        self.inner.rms_after.clone()
    }

    #[getter]
    fn noise_floor(&self) -> Vec<f64> {
        self.inner.noise_floor.clone()
    }

    #[getter]
    fn repeats(&self) -> Option<Repeats> {
        self.inner.repeats.as_ref().map(Repeats::from)
    }

    #[getter]
    fn changes(&self) -> Vec<Change> {
        self.inner.changes.iter().map(Change::from).collect()
    }

    #[getter]
    fn errors(&self) -> Table {
        let d = &self.inner;
        let series = [
            ("before", Some(&d.rms_before[..])),
            ("after", Some(&d.rms_after[..])),
            ("noise_floor", Some(&d.noise_floor[..])),
        ];
        answer::errors(d.model.mechanism, &d.channels, &series)
    }

    fn svg(&self) -> PyResult<String> {
        pictures(&self.before, &self.inner.model, &self.dataset, &self.inner.noise_floor)
    }

    fn __repr__(&self) -> String {
        let names: Vec<String> =
            self.inner.effects.iter().map(|e| format!("{} ({:.2})", e.name, e.confidence.probability())).collect();
        format!("Diagnosis({}: {})", self.inner.verdict, names.join(", "))
    }

    fn _repr_html_(&self) -> PyResult<String> {
        let verdict = format!("<p><b>{}</b></p>", deltatwin_report::html::escape(&self.__repr__()));
        let tables = self.errors()._repr_html_() + &self.ranking()._repr_html_();
        Ok(verdict + &answer::picture(&self.svg()?) + &tables)
    }
}

/// Residuals of two models over time, as SVG.
fn pictures(before: &model::Model, after: &model::Model, dataset: &Dataset, noise: &[f64]) -> PyResult<String> {
    let stages = [
        Stage { role: Role::Identified, name: "before", model: before },
        Stage { role: Role::Added, name: "after", model: after },
    ];
    let figures = residual::figures(&stages, dataset, noise).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(figures.get(1).map_or(String::new(), |(_, figure)| figure.svg().into()))
}

/// Result of an addition.
#[pyclass(frozen, module = "deltatwin")]
pub struct Addition {
    inner: diagnosis::Addition,
    before: Arc<model::Model>,
    dataset: Dataset,
}

#[pymethods]
impl Addition {
    #[getter]
    fn effect(&self) -> &str {
        &self.inner.effect
    }

    #[getter]
    fn model(&self) -> Model {
        self.inner.fit.model.clone().into()
    }

    #[getter]
    fn parameters(&self) -> Vec<Estimate> {
        parameters_of(&self.inner.fit, &self.inner.effect).iter().map(Estimate::from).collect()
    }

    #[getter]
    fn channels(&self) -> Vec<String> {
        self.inner.budget.channels.iter().map(Channel::to_string).collect()
    }

    #[getter]
    fn rms_before(&self) -> Vec<f64> {
        self.inner.budget.rms_before.clone()
    }

    #[getter]
    fn rms_after(&self) -> Vec<f64> {
        self.inner.budget.rms_after().to_vec()
    }

    #[getter]
    fn noise_floor(&self) -> Vec<f64> {
        self.inner.budget.noise_floor.clone()
    }

    #[getter]
    fn changes(&self) -> Vec<Change> {
        self.inner.changes.iter().map(Change::from).collect()
    }

    #[getter]
    fn errors(&self) -> Table {
        let b = &self.inner.budget;
        let series = [
            ("before", Some(&b.rms_before[..])),
            ("after", Some(b.rms_after())),
            ("noise_floor", Some(&b.noise_floor[..])),
        ];
        answer::errors(b.mechanism, &b.channels, &series)
    }

    fn svg(&self) -> PyResult<String> {
        pictures(&self.before, &self.inner.fit.model, &self.dataset, &self.inner.budget.noise_floor)
    }

    fn __repr__(&self) -> String {
        let list = |values: &[f64]| values.iter().map(|x| format!("{x:.4}")).collect::<Vec<_>>().join(", ");
        let b = &self.inner.budget;
        format!("Addition({}: rms [{}] -> [{}])", self.inner.effect, list(&b.rms_before), list(b.rms_after()))
    }

    fn _repr_html_(&self) -> PyResult<String> {
        let parameters = answer::estimates(&self.inner.effect, &self.parameters());
        Ok(self.errors()._repr_html_() + &answer::picture(&self.svg()?) + &parameters._repr_html_())
    }
}

fn failed(error: &DiagnosisError) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// Laws of an argument, as effects of a machine with `dof` axes.
fn laws(candidates: Option<Vec<Py<Law>>>, dof: usize) -> Vec<Arc<dyn Effect>> {
    candidates.unwrap_or_default().iter().map(|law| law.get().effect(dof)).collect()
}

/// The recording by which an answer is shown.
fn shown(data: &Data) -> Dataset {
    data.held_out.last().or(data.datasets.last()).cloned().unwrap_or_else(|| data.datasets[0].clone())
}

/// Time limit by default: seconds per 50 000 samples, and the least.
const SECONDS: f64 = 250.0;
const LEAST: f64 = 500.0;

/// Name the physical effect that a model lacks.
///
/// The parameters are refitted, then every effect of the catalogue, and every ``Law`` in ``candidates``, is tried. The
/// verdict is ``"none"``, ``"effect"``, ``"several"``, ``"ambiguous"``, ``"unknown"``, or
/// ``"undecided"`` where ``time_limit`` was up before the question was answered.
///
/// Parameters
/// ----------
/// model, recordings, held_out, hold, gate, progress
///     As for ``identify``.
/// candidates : sequence of Law, optional
///     Laws in Python that are tried beside the catalogue. Each is called once per recording with all of its samples;
///     ``law.calls`` and ``law.seconds`` say what it cost.
/// time_limit : float, optional
///     Seconds after which the best answer so far is given, with what was ``not_tried``; by default 250 s for every
///     50 000 samples, and not less than 500 s; the work is bounded, too.
///
/// Raises
/// ------
/// DataError
///     If a recording cannot be of the machine, with the remedy.
/// ValueError
///     If the recordings are too short, or measure different channels.
#[pyfunction]
#[pyo3(signature = (model, recordings, *, held_out = None, candidates = None, hold = Vec::new(), time_limit = None, gate = true, progress = None))]
#[expect(clippy::too_many_arguments, reason = "the keywords of the function")]
pub fn diagnose(
    py: Python,
    model: &Model,
    recordings: &Bound<'_, PyAny>,
    held_out: Option<&Bound<'_, PyAny>>,
    candidates: Option<Vec<Py<Law>>>,
    hold: Vec<String>,
    time_limit: Option<f64>,
    gate: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Diagnosis> {
    if let Some(limit) = time_limit.filter(|x| !(x.is_finite() && *x > 0.0)) {
        return Err(PyValueError::new_err(format!("time_limit is {limit}; expected seconds above 0")));
    }
    let data = Data::of(py, &model.inner, recordings, held_out, gate)?;
    let own = laws(candidates, model.dof());
    law::evaluate(py, &model.inner, &own, &data)?;
    let bar = Bar::of(py, progress, "diagnose")?;
    let before = model.inner.clone();
    let samples: usize = data.datasets.iter().chain(&data.held_out).map(Dataset::len).sum();
    let limit = time_limit.unwrap_or((SECONDS * samples as f64 / 5e4).max(LEAST));
    let done = run(py, bar.function(), move |task| {
        let begun = Instant::now();
        let passed = || if task.stopped() { f64::INFINITY } else { begun.elapsed().as_secs_f64() / limit };
        let options = Options { fixed: &hold, clock: &passed, candidates: &own, ..Options::default() };
        let mut step = String::new();
        let mut show = |report: Progress| {
            let text = report.text(&step);
            if let Progress::Step(what) = report {
                step = what.into();
            }
            task.progress(&text, begun.elapsed().as_secs_f64() / limit);
        };
        let inner = diagnose_with(&before, &data.datasets, &data.held_out, &options, &mut show)?;
        Ok(Diagnosis { inner, dataset: shown(&data), before })
    })?;
    law::raised(py)?;
    done.map_err(|e: DiagnosisError| failed(&e))
}

/// Add an effect (its name, or a ``Law``) to a model, refit, and show the error before and after.
///
/// Other arguments and errors as for ``identify``. The model of the result is new; the given one is unchanged.
#[pyfunction]
#[pyo3(signature = (model, effect, recordings, *, held_out = None, hold = Vec::new(), gate = true, progress = None))]
#[expect(clippy::too_many_arguments, reason = "the keywords of the function")]
pub fn add(
    py: Python,
    model: &Model,
    effect: &Bound<'_, PyAny>,
    recordings: &Bound<'_, PyAny>,
    held_out: Option<&Bound<'_, PyAny>>,
    hold: Vec<String>,
    gate: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Addition> {
    let own: Vec<Arc<dyn Effect>> = effect.cast::<Law>().map_or(Vec::new(), |law| vec![law.get().effect(model.dof())]);
    let name: String = match own.first() {
        Some(law) => law.name().into(),
        None => effect.extract()?,
    };
    let data = Data::of(py, &model.inner, recordings, held_out, gate)?;
    law::evaluate(py, &model.inner, &own, &data)?;
    let bar = Bar::of(py, progress, "add")?;
    let before = model.inner.clone();
    let done = run(py, bar.function(), move |task| {
        let passed = || if task.stopped() { f64::INFINITY } else { 0.0 };
        let options = Options { fixed: &hold, clock: &passed, candidates: &own, ..Options::default() };
        let inner = add_with(&before, &name, &data.datasets, &data.held_out, &options)?;
        Ok(Addition { inner, dataset: shown(&data), before })
    })?;
    law::raised(py)?;
    done.map_err(|e: DiagnosisError| failed(&e))
}

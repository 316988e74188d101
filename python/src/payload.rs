//! [`identify_payload`]: what the flange carries, with a known robot.

use deltatwin::identification::NoiseLevel;
use deltatwin::identification::estimator::PRIOR_INFORMATION;
use deltatwin::identification::fit::FitError;
use deltatwin::identification::{PayloadFit, identify_payload as identified};
use deltatwin::machine;
use deltatwin::recording::Channel;
use deltatwin_io::recording::setup;
use pyo3::prelude::*;

use crate::answer::{self, Estimate};
use crate::data::Data;
use crate::errors;
use crate::how::{How, Words};
use crate::identify::failed;
use crate::interrupt::{Bar, run};
use crate::law;
use crate::model::Model;
use crate::setup::{Payload, Setup};
use crate::table::Table;

/// Result of an identification of the payload.
#[pyclass(frozen, module = "deltatwin")]
pub struct PayloadIdentification {
    found: PayloadFit,
    setup: machine::Setup,
    channels: Vec<Channel>,
    noise: Vec<f64>,
}

#[pymethods]
impl PayloadIdentification {
    #[getter]
    fn payload(&self) -> Payload {
        Payload { inner: self.found.payload }
    }

    #[getter]
    fn setup(&self) -> Setup {
        Setup { inner: self.setup }
    }

    #[getter]
    fn estimates(&self) -> Vec<Estimate> {
        self.found.parameters.iter().map(Estimate::from).collect()
    }

    #[getter]
    fn parameters(&self) -> Table {
        answer::estimates("payload about the flange centre", &self.estimates())
    }

    #[getter]
    fn unidentified(&self) -> Vec<(String, String)> {
        self.found.fit.unidentified.iter().map(|u| (u.name.clone(), u.reason.to_string())).collect()
    }

    #[getter]
    fn channels(&self) -> Vec<String> {
        self.channels.iter().map(Channel::to_string).collect()
    }

    #[getter]
    fn rms(&self) -> Vec<f64> {
        self.found.fit.residuals.rms.clone()
    }

    #[getter]
    fn noise_floor(&self) -> Vec<f64> {
        self.noise.clone()
    }

    #[getter]
    fn errors(&self) -> Table {
        let series = [("rms", Some(&self.found.fit.residuals.rms[..])), ("noise_floor", Some(&self.noise[..]))];
        answer::errors(self.found.fit.model.mechanism, &self.channels, &series)
    }

    fn __repr__(&self) -> String {
        let p = &self.found.payload;
        format!("PayloadIdentification(mass={:.6}, com=[{:.6}, {:.6}, {:.6}])", p.mass, p.com.x, p.com.y, p.com.z)
    }

    fn _repr_html_(&self) -> String {
        self.errors()._repr_html_() + &self.parameters()._repr_html_()
    }
}

/// Estimate the payload with which recordings were made, with everything else as the model has it.
///
/// An error of the model becomes an error of the payload: identify the empty robot first. All ten parameters about the
/// flange centre are estimated; what the data do not determine is that of the recording's setup.
///
/// Parameters
/// ----------
/// model : Model
///     The empty robot; it has a flange.
/// recordings : Recording or sequence
///     What is fitted; their payload is the same.
/// robust, weighing, method, regularisation, derivatives, gate, progress
///     As for ``identify``.
///
/// Returns
/// -------
/// PayloadIdentification
///     ``payload`` in the form of a setup; ``setup``, that of the first recording with it; ``parameters``, mass (kg),
///     first moments (kg·m) and tensor (kg·m²) about the flange centre with standard errors.
///
/// Raises
/// ------
/// DataError
///     If a recording cannot be fitted, or what is found is none that a flange can carry.
/// ValueError
///     If the machine has no flange, or for a word or a number that is none of those known.
#[pyfunction]
#[pyo3(signature = (model, recordings, *, robust = false, weighing = "noise".into(), method = "cones".into(),
                    regularisation = PRIOR_INFORMATION, derivatives = "reversals".into(), gate = true, progress = None))]
#[expect(clippy::too_many_arguments, reason = "the keywords of the function")]
pub fn identify_payload(
    py: Python,
    model: &Model,
    recordings: &Bound<'_, PyAny>,
    robust: bool,
    weighing: String,
    method: String,
    regularisation: f64,
    derivatives: String,
    gate: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<PayloadIdentification> {
    let words = Words { weighing, method, limbs: "alike".into(), bodies: "symmetric".into(), derivatives };
    let how = How::new(&words, Vec::new(), robust)?.regularised(None, regularisation, None)?;
    let data = Data::read(py, &model.inner, (recordings, None), how.derivatives, gate)?;
    let bar = Bar::of(py, progress, "identify")?;
    law::evaluate(py, &model.inner, &[], &data)?;
    let own = model.inner.clone();
    let done = run(py, bar.function(), move |task| {
        let first = &data.datasets[0];
        let (channels, name) = (first.channels.clone(), first.name.clone());
        let noise = NoiseLevel::of(&own, &data.datasets);
        let stop = || task.stopped();
        let found = identified(&own, &data.datasets, &noise.of_each, &how.options(&stop))?;
        let setup = machine::Setup { payload: found.payload, ..first.setup };
        Ok((PayloadIdentification { found, setup, channels, noise: noise.pooled }, name))
    })?;
    law::raised(py)?;
    let (found, name) = done.map_err(|e: FitError| failed(&e))?;
    // A setup must not state an impossible payload: the recording was of an empty flange, or of another robot.
    setup::from_toml(&setup::to_toml(&found.setup), "the payload found").map_err(|e| {
        let what = format!("{name} as a setup states it: {e}");
        errors::data_error(py, format!("{what}; is something at the flange, and is the empty robot identified?"))
    })?;
    Ok(found)
}

//! [`excite`]: the motion with the most information about the parameters.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use deltatwin::dynamics::Plant;
use deltatwin::excitation::{Design, ExcitationError, Hemisphere, Objective, Options, design};
use deltatwin::machine::Setup;
use deltatwin::model;
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{Course, array};
use crate::errors;
use crate::interrupt::{Bar, run};
use crate::model::Model;

/// A designed motion.
#[pyclass(frozen, module = "deltatwin")]
pub struct Excitation {
    design: Design,
    options: Options,
    model: Arc<model::Model>,
}

#[pymethods]
impl Excitation {
    /// Condition number of the regressor along the motion, columns in units of the parameters' sizes.
    #[getter]
    fn condition(&self) -> f64 {
        self.design.merit.condition
    }

    /// log det of the information per sample.
    #[getter]
    fn log_det(&self) -> f64 {
        self.design.merit.log_det
    }

    /// Condition numbers of random motions within the same limits.
    #[getter]
    fn random_condition(&self) -> Vec<f64> {
        self.design.random.iter().map(|m| m.condition).collect()
    }

    /// Leading parameter of each base parameter.
    #[getter]
    fn base_parameters(&self) -> Vec<String> {
        self.design.parameters.iter().map(|p| p.name.clone()).collect()
    }

    /// Largest use of each kind of limit; 1 is the usable share.
    #[getter]
    fn worst(&self) -> Vec<(String, f64)> {
        self.design.worst.iter().map(|(name, share)| ((*name).to_string(), *share)).collect()
    }

    /// ``completed``, or ``time_limit`` if the time ended the search.
    #[getter]
    fn status(&self) -> &'static str {
        if self.design.stopped { "time_limit" } else { "completed" }
    }

    /// Period, s.
    #[getter]
    fn period(&self) -> f64 {
        1.0 / self.options.frequency
    }

    /// The scenario of the motion for the model in `model_path`, as text.
    fn scenario(&self, py: Python, model_path: PathBuf) -> PyResult<String> {
        deltatwin_io::scenario::design_text(&self.design, &self.options, &self.model, &model_path)
            .map_err(|e| errors::report(py, &e))
    }

    /// Write the motion as a scenario for the model in the file ``model_path``.
    #[pyo3(signature = (path, model_path, *, force = false))]
    fn save(&self, py: Python, path: PathBuf, model_path: PathBuf, force: bool) -> PyResult<()> {
        errors::refuse_existing(&path, force)?;
        deltatwin_io::scenario::write_design(&self.design, &self.options, &self.model, &model_path, &path)
            .map_err(|e| errors::report(py, &e))
    }

    /// ``t``, ``q``, ``qd``, ``qdd`` of one period: ``(n,)`` and ``(n, dof)``.
    #[pyo3(signature = (sample_time = None))]
    fn states<'py>(&self, py: Python<'py>, sample_time: Option<f64>) -> PyResult<Course<'py>> {
        let step = sample_time.unwrap_or(self.model.sample_time);
        if !(step.is_finite() && step > 1e-6) {
            return Err(PyValueError::new_err(format!("sample_time is {step}; expected seconds above 1e-6")));
        }
        let geometry = Plant::new(&self.model, &Setup::default()).geometry;
        let dof = self.model.mechanism.axes();
        let count = (self.period() / step).round() as usize;
        let t: Vec<f64> = (0..count).map(|k| k as f64 * step).collect();
        let [mut q, mut qd, mut qdd] = [const { Vec::new() }; 3];
        for at in &t {
            let joints = geometry
                .inverse_motion(&self.design.motion.at(*at))
                .map_err(|e| PyValueError::new_err(format!("t = {at}: {e}")))?;
            q.extend_from_slice(&joints.q[..dof]);
            qd.extend_from_slice(&joints.qd[..dof]);
            qdd.extend_from_slice(&joints.qdd[..dof]);
        }
        let shape = [count, dof];
        Ok((PyArray1::from_vec(py, t), array(py, q, &shape)?, array(py, qd, &shape)?, array(py, qdd, &shape)?))
    }

    fn __repr__(&self) -> String {
        let (condition, period) = (self.condition(), self.period());
        format!("Excitation(condition={condition:.4}, period={period} s, {})", self.status())
    }
}

/// Design the periodic motion with the most information about the parameters, within all limits.
///
/// ``objective`` is ``"logdet"`` or ``"condition"``; ``share`` is the usable share of the limits; ``hemisphere`` is centre
/// (m) and radius (m) of the lower half of a ball that the platform may not leave; ``time_limit`` is in s.
///
/// Raises ``ValueError`` if no motion is possible, ``ModelError`` for a machine without platform.
#[pyfunction]
#[pyo3(signature = (model, *, objective = "logdet", frequency = 0.1, harmonics = 5, periods = 2, share = 0.8, hemisphere = None, seed = 1, starts = 4, iterations = 80, time_limit = 50.0, progress = None))]
#[expect(clippy::too_many_arguments, reason = "the keywords of the function")]
pub fn excite(
    py: Python,
    model: &Model,
    objective: &str,
    frequency: f64,
    harmonics: usize,
    periods: usize,
    share: f64,
    hemisphere: Option<([f64; 3], f64)>,
    seed: u64,
    starts: usize,
    iterations: usize,
    time_limit: f64,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Excitation> {
    let objective = match objective {
        "logdet" => Objective::Logdet,
        "condition" => Objective::Condition,
        other => return Err(PyValueError::new_err(format!("objective {other:?}; expected 'logdet' or 'condition'"))),
    };
    let within = |name: &str, value: f64, low: f64, high: f64| {
        let text = || PyValueError::new_err(format!("{name} is {value}; expected a number from {low} to {high}"));
        if (low..=high).contains(&value) { Ok(value) } else { Err(text()) }
    };
    within("harmonics", harmonics as f64, 1.0, 50.0)?;
    within("periods", periods as f64, 1.0, 1000.0)?;
    within("starts", starts as f64, 1.0, 1000.0)?;
    if !model.inner.assembled {
        return Err(errors::model_error(py, "the machine has no platform: expected an assembled robot"));
    }
    let options = Options {
        objective,
        frequency: within("frequency", frequency, 1e-3, 20.0)?,
        harmonics,
        periods,
        share: within("share", share, 0.01, 1.0)?,
        hemisphere: hemisphere.map(|(centre, radius)| Hemisphere { centre: centre.into(), radius }),
        seed,
        starts,
        iterations,
        ..Options::default()
    };
    let limit = within("time_limit", time_limit, 0.0, 1e6)?;
    let own = model.inner.clone();
    let bar = Bar::of(py, progress, "excite")?;
    let done = run(py, bar.function(), move |task| {
        let begun = Instant::now();
        let teller = std::sync::Mutex::new(task.clone());
        let stop = task.stop_flag();
        let go_on = || {
            let passed = begun.elapsed().as_secs_f64();
            if let Ok(teller) = teller.try_lock() {
                teller.progress("excite", passed / limit);
            }
            passed < limit && !stop.load(std::sync::atomic::Ordering::Relaxed)
        };
        let design = design(&own, &options, &go_on)?;
        Ok(Excitation { design, options, model: own })
    })?;
    done.map_err(|e: ExcitationError| PyValueError::new_err(e.to_string()))
}

//! [`simulate`]: the twin along a scenario.

use std::path::{Path, PathBuf};

use deltatwin::dynamics::Plant;
use deltatwin::scenario::Scenario;
use deltatwin::twin::{Options, Report, SimulationError, simulate_until_failure};
use deltatwin_io::outside::Access;
use deltatwin_io::scenario::ScenarioError;
use pyo3::exceptions::{PyFileNotFoundError, PyValueError};
use pyo3::prelude::*;

use crate::errors;
use crate::interrupt::{Bar, run};
use crate::model::Model;
use crate::recording::Recording;
use crate::table::{Series, Table};

/// An event of a run.
#[pyclass(frozen, get_all, module = "deltatwin")]
#[derive(Clone)]
pub struct Event {
    pub t: f64,
    pub kind: &'static str,
    pub what: String,
}

#[pymethods]
impl Event {
    fn __repr__(&self) -> String {
        format!("Event({:.6} s, {}: {})", self.t, self.kind, self.what)
    }
}

/// Result of a run.
#[pyclass(frozen, module = "deltatwin")]
pub struct Simulation {
    #[pyo3(get)]
    recording: Py<Recording>,
    #[pyo3(get)]
    status: &'static str,
    #[pyo3(get)]
    message: String,
    report: Report,
}

#[pymethods]
impl Simulation {
    #[getter]
    fn simulated(&self) -> f64 {
        self.report.simulated
    }

    #[getter]
    fn steps(&self) -> usize {
        self.report.steps
    }

    #[getter]
    fn energy_error(&self) -> f64 {
        self.report.energy_error
    }

    #[getter]
    fn max_loop_gap(&self) -> f64 {
        self.report.max_loop_gap
    }

    #[getter]
    fn peak_strut_force(&self) -> f64 {
        self.report.peak_strut_force
    }

    #[getter]
    fn min_socket_margin(&self) -> f64 {
        self.report.min_margin.iter().copied().fold(f64::INFINITY, f64::min)
    }

    #[getter]
    fn events(&self) -> Vec<Event> {
        let of = |e: &deltatwin::twin::Event| Event { t: e.t, kind: e.kind.name(), what: e.what.clone() };
        self.report.events.iter().map(of).collect()
    }

    #[getter]
    fn event_table(&self) -> Table {
        let all = self.events();
        let mut table = Table::new("events");
        table.push("t", "s", Series::Float(all.iter().map(|e| e.t).collect()));
        table.push("kind", "", Series::Text(all.iter().map(|e| Some(e.kind.into())).collect()));
        table.push("what", "", Series::Text(all.iter().map(|e| Some(e.what.clone())).collect()));
        table
    }

    fn __repr__(&self) -> String {
        let events = self.report.events.len();
        format!("Simulation({}, simulated={:.4} s, events={events})", self.status, self.report.simulated)
    }
}

/// The exception for a scenario that cannot be read.
pub fn scenario_error(py: Python, error: &ScenarioError) -> PyErr {
    match error {
        ScenarioError::Io { file, .. } if !file.exists() => PyFileNotFoundError::new_err(error.to_string()),
        ScenarioError::Content(problem) => errors::problem(py, problem),
        other => errors::model_error(py, other),
    }
}

/// A scenario from a file, or from a text if that has several lines; its models are relative to `folder`.
pub fn read_scenario(py: Python, scenario: &Bound<'_, PyAny>, folder: &Path) -> PyResult<Scenario> {
    let text = scenario.extract::<String>().ok().filter(|text| text.contains('\n'));
    let access = Access::with(deltatwin_cell::mesh::read);
    let read = match text {
        Some(text) => deltatwin_io::scenario::parse_with(&text, &folder.join("scenario.toml"), access),
        None => deltatwin_io::scenario::read_with(&scenario.extract::<PathBuf>()?, access),
    };
    read.map_err(|e| scenario_error(py, &e))
}

struct Outcome {
    recording: deltatwin::recording::Recording,
    report: Report,
    failure: Option<SimulationError>,
    stopped: bool,
}

/// Run the twin along a scenario.
///
/// Parameters
/// ----------
/// scenario : path or str
///     Scenario file, or its text (several lines); models in a text are relative to ``folder``.
/// model : Model, optional
///     Machine, in place of the scenario's; a ``Law`` in it is called at every step.
/// controller : Model, optional
///     Model of the feed-forward, in place of the scenario's.
/// duration, seed, noise : optional
///     In place of the scenario's.
///
/// Returns
/// -------
/// Simulation
///     With the recording, events, and ``status``: ``"completed"``, ``"failed"`` (the equations cannot be continued,
///     ``message`` says why) or ``"inaccurate"`` (the energy balance does not close).
///
/// Raises
/// ------
/// ModelError
///     With path, line and column of an error in the scenario or in a model.
///
/// Counterpart: a loop over ``mujoco.mj_step`` with a controller.
#[pyfunction]
#[pyo3(signature = (scenario, *, model = None, controller = None, duration = None, seed = None, noise = None, folder = PathBuf::new(), progress = None))]
#[expect(clippy::too_many_arguments, reason = "the keywords of the function")]
pub fn simulate(
    py: Python,
    scenario: &Bound<'_, PyAny>,
    model: Option<PyRef<'_, Model>>,
    controller: Option<PyRef<'_, Model>>,
    duration: Option<f64>,
    seed: Option<u64>,
    noise: Option<bool>,
    folder: PathBuf,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Simulation> {
    let mut scenario = read_scenario(py, scenario, &folder)?;
    if let Some(duration) = duration {
        if !(0.01..=3600.0).contains(&duration) {
            return Err(PyValueError::new_err(format!("duration is {duration}; expected 0.01 to 3600 s")));
        }
        scenario.duration = duration;
    }
    scenario.seed = seed.unwrap_or(scenario.seed);
    scenario.noise = noise.unwrap_or(scenario.noise);
    let read = |file: &Path| deltatwin_io::model::read(file).map_err(|e| errors::report(py, &e));
    let own = match &model {
        Some(model) => (*model.inner).clone(),
        None => read(&scenario.model)?,
    };
    let machine = scenario.machine(&own);
    let planning = match (&controller, &scenario.controller_model) {
        (Some(controller), _) => (*controller.inner).clone(),
        (None, Some(file)) => read(file)?,
        (None, None) => machine.clone(),
    };
    if planning.mechanism != machine.mechanism {
        let text = format!("{} is another kind of machine than {}", planning.name, machine.name);
        return Err(errors::model_error(py, text));
    }
    let motion = scenario.motion(&planning).map_err(|e| PyValueError::new_err(e.to_string()))?;
    let options = Options { contacts: Some(deltatwin_cell::contacts), ..Options::of(&scenario, &machine) };
    let bar = Bar::of(py, progress, "simulate")?;
    let outcome = run(py, bar.function(), move |task| {
        let plant = Plant::new(&planning, &scenario.believed_setup());
        let mut last = 0.0;
        let mut stopped = false;
        let mut tell = |t: f64| {
            let share = t / scenario.duration;
            if share - last >= 0.01 {
                last = share;
                task.progress("simulate", share);
            }
            stopped = task.stopped();
            !stopped
        };
        let desired = |t: f64| motion.at(t);
        let (mut recording, report, failure) =
            simulate_until_failure(&machine, &scenario.setup, &plant, &desired, &options, &mut tell)?;
        recording.name.clone_from(&scenario.name);
        Ok(Outcome { recording, report, failure, stopped })
    })?;
    crate::law::raised(py)?;
    let Outcome { recording, report, failure, stopped } =
        outcome.map_err(|e: SimulationError| PyValueError::new_err(e.to_string()))?;
    let (status, message) = match failure {
        Some(failure) => ("failed", failure.to_string()),
        None if stopped => ("interrupted", String::new()),
        None if !report.energy_closes() => ("inaccurate", "the energy balance does not close".into()),
        None => ("completed", String::new()),
    };
    Ok(Simulation { recording: Py::new(py, Recording::from(recording))?, status, message, report })
}

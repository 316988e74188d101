//! [`plan`]: the fastest motion along a path.

use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Instant;

use deltatwin::dynamics::Plant;
use deltatwin::planner::trajectory::trajectory;
use deltatwin::planner::{self, Limits, Machine, Options, PlanError};
use deltatwin_io::outside::Access;
use pyo3::prelude::*;

use crate::errors;
use crate::interrupt::{Bar, run};
use crate::model::Model;
use crate::recording::Recording;
use crate::simulate::scenario_error;
use crate::table::{Series, Table};

/// A plan, or the reason why there is none.
#[pyclass(frozen, module = "deltatwin")]
pub struct Plan {
    #[pyo3(get)]
    status: &'static str,
    #[pyo3(get)]
    message: String,
    #[pyo3(get)]
    trajectory: Option<Py<Recording>>,
    found: Option<planner::Plan>,
}

#[pymethods]
impl Plan {
    #[getter]
    fn time(&self) -> Option<f64> {
        self.found.as_ref().map(|p| p.time)
    }

    #[getter]
    fn bound(&self) -> Option<f64> {
        self.found.as_ref().map(|p| p.bound)
    }

    #[getter]
    fn time_without_jerk(&self) -> Option<f64> {
        self.found.as_ref().map(|p| p.time_without_jerk)
    }

    #[getter]
    fn active(&self) -> Table {
        let all = self.found.as_ref().map_or_else(Vec::new, planner::Plan::active);
        let mut table = Table::new("active limits");
        table.push("limit", "", Series::Text(all.iter().map(|(limit, _)| Some(limit.to_string())).collect()));
        table.push("begin", "", Series::Float(all.iter().map(|(_, range)| range[0]).collect()));
        table.push("end", "", Series::Float(all.iter().map(|(_, range)| range[1]).collect()));
        table
    }

    fn __repr__(&self) -> String {
        match &self.found {
            Some(found) => format!("Plan({:.5} s, bound={:.5} s)", found.time, found.bound),
            None => format!("Plan({}: {})", self.status, self.message),
        }
    }
}

/// Seconds since the first call.
fn seconds() -> f64 {
    static BEGUN: OnceLock<Instant> = OnceLock::new();
    BEGUN.get_or_init(Instant::now).elapsed().as_secs_f64()
}

/// Plan the fastest motion along a path (a path file, or its text) within all limits.
///
/// ``status`` is ``"completed"``, or ``"infeasible"`` or ``"not_converged"`` with a ``message``.
///
/// Raises ``ModelError`` with the place of an error in the path file, ``ValueError`` if the robot cannot follow the path.
///
/// Counterpart: ``toppra``, ``copp``, with constraint forces of the closed mechanism as further limits.
#[pyfunction]
#[pyo3(signature = (model, path, *, tighten = false, progress = None))]
pub fn plan(
    py: Python,
    model: &Model,
    path: &Bound<'_, PyAny>,
    tighten: bool,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Plan> {
    if !model.inner.assembled || !model.inner.mechanism.is_delta() {
        return Err(errors::model_error(py, "expected an assembled robot"));
    }
    let own = model.inner.clone();
    let limits = Limits::of(&own);
    let text = path.extract::<String>().ok().filter(|text| text.contains('\n'));
    let read = match text {
        Some(text) => deltatwin_io::plan::parse(&text, &PathBuf::from("path.toml"), limits),
        None => {
            deltatwin_io::plan::read_with(&path.extract::<PathBuf>()?, limits, Access::with(deltatwin_cell::mesh::read))
        }
    };
    let task = read.map_err(|e| scenario_error(py, &e))?;
    let bar = Bar::of(py, progress, "plan")?;
    let done = run(py, bar.function(), move |_| {
        let plant = Plant::new(&own, &task.setup);
        let machine = Machine::new(&plant, task.limits.detail);
        let options = Options { tighten, clock: seconds, ..task.options };
        let found = planner::plan(&machine, &task.shape.curve(), &task.limits, &options)?;
        let planned = trajectory(&machine, &found, &task.setup, own.sample_time, &task.name)?;
        Ok((found, planned))
    })?;
    match done {
        Ok((found, planned)) => {
            let trajectory = Some(Py::new(py, Recording::from(planned))?);
            Ok(Plan { status: "completed", message: String::new(), trajectory, found: Some(found) })
        }
        Err(error @ PlanError::Place { .. }) => Err(pyo3::exceptions::PyValueError::new_err(error.to_string())),
        Err(error) => {
            let status = if error == PlanError::Unsolved { "not_converged" } else { "infeasible" };
            Ok(Plan { status, message: error.to_string(), trajectory: None, found: None })
        }
    }
}

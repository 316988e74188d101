//! [`Recording`]: measured or simulated signals.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use deltatwin::identification::{Dataset, Method};
use deltatwin::machine::{Axis, Joint, Mechanism};
use deltatwin::recording::{self, Channel, Signals};
use deltatwin_io::recording::{Mapping, Reading};
use numpy::{PyArray1, PyArrayDyn};
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyCapsule;

use crate::arrays::{Course, Rows, array};
use crate::errors;
use crate::model::Model;
use crate::setup::Setup;
use crate::table::{Series, Table};

/// One run of a machine.
#[pyclass(frozen, module = "deltatwin")]
pub struct Recording {
    pub inner: Arc<recording::Recording>,
    #[pyo3(get)]
    warnings: Vec<String>,
    dataset: OnceLock<Arc<Dataset>>,
}

impl From<recording::Recording> for Recording {
    fn from(inner: recording::Recording) -> Self {
        Self { inner: Arc::new(inner), warnings: Vec::new(), dataset: OnceLock::new() }
    }
}

impl Recording {
    /// The smoothed motion with the measured channels; computed once.
    pub fn dataset(&self) -> Arc<Dataset> {
        self.dataset.get_or_init(|| Arc::new(Dataset::new(&self.inner))).clone()
    }

    /// The smoothed motion by a method of differentiation; that of [`Self::dataset`] is computed once.
    pub fn dataset_by(&self, method: Method) -> Arc<Dataset> {
        match method {
            Method::Reversals => self.dataset(),
            other => Arc::new(Dataset::with(&self.inner, other)),
        }
    }

    fn axes(&self) -> usize {
        self.inner.signals.mechanism.axes()
    }

    /// The rows of a quantity of the axes.
    fn joined<'py>(
        &self,
        py: Python<'py>,
        rows: impl Iterator<Item = [f64; 4]>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let own = self.axes();
        let flat: Vec<f64> = rows.flat_map(|row| row.into_iter().take(own)).collect();
        let len = flat.len() / own;
        array(py, flat, &[len, own])
    }
}

/// The value of a channel that is not finite, as an error with row and column.
fn finite(py: Python, channel: Channel, values: &[f64]) -> PyResult<()> {
    let Some(k) = values.iter().position(|x| !x.is_finite()) else { return Ok(()) };
    let text = format!("row {k}, column `{channel}`: {}; expected a finite number", values[k]);
    let made = py.import("deltatwin._errors")?.getattr("DataError")?;
    Err(PyErr::from_value(made.call1((text, None::<String>, k.to_string(), channel.to_string()))?))
}

#[pymethods]
impl Recording {
    /// A recording in a file: CSV or table of any drive software, ``.mcap``, ``.db3``, folder of a ROS 2 bag.
    ///
    /// Parameters
    /// ----------
    /// path : path
    ///     The file; a sidecar ``<stem>.setup.toml`` states payload and noise.
    /// model : Model, optional
    ///     Model whose axes must be there; else the machine follows from the columns.
    /// setup : path, optional
    ///     Setup file in place of the sidecar.
    /// columns : str, optional
    ///     Which column is which channel, such as ``"t=Time[ms], q1=ActPos[deg], tau1=Iq[A]*0.12"``.
    /// joint : str, optional
    ///     One joint of several, read as a single axis.
    /// rate : float, optional
    ///     Samples per second of a file without times.
    /// gear_ratio : float, optional
    ///     Gear ratio of a recording of the motor's side.
    ///
    /// Raises
    /// ------
    /// DataError
    ///     With path, row and column of what cannot be repaired; what was repaired is in ``warnings``.
    #[staticmethod]
    #[pyo3(signature = (path, *, model = None, setup = None, columns = None, joint = None, rate = None, gear_ratio = None))]
    #[expect(clippy::too_many_arguments, reason = "the keywords of the reader")]
    fn read(
        py: Python,
        path: PathBuf,
        model: Option<PyRef<'_, Model>>,
        setup: Option<PathBuf>,
        columns: Option<&str>,
        joint: Option<String>,
        rate: Option<f64>,
        gear_ratio: Option<f64>,
    ) -> PyResult<Self> {
        let maps: Vec<Mapping> = columns
            .map(|text| text.parse::<Mapping>().map_err(|e| PyValueError::new_err(format!("columns: {e}"))))
            .transpose()?
            .into_iter()
            .collect();
        let machine = model.map(|m| m.inner.mechanism);
        let read = py.detach(|| {
            let how = Reading {
                setup: setup.as_deref(),
                machine,
                maps: &maps,
                joint: joint.as_deref(),
                rate,
                gear_ratio,
                ..Reading::default()
            };
            deltatwin_io::recording::read_as(&path, &how)
        });
        let (inner, warnings) = read.map_err(|e| errors::read(py, &e))?;
        Ok(Self { inner: Arc::new(inner), warnings, dataset: OnceLock::new() })
    }

    /// A recording from arrays: times ``t`` ``(n,)`` in s, ``q`` ``(n, dof)`` in rad (m if ``prismatic``), ``tau`` ``(n, dof)`` in N·m (N).
    ///
    /// ``qd`` and ``qdd`` may be given where they were measured; they are else differentiated from ``q``. ``channels`` are others
    /// by the names of their columns, such as ``{"load1": load}``, each ``(n,)``.
    ///
    /// Raises ``DataError`` with row and column of a value that is not finite, or of times that do not increase.
    #[staticmethod]
    #[pyo3(signature = (t, q, tau, *, qd = None, qdd = None, setup = None, channels = None, name = "arrays", prismatic = false))]
    #[expect(clippy::too_many_arguments, reason = "one argument per signal")]
    fn from_arrays(
        py: Python,
        t: &Bound<'_, PyAny>,
        q: &Bound<'_, PyAny>,
        tau: &Bound<'_, PyAny>,
        qd: Option<&Bound<'_, PyAny>>,
        qdd: Option<&Bound<'_, PyAny>>,
        setup: Option<PyRef<'_, Setup>>,
        channels: Option<BTreeMap<String, Bound<'_, PyAny>>>,
        name: &str,
        prismatic: bool,
    ) -> PyResult<Self> {
        let times = py.import("numpy")?.call_method1("asarray", (t, "float64"))?;
        let n = times.len()?;
        let times = Rows::of(&times, "t", n)?.values()?.to_vec();
        let shape: Vec<usize> = py.import("numpy")?.call_method1("shape", (q,))?.extract()?;
        let axes = if shape.len() == 1 { 1 } else { *shape.last().unwrap_or(&0) };
        let mechanism = match axes {
            1 => Mechanism::Axis(Axis::from(if prismatic { Joint::Prismatic } else { Joint::Revolute })),
            3 if prismatic => Mechanism::LINEAR_DELTA,
            3 => Mechanism::delta(false),
            4 => Mechanism::delta(true),
            other => {
                return Err(errors::data_error(py, format!("q has {other} columns; expected 1, 3 or 4 axes")));
            }
        };
        let mut signals = Signals::new(mechanism, Vec::new());
        let first = [Channel::Angle(0), Channel::Torque(0), Channel::Rate(0), Channel::Acceleration(0)];
        for (channel, object) in first.into_iter().zip([Some(q), Some(tau), qd, qdd]) {
            let (Some(object), family) = (object, channel.family()) else { continue };
            let (of, name) = (family.of, family.name);
            let columns = py.import("numpy")?.call_method1("reshape", (object, (-1, axes)))?;
            let rows = Rows::of(&columns, name, axes)?;
            if rows.len != n {
                let text = format!("{name} has {} rows, t has {n}; expected the same number", rows.len);
                return Err(errors::data_error(py, text));
            }
            for k in 0..axes {
                let values: Vec<f64> = rows.values()?.iter().skip(k).step_by(axes).copied().collect();
                finite(py, of(k), &values)?;
                signals.set(of(k), values);
            }
        }
        if let Some(k) = (1..n).find(|&k| times[k] <= times[k - 1] || !times[k].is_finite()) {
            let text = format!("row {k}, column `t`: {}; expected a time after {}", times[k], times[k - 1]);
            return Err(errors::data_error(py, text));
        }
        for (name, values) in channels.unwrap_or_default() {
            let channel =
                Channel::named(&name).ok_or_else(|| errors::data_error(py, format!("{name}: no known channel")))?;
            let values = py.import("numpy")?.call_method1("asarray", (values, "float64"))?;
            let values = Rows::of(&values, &name, n)?.values()?.to_vec();
            finite(py, channel, &values)?;
            signals.set(channel, values);
        }
        signals.t = times;
        let setup = setup.map(|s| s.inner).unwrap_or_default();
        if let Some(misfit) = setup.load.misfit(mechanism) {
            return Err(errors::data_error(py, misfit.to_string()));
        }
        Ok(recording::Recording { name: name.into(), signals, setup }.into())
    }

    /// Write ``.csv`` (with its sidecar) or ``.mcap``. Raises ``FileExistsError`` if there is a file, unless ``force``.
    #[pyo3(signature = (path, *, force = false))]
    fn write(&self, py: Python, path: PathBuf, force: bool) -> PyResult<()> {
        errors::refuse_existing(&path, force)?;
        py.detach(|| deltatwin_io::recording::write(&self.inner, &path)).map_err(|e| errors::write(&e))
    }

    /// Name, usually that of the file.
    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    /// Number of axes.
    #[getter]
    fn dof(&self) -> usize {
        self.axes()
    }

    /// Median sampling period, s.
    #[getter]
    fn sample_time(&self) -> f64 {
        self.inner.signals.sample_time()
    }

    /// Payload, configuration and noise of the run.
    #[getter]
    fn setup(&self) -> Setup {
        Setup { inner: self.inner.setup }
    }

    /// The recording under another setup.
    fn with_setup(&self, setup: PyRef<'_, Setup>) -> Self {
        recording::Recording { setup: setup.inner, ..(*self.inner).clone() }.into()
    }

    /// Times ``(n,)``, s.
    #[getter]
    fn t<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.inner.signals.t)
    }

    /// Joint angles ``(n, dof)``, rad.
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.joined(py, self.inner.signals.q().iter())
    }

    /// Drive torques ``(n, dof)``, N·m.
    #[getter]
    fn tau<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.joined(py, self.inner.signals.tau().iter())
    }

    /// Names of the channels, as in files: ``q1``, ``tau1``, ``strut1_upper``, ``load1``, ….
    #[getter]
    fn channels(&self) -> Vec<String> {
        self.inner.signals.series().map(|(channel, _)| channel.to_string()).collect()
    }

    /// The values ``(n,)`` of a channel by its name. Raises ``KeyError`` if it was not recorded.
    fn __getitem__<'py>(&self, py: Python<'py>, channel: &str) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let values = Channel::named(channel).and_then(|channel| self.inner.signals.get(channel));
        let values = values.ok_or_else(|| PyKeyError::new_err(format!("{channel}: not recorded")))?;
        Ok(PyArray1::from_slice(py, values))
    }

    /// ``t``, ``q``, ``qd``, ``qdd``: the smoothed motion that fits use; a few samples at the ends are lost.
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Course<'py>> {
        let dataset = py.detach(|| self.dataset());
        let of = |get: &dyn Fn(&deltatwin::kinematics::JointState) -> [f64; 4]| {
            self.joined(py, dataset.joints.iter().map(get))
        };
        Ok((PyArray1::from_slice(py, &dataset.t), of(&|j| j.q)?, of(&|j| j.qd)?, of(&|j| j.qdd)?))
    }

    /// All channels as a table; the recording itself is an Arrow C stream, too.
    fn to_arrow(&self) -> Table {
        let mut table = Table::new(&self.inner.name);
        for (name, unit, values) in self.inner.signals.columns() {
            table.push(&name, &unit.to_string(), Series::Float(values.to_vec()));
        }
        table
    }

    /// The channels as an Arrow C stream, see ``Table``.
    #[pyo3(signature = (requested_schema = None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        drop(requested_schema);
        self.to_arrow().stream(py)
    }

    fn __len__(&self) -> usize {
        self.inner.signals.len()
    }

    fn __repr__(&self) -> String {
        let signals = &self.inner.signals;
        let time = signals.t.last().zip(signals.t.first()).map_or(0.0, |(b, a)| b - a);
        format!("Recording({:?}, dof={}, samples={}, seconds={time:.4})", self.inner.name, self.axes(), signals.len())
    }
}

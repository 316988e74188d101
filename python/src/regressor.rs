//! Regressor of the inverse dynamics, and its base columns.

use std::sync::Arc;

use deltatwin::dynamics::{Plant, PlantParameter, Sample, regressor, steady_inverse_dynamics};
use deltatwin::effects::ActiveEffect;
use deltatwin::identification::base_parameters::Structure;
use deltatwin::kinematics::KinematicsError;
use deltatwin::recording::Channel;
use nalgebra::{DMatrix, DVector};
use numpy::PyArrayDyn;
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arrays::{StateView, States, array};
use crate::kinematics::impossible;
use crate::model::Model;
use crate::setup::Setup;

/// Matrix Y with τ = Y·p + constant.
#[pyclass(frozen, module = "deltatwin")]
pub struct Regressor {
    /// `(n, dof, p)`, row by row.
    values: Arc<Vec<f64>>,
    constant: Vec<f64>,
    parameters: Vec<PlantParameter>,
    shape: [usize; 3],
}

/// Independent columns of a regressor, with the combinations of parameters that belong to them.
#[pyclass(frozen, module = "deltatwin")]
pub struct BaseRegressor {
    values: Vec<f64>,
    shape: [usize; 3],
    #[pyo3(get)]
    names: Vec<String>,
    #[pyo3(get)]
    combinations: Vec<String>,
    parameter_values: Vec<f64>,
    #[pyo3(get)]
    condition: f64,
}

/// Rows of the regressor and the torque of one state.
fn row(
    plant: &Plant,
    effects: &[&ActiveEffect],
    channels: &[Channel],
    view: &StateView,
    k: usize,
) -> Result<(DMatrix<f64>, [f64; 4]), KinematicsError> {
    let motion = plant.motion(&view.at(k))?;
    let loads = steady_inverse_dynamics(plant, 0.0, &motion, plant.assembled)?;
    let inner = plant.steady_states(0.0, &motion);
    let states: Vec<&[f64]> = std::iter::once(&[][..]).chain(inner.iter().map(Vec::as_slice)).collect();
    let at = Sample { t: 0.0, motion: &motion, loads: &loads };
    Ok((regressor(plant, effects, &at, &states, channels)?, loads.tau))
}

fn built(plant: &Plant, view: StateView<'_>, dof: usize) -> Result<Regressor, (usize, KinematicsError)> {
    let rigid = plant.rigid_bodies();
    let effects: Vec<&ActiveEffect> = std::iter::once(&rigid).chain(&plant.effects).collect();
    let channels = Channel::of_drives(plant.mechanism);
    let parameters: Vec<PlantParameter> = plant.parameters().into_iter().collect();
    let columns = parameters.len();
    let own: Vec<f64> = parameters.iter().map(|p| p.value).collect();
    let (mut values, mut constant) = (vec![0.0; view.len * dof * columns], vec![0.0; view.len * dof]);
    let pieces = values.par_chunks_mut((dof * columns).max(1)).zip(constant.par_chunks_mut(dof)).enumerate();
    pieces.with_min_len(64).try_for_each(|(k, (out, rest))| {
        let (rows, tau) = row(plant, &effects, &channels, &view, k).map_err(|e| (k, e))?;
        for i in 0..dof {
            for j in 0..columns {
                out[i * columns + j] = rows[(i, j)];
            }
            rest[i] = tau[i] - (0..columns).map(|j| rows[(i, j)] * own[j]).sum::<f64>();
        }
        Ok(())
    })?;
    Ok(Regressor { values: Arc::new(values), constant, parameters, shape: [view.len, dof, columns] })
}

#[pymethods]
impl Model {
    /// Matrix Y with τ = Y·p + constant, for ``q``, ``qd``, ``qdd`` ``(n, dof)``.
    ///
    /// Parameters are those of the links and of all effects, in the order of ``parameters``; columns of parameters that
    /// enter nonlinearly are zero. ``constant`` is what no parameter states, such as a payload.
    ///
    /// Counterpart: ``pinocchio.computeJointTorqueRegressor``; MuJoCo has none.
    #[pyo3(signature = (q, qd = None, qdd = None, *, setup = None))]
    fn regressor<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qd: Option<&Bound<'py, PyAny>>,
        qdd: Option<&Bound<'py, PyAny>>,
        setup: Option<PyRef<'py, Setup>>,
    ) -> PyResult<Regressor> {
        let (plant, dof) = (self.plant(setup.as_deref()), self.dof());
        let states = States::of(q, qd, qdd, dof)?;
        let view = states.view()?;
        py.detach(|| built(&plant, view, dof)).map_err(|(k, e)| impossible(e, k))
    }
}

/// Largest number of rows from which the independent columns are determined.
const MOST_ROWS: usize = 20_000;

#[pymethods]
impl Regressor {
    /// ``(n, dof, columns)``; torque in N·m per unit of each parameter.
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, self.values.to_vec(), &self.shape)
    }

    /// Torques that are no parameter's, ``(n, dof)`` in N·m.
    #[getter]
    fn constant<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, self.constant.clone(), &self.shape[..2])
    }

    /// Names of the parameters, in the order of the columns.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.parameters.iter().map(|p| p.name.clone()).collect()
    }

    /// Units of the parameters.
    #[getter]
    fn units(&self) -> Vec<String> {
        self.parameters.iter().map(|p| p.unit.to_string()).collect()
    }

    /// Present values of the parameters.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let values: Vec<f64> = self.parameters.iter().map(|p| p.value).collect();
        array(py, values, &[self.parameters.len()])
    }

    /// The linearly independent columns along this motion, with the combinations of parameters that they stand for.
    fn base(&self, py: Python) -> BaseRegressor {
        py.detach(|| self.based())
    }

    fn __len__(&self) -> usize {
        self.shape[0]
    }

    fn __repr__(&self) -> String {
        let [n, dof, p] = self.shape;
        format!("Regressor(n={n}, dof={dof}, parameters={p})")
    }
}

impl Regressor {
    fn based(&self) -> BaseRegressor {
        let [n, dof, columns] = self.shape;
        let stride = (n * dof).div_ceil(MOST_ROWS).max(1);
        let rows: Vec<Vec<f64>> =
            self.values.chunks_exact(columns.max(1)).step_by(stride).map(<[f64]>::to_vec).collect();
        // Sizes only scale the columns; one that is zero (an absent inertia) must not hide its column.
        let size = |p: &PlantParameter| if p.usual > 0.0 { p.usual } else { 1.0 };
        let size = DVector::from_iterator(columns, self.parameters.iter().map(size));
        let structure = Structure::new(&rows, stride, &size, 0.0);
        let none = DMatrix::zeros(columns, columns);
        let base = structure.base_parameters(&self.parameters, &size, &none);
        let kept = &structure.independent;
        let values: Vec<f64> =
            self.values.chunks_exact(columns.max(1)).flat_map(|row| kept.iter().map(|&j| row[j])).collect();
        BaseRegressor {
            values,
            shape: [n, dof, kept.len()],
            names: base.iter().map(|b| b.name.clone()).collect(),
            combinations: base.iter().map(deltatwin::identification::BaseParameter::combination).collect(),
            parameter_values: base.iter().map(|b| b.value).collect(),
            condition: structure.condition(),
        }
    }
}

#[pymethods]
impl BaseRegressor {
    #[getter]
    fn matrix<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, self.values.clone(), &self.shape)
    }

    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        array(py, self.parameter_values.clone(), &[self.parameter_values.len()])
    }

    fn __repr__(&self) -> String {
        let [n, dof, b] = self.shape;
        format!("BaseRegressor(n={n}, dof={dof}, base_parameters={b}, condition={:.3e})", self.condition)
    }
}

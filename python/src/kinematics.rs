//! Kinematics: positions, Jacobians, and the motion of all bodies.

use deltatwin::dynamics::Plant;
use deltatwin::kinematics::{self, JointState, KinematicsError, PlatformState};
use deltatwin::machine::bodies::{BODIES, SLOTS, body_name};
use nalgebra::Vector3;
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{self, Rows, States};
use crate::errors;
use crate::model::Model;
use crate::setup::Setup;

/// The exception for state `k`.
pub fn impossible(error: KinematicsError, k: usize) -> PyErr {
    PyValueError::new_err(format!("row {k}: {error}"))
}

/// Refuses a machine without platform.
fn needs_platform(py: Python, plant: &Plant) -> PyResult<()> {
    if plant.assembled {
        return Ok(());
    }
    Err(errors::model_error(py, "the machine has no platform: expected an assembled robot"))
}

/// Motion of all bodies at `n` instants.
#[pyclass(frozen, module = "deltatwin")]
pub struct Motion {
    all: Vec<kinematics::Motion>,
    /// Indices of the bodies.
    bodies: Vec<usize>,
}

impl Motion {
    fn vectors<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&kinematics::BodyMotion) -> Vector3<f64>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let of = |m: &kinematics::Motion| {
            self.bodies.iter().flat_map(|&b| <[f64; 3]>::from(of(&m.bodies[b]))).collect::<Vec<_>>()
        };
        let values = self.all.iter().flat_map(of).collect();
        arrays::array(py, values, &[self.all.len(), self.bodies.len(), 3])
    }
}

#[pymethods]
impl Motion {
    /// Names of the bodies, in the order of the second axis of the arrays.
    #[getter]
    fn bodies(&self) -> Vec<String> {
        self.bodies.iter().map(|&b| body_name(b)).collect()
    }

    /// Origins of the body frames, ``(n, bodies, 3)``, m, inertial frame.
    #[getter]
    fn position<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.vectors(py, |b| b.position)
    }

    /// Velocities of the origins, ``(n, bodies, 3)``, m/s, inertial axes.
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.vectors(py, |b| b.velocity)
    }

    /// Accelerations of the origins, ``(n, bodies, 3)``, m/s², inertial axes, without gravity.
    #[getter]
    fn acceleration<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.vectors(py, |b| b.acceleration)
    }

    /// ``(n, bodies, 3)``, rad/s, inertial axes.
    #[getter]
    fn angular_velocity<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.vectors(py, |b| b.angular_velocity)
    }

    /// ``(n, bodies, 3)``, rad/s², inertial axes.
    #[getter]
    fn angular_acceleration<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.vectors(py, |b| b.angular_acceleration)
    }

    /// Rotation matrices body to inertial frame, ``(n, bodies, 3, 3)``.
    #[getter]
    fn rotation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let rows = |m: &kinematics::Motion| {
            let of = |&b: &usize| (0..9).map(move |k| m.bodies[b].rotation[(k / 3, k % 3)]).collect::<Vec<_>>();
            self.bodies.iter().flat_map(of).collect::<Vec<_>>()
        };
        let values = self.all.iter().flat_map(rows).collect();
        arrays::array(py, values, &[self.all.len(), self.bodies.len(), 3, 3])
    }

    fn __len__(&self) -> usize {
        self.all.len()
    }

    fn __repr__(&self) -> String {
        format!("Motion(instants={}, bodies={})", self.all.len(), self.bodies.len())
    }
}

#[pymethods]
impl Model {
    /// Centre of the platform's ball plane in the inertial frame, ``(n, 3)`` in m, for joint angles ``q`` ``(n, dof)`` in rad.
    ///
    /// Counterpart: ``pinocchio.forwardKinematics`` with the loops closed, ``mujoco.mj_kinematics``.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     With the row whose loops cannot be closed.
    /// ModelError
    ///     If the machine has no platform.
    fn forward_kinematics<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let plant = self.plant(None);
        needs_platform(py, &plant)?;
        let rows = Rows::of(q, "q", self.dof())?;
        let (values, width) = (rows.values()?, rows.width);
        let all = py.detach(|| {
            let mut out = Vec::with_capacity(3 * rows_of(values, width));
            for (k, q) in values.chunks_exact(width).enumerate() {
                let position = plant.geometry.forward(q).map_err(|e| impossible(e, k))?;
                out.extend_from_slice(position.as_slice());
            }
            Ok::<_, PyErr>(out)
        })?;
        rows.shaped(py, all, &[3])
    }

    /// Joint angles ``(n, dof)`` in rad for positions of the platform ``(n, 3)`` in m, elbows outward; ``psi`` is the angle of axis 4 in rad, one number or one per row.
    ///
    /// Joint limits are not checked. Raises as ``forward_kinematics``.
    #[pyo3(signature = (position, psi = None))]
    fn inverse_kinematics<'py>(
        &self,
        py: Python<'py>,
        position: &Bound<'py, PyAny>,
        psi: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let plant = self.plant(None);
        needs_platform(py, &plant)?;
        let rows = Rows::of(position, "position", 3)?;
        let angles: Option<Vec<f64>> = psi
            .map(|psi| match psi.extract::<f64>() {
                Ok(one) => Ok(vec![one; rows.len]),
                Err(_) => psi.extract::<Vec<f64>>(),
            })
            .transpose()?;
        if angles.as_ref().is_some_and(|a| a.len() != rows.len) {
            return Err(PyValueError::new_err(format!("psi: expected a number, or {} numbers", rows.len)));
        }
        let (values, dof) = (rows.values()?, self.dof());
        let all = py.detach(|| {
            let mut out = Vec::with_capacity(dof * rows_of(values, 3));
            for (k, at) in values.chunks_exact(3).enumerate() {
                let pose = PlatformState {
                    position: Vector3::new(at[0], at[1], at[2]),
                    psi: [angles.as_ref().map_or(0.0, |a| a[k]), 0.0, 0.0],
                    ..PlatformState::default()
                };
                let joints = plant.geometry.inverse_motion(&pose).map_err(|e| impossible(e, k))?;
                out.extend_from_slice(&joints.q[..dof]);
            }
            Ok::<_, PyErr>(out)
        })?;
        rows.shaped(py, all, &[dof])
    }

    /// Derivative of the platform's position by the joint angles, ``(n, 3, dof)`` in m/rad.
    ///
    /// Counterpart: ``pinocchio.computeFrameJacobian`` (``LOCAL_WORLD_ALIGNED``, translational rows) after elimination of
    /// the passive joints; ``mujoco.mj_jac``. Raises as ``forward_kinematics``, and at singular poses.
    fn jacobian<'py>(&self, py: Python<'py>, q: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let plant = self.plant(None);
        needs_platform(py, &plant)?;
        let rows = Rows::of(q, "q", self.dof())?;
        let (values, dof) = (rows.values()?, rows.width);
        let all = py.detach(|| {
            let mut out = Vec::with_capacity(3 * dof * rows_of(values, dof));
            for (k, q) in values.chunks_exact(dof).enumerate() {
                let columns = (0..dof).map(|j| {
                    let mut joints = JointState::default();
                    joints.q[..dof].copy_from_slice(q);
                    joints.qd[j] = 1.0;
                    Ok(plant.geometry.forward_motion(&joints).map_err(|e| impossible(e, k))?.velocity)
                });
                let columns = columns.collect::<PyResult<Vec<_>>>()?;
                out.extend((0..3).flat_map(|i| columns.iter().map(move |c| c[i])));
            }
            Ok::<_, PyErr>(out)
        })?;
        rows.shaped(py, all, &[3, dof])
    }

    /// Pose, velocity and acceleration of all bodies, 14 of a delta robot, for ``q``, ``qd``, ``qdd`` ``(n, dof)`` in rad, rad/s, rad/s².
    ///
    /// Counterpart: ``data.oMi``, ``data.v``, ``data.a`` of pinocchio; ``data.xpos``, ``data.cvel`` of MuJoCo.
    #[pyo3(signature = (q, qd = None, qdd = None, *, setup = None))]
    fn motion<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qd: Option<&Bound<'py, PyAny>>,
        qdd: Option<&Bound<'py, PyAny>>,
        setup: Option<PyRef<'py, Setup>>,
    ) -> PyResult<Motion> {
        let plant = self.plant(setup.as_deref());
        let states = States::of(q, qd, qdd, self.dof())?;
        let view = states.view()?;
        let one = |k: usize| plant.motion(&view.at(k)).map_err(|e| impossible(e, k));
        let machine = plant.mechanism;
        let all = machine.is_delta() || machine.limbs() == 1;
        let bodies = (0..SLOTS).filter(|&b| if all { b < BODIES } else { machine.has_body(b) }).collect();
        Ok(Motion { all: py.detach(|| (0..view.len).map(one).collect::<PyResult<_>>())?, bodies })
    }
}

fn rows_of(values: &[f64], width: usize) -> usize {
    values.len() / width.max(1)
}

//! Inverse and forward dynamics.

use deltatwin::constraint_forces::{Detail, MULTIPLIERS, Multipliers, constraint_forces};
use deltatwin::dynamics::{Plant, steady_inverse_dynamics};
use deltatwin::kinematics::{JointState, KinematicsError};
use nalgebra::{DMatrix, DVector};
use numpy::PyArrayDyn;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::arrays::{StateView, States};
use crate::errors;
use crate::kinematics::impossible;
use crate::model::Model;
use crate::setup::Setup;

/// Number of states from which the interpreter is released: about 10 µs of work.
const WORTH_RELEASING: usize = 8;
/// Number of states from which all cores work, and that one core takes at once.
const WORTH_SPREADING: usize = 2048;
const PIECE: usize = 512;

/// The numbers of `of(state)`, `width` each, for all states.
fn each(
    py: Python,
    view: StateView<'_>,
    width: usize,
    of: impl Fn(&JointState, &mut [f64]) -> Result<(), KinematicsError> + Sync,
) -> PyResult<Vec<f64>> {
    let mut out = vec![0.0; view.len * width];
    let one = |(k, own): (usize, &mut [f64])| of(&view.at(k), own).map_err(|e| (k, e));
    let done = if view.len < WORTH_RELEASING {
        out.chunks_exact_mut(width).enumerate().try_for_each(one)
    } else {
        let out = &mut out;
        py.detach(|| {
            if view.len < WORTH_SPREADING {
                return out.chunks_exact_mut(width).enumerate().try_for_each(one);
            }
            out.par_chunks_mut(width).with_min_len(PIECE).enumerate().try_for_each(one)
        })
    };
    done.map_err(|(k, e)| impossible(e, k))?;
    Ok(out)
}

fn torque(plant: &Plant, joints: &JointState) -> Result<[f64; 4], KinematicsError> {
    let motion = plant.motion(joints)?;
    Ok(steady_inverse_dynamics(plant, 0.0, &motion, false)?.tau)
}

/// The machine without force laws: their inertia stays.
fn rigid(plant: &Plant) -> Plant {
    Plant { effects: Vec::new(), ..plant.clone() }
}

/// The mass matrix at a pose: column `i` is the torque of the rigid machine without gravity at q̈ = e_i.
fn mass_matrix(weightless: &Plant, q: &JointState, dof: usize) -> Result<DMatrix<f64>, KinematicsError> {
    let mut mass = DMatrix::zeros(dof, dof);
    for i in 0..dof {
        let mut unit = JointState { q: q.q, ..JointState::default() };
        unit.qdd[i] = 1.0;
        let tau = torque(weightless, &unit)?;
        (0..dof).for_each(|j| mass[(j, i)] = tau[j]);
    }
    Ok(mass)
}

/// Largest torque error (relative to the torques) and number of corrections of [`accelerations`].
const EXACT: f64 = 1e-12;
const MOST_CORRECTIONS: usize = 50;

/// The accelerations whose inverse dynamics are `tau`: q̈ ← q̈ + M⁻¹·(τ − τ(q, q̇, q̈)). Without laws that depend on loads
/// the first step is exact; with them the iteration contracts by a friction coefficient.
fn accelerations(
    (plant, weightless): (&Plant, &Plant),
    state: &JointState,
    tau: &[f64],
) -> Result<DVector<f64>, KinematicsError> {
    let dof = tau.len();
    let mass = mass_matrix(weightless, state, dof)?;
    let solve = mass.lu();
    let mut now = JointState { qdd: [0.0; 4], ..*state };
    let size = tau.iter().fold(1.0f64, |m, x| m.max(x.abs()));
    for _ in 0..MOST_CORRECTIONS {
        let own = torque(plant, &now)?;
        let rest = DVector::from_fn(dof, |i, _| tau[i] - own[i]);
        if rest.amax() <= EXACT * size {
            break;
        }
        let step = solve.solve(&rest).ok_or_else(|| KinematicsError::Singular { q: state.q.into() })?;
        (0..dof).for_each(|i| now.qdd[i] += step[i]);
    }
    Ok(DVector::from_fn(dof, |i, _| now.qdd[i]))
}

#[pymethods]
impl Model {
    /// Drive torques ``(n, dof)`` in N·m for a motion ``q``, ``qd``, ``qdd`` ``(n, dof)`` in rad, rad/s, rad/s²; missing arrays are zero.
    ///
    /// All effects of the model act; internal states (such as a warm gear) are in equilibrium with the motion. ``setup``
    /// states payload and configuration.
    ///
    /// Counterpart: ``pinocchio.rnea`` with the loops closed, ``mujoco.mj_inverse``.
    ///
    /// Raises ``ValueError`` for another shape, and with the row of an impossible or singular pose.
    #[pyo3(signature = (q, qd = None, qdd = None, *, setup = None))]
    fn inverse_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qd: Option<&Bound<'py, PyAny>>,
        qdd: Option<&Bound<'py, PyAny>>,
        setup: Option<PyRef<'py, Setup>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (plant, dof) = (self.plant(setup.as_deref()), self.dof());
        let states = States::of(q, qd, qdd, dof)?;
        let all = each(py, states.view()?, dof, |joints, out| {
            out.copy_from_slice(&torque(&plant, joints)?[..dof]);
            Ok(())
        })?;
        states.q.shaped(py, all, &[dof])
    }

    /// Torques at q̈ = 0: Coriolis, gravity, friction and all other effects, ``(n, dof)`` in N·m.
    ///
    /// Counterpart: ``pinocchio.nonLinearEffects``, ``data.qfrc_bias`` of MuJoCo (minus its passive forces).
    #[pyo3(signature = (q, qd = None, *, setup = None))]
    fn bias<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qd: Option<&Bound<'py, PyAny>>,
        setup: Option<PyRef<'py, Setup>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.inverse_dynamics(py, q, qd, None, setup)
    }

    /// Torques that hold the weight, without the force laws of effects, ``(n, dof)`` in N·m.
    ///
    /// Counterpart: ``pinocchio.computeGeneralizedGravity``.
    #[pyo3(signature = (q, *, setup = None))]
    fn gravity<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        setup: Option<PyRef<'py, Setup>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (plant, dof) = (rigid(&self.plant(setup.as_deref())), self.dof());
        let states = States::of(q, None, None, dof)?;
        let all = each(py, states.view()?, dof, |joints, out| {
            out.copy_from_slice(&torque(&plant, joints)?[..dof]);
            Ok(())
        })?;
        states.q.shaped(py, all, &[dof])
    }

    /// Symmetric mass matrix of the closed mechanism, ``(n, dof, dof)`` in kg·m².
    ///
    /// Counterpart: ``pinocchio.crba``, ``mujoco.mj_fullM``, reduced to the driven axes.
    #[pyo3(signature = (q, *, setup = None))]
    fn mass_matrix<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        setup: Option<PyRef<'py, Setup>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let dof = self.dof();
        let weightless = Plant { gravity: 0.0, ..rigid(&self.plant(setup.as_deref())) };
        let states = States::of(q, None, None, dof)?;
        let all = each(py, states.view()?, dof * dof, |joints, out| {
            // Symmetric: by rows as by columns.
            out.copy_from_slice(mass_matrix(&weightless, joints, dof)?.as_slice());
            Ok(())
        })?;
        states.q.shaped(py, all, &[dof, dof])
    }

    /// Accelerations ``(n, dof)`` in rad/s² under drive torques ``tau`` ``(n, dof)`` in N·m.
    ///
    /// The exact inverse of ``inverse_dynamics``, also where friction depends on the constraint forces.
    ///
    /// Counterpart: ``pinocchio.aba`` or ``constraintDynamics``, ``mujoco.mj_forward``.
    #[pyo3(signature = (q, qd, tau, *, setup = None))]
    fn forward_dynamics<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qd: &Bound<'py, PyAny>,
        tau: &Bound<'py, PyAny>,
        setup: Option<PyRef<'py, Setup>>,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let (plant, dof) = (self.plant(setup.as_deref()), self.dof());
        let weightless = Plant { gravity: 0.0, ..rigid(&plant) };
        // The torques travel in the place of the accelerations.
        let states = States::of(q, Some(qd), Some(tau), dof)
            .map_err(|e| PyValueError::new_err(e.to_string().replace("ValueError: ", "").replace("qdd", "tau")))?;
        let all = each(py, states.view()?, dof, |joints, out| {
            let found = accelerations((&plant, &weightless), joints, &joints.qdd[..dof])?;
            out.copy_from_slice(found.as_slice());
            Ok(())
        })?;
        states.q.shaped(py, all, &[dof])
    }

    /// Multipliers of the joints, ``(n, 21)``; names and order are those of ``constraint_force_names``.
    ///
    /// Struts in N (tension positive) at the platform (``lambda_p``) and at the elbow (``lambda_s``), the bearing of the end
    /// effector (``lambda_e``), drives (``lambda_a``, ``lambda_tb``). ``reduced``: the paper's model, struts loaded along
    /// their axes only.
    ///
    /// Counterpart: ``data.lambda_c`` of pinocchio, ``data.efc_force`` of MuJoCo. Raises ``ModelError`` without struts.
    #[pyo3(signature = (q, qd = None, qdd = None, *, setup = None, reduced = false))]
    #[expect(clippy::too_many_arguments, reason = "the keywords of the method")]
    fn constraint_forces<'py>(
        &self,
        py: Python<'py>,
        q: &Bound<'py, PyAny>,
        qd: Option<&Bound<'py, PyAny>>,
        qdd: Option<&Bound<'py, PyAny>>,
        setup: Option<PyRef<'py, Setup>>,
        reduced: bool,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        let plant = self.plant(setup.as_deref());
        if !plant.assembled {
            return Err(errors::model_error(py, "the machine has no struts: expected an assembled robot"));
        }
        if !plant.is_closed_delta() {
            let why = "the multipliers are known of three limbs and one platform; expected such a robot, or `inverse_dynamics`";
            return Err(errors::model_error(py, why));
        }
        let detail = if reduced { Detail::Reduced } else { Detail::Complete };
        let states = States::of(q, qd, qdd, self.dof())?;
        let all = each(py, states.view()?, MULTIPLIERS, |joints, out| {
            let motion = plant.motion(joints)?;
            let own = plant.steady_states(0.0, &motion);
            let inner: Vec<&[f64]> = own.iter().map(Vec::as_slice).collect();
            out.copy_from_slice(&constraint_forces(&plant, 0.0, &motion, &inner, detail)?.to_array());
            Ok(())
        })?;
        states.q.shaped(py, all, &[MULTIPLIERS])
    }

    /// Names of the columns of ``constraint_forces``.
    #[staticmethod]
    fn constraint_force_names() -> Vec<String> {
        Multipliers::names().to_vec()
    }
}

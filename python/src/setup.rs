//! Conditions of a run: [`Payload`] and [`Setup`].

use std::collections::BTreeMap;

use deltatwin::machine::{self, Configuration, Load};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// What the flange carries.
#[pyclass(frozen, eq, module = "deltatwin")]
#[derive(Clone, PartialEq)]
pub struct Payload {
    pub inner: machine::Payload,
}

#[pymethods]
impl Payload {
    /// A payload of ``mass`` (kg) with its centre of mass at ``com`` (m, from the flange centre, z up, turning with axis 4).
    ///
    /// ``inertia_zz`` or ``inertia`` (xx, yy, zz or xx, yy, zz, xy, xz, yz) are about the centre of mass, kg·m².
    ///
    /// Raises ``ValueError`` for what no body can have. Counterpart: ``pinocchio.Inertia``.
    #[new]
    #[pyo3(signature = (mass, com = [0.0; 3], *, inertia_zz = None, inertia = None))]
    fn new(mass: f64, com: [f64; 3], inertia_zz: Option<f64>, inertia: Option<Vec<f64>>) -> PyResult<Self> {
        if !(0.0..=100.0).contains(&mass) || com.iter().any(|x| !(-10.0..=10.0).contains(x)) {
            return Err(PyValueError::new_err(format!(
                "a payload of {mass} kg at {com:?} m; expected 0 to 100 kg, and lengths from -10 to 10 m"
            )));
        }
        let inner = machine::Payload::stated(mass, com, inertia_zz, inertia.as_deref())
            .map_err(|what| PyValueError::new_err(format!("inertia {what}")))?;
        Ok(Self { inner })
    }

    /// A box of uniform density with edges ``size`` (m) and ``mass`` (kg), held at ``grip`` (m, from its centre).
    #[staticmethod]
    #[pyo3(signature = (size, mass, *, grip = [0.0; 3]))]
    fn cuboid(size: [f64; 3], mass: f64, grip: [f64; 3]) -> PyResult<Self> {
        if !(0.0..=100.0).contains(&mass) || size.iter().any(|x| !(0.0..=10.0).contains(x)) {
            return Err(PyValueError::new_err(format!(
                "a box of {mass} kg and {size:?} m; expected 0 to 100 kg, and edges up to 10 m"
            )));
        }
        Ok(Self { inner: machine::Payload::cuboid(mass, size, grip) })
    }

    #[getter]
    fn mass(&self) -> f64 {
        self.inner.mass
    }

    #[getter]
    fn com(&self) -> [f64; 3] {
        self.inner.com.into()
    }

    #[getter]
    fn inertia(&self) -> [f64; 6] {
        self.inner.moments()
    }

    fn __repr__(&self) -> String {
        format!("Payload(mass={}, com={:?}, inertia={:?})", self.inner.mass, self.com(), self.inertia())
    }

    fn __reduce__(slf: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, Parts)> {
        let own = slf.get();
        let remake = slf.get_type().getattr("_remake")?.unbind();
        Ok((remake, (own.mass(), own.com(), own.inertia(), own.inner.faces.into())))
    }

    #[staticmethod]
    fn _remake(mass: f64, com: [f64; 3], inertia: [f64; 6], faces: [f64; 3]) -> Self {
        let inner = machine::Payload::with_tensor(mass, com, inertia);
        Self { inner: machine::Payload { faces: faces.into(), ..inner } }
    }
}

/// Mass, centre of mass, moments of inertia and faces of a payload.
type Parts = (f64, [f64; 3], [f64; 6], [f64; 3]);

/// A load from its keys.
fn known_load(keys: BTreeMap<String, f64>) -> PyResult<Load> {
    let mut load = Load::default();
    for (key, value) in keys {
        match key.as_str() {
            _ if !value.is_finite() => {
                return Err(PyValueError::new_err(format!("load[{key:?}] is {value}; expected a number")));
            }
            "mass" => load.mass = value,
            "radius" => load.radius = Some(value),
            "force" => load.force = value,
            "torque" => load.torque = value,
            _ => return Err(PyValueError::new_err(format!("load[{key:?}]: expected mass, radius, force or torque"))),
        }
    }
    Ok(load)
}

/// Payload, configuration and noise of a run.
#[pyclass(frozen, eq, module = "deltatwin")]
#[derive(Clone, PartialEq)]
pub struct Setup {
    pub inner: machine::Setup,
}

#[pymethods]
impl Setup {
    /// Conditions of a run: ``payload``, whether the robot is ``assembled``, and the standard deviation of the torque noise
    /// per axis in N·m, if it is known. ``load`` of a single axis has the keys of ``[load]``: ``mass``, ``radius``, ``force``,
    /// ``torque``.
    #[new]
    #[pyo3(signature = (payload = None, *, assembled = true, torque_noise = None, load = None))]
    fn new(
        payload: Option<PyRef<'_, Payload>>,
        assembled: bool,
        torque_noise: Option<Vec<f64>>,
        load: Option<BTreeMap<String, f64>>,
    ) -> PyResult<Self> {
        let noise = torque_noise.map(|given| {
            if given.is_empty() || given.len() > 4 || given.iter().any(|x| !(x.is_finite() && *x >= 0.0)) {
                let text = format!("torque_noise is {given:?}; expected one number from 0 per axis");
                return Err(PyValueError::new_err(text));
            }
            Ok(std::array::from_fn(|i| given.get(i).copied().unwrap_or(0.0)))
        });
        Ok(Self {
            inner: machine::Setup {
                configuration: if assembled { Configuration::Assembled } else { Configuration::Disassembled },
                payload: payload.map(|p| p.inner).unwrap_or_default(),
                torque_noise: noise.transpose()?,
                load: known_load(load.unwrap_or_default())?,
            },
        })
    }

    #[getter]
    fn payload(&self) -> Payload {
        Payload { inner: self.inner.payload }
    }

    #[getter]
    fn assembled(&self) -> bool {
        self.inner.configuration == Configuration::Assembled
    }

    /// Known load of a single axis by the keys of ``[load]``.
    #[getter]
    fn load(&self) -> BTreeMap<&'static str, f64> {
        let Load { mass, radius, force, torque } = self.inner.load;
        let numbers = [("mass", mass), ("force", force), ("torque", torque)];
        let stated = numbers.into_iter().filter(|(_, value)| *value != 0.0);
        stated.chain(radius.map(|radius| ("radius", radius))).collect()
    }

    #[getter]
    fn torque_noise(&self) -> Option<[f64; 4]> {
        self.inner.torque_noise
    }

    fn __repr__(&self) -> String {
        format!("Setup({}, assembled={})", self.payload().__repr__(), if self.assembled() { "True" } else { "False" })
    }
}

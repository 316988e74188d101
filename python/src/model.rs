//! [`Model`]: a machine with its effects.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use deltatwin::dynamics::Plant;
use deltatwin::effects::{self, ActiveEffect, Effect, Role};
use deltatwin::machine::{Limb, Mechanism};
use deltatwin::model;
use deltatwin::text::nearest;
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;

use crate::errors;
use crate::law::Law;
use crate::setup::Setup;
use crate::table::{Series, Table};

/// The shipped models by name.
const SHIPPED: [(&str, &str); 10] = [
    ("irb360-6-1600", include_str!("../../models/irb360-6-1600.toml")),
    ("irb360-6-1600-truth", include_str!("../../models/irb360-6-1600-truth.toml")),
    ("irb360-6-1600-disassembled", include_str!("../../models/irb360-6-1600-disassembled.toml")),
    ("irb360-1-1130", include_str!("../../models/irb360-1-1130.toml")),
    ("irb360-3-1130", include_str!("../../models/irb360-3-1130.toml")),
    ("irb360-8-1130", include_str!("../../models/irb360-8-1130.toml")),
    ("irb360-1-1600", include_str!("../../models/irb360-1-1600.toml")),
    ("clavel-delta", include_str!("../../models/clavel-delta.toml")),
    ("linear-delta", include_str!("../../models/linear-delta.toml")),
    ("servo-axis", include_str!("../../models/servo-axis.toml")),
];

/// A machine with its effects. Models do not change: `with_…` and `without_…` return others.
#[pyclass(frozen, module = "deltatwin")]
pub struct Model {
    pub inner: Arc<model::Model>,
    plant: OnceLock<Arc<Plant>>,
}

impl From<model::Model> for Model {
    fn from(inner: model::Model) -> Self {
        Self { inner: Arc::new(inner), plant: OnceLock::new() }
    }
}

impl Model {
    /// Number of driven axes.
    pub fn dof(&self) -> usize {
        self.inner.mechanism.axes()
    }

    /// The machine under `setup`; without one assembled and without payload.
    pub fn plant(&self, setup: Option<&Setup>) -> Arc<Plant> {
        match setup {
            None => self
                .plant
                .get_or_init(|| Arc::new(Plant::new(&self.inner, &deltatwin::machine::Setup::default())))
                .clone(),
            Some(setup) => Arc::new(Plant::new(&self.inner, &setup.inner)),
        }
    }

    /// The text of a model file.
    pub fn text(&self, py: Python) -> PyResult<String> {
        if let Some(law) = self.inner.effects.iter().find(|a| Law::is_own(&*a.effect)) {
            let text = format!(
                "the effect `{}` is a Python law, which no model file can hold; write it as a formula \
                 ([effects.formula]), or remove it with without_effect",
                law.effect.name()
            );
            return Err(errors::model_error(py, text));
        }
        let written = match &self.inner.source {
            Some(source) => deltatwin_io::model::updated_text(source, &self.inner),
            None => deltatwin_io::model::full_text(&self.inner),
        };
        written.map_err(|e| errors::report(py, &e))
    }

    fn shipped(name: &str) -> PyResult<&'static str> {
        SHIPPED.iter().find(|(own, _)| *own == name).map(|(_, text)| *text).ok_or_else(|| {
            let names: Vec<&str> = SHIPPED.iter().map(|(own, _)| *own).collect();
            let hint = nearest(name, names.iter().copied()).map_or(String::new(), |n| format!("; did you mean {n:?}?"));
            PyKeyError::new_err(format!("no model is called {name:?}; expected one of {}{hint}", names.join(", ")))
        })
    }
}

#[pymethods]
impl Model {
    /// The model in a file.
    ///
    /// Counterpart: ``pinocchio.buildModelFromUrdf``, ``mujoco.MjModel.from_xml_path``.
    ///
    /// Raises
    /// ------
    /// ModelError
    ///     With path, line and column of the first error in the file.
    /// FileNotFoundError
    ///     If there is no file.
    #[staticmethod]
    fn load(py: Python, path: PathBuf) -> PyResult<Self> {
        errors::openable(&path)?;
        deltatwin_io::model::read(&path).map(Self::from).map_err(|e| errors::report(py, &e))
    }

    /// The model in a text; ``path`` is named in errors. Raises ``ModelError`` as ``load`` does.
    #[staticmethod]
    #[pyo3(signature = (text, path = PathBuf::from("model.toml")))]
    fn parse(py: Python, text: &str, path: PathBuf) -> PyResult<Self> {
        deltatwin_io::model::parse(text, &path).map(Self::from).map_err(|e| errors::report(py, &e))
    }

    /// A shipped model by its name, see ``builtin_names``. Raises ``KeyError`` for another name.
    #[staticmethod]
    fn builtin(py: Python, name: &str) -> PyResult<Self> {
        Self::parse(py, Self::shipped(name)?, PathBuf::from(format!("{name}.toml")))
    }

    /// Names of the shipped models.
    #[staticmethod]
    fn builtin_names() -> Vec<&'static str> {
        SHIPPED.iter().map(|(name, _)| *name).collect()
    }

    /// A first model of a single axis from recordings alone: sampling, encoder, travel, limits, noise, inertia, friction
    /// and gravity.
    ///
    /// ``gear_ratio`` is motor turns per turn of the joint, 1 if it is not known. Where the recordings hold the motor's
    /// current, the model is in ampere, and everything is per torque constant.
    ///
    /// Raises ``DataError`` if the recordings are too short or do not move.
    #[staticmethod]
    #[pyo3(signature = (recordings, *, name = "axis", gear_ratio = None))]
    fn from_axis(py: Python, recordings: &Bound<'_, PyAny>, name: &str, gear_ratio: Option<f64>) -> PyResult<Self> {
        let all = crate::data::each(Some(recordings), "recordings", |r| (*r.inner).clone())?;
        if let Some(other) = all.iter().find(|r| !matches!(r.signals.mechanism, Mechanism::Axis(_))) {
            let text = format!("{}: has several axes; expected a recording of one", other.name);
            return Err(errors::data_error(py, text));
        }
        let found = py.detach(|| deltatwin::identification::initial::axis(name, &all, gear_ratio));
        found.map(|initial| initial.model.into()).map_err(|e| errors::data_error(py, e))
    }

    /// The model as the text of a model file; comments of the file it came from are kept.
    ///
    /// Raises ``ModelError`` if the model has a Python law, which no file can hold.
    fn to_toml(&self, py: Python) -> PyResult<String> {
        self.text(py)
    }

    /// Write a model file.
    ///
    /// Raises ``FileExistsError`` if there is a file, unless ``force``; ``ModelError`` as ``to_toml``.
    #[pyo3(signature = (path, *, force = false))]
    fn save(&self, py: Python, path: PathBuf, force: bool) -> PyResult<()> {
        errors::refuse_existing(&path, force)?;
        let text = self.text(py)?;
        deltatwin_io::file::replace_text(&path, &text).map_err(|reason| {
            pyo3::exceptions::PyOSError::new_err(format!("{}: cannot be written: {reason}", path.display()))
        })
    }

    /// Name of the machine.
    #[getter]
    fn name(&self) -> &str {
        &self.inner.name
    }

    /// Number of driven axes: 4 with telescope, 3 without, 1 for a single axis. Counterpart: ``model.nv``.
    #[getter(dof)]
    fn own_dof(&self) -> usize {
        self.dof()
    }

    /// Names of the coordinates, ``q1`` …, in the order of the columns of ``q``.
    #[getter]
    fn joint_names(&self) -> Vec<String> {
        (1..=self.dof()).map(|i| format!("q{i}")).collect()
    }

    /// Whether struts and platform are mounted; else there are kinematics and dynamics of the axes alone.
    #[getter]
    fn has_platform(&self) -> bool {
        self.inner.assembled
    }

    /// Sampling and control period, s.
    #[getter]
    fn sample_time(&self) -> f64 {
        self.inner.sample_time
    }

    /// Limits by name, one number per axis: torque (N·m), speed (rad/s), acceleration (rad/s²), jerk (rad/s³), and
    /// ``arm_angle`` (lower, upper; rad).
    #[getter]
    fn limits(&self) -> BTreeMap<&'static str, Vec<f64>> {
        let drives = &self.inner.drives[..self.dof()];
        let of = |f: &dyn Fn(&deltatwin::machine::Drive) -> f64| drives.iter().map(f).collect::<Vec<f64>>();
        let mut limits = BTreeMap::from([
            ("torque", of(&|d| d.max_torque)),
            ("speed", of(&|d| d.max_speed)),
            ("acceleration", of(&|d| d.max_acceleration)),
            ("jerk", of(&|d| d.max_jerk)),
        ]);
        if matches!(self.inner.mechanism, Mechanism::Delta { .. }) {
            limits.insert("arm_angle", self.inner.geometry.arm_limits().to_vec());
        }
        limits
    }

    /// Lengths of a delta robot in m by name, `strut_length` one per limb: base_radius, arm_length, strut_length, platform_radius, pair_distance (of
    /// the two struts of a limb). Empty for a single axis.
    #[getter]
    fn lengths(&self) -> BTreeMap<&'static str, Vec<f64>> {
        if !matches!(self.inner.mechanism, Mechanism::Delta { .. }) {
            return BTreeMap::new();
        }
        let g = &self.inner.geometry;
        let of = |length: &dyn Fn(&Limb) -> f64| vec![length(&g.limbs[0])];
        BTreeMap::from([
            ("base_radius", of(&|limb| limb.base_radius)),
            ("arm_length", of(&|limb| limb.arm_length)),
            ("strut_length", g.limbs.iter().map(|limb| limb.strut_length).collect()),
            ("platform_radius", vec![g.platform_radius()]),
            ("pair_distance", of(&|limb| limb.pair_distance)),
        ])
    }

    /// Names of the effects in the model, in the order of its parameters.
    #[getter]
    fn effects(&self) -> Vec<&'static str> {
        self.inner.effects.iter().map(|a| a.effect.name()).collect()
    }

    /// Effects that were added by ``add`` or ``diagnose``, in order.
    #[getter]
    fn history(&self) -> Vec<String> {
        self.inner.history.iter().map(|a| a.effect.clone()).collect()
    }

    /// All parameters as a table: name, value, unit, role (linear, shape, fixed), low, high.
    ///
    /// The order is that of the columns of ``regressor``. Counterpart: ``inertia.toDynamicParameters()`` of each body.
    #[getter]
    fn parameters(&self) -> PyResult<Table> {
        let table = self.plant(None).parameters();
        let mut out = Table::new("parameters");
        out.push("name", "", Series::Text(table.iter().map(|p| Some(p.name.clone())).collect()));
        out.push("value", "", Series::Float(table.iter().map(|p| p.value).collect()));
        out.push("unit", "", Series::Text(table.iter().map(|p| Some(p.unit.to_string())).collect()));
        let role = |role: Role| match role {
            Role::Linear => "linear",
            Role::Shape => "shape",
            Role::Fixed => "fixed",
        };
        out.push("role", "", Series::Text(table.iter().map(|p| Some(role(p.role).into())).collect()));
        out.push("low", "", Series::Float(table.iter().map(|p| p.range.0).collect()));
        out.push("high", "", Series::Float(table.iter().map(|p| p.range.1).collect()));
        Ok(out)
    }

    /// The model with other values of some parameters, by their names in ``parameters``.
    ///
    /// Raises ``KeyError`` for a name that the model does not have, ``ValueError`` for a number that is not finite.
    fn with_parameters(&self, values: BTreeMap<String, f64>) -> PyResult<Self> {
        let table = self.plant(None).parameters();
        let mut all = table.values();
        for (name, value) in values {
            let Some(k) = table.named(&name) else {
                let hint = nearest(&name, table.iter().map(|p| p.name.as_str()))
                    .map_or(String::new(), |n| format!("; did you mean {n:?}?"));
                return Err(PyKeyError::new_err(format!("the model has no parameter {name:?}{hint}")));
            };
            if !value.is_finite() {
                return Err(PyValueError::new_err(format!("{name} is {value}; expected a finite number")));
            }
            all[k] = value;
        }
        let mut model = (*self.inner).clone();
        deltatwin::dynamics::set_parameters(&mut model, &all);
        Ok(model.into())
    }

    /// The model with another effect: one of the catalogue by its name, or a ``Law``.
    ///
    /// Values are given by parameter (one number for all of its values, or one for each); others have their usual sizes.
    ///
    /// >>> dt.Model.builtin("irb360-6-1600").with_effect("ball_socket_viscous", coefficient=0.02).effects[-1]
    /// 'ball_socket_viscous'
    ///
    /// Raises ``KeyError`` for an unknown name, ``ValueError`` for a value outside its range or an effect that is there,
    /// ``ModelError`` if the machine does not have the part on which the effect acts.
    #[pyo3(signature = (effect, /, **values))]
    fn with_effect(
        &self,
        py: Python,
        effect: &Bound<'_, PyAny>,
        values: Option<BTreeMap<String, Bound<'_, PyAny>>>,
    ) -> PyResult<Self> {
        let law: Arc<dyn Effect> = match effect.cast::<Law>() {
            Ok(law) => law.get().effect(self.dof()),
            Err(_) => found(&effect.extract::<String>()?)?,
        };
        let name = law.name();
        if self.inner.effects.iter().any(|a| a.effect.name() == name) {
            return Err(PyValueError::new_err(format!("the model has the effect {name:?} already")));
        }
        if !self.inner.mechanism.has(law.acts_on(), self.inner.assembled) {
            let part = law.acts_on().describe();
            return Err(errors::model_error(py, format!("{name} acts on {part}, which this machine does not have")));
        }
        let mut active = ActiveEffect::absent_on(law, self.inner.host()).at_nominal_size();
        for (key, value) in values.unwrap_or_default() {
            set(&mut active, &key, &value)?;
        }
        let mut model = (*self.inner).clone();
        model.effects.push(active);
        Ok(model.into())
    }

    /// The model without an effect. Raises ``KeyError`` if it does not have it.
    fn without_effect(&self, effect: &str) -> PyResult<Self> {
        if !self.inner.effects.iter().any(|a| a.effect.name() == effect) {
            let own = self.effects();
            return Err(PyKeyError::new_err(format!(
                "the model has no effect {effect:?}; expected one of {}",
                own.join(", ")
            )));
        }
        let mut model = (*self.inner).clone();
        model.effects.retain(|a| a.effect.name() != effect);
        Ok(model.into())
    }

    fn __repr__(&self) -> String {
        format!("Model({:?}, dof={}, effects={:?})", self.inner.name, self.dof(), self.effects())
    }

    fn __str__(&self) -> String {
        model::summary(&self.inner)
    }

    fn __reduce__(slf: &Bound<'_, Self>) -> PyResult<(Py<PyAny>, (String, String))> {
        let own = slf.get();
        let path = own.inner.path.clone().unwrap_or_else(|| PathBuf::from("model.toml"));
        let parse = slf.get_type().getattr("parse")?.unbind();
        Ok((parse, (own.text(slf.py())?, path.display().to_string())))
    }
}

/// The registered effect called `name`.
fn found(name: &str) -> PyResult<Arc<dyn Effect>> {
    effects::find(name).ok_or_else(|| {
        let hint = nearest(name, effects::REGISTRY.iter().map(|e| e.name()))
            .map_or(String::new(), |n| format!("; did you mean {n:?}?"));
        PyKeyError::new_err(format!("there is no effect {name:?}{hint}; deltatwin.effects() lists all"))
    })
}

/// Sets the values of a parameter, by its name or by that of one of its values.
fn set(active: &mut ActiveEffect, key: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    let entries = active.entries();
    let numbers: Vec<f64> = match value.extract::<f64>() {
        Ok(one) => vec![one],
        Err(_) => value.extract()?,
    };
    let block = active.effect.parameters().iter().position(|p| p.name == key);
    let places: Vec<usize> = match block {
        Some(block) => (0..entries.len()).filter(|&i| entries[i].param.block == block).collect(),
        None => (0..entries.len()).filter(|&i| entries[i].name == key).collect(),
    };
    if places.is_empty() {
        let names: Vec<String> = active.effect.parameters().iter().map(|p| p.name.to_string()).collect();
        let text = format!("{} has no parameter {key:?}; expected {}", active.effect.name(), names.join(", "));
        return Err(PyKeyError::new_err(text));
    }
    if numbers.len() != 1 && numbers.len() != places.len() {
        let text = format!("{key} has {} number(s); expected 1 or {}", numbers.len(), places.len());
        return Err(PyValueError::new_err(text));
    }
    for (j, i) in places.into_iter().enumerate() {
        let number = numbers[if numbers.len() == 1 { 0 } else { j }];
        let (low, high) = entries[i].parameter.range;
        if !(low..=high).contains(&number) {
            let unit = entries[i].parameter.unit;
            let text = format!("{key} is {number}; expected a number from {low} to {high} {unit}");
            return Err(PyValueError::new_err(text));
        }
        active.values[i] = number;
    }
    Ok(())
}

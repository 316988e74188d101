//! [`Law`]: an effect whose law is a Python function, vectorised over samples.
//!
//! The function is called with all samples of the recordings at once, before a computation begins; what it returned is
//! looked up by the motion of each sample. A motion that was not among those (an experiment that is planned, a run of
//! the twin) is one call per instant.

use std::any::Any;
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap, HashSet};
use std::hash::{BuildHasherDefault, DefaultHasher};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock, Mutex, PoisonError, RwLock};
use std::time::Instant as Clock;

use deltatwin::effects::{About, Effect, Instant, Parameter, Part, Reads, Role, Spec, Unit, Values, Wrenches};
use deltatwin::kinematics::JointState;
use deltatwin::model;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{Rows, array};
use crate::data::Data;

/// Time and motion of a sample, bit by bit.
type Key = [u64; 13];
type Columns = HashMap<Key, Box<[f64]>, BuildHasherDefault<DefaultHasher>>;

/// Samples given to the function at once.
const BATCH: usize = 65_536;
/// Bounds of a parameter, in its usual size.
const RANGE: f64 = 1e3;

/// What a law has in common on machines of any number of axes.
struct Shared {
    function: Py<PyAny>,
    spec: Spec,
    accelerations: bool,
    calls: AtomicU64,
    samples: AtomicU64,
    nanoseconds: AtomicU64,
}

/// A law on a machine with `dof` axes.
struct Function {
    shared: Arc<Shared>,
    dof: usize,
    known: RwLock<Columns>,
}

/// An effect whose law is a Python function.
#[pyclass(frozen, module = "deltatwin")]
pub struct Law {
    shared: Arc<Shared>,
    on: Mutex<HashMap<usize, Arc<Function>>>,
}

/// The first exception of a law since it was last raised.
static RAISED: Mutex<Option<PyErr>> = Mutex::new(None);

/// `text` for as long as the process runs; each text is kept once.
fn forever(text: &str) -> &'static str {
    static KEPT: LazyLock<Mutex<HashSet<&'static str>>> = LazyLock::new(Mutex::default);
    let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
    kept.get(text).copied().unwrap_or_else(|| {
        let own: &'static str = Box::leak(text.to_string().into_boxed_str());
        kept.insert(own);
        own
    })
}

/// Units that a parameter of a law may have.
const UNITS: [Unit; 17] = [
    Unit::One,
    Unit::Kg,
    Unit::KgM,
    Unit::KgM2,
    Unit::N,
    Unit::NPerM,
    Unit::NSPerM,
    Unit::NS2PerM2,
    Unit::NM,
    Unit::NMPerS,
    Unit::NMPerRad,
    Unit::NMSPerRad,
    Unit::A,
    Unit::APerRad,
    Unit::ASPerRad,
    Unit::NPerLaw,
    Unit::NMPerLaw,
];

fn unit(text: &str) -> PyResult<Unit> {
    UNITS.into_iter().find(|unit| unit.to_string() == text).ok_or_else(|| {
        let all: Vec<String> = UNITS.iter().map(ToString::to_string).collect();
        PyValueError::new_err(format!("unit {text:?}; expected one of {}", all.join(", ")))
    })
}

impl Law {
    /// The law as an effect of a machine with `dof` axes; what it has computed is kept.
    pub fn effect(&self, dof: usize) -> Arc<dyn Effect> {
        let mut on = self.on.lock().unwrap_or_else(PoisonError::into_inner);
        let make = || Function { shared: self.shared.clone(), dof, known: RwLock::default() };
        on.entry(dof).or_insert_with(|| Arc::new(make())).clone()
    }

    /// Whether an effect is a Python law.
    pub fn is_own(effect: &dyn Effect) -> bool {
        function(effect).is_some()
    }
}

fn function(effect: &dyn Effect) -> Option<&Function> {
    (effect as &dyn Any).downcast_ref()
}

/// Calls the laws of `others` and of `model` with all samples of the recordings.
///
/// # Errors
/// The exception of a law, or `ValueError` if it returns another shape than it must.
pub fn evaluate(py: Python, model: &model::Model, others: &[Arc<dyn Effect>], data: &Data) -> PyResult<()> {
    let own = model.effects.iter().map(|a| &a.effect);
    for law in own.chain(others).filter_map(|effect| function(&**effect)) {
        // What earlier recordings needed is not kept.
        law.known.write().unwrap_or_else(PoisonError::into_inner).clear();
        for dataset in data.datasets.iter().chain(&data.held_out) {
            let samples: Vec<(f64, JointState)> =
                dataset.t.iter().copied().zip(dataset.joints.iter().copied()).collect();
            for batch in samples.chunks(BATCH) {
                law.learn(py, batch)?;
            }
        }
    }
    Ok(())
}

/// Raises what a law raised during a computation.
///
/// # Errors
/// The exception of the law.
pub fn raised(py: Python) -> PyResult<()> {
    let error = RAISED.lock().unwrap_or_else(PoisonError::into_inner).take();
    error.map_or(Ok(()), |e| Err(e.clone_ref(py)))
}

impl Function {
    fn key(t: f64, joints: &JointState) -> Key {
        let mut key = [0; 13];
        key[0] = t.to_bits();
        let all = joints.q.iter().chain(&joints.qd).chain(&joints.qdd);
        key[1..].iter_mut().zip(all).for_each(|(own, x)| *own = x.to_bits());
        key
    }

    /// The motion that the function sees.
    fn seen(&self, joints: &JointState) -> JointState {
        if self.shared.accelerations { *joints } else { JointState { qdd: [0.0; 4], ..*joints } }
    }

    /// Calls the function with `samples` that are not known yet, and keeps what it returns.
    fn learn(&self, py: Python, samples: &[(f64, JointState)]) -> PyResult<()> {
        let new: Vec<(f64, JointState)> = {
            let known = self.known.read().unwrap_or_else(PoisonError::into_inner);
            let seen = samples.iter().map(|(t, joints)| (*t, self.seen(joints)));
            seen.filter(|(t, joints)| !known.contains_key(&Self::key(*t, joints))).collect()
        };
        if new.is_empty() {
            return Ok(());
        }
        let columns = self.called(py, &new)?;
        let mut known = self.known.write().unwrap_or_else(PoisonError::into_inner);
        for ((t, joints), own) in new.iter().zip(columns) {
            known.insert(Self::key(*t, joints), own);
        }
        Ok(())
    }

    /// What the function returns for `samples`: for each the torque of every parameter and axis.
    fn called(&self, py: Python, samples: &[(f64, JointState)]) -> PyResult<Vec<Box<[f64]>>> {
        let (n, dof, count) = (samples.len(), self.dof, self.shared.spec.parameters.len());
        let rows = |of: &dyn Fn(&JointState) -> [f64; 4]| {
            let flat: Vec<f64> = samples.iter().flat_map(|(_, j)| of(j)[..dof].to_vec()).collect();
            array(py, flat, &[n, dof])
        };
        let begun = Clock::now();
        let t = array(py, samples.iter().map(|(t, _)| *t).collect(), &[n])?;
        let function = self.shared.function.bind(py);
        let (q, qd) = (rows(&|j| j.q)?, rows(&|j| j.qd)?);
        let returned = match self.shared.accelerations {
            true => function.call1((t, q, qd, rows(&|j| j.qdd)?))?,
            false => function.call1((t, q, qd))?,
        };
        let numpy = py.import("numpy")?;
        let shape: Vec<usize> = numpy.call_method1("shape", (&returned,))?.extract()?;
        let is_one = count == 1 && shape == [n, dof];
        if !is_one && shape != [count, n, dof] {
            let expected = if count == 1 { format!("({n}, {dof})") } else { format!("({count}, {n}, {dof})") };
            let text = format!("the law {} returned the shape {shape:?}; expected {expected}", self.shared.spec.name);
            return Err(PyValueError::new_err(text));
        }
        let flat = numpy.call_method1("reshape", (&returned, (count * n, dof)))?;
        let values = Rows::of(&flat, self.shared.spec.name, dof)?;
        let values = values.values()?;
        let of = |k: usize| (0..count).flat_map(|p| &values[(p * n + k) * dof..][..dof]).copied().collect();
        let columns = (0..n).map(of).collect();
        let count = |counter: &AtomicU64, by: u64| counter.fetch_add(by, Ordering::Relaxed);
        count(&self.shared.calls, 1);
        count(&self.shared.samples, n as u64);
        count(&self.shared.nanoseconds, begun.elapsed().as_nanos() as u64);
        Ok(columns)
    }

    /// The columns of one instant; NaN if the function raises.
    fn at(&self, t: f64, joints: &JointState) -> Box<[f64]> {
        let joints = self.seen(joints);
        let key = Self::key(t, &joints);
        if let Some(own) = self.known.read().unwrap_or_else(PoisonError::into_inner).get(&key) {
            return own.clone();
        }
        let found = Python::attach(|py| self.called(py, &[(t, joints)]));
        match found.map(|mut all| all.pop()) {
            Ok(Some(own)) => own,
            Ok(None) => Box::default(),
            Err(error) => {
                RAISED.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                vec![f64::NAN; self.dof * self.shared.spec.parameters.len()].into()
            }
        }
    }
}

impl Effect for Function {
    fn spec(&self) -> &Spec {
        &self.shared.spec
    }

    fn wrenches(&self, values: &Values, at: &Instant, out: &mut Wrenches) {
        let joints = JointState { q: at.motion.q, qd: at.motion.qd, qdd: at.motion.qdd };
        let columns = self.at(at.t, &joints);
        for (k, own) in columns.chunks_exact(self.dof).enumerate() {
            // The function states what the drive must supply, a wrench what acts on the machine.
            (0..self.dof).for_each(|axis| out.drive_torque(values.index(k, 0), axis, -own[axis]));
        }
    }
}

#[pymethods]
impl Law {
    #[new]
    #[pyo3(signature = (name, torque, parameters, *, units = None, nonnegative = false, accelerations = false, summary = "a law in Python"))]
    #[expect(clippy::too_many_arguments, reason = "the keywords of the constructor")]
    fn new(
        name: &str,
        torque: Bound<'_, PyAny>,
        parameters: BTreeMap<String, f64>,
        units: Option<BTreeMap<String, String>>,
        nonnegative: bool,
        accelerations: bool,
        summary: &str,
    ) -> PyResult<Self> {
        if !torque.is_callable() {
            return Err(PyValueError::new_err("torque is no function; expected torque(t, q, qd)"));
        }
        let is_word = |name: &str| !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        if !is_word(name) || deltatwin::effects::find(name).is_some() {
            let text =
                format!("the law is called {name:?}; expected letters, digits and _, and no name of the catalogue");
            return Err(PyValueError::new_err(text));
        }
        if parameters.is_empty() {
            return Err(PyValueError::new_err("parameters is empty; expected names with their usual sizes"));
        }
        let units = units.unwrap_or_default();
        let parameter = |(key, usual): (&String, &f64)| {
            if !(usual.is_finite() && *usual > 0.0) {
                return Err(PyValueError::new_err(format!(
                    "parameter {key}: usual size {usual}; expected one above 0"
                )));
            }
            let own = units.get(key).map_or(Ok(Unit::NMPerLaw), |text| unit(text))?;
            let low = if nonnegative { 0.0 } else { -RANGE * usual };
            let mut made = Parameter::new("", own, Role::Linear, *usual, (low, RANGE * usual));
            made.name = Cow::Owned(key.clone());
            Ok(made)
        };
        let all = parameters.iter().map(parameter).collect::<PyResult<Vec<_>>>()?;
        let summary = forever(summary);
        let about = About { summary, law: "a Python function", shows: "as its function says", source: "the user" };
        let mut spec = Spec::new(forever(name), Part::Drives, about, &[]);
        if accelerations {
            spec = spec.reads(Reads { accelerations: true, ..Reads::MOTION });
        }
        spec.parameters = Cow::Owned(all);
        let shared = Shared {
            function: torque.unbind(),
            spec,
            accelerations,
            calls: AtomicU64::new(0),
            samples: AtomicU64::new(0),
            nanoseconds: AtomicU64::new(0),
        };
        Ok(Self { shared: Arc::new(shared), on: Mutex::default() })
    }

    #[getter]
    fn name(&self) -> &'static str {
        self.shared.spec.name
    }

    #[getter]
    fn parameters(&self) -> Vec<String> {
        self.shared.spec.parameters.iter().map(|p| p.name.to_string()).collect()
    }

    #[getter]
    fn calls(&self) -> u64 {
        self.shared.calls.load(Ordering::Relaxed)
    }

    #[getter]
    fn samples(&self) -> u64 {
        self.shared.samples.load(Ordering::Relaxed)
    }

    #[getter]
    fn seconds(&self) -> f64 {
        1e-9 * self.shared.nanoseconds.load(Ordering::Relaxed) as f64
    }

    fn __repr__(&self) -> String {
        let (name, calls, samples) = (self.name(), self.calls(), self.samples());
        format!("Law({name}: {calls} calls, {samples} samples, {:.3} s)", self.seconds())
    }
}

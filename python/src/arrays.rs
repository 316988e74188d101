//! Arrays of states: `(n, dof)` or `(dof,)`, float64.

use deltatwin::kinematics::JointState;
use numpy::ndarray::{ArrayD, IxDyn};
use numpy::{
    IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

/// Rows of an array, borrowed from it if it is contiguous float64.
pub struct Rows<'py> {
    held: Held<'py>,
    /// Number of rows.
    pub len: usize,
    /// Numbers in a row.
    pub width: usize,
    /// Whether the argument was one row.
    pub single: bool,
}

enum Held<'py> {
    Many(PyReadonlyArray2<'py, f64>),
    One(PyReadonlyArray1<'py, f64>),
}

impl<'py> Rows<'py> {
    /// The rows of `object`, an array `(n, width)` or `(width,)` of float64; anything else that numpy can turn into one
    /// is copied.
    ///
    /// # Errors
    /// `ValueError` with the shape that was expected.
    pub fn of(object: &Bound<'py, PyAny>, name: &str, width: usize) -> PyResult<Self> {
        let py = object.py();
        let given = if object.cast::<PyArray2<f64>>().is_ok() || object.cast::<PyArray1<f64>>().is_ok() {
            object.clone()
        } else {
            py.import("numpy")?.call_method1("asarray", (object, "float64"))?
        };
        let contiguous = |array: Bound<'py, PyAny>| py.import("numpy")?.call_method1("ascontiguousarray", (array,));
        let wrong = |shape: String| {
            PyValueError::new_err(format!("{name} has the shape {shape}; expected (n, {width}) or ({width},)"))
        };
        if let Ok(array) = given.cast::<PyArray2<f64>>() {
            let array = if array.is_c_contiguous() { array.clone() } else { contiguous(given.clone())?.cast_into()? };
            let [len, own] = *array.shape() else {
                return Err(wrong("()".into()));
            };
            if own != width {
                return Err(wrong(format!("({len}, {own})")));
            }
            return Ok(Self { held: Held::Many(array.readonly()), len, width, single: false });
        }
        if let Ok(array) = given.cast::<PyArray1<f64>>() {
            let array = if array.is_c_contiguous() { array.clone() } else { contiguous(given.clone())?.cast_into()? };
            let own = array.len();
            if own != width {
                return Err(wrong(format!("({own},)")));
            }
            return Ok(Self { held: Held::One(array.readonly()), len: 1, width, single: true });
        }
        Err(wrong(given.getattr("shape")?.str()?.to_string()))
    }

    /// The numbers, row by row.
    ///
    /// # Errors
    /// If the array is not contiguous, which it is.
    pub fn values(&self) -> PyResult<&[f64]> {
        Ok(match &self.held {
            Held::Many(array) => array.as_slice()?,
            Held::One(array) => array.as_slice()?,
        })
    }

    /// An array of `(n, shape…)`, or of `shape` if the argument was one row.
    ///
    /// # Errors
    /// If `values` has another number of elements.
    pub fn shaped<'a>(
        &self,
        py: Python<'a>,
        values: Vec<f64>,
        shape: &[usize],
    ) -> PyResult<Bound<'a, PyArrayDyn<f64>>> {
        let mut all = Vec::with_capacity(shape.len() + 1);
        if !self.single {
            all.push(self.len);
        }
        all.extend_from_slice(shape);
        array(py, values, &all)
    }
}

/// An array of a shape.
///
/// # Errors
/// If `values` has another number of elements.
pub fn array<'py>(py: Python<'py>, values: Vec<f64>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let made = ArrayD::from_shape_vec(IxDyn(shape), values).map_err(|e| PyValueError::new_err(e.to_string()))?;
    Ok(made.into_pyarray(py))
}

/// Times `(n,)`, coordinates, rates and accelerations `(n, dof)` of a motion.
pub type Course<'py> =
    (Bound<'py, PyArray1<f64>>, Bound<'py, PyArrayDyn<f64>>, Bound<'py, PyArrayDyn<f64>>, Bound<'py, PyArrayDyn<f64>>);

/// Joint states of one to three arrays of equal shape.
pub struct States<'py> {
    /// Coordinates.
    pub q: Rows<'py>,
    qd: Option<Rows<'py>>,
    qdd: Option<Rows<'py>>,
}

/// Joint states as slices; missing arrays are zero.
#[derive(Clone, Copy)]
pub struct StateView<'a> {
    q: &'a [f64],
    qd: Option<&'a [f64]>,
    qdd: Option<&'a [f64]>,
    width: usize,
    /// Number of states.
    pub len: usize,
}

impl<'py> States<'py> {
    /// The states of `q` and, where given, rates and accelerations of the same shape.
    ///
    /// # Errors
    /// `ValueError` with the shape that was expected.
    pub fn of(
        q: &Bound<'py, PyAny>,
        qd: Option<&Bound<'py, PyAny>>,
        qdd: Option<&Bound<'py, PyAny>>,
        dof: usize,
    ) -> PyResult<Self> {
        let q = Rows::of(q, "q", dof)?;
        let same = |object: Option<&Bound<'py, PyAny>>, name: &str| -> PyResult<Option<Rows<'py>>> {
            let Some(object) = object else { return Ok(None) };
            let rows = Rows::of(object, name, dof)?;
            if rows.len != q.len {
                let text = format!("{name} has {} row(s), q has {}; expected the same number", rows.len, q.len);
                return Err(PyValueError::new_err(text));
            }
            Ok(Some(rows))
        };
        let (qd, qdd) = (same(qd, "qd")?, same(qdd, "qdd")?);
        Ok(Self { q, qd, qdd })
    }

    /// The numbers.
    ///
    /// # Errors
    /// If an array is not contiguous, which it is.
    pub fn view(&self) -> PyResult<StateView<'_>> {
        Ok(StateView {
            q: self.q.values()?,
            qd: self.qd.as_ref().map(Rows::values).transpose()?,
            qdd: self.qdd.as_ref().map(Rows::values).transpose()?,
            width: self.q.width,
            len: self.q.len,
        })
    }
}

impl StateView<'_> {
    /// State `k`.
    pub fn at(&self, k: usize) -> JointState {
        let mut state = JointState::default();
        let range = k * self.width..(k + 1) * self.width;
        let own = |target: &mut [f64; 4], source: Option<&[f64]>| {
            if let Some(source) = source {
                target[..self.width].copy_from_slice(&source[range.clone()]);
            }
        };
        own(&mut state.q, Some(self.q));
        own(&mut state.qd, self.qd);
        own(&mut state.qdd, self.qdd);
        state
    }
}

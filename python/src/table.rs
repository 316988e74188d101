//! [`Table`]: named columns with units, handed on by the Arrow C stream.

use std::sync::Arc;

use arrow_array::ffi_stream::FFI_ArrowArrayStream;
use arrow_array::{ArrayRef, BooleanArray, Float64Array, Int64Array, RecordBatch, RecordBatchIterator, StringArray};
use arrow_schema::{DataType, Field, Schema};
use numpy::PyArray1;
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyCapsule, PyList};

/// Values of a column.
#[derive(Clone)]
pub enum Series {
    /// Numbers; NaN where there is none.
    Float(Vec<f64>),
    /// Numbers that may be missing.
    MaybeFloat(Vec<Option<f64>>),
    /// Whole numbers.
    Integer(Vec<Option<i64>>),
    /// Texts.
    Text(Vec<Option<String>>),
    /// True or false.
    Flag(Vec<Option<bool>>),
}

/// Columns of equal length.
#[pyclass(frozen, module = "deltatwin")]
pub struct Table {
    title: String,
    fields: Vec<Field>,
    columns: Vec<ArrayRef>,
}

/// Key of a column's unit in the metadata of its Arrow field.
const UNIT: &str = "unit";

/// Rows shown in a notebook, at the head.
const SHOWN: usize = 20;

impl Table {
    /// A table without columns.
    pub fn new(title: &str) -> Self {
        Self { title: title.into(), fields: Vec::new(), columns: Vec::new() }
    }

    /// Adds a column.
    pub fn push(&mut self, name: &str, unit: &str, series: Series) {
        let (kind, column): (DataType, ArrayRef) = match series {
            Series::Float(values) => (DataType::Float64, Arc::new(Float64Array::from(values))),
            Series::MaybeFloat(values) => (DataType::Float64, Arc::new(Float64Array::from(values))),
            Series::Integer(values) => (DataType::Int64, Arc::new(Int64Array::from(values))),
            Series::Text(values) => (DataType::Utf8, Arc::new(StringArray::from(values))),
            Series::Flag(values) => (DataType::Boolean, Arc::new(BooleanArray::from(values))),
        };
        let field = Field::new(name, kind, true);
        let with_unit = || field.clone().with_metadata([(UNIT.to_string(), unit.to_string())].into());
        self.fields.push(if unit.is_empty() { field } else { with_unit() });
        self.columns.push(column);
    }

    /// The stream of its one batch, as a capsule `arrow_array_stream`.
    ///
    /// # Errors
    /// If the columns have different lengths.
    pub fn stream<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyCapsule>> {
        let schema = Arc::new(Schema::new(self.fields.clone()));
        let batch = RecordBatch::try_new(schema.clone(), self.columns.clone())
            .map_err(|e| PyValueError::new_err(e.to_string()))?;
        let reader = RecordBatchIterator::new([Ok(batch)], schema);
        PyCapsule::new_with_value(py, FFI_ArrowArrayStream::new(Box::new(reader)), c"arrow_array_stream")
    }

    fn rows(&self) -> usize {
        self.columns.first().map_or(0, |c| c.len())
    }

    fn index(&self, name: &str) -> PyResult<usize> {
        self.fields.iter().position(|f| f.name() == name).ok_or_else(|| {
            let names: Vec<&str> = self.fields.iter().map(|f| f.name().as_str()).collect();
            PyKeyError::new_err(format!("no column is called {name:?}; expected one of {}", names.join(", ")))
        })
    }

    fn text(&self, c: usize, row: usize) -> String {
        let column = self.columns[c].as_any();
        if self.columns[c].is_null(row) {
            return String::new();
        }
        if let Some(all) = column.downcast_ref::<Float64Array>() {
            return deltatwin::text::significant(all.value(row), 5);
        }
        if let Some(all) = column.downcast_ref::<Int64Array>() {
            return all.value(row).to_string();
        }
        if let Some(all) = column.downcast_ref::<BooleanArray>() {
            return all.value(row).to_string();
        }
        column.downcast_ref::<StringArray>().map_or(String::new(), |all| all.value(row).to_string())
    }
}

#[pymethods]
impl Table {
    /// Names of the columns.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.fields.iter().map(|f| f.name().clone()).collect()
    }

    /// Units of the columns; empty for texts.
    #[getter]
    fn units(&self) -> Vec<String> {
        self.fields.iter().map(|f| f.metadata().get(UNIT).cloned().unwrap_or_default()).collect()
    }

    fn __len__(&self) -> usize {
        self.rows()
    }

    /// A column by its name: an array of float64 for numbers (NaN where there is none), else a list.
    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let column = self.columns[self.index(name)?].as_any();
        if let Some(all) = column.downcast_ref::<Float64Array>() {
            let values: Vec<f64> = all.iter().map(|x| x.unwrap_or(f64::NAN)).collect();
            return Ok(PyArray1::from_vec(py, values).into_any());
        }
        if let Some(all) = column.downcast_ref::<Int64Array>() {
            return Ok(PyList::new(py, all.iter())?.into_any());
        }
        if let Some(all) = column.downcast_ref::<BooleanArray>() {
            return Ok(PyList::new(py, all.iter())?.into_any());
        }
        let texts = column.downcast_ref::<StringArray>().map(|all| all.iter().collect::<Vec<_>>()).unwrap_or_default();
        Ok(PyList::new(py, texts)?.into_any())
    }

    /// The table as an Arrow C stream.
    ///
    /// ``polars.DataFrame(table)``, ``pyarrow.table(table)``, ``pandas.DataFrame.from_arrow(table)`` and
    /// ``duckdb.from_arrow(table)`` read it.
    #[pyo3(signature = (requested_schema = None))]
    fn __arrow_c_stream__<'py>(
        &self,
        py: Python<'py>,
        requested_schema: Option<Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyCapsule>> {
        // The protocol lets a producer ignore the schema that a consumer would like.
        drop(requested_schema);
        self.stream(py)
    }

    fn __repr__(&self) -> String {
        format!("Table({}, rows={}, columns={:?})", self.title, self.rows(), self.names())
    }

    pub fn _repr_html_(&self) -> String {
        let escape = deltatwin_report::html::escape;
        let head = |f: &Field| match f.metadata().get(UNIT) {
            Some(unit) => format!("<th>{} / {}</th>", escape(f.name()), escape(unit)),
            None => format!("<th>{}</th>", escape(f.name())),
        };
        let mut html = format!("<table><caption>{}</caption><tr>", escape(&self.title));
        html.extend(self.fields.iter().map(head));
        html += "</tr>";
        for row in 0..self.rows().min(SHOWN) {
            html += "<tr>";
            html.extend((0..self.columns.len()).map(|c| format!("<td>{}</td>", escape(&self.text(c, row)))));
            html += "</tr>";
        }
        html += "</table>";
        if self.rows() > SHOWN {
            html += &format!("<p>… {} more rows</p>", self.rows() - SHOWN);
        }
        html
    }
}

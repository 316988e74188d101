//! Errors of the library as Python exceptions: `ModelError(path, line, column)` and `DataError(row, column)`, both
//! `ValueError`s, defined in `deltatwin/_errors.py`.

use std::path::Path;

use deltatwin_io::Problem;
use deltatwin_io::file::WriteError;
use deltatwin_io::recording::ReadError;
use pyo3::exceptions::{PyFileExistsError, PyOSError, PyRuntimeError, PyValueError};
use pyo3::prelude::*;

/// An exception of the package called `class`, or the error of making it.
fn exception<'py>(py: Python<'py>, class: &str, arguments: impl pyo3::call::PyCallArgs<'py>) -> PyErr {
    let made = || py.import("deltatwin._errors")?.getattr(class)?.call1(arguments);
    match made() {
        Ok(instance) => PyErr::from_value(instance),
        Err(error) => error,
    }
}

/// `file:line:column` as its parts.
fn parts(place: &str) -> (Option<String>, Option<usize>, Option<usize>) {
    let mut back = place.rsplitn(3, ':');
    let (column, line, file) = (back.next(), back.next(), back.next());
    let number = |text: Option<&str>| text.and_then(|t| t.parse::<usize>().ok());
    match (file, number(line), number(column)) {
        (Some(file), Some(line), Some(column)) => (Some(file.into()), Some(line), Some(column)),
        _ => (None, None, None),
    }
}

/// A `ModelError` without a place.
pub fn model_error(py: Python, message: impl std::fmt::Display) -> PyErr {
    exception(py, "ModelError", (message.to_string(), None::<String>, None::<usize>, None::<usize>))
}

/// A `DataError` without a place.
pub fn data_error(py: Python, message: impl std::fmt::Display) -> PyErr {
    exception(py, "DataError", (message.to_string(), None::<String>, None::<String>, None::<String>))
}

/// The exception for an error in a text file.
pub fn problem(py: Python, error: &Problem) -> PyErr {
    let (path, line, column) = parts(&error.place);
    exception(py, "ModelError", (error.to_string(), path, line, column))
}

/// The exception for an error of a reader of text files, with the place if it has one.
pub fn report(py: Python, error: &miette::Report) -> PyErr {
    if let Some(own) = error.downcast_ref::<Problem>() {
        return problem(py, own);
    }
    // Errors that wrap one with a place begin with that place.
    let chain: Vec<String> = error.chain().map(ToString::to_string).collect();
    let message = chain.join(": ");
    let place = message.split(": ").next().map_or((None, None, None), parts);
    exception(py, "ModelError", (message, place.0, place.1, place.2))
}

/// The exception for an error of reading a recording.
pub fn read(py: Python, error: &ReadError) -> PyErr {
    match error {
        ReadError::Io { reason, .. } if reason.kind() == std::io::ErrorKind::NotFound => {
            pyo3::exceptions::PyFileNotFoundError::new_err(error.to_string())
        }
        ReadError::Io { .. } => PyOSError::new_err(error.to_string()),
        ReadError::Content { file, .. } => {
            let path = file.display().to_string();
            exception(py, "DataError", (error.to_string(), Some(path), None::<String>, None::<String>))
        }
        ReadError::Value { file, row, column, .. } => {
            let path = file.display().to_string();
            exception(py, "DataError", (error.to_string(), Some(path), Some(row.clone()), Some(column.clone())))
        }
        ReadError::Setup(own) => problem(py, own),
    }
}

/// The exception for a file that was not written.
pub fn write(error: &WriteError) -> PyErr {
    match error {
        WriteError::Io { .. } => PyOSError::new_err(error.to_string()),
        WriteError::Invalid { .. } => PyValueError::new_err(error.to_string()),
    }
}

/// Refuses a file that is not there.
///
/// # Errors
/// `FileNotFoundError`, or another `OSError`.
pub fn openable(path: &Path) -> PyResult<()> {
    std::fs::metadata(path).map(drop).map_err(|reason| {
        std::io::Error::new(reason.kind(), format!("{}: cannot be read: {reason}", path.display())).into()
    })
}

/// Refuses to replace a file, unless `force`.
///
/// # Errors
/// `FileExistsError` if there is a file.
pub fn refuse_existing(path: &Path, force: bool) -> PyResult<()> {
    if path.exists() && !force {
        let text = format!("{}: exists; expected a new name, or force=True", path.display());
        return Err(PyFileExistsError::new_err(text));
    }
    Ok(())
}

/// A thread ended without a result.
pub fn lost() -> PyErr {
    PyRuntimeError::new_err("the computation ended without a result; please report this")
}

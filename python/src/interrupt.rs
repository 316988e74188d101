//! Long computations outside the interpreter, which Ctrl-C ends.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::Duration;

use pyo3::prelude::*;

use crate::errors;

/// Time between two looks for Ctrl-C, and time for which a computation that was told to stop is waited for.
const LOOK: Duration = Duration::from_millis(50);
const GRACE: Duration = Duration::from_millis(500);

/// What a computation tells while it runs.
enum Told<T> {
    Progress(String, f64),
    Done(Box<T>),
}

/// Handle of a computation by which it tells its progress and learns that it must stop.
pub struct Task<T> {
    stop: Arc<AtomicBool>,
    tell: Sender<Told<T>>,
}

impl<T> Clone for Task<T> {
    fn clone(&self) -> Self {
        Self { stop: self.stop.clone(), tell: self.tell.clone() }
    }
}

impl<T> Task<T> {
    /// Whether it must stop.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// The flag that tells it to stop.
    pub fn stop_flag(&self) -> Arc<AtomicBool> {
        self.stop.clone()
    }

    /// Tells what it does, and how far it is (0 to 1; NaN if that is not known).
    pub fn progress(&self, what: &str, share: f64) {
        let _ = self.tell.send(Told::Progress(what.into(), share));
    }
}

/// The result of `work`, which runs on a thread of its own while the interpreter is free.
///
/// `bar` is called with what is done and how far it is. On Ctrl-C the computation is told to stop; one that does not
/// within half a second is left to end by itself, and its result is dropped.
///
/// # Errors
/// `KeyboardInterrupt`, or the error of `bar`.
pub fn run<T: Send + 'static>(
    py: Python,
    bar: Option<&Bound<'_, PyAny>>,
    work: impl FnOnce(&Task<T>) -> T + Send + 'static,
) -> PyResult<T> {
    let (tell, hear) = channel();
    let task = Task { stop: Arc::new(AtomicBool::new(false)), tell };
    let stop = task.stop.clone();
    std::thread::spawn(move || {
        let result = work(&task);
        let _ = task.tell.send(Told::Done(Box::new(result)));
    });
    // A receiver is used from one thread at a time, which the mutex states.
    let hear = std::sync::Mutex::new(hear);
    let next = |wait: Duration| {
        py.detach(|| hear.lock().map_or(Err(RecvTimeoutError::Disconnected), |hear| hear.recv_timeout(wait)))
    };
    let abandon = |error: PyErr| {
        stop.store(true, Ordering::Relaxed);
        let until = std::time::Instant::now() + GRACE;
        while let Some(left) = until.checked_duration_since(std::time::Instant::now()) {
            if !matches!(next(left), Ok(Told::Progress(..))) {
                break;
            }
        }
        error
    };
    loop {
        match next(LOOK) {
            Ok(Told::Done(result)) => return Ok(*result),
            Ok(Told::Progress(what, share)) => {
                if let Some(bar) = bar {
                    bar.call1((what, share)).map_err(&abandon)?;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return Err(errors::lost()),
        }
        py.check_signals().map_err(&abandon)?;
    }
}

/// What a computation's progress is told to: a bar of `tqdm` if that is installed, a function of one's own, or nothing.
pub struct Bar<'py> {
    tell: Option<Bound<'py, PyAny>>,
    own: bool,
}

impl<'py> Bar<'py> {
    /// The bar for an argument `progress`: `True`, `False` or a function `(what, share)`.
    ///
    /// # Errors
    /// If the argument is none of these.
    pub fn of(py: Python<'py>, progress: Option<&Bound<'py, PyAny>>, title: &str) -> PyResult<Self> {
        let wanted = progress.map_or(Ok(true), |p| p.is_truthy())?;
        let callable = progress.filter(|p| p.is_callable());
        if let Some(function) = callable {
            return Ok(Self { tell: Some(function.clone()), own: false });
        }
        if !wanted {
            return Ok(Self { tell: None, own: false });
        }
        let made = py.import("deltatwin._progress")?.getattr("bar")?.call1((title,))?;
        let tell = (!made.is_none()).then_some(made);
        Ok(Self { own: tell.is_some(), tell })
    }

    /// The function `(what, share)`, if there is one.
    pub fn function(&self) -> Option<&Bound<'py, PyAny>> {
        self.tell.as_ref()
    }
}

impl Drop for Bar<'_> {
    fn drop(&mut self) {
        if let Some(bar) = self.tell.as_ref().filter(|_| self.own) {
            // A bar that cannot be closed is only looks.
            let _ = bar.call_method0("close");
        }
    }
}

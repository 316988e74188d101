//! Fits from one start, each computed once.

use std::cell::RefCell;
use std::rc::Rc;

use crate::diagnosis::fitting::Fitting;
use crate::diagnosis::judge::Judged;
use crate::diagnosis::problem;
use crate::evidence::Chosen;
use crate::identification::fit::{Fit, FitError};

/// Candidates and variants in a fit.
type Key = Vec<(usize, usize)>;

/// Fits from one start, by their set of effects.
#[derive(Default)]
pub(super) struct Fits {
    judged: RefCell<Vec<(Key, Judged)>>,
    columns: RefCell<Vec<(Key, Rc<Vec<problem::Owned>>)>>,
}

/// Key of a set of effects, independent of the order of addition.
fn key(chosen: &[Chosen]) -> Key {
    let mut key: Key = chosen.iter().map(|c| (c.candidate, c.variant)).collect();
    key.sort_unstable();
    key
}

impl Fits {
    /// The fit with `chosen`, computed by `make` at the first request.
    pub fn of<E>(&self, chosen: &[Chosen], make: impl FnOnce() -> Result<Judged, E>) -> Result<Judged, E> {
        let key = key(chosen);
        if let Some((_, known)) = self.judged.borrow().iter().find(|(k, _)| *k == key) {
            return Ok(known.clone());
        }
        let made = make()?;
        self.judged.borrow_mut().push((key, made.clone()));
        Ok(made)
    }

    /// Columns of all parameters at the fit with `chosen`.
    pub fn columns(
        &self,
        chosen: &[Chosen],
        fit: &Fit,
        fitting: &Fitting,
    ) -> Result<Rc<Vec<problem::Owned>>, FitError> {
        let key = key(chosen);
        if let Some((_, known)) = self.columns.borrow().iter().find(|(k, _)| *k == key) {
            return Ok(known.clone());
        }
        let made = Rc::new(fitting.owned_columns(&fit.model)?);
        self.columns.borrow_mut().push((key, made.clone()));
        Ok(made)
    }
}

//! Fits from one start, each computed once.

use std::cell::RefCell;

use crate::diagnosis::judge::Judged;
use crate::evidence::Chosen;

/// Candidates and variants in a fit.
type Key = Vec<(usize, usize)>;

/// Fits from one start, by their set of effects.
#[derive(Default)]
pub(super) struct Fits {
    judged: RefCell<Vec<(Key, Judged)>>,
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
}

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
        if let Some(known) = self.known(chosen) {
            return Ok(known);
        }
        let key = key(chosen);
        let made = make()?;
        self.judged.borrow_mut().push((key, made.clone()));
        Ok(made)
    }

    /// The fit with `chosen` if it was made.
    pub fn known(&self, chosen: &[Chosen]) -> Option<Judged> {
        let key = key(chosen);
        self.judged.borrow().iter().find(|(k, _)| *k == key).map(|(_, known)| known.clone())
    }

    /// All sets of effects that were fitted, with their fits.
    pub fn all(&self) -> Vec<(Vec<Chosen>, Judged)> {
        let chosen = |key: &Key| key.iter().map(|&(candidate, variant)| Chosen { candidate, variant }).collect();
        self.judged.borrow().iter().map(|(key, judged)| (chosen(key), judged.clone())).collect()
    }
}

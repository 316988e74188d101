//! Layout of a flat state: positions and velocities, then internal states of effects, then work.

use std::ops::Range;

/// Index of the work of spin restraint and brakes, after that of the four drives.
pub(super) const WORK_RESTRAINTS: usize = 4;
/// Index of the work of contacts and other external wrenches.
pub(super) const WORK_CONTACT: usize = 5;
/// Index of the work of elastic struts.
pub(super) const WORK_STRUTS: usize = 6;
/// Index of the work of hard stops.
pub(super) const WORK_STOPS: usize = 7;
/// Index of the work of the first effect.
pub(super) const WORK_EFFECTS: usize = 8;

/// Layout of a flat state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    mechanics: usize,
    own: usize,
    effects: usize,
}

impl Layout {
    /// Layout with `mechanics` positions and velocities, `own` internal states and `effects` effects.
    pub fn new(mechanics: usize, own: usize, effects: usize) -> Self {
        Self { mechanics, own, effects }
    }

    pub fn own(&self) -> Range<usize> {
        self.mechanics..self.mechanics + self.own
    }

    pub fn work(&self) -> Range<usize> {
        self.mechanics + self.own..self.len()
    }

    pub fn len(&self) -> usize {
        self.mechanics + self.own + WORK_EFFECTS + self.effects
    }
}

//! Where things stand in a flat state: positions and velocities, then own states of effects, then work done.

use std::ops::Range;

/// Work entries: four drives first, then the restraint of the spins and the brakes.
pub(super) const WORK_RESTRAINTS: usize = 4;
/// Contacts and other wrenches from outside.
pub(super) const WORK_CONTACT: usize = 5;
/// Elastic struts.
pub(super) const WORK_STRUTS: usize = 6;
/// Hard stops.
pub(super) const WORK_STOPS: usize = 7;
/// Then one per effect.
pub(super) const WORK_EFFECTS: usize = 8;

/// Layout of a flat state.
#[derive(Clone, Copy, Debug)]
pub(super) struct Layout {
    mechanics: usize,
    own: usize,
    effects: usize,
}

impl Layout {
    /// Layout with `mechanics` positions and velocities, `own` states of effects and `effects` effects.
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

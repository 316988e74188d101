//! List of the effects of one machine.

use std::ops::{Deref, IndexMut};

use super::ActiveEffect;
use crate::effects::REGISTRY;

/// The effects that act on a machine, always in the order of the registry.
///
/// Model files, parameters, regressor columns and reports all follow this order.
#[derive(Clone, Default)]
pub struct Effects(Vec<ActiveEffect>);

/// Index of an effect in the registry; unregistered effects come last.
fn place(active: &ActiveEffect) -> usize {
    REGISTRY.iter().position(|e| e.name() == active.effect.name()).unwrap_or(REGISTRY.len())
}

impl Effects {
    /// Inserts an effect in registry order, after one of the same name.
    pub fn push(&mut self, active: ActiveEffect) {
        let own = place(&active);
        let at = self.0.partition_point(|a| place(a) <= own);
        self.0.insert(at, active);
    }

    /// Removes and returns effect `i`.
    ///
    /// # Panics
    /// If `i` is out of range.
    pub fn remove(&mut self, i: usize) -> ActiveEffect {
        self.0.remove(i)
    }

    /// Keeps the effects for which `keep` is true.
    pub fn retain(&mut self, keep: impl FnMut(&ActiveEffect) -> bool) {
        self.0.retain(keep);
    }

    /// Removes all effects.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Iterator over the effects, with mutable values.
    pub fn iter_mut(&mut self) -> std::slice::IterMut<'_, ActiveEffect> {
        self.0.iter_mut()
    }
}

impl Deref for Effects {
    type Target = [ActiveEffect];

    fn deref(&self) -> &[ActiveEffect] {
        &self.0
    }
}

impl std::ops::Index<usize> for Effects {
    type Output = ActiveEffect;

    fn index(&self, i: usize) -> &ActiveEffect {
        &self.0[i]
    }
}

impl IndexMut<usize> for Effects {
    fn index_mut(&mut self, i: usize) -> &mut ActiveEffect {
        &mut self.0[i]
    }
}

impl From<Vec<ActiveEffect>> for Effects {
    fn from(mut all: Vec<ActiveEffect>) -> Self {
        all.sort_by_key(place);
        Self(all)
    }
}

impl From<Effects> for Vec<ActiveEffect> {
    fn from(all: Effects) -> Self {
        all.0
    }
}

impl FromIterator<ActiveEffect> for Effects {
    fn from_iter<I: IntoIterator<Item = ActiveEffect>>(all: I) -> Self {
        all.into_iter().collect::<Vec<_>>().into()
    }
}

impl Extend<ActiveEffect> for Effects {
    fn extend<I: IntoIterator<Item = ActiveEffect>>(&mut self, more: I) {
        more.into_iter().for_each(|active| self.push(active));
    }
}

impl<'a> IntoIterator for &'a Effects {
    type Item = &'a ActiveEffect;
    type IntoIter = std::slice::Iter<'a, ActiveEffect>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.iter()
    }
}

impl<'a> IntoIterator for &'a mut Effects {
    type Item = &'a mut ActiveEffect;
    type IntoIter = std::slice::IterMut<'a, ActiveEffect>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.iter_mut()
    }
}

impl IntoIterator for Effects {
    type Item = ActiveEffect;
    type IntoIter = std::vec::IntoIter<ActiveEffect>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::effects::find;

    #[test]
    fn effects_stand_in_the_order_of_the_registry() {
        let absent = |name: &str| ActiveEffect::absent(find(name).unwrap());
        let mut all = Effects::from(vec![absent("signal_delay"), absent("drive_friction")]);
        all.push(absent("ball_socket_coulomb"));
        all.extend([absent("formula"), absent("axis4_friction")]);
        let names: Vec<&str> = all.iter().map(|a| a.effect.name()).collect();
        assert_eq!(names, ["drive_friction", "axis4_friction", "ball_socket_coulomb", "signal_delay", "formula"]);
    }
}

//! Ordered list of the parameters of a machine.

use std::ops::Deref;

use crate::effects::{ActiveEffect, Param, Role};
use crate::machine::Unit;

/// A parameter of a plant.
#[derive(Clone, Debug)]
pub struct PlantParameter {
    /// Identity.
    pub param: Param,
    /// Printed name, e.g. `drive_friction.coulomb_1`.
    pub name: String,
    /// Unit.
    pub unit: Unit,
    /// How it enters the dynamics.
    pub role: Role,
    /// Present value.
    pub value: f64,
    /// Lower and upper bound.
    pub range: (f64, f64),
    /// Typical magnitude.
    pub usual: f64,
    /// Index of its effect among those of the table, and flat index within the effect.
    place: (usize, usize),
}

/// All parameters of a machine, in the order of parameter vectors, regressor columns and model files.
#[derive(Clone, Debug, Default)]
pub struct ParamTable(Vec<PlantParameter>);

impl ParamTable {
    /// Parameters of `effects` in order, one per flat value.
    pub fn new<'a>(effects: impl IntoIterator<Item = &'a ActiveEffect>) -> Self {
        let of = |(number, active): (usize, &ActiveEffect)| {
            let parameter = |(index, (entry, value)): (usize, (crate::effects::Entry, &f64))| PlantParameter {
                param: entry.param,
                name: entry.full_name(),
                unit: entry.parameter.unit,
                role: entry.parameter.role,
                value: *value,
                range: entry.parameter.range,
                usual: entry.parameter.default.abs(),
                place: (number, index),
            };
            active.entries().into_iter().zip(&active.values).enumerate().map(parameter).collect::<Vec<_>>()
        };
        Self(effects.into_iter().enumerate().flat_map(of).collect())
    }

    /// Index of a parameter.
    pub fn index(&self, param: Param) -> Option<usize> {
        self.0.iter().position(|p| p.param == param)
    }

    /// Index of the parameter printed as `name`.
    pub fn named(&self, name: &str) -> Option<usize> {
        self.0.iter().position(|p| p.name == name)
    }

    /// Present values in order.
    pub fn values(&self) -> Vec<f64> {
        self.0.iter().map(|p| p.value).collect()
    }

    /// Indices of the parameters that enter linearly.
    pub fn linear(&self) -> Vec<usize> {
        self.places(|p| p.role == Role::Linear)
    }

    /// Indices of the parameters that can be estimated, without those of the effects named in `fixed`.
    pub fn free(&self, fixed: &[String]) -> Vec<usize> {
        self.places(|p| p.role != Role::Fixed && !fixed.iter().any(|h| h == p.param.effect))
    }

    fn places(&self, keep: impl Fn(&PlantParameter) -> bool) -> Vec<usize> {
        (0..self.0.len()).filter(|&k| keep(&self.0[k])).collect()
    }

    /// The element of `by_effect` (one vector per effect, one entry per flat value) that belongs to parameter `k`.
    ///
    /// # Panics
    /// If `by_effect` has another shape than the effects of the table, or if there is no parameter `k`.
    pub fn pick<'a, T>(&self, k: usize, by_effect: &'a [Vec<T>]) -> &'a T {
        let (effect, index) = self.0[k].place;
        &by_effect[effect][index]
    }
}

impl Deref for ParamTable {
    type Target = [PlantParameter];

    fn deref(&self) -> &[PlantParameter] {
        &self.0
    }
}

impl IntoIterator for ParamTable {
    type Item = PlantParameter;
    type IntoIter = std::vec::IntoIter<PlantParameter>;

    fn into_iter(self) -> Self::IntoIter {
        self.0.into_iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dynamics::Plant;
    use crate::machine::Setup;
    use crate::model::testing::irb360_truth;

    #[test]
    fn every_parameter_is_found_by_identity_and_by_name_where_it_stands() {
        let model = irb360_truth();
        let plant = Plant::new(&model, &Setup::default());
        let table = plant.parameters();
        let effects: Vec<ActiveEffect> = std::iter::once(plant.rigid_bodies()).chain(plant.effects.to_vec()).collect();
        let values: Vec<Vec<f64>> = effects.iter().map(|a| a.values.clone()).collect();
        assert!(table.len() > 30, "{}", table.len());
        for (k, p) in table.iter().enumerate() {
            assert_eq!((table.index(p.param), table.named(&p.name)), (Some(k), Some(k)), "{}", p.name);
            // Block and item address the same value as the flat index.
            let active = effects.iter().find(|a| a.effect.name() == p.param.effect).unwrap();
            let flat = active.values().index(p.param.block, p.param.item);
            assert_eq!((active.values[flat], *table.pick(k, &values)), (p.value, p.value), "{}", p.name);
        }
        let fixed = vec!["drive_friction".to_string()];
        let (linear, free) = (table.linear(), table.free(&fixed));
        assert!(linear.iter().all(|&k| table[k].role == Role::Linear) && linear.len() < table.len());
        assert!(free.iter().all(|&k| table[k].role != Role::Fixed && table[k].param.effect != "drive_friction"));
        assert_eq!(
            table.free(&[]).len() - free.len(),
            table.iter().filter(|p| p.param.effect == "drive_friction" && p.role != Role::Fixed).count()
        );
    }
}

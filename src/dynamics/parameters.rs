//! The parameters of a machine in their order.

use std::ops::Deref;

use crate::effects::{ActiveEffect, Param, Role};
use crate::machine::Unit;

/// A parameter of a plant.
#[derive(Clone, Debug)]
pub struct PlantParameter {
    /// Its identity.
    pub param: Param,
    /// Printed name, e.g. `drive_friction.coulomb_1`.
    pub name: String,
    /// Unit.
    pub unit: Unit,
    /// How it enters.
    pub role: Role,
    /// Present value.
    pub value: f64,
    /// Allowed values.
    pub range: (f64, f64),
    /// Usual magnitude.
    pub usual: f64,
    /// Number of its effect among those of the table, and flat index within the effect.
    place: (usize, usize),
}

/// All parameters of a machine. Vectors of parameters, columns and model files follow its order.
#[derive(Clone, Debug, Default)]
pub struct ParamTable(Vec<PlantParameter>);

impl ParamTable {
    /// Parameters of effects in order, flat value by flat value.
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

    /// Place of a parameter in the order.
    pub fn index(&self, param: Param) -> Option<usize> {
        self.0.iter().position(|p| p.param == param)
    }

    /// Place of the parameter that is printed as `name`.
    pub fn named(&self, name: &str) -> Option<usize> {
        self.0.iter().position(|p| p.name == name)
    }

    /// Present values.
    pub fn values(&self) -> Vec<f64> {
        self.0.iter().map(|p| p.value).collect()
    }

    /// Places of the parameters that enter linearly.
    pub fn linear(&self) -> Vec<usize> {
        self.places(|p| p.role == Role::Linear)
    }

    /// Places of the parameters that can be estimated, without those of the effects `fixed`.
    pub fn free(&self, fixed: &[String]) -> Vec<usize> {
        self.places(|p| p.role != Role::Fixed && !fixed.iter().any(|h| h == p.param.effect))
    }

    fn places(&self, keep: impl Fn(&PlantParameter) -> bool) -> Vec<usize> {
        (0..self.0.len()).filter(|&k| keep(&self.0[k])).collect()
    }

    /// What belongs to parameter `k` of what is given per effect and flat value, in the order of the effects.
    ///
    /// # Panics
    /// If it is given for other effects than the table's.
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
    use crate::model::testing::shipped;

    #[test]
    fn every_parameter_is_found_by_identity_and_by_name_where_it_stands() {
        let model = shipped("irb360-6-1600-truth");
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

//! Effects that a model lacks, with the shapes at which a search begins.

use std::sync::Arc;

use super::orders;
use crate::effects::{self, ActiveEffect, Entry, Role, Start};
use crate::identification::Dataset;
use crate::identification::fit::Fit;
use crate::machine::Unit;
use crate::model::Model;

/// Least number of motor turns in the travel: two periods of order one are distinguished from gravity and springs, which vary over
/// the whole travel.
const LEAST_TURNS: f64 = 2.0;

/// Largest sampling period, s, at which the ringing of elastic gears above 10 Hz is resolved.
const SLOWEST_RINGING: f64 = 4e-3;

/// Effects that the model lacks on the mounted parts of the machine and that the data resolve, each with its initial
/// shapes; cogging at the orders in the residuals of `fit`, if there are any. Laws of the motor angle are left out if the
/// motor hardly turns, because they then resemble gravity and springs, elastic gears where slow samples or coarse angles hide
/// their ringing, and filters of the torque where the motion is smoothed at reversals, because the torque is not. `others` are
/// effects outside the registry.
pub fn testable(
    model: &Model,
    fit: &Fit,
    datasets: &[Dataset],
    others: &[Arc<dyn effects::Effect>],
) -> Vec<Vec<ActiveEffect>> {
    let hides_ringing = datasets.iter().any(|t| t.dt > SLOWEST_RINGING || t.is_coarse());
    let known = absent(model, effects::REGISTRY.iter().chain(others));
    let testable = known.filter(|e| e.spec().identifiable && e.name() != effects::cogging::NAME);
    let turns = orders::motor_turns(model, datasets);
    let of_motor = |e: &dyn effects::Effect| e.parameters().iter().any(|p| p.unit == Unit::GearRatio);
    let testable = testable.filter(|e| turns >= LEAST_TURNS || !of_motor(&**e));
    let is_smoothed = datasets.iter().any(Dataset::smooths_reversals);
    let filters =
        |a: &ActiveEffect| a.effect.sensor().is_some_and(|sensor| sensor.memory(&a.at_nominal_size().values()) > 0.0);
    let hidden = datasets.iter().map(Dataset::hidden_travel).fold(0.0, f64::max);
    let shown = |mut shapes: Vec<ActiveEffect>| {
        shapes.retain(|a| !changes_within(a, hidden));
        shapes
    };
    let testable = testable.map(|e| shown(variants(model, e))).filter(|shapes| !(is_smoothed && filters(&shapes[0])));
    let shapes = testable.filter(|shapes| !(hides_ringing && shapes[0].has_gears()));
    shapes.chain(orders::cogging(model, &fit.residuals, datasets).map(|found| vec![found])).collect()
}

/// Effects that the model lacks and that exist in the twin only: inverse dynamics along a measured motion does not
/// contain them.
pub fn untestable(model: &Model) -> Vec<Arc<dyn effects::Effect>> {
    absent(model, effects::REGISTRY.iter()).filter(|e| !e.spec().identifiable).collect()
}

/// The `effects` that the model lacks, of the mounted parts of the machine.
fn absent<'a>(
    model: &'a Model,
    effects: impl Iterator<Item = &'a Arc<dyn effects::Effect>>,
) -> impl Iterator<Item = Arc<dyn effects::Effect>> {
    effects
        .filter(|e| e.name() != effects::rigid_bodies::NAME && !e.parameters().is_empty())
        .filter(|e| model.mechanism.has(e.acts_on(), model.assembled))
        .filter(|e| !model.effects.iter().any(|a| a.effect.name() == e.name()))
        .cloned()
}

/// Whether a shape of a law that also exists without it changes over an angle below `travel`.
fn changes_within(active: &ActiveEffect, travel: f64) -> bool {
    let within = |(e, value): (Entry, &f64)| {
        e.parameter.or_zero && e.parameter.unit == Unit::Rad && *value > 0.0 && *value < travel
    };
    active.entries().into_iter().zip(&active.values).any(within)
}

/// An absent effect with the model's constants, one variant per initial shape.
pub(super) fn variants(model: &Model, effect: Arc<dyn effects::Effect>) -> Vec<ActiveEffect> {
    let mut base = ActiveEffect::absent_on(effect.clone(), model.host());
    let entries = base.entries();
    for (value, entry) in base.values.iter_mut().zip(&entries).filter(|(_, e)| e.parameter.role != Role::Linear) {
        *value = effect.spec().constant(&entry.parameter.name, &model.view()).unwrap_or(*value);
    }
    let of_role = |role: Role| {
        let own = entries.iter().enumerate().filter(move |(_, e)| e.parameter.role == role);
        own.map(|(i, _)| i)
    };
    if !effect.spec().search.starts.is_empty() {
        return effect.spec().search.starts.iter().map(|start| begun_at(&base, start, model.view().size())).collect();
    }
    // Sets of values that are scaled together. The response of gears depends on their compliance from the start.
    let gears = base.has_gears();
    let searched: Vec<Vec<usize>> = if gears {
        base = base.at_nominal_size();
        vec![of_role(Role::Linear).collect()]
    } else {
        of_role(Role::Shape).map(|i| vec![i]).collect()
    };
    let scaled = |(set, factor): (&Vec<usize>, &f64)| {
        let mut variant = base.clone();
        for &i in set {
            let (low, high) = entries[i].parameter.range;
            variant.values[i] = (factor * base.values[i]).clamp(low, high);
        }
        variant
    };
    let grids = searched.iter().zip(effect.spec().search.grids);
    let mut variants: Vec<ActiveEffect> =
        grids.flat_map(|(set, grid)| grid.iter().map(move |f| (set, f))).map(scaled).collect();
    if variants.is_empty() {
        variants.push(base);
    }
    for (i, _) in
        entries.iter().enumerate().filter(|(_, e)| effect.spec().search.switches.contains(&&*e.parameter.name))
    {
        let switched = |v: ActiveEffect| {
            let mut other = v.clone();
            other.values[i] = 1.0 - other.values[i];
            [v, other]
        };
        variants = variants.into_iter().flat_map(switched).collect();
    }
    variants
}

/// An effect with the values of an initial shape, on a machine of `size` relative to the reference machine.
fn begun_at(active: &ActiveEffect, start: &Start, size: f64) -> ActiveEffect {
    let mut begun = active.clone();
    for (block, values) in start.0.iter().flatten() {
        let first = begun.values().index(*block, 0);
        let factor = if active.effect.parameters()[*block].unit == Unit::M { size } else { 1.0 };
        for (own, value) in begun.values[first..].iter_mut().zip(*values) {
            *own = factor * value;
        }
    }
    begun
}

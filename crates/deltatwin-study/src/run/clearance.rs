//! Margin against contact: how close the robot and its payload come to the objects around it.

use deltatwin::dynamics::Plant;
use deltatwin::kinematics::{JointState, Motion};
use deltatwin::scenario::{ActionKind, Scenario};
use deltatwin::twin::{Contacts, Sample};
use deltatwin_cell::{Cell, Clearance};

use super::margins::Margins;
use super::verdict::CauseKind;

/// Distance at which the margin against contact is 1, m; at contact it is 0, at this depth of overlap −1.
pub const CLEAR: f64 = 0.1;
/// Every which sample is looked at; around the closest of them all are.
const STRIDE: usize = 5;

/// Objects that the gripper picks, which it must touch.
pub fn picked(scenario: &Scenario) -> Vec<usize> {
    let objects = scenario.actions.iter().filter_map(|a| match a.kind {
        ActionKind::Pick(object) => Some(object),
        ActionKind::Release => None,
    });
    objects.collect()
}

/// Takes the distance to the objects along a run into account; nothing without objects.
pub fn follow(margins: &mut Margins, plant: &Plant, scenario: &Scenario, trace: &[Sample]) {
    if scenario.objects.is_empty() || !plant.assembled {
        return;
    }
    let shape = scenario.payload_shape.as_ref();
    let Ok(mut cell) = Cell::new(&scenario.objects, &plant.geometry, shape, plant.gravity_vector()) else { return };
    let without = picked(scenario);
    let mut closest = (f64::INFINITY, 0);
    let mut see = |k: usize, margins: &mut Margins| {
        let sample = &trace[k];
        let Some(motion) = posed(plant, sample) else { return f64::INFINITY };
        let found = cell.clearance(&motion, CLEAR, &without);
        let value = found.map_or(1.0, |c| c.distance / CLEAR);
        margins.see(CauseKind::Contact, sample.t, value, || found.map_or_else(String::new, |c| named(&cell, &c)));
        value
    };
    for k in (0..trace.len()).step_by(STRIDE) {
        let value = see(k, margins);
        if value < closest.0 {
            closest = (value, k);
        }
    }
    if closest.0 < 1.0 {
        let (from, to) = (closest.1.saturating_sub(STRIDE - 1), (closest.1 + STRIDE).min(trace.len()));
        for k in from..to {
            see(k, margins);
        }
    }
}

/// Motion of all bodies at a sample, without accelerations.
fn posed(plant: &Plant, sample: &Sample) -> Option<Motion> {
    plant.motion(&JointState { q: sample.q, qd: sample.rate, ..JointState::default() }).ok()
}

fn named(cell: &Cell, at: &Clearance) -> String {
    format!("{} at {}", cell.name(at.link), cell.name(at.other))
}

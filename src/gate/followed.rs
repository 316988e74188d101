//! Measured over predicted torque of every axis, as recorded.

use super::instants::{Instants, Predicted, plain};
use super::line::Line;
use crate::identification::Dataset;
use crate::model::Model;

/// Largest number of instants.
const INSTANTS: usize = 400;

/// How the measured torque of an axis follows the prediction of the unfitted model.
#[derive(Clone, Debug)]
pub struct Followed {
    /// Axis, from 0.
    pub axis: usize,
    /// Predicted torques at some instants, N·m (N on a prismatic axis).
    pub predicted: Vec<f64>,
    /// Measured torques at the same instants.
    pub measured: Vec<f64>,
    /// Their line; `None` where one of them does not vary.
    pub line: Option<Line>,
}

/// Measured and predicted torques of all axes of a recording at the poses that `model` reaches.
pub fn followed(model: &Model, dataset: &Dataset) -> Vec<Followed> {
    let instants = Instants::of(dataset, INSTANTS);
    let predicted = Predicted::new(&plain(model, dataset), &dataset.channels, 0.0, &instants.joints(|j| *j));
    let axis = |(c, channel): (usize, &crate::recording::Channel)| {
        let axis = channel.drive()?;
        let (there, measured) = (predicted.series[c].clone(), predicted.of(instants.measured(c, 0)));
        Some(Followed { axis, line: Line::of(&there, &measured), predicted: there, measured })
    };
    dataset.channels.iter().enumerate().filter_map(axis).collect()
}

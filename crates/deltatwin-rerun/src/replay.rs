//! Display of a recording in Rerun: moving robot with measured and predicted torques.

use std::path::Path;

use miette::IntoDiagnostic;

use crate::scene::{Scene, Series, measured, write_rrd};
use deltatwin::dynamics::Plant;
use deltatwin::identification::{Dataset, Residuals, predict};
use deltatwin::machine::{AXES, Unit};
use deltatwin::model::Model;
use deltatwin::recording::Recording;

/// Frame rate of the moving robot, Hz.
const FRAMES: f64 = 50.0;
const PREDICTED: [u8; 3] = [225, 225, 225];
const RESIDUAL: [u8; 3] = [200, 60, 60];

/// Writes `recording` with the prediction of `model` as an `.rrd` file.
///
/// # Errors
/// If the prediction or the kinematics fail, or the file cannot be written.
pub fn write(path: &Path, recording: &Recording, model: &Model) -> miette::Result<()> {
    let dataset = Dataset::new(recording);
    let plant = Plant::new(model, &recording.setup);
    let predicted = predict(&plant, &dataset).into_diagnostic()?;
    let noise = dataset.noise(model);
    let left = Residuals::of(&dataset, &predicted).series.remove(0);
    let mut series = measured(recording);
    let axes = plant.mechanism.axes();
    let unit = plant.mechanism.unit(Unit::NM);
    for axis in 0..axes {
        let mut add = |path: String, values: Vec<f64>, color, label: &str| {
            series.push(Series { path, times: dataset.t.clone(), values, color, label: label.into() });
        };
        let axis_name = format!("axis{}", axis + 1);
        add(format!("torque/{axis_name}/model"), predicted[axis].clone(), PREDICTED, &format!("model [{unit}]"));
        add(format!("residual/{axis_name}/residual"), left[axis].clone(), RESIDUAL, &format!("residual [{unit}]"));
    }
    let stride = dataset.stride(1.0 / FRAMES);
    let frames: Vec<usize> = (0..dataset.len()).step_by(stride).collect();
    let times: Vec<f64> = frames.iter().map(|&k| dataset.t[k]).collect();
    let poses = frames.iter().map(|&k| plant.motion(&dataset.joints[k]).map(|m| m.shown(plant.mechanism)));
    let poses = poses.collect::<Result<Vec<_>, _>>().into_diagnostic()?;
    // Mean over a frame, which reduces the noise of single samples.
    let residual: Vec<[f64; AXES]> = frames
        .iter()
        .map(|&k| {
            let window = k.saturating_sub(stride / 2)..(k + stride / 2 + 1).min(dataset.len());
            std::array::from_fn(|i| {
                if i >= axes {
                    return 0.0;
                }
                left[i][window.clone()].iter().sum::<f64>() / window.len() as f64 / noise[i].max(f64::MIN_POSITIVE)
            })
        })
        .collect();
    let mut scene = Scene::new(plant.mechanism, &plant.geometry, times, poses);
    scene.series = series;
    scene.residual = Some(residual);
    write_rrd(path, &recording.name, &scene).into_diagnostic()
}

//! The trajectory of the platform in the colours of its residual, with what they mean.

use nalgebra::Vector3;
use rerun::{RecordingStream, archetypes as a};

use super::content::Scene;
use super::known::Known;
use super::paint::{GHOST, heat};
use super::robot::{AFTER, is_assembled};
use super::{AXIS, Outcome, color, frames, point};
use deltatwin::machine::PerAxis;
use deltatwin::machine::bodies::PLATFORM;

/// Time that the trail of a stream goes back, s.
const BACK: f64 = 2.0;
/// Residuals in the legend, standard deviations, and what it says.
const LEGEND: [(f64, &str); 3] =
    [(1.0, "mean residual over 20 ms: up to 1 σ of it"), (3.5, "3.5 σ"), (6.0, "6 σ and more")];
/// Length of a line of the legend and distance between two, m.
const LINE: (f32, f32) = (0.06, 0.07);

/// Colour of the axis with the largest residual.
fn worst(residual: &PerAxis<f64>) -> [u8; 3] {
    heat(residual.iter().fold(0.0f64, |most, x| most.max(x.abs())))
}

/// Logs the whole trajectory: that of the measured robot, and the same in the colours of the later model.
pub(super) fn whole(rec: &RecordingStream, scene: &Scene) -> Outcome {
    if !is_assembled(scene) {
        return Ok(());
    }
    let path: Vec<_> = scene.bodies.iter().map(|b| point(b[PLATFORM].translation.vector)).collect();
    // One piece per frame, in the colour of the residual there.
    let coloured = |residual: &[PerAxis<f64>]| {
        a::LineStrips3D::new(path.windows(2).map(<[_]>::to_vec))
            .with_colors(residual.iter().skip(1).map(|r| color(worst(r))))
            .with_radii([0.002f32])
    };
    let plain = || a::LineStrips3D::new([path.clone()]).with_colors([color(AXIS[0])]).with_radii([0.001f32]);
    rec.log_static("world/path", &scene.residual.as_deref().map_or_else(plain, coloured))?;
    if let Some(after) = &scene.after {
        rec.log_static(format!("{AFTER}/path"), &coloured(&after.residual))?;
    }
    Ok(())
}

/// Logs the end of the trajectory of a stream.
pub(super) fn end(rec: &RecordingStream, scene: &Scene, known: &mut Known) -> Outcome {
    let Some(&last) = scene.times.last().filter(|_| is_assembled(scene)) else { return Ok(()) };
    for (k, (t, bodies)) in scene.times.iter().zip(&scene.bodies).enumerate() {
        let tint = scene.residual.as_ref().map_or(AXIS[0], |residual| worst(&residual[k]));
        known.trail.push_back((*t, point(bodies[PLATFORM].translation.vector), tint));
    }
    while known.trail.front().is_some_and(|(t, ..)| *t < last - BACK) {
        known.trail.pop_front();
    }
    // It changes as rarely as curves do.
    if scene.series.is_empty() {
        return Ok(());
    }
    let points: Vec<_> = known.trail.iter().collect();
    let path = a::LineStrips3D::update_fields()
        .with_strips(points.windows(2).map(|pair| vec![pair[0].1, pair[1].1]))
        .with_colors(points.iter().skip(1).map(|p| color(p.2)))
        .with_radii(points.iter().skip(1).map(|_| 0.002f32));
    let count = points.len().saturating_sub(1);
    rec.send_columns("world/path", [frames(&[last])], path.columns([count])?)?;
    Ok(())
}

/// Logs what the colours of trail and arms mean, and what the ghost is, beside the robot.
pub(super) fn legend(rec: &RecordingStream, scene: &Scene) -> Outcome {
    let g = scene.geometry;
    let mut lines: Vec<([u8; 3], &str)> = Vec::new();
    if scene.residual.is_some() {
        lines.extend(LEGEND.map(|(sigma, text)| (heat(sigma), text)));
    }
    if scene.ghost.is_some() {
        lines.push((GHOST, scene.ghost_name.as_str()));
    }
    if lines.is_empty() || !is_assembled(scene) {
        return Ok(());
    }
    // Above what moves, beside the housing, and within the first view of the scene.
    let height = g.mounting_height + f64::from(LINE.1);
    let [x, y, z] = point(g.limbs[0].radial() * (-2.5 * g.limbs[0].base_radius) + Vector3::z() * height);
    let strips = (0..lines.len()).map(|k| {
        let height = z - LINE.1 * k as f32;
        [[x, y - 0.5 * LINE.0, height], [x, y + 0.5 * LINE.0, height]]
    });
    let legend = a::LineStrips3D::new(strips)
        .with_colors(lines.iter().map(|(tint, _)| color(*tint)))
        .with_labels(lines.iter().map(|(_, text)| *text))
        .with_show_labels(true)
        .with_radii([0.004f32]);
    rec.log_static("world/legend", &legend)?;
    Ok(())
}

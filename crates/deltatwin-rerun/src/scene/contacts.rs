//! Contacts as arrows: where they are, and the force on the robot.

use rerun::{RecordingStream, archetypes as a};

use super::content::Scene;
use super::known::Known;
use super::{Outcome, color, frames, point};

const ENTITY: &str = "world/contacts";
/// Length of an arrow per force, m/N, and of the longest, m.
const LENGTH: f64 = 2e-3;
const LONGEST: f64 = 0.6;
const RADIUS: f32 = 0.006;
const COLOR: [u8; 3] = [255, 225, 60];

/// Logs the contacts of every frame that has any, and once that there are none.
pub(super) fn arrows(rec: &RecordingStream, scene: &Scene, known: &mut Known) -> Outcome {
    let Some(contacts) = &scene.contacts else { return Ok(()) };
    let (quiet, _) = known.changes(ENTITY, &scene.times, contacts.iter().map(|all| u32::from(!all.is_empty())));
    let sent: Vec<usize> =
        (0..contacts.len()).filter(|&k| !contacts[k].is_empty() || quiet.contains(&scene.times[k])).collect();
    if sent.is_empty() {
        return Ok(());
    }
    let all = || sent.iter().flat_map(|&k| &contacts[k]);
    let length = |force: f64| if force > 0.0 { (LENGTH * force).min(LONGEST) / force } else { 0.0 };
    let arrows = a::Arrows3D::update_fields()
        .with_origins(all().map(|c| point(c.at)))
        .with_vectors(all().map(|c| point(c.force * length(c.force.norm()))))
        .with_labels(all().map(|c| format!("{:.0} N", c.force.norm())))
        .with_colors(all().map(|_| color(COLOR)))
        .with_radii(all().map(|_| RADIUS));
    let times: Vec<f64> = sent.iter().map(|&k| scene.times[k]).collect();
    rec.send_columns(ENTITY, [frames(&times)], arrows.columns(sent.iter().map(|&k| contacts[k].len()))?)?;
    Ok(())
}

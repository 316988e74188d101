//! Colours of the robot's parts: residual, and share of the hold that a load uses.

use rerun::{RecordingStream, Rgba32, archetypes as a};

use super::content::Scene;
use super::known::Known;
use super::robot::{Figure, asset, figures, shown};
use super::solids::{CARBON, CUPS, STEEL};
use super::{Outcome, assets, frames};
use deltatwin::machine::bodies::{BodyKind, body_kind};

/// Colour of a strut with an open socket.
const LOOSE: [u8; 3] = [225, 40, 60];
/// Colour of a ghost, and how little it lets through of what is behind.
pub(super) const GHOST: [u8; 3] = [90, 190, 250];
const GHOST_ALPHA: u8 = 90;

/// What colours a part over time.
#[derive(Clone, Copy)]
pub(super) enum Source {
    /// Residual of an axis.
    Residual(usize),
    /// Load of a strut.
    Strut(usize),
    /// Load of a cup: of a strut, at the elbow (0) or at the platform (1).
    Cup(usize, usize),
}

/// What colours the part `name` of body `b` over time; `None` if it has one colour.
pub(super) fn of(scene: &Scene, figure: &Figure, b: usize, name: &str) -> Option<Source> {
    if figure.is_ghost {
        return None;
    }
    let whole = name.is_empty();
    match body_kind(b) {
        BodyKind::Arm(limb) if whole && limb < scene.machine.arms() => figure.residual.map(|_| Source::Residual(limb)),
        BodyKind::TelescopeUpper | BodyKind::TelescopeLower if whole => figure.residual.map(|_| Source::Residual(3)),
        BodyKind::Strut(s) if whole => (scene.used.is_some() || scene.loose.is_some()).then_some(Source::Strut(s)),
        BodyKind::Strut(s) => {
            let end = CUPS.iter().position(|cup| *cup == name).filter(|_| scene.used.is_some())?;
            Some(Source::Cup(s, end))
        }
        _ => None,
    }
}

/// Colour of a part that has one: its own, or that of a ghost.
pub(super) fn usual(figure: &Figure, [r, g, b]: [u8; 3]) -> Rgba32 {
    let [x, y, z] = GHOST;
    if figure.is_ghost { Rgba32::from_unmultiplied_rgba(x, y, z, GHOST_ALPHA) } else { Rgba32::from_rgb(r, g, b) }
}

/// Entity of the part `name` of a body.
pub(super) fn part_entity(body: &str, name: &str) -> String {
    if name.is_empty() { body.to_string() } else { format!("{body}/{name}") }
}

impl Source {
    /// Colour at frame `k`.
    fn color(self, scene: &Scene, figure: &Figure, k: usize) -> [u8; 3] {
        let used = |socket: usize| scene.used.as_ref().map_or(0.0, |used| used[k][socket]);
        let load = |s: usize, used: f64, usual: [u8; 3]| {
            let is_loose = scene.loose.as_ref().is_some_and(|loose| loose[k][s]);
            if is_loose { LOOSE } else { strain(usual, used) }
        };
        let struts = scene.machine.struts();
        match self {
            Self::Residual(axis) => figure.residual.map_or(STEEL, |residual| heat(residual[k][axis])),
            Self::Strut(s) => load(s, used(s).max(used(struts + s)), CARBON),
            Self::Cup(s, end) => load(s, used(end * struts + s), STEEL),
        }
    }
}

/// Logs the colours where they change.
pub(super) fn colors(rec: &RecordingStream, scene: &Scene, known: &mut Known) -> Outcome {
    for figure in figures(scene) {
        for b in shown(scene) {
            let entity = figure.entity(scene, b);
            let mesh = asset(scene, &figure, b);
            let names: &[&str] = if mesh.is_some() { &[""] } else { &["", CUPS[0], CUPS[1]] };
            for name in names {
                let Some(source) = of(scene, &figure, b, name) else { continue };
                let entity = match mesh {
                    Some(_) => assets::entity(&entity),
                    None => part_entity(&entity, name),
                };
                let packed = |k: usize| {
                    let [r, g, b] = source.color(scene, &figure, k);
                    Rgba32::from_rgb(r, g, b).to_u32()
                };
                let (times, colors) = known.changes(&entity, &scene.times, (0..scene.times.len()).map(packed));
                if times.is_empty() {
                    continue;
                }
                let colors = colors.into_iter().map(Rgba32::from_u32);
                let columns: Vec<_> = match mesh {
                    Some(_) => {
                        a::Asset3D::update_fields().with_many_albedo_factor(colors).columns_of_unit_batches()?.collect()
                    }
                    None => {
                        a::Mesh3D::update_fields().with_many_albedo_factor(colors).columns_of_unit_batches()?.collect()
                    }
                };
                rec.send_columns(entity, [frames(&times)], columns)?;
            }
        }
    }
    Ok(())
}

/// Colour of a part that uses the share `used` of its hold: its `usual` colour up to a half, yellow at three quarters, red
/// at the limit.
fn strain(usual: [u8; 3], used: f64) -> [u8; 3] {
    let stops = [usual, [240, 200, 60], [225, 40, 40]];
    let x = if used.is_finite() { (4.0 * (used - 0.5)).clamp(0.0, 2.0) } else { 2.0 };
    let i = (x as usize).min(1);
    let mix = |a: u8, b: u8| (f64::from(a) + (x - i as f64) * (f64::from(b) - f64::from(a))) as u8;
    std::array::from_fn(|c| mix(stops[i][c], stops[i + 1][c]))
}

/// Colour of a residual: green up to 1 σ, yellow at 3.5 σ, red from 6 σ.
pub(super) fn heat(sigma: f64) -> [u8; 3] {
    let stops = [[70.0, 170.0, 90.0], [240.0, 200.0, 60.0], [215.0, 50.0, 45.0]];
    let x = if sigma.is_finite() { (sigma.abs() - 1.0).clamp(0.0, 5.0) / 2.5 } else { 2.0 };
    let i = (x as usize).min(1);
    std::array::from_fn(|c| (stops[i][c] + (x - i as f64) * (stops[i + 1][c] - stops[i][c])) as u8)
}

#[cfg(test)]
mod tests {
    use super::{CARBON, heat, strain};

    #[test]
    fn strain_colours() {
        assert_eq!((strain(CARBON, 0.0), strain(CARBON, 0.5)), (CARBON, CARBON));
        assert_eq!((strain(CARBON, 0.75), strain(CARBON, 1.2)), ([240, 200, 60], [225, 40, 40]));
        assert_eq!(strain(CARBON, f64::NAN), [225, 40, 40]);
    }

    #[test]
    fn residual_colours() {
        assert_eq!(heat(0.5), [70, 170, 90]);
        assert_eq!(heat(-3.5), [240, 200, 60]);
        assert_eq!(heat(50.0), [215, 50, 45]);
        assert_eq!(heat(f64::NAN), [215, 50, 45]);
    }
}

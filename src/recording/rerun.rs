//! The moving robot and its signals as a Rerun recording (`.rrd`).

use std::path::Path;

use rerun::blueprint as bp;
use rerun::components::{Color, FillMode};
use rerun::external::re_sdk_types::blueprint::components::PanelState;
use rerun::{RecordingStream, TimeColumn, archetypes as a};

use super::{Recording, WriteError, file};
use crate::kinematics::Motion;
use crate::model::bodies::{
    ARM, BODIES, END_EFFECTOR, PLATFORM, ROTOR, STRUT, TELESCOPE_LOWER, TELESCOPE_UPPER, body_name,
};
use crate::model::{ARMS, AXES, Geometry, STRUTS};

/// Name of the timeline, s.
const TIME: &str = "time";
const APPLICATION: &str = "deltatwin";

const STEEL: [u8; 3] = [150, 155, 165];
const CARBON: [u8; 3] = [60, 62, 70];
const ORANGE: [u8; 3] = [235, 125, 40];
const BRASS: [u8; 3] = [215, 175, 80];
/// Colours of axes 1–4 in plots.
const AXIS: [[u8; 3]; AXES] = [[76, 140, 220], [235, 125, 40], [90, 175, 95], [170, 105, 200]];

/// What is drawn.
pub struct Scene<'a> {
    /// Time of each frame, s; increasing, some 50 per second are enough.
    pub times: &'a [f64],
    /// Motion of all bodies, one per frame.
    pub motions: &'a [Motion],
    /// Lengths of the bodies.
    pub geometry: &'a Geometry,
    /// Curves beside the robot, at their own rate.
    pub series: Vec<Series>,
    /// Torque residual per frame and axis in standard deviations of the sensor noise; colours arms and telescope from
    /// green (noise) to red (6 σ).
    pub residual: Option<&'a [[f64; AXES]]>,
}

/// A curve over time.
pub struct Series {
    /// Place in the tree: tab, plot and curve, e.g. `torque/axis1/measured`.
    pub path: String,
    /// Times, s.
    pub times: Vec<f64>,
    /// Values, one per time.
    pub values: Vec<f64>,
    /// Red, green, blue.
    pub color: [u8; 3],
    /// Legend with the unit, e.g. `measured [N·m]`.
    pub label: String,
}

/// Curves of what was recorded: torques, joint angles, strut forces.
pub fn measured(recording: &Recording) -> Vec<Series> {
    let s = &recording.signals;
    let mut series = Vec::new();
    let mut add = |path: String, values: Vec<f64>, color, label: &str| {
        series.push(Series { path, times: s.t.clone(), values, color, label: label.into() });
    };
    for k in 0..AXES {
        let path = format!("torque/axis{}/measured", k + 1);
        add(path, s.tau.iter().map(|v| v[k]).collect(), AXIS[k], "measured [N·m]");
    }
    for k in 0..AXES {
        let (path, label) = (format!("joints/axis{}/angle", k + 1), format!("q{} [rad]", k + 1));
        add(path, s.q.iter().map(|v| v[k]).collect(), AXIS[k], &label);
    }
    for (end, forces, shade) in [("upper", &s.strut_upper, 1.0), ("lower", &s.strut_lower, 0.6)] {
        for (i, force) in forces.iter().enumerate() {
            let Some(force) = force else { continue };
            let color = AXIS[i / 2].map(|c| (f64::from(c) * shade) as u8);
            let path = format!("struts/strut{}/{end}", i + 1);
            add(path, force.clone(), color, &format!("{end} end [N]"));
        }
    }
    series
}

/// Writes the robot, its curves and a layout for them. A file that is there is replaced as a whole.
pub fn write_rrd(path: &Path, name: &str, scene: &Scene) -> Result<(), WriteError> {
    check(scene).map_err(|problem| WriteError::invalid(path, problem))?;
    let io_error = |source| WriteError::Io { file: path.into(), source };
    let temporary = file::beside(path).map_err(io_error)?.into_temp_path();
    log(&temporary, name, scene).map_err(|e| io_error(std::io::Error::other(e)))?;
    temporary.persist(path).map_err(|e| io_error(e.error))
}

fn check(scene: &Scene) -> Result<(), String> {
    let frames = scene.times.len();
    let expect = |what: &str, count: usize, wanted: usize| {
        (count == wanted).then_some(()).ok_or_else(|| format!("{what}: {count} values for {wanted} times"))
    };
    expect("motions", scene.motions.len(), frames)?;
    expect("residual", scene.residual.map_or(frames, <[_]>::len), frames)?;
    scene.series.iter().try_for_each(|s| expect(&s.path, s.values.len(), s.times.len()))
}

type Outcome = Result<(), Box<dyn std::error::Error + Send + Sync>>;

fn log(path: &Path, name: &str, scene: &Scene) -> Outcome {
    let rec = rerun::RecordingStreamBuilder::new(APPLICATION)
        .recording_name(name)
        .with_blueprint(layout(&scene.series))
        .enabled(true)
        .save(path)?;
    rec.log_static("world", &a::ViewCoordinates::RIGHT_HAND_Z_UP())?;
    base(&rec, scene.geometry)?;
    robot(&rec, scene)?;
    for s in &scene.series {
        curve(&rec, s)?;
    }
    rec.flush_blocking()?;
    Ok(())
}

/// Robot left; a tab per first part of the paths and in it a plot per second part.
fn layout(series: &[Series]) -> bp::Blueprint {
    let mut tabs: Vec<(&str, Vec<&str>)> = Vec::new();
    for s in series {
        let mut parts = s.path.splitn(3, '/');
        let tab = parts.next().unwrap_or_default();
        let plot = match (parts.next(), parts.next()) {
            (Some(plot), Some(_)) => plot,
            _ => "",
        };
        let i = tabs.iter().position(|(name, _)| *name == tab).unwrap_or_else(|| {
            tabs.push((tab, Vec::new()));
            tabs.len() - 1
        });
        if !tabs[i].1.contains(&plot) {
            tabs[i].1.push(plot);
        }
    }
    let tabs = tabs.into_iter().map(|(tab, plots)| {
        let views = plots.into_iter().map(|plot| {
            let (name, origin) = match plot {
                "" => (tab.to_string(), format!("/{tab}")),
                _ => (plot.to_string(), format!("/{tab}/{plot}")),
            };
            bp::ContainerLike::from(bp::TimeSeriesView::new(name).with_origin(origin))
        });
        bp::Vertical::new(views.collect::<Vec<_>>()).with_name(tab).into()
    });
    let tabs: Vec<bp::ContainerLike> = tabs.collect();
    let mut parts = vec![bp::Spatial3DView::new("robot").with_origin("/world").into()];
    if !tabs.is_empty() {
        parts.push(bp::Tabs::new(tabs).into());
    }
    bp::Blueprint::new(bp::Horizontal::new(parts))
        .with_auto_views(false)
        .with_blueprint_panel(bp::BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(bp::SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(bp::TimePanel::new().with_timeline(TIME).with_state(PanelState::Collapsed))
}

/// The mounting ring and the motors, which stand still.
fn base(rec: &RecordingStream, g: &Geometry) -> Outcome {
    let ring = (0..=72).map(|k| {
        let (sin, cos) = (f64::from(k) * std::f64::consts::TAU / 72.0).sin_cos();
        [g.base_radius * cos, g.base_radius * sin, g.mounting_height].map(|v| v as f32)
    });
    let mut strips: Vec<Vec<[f32; 3]>> = vec![ring.collect()];
    let (mut from, mut to) = (Vec::new(), Vec::new());
    for i in 0..ARMS {
        let shaft = Geometry::radial(i) * g.base_radius;
        let half = Geometry::tangential(i) * (0.35 * g.base_radius);
        from.push(point(shaft - half));
        to.push(point(shaft + half));
        let above = shaft.xy().push(g.mounting_height);
        strips.push(vec![point(above), point(shaft)]);
    }
    let lines = a::LineStrips3D::new(strips).with_colors([color(STEEL)]).with_radii([0.008f32]);
    rec.log_static("world/base/frame", &lines)?;
    let motors = a::Capsules3D::from_endpoints_and_radii(from, to, [0.045f32; ARMS])
        .with_colors([color(STEEL)])
        .with_fill_mode(FillMode::Solid);
    rec.log_static("world/base/motors", &motors)?;
    Ok(())
}

fn robot(rec: &RecordingStream, scene: &Scene) -> Outcome {
    let g = scene.geometry;
    // Bodies of a disassembled robot rest in the origin, where the platform never is.
    let assembled = scene.motions.iter().any(|m| m.bodies[PLATFORM].position.norm() > 0.0);
    let (thick, thin) = (0.03f32, 0.009f32);
    let sleeve = -0.9 * g.telescope_limits[0];
    for b in 0..BODIES {
        let entity = format!("world/{}", body_name(b));
        let axis_of_color = match b {
            ARM..STRUT => Some(b - ARM),
            TELESCOPE_UPPER => Some(3),
            _ => None,
        };
        if b >= STRUT && !assembled {
            continue;
        }
        let half = 0.5 * g.pair_distance;
        match b {
            ARM..STRUT => {
                let l = g.arm_length;
                bar(rec, &entity, [l, 0.0, 0.0], thick, STEEL, scene.residual.is_some())?;
                if assembled {
                    balls(rec, &entity, &[[l, half, 0.0], [l, -half, 0.0]])?;
                    bolt(rec, &entity, [l, half, 0.0], [l, -half, 0.0])?;
                }
            }
            STRUT..PLATFORM => {
                let length = g.strut_length[(b - STRUT) / (STRUTS / ARMS)];
                bar(rec, &entity, [length, 0.0, 0.0], thin, CARBON, false)?;
            }
            PLATFORM => platform(rec, &entity, g)?,
            END_EFFECTOR => {
                let flange = a::Boxes3D::from_centers_and_half_sizes([[0.02f32, 0.0, 0.01]], [[0.06f32, 0.02, 0.01]]);
                let flange = flange.with_colors([color(BRASS)]).with_fill_mode(FillMode::Solid);
                rec.log_static(entity.as_str(), &flange)?;
            }
            ROTOR => continue,
            TELESCOPE_UPPER => {
                bar(rec, &entity, [0.0, 0.0, sleeve], 0.018, STEEL, scene.residual.is_some())?;
            }
            TELESCOPE_LOWER => bar(rec, &entity, [0.0, 0.0, -sleeve], 0.011, CARBON, false)?,
            _ => continue,
        }
        let poses = a::Transform3D::update_fields()
            .with_many_translation(scene.motions.iter().map(|m| point(m.bodies[b].position)))
            .with_many_mat3x3(scene.motions.iter().map(|m| {
                let columns = m.bodies[b].rotation; // nalgebra stores by column, as Rerun does
                let mut entries = [0f32; 9];
                entries.iter_mut().zip(columns.iter()).for_each(|(e, v)| *e = *v as f32);
                rerun::datatypes::Mat3x3::from(entries)
            }));
        rec.send_columns(entity.as_str(), [frames(scene)], poses.columns_of_unit_batches()?)?;
        if let (Some(axis), Some(residual)) = (axis_of_color, scene.residual) {
            let colors = residual.iter().map(|r| color(heat(r[axis])));
            let colors = a::Capsules3D::update_fields().with_colors(colors);
            rec.send_columns(entity, [frames(scene)], colors.columns_of_unit_batches()?)?;
        }
    }
    if assembled {
        let path: Vec<_> = scene.motions.iter().map(|m| point(m.bodies[PLATFORM].position)).collect();
        let path = a::LineStrips3D::new([path]).with_colors([color(AXIS[0])]).with_radii([0.001f32]);
        rec.log_static("world/path", &path)?;
    }
    Ok(())
}

fn platform(rec: &RecordingStream, entity: &str, g: &Geometry) -> Outcome {
    let mut corners = Vec::new();
    for i in 0..ARMS {
        for s in [2 * i + 1, 2 * i] {
            let ball = Geometry::radial(i) * g.platform_radius;
            corners.push(point(ball + Geometry::tangential(i) * g.pair_offset(s)));
        }
    }
    let sockets: Vec<_> = corners.iter().map(|c| c.map(f64::from)).collect();
    balls(rec, entity, &sockets)?;
    corners.push(corners[0]);
    let edge = a::LineStrips3D::new([corners]).with_colors([color(ORANGE)]).with_radii([0.008f32]);
    rec.log_static(format!("{entity}/edge"), &edge)?;
    let hub = a::Cylinders3D::from_lengths_and_radii([0.03f32], [0.7 * g.platform_radius as f32]);
    let hub = hub.with_colors([color(ORANGE)]).with_fill_mode(FillMode::Solid);
    rec.log_static(format!("{entity}/hub"), &hub)?;
    Ok(())
}

/// A rod from the body's origin to `end`. Without `painted`, its colour is constant.
fn bar(rec: &RecordingStream, entity: &str, end: [f64; 3], radius: f32, rgb: [u8; 3], painted: bool) -> Outcome {
    let end = end.map(|v| v as f32);
    let mut rod = a::Capsules3D::from_endpoints_and_radii([[0f32; 3]], [end], [radius]).with_fill_mode(FillMode::Solid);
    if !painted {
        rod = rod.with_colors([color(rgb)]);
    }
    rec.log_static(entity, &rod)?;
    Ok(())
}

fn balls(rec: &RecordingStream, entity: &str, centres: &[[f64; 3]]) -> Outcome {
    let centres = centres.iter().map(|c| c.map(|v| v as f32));
    let points = a::Points3D::new(centres).with_radii([0.018f32]).with_colors([color(BRASS)]);
    rec.log_static(format!("{entity}/sockets"), &points)?;
    Ok(())
}

/// The bolt between the two balls at an elbow.
fn bolt(rec: &RecordingStream, entity: &str, from: [f64; 3], to: [f64; 3]) -> Outcome {
    let strip = [from, to].map(|p| p.map(|v| v as f32));
    let line = a::LineStrips3D::new([strip]).with_colors([color(BRASS)]).with_radii([0.007f32]);
    rec.log_static(format!("{entity}/bolt"), &line)?;
    Ok(())
}

fn curve(rec: &RecordingStream, s: &Series) -> Outcome {
    let style =
        a::SeriesLines::new().with_names([s.label.as_str()]).with_colors([color(s.color)]).with_widths([1.5f32]);
    rec.log_static(s.path.as_str(), &style)?;
    let times = TimeColumn::new_duration_secs(TIME, s.times.iter().copied());
    let values = a::Scalars::new(s.values.iter().copied()).columns_of_unit_batches()?;
    rec.send_columns(s.path.as_str(), [times], values)?;
    Ok(())
}

fn frames(scene: &Scene) -> TimeColumn {
    TimeColumn::new_duration_secs(TIME, scene.times.iter().copied())
}

fn point(v: nalgebra::Vector3<f64>) -> [f32; 3] {
    [v.x as f32, v.y as f32, v.z as f32]
}

fn color([r, g, b]: [u8; 3]) -> Color {
    Color::from_rgb(r, g, b)
}

/// Green within the noise, yellow at 3 σ, red from 6 σ on.
fn heat(sigma: f64) -> [u8; 3] {
    let stops = [[70.0, 170.0, 90.0], [240.0, 200.0, 60.0], [215.0, 50.0, 45.0]];
    let x = if sigma.is_finite() { (sigma.abs() - 1.0).clamp(0.0, 5.0) / 2.5 } else { 2.0 };
    let i = (x as usize).min(1);
    std::array::from_fn(|c| (stops[i][c] + (x - i as f64) * (stops[i + 1][c] - stops[i][c])) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinematics::JointState;

    #[test]
    fn residual_colours() {
        assert_eq!(heat(0.5), [70, 170, 90]);
        assert_eq!(heat(-3.5), [240, 200, 60]);
        assert_eq!(heat(50.0), [215, 50, 45]);
        assert_eq!(heat(f64::NAN), [215, 50, 45]);
    }

    /// Arms apart, axis 4 turning.
    fn lift(g: &Geometry, phi: f64) -> Motion {
        let joints = JointState { q: [phi, 0.8 * phi, phi + 0.1, 2.0 * phi], ..JointState::default() };
        Motion::assembled(g, &joints).expect("a pose within reach")
    }

    #[test]
    fn a_scene_is_written() {
        let g = Geometry {
            base_radius: 0.2,
            arm_length: 0.35,
            strut_length: [0.95; ARMS],
            platform_radius: 0.05,
            pair_distance: 0.09,
            mounting_height: 0.275,
            upper_hooke_height: 0.05,
            lower_hooke_height: 0.03,
            flange_height: -0.05,
            arm_limits: [-0.9, 1.9],
            telescope_limits: [0.65, 1.25],
        };
        let times: Vec<f64> = (0..100).map(|i| f64::from(i) * 0.02).collect();
        let motions: Vec<Motion> = times.iter().map(|t| lift(&g, 0.3 + 0.4 * (3.0 * t).sin())).collect();
        let residual: Vec<[f64; AXES]> = times.iter().map(|t| [0.0, 3.5, 3.0 * t, 9.0]).collect();
        let mut recording = Recording::default();
        recording.signals.t = times.clone();
        recording.signals.q = motions.iter().map(|m| m.q).collect();
        recording.signals.tau = times.iter().map(|t| [9.0 * t.sin(); AXES]).collect();
        recording.signals.strut_upper[0] = Some(times.iter().map(|t| 30.0 * t.cos()).collect());
        let mut scene = Scene {
            times: &times,
            motions: &motions,
            geometry: &g,
            series: measured(&recording),
            residual: Some(&residual),
        };
        assert_eq!(scene.series.len(), 9);
        scene.series.push(Series {
            path: "torque/axis1/model".into(),
            times: times.clone(),
            values: times.iter().map(|t| 8.0 * t.sin()).collect(),
            color: [120; 3],
            label: "model [N·m]".into(),
        });
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.rrd");
        write_rrd(&path, "lift", &scene).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        assert!(bytes.starts_with(b"RRF2") && bytes.len() > 20_000, "{} bytes", bytes.len());

        scene.series[0].values.pop();
        let e = write_rrd(&path, "lift", &scene).unwrap_err().to_string();
        assert!(e.contains("torque/axis1/measured: 99 values for 100 times"), "{e}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }
}

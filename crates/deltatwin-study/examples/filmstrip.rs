//! Pictures of runs at given instants, one row per scenario, as an SVG file.
//!
//! `cargo run -p deltatwin-study --example filmstrip -- docs/bulky.svg 0.15,0.28,0.36,0.45 SCENARIO…`

use std::fmt::Write;
use std::path::{Path, PathBuf};

use deltatwin::cell::Shape;
use deltatwin::machine::bodies::{self, END_EFFECTOR, PLATFORM, TELESCOPE_LOWER, TELESCOPE_UPPER};
use deltatwin::machine::{lower_socket, six_struts, three_arms};
use deltatwin::twin::Frame;
use deltatwin_io::outside::Access;
use deltatwin_io::{model, scenario};
use deltatwin_study::run::{AFTER_LANDING, Case, Keep, Outcome, run};
use miette::{IntoDiagnostic, Result, miette};
use nalgebra::{Isometry3, Point3, Vector3};

/// Azimuth and elevation of the eye, rad.
const EYE: [f64; 2] = [-1.3, 0.22];
/// Width and height of a picture, and pixels per metre.
const PICTURE: [f64; 2] = [300.0, 372.0];
const SCALE: f64 = 168.0;
/// Height of the title of a row.
const TITLE: f64 = 30.0;

/// Place of a point in its picture, and its distance towards the eye, m.
fn project(p: &Point3<f64>) -> [f64; 3] {
    let ((sin, cos), (rise, level)) = (EYE[0].sin_cos(), EYE[1].sin_cos());
    let (right, near) = (cos * p.y - sin * p.x, cos * p.x + sin * p.y);
    [0.5 * PICTURE[0] + SCALE * right, 70.0 - SCALE * (level * p.z - rise * near), level * near + rise * p.z]
}

/// The faces of a box towards the eye.
fn cuboid(out: &mut String, size: &Vector3<f64>, pose: &Isometry3<f64>, color: &str) {
    for axis in 0..3 {
        let (side, other) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut normal = Vector3::zeros();
        normal[axis] = 1.0;
        let towards = project(&(pose.rotation * normal).into())[2];
        let shade = [0.86, 0.72, 1.0][axis];
        let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].map(|[a, b]| {
            let mut p = Vector3::zeros();
            p[axis] = towards.signum() * size[axis] / 2.0;
            (p[side], p[other]) = (a * size[side] / 2.0, b * size[other] / 2.0);
            let [x, y, _] = project(&(pose * Point3::from(p)));
            format!("{x:.1},{y:.1}")
        });
        let _ = writeln!(
            out,
            r##"<polygon points="{}" fill="{color}" fill-opacity="{shade}" stroke="#445" stroke-width="0.7"/>"##,
            corners.join(" ")
        );
    }
}

fn line(out: &mut String, [a, b]: [Point3<f64>; 2], color: &str, width: f64) {
    let ([x1, y1, _], [x2, y2, _]) = (project(&a), project(&b));
    let _ = writeln!(
        out,
        r#"<line x1="{x1:.1}" y1="{y1:.1}" x2="{x2:.1}" y2="{y2:.1}" stroke="{color}" stroke-width="{width}" stroke-linecap="round"/>"#
    );
}

/// The robot, its payload and the objects at one instant.
fn picture(case: &Case, outcome: &Outcome, frame: &Frame) -> String {
    let mut out = String::new();
    let geometry = &case.model.geometry;
    let mut boxes: Vec<(f64, Vector3<f64>, Isometry3<f64>)> = Vec::new();
    for (object, pose) in outcome.options.objects.iter().zip(&frame.objects) {
        if let Shape::Box { size } = object.shape {
            boxes.push((project(&pose.translation.vector.into())[2], size, *pose));
        }
    }
    boxes.sort_by(|a, b| a.2.translation.z.total_cmp(&b.2.translation.z).then(a.0.total_cmp(&b.0)));
    for (_, size, pose) in &boxes {
        cuboid(&mut out, size, pose, "#c9ced6");
    }
    let tip = |body: usize, x: f64, y: f64, z: f64| frame.bodies[body] * Point3::new(x, y, z);
    let limbs = case.model.geometry.limbs;
    for s in six_struts() {
        let loose = [s, lower_socket(s)].iter().any(|&socket| !frame.closed.contains(socket));
        let (color, width) = if loose { ("#d4351c", 2.6) } else { ("#3d6ea5", 1.8) };
        line(
            &mut out,
            [tip(bodies::strut(s), 0.0, 0.0, 0.0), tip(bodies::strut(s), limbs[s / 2].strut_length, 0.0, 0.0)],
            color,
            width,
        );
    }
    if geometry.has_telescope() {
        line(&mut out, [tip(TELESCOPE_UPPER, 0.0, 0.0, 0.0), tip(TELESCOPE_LOWER, 0.0, 0.0, 0.0)], "#8a8f98", 2.2);
    }
    for i in three_arms() {
        let half = 0.5 * geometry.limbs[0].pair_distance;
        line(
            &mut out,
            [tip(bodies::arm(i), 0.0, 0.0, 0.0), tip(bodies::arm(i), geometry.limbs[i].arm_length, 0.0, 0.0)],
            "#e08a2c",
            6.0,
        );
        let ends = [-half, half].map(|y| tip(bodies::arm(i), geometry.limbs[i].arm_length, y, 0.0));
        line(&mut out, ends, "#e08a2c", 3.0);
        let shafts = [i, (i + 1) % three_arms().len()].map(|i| Point3::from(geometry.limbs[i].shaft()));
        line(&mut out, shafts, "#555", 3.0);
        let pair = [-half, half].map(|y| {
            let p = geometry.limbs[i].point + geometry.limbs[i].tangential() * y;
            frame.bodies[PLATFORM] * Point3::from(p)
        });
        line(&mut out, pair, "#333", 4.0);
    }
    if let Some(payload) = &outcome.options.payload_shape
        && let Shape::Box { size } = &payload.shape
    {
        let pose =
            frame.bodies[END_EFFECTOR] * Isometry3::translation(payload.centre.x, payload.centre.y, payload.centre.z);
        cuboid(&mut out, size, &pose, "#caa46a");
    }
    out
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let usage = || miette!("expected an SVG file, instants in s (0.1,0.2) and scenarios");
    let target = PathBuf::from(arguments.next().ok_or_else(usage)?);
    let times: Vec<f64> = arguments.next().ok_or_else(usage)?.split(',').filter_map(|t| t.parse().ok()).collect();
    let mut rows = String::new();
    let (mut width, mut top) = (0.0f64, 0.0);
    for file in arguments.map(PathBuf::from) {
        let scenario = scenario::read_with(&file, Access::with(deltatwin_cell::mesh::read))?;
        let controller_model = scenario.controller_model.as_deref().map(model::read).transpose()?;
        let base = file.parent().unwrap_or(Path::new(".")).to_path_buf();
        let model = model::read(&scenario.model)?;
        let case =
            Case { nominal: model.sockets, model, controller_model, scenario, base, after_landing: AFTER_LANDING };
        let outcome = run(&case, Keep::Recording).into_diagnostic()?;
        let verdict = &outcome.verdict;
        let picks = verdict.picks_per_minute().map_or(String::new(), |p| format!(", {p:.1} picks per minute"));
        let fate = if verdict.survived { "every socket holds".into() } else { verdict.fmea.local.clone() };
        let _ = writeln!(
            rows,
            r##"<text x="10" y="{:.0}" font-size="15" fill="#222"><tspan font-weight="bold">{}</tspan>{picks}: {fate}</text>"##,
            top + 21.0,
            case.scenario.name
        );
        for (k, t) in times.iter().enumerate() {
            let frames = &outcome.report.frames;
            let Some(frame) = frames.iter().min_by(|a, b| (a.t - t).abs().total_cmp(&(b.t - t).abs())) else {
                continue;
            };
            let x = PICTURE[0] * k as f64;
            let _ = writeln!(
                rows,
                r##"<svg x="{x:.0}" y="{:.0}" width="{}" height="{}">{}<text x="10" y="20" font-size="14" fill="#555">{:.2} s</text></svg>"##,
                top + TITLE,
                PICTURE[0],
                PICTURE[1],
                picture(&case, &outcome, frame),
                frame.t
            );
            width = width.max(x + PICTURE[0]);
        }
        top += TITLE + PICTURE[1];
    }
    let svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {top}\" width=\"{width}\" height=\"{top}\" \
         font-family=\"sans-serif\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n{rows}</svg>\n"
    );
    deltatwin_io::file::replace_text(&target, &svg).into_diagnostic()
}

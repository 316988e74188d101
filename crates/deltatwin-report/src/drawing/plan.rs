//! Figures of a plan and of its execution (Figs. 14–17 of the paper).

use crate::{Color, Curve as Line, Figure, Panel, Style, panels, time_series};
use deltatwin::planner::limits::Limits;
use deltatwin::planner::validation::{Execution, acceleration};
use deltatwin::planner::verify::checked;
use deltatwin::planner::{Curve, Limit, Plan};
use deltatwin::recording::{Channel, Recording, Signals};

/// Factor on the largest z up to which the maximum velocity curve is drawn.
const CLIPPED: f64 = 1.6;

/// Label of the axis of the path parameter s, which has no unit.
const PARAMETER: &str = "path parameter s";

fn panel(title: &str, y_label: &str, curves: Vec<Line>) -> Panel {
    Panel { title: title.into(), y_label: y_label.into(), curves }
}

fn limit(t: &[f64], value: f64, label: &str) -> Vec<Line> {
    let ends = vec![t[0], t[t.len() - 1]];
    let line =
        |y: f64, label: &str| Line::new(label, ends.clone(), vec![y, y]).color(Color::MUTED).style(Style::Dashed);
    if value.is_finite() { vec![line(value, label), line(-value, "")] } else { vec![] }
}

/// Coordinates of the path over s.
pub fn path(curve: &Curve) -> Figure {
    let s: Vec<f64> = (0..=400).map(|k| curve.end() * f64::from(k) / 400.0).collect();
    let of = |i: usize| -> Vec<f64> { s.iter().map(|s| curve.at(*s)[0][i]).collect() };
    let line = |i: usize| vec![Line::new("planned", s.clone(), of(i)).color(Color::BLUE)];
    panels(
        "Path",
        PARAMETER,
        &[panel("x", "m", line(0)), panel("y", "m", line(1)), panel("z", "m", line(2)), panel("ψ", "rad", line(3))],
    )
}

/// Squared path speed and maximum velocity curve over s.
pub fn speed(plan: &Plan) -> Figure {
    let (s, z): (Vec<f64>, Vec<f64>) = plan.uses.iter().map(|u| plan.speed(u).into()).unzip();
    let top = CLIPPED * z.iter().fold(0.0f64, |m, z| m.max(*z));
    let mvc = plan.mvc.iter().map(|p| if p[1] <= top { p[1] } else { f64::NAN }).collect();
    time_series(
        "Squared path speed and maximum velocity curve",
        PARAMETER,
        "ṡ² / s⁻²",
        &[
            Line::new("maximum velocity curve", plan.mvc.iter().map(|p| p[0]).collect(), mvc)
                .color(Color::MUTED)
                .style(Style::Dashed),
            Line::new("planned", s, z).color(Color::BLUE),
        ],
    )
}

/// Use of the drives' limits over s.
pub fn drives(plan: &Plan, limits: &Limits, axes: usize) -> Figure {
    let s: Vec<f64> = plan.uses.iter().map(|u| plan.speed(u)[0]).collect();
    let share = |kind: fn(usize) -> Limit, signed: bool| -> Vec<Line> {
        let curves = (0..axes).map(|axis| {
            let k = (0..deltatwin::planner::verify::CHECKED).find(|&k| checked(k) == kind(axis)).unwrap_or_default();
            let of = plan.uses.iter().map(|u| if signed { u.ratio[k].copysign(u.value[k]) } else { u.ratio[k] });
            Line::new(format!("axis {}", axis + 1), s.clone(), of.collect())
                .color(Color::OF_AXIS[axis % Color::OF_AXIS.len()])
        });
        curves.chain(limit(&s, 1.0, "limit")).collect()
    };
    let mut all = vec![
        panel("speed", "of limit", share(Limit::Speed, true)),
        panel("acceleration", "of limit", share(Limit::Acceleration, true)),
        panel("torque", "of limit", share(Limit::Torque, true)),
    ];
    if limits.has_jerk() {
        all.insert(2, panel("jerk", "of limit", share(Limit::Jerk, true)));
    }
    panels("Drives, in units of what may be used", PARAMETER, &all)
}

fn strut(signals: &Signals, s: usize) -> Vec<f64> {
    signals[Channel::StrutUpper(s)].to_vec()
}

/// Planned strut forces over time.
pub fn forces(planned: &Recording, limits: &Limits) -> Figure {
    let signals = &planned.signals;
    let struts = 0..signals.mechanism.struts();
    let curves = struts.map(|s| Line::new(format!("strut {}", s + 1), signals.t.clone(), strut(signals, s)));
    let usable = (1.0 - limits.margin) * limits.strut_upper;
    let all: Vec<Line> = curves.chain(limit(&signals.t, usable, "limit less margin")).collect();
    time_series("Strut forces at the elbows", "t / s", "N", &all)
}

/// Planned and executed torques, strut forces and acceleration over time.
pub fn execution(planned: &Recording, execution: &Execution) -> [Figure; 3] {
    let (want, got) = (&planned.signals, &execution.recording.signals);
    let pair = |a: (Vec<f64>, Vec<f64>), b: (Vec<f64>, Vec<f64>)| {
        vec![
            Line::new("planned", a.0, a.1).color(Color::BLUE),
            Line::new("executed", b.0, b.1).color(Color::MEASURED).style(Style::Dashed),
        ]
    };
    let tau = |s: &Signals, i: usize| (s.t.clone(), s[Channel::Torque(i)].to_vec());
    let unit = Channel::Torque(0).unit(want.mechanism).to_string();
    let torque = |i: usize| panel(&format!("axis {}", i + 1), &unit, pair(tau(want, i), tau(got, i)));
    let torques: Vec<Panel> = (0..want.mechanism.axes()).map(torque).collect();
    let force = |s: &Signals, i: usize| (s.t.clone(), strut(s, i));
    let struts: Vec<Panel> = (0..want.mechanism.struts())
        .map(|i| panel(&format!("strut {}", i + 1), "N", pair(force(want, i), force(got, i))))
        .collect();
    let inner = |s: &Signals, i: usize| {
        let a = acceleration(s);
        (s.t[1..=a.len()].to_vec(), a.iter().map(|a| a[i]).collect())
    };
    let accelerations: Vec<Panel> = ["x", "y", "z"]
        .iter()
        .enumerate()
        .map(|(i, name)| panel(name, "m/s²", pair(inner(want, i), inner(got, i))))
        .collect();
    [
        panels("Drive torques", "t / s", &torques),
        panels("Strut forces at the elbows", "t / s", &struts),
        panels("Acceleration of the end effector", "t / s", &accelerations),
    ]
}

//! Friction of drive 4 as a function of its speed: Table 2 and Fig. 9 (section 6.3.1 of the paper).

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};

use super::page::{Comparison, Estimate, Plot, Row, Section};
use super::paper;
use super::runs::{Campaign, Run};
use deltatwin_report::{Color, Curve, Style, time_series};

/// Axis of the curve, from 0.
const AXIS: usize = 3;
/// Steepness of the Coulomb term of eq. 48, s/rad.
const STEEPNESS: f64 = 100.0;
/// Share of a run at constant speed that is discarded for settling.
const SETTLING: f64 = 0.3;

/// Mean torque at one speed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Point {
    /// Speed, rad/s.
    pub speed: f64,
    /// Mean torque, N·m.
    pub torque: f64,
    /// Standard error of the mean, N·m.
    pub std: f64,
}

/// One point per speed and direction at which the axis was commanded to move without acceleration.
pub fn points(run: &Run) -> Vec<Point> {
    // By commanded speed in µrad/s, ascending.
    let mut held: BTreeMap<i64, Vec<f64>> = BTreeMap::new();
    let mut stretch: Vec<f64> = Vec::new();
    let mut now = 0;
    let mut finish = |speed: i64, stretch: &mut Vec<f64>| {
        let settled = (SETTLING * stretch.len() as f64) as usize;
        if speed != 0 && stretch.len() > settled + 1 {
            held.entry(speed).or_default().extend(&stretch[settled..]);
        }
        stretch.clear();
    };
    for (tau, wanted) in run.recording.signals.tau().iter().zip(&run.commanded) {
        let speed = if wanted.qdd[AXIS].abs() < 1e-9 { (wanted.qd[AXIS] * 1e6).round() as i64 } else { 0 };
        if speed != now {
            finish(now, &mut stretch);
            now = speed;
        }
        if speed != 0 {
            stretch.push(tau[AXIS]);
        }
    }
    finish(now, &mut stretch);
    held.into_iter()
        .map(|(speed, torques)| {
            let n = torques.len() as f64;
            let mean = torques.iter().sum::<f64>() / n;
            let variance = torques.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (n - 1.0);
            Point { speed: speed as f64 * 1e-6, torque: mean, std: (variance / n).sqrt() }
        })
        .collect()
}

/// A_C, A_v (N·m) and ε_v (rad/s) of eq. 48 with their standard errors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Curve48 {
    /// Values.
    pub values: [f64; 3],
    /// Standard errors.
    pub std: [f64; 3],
    /// Weighted sum of squares per degree of freedom; about one if eq. 48 is the law.
    pub reduced_chi_squared: f64,
}

/// A_C tanh(100 q̇) + A_v tanh(q̇/ε_v), N·m (eq. 48).
pub fn law([coulomb, saturating, width]: [f64; 3], speed: f64) -> f64 {
    coulomb * (STEEPNESS * speed).tanh() + saturating * (speed / width).tanh()
}

/// Gradient of the law with respect to A_C, A_v, ε_v.
fn gradient([_, saturating, width]: [f64; 3], speed: f64) -> Vector3<f64> {
    let s = (speed / width).tanh();
    Vector3::new((STEEPNESS * speed).tanh(), s, -saturating * (1.0 - s * s) * speed / (width * width))
}

const MAX_ITERATIONS: usize = 100;

/// Nonlinear least squares by damped Gauss–Newton steps; `None` if the points do not determine the curve.
pub fn fit(points: &[Point]) -> Option<Curve48> {
    let fastest = points.iter().map(|p| p.speed.abs()).fold(0.0, f64::max);
    let highest = points.iter().map(|p| p.torque.abs()).fold(0.0, f64::max);
    let cost = |v: [f64; 3]| points.iter().map(|p| ((p.torque - law(v, p.speed)) / p.std).powi(2)).sum::<f64>();
    let normal = |v: [f64; 3]| {
        points.iter().fold((Matrix3::zeros(), Vector3::zeros()), |(a, b), p| {
            let g = gradient(v, p.speed) / p.std;
            (a + g * g.transpose(), b + g * ((p.torque - law(v, p.speed)) / p.std))
        })
    };
    let mut values = [0.5 * highest, 0.5 * highest, 0.2 * fastest];
    for _ in 0..MAX_ITERATIONS {
        let (a, b) = normal(values);
        let step = a.cholesky()?.solve(&b);
        let moved = |damping: f64| -> [f64; 3] { std::array::from_fn(|i| values[i] + damping * step[i]) };
        let better = (0..20).map(|k| moved(0.5f64.powi(k))).find(|v| v[2] > 0.0 && cost(*v) < cost(values));
        let Some(better) = better else { break };
        values = better;
    }
    let covariance = normal(values).0.try_inverse()?;
    let freedom = points.len().checked_sub(3).filter(|n| *n > 0)? as f64;
    Some(Curve48 {
        values,
        std: std::array::from_fn(|i| covariance[(i, i)].sqrt()),
        reduced_chi_squared: cost(values) / freedom,
    })
}

/// Section on Table 2 and Fig. 9.
pub fn section(campaign: &Campaign, points: &[Point], curve: &Curve48) -> Section {
    let truth = campaign.robot.effects.iter().find(|a| a.effect.name() == "axis4_friction");
    let names = [("A_C", "N·m"), ("A_v", "N·m"), ("ε_v", "rad/s")];
    let rows = names
        .iter()
        .enumerate()
        .map(|(i, (name, unit))| {
            let row = Row::new(*name, unit, Estimate::new(curve.values[i], curve.std[i])).paper(paper::TABLE_2[i]);
            truth.map_or(row.clone(), |t| row.truth(t.values[i]))
        })
        .collect();
    let table = Comparison::new("identified", rows);
    let fastest = points.iter().map(|p| p.speed.abs()).fold(0.0, f64::max);
    let dense: Vec<f64> = (-200..=200).map(|k| fastest * f64::from(k) / 200.0).collect();
    // The jump at standstill is omitted, where both curves would be the same vertical line.
    let line = |values: [f64; 3]| dense.iter().map(|v| if *v == 0.0 { f64::NAN } else { law(values, *v) }).collect();
    let degrees = |v: &[f64]| v.iter().map(|v| v.to_degrees()).collect::<Vec<_>>();
    let speeds: Vec<f64> = points.iter().map(|p| p.speed).collect();
    let figure = time_series(
        "Friction torque of drive 4",
        "speed / °/s",
        "torque / N·m",
        &[
            Curve::new("eq. 48, identified", degrees(&dense), line(curve.values)).color(Color::BLUE),
            Curve::new("eq. 48 with the paper's Table 2", degrees(&dense), line(paper::TABLE_2))
                .color(Color::MEASURED)
                .style(Style::Dashed),
            Curve::new("mean torque", degrees(&speeds), points.iter().map(|p| p.torque).collect())
                .color(Color::VERMILION)
                .style(Style::Points),
        ],
    );
    let agreement = format!(
        "{} The twin's drive 4 was given the paper's Table 2, so the agreement is by construction; what is shown is that \
         constant-speed runs determine the law. χ² per degree of freedom is {:.2}: eq. 48 is the twin's law, whereas the \
         paper's curve is only almost symmetric.",
        table.hits(0),
        curve.reduced_chi_squared
    );
    Section {
        key: "table_2",
        title: "Table 2 and Fig. 9: friction of drive 4".into(),
        text: format!(
            "The assembled robot holds its arms still on the centre line while axis 4 turns to and fro at {} speeds up to \
             {:.0} °/s. The mean torque over each run at constant speed is one point; nonlinear least squares weighs every \
             point by its standard error.",
            points.len() / 2,
            fastest.to_degrees()
        ),
        tables: vec![table],
        plots: vec![Plot {
            name: "figure-9",
            figure,
            caption: "Mean torque of drive 4 over its speed in both directions. The two curves lie on each other; their jump \
                      at standstill is not drawn."
                .into(),
        }],
        agreement,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exact_points_give_the_curve_back() {
        let values = [0.4, 0.7, 6.0];
        let speeds = [-40.0, -20.0, -8.0, -3.0, 1.0, 2.0, 5.0, 10.0, 30.0];
        let points = speeds.map(|speed| Point { speed, torque: law(values, speed), std: 0.01 });
        let fitted = fit(&points).unwrap();
        for i in 0..3 {
            assert!((fitted.values[i] - values[i]).abs() < 1e-9, "{fitted:?}");
        }
        assert!(fit(&points[..3]).is_none());
    }

    #[test]
    fn the_gradient_is_the_derivative() {
        let values = [0.5, 0.6, 8.0];
        for speed in [-20.0, 0.005, 3.0] {
            let exact = gradient(values, speed);
            for i in 0..3 {
                let mut ahead = values;
                ahead[i] += 1e-6;
                let slope = (law(ahead, speed) - law(values, speed)) / 1e-6;
                assert!((slope - exact[i]).abs() < 1e-6, "{i} {speed}");
            }
        }
    }
}

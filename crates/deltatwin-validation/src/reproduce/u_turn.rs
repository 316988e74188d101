//! The time-optimal U-turn: Figs. 14 to 17 (section 6.6 of the paper).

use std::path::Path;

use miette::IntoDiagnostic;

use super::assembled::Assembled;
use super::page::{Comparison, Estimate, Plot, Row, Section};
use super::paper::u_turn as printed;
use super::runs::Campaign;
use deltatwin::dynamics::Plant;
use deltatwin::machine::six_struts;
use deltatwin::model::Model;
use deltatwin::planner::trajectory::trajectory;
use deltatwin::planner::validation::{Execution, execute};
use deltatwin::planner::{Curve, Limit, Limits, Machine, Plan, Task, plan};
use deltatwin::recording::{Channel, Recording};
use deltatwin_report::{Color, Curve as Line, drawing, time_series};

/// The path with its payload and limits.
const U_TURN: &str = include_str!("../../../../scenarios/u-turn.toml");
/// Range of s around the corner in each half of the path.
const HALVES: [[f64; 2]; 2] = [[0.1, 0.4], [0.6, 0.9]];
/// Range of s of the straight horizontal part.
const ACROSS: [f64; 2] = [0.3, 0.7];

/// A plan of one model and its execution by one machine.
struct Variant {
    title: &'static str,
    task: Task,
    plan: Plan,
    planned: Recording,
    executed: Execution,
}

impl Variant {
    fn new(title: &'static str, model: &Model, machine: &Model) -> miette::Result<Self> {
        let task = deltatwin_io::plan::parse(U_TURN, Path::new("scenarios/u-turn.toml"), Limits::of(model))?;
        let plant = Plant::new(model, &task.setup);
        let planner = Machine::new(&plant, task.limits.detail);
        let plan = plan(&planner, &task.shape.curve(), &task.limits, &task.options).into_diagnostic()?;
        let planned = trajectory(&planner, &plan, &task.setup, model.sample_time, &task.name).into_diagnostic()?;
        let executed = execute(machine, &plant, &planned, Some(deltatwin_cell::contacts)).into_diagnostic()?;
        Ok(Self { title, task, plan, planned, executed })
    }

    /// Largest planned force at an elbow, N.
    fn planned_force(&self) -> f64 {
        let forces = self.planned.signals.rows::<{ six_struts().end }>(Channel::StrutUpper).iter().flatten();
        forces.fold(0.0, |most, f| f.abs().max(most))
    }

    /// Largest use, on the straight part, of the limits that `wanted` selects.
    fn used_across(&self, wanted: fn(Limit) -> bool) -> f64 {
        let across = |s: f64| (ACROSS[0]..ACROSS[1]).contains(&s);
        let uses = self.plan.uses.iter().filter(|u| across(self.plan.speed(u)[0]));
        uses.flat_map(|u| u.limits()).filter(|(limit, _)| wanted(*limit)).fold(0.0, |most, (_, ratio)| ratio.max(most))
    }

    /// s at which z is closest to the maximum velocity curve within a range, and the ratio there.
    fn nearest(&self, [from, to]: [f64; 2]) -> [f64; 2] {
        let z: Vec<[f64; 2]> = self.plan.uses.iter().map(|u| self.plan.speed(u)).collect();
        let share = |[s, most]: [f64; 2]| {
            let i = z.partition_point(|p| p[0] < s).min(z.len() - 1);
            [s, z[i][1] / most]
        };
        let inside = self.plan.mvc.iter().filter(|p| (from..to).contains(&p[0]));
        inside.map(|p| share(*p)).fold([f64::NAN, 0.0], |best, p| if p[1] > best[1] { p } else { best })
    }
}

/// Length and height of a path, m.
fn extent(curve: &Curve) -> [f64; 2] {
    let span = |axis: usize| {
        let places = (0..=1000).map(|k| curve.at(curve.end() * f64::from(k) / 1e3)[0][axis]);
        let (low, high) = places.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(x), b.max(x)));
        high - low
    };
    [span(1), span(2)]
}

/// Sections on Figs. 14 to 17.
///
/// # Errors
/// If planning or execution fails.
pub fn sections(campaign: &Campaign, assembled: &Assembled) -> miette::Result<Vec<Section>> {
    let variants = [
        Variant::new("sockets with friction", &assembled.paper.model, &campaign.robot)?,
        Variant::new("free sockets", &assembled.free.model, &campaign.free)?,
        Variant::new("model with socket friction", &assembled.complete.model, &campaign.robot)?,
    ];
    let titles: Vec<String> = variants.iter().map(|v| v.title.to_string()).collect();
    let row = |quantity: String, unit: &'static str, of: &dyn Fn(&Variant) -> f64| Row {
        quantity,
        unit: unit.into(),
        ours: variants.iter().map(|v| Some(Estimate::plain(of(v)))).collect(),
        truth: None,
        paper: None,
    };
    Ok(vec![
        path(&variants[0]),
        speed(&variants, &titles, &row),
        forces(&variants, &titles, &row),
        acceleration(&variants, &titles, &row),
    ])
}

type MakeRow<'a> = &'a dyn Fn(String, &'static str, &dyn Fn(&Variant) -> f64) -> Row;

fn path(variant: &Variant) -> Section {
    let curve = variant.task.shape.curve();
    let [length, height] = extent(&curve);
    let [y, z] = [1, 2].map(|axis| (0..=400).map(|k| curve.at(f64::from(k) / 400.0)[0][axis]).collect::<Vec<f64>>());
    let rows = vec![
        Row::new("length along y", "m", Estimate::plain(length)).paper(printed::LENGTH),
        Row::new("height", "m", Estimate::plain(height)).paper(printed::HEIGHT),
    ];
    let line = Line::new("", y, z).color(Color::BLUE);
    Section {
        key: "figure_14",
        title: "Fig. 14: path of the U-turn".into(),
        text: "A B-spline of degree four in the plane x = 0, symmetric about z, with 2.5 kg on the end effector and without \
               rotation; `scenarios/u-turn.toml`."
            .into(),
        tables: vec![Comparison::new("path", rows)],
        plots: vec![Plot {
            name: "figure-14",
            figure: time_series("Path of the U-turn", "y / m", "z / m", &[line]),
            caption: "The platform goes up, across and down.".into(),
        }],
        agreement: "Length and height are the paper's by construction. It prints neither control points nor where in the \
                    workspace the path lies."
            .into(),
    }
}

fn speed(variants: &[Variant; 3], titles: &[String], row: MakeRow) -> Section {
    let mut rows = vec![row("duration".into(), "s", &|v| v.plan.time)];
    rows[0].paper = Some(printed::TIME);
    rows.push(row("the same without jerk limits".into(), "s", &|v| v.plan.time_without_jerk));
    for (half, valley) in HALVES.into_iter().zip(printed::VALLEYS) {
        let number = if half == HALVES[0] { "first" } else { "second" };
        let mut place = row(format!("{number} valley: s"), "", &|v| v.nearest(half)[0]);
        place.paper = Some(valley);
        rows.push(place);
        rows.push(row(format!("{number} valley: z over the maximum velocity curve"), "", &|v| v.nearest(half)[1]));
    }
    let first = &variants[0];
    let [a, b] = HALVES.map(|half| first.nearest(half));
    let percent = 1e2 * (first.plan.time / printed::TIME - 1.0);
    Section {
        key: "figure_15",
        title: "Fig. 15: path speed of the time-optimal motion".into(),
        text: "Planned with the models that Tables 3 and 4 identified, within the limits of section 6.6 and 10 % less of \
               torques and constraint forces: the paper's model identified on the robot with socket friction and on the \
               one with free sockets, and the model that has this friction."
            .into(),
        tables: vec![Comparison { titles: titles.to_vec(), rows }],
        plots: vec![Plot {
            name: "figure-15",
            figure: drawing::plan::speed(&first.plan),
            caption: "Squared path speed of the paper's model on the robot with socket friction.".into(),
        }],
        agreement: format!(
            "The motion takes {:.3} s, {percent:+.1} % of the paper's ≈ {} s on a path whose corners are ours. Its speed comes \
             nearest to the maximum velocity curve in the corners, at s = {:.2} and {:.2} (paper: {} and {}), and uses \
             {:.0} and {:.0} % of it there. The paper minimises −∫ ṡ² ds (eq. 43), the plan here the time itself.",
            first.plan.time,
            printed::TIME,
            a[0],
            b[0],
            printed::VALLEYS[0],
            printed::VALLEYS[1],
            1e2 * a[1],
            1e2 * b[1]
        ),
    }
}

fn forces(variants: &[Variant; 3], titles: &[String], row: MakeRow) -> Section {
    let struts = |limit: Limit| matches!(limit, Limit::LambdaS(_));
    let torques = |limit: Limit| matches!(limit, Limit::Torque(_));
    let mut rows = vec![
        row("largest magnitude of planned λ_S".into(), "N", &Variant::planned_force),
        row("way across: largest λ_S over its limit".into(), "", &move |v| v.used_across(struts)),
        row("way across: largest torque over its limit".into(), "", &move |v| v.used_across(torques)),
        row("largest magnitude of executed λ_S".into(), "N", &|v| v.executed.peak_strut),
        row("executed − planned λ_S, RMS of the worst strut".into(), "N", &|v| {
            v.executed.strut.iter().fold(0.0, |most, s| s[0].max(most))
        }),
        row("executed − planned torque, RMS of the worst arm".into(), "N·m", &|v| {
            v.executed.torque[..3].iter().fold(0.0, |most, t| t[0].max(most))
        }),
    ];
    rows[0].paper = Some(printed::STRUT_FORCE);
    let [first, free, complete] = variants;
    let torques = drawing::plan::execution(&first.planned, &first.executed)[0].clone();
    let [_, executed, _] = drawing::plan::execution(&first.planned, &first.executed);
    Section {
        key: "figure_16",
        title: "Fig. 16: strut forces of the time-optimal motion".into(),
        text: "The twin follows each plan with the feed-forward of its model and feedback; what it measures is without noise. \
               The paper shows the planned forces."
            .into(),
        tables: vec![Comparison { titles: titles.to_vec(), rows }],
        plots: vec![
            Plot {
                name: "figure-16",
                figure: drawing::plan::forces(&first.planned, &first.task.limits),
                caption: "Planned strut forces at the elbows; tension positive.".into(),
            },
            Plot {
                name: "figure-16-executed",
                figure: executed,
                caption: "The same as planned with the paper's model and as executed by the robot with socket friction.".into(),
            },
            Plot {
                name: "figure-16-torques",
                figure: torques,
                caption: "Drive torques of the same motion.".into(),
            },
        ],
        agreement: format!(
            "As in the paper the strut forces and not the torques are the limit on the way across: they use {:.0} % of what may \
             be used, the torques at most {:.0} %. The twin can tell what the paper could not measure: on the robot with socket \
             friction the struts bear up to {:.0} N where {:.0} N were planned, on the one with free sockets {:.0} N, and {:.0} N \
             when the model knows the friction. A limit on strut forces holds as far as the model has the friction that \
             loads them.",
            1e2 * first.used_across(struts),
            1e2 * first.used_across(|limit| matches!(limit, Limit::Torque(_))),
            first.executed.peak_strut,
            first.planned_force(),
            free.executed.peak_strut,
            complete.executed.peak_strut
        ),
    }
}

fn acceleration(variants: &[Variant; 3], titles: &[String], row: MakeRow) -> Section {
    let rows = vec![
        row("executed − planned acceleration, RMS".into(), "m/s²", &|v| v.executed.acceleration[0]),
        row("executed − planned acceleration, largest".into(), "m/s²", &|v| v.executed.acceleration[1]),
    ];
    let first = &variants[0];
    let [_, _, figure] = drawing::plan::execution(&first.planned, &first.executed);
    Section {
        key: "figure_17",
        title: "Fig. 17: acceleration of the end effector".into(),
        text: "Second differences of the platform's position, planned and executed by the twin. The paper differentiates a \
               laser tracker's measurement."
            .into(),
        tables: vec![Comparison { titles: titles.to_vec(), rows }],
        plots: vec![Plot {
            name: "figure-17",
            figure,
            caption: "Planned with the paper's model and executed by the robot with socket friction.".into(),
        }],
        agreement: format!(
            "The paper prints no number and says that both fit well. Here they differ by {:.2} m/s² RMS: the feedback leaves \
             little of what the feed-forward lacks. The noise of a laser tracker and elasticities, which the paper names as \
             its next step, are not in this twin.",
            first.executed.acceleration[0]
        ),
    }
}

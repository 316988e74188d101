//! Page of a plan.

use deltatwin::machine::Mechanism;
use deltatwin::planner::validation::Execution;
use deltatwin::planner::{Plan, Task};
use deltatwin::recording::{Channel, Recording};
use deltatwin::text::significant;

use crate::html::{Callout, Report};
use crate::{Figure, drawing};

/// What a page of a plan shows.
pub struct PlanPage<'a> {
    /// Path, limits and payload.
    pub task: &'a Task,
    /// The plan.
    pub plan: &'a Plan,
    /// The planned trajectory.
    pub planned: &'a Recording,
    /// Its execution by the twin.
    pub execution: Option<&'a Execution>,
    /// Name of the machine.
    pub machine: &'a str,
    /// Remarks about the path.
    pub notes: &'a [String],
}

/// Every figure of a plan with the name of its file and its caption.
pub fn figures(page: &PlanPage) -> Vec<(&'static str, Figure, &'static str)> {
    let PlanPage { task, plan, planned, execution, .. } = page;
    let mut all = vec![
        ("path", drawing::plan::path(&task.shape.curve()), "The path of the end effector over its parameter."),
        (
            "speed",
            drawing::plan::speed(plan),
            "Square of the path speed, and the largest at which some acceleration is within the limits.",
        ),
        (
            "drives",
            drawing::plan::drives(plan, &task.limits, page.planned.signals.mechanism.axes()),
            "What the drives use of their limits, less the margin: the plan is as fast as possible where one of them, or \
             a constraint force, comes to 1.",
        ),
        (
            "forces",
            drawing::plan::forces(planned, &task.limits),
            "Axial forces of the struts that the model expects of the plan.",
        ),
    ];
    if let Some(execution) = execution {
        let [torques, struts, acceleration] = drawing::plan::execution(planned, execution);
        all.extend([
            ("executed-torques", torques, "Torques that the plan expects, and those of the twin with its controller."),
            ("executed-forces", struts, "Strut forces that the plan expects, and those of the twin."),
            ("executed-acceleration", acceleration, "Acceleration of the end effector in the plan and by the twin."),
        ]);
    }
    all
}

/// One self-contained page: the time and how good it is, the limits that set it, the motion, and its execution.
pub fn plan_page(page: &PlanPage) -> Report {
    let PlanPage { task, plan, execution, machine, notes, .. } = page;
    let margin = 1e2 * task.limits.margin;
    let subtitle = format!("fastest motion of {machine}, {margin:.0} % of torques and constraint forces left unused");
    let mut report = Report::new(format!("{}: {:.4} s", task.name, plan.time), subtitle);
    headline(&mut report, page);
    if !notes.is_empty() {
        report.callout(Callout::Note, &notes.join("\n"));
    }
    let (executed, own): (Vec<_>, Vec<_>) =
        figures(page).into_iter().partition(|(name, ..)| name.starts_with("executed"));
    report.anchored("motion", "The motion");
    for (_, figure, caption) in &own {
        report.figure(figure, caption);
    }
    report.anchored("limits", "What sets the time");
    active(&mut report, plan, page.planned.signals.mechanism);
    if let Some(execution) = execution {
        report.anchored("execution", "Executed by the twin");
        table(&mut report, execution);
        for (_, figure, caption) in &executed {
            report.figure(figure, caption);
        }
    }
    report
}

/// Numbers at the top, and whether the plan and its execution are within the limits.
fn headline(report: &mut Report, page: &PlanPage) {
    let PlanPage { task, plan, planned, execution, .. } = page;
    let gap = |bound: f64| format!("{:.2} % above it", 1e2 * (plan.time / bound - 1.0));
    let bound = if task.limits.has_jerk() { plan.outer_bound } else { Some(plan.bound) };
    let mut tiles = vec![[format!("{:.4} s", plan.time), "from rest to rest".into(), String::new()]];
    if let Some(bound) = bound.filter(|bound| *bound > 0.0) {
        let what = if task.limits.has_jerk() { "of any motion on the plan's grid" } else { "of any motion" };
        tiles.push([format!("{bound:.4} s"), format!("least time {what}"), gap(bound)]);
    }
    let worst = plan.worst();
    if let Some((limit, ratio)) = worst.iter().max_by(|a, b| a.1.total_cmp(b.1)) {
        let places = format!("{}; checked at {} places", limit.title(planned.signals.mechanism), plan.uses.len());
        tiles.push([format!("{:.2} %", 1e2 * ratio), "largest use of a limit".into(), places]);
    }
    let signals = &planned.signals;
    let forces = (0..signals.mechanism.struts()).flat_map(|s| &signals[Channel::StrutUpper(s)]);
    let peak = forces.fold(0.0_f64, |most, f| most.max(f.abs()));
    if peak > 0.0 {
        let usable = (1.0 - task.limits.margin) * task.limits.strut_upper;
        let note = if usable.is_finite() { format!("{usable:.0} N may be used") } else { "not limited".into() };
        tiles.push([format!("{peak:.0} N"), "largest strut force".into(), note]);
    }
    let tiles: Vec<[&str; 3]> = tiles.iter().map(|tile| tile.each_ref().map(String::as_str)).collect();
    report.tiles(&tiles);
    let Some(execution) = execution else { return };
    let text = format!(
        "The twin executes it: strut forces up to {:.1} N, least margin of a socket {:.1} N.",
        execution.peak_strut, execution.margin
    );
    if execution.is_within(&task.limits) {
        report.callout(Callout::Good, &(text + " Every limit holds."));
    } else {
        let violated = execution.violations(&task.limits).into_iter().map(|v| format!("\nLimit violated: {v}."));
        let events = execution.events.iter().map(|e| format!("\n{:.6} s {}: {}", e.t, e.kind.name(), e.what));
        report.callout(Callout::Bad, &(text + &violated.chain(events).collect::<String>()));
    }
}

fn active(report: &mut Report, plan: &Plan, machine: Mechanism) {
    let active = plan.active();
    if active.is_empty() {
        report.paragraph("No limit is reached.");
        return;
    }
    let rows: Vec<[String; 3]> = active
        .iter()
        .map(|(limit, [from, to])| [limit.title(machine), format!("{from:.4}"), format!("{to:.4}")])
        .collect();
    report.table(&["limit reached", "from s =", "to s ="], &rows);
}

/// Deviations of the execution from the plan.
fn table(report: &mut Report, execution: &Execution) {
    let mut rows = Vec::new();
    let mut row = |what: String, [rms, most]: [f64; 2], unit: &str| {
        rows.push([what, significant(rms, 3), significant(most, 3), unit.to_string()]);
    };
    let machine = execution.recording.signals.mechanism;
    for (axis, values) in execution.torque[..machine.axes()].iter().enumerate() {
        row(Channel::Torque(axis).title(machine), *values, &Channel::Torque(axis).unit(machine).to_string());
    }
    for (strut, values) in execution.strut.iter().enumerate() {
        row(Channel::StrutUpper(strut).title(machine), *values, "N");
    }
    row("acceleration of the end effector".into(), execution.acceleration, "m/s²");
    report.table(&["differs from the plan", "RMS", "at most", "unit"], &rows);
}

//! `deltatwin plan`.

use std::path::PathBuf;
use std::sync::OnceLock;
use std::time::Instant;

use miette::{IntoDiagnostic, WrapErr};
use serde_json::{Map, Value, json};

use crate::data::Outside;
use crate::terminal::{
    BAD_ANSWER, DONE, Table, assembled_robot, check_output, complain, origin_of, path, say, spinner, warn, write_figure,
};
use deltatwin::dynamics::Plant;
use deltatwin::machine::Unit;
use deltatwin::planner::trajectory::trajectory;
use deltatwin::planner::validation::{Execution, execute};
use deltatwin::planner::{Limits, Machine, Options, Plan, PlanError, Task, plan};
use deltatwin::recording::Recording;
use deltatwin::text::significant;
use deltatwin::twin::NewContacts;
use deltatwin::twin::origin::of_recording;
use deltatwin_analysis::page::end;
use deltatwin_report::plan::{PlanPage, figures, plan_page};

/// Plan the fastest motion along a path.
///
/// Limits on speed, acceleration, jerk and torque of the drives and on the constraint forces hold all along, or no plan is
/// given. The trajectory is a recording at the control period, which a scenario can run as a table.
#[derive(clap::Args, Clone, Debug)]
#[command(
    after_help = "Example: deltatwin plan models/irb360-6-1600.toml scenarios/u-turn.toml -o u-turn.csv --figure figures"
)]
pub struct Args {
    /// Model file.
    pub model: PathBuf,
    /// Path file.
    pub path: PathBuf,
    /// Trajectory to write, .csv or .mcap.
    #[arg(short, long, value_name = "TRAJ")]
    pub output: Option<PathBuf>,
    /// Folder for the figures, made if need be.
    #[arg(long, value_name = "DIR")]
    pub figure: Option<PathBuf>,
    /// Page to write, .html: the time, the limits that set it, the motion and its execution.
    #[arg(long, value_name = "PAGE")]
    pub report: Option<PathBuf>,
    /// Model file of a machine; the twin executes the plan on it, with feed-forward of MODEL; exit status 1 if it
    /// exceeds a limit there or an event occurs.
    #[arg(long, value_name = "MODEL2")]
    pub twin: Option<PathBuf>,
    /// Tighten the bound on the time with jerk limits; takes seconds.
    #[arg(long)]
    pub tighten: bool,
    #[command(flatten)]
    pub outside: Outside,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Largest number of ranges of active limits in the printed table.
const SHOWN: usize = 40;

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let model = assembled_robot(&args.model)?;
    let twin = args.twin.as_deref().map(assembled_robot).transpose()?;
    let task = deltatwin_io::plan::read_with(&args.path, Limits::of(&model), args.outside.access())?;
    if let Some(output) = &args.output {
        check_output(output, &[&args.model, &args.path], &["csv", "mcap"])?;
    }
    if let Some(page) = &args.report {
        check_output(page, &[&args.model, &args.path], &["html"])?;
    }
    let notes = task.shape.notes();
    warn(&notes.iter().map(|note| format!("{}: {note}", args.path.display())).collect::<Vec<_>>());
    let plant = Plant::new(&model, &task.setup);
    let machine = Machine::new(&plant, task.limits.detail);
    let curve = task.shape.curve();
    let progress = spinner("plan");
    let start = Instant::now();
    let options = Options { tighten: args.tighten, clock: seconds, ..task.options };
    let found = plan(&machine, &curve, &task.limits, &options);
    progress.finish_and_clear();
    let found = match found {
        Ok(found) => found,
        Err(error @ PlanError::Place { .. }) => {
            return Err(error).into_diagnostic().wrap_err_with(|| args.path.display().to_string());
        }
        Err(error) => {
            if args.json {
                say(json!({ "path": path(&args.path), "time": Value::Null, "error": error.to_string() }))?;
            }
            complain(format!("error: {}: {error}", args.path.display()));
            return Ok(BAD_ANSWER);
        }
    };
    let wall = start.elapsed().as_secs_f64();
    let planned = trajectory(&machine, &found, &task.setup, model.sample_time, &task.name)
        .into_diagnostic()
        .wrap_err_with(|| args.path.display().to_string())?;
    if let Some(output) = &args.output {
        let [model_name, path_name] =
            [&args.model, &args.path].map(|file| file.file_name().unwrap_or_default().to_string_lossy());
        let context = of_recording(&format!("deltatwin plan {model_name} {path_name}"), Some(&model), &planned);
        deltatwin_io::recording::write_with(&planned, output, &context)?;
    }
    let contacts = Some(deltatwin_cell::contacts as NewContacts);
    let execution =
        twin.as_ref().map(|twin| execute(twin, &plant, &planned, contacts)).transpose().into_diagnostic()?;
    let page = PlanPage {
        task: &task,
        plan: &found,
        planned: &planned,
        execution: execution.as_ref(),
        machine: &model.name,
        notes: &notes,
    };
    let written = write(args, &page)?;
    if args.json {
        let mut out = to_json(args, &found, &planned, &notes, wall);
        if let Some(execution) = &execution {
            out["execution"] = executed(execution, &task.limits);
        }
        say(out)?;
    } else {
        print(args, &page, &written)?;
    }
    Ok(if execution.is_none_or(|e| e.is_within(&task.limits)) { DONE } else { BAD_ANSWER })
}

/// Writes the figures and the page; returns their files.
fn write(args: &Args, page: &PlanPage) -> miette::Result<Vec<PathBuf>> {
    let mut written = Vec::new();
    if let Some(folder) = &args.figure {
        std::fs::create_dir_all(folder).into_diagnostic().wrap_err_with(|| folder.display().to_string())?;
        for (name, figure, _) in figures(page) {
            let target = folder.join(name).with_extension("svg");
            write_figure(&target, &figure)?;
            written.push(target);
        }
    }
    if let Some(target) = &args.report {
        let twin = args.twin.iter().map(|twin| ("twin", twin.as_path()));
        let inputs: Vec<_> = [("model", args.model.as_path()), ("path", &args.path)].into_iter().chain(twin).collect();
        let mut report = plan_page(page);
        end(&mut report, &origin_of("plan", &inputs)?);
        report.write(target).into_diagnostic()?;
        written.push(target.clone());
    }
    Ok(written)
}

/// Seconds since the first call.
fn seconds() -> f64 {
    static BEGUN: OnceLock<Instant> = OnceLock::new();
    BEGUN.get_or_init(Instant::now).elapsed().as_secs_f64()
}

fn to_json(args: &Args, found: &Plan, planned: &Recording, notes: &[String], wall: f64) -> Value {
    let violation: Map<String, Value> = found
        .worst()
        .into_iter()
        .filter(|(_, ratio)| *ratio > 0.0)
        .map(|(limit, ratio)| (limit.to_string(), json!(ratio)))
        .collect();
    let active: Vec<Value> = found
        .active()
        .into_iter()
        .map(|(limit, [from, to])| json!({ "s": from, "to": to, "limit": limit.to_string() }))
        .collect();
    json!({
        "path": path(&args.path),
        "time": found.time,
        "max_violation": violation,
        "optimality_gap": found.optimality_gap(),
        "time_bound": found.bound,
        "time_outer_bound": found.outer_bound,
        "time_search_bound": found.search_bound,
        "time_estimate": found.estimate,
        "time_without_jerk": found.time_without_jerk,
        "time_bound_without_jerk": found.bound,
        "intervals": found.profile.pieces.len(),
        "notes": notes,
        "solve_s": found.solve_s,
        "verify_s": found.verify_s,
        "wall_s": wall,
        "iterations": found.iterations,
        "active": active,
        "samples": planned.signals.len(),
        "trajectory": args.output.as_deref().map_or(Value::Null, path),
    })
}

/// What the twin makes of the plan.
fn executed(e: &Execution, limits: &Limits) -> Value {
    let pairs = |values: &[[f64; 2]], k: usize| -> Vec<f64> { values.iter().map(|v| v[k]).collect() };
    let violated = e.violations(limits).into_iter();
    let violated = violated.map(|v| json!({ "limit": v.limit.to_string(), "value": v.value, "allowed": v.allowed }));
    json!({
        "torque_rms": pairs(&e.torque, 0),
        "torque_max": pairs(&e.torque, 1),
        "strut_rms": pairs(&e.strut, 0),
        "strut_max": pairs(&e.strut, 1),
        "acceleration_rms": e.acceleration[0],
        "acceleration_max": e.acceleration[1],
        "peak_strut_force": e.peak_strut,
        "min_socket_margin": e.margin,
        "within_limits": e.is_within(limits),
        "violated": violated.collect::<Vec<_>>(),
        "events": e.events.iter().map(|e| json!({ "t": e.t, "kind": e.kind.name(), "what": e.what })).collect::<Vec<_>>(),
    })
}

/// Prints the bounds on the time.
fn bounds(task: &Task, found: &Plan) -> miette::Result<()> {
    let gap = |bound: f64| 1e2 * (1.0 - bound / found.time);
    if !task.limits.has_jerk() {
        let (bound, gap) = (found.bound, gap(found.bound));
        return say(format!("  bound      no motion within the limits takes less than {bound:.5} s: gap {gap:.3} %"));
    }
    if let Some(estimate) = found.estimate {
        let gap = gap(estimate);
        say(format!("  grid       about {estimate:.5} s on an ever finer grid (extrapolated): {gap:.2} % less"))?;
    }
    if let Some(outer) = found.outer_bound {
        let (n, gap) = (found.profile.pieces.len(), gap(outer));
        say(format!("  outer      at least {outer:.5} s for any motion on the plan's {n} intervals: gap {gap:.2} %"))?;
    }
    let (slow, bound) = (found.time_without_jerk, found.bound);
    say(format!("  no jerk    {slow:.5} s without jerk limits"))?;
    say(format!("  bound      no motion along the path takes less than {bound:.5} s, with or without jerk limits"))
}

fn print(args: &Args, page: &PlanPage, written: &[PathBuf]) -> miette::Result<()> {
    let PlanPage { task, plan: found, planned, execution, .. } = page;
    let machine = planned.signals.mechanism;
    say(format!("{}: {:.5} s", task.name, found.time))?;
    bounds(task, found)?;
    let worst = found.worst();
    let largest = worst.iter().max_by(|a, b| a.1.total_cmp(b.1));
    let (limit, ratio) = largest.map_or(("nothing".into(), 0.0), |(limit, ratio)| (limit.title(machine), *ratio));
    say(format!(
        "  check      {limit} reaches {:.3} % of what may be used, on {} places",
        1e2 * ratio,
        found.uses.len()
    ))?;
    say(format!(
        "  search     {:.0} ms, {} steps, check {:.0} ms",
        1e3 * found.solve_s,
        found.iterations,
        1e3 * found.verify_s
    ))?;
    let mut table = Table::new(&["  Active limit", "from s =", "to s ="], &[]);
    let active = found.active();
    for (limit, [from, to]) in active.iter().take(SHOWN) {
        table.row([format!("  {}", limit.title(machine)), format!("{from:.4}"), format!("{to:.4}")]);
    }
    say(table)?;
    if active.len() > SHOWN {
        say(format!("    and {} more; --json lists all", active.len() - SHOWN))?;
    }
    if let Some(e) = execution {
        let row = |what: &str, values: &[[f64; 2]], unit: &str| {
            let rms = values.iter().map(|v| significant(v[0], 3)).collect::<Vec<_>>().join(", ");
            let most = values.iter().map(|v| v[1]).fold(0.0, f64::max);
            say(format!("  {what} differ by {rms} {unit} RMS, {} {unit} at most", significant(most, 3)))
        };
        say("  Executed by the twin:")?;
        row("  torques", &e.torque[..machine.axes()], &machine.unit(Unit::NM).to_string())?;
        row("  strut forces", &e.strut, "N")?;
        row("  accelerations", &[e.acceleration], "m/s²")?;
        say(format!("    strut forces up to {:.1} N, least margin of a socket {:.1} N", e.peak_strut, e.margin))?;
        for violation in e.violations(&task.limits) {
            say(format!("    limit violated: {violation}"))?;
        }
        for event in &e.events {
            say(format!("    {:9.6} s  {}: {}", event.t, event.kind.name(), event.what))?;
        }
    }
    for file in args.output.iter().chain(written) {
        say(format!("  Wrote {}", file.display()))?;
    }
    Ok(())
}

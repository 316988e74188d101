//! Remedies for a payload and a path.

use deltatwin::planner::Limits;
use deltatwin::text::significant;
use deltatwin_io::kind::{Kind, kind};
use deltatwin_io::{model, plan, scenario, study};
use deltatwin_study::conduct::Conduct;
use deltatwin_study::design::{Point, nominal};
use deltatwin_study::run::advise::{Advice, Remedy, advise};
use deltatwin_study::run::{AFTER_LANDING, Case, Verdict};
use miette::{IntoDiagnostic, WrapErr};
use serde_json::{Value, json};
use std::path::Path;

use super::{Args, COMPLETE};
use crate::terminal::{BAD_ANSWER, Table, say, spinner, wrapped};

/// Prints the cheapest remedies for a scenario, or for the nominal point of a study.
pub fn run(args: &Args) -> miette::Result<u8> {
    let case = case(args)?;
    let read = |file| plan::read_with(file, Limits::of(case.planning()), args.outside.access());
    let task = args.path.as_deref().map(read).transpose()?;
    let busy = spinner("trying remedies on the twin");
    let advice = advise(&case, task.as_ref(), args.wanted).into_diagnostic();
    busy.finish_and_clear();
    let advice = advice.wrap_err_with(|| args.study.display().to_string())?;
    if args.json {
        say(as_json(&advice))?
    } else {
        print(args, &advice)?
    }
    let enough = advice.before.margin >= args.wanted || !advice.remedies.is_empty();
    Ok(if enough { COMPLETE } else { BAD_ANSWER })
}

fn case(args: &Args) -> miette::Result<Case> {
    if kind(&args.study)? == Kind::Study {
        let conduct = Conduct::new(study::read(&args.study, args.outside.access())?, Path::new(""))?;
        let settings = conduct.study.factors.iter().map(nominal).collect();
        return conduct
            .case(&Point { settings, seed: None })
            .map_err(|reason| miette::miette!("{}: its factors at their middles: {reason}", args.study.display()));
    }
    let scenario = scenario::read_with(&args.study, args.outside.access())?;
    let machine = model::read(&scenario.model)?;
    let controller_model = scenario.controller_model.as_deref().map(model::read).transpose()?;
    let base = args.study.parent().unwrap_or(Path::new("")).to_path_buf();
    Ok(Case {
        nominal: machine.sockets,
        model: machine,
        controller_model,
        scenario,
        base,
        after_landing: AFTER_LANDING,
    })
}

fn state(verdict: &Verdict) -> String {
    let cause = &verdict.cause;
    let what = if verdict.survived { "survives; closest" } else { "fails" };
    let margin = significant(verdict.margin, 3);
    format!("{what}: {} ({}) at {:.3} s, margin {margin}", cause.kind.name(), cause.part, cause.time)
}

fn print(args: &Args, advice: &Advice) -> miette::Result<()> {
    say(wrapped(&format!("As given: {}", state(&advice.before)), 0))?;
    if let Some(rate) = advice.before.picks_per_minute() {
        say(format!("  {} picks per minute", significant(rate, 4)))?;
    }
    if advice.before.margin >= advice.wanted {
        say(wrapped(&format!("The wanted margin, {}, is there already.", advice.wanted), 0))?;
    }
    let mut table = Table::new(&["remedy", "cost", "picks/min", "margin", "what"], &[4]);
    for remedy in &advice.remedies {
        let rate = remedy.verdict.picks_per_minute().map_or("—".into(), |rate| significant(rate, 4));
        table.row([
            remedy.kind.name().into(),
            cost(remedy),
            rate,
            significant(remedy.verdict.margin, 3),
            remedy.what.clone(),
        ]);
    }
    if !advice.remedies.is_empty() {
        say(table)?;
    }
    if let Some(best) = advice.best.as_ref().filter(|_| advice.before.margin < advice.wanted) {
        say(wrapped(
            &format!(
                "Nothing that was tried reaches the wanted margin, {}, against every cause; the best, {}, reaches {}: {}.",
                advice.wanted,
                best.what,
                significant(best.margin, 3),
                best.cause
            ),
            0,
        ))?;
    }
    for reason in &advice.refused {
        say(wrapped(&format!("no help, {reason}"), 2))?;
    }
    say(wrapped(&format!("Every margin is that of a run of the twin; wanted was {} (--wanted).", advice.wanted), 2))?;
    let name = args.study.display();
    let next = match kind(&args.study)? {
        Kind::Study => format!("deltatwin study {name} -o study"),
        _ => format!("deltatwin simulate {name} -o run.mcap"),
    };
    say(format!("  Next: {next}"))
}

/// Loss of picks per minute, or of speed where nothing is picked.
fn cost(remedy: &Remedy) -> String {
    match remedy.cost.unwrap_or(1.0 - remedy.speed) {
        none if none.abs() < 5e-5 => "none".into(),
        cost => format!("{:.1} %", 1e2 * cost),
    }
}

fn as_json(advice: &Advice) -> Value {
    let verdict = |v: &Verdict| {
        json!({
            "survived": v.survived,
            "cause": v.cause.kind.name(),
            "part": v.cause.part,
            "t": v.cause.time,
            "margin": v.margin,
            "picks_per_minute": v.picks_per_minute(),
        })
    };
    let remedy = |r: &Remedy| {
        json!({
            "remedy": r.kind.name(),
            "what": r.what,
            "speed": r.speed,
            "cost": r.cost.unwrap_or(1.0 - r.speed),
            "after": verdict(&r.verdict),
        })
    };
    json!({
        "before": verdict(&advice.before),
        "wanted": advice.wanted,
        "remedies": advice.remedies.iter().map(remedy).collect::<Vec<_>>(),
        "refused": advice.refused,
        "best": advice.best.as_ref().map(|b| json!({ "what": b.what, "margin": b.margin, "cause": b.cause })),
    })
}

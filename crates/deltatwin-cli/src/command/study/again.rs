//! A run of a study made again.

#[cfg(feature = "viewer")]
use deltatwin_io::outside::Access;
use serde_json::json;

use super::{Args, COMPLETE, command};
use crate::terminal::{BAD_ANSWER, check_output, path, say, wrapped};
use deltatwin::text::significant;
#[cfg(feature = "viewer")]
use deltatwin_rerun::{scene::Assets, show::Stage};
use deltatwin_study::conduct::{Conduct, Remade};

/// Makes `run` again, writes what is asked for and prints its verdict.
pub fn run(args: &Args, conduct: &Conduct, run: u64) -> miette::Result<u8> {
    if let Some(file) = &args.mcap {
        check_output(file, &[&args.study, conduct.study.scenario()], &["mcap", "csv"])?;
    }
    #[cfg(feature = "viewer")]
    if let Some(file) = &args.rrd {
        check_output(file, &[&args.study], &["rrd"])?;
    }
    let remade = conduct.remake(run)?;
    if let Some(file) = &args.mcap {
        remade.write_recording(conduct, file)?;
    }
    #[cfg(feature = "viewer")]
    if let Some(file) = &args.rrd {
        write_rerun(&remade, file, args.outside.access())?;
    }
    if args.json {
        as_json(args, conduct, &remade)?
    } else {
        print(args, conduct, &remade)?
    }
    Ok(if remade.same == Some(false) { BAD_ANSWER } else { COMPLETE })
}

#[cfg(feature = "viewer")]
fn write_rerun(remade: &Remade, file: &std::path::Path, access: Access) -> miette::Result<()> {
    let outcome = &remade.outcome;
    let Some(recording) = &outcome.recording else {
        return Err(miette::miette!(
            "{}: the motion was refused before it began; there is nothing to see",
            file.display()
        ));
    };
    let (model, setup) = (&remade.case.model, &remade.case.scenario.setup);
    let plant = deltatwin::dynamics::Plant::new(model, setup);
    let (options, assets) = (outcome.options.clone(), Assets::of(model, access)?);
    Stage { plant, options, desired: None, assets }.write(file, recording, &outcome.report)?;
    Ok(())
}

fn settings<'a>(conduct: &'a Conduct, remade: &'a Remade) -> impl Iterator<Item = (&'a str, String, &'a str)> {
    conduct.study.factors.iter().zip(&remade.point.settings).map(|(factor, setting)| {
        let text = conduct.columns.text(factor, *setting);
        let text = text.parse::<f64>().map_or(text, |x| significant(x, 5));
        (factor.name.as_str(), text, if factor.unit == "1" { "" } else { factor.unit.as_str() })
    })
}

fn print(args: &Args, conduct: &Conduct, remade: &Remade) -> miette::Result<()> {
    let verdict = &remade.outcome.verdict;
    let of: Vec<String> =
        settings(conduct, remade).map(|(n, v, u)| format!("{n} = {v} {u}").trim_end().into()).collect();
    say(wrapped(&format!("run {} of {}: {}", remade.run, conduct.study.name, of.join(", ")), 0))?;
    let cause = &verdict.cause;
    let what = if verdict.survived { "survives; closest" } else { "fails" };
    say(wrapped(
        &format!(
            "{what}: {} ({}) at {:.4} s, margin {}",
            cause.kind.name(),
            cause.part,
            cause.time,
            significant(verdict.margin, 3)
        ),
        2,
    ))?;
    if let Some(limit) = verdict.limit.as_ref().filter(|limit| limit.kind != cause.kind) {
        say(wrapped(&format!("first limit: {} ({}) at {:.4} s", limit.kind.name(), limit.part, limit.time), 2))?;
    }
    for step in verdict.sequence.iter().take(MOST_STEPS) {
        say(wrapped(&format!("{:9.6} s  {}", step.time, step.what), 2))?;
    }
    if verdict.sequence.len() > MOST_STEPS {
        say(format!("  and {} more events", verdict.sequence.len() - MOST_STEPS))?;
    }
    if !verdict.survived {
        say(wrapped(&format!("local effect: {}", verdict.fmea.local), 2))?;
        say(wrapped(&format!("end effect: {}", verdict.fmea.end), 2))?;
        let lead = verdict.fmea.lead.map_or(String::new(), |lead| format!(", {:.1} ms before", 1e3 * lead));
        say(wrapped(&format!("noticed by: {}{lead}", verdict.fmea.detection), 2))?;
    }
    match remade.same {
        Some(true) => say("  the verdict is that of the table, bit by bit")?,
        Some(false) => say("  the verdict differs from that of the table")?,
        None => {}
    }
    if let Some(file) = &args.mcap {
        say(format!("  Wrote {}; next: deltatwin replay {}", file.display(), file.display()))?;
    } else {
        say(format!("  Next: {}", command(args, &format!("--run {} --mcap run-{}.mcap", remade.run, remade.run))))?;
    }
    Ok(())
}

/// Number of events that are printed.
const MOST_STEPS: usize = 12;

fn as_json(args: &Args, conduct: &Conduct, remade: &Remade) -> miette::Result<()> {
    let verdict = &remade.outcome.verdict;
    let factors: serde_json::Map<String, serde_json::Value> = settings(conduct, remade)
        .map(|(name, value, _)| (name.to_string(), value.parse::<f64>().map_or(json!(value), |x| json!(x))))
        .collect();
    let sequence: Vec<_> = verdict.sequence.iter().map(|s| json!({ "t": s.time, "what": s.what })).collect();
    say(json!({
        "run": remade.run,
        "factors": factors,
        "survived": verdict.survived,
        "cause": verdict.cause.kind.name(),
        "part": verdict.cause.part,
        "t": verdict.cause.time,
        "margin": verdict.margin,
        "first_limit": verdict.limit.as_ref().map(|limit| json!({
            "cause": limit.kind.name(),
            "part": limit.part,
            "t": limit.time,
        })),
        "sequence": sequence,
        "fmea": {
            "cause": verdict.fmea.cause,
            "local": verdict.fmea.local,
            "end": verdict.fmea.end,
            "detection": verdict.fmea.detection,
            "lead": verdict.fmea.lead,
        },
        "same_as_table": remade.same,
        "recording": args.mcap.as_deref().map_or(serde_json::Value::Null, path),
    }))
}

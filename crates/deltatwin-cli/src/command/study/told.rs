//! What a study has found, in words and numbers.

use serde_json::{Value, json};

use super::pictures::{self, Shown, importance};
use super::{Args, COMPLETE, STOPPED, command};
use crate::terminal::{Table, complain, path, say, wrapped};
use deltatwin::text::significant;
use deltatwin_analysis::json::paths;
use deltatwin_io::study::Factor;
use deltatwin_study::campaign::Chunk;
use deltatwin_study::conduct::{Conduct, Diagnosed, Summary};
use deltatwin_study::run::CauseKind;
use deltatwin_study::statistics::{Ended, Index, Subset, wilson};

/// Says how to go on after an interruption; returns the exit status.
pub fn interrupted(args: &Args) -> u8 {
    let chunk = args.chunk.map_or(String::new(), |chunk| format!("--chunk {chunk}"));
    complain(format!("interrupted; what was done is kept, the same command goes on:\n  {}", command(args, &chunk)));
    STOPPED
}

/// Tells that a part is there.
pub fn part(args: &Args, conduct: &Conduct, chunk: Chunk) -> miette::Result<u8> {
    let part = conduct.campaign.part(chunk);
    let rows = chunk.range(conduct.runs());
    if args.json {
        say(json!({
            "study": conduct.study.name,
            "digest": conduct.campaign.digest.hex(),
            "build": conduct.campaign.build,
            "part": path(&part),
            "first_run": rows.start,
            "runs": rows.end - rows.start,
        }))?;
        return Ok(COMPLETE);
    }
    say(format!("Wrote {}: runs {} to {}", part.display(), rows.start, rows.end.saturating_sub(1)))?;
    say(format!("Next, when all {} parts are there:\n  {}", chunk.of(), command(args, "--merge")))?;
    Ok(COMPLETE)
}

/// Tells what the table says; returns the exit status.
pub fn table(args: &Args, conduct: &Conduct) -> miette::Result<u8> {
    let summary = conduct.summary()?;
    let subset = conduct.subset_result()?;
    let subset = subset.as_ref();
    let files = pictures::write(args, conduct, &summary, subset)?;
    if args.json {
        let mut object = as_json(conduct, &summary, subset);
        object["page"] = path(&files[0]);
        object["figures"] = paths(&files[1..]);
        object["sobol"] = sobol(conduct)?;
        say(object)?;
        return Ok(COMPLETE);
    }
    let study = &conduct.study;
    let title = study.title.as_ref().map_or(String::new(), |title| format!(": {title}"));
    say(wrapped(&format!("{}{title}", study.name), 0))?;
    let factors: Vec<&str> = study.factors.iter().map(|f| f.name.as_str()).collect();
    say(wrapped(
        &format!("{} of {} ({}), digest {}", study.design.name(), factors.join(" × "), rows(&summary), short(conduct)),
        2,
    ))?;
    counts(conduct, &summary)?;
    if let Some(subset) = subset {
        rare(subset)?;
    }
    if let Some(found) = &summary.diagnosed {
        diagnosed(conduct, found)?;
    }
    if let Some((run, reason)) = &summary.first_error {
        say(wrapped(&format!("{}; run {run}: {reason}", without_verdict(&summary, subset)), 2))?;
    }
    say(format!("  Wrote {} and {}", conduct.campaign.table().display(), files[0].display()))?;
    if let Some((run, margin)) = summary.worst {
        say(format!("  The least margin, {}, is that of run {run}. Next, to see it:", significant(margin, 3)))?;
        say(format!("    {}", command(args, &format!("--run {run} --mcap run-{run}.mcap"))))?;
    }
    Ok(COMPLETE)
}

fn rows(summary: &Summary) -> String {
    if summary.runs == 1 { "1 row".into() } else { format!("{} rows", summary.runs) }
}

fn short(conduct: &Conduct) -> String {
    conduct.campaign.digest.hex().chars().take(12).collect()
}

/// The runs without a verdict, and between which probabilities of failure they leave the true one.
pub fn without_verdict(summary: &Summary, subset: Option<&Subset>) -> String {
    let count = format!("{} run(s) without a verdict", summary.errors);
    if summary.boundary.is_some() {
        return count;
    }
    let [low, high] = subset.map_or_else(|| summary.bounds(), Subset::bounds).map(|p| significant(1e2 * p, 3));
    format!("{count}: failures are {low} % if these survive, {high} % if they fail")
}

fn counts(conduct: &Conduct, summary: &Summary) -> miette::Result<()> {
    let answered = summary.runs - summary.errors;
    if let Some((crossings, rising)) = summary.boundary {
        let of = conduct.study.margin.map_or(String::new(), |cause| format!(" by {}", CauseKind::ALL[cause].name()));
        say(format!(
            "  {crossings} of {answered} rays end in a failure{of}; the others reach the end of their ranges"
        ))?;
        if rising > 0 {
            say(format!(
                "  along {rising} of them the margin does not fall all the way: column margin_rises_from says where"
            ))?;
        }
    } else if answered > 0 {
        let [low, high] = wilson(summary.failed as usize, answered as usize, CONFIDENCE);
        say(format!(
            "  {} of {answered} failed, {:.2} % (95 % interval {:.2} to {:.2} %)",
            summary.failed,
            1e2 * summary.failed as f64 / answered as f64,
            1e2 * low,
            1e2 * high
        ))?;
    }
    let mut table = Table::new(&["cause", "runs", "share of the failures"], &[]);
    for (cause, count) in &summary.causes {
        let share = 1e2 * *count as f64 / summary.failed as f64;
        table.row([cause.clone(), count.to_string(), format!("{share:.1} %")]);
    }
    if !summary.causes.is_empty() {
        say(table)?;
    }
    if let Some((socket, count)) = summary.sockets.first() {
        say(format!("  the first socket to leave is most often {socket}: in {count} of these runs"))?;
    }
    if let Some((count, median)) = summary.noticed {
        say(format!(
            "  {count} failures would be noticed before they happen, {:.1} ms before in the median",
            1e3 * median
        ))?;
    }
    Ok(())
}

/// What the diagnosis says of the recordings, and how early.
fn diagnosed(conduct: &Conduct, found: &Diagnosed) -> miette::Result<()> {
    let count: u64 = found.named.iter().map(|(_, n)| n).sum();
    let names: Vec<String> = found.named.iter().map(|(name, n)| format!("{name} {n}")).collect();
    let names = if names.is_empty() { String::new() } else { format!(": {}", names.join(", ")) };
    say(wrapped(
        &format!(
            "the diagnosis of the recordings names something in {count} of {} runs{names}; in {} something is missing and not named",
            found.runs, found.unknown
        ),
        2,
    ))?;
    let Some(over) = conduct.study.over.map(|k| &conduct.study.factors[k]) else { return Ok(()) };
    let value =
        |x: f64| if over.unit == "1" { significant(x, 3) } else { format!("{} {}", significant(x, 3), over.unit) };
    let named = match found.named_from {
        Some((from, margin)) => {
            format!("always named from {} on, with a margin of {} left", value(from), significant(margin, 2))
        }
        None => "not always named at any value".into(),
    };
    let failed =
        found.failed_from.map_or("no run fails".into(), |from| format!("the first failure is at {}", value(from)));
    say(wrapped(&format!("over {}: {named}; {failed}", over.name), 2))
}

/// Confidence of intervals.
const CONFIDENCE: f64 = 0.95;

fn rare(subset: &Subset) -> miette::Result<()> {
    let [low, high] = subset.interval(CONFIDENCE);
    let what = match subset.ended {
        Ended::Reached => "probability of failure",
        _ => "the failure was not reached; its probability is below",
    };
    say(wrapped(
        &format!(
            "{what} {} (c.o.v. {}, 95 % interval {} to {}) from {} runs in {} levels",
            significant(subset.probability, 3),
            significant(subset.variation, 2),
            significant(low, 2),
            significant(high, 2),
            subset.evaluations,
            subset.levels.len()
        ),
        2,
    ))
}

/// Sobol' indices of a sensitivity study; null of another one, and where there are none.
fn sobol(conduct: &Conduct) -> miette::Result<Value> {
    let shown = Shown::of(conduct)?;
    let Some(Ok(found)) = importance::indices(&shown) else { return Ok(Value::Null) };
    let factors = conduct.study.factors.iter().zip(&found.first).zip(&found.total);
    let index = |((factor, first), total): ((&Factor, &Index), &Index)| {
        json!({
            "factor": factor.name,
            "first": first.value,
            "first_interval": first.interval,
            "total": total.value,
            "total_interval": total.interval,
        })
    };
    Ok(json!({
        "output": shown.margin,
        "base_points": found.base,
        "variance": found.variance,
        "indices": factors.map(index).collect::<Vec<_>>(),
    }))
}

fn as_json(conduct: &Conduct, summary: &Summary, subset: Option<&Subset>) -> Value {
    let answered = summary.runs - summary.errors;
    let map = |counts: &[(String, u64)]| -> Value { counts.iter().map(|(k, n)| (k.clone(), json!(n))).collect() };
    json!({
        "study": conduct.study.name,
        "design": conduct.study.design.name(),
        "digest": conduct.campaign.digest.hex(),
        "build": conduct.campaign.build,
        "runs": summary.runs,
        "failed": summary.failed,
        "errors": summary.errors,
        "failed_bounds": (summary.runs > 0).then(|| summary.bounds()),
        "failed_interval": (answered > 0).then(|| wilson(summary.failed as usize, answered as usize, CONFIDENCE)),
        "causes": map(&summary.causes),
        "first_sockets": map(&summary.sockets),
        "worst_run": summary.worst.map(|(run, _)| run),
        "least_margin": summary.worst.map(|(_, margin)| margin),
        "noticed_before": summary.noticed.map(|(count, _)| count),
        "median_lead": summary.noticed.map(|(_, median)| median),
        "diagnosed": summary.diagnosed.as_ref().map(|found| json!({
            "runs": found.runs,
            "named": map(&found.named),
            "unknown": found.unknown,
            "named_from": found.named_from.map(|(from, _)| from),
            "margin_then": found.named_from.map(|(_, margin)| margin),
            "failed_from": found.failed_from,
        })),
        "probability": subset.map(|s| json!({
            "value": s.probability,
            "variation": s.variation,
            "interval": s.interval(CONFIDENCE),
            "bounds": s.bounds(),
            "runs": s.evaluations,
            "levels": s.levels.len(),
            "reached": s.ended == Ended::Reached,
        })),
        "table": path(&conduct.campaign.table()),
    })
}

//! A diagnosis on one screen: the verdict, the errors before and after relative to the noise, and the next commands.

use super::Args;
use super::unexplained;
use crate::data::DataArgs;
use crate::terminal::{Table, command, error_bars, grouped, say, say_repeats, wrapped};
use deltatwin::diagnosis::candidates::{Standing, Untestable};
use deltatwin::diagnosis::{CandidateReport, Diagnosis, Verdict};
use deltatwin::identification::Estimate;
use deltatwin::text::{significant, with_error};

/// Number of candidates shown in addition to those found and their rivals.
const MAX_OTHERS: usize = 3;

/// Prints the diagnosis on one screen.
pub fn print(d: &Diagnosis, args: &Args) -> miette::Result<()> {
    say(wrapped(&deltatwin_analysis::sentence::verdict(d), 0))?;
    say("")?;
    let several = d.effects.len() > 1;
    if several {
        let all = percent(d.explained());
        say(wrapped(&format!("Together they explain {all} of the error above the noise."), 2))?;
    }
    for e in &d.effects {
        let share = percent(e.explained);
        let explains = if several {
            format!("without it {share} of that is back")
        } else {
            format!("explains {share} of the error above the noise")
        };
        say(wrapped(&format!("{}: {}; {explains}", e.name, values(&e.parameters)), 2))?;
    }
    let gap = if d.effects.is_empty() { "" } else { "\n" };
    let held_out = d.budget.held_out;
    say(format!(
        "{gap}{}",
        error_bars(d.model.mechanism, &d.channels, held_out, &d.rms_before, &d.rms_after, &d.noise_floor)
    ))?;
    if let Some(repeats) = &d.repeats {
        say_repeats(repeats)?;
    }
    if let Some(lag) = d.sampling_lag {
        let size = significant(1e3 * lag.abs(), 2);
        let text = if lag < 0.0 {
            format!(
                "The torques are recorded {size} ms before they act, as held commands are: no effect, but in the model."
            )
        } else {
            format!("The torques are recorded {size} ms late, less than half a sample: no effect, but in the model.")
        };
        say(format!("\n{}", wrapped(&text, 2)))?;
    }
    match (&d.unexplained, &d.left.sight) {
        (Some(u), _) => unexplained::print(u, d.explained_with_formula(), args.verbose)?,
        (None, Some(rest)) => say(format!("\n{}", wrapped(&unexplained::rest(rest), 2)))?,
        (None, None) => {}
    }
    for pattern in &d.left.patterns {
        say(wrapped(&format!("{}.", pattern.sentence), 4))?;
    }
    candidates(d)?;
    not_testable(d)?;
    if !d.not_tried.is_empty() {
        say(format!("\n{}", wrapped(&format!("The search was cut short; not tried: {}", d.not_tried.join(", ")), 2)))?;
    }
    next(d, args)
}

/// Largest number of parameters of an effect on the screen.
const MAX_VALUES: usize = 8;

/// Parameters with their standard errors in one line, those that are not determined last; the first of many.
fn values(parameters: &[Estimate]) -> String {
    let value = |p: &&Estimate| format!("{} = {}", p.name, p.unit.quantity(with_error(p.value, p.std)));
    let (known, open): (Vec<&Estimate>, Vec<_>) = parameters.iter().partition(|p| p.identified());
    let mut texts: Vec<String> = known.iter().take(MAX_VALUES).map(value).collect();
    let names: Vec<&str> = open.iter().take(MAX_VALUES - texts.len()).map(|p| &*p.name).collect();
    if !names.is_empty() {
        texts.push(format!("{} not determined alone", names.join(", ")));
    }
    if parameters.len() > MAX_VALUES {
        texts.push(format!("and {} more with --json", parameters.len() - MAX_VALUES));
    }
    texts.join(", ")
}

fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// Prints every found effect, every rival, and the best of the others.
fn candidates(d: &Diagnosis) -> miette::Result<()> {
    let named = |c: &&CandidateReport| matches!(c.standing, Standing::Found | Standing::Rival | Standing::Doubted);
    let tested = |c: &&CandidateReport| !named(c) && c.standing != Standing::Untestable;
    let mut table = Table::new(&["Candidate", "probability", "alone", "outcome", "imitated by"], &[3, 4]);
    let shown: Vec<_> =
        d.candidates.iter().filter(named).chain(d.candidates.iter().filter(tested).take(MAX_OTHERS)).collect();
    if shown.is_empty() {
        return Ok(());
    }
    for c in shown {
        let cells = [format!("{:.2}", c.probability), percent(c.explained), c.standing.to_string()];
        table.row(std::iter::once(c.name.clone()).chain(cells).chain([grouped(&c.absorbed_by)]));
    }
    say(format!("\n{table}"))?;
    say("  alone: what it could explain of the recordings fitted to, were nothing else missing")
}

/// Prints the effects that these data cannot test, grouped by reason.
fn not_testable(d: &Diagnosis) -> miette::Result<()> {
    let reason = |c: &CandidateReport| c.untestable;
    let of = |why: Untestable| -> Vec<&str> {
        let own = d.candidates.iter().filter(|c| reason(c) == Some(why)).map(|c| c.name.as_str());
        let beyond = d.twin_only.iter().filter(|_| why == Untestable::TwinOnly).map(String::as_str);
        own.chain(beyond).collect()
    };
    let groups: Vec<_> = Untestable::ALL.into_iter().map(|why| (why, of(why))).filter(|(_, n)| !n.is_empty()).collect();
    if groups.is_empty() && d.unseen_parameters.is_empty() {
        return Ok(());
    }
    say("\n  Not testable with this recording")?;
    groups.iter().try_for_each(|(why, names)| say(wrapped(&format!("{why}: {}", names.join(", ")), 4)))?;
    match d.unseen_parameters.is_empty() {
        true => Ok(()),
        false => say(wrapped(&format!("parameters that no channel shows: {}", d.unseen_parameters.join(", ")), 4)),
    }
}

/// Prints the next experiment and the next commands.
fn next(d: &Diagnosis, args: &Args) -> miette::Result<()> {
    if let Some(next) = &d.next_experiment {
        say(format!("\n{}", wrapped(&format!("Next experiment: {}", next.what), 2)))?;
    }
    say("\n  Next")?;
    let model = args.model.display().to_string();
    let again = |more: &[&str]| words("diagnose", std::slice::from_ref(&model), &args.data, more);
    let mut commands: Vec<Vec<String>> = Vec::new();
    match (&args.output, d.effects.as_slice()) {
        (Some(output), _) => commands.push(words("compare", &[output.display().to_string()], &args.data, &[])),
        (None, [one]) if d.verdict == Verdict::Effect => {
            commands.push(words("add", &[model.clone(), one.name.clone()], &args.data, &["-o", "better.toml"]));
        }
        // More time helps only where the time, and not the work, ended the search.
        (None, [])
            if d.verdict == Verdict::Undecided
                && !d.is_work_spent
                && let Some(limit) = args.time_limit =>
        {
            commands.push(again(&["--time-limit", &(4.0 * limit).to_string()]));
        }
        (None, _) if d.verdict != Verdict::None => commands.push(again(&["-o", "better.toml"])),
        _ => {}
    }
    if d.next_experiment.as_ref().is_some_and(|n| n.experiment.course.is_some()) && args.next.is_none() {
        commands.push(again(&["--next", "next.toml"]));
    }
    commands.iter().try_for_each(|c| say(command(c, 4)))?;
    if args.verbose {
        Ok(())
    } else {
        say("    --verbose shows p-values, the error budget and the parameters that moved")
    }
}

/// The words of a command on the same data.
fn words(name: &str, first: &[String], data: &DataArgs, more: &[&str]) -> Vec<String> {
    let mut words: Vec<String> = vec!["deltatwin".into(), name.into()];
    words.extend(first.iter().cloned());
    words.extend(data.inputs().words());
    words.extend(more.iter().map(|w| w.to_string()));
    words
}

//! Error budget on the terminal.

use crate::terminal::{Table, WIDTH, say, wrapped};
use deltatwin::diagnosis::budget::{Budget, Change};
use deltatwin::model::Added;
use deltatwin::text::significant;

/// Prints the shares of every channel and the changed parameters.
pub fn print(budget: &Budget, changes: &[Change], history: &[Added]) -> miette::Result<()> {
    if budget.effects.is_empty() {
        return Ok(());
    }
    // Longer names exceed the width of the screen.
    let fits = budget.effects.iter().map(|(name, _)| name.chars().count() + 2).sum::<usize>() + 55 <= WIDTH;
    let title = |(i, (name, _)): (usize, &(String, Vec<f64>))| if fits { name.clone() } else { format!("[{}]", i + 1) };
    let names: Vec<String> = budget.effects.iter().enumerate().map(title).collect();
    let mut header = vec!["Share of the mean square error", "noise"];
    header.extend(names.iter().map(String::as_str));
    header.push("unexplained");
    let mut is_negative = false;
    let mut table = Table::new(&header, &[]);
    let percent = |share: f64| format!("{:.1} %", 100.0 * share);
    for (c, &channel) in budget.channels.iter().enumerate() {
        let shares = budget.shares(c);
        let parts = std::iter::once(shares.noise).chain(shares.effects).chain([shares.unexplained]);
        let parts: Vec<f64> = parts.collect();
        is_negative |= parts.iter().any(|share| *share < 0.0);
        table.row(std::iter::once(channel.title(budget.mechanism)).chain(parts.into_iter().map(percent)));
    }
    say(format!("\n{table}"))?;
    if is_negative {
        say("  A negative share: the addition made the channel worse.")?;
    }
    let names = budget.effects.iter().enumerate().map(|(i, (name, _))| format!("[{}] {name}", i + 1));
    if !fits {
        say(wrapped(&names.collect::<Vec<_>>().join(", "), 2))?;
    }
    if !changes.is_empty() {
        let mut table = Table::new(&["Parameter that moved", "before", "std", "after", "std", "unit"], &[5]);
        for Change { before, after } in changes {
            let digits = [(before.value, 4), (before.std, 2), (after.value, 4), (after.std, 2)];
            let cells = digits.map(|(x, digits)| significant(x, digits));
            table.row(std::iter::once(before.name.clone()).chain(cells).chain([before.unit.to_string()]));
        }
        say(format!("\n{table}"))?;
    }
    let earlier = history.len().saturating_sub(budget.effects.len());
    if earlier > 0 {
        let names: Vec<&str> = history[..earlier].iter().map(|a| a.effect.as_str()).collect();
        say(format!("\n  Added earlier: {}", names.join(", ")))?;
    }
    Ok(())
}

//! Additional output of a diagnosis with `--verbose`: all parameters, all candidates with their p-values, the error
//! budget.

use super::budget;
use crate::terminal::{Table, grouped, say, wrapped};
use deltatwin::diagnosis::Diagnosis;
use deltatwin::text::significant;

/// Prints the details.
pub fn print(d: &Diagnosis) -> miette::Result<()> {
    for e in &d.effects {
        let mut table = Table::new(&[&e.name, "value", "std", "unit"], &[3]);
        for p in &e.parameters {
            table.row([p.name.clone(), significant(p.value, 4), significant(p.std, 2), p.unit.to_string()]);
        }
        say(format!("\n{table}"))?;
    }
    budget::print(&d.budget, &d.changes, &d.model.history)?;
    let mut table = Table::new(&["All candidates", "prob.", "alone", "p", "outcome", "imitated by"], &[4, 5]);
    for c in &d.candidates {
        let numbers = [
            format!("{:.2}", c.probability),
            format!("{:.1} %", 100.0 * c.explained),
            significant(c.p_adjusted, 2),
            c.standing.to_string(),
        ];
        table.row(std::iter::once(c.name.clone()).chain(numbers).chain([grouped(&c.absorbed_by)]));
    }
    say(format!("\n{table}"))?;
    let about = "p: chance that noise alone lets any candidate look like that, beside all that was found. A small p makes no \
                 effect: one that explains less than a tenth of the noise on every channel is too small to matter.";
    say(wrapped(about, 2))
}

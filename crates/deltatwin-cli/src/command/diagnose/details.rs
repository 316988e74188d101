//! Additional output of a diagnosis with `--verbose`: all parameters, all candidates with their p-values, the error
//! budget, the time of every stage.

use super::budget;
use super::time::Stage;
use crate::terminal::{Table, grouped, say, wrapped};
use deltatwin::diagnosis::Diagnosis;
use deltatwin::text::significant;

/// Time, s, below which a stage is not listed.
const SHORT: f64 = 0.05;

/// Prints the details.
pub fn print(d: &Diagnosis, stages: &[Stage]) -> miette::Result<()> {
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
    say(wrapped(about, 2))?;
    let mut table = Table::new(&["Stage", "time", "computing time"], &[0]);
    for stage in stages.iter().filter(|s| s.computed > SHORT || s.elapsed > SHORT) {
        table.row([stage.name.clone(), format!("{:.2} s", stage.elapsed), format!("{:.2} s", stage.computed)]);
    }
    say(format!("\n{table}"))?;
    let work = &d.work;
    let text = format!(
        "{} fits with {} passes that compute all columns and {} that predict; all candidates assessed {} times",
        work.fits, work.fitting.regressions, work.fitting.predictions, work.rankings
    );
    say(wrapped(&text, 2))
}

//! Output of `deltatwin diagnose` about unknown effects.

use crate::terminal::{say, wrapped};
use deltatwin::diagnosis::Unexplained;
use deltatwin::diagnosis::left::Rest;
use deltatwin::diagnosis::unknown::Shape;
use deltatwin::machine::Unit;
use deltatwin::text::significant;

/// Prints the location, the shape of the force, and the formula for the model file.
pub fn print(u: &Unexplained, explained: f64, verbose: bool) -> miette::Result<()> {
    let what = if u.beside_named { "What is left beside it" } else { "It" };
    let own = |(place, share): &(String, f64)| format!("{:.0} % at {place}", 100.0 * share);
    let shares = u.shares.iter().filter(|(_, share)| *share > 0.0).take(if verbose { usize::MAX } else { 3 });
    let shares = shares.map(own).collect::<Vec<_>>().join(", ");
    let place = format!(
        "{what} acts on {} (laws at one place alone could take {shares}): {}.",
        u.location,
        looks(&u.shape, u.unit)
    );
    say(format!("\n{}", wrapped(&place, 2)))?;
    let worth = format!("{:.1} % of the error above the noise", 100.0 * explained);
    let fit = match u.replaces {
        true => format!("An empirical fit, no physical finding, takes {worth}; `-o` writes it into the model:"),
        false => {
            format!("An empirical fit, no physical finding, makes it {worth}; `-o` leaves it out, paste it to have it:")
        }
    };
    say(wrapped(&fit, 2))?;
    say(u.toml().lines().map(|line| format!("    {line}\n")).collect::<String>().trim_end())
}

/// Description of a residual without a formula, as a sentence.
pub fn rest(rest: &Rest) -> String {
    format!("What is left on {}, for which no law was found: {}.", rest.location, looks(&rest.shape, rest.unit))
}

/// Description of a shape.
fn looks(s: &Shape, unit: Unit) -> String {
    let mut words = vec![format!("{} in speed", s.parity())];
    if let Some((period, variable)) = s.period {
        words.push(format!("period {} {} in {variable}", significant(period, 4), s.variable_unit()));
    }
    let (low, high) = s.mean.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), m| (a.min(*m), b.max(*m)));
    if low < high {
        let force = if s.along { "along the motion " } else { "" };
        let range = format!("{force}{} to {} {unit} over {}", significant(low, 2), significant(high, 2), s.variable);
        words.push(range);
    }
    words.push(format!("jump at reversal {} {unit}", significant(s.jump, 2)));
    words.push(format!("drift {} {unit} over the recording", significant(s.drift, 2)));
    let power = if s.power < 0.0 { "takes" } else { "gives" };
    words.push(format!("{power} {} W on average", significant(s.power.abs(), 2)));
    words.join(", ")
}

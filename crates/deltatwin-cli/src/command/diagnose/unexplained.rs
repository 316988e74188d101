//! Output of `deltatwin diagnose` about unknown effects.

use serde_json::{Value, json};

use crate::terminal::{say, wrapped};
use deltatwin::diagnosis::Unexplained;
use deltatwin::diagnosis::left::Rest;
use deltatwin::diagnosis::unknown::Shape;
use deltatwin::effects::formula::Place;
use deltatwin::identification::Estimate;
use deltatwin::machine::Unit;
use deltatwin::text::significant;

/// An unknown effect as JSON; `explained` is the share of the explainable error of the named effects and the formula.
pub fn json(u: &Unexplained, explained: f64) -> Value {
    let term = |(place, law, c): &(Place, String, Estimate)| json!({"name": c.name, "at": place.name(), "law": law, "coefficient": c.value, "std": finite(c.std), "unit": c.unit.to_string()});
    let s = &u.shape;
    json!({
        "location": u.location,
        "shares": u.shares.iter().map(|(place, share)| json!({"place": place, "share": share})).collect::<Vec<_>>(),
        "left": u.left,
        "explained": explained,
        "beside_named": u.beside_named,
        "in_model": u.replaces,
        "rms": u.residuals.rms,
        "shape": shape(s, u.unit),
        "parity": s.parity(),
        "odd_in_speed": s.odd,
        "period": s.period.map(|(value, variable)| json!({"value": value, "variable": variable})),
        "drift": s.drift,
        "jump": s.jump,
        "mean_power": s.power,
        "terms": u.terms.iter().map(term).collect::<Vec<_>>(),
        "formula": u.toml(),
    })
}

/// A shape as JSON.
pub fn shape(s: &Shape, unit: Unit) -> Value {
    json!({"variable": s.variable, "along_motion": s.along, "variable_unit": s.variable_unit(), "unit": unit.to_string(), "x": s.x, "mean": s.mean, "low": s.low, "high": s.high})
}

fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

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

//! What `deltatwin diagnose` says of what no known effect explains.

use serde_json::{Value, json};

use crate::diagnosis::Unexplained;
use crate::effects::formula::Place;
use crate::identification::Estimate;
use crate::terminal::{Table, say, significant};

/// As JSON; `explained` is the share of the explainable error that the formula takes.
pub fn json(u: &Unexplained, explained: f64) -> Value {
    let term = |(place, law, c): &(Place, String, Estimate)| json!({"name": c.name, "at": place.name(), "law": law, "coefficient": c.value, "std": finite(c.std), "unit": c.unit});
    let s = &u.shape;
    json!({
        "location": u.location,
        "shares": u.shares.iter().map(|(place, share)| json!({"place": place, "share": share})).collect::<Vec<_>>(),
        "left": u.left,
        "explained": explained,
        "beside_named": u.beside_named,
        "shape": {"variable": s.variable, "along_motion": s.along, "variable_unit": s.variable_unit, "unit": u.unit, "x": s.x, "mean": s.mean, "low": s.low, "high": s.high},
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

fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

/// On the terminal.
pub fn print(u: &Unexplained, explained: f64) -> miette::Result<()> {
    say(format!("\n  It acts on {}. What laws at one place alone could take of it:", u.location))?;
    let mut table = Table::new(&["  place", "share"], &[]);
    for (place, share) in u.shares.iter().filter(|(_, share)| *share > 0.0) {
        table.row([format!("  {place}"), format!("{:.1} %", 100.0 * share)]);
    }
    say(table)?;
    let s = &u.shape;
    say(format!(
        "  over {}: {} in speed, jump at reversal {} {}",
        s.variable,
        s.parity(),
        significant(s.jump, 2),
        u.unit
    ))?;
    if let Some((period, variable)) = s.period {
        say(format!("  period {} {} in {variable}", significant(period, 4), s.variable_unit))?;
    }
    let power = if s.power < 0.0 { "takes" } else { "gives" };
    say(format!(
        "  drift {} {} over the recording, {power} {} W on average",
        significant(s.drift, 2),
        u.unit,
        significant(s.power.abs(), 2)
    ))?;
    say(format!(
        "\n  An empirical fit, no physical finding, takes {:.1} % of the explainable error:\n",
        100.0 * explained
    ))?;
    say(u.toml().lines().map(|line| format!("    {line}\n")).collect::<String>())
}

//! Error budget as JSON.

use serde_json::{Value, json};

use crate::json::channel_names;
use deltatwin::diagnosis::budget::Budget;

/// The budget as JSON; shares are of the mean square error before the first effect.
pub fn json(budget: &Budget) -> Value {
    let shares: Vec<_> = (0..budget.channels.len()).map(|c| budget.shares(c)).collect();
    let effect = |(i, (name, rms)): (usize, &(String, Vec<f64>))| json!({"name": name, "rms_after": rms, "share": shares.iter().map(|s| s.effects[i]).collect::<Vec<_>>()});
    json!({
        "channels": channel_names(&budget.channels),
        "held_out": budget.held_out,
        "rms_before": budget.rms_before,
        "noise_floor": budget.noise_floor,
        "noise": shares.iter().map(|s| s.noise).collect::<Vec<_>>(),
        "effects": budget.effects.iter().enumerate().map(effect).collect::<Vec<_>>(),
        "unexplained": shares.iter().map(|s| s.unexplained).collect::<Vec<_>>(),
    })
}

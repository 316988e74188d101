//! The fastest motion along a shipped path within limits on drives and strut forces, and what is left to the limits.
//!
//! `cargo run --example time_optimal`

use std::path::Path;

use deltatwin::dynamics::Plant;
use deltatwin::planner::{Limit, Limits, Machine, plan};
use deltatwin_io::{model, plan as path};
use miette::{IntoDiagnostic, Result};

/// Largest strut forces that are tried, N.
const STRUT_FORCES: [f64; 3] = [150.0, 120.0, 100.0];

fn main() -> Result<()> {
    let model = model::read(Path::new("models/irb360-6-1600.toml"))?;
    let task = path::read(Path::new("scenarios/u-turn.toml"), Limits::of(&model))?;
    let plant = Plant::new(&model, &task.setup);
    let curve = task.shape.curve();
    for largest in STRUT_FORCES {
        let limits = Limits { strut_upper: largest, strut_lower: largest, ..task.limits };
        let machine = Machine::new(&plant, limits.detail);
        let found = plan(&machine, &curve, &limits, &task.options).into_diagnostic()?;
        println!("struts up to {largest} N, of which {:.0} % stay unused:", 100.0 * limits.margin);
        println!(
            "  duration          {:.4} s, at most {:.1} % above the least",
            found.time,
            100.0 * found.optimality_gap()
        );
        let worst = found.worst();
        let margin = |of: fn(&Limit) -> bool| {
            let used = worst.iter().filter(|(limit, _)| of(limit)).map(|(_, used)| *used).fold(0.0, f64::max);
            100.0 * (1.0 - used).max(0.0)
        };
        println!("  margin of torques {:6.1} %", margin(|l| matches!(l, Limit::Torque(_))));
        println!("  of strut forces   {:6.1} %", margin(|l| matches!(l, Limit::LambdaP(_) | Limit::LambdaS(_))));
        println!("  of the bearing    {:6.1} %", margin(|l| matches!(l, Limit::LambdaE(_))));
        println!("  of jerks          {:6.1} %", margin(|l| matches!(l, Limit::Jerk(_))));
    }
    Ok(())
}

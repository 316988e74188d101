//! Verdicts on scenarios: what limits each run, what happens when it fails, and what would have noticed.
//!
//! `cargo run -p deltatwin-study --example verdict -- scenarios/crash.toml`

use std::path::{Path, PathBuf};
use std::time::Instant;

use deltatwin_io::outside::Access;
use deltatwin_io::{model, scenario};
use deltatwin_study::run::{AFTER_LANDING, Case, Keep, run};
use miette::{IntoDiagnostic, Result};

fn main() -> Result<()> {
    for file in std::env::args_os().skip(1).map(PathBuf::from) {
        let scenario = scenario::read_with(&file, Access::with(deltatwin_cell::mesh::read))?;
        let controller_model = scenario.controller_model.as_deref().map(model::read).transpose()?;
        let base = file.parent().unwrap_or(Path::new(".")).to_path_buf();
        let model = model::read(&scenario.model)?;
        let case =
            Case { nominal: model.sockets, model, controller_model, scenario, base, after_landing: AFTER_LANDING };
        let start = Instant::now();
        let outcome = run(&case, Keep::Nothing).into_diagnostic()?;
        let (wall, verdict) = (start.elapsed().as_secs_f64(), outcome.verdict);
        let state = if verdict.survived { "survived" } else { "failed" };
        println!("{}: {state}, margin {:.3} ({wall:.3} s)", case.scenario.name, verdict.margin);
        if let Some(picks) = verdict.picks_per_minute() {
            println!("  {picks:.1} picks per minute");
        }
        for margin in &verdict.margins {
            let cause = &margin.cause;
            println!("  {:<16}{:7.3}  {} at {:.4} s", cause.kind.name(), margin.value, cause.part, cause.time);
        }
        for step in &verdict.sequence {
            println!("  {:9.6} s  {}", step.time, step.what);
        }
        for notice in &verdict.supervision {
            let lead = notice.lead.map_or("never".into(), |lead| format!("{lead:+.4} s"));
            println!("  noticed {lead:>10}  {}", notice.what);
        }
        if let Some(hand) = &verdict.hand {
            println!(
                "  by hand {:.1} N·m, {:.0} N; twin {:.0} N. {}",
                hand.torque, hand.force, hand.twin_force, hand.why
            );
        }
        println!("  cause      {}", verdict.fmea.cause);
        println!("  local      {}", verdict.fmea.local);
        println!("  end        {}", verdict.fmea.end);
        println!("  detection  {} ({:?} s)", verdict.fmea.detection, verdict.fmea.lead);
    }
    Ok(())
}

//! From a recording as CSV to the name of the effect that a model lacks, and to a better model.
//!
//! `cargo run --example missing_effect`. The measurement of the shipped servo axis comes from the twin, which has a Stribeck
//! friction that the model does not know.

use std::path::Path;

use deltatwin::diagnosis::{add, diagnose};
use deltatwin::dynamics::Plant;
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::identification::NoiseLevel;
use deltatwin::identification::{Dataset, fit};
use deltatwin::twin::{Options, simulate};
use deltatwin_io::{model, recording, scenario};
use miette::{IntoDiagnostic, Result};

fn main() -> Result<()> {
    let folder = tempfile::tempdir().into_diagnostic()?;
    let file = folder.path().join("axis.csv");
    measure(&file)?;

    let delivered = model::read(Path::new("models/servo-axis.toml"))?;
    let (measured, notes) = recording::read_of(&file, None, delivered.mechanism).into_diagnostic()?;
    notes.iter().for_each(|note| println!("note: {note}"));
    let data = [Dataset::new(&measured)];
    let noise = NoiseLevel::of(&delivered, &data);

    let identified = fit(&delivered, &data, &noise.of_each).into_diagnostic()?;
    println!("identified:     RMS {:.2} N, noise {:.2} N", identified.residuals.rms[0], noise.pooled[0]);

    let diagnosis = diagnose(&identified.model, &data, &[], &mut |_| {}).into_diagnostic()?;
    println!("diagnosis:      {}", diagnosis.verdict);
    for named in &diagnosis.effects {
        println!("missing:        {} (probability {:.2})", named.name, named.confidence.probability());
        let added = add(&identified.model, &named.name, &data, &[]).into_diagnostic()?;
        for p in &named.parameters {
            println!("  {:<16}{}", p.name, p.unit.quantity(format!("{:.4} ± {:.4}", p.value, p.std)));
        }
        println!("with it:        RMS {:.2} N", added.fit.residuals.rms[0]);
        model::write(&added.fit.model, &folder.path().join("better.toml"))?;
    }
    Ok(())
}

/// Writes what the sensors of an axis with one more effect record.
fn measure(file: &Path) -> Result<()> {
    let scenario = scenario::read(Path::new("scenarios/servo-axis.toml"))?;
    let believed = model::read(&scenario.model)?;
    let mut machine = believed.clone();
    machine
        .effects
        .push(ActiveEffect::new(find("drive_stribeck").expect("in the catalogue"), &[&[20.0], &[0.02], &[1900.0]]));
    let motion = scenario.motion(&believed).into_diagnostic()?;
    let (plant, options) = (Plant::new(&believed, &scenario.setup), Options::of(&scenario, &machine));
    let (recording, _) =
        simulate(&machine, &scenario.setup, &plant, &|t| motion.at(t), &options, &mut |_| true).into_diagnostic()?;
    recording::write(&recording, file).into_diagnostic()
}

//! The twin along a shipped scenario with ball sockets of one's own choice, and what it does to the strut forces.
//!
//! `cargo run --example strut_forces`

use std::path::Path;

use deltatwin::dynamics::Plant;
use deltatwin::effects::{ActiveEffect, find};
use deltatwin::machine::six_struts;
use deltatwin::recording::Channel;
use deltatwin::twin::{Options, simulate};
use deltatwin_io::{model, scenario};
use miette::{IntoDiagnostic, Result};

/// Friction moments of a ball, N·m, that are tried.
const MOMENTS: [f64; 3] = [0.0, 0.285, 0.6];
/// Rate at which the friction has nearly its full moment, rad/s.
const REGULARISATION: f64 = 0.05;

fn main() -> Result<()> {
    let scenario = scenario::read(Path::new("scenarios/smoke.toml"))?;
    let machine = model::read(&scenario.model)?;
    let believed = model::read(scenario.controller_model.as_ref().unwrap_or(&scenario.model))?;
    let controller = Plant::new(&believed, &scenario.setup);
    let motion = scenario.motion(&believed).into_diagnostic()?;
    println!("largest strut force at the elbow, N, over {} s", scenario.duration);
    println!("friction moment of a ball{}", six_struts().map(|s| format!("   strut {}", s + 1)).collect::<String>());
    for moment in MOMENTS {
        let mut machine = machine.clone();
        machine.effects.retain(|active| active.effect.name() != "ball_socket_coulomb");
        let friction = find("ball_socket_coulomb").expect("in the catalogue");
        machine.effects.push(ActiveEffect::new(friction, &[&[moment], &[REGULARISATION]]));

        let mut options = Options::of(&scenario, &machine);
        options.sensors.strut_upper = std::array::from_fn(|s| six_struts().contains(&s));
        let (recording, report) =
            simulate(&machine, &scenario.setup, &controller, &|t| motion.at(t), &options, &mut |_| true)
                .into_diagnostic()?;
        let peak = |forces: &[f64]| forces.iter().fold(0.0f64, |peak, f| peak.max(f.abs()));
        let upper = six_struts().map(|strut| peak(&recording.signals[Channel::StrutUpper(strut)]));
        let peaks = upper.map(|peak| format!("{peak:10.1}"));
        println!("{moment:21.3} N·m{}", peaks.collect::<String>());
        assert!(report.energy_closes(), "the step is too long for the motion");
    }
    Ok(())
}

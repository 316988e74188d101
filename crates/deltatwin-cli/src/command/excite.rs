//! `deltatwin excite`.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic, WrapErr, miette};
use nalgebra::Vector3;
use serde_json::{Map, Value, json};

use crate::terminal::{DONE, INTERRUPTED, Table, bar, catch_interrupt, check_output, interrupted, path, say, wrapped};
use deltatwin::effects::{ActiveEffect, Role};
use deltatwin::excitation::discriminate::{Discrimination, discriminate};
use deltatwin::excitation::experiments::{Experiment, Kind};
use deltatwin::excitation::prospect::{Prospect, chance, duration, in_words};
use deltatwin::excitation::{Design, Hemisphere, Merit, Objective, Options, design};
use deltatwin::machine::Mechanism;
use deltatwin::model::Model;
use deltatwin::numerics::median;
use deltatwin::text::significant;
use deltatwin_io::{model, scenario};

/// Design a motion that tells most about the parameters of a model.
///
/// The end effector follows Fourier series in x, y, z and ψ that respect every limit of joints, telescope and drives on a
/// fine grid. What is optimised is the information about the base parameters, those of all effects in the model included.
/// The motion is periodic and does not begin at rest. Ctrl-C ends the search; the best motion so far is written.
#[derive(clap::Args, Clone, Debug)]
#[command(
    after_help = "Examples: deltatwin excite models/irb360-6-1600.toml -o excite.toml --hemisphere 0,0,-0.85,0.35\n          \
                  deltatwin excite models/irb360-6-1600.toml -o tell.toml --discriminate base_tilt torque_bias"
)]
pub struct Args {
    /// Model file.
    pub model: PathBuf,
    /// Scenario to write, .toml.
    #[arg(short, long, value_name = "SCENARIO")]
    pub output: PathBuf,
    /// What is optimised.
    #[arg(long, value_enum, default_value_t)]
    pub objective: Measure,
    /// Base frequency, Hz; the motion repeats after its inverse.
    #[arg(long, default_value_t = 0.1)]
    pub frequency: f64,
    /// Number of harmonics.
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u64).range(1..=50))]
    pub harmonics: u64,
    /// Periods that the scenario runs.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub periods: u64,
    /// Share of the limits on speed, acceleration, torque and on the force that dislocates a socket that may be used.
    #[arg(long, default_value_t = 0.8)]
    pub share: f64,
    /// Lower half of a ball that the platform may not leave, m: centre of its flat top and radius.
    #[arg(long, value_name = "X,Y,Z,R", value_parser = hemisphere, allow_hyphen_values = true)]
    pub hemisphere: Option<Hemisphere>,
    /// Plan for telling these two effects apart instead; the best experiment of a catalogue is written. Their sizes are those
    /// in the model, else the usual ones.
    #[arg(long, num_args = 2, value_names = ["EFFECT", "EFFECT"])]
    pub discriminate: Option<Vec<String>>,
    /// Seed of the random motions.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Number of searches, each from another random motion.
    #[arg(long, default_value_t = 4, value_parser = clap::value_parser!(u64).range(1..=1000))]
    pub starts: u64,
    /// Largest number of steps of each search.
    #[arg(long, default_value_t = 80, value_parser = clap::value_parser!(u64).range(0..=100_000))]
    pub iterations: u64,
    /// Longest time of the search, s; a search that it ends depends on the speed of the computer.
    #[arg(long, default_value_t = 50.0, value_name = "SECONDS")]
    pub budget: f64,
    /// One JSON object on stdout.
    #[arg(long)]
    pub json: bool,
}

/// Number of base parameters in the printed table.
const SHOWN: usize = 8;
/// Longest duration of a scenario, s.
const LONGEST: f64 = 3600.0;

/// Objective of the design.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub enum Measure {
    /// −log det of the information: the volume of the confidence ellipsoid, whatever the units of the parameters.
    #[default]
    Logdet,
    /// Condition number of the weighted regressor with columns in units of the parameters' own sizes.
    Condition,
}

impl From<Measure> for Objective {
    fn from(chosen: Measure) -> Self {
        match chosen {
            Measure::Logdet => Self::Logdet,
            Measure::Condition => Self::Condition,
        }
    }
}

/// Parses `X,Y,Z,R`.
fn hemisphere(text: &str) -> Result<Hemisphere, String> {
    let numbers: Vec<f64> = text.split(',').filter_map(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, z, radius]
            if text.split(',').count() == 4
                && [x, y, z].iter().all(|v| v.abs() <= 10.0)
                && (0.01..=10.0).contains(&radius) =>
        {
            Ok(Hemisphere { centre: Vector3::new(x, y, z), radius })
        }
        _ => Err("expected four numbers X,Y,Z,R in m, the radius from 0.01 to 10".into()),
    }
}

fn within(option: &str, value: f64, low: f64, high: f64, unit: &str) -> miette::Result<f64> {
    match (low..=high).contains(&value) {
        true => Ok(value),
        false => Err(miette!("--{option} is {value}; expected a number from {low} to {high}{unit}")),
    }
}

impl Args {
    fn options(&self) -> miette::Result<Options> {
        let frequency = within("frequency", self.frequency, 1e-3, 20.0, " Hz")?;
        let length = self.periods as f64 / frequency;
        if length > LONGEST {
            return Err(miette!("--periods makes the run {length} s long; expected at most {LONGEST} s"));
        }
        Ok(Options {
            objective: self.objective.into(),
            frequency,
            harmonics: self.harmonics as usize,
            periods: self.periods as usize,
            share: within("share", self.share, 0.01, 1.0, "")?,
            hemisphere: self.hemisphere,
            seed: self.seed,
            starts: self.starts as usize,
            iterations: self.iterations as usize,
            ..Options::default()
        })
    }
}

/// Runs the command; returns the exit status.
pub fn run(args: &Args) -> miette::Result<u8> {
    let options = args.options()?;
    let budget = Duration::from_secs_f64(within("budget", args.budget, 0.0, 1e6, " s")?);
    let model = model::read(&args.model)?;
    if !model.assembled {
        let what = match model.mechanism {
            Mechanism::Delta { .. } => "is disassembled",
            Mechanism::Axis(_) => "is a single axis",
        };
        return Err(miette!(
            "{}: {what}; expected an assembled robot. A scenario with [motion] kind = \"random_fourier\" moves every axis on \
             its own",
            args.model.display()
        ));
    }
    check_output(&args.output, &[&args.model], &["toml"])?;
    catch_interrupt()?;
    let start = Instant::now();
    let progress = bar("excite", args.starts * args.iterations);
    let go_on = || {
        progress.inc(1);
        start.elapsed() < budget && !interrupted()
    };
    if let Some([a, b]) = args.discriminate.as_deref() {
        let planned = discriminate(&model, [a, b], &options, &go_on);
        progress.finish_and_clear();
        let planned = planned.into_diagnostic().wrap_err_with(|| args.model.display().to_string())?;
        return tell(&planned, args, &model, start.elapsed().as_secs_f64());
    }
    let designed = design(&model, &options, &go_on);
    progress.finish_and_clear();
    let designed = designed.into_diagnostic().wrap_err_with(|| args.model.display().to_string())?;
    let solve = start.elapsed().as_secs_f64();
    scenario::write_design(&designed, &options, &model, &args.model, &args.output)?;
    if args.json { say(json(&designed, args, solve)) } else { print(&designed, args, solve) }?;
    Ok(if interrupted() { INTERRUPTED } else { DONE })
}

/// Writes the best plan that needs no other machine, and prints all plans.
fn tell(planned: &Discrimination, args: &Args, model: &Model, solve: f64) -> miette::Result<u8> {
    let written = planned.plans.iter().find(|(e, _)| e.kind != Kind::Disassembled && e.course.is_some());
    let (plan, promise) = written.ok_or_else(|| miette!("no planned experiment can be written as a scenario"))?;
    let [a, b] = planned.effects.each_ref().map(|e| e.effect.name());
    let sizes = |e: &ActiveEffect| {
        let linear = e.entries().into_iter().zip(&e.values).filter(|(e, _)| e.parameter.role == Role::Linear);
        linear
            .map(|(e, v)| format!("{} = {}", e.name, e.parameter.unit.quantity(significant(*v, 4))))
            .collect::<Vec<_>>()
    };
    let mut comments = vec![
        format!("To distinguish {a} from {b}, planned by `deltatwin excite --discriminate`: {}.", plan.what),
        format!(
            "Predicted: δ² = {}, chance {:.2} of the right answer alone; {}.",
            significant(promise.noncentrality, 3),
            promise.chance,
            promise.seconds.map_or("no length gives 95 %".into(), |s| format!("{} give 95 %", duration(s)))
        ),
    ];
    comments.extend(planned.effects.iter().map(|e| format!("  {}: {}", e.effect.name(), sizes(e).join(", "))));
    scenario::write_experiment(plan, &comments, args.seed, (model, &args.model), &args.output)?;
    let entry = |(e, p): &(Experiment, Prospect)| {
        json!({
            "kind": e.kind.name(),
            "what": e.what,
            "noncentrality": p.noncentrality,
            "chance": p.chance,
            "duration": e.length,
            "seconds": p.seconds,
            "preparation": e.kind.preparation(),
        })
    };
    if args.json {
        let mut object = entry(&(plan.clone(), promise.clone()));
        object["scenario"] = path(&args.output);
        object["pair"] = json!([a, b]);
        object["searched"] = json!(planned.searched);
        object["plans"] = planned.plans.iter().map(entry).collect();
        object["solve_s"] = json!(solve);
        object["interrupted"] = json!(interrupted());
        say(object)?;
    } else {
        let mut table = Table::new(&["Experiment", "length", "δ²", "chance", "for 95 %", "kind"], &[5]);
        for (e, p) in &planned.plans {
            let needed = p.seconds.map_or("—".into(), duration);
            let cells = [duration(e.length), significant(p.noncentrality, 3), format!("{:.2}", p.chance), needed];
            table.row(std::iter::once(e.what.clone()).chain(cells).chain(std::iter::once(e.kind.name().into())));
        }
        say(table)?;
        say(format!(
            "\n{}",
            wrapped(&format!("To distinguish {a} from {b}: {}, {}", in_words(plan), chance(promise)), 2)
        ))?;
        say(format!("  Wrote {} after {solve:.1} s", args.output.display()))?;
    }
    Ok(if interrupted() { INTERRUPTED } else { DONE })
}

fn finite(x: f64) -> Value {
    if x.is_finite() { json!(x) } else { Value::Null }
}

/// Median and best value over the random motions.
fn random(design: &Design, of: impl Fn(&Merit) -> f64) -> [f64; 2] {
    [median(design.random.iter().map(&of)), design.random.iter().map(of).fold(f64::INFINITY, f64::min)]
}

fn json(design: &Design, args: &Args, solve: f64) -> Value {
    let [median_condition, best] = random(design, |m| m.condition);
    let worst: Map<String, Value> = design.worst.iter().map(|(name, share)| (name.to_string(), json!(share))).collect();
    let std = |(i, p): (usize, &deltatwin::dynamics::PlantParameter)| {
        let size = design.sizes[i];
        let std = finite(design.merit.std[i] * size);
        let typical = finite(random(design, |m| m.std[i])[0] * size);
        (p.name.clone(), json!({"std": std, "random_median_std": typical, "unit": p.unit.to_string()}))
    };
    json!({
        "scenario": path(&args.output),
        "condition_number": finite(design.merit.condition),
        "condition_number_si": finite(design.merit.condition_si),
        "condition_number_unit_columns": finite(design.merit.condition_unit),
        "log_det": finite(design.merit.log_det),
        "random": {
            "count": design.random.len(),
            "median_condition_number": finite(median_condition),
            "best_condition_number": finite(best),
            "median_condition_number_si": finite(random(design, |m| m.condition_si)[0]),
            "median_condition_number_unit_columns": finite(random(design, |m| m.condition_unit)[0]),
            "median_log_det": finite(random(design, |m| m.log_det)[0]),
            "best_log_det": finite(-random(design, |m| -m.log_det)[1]),
        },
        "base_parameters": design.parameters.iter().enumerate().map(std).collect::<Map<String, Value>>(),
        "dependent": design.dependent,
        "worst_limit": worst,
        "iterations": design.iterations,
        "stopped": design.stopped,
        "interrupted": interrupted(),
        "solve_s": solve,
    })
}

fn print(design: &Design, args: &Args, solve: f64) -> miette::Result<()> {
    let mut table = Table::new(&["Condition number, columns", "designed", "random median", "best", "gain"], &[]);
    type Of = fn(&Merit) -> f64;
    let kinds: [(&str, Of); 3] = [
        ("in units of the parameters' sizes", |m| m.condition),
        ("in SI units", |m| m.condition_si),
        ("of length one", |m| m.condition_unit),
    ];
    let number = |x: f64| significant(x, 4);
    for (name, of) in kinds {
        let [typical, best] = random(design, of);
        let own = of(&design.merit);
        table.row([name.into(), number(own), number(typical), number(best), significant(typical / own, 3)]);
    }
    let log_det = random(design, |m| -m.log_det).map(|v| number(-v));
    let [typical, best] = log_det;
    table.row(["log det of the information".into(), number(design.merit.log_det), typical, best, String::new()]);
    say(table)?;
    // The parameters with the largest errors along a random motion first.
    let typical: Vec<f64> = (0..design.parameters.len()).map(|i| random(design, |m| m.std[i])[0]).collect();
    let mut order: Vec<usize> = (0..design.parameters.len()).collect();
    order.sort_by(|&a, &b| typical[b].total_cmp(&typical[a]));
    let mut table =
        Table::new(&["Standard error of base parameter", "designed", "random median", "gain", "unit"], &[4]);
    for &i in order.iter().take(SHOWN) {
        let (p, size, std) = (&design.parameters[i], design.sizes[i], design.merit.std[i]);
        let cells = [significant(std * size, 3), significant(typical[i] * size, 3), significant(typical[i] / std, 3)];
        table.row(std::iter::once(p.name.clone()).chain(cells).chain(std::iter::once(p.unit.to_string())));
    }
    say(format!("\n{table}"))?;
    let mut table = Table::new(&["Use of the limits", "worst"], &[]);
    for (name, share) in &design.worst {
        table.row([name.replace('_', " "), format!("{share:.3}")]);
    }
    say(format!("\n{table}"))?;
    let ended = if interrupted() {
        ", interrupted"
    } else if design.stopped {
        ", out of time"
    } else {
        ""
    };
    say(format!("\n  {} steps from {} starts in {solve:.1} s{ended}", design.iterations, args.starts))?;
    say(format!("  Wrote {}", args.output.display()))
}

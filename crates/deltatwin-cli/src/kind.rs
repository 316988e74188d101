//! Validation of files: models, scenarios, setups, recordings.

use std::path::Path;

use miette::{IntoDiagnostic, WrapErr};

use deltatwin::gate::{Finding, examine, folded, inspect, positions};
use deltatwin::identification::{Dataset, swapped};
use deltatwin::machine::{Configuration, Setup};
use deltatwin::model::{Model, summary};
use deltatwin::planner::Limits;
use deltatwin::recording::{Channel, Recording};
use deltatwin_analysis::data::warning;
use deltatwin_io::kind::{Kind, kind};
use deltatwin_io::outside::Access;
use deltatwin_io::recording::setup;
use deltatwin_io::recording::{self, Reading};
use deltatwin_io::{model, scenario, study};

/// A valid file.
#[derive(Clone, Debug)]
pub struct Verified {
    /// Kind of the file.
    pub kind: Kind,
    /// Summary of its content, one sentence.
    pub summary: String,
    /// Warnings about it.
    pub warnings: Vec<String>,
    /// Findings of the gate about a recording; `None` without a model.
    pub gate: Option<Vec<Finding>>,
}

/// How recordings are validated.
#[derive(Clone, Copy)]
pub struct Examination<'a> {
    /// How they are read.
    pub how: Reading<'a>,
    /// Model that they are compared with.
    pub model: Option<&'a Model>,
    /// Mass of their payload, kg, instead of what the setup states.
    pub payload_mass: Option<f64>,
}

/// Validates a file of any kind with `access` to the files it names.
///
/// # Errors
/// The first error of the file.
pub fn check_as(path: &Path, access: Access, recordings: &Examination) -> miette::Result<Verified> {
    let kind = kind(path)?;
    if kind == Kind::Recording {
        let (summary, warnings, gate) = recording(path, recordings)?;
        return Ok(Verified { kind, summary, warnings, gate });
    }
    let (summary, warnings) = match kind {
        Kind::Model => (summary(&model::read(path)?), Vec::new()),
        Kind::Scenario => (scenario(path, access)?, Vec::new()),
        Kind::Study => (study(path, access)?, Vec::new()),
        Kind::Path => (planned_path(path, access)?, Vec::new()),
        Kind::Setup => (setup(&setup::read(path)?), Vec::new()),
        Kind::Recording => unreachable!("recordings are done with above"),
    };
    Ok(Verified { kind, summary, warnings, gate: None })
}

fn scenario(path: &Path, access: Access) -> miette::Result<String> {
    let scenario = scenario::read_with(path, access)?;
    let machine = model::read(&scenario.model)?;
    let controller = scenario.controller_model.as_deref().map(model::read).transpose()?;
    let planning = controller.as_ref().unwrap_or(&machine);
    scenario.motion(planning).into_diagnostic().wrap_err_with(|| path.display().to_string())?;
    let course = scenario.motion.describe();
    let sensors = scenario.sensors.strut_upper.iter().chain(&scenario.sensors.strut_lower).filter(|s| **s).count();
    Ok(format!(
        "{} s of {course} on {}, feed-forward from {}, {}, {}, {sensors} strut force sensors; the motion can be reached.",
        (1e4 * scenario.duration).round() / 1e4,
        machine.name,
        planning.name,
        payload(&scenario.setup),
        if scenario.noise { "noisy" } else { "no noise" },
    ))
}

fn study(path: &Path, access: Access) -> miette::Result<String> {
    let study = study::read(path, access)?;
    let names: Vec<&str> = study.factors.iter().map(|f| f.name.as_str()).collect();
    let scenario = study.scenario().file_name().unwrap_or_default().to_string_lossy().into_owned();
    let what = format!("{} of {} on {scenario}", study.design.name(), names.join(", "));
    rows(study, what)
}

/// Summary of a study that may run: `what` it is, with the number of its rows.
#[cfg(feature = "studies")]
fn rows(study: study::Study, what: String) -> miette::Result<String> {
    use deltatwin_study::conduct::Conduct;
    use deltatwin_validation::exam::experiment::Experiments;
    if study.experiment.is_some() {
        let experiments = Experiments::new(study, Path::new(""))?;
        return Ok(format!("experiments of the diagnosis, {} of them.", experiments.runs()));
    }
    let conduct = Conduct::new(study, Path::new(""))?;
    let most = if conduct.is_search() { "at most " } else { "" };
    Ok(format!("{what}, {most}{} rows; every factor fits at both ends of its range.", conduct.runs()))
}

/// Summary of a study whose runs this build leaves out.
#[cfg(not(feature = "studies"))]
fn rows(_: study::Study, what: String) -> miette::Result<String> {
    Ok(format!("{what}; its factors are checked by a build with `--features studies`."))
}

fn planned_path(path: &Path, access: Access) -> miette::Result<String> {
    let task = deltatwin_io::plan::read_with(path, Limits::NONE, access)?;
    let curve = task.shape.curve();
    let [from, to] = [0.0, curve.end()].map(|s| curve.at(s)[0]);
    Ok(format!(
        "path from ({}, {}, {}) to ({}, {}, {}) m, {}, {} intervals.",
        from.x,
        from.y,
        from.z,
        to.x,
        to.y,
        to.z,
        payload(&task.setup),
        task.options.intervals,
    ))
}

fn payload(setup: &Setup) -> String {
    match setup.payload.mass {
        0.0 => "no payload".into(),
        m => format!("payload {m} kg"),
    }
}

fn setup(setup: &Setup) -> String {
    let configuration = match setup.configuration {
        Configuration::Assembled => "assembled",
        Configuration::Disassembled => "disassembled",
    };
    let noise = if setup.torque_noise.is_some() { ", torque noise stated" } else { "" };
    format!("{configuration}, {}{noise}.", payload(setup))
}

/// Warnings about a recording alone, see [`inspect`].
pub fn alone(path: &Path, recording: &Recording) -> Vec<String> {
    inspect(recording, &Dataset::new(recording)).iter().map(|f| warning(path, f)).collect()
}

type Verdict = (String, Vec<String>, Option<Vec<Finding>>);

fn recording(path: &Path, &Examination { how, model, payload_mass }: &Examination) -> miette::Result<Verdict> {
    let (mut recording, mut warnings) = recording::read_as(path, &how)?;
    recording.setup.payload.mass = payload_mass.unwrap_or(recording.setup.payload.mass);
    let mut dataset = Dataset::new(&recording);
    if model.is_none() {
        // For a model with elastic gears; of a long recording they are large.
        dataset.readings = Default::default();
    }
    let gate = model.map(|m| examine(m, &dataset).into_iter().chain(positions(m, &recording)).collect::<Vec<_>>());
    // What the gate has said about an axis with the model's help is not said again.
    let said = |f: &Finding| gate.iter().flatten().any(|g| g.axis == f.axis && g.problem == f.problem);
    let mut alone = inspect(&recording, &dataset);
    alone.extend(model.map_or_else(Vec::new, |m| folded(m, &dataset)));
    warnings.extend(alone.iter().filter(|f| !said(f)).map(|f| warning(path, f)));
    if model.is_none() {
        warnings.extend(swapped(&dataset).map(|what| format!("{}: {what}", path.display())));
    }
    let s = &recording.signals;
    let duration = s.t.last().zip(s.t.first()).map_or(0.0, |(b, a)| b - a);
    let forces = s.series().filter(|(c, _)| matches!(c, Channel::StrutUpper(_) | Channel::StrutLower(_))).count();
    let axes = match s.mechanism.axes() {
        1 => "one axis".to_string(),
        n => format!("{n} axes"),
    };
    let pieces = match s.stretches().len() {
        1 => "one piece".to_string(),
        n => format!("{n} pieces"),
    };
    let summary = format!(
        "{axes}, {} samples over {duration:.4} s every {:.1} µs in {pieces}, {forces} strut forces; {}",
        s.len(),
        1e6 * s.sample_time(),
        setup(&recording.setup),
    );
    Ok((summary, warnings, gate))
}

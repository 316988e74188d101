//! Designed motions and planned experiments as scenario files.

use std::fmt::Write;
use std::path::Path;

use deltatwin::excitation::experiments::Experiment;
use deltatwin::excitation::{Design, Objective, Options};
use deltatwin::machine::{Payload, Setup};
use deltatwin::model::Model;
use deltatwin::numerics::median;
use deltatwin::recording::Channel;
use deltatwin::scenario::Course;
use deltatwin::text::significant;
use miette::{IntoDiagnostic, WrapErr, miette};

use super::{motion_text, parse};
use crate::file::{replace_text, way};
use crate::recording::setup::payload_to_toml;

/// Text of a scenario that runs the model file called `model` along the designed motion.
fn text(design: &Design, options: &Options, model: String) -> String {
    let mut out = String::new();
    let objective = match options.objective {
        Objective::Logdet => "-log det of the information about the base parameters",
        Objective::Condition => "the condition number of the weighted base regressor",
    };
    let random = median(design.random.iter().map(|m| m.condition));
    let worst = design.worst.iter().map(|(name, share)| format!("{name} {share:.3}")).collect::<Vec<_>>().join(", ");
    let number = |x: f64| significant(x, 4);
    let comments = [
        format!("Excitation for identification, designed by `deltatwin excite`: least {objective}."),
        format!(
            "Condition number {}, columns in units of the parameters' own sizes; median of {} random motions {}.",
            number(design.merit.condition),
            design.random.len(),
            number(random)
        ),
        format!(
            "Columns in SI units {}, of length one {}.",
            number(design.merit.condition_si),
            number(design.merit.condition_unit)
        ),
        format!("{} base parameters, log det {}.", design.parameters.len(), number(design.merit.log_det)),
        format!(
            "Worst use of the limits, with {} of speed, acceleration, torque and dislocation force permitted:",
            options.share
        ),
        format!("  {worst}."),
        "The motion is periodic and does not begin at rest: bring a real machine into it first.".into(),
        "`deltatwin simulate --model M` runs another machine along the same motion.".into(),
    ];
    for line in comments {
        let _ = writeln!(out, "# {line}");
    }
    let duration = options.periods as f64 / options.frequency;
    let model = toml::Value::String(model);
    let _ = write!(
        out,
        "\nmodel = {model} # also plans the motion and gives the feed-forward\n\
         duration = {duration:?} # s, {} periods\n\
         seed = {} # of the sensor noise\n\
         noise = true\n\n{}",
        options.periods,
        options.seed,
        motion_text(&Course::Fourier(design.motion.clone())).unwrap_or_default()
    );
    out
}

/// Writes a designed motion as a scenario, after reading it back and checking its motion.
///
/// # Errors
/// If the motion is not feasible for the machine, or the file cannot be written.
pub fn write_design(
    design: &Design,
    options: &Options,
    model: &Model,
    model_file: &Path,
    output: &Path,
) -> miette::Result<()> {
    let text = text(design, options, relative(model_file, output));
    checked(&text, model, output)?;
    replace_text(output, &text).into_diagnostic().wrap_err_with(|| format!("cannot write {}", output.display()))
}

/// A designed motion as the text of a scenario that may be saved in any folder: it names `model_file` by its absolute path.
///
/// # Errors
/// If the motion is not feasible for the machine, or there is no `model_file`.
pub fn design_text(design: &Design, options: &Options, model: &Model, model_file: &Path) -> miette::Result<String> {
    let file = model_file
        .canonicalize()
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot read {}", model_file.display()))?;
    let text = text(design, options, file.display().to_string());
    checked(&text, model, &file.with_file_name("scenario.toml"))?;
    Ok(text)
}

/// Reads a scenario's text back and checks its motion.
fn checked(text: &str, model: &Model, file: &Path) -> miette::Result<()> {
    let scenario = parse(text, file)?;
    scenario.motion(model).into_diagnostic().wrap_err_with(|| file.display().to_string())?;
    Ok(())
}

/// Writes a planned experiment as a scenario of `model_file`, after reading it back and checking its motion.
///
/// # Errors
/// If the motion cannot be written as a table `[motion]` or is not feasible for the machine, or the file cannot be
/// written.
pub fn write_experiment(
    plan: &Experiment,
    comments: &[String],
    seed: u64,
    (model, model_file): (&Model, &Path),
    output: &Path,
) -> miette::Result<()> {
    let motion = plan.course.as_ref().and_then(motion_text);
    let motion = motion.ok_or_else(|| miette!("{}: the motion of a recording is no scenario", output.display()))?;
    let mut text: String = comments.iter().map(|line| format!("# {line}\n")).collect();
    let model_name = toml::Value::String(relative(model_file, output));
    let _ = write!(
        text,
        "\nmodel = {model_name}\nduration = {:?} # s\nseed = {seed} # of the sensor noise\nnoise = true\n\n{motion}",
        (plan.length * 1e6).round() / 1e6
    );
    let Setup { payload, .. } = plan.dataset.setup;
    if payload != Payload::default() {
        let _ = write!(text, "\n{}", payload_to_toml(&payload));
    }
    let struts = |end: fn(&Channel) -> Option<usize>| plan.dataset.channels.iter().filter_map(end).collect::<Vec<_>>();
    let upper = struts(|c| if let Channel::StrutUpper(i) = c { Some(i + 1) } else { None });
    let lower = struts(|c| if let Channel::StrutLower(i) = c { Some(i + 1) } else { None });
    if !upper.is_empty() || !lower.is_empty() {
        let _ = write!(text, "\n[sensors]\nstrut_upper = {upper:?}\nstrut_lower = {lower:?}\n");
    }
    checked(&text, model, output)?;
    replace_text(output, &text).into_diagnostic().wrap_err_with(|| format!("cannot write {}", output.display()))
}

/// `file` relative to the folder of `output`; absolute if they have no common folder.
fn relative(file: &Path, output: &Path) -> String {
    let folder = output.parent().filter(|f| !f.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let (Ok(file), Ok(folder)) = (file.canonicalize(), folder.canonicalize()) else {
        return file.display().to_string();
    };
    let has_common = file.components().zip(folder.components()).take_while(|(a, b)| a == b).count() > 1;
    if has_common { way(&file, &folder).display().to_string() } else { file.display().to_string() }
}

//! Pages of the stages and of the whole run, from the same components.

use crate::data::Data;
use crate::folder::Input;
use crate::identify::Identification;
use crate::run::Analysis;
use deltatwin::comparison::Comparison;
use deltatwin::diagnosis::{Addition, Diagnosis, Verdict};
use deltatwin::gate::Finding;
use deltatwin::identification::{Dataset, Estimate, FitError, Residuals};
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin::text::significant;
use deltatwin_report::component::errors::Errors;
use deltatwin_report::component::parameters::Parameters;
use deltatwin_report::component::signals::{Addition as Added, Alternatives, Signals};
use deltatwin_report::component::{candidates, errors, origin, parameters, signals};
use deltatwin_report::drawing::residual::Stage;
use deltatwin_report::{Callout, ErrorGroup, Figure, Report, Role, drawing, falling_error};
use nalgebra::DMatrix;

/// Where results come from.
#[derive(Clone, Debug, Default)]
pub struct Origin {
    /// The command that gives them.
    pub command: Vec<String>,
    /// Name of the command in the provenance of fitted numbers.
    pub stage: String,
    /// Version of the program.
    pub version: String,
    /// Day, `2026-11-23`.
    pub date: String,
    /// Files that went in.
    pub inputs: Vec<Input>,
    /// Warnings about these.
    pub warnings: Vec<String>,
    /// What is known beside the data, such as the effect that a demo has hidden; may be empty.
    pub note: String,
}

/// Page of a whole run.
///
/// # Errors
/// If a model cannot follow the recording.
pub fn of_run(a: &Analysis, model: &Model, data: &Data, origin: &Origin) -> Result<Report, FitError> {
    let d = &a.diagnosis;
    let mut page = begin(&format!("{}: what is missing", model.name), data, origin);
    headline(&mut page, d);
    if !origin.note.is_empty() {
        page.callout(Callout::Note, &origin.note);
    }
    let stages = stages_of_run(a);
    let mut models = vec![
        Stage { role: Role::Nominal, name: "delivered", model },
        Stage { role: Role::Identified, name: "identified", model: &a.identification.fitted.model },
    ];
    if stages.len() > models.len() {
        models.push(Stage { role: Role::Added, name: "effect added", model: &d.model });
    }
    let held_out = !data.held_out.is_empty();
    errors::add(
        &mut page,
        &Errors { mechanism: d.model.mechanism, channels: &d.channels, stages, noise_floor: &d.noise_floor, held_out },
    );
    warnings(&mut page, &[&origin.warnings[..], &a.warnings].concat(), &a.gate);
    diagnosed_residuals(&mut page, &models, data, d)?;
    findings(&mut page, &a.identified, "Where the identified model fails");
    diagnosed(&mut page, d);
    page.anchored("parameters", "Parameters");
    let fitted = &a.identification.fitted.parameters;
    let mut estimates: Vec<(Role, &str, &[Estimate])> = vec![(Role::Identified, "identified", fitted)];
    let mut covariance = &a.identification.fitted.covariance;
    if !d.effects.is_empty() {
        estimates.push((Role::Added, "effect added", &d.parameters[1]));
        covariance = &d.covariance;
    }
    parameter_table(&mut page, model, data, &estimates, covariance);
    budget(&mut page, d);
    next(&mut page, d);
    end(&mut page, origin);
    Ok(page)
}

/// RMS errors of a run at every stage of the model, N·m or N.
fn stages_of_run(a: &Analysis) -> Vec<(Role, &str, &[f64])> {
    let d = &a.diagnosis;
    let delivered = a.delivered.judged().0;
    let identified = a.identification.judged().0;
    let mut stages: Vec<(Role, &str, &[f64])> =
        vec![(Role::Nominal, "delivered", delivered), (Role::Identified, "identified", identified)];
    if !d.effects.is_empty() || d.unexplained.is_some() {
        stages.push((Role::Added, "effect added", &d.rms_after));
    }
    stages
}

/// Figure of the RMS errors of a run at every stage of the model, against the noise.
pub fn errors_figure(a: &Analysis) -> Figure {
    let (names, errors): (Vec<(Role, &str)>, Vec<&[f64]>) =
        stages_of_run(a).into_iter().map(|(role, name, rms)| ((role, name), rms)).unzip();
    let group = |(c, channel): (usize, &Channel)| ErrorGroup {
        name: channel.title(a.diagnosis.model.mechanism),
        values: errors.iter().map(|rms| rms[c]).collect(),
        floor: a.diagnosis.noise_floor.get(c).copied(),
    };
    let groups: Vec<ErrorGroup> = a.diagnosis.channels.iter().enumerate().map(group).collect();
    falling_error("RMS error", "RMS error / N·m or N", &names, &groups)
}

/// Page of a comparison, with the residuals of a later model `beside` it where given, under its name.
///
/// # Errors
/// If a model cannot follow the recording.
pub fn of_comparison(
    c: &Comparison,
    model: &Model,
    beside: Option<(&str, &Model)>,
    data: &Data,
    origin: &Origin,
) -> Result<Report, FitError> {
    let title = format!("{} compared with what was measured", model.name);
    let mut page = dated(&title, compared_with(data), origin);
    let (rms, noise_floor) = c.judged();
    let held_out = c.held_out.is_some();
    let mut models = vec![Stage { role: Role::Nominal, name: "model", model }];
    let mut stages: Vec<(Role, &str, &[f64])> = vec![(Role::Nominal, "model", rms)];
    let judged = if held_out { &data.held_out } else { &data.datasets };
    let other = beside.map(|(_, other)| Residuals::new(other, judged)).transpose()?;
    if let Some(((name, other), left)) = beside.zip(other.as_ref()) {
        models.push(Stage { role: Role::Added, name, model: other });
        stages.push((Role::Added, name, &left.rms));
    }
    errors::add(&mut page, &Errors { mechanism: c.mechanism, channels: &c.channels, stages, noise_floor, held_out });
    warnings(&mut page, &origin.warnings, &[]);
    residuals(&mut page, &models, data, noise_floor)?;
    findings(&mut page, c, "Where the model fails");
    end(&mut page, origin);
    Ok(page)
}

/// Page of a fit of `model`.
///
/// # Errors
/// If a model cannot follow the recording.
pub fn of_identification(
    i: &Identification,
    before: &Comparison,
    model: &Model,
    data: &Data,
    origin: &Origin,
) -> Result<Report, FitError> {
    let mut page = begin(&format!("{} identified", model.name), data, origin);
    let (rms, noise_floor) = i.judged();
    let delivered = before.judged().0;
    let stages: Vec<(Role, &str, &[f64])> =
        vec![(Role::Nominal, "delivered", delivered), (Role::Identified, "identified", rms)];
    let held_out = i.held_out.is_some();
    errors::add(
        &mut page,
        &Errors { mechanism: i.fitted.model.mechanism, channels: &i.channels, stages, noise_floor, held_out },
    );
    warnings(&mut page, &origin.warnings, &[]);
    let models = [
        Stage { role: Role::Nominal, name: "delivered", model },
        Stage { role: Role::Identified, name: "identified", model: &i.fitted.model },
    ];
    residuals(&mut page, &models, data, noise_floor)?;
    page.anchored("parameters", "Parameters");
    parameter_table(
        &mut page,
        model,
        data,
        &[(Role::Identified, "identified", &i.fitted.parameters)],
        &i.fitted.covariance,
    );
    end(&mut page, origin);
    Ok(page)
}

/// Page of a diagnosis of `model`.
///
/// # Errors
/// If a model cannot follow the recording.
pub fn of_diagnosis(d: &Diagnosis, model: &Model, data: &Data, origin: &Origin) -> Result<Report, FitError> {
    let mut page = begin(&format!("{}: what is missing", model.name), data, origin);
    headline(&mut page, d);
    let mut stages: Vec<(Role, &str, &[f64])> = vec![(Role::Identified, "refitted", &d.rms_before)];
    let mut models = vec![Stage { role: Role::Nominal, name: "as given", model }];
    if !d.effects.is_empty() || d.unexplained.is_some() {
        stages.push((Role::Added, "effect added", &d.rms_after));
        models.push(Stage { role: Role::Added, name: "effect added", model: &d.model });
    }
    let held_out = d.budget.held_out;
    errors::add(
        &mut page,
        &Errors { mechanism: d.model.mechanism, channels: &d.channels, stages, noise_floor: &d.noise_floor, held_out },
    );
    warnings(&mut page, &origin.warnings, &[]);
    diagnosed_residuals(&mut page, &models, data, d)?;
    diagnosed(&mut page, d);
    page.anchored("parameters", "Parameters");
    let estimates: [(Role, &str, &[Estimate]); 2] =
        [(Role::Identified, "refitted", &d.parameters[0]), (Role::Added, "effect added", &d.parameters[1])];
    parameter_table(&mut page, model, data, &estimates[..if d.effects.is_empty() { 1 } else { 2 }], &d.covariance);
    budget(&mut page, d);
    next(&mut page, d);
    end(&mut page, origin);
    Ok(page)
}

/// Page of an effect added to `model`.
///
/// # Errors
/// If a model cannot follow the recording.
pub fn of_addition(a: &Addition, model: &Model, data: &Data, origin: &Origin) -> Result<Report, FitError> {
    let mut page = begin(&format!("{} with {}", model.name, a.effect), data, origin);
    let b = &a.budget;
    let stages: Vec<(Role, &str, &[f64])> =
        vec![(Role::Identified, "refitted", &b.rms_before), (Role::Added, "effect added", b.rms_after())];
    errors::add(
        &mut page,
        &Errors {
            mechanism: b.mechanism,
            channels: &b.channels,
            stages,
            noise_floor: &b.noise_floor,
            held_out: b.held_out,
        },
    );
    warnings(&mut page, &origin.warnings, &[]);
    let models = [
        Stage { role: Role::Nominal, name: "as given", model },
        Stage { role: Role::Added, name: "effect added", model: &a.fit.model },
    ];
    residuals(&mut page, &models, data, &b.noise_floor)?;
    page.anchored("parameters", "Parameters");
    let estimates = [
        (Role::Identified, "refitted", &a.parameters_before[..]),
        (Role::Added, "effect added", &a.fit.parameters[..]),
    ];
    parameter_table(&mut page, model, data, &estimates, &a.fit.covariance);
    addition_budget(&mut page, a);
    end(&mut page, origin);
    Ok(page)
}

const BUDGET: &str = "What the noise leaves, what each added effect explains, and what nothing explains yet, as shares of the mean square.";

fn names(all: &[Dataset]) -> String {
    all.iter().map(|t| t.name.clone()).collect::<Vec<_>>().join(", ")
}

/// A page of results that were fitted to the data.
fn begin(title: &str, data: &Data, origin: &Origin) -> Report {
    let mut subtitle = format!("fitted to {}", names(&data.datasets));
    if !data.held_out.is_empty() {
        subtitle += &format!("; judged by {}, which the fit has not seen", names(&data.held_out));
    }
    dated(title, subtitle, origin)
}

/// The recordings of a comparison, which fits nothing.
fn compared_with(data: &Data) -> String {
    let mut text = format!("recorded in {}", names(&data.datasets));
    if !data.held_out.is_empty() {
        text += &format!("; held out: {}", names(&data.held_out));
    }
    text
}

fn dated(title: &str, mut subtitle: String, origin: &Origin) -> Report {
    if !origin.date.is_empty() {
        subtitle += &format!(" · {}", origin.date);
    }
    Report::new(title, subtitle)
}

/// Adds the verdict in a sentence, with how far the error fell.
pub fn headline(page: &mut Report, d: &Diagnosis) {
    let kind = match d.verdict {
        Verdict::None | Verdict::Effect | Verdict::Several if !d.left.beside => Callout::Good,
        Verdict::Unknown => Callout::Bad,
        _ => Callout::Warning,
    };
    page.callout(kind, &crate::sentence::verdict(d));
    let worst =
        |rms: &[f64]| rms.iter().zip(&d.noise_floor).map(|(r, n)| r / n).filter(|r| r.is_finite()).fold(0.0, f64::max);
    let (before, after) = (worst(&d.rms_before), worst(&d.rms_after));
    let fell = format!("{} → {} × noise", significant(before, 3), significant(after, 3));
    let explained = format!("{:.1} %", 100.0 * d.explained());
    let tested = d.candidates.iter().filter(|c| c.untestable.is_none()).count().to_string();
    let all = format!("of {} in the library for this machine", d.candidates.len() + d.twin_only.len());
    let mut tiles = Vec::new();
    if !d.effects.is_empty() {
        tiles.push([&fell[..], "worst channel, without → with the effect", "1 is pure noise"]);
        tiles.push([&explained, "of the error above the noise is explained", ""]);
    } else {
        tiles.push([fell.split(" →").next().unwrap_or_default(), "times the noise, worst channel", "1 is pure noise"]);
    }
    tiles.push([&tested, "effects tested", &all]);
    page.tiles(&tiles);
}

fn warnings(page: &mut Report, warnings: &[String], gate: &[Finding]) {
    let said = |w: &&String| !gate.iter().any(|f| w.contains(&f.sentence));
    let mut lines: Vec<String> = warnings.iter().filter(said).cloned().collect();
    lines.extend(gate.iter().map(|f| format!("{}: {}; remedy: {}", f.recording, crate::gate::line(f), f.remedy)));
    if !lines.is_empty() {
        page.callout(Callout::Warning, &lines.join("\n"));
    }
}

/// Adds the curves of the last recording, a held-out one if there is any.
///
/// # Errors
/// If a model cannot follow the recording.
pub fn residuals(page: &mut Report, stages: &[Stage], data: &Data, noise: &[f64]) -> Result<(), FitError> {
    let Some(dataset) = shown(data) else { return Ok(()) };
    page.anchored("residuals", &format!("What is left of {}", dataset.name));
    signals::add(page, &Signals::of(stages, dataset, noise)?);
    Ok(())
}

/// Adds curves as [`residuals`], with what the best candidates of a diagnosis explain of them in any range of time.
///
/// # Errors
/// If a model cannot follow the recording.
pub fn diagnosed_residuals(page: &mut Report, stages: &[Stage], data: &Data, d: &Diagnosis) -> Result<(), FitError> {
    let Some(dataset) = shown(data) else { return Ok(()) };
    let own = std::slice::from_ref(dataset);
    let of = |mut residuals: Residuals| residuals.series.pop().unwrap_or_default();
    let (before, alone) = d.alone.residuals(&data.datasets, own)?;
    let mut with = Vec::new();
    if !d.effects.is_empty() {
        let name = d.effects.iter().map(|e| e.name.as_str()).collect::<Vec<_>>().join(" + ");
        with.push(Added { name, refitted: true, left: of(Residuals::new(&d.model, own)?) });
    }
    with.extend(alone.into_iter().map(|(name, left)| Added { name: name.into(), refitted: false, left: of(left) }));
    let by = Alternatives { before: of(before), with };
    page.anchored("residuals", &format!("What is left of {}", dataset.name));
    signals::add(page, &Signals::of(stages, dataset, &d.noise_floor)?.explained(&by, dataset, &d.noise_floor));
    Ok(())
}

/// The recording whose curves a page shows.
fn shown(data: &Data) -> Option<&Dataset> {
    data.held_out.last().or(data.datasets.last())
}

/// Adds a comparison's sentences about where a model fails.
pub fn findings(page: &mut Report, c: &Comparison, heading: &str) {
    page.anchored("where", heading);
    if c.findings.is_empty() {
        page.paragraph("Nothing stands out.");
        return;
    }
    let sentences: Vec<String> = c.findings.iter().map(|f| f.sentence.clone()).collect();
    page.list(&sentences);
}

/// Adds the candidates, and what acts where none of them explains it.
pub fn diagnosed(page: &mut Report, d: &Diagnosis) {
    page.anchored("candidates", "Which effect is missing");
    candidates::add(page, d);
    if let Some(u) = &d.unexplained {
        page.anchored("unexplained", "What no known effect explains");
        let title = format!("What acts on {}", u.location);
        let caption = "The law found by sparse regression: an empirical fit, no physical finding.";
        page.figure(&drawing::shape::shape(&u.shape, &title, u.unit), caption);
        page.commands(&u.toml());
    }
}

/// Adds the parameters of `stages` with error bars beside the values of `model`, and how their estimates are correlated:
/// `covariance` is that of the last stage's estimates.
pub fn parameter_table(
    page: &mut Report,
    model: &Model,
    data: &Data,
    stages: &[(Role, &str, &[Estimate])],
    covariance: &DMatrix<f64>,
) {
    let Some(dataset) = data.datasets.first() else { return };
    let prior = &dataset.plant(model).parameters();
    parameters::add(page, &Parameters { prior, stages, covariance });
}

/// Adds the error budget of the found effects.
pub fn budget(page: &mut Report, d: &Diagnosis) {
    if !d.budget.effects.is_empty() {
        page.anchored("budget", "Error budget");
        page.figure(&drawing::budget::figure(&d.budget), BUDGET);
    }
}

/// Adds the error budget of an addition.
pub fn addition_budget(page: &mut Report, a: &Addition) {
    page.anchored("budget", "Error budget");
    page.figure(&drawing::budget::figure(&a.budget), BUDGET);
}

/// Adds the experiment that decides open alternatives.
pub fn next(page: &mut Report, d: &Diagnosis) {
    let Some(next) = &d.next_experiment else { return };
    page.anchored("next", "What to measure next");
    page.callout(Callout::Note, &format!("Next experiment: {}.", next.what.trim_end_matches('.')));
}

/// Adds where the results of a page come from.
pub fn end(page: &mut Report, origin: &Origin) {
    let inputs: Vec<[String; 4]> = origin
        .inputs
        .iter()
        .map(|i| [i.role.into(), i.file.display().to_string(), i.sha256.clone(), i.bytes.to_string()])
        .collect();
    let command = origin.command.iter().map(|w| quoted(w)).collect::<Vec<_>>().join(" ");
    origin::add(page, &command, &format!("deltatwin {}, {}", origin.version, origin.date), &inputs);
}

/// A word quoted for a shell if necessary.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "/._-+=:,@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) { word.into() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

//! The stages of the loop on a session: check, fit, where, why, add.

use std::path::Path;
use std::sync::Arc;

use deltatwin::comparison::compare;
use deltatwin::diagnosis::{self, Options, Progress, diagnose_with};
use deltatwin::gate::{Remedy as GateRemedy, combined};
use deltatwin::identification::fit::Fit;
use deltatwin::identification::{Dataset, NoiseLevel, Residuals};
use deltatwin::machine::Configuration;
use deltatwin::model::{Model, Provenance};
use deltatwin::text::significant;
use deltatwin_analysis::gate::{Examined, line as finding_line};
use deltatwin_analysis::law::{self, TermError};
use deltatwin_analysis::progress::Course;
use deltatwin_analysis::{add as added, compare as compared, diagnose as diagnosed, gate, page, run};
use deltatwin_io::file::replace_text;
use deltatwin_io::model;
use deltatwin_io::scenario::write_experiment;
use deltatwin_report::component::checks;
use deltatwin_report::drawing::residual::Stage as Drawn;
use deltatwin_report::{Report, Role};
use miette::IntoDiagnostic;
use serde_json::{Value, json};

use crate::job::Job;
use crate::session::{Basis, Errors, Remedy, Session, StageResult, Version, private};
use crate::studio::{Task, line};

/// What a stage has found.
#[derive(Default)]
pub(crate) struct Outcome {
    stages: Vec<(&'static str, StageResult, Value, Report)>,
    /// A fit, whose model is a new version.
    pub fit: Option<(Arc<Fit>, Provenance, Version)>,
    /// Errors of versions.
    errors: Vec<(usize, Errors)>,
}

impl Outcome {
    /// Writes the results, which depend on `basis`, and the new model into the folder.
    ///
    /// # Errors
    /// If a file cannot be written.
    pub fn write(&self, folder: &Path, basis: &Basis) -> miette::Result<()> {
        let stages = folder.join("stages");
        private(&stages).into_diagnostic()?;
        if let Some((fit, provenance, version)) = &self.fit {
            model::write_fitted(&fit.model, &folder.join(&version.file), provenance)?;
        }
        for (name, _, json, report) in &self.stages {
            let name = basis.key(name);
            replace_text(&stages.join(format!("{name}.json")), &format!("{json:#}\n")).into_diagnostic()?;
            replace_text(&stages.join(format!("{name}.html")), report.fragment()).into_diagnostic()?;
        }
        Ok(())
    }

    /// Puts the results and the new version into the session.
    pub fn apply(&self, session: &mut Session) {
        for (k, errors) in &self.errors {
            if let Some(version) = session.versions.get_mut(*k) {
                version.errors = Some(errors.clone());
            }
        }
        if let Some((_, _, version)) = &self.fit {
            session.versions.push(version.clone());
            session.current = Some(session.versions.len() - 1);
        }
        for (name, result, _, _) in &self.stages {
            session.stages.insert((*name).into(), result.clone());
        }
    }
}

impl Task {
    /// A command on the model in use and the session's recordings, in the folder of the session.
    fn command(&self, name: &str, first: &[&str], more: &[&str]) -> String {
        let file = &self.session.versions[self.version].file;
        let mut words: Vec<String> = ["deltatwin", name, file].iter().chain(first).map(|w| w.to_string()).collect();
        words.extend(self.session.inputs(Path::new("")).map(|i| i.words()).unwrap_or_default());
        words.extend(more.iter().map(|w| w.to_string()));
        line(&words)
    }

    /// Number of samples of all recordings.
    pub fn samples(&self) -> usize {
        self.data.datasets.iter().chain(&self.data.held_out).map(Dataset::len).sum()
    }

    fn held_out(&self) -> bool {
        !self.data.held_out.is_empty()
    }

    fn judged(&self) -> &[Dataset] {
        if self.held_out() { &self.data.held_out } else { &self.data.datasets }
    }

    fn errors(&self, rms: Vec<f64>, noise_floor: Vec<f64>) -> Errors {
        let channels = self.data.channels();
        let machine = self.data.mechanism();
        Errors {
            channels: channels.iter().map(|c| c.title(machine)).collect(),
            units: channels.iter().map(|c| c.unit(machine).to_string()).collect(),
            rms,
            noise_floor,
            held_out: self.held_out(),
        }
    }

    /// Errors of a model on the recordings that judge.
    fn errors_of(&self, model: &Model) -> miette::Result<Errors> {
        let rms = Residuals::new(model, self.judged()).into_diagnostic()?.rms;
        Ok(self.errors(rms, NoiseLevel::measured(model, self.judged()).into_diagnostic()?.pooled))
    }

    /// A new version in use after this stage.
    fn next(&self, what: String, slug: &str, command: &dyn Fn(&str) -> String, errors: Errors) -> Version {
        // A session that began anew with another model leaves the files of the earlier one.
        let numbered = |k: usize| format!("models/v{k}-{slug}.toml");
        let free = |file: &String| !self.folder.join(file).exists();
        let file = (self.session.versions.len()..).map(numbered).find(free).unwrap_or_else(|| numbered(0));
        let command = command(&file);
        Version { parent: Some(self.version), command, errors: Some(errors), ..Version::delivered(&file, &what) }
    }

    fn provenance(&self, stage: &str, parameters: &[deltatwin::identification::Estimate]) -> Provenance {
        let files = self.session.recordings.iter().filter(|r| !r.held_out).map(|r| r.file.clone()).collect();
        let today = jiff::Timestamp::now().strftime("%Y-%m-%d").to_string();
        Provenance::new(stage, today, files, parameters.iter().map(|p| (p.name.clone(), p.std)))
    }

    fn result(&self, good: bool, message: String, command: String) -> StageResult {
        StageResult {
            good,
            message,
            command,
            version: self.version,
            remedies: Vec::new(),
            named: Vec::new(),
            files: Vec::new(),
            next: None,
        }
    }
}

/// Whether the recordings belong to the model, with remedies; and the errors of the versions.
pub(crate) fn check(task: &Task, job: &Job) -> miette::Result<Outcome> {
    job.at((0.0, 0.7), "signs, factors, order, zeros");
    let examined = Examined::of(&task.model, &task.data);
    let good = examined.refused.is_empty() || task.session.how.no_gate;
    let mut remedies: Vec<Remedy> = Vec::new();
    let mut report = Report::new("", "");
    let files =
        |held_out: bool| task.session.recordings.iter().filter(move |r| r.held_out == held_out).map(|r| &r.file);
    let datasets = task.data.datasets.iter().chain(&task.data.held_out);
    for (dataset, file) in datasets.zip(files(false).chain(files(true))) {
        let own: Vec<_> = examined.findings.iter().filter(|f| f.recording == dataset.name).cloned().collect();
        let all = combined(&own);
        report.heading(&dataset.name);
        checks::add(&mut report, &gate::CHECKS, &gate::checks(&task.model, dataset, &own));
        for finding in &own {
            let sentence = format!("{}: {}", finding.recording, finding_line(finding));
            let (kind, text) = match &finding.remedy {
                // One assignment for everything that is wrong with the recording.
                GateRemedy::Map(own) => ("map", all.as_ref().map_or_else(|| own.join(", "), map_text)),
                GateRemedy::PayloadMass(mass) => ("payload_mass", significant(*mass, 4)),
                GateRemedy::Payload(_) | GateRemedy::Words(_) => ("words", finding.remedy.to_string()),
            };
            let (severe, recording) = (finding.severe, file.clone());
            remedies.push(Remedy { sentence, severe, kind: kind.into(), text, recording });
        }
    }
    let mut errors = Vec::new();
    if good {
        job.at((0.7, 1.0), "errors of the model");
        for k in task.session.chain() {
            let version = model::read(&task.folder.join(&task.session.versions[k].file))?;
            errors.push((k, task.errors_of(&version)?));
        }
    }
    let message = match (good, remedies.len()) {
        (true, 0) => {
            "The recordings belong to the model: signs, factors, order, zeros, lag and payload are in order.".into()
        }
        (true, 1) => "The recordings can be fitted, with one remark.".into(),
        (true, n) => format!("The recordings can be fitted, with {n} remarks: look at them first."),
        (false, _) => "The recordings do not belong to the model: nothing should be fitted.".to_string(),
    };
    let files: Vec<String> = task.session.recordings.iter().map(|r| r.file.clone()).collect();
    let model_file = &task.session.versions[task.version].file;
    let mut words = [vec!["deltatwin".to_string(), "check".into()], files].concat();
    words.extend(["--model".to_string(), model_file.clone()]);
    task.session.how.maps.iter().for_each(|map| words.extend(["--map".to_string(), map.clone()]));
    if !task.data.warnings.is_empty() {
        report.heading("Remarks of the reader");
        let short = |w: &String| w.replace(&format!("{}/", task.folder.display()), "");
        report.list(&task.data.warnings.iter().map(short).collect::<Vec<_>>());
    }
    let json = json!({"good": good, "gate": gate::json(&examined.findings), "warnings": task.data.warnings});
    let result = StageResult { remedies, ..task.result(good, message, line(&words)) };
    Ok(Outcome { stages: vec![("check", result, json, report)], fit: None, errors })
}

/// Text of a remedy by mapping.
fn map_text(remedy: &GateRemedy) -> String {
    match remedy {
        GateRemedy::Map(assignments) => assignments.join(", "),
        other => other.to_string(),
    }
}

/// A fit of the model in use, as a new version.
pub(crate) fn fit(task: &Task, job: &Job) -> miette::Result<Outcome> {
    job.at((0.0, 1.0), "least squares");
    let found = run::identify_until(&task.model, &task.data, Some(&|| job.is_cancelled())).into_diagnostic()?;
    let (rms, floor) = found.judged();
    let errors = task.errors(rms.to_vec(), floor.to_vec());
    let command = |file: &str| task.command("identify", &[], &["-o", file]);
    let version = task.next("identified".into(), "identified", &command, errors);
    let mut report = Report::new("", "");
    let estimates = [(Role::Identified, "identified", &found.fitted.parameters[..])];
    page::parameter_table(&mut report, &task.model, &task.data, &estimates, &found.fitted.covariance);
    let count = found.fitted.parameters.iter().filter(|p| p.identified()).count();
    let message = format!(
        "{count} parameters identified; {} base parameters, condition number {}.",
        found.fitted.structure.rank,
        significant(found.fitted.structure.condition(), 3)
    );
    let mut result = task.result(true, message, version.command.clone());
    let mut json = found.json(Some(Path::new(&version.file)));
    // The fit does not depend on what is held out; these errors are the version's.
    json["held_out_rms"] = Value::Null;
    json["held_out_noise_floor"] = Value::Null;
    result.version = task.session.versions.len();
    let provenance = task.provenance("identify", &found.fitted.parameters);
    Ok(Outcome {
        stages: vec![("fit", result, json, report)],
        fit: Some((Arc::new(found.fitted), provenance, version)),
        errors: Vec::new(),
    })
}

/// Where the model in use fails: its residuals next to those of the first version and the one before it.
pub(crate) fn locate(task: &Task, job: &Job) -> miette::Result<Outcome> {
    job.at((0.0, 0.5), "residuals");
    let comparison = compare(&task.model, &task.data.datasets, &task.data.held_out).into_diagnostic()?;
    let mut earlier = task.session.chain();
    earlier.retain(|k| *k != task.version);
    // The delivered model and the latest before this one.
    if earlier.len() > 2 {
        earlier.drain(1..earlier.len() - 1);
    }
    let mut models = Vec::new();
    for k in earlier {
        let known = &task.session.versions[k];
        models.push((known, model::read(&task.folder.join(&known.file))?));
    }
    let own = &task.session.versions[task.version];
    let role = |version: &Version| if version.role() == own.role() { Role::Earlier } else { version.role() };
    let drawn = |(version, model)| Drawn { role: role(version), name: &version.what, model };
    let mut stages: Vec<Drawn> = models.iter().map(|(version, model)| drawn((*version, model))).collect();
    stages.push(Drawn { role: own.role(), name: &own.what, model: &task.model });
    job.at((0.5, 1.0), "curves");
    let mut report = Report::new("", "");
    page::findings(&mut report, &comparison, "Where the model fails");
    page::residuals(&mut report, &stages, &task.data, &comparison.noise_floor).into_diagnostic()?;
    let message = match comparison.worst() {
        Some((channel, ratio)) => {
            format!("{}: {} times the noise.", channel.title(comparison.mechanism), significant(ratio, 3))
        }
        None => "The noise is not known.".into(),
    };
    let command = task.command("compare", &[], &["--report", "where.html"]);
    let result = task.result(true, message, command);
    let errors = vec![(task.version, task.errors_of(&task.model)?)];
    let located = ("where", result, compared::json(&comparison, &[]), report);
    Ok(Outcome { stages: vec![located], fit: None, errors })
}

/// Most computing time per sample of a diagnosis on a busy machine, and its lower bound, s.
const LIMIT: (f64, f64) = (1.2e-3, 120.0);

/// Expected time of a stage per sample of all recordings, s: on two cores, with 100 000 samples.
pub(crate) fn seconds_per_sample(stage: &str) -> f64 {
    match stage {
        "check" => 5e-6,
        "fit" => 1e-5,
        "where" => 1.5e-5,
        "why" => 2.3e-4,
        _ => 6e-5,
    }
}

/// Which effect is missing, and the next experiment.
pub(crate) fn diagnose(task: &Task, job: &Job) -> miette::Result<Outcome> {
    let limit = (LIMIT.0 * task.samples() as f64).max(LIMIT.1);
    let clock = || if job.is_cancelled() { f64::INFINITY } else { job.seconds() / limit };
    let options = Options { clock: &clock, fitted: task.fit.as_deref(), ..Options::default() };
    let mut course = Course::default();
    let d = diagnose_with(&task.model, &task.data.datasets, &task.data.held_out, &options, &mut |report| {
        course.follow(&report);
        job.at(course.span(), course.text());
        if let Progress::Ranked(promises) = report {
            job.rank(promises);
        }
    })
    .into_diagnostic()?;
    let mut files = Vec::new();
    let next_file = format!("{}.toml", task.session.basis.key("next"));
    let mut report = Report::new("", "");
    page::headline(&mut report, &d);
    page::diagnosed(&mut report, &d);
    page::budget(&mut report, &d);
    page::next(&mut report, &d);
    if let Some(next) = d.next_experiment.as_ref().filter(|n| {
        let apart = n.experiment.dataset.setup.configuration != Configuration::Assembled && task.model.assembled;
        n.experiment.course.is_some() && !apart
    }) {
        let comments = [format!("Proposed by `deltatwin diagnose`, {}.", next.what)];
        let machine = task.folder.join(&task.session.versions[task.version].file);
        write_experiment(&next.experiment, &comments, 1, (&task.model, &machine), &task.folder.join(&next_file))?;
        files.push(next_file.clone());
    }
    let more: &[&str] = if files.is_empty() { &[] } else { &["--next", &next_file] };
    let mut result = task.result(true, deltatwin_analysis::sentence::verdict(&d), task.command("diagnose", &[], more));
    result.named = d.effects.iter().map(|e| e.name.clone()).collect();
    result.files = files;
    result.next = d.next_experiment.as_ref().map(|n| format!("{}.", n.what.trim_end_matches('.')));
    let scenario = result.files.first().map(Path::new);
    let json = diagnosed::json(&d, None, scenario);
    Ok(Outcome { stages: vec![("why", result, json, report)], fit: None, errors: Vec::new() })
}

/// The effect added to the model in use, as a new version; a formula has the terms `laws`.
pub(crate) fn add(task: &Task, job: &Job, effect: &str, laws: &[String]) -> miette::Result<Outcome> {
    job.at((0.0, 1.0), effect);
    let typed = match laws {
        [] => Vec::new(),
        terms => vec![law::formula(task.model.mechanism, terms).into_diagnostic()?],
    };
    let clock = || if job.is_cancelled() { f64::INFINITY } else { 0.0 };
    let options = Options { clock: &clock, candidates: &typed, fitted: task.fit.as_deref(), ..Options::default() };
    let a = diagnosis::add_with(&task.model, effect, &task.data.datasets, &task.data.held_out, &options);
    let a = a.map_err(|error| match TermError::of(&error, laws) {
        Some(fault) => miette::Report::new(fault),
        None => miette::Report::from_err(error),
    })?;
    let errors = task.errors(a.budget.rms_after().to_vec(), a.budget.noise_floor.clone());
    let terms: Vec<&str> = laws.iter().flat_map(|term| ["--law", term]).collect();
    let command = |file: &str| task.command("add", &[effect], &[&terms[..], &["-o", file]].concat());
    let version = task.next(format!("+ {effect}"), effect, &command, errors);
    let mut report = Report::new("", "");
    let estimates = [
        (Role::Identified, "refitted", &a.parameters_before[..]),
        (Role::Added, "effect added", &a.fit.parameters[..]),
    ];
    page::addition_budget(&mut report, &a);
    page::parameter_table(&mut report, &task.model, &task.data, &estimates, &a.fit.covariance);
    let worst = |rms: &[f64]| {
        let ratios = rms.iter().zip(&a.budget.noise_floor).map(|(r, n)| r / n).filter(|r| r.is_finite());
        significant(ratios.fold(0.0, f64::max), 3)
    };
    let (before, after) = (worst(&a.budget.rms_before), worst(a.budget.rms_after()));
    let message = match before == after {
        true => format!("With {effect} the worst channel stays at {after} times the noise."),
        false => format!("With {effect} the worst channel goes from {before} to {after} times the noise."),
    };
    let mut result = task.result(true, message, version.command.clone());
    result.version = task.session.versions.len();
    let json = added::json(&a, Some(Path::new(&version.file)));
    let provenance = task.provenance("add", &a.fit.parameters);
    Ok(Outcome {
        stages: vec![("add", result, json, report)],
        fit: Some((Arc::new(a.fit), provenance, version)),
        errors: Vec::new(),
    })
}

//! Figures and report of a demo.

use super::{Findings, describe};
use crate::exam::Campaign;
use deltatwin::diagnosis::Diagnosis;
use deltatwin::diagnosis::candidates::Standing;
use deltatwin::dynamics::Plant;
use deltatwin::identification::{Residuals, predict};
use deltatwin::machine::AXES;
use deltatwin_report::drawing::residual::amplitude_spectrum;
use deltatwin_report::{
    Callout, Color, Curve, ErrorGroup, Panel, RankRow, Report, Style, falling_error, panels, ranking, scatter_binned,
    spectrum,
};

/// HTML report of a demo; its figures use the held-out motion.
pub fn report(campaign: &Campaign, findings: &Findings) -> Report {
    let d = &findings.diagnosis;
    let mut report = Report::new(
        "deltatwin demo",
        "A hidden effect in a robot: compare, identify, diagnose, add, and watch the error fall",
    );
    let hidden = describe(campaign);
    let names: Vec<&str> = d.effects.iter().map(|e| e.name.as_str()).collect();
    let verdict = format!(
        "Verdict: {} {}. Hidden was {hidden}.",
        d.verdict,
        if names.is_empty() { String::new() } else { format!("({})", names.join(", ")) }
    );
    report.callout(if findings.right { Callout::Good } else { Callout::Bad }, &verdict);
    falling(&mut report, findings);
    report.heading("Where the model fails");
    for finding in findings.comparison.findings.iter().take(6) {
        report.paragraph(&finding.sentence);
    }
    if let Some((torques, phase, spectra)) = residual_figures(campaign, findings) {
        report.figure(&torques, "Held-out motion: measured torque, identified model and what it leaves.");
        report.figure(&phase, "Residual of the arms before and after, against joint speed.");
        report.figure(&spectra, "Spectrum of the residuals of axis 1.");
    }
    candidates(&mut report, d, &names);
    budget(&mut report, d);
    if let Some(next) = &d.next_experiment {
        report.callout(Callout::Note, &format!("Next experiment, {}.", next.what));
    }
    report
}

/// Adds the RMS errors of the delivered, the identified and the extended model.
fn falling(report: &mut Report, findings: &Findings) {
    let d = &findings.diagnosis;
    report.heading("The error falls");
    let stages = stage_rms(findings);
    let groups: Vec<ErrorGroup> = (0..AXES)
        .map(|i| ErrorGroup {
            name: format!("axis {}", i + 1),
            values: stages.iter().map(|s| s[i]).collect(),
            floor: Some(d.noise_floor[i]),
        })
        .collect();
    report.figure(
        &falling_error(
            "RMS torque error on the held-out motion",
            "RMS / N·m",
            &["as delivered", "identified", "effect added"],
            &groups,
        ),
        "Each axis against the noise of its torque sensor (dashed).",
    );
    let rows: Vec<Vec<String>> = d
        .channels
        .iter()
        .enumerate()
        .map(|(c, channel)| {
            let mut row = vec![format!("{channel} / {}", channel.unit())];
            row.extend(stages.iter().map(|s| format!("{:.4}", s[c])));
            row.push(format!("{:.4}", d.noise_floor[c]));
            row
        })
        .collect();
    report.table(&["RMS, held out", "as delivered", "identified", "effect added", "noise floor"], &rows);
}

/// Adds the ranking of the candidates and the parameters of the named effects.
fn candidates(report: &mut Report, d: &Diagnosis, names: &[&str]) {
    report.heading("Which effect is missing");
    let rows: Vec<RankRow> = d
        .candidates
        .iter()
        .map(|c| RankRow {
            name: c.name.clone(),
            // Untestable candidates have no meaningful share.
            share: if c.standing == Standing::Untestable { f64::NAN } else { c.explained },
            note: c.standing.to_string(),
            highlight: names.contains(&c.name.as_str()),
        })
        .collect();
    report.figure(
        &ranking("Candidates", "share of the error above the noise that it could explain alone / %", &rows),
        "Every absent effect, tried on the measurement as if nothing else were missing, and where it ended up.",
    );
    for e in &d.effects {
        let rows: Vec<Vec<String>> = e
            .parameters
            .iter()
            .map(|p| {
                vec![
                    format!("{}.{}", e.name, p.name),
                    format!("{:.5}", p.value),
                    format!("{:.5}", p.std),
                    p.unit.to_string(),
                ]
            })
            .collect();
        report.table(&["parameter", "estimate", "standard error", "unit"], &rows);
    }
}

/// Adds the error budget and the changed parameters.
fn budget(report: &mut Report, d: &Diagnosis) {
    if !d.budget.effects.is_empty() {
        report.heading("Error budget");
        report.figure(
            &deltatwin_report::drawing::budget::figure(&d.budget),
            "What the noise leaves, what each added effect explains, and what nothing explains yet; held-out motion.",
        );
        let number = |x: f64| deltatwin::text::significant(x, 4);
        let row = |c: &deltatwin::diagnosis::budget::Change| {
            let numbers = [c.before.value, c.before.std, c.after.value, c.after.std].map(number);
            std::iter::once(c.before.name.clone()).chain(numbers).chain([c.before.unit.to_string()]).collect::<Vec<_>>()
        };
        let rows: Vec<Vec<String>> = d.changes.iter().map(row).collect();
        if !rows.is_empty() {
            report.paragraph("Parameters that the addition moved by more than three standard errors, or by a tenth:");
            report.table(&["parameter", "before", "std", "after", "std", "unit"], &rows);
        }
    }
}

/// RMS residuals on the held-out motion of the delivered, the identified and the extended model, N·m or N per
/// channel.
pub fn stage_rms(findings: &Findings) -> [Vec<f64>; 3] {
    let d = &findings.diagnosis;
    let delivered = findings.comparison.held_out_rms.clone().unwrap_or_else(|| findings.comparison.rms.clone());
    [delivered, d.rms_before.clone(), d.rms_after.clone()]
}

fn residual_figures(
    campaign: &Campaign,
    findings: &Findings,
) -> Option<(deltatwin_report::Figure, deltatwin_report::Figure, deltatwin_report::Figure)> {
    let dataset = &findings.validation;
    let before_model = &findings.identified.model;
    let predicted = predict(&Plant::new(before_model, &campaign.validation.setup), dataset).ok()?;
    let before = Residuals::of(dataset, &predicted).series.remove(0);
    let after = Residuals::new(&findings.diagnosis.model, std::slice::from_ref(dataset)).ok()?.series.remove(0);
    let stack: Vec<Panel> = (0..AXES)
        .map(|i| Panel {
            title: format!("axis {}", i + 1),
            y_label: "torque / N·m".into(),
            curves: vec![
                Curve::new("measured", dataset.t.clone(), dataset.measured[i].clone()).color(Color::MEASURED),
                Curve::new("identified model", dataset.t.clone(), predicted[i].clone()).color(Color::MODEL),
                Curve::new("residual", dataset.t.clone(), before[i].clone()).color(Color::RESIDUAL).style(Style::Thin),
            ],
        })
        .collect();
    let speed: Vec<f64> = (0..3).flat_map(|i| dataset.joints.iter().map(move |j| j.qd[i])).collect();
    let all = |r: &[Vec<f64>]| -> Vec<f64> { r[..3].concat() };
    let phase = scatter_binned(
        "Residual of the arms over joint speed",
        "joint speed / rad/s",
        "residual / N·m",
        &[
            Curve::new("identified", speed.clone(), all(&before)).color(Color::RESIDUAL),
            Curve::new("effect added", speed, all(&after)).color(Color::IMPROVED),
        ],
        40,
    );
    let line = |r: &[f64]| amplitude_spectrum(r, dataset.dt);
    let (f, a) = line(&before[0]);
    let (g, b) = line(&after[0]);
    let spectra = spectrum(
        "Residual of axis 1",
        "frequency / Hz",
        "amplitude / N·m",
        &[
            Curve::new("identified", f, a).color(Color::RESIDUAL),
            Curve::new("effect added", g, b).color(Color::IMPROVED),
        ],
        &[],
    );
    Some((panels("Torques of the held-out motion", "time / s", &stack), phase, spectra))
}

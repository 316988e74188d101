//! A strut with a force sensor: Fig. 13 (section 6.5 of the paper).

use miette::IntoDiagnostic;

use super::assembled::Assembled;
use super::page::{Comparison, Estimate, Plot, Row, Section};
use super::runs::Campaign;
use super::{paper, robot};
use deltatwin::identification::residuals::{self, difference};
use deltatwin::identification::{Dataset, predict};
use deltatwin::model::Model;
use deltatwin::recording::Channel;
use deltatwin_report::{Color, Curve, Style, time_series};

/// Section on Fig. 13.
///
/// # Errors
/// If strut 1 has no sensor, or a pose of the recording is impossible for the model's geometry.
pub fn section(campaign: &Campaign, assembled: &Assembled) -> miette::Result<Section> {
    let dataset = Dataset::new(&campaign.strut_force.recording);
    let place = dataset.channels.iter().position(|c| *c == Channel::StrutUpper(0));
    let Some(place) = place else {
        return Err(miette::miette!(
            "strut-force: strut 1 carries no sensor; expected `strut_upper = [1]` in [sensors]"
        ));
    };
    let measured = &dataset.measured[place];
    let compute = |model: &Model| -> miette::Result<Vec<f64>> {
        Ok(predict(&dataset.plant(model), &dataset).into_diagnostic()?.remove(place))
    };
    let variants = [
        (
            "paper's model, strut 1 heavier",
            robot::with_measurement_strut(&assembled.paper.model),
            Color::BLUE,
            Style::Line,
        ),
        ("paper's model, six struts alike", assembled.paper.model.clone(), Color::VERMILION, Style::Dashed),
        (
            "socket friction, strut 1 heavier",
            robot::with_measurement_strut(&assembled.complete.model),
            Color::GREEN,
            Style::Line,
        ),
    ];
    let mut curves =
        vec![Curve::new("measured", dataset.t.clone(), measured.to_vec()).color(Color::MUTED).style(Style::Thin)];
    let (mut rms, mut mean) = (Vec::new(), Vec::new());
    for (label, model, color, style) in &variants {
        let computed = compute(model)?;
        let residual = difference(measured, &computed);
        mean.push(residual.iter().sum::<f64>() / residual.len().max(1) as f64);
        rms.push(residuals::rms(&residual));
        curves.push(Curve::new(*label, dataset.t.clone(), computed).color(*color).style(*style));
    }
    let row = |what: &str, values: &[f64]| Row {
        quantity: what.into(),
        unit: "N".into(),
        ours: values.iter().map(|v| Some(Estimate::plain(*v))).collect(),
        truth: None,
        paper: None,
    };
    let (low, high) = measured.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    let figure = time_series("Force at the upper end of strut 1", "time / s", "force / N", &curves);
    Ok(Section {
        key: "figure_13",
        title: "Fig. 13: force in the measurement strut".into(),
        text: format!(
            "Strut 1 is replaced by the measurement strut of {:.0} g, {} kg hang at the flange, and the platform goes up \
             and down on the centre line. Measured: the twin's force sensor with noise of {} N. Computed: from the model \
             that Tables 3 and 4 identified, along the measured motion.",
            1e3 * paper::MEASUREMENT_STRUT,
            paper::WEIGHT_PLATE,
            campaign.robot.noise.strut_force
        ),
        tables: vec![Comparison {
            titles: variants.iter().map(|v| v.0.to_string()).collect(),
            rows: vec![row("RMS of measured − computed", &rms), row("mean of measured − computed", &mean)],
        }],
        plots: vec![Plot {
            name: "figure-13",
            figure,
            caption: "Measured and computed axial force at the elbow end of strut 1; tension positive.".into(),
        }],
        agreement: format!(
            "The paper shows measurement and computation without a number and says they fit well. Here the force ranges \
             from {low:.0} to {high:.0} N and the paper's model is off by {:.2} N RMS, of which {} N is sensor noise. On the \
             centre line the socket friction of the three limbs keeps the platform in balance by symmetry, so this motion, \
             the only one that the paper's measurement strut allowed, does not show the forces that Fig. 11 here shows. \
             Speed and acceleration of the paper's motion are not given, so the curves themselves cannot be compared.",
            rms[0], campaign.robot.noise.strut_force
        ),
    })
}

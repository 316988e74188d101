//! A strut with a force sensor: Fig. 13 (paper section 6.5).

use miette::IntoDiagnostic;

use super::assembled::Assembled;
use super::page::{Comparison, Estimate, Plot, Row, Section};
use super::paper;
use super::runs::Campaign;
use crate::dynamics::{Channel, Plant};
use crate::identification::fit::channel_rms;
use crate::identification::{Trace, predict};
use crate::model::Model;
use crate::report::{Color, Curve, Style, time_series};

/// Fig. 13.
pub fn section(campaign: &Campaign, assembled: &Assembled) -> miette::Result<Section> {
    let trace = Trace::new(&campaign.strut_force.recording);
    let place = trace.channels.iter().position(|c| *c == Channel::StrutUpper(0));
    let Some(place) = place else {
        return Err(miette::miette!(
            "strut-force: strut 1 carries no sensor; expected `strut_upper = [1]` in [sensors]"
        ));
    };
    let measured = &trace.measured[place];
    let compute = |model: &Model| -> miette::Result<Vec<f64>> {
        Ok(predict(&Plant::new(model, &trace.setup), &trace).into_diagnostic()?.remove(place))
    };
    let known = compute(&assembled.with_measurement_strut())?;
    let unknown = compute(&assembled.paper.model)?;
    let error = |computed: &[f64]| {
        let residual: Vec<f64> = measured.iter().zip(computed).map(|(m, c)| m - c).collect();
        let mean = residual.iter().sum::<f64>() / residual.len().max(1) as f64;
        (channel_rms(&[vec![residual]])[0], mean)
    };
    let ((rms, mean), (rms_unknown, mean_unknown)) = (error(&known), error(&unknown));
    let row = |what: &str, a: f64, b: f64| Row {
        quantity: what.into(),
        unit: "N",
        ours: vec![Some(Estimate::plain(a)), Some(Estimate::plain(b))],
        truth: None,
        paper: None,
    };
    let (low, high) = measured.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), x| (a.min(*x), b.max(*x)));
    let figure = time_series(
        "Force at the upper end of strut 1",
        "time / s",
        "force / N",
        &[
            Curve::new("measured", trace.t.clone(), measured.clone()).color(Color::MUTED).style(Style::Thin),
            Curve::new("computed with the heavier strut", trace.t.clone(), known).color(Color::MODEL),
            Curve::new("computed with six alike", trace.t.clone(), unknown).color(Color::RESIDUAL).style(Style::Dashed),
        ],
    );
    Ok(Section {
        key: "figure_13",
        title: "Fig. 13: force in the measurement strut".into(),
        text: format!(
            "Strut 1 is replaced by the measurement strut of {:.0} g, {} kg hang at the flange, and the platform goes up \
             and down on the centre line. Measured: the twin's force sensor with noise of {} N. Computed: from the model \
             that Tables 3 and 4 identified, along the measured motion, once with the strut's known mass and once as if all \
             six were alike.",
            1e3 * paper::MEASUREMENT_STRUT,
            paper::WEIGHT_PLATE,
            campaign.robot.noise.strut_force
        ),
        tables: vec![Comparison {
            titles: vec!["with the heavier strut".into(), "six struts alike".into()],
            rows: vec![
                row("RMS of measured − computed", rms, rms_unknown),
                row("mean of measured − computed", mean, mean_unknown),
            ],
        }],
        plots: vec![Plot {
            name: "figure-13",
            figure,
            caption: "Measured and computed axial force at the elbow end of strut 1; tension positive.".into(),
        }],
        agreement: format!(
            "The paper shows measurement and computation without a number and says they fit well. Here the force ranges \
             from {low:.0} to {high:.0} N and the computation is off by {rms:.1} N RMS. Speed and acceleration of the \
             paper's motion are not given, so the curves themselves cannot be compared."
        ),
    })
}

//! Parts of answers: estimates, findings, candidates.

use deltatwin::comparison;
use deltatwin::diagnosis::{self, budget};
use deltatwin::identification;
use deltatwin::machine::Mechanism;
use pyo3::prelude::*;

use crate::table::{Series, Table};

/// A parameter with its standard error.
#[pyclass(frozen, get_all, module = "deltatwin")]
#[derive(Clone)]
pub struct Estimate {
    pub name: String,
    pub value: f64,
    pub std: f64,
    pub unit: String,
}

impl From<&identification::Estimate> for Estimate {
    fn from(e: &identification::Estimate) -> Self {
        Self { name: e.name.clone(), value: e.value, std: e.std, unit: e.unit.to_string() }
    }
}

#[pymethods]
impl Estimate {
    fn __repr__(&self) -> String {
        let Self { name, value, std, unit } = self;
        format!("Estimate({name}: {value:.6} ± {std:.2} {unit})")
    }
}

/// Where a model fails.
#[pyclass(frozen, get_all, module = "deltatwin")]
#[derive(Clone)]
pub struct Finding {
    pub channel: String,
    pub place: String,
    pub share: f64,
    pub sentence: String,
}

impl From<&comparison::Finding> for Finding {
    fn from(f: &comparison::Finding) -> Self {
        Self { channel: f.channel.to_string(), place: f.place.clone(), share: f.share, sentence: f.sentence.clone() }
    }
}

#[pymethods]
impl Finding {
    fn __repr__(&self) -> String {
        format!("Finding({})", self.sentence)
    }
}

/// A named effect.
#[pyclass(frozen, get_all, module = "deltatwin")]
#[derive(Clone)]
pub struct Named {
    pub name: String,
    pub probability: f64,
    pub explained: f64,
    pub parameters: Vec<Estimate>,
}

impl From<&diagnosis::Named> for Named {
    fn from(n: &diagnosis::Named) -> Self {
        Self {
            name: n.name.clone(),
            probability: n.confidence.probability(),
            explained: n.explained,
            parameters: n.parameters.iter().map(Estimate::from).collect(),
        }
    }
}

#[pymethods]
impl Named {
    fn __repr__(&self) -> String {
        format!("Named({}, probability={:.2}, explained={:.3})", self.name, self.probability, self.explained)
    }
}

/// Evidence about a candidate.
#[pyclass(frozen, get_all, module = "deltatwin")]
#[derive(Clone)]
pub struct Candidate {
    pub name: String,
    pub probability: f64,
    pub explained: f64,
    pub p_adjusted: f64,
    pub outcome: String,
    pub reason: Option<String>,
    pub absorbed_by: Vec<String>,
}

impl From<&diagnosis::CandidateReport> for Candidate {
    fn from(c: &diagnosis::CandidateReport) -> Self {
        Self {
            name: c.name.clone(),
            probability: c.probability,
            explained: c.explained,
            p_adjusted: c.p_adjusted,
            outcome: c.standing.to_string(),
            reason: c.untestable.map(|u| u.to_string()),
            absorbed_by: c.absorbed_by.clone(),
        }
    }
}

#[pymethods]
impl Candidate {
    fn __repr__(&self) -> String {
        format!("Candidate({}, probability={:.2}, {})", self.name, self.probability, self.outcome)
    }
}

/// A parameter before and after an addition.
#[pyclass(frozen, get_all, module = "deltatwin")]
#[derive(Clone)]
pub struct Change {
    pub before: Estimate,
    pub after: Estimate,
}

impl From<&budget::Change> for Change {
    fn from(c: &budget::Change) -> Self {
        Self { before: (&c.before).into(), after: (&c.after).into() }
    }
}

#[pymethods]
impl Change {
    fn __repr__(&self) -> String {
        format!("Change({} -> {})", self.before.__repr__(), self.after.__repr__())
    }
}

/// Estimates as a table.
pub fn estimates(title: &str, all: &[Estimate]) -> Table {
    let mut table = Table::new(title);
    table.push("name", "", Series::Text(all.iter().map(|e| Some(e.name.clone())).collect()));
    table.push("value", "", Series::Float(all.iter().map(|e| e.value).collect()));
    table.push("std", "", Series::Float(all.iter().map(|e| e.std).collect()));
    table.push("unit", "", Series::Text(all.iter().map(|e| Some(e.unit.clone())).collect()));
    table
}

/// RMS errors by channel as a table; `series` are named columns.
pub fn errors(
    machine: Mechanism,
    channels: &[deltatwin::recording::Channel],
    series: &[(&str, Option<&[f64]>)],
) -> Table {
    let mut table = Table::new("RMS error");
    table.push("channel", "", Series::Text(channels.iter().map(|c| Some(c.to_string())).collect()));
    table.push("unit", "", Series::Text(channels.iter().map(|c| Some(c.unit(machine).to_string())).collect()));
    for (name, values) in series {
        if let Some(values) = values {
            table.push(name, "", Series::Float(values.to_vec()));
        }
    }
    table
}

/// A figure of a notebook: an element that scales with the page.
pub fn picture(svg: &str) -> String {
    format!("<div style=\"max-width: 60em\">{svg}</div>")
}

/// Laps of one motion, and what of a residual repeats in them.
#[pyclass(frozen, module = "deltatwin")]
#[derive(Clone)]
pub struct Repeats {
    #[pyo3(get)]
    laps: usize,
    #[pyo3(get)]
    recordings: usize,
    #[pyo3(get)]
    period: f64,
    #[pyo3(get)]
    sentences: Vec<String>,
    shares: Vec<identification::repeats::Share>,
}

impl From<&identification::Repeats> for Repeats {
    fn from(r: &identification::Repeats) -> Self {
        let shares = r.channels.clone();
        Self { laps: r.laps, recordings: r.recordings, period: r.period, sentences: r.sentences(), shares }
    }
}

#[pymethods]
impl Repeats {
    #[getter]
    fn channels(&self) -> Table {
        let mut table = Table::new("residual over laps");
        let text = |of: &dyn Fn(&identification::repeats::Share) -> String| {
            Series::Text(self.shares.iter().map(|s| Some(of(s))).collect())
        };
        table.push("channel", "", text(&|s| s.channel.to_string()));
        table.push("unit", "", text(&|s| s.channel.unit(s.mechanism).to_string()));
        let names = ["residual", "repeats", "repeats_std", "noise", "noise_std", "drift"];
        let numbers = |s: &identification::repeats::Share| {
            let p = &s.parts;
            [p.rms, p.repeats.0, p.repeats.1, p.noise.0, p.noise.1, p.drift]
        };
        for (k, name) in names.into_iter().enumerate() {
            table.push(name, "", Series::Float(self.shares.iter().map(|s| numbers(s)[k]).collect()));
        }
        table
    }

    fn __repr__(&self) -> String {
        format!("Repeats(laps={}, recordings={}, period={:.6} s)", self.laps, self.recordings, self.period)
    }
}

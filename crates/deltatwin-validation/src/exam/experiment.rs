//! Virtual excitation experiments: a study whose runs hide effects in a robot and ask the diagnosis for them.
//!
//! The factors set parts of a [`Case`]; everything else is that of [`Case::default`]. Campaigns are made and judged in
//! memory; a row is a function of the study's digest, its seed and its number.

use std::path::Path;

use deltatwin::machine::Mechanism;
use deltatwin::model::Model;
use deltatwin::text::nearest;
use deltatwin_io::study::{Factor, Range, Setting, Study};
use deltatwin_study::campaign::{Campaign, CampaignError, Chunk, Draws, Heading, Kind, Value, Watch};
use deltatwin_study::conduct;
use deltatwin_study::design::Plan;
use deltatwin_study::statistics::Attempt;
use miette::miette;
use serde_json::json;

use super::campaign::{Campaign as Made, CampaignError as Failure, Case, campaign, hideable};
use super::judge::{Answer, Grade, Truth, judge};
use super::motion::MotionKind;
use super::noise::Noise;
use super::score::Judged;
use super::size::Size;

/// A study of experiments with its folder.
pub struct Experiments {
    /// The study.
    pub study: Study,
    /// Its points.
    pub plan: Plan,
    /// Its rows on the disk.
    pub campaign: Campaign,
    model: Model,
    draws: Draws,
}

/// Keys that a factor of an experiment may have.
const KEYS: [&str; 7] = ["effect", "size", "noise", "motion", "duration", "payload", "strut_sensor"];
/// Shortest and longest recording, s.
const DURATION: (f64, f64) = (1.0, 600.0);
/// Least and largest size as a number, relative to medium size.
const SCALE: (f64, f64) = (1e-3, 100.0);
/// Level of `effect` with which nothing is hidden.
const NOTHING: &str = "none";

/// Columns after the factors.
fn own() -> Vec<Heading> {
    vec![
        Heading::new("effect_over_noise", "1", Kind::Float),
        Heading::new("limited", "", Kind::Flag),
        Heading::new("verdict", "", Kind::Text),
        Heading::new("first_named", "", Kind::Text),
        Heading::new("probability", "1", Kind::Float),
        Heading::new("right", "", Kind::Flag),
        Heading::new("grade", "", Kind::Text),
        Heading::new("left_over_noise", "1", Kind::Float),
        Heading::new("error", "", Kind::Text),
    ]
}

impl Experiments {
    /// The study with its rows in `folder`, after a check of all its levels.
    ///
    /// # Errors
    /// If the model is none of an assembled delta robot, or a factor is none of an experiment.
    pub fn new(study: Study, folder: &Path) -> miette::Result<Self> {
        let file = study.experiment.clone().ok_or_else(|| miette!("{}: has no `model`", study.path.display()))?;
        let model = deltatwin_io::model::read(&file)?;
        if !model.assembled || !matches!(model.mechanism, Mechanism::Delta { .. }) {
            return Err(miette!("{}: expected the model of an assembled delta robot", file.display()));
        }
        let mut headings = vec![Heading::new("run", "1", Kind::Integer), Heading::new("seed", "1", Kind::Integer)];
        headings.extend(study.factors.iter().map(conduct::heading));
        headings.extend(own());
        let (campaign, draws) = conduct::campaign(&study, headings, folder);
        let plan = Plan::new(&study, draws.clone());
        if plan.is_search() {
            return Err(miette!(
                "{}: an experiment has no margin to search by; expected a grid or a sample",
                study.path.display()
            ));
        }
        let experiments = Self { study, plan, campaign, model, draws };
        for (k, settings) in experiments.plan.extremes() {
            let set = experiments.set(&mut Case::default(), &experiments.study.factors[k], settings[k]);
            set.map_err(|message| experiments.study.refuse(k, message))?;
        }
        Ok(experiments)
    }

    /// Number of rows.
    pub fn runs(&self) -> u64 {
        self.plan.runs()
    }

    /// Makes the rows of a chunk that are not there.
    ///
    /// # Errors
    /// If the rows cannot be kept, or the watch asks to stop.
    pub fn chunk(&self, chunk: Chunk, watch: &dyn Watch) -> Result<(), CampaignError> {
        self.campaign.chunk(chunk, self.runs(), &|run| Ok(self.row(run)?), watch)
    }

    /// Sets a part of a case.
    fn set(&self, case: &mut Case, factor: &Factor, setting: Setting) -> Result<(), String> {
        let text = match (setting, &factor.range) {
            (Setting::Level(level), Range::Levels(all)) => all.get(level).map_or("", |l| l.text.as_str()).to_string(),
            (Setting::Number(x), _) => x.to_string(),
            _ => return Ok(()),
        };
        for key in &factor.keys {
            let wrong = |known: &[&str]| {
                let hint =
                    nearest(&text, known.iter().copied()).map_or(String::new(), |n| format!("; did you mean {n}?"));
                Err(format!("factor `{}`: `{key}` is {text}; expected {}{hint}", factor.name, known.join(", ")))
            };
            match key.as_str() {
                "effect" => {
                    let known: Vec<&str> = hideable(&self.model).iter().map(|e| e.name()).collect();
                    match text.as_str() {
                        NOTHING => case.effects.clear(),
                        name if known.contains(&name) => case.effects = vec![name.into()],
                        _ => return wrong(&[&[NOTHING], &known[..]].concat()),
                    }
                }
                "size" => match (Size::ALL.iter().find(|size| size.name() == text), text.parse::<f64>()) {
                    (Some(size), _) => (case.size, case.scale) = (*size, 1.0),
                    (None, Ok(scale)) if (SCALE.0..=SCALE.1).contains(&scale) => {
                        (case.size, case.scale) = (Size::Medium, scale);
                    }
                    _ => return wrong(&[&Size::ALL.map(Size::name)[..], &["0.001 to 100 of medium size"]].concat()),
                },
                "noise" => match Noise::ALL.iter().find(|noise| noise.name() == text) {
                    Some(noise) => case.noise = *noise,
                    None => return wrong(&Noise::ALL.map(Noise::name)),
                },
                "motion" => match MotionKind::ALL.iter().find(|motion| motion.name() == text) {
                    Some(motion) => case.motion = *motion,
                    None => return wrong(&MotionKind::ALL.map(MotionKind::name)),
                },
                "duration" => match text.parse::<f64>() {
                    Ok(x) if (DURATION.0..=DURATION.1).contains(&x) => case.duration = x,
                    _ => return wrong(&["a number from 1 to 600 s"]),
                },
                "payload" | "strut_sensor" => match text.parse() {
                    Ok(flag) if key == "payload" => case.payload = flag,
                    Ok(flag) => case.strut_sensor = flag,
                    Err(_) => return wrong(&["true", "false"]),
                },
                other => {
                    let hint = nearest(other, KEYS).map_or(String::new(), |n| format!("; did you mean `{n}`?"));
                    return Err(format!(
                        "factor `{}` has the key `{other}`; expected, in an experiment, one of {}{hint}",
                        factor.name,
                        KEYS.join(", ")
                    ));
                }
            }
        }
        Ok(())
    }

    fn row(&self, run: u64) -> Result<Vec<Value>, String> {
        let seed = self.draws.seed(run);
        let mut case = Case { seed, ..Case::default() };
        let settings = self.plan.point(run).settings;
        let integer = |n: u64| Value::Integer(i64::try_from(n).unwrap_or(i64::MAX));
        let mut row = vec![integer(run), integer(seed)];
        for (factor, setting) in self.study.factors.iter().zip(settings) {
            self.set(&mut case, factor, setting)?;
            row.push(conduct::cell(factor, setting));
        }
        match campaign(&self.model, &case, &|_, _| {}) {
            Ok(made) => {
                let answer = judge(&self.model, &[made.measurement.clone(), made.validation.clone()]);
                row.extend(cells(&truth_of(&made), &answer));
            }
            // A robot that cannot move with its hidden effect has no answer.
            Err(failure @ (Failure::Simulation(_) | Failure::Size(_))) => {
                row.resize(self.campaign.headings.len() - 1, Value::Missing);
                row.push(failure.to_string().into());
            }
            Err(failure) => return Err(failure.to_string()),
        }
        Ok(row)
    }
}

/// Truth of a campaign, as far as a row needs it.
fn truth_of(made: &Made) -> Truth {
    let first = made.hidden.first().map(|hidden| &hidden.rise);
    let ratio = first.and_then(|rise| rise.ratios.iter().find(|(channel, _)| *channel == rise.channel));
    Truth {
        effects: made.hidden.iter().map(|h| h.active.effect.name().to_string()).collect(),
        rise: ratio.map(|(_, ratio)| *ratio),
        limited: made.hidden.iter().any(|hidden| hidden.rise.limited),
        ..Truth::default()
    }
}

/// Values of [`own`] columns.
fn cells(truth: &Truth, answer: &Answer) -> Vec<Value> {
    let grade = Grade::of(truth, answer);
    let hidden = !truth.effects.is_empty();
    // What a refit leaves beside the noise: its RMS in units of the noise.
    let rise = truth.rise.map(|ratio| (ratio.powi(2) - 1.0).max(0.0).sqrt());
    vec![
        rise.into(),
        hidden.then_some(truth.limited).into(),
        answer.verdict.as_str().into(),
        answer.effects.first().map(|e| e.name.clone()).into(),
        answer.effects.first().map(|e| e.probability).into(),
        (grade == Grade::Right).into(),
        grade.to_string().into(),
        answer.held_out_ratio().into(),
        answer.failure.clone().into(),
    ]
}

/// Columns of the table of an exam.
pub fn exam_headings() -> Vec<Heading> {
    let text = |name: &str| Heading::new(name, "", Kind::Text);
    let mut headings = vec![Heading::new("run", "1", Kind::Integer), text("campaign"), text("hidden")];
    headings.extend(["size", "noise"].map(text));
    headings.extend(own());
    headings
}

/// Row of an exam under [`exam_headings`]; a campaign without a judgement was left out.
pub fn exam_row(run: u64, name: &str, judged: Option<&Judged>) -> Vec<Value> {
    let mut row = vec![Value::Integer(i64::try_from(run).unwrap_or(i64::MAX)), name.into()];
    match judged {
        Some(j) => {
            row.push(j.hidden().into());
            row.extend([j.truth.size.clone().into(), j.truth.noise.clone().into()]);
            row.extend(cells(&j.truth, &j.answer));
        }
        None => {
            row.resize(exam_headings().len() - 1, Value::Missing);
            row.push("left out: the robot cannot be simulated".into());
        }
    }
    row
}

/// Attempts of a power curve from rows of a table: the size of the effect, the length of the recording (s) from the
/// column `length`, if there is one, and whether the effect was named.
pub fn attempts(table: &deltatwin_study::campaign::Table, length: Option<&str>) -> Vec<Attempt> {
    let column = |name: &str| table.column(name);
    let (Some(size), Some(right)) = (column("effect_over_noise"), column("right")) else { return Vec::new() };
    let length = length.and_then(column);
    let attempt = |row: &Vec<Value>| {
        let named = match row[right] {
            Value::Flag(right) => right,
            _ => return None,
        };
        let length = length.map_or(Some(Case::default().duration), |c| row[c].number())?;
        Some(Attempt { size: row[size].number().filter(|size| *size > 0.0)?, length, named })
    };
    table.rows.iter().filter_map(attempt).collect()
}

/// Counts of right answers by the levels of a factor, as JSON: level → {count, of}.
pub fn by_level(table: &deltatwin_study::campaign::Table, factor: &str) -> serde_json::Value {
    let (Some(column), Some(right)) = (table.column(factor), table.column("right")) else { return json!({}) };
    let mut counts: std::collections::BTreeMap<String, (u64, u64)> = Default::default();
    for row in &table.rows {
        let Value::Flag(right) = row[right] else { continue };
        let level = match &row[column] {
            Value::Text(text) => text.clone(),
            other => other.number().map_or(String::new(), |x| x.to_string()),
        };
        let entry = counts.entry(level).or_default();
        entry.0 += u64::from(right);
        entry.1 += 1;
    }
    counts.into_iter().map(|(level, (count, of))| (level, json!({ "count": count, "of": of }))).collect()
}

//! Columns of a study's table, and rows under them.

use deltatwin_io::Problem;
use deltatwin_io::study::{CAUSES, Design, Factor, Range, Setting, Study};

use crate::campaign::{Heading, Kind, Value};
use crate::design::{Crossing, Point};
use crate::run::{Naming, Verdict};

/// Columns of a study: its run, seed and factors, those of its design, those of a verdict, of a diagnosis, and an error.
#[derive(Clone, Debug)]
pub struct Columns {
    /// All headings.
    pub headings: Vec<Heading>,
    /// First column of a factor; the others follow.
    pub factors: usize,
    /// First column of the verdict.
    pub verdict: usize,
    /// Column of the margin that the study is about: the least, or that against its cause.
    pub margin: usize,
    /// Column that says whether the run survived.
    pub survived: usize,
    /// Column of the error.
    pub error: usize,
}

/// Column of the scenario's seed.
const SEED: usize = 1;

impl Columns {
    /// The columns of `study`.
    ///
    /// # Errors
    /// If a factor has the name of another column.
    pub fn of(study: &Study) -> Result<Self, Problem> {
        let mut headings = vec![Heading::new("run", "1", Kind::Integer), Heading::new("seed", "1", Kind::Integer)];
        let own: Vec<Heading> = match study.design {
            Design::Boundary { .. } => vec![
                Heading::new("reach", "1", Kind::Float),
                Heading::new("reach_low", "1", Kind::Float),
                Heading::new("reach_high", "1", Kind::Float),
                Heading::new("evaluations", "1", Kind::Integer),
                Heading::new("margin_falls", "", Kind::Flag),
                Heading::new("margin_rises_from", "1", Kind::Float),
            ],
            Design::WorstCase { .. } => vec![Heading::new("generation", "1", Kind::Integer)],
            Design::Subset { .. } => vec![Heading::new("batch", "1", Kind::Integer)],
            _ => Vec::new(),
        };
        let factors = headings.len();
        headings.extend(study.factors.iter().map(heading));
        headings.extend(own);
        let verdict = headings.len();
        headings.extend(Verdict::columns().iter().map(|column| Heading::from(*column)));
        if study.diagnose {
            headings.extend(Naming::columns().iter().map(|column| Heading::from(*column)));
        }
        let error = headings.len();
        headings.push(Heading::new("error", "", Kind::Text));
        for (k, factor) in study.factors.iter().enumerate() {
            let others = headings.iter().enumerate().filter(|(c, _)| *c != factors + k);
            if let Some((_, other)) = others.into_iter().find(|(_, h)| h.name == factor.name) {
                let message = format!("factor `{}` has the name of another column; expected its own", other.name);
                return Err(study.refuse(k, message));
            }
        }
        let named = |name: &str| verdict + Verdict::columns().iter().position(|c| c.name == name).unwrap_or(0);
        let margin = study.margin.map_or("margin".into(), |cause| format!("margin_{}", CAUSES[cause]));
        Ok(Self { factors, verdict, margin: named(&margin), survived: named("survived"), error, headings })
    }

    /// Row of a run of `study`; `own` are the values of the design's columns, `answer` those of verdict and diagnosis.
    pub fn row(
        &self,
        study: &Study,
        (run, point): (u64, &Point),
        own: Vec<Value>,
        answer: Result<Vec<Value>, String>,
    ) -> Vec<Value> {
        let integer = |n: u64| Value::Integer(i64::try_from(n).unwrap_or(i64::MAX));
        let mut row = vec![integer(run), point.seed.map_or(Value::Missing, integer)];
        row.extend(study.factors.iter().zip(&point.settings).map(|(factor, setting)| cell(factor, *setting)));
        row.extend(own);
        match answer {
            Ok(answer) => {
                row.extend(answer);
                row.push(Value::Missing);
            }
            Err(reason) => {
                row.resize(self.error, Value::Missing);
                row.push(reason.as_str().into());
            }
        }
        row
    }

    /// Settings of a factor as text.
    pub fn text(&self, factor: &Factor, setting: Setting) -> String {
        match (setting, &factor.range) {
            (Setting::Level(level), Range::Levels(all)) => all.get(level).map_or(String::new(), |l| l.text.clone()),
            (Setting::Level(level), _) => level.to_string(),
            (Setting::Unset, _) => "as in the scenario".into(),
            (Setting::Number(x), _) => x.to_string(),
        }
    }

    /// The verdict's part of a row.
    pub fn verdict_of<'r>(&self, row: &'r [Value]) -> &'r [Value] {
        &row[self.verdict..self.verdict + Verdict::columns().len()]
    }

    /// Settings and seed of a row.
    ///
    /// # Errors
    /// If a value is none of its factor's levels.
    pub fn point(&self, study: &Study, row: &[Value]) -> Result<Point, String> {
        let setting = |(k, factor): (usize, &Factor)| {
            let cell = &row[self.factors + k];
            match (&factor.range, cell) {
                (Range::Levels(all), cell) => {
                    let same = |level: &deltatwin_io::study::Level| match (cell, level.number) {
                        (Value::Text(text), None) => *text == level.text,
                        (cell, Some(x)) => cell.number() == Some(x),
                        _ => false,
                    };
                    let level = all.iter().position(same);
                    level.map(Setting::Level).ok_or_else(|| format!("{cell:?} is no level of factor `{}`", factor.name))
                }
                (_, cell) => cell
                    .number()
                    .map(Setting::Number)
                    .ok_or_else(|| format!("factor `{}` has no number in the table", factor.name)),
            }
        };
        let settings = study.factors.iter().enumerate().map(setting).collect::<Result<Vec<_>, _>>()?;
        let seed = match &row[SEED] {
            Value::Integer(seed) => Some(seed.unsigned_abs()),
            _ => None,
        };
        Ok(Point { settings, seed })
    }
}

fn kind(factor: &Factor) -> Kind {
    match &factor.range {
        Range::Levels(all) if all.iter().any(|level| level.number.is_none()) => Kind::Text,
        _ => Kind::Float,
    }
}

/// Heading of a factor's column.
pub fn heading(factor: &Factor) -> Heading {
    Heading::new(&factor.name, unit(factor), kind(factor))
}

fn unit(factor: &Factor) -> &str {
    if kind(factor) == Kind::Text { "" } else { &factor.unit }
}

/// Value of a factor in the table.
pub fn cell(factor: &Factor, setting: Setting) -> Value {
    match (setting, &factor.range) {
        (Setting::Number(x), _) => Value::Float(x),
        (Setting::Level(level), Range::Levels(all)) => match all.get(level) {
            Some(level) => level.number.map_or_else(|| level.text.as_str().into(), Value::Float),
            None => Value::Missing,
        },
        (Setting::Level(_) | Setting::Unset, _) => Value::Missing,
    }
}

/// Values of the columns of a boundary search.
pub fn crossing(at: &Crossing) -> Vec<Value> {
    let evaluations = Value::Integer(i64::from(at.evaluations));
    vec![at.at.into(), at.low.into(), at.high.into(), evaluations, at.rises.is_none().into(), at.rises.into()]
}

/// The same where a run has no verdict.
pub fn no_crossing() -> Vec<Value> {
    vec![Value::Missing; 6]
}

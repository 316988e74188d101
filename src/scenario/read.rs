//! TOML → [`Scenario`], with errors that name file, line, key, value and what was expected.

use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::{Diagnostic, NamedSource, SourceSpan};
use serde::Deserialize;
use thiserror::Error;
use toml::Spanned;

use super::{Course, FourierMotion, Scenario};
use crate::model::STRUTS;
use crate::recording::{Payload, Setup};

/// Why a scenario was refused.
#[derive(Debug, Error, Diagnostic)]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {reason}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// What the system said.
        reason: String,
    },
    /// A mistake in the file.
    #[error("{place}: {message}")]
    Content {
        /// `file:line:column`.
        place: String,
        /// Key, value and what was expected.
        message: String,
        /// The scenario's text.
        #[source_code]
        text: Arc<NamedSource<String>>,
        /// Where the mistake is.
        #[label("here")]
        span: SourceSpan,
    },
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    model: Spanned<String>,
    controller_model: Option<Spanned<String>>,
    duration: Spanned<f64>,
    seed: Option<u64>,
    noise: Option<bool>,
    substeps: Option<Spanned<i64>>,
    motion: Spanned<Motion>,
    payload: Option<Load>,
    sensors: Option<Sensors>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Motion {
    kind: Spanned<String>,
    frequency: Spanned<f64>,
    seed: Option<Spanned<u64>>,
    harmonics: Option<Spanned<i64>>,
    share: Option<Spanned<f64>>,
    centre: Option<Spanned<[f64; 4]>>,
    sine: Option<Spanned<Vec<[f64; 4]>>>,
    cosine: Option<Spanned<Vec<[f64; 4]>>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Load {
    mass: Spanned<f64>,
    com: Option<[Spanned<f64>; 3]>,
    inertia_zz: Option<Spanned<f64>>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Sensors {
    strut_upper: Vec<Spanned<i64>>,
}

/// Largest share of the limits by default: room for feedback and model error.
const SHARE: f64 = 0.8;
const HARMONICS: i64 = 5;
const SUBSTEPS: i64 = 2;

type Result<T> = std::result::Result<T, ScenarioError>;

/// A scenario as text.
struct File<'a> {
    name: String,
    text: &'a str,
}

impl File<'_> {
    fn problem(&self, span: Range<usize>, message: String) -> ScenarioError {
        let before = self.text.get(..span.start).unwrap_or(self.text);
        let line = before.matches('\n').count() + 1;
        let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
        ScenarioError::Content {
            place: format!("{}:{line}:{column}", self.name),
            message,
            text: NamedSource::new(&self.name, self.text.to_string()).with_language("toml").into(),
            span: span.into(),
        }
    }

    fn within(&self, key: &str, value: &Spanned<f64>, low: f64, high: f64, unit: &str) -> Result<f64> {
        let v = *value.get_ref();
        if (low..=high).contains(&v) {
            return Ok(v);
        }
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        Err(self.problem(value.span(), format!("`{key}` is {v}; expected a number from {low} to {high}{unit}")))
    }

    fn count(&self, key: &str, value: &Spanned<i64>, low: i64, high: i64) -> Result<usize> {
        let v = *value.get_ref();
        if (low..=high).contains(&v) {
            return Ok(v as usize);
        }
        Err(self.problem(value.span(), format!("`{key}` is {v}; expected a whole number from {low} to {high}")))
    }

    fn optional(&self, key: &str, value: &Option<Spanned<f64>>, default: f64, low: f64, high: f64) -> Result<f64> {
        value.as_ref().map_or(Ok(default), |v| self.within(key, v, low, high, ""))
    }

    fn course(&self, motion: &Spanned<Motion>) -> Result<Course> {
        let m = motion.get_ref();
        let frequency = self.within("motion.frequency", &m.frequency, 1e-3, 20.0, "Hz")?;
        match m.kind.get_ref().as_str() {
            "random_fourier" => {
                self.foreign(&m.centre, "centre", "random_fourier")?;
                self.foreign(&m.sine, "sine", "random_fourier")?;
                self.foreign(&m.cosine, "cosine", "random_fourier")?;
                Ok(Course::RandomFourier {
                    seed: m.seed.as_ref().map_or(0, |s| *s.get_ref()),
                    frequency,
                    harmonics: match &m.harmonics {
                        Some(n) => self.count("motion.harmonics", n, 1, 50)?,
                        None => HARMONICS as usize,
                    },
                    share: self.optional("motion.share", &m.share, SHARE, 0.01, 1.0)?,
                })
            }
            "fourier" => {
                self.foreign(&m.seed, "seed", "fourier")?;
                self.foreign(&m.harmonics, "harmonics", "fourier")?;
                self.foreign(&m.share, "share", "fourier")?;
                let Some(centre) = &m.centre else {
                    let message = "[motion] lacks `centre`; expected the mean of x, y, z in m and ψ in rad";
                    return Err(self.problem(motion.span(), message.into()));
                };
                let rows =
                    |rows: &Option<Spanned<Vec<[f64; 4]>>>| rows.as_ref().map_or(Vec::new(), |r| r.get_ref().clone());
                let (mut sine, mut cosine) = (rows(&m.sine), rows(&m.cosine));
                let harmonics = sine.len().max(cosine.len());
                sine.resize(harmonics, [0.0; 4]);
                cosine.resize(harmonics, [0.0; 4]);
                let series = FourierMotion { frequency, centre: *centre.get_ref(), sine, cosine };
                for (key, span, rows) in [
                    ("centre", Some(centre.span()), std::slice::from_ref(&series.centre)),
                    ("sine", m.sine.as_ref().map(Spanned::span), &series.sine[..]),
                    ("cosine", m.cosine.as_ref().map(Spanned::span), &series.cosine[..]),
                ] {
                    // Radians of axis 4 may be many turns; metres may not be many.
                    if let Some(v) = rows.iter().flatten().find(|v| v.is_nan() || v.abs() > 1e3) {
                        let message = format!("`motion.{key}` has {v}; expected numbers from -1000 to 1000");
                        return Err(self.problem(span.unwrap_or_else(|| motion.span()), message));
                    }
                }
                Ok(Course::Fourier(series))
            }
            other => {
                let message = format!("`motion.kind` is \"{other}\"; expected \"random_fourier\" or \"fourier\"");
                Err(self.problem(m.kind.span(), message))
            }
        }
    }

    /// Refuses a key that belongs to the other kind of motion.
    fn foreign<T>(&self, value: &Option<Spanned<T>>, key: &str, kind: &str) -> Result<()> {
        match value {
            None => Ok(()),
            Some(v) => {
                let message =
                    format!("`motion.{key}` has no meaning for kind = \"{kind}\"; expected it to be left out");
                Err(self.problem(v.span(), message))
            }
        }
    }

    fn payload(&self, load: &Load) -> Result<Payload> {
        let mut payload =
            Payload { mass: self.within("payload.mass", &load.mass, 0.0, 100.0, "kg")?, ..Payload::default() };
        if let Some(com) = &load.com {
            for (i, c) in com.iter().enumerate() {
                payload.com[i] = self.within("payload.com", c, -2.0, 2.0, "m")?;
            }
        }
        payload.inertia_zz = self.optional("payload.inertia_zz", &load.inertia_zz, 0.0, 0.0, 100.0)?;
        Ok(payload)
    }

    fn strut_sensors(&self, sensors: &Sensors) -> Result<[bool; STRUTS]> {
        let mut fitted = [false; STRUTS];
        for strut in &sensors.strut_upper {
            let i = self.count("sensors.strut_upper", strut, 1, STRUTS as i64)?;
            if std::mem::replace(&mut fitted[i - 1], true) {
                let message = format!("`sensors.strut_upper` has {i} twice; expected every strut once");
                return Err(self.problem(strut.span(), message));
            }
        }
        Ok(fitted)
    }
}

impl Scenario {
    /// Reads a scenario file; the files it names are relative to it.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path)
            .map_err(|e| ScenarioError::Io { file: path.into(), reason: e.to_string() })?;
        Self::parse(&text, path)
    }

    /// Reads a scenario from `text`; `path` names it in errors and is where it looks for models.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let file = File { name: path.display().to_string(), text };
        let document: Document = toml::from_str(text)
            .map_err(|e| file.problem(e.span().unwrap_or(0..0), e.message().trim().replace('\n', ", ")))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let beside = |key: &str, name: &Spanned<String>| {
            let target = folder.join(name.get_ref());
            if target.is_file() {
                return Ok(target);
            }
            let message = format!("`{key}` is \"{}\"; expected a model file, relative to the scenario", name.get_ref());
            Err(file.problem(name.span(), message))
        };
        let model = beside("model", &document.model)?;
        let controller_model =
            document.controller_model.as_ref().map(|name| beside("controller_model", name)).transpose()?;
        let payload = document.payload.as_ref().map_or(Ok(Payload::default()), |load| file.payload(load))?;
        Ok(Self {
            name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            model,
            controller_model,
            duration: file.within("duration", &document.duration, 0.01, 3600.0, "s")?,
            seed: document.seed.unwrap_or(0),
            noise: document.noise.unwrap_or(true),
            substeps: match &document.substeps {
                Some(n) => file.count("substeps", n, 1, 1000)?,
                None => SUBSTEPS as usize,
            },
            motion: file.course(&document.motion)?,
            setup: Setup { payload, ..Setup::default() },
            strut_sensors: document.sensors.as_ref().map_or(Ok([false; STRUTS]), |s| file.strut_sensors(s))?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = "model = \"../models/irb360-6-1600.toml\"\nduration = 1.0\n[motion]\n\
                        kind = \"fourier\"\nfrequency = 0.5\ncentre = [0.0, 0.0, -1.0, 0.0]\n";

    fn parse(text: &str) -> Result<Scenario> {
        Scenario::parse(text, Path::new("scenarios/test.toml"))
    }

    fn refusal(from: &str, to: &str) -> String {
        assert!(GOOD.contains(from));
        parse(&GOOD.replace(from, to)).unwrap_err().to_string()
    }

    #[test]
    fn defaults_fill_what_is_left_out() {
        let s = parse(GOOD).unwrap();
        assert_eq!((s.seed, s.noise, s.substeps), (0, true, 2));
        assert!(s.controller_model.is_none());
    }

    #[test]
    fn mistakes_are_named_with_line_and_value() {
        let text = refusal("duration = 1.0", "duration = -1.0");
        assert!(text.contains("test.toml:2:") && text.contains("-1") && text.contains("expected"), "{text}");
        let text = refusal("\"fourier\"", "\"spiral\"");
        assert!(text.contains("test.toml:4:") && text.contains("spiral"), "{text}");
        let text = refusal("centre", "center");
        assert!(text.contains("test.toml:6:") && text.contains("center"), "{text}");
        let text = refusal("frequency = 0.5", "frequency = 0.5\nshare = 0.5");
        assert!(text.contains("no meaning"), "{text}");
        let text = refusal("irb360-6-1600.toml", "nothing.toml");
        assert!(text.contains("test.toml:1:") && text.contains("nothing.toml"), "{text}");
    }

    #[test]
    fn motions_out_of_reach_are_refused() {
        let model = crate::model::Model::read(Path::new("models/irb360-6-1600.toml")).unwrap();
        assert!(parse(GOOD).unwrap().motion(&model).is_ok());
        let far = parse(&GOOD.replace("[0.0, 0.0,", "[0.9, 0.0,")).unwrap();
        assert!(far.motion(&model).unwrap_err().to_string().contains("cannot be reached"));
    }
}

//! Setup of a run as TOML: the sidecar `<stem>.setup.toml` of a recording.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use miette::NamedSource;
use serde::Deserialize;
use toml::Spanned;

use super::{Mapping, ReadError, WriteError, file};
use crate::machine::{AXES, Configuration, Payload, Setup};

/// Where the setup of the recording `path` is kept.
pub fn sidecar(path: &Path) -> PathBuf {
    path.with_extension("setup.toml")
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Document {
    configuration: State,
    payload: Load,
    noise: Noise,
    columns: BTreeMap<String, Spanned<String>>,
}

/// A sidecar: what is known about a run, and which column of its file is which channel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sidecar {
    /// What is known about the run.
    pub setup: Setup,
    /// `[columns]`: channel = "column[unit]".
    pub columns: Mapping,
}

#[derive(Deserialize, Clone, Copy)]
#[serde(rename_all = "lowercase")]
enum State {
    Assembled,
    Disassembled,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, default)]
struct Load {
    mass: Spanned<f64>,
    com: [Spanned<f64>; 3],
    inertia_zz: Option<Spanned<f64>>,
    inertia: Option<Spanned<Vec<f64>>>,
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields, default)]
struct Noise {
    torque: Option<Spanned<Vec<Spanned<f64>>>>,
}

fn zero() -> Spanned<f64> {
    Spanned::new(0..0, 0.0)
}

impl Default for Document {
    fn default() -> Self {
        Self {
            configuration: State::Assembled,
            payload: Load::default(),
            noise: Noise::default(),
            columns: BTreeMap::new(),
        }
    }
}

impl Default for Load {
    fn default() -> Self {
        Self { mass: zero(), com: [zero(), zero(), zero()], inertia_zz: None, inertia: None }
    }
}

impl Setup {
    /// Reads a setup file.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        Ok(Sidecar::read(path)?.setup)
    }

    /// Reads a setup from TOML; `name` stands for the text in errors.
    pub fn from_toml(text: &str, name: &str) -> Result<Self, ReadError> {
        Ok(Sidecar::from_toml(text, name)?.setup)
    }
}

impl Sidecar {
    /// Reads a setup file with its columns.
    pub fn read(path: &Path) -> Result<Self, ReadError> {
        let bytes = std::fs::read(path).map_err(|e| ReadError::io(path, e))?;
        let text = String::from_utf8(bytes).map_err(|_| ReadError::content(path, "is not text", "a setup in TOML"))?;
        Self::from_toml(&text, &path.display().to_string())
    }

    /// Reads a setup with its columns from TOML; `name` stands for the text in errors.
    pub fn from_toml(text: &str, name: &str) -> Result<Self, ReadError> {
        let error = |message: String, span: std::ops::Range<usize>| {
            let before = text.get(..span.start).unwrap_or(text);
            let line = before.matches('\n').count() + 1;
            let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
            ReadError::Setup {
                place: format!("{name}:{line}:{column}"),
                message,
                text: NamedSource::new(name, text.to_string()).into(),
                span: span.into(),
            }
        };
        let document: Document = toml::from_str(text)
            .map_err(|e| error(e.message().trim().replace('\n', ", "), e.span().unwrap_or(0..0)))?;
        let within = |key: &str, value: &Spanned<f64>, low: f64, high: f64, unit: &str| {
            let v = *value.get_ref();
            if (low..=high).contains(&v) {
                Ok(v)
            } else {
                let expected = format!("expected a number from {low} to {high} {unit}");
                Err(error(format!("`{key}` is {v}; {expected}"), value.span()))
            }
        };
        let load = &document.payload;
        let mass = within("payload.mass", &load.mass, 0.0, 100.0, "kg")?;
        let vertical = load.inertia_zz.as_ref().map(|v| within("payload.inertia_zz", v, 0.0, 100.0, "kg·m²"));
        let mut com = [0.0; 3];
        for (own, c) in com.iter_mut().zip(&load.com) {
            *own = within("payload.com", c, -2.0, 2.0, "m")?;
        }
        let tensor = load.inertia.as_ref().map(|v| v.get_ref().as_slice());
        let payload = Payload::stated(mass, com, vertical.transpose()?, tensor).map_err(|what| {
            let span = load.inertia.as_ref().map_or(0..0, Spanned::span);
            error(format!("`payload.inertia` {what}"), span)
        })?;
        let mut torque_noise = None;
        if let Some(values) = &document.noise.torque {
            let mut sigma = [0.0; AXES];
            let n = values.get_ref().len();
            if ![1, 3, AXES].contains(&n) {
                let message = format!("`noise.torque` has {n} numbers; expected one per axis: 1, 3 or {AXES}");
                return Err(error(message, values.span()));
            }
            for (s, v) in sigma.iter_mut().zip(values.get_ref()) {
                *s = within("noise.torque", v, 0.0, 1e4, "N·m")?;
            }
            torque_noise = Some(sigma);
        }
        let configuration = match document.configuration {
            State::Assembled => Configuration::Assembled,
            State::Disassembled => Configuration::Disassembled,
        };
        let mut columns = Mapping::default();
        for (channel, source) in &document.columns {
            let refused = |e: String| error(format!("`columns.{channel}`: {e}"), source.span());
            columns.assign(channel, source.get_ref()).map_err(refused)?;
        }
        Ok(Self { setup: Setup { configuration, payload, torque_noise }, columns })
    }
}

impl Setup {
    /// The setup as TOML, read back without loss by [`Setup::from_toml`].
    pub fn to_toml(&self) -> String {
        let configuration = match self.configuration {
            Configuration::Assembled => "assembled",
            Configuration::Disassembled => "disassembled",
        };
        let mut text = format!("configuration = \"{configuration}\"\n\n{}", self.payload.to_toml());
        if let Some(sigma) = self.torque_noise {
            text += &format!("\n[noise]\ntorque = {sigma:?} # N·m, standard deviation\n");
        }
        text
    }

    /// Writes a setup file.
    pub fn write(&self, path: &Path) -> Result<(), WriteError> {
        file::replace(path, |out| out.write_all(self.to_toml().as_bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        Setup::from_toml(text, "run.setup.toml").unwrap_err().to_string()
    }

    #[test]
    fn round_trip() {
        let setup = Setup {
            configuration: Configuration::Disassembled,
            payload: Payload::new(1.0 / 3.0, [1e-7, -0.02, 0.1], 0.004),
            torque_noise: Some([0.4, 0.4, 0.4, 0.05]),
        };
        assert_eq!(Setup::from_toml(&setup.to_toml(), "x").unwrap(), setup);
        assert_eq!(Setup::from_toml("", "x").unwrap(), Setup::default());
        assert_eq!(Setup::from_toml("[payload]\nmass = 2", "x").unwrap().payload.mass, 2.0);
    }

    #[test]
    fn a_tensor_is_read_and_checked() {
        let of = |keys: &str| Setup::from_toml(&format!("[payload]\nmass = 2\n{keys}"), "run.setup.toml");
        let tensor = [0.02, 0.04, 0.03, 0.0, -0.01, 0.001];
        let payload = of("inertia = [0.02, 0.04, 0.03, 0.0, -0.01, 0.001]").unwrap().payload;
        assert_eq!(payload, Payload::with_tensor(2.0, [0.0; 3], tensor));
        assert_eq!(of("inertia_zz = 0.03").unwrap().payload.moments(), [0.03, 0.03, 0.03, 0.0, 0.0, 0.0]);
        let e = of("inertia_zz = 0.03\ninertia = [0.02, 0.04, 0.05]").unwrap_err().to_string();
        assert!(e.starts_with("run.setup.toml:4:11: `payload.inertia` has zz = 0.05, but `inertia_zz` is 0.03"), "{e}");
        let e = of("inertia = [0.01, 0.01, 0.05]").unwrap_err().to_string();
        assert!(e.contains(":3:11: `payload.inertia` violates the triangle inequality"), "{e}");
        assert!(of("inertia = [0.01, nan, 0.05]").is_err());
    }

    #[test]
    fn mistakes_are_named_with_their_place() {
        let e = refused("configuration = \"assembled\"\n[payload]\nmas = 1.0\n");
        assert!(e.starts_with("run.setup.toml:3:1: unknown field `mas`"), "{e}");
        let e = refused("[payload]\nmass = -1.0\n");
        assert!(e.starts_with("run.setup.toml:2:8: `payload.mass` is -1; expected"), "{e}");
        assert!(refused("[payload]\ncom = [0.0, nan, 0.0]").contains(":2:13: `payload.com` is NaN"));
        assert!(refused("[noise]\ntorque = [1.0, 2.0]").contains(":2:"), "{}", refused("[noise]\ntorque = [1.0, 2.0]"));
        assert!(refused("configuration = \"asembled\"").contains("assembled"));
        assert!(refused("configuration = ").contains(":1:"));
        let e = refused("[columns]\nt = \"Time[ms]\"\nq1 = \"Pos[furlong]\"\n");
        assert!(e.starts_with("run.setup.toml:3:6: `columns.q1`") && e.contains("furlong"), "{e}");
    }
}

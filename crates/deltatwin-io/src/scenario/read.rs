//! TOML → [`Scenario`], with errors that state file, line, key, value and what was expected.

pub(crate) mod cell;
mod machine;
mod motion;

use std::path::{Path, PathBuf};

use deltatwin::machine::Setup;
use deltatwin::scenario::{Course, Formulation, HoldTorque, Scenario};
use miette::Diagnostic;
use serde::Deserialize;
use thiserror::Error;
use toml::Spanned;

use crate::file;
use crate::kind::Kind;
use crate::load;
use crate::model::shipped;
use crate::outside::Access;
use crate::source::{Checked, Interval, Problem, Source};

/// Why a scenario or a path file was rejected.
#[derive(Debug, Error, Diagnostic)]
pub enum ScenarioError {
    /// The file cannot be read.
    #[error("{}: cannot be read: {reason}", file.display())]
    Io {
        /// The file.
        file: PathBuf,
        /// Error of the operating system.
        reason: String,
    },
    /// The file is of another kind.
    #[error("{}: is a {found}; expected a {expected}", file.display())]
    Kind {
        /// The file.
        file: PathBuf,
        /// Kind of the file.
        found: Kind,
        /// Required kind.
        expected: Kind,
    },
    /// An error in the file.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Content(#[from] Problem),
}

impl ScenarioError {
    /// The text of a file.
    pub(crate) fn text(path: &Path) -> Result<String> {
        file::text(path).map_err(|e| Self::Io { file: path.into(), reason: e.to_string() })
    }

    /// The error that the file is of another kind if `text` is; otherwise this error.
    pub(crate) fn unless_other(self, expected: Kind, text: &str, path: &Path) -> Self {
        let found = Kind::instead_of(expected, text);
        found.map_or(self, |found| Self::Kind { file: path.into(), found, expected })
    }
}

type Result<T> = std::result::Result<T, ScenarioError>;

/// All tables except `[motion]`, whose keys depend on its kind.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    model: Spanned<String>,
    controller_model: Option<Spanned<String>>,
    duration: Option<Spanned<f64>>,
    seed: Option<u64>,
    noise: Option<bool>,
    substeps: Option<Spanned<i64>>,
    control_period: Option<Spanned<i64>>,
    hold_torque: Option<Spanned<String>>,
    formulation: Option<Spanned<String>>,
    gains: Option<machine::GainKeys>,
    payload: Option<cell::LoadKeys>,
    #[serde(default)]
    load: load::Keys,
    believed_payload: Option<cell::LoadKeys>,
    #[serde(default)]
    objects: Vec<cell::ObjectKeys>,
    #[serde(default)]
    actions: Vec<cell::ActionKeys>,
    sockets: Option<machine::SocketKeys>,
    supervision: Option<machine::SupervisionKeys>,
    sensors: Option<machine::SensorKeys>,
}

/// Shortest and longest run, s.
const DURATION: [f64; 2] = [0.01, 3600.0];

/// Reads a scenario file without solids; the files it names are relative to it.
///
/// # Errors
/// [`ScenarioError::Io`] if the file cannot be read; else the first error in it, with its position.
pub fn read(path: &Path) -> Result<Scenario> {
    read_with(path, Access::PLAIN)
}

/// Reads a scenario file like [`read`], with `access` to the files it names.
///
/// # Errors
/// As for [`read`].
pub fn read_with(path: &Path, access: Access) -> Result<Scenario> {
    let text = ScenarioError::text(path)?;
    parse_with(&text, path, access).map_err(|e| e.unless_other(Kind::Scenario, &text, path))
}

/// Reads a scenario from `text` without solids; `path` is named in errors, and models and tables are relative to it.
///
/// # Errors
/// The first error in the text, with its position.
pub fn parse(text: &str, path: &Path) -> Result<Scenario> {
    parse_with(text, path, Access::PLAIN)
}

/// Reads a scenario from `text` like [`parse`], with `access` to the files it names.
///
/// # Errors
/// The first error in the text, with its position.
pub fn parse_with(text: &str, path: &Path, access: Access) -> Result<Scenario> {
    let file = &Source { access, ..Source::new(path.display(), text) };
    let (document, motion) = file.document::<Document>("motion")?;
    let folder = path.parent().unwrap_or(Path::new(""));
    let beside = |key: &str, name: &Spanned<String>| {
        let target = folder.join(name.get_ref());
        file.may_name(key, name, &target)?;
        if target.is_file() || shipped::is_named(folder, name.get_ref()) {
            return Ok(target);
        }
        let name_of = name.get_ref();
        let message = format!(
            "`{key}` is \"{name_of}\", which is no file; expected a model file, relative to the scenario, or a shipped model"
        );
        Err(file.problem(name.span(), message))
    };
    let model = beside("model", &document.model)?;
    let controller_model =
        document.controller_model.as_ref().map(|name| beside("controller_model", name)).transpose()?;
    let Some(motion) = motion else {
        return Err(file.problem(0..0, "[motion] is missing; expected the desired motion".into()).into());
    };
    let motion = motion::course(file, folder, motion)?;
    let duration = duration(file, &document.duration, &motion)?;
    let whole =
        |key: &str, value: &Option<Spanned<i64>>| value.as_ref().map(|n| file.count(key, n, 1, 1000)).transpose();
    let (payload, payload_shape) =
        document.payload.as_ref().map_or(Ok(Default::default()), |keys| cell::payload(file, keys))?;
    let believed_payload = document.believed_payload.as_ref().map(|keys| cell::payload(file, keys)).transpose()?;
    let drag_factor = document.payload.as_ref().map(|keys| cell::drag_factor(file, keys)).transpose()?.flatten();
    let objects = cell::objects(file, &document.objects)?;
    Ok(Scenario {
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        model,
        controller_model,
        duration,
        seed: document.seed.unwrap_or(0),
        noise: document.noise.unwrap_or(true),
        substeps: whole("substeps", &document.substeps)?,
        control_period: whole("control_period", &document.control_period)?.unwrap_or(1),
        hold_torque: match &document.hold_torque {
            Some(word) => {
                let choices = [("ramp", HoldTorque::Ramp), ("hold", HoldTorque::Hold)];
                file.choice("hold_torque", word, &choices)?
            }
            None => HoldTorque::default(),
        },
        formulation: match &document.formulation {
            Some(word) => file.choice("formulation", word, &Formulation::NAMES)?,
            None => Formulation::default(),
        },
        gains: document.gains.as_ref().map_or(Ok(Default::default()), |keys| machine::gains(file, keys))?,
        motion,
        setup: Setup { payload, load: load::read(file, &document.load)?, ..Setup::default() },
        believed_payload: believed_payload.map(|(payload, _)| payload),
        drag_factor,
        payload_shape,
        actions: cell::actions(file, &document.actions, &objects, duration)?,
        objects,
        sockets: document.sockets.as_ref().map_or(Ok(Default::default()), |keys| machine::sockets(file, keys))?,
        supervision: document
            .supervision
            .as_ref()
            .map_or(Ok(Default::default()), |keys| machine::supervision(file, keys))?,
        sensors: document.sensors.as_ref().map_or(Ok(Default::default()), |keys| machine::sensors(file, keys))?,
    })
}

/// Duration of the run (s): the stated one, else that of the motion.
fn duration(file: &Source, given: &Option<Spanned<f64>>, motion: &Course) -> Checked<f64> {
    let [shortest, longest] = DURATION;
    match (given, motion.length()) {
        (Some(value), length) => {
            let duration = file.within("duration", value, Interval(shortest, longest, "s"))?;
            match (motion, length) {
                (Course::Table(table), Some(length)) if table.moving && duration > length => {
                    let message = format!(
                        "`duration` is {duration}; expected at most {length} s, where the table ends in motion"
                    );
                    Err(file.problem(value.span(), message))
                }
                _ => Ok(duration),
            }
        }
        (None, Some(length)) if length <= longest => Ok(length.max(shortest)),
        (None, Some(length)) => {
            let message = format!("[motion] takes {length} s; expected `duration`, at most {longest} s");
            Err(file.problem(0..0, message))
        }
        (None, None) => {
            let message = "the scenario lacks `duration`; expected seconds, as its motion never ends".into();
            Err(file.problem(0..0, message))
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    pub const HEAD: &str = "model = \"../models/irb360-6-1600.toml\"\nduration = 1.0\n";

    pub const GOOD: &str = "model = \"../models/irb360-6-1600.toml\"\nduration = 1.0\n[motion]\n\
                            kind = \"fourier\"\nfrequency = 0.5\ncentre = [0.0, 0.0, -1.0, 0.0]\n";

    pub fn parse(text: &str) -> Result<Scenario> {
        super::parse(text, Path::new("../../scenarios/test.toml"))
    }

    fn refusal(from: &str, to: &str) -> String {
        assert!(GOOD.contains(from));
        parse(&GOOD.replace(from, to)).unwrap_err().to_string()
    }

    #[test]
    fn defaults_fill_what_is_left_out() {
        let s = parse(GOOD).unwrap();
        assert_eq!((s.seed, s.noise, s.substeps, s.control_period), (0, true, None, 1));
        assert!(s.controller_model.is_none() && s.objects.is_empty() && s.actions.is_empty());
        assert_eq!(s.hold_torque, HoldTorque::Ramp);
        let s = parse(&format!("control_period = 5\nhold_torque = \"hold\"\n{GOOD}")).unwrap();
        assert_eq!((s.control_period, s.hold_torque), (5, HoldTorque::Hold));
        assert_eq!(s.formulation, Formulation::Eliminated);
        // A shipped model by its name.
        let named = GOOD.replace("../models/irb360-6-1600.toml", "par4");
        assert!(named != GOOD && parse(&named).unwrap().model.ends_with("par4"));
        let s = parse(&format!("formulation = \"absolute\"\n{GOOD}")).unwrap();
        assert_eq!(s.formulation, Formulation::Absolute);
    }

    #[test]
    fn mistakes_are_named_with_line_and_value() {
        for (from, to, expected) in [
            ("duration = 1.0", "duration = -1.0", "test.toml:2:12: `duration` is -1; expected"),
            ("\"fourier\"", "\"spiral\"", "test.toml:4:8: `motion.kind` is \"spiral\""),
            ("centre", "center", "test.toml:6:1: unknown key `motion.center`"),
            ("frequency = 0.5", "frequency = 0.5\nshare = 0.5", "test.toml:6:1: unknown key `motion.share`"),
            ("irb360-6-1600.toml", "nothing.toml", "test.toml:1:9: `model` is \"../models/nothing.toml\""),
            ("duration = 1.0", "duration = 1.0\nhold_torque = \"step\"", "test.toml:3:15: `hold_torque` is \"step\""),
            ("duration = 1.0", "duration = 1.0\nformulation = \"full\"", "test.toml:3:15: `formulation` is \"full\""),
            ("duration = 1.0", "duration = 1.0\ncontrol_period = 0", "test.toml:3:18: `control_period` is 0"),
            ("duration = 1.0", "duration = 1.0\nduratoin = 1.0", "test.toml:3:1: unknown key `duratoin`"),
            ("duration = 1.0", "duration = ", "test.toml:2:"),
            ("[motion]", "[movement]", "test.toml:3:2: unknown key `movement`"),
            ("-1.0, 0.0]", "-1.0, inf]", "test.toml:6:10: `motion.centre` has inf"),
        ] {
            let e = refusal(from, to);
            assert!(e.contains(expected), "{expected}\n{e}");
        }
        assert!(parse(HEAD).unwrap_err().to_string().contains("[motion] is missing"));
        assert!(parse(&format!("motion = 3\n{HEAD}")).unwrap_err().to_string().contains("test.toml:1:10: `motion`"));
    }

    #[test]
    fn motions_out_of_reach_are_refused_with_their_time() {
        let model = crate::model::read(Path::new("../../models/irb360-6-1600.toml")).unwrap();
        assert!(parse(GOOD).unwrap().motion(&model).is_ok());
        let refused = |motion: &str| {
            let text = format!("{HEAD}[motion]\n{motion}");
            parse(&text).unwrap().motion(&model).unwrap_err().to_string()
        };
        let far = parse(&GOOD.replace("[0.0, 0.0,", "[0.9, 0.0,")).unwrap();
        assert!(far.motion(&model).unwrap_err().to_string().contains("cannot be reached"));
        let e = refused("kind = \"static_poses\"\nposes = [[0, 0, -1, 0], [1.5, 0, -1, 0]]\nhold = 0.5\nmove = 1\n");
        assert!(e.contains("cannot be reached at t = 1."), "{e}");
        let e = refused("kind = \"static_poses\"\nposes = [[0, 0, -1, 0], [0, 0, -1, 9]]\nhold = 0.5\nmove = 0.2\n");
        assert!(e.contains("rad/s of axis 4 at t = 0.5"), "{e}");
        let e = refused(
            "kind = \"constant_speed\"\naxis = 1\npose = [0, 0, -1, 0]\nbetween = [0, 2]\nspeeds = [1]\nacceleration = 9\n",
        );
        assert!(e.contains("arm 1"), "{e}");
        let e = refused(
            "kind = \"constant_speed\"\naxis = 4\npose = [3, 0, -1, 0]\nbetween = [0, 2]\nspeeds = [1]\nacceleration = 9\n",
        );
        assert!(e.contains("out of reach"), "{e}");
    }

    proptest! {
        #[test]
        fn damaged_files_are_read_or_refused_with_a_place(
            file in prop::sample::select(vec!["path", "pick-and-place", "constant-speed", "worn-sockets", "table"]),
            at in any::<prop::sample::Index>(),
            length in 0..30usize,
            put in prop::sample::select(vec!["", "nan", "-1", "1e300", "inf", "[", "\"\"", "9223372036854775807", "ψ", "\n"]),
        ) {
            let path = format!("../../scenarios/{file}.toml");
            let text: Vec<char> = std::fs::read_to_string(&path).unwrap().chars().collect();
            let at = at.index(text.len());
            let end = (at + length).min(text.len());
            let damaged: String = text[..at].iter().copied().chain(put.chars()).chain(text[end..].iter().copied()).collect();
            if let Err(e) = super::parse(&damaged, Path::new(&path)) {
                prop_assert!(e.to_string().starts_with(&format!("{path}:")), "{e}");
            }
        }
    }
}

//! TOML → [`Study`], with errors that state file, line, key, value and what was expected.

mod design;
mod factors;

use std::path::{Path, PathBuf};

use miette::Diagnostic;
use serde::Deserialize;
use thiserror::Error;
use toml::{Spanned, Table};

use self::factors::FactorKeys;
use super::factor::{Factor, Range};
use super::template::{SCENARIO, Template};
use super::{CAUSES, Design, Draws, Keep, Study};
use crate::kind::Kind;
use crate::outside::Access;
use crate::scenario::ScenarioError;
use crate::source::{Checked, Interval, Problem, Source};

/// Why a study was rejected.
#[derive(Debug, Error, Diagnostic)]
pub enum StudyError {
    /// The study's own file.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Own(ScenarioError),
    /// A scenario that the study names.
    #[error("{study}: its scenario is not valid")]
    Scenario {
        /// The study.
        study: String,
        /// The error in the scenario.
        #[source]
        #[diagnostic_source]
        source: ScenarioError,
    },
}

impl From<Problem> for StudyError {
    fn from(problem: Problem) -> Self {
        Self::Own(problem.into())
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    title: Option<String>,
    scenario: Option<Spanned<String>>,
    model: Option<Spanned<String>>,
    seed: Option<Spanned<i64>>,
    keep: Option<Spanned<KeepKeys>>,
    #[serde(default)]
    diagnose: bool,
    draws: Option<Spanned<String>>,
    margin: Option<Spanned<String>>,
    over: Option<Spanned<String>>,
    after_landing: Option<Spanned<f64>>,
    #[serde(default)]
    factors: Vec<Spanned<FactorKeys>>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum KeepKeys {
    Word(String),
    Runs(Vec<i64>),
    Other(serde::de::IgnoredAny),
}

/// Longest time for which a broken robot is followed after its load has landed, s.
const LONGEST_AFTER: f64 = 10.0;

/// Reads a study file; the scenarios that it names are relative to it, all other files to the scenario; `access` states
/// which they may be.
///
/// # Errors
/// The first error in the file or in a scenario that it names, with its position.
pub fn read(path: &Path, access: Access) -> Result<Study, StudyError> {
    let text = ScenarioError::text(path).map_err(StudyError::Own)?;
    parse(&text, path, access).map_err(|e| match e {
        StudyError::Own(own) => StudyError::Own(own.unless_other(Kind::Study, &text, path)),
        other => other,
    })
}

/// Reads a study from `text` like [`read`]; `path` is named in errors.
///
/// # Errors
/// As for [`read`].
pub fn parse(text: &str, path: &Path, access: Access) -> Result<Study, StudyError> {
    let file = &Source { access, ..Source::new(path.display(), text) };
    let (document, design) = file.document::<Document>("design")?;
    let factors = factors::factors(file, &document.factors)?;
    let Some(design) = design else {
        return Err(file.problem(0..0, "[design] is missing; expected how the factors are set".into()).into());
    };
    let design = design::design(file, design, &factors)?;
    let experiment = experiment(file, path, &document)?;
    let scenarios = match experiment {
        None => scenarios(file, path, &document, &factors)?,
        Some(_) => Vec::new(),
    };
    let seed = document.seed.as_ref().map_or(Ok(1), |seed| file.count("seed", seed, 0, i64::MAX))? as u64;
    let template = Template::read((&scenarios, experiment.as_deref()), access, &determining(text))
        .map_err(|source| StudyError::Scenario { study: path.display().to_string(), source })?;
    Ok(Study {
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        path: path.into(),
        text: text.into(),
        title: document.title,
        seed,
        keep: keep(file, &document.keep)?,
        diagnose: document.diagnose,
        draws: draws(file, &document.draws, &design)?,
        design,
        experiment,
        margin: margin(file, &document.margin)?,
        over: document.over.as_ref().map(|name| design::named(file, "over", name, &factors)).transpose()?,
        after_landing: file.maybe("after_landing", &document.after_landing, Interval(0.0, LONGEST_AFTER, "s"))?,
        factors,
        template,
    })
}

/// What of a study's file determines its rows.
fn determining(text: &str) -> Table {
    let mut table: Table = text.parse().unwrap_or_default();
    for key in ["title", "keep", "over", "seed"] {
        table.remove(key);
    }
    table
}

fn keep(file: &Source, keys: &Option<Spanned<KeepKeys>>) -> Checked<Keep> {
    let Some(keys) = keys else { return Ok(Keep::None) };
    let refuse = |found: &str| {
        let message = format!("`keep` is {found}; expected \"none\", \"failed\" or an array of numbers of runs");
        Err(file.problem(keys.span(), message))
    };
    match keys.get_ref() {
        KeepKeys::Word(word) if word == "none" => Ok(Keep::None),
        KeepKeys::Word(word) if word == "failed" => Ok(Keep::Failed),
        KeepKeys::Runs(runs) => {
            let numbers: Option<Vec<u64>> = runs.iter().map(|n| u64::try_from(*n).ok()).collect();
            numbers.map_or_else(|| refuse(&file.quote(keys.span())), |runs| Ok(Keep::Runs(runs)))
        }
        KeepKeys::Word(_) | KeepKeys::Other(_) => refuse(&file.quote(keys.span())),
    }
}

fn margin(file: &Source, word: &Option<Spanned<String>>) -> Checked<Option<usize>> {
    let causes = CAUSES.iter().enumerate().map(|(k, name)| (*name, Some(k)));
    let choices: Vec<(&str, Option<usize>)> = std::iter::once(("any", None)).chain(causes).collect();
    word.as_ref().map_or(Ok(None), |word| file.choice("margin", word, &choices))
}

fn draws(file: &Source, word: &Option<Spanned<String>>, design: &Design) -> Checked<Draws> {
    match word {
        Some(word) => file.choice("draws", word, &[("each", Draws::Each), ("same", Draws::Same)]),
        // Where combinations are compared, they are compared on the same machine.
        None => Ok(match design {
            Design::Grid { repeats: 1 }
            | Design::Boundary { repeats: 1, .. }
            | Design::Sensitivity { .. }
            | Design::WorstCase { .. } => Draws::Same,
            _ => Draws::Each,
        }),
    }
}

/// The model file of an experiment.
fn experiment(file: &Source, path: &Path, document: &Document) -> Checked<Option<PathBuf>> {
    let Some(name) = &document.model else { return Ok(None) };
    file.foreign("scenario", &document.scenario, "an experiment, which has a `model`")?;
    let target = path.parent().unwrap_or(Path::new("")).join(name.get_ref());
    file.may_name("model", name, &target)?;
    if target.is_file() {
        return Ok(Some(target));
    }
    let name_of = name.get_ref();
    let message = format!("`model` is \"{name_of}\", which is no file; expected a model, relative to the study");
    Err(file.problem(name.span(), message))
}

/// The scenario files: the one stated, or the levels of the factor with that key.
fn scenarios(file: &Source, path: &Path, document: &Document, factors: &[Factor]) -> Result<Vec<PathBuf>, StudyError> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let found = |name: &str, span: std::ops::Range<usize>| {
        let target = folder.join(name);
        let check = file.access.check(path, &target);
        check.map_err(|what| file.problem(span.clone(), format!("`scenario` is \"{name}\", which {what}")))?;
        if target.is_file() {
            return Ok(target);
        }
        let message = format!("`scenario` is \"{name}\", which is no file; expected a scenario, relative to the study");
        Err(file.problem(span, message))
    };
    let factor = factors.iter().position(|factor| factor.keys.iter().any(|key| key == SCENARIO));
    match (&document.scenario, factor) {
        (Some(name), None) => Ok(vec![found(name.get_ref(), name.span())?]),
        (None, Some(k)) => {
            let span = document.factors[k].span();
            let Range::Levels(levels) = &factors[k].range else {
                let message = format!("factor `{}` has no `levels`; expected names of scenarios", factors[k].name);
                return Err(file.problem(span, message).into());
            };
            levels.iter().map(|level| found(&level.text, span.clone()).map_err(Into::into)).collect()
        }
        (Some(name), Some(k)) => {
            let message = format!(
                "`scenario` stands beside factor `{}`, whose levels are scenarios; expected one of them",
                factors[k].name
            );
            Err(file.problem(name.span(), message).into())
        }
        (None, None) => Err(file
            .problem(0..0, "missing key `scenario`; expected a scenario file, or `model` for an experiment".into())
            .into()),
    }
}

/// Reads a study without meshes, for tests.
#[cfg(test)]
fn parsed(text: &str) -> Result<Study, StudyError> {
    parse(text, Path::new("../../scenarios/studies/test.toml"), Access::PLAIN)
}

#[cfg(test)]
mod tests {
    use super::super::Setting;
    use super::*;
    use deltatwin::identification::uncertainty::Uncertainty;

    const GOOD: &str = "scenario = \"../payload.toml\"\nseed = 4\n\n[design]\nkind = \"grid\"\n\n[[factors]]\nname = \
                        \"mass\"\nkey = \"payload.mass\"\nunit = \"kg\"\nfrom = 0.5\nto = 6.0\ncount = 12\n";

    fn refusal(from: &str, to: &str) -> String {
        assert!(GOOD.contains(from), "{from}");
        let error = parsed(&GOOD.replace(from, to)).map(|_| ()).unwrap_err();
        let cause = std::error::Error::source(&error).map_or(String::new(), |e| format!(": {e}"));
        format!("{error}{cause}")
    }

    #[test]
    fn factors_change_scenario_and_models() {
        let text = format!(
            "{GOOD}[[factors]]\nname = \"hold\"\nkey = \"model.sockets.dislocation_force\"\nchange = \"multiply\"\nlevels = \
             [0.5, 1]\n[[factors]]\nname = \"com\"\nkey = \"payload.com.x\"\nlevels = [0.1]\n[[factors]]\nname = \
             \"wear\"\nkey = [\"sockets.wear.7\", \"sockets.wear.8\"]\nlevels = [0.25]\n[[factors]]\nname = \
             \"speed\"\nkey = \"speed_scale\"\nlevels = [2.0]\n"
        );
        let study = parsed(&text).unwrap();
        assert_eq!((study.seed, &study.keep, study.draws), (4, &Keep::None, Draws::Same));
        let at = |k: usize| {
            [Setting::Number(3.5), Setting::Level(k), Setting::Level(0), Setting::Level(0), Setting::Level(0)]
        };
        let [weak, whole] = [0, 1].map(|k| study.files(&at(k), Some(99)).unwrap());
        assert_eq!(weak.scenario.setup.payload.mass, 3.5);
        assert_eq!(weak.scenario.setup.payload.com.as_slice(), [0.1, -0.02, -0.08]);
        assert_eq!(weak.scenario.seed, 99);
        assert_eq!(weak.scenario.duration, 10.0);
        assert_eq!(weak.scenario.sockets.wear[6..8], [0.25, 0.25]);
        assert_eq!(weak.scenario.sockets.wear[0], 0.0);
        assert_eq!(2.0 * weak.model.sockets.dislocation_force, whole.model.sockets.dislocation_force);
        // What is known at the machine does not follow the factor.
        let known = [&weak, &whole].map(|files| files.nominal.dislocation_force);
        assert_eq!(known, [whole.model.sockets.dislocation_force; 2]);
        assert_eq!(whole.controller_model.unwrap().name, weak.controller_model.unwrap().name);
        let wrong = study.files(&[Setting::Number(1e6)], None).map(|_| ()).unwrap_err();
        assert_eq!(wrong, "`payload.mass` is 1000000; expected a number from 0 to 100 kg");
    }

    #[test]
    fn machines_are_drawn_from_the_covariance_beside_their_model() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::copy("../../models/irb360-6-1600.toml", at("model.toml")).unwrap();
        let scenario = "model = \"model.toml\"\nduration = 0.2\n[motion]\nkind = \"path\"\nspeed = 1.0\n\
                        acceleration = 20.0\njerk = 2000.0\n\
                        waypoints = [[-0.1, 0.0, -0.95, 0.0], [0.1, 0.0, -0.95, 0.0]]\n";
        std::fs::write(at("scenario.toml"), scenario).unwrap();
        let study = "scenario = \"scenario.toml\"\n[design]\nkind = \"grid\"\n\
                     [[factors]]\nname = \"robot\"\nkey = \"model.drawn\"\nlevels = [0, 1, 2]\n\
                     [[factors]]\nname = \"friction\"\nkey = \"model.effects.drive_friction.viscous.1\"\n\
                     change = \"multiply\"\nlevels = [2]\n";
        std::fs::write(at("study.toml"), study).unwrap();
        let read = || super::read(&at("study.toml"), Access::PLAIN);
        let study = read().unwrap();
        let error = study.files(&[Setting::Level(1), Setting::Unset], None).err().unwrap();
        assert!(error.contains("model.covariance.csv") && error.contains("identify -o"), "{error}");
        let without = study.contents().len();

        let names = vec!["drive_friction.viscous_1".to_string()];
        let covariance = nalgebra::DMatrix::from_element(1, 1, 0.01);
        crate::model::uncertainty::write(&Uncertainty { names, covariance }, &at("model.toml")).unwrap();
        let study = read().unwrap();
        assert_eq!(study.contents().len(), without + 1, "the covariance counts for the digest");
        let friction = |robot: Setting, times: Setting| {
            let files = study.files(&[robot, times], None).unwrap();
            let own = files.model.effects.iter().find(|e| e.effect.name() == "drive_friction").unwrap().clone();
            own.values().block(1)[..2].to_vec()
        };
        let [itself, one, two] = [0, 1, 2].map(|k| friction(Setting::Level(k), Setting::Unset));
        assert_eq!(itself, friction(Setting::Unset, Setting::Unset));
        assert!(one[0] != itself[0] && one[0] != two[0] && one[1] == itself[1], "{itself:?} {one:?} {two:?}");
        assert!((one[0] - itself[0]).abs() < 0.5, "{itself:?} {one:?}");
        // Multiplied is the drawn machine's.
        assert_eq!(friction(Setting::Level(1), Setting::Level(0))[0], 2.0 * one[0]);
    }

    #[test]
    fn mistakes_are_named_with_line_and_value() {
        for (from, to, expected) in [
            ("../payload.toml", "../pyload.toml", "test.toml:1:12: `scenario` is \"../pyload.toml\", which is no file"),
            ("../payload.toml", "../../models/clavel-delta.toml", "its scenario is not valid: "),
            ("\"grid\"", "\"gird\"", "test.toml:5:8: `design.kind` is \"gird\"; expected \"grid\", "),
            ("\"grid\"", "\"gird\"", "did you mean \"grid\"?"),
            ("\"grid\"", "\"sobol\"", "kind = \"sobol\" lacks `design.runs`"),
            ("\"grid\"", "\"grid\"\nruns = 3", "test.toml:6:8: `design.runs` has no meaning for kind = \"grid\""),
            (
                "\"grid\"",
                "\"boundary\"\nalong = [\"maas\"]",
                "has \"maas\"; expected factors: mass; did you mean \"mass\"?",
            ),
            ("\"grid\"", "\"boundary\"\nalong = [\"mass\"]", "with `from` and `to` and no `count`"),
            ("\"grid\"", "\"subset\"", "factor `mass` has levels"),
            ("[design]", "[desing]", "unknown key `desing`"),
            ("count = 12", "count = 1", "`factors.count` is 1; expected a whole number from 2"),
            ("count = 12\n", "", "factor `mass` lacks `count`"),
            ("to = 6.0", "to = 0.5", "runs from 0.5 to 0.5"),
            ("to = 6.0\n", "", "lacks `factors.to`"),
            (
                "count = 12",
                "levels = [1]",
                "factor `mass` has `levels` and `from` and `to`; expected one of `levels`, `from` with `to`, or",
            ),
            ("from = 0.5\nto = 6.0\ncount = 12", "", "factor `mass` has no values; expected one of `levels`"),
            (
                "from = 0.5\nto = 6.0\ncount = 12",
                "distribution = { kind = \"normal\", mean = 1, sigma = -1 }",
                "`distribution.sigma` is -1; expected a number above 0, at most 1000000000000",
            ),
            ("seed = 4", "after_landing = -1.0", "`after_landing` is -1; expected a number from 0 to 10 s"),
            ("from = 0.5\nto = 6.0\ncount = 12", "levels = [1, \"a\"]", "expected numbers, or no numbers"),
            ("from = 0.5\nto = 6.0\ncount = 12", "levels = []", "has 0 value(s)"),
            (
                "from = 0.5\nto = 6.0\ncount = 12",
                "distribution = { kind = \"normal\", mean = 1 }",
                "lacks `distribution.sigma`",
            ),
            (
                "from = 0.5\nto = 6.0\ncount = 12",
                "distribution = { kind = \"uniform\", mean = 1, low = 0, high = 1 }",
                "`distribution.mean` has no meaning",
            ),
            (
                "from = 0.5\nto = 6.0\ncount = 12",
                "distribution = { kind = \"uniform\", low = 2, high = 1 }",
                "out of order",
            ),
            ("\"mass\"", "\"Masse 1\"", "`factors.name` is \"Masse 1\""),
            ("\"payload.mass\"", "3", "`factors.key` is 3"),
            ("seed = 4", "seed = -4", "`seed` is -4"),
            ("seed = 4", "keep = \"all\"", "`keep` is \"all\"; expected \"none\", \"failed\" or an array"),
            ("seed = 4", "draws = \"some\"", "`draws` is \"some\"; expected \"each\" or \"same\""),
            ("seed = 4", "margin = \"sockets\"", "`margin` is \"sockets\"; expected \"any\", \"socket\", "),
            ("unit = \"kg\"", "units = \"kg\"", "unknown key `factors.units`"),
        ] {
            let e = refusal(from, to);
            assert!(e.contains(expected), "{expected}\n{e}");
        }
        let twice = format!("{GOOD}{}", &GOOD[GOOD.find("[[factors]]").unwrap()..]);
        assert!(parsed(&twice).map(|_| ()).unwrap_err().to_string().contains("`mass` is there twice"));
    }

    #[test]
    fn contents_are_those_that_matter() {
        let of = |text: &str| parsed(text).unwrap().contents().to_vec();
        let good = of(GOOD);
        assert_eq!(good.len(), 4, "study, scenario and two models");
        assert_eq!(good, of(&format!("# A comment.\ntitle = \"x\"\nkeep = \"failed\"\nover = \"mass\"\n{GOOD}")));
        assert_eq!(good, of(&GOOD.replace("seed = 4", "seed = 5")), "the seed is added to the digest apart");
        assert_ne!(good, of(&GOOD.replace("count = 12", "count = 13")));
    }
}

//! Folder of a run: `result.json`, models, page.

use std::io::{self, Read};
use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr, miette};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

use crate::page::{self, Origin};
use crate::run::Analysis;
use crate::{Data, Inputs, Joined, add, compare, diagnose, gate};
use deltatwin::identification::Estimate;
use deltatwin::model::{Model, Provenance};
use deltatwin_io::file::{self, replace_text};
use deltatwin_io::model::shipped;
use deltatwin_io::recording::setup;

/// Version of the layout of `result.json`; a reader of version 1 reads every later file of version 1.
pub const SCHEMA_VERSION: u32 = 1;

/// Name of the file with all results.
pub const RESULT: &str = "result.json";
/// Name of the fitted model.
pub const IDENTIFIED: &str = "identified.toml";
/// Name of the model with the effects added.
pub const MODEL: &str = "model.toml";
/// Name of the figure of the errors before and after.
pub const ERRORS: &str = "errors.svg";
/// Name of the page.
pub const PAGE: &str = "report.html";

/// A file that went into a run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Input {
    /// `model`, `data`, `held_out`, `setup`, or what else a command reads, as `later model`.
    pub role: &'static str,
    /// The file as given.
    pub file: PathBuf,
    /// SHA-256 of its content, hexadecimal.
    pub sha256: String,
    /// Its size.
    pub bytes: u64,
}

impl Input {
    /// A file or a shipped model with its hash; of a bag's folder the hash of its files in order of their names.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn of(role: &'static str, file: &Path) -> io::Result<Self> {
        let mut hasher = Sha256::new();
        let bytes = if file.is_dir() {
            let mut files: Vec<PathBuf> =
                std::fs::read_dir(file)?.map(|entry| entry.map(|e| e.path())).collect::<io::Result<_>>()?;
            files.sort();
            files.iter().filter(|f| f.is_file()).map(|f| hash(f, &mut hasher)).sum::<io::Result<u64>>()?
        } else if let Some(text) = shipped::named(file) {
            hasher.update(text);
            text.len() as u64
        } else {
            hash(file, &mut hasher)?
        };
        Ok(Self { role, file: file.into(), sha256: hexadecimal(hasher), bytes })
    }

    /// All files of a run with their hashes: model, recordings, and the setups that were read with them.
    ///
    /// # Errors
    /// If one cannot be read; the message names it.
    pub fn all(model: Option<&Path>, inputs: &Inputs) -> miette::Result<Vec<Self>> {
        let mut files: Vec<(&'static str, PathBuf)> = model.iter().map(|file| ("model", file.to_path_buf())).collect();
        files.extend(inputs.data.iter().map(|file| ("data", file.clone())));
        files.extend(inputs.held_out.iter().map(|file| ("held_out", file.clone())));
        match &inputs.setup {
            Some(file) => files.push(("setup", file.clone())),
            None => {
                let beside = inputs.data.iter().chain(&inputs.held_out).map(|file| setup::sidecar(file));
                files.extend(beside.filter(|file| file.is_file()).map(|file| ("setup", file)));
            }
        }
        let named = |(role, file): &(&'static str, PathBuf)| {
            Self::of(role, file).into_diagnostic().wrap_err_with(|| format!("{}: cannot be read", file.display()))
        };
        files.iter().map(named).collect()
    }

    fn json(&self) -> Value {
        json!({"role": self.role, "file": self.file.display().to_string(), "sha256": self.sha256, "bytes": self.bytes})
    }
}

/// SHA-256 of a text, hexadecimal.
pub fn sha256(text: &str) -> String {
    hexadecimal(Sha256::new_with_prefix(text))
}

fn hexadecimal(hasher: Sha256) -> String {
    hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Adds the content of a file to a hash; returns its size.
fn hash(file: &Path, hasher: &mut Sha256) -> io::Result<u64> {
    let mut reader = std::fs::File::open(file)?;
    let mut buffer = vec![0; 1 << 16];
    let mut size = 0;
    loop {
        match reader.read(&mut buffer)? {
            0 => return Ok(size),
            n => {
                hasher.update(&buffer[..n]);
                size += n as u64;
            }
        }
    }
}

/// Checks that the folder of a run may be and can be written: it is empty or does not exist, or is overwritten on purpose.
///
/// # Errors
/// If it holds results and `force` is not set, is a file, or cannot be created or written.
pub fn check(folder: &Path, force: bool) -> miette::Result<()> {
    if folder.exists() && !folder.is_dir() {
        return Err(miette!("{}: is a file; expected a folder", folder.display()));
    }
    let there = [RESULT, IDENTIFIED, MODEL, PAGE].into_iter().map(|name| folder.join(name)).find(|f| f.exists());
    match there {
        Some(file) if !force => {
            Err(miette!("{}: exists; expected another folder, or --force to replace its results", file.display()))
        }
        _ => file::check_folder(folder)
            .map_err(|reason| miette!("{}: cannot be written: {reason}; expected a folder", folder.display())),
    }
}

/// All results of a run as one JSON object; `origin` has the command, the date and the inputs.
pub fn result(analysis: &Analysis, origin: &Origin) -> Value {
    let mut object = Map::new();
    object.insert("schema".into(), "deltatwin/result".into());
    object.insert("schema_version".into(), SCHEMA_VERSION.into());
    object.insert("program".into(), json!({"name": "deltatwin", "version": origin.version}));
    object.insert("command".into(), json!(origin.command));
    object.insert("date".into(), json!(origin.date));
    object.insert("inputs".into(), origin.inputs.iter().map(Input::json).collect());
    object.insert("warnings".into(), origin.warnings.iter().chain(&analysis.warnings).map(|w| json!(w)).collect());
    object.insert("zeros".into(), analysis.zeros.iter().map(Joined::json).collect());
    object.insert("cut".into(), analysis.cut.iter().map(|stage| json!(stage.to_string())).collect());
    let d = &analysis.diagnosis;
    let (fitted, model) = (Path::new(IDENTIFIED), Path::new(MODEL));
    let stages = json!({
        "check": {"good": true, "gate": gate::json(&analysis.gate)},
        "identify": analysis.identification.json(Some(fitted)),
        "compare": {
            "delivered": compare::json(&analysis.delivered, &analysis.gate),
            "identified": compare::json(&analysis.identified, &analysis.gate),
        },
        "diagnose": diagnose::json(d, Some(model), None),
        "add": add::of_diagnosis(d, Some(model)),
    });
    object.insert("stages".into(), stages);
    object.insert("files".into(), json!({"identified": IDENTIFIED, "model": MODEL, "errors": ERRORS, "report": PAGE}));
    Value::Object(object)
}

/// Writes the results of a run of `model` into `folder`, which is created: models, page and, last, `result.json`; returns
/// the files. A folder without `result.json` is of a run that did not end.
///
/// # Errors
/// If a file cannot be written, or the page's models cannot follow the recording; the message names the file.
pub fn write(
    folder: &Path,
    analysis: &Analysis,
    model: &Model,
    data: &Data,
    origin: &Origin,
) -> miette::Result<Vec<PathBuf>> {
    std::fs::create_dir_all(folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("{}: cannot be created", folder.display()))?;
    let provenance = |parameters: &[Estimate]| {
        let recordings = origin.inputs.iter().filter(|i| i.role == "data").map(|i| i.file.display().to_string());
        let errors = parameters.iter().map(|p| (p.name.clone(), p.std));
        Provenance::new(&origin.stage, origin.date.clone(), recordings.collect(), errors)
    };
    let mut files = Vec::new();
    let mut named = |name: &str| {
        files.push(folder.join(name));
        folder.join(name)
    };
    let fitted = &analysis.identification.fitted;
    deltatwin_io::model::write_fitted(&fitted.model, &named(IDENTIFIED), &provenance(&fitted.parameters))?;
    let d = &analysis.diagnosis;
    deltatwin_io::model::write_fitted(&d.model, &named(MODEL), &provenance(&d.parameters[1]))?;
    let errors = page::errors_figure(analysis);
    replace_text(&named(ERRORS), errors.svg())
        .into_diagnostic()
        .wrap_err_with(|| format!("{}: cannot be written", folder.join(ERRORS).display()))?;
    let page = page::of_run(analysis, model, data, origin).into_diagnostic()?;
    page.write(named(PAGE)).into_diagnostic()?;
    let text = format!("{:#}\n", result(analysis, origin));
    replace_text(&named(RESULT), &text)
        .into_diagnostic()
        .wrap_err_with(|| format!("{}: cannot be written", folder.join(RESULT).display()))?;
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_that_of_the_content() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("abc");
        std::fs::write(&file, "abc").unwrap();
        let input = Input::of("data", &file).unwrap();
        // FIPS 180-4, example of one block.
        assert_eq!(input.sha256, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert_eq!(input.bytes, 3);
        // A bag's folder of that file alone has the same content.
        assert_eq!(Input::of("data", folder.path()).unwrap().sha256, input.sha256);
        assert_eq!(sha256("abc"), input.sha256);
        assert!(Input::of("data", &folder.path().join("none")).is_err());
    }

    #[test]
    fn results_are_not_replaced_by_accident() {
        let folder = tempfile::tempdir().unwrap();
        assert!(check(folder.path(), false).is_ok() && check(&folder.path().join("new"), false).is_ok());
        std::fs::write(folder.path().join(RESULT), "{}").unwrap();
        assert!(check(folder.path(), false).unwrap_err().to_string().contains("--force"));
        assert!(check(folder.path(), true).is_ok());
        assert!(check(&folder.path().join(RESULT), true).is_err());
    }
}

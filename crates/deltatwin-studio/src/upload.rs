//! Files that come in: bounded in size, under harmless names, and kept only if they are recordings, models or setups.

use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};

use deltatwin_io::kind::{Kind, kind};
use deltatwin_io::recording::{self, Reading};
use deltatwin_io::{file, model};
use miette::{IntoDiagnostic, miette};

use crate::session::private;

/// Largest size of a file, bytes.
pub const MOST_BYTES: u64 = 512 << 20;

/// Largest number of characters of a name.
const LONGEST: usize = 80;

/// What makes a folder a bag, and the largest number of its files.
const METADATA: &str = "metadata.yaml";
const MOST_PARTS: usize = 1000;

/// Beginning of the names of folders in which files are judged.
const INCOMING: &str = ".incoming-";

/// A file that was kept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Kept {
    /// A recording, with its file relative to the session.
    Recording(String),
    /// A model.
    Model(String),
    /// The setup of a recording.
    Setup(String),
}

/// A file name of letters, digits, `.`, `-` and `_` that stays in its folder and is not hidden, made from any text.
pub fn safe_name(name: &str) -> String {
    let last = name.rsplit(['/', '\\']).next().unwrap_or_default();
    let plain = |c: char| if c.is_ascii_alphanumeric() || ".-_".contains(c) { c } else { '_' };
    let text: String = last.chars().map(plain).collect();
    let text = text.trim_start_matches(['.', '-']);
    let cut = text.len().saturating_sub(LONGEST);
    let text = text[cut..].trim_start_matches(['.', '-']);
    if text.is_empty() { "file".into() } else { text.into() }
}

/// Keeps the file called `name` with the content of `source` in `folder` if it can be used.
///
/// # Errors
/// If it is larger than [`MOST_BYTES`], cannot be read as a recording, model or setup, or not be written; the folder is
/// then as before.
pub fn keep(folder: &Path, name: &str, source: &mut dyn Read) -> miette::Result<Kept> {
    let safe = safe_name(name);
    let is_toml = Path::new(&safe).extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let is_setup = safe.to_ascii_lowercase().ends_with(".setup.toml");
    let place = if is_toml && !is_setup { "models" } else { "data" };
    // It is judged under its own ending, in a folder of its own that goes away with it.
    let trial = Trial::new(folder)?;
    let trial_file = trial.folder.join(&safe);
    receive(&trial_file, &safe, source)?;
    let found = judge(&trial_file, &safe)?;
    place_of(folder, place, &safe, &trial_file).map(found)
}

/// A folder in a session in which files are judged, and which goes away with this value.
pub struct Trial {
    /// The folder.
    pub folder: PathBuf,
}

impl Trial {
    /// A new one in the folder of a session.
    ///
    /// # Errors
    /// If it cannot be created.
    pub fn new(session: &Path) -> miette::Result<Self> {
        let folder = session.join(format!("{INCOMING}{}", unique()?));
        private(&folder).into_diagnostic()?;
        Ok(Self { folder })
    }
}

impl Drop for Trial {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

/// Keeps the files of a ROS 2 bag in a folder called `name`: their names and sizes in the order in which `source` holds
/// them one after the other.
///
/// # Errors
/// As for [`keep`]; and if it has no `metadata.yaml`, or names that are not plain or come twice.
pub fn keep_bag(folder: &Path, name: &str, parts: &[(String, u64)], source: &mut dyn Read) -> miette::Result<Kept> {
    let safe = safe_name(name);
    let names: BTreeSet<&str> = parts.iter().map(|(part, _)| part.as_str()).collect();
    let is_bag = parts.iter().all(|(part, _)| safe_name(part) == *part) && names.len() == parts.len();
    if !is_bag || !names.contains(METADATA) || parts.len() > MOST_PARTS {
        return Err(miette!("{safe}: is no bag; expected a folder with {METADATA} and the files it lists"));
    }
    if parts.iter().fold(0, |sum: u64, (_, size)| sum.saturating_add(*size)) > MOST_BYTES {
        return Err(miette!(
            "{safe}: larger than {} MB; expected a smaller bag, or the command line",
            MOST_BYTES >> 20
        ));
    }
    let trial = Trial::new(folder)?;
    let bag = trial.folder.join(&safe);
    private(&bag).into_diagnostic()?;
    parts.iter().try_for_each(|(part, size)| receive(&bag.join(part), part, &mut source.take(*size)))?;
    let renamed = |e: recording::ReadError| miette!("{}", e.to_string().replace(&bag.display().to_string(), &safe));
    recording::read(&bag, None).map_err(renamed)?;
    place_of(folder, "data", &safe, &bag).map(Kept::Recording)
}

/// Removes what uploads left that a killed server did not end.
pub fn clean(folder: &Path) {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for entry in entries.filter(|e| e.file_name().to_string_lossy().starts_with(INCOMING)) {
        let _ = std::fs::remove_dir_all(entry.path());
    }
}

fn unique() -> miette::Result<String> {
    let mut bytes = [0; 6];
    getrandom::fill(&mut bytes).map_err(|e| miette!("no random number: {e}"))?;
    Ok(bytes.iter().map(|b| format!("{b:02x}")).collect())
}

fn receive(path: &Path, name: &str, source: &mut dyn Read) -> miette::Result<()> {
    let mut too_large = false;
    file::replace(path, |out| {
        let copied = std::io::copy(&mut source.take(MOST_BYTES + 1), out)?;
        too_large = copied > MOST_BYTES;
        Ok::<(), std::io::Error>(())
    })
    .into_diagnostic()?;
    if too_large {
        return Err(miette!(
            "{name}: larger than {} MB; expected a smaller file, or the command line",
            MOST_BYTES >> 20
        ));
    }
    Ok(())
}

/// What the file is, if it can be used; errors name it as it was called.
fn judge(path: &Path, name: &str) -> miette::Result<fn(String) -> Kept> {
    let renamed = |text: String| text.replace(&path.display().to_string(), name);
    match kind(path).map_err(|e| miette!("{}", renamed(e.to_string())))? {
        Kind::Model => {
            model::read(path).map_err(|e| miette!("{}", renamed(chain(&e))))?;
            Ok(Kept::Model)
        }
        Kind::Setup => {
            recording::setup::read(path).map_err(|e| miette!("{}", renamed(e.to_string())))?;
            Ok(Kept::Setup)
        }
        Kind::Recording => {
            let table = recording::preview(path, &Reading::default()).map(|p| p.rows > 0 && p.columns.len() > 1);
            let is_table = table.unwrap_or(false);
            let as_bag = || recording::read(path, None).map(drop).map_err(|e| miette!("{}", renamed(e.to_string())));
            if !is_table {
                as_bag()?;
            }
            Ok(Kept::Recording)
        }
        other => Err(miette!("{name}: is a {other}; expected a recording, a model or a setup")),
    }
}

/// An error with its causes.
fn chain(error: &miette::Report) -> String {
    error.chain().map(ToString::to_string).collect::<Vec<_>>().join(": ")
}

/// Moves the file into its place, under another name if there is another file of that name; returns it relative to
/// `folder`.
fn place_of(folder: &Path, place: &str, name: &str, from: &Path) -> miette::Result<String> {
    private(&folder.join(place)).into_diagnostic()?;
    let (stem, ending) = match name.split_once('.') {
        Some((stem, ending)) => (stem.to_string(), format!(".{ending}")),
        None => (name.to_string(), String::new()),
    };
    for k in 1..1000 {
        let tried = if k == 1 { name.to_string() } else { format!("{stem}-{k}{ending}") };
        let target: PathBuf = folder.join(place).join(&tried);
        if target.exists() {
            if same(&target, from) {
                return Ok(format!("{place}/{tried}"));
            }
            continue;
        }
        std::fs::rename(from, &target).into_diagnostic()?;
        return Ok(format!("{place}/{tried}"));
    }
    Err(miette!("{name}: there are too many files of this name"))
}

/// Whether two files, or two folders of files, have the same content.
fn same(a: &Path, b: &Path) -> bool {
    if a.is_dir() || b.is_dir() {
        let names = |folder: &Path| -> Option<BTreeSet<_>> {
            std::fs::read_dir(folder).ok()?.map(|entry| Some(entry.ok()?.file_name())).collect()
        };
        let (own, other) = (names(a), names(b));
        return own.is_some() && own == other && own.iter().flatten().all(|name| same(&a.join(name), &b.join(name)));
    }
    let size = |p: &Path| std::fs::metadata(p).map(|m| m.len()).ok();
    size(a) == size(b) && std::fs::read(a).ok() == std::fs::read(b).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_their_folder() {
        for (name, safe) in [
            ("run.csv", "run.csv"),
            ("../../etc/passwd", "passwd"),
            ("..\\..\\boot.ini", "boot.ini"),
            (".bashrc", "bashrc"),
            ("--force", "force"),
            ("", "file"),
            ("..", "file"),
            ("<img src=x onerror=alert(1)>.csv", "_img_src_x_onerror_alert_1__.csv"),
            ("a\0b\n.csv", "a_b_.csv"),
        ] {
            assert_eq!(safe_name(name), safe, "{name:?}");
        }
        let long = format!("{}.csv", "x".repeat(500));
        assert!(safe_name(&long).len() <= LONGEST && safe_name(&long).ends_with(".csv"));
    }

    #[test]
    fn what_cannot_be_used_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let bad: [(&str, &[u8]); 5] = [
            ("noise.bin", &[0, 159, 146, 150, 0, 1, 2]),
            ("empty.csv", b""),
            ("page.html", b"<script>alert(1)</script>"),
            ("model.toml", b"[geometry]\narm_length = \"long\"\n"),
            ("cut.mcap", b"\x89MCAP0\r\n"),
        ];
        for (name, content) in bad {
            let refused = keep(folder.path(), name, &mut &content[..]);
            assert!(refused.is_err(), "{name}");
            assert!(!refused.unwrap_err().to_string().contains(INCOMING), "{name}");
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
    }

    #[test]
    fn a_table_is_kept_once() {
        let folder = tempfile::tempdir().unwrap();
        let text = b"t,a,b\n0,1,2\n0.1,2,3\n";
        let kept = |text: &[u8]| keep(folder.path(), "../x/run.csv", &mut &text[..]).unwrap();
        assert_eq!(kept(text), Kept::Recording("data/run.csv".into()));
        assert_eq!(kept(text), Kept::Recording("data/run.csv".into()));
        assert_eq!(kept(b"t,a\n0,1\n1,2\n"), Kept::Recording("data/run-2.csv".into()));
        assert_eq!(std::fs::read(folder.path().join("data/run.csv")).unwrap(), text);
    }
}

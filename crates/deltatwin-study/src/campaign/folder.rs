//! The folder of a campaign: its parts, its table, and how they are written.

use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Read, Seek, Write};
use std::path::{Path, PathBuf};

use super::chunk::Chunk;
use super::digest::Digest;
use super::error::{CampaignError, short};
use super::parquet::{Reader, Writer};
use super::table::Heading;

/// Name of the merged table in a campaign's folder.
pub const TABLE: &str = "runs.parquet";
/// Folder of the parts in a campaign's folder.
pub(super) const PARTS: &str = "parts";
/// File in the folder of the parts that states to which campaign they belong, from before the first run.
const OWNER: &str = ".study";
/// Keys of the metadata of parts and tables.
const NAME: &str = "name";
const DIGEST: &str = "digest";
const BUILD_KEY: &str = "build";
pub(super) const FIRST: &str = "first_run";

/// This build of deltatwin: SHA-256 of all sources on which rows depend.
///
/// It is the same for the program and the Python package, on every machine, if they are built from the same sources.
pub const BUILD: &str = env!("DELTATWIN_BUILD");

/// A campaign: runs 0 to `runs`, one row each, in a folder.
pub struct Campaign {
    /// Name for messages.
    pub name: String,
    /// Folder of the parts and the table.
    pub folder: PathBuf,
    /// Digest of all that determines the rows, besides the program.
    pub digest: Digest,
    /// The build that makes the rows: [`BUILD`].
    pub build: String,
    /// Headings of the rows.
    pub headings: Vec<Heading>,
    /// Further metadata of the table.
    pub metadata: Vec<(String, String)>,
}

/// What a folder holds of a campaign.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    /// Nothing, or parts.
    Open,
    /// The whole table.
    Table,
}

impl Campaign {
    /// The merged table.
    pub fn table(&self) -> PathBuf {
        self.folder.join(TABLE)
    }

    /// The part of a chunk.
    pub fn part(&self, chunk: Chunk) -> PathBuf {
        self.folder.join(PARTS).join(format!("{}.parquet", chunk.stem()))
    }

    pub(super) fn journal(&self, chunk: Chunk) -> PathBuf {
        self.folder.join(PARTS).join(format!(".{}.journal", chunk.stem()))
    }

    /// What the folder holds of this campaign.
    ///
    /// # Errors
    /// If its table is of another campaign, made by another build, or cannot be read.
    pub fn held(&self) -> Result<Held, CampaignError> {
        let table = self.table();
        if !table.is_file() {
            return Ok(Held::Open);
        }
        self.own(&table)?;
        Ok(Held::Table)
    }

    /// Takes the folder for this campaign before the first run: what stands there stays, and must be its own.
    ///
    /// # Errors
    /// If table, parts or owner of the folder are of another campaign or of another build, or it cannot be written.
    pub fn claim(&self) -> Result<(), CampaignError> {
        self.held()?;
        let folder = self.folder.join(PARTS);
        std::fs::create_dir_all(&folder).map_err(CampaignError::io(&folder))?;
        let path = folder.join(OWNER);
        let open = || -> io::Result<(File, String)> {
            let mut file = OpenOptions::new().read(true).write(true).create(true).truncate(false).open(&path)?;
            // Of two campaigns that begin at once, one is the first.
            file.lock()?;
            let mut text = String::new();
            file.read_to_string(&mut text)?;
            Ok((file, text))
        };
        let (mut file, text) = open().map_err(CampaignError::io(&path))?;
        if let Ok(owner) = serde_json::from_str::<serde_json::Value>(&text) {
            let entry = |name: &str| owner[name].as_str().unwrap_or_default();
            return self.same(&path, &entry);
        }
        // Not claimed yet, or torn by a kill before the first run.
        self.parts()?;
        if let Some(journal) = self.journals()?.into_iter().next() {
            let (found, expected) = ("that wrote no owner".into(), self.build.clone());
            return Err(CampaignError::OtherBuild { file: journal, found, expected });
        }
        let owner = serde_json::json!({ NAME: self.name, DIGEST: self.digest.hex(), BUILD_KEY: self.build });
        let mut write = || -> io::Result<()> {
            file.set_len(0)?;
            file.rewind()?;
            writeln!(file, "{owner}")?;
            file.sync_all()
        };
        write().map_err(CampaignError::io(&path))
    }

    /// Journals in the folder, of whatever campaign.
    fn journals(&self) -> Result<Vec<PathBuf>, CampaignError> {
        let folder = self.folder.join(PARTS);
        let entries = std::fs::read_dir(&folder).map_err(CampaignError::io(&folder))?;
        let files = entries.map(|entry| entry.map(|entry| entry.path()).map_err(CampaignError::io(&folder)));
        let is_journal = |file: &Result<PathBuf, _>| {
            file.as_ref().map_or(true, |file| file.extension().is_some_and(|e| e == "journal"))
        };
        files.filter(is_journal).collect()
    }

    /// Whether `file`, whose metadata are `entry`, is of this campaign, made by this build.
    fn same<'a>(&self, file: &Path, entry: &dyn Fn(&str) -> &'a str) -> Result<(), CampaignError> {
        let digest = self.digest.hex();
        if entry(DIGEST) != digest {
            let [found, expected] = [(entry(NAME), entry(DIGEST)), (self.name.as_str(), digest.as_str())].map(named);
            return Err(CampaignError::Foreign { file: file.into(), found, expected });
        }
        if entry(BUILD_KEY) != self.build {
            let (found, expected) = (entry(BUILD_KEY).into(), self.build.clone());
            return Err(CampaignError::OtherBuild { file: file.into(), found, expected });
        }
        Ok(())
    }

    /// A table of this campaign, made by this build.
    pub(super) fn own(&self, file: &Path) -> Result<Reader, CampaignError> {
        let reader = Reader::open(file).map_err(CampaignError::content(file))?;
        let entry = |name: &str| reader.metadata().iter().find(|(key, _)| key == name).map_or("", |(_, value)| value);
        self.same(file, &entry)?;
        if reader.headings() != self.headings {
            let (found, expected) = (entry(BUILD_KEY).into(), self.build.clone());
            return Err(CampaignError::OtherBuild { file: file.into(), found, expected });
        }
        Ok(reader)
    }

    /// Removes table, parts and journals, of whatever campaign.
    ///
    /// # Errors
    /// If they cannot be removed.
    pub fn clear(&self) -> Result<(), CampaignError> {
        let parts = self.folder.join(PARTS);
        for (path, there) in [(self.table(), self.table().is_file()), (parts.clone(), parts.is_dir())] {
            if there {
                let gone = if path.is_dir() { std::fs::remove_dir_all(&path) } else { std::fs::remove_file(&path) };
                gone.map_err(CampaignError::io(&path))?;
            }
        }
        Ok(())
    }

    /// Removes the parts, which the table holds.
    ///
    /// # Errors
    /// If they cannot be removed.
    pub fn remove_parts(&self) -> Result<(), CampaignError> {
        let parts = self.folder.join(PARTS);
        if parts.is_dir() && self.table().is_file() {
            std::fs::remove_dir_all(&parts).map_err(CampaignError::io(&parts))?;
        }
        Ok(())
    }

    /// Writes a table under a temporary name, forces it to the disk and gives it its name.
    pub(super) fn write(
        &self,
        file: &Path,
        metadata: &[(String, String)],
        rows: impl FnOnce(&mut Writer<&mut BufWriter<File>>) -> Result<(), CampaignError>,
    ) -> Result<(), CampaignError> {
        let folder = file.parent().unwrap_or(&self.folder);
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        // One name per table, so that no kill leaves more than one file, which the next attempt takes.
        let temporary = folder.join(format!(".{name}.writing"));
        let mut out = BufWriter::new(File::create(&temporary).map_err(CampaignError::io(&temporary))?);
        let mut all = self.metadata.clone();
        all.push((NAME.into(), self.name.clone()));
        all.push((DIGEST.into(), self.digest.hex()));
        all.push((BUILD_KEY.into(), self.build.clone()));
        all.extend(metadata.iter().cloned());
        let mut writer = Writer::new(&mut out, &self.headings, &all).map_err(CampaignError::content(&temporary))?;
        rows(&mut writer)?;
        writer.finish().map_err(CampaignError::content(&temporary))?;
        let kept = || -> io::Result<()> {
            out.flush()?;
            out.get_ref().sync_all()?;
            std::fs::rename(&temporary, file)?;
            // The name is on the disk once the folder is.
            if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
        };
        let mut kept = kept;
        kept().map_err(CampaignError::io(file))
    }
}

/// A campaign by name and digest.
fn named((name, digest): (&str, &str)) -> String {
    let name = if name.is_empty() { "without a name" } else { name };
    format!("{name} (digest {})", short(digest))
}

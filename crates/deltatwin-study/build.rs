//! Names the build by a digest of all sources on which the rows of a study depend.
//!
//! The digest is that of the files alone: neither folder, compiler, profile nor clock counts, so that the program, the
//! Python package and every node of a cluster that were built from the same sources have the same one.

use std::path::{Path, PathBuf};
use std::{env, fs, io};

use sha2::{Digest, Sha256};

/// Sources, relative to this crate: the library, contacts, files, studies, what experiments diagnose, and the versions of
/// all dependencies.
const SOURCES: [&str; 7] = [
    "../../src",
    "../../Cargo.lock",
    "../deltatwin-cell/src",
    "../deltatwin-io/src",
    "../deltatwin-analysis/src",
    "../deltatwin-validation/src",
    "src",
];

fn main() -> io::Result<()> {
    let here = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    let mut hash = Sha256::new();
    for source in SOURCES {
        let path = here.join(source);
        // A crate from a registry stands alone; its version then names the rest.
        if path.exists() {
            println!("cargo::rerun-if-changed={}", path.display());
            add(&mut hash, &path, source)?;
        }
    }
    hash.update(env::var("CARGO_PKG_VERSION").unwrap_or_default());
    let digest: String = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
    println!("cargo::rustc-env=DELTATWIN_BUILD={digest}");
    Ok(())
}

/// Adds a file, or the files of a folder in the order of their names, with `name`; the ends of lines do not count.
fn add(hash: &mut Sha256, path: &Path, name: &str) -> io::Result<()> {
    if path.is_dir() {
        let mut inside: Vec<_> = fs::read_dir(path)?.map(|entry| Ok(entry?.file_name())).collect::<io::Result<_>>()?;
        inside.sort();
        return inside.iter().try_for_each(|file| {
            let name = format!("{name}/{}", file.to_string_lossy());
            add(hash, &path.join(file), &name)
        });
    }
    let content: Vec<u8> = fs::read(path)?.into_iter().filter(|byte| *byte != b'\r').collect();
    for bytes in [name.as_bytes(), &content] {
        hash.update((bytes.len() as u64).to_le_bytes());
        hash.update(bytes);
    }
    Ok(())
}

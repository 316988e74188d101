//! Data flow one way: a folder of the library uses those above it in `lib.rs`, and the library knows no file, no command
//! line, no picture, no viewer, no contact solver and no clock.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::common::shipped;

/// Crates that only those around the library may use.
const OUTSIDE: &[&str] = &[
    "clap",
    "clap_complete",
    "clap_mangen",
    "csv",
    "ctrlc",
    "hyper",
    "indicatif",
    "mcap",
    "mesh-loader",
    "miette",
    "parquet",
    "parry3d",
    "plotters",
    "rapier3d",
    "rerun",
    "rumqttc-v4-next",
    "rusqlite",
    "serde",
    "serde_json",
    "tempfile",
    "textwrap",
    "tokio",
    "toml",
    "toml_edit",
    "yaml-rust2",
];

/// Crates that one of those around the library alone uses, and which one.
const ALONE: &[(&str, &str)] = &[
    ("csv", "deltatwin-io"),
    ("hyper", "deltatwin-studio"),
    ("mcap", "deltatwin-io"),
    ("mesh-loader", "deltatwin-cell"),
    ("parquet", "deltatwin-study"),
    ("parry3d", "deltatwin-cell"),
    ("rapier3d", "deltatwin-cell"),
    ("rumqttc-v4-next", "deltatwin-watch"),
    ("rusqlite", "deltatwin-io"),
    ("rustls", "deltatwin-watch"),
    ("toml", "deltatwin-io"),
    ("toml_edit", "deltatwin-io"),
    ("yaml-rust2", "deltatwin-io"),
];

/// What only the crates around the library do: print, open files, look at the clock.
const NOT_HERE: [&str; 9] = [
    "println!(",
    "print!(",
    "eprintln!(",
    "std::fs",
    "File::",
    "is_file()",
    "canonicalize()",
    "std::time",
    "SystemTime",
];

/// Numbers of limbs, struts, sockets and axes that only `src/machine` knows: others use the types and ranges of its layout.
const SIZES: [&str; 6] = ["AXES", "ARMS", "STRUTS", "MAX_LIMBS", "MAX_STRUTS", "MAX_SOCKETS"];

/// Files of unit tests.
fn is_test(file: &Path) -> bool {
    file.file_stem().is_some_and(|s| s == "tests" || s == "testing")
        || file.starts_with(shipped("src/evidence/campaign"))
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Code without its unit tests, which may use everything.
fn product(text: &str) -> &str {
    text.split("#[cfg(test)]\nmod tests {").next().unwrap_or(text)
}

#[test]
fn folders_use_those_above_them() {
    let lib = std::fs::read_to_string(shipped("src/lib.rs")).expect("a file");
    let order: Vec<&str> =
        lib.lines().filter_map(|l| l.strip_prefix("pub mod ")).map(|l| l.trim_end_matches(';')).collect();
    assert!(order.len() > 10, "{order:?}");
    let place = |name: &str| order.iter().position(|m| *m == name);
    let mut files = Vec::new();
    sources(&shipped("src"), &mut files);
    let (mut upstream, mut edges) = (BTreeSet::new(), 0);
    for file in files {
        let inside = file.strip_prefix(shipped("src")).expect("below src");
        let folder = inside.iter().next().expect("a name").to_string_lossy();
        let Some(own) = place(folder.trim_end_matches(".rs")) else { continue };
        let text = std::fs::read_to_string(&file).expect("a file");
        for used in product(&text).split("crate::").skip(1).filter(|_| !is_test(&file)) {
            let name: String = used.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
            edges += 1;
            if place(&name).is_some_and(|there| there > own) {
                upstream.insert((order[own].to_string(), name));
            }
        }
    }
    assert!(edges > 500, "{edges}");
    assert!(upstream.is_empty(), "{upstream:?}");
}

#[test]
fn the_library_stands_alone() {
    let manifest: toml::Table = std::fs::read_to_string(shipped("Cargo.toml")).expect("a file").parse().expect("TOML");
    let used = manifest["dependencies"].as_table().expect("a table");
    let wrong: Vec<&&str> = OUTSIDE.iter().filter(|name| used.contains_key(**name)).collect();
    assert!(wrong.is_empty() && used.len() > 5, "{wrong:?}");
    let mut files = Vec::new();
    sources(&shipped("src"), &mut files);
    for file in files.iter().filter(|f| !is_test(f)) {
        let text = std::fs::read_to_string(file).expect("a file");
        for word in NOT_HERE {
            assert!(!product(&text).contains(word), "{}: {word}", file.display());
        }
    }
}

#[test]
fn contacts_and_formats_of_files_are_known_to_one_crate_each() {
    let mut users = BTreeSet::new();
    for entry in std::fs::read_dir(shipped("crates")).expect("a folder") {
        let manifest = entry.expect("an entry").path().join("Cargo.toml");
        let manifest: toml::Table = std::fs::read_to_string(manifest).expect("a file").parse().expect("TOML");
        let name = manifest["package"]["name"].as_str().expect("a name").to_string();
        let used = manifest["dependencies"].as_table().expect("a table");
        users.extend(ALONE.iter().filter(|(c, _)| used.contains_key(*c)).map(|(c, _)| (c.to_string(), name.clone())));
    }
    assert_eq!(users, ALONE.iter().map(|(c, user)| (c.to_string(), user.to_string())).collect());
}

#[test]
fn only_the_machine_knows_how_many_limbs_and_axes_there_are() {
    let mut files = Vec::new();
    for folder in ["src", "crates", "python", "tests", "benches", "examples"] {
        sources(&shipped(folder), &mut files);
    }
    files.retain(|f| !f.starts_with(shipped("src/machine")) && *f != shipped("tests/walls.rs"));
    assert!(files.len() > 300, "{}", files.len());
    for file in files {
        let text = std::fs::read_to_string(&file).expect("a file");
        let known = text.split(|c: char| !c.is_alphanumeric() && c != '_').find(|word| SIZES.contains(word));
        assert!(known.is_none(), "{}: {known:?} in place of a type or range of `machine::layout`", file.display());
    }
}

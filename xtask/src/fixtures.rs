//! `cargo xtask fixtures`: the files of the fixtures package are those that its README lists. And where the chores find
//! files: the package itself is for tests, so that what is published does not hang on it.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use sha2::{Digest, Sha256};

use crate::{Outcome, root};

/// Compares names, sizes and checksums of `fixtures/files` with the table of `fixtures/README.md`.
pub(crate) fn run() -> Outcome {
    let folder = root().join("fixtures");
    let table = fs::read_to_string(folder.join("README.md"))
        .map_err(|e| format!("fixtures/README.md: {e}"))?;
    let mut listed = BTreeMap::new();
    for row in table.lines().filter(|l| l.starts_with('|')).skip(2) {
        let cells: Vec<_> = row.trim_matches('|').split('|').map(str::trim).collect();
        let [name, _, _, _, bytes, sha256] = cells[..] else {
            return Err(format!("fixtures/README.md: not six cells: {row}"));
        };
        listed.insert(name.to_owned(), (bytes.to_owned(), sha256.to_owned()));
    }
    let mut found = BTreeMap::new();
    let entries = fs::read_dir(folder.join("files")).map_err(|e| format!("fixtures/files: {e}"))?;
    for entry in entries {
        let entry = entry.map_err(|e| format!("fixtures/files: {e}"))?;
        let name = entry.file_name().to_string_lossy().into_owned();
        let content = fs::read(entry.path()).map_err(|e| format!("{name}: {e}"))?;
        let sha256: String = Sha256::digest(&content)
            .iter()
            .map(|byte| format!("{byte:02x}"))
            .collect();
        found.insert(name, (content.len().to_string(), sha256));
    }
    for name in listed.keys().chain(found.keys()) {
        match (listed.get(name), found.get(name)) {
            (Some(l), Some(f)) if l == f => {}
            (Some(_), Some(_)) => {
                return Err(format!("{name} is not the file that the table describes"));
            }
            (Some(_), None) => return Err(format!("{name} is in the table, not in the folder")),
            _ => return Err(format!("{name} is in the folder, not in the table")),
        }
    }
    println!("{} fixtures as listed", listed.len());
    Ok(())
}

/// The folder of the fixtures.
pub(crate) fn folder() -> PathBuf {
    root().join("fixtures/files")
}

/// A fixture.
pub(crate) fn path(name: &str) -> PathBuf {
    folder().join(name)
}

/// A file or folder of the larger data that developers keep beside the workspace; a linked working tree lies a level
/// deeper.
pub(crate) fn shared(relative: &str) -> Option<PathBuf> {
    let beside = ["../shared/data", "../../shared/data"].map(|data| root().join(data));
    let mut found = beside.map(|data| data.join(relative)).into_iter();
    found.find(|path| path.exists())
}

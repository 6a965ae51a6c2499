//! A copy of the workspace to plant faults in.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use super::lists::Fault;
use crate::{Outcome, root, target};

/// The files that git knows or would take, in a folder of their own.
pub(super) struct Copy {
    folder: PathBuf,
    target: PathBuf,
}

impl Copy {
    /// The copy as the workspace is now. Files that are the same stay as they are, so that only what has changed is
    /// compiled again.
    pub(super) fn refreshed() -> Result<Self, String> {
        let own = target().join("faults");
        let copy = Self {
            folder: own.join("workspace"),
            target: own.join("target"),
        };
        let files = files_of(root())?;
        for file in &files {
            let content = fs::read(root().join(file)).map_err(|e| failed(file, &e))?;
            copy.write(file, &content)?;
        }
        copy.remove_all_but(&copy.folder, &files)?;
        Ok(copy)
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Cargo in the copy. Kernels of shaders are only seen on a device: its absence is a failure.
    pub(super) fn cargo(&self) -> Command {
        let mut cargo = Command::new("cargo");
        cargo
            .current_dir(&self.folder)
            .env("CARGO_TARGET_DIR", &self.target)
            .env("GEOM_REQUIRE_GPU", "1");
        cargo
    }

    /// Does something while a fault is in place.
    pub(super) fn with<T>(
        &self,
        fault: &Fault,
        work: impl FnOnce() -> Result<T, String>,
    ) -> Result<T, String> {
        let file = Path::new(fault.file);
        let text = fs::read_to_string(self.folder.join(file)).map_err(|e| failed(file, &e))?;
        self.write(file, fault.planted(&text)?.as_bytes())?;
        let result = work();
        self.write(file, text.as_bytes())?;
        result.map_err(|e| format!("`{}`: {e}", fault.breaks))
    }

    /// Writes a file unless it holds that already.
    fn write(&self, file: &Path, content: &[u8]) -> Outcome {
        let path = self.folder.join(file);
        if fs::read(&path).is_ok_and(|old| old == content) {
            return Ok(());
        }
        let folder = path.parent().unwrap_or(&self.folder);
        fs::create_dir_all(folder)
            .and_then(|()| fs::write(&path, content))
            .map_err(|e| failed(&path, &e))
    }

    /// What the workspace no longer has, the copy should not have either.
    fn remove_all_but(&self, folder: &Path, files: &BTreeSet<PathBuf>) -> Outcome {
        for entry in fs::read_dir(folder).map_err(|e| failed(folder, &e))? {
            let path = entry.map_err(|e| failed(folder, &e))?.path();
            if path.is_dir() {
                self.remove_all_but(&path, files)?;
            } else if !path
                .strip_prefix(&self.folder)
                .is_ok_and(|own| files.contains(own))
            {
                fs::remove_file(&path).map_err(|e| failed(&path, &e))?;
            }
        }
        Ok(())
    }
}

/// The files of a repository, those that are not yet added included.
fn files_of(folder: &Path) -> Result<BTreeSet<PathBuf>, String> {
    let git = Command::new("git")
        .args([
            "ls-files",
            "-z",
            "--cached",
            "--others",
            "--exclude-standard",
        ])
        .current_dir(folder)
        .output()
        .map_err(|e| format!("cannot run git: {e}"))?;
    if !git.status.success() {
        return Err(format!("`git ls-files` failed: {}", git.status));
    }
    let names = String::from_utf8(git.stdout).map_err(|_| "git lists a name that is no text")?;
    let files = names.split('\0').filter(|name| !name.is_empty());
    // One that is deleted but still known is not there to be copied.
    Ok(files
        .map(PathBuf::from)
        .filter(|f| folder.join(f).is_file())
        .collect())
}

fn failed(path: &Path, error: &std::io::Error) -> String {
    format!("{}: {error}", path.display())
}

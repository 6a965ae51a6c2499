//! A Python environment under `target/`, for comparisons with independent programs.

use std::path::PathBuf;
use std::process::{Command, Stdio};

use crate::root;

/// The interpreter of an environment in which `packages` are installed; made on first use.
pub(crate) fn with(packages: &[&str]) -> Result<PathBuf, String> {
    let folder = root().join("target").join("python");
    let python = folder.join(if cfg!(windows) {
        "Scripts/python.exe"
    } else {
        "bin/python"
    });
    if !python.exists() {
        let made = Command::new("python3")
            .arg("-m")
            .arg("venv")
            .arg(&folder)
            .status();
        if !made.is_ok_and(|s| s.success()) {
            return Err(
                "cannot make a virtual environment: is python3 with venv installed?".into(),
            );
        }
    }
    let installed = Command::new(&python)
        .args([
            "-m",
            "pip",
            "install",
            "--quiet",
            "--disable-pip-version-check",
        ])
        .args(packages)
        .stdout(Stdio::null())
        .status();
    if !installed.is_ok_and(|s| s.success()) {
        return Err(format!("pip cannot install {}", packages.join(", ")));
    }
    Ok(python)
}

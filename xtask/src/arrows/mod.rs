//! `cargo xtask arrows`: the house as its plan draws it. Between the crates only the arrows of the
//! architecture; inside a crate no circle of files but child and parent, and no folder with more than
//! ten files; and what a crate brings with it stays small.

mod circles;
mod modules;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::{Outcome, root};
use modules::Module;

/// The published crates.
pub(crate) const LIBRARIES: &[&str] = &[
    "geom-core",
    "geom-shaders",
    "gauss-density",
    "dual-contour",
    "tet-quality",
    "crossfield",
    "secondfund-ops",
    "spectral-corresp",
    "tspline",
];

/// Who may depend on whom among the published crates.
const ALLOWED: &[(&str, &str)] = &[
    ("geom-core", "geom-shaders"),
    ("gauss-density", "geom-core"),
    ("dual-contour", "geom-core"),
    ("tet-quality", "geom-core"),
    ("crossfield", "geom-core"),
    ("secondfund-ops", "geom-core"),
    ("spectral-corresp", "geom-core"),
    ("tspline", "geom-core"),
];

/// More files than this in a folder, and a newcomer needs a guide.
const FILES_PER_FOLDER: usize = 10;

/// How many packages a crate may bring into a program that uses it without a GPU: itself and all below.
const PACKAGES: &[(&str, usize)] = &[("gauss-density", 45)];

/// Prints the arrows, rooms and packages, and fails on the first that is not as planned.
pub(crate) fn run() -> Outcome {
    let metadata = metadata()?;
    between_crates(&metadata)?;
    let mut faults = Vec::new();
    for (name, source) in sources(&metadata) {
        faults.extend(inside(&name, &source)?);
    }
    for &(package, most) in PACKAGES {
        let found = packages_below(package)?;
        println!("{package} without a GPU: {found} packages (at most {most})");
        if found > most {
            faults.push(format!("{package} brings {found} packages, not {most}"));
        }
    }
    match faults.is_empty() {
        true => Ok(()),
        false => Err(faults.join("\n       ")),
    }
}

/// What cargo says about the workspace.
fn metadata() -> Result<serde_json::Value, String> {
    let output = Command::new("cargo")
        .args(["metadata", "--format-version", "1", "--no-deps"])
        .current_dir(root())
        .output()
        .map_err(|e| format!("cannot run cargo: {e}"))?;
    serde_json::from_slice(&output.stdout).map_err(|e| format!("cargo metadata gives no JSON: {e}"))
}

/// Fails on an arrow between crates too many or too few.
fn between_crates(metadata: &serde_json::Value) -> Outcome {
    let text = |v: &serde_json::Value| v.as_str().unwrap_or_default().to_owned();
    let mut found = BTreeSet::new();
    for package in metadata["packages"].as_array().into_iter().flatten() {
        let from = text(&package["name"]);
        for dependency in package["dependencies"].as_array().into_iter().flatten() {
            let to = text(&dependency["name"]);
            let ours = [&from, &to].iter().all(|n| LIBRARIES.contains(&n.as_str()));
            // Tests may look anywhere; the shipped crates may not.
            if ours && dependency["kind"].is_null() {
                found.insert((from.clone(), to));
            }
        }
    }
    let allowed: BTreeSet<_> = ALLOWED
        .iter()
        .map(|&(a, b)| (a.to_owned(), b.to_owned()))
        .collect();
    for (from, to) in &found {
        println!("{from} → {to}");
    }
    match found.symmetric_difference(&allowed).next() {
        None => Ok(()),
        Some((from, to)) => Err(format!(
            "the arrow {from} → {to} is not as the architecture says"
        )),
    }
}

/// The published crates with the folder of their sources.
fn sources(metadata: &serde_json::Value) -> Vec<(String, PathBuf)> {
    let packages = metadata["packages"].as_array().into_iter().flatten();
    packages
        .filter_map(|package| {
            let name = package["name"].as_str()?;
            let manifest = Path::new(package["manifest_path"].as_str()?);
            let ours = LIBRARIES.contains(&name);
            ours.then(|| (name.to_owned(), manifest.with_file_name("src")))
        })
        .collect()
}

/// What is not as planned inside of one crate: circles of files and crowded folders.
fn inside(name: &str, source: &Path) -> Result<Vec<String>, String> {
    let modules = modules::read(source)?;
    let arrows = modules::arrows(&modules);
    let circles = circles::circles(&modules, &arrows);
    let fullest = files_per_folder(&modules).into_iter().max_by_key(|f| f.1);
    let (folder, files) = fullest.unwrap_or_default();
    println!(
        "{name}: {} files, at most {files} in a folder, {} arrows, {} circles",
        modules.len(),
        arrows.len(),
        circles.len()
    );
    let mut faults = Vec::new();
    if files > FILES_PER_FOLDER {
        let folder = folder.strip_prefix(root()).unwrap_or(&folder).display();
        faults.push(format!(
            "{folder} has {files} files, more than {FILES_PER_FOLDER}"
        ));
    }
    for circle in circles {
        faults.push(format!("{name}: a circle of files: {circle}"));
    }
    Ok(faults)
}

/// How many files lie in each folder.
fn files_per_folder(modules: &[Module]) -> BTreeMap<PathBuf, usize> {
    let mut counts = BTreeMap::new();
    let files: BTreeSet<&PathBuf> = modules.iter().map(|m| &m.file).collect();
    for file in files {
        let folder = file.parent().unwrap_or(Path::new("")).to_owned();
        *counts.entry(folder).or_insert(0) += 1;
    }
    counts
}

/// How many packages a program gets that uses one of our crates without a GPU.
fn packages_below(package: &str) -> Result<usize, String> {
    let output = Command::new("cargo")
        .args(["tree", "--package", package, "--no-default-features"])
        .args(["--edges", "normal", "--prefix", "none", "--format", "{p}"])
        .current_dir(root())
        .output()
        .map_err(|e| format!("cannot run cargo: {e}"))?;
    let text = String::from_utf8_lossy(&output.stdout);
    let names = text.lines().filter(|l| !l.is_empty());
    // A package that stands in the tree before is marked.
    let packages: BTreeSet<&str> = names.map(|l| l.trim_end_matches(" (*)")).collect();
    match packages.len() {
        0 => Err(format!("cargo tree knows no package {package}")),
        found => Ok(found),
    }
}

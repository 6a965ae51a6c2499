//! `cargo xtask arrows`: the dependencies between our crates are those of the architecture.

use std::collections::BTreeSet;
use std::process::Command;

use crate::{Outcome, root};

/// The published crates.
pub(crate) const LIBRARIES: &[&str] = &[
    "geom-core",
    "geom-shaders",
    "gauss-density",
    "dual-contour",
    "tet-quality",
    "crossfield",
];

/// Who may depend on whom among the published crates.
const ALLOWED: &[(&str, &str)] = &[
    ("geom-core", "geom-shaders"),
    ("gauss-density", "geom-core"),
    ("dual-contour", "geom-core"),
    ("tet-quality", "geom-core"),
    ("crossfield", "geom-core"),
];

/// Reads `cargo metadata`; fails on an arrow too many or too few.
pub(crate) fn run() -> Outcome {
    let output = Command::new("cargo")
        .args(["metadata", "--format-version", "1", "--no-deps"])
        .current_dir(root())
        .output()
        .map_err(|e| format!("cannot run cargo: {e}"))?;
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout)
        .map_err(|e| format!("cargo metadata gives no JSON: {e}"))?;
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

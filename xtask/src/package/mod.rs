//! `cargo xtask package`: the crates as others get them. They are packed, unpacked beside two programs of somebody
//! else's that ask for them by name and version, and built from there.

mod licences;

use std::fs;
use std::path::Path;
use std::process::Command;

use serde_json::Value;

use crate::{Outcome, root, target};

/// How much is built.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Only what the gate has time for: the licences, the packing, and whether all crates and the two programs compile without
    /// a GPU, and without a warning
    #[arg(long)]
    pub(crate) quick: bool,
}

/// Programs of somebody else's: their names and texts.
const PROGRAMS: [(&str, &str); 2] = [
    (
        "screened_poisson",
        include_str!("../../downstream/screened_poisson.rs"),
    ),
    (
        "structure_by_modes",
        include_str!("../../downstream/structure_by_modes.rs"),
    ),
];

/// What they would `cargo add`, with the features that they need.
const NEEDS: [(&str, &[&str]); 7] = [
    ("gauss-density", &[]),
    ("dual-contour", &[]),
    ("tet-quality", &[]),
    ("spectral-corresp", &[]),
    ("secondfund-ops", &[]),
    ("geom-core", &["io"]),
    ("faer", &["std", "rayon", "sparse-linalg"]),
];

/// A published crate: its name and version.
type Published = (String, String);

pub(crate) fn run(arguments: &Arguments) -> Outcome {
    let metadata = metadata()?;
    licences::check(&metadata)?;
    let crates = published(&metadata);
    let folder = target().join("packaged");
    pack()?;
    unpack(&crates, &folder)?;
    write_workspace(&crates, &folder)?;
    write_programs(&crates, &metadata, &folder)?;

    if !arguments.quick {
        for (name, _) in &crates {
            check_alone(name, &all_features(&metadata, name), &folder)?;
        }
    }
    if arguments.quick {
        checked("check --quiet --workspace --no-default-features", &folder)?;
    } else {
        let input = root().join("fixtures/files/1AJJ.pdb").display().to_string();
        for (name, _) in PROGRAMS {
            println!("{name}:");
            let run = ["run", "--quiet", "--package", "downstream", "--bin", name];
            for features in [&[][..], &["--no-default-features"]] {
                cargo(&folder, &[&run[..], features, &["--", &input]].concat())?;
            }
        }
    }
    println!(
        "{} crates and {} programs on them",
        crates.len(),
        PROGRAMS.len()
    );
    Ok(())
}

/// Checks one packed crate with its default features, without them, and with all.
fn check_alone(name: &str, all: &str, folder: &Path) -> Outcome {
    for features in ["", "--no-default-features", &format!("--features {all}")] {
        println!("{name} {features}");
        let line = format!("check --quiet --package {name} {features}");
        checked(line.trim(), folder)?;
    }
    Ok(())
}

/// A check in the other workspace. A warning is an error: those of what it builds on are not shown, so it is ours.
fn checked(line: &str, folder: &Path) -> Outcome {
    let arguments: Vec<&str> = line.split(' ').collect();
    let output = in_other_workspace(folder, &arguments).output();
    let output = output.map_err(|e| format!("cargo {line}: {e}"))?;
    let told = String::from_utf8_lossy(&output.stderr);
    if !output.status.success() || told.lines().any(is_warning) {
        return Err(format!("`cargo {line}`:\n{told}"));
    }
    Ok(())
}

/// Does a line of cargo's begin a warning of the compiler?
fn is_warning(line: &str) -> bool {
    line.starts_with("warning")
}

/// All features of a crate but `mpi`, which needs a library of the system, and `default`.
fn all_features(metadata: &Value, name: &str) -> String {
    let package = packages(metadata).find(|p| p["name"] == name && p["source"].is_null());
    let features = package.and_then(|p| p["features"].as_object());
    let names = features.into_iter().flatten().map(|(feature, _)| feature);
    let wanted = names.filter(|f| *f != "mpi" && *f != "default");
    wanted.map(String::as_str).collect::<Vec<_>>().join(",")
}

/// What cargo knows about the workspace and all that it builds on.
fn metadata() -> Result<Value, String> {
    let told = Command::new("cargo")
        .args(["metadata", "--all-features", "--format-version", "1"])
        .current_dir(root())
        .output()
        .map_err(|e| format!("cargo metadata: {e}"))?;
    serde_json::from_slice(&told.stdout).map_err(|e| format!("cargo metadata: {e}"))
}

/// The packages of `cargo metadata`.
fn packages(metadata: &Value) -> impl Iterator<Item = &Value> {
    metadata["packages"].as_array().into_iter().flatten()
}

/// The crates of the workspace that are for others.
fn published(metadata: &Value) -> Vec<Published> {
    let text = |package: &Value, key: &str| package[key].as_str().unwrap_or_default().to_owned();
    packages(metadata)
        // Those of the workspace have no source; `publish = false` is an empty list of registries.
        .filter(|package| package["source"].is_null() && package["publish"].is_null())
        .map(|package| (text(package, "name"), text(package, "version")))
        .collect()
}

/// Packs the whole workspace, programs included: each manifest must be one that a registry takes.
fn pack() -> Outcome {
    // What is packed is the working tree, committed or not.
    let pack = [
        "package",
        "--workspace",
        "--no-verify",
        "--allow-dirty",
        "--quiet",
    ];
    crate::call("cargo", &pack, &[])
}

/// The packed crates, in folders of their own.
fn unpack(crates: &[Published], folder: &Path) -> Outcome {
    let place = folder.join("crates");
    if place.exists() {
        fs::remove_dir_all(&place).map_err(|e| failed(&place, &e))?;
    }
    fs::create_dir_all(&place).map_err(|e| failed(&place, &e))?;
    for (name, version) in crates {
        let file = target().join(format!("package/{name}-{version}.crate"));
        let [file, place] = [&file, &place].map(|path| path.display().to_string());
        // `-m`: packed files all have one old date, by which cargo would take what was checked before for up to date.
        crate::call("tar", &["-xmzf", &file, "-C", &place], &[])?;
    }
    Ok(())
}

/// A workspace in which the names of our crates mean the unpacked ones, with the versions of everything else that the
/// tests are run with.
fn write_workspace(crates: &[Published], folder: &Path) -> Outcome {
    let mut manifest = String::from(
        "[workspace]\nresolver = \"3\"\nmembers = [\"crates/*\", \"downstream\"]\n\n[patch.crates-io]\n",
    );
    for (name, version) in crates {
        manifest += &format!("{name} = {{ path = \"crates/{name}-{version}\" }}\n");
    }
    let lock = folder.join("Cargo.lock");
    fs::copy(root().join("Cargo.lock"), &lock).map_err(|e| failed(&lock, &e))?;
    manifest += &profile()?;
    write(&folder.join("Cargo.toml"), &manifest)
}

/// The profile of the workspace itself, so that what is built on was built before. It names packages that are not in the
/// other one, which cargo says only where it is not `--quiet`.
fn profile() -> Result<String, String> {
    let manifest = root().join("Cargo.toml");
    let text = fs::read_to_string(&manifest).map_err(|e| failed(&manifest, &e))?;
    let begin = text.find("[profile.dev]").ok_or("no profile for dev")?;
    let own = &text[begin..];
    let end = own.find("[profile.release").unwrap_or(own.len());
    Ok(own[..end].to_owned())
}

/// The programs, in a package that asks for what `cargo add` would write. The crates' default features are those of a
/// feature of its own, so that one manifest serves with and without.
fn write_programs(crates: &[Published], metadata: &Value, folder: &Path) -> Outcome {
    let folder = folder.join("downstream");
    let ours = NEEDS
        .iter()
        .filter(|(need, _)| crates.iter().any(|(name, _)| name == need));
    let defaults: Vec<_> = ours.map(|(need, _)| format!("{need}/default")).collect();
    let mut manifest = format!(
        "[package]\nname = \"downstream\"\nversion = \"0.1.0\"\nedition = \"2024\"\n\n[features]\ndefault = {defaults:?}\n\n[dependencies]\n"
    );
    for (need, features) in NEEDS {
        let version = version_of(metadata, need)?;
        manifest += &format!(
            "{need} = {{ version = \"{version}\", default-features = false, features = {features:?} }}\n"
        );
    }
    write(&folder.join("Cargo.toml"), &manifest)?;
    for (name, text) in PROGRAMS {
        write(&folder.join(format!("src/bin/{name}.rs")), text)?;
    }
    Ok(())
}

/// The version of a package that the workspace is built with.
fn version_of<'a>(metadata: &'a Value, name: &str) -> Result<&'a str, String> {
    packages(metadata)
        .find(|package| package["name"] == name)
        .and_then(|package| package["version"].as_str())
        .ok_or_else(|| format!("the workspace is built without {name}"))
}

/// Writes a file unless it holds that already, so that nothing is built again for nothing.
fn write(path: &Path, text: &str) -> Outcome {
    if fs::read_to_string(path).is_ok_and(|old| old == text) {
        return Ok(());
    }
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder)
        .and_then(|()| fs::write(path, text))
        .map_err(|e| failed(path, &e))
}

/// Cargo in the other workspace; what others build has no warnings of ours.
fn cargo(folder: &Path, arguments: &[&str]) -> Outcome {
    let line = arguments.join(" ");
    let status = in_other_workspace(folder, arguments).status();
    let status = status.map_err(|e| format!("cargo {line}: {e}"))?;
    if status.success() {
        Ok(())
    } else {
        Err(format!("`cargo {line}` failed: {status}"))
    }
}

/// What is built there goes where our own builds go, so that nothing is built twice.
fn in_other_workspace(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new("cargo");
    command.args(arguments).current_dir(folder);
    command.env("CARGO_TARGET_DIR", target());
    command
}

fn failed(path: &Path, error: &std::io::Error) -> String {
    format!("{}: {error}", path.display())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_features_are_all_but_those_that_need_a_system() {
        let metadata = serde_json::json!({"packages": [
            {"name": "a", "source": "registry", "features": {"x": []}},
            {"name": "a", "source": null, "features": {"default": ["io"], "io": [], "mpi": [], "wgpu": []}},
        ]});
        assert_eq!(all_features(&metadata, "a"), "io,wgpu");
        assert_eq!(all_features(&metadata, "b"), "");
        assert!(is_warning("warning: unused import"));
        assert!(!is_warning("   |  a warning"));
    }
}

//! Every kind of GLB that our programs write, in the Khronos glTF validator, which Node runs.

use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use super::{Lab, integer, text};
use crate::{Outcome, fixtures, root};

/// Programs that write GLB, and what they are told: fixtures by their names, and `<` before a file of an earlier program.
const PROGRAMS: [(&str, &str); 17] = [
    ("00_pipeline", "5e5z.pdb --spacing 1 --stages all"),
    ("02_surface", "1AJJ.pdb --color residue"),
    ("03_tets", "5e5z.pdb --spacing 1 --region both"),
    ("04_improve", "<02_surface/surface.ply"),
    ("05_eliminate", "5e5z.pdb --epsilon 0.05"),
    ("06_modes", "bob_small.ply --count 4"),
    ("08_quads", "bob_small.ply --quads 400"),
    ("09_anisotropy", "spot.ply --quads 1500"),
    ("10_tmesh", "<08_quads/quads.obj --levels curvature"),
    (
        "11_tspline",
        "<08_quads/quads.obj --levels curvature --tolerance 0.3",
    ),
    ("12_correspond", "5e5z.pdb 5e5z.pdb"),
    ("13_deform", "5e5z.pdb 5e5z.pdb"),
    ("14_compare", "5e5z.pdb 5e5z.pdb"),
    ("15_segment", "bob_small.ply --groups 3"),
    ("16_pockets", "5e5z.pdb"),
    ("17_smooth", "bob_small.ply --method bilateral"),
    ("20_tiles", "5e5z.pdb --spacing 1 --tiles 4"),
];

/// No error and no warning in any file; each program writes one at least.
pub(super) fn glb(lab: &mut Lab) -> Outcome {
    let validator = match validator() {
        Ok(folder) => folder,
        Err(missing) => {
            println!("The glTF validator is NOT AT HAND, no GLB is compared: {missing}");
            return Ok(());
        }
    };
    let out = lab.file("glb");
    if out.exists() {
        std::fs::remove_dir_all(&out).map_err(text)?;
    }
    for (program, told) in PROGRAMS {
        let words: Vec<String> = told.split(' ').map(|word| argument(word, &out)).collect();
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let folder = out.join(program);
        super::program(program, &[&words[..], &["--no-pictures"]].concat(), &folder)?;
        let mut files = Vec::new();
        collect(&folder, &mut files)?;
        lab.same(&format!("{program}: writes GLB"), true, !files.is_empty());
        for (file, answer) in files.iter().zip(validated(&validator, &files)?) {
            let file = file.strip_prefix(&out).unwrap_or(file).display();
            for measure in ["errors", "warnings"] {
                let what = format!("{file}: {measure}");
                lab.same(&what, 0, integer(&answer, measure)?);
            }
            if let Some(message) = answer["messages"].as_array().and_then(|m| m.first()) {
                println!("  {message}");
            }
        }
    }
    Ok(())
}

/// A word of a program's line, files where they are.
fn argument(word: &str, out: &Path) -> String {
    match word.strip_prefix('<') {
        Some(made) => out.join(made).display().to_string(),
        None if fixtures::folder().join(word).is_file() => {
            fixtures::path(word).display().to_string()
        }
        None => word.to_owned(),
    }
}

/// All GLB files of a folder and of those in it, by name.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> Outcome {
    let entries = std::fs::read_dir(folder).map_err(text)?;
    let mut paths: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            collect(&path, files)?;
        } else if path.extension().is_some_and(|e| e == "glb") {
            files.push(path);
        }
    }
    Ok(())
}

/// Where the validator is; installed on first use.
fn validator() -> Result<PathBuf, String> {
    let node = Command::new("node").arg("--version").output();
    if !node.is_ok_and(|o| o.status.success()) {
        return Err("there is no node".to_owned());
    }
    let folder = root().join("target/node");
    let package = folder.join("node_modules/gltf-validator");
    if !package.is_dir() {
        std::fs::create_dir_all(&folder).map_err(text)?;
        let installed = Command::new("npm")
            .args(["install", "--silent", "--no-save", "--prefix"])
            .arg(&folder)
            .arg("gltf-validator")
            .output();
        if !installed.is_ok_and(|o| o.status.success()) || !package.is_dir() {
            return Err("npm cannot install gltf-validator".to_owned());
        }
    }
    Ok(package)
}

/// What it says of each file.
fn validated(validator: &Path, files: &[PathBuf]) -> Result<Vec<Value>, String> {
    let script = root().join("xtask/src/lab/peers/glb.js");
    let mut arguments = vec![
        script.display().to_string(),
        validator.display().to_string(),
    ];
    arguments.extend(files.iter().map(|file| file.display().to_string()));
    let told = crate::capture("node", &arguments)?;
    let answers: Vec<Value> = serde_json::from_str(&told).map_err(text)?;
    if answers.len() == files.len() {
        Ok(answers)
    } else {
        Err(format!(
            "the validator answers for {} of {} files",
            answers.len(),
            files.len()
        ))
    }
}

//! A case in an independent program.

use std::fs;
use std::path::Path;

use dual_contour::Extent;
use geom_core::io::{View, mesh};
use geom_core::{TetMesh, TriMesh};
use serde_json::{Value, json};
use sha2::{Digest, Sha256};

use crate::lab::text;
use crate::{capture, root};

/// Is this one of the cases that the program sees? One of seven, whichever others are swept with it.
pub(super) fn is_chosen(key: &str) -> bool {
    Sha256::digest(key)[0] % 7 == 0
}

/// What an independent program finds in the files of a case.
pub(super) fn check(
    python: &str,
    script: &Path,
    volume: &TetMesh,
    surface: &TriMesh,
    region: Extent,
    row: &Value,
) -> Result<Vec<String>, String> {
    // Sweeps may run side by side.
    let folder = root().join(format!("target/sweep-check-{}", std::process::id()));
    fs::create_dir_all(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let ask = |name: &str, view: &View<'_>| {
        let path = folder.join(name);
        mesh::save(&path, view).map_err(text)?;
        let arguments = [script, &path].map(|p| p.display().to_string());
        let answer = capture(python, &arguments)?;
        fs::remove_file(&path).map_err(text)?;
        serde_json::from_str::<Value>(&answer).map_err(|e| format!("{}: {e}", script.display()))
    };
    let tets = &ask("volume.vtu", &View::from(volume))?["tetra"];
    let shell = &ask("surface.off", &View::from(surface))?["surface"];
    fs::remove_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut faults = Vec::new();
    let mut same = |what: &str, found: &Value, wanted: Value| {
        let fine = match (found.as_f64(), wanted.as_f64()) {
            (Some(a), Some(b)) => (a - b).abs() <= 1e-6 * b.abs().max(1.0),
            _ => *found == wanted,
        };
        if !fine {
            faults.push(format!(
                "the independent checker: {what} {found}, not {wanted}"
            ));
        }
    };
    same("tets", &tets["tets"], row["tets"].clone());
    same("inverted", &tets["inverted"], json!(0));
    let overfull = "faces_shared_by_more_than_two";
    same(overfull, &tets[overfull], json!(0));
    same("volume", &tets["volume"], row["volume"].clone());
    for (theirs, ours) in [
        ("dihedral_min", "min_dihedral"),
        ("dihedral_max", "max_dihedral"),
        ("joe_liu_min", "joe_liu"),
        ("edge_ratio_max", "edge_ratio"),
    ] {
        same(theirs, &tets[theirs], row[ours].clone());
    }
    // A cavity's wall is a part of the surface of its own; around the molecule there is the box as well.
    let topology = [0, 1, 2].map(|k| row["topology"][k].as_i64().unwrap_or(0));
    let [parts, tunnels, cavities] = topology;
    let (parts, euler) = (parts + cavities, 2 * (parts - tunnels + cavities));
    let boundary = &tets["boundary"];
    let (bound_parts, bound_euler) = match region {
        Extent::Interior => (parts, euler),
        Extent::Exterior => (parts + 1, euler + 2),
        Extent::Both => (1, 2),
    };
    for (name, found, parts, euler) in [
        ("boundary", boundary, bound_parts, bound_euler),
        ("surface", shell, parts, euler),
    ] {
        same(&format!("{name} closed"), &found["closed"], json!(true));
        for key in [
            "nonmanifold_edges",
            "nonmanifold_vertices",
            "misoriented_edges",
        ] {
            same(&format!("{name} {key}"), &found[key], json!(0));
        }
        same(
            &format!("{name} components"),
            &found["components"],
            json!(parts),
        );
        same(&format!("{name} euler"), &found["euler"], json!(euler));
    }
    Ok(faults)
}

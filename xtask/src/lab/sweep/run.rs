//! The loop over all cases, the file of results, the summary.

use std::collections::BTreeMap;
use std::fs::{self, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use gauss_density::{Cutoff, Levels, Model, PointSampler, sample_band};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::io::{View, mesh};
use geom_core::{Cpu, Run, TetMesh, TriMesh};
use serde_json::{Value, json};

use super::{Arguments, Mesher, Region, case};
use crate::{Outcome, capture, root};

/// The independent checker sees every case whose number is a multiple of this.
const CHECKED: usize = 7;

fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}

pub(crate) fn run(arguments: &Arguments) -> Outcome {
    let files = structures(arguments)?;
    let out = root().join(&arguments.out);
    let mut rows = earlier(&out)?;
    let mut file = OpenOptions::new()
        .create(true)
        .append(true)
        .open(&out)
        .map_err(|e| format!("{}: {e}", out.display()))?;
    let spacings = if arguments.spacing.is_empty() {
        2
    } else {
        arguments.spacing.len()
    };
    let per_structure = arguments.method.len() * arguments.region.len();
    let total = files.len() * spacings * per_structure;
    println!(
        "{} structures, {total} cases, results in {}",
        files.len(),
        out.display()
    );
    let mut keys = Vec::new();
    // All structures at the coarser spacing first: what stops early has seen each of them.
    for k in 0..spacings {
        for path in &files {
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            let structure = read(path, &ReadOptions::default())
                .map_err(|e| e.to_string())?
                .structure;
            let atoms = structure.atoms().len();
            let spacing = match arguments.spacing.get(k) {
                Some(&h) => h,
                None => spacing_for(atoms, arguments.tets as f64 * [1.0, 2.5][k]),
            };
            let cases: Vec<(Mesher, Region, String)> = arguments
                .method
                .iter()
                .flat_map(|&m| arguments.region.iter().map(move |&r| (m, r)))
                .map(|(m, r)| (m, r, format!("{name} {spacing} {m:?} {r:?}")))
                .collect();
            keys.extend(cases.iter().map(|c| c.2.clone()));
            if cases.iter().all(|c| rows.contains_key(&c.2)) {
                continue;
            }
            let start = Instant::now();
            let model = Model::uniform(&structure, &Levels::default()).map_err(text)?;
            let options = gauss_density::Options {
                spacing,
                ..Default::default()
            };
            let grid = sample_band(&model, &options, Run::on(&Cpu))
                .map_err(|e| format!("{name}: {e}"))?
                .grid;
            let field = PointSampler::new(&model, Cutoff::default()).map_err(text)?;
            let density_s = start.elapsed().as_secs_f64();
            for &mesher in &arguments.method {
                if cases
                    .iter()
                    .filter(|c| c.0 == mesher)
                    .all(|c| rows.contains_key(&c.2))
                {
                    continue;
                }
                let expected = case::expected(&grid, &field, mesher);
                for (_, region, key) in cases.iter().filter(|c| c.0 == mesher) {
                    if rows.contains_key(key) {
                        continue;
                    }
                    let done = case::run(&grid, &field, mesher, *region, expected.clone());
                    let mut row = done.row;
                    row["case"] = key.as_str().into();
                    row["structure"] = (*name).into();
                    row["atoms"] = atoms.into();
                    row["spacing"] = spacing.into();
                    row["method"] = format!("{mesher:?}").into();
                    row["region"] = format!("{region:?}").into();
                    row["density_s"] = density_s.into();
                    let number = keys.iter().position(|k| k == key).unwrap_or(0);
                    if let (Some(script), Some((mesh, surface)), 0) =
                        (&arguments.meshcheck, &done.mesh, number % CHECKED)
                    {
                        let faults =
                            check(&arguments.python, script, mesh, surface, *region, &row)?;
                        row["checked"] = true.into();
                        if let Some(all) = row["faults"].as_array_mut() {
                            all.extend(faults.into_iter().map(Value::from));
                        }
                    }
                    println!("{}", line(&row));
                    writeln!(file, "{row}").map_err(|e| format!("{}: {e}", out.display()))?;
                    rows.insert(key.clone(), row);
                }
            }
        }
    }
    summary(&keys, &rows)
}

/// The structure files asked for, by name.
fn structures(arguments: &Arguments) -> Result<Vec<PathBuf>, String> {
    let folder = match &arguments.data {
        Some(folder) => folder.clone(),
        None => fixtures::shared("pdb").ok_or(
            "NOTHING SWEPT: no ../shared/data/pdb beside the workspace; give a folder with --data",
        )?,
    };
    let entries = fs::read_dir(&folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut files: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
    files.retain(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let bare = name.strip_suffix(".gz").unwrap_or(&name);
        let known = ["pdb", "ent", "cif", "pqr"].contains(&bare.rsplit('.').next().unwrap_or(""));
        let only = &arguments.only;
        known && (only.is_empty() || only.iter().any(|o| name.contains(o.as_str())))
    });
    files.sort();
    if files.is_empty() {
        return Err(format!(
            "NOTHING SWEPT: no such structure in {}",
            folder.display()
        ));
    }
    Ok(files)
}

/// Spacing, Å, that gives a molecule about as many tetrahedra inside, but not so coarse that atoms are
/// lost.
fn spacing_for(atoms: usize, tets: f64) -> f64 {
    let h = 0.5 * (atoms as f64 / 1000.0 * 1e6 / tets).cbrt();
    (h.min(1.6) * 100.0).round() / 100.0
}

/// The cases of an earlier run.
fn earlier(path: &Path) -> Result<BTreeMap<String, Value>, String> {
    let Ok(lines) = fs::read_to_string(path) else {
        return Ok(BTreeMap::new());
    };
    lines
        .lines()
        .map(|line| {
            let row: Value =
                serde_json::from_str(line).map_err(|e| format!("{}: {e}", path.display()))?;
            let key = row["case"].as_str().unwrap_or_default().to_owned();
            Ok((key, row))
        })
        .collect()
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or(f64::NAN)
}

fn list(row: &Value, key: &str) -> Vec<String> {
    let items = row[key].as_array().into_iter().flatten();
    items
        .map(|v| v.as_str().unwrap_or_default().to_owned())
        .collect()
}

fn line(row: &Value) -> String {
    let mut out = format!(
        "{}: {} tets, {:.1}°–{:.1}°, Joe–Liu {:.3}, edge ratio {:.2}, {} of {} far, topology {}, {:.1} + {:.1} s",
        row["case"].as_str().unwrap_or_default(),
        row["tets"],
        number(row, "min_dihedral"),
        number(row, "max_dihedral"),
        number(row, "joe_liu"),
        number(row, "edge_ratio"),
        row["far_vertices"],
        row["surface_vertices"],
        row["topology"],
        number(row, "mesh_s"),
        number(row, "improve_s"),
    );
    for (word, key) in [("BROKEN", "faults"), ("missed", "misses")] {
        let items = list(row, key);
        if !items.is_empty() {
            out += &format!("  {word}: {}", items.join("; "));
        }
    }
    out
}

/// What an independent program finds in the files of a case.
fn check(
    python: &str,
    script: &Path,
    volume: &TetMesh,
    surface: &TriMesh,
    region: Region,
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
    let topology = [0, 1, 2].map(|k| row["topology"][k].as_i64().unwrap_or(0));
    let [parts, tunnels, cavities] = topology;
    let (parts, euler) = (parts + cavities, 2 * (parts - tunnels + cavities));
    let boundary = &tets["boundary"];
    let (bound_parts, bound_euler) = match region {
        Region::Interior => (parts, euler),
        Region::Exterior => (parts + 1, euler + 2),
        Region::Both => (1, 2),
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

/// The worst figures per method and region, all that falls short, and an error if a mesh is broken.
fn summary(keys: &[String], rows: &BTreeMap<String, Value>) -> Outcome {
    let rows: Vec<&Value> = keys.iter().filter_map(|k| rows.get(k)).collect();
    println!(
        "\n| method | region | cases | tets | min dihedral | max dihedral | Joe–Liu | edge ratio | vertices within 0.1 h | below target | broken |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|---|");
    for method in ["Lattice", "DualContour"] {
        for region in ["Interior", "Exterior", "Both"] {
            let of: Vec<&Value> = rows
                .iter()
                .copied()
                .filter(|r| r["method"] == method && r["region"] == region)
                .collect();
            if of.is_empty() {
                continue;
            }
            let worst = |key: &str, f: fn(f64, f64) -> f64| {
                of.iter().map(|r| number(r, key)).fold(f64::NAN, f)
            };
            let on = of
                .iter()
                .map(|r| 1.0 - number(r, "far_vertices") / number(r, "surface_vertices"))
                .fold(f64::NAN, f64::min);
            let tets: f64 = of.iter().map(|r| number(r, "tets")).sum();
            let with = |key| of.iter().filter(|r| !list(r, key).is_empty()).count();
            println!(
                "| {method} | {region} | {} | {:.1} M | {:.1}° | {:.1}° | {:.3} | {:.2} | {:.3} % | {} | {} |",
                of.len(),
                tets / 1e6,
                worst("min_dihedral", f64::min),
                worst("max_dihedral", f64::max),
                worst("joe_liu", f64::min),
                worst("edge_ratio", f64::max),
                100.0 * on,
                with("misses"),
                with("faults")
            );
        }
    }
    let (mut broken, mut missed, mut checked) = (0, 0, 0);
    for row in &rows {
        checked += usize::from(row["checked"] == true);
        let faults = !list(row, "faults").is_empty();
        let misses = !list(row, "misses").is_empty();
        broken += usize::from(faults);
        missed += usize::from(misses);
        if faults || misses {
            println!("{}", line(row));
        }
    }
    println!(
        "{} cases: {broken} broken, {missed} below a target; {checked} also seen by the independent checker",
        rows.len()
    );
    if broken == 0 {
        Ok(())
    } else {
        Err(format!("{broken} of {} meshes are broken", rows.len()))
    }
}

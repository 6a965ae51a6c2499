//! Quads of every mesh of the data folders, each audited.

use std::collections::btree_map::Entry;
use std::fs;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use crossfield::quads::quality::distances;
use crossfield::quads::{Rung, SurfacePoint};
use crossfield::{Options, Quadrangulation, Size, quadrangulate};
use gauss_density::Levels;
use geom_core::io::mesh;
use geom_core::mesh::{Halfedges, SurfaceAudit};
use geom_core::{Cpu, Point3, Run, TriMesh};
use serde_json::{Value, json};

use super::run::{append, earlier, spacings_for, structure};
use super::{Arguments, Rows, files, name};
use crate::lab::{density_surface, text};
use crate::{Outcome, root};

/// Most quads that a mesh gets, unless it has fewer triangles than three times as many. Surfaces of structures get as many as
/// they do by default: their tunnels ask for irregular vertices, and those for quads between them.
const MOST: usize = 3000;
/// Kinds of files.
const MESHES: [&str; 4] = ["off", "obj", "ply", "stl"];
/// Those whose density surface is taken.
const STRUCTURES: [&str; 4] = ["pdb", "ent", "cif", "pqr"];
/// How many tetrahedra a molecule would have inside, at the spacing of its surface: 1 Å for a thousand atoms.
const TETS: f64 = 125_000.0;
/// How far a vertex may be from its place on the surface, over the diagonal.
const NEAR: f64 = 1e-9;

pub(super) fn run(arguments: &Arguments) -> Outcome {
    let files = files(
        arguments,
        &["psb/off", "meshes", "pdb"],
        &[&MESHES[..], &STRUCTURES].concat(),
    )?;
    let out = root().join(&arguments.out);
    if arguments.in_process {
        return files.iter().try_for_each(|path| {
            let row = row(path);
            append(&out, &row, &line(&row))
        });
    }
    let mut rows = earlier(&out)?;
    println!("{} meshes, results in {}", files.len(), out.display());
    for path in &files {
        let name = name(path);
        if rows.contains_key(&name) {
            continue;
        }
        let died = in_own_process(path, arguments)?;
        rows = earlier(&out)?;
        if let Entry::Vacant(place) = rows.entry(name) {
            let row = json!({ "case": place.key(), "faults": [died], "misses": [] });
            append(&out, &row, &line(&row))?;
            place.insert(row);
        }
    }
    let names: Vec<String> = files.iter().map(|p| name(p)).collect();
    if let Some(path) = &arguments.table {
        fs::write(root().join(path), page(&names, &rows))
            .map_err(|e| format!("{}: {e}", path.display()))?;
    }
    let broken: Vec<&String> = names
        .iter()
        .filter(|n| !faults(&rows[*n], "faults").is_empty())
        .collect();
    println!("{} meshes, {} broken", names.len(), broken.len());
    if broken.is_empty() {
        Ok(())
    } else {
        Err(format!("broken: {broken:?}"))
    }
}

/// Runs a mesh in a process of its own; how that died, should no row come of it.
fn in_own_process(path: &Path, arguments: &Arguments) -> Result<String, String> {
    let child = Command::new(std::env::current_exe().map_err(text)?)
        .args(["sweep", "--quads", "--in-process", "--data"])
        .arg(path)
        .arg("--out")
        .arg(&arguments.out)
        .stdout(Stdio::inherit())
        .output()
        .map_err(text)?;
    let said = String::from_utf8_lossy(&child.stderr);
    let said = said.trim().replace('\n', "; ");
    Ok(format!("the process died of {}: {said}", child.status))
}

/// What comes of a mesh.
fn row(path: &Path) -> Value {
    let mut row = match measured(path) {
        Ok(row) => row,
        Err(why) => json!({ "faults": [why], "misses": [] }),
    };
    row["case"] = name(path).into();
    row
}

fn measured(path: &Path) -> Result<Value, String> {
    let surface = surface(path)?;
    let triangles = surface.triangles().len();
    let most = if is_structure(path) { triangles } else { MOST };
    let count = (triangles / 3).min(most).max(1);
    let options = Options {
        size: Size::Quads(count),
        ..Options::default()
    };
    let start = Instant::now();
    let made = quadrangulate(&surface, &options, Run::on(&Cpu)).map_err(text)?;
    let seconds = start.elapsed().as_secs_f64();
    let report = &made.report;
    let [there, back] = distances(&made.mesh, &surface).map_err(text)?;
    let diagonal = surface.bounds().diagonal();
    let split = report.parts.iter().filter(|p| p.rung == Rung::Split);
    let mut misses = Vec::new();
    if report.scaled_jacobian.min < 0.3 {
        misses.push(format!(
            "{} quads below 0.3",
            report.scaled_jacobian.below_0_3
        ));
    }
    if report.scaled_jacobian.mean < 0.9 {
        misses.push(format!("mean {:.3}", report.scaled_jacobian.mean));
    }
    Ok(json!({
        "triangles": triangles,
        "euler": surface.euler_characteristic(),
        "parts": report.parts.len(),
        "split": split.count(),
        "repaired": report.repaired.is_some(),
        "wanted": count,
        "quads": made.mesh.quads().len(),
        "irregular": report.valences.irregular(),
        "jacobian_min": report.scaled_jacobian.min,
        "jacobian_mean": report.scaled_jacobian.mean,
        "below_0_3": report.scaled_jacobian.below_0_3,
        "distance": there.max(back) / diagonal,
        "seconds": seconds,
        "faults": audited(&made, &surface),
        "misses": misses,
    }))
}

/// The mesh's surface, or that of the structure's density.
fn surface(path: &Path) -> Result<TriMesh, String> {
    if !is_structure(path) {
        return Ok(mesh::read(path).map_err(text)?.mesh.into_triangles());
    }
    let structure = structure(path)?;
    let spacing = spacings_for(structure.atoms().len(), TETS)[0];
    density_surface(&structure, Levels::default().decay, spacing)
}

fn is_structure(path: &Path) -> bool {
    let name = name(path);
    let bare = name.strip_suffix(".gz").unwrap_or(&name);
    STRUCTURES.contains(&bare.rsplit('.').next().unwrap_or_default())
}

/// What is wrong with quads whatever they look like.
fn audited(made: &Quadrangulation, surface: &TriMesh) -> Vec<String> {
    let mut faults = Vec::new();
    if !SurfaceAudit::of_quads(&made.mesh).is_manifold() {
        faults.push("no manifold".to_owned());
    }
    let near = NEAR * surface.bounds().diagonal();
    let all = made.mesh.positions().iter().zip(&made.sources);
    let off =
        |(p, source): &(&Point3, &SurfacePoint)| (source.position(surface) - **p).norm() > near;
    let far = all.filter(off).count();
    if far > 0 {
        faults.push(format!("{far} vertices off the surface"));
    }
    // What repair has changed has another topology.
    if made.report.repaired.is_none() {
        let [own, wanted] = [
            made.mesh.euler_characteristic(),
            surface.euler_characteristic(),
        ];
        if own != wanted {
            faults.push(format!("Euler characteristic {own} for {wanted}"));
        }
        let loops = Halfedges::of(surface).map(|e| e.boundary_loops().len());
        let made = Halfedges::of_quads(&made.mesh).map(|e| e.boundary_loops().len());
        if loops != made {
            faults.push("other boundary loops".to_owned());
        }
    }
    faults
}

fn faults(row: &Value, key: &str) -> String {
    let all = row[key].as_array().into_iter().flatten();
    let all: Vec<&str> = all.filter_map(Value::as_str).collect();
    all.join("; ")
}

/// The figures of a row, as a line of the table has them.
fn figures(row: &Value) -> Option<String> {
    let number = |key: &str| row[key].as_f64();
    Some(format!(
        "{} | {} | {} of {} | {} / {} | {} | {:.2} / {:.3}, {} | {:.4} | {:.1}",
        number("triangles")?,
        number("euler")?,
        number("split")?,
        number("parts")?,
        number("quads")?,
        number("wanted")?,
        number("irregular")?,
        number("jacobian_min")?,
        number("jacobian_mean")?,
        number("below_0_3")?,
        number("distance")?,
        number("seconds")?,
    ))
}

fn line(row: &Value) -> String {
    let case = row["case"].as_str().unwrap_or_default();
    let mut line = match figures(row) {
        Some(figures) => format!("{case}: {figures}"),
        None => case.to_owned(),
    };
    let broken = faults(row, "faults");
    if !broken.is_empty() {
        line += &format!("  BROKEN: {broken}");
    }
    line
}

fn page(names: &[String], rows: &Rows) -> String {
    let rows: Vec<&Value> = names.iter().map(|n| &rows[n]).collect();
    let count = |holds: &dyn Fn(&&&Value) -> bool| rows.iter().filter(holds).count();
    let broken = count(&|r| !faults(r, "faults").is_empty());
    let missed = count(&|r| !faults(r, "misses").is_empty());
    let sum = |key: &str| rows.iter().filter_map(|r| r[key].as_u64()).sum::<u64>();
    let (split, parts) = (sum("split"), sum("parts"));
    let mut page = format!(
        "# Quads of meshes\n\n`cargo xtask sweep --quads`: a third as many quads as triangles, of meshes at most {MOST}. \
         {} meshes, {broken} broken; {missed} with a scaled Jacobian below 0.3 or a mean below 0.9; {split} of {parts} parts on the last rung.\n\n\
         | mesh | triangles | χ | parts split | quads / wanted | irregular | scaled Jacobian min / mean, below 0.3 | distance / \
         diagonal | s | broken |\n|---|---|---|---|---|---|---|---|---|---|\n",
        names.len(),
    );
    for (name, row) in names.iter().zip(rows) {
        let figures = figures(row).unwrap_or_else(|| "| | | | | | |".to_owned());
        page += &format!("| {name} | {figures} | {} |\n", faults(row, "faults"));
    }
    page
}

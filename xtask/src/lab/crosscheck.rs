//! `cargo xtask crosscheck`: our files in other people's programs. trimesh and meshio measure our
//! surfaces and tetrahedra, mrcfile and GridDataFormats read and write our grids, and scikit-fem solves
//! equations with known answers on our meshes. Meshes of SciPy and, where it is at hand, TetGen are improved. Instant Meshes
//! makes quads beside ours. Gmsh and VTK read our spline surfaces, and the parts of a mesh in tiles. gemmi and biotite read
//! the structures that we read, potpourri3d finds distances, MeshFix looks for something to repair, and the validator of Khronos
//! goes over every GLB. Chromium opens the pages of runs.

mod distances;
mod glb;
mod grids;
mod pages;
mod quads;
mod repair;
mod splines;
mod structures;
mod tiles;

use std::path::{Path, PathBuf};

use gauss_density::{Cutoff, Model, PointSampler, sample};
use geom_core::io::{Encoding, View, mesh, msh, ply};
use geom_core::mesh::{INTERIOR, SurfaceAudit, shapes};
use geom_core::{Aabb, Cpu, Point3, Run, ScalarGrid, TetMesh, TriMesh, Vector3};
use serde_json::Value;

use super::{number, python, text};
use crate::{Outcome, fixtures, root};

/// The parts, in the order in which they run.
const PARTS: [&str; 14] = [
    "surfaces",
    "volumes",
    "grids",
    "solver",
    "foreign",
    "tetgen",
    "quads",
    "splines",
    "tiles",
    "structures",
    "distances",
    "repair",
    "glb",
    "pages",
];

/// Prints a row per comparison, of one part or of all; an error if one is out of its tolerance.
pub(crate) fn run(part: Option<&str>) -> Outcome {
    if let Some(unknown) = part.filter(|p| !PARTS.contains(p)) {
        return Err(format!("no part {unknown}; there are {}", PARTS.join(", ")));
    }
    let python = python::with(&[
        "numpy",
        "scipy",
        "trimesh",
        "meshio",
        "scikit-fem",
        "mrcfile",
        "GridDataFormats",
        "gmsh",
        "vtk",
        "pynanoinstantmeshes",
        "gemmi",
        "biotite",
        "potpourri3d",
        "pymeshfix",
    ])?;
    let folder = root().join("target/crosscheck");
    std::fs::create_dir_all(&folder).map_err(|e| e.to_string())?;
    let mut lab = Lab {
        python,
        folder,
        compared: 0,
        failed: 0,
    };
    println!("{:<44} {:>16} {:>16}  tolerance", "", "ours", "theirs");
    let molecule = molecule()?;
    for name in PARTS {
        if part.is_some_and(|p| p != name) {
            continue;
        }
        match name {
            "surfaces" => surfaces(&mut lab, &molecule)?,
            "volumes" => volumes(&mut lab, &molecule)?,
            "grids" => grids::grids(&mut lab, &molecule.grid)?,
            "solver" => solver(&mut lab)?,
            "foreign" => foreign(&mut lab)?,
            "tetgen" => tetgen(&mut lab, &molecule)?,
            "quads" => quads::quads(&mut lab)?,
            "splines" => splines::splines(&mut lab)?,
            "tiles" => tiles::tiles(&mut lab)?,
            "structures" => structures::structures(&mut lab)?,
            "distances" => distances::distances(&mut lab, &molecule.surface)?,
            "repair" => repair::repair(&mut lab)?,
            "glb" => glb::glb(&mut lab)?,
            _ => pages::pages(&mut lab)?,
        }
    }
    println!("{} compared, {} out of tolerance", lab.compared, lab.failed);
    match lab.failed {
        0 => Ok(()),
        n => Err(format!("{n} comparisons are out of tolerance")),
    }
}

/// Runs one of our programs as a user would.
fn program(name: &str, arguments: &[&str], out: &Path) -> Outcome {
    let out = out.display().to_string();
    let cargo = ["run", "--quiet", "--example", name, "--"];
    let run = [&cargo[..], arguments, &["--quiet", "--out", &out]].concat();
    crate::call("cargo", &run, &[])
}

struct Lab {
    python: PathBuf,
    folder: PathBuf,
    compared: usize,
    failed: usize,
}

impl Lab {
    /// What a script of `peers/` prints.
    fn ask(&self, script: &str, arguments: &[String]) -> Result<Value, String> {
        let script = root().join("xtask/src/lab/peers").join(script);
        super::answer(&self.python, &script, arguments)
    }

    fn file(&self, name: &str) -> PathBuf {
        self.folder.join(name)
    }

    fn row(&mut self, what: &str, ours: &str, theirs: &str, tolerance: &str, fine: bool) {
        self.compared += 1;
        let mark = if fine { "" } else { "  ← OUT OF TOLERANCE" };
        println!("{what:<44} {ours:>16} {theirs:>16}  {tolerance}{mark}");
        if !fine {
            self.failed += 1;
        }
    }

    /// Two numbers, equal up to a part of the larger.
    fn near(&mut self, what: &str, ours: f64, theirs: f64, relative: f64) {
        let fine = (ours - theirs).abs() <= relative * ours.abs().max(theirs.abs());
        let [a, b] = [ours, theirs].map(|v| format!("{v:.9}"));
        self.row(what, &a, &b, &format!("{relative:.0e}"), fine);
    }

    /// Two things that must be the same.
    fn same<T: PartialEq + std::fmt::Display>(&mut self, what: &str, ours: T, theirs: T) {
        let fine = ours == theirs;
        self.row(what, &ours.to_string(), &theirs.to_string(), "equal", fine);
    }
}

/// A bundled protein: its density, surface and improved tetrahedra inside and outside.
struct Molecule {
    grid: ScalarGrid,
    surface: TriMesh,
    volume: TetMesh,
}

fn molecule() -> Result<Molecule, String> {
    use geom_core::io::structure::{ReadOptions, read};
    let path = fixtures::path("1AJJ.pdb");
    let structure = read(path, &ReadOptions::default()).map_err(text)?.structure;
    let model = Model::uniform(&structure, &gauss_density::Levels::default()).map_err(text)?;
    let options = gauss_density::Options {
        spacing: 1.0,
        ..Default::default()
    };
    let grid = sample(&model, &options, Run::on(&Cpu)).map_err(text)?.grid;
    let field = PointSampler::new(&model, Cutoff::default()).map_err(text)?;
    let (surface, volume) = meshes(&grid, &field, dual_contour::Extent::Both, f64::INFINITY)?;
    Ok(Molecule {
        grid,
        surface,
        volume,
    })
}

/// The surface, and the tetrahedra after improvement.
fn meshes(
    grid: &ScalarGrid,
    field: &PointSampler<'_>,
    region: dual_contour::Extent,
    max_cell: f64,
) -> Result<(TriMesh, TetMesh), String> {
    let options = dual_contour::Options {
        region,
        max_cell,
        ..Default::default()
    };
    let surface = dual_contour::surface(grid, Some(field), &options, Run::on(&Cpu));
    let volume = dual_contour::volume(grid, Some(field), &options, Run::on(&Cpu));
    let improved = tet_quality::improve(
        volume.map_err(text)?.mesh,
        Some(field),
        &tet_quality::Options::default(),
        Run::on(&Cpu),
    );
    Ok((surface.map_err(text)?.mesh, improved.map_err(text)?.mesh))
}

/// Area, volume, watertightness and Euler characteristic, through every surface format.
fn surfaces(lab: &mut Lab, molecule: &Molecule) -> Outcome {
    let inputs = [
        ("sphere", shapes::icosphere(1.7, 4)),
        ("torus", shapes::torus(5.0, 2.0, 48, 24)),
        ("cylinder", shapes::cylinder(1.5, 4.0, 24, 6)),
        ("walls", shapes::shell(2.0, 3.0, 4).region_surface(0)),
        ("molecule", molecule.surface.clone()),
    ];
    for (name, surface) in &inputs {
        let view = View::from(surface);
        let mut files = Vec::new();
        for ending in ["ply", "off", "obj", "stl", "glb", "vtu", "msh"] {
            let path = lab.file(&format!("{name}.{ending}"));
            mesh::save(&path, &view).map_err(text)?;
            files.push(path.display().to_string());
        }
        let path = lab.file(&format!("{name}_text.ply"));
        ply::save(&path, &view, Encoding::Ascii).map_err(text)?;
        files.push(path.display().to_string());
        let audit = SurfaceAudit::of(surface);
        // Every format must carry the same mesh, so each file is measured for itself.
        let answers = lab.ask("measure.py", &files)?;
        for (file, theirs) in files.iter().zip(answers.as_array().into_iter().flatten()) {
            let file = file.rsplit('/').next().unwrap_or(file);
            // STL and GLB hold f32.
            let single = file.ends_with("stl") || file.ends_with("glb");
            let tolerance = if single { 1e-5 } else { 1e-11 };
            let what = |measure: &str| format!("{file}: {measure}");
            lab.near(
                &what("area"),
                surface.area(),
                number(theirs, "area")?,
                tolerance,
            );
            lab.near(
                &what("volume"),
                surface.volume(),
                number(theirs, "volume")?,
                tolerance,
            );
            let watertight = theirs["watertight"] == true && theirs["oriented"] == true;
            lab.same(
                &what("closed and oriented"),
                audit.is_closed_manifold(),
                watertight,
            );
            let euler = audit.euler_characteristic();
            lab.same(
                &what("Euler characteristic"),
                euler,
                integer(theirs, "euler")?,
            );
            let parts = audit.components.len() as i64;
            lab.same(&what("components"), parts, integer(theirs, "parts")?);
        }
    }
    Ok(())
}

fn integer(answer: &Value, key: &str) -> Result<i64, String> {
    let value = answer[key].as_i64();
    value.ok_or_else(|| format!("a peer printed no `{key}`"))
}

/// Tetrahedra: volumes per region, extreme dihedral angles, conformity, through VTU and both MSH.
fn volumes(lab: &mut Lab, molecule: &Molecule) -> Outcome {
    let inputs = [
        ("ball in box", shapes::ball_in_box(2.0, 4.0, 5)),
        ("molecule in box", molecule.volume.clone()),
    ];
    for (name, tets) in &inputs {
        let report = tet_quality::quality_report(tets);
        let files = export(lab, &name.replace(' ', "_"), tets)?;
        let answers = lab.ask("measure.py", &files)?;
        for (file, theirs) in files.iter().zip(answers.as_array().into_iter().flatten()) {
            let file = file.rsplit('/').next().unwrap_or(file);
            let what = |measure: &str| format!("{file}: {measure}");
            for (region, summary) in &report.regions {
                let measure = what(&format!("volume of region {region}"));
                let theirs = number(&theirs["volumes"], &region.to_string())?;
                lab.near(&measure, summary.volume, theirs, 1e-11);
            }
            for (measure, ours) in [
                ("min dihedral", report.all.min_dihedral.min),
                ("max dihedral", report.all.max_dihedral.max),
            ] {
                lab.near(&what(measure), ours, number(theirs, measure)?, 1e-9);
            }
            // Ours counts by the sign of a volume, theirs by its size: both must see the same sides.
            let positive = number(theirs, "smallest volume")? > 0.0;
            lab.same(
                &what("no inverted tetrahedron"),
                report.all.inverted == 0,
                positive,
            );
            lab.same(
                &what("faces of three"),
                0,
                integer(theirs, "faces of three")?,
            );
            let boundary = tets.interfaces();
            let boundary = boundary
                .iter()
                .filter(|f| f.outside == geom_core::mesh::OUTSIDE);
            let boundary = boundary.count() as i64;
            lab.same(
                &what("boundary faces"),
                boundary,
                integer(theirs, "boundary faces")?,
            );
            // Whole numbers: nothing was lost, doubled or turned on the way.
            let euler = tets.euler_characteristic();
            lab.same(
                &what("Euler characteristic"),
                euler,
                integer(theirs, "euler")?,
            );
        }
    }
    // By the divergence theorem, without a file between.
    let surface = molecule.volume.region_surface(INTERIOR);
    let enclosed = molecule.volume.region_volume(INTERIOR);
    lab.near(
        "molecule: enclosed by its surface",
        enclosed,
        surface.volume(),
        1e-11,
    );
    Ok(())
}

/// Random Delaunay meshes of scipy, slivers and all: with a boundary of good triangles they reach the
/// goals; a random boundary, which stays as it is, forbids that in places, and the report says so.
fn foreign(lab: &mut Lab) -> Outcome {
    let names = ["delaunay cube", "delaunay cloud"];
    let files: Vec<String> = names
        .iter()
        .map(|name| lab.file(&format!("{}.vtu", name.replace(' ', "_"))))
        .map(|path| path.display().to_string())
        .collect();
    let counts = lab.ask("delaunay.py", &files)?;
    for (k, (name, file)) in names.iter().zip(&files).enumerate() {
        let mesh::AnyMesh::Tet(tets) = mesh::read(file).map_err(text)?.mesh else {
            return Err(format!("{file}: no tetrahedra"));
        };
        let theirs = counts[k].as_i64().ok_or("no count")?;
        lab.same(
            &format!("{name}: tetrahedra"),
            tets.tets().len() as i64,
            theirs,
        );
        let options = tet_quality::Options::default();
        let report = tet_quality::improve(tets, None, &options, Run::on(&Cpu))
            .map_err(text)?
            .report;
        let (before, after) = (&report.before.all, &report.after.all);
        lab.near(
            &format!("{name}: volume, improved"),
            after.volume,
            before.volume,
            1e-12,
        );
        let missed: usize = report.unmet.counts.iter().map(|c| c.1).sum();
        let forbidden = report
            .unmet
            .counts
            .iter()
            .any(|c| c.0 == tet_quality::Cause::Boundary);
        // The cube's boundary allows the goals; that of the cloud does not.
        let fine = if k == 0 {
            report.converged
        } else {
            after.min_dihedral.min > before.min_dihedral.min && forbidden
        };
        lab.row(
            &format!("{name}: min dihedral, improved ({missed} below the goals)"),
            &format!("{:.2}", after.min_dihedral.min),
            &format!("{:.3}", before.min_dihedral.min),
            if k == 0 {
                "all goals"
            } else {
                "better, the boundary named"
            },
            fine,
        );
    }
    Ok(())
}

/// TetGen's mesh inside the surface of the molecule, where TetGen can be installed: what stays below the
/// goals is a small part, and a cause is found for each.
fn tetgen(lab: &mut Lab, molecule: &Molecule) -> Outcome {
    if let Err(missing) = python::with(&["tetgen"]) {
        println!("TetGen is NOT AT HAND, its mesh is left out: {missing}");
        return Ok(());
    }
    let surface = lab.file("tetgen_surface.ply");
    let inside = molecule.volume.region_surface(INTERIOR);
    mesh::save(&surface, &View::from(&inside)).map_err(text)?;
    let out = lab.file("tetgen.vtu");
    let files = [&surface, &out].map(|path| path.display().to_string());
    let count = lab.ask("tetrahedralize.py", &files)?;
    let mesh::AnyMesh::Tet(tets) = mesh::read(&out).map_err(text)?.mesh else {
        return Err(format!("{}: no tetrahedra", out.display()));
    };
    let theirs = count.as_i64().ok_or("no count")?;
    lab.same("TetGen: tetrahedra", tets.tets().len() as i64, theirs);
    let report = tet_quality::improve(tets, None, &tet_quality::Options::default(), Run::on(&Cpu))
        .map_err(text)?
        .report;
    let (before, after) = (&report.before.all, &report.after.all);
    let (old, new) = (before.volume, after.volume);
    lab.near("TetGen: volume, improved", new, old, 1e-12);
    let missed: usize = report.unmet.counts.iter().map(|c| c.1).sum();
    let unsolved = tet_quality::Cause::Unsolved;
    let named = report.unmet.counts.iter().all(|c| c.0 != unsolved);
    lab.row(
        &format!("TetGen: min dihedral, improved ({missed} below the goals)"),
        &format!("{:.2}", after.min_dihedral.min),
        &format!("{:.3}", before.min_dihedral.min),
        "better, 0.1 % below, causes named",
        after.min_dihedral.min > before.min_dihedral.min && 1000 * missed < after.tets && named,
    );
    Ok(())
}

/// One mesh as VTU and as MSH of both versions; in 2.2 without cell fields, on which meshio 5.3 stumbles
/// whoever has written them.
fn export(lab: &Lab, name: &str, tets: &TetMesh) -> Result<Vec<String>, String> {
    let mut bare = View::from(tets);
    let mut files = Vec::new();
    for ending in ["vtu", "msh"] {
        let path = lab.file(&format!("{name}.{ending}"));
        mesh::save(&path, &bare).map_err(text)?;
        files.push(path.display().to_string());
    }
    bare.cell_fields.clear();
    for encoding in [Encoding::Binary, Encoding::Ascii] {
        let path = lab.file(&format!("{name}_22_{encoding:?}.msh").to_lowercase());
        let version = msh::Version::V22;
        msh::save(&path, &bare, msh::Options { version, encoding }).map_err(text)?;
        files.push(path.display().to_string());
    }
    Ok(files)
}

/// Half the edge of the box around the ball, Å, and the ball's radius.
const HALF: f64 = 4.5;
const RADIUS: f64 = 2.1;
/// Lattice cells along the box in the three meshes: whole octree blocks, so that it is not enlarged.
const CELLS: [f64; 3] = [16.0, 24.0, 32.0];

/// Laplace and Poisson equations in and around a ball, on meshes of three spacings: the error falls
/// with the square of the spacing, and all parts arrive by name.
fn solver(lab: &mut Lab) -> Outcome {
    use dual_contour::Extent;
    let tree = vec![(vec![0, 1], vec![1.0])];
    let model = Model::new(vec![Point3::origin()], vec![RADIUS], vec![1.0], tree).map_err(text)?;
    let field = PointSampler::new(&model, Cutoff::default()).map_err(text)?;
    let sides: Vec<String> = ["xmax", "xmin", "ymax", "ymin", "zmax", "zmin"]
        .map(|side| format!("box_{side}"))
        .to_vec();
    let with_surface = [sides, vec!["molecule|exterior".to_owned()]].concat();
    for (problem, extent, regions, boundaries) in [
        (
            "interior",
            Extent::Interior,
            "molecule",
            "molecule|exterior".to_owned(),
        ),
        (
            "exterior",
            Extent::Exterior,
            "exterior",
            with_surface.join(" "),
        ),
        (
            "both",
            Extent::Both,
            "exterior molecule",
            with_surface.join(" "),
        ),
    ] {
        let mut errors: Vec<Vec<f64>> = Vec::new();
        let mut files = Vec::new();
        for cells in CELLS {
            let spacing = 2.0 * HALF / cells;
            let corner = Vector3::repeat(HALF);
            let options = gauss_density::Options {
                spacing,
                bounds: Some(Aabb::new(Point3::from(-corner), Point3::from(corner))),
                ..Default::default()
            };
            let grid = sample(&model, &options, Run::on(&Cpu)).map_err(text)?.grid;
            let (_, tets) = meshes(&grid, &field, extent, spacing)?;
            files = export(lab, &format!("{problem}_{cells}"), &tets)?;
            if !errors.is_empty() {
                // Names in MSH 2.2 are checked once: the meshes are those of 4.1.
                files.truncate(2);
            }
            let mut of_files = Vec::new();
            for file in &files {
                let arguments = [problem.to_owned(), RADIUS.to_string(), file.clone()];
                let answer = lab.ask("solve.py", &arguments)?;
                of_files.push(number(&answer, "error")?);
                let names = |key: &str| -> String {
                    let names = answer[key].as_array().into_iter().flatten();
                    names
                        .filter_map(Value::as_str)
                        .collect::<Vec<_>>()
                        .join(" ")
                };
                let file = file.rsplit('/').next().unwrap_or(file);
                // Of MSH 2.2 scikit-fem names the outer boundary only.
                let within = problem == "both" && file.contains("_22_");
                let sides = boundaries.trim_end_matches(" molecule|exterior");
                let boundaries = if within { sides } else { &boundaries };
                for (expected, key) in [(regions, "regions"), (boundaries, "boundaries")] {
                    let arrived = names(key);
                    lab.same(&format!("{file}: {key} by name"), arrived == expected, true);
                    if arrived != expected {
                        println!("  expected {expected}, arrived {arrived}");
                    }
                }
            }
            errors.push(of_files);
        }
        for (k, file) in files.iter().enumerate() {
            let series: Vec<f64> = errors.iter().filter_map(|e| e.get(k).copied()).collect();
            if series.len() == CELLS.len() {
                let order = slope(&series);
                let errors: Vec<String> = series.iter().map(|e| format!("{e:.2e}")).collect();
                let file = file.rsplit('/').next().unwrap_or(file);
                let what = format!("{file}: order of {}", errors.join(" → "));
                lab.row(&what, "2", &format!("{order:.2}"), "≥ 1.8", order >= 1.8);
            }
        }
    }
    Ok(())
}

/// How fast errors fall with the spacing: the slope of the line through their logarithms, by least
/// squares.
fn slope(errors: &[f64]) -> f64 {
    let n = CELLS.len() as f64;
    let x: Vec<f64> = CELLS.iter().map(|cells| -cells.ln()).collect();
    let y: Vec<f64> = errors.iter().map(|e| e.ln()).collect();
    let (mean_x, mean_y) = (x.iter().sum::<f64>() / n, y.iter().sum::<f64>() / n);
    let both: f64 = x
        .iter()
        .zip(&y)
        .map(|(x, y)| (x - mean_x) * (y - mean_y))
        .sum();
    both / x.iter().map(|x| (x - mean_x).powi(2)).sum::<f64>()
}

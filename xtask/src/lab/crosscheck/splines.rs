//! Spline surfaces: what Gmsh's kernel (OpenCASCADE) measures in STEP, where VTK evaluates Bézier cells, SciPy's eigenvalues
//! of our matrices, and triangles without gaps.

use std::fs::File;
use std::io::{BufWriter, Write};

use gauss_density::{Levels, Model, sample};
use geom_core::io::mesh::AnyMesh;
use geom_core::io::structure::{ReadOptions, read};
use geom_core::io::{View, mesh};
use geom_core::mesh::SurfaceAudit;
use geom_core::{Cpu, Run, TriMesh};
use serde_json::Value;
use tspline::files::{market, npz, step, vtu};
use tspline::surface::Jet;
use tspline::surface::errors::measures;
use tspline::surface::fit::{FitOptions, MeshTarget, fit};
use tspline::surface::tessellate::tessellate;
use tspline::{
    Basis, CleanOptions, QualityOptions, Surface, TMesh, TMeshOptions, analysis, improve, levels,
};

use super::{Lab, integer, number, text};
use crate::{Outcome, fixtures};

/// How many eigenvalues are compared, the zero included.
const EIGENVALUES: usize = 12;
/// Where samples of each patch lie, in both directions.
const PLACES: [f64; 3] = [0.0, 0.3, 1.0];

/// A protein by the default basis, another shape by both.
pub(super) fn splines(lab: &mut Lab) -> Outcome {
    let spot = mesh::read(fixtures::path("spot.ply")).map_err(text)?;
    let spot = spot.mesh.into_triangles();
    let protein = protein()?;
    for (name, target, basis) in [
        ("spot", &spot, Basis::Hierarchical),
        ("spot_rational", &spot, Basis::Rational),
        ("protein", &protein, Basis::Hierarchical),
    ] {
        compare(lab, name, &spline(target, basis)?)?;
    }
    Ok(())
}

/// A bundled protein, smooth as the thesis's.
pub(super) fn protein() -> Result<TriMesh, String> {
    let path = fixtures::path("1AJJ.pdb");
    let structure = read(path, &ReadOptions::default()).map_err(text)?.structure;
    let levels = Levels {
        decay: 0.3,
        ..Levels::default()
    };
    let model = Model::uniform(&structure, &levels).map_err(text)?;
    let options = gauss_density::Options {
        spacing: 1.5,
        ..Default::default()
    };
    let grid = sample(&model, &options, Run::on(&Cpu)).map_err(text)?.grid;
    let options = dual_contour::Options::default();
    let surface = dual_contour::surface(&grid, None, &options, Run::on(&Cpu));
    Ok(surface.map_err(text)?.mesh)
}

/// With elements of two sizes.
fn spline(target: &TriMesh, basis: Basis) -> Result<Surface, String> {
    let options = crossfield::Options {
        nested: 1,
        ..crossfield::Options::default()
    };
    let quads = crossfield::quadrangulate(target, &options, Run::on(&Cpu)).map_err(text)?;
    let fine = quads.mesh;
    let places = levels::Places::of(target, &fine).map_err(text)?;
    let wished = levels::by_curvature(&fine, &places, 0.5, 1).map_err(text)?;
    let allowed = levels::cleaned(&fine, &wished, &CleanOptions::default()).map_err(text)?;
    let mesh = TMesh::build(&fine, &allowed, &TMeshOptions::default()).map_err(text)?;
    let better = improve(mesh, target, &QualityOptions::default(), Run::on(&Cpu)).map_err(text)?;
    let mut surface = Surface::new(better.mesh, basis, Run::on(&Cpu)).map_err(text)?;
    let target = MeshTarget::new(target).map_err(text)?;
    fit(&mut surface, &target, &FitOptions::default(), Run::on(&Cpu)).map_err(text)?;
    Ok(surface)
}

fn compare(lab: &mut Lab, name: &str, surface: &Surface) -> Outcome {
    let matrices = analysis::matrices(surface).map_err(text)?;
    let files = export(lab, name, surface, &matrices)?;
    let mut arguments = files.clone();
    arguments.push(EIGENVALUES.to_string());
    let theirs = lab.ask("splines.py", &arguments)?;

    let what = |measure: &str| format!("{name}.{measure}");
    let [area, volume] = measures(surface, Run::on(&Cpu)).map_err(text)?;
    let patches = surface.patches().len() as i64;
    lab.same(&what("step: faces"), patches, integer(&theirs, "faces")?);
    lab.same(&what("step: solids"), 1, integer(&theirs, "solids")?);
    lab.near(
        &what("step: area by our rule"),
        area,
        number(&theirs, "area")?,
        1e-9,
    );
    let finely = number(&theirs, "area_finely")?;
    lab.near(&what("step: area by a finer rule"), area, finely, 1e-6);
    let enclosed = number(&theirs, "volume")?;
    lab.near(&what("step: volume"), volume, enclosed, 1e-9);
    lab.same(
        &what("vtu: cells of type 77"),
        patches,
        integer(&theirs, "cells")?,
    );
    let apart = number(&theirs, "apart")?;
    let extent = surface.mesh().fine().bounds().diagonal();
    lab.row(
        &what("vtu: farthest of 9 points per cell"),
        "0",
        &format!("{apart:.2e}"),
        "1e-14 of the extent",
        apart < 1e-14 * extent,
    );
    let pairs = analysis::eigenpairs(&matrices, EIGENVALUES, Run::on(&Cpu)).map_err(text)?;
    for kind in ["mtx", "npz"] {
        let values: Vec<f64> = theirs[kind]
            .as_array()
            .into_iter()
            .flatten()
            .filter_map(Value::as_f64)
            .collect();
        let found = values.len() as i64;
        lab.same(
            &what(&format!("{kind}: eigenvalues")),
            EIGENVALUES as i64,
            found,
        );
        // The first is zero.
        for (k, (ours, theirs)) in pairs.values.iter().zip(&values).enumerate().skip(1) {
            lab.near(
                &what(&format!("{kind}: eigenvalue {k}")),
                *ours,
                *theirs,
                1e-9,
            );
        }
    }
    triangles(lab, name, surface)
}

/// STEP, Bézier cells, where we see 9 points of each, and the matrices twice.
fn export(
    lab: &Lab,
    name: &str,
    surface: &Surface,
    matrices: &analysis::Matrices,
) -> Result<Vec<String>, String> {
    let mut files = Vec::new();
    let mut save = |ending: &str, write: &dyn Fn(&mut dyn Write) -> std::io::Result<()>| {
        let path = lab.file(&format!("{name}{ending}"));
        let mut out = BufWriter::new(File::create(&path).map_err(text)?);
        write(&mut out).and_then(|()| out.flush()).map_err(text)?;
        files.push(path.display().to_string());
        Ok::<(), String>(())
    };
    let levels: Vec<f64> = surface
        .mesh()
        .elements()
        .iter()
        .map(|e| e.level.into())
        .collect();
    save(".step", &|out| step::write(out, surface, name))?;
    save(".bezier.vtu", &|out| {
        vtu::write(out, surface, &[("\"level\" < 9 & more", &levels)])
    })?;
    save(".points.f64", &|out| {
        for points in surface.patches() {
            for t in PLACES {
                for s in PLACES {
                    let point = Jet::of(points, [s, t]).point;
                    point
                        .iter()
                        .try_for_each(|x| out.write_all(&x.to_le_bytes()))?;
                }
            }
        }
        Ok(())
    })?;
    for (name, matrix) in [("stiffness", &matrices.stiffness), ("mass", &matrices.mass)] {
        save(&format!(".{name}.mtx"), &|out| {
            market::write_symmetric(out, matrix)
        })?;
        save(&format!(".{name}.npz"), &|out| npz::write(out, matrix))?;
    }
    Ok(files)
}

/// The triangles of a surface, through formats of f64.
fn triangles(lab: &mut Lab, name: &str, surface: &Surface) -> Outcome {
    let made = tessellate(surface, 4, Run::on(&Cpu)).map_err(text)?.mesh;
    let mut files = Vec::new();
    for ending in ["ply", "obj", "vtu"] {
        let path = lab.file(&format!("{name}_triangles.{ending}"));
        mesh::save(&path, &View::from(&made)).map_err(text)?;
        // What we read ourselves is what others must find, too.
        let AnyMesh::Tri(_) = mesh::read(&path).map_err(text)?.mesh else {
            return Err(format!("{}: no triangles", path.display()));
        };
        files.push(path.display().to_string());
    }
    let audit = SurfaceAudit::of(&made);
    let answers = lab.ask("measure.py", &files)?;
    for (file, theirs) in files.iter().zip(answers.as_array().into_iter().flatten()) {
        let file = file.rsplit('/').next().unwrap_or(file);
        let what = |measure: &str| format!("{file}: {measure}");
        lab.near(&what("area"), made.area(), number(theirs, "area")?, 1e-11);
        lab.near(
            &what("volume"),
            made.volume(),
            number(theirs, "volume")?,
            1e-11,
        );
        let closed = theirs["watertight"] == true && theirs["oriented"] == true;
        lab.same(
            &what("closed and oriented"),
            audit.is_closed_manifold(),
            closed,
        );
        let euler = audit.euler_characteristic();
        lab.same(
            &what("Euler characteristic"),
            euler,
            integer(theirs, "euler")?,
        );
    }
    Ok(())
}

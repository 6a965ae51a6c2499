//! Quads beside those of Instant Meshes, as many of them on the same surfaces: irregular vertices and scaled Jacobians.

use std::time::Instant;

use crossfield::quads::quality::{JacobianSummary, Valences, scaled_jacobians};
use crossfield::{Options, Size, quadrangulate};
use geom_core::io::mesh::AnyMesh;
use geom_core::io::{View, mesh};
use geom_core::{Cpu, QuadMesh, Run, TriMesh};

use super::{Lab, integer, number, splines, text};
use crate::{Outcome, fixtures};

/// A bundled mesh, a protein, and larger meshes where they are at hand.
pub(super) fn quads(lab: &mut Lab) -> Outcome {
    let spot = mesh::read(fixtures::path("spot.ply")).map_err(text)?;
    compare(lab, "spot", &spot.mesh.into_triangles(), 2000)?;
    compare(lab, "1AJJ", &splines::protein()?, 2000)?;
    for (name, file) in [
        ("hand", "meshes/cgal_hand.off"),
        ("bunny", "meshes/dir_bunny.off"),
    ] {
        match fixtures::shared(file) {
            Some(path) => {
                let surface = mesh::read(path).map_err(text)?.mesh.into_triangles();
                compare(lab, name, &surface, 2800)?;
            }
            None => println!("  {file}: not at hand, row left out"),
        }
    }
    Ok(())
}

/// What quads are like.
struct Measured {
    irregular: usize,
    jacobian: JacobianSummary,
}

/// About so many quads of a surface by both; ours must have fewer irregular vertices and better corners.
fn compare(lab: &mut Lab, name: &str, surface: &TriMesh, count: usize) -> Outcome {
    let options = Options {
        size: Size::Quads(count),
        ..Options::default()
    };
    let start = Instant::now();
    let made = quadrangulate(surface, &options, Run::on(&Cpu)).map_err(text)?;
    let seconds = start.elapsed().as_secs_f64();
    let own = measured(&made.mesh, surface)?;

    let [input, output] = ["surface", "instant"].map(|s| lab.file(&format!("{name}_{s}.obj")));
    mesh::save(&input, &View::from(surface)).map_err(text)?;
    let [from, to] = [&input, &output].map(|p| p.display().to_string());
    let asked = made.mesh.quads().len().to_string();
    let theirs = lab.ask("quads.py", &[from, asked, to])?;
    let AnyMesh::Quad(quads) = mesh::read(&output).map_err(text)?.mesh else {
        return Err(format!("{name}: their faces are not all quads"));
    };
    lab.same(
        &format!("{name}.faces but quads"),
        0,
        integer(&theirs, "others")?,
    );
    let [a, b] = [made.mesh.quads().len(), quads.quads().len()];
    let near = (b as f64 / a as f64).ln().abs() < 0.25;
    lab.row(
        &format!("{name}.quads"),
        &a.to_string(),
        &b.to_string(),
        "22 %",
        near,
    );
    let other = measured(&quads, surface)?;
    let [a, b] = [own.irregular, other.irregular];
    lab.row(
        &format!("{name}.irregular vertices"),
        &a.to_string(),
        &b.to_string(),
        "fewer",
        a < b,
    );
    let figures = |m: &Measured| [m.jacobian.min, m.jacobian.percentile_5, m.jacobian.mean];
    let names = [
        "smallest scaled Jacobian",
        "that of 1 in 20",
        "mean scaled Jacobian",
    ];
    for ((what, a), b) in names.into_iter().zip(figures(&own)).zip(figures(&other)) {
        let [shown, shown_b] = [a, b].map(|x| format!("{x:.3}"));
        lab.row(&format!("{name}.{what}"), &shown, &shown_b, "larger", a > b);
    }
    let their_seconds = number(&theirs, "seconds")?;
    println!("  {name}: {seconds:.1} s, theirs {their_seconds:.1} s");
    Ok(())
}

/// Theirs by the same measure as ours.
fn measured(quads: &QuadMesh, surface: &TriMesh) -> Result<Measured, String> {
    let jacobians = scaled_jacobians(quads, surface).map_err(text)?;
    Ok(Measured {
        irregular: Valences::of(quads).map_err(text)?.irregular(),
        jacobian: JacobianSummary::of(&jacobians),
    })
}

//! Your own arrays in, better tetrahedra out. `cargo run --release --example better_tetrahedra`

#![expect(clippy::print_stdout, reason = "the result")]

use geom_core::{Cpu, Point3, Run, TetMesh};
use tet_quality::{Options, improve, quality_report};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // A block of 4 × 4 × 4 cubes, each cut into six tetrahedra along a diagonal, and squeezed.
    let at = |i: u32| {
        Point3::new(
            f64::from(i % 5),
            f64::from(i / 5 % 5),
            0.3 * f64::from(i / 25),
        )
    };
    let positions: Vec<Point3> = (0..125).map(at).collect();
    let cubes = (0..64).map(|c| c % 4 + c / 4 % 4 * 5 + c / 16 * 25);
    let paths = [[1, 6], [6, 5], [5, 30], [30, 25], [25, 26], [26, 1]];
    let tets = cubes
        .flat_map(|o| paths.map(|[a, b]| [o, o + a, o + b, o + 31]))
        .collect();

    let mesh = TetMesh::new(positions, tets)?;
    let before = quality_report(&mesh).all.min_dihedral.min;
    let improved = improve(mesh, None, &Options::default(), Run::on(&Cpu))?;

    println!(
        "smallest dihedral angle {before:.1}° before, {:.1}° after",
        improved.report.after.all.min_dihedral.min
    );
    let (_positions, _tets) = (improved.mesh.positions(), improved.mesh.tets());
    Ok(())
}

//! The goals on meshes of proteins, made by the other crates from the bundled structure: what the thesis
//! reached, what the issue asks for.

use dual_contour::Method;
use gauss_density::{Cutoff, Model, PointSampler};
use geom_core::io::structure::{ReadOptions, read};
use geom_core::mesh::{SurfaceAudit, VolumeAudit};
use geom_core::{Cpu, Run};
use tet_quality::{Improved, Options, improve};

/// Meshes the bundled protein and improves the mesh at the default options.
fn protein(method: Method, region: dual_contour::Extent, spacing: f64) -> Improved {
    let path = fixtures::path("1AJJ.pdb");
    let structure = read(path, &ReadOptions::default()).unwrap().structure;
    let model = Model::uniform(&structure, &Default::default()).unwrap();
    let density = gauss_density::Options {
        spacing,
        ..Default::default()
    };
    let grid = gauss_density::sample(&model, &density, Run::on(&Cpu))
        .unwrap()
        .grid;
    let field = PointSampler::new(&model, Cutoff::default()).unwrap();
    let contour = dual_contour::Options {
        method,
        region,
        ..Default::default()
    };
    let volume = dual_contour::volume(&grid, Some(&field), &contour, Run::on(&Cpu)).unwrap();
    let before = SurfaceAudit::of(&volume.surface);
    let options = Options {
        spacing: Some(spacing),
        ..Options::default()
    };
    let improved = improve(volume.mesh, Some(&field), &options, Run::on(&Cpu)).unwrap();
    let audit = VolumeAudit::of(&improved.mesh);
    assert!(audit.is_valid(), "{audit:?}");
    // The surface keeps its topology.
    if region != dual_contour::Extent::Exterior {
        let after = SurfaceAudit::of(&improved.mesh.region_surface(1));
        assert_eq!(after.is_closed_manifold(), before.is_closed_manifold());
        assert_eq!(after.euler_characteristic(), before.euler_characteristic());
    }
    improved
}

fn assert_goals(improved: &Improved, min_dihedral: f64) {
    let report = &improved.report;
    let all = &report.after.all;
    assert!(report.converged, "{:?}", report.exceptions.counts);
    assert!(
        all.min_dihedral.min >= min_dihedral,
        "{:?}",
        all.min_dihedral
    );
    assert!(all.max_dihedral.max <= 155.0, "{:?}", all.max_dihedral);
    assert!(all.joe_liu.min >= 0.3, "{:?}", all.joe_liu);
    assert!(all.edge_ratio.max <= 6.0, "{:?}", all.edge_ratio);
    let fit = &report.surface;
    assert!(fit.vertices > 1000);
    assert!(
        fit.far as f64 <= 1e-3 * fit.vertices as f64,
        "{} of {}",
        fit.far,
        fit.vertices
    );
}

#[test]
fn dual_contouring_reaches_20_degrees() {
    let improved = protein(Method::DualContour, dual_contour::Extent::Interior, 0.8);
    // What the thesis has after its improvement is what we have not to fall short of before all else.
    assert!(improved.report.before.all.min_dihedral.min < 5.0);
    assert_goals(&improved, 20.0);
}

#[test]
fn the_lattice_method_reaches_25_degrees_on_both_sides() {
    assert_goals(
        &protein(Method::Lattice, dual_contour::Extent::Interior, 0.8),
        25.0,
    );
    assert_goals(
        &protein(Method::Lattice, dual_contour::Extent::Exterior, 1.2),
        25.0,
    );
    assert_goals(
        &protein(Method::Lattice, dual_contour::Extent::Both, 1.2),
        25.0,
    );
}

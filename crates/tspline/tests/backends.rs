//! A whole improvement on another backend. That of corners has its laws in geom-core.

#![cfg(feature = "wgpu")]

use geom_core::mesh::shapes;
use geom_core::testing::gpu_or_skip;
use geom_core::{Run, nalgebra};
use tspline::{QualityOptions, TMesh, TMeshOptions, improve};

#[test]
fn whole_improvements_obey_the_same_laws() {
    let Some(gpu) = gpu_or_skip() else { return };
    let fine = shapes::quad_sphere(1.0, 8);
    let mesh = TMesh::build(&fine, &[1; 384], &TMeshOptions::default()).unwrap();
    let surface = shapes::ellipsoid(nalgebra::vector![1.0, 0.8, 0.6], 3);
    let out = improve(mesh, &surface, &QualityOptions::default(), Run::on(&gpu)).unwrap();
    assert!(out.report.backend.starts_with("wgpu"));
    assert!(out.report.after.min >= out.report.before.min);
    assert!(out.mesh.audit().is_valid());
}

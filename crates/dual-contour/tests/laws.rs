//! What must hold for all inputs.

mod common;

use common::*;
use dual_contour::geom_core::mesh::{EXTERIOR, INTERIOR};
use dual_contour::geom_core::{Cpu, LatticeValues, Point3, Run, ScalarGrid};
use dual_contour::{AtBox, Extent, Method, Options, surface, volume};

fn both(options: Options) -> Options {
    Options {
        region: Extent::Both,
        ..options
    }
}

/// Everything that must hold for a mesh of inside and outside, by either method.
fn check_all(grid: &ScalarGrid, options: &Options) {
    check_method(grid, options);
    if options.tolerance == 0.0 {
        let method = Method::Lattice;
        check_method(
            grid,
            &Options {
                method,
                ..options.clone()
            },
        );
    }
}

fn check_method(grid: &ScalarGrid, options: &Options) {
    let run = Run::on(&Cpu);
    let v = volume(grid, None, &both(options.clone()), run).unwrap();
    assert_conforming(&v.mesh);
    assert_closed(&v.surface);
    let bounds = v.mesh.bounds();
    let total = bounds.extent().product();
    let sum = v.mesh.volume();
    assert!(
        (sum / total - 1.0).abs() < 1e-12,
        "{sum} of a box of {total}"
    );
    let inside = boundary_of(&v.mesh, INTERIOR);
    assert!(
        geometry(v.mesh.positions(), &inside)
            == geometry(v.surface.positions(), v.surface.triangles()),
        "the surface is the boundary of the inner tetrahedra"
    );
    let alone = surface(grid, None, options, run).unwrap();
    assert!(alone.mesh == v.surface, "the surface alone is the same");
    let inner = volume(grid, None, options, run).unwrap();
    let outer = volume(
        grid,
        None,
        &Options {
            region: Extent::Exterior,
            ..options.clone()
        },
        run,
    )
    .unwrap();
    assert_eq!(
        inner.mesh.tets().len() + outer.mesh.tets().len(),
        v.mesh.tets().len()
    );
    assert!(inner.surface == v.surface);
    assert!(outer.surface == v.surface);
    let tets: Vec<[u32; 4]> = v
        .mesh
        .tets()
        .iter()
        .zip(v.mesh.regions())
        .filter(|(_, r)| **r == INTERIOR)
        .map(|(t, _)| *t)
        .collect();
    assert_eq!(v.surface.euler_characteristic(), 2 * euler_of_tets(&tets));
}

#[test]
fn a_ball_is_a_ball() {
    let field = ball(Point3::origin(), 3.0);
    let grid = sample(&field, 4.0, 24);
    check_all(&grid, &Options::default());
    let mesh = surface(&grid, Some(&field), &Options::default(), Run::on(&Cpu))
        .unwrap()
        .mesh;
    assert_eq!(mesh.euler_characteristic(), 2);
    let worst = mesh
        .positions()
        .iter()
        .map(|p| (p.coords.norm() - 3.0).abs())
        .fold(0.0, f64::max);
    assert!(
        worst < 0.02 * grid.lattice().spacing,
        "vertices lie on the sphere, worst {worst}"
    );
}

#[test]
fn white_noise_gives_manifold_conforming_meshes() {
    for (i, density) in [0.1, 0.2, 0.3, 0.4, 0.5].into_iter().enumerate() {
        check_all(&noise(12, density, 1, i as u64 + 1), &Options::default());
    }
}

#[test]
fn white_noise_may_touch_the_box() {
    for (i, density) in [0.15, 0.5].into_iter().enumerate() {
        let grid = noise(11, density, 0, i as u64 + 11);
        for at_box in [AtBox::Cap, AtBox::Clip] {
            check_all(
                &grid,
                &Options {
                    at_box,
                    ..Options::default()
                },
            );
        }
    }
}

#[test]
fn adaptive_noise_is_manifold_too() {
    for (i, tolerance) in [0.2, 1.0, 3.0].into_iter().enumerate() {
        let field = Field(move |x: &Point3| {
            1.0 + (1.7 * x.x + i as f64).sin() * (1.3 * x.y).cos()
                + (2.1 * x.z).sin() * (0.9 * x.x).cos()
                - 0.1 * x.coords.norm_squared()
        });
        let grid = sample(&field, 5.0, 24);
        check_all(
            &grid,
            &Options {
                tolerance,
                ..Options::default()
            },
        );
    }
}

#[test]
fn regions_of_a_volume_are_named() {
    let grid = sample(&ball(Point3::origin(), 2.0), 3.0, 12);
    let v = volume(&grid, None, &both(Options::default()), Run::on(&Cpu)).unwrap();
    assert!(v.mesh.regions().contains(&INTERIOR) && v.mesh.regions().contains(&EXTERIOR));
}

//! Cavities stay what they are.

use geom_core::mesh::SurfaceAudit;
use geom_core::{Cpu, ImplicitField, Lattice, Point3, Run, ScalarGrid, TetMesh, Vector3};
use tet_quality::testing::noise;
use tet_quality::{Options, improve, inside};

/// 1 on two spheres about the same centre, larger between them.
struct Hollow {
    center: Point3,
    inner: f64,
    outer: f64,
}

impl ImplicitField for Hollow {
    fn value(&self, x: &Point3) -> f64 {
        self.value_gradient(x).0
    }
    fn value_gradient(&self, x: &Point3) -> (f64, Vector3) {
        let d = x - self.center;
        let (r, a, b) = (
            d.norm_squared(),
            self.inner * self.inner,
            self.outer * self.outer,
        );
        let slope = 2.0 * (a + b - 2.0 * r) / (b * b);
        (1.0 + (r - a) * (b - r) / (b * b), d * slope)
    }
}

/// A ball with a cavity of radius `inner` in its middle, which is somewhere in a lattice cell.
fn hollow_ball(inner: f64, seed: u64) -> (TetMesh, Hollow) {
    let mut noise = noise(seed);
    let mut coordinate = || 4.5 + 0.5 * noise();
    let field = Hollow {
        center: Point3::new(coordinate(), coordinate(), coordinate()),
        inner,
        outer: 3.2,
    };
    let lattice = Lattice {
        origin: Point3::origin(),
        spacing: 1.0,
        counts: [10; 3],
    };
    let value = |i: u32| {
        let p = [i % 10, i / 10 % 10, i / 100].map(f64::from);
        field.value(&Point3::from(p)) as f32
    };
    let grid = ScalarGrid::new(lattice, (0..1000).map(value).collect()).unwrap();
    let contour = dual_contour::Options {
        method: dual_contour::Method::DualContour,
        region: dual_contour::Extent::Interior,
        ..Default::default()
    };
    let volume = dual_contour::volume(&grid, Some(&field), &contour, Run::on(&Cpu)).unwrap();
    (volume.mesh, field)
}

#[test]
fn the_volumes_are_those_of_the_walls_after_every_change() {
    let (mesh, field) = hollow_ball(1.3, 5);
    inside::volumes_of_walls(mesh, &field, field.center);
}

#[test]
fn a_cavity_of_a_cell_is_not_pulled_through_itself() {
    // Without the guard some of these small cavities turn inside out.
    let mut cavities = 0;
    for case in 0..24u32 {
        let (raw, field) = hollow_ball(0.35 + 0.02 * f64::from(case), 3 + u64::from(case));
        let options = Options {
            spacing: Some(1.0),
            ..Options::default()
        };
        let volumes = |mesh: &TetMesh| -> Vec<f64> {
            let parts = SurfaceAudit::of(&mesh.region_surface(1)).components;
            let mut volumes: Vec<f64> = parts.iter().map(|c| c.volume).collect();
            volumes.sort_by(f64::total_cmp);
            volumes
        };
        let before = volumes(&raw);
        let after = volumes(
            &improve(raw, Some(&field), &options, Run::on(&Cpu))
                .unwrap()
                .mesh,
        );
        assert_eq!(before.len(), after.len());
        if let [cavity, _] = before[..] {
            cavities += 1;
            assert!(
                cavity < 0.0 && after[0] <= 0.249 * cavity,
                "{before:?} {after:?}"
            );
        }
    }
    assert!(cavities >= 10);
}

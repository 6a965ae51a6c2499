//! The chain from one atom to a surface, against the closed form.

use std::f64::consts::PI;

use dual_contour::geom_core::{Cpu, Point3, Run};
use gauss_density::{Model, Options, sample_band};

/// Radius of carbon, Å.
const R: f64 = 1.7;

/// Relative errors at a spacing: the worst radius, the area, the volume.
fn errors(spacing: f64) -> [f64; 3] {
    let model = Model::new(vec![Point3::origin()], vec![R], vec![1.0], vec![]).unwrap();
    let options = Options {
        spacing,
        ..Options::default()
    };
    let band = sample_band(&model, &options, Run::on(&Cpu)).unwrap();
    let contour = dual_contour::Options::default();
    let surface = dual_contour::surface(&band.grid, None, &contour, Run::on(&Cpu)).unwrap();
    let radii = surface.mesh.positions().iter().map(|x| x.coords.norm());
    [
        radii.map(|r| (r / R - 1.0).abs()).fold(0.0, f64::max),
        (surface.mesh.area() / (4.0 * PI * R * R) - 1.0).abs(),
        (surface.mesh.volume() / (4.0 / 3.0 * PI * R * R * R) - 1.0).abs(),
    ]
}

#[test]
fn one_atom_gives_its_sphere_at_second_order() {
    let [coarse, fine] = [0.25, 0.125].map(errors);
    assert!(coarse[0] < 0.01, "the radius is off by {:.4}", coarse[0]);
    for (coarse, fine) in coarse.into_iter().zip(fine) {
        let fall = coarse / fine;
        assert!(
            fall > 3.0,
            "halving the spacing only divides {coarse:.2e} by {fall:.2}"
        );
    }
}

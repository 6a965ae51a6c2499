//! Closed forms: spectra of spheres, tori and cylinders, curvature of limit surfaces.

use geom_core::mesh::shapes;
use geom_core::{Cpu, Run};
use secondfund_ops::options::Quadrature;
use secondfund_ops::{Element, Normals, Operator, SpectrumOptions, Spectrum, Surface, Weight, spectrum};

fn modes_of(element: Element<'_>, operator: Operator, modes: usize, regularization: f64) -> Spectrum {
    let options = SpectrumOptions {
        operator,
        modes,
        regularization,
        verify: true,
        ..SpectrumOptions::default()
    };
    spectrum(&element, &options, Run::on(&Cpu)).unwrap()
}

/// The largest relative error of values from `l(l+1)` of a unit sphere, by degree.
fn sphere_errors(values: &[f64], scale: impl Fn(f64) -> f64) -> [f64; 2] {
    let worst = |range: std::ops::Range<usize>, exact: f64| {
        let exact = scale(exact);
        values[range].iter().map(|v| (v / exact - 1.0).abs()).fold(0.0, f64::max)
    };
    [worst(0..3, 2.0), worst(3..8, 6.0)]
}

#[test]
fn a_sphere_of_triangles_has_its_spectrum() {
    let sphere = shapes::icosphere(3.0, 4);
    let normals = Normals::OfMesh { rounds: 0 };
    let element = Element::Triangles(&sphere, &normals);
    // Unit scale: radius ½, and Laplace–Beltrami values in units of 1/36 Å⁻².
    let lbo = modes_of(element, Operator::Lbo, 8, 0.5);
    let errors = sphere_errors(&lbo.values, |x| 4.0 * x);
    assert!(errors[0] < 2e-3 && errors[1] < 4e-3, "{errors:?} {:?}", lbo.values);
    // λ = l(l+1) / (1 + ε² R²).
    let slo = modes_of(element, Operator::Slo(Weight::One), 8, 1.0);
    let errors = sphere_errors(&slo.values, |x| x / 1.25);
    assert!(errors[0] < 4e-3 && errors[1] < 6e-3, "{errors:?} {:?}", slo.values);
}

#[test]
fn spheres_of_quads_converge() {
    for (n, known) in [(4, [1.3e-4, 1.9e-3]), (8, [2.2e-5, 2.4e-4]), (16, [3.4e-6, 3.2e-5])] {
        let surface = Surface::interpolating(&shapes::quad_sphere(1.0, n)).unwrap();
        let lbo = modes_of(Element::CatmullClark(&surface), Operator::Lbo, 15, 0.5);
        let scale = lbo.scale * lbo.scale;
        let errors = sphere_errors(&lbo.values, |x| x * scale);
        println!("{n} {errors:?} area {}", lbo.areas.iter().sum::<f64>() * scale / 4.0 / std::f64::consts::PI - 1.0);
        for k in 0..2 {
            assert!(errors[k] < 1.3 * known[k], "{n}: {errors:?}");
        }
    }
}

#[test]
fn a_torus_has_the_spectrum_of_the_fourier_solution() {
    let torus = Surface::interpolating(&shapes::quad_torus(1.0, 0.4, 48, 24)).unwrap();
    let lbo = modes_of(Element::CatmullClark(&torus), Operator::Lbo, 8, 0.5);
    let exact = [1.028956, 1.028956, 3.611378, 3.611378, 6.160800, 6.710149, 7.200141, 7.200141];
    let scale = lbo.scale * lbo.scale;
    for (v, e) in lbo.values.iter().zip(exact) {
        assert!((v / scale / e - 1.0).abs() < 1e-4, "{:?}", lbo.values.iter().map(|v| v / scale).collect::<Vec<_>>());
    }
    // ε = ½ of the torus's own unit.
    let slo = modes_of(Element::CatmullClark(&torus), Operator::Slo(Weight::One), 9, 0.5 * lbo.scale);
    let exact = [0.947815, 1.032331, 1.426633, 1.426633, 2.295331, 2.295331, 3.260859, 3.260859, 3.866499];
    for (v, e) in slo.values.iter().zip(exact) {
        assert!((v / e - 1.0).abs() < 5e-3, "{:?}", slo.values);
    }
    let jets = torus.jets(Quadrature::default()).unwrap();
    let total: f64 = jets
        .iter()
        .map(|(jet, w)| w * jet.area_normal().norm() * jet.forms().gaussian())
        .sum();
    assert!(total.abs() < 1e-10, "∫K = {total}");
}

//! Closed forms: spectra of spheres, tori and cylinders, curvature of limit surfaces.

#![expect(clippy::print_stdout, reason = "figures for people, with --nocapture")]

use crate::thesis::molecular_surface;
use geom_core::compute::random::SplitMix64;
use geom_core::io::structure::{ReadOptions, read};
use geom_core::mesh::shapes;
use geom_core::nalgebra::Rotation3;
use geom_core::search::crossing::crossing_pairs;
use geom_core::surface::remesh;
use geom_core::{Cpu, Point3, QuadMesh, Run, TriMesh, Vector3};
use proptest::prelude::*;
use secondfund_ops::catmull::{Jet, subdivide};
use secondfund_ops::flow::{filter_normals, filter_quad_normals};
use secondfund_ops::forms::{Conductor, Forms, Law, Symmetric, shape_diameter};
use secondfund_ops::options::{FlowOperator, Quadrature};
use secondfund_ops::segment::metrics::{cut_discrepancy, difference};
use secondfund_ops::segment::rivals::{concavity_aware, shape_diameter_mode};
use secondfund_ops::segment::{consensus, davies_bouldin, medoids, parts};
use secondfund_ops::testing::{
    box_errors, dimpled_ball, halved, rounded_box, shaken, shaken_quads,
};
use secondfund_ops::{
    BezierElement, BezierSurface, Element, Error, Faces, FilterOptions, FlowOptions, Groups, Modes,
    NormalFilter, Normals, Operator, PartOptions, SegmentOptions, Spectrum, SpectrumOptions,
    Surface, Weight, segment, smooth, smooth_quads, spectrum,
};

fn modes_of(
    element: Element<'_>,
    operator: Operator,
    modes: usize,
    regularization: f64,
) -> Spectrum {
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
        values[range]
            .iter()
            .map(|v| (v / exact - 1.0).abs())
            .fold(0.0, f64::max)
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
    assert!(
        errors[0] < 2e-3 && errors[1] < 4e-3,
        "{errors:?} {:?}",
        lbo.values
    );
    // λ = l(l+1) / (1 + ε² R²).
    let slo = modes_of(element, Operator::Slo(Weight::One), 8, 1.0);
    let errors = sphere_errors(&slo.values, |x| x / 1.25);
    assert!(
        errors[0] < 4e-3 && errors[1] < 6e-3,
        "{errors:?} {:?}",
        slo.values
    );
}

#[test]
fn spheres_of_quads_converge() {
    for (n, known, area) in [
        (4, [1.3e-4, 1.9e-3], 1.1e-4),
        (8, [2.2e-5, 2.4e-4], 1.7e-5),
        (16, [3.4e-6, 3.2e-5], 3.1e-6),
        (32, [4.8e-7, 4.2e-6], 5.1e-7),
    ] {
        let surface = Surface::interpolating(&shapes::quad_sphere(1.0, n)).unwrap();
        let lbo = modes_of(Element::CatmullClark(&surface), Operator::Lbo, 15, 0.5);
        let scale = lbo.scale * lbo.scale;
        let errors = sphere_errors(&lbo.values, |x| x * scale);
        let of_ball = lbo.areas.iter().sum::<f64>() * scale / 4.0 / std::f64::consts::PI;
        println!("{n} {errors:?} area {}", of_ball - 1.0);
        assert!((of_ball - 1.0).abs() < 1.3 * area, "{n}: {of_ball}");
        for k in 0..2 {
            assert!(errors[k] < 1.3 * known[k], "{n}: {errors:?}");
        }
    }
}

#[test]
fn a_torus_has_the_spectrum_of_the_fourier_solution() {
    let torus = Surface::interpolating(&shapes::quad_torus(1.0, 0.4, 48, 24)).unwrap();
    let lbo = modes_of(Element::CatmullClark(&torus), Operator::Lbo, 10, 0.5);
    let exact = [
        1.028956, 1.028956, 3.611378, 3.611378, 6.160800, 6.710149, 7.200141, 7.200141, 7.255942,
        7.255942,
    ];
    let scale = lbo.scale * lbo.scale;
    for (v, e) in lbo.values.iter().zip(exact) {
        assert!(
            (v / scale / e - 1.0).abs() < 1e-4,
            "{:?}",
            lbo.values.iter().map(|v| v / scale).collect::<Vec<_>>()
        );
    }
    // ε = ½ of the torus's own unit.
    let slo = modes_of(
        Element::CatmullClark(&torus),
        Operator::Slo(Weight::One),
        9,
        0.5 * lbo.scale,
    );
    let exact = [
        0.947815, 1.032331, 1.426633, 1.426633, 2.295331, 2.295331, 3.260859, 3.260859, 3.866499,
    ];
    for (v, e) in slo.values.iter().zip(exact) {
        assert!((v / e - 1.0).abs() < 5e-3, "{:?}", slo.values);
    }
    let jets = torus.jets(Quadrature::default()).unwrap();
    let total: f64 = jets
        .iter()
        .map(|(jet, w)| w * jet.area_normal().norm() * jet.forms().gaussian())
        .sum();
    assert!(total.abs() < 1e-12, "∫K = {total}");
}

/// Errors of the first three modes, of two operators of second derivatives, as the notes measured them.
#[test]
fn second_derivatives_of_spheres_converge() {
    for (n, gho, bare) in [
        (4, 1.9e-4, 2.5e-2),
        (8, 4e-5, 1.5e-2),
        (16, 5e-6, 6.8e-3),
        (32, 6.9e-7, 3.1e-3),
    ] {
        let surface = Surface::interpolating(&shapes::quad_sphere(1.0, n)).unwrap();
        let element = Element::CatmullClark(&surface);
        let worst = |operator, exact: &dyn Fn(f64) -> f64| {
            let modes = modes_of(element, operator, 3, 0.0);
            let exact = 2.0 * exact(modes.scale);
            let off = modes.values.iter().map(|v| (v / exact - 1.0).abs());
            off.fold(0.0, f64::max)
        };
        // l(l+1) / R³ in unit scale, and l(l+1) whatever the radius.
        let errors = [
            worst(Operator::Gho, &|scale| scale.powi(3)),
            worst(Operator::Slo(Weight::One), &|_| 1.0),
        ];
        println!("{n}: {errors:?}");
        assert!(
            errors[0] < 1.3 * gho && errors[1] < 1.3 * bare,
            "{n}: {errors:?}"
        );
    }
}

#[test]
fn a_convex_body_has_modes_of_the_giaquinta_hildebrandt_operator_and_a_torus_has_none() {
    let sphere = Surface::interpolating(&shapes::quad_sphere(1.0, 8)).unwrap();
    let gho = modes_of(Element::CatmullClark(&sphere), Operator::Gho, 8, 0.5);
    assert_eq!(gho.values.len(), 8);
    let torus = Surface::interpolating(&shapes::quad_torus(1.0, 0.4, 24, 12)).unwrap();
    let options = SpectrumOptions {
        operator: Operator::Gho,
        ..SpectrumOptions::default()
    };
    let none = spectrum(&Element::CatmullClark(&torus), &options, Run::on(&Cpu));
    assert_eq!(none.err(), Some(Error::Indefinite));
}

/// `∫ dA`, `∫ H dA`, `∫ K dA` over a surface.
fn totals(surface: &Surface, quadrature: Quadrature) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (jet, weight) in surface.jets(quadrature).unwrap() {
        let area = weight * jet.area_normal().norm();
        let forms = jet.forms();
        sums[0] += area;
        sums[1] += area * forms.mean();
        sums[2] += area * forms.gaussian();
    }
    sums
}

#[test]
fn an_ellipsoid_has_four_pi_of_curvature_and_turns_outwards() {
    let axes = Vector3::new(1.0, 0.7, 0.5);
    let (positions, quads) = shapes::quad_sphere(1.0, 16).into_parts();
    let positions: Vec<Point3> = positions
        .iter()
        .map(|p| Point3::from(p.coords.component_mul(&axes)))
        .collect();
    let mesh = QuadMesh::new(positions.clone(), quads.clone()).unwrap();
    let surface = Surface::interpolating(&mesh).unwrap();
    assert!(!surface.flipped());
    let [area, mean, gauss] = totals(&surface, Quadrature::default());
    let off = |gauss: f64| (gauss / 4.0 / std::f64::consts::PI - 1.0).abs();
    assert!(off(gauss) < 1.6e-6, "{}", off(gauss));
    for (n, known) in [(8, 3.3e-6), (32, 1.9e-7)] {
        let (positions, quads) = shapes::quad_sphere(1.0, n).into_parts();
        let squeezed = positions
            .iter()
            .map(|p| Point3::from(p.coords.component_mul(&axes)));
        let mesh = QuadMesh::new(squeezed.collect(), quads).unwrap();
        let surface = Surface::interpolating(&mesh).unwrap();
        let error = off(totals(&surface, Quadrature::default())[2]);
        assert!(error < 1.3 * known, "{n}: {error}");
    }
    assert!(mean > 0.0);
    // The limit passes through the samples.
    for (p, q) in surface.limit_positions().iter().zip(mesh.positions()) {
        assert!((p - q).norm() < 1e-11);
    }
    let back: Vec<[u32; 4]> = quads.iter().map(|&[a, b, c, d]| [a, d, c, b]).collect();
    let other = Surface::interpolating(&QuadMesh::new(positions, back).unwrap()).unwrap();
    assert!(other.flipped());
    for (a, b) in totals(&other, Quadrature::default())
        .iter()
        .zip([area, mean, gauss])
    {
        assert!((a - b).abs() < 1e-8 * b.abs(), "{a} {b}");
    }
}

#[test]
fn an_open_cylinder_is_curved_one_way() {
    let (around, along, radius) = (24u32, 8u32, 1.5);
    let positions = (0..=along).flat_map(|j| {
        (0..around).map(move |i| {
            let u = std::f64::consts::TAU * f64::from(i) / f64::from(around);
            Point3::new(radius * u.cos(), radius * u.sin(), 0.4 * f64::from(j))
        })
    });
    let at = |i: u32, j: u32| j * around + i % around;
    let quads: Vec<[u32; 4]> = (0..along * around)
        .map(|q| (q % around, q / around))
        .map(|(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
        .collect();
    let surface =
        Surface::interpolating(&QuadMesh::new(positions.collect(), quads).unwrap()).unwrap();
    for (jet, _) in surface.jets(Quadrature::default()).unwrap() {
        let principal = jet.forms().principal();
        assert!((principal.max * radius - 1.0).abs() < 5e-3, "{principal:?}");
        assert!(principal.min.abs() < 1e-9, "{principal:?}");
    }
    let area = totals(&surface, Quadrature::default())[0];
    let exact = std::f64::consts::TAU * radius * 3.2;
    assert!((area / exact - 1.0).abs() < 1e-4, "{area} {exact}");
}

#[test]
fn limit_positions_survive_a_subdivision() {
    // Corners of valence 3 among those of valence 4.
    let surface = Surface::new(rounded_box([1.0, 0.9, 0.8], 0.3, 3)).unwrap();
    let finer = Surface::new(subdivide(surface.control()).unwrap()).unwrap();
    let both = surface.limit_positions();
    for (p, q) in both.iter().zip(finer.limit_positions()) {
        assert!((p - q).norm() < 1e-14);
    }
    let fine = Quadrature {
        points: 8,
        depth: 10,
    };
    for (a, b) in totals(&surface, fine).iter().zip(totals(&finer, fine)) {
        assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
    }
}

/// Valences 3, 4 and 5 in one closed net; an affine map of the net is that of its surface.
#[test]
fn surfaces_of_mixed_valence_follow_their_nets() {
    let net = halved(&shapes::icosphere(1.0, 0));
    let surface = Surface::new(net.clone()).unwrap();
    let finer = Surface::new(subdivide(surface.control()).unwrap()).unwrap();
    for (p, q) in surface
        .limit_positions()
        .iter()
        .zip(finer.limit_positions())
    {
        assert!((p - q).norm() < 1e-15 * 10.0);
    }
    let map = |p: &Point3| Point3::new(2.0 * p.x + p.y, p.y - 0.5 * p.z + 3.0, 0.7 * p.z + p.x);
    let (positions, quads) = net.into_parts();
    let moved = QuadMesh::new(positions.iter().map(map).collect(), quads).unwrap();
    let moved = Surface::new(moved).unwrap();
    let rule = Quadrature::default();
    let jets = |s: &Surface| s.jets(rule).unwrap();
    for ((a, _), (b, _)) in jets(&surface).iter().zip(jets(&moved)) {
        assert!((map(&a.position) - b.position).norm() < 1e-12);
        let linear = |v: &Vector3| map(&Point3::from(*v)) - map(&Point3::origin());
        assert!((linear(&a.first[0]) - b.first[0]).norm() < 1e-12);
    }
}

/// Neither where a quad begins nor the unit of length changes the curvature; λ is that of the scaled body.
#[test]
fn curvature_does_not_depend_on_parameters_and_scales() {
    let net = rounded_box([1.0, 0.9, 0.8], 0.3, 4);
    let (positions, quads) = net.clone().into_parts();
    let turned = quads.iter().zip(0..).map(|(q, f)| {
        let mut q = *q;
        q.rotate_left(f % 4);
        q
    });
    let turned = QuadMesh::new(positions.clone(), turned.collect()).unwrap();
    let scaled = positions.iter().map(|p| p * 3.0).collect();
    let scaled = Surface::new(QuadMesh::new(scaled, quads).unwrap()).unwrap();
    let (one, other) = (Surface::new(net).unwrap(), Surface::new(turned).unwrap());
    let rule = Quadrature::default();
    let [area, mean, gauss] = totals(&one, rule);
    for (a, b) in totals(&other, rule).iter().zip([area, mean, gauss]) {
        assert!((a / b - 1.0).abs() < 1e-10, "{a} {b}");
    }
    for (a, b) in totals(&scaled, rule)
        .iter()
        .zip([9.0 * area, 3.0 * mean, gauss])
    {
        assert!((a / b - 1.0).abs() < 1e-10, "{a} {b}");
    }
    let values =
        |s: &Surface| modes_of(Element::CatmullClark(s), Operator::Slo(Weight::One), 5, 0.5).values;
    for (a, b) in values(&one).iter().zip(values(&scaled)) {
        assert!((a / b - 1.0).abs() < 1e-7, "{a} {b}");
    }
}

/// The secondary operator on a ball of quads, and mean curvature on an ellipsoid, converge as measured.
#[test]
fn second_derivatives_of_quads_converge() {
    let sphere = Surface::interpolating(&shapes::quad_sphere(1.0, 16)).unwrap();
    // ε = ½ of the radius: λ = 2 / (1 + ¼).
    let element = Element::CatmullClark(&sphere);
    let slo = modes_of(element, Operator::Slo(Weight::One), 3, 1.0).values;
    assert!(slo.iter().all(|v| (1.6..1.608).contains(v)), "{slo:?}");
    // Without regularization the error is that of curvature at extraordinary vertices, of first order.
    let bare = modes_of(element, Operator::Slo(Weight::One), 3, 0.0).values;
    assert!(
        bare.iter().all(|v| (v / 2.0 - 1.0).abs() < 8e-3),
        "{bare:?}"
    );

    let axes = Vector3::new(1.0, 0.7, 0.5);
    let median = |n: u32| {
        let (positions, quads) = shapes::quad_sphere(1.0, n).into_parts();
        let positions = positions
            .iter()
            .map(|p| Point3::from(p.coords.component_mul(&axes)));
        let mesh = QuadMesh::new(positions.collect(), quads).unwrap();
        let jets = Surface::interpolating(&mesh)
            .unwrap()
            .jets(Quadrature::default())
            .unwrap();
        let squares = axes.component_mul(&axes);
        let exact = |p: &Point3| {
            let h = p.coords.component_div(&squares).norm();
            (squares.sum() - p.coords.norm_squared()) / (2.0 * axes.product().powi(2) * h.powi(3))
        };
        let error = |jet: &Jet| (jet.forms().mean() / exact(&jet.position) - 1.0).abs();
        let mut errors: Vec<f64> = jets.iter().map(|(jet, _)| error(jet)).collect();
        errors.sort_by(f64::total_cmp);
        errors[errors.len() / 2]
    };
    let [coarse, fine, finest] = [8, 16, 32].map(median);
    println!("median error of H: {coarse} {fine} {finest}");
    assert!(fine < 6e-3 && fine < 0.5 * coarse, "{coarse} {fine}");
    assert!(finest < 4e-4, "{finest}");
}

/// The same waves are detail on a thick body, a ball, and shape on one as thin as they are long, a ring. What is left of them:
/// the root mean square distance of normals from those of the body without waves, over that of the mesh's own normals.
#[test]
fn detail_is_what_is_small_beside_the_thickness() {
    let height = |angle: f64| 0.01 * (20.0 * angle).sin();
    let waved = |body: &TriMesh, outward: &dyn Fn(&Point3) -> (Vector3, f64)| {
        let outward: Vec<_> = body.positions().iter().map(outward).collect();
        let places = body.positions().iter().zip(&outward);
        let places = places.map(|(p, (n, angle))| p + n * height(*angle));
        let mesh = TriMesh::new(places.collect(), body.triangles().to_vec()).unwrap();
        let left = |detail: f64| {
            let Ok(Normals::Given(normals)) = Normals::without_detail(&mesh, 3, detail) else {
                panic!("no normals");
            };
            let off = normals.iter().zip(&outward);
            off.map(|(n, (m, _))| (n - m).norm_squared())
                .sum::<f64>()
                .sqrt()
        };
        left(Normals::DETAIL) / left(0.0)
    };
    let ball = waved(&shapes::icosphere(1.0, 5), &|p| (p.coords, p.z.acos()));
    let ring = waved(&shapes::torus(1.0, 0.1, 240, 24), &|p| {
        let middle = Vector3::new(p.x, p.y, 0.0).normalize();
        ((p.coords - middle).normalize(), p.y.atan2(p.x))
    });
    println!("of waves is left {ball:.2} on a ball and {ring:.2} on a ring");
    assert!(ball < 0.35 && ring > 0.9, "{ball} {ring}");
}

/// Nothing lies behind a bent sheet, so that all of its detail stays, next to a triangle without area and an unused vertex, too.
#[test]
fn a_sheet_has_no_detail() {
    let side = 12u32;
    let at = |i: u32, j: u32| j * (side + 1) + i;
    let place = |i: u32, j: u32| {
        let [x, y] = [i, j].map(f64::from);
        Point3::new(x, y, 0.3 * (x + 0.5 * y).sin())
    };
    let mut positions: Vec<Point3> = (0..=side)
        .flat_map(|j| (0..=side).map(move |i| place(i, j)))
        .collect();
    let line = positions.len() as u32;
    positions.extend([0.0, 1.0, 2.0, 3.0].map(|x| Point3::new(x, -5.0, 0.0)));
    let mut triangles: Vec<[u32; 3]> = (0..side * side)
        .flat_map(|q| {
            let (i, j) = (q % side, q / side);
            let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
            [[a, b, c], [a, c, d]]
        })
        .collect();
    triangles.push([line, line + 1, line + 2]);
    let sheet = TriMesh::new(positions, triangles).unwrap();
    let of = |detail| Normals::without_detail(&sheet, 1, detail).unwrap();
    let (Normals::Given(own), Normals::Given(plain)) = (of(0.0), of(0.5)) else {
        panic!("normals by vertex");
    };
    assert!(
        own[..line as usize]
            .iter()
            .all(|n| n.z > 0.9 && (n.norm() - 1.0).abs() < 1e-12)
    );
    let off = own.iter().zip(&plain).map(|(a, b)| (a - b).norm());
    assert!(off.fold(0.0, f64::max) < 1e-12);
}

/// Normals of a sphere as they are, and those of its mesh, give nearly the same spectrum.
#[test]
fn given_normals_and_those_of_the_mesh_agree() {
    let ball = shapes::icosphere(1.0, 4);
    let given = Normals::Given(ball.positions().iter().map(|p| p.coords).collect());
    let of_mesh = Normals::OfMesh { rounds: 0 };
    let values = |normals| {
        modes_of(
            Element::Triangles(&ball, normals),
            Operator::Slo(Weight::One),
            8,
            0.5,
        )
        .values
    };
    let (a, b) = (values(&given), values(&of_mesh));
    for (a, b) in a.iter().zip(b) {
        assert!((a / b - 1.0).abs() < 2e-3, "{a} {b}");
    }
}

/// A torus net of this many quads as Bézier elements: uniform cubic B-splines along both ways, and its nodes' numbers.
fn bezier_torus(net: &QuadMesh, around: u32, along: u32) -> BezierSurface {
    // Bernstein coefficients of the four B-splines over an interval.
    let spline = [
        [1.0, 0.0, 0.0, 0.0],
        [4.0, 4.0, 2.0, 1.0],
        [1.0, 2.0, 4.0, 4.0],
        [0.0, 0.0, 0.0, 1.0],
    ]
    .map(|row: [f64; 4]| row.map(|c| c / 6.0));
    let number = |i: u32, j: u32| (i % around) * along + j % along;
    let element = |(i, j): (u32, u32)| {
        let places: Vec<(u32, u32)> = (0..16).map(|k| (k % 4, k / 4)).collect();
        BezierElement {
            nodes: places
                .iter()
                .map(|&(a, b)| number(i + around + a - 1, j + along + b - 1))
                .collect(),
            rows: places
                .iter()
                .map(|&(a, b)| {
                    std::array::from_fn(|c| spline[a as usize][c % 4] * spline[b as usize][c / 4])
                })
                .collect(),
        }
    };
    let nodes: Vec<[f64; 4]> = net
        .positions()
        .iter()
        .map(|p| [p.x, p.y, p.z, 1.0])
        .collect();
    let all = (0..along).flat_map(|j| (0..around).map(move |i| (i, j)));
    BezierSurface::new(&nodes, all.map(element).collect()).unwrap()
}

/// A regular net is the same surface either way, with the same spectra; a function of coefficients is evaluated.
#[test]
fn bezier_elements_are_the_limit_surface_of_regular_nets() {
    let (around, along) = (16, 10);
    let net = shapes::quad_torus(1.0, 0.4, around, along);
    let surface = Surface::new(net.clone()).unwrap();
    let elements = bezier_torus(surface.control(), around, along);
    for operator in [
        Operator::Lbo,
        Operator::Slo(Weight::ExpK),
        Operator::Concave(Weight::One),
    ] {
        let a = modes_of(Element::CatmullClark(&surface), operator.clone(), 6, 0.5);
        let b = modes_of(Element::Bezier(&elements), operator, 6, 0.5);
        assert!((a.scale / b.scale - 1.0).abs() < 1e-12);
        for (x, y) in a.values.iter().zip(&b.values) {
            assert!((x / y - 1.0).abs() < 1e-7, "{:?} {:?}", a.values, b.values);
        }
        assert_eq!(
            (b.modes[0].len(), b.components.iter().max()),
            (160, Some(&0))
        );
    }
    let ones = vec![2.0; elements.nodes()];
    assert!((elements.value(3, [0.3, 0.9], &ones) - 2.0).abs() < 1e-14);
}

/// A quarter of a cylinder by rational arcs: exactly round, straight the other way.
#[test]
fn rational_elements_are_exactly_round() {
    let w = std::f64::consts::FRAC_1_SQRT_2;
    // The quadratic arc (1, 0), (1, 1), (0, 1) with weights 1, w, 1, raised to cubic.
    let quadratic = [[1.0, 0.0, 1.0], [w, w, w], [0.0, 1.0, 1.0]];
    let raised = |k: usize| -> [f64; 3] {
        let t = k as f64 / 3.0;
        std::array::from_fn(|c| {
            let of = |i: usize| quadratic.get(i).map_or(0.0, |p| p[c]);
            (if k > 0 { t * of(k - 1) } else { 0.0 }) + (1.0 - t) * of(k)
        })
    };
    let radius = 2.5;
    let nodes: Vec<[f64; 4]> = (0..16)
        .map(|k| {
            let [x, y, w] = raised(k % 4);
            [radius * x / w, radius * y / w, (k / 4) as f64, w]
        })
        .collect();
    let unit = |k: usize| std::array::from_fn(|c| f64::from(u8::from(c == k)));
    let patch = BezierElement {
        nodes: (0..16).collect(),
        rows: (0..16).map(unit).collect(),
    };
    let surface = BezierSurface::new(&nodes, vec![patch.clone()]).unwrap();
    for (jet, _) in surface.jets(Quadrature::default()).unwrap() {
        assert!((jet.position.coords.xy().norm() - radius).abs() < 1e-12);
        let principal = jet.forms().principal();
        assert!(
            (principal.max * radius - 1.0).abs() < 1e-10,
            "{principal:?}"
        );
        assert!(principal.min.abs() < 1e-10, "{principal:?}");
    }
    let refused =
        |nodes: &[[f64; 4]], patch: BezierElement| BezierSurface::new(nodes, vec![patch]).err();
    let mut light = nodes.clone();
    light[5][3] = 0.0;
    assert_eq!(
        refused(&light, patch.clone()),
        Some(Error::Node { node: 5 })
    );
    let mut wrong = [patch.clone(), patch.clone(), patch.clone(), patch];
    wrong[0].nodes[3] = 16;
    wrong[1].nodes[3] = 4;
    wrong[2].rows.truncate(7);
    wrong[3].rows[2][1] = f64::NAN;
    for patch in wrong {
        assert!(matches!(
            refused(&nodes, patch),
            Some(Error::Element { element: 0, .. })
        ));
    }
}

/// This many quads around a boundary vertex, which is vertex 0, bent upwards.
fn fan(quads: u32) -> QuadMesh {
    let n = f64::from(quads);
    let at = |turn: f64, radius: f64| {
        let (sin, cos) = (turn * std::f64::consts::PI / n).sin_cos();
        let (x, y) = (radius * cos, radius * sin);
        Point3::new(x, y, 0.3 * x * x + 0.1 * x * y + 0.2 * y)
    };
    let spokes = (0..=quads).map(|j| at(f64::from(j), 1.0));
    let across = (0..quads).map(|j| at(f64::from(j) + 0.5, 1.4));
    let positions = [Point3::origin()].into_iter().chain(spokes).chain(across);
    let faces = (0..quads).map(|j| [0, 1 + j, 2 + quads + j, 2 + j]);
    QuadMesh::new(positions.collect(), faces.collect()).unwrap()
}

/// Boundaries with any number of quads at a vertex: the patches are the limit of subdivision.
#[test]
fn rims_of_many_quads_are_the_limit_of_subdivision() {
    let fine = Quadrature {
        points: 8,
        depth: 12,
    };
    for quads in 3..=7 {
        let surface = Surface::new(fan(quads)).unwrap();
        assert_eq!(surface.rough_rims().is_empty(), quads == 3);
        let finer = Surface::new(subdivide(surface.control()).unwrap()).unwrap();
        for (p, q) in surface
            .limit_positions()
            .iter()
            .zip(finer.limit_positions())
        {
            assert!((p - q).norm() < 1e-14);
        }
        let [area, mean, _] = totals(&surface, fine);
        let [other, bent, _] = totals(&finer, fine);
        assert!((area / other - 1.0).abs() < 1e-5, "{quads}: {area} {other}");
        // Quads at their limit positions after four steps.
        let steps = (0..4).fold(surface.control().clone(), |m, _| subdivide(&m).unwrap());
        let limit = Surface::new(steps).unwrap().limit_mesh().into_triangles();
        assert!(
            (limit.area() / area - 1.0).abs() < 2e-3,
            "{quads}: {} {area}",
            limit.area()
        );
        if quads == 3 {
            assert!((mean / bent - 1.0).abs() < 1e-4, "{mean} {bent}");
        }
        let flat = |p: &Point3| Point3::new(p.x, p.y, 0.0);
        let (positions, faces) = fan(quads).into_parts();
        let plane = QuadMesh::new(positions.iter().map(flat).collect(), faces).unwrap();
        for (jet, _) in Surface::new(plane).unwrap().jets(fine).unwrap() {
            assert!(
                jet.position.z == 0.0 && jet.first.iter().chain(&jet.second).all(|d| d.z == 0.0)
            );
        }
    }
}

/// A ball without one of its quads: four boundary vertices of three quads each. Its spectrum is nearly the ball's.
#[test]
fn a_ball_with_a_hole_is_round_up_to_its_rim() {
    let (positions, quads) = shapes::quad_sphere(1.0, 12).into_parts();
    let open = QuadMesh::new(positions, quads[1..].to_vec()).unwrap();
    let surface = Surface::interpolating(&open).unwrap();
    assert!(surface.refined() && surface.rough_rims().is_empty());
    let area = totals(&surface, Quadrature::default())[0];
    let hole = QuadMesh::new(open.positions().to_vec(), vec![quads[0]])
        .unwrap()
        .area();
    let exact = 4.0 * std::f64::consts::PI - hole;
    assert!((area / exact - 1.0).abs() < 1e-3, "{area} {exact}");
    let modes = modes_of(
        Element::CatmullClark(&surface),
        Operator::Slo(Weight::One),
        8,
        0.5,
    );
    // λ = l(l+1) / (1 + ε² R²) with R = ½.
    let errors = sphere_errors(&modes.values, |x| x / (1.0 + 0.25 * 0.25));
    println!("{errors:?} {:?}", modes.values);
    assert!(errors[0] < 0.02 && errors[1] < 0.03, "{errors:?}");
}

proptest! {
    #![proptest_config(geom_core::testing::cases(256))]

    /// `A_ε ≤ Ψ²/ε² g⁻¹`, and without regularization `Ψ² b⁻¹ g b⁻¹`.
    #[test]
    fn the_secondary_operator_is_bounded(
        (p, q, r) in (-2.0..2.0f64, -2.0..2.0f64, -2.0..2.0f64),
        (x, y, z) in (-5.0..5.0f64, -5.0..5.0f64, -5.0..5.0f64),
        epsilon in 0.05..3.0f64,
    ) {
        let first = Symmetric::new(p * p + 0.3, p * r, q * q + r * r + 0.3);
        prop_assume!(first.determinant() > 0.05);
        let forms = Forms { first, second: Symmetric::new(x, y, z) };
        let conductor = |regularization| Conductor {
            law: Law::GaussImage,
            gauss: 1.0,
            mean: 0.0,
            bounds: [0.5, 10.0],
            regularization,
            limit: f64::INFINITY,
            sharpen: 0.0,
        };
        let a = conductor(epsilon).at(&forms, 1.0);
        let psi = conductor(epsilon).psi(&forms, 1.0);
        let bound = first.inverse() * (psi * psi / (epsilon * epsilon));
        let (_, least, _) = (bound + a * -1.0).eigen();
        prop_assert!(least >= -1e-9 * bound.trace(), "{least}");
        prop_assert!(a.eigen().1 > 0.0);
        prop_assume!(forms.second.determinant().abs() > 0.1);
        let inverse = forms.second.inverse();
        let exact = inverse.around(first) * (psi * psi);
        let limit = conductor(0.0).at(&forms, 1.0);
        let off = (exact.xx - limit.xx).abs() + (exact.xy - limit.xy).abs() + (exact.yy - limit.yy).abs();
        prop_assert!(off < 1e-6 * exact.trace(), "{off} {exact:?}");
    }
}

#[test]
fn bad_input_is_named() {
    let sphere = shapes::icosphere(1.0, 1);
    let normals = Normals::default();
    let element = Element::Triangles(&sphere, &normals);
    let run = |options: &SpectrumOptions| spectrum(&element, options, Run::on(&Cpu)).err().unwrap();
    let with = |operator| SpectrumOptions {
        operator,
        ..SpectrumOptions::default()
    };
    let many = SpectrumOptions {
        modes: 42,
        ..SpectrumOptions::default()
    };
    assert_eq!(
        run(&many),
        Error::TooManyModes {
            asked: 42,
            vertices: 42
        }
    );
    assert!(matches!(
        run(&with(Operator::Slo(Weight::Field(vec![1.0; 3])))),
        Error::Length { expected: 42, .. }
    ));
    let mut field = vec![1.0; 42];
    field[7] = 0.0;
    assert_eq!(
        run(&with(Operator::Slo(Weight::Field(field)))),
        Error::Field { vertex: 7 }
    );
    let none = SpectrumOptions {
        modes: 0,
        ..SpectrumOptions::default()
    };
    assert!(matches!(run(&none), Error::Option(o) if o.option == "modes"));
    let few = SpectrumOptions {
        modes: 4,
        ..SpectrumOptions::default()
    };
    let few = spectrum(&element, &few, Run::on(&Cpu)).unwrap();
    let asked = SegmentOptions {
        modes: Modes::Count(5),
        ..SegmentOptions::default()
    };
    let error = segment(&few, &Faces::from(&sphere), &asked, Run::on(&Cpu)).unwrap_err();
    assert!(matches!(error, Error::Option(o) if o.option == "modes"));
    let negative = SpectrumOptions {
        regularization: -1.0,
        ..SpectrumOptions::default()
    };
    assert!(matches!(run(&negative), Error::Option(_)));
    for detail in [-0.1, f64::NAN] {
        let error = Normals::without_detail(&sphere, 3, detail).unwrap_err();
        assert!(matches!(error, Error::Option(o) if o.option == "detail"));
    }
    let empty = TriMesh::new(Vec::new(), Vec::new()).unwrap();
    let error = Normals::without_detail(&empty, 3, 0.05).unwrap_err();
    assert_eq!(error, Error::NoExtent);
    let other = Normals::Given(vec![Vector3::z(); 5]);
    let wrong = spectrum(
        &Element::Triangles(&sphere, &other),
        &SpectrumOptions::default(),
        Run::on(&Cpu),
    );
    assert!(matches!(wrong.err(), Some(Error::Length { .. })));

    // A flat triangle has no finite conductivity without regularization.
    let flat = TriMesh::new(
        [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [1.0, 1.0, 0.0],
        ]
        .map(Point3::from)
        .to_vec(),
        vec![[0, 1, 2], [1, 3, 2]],
    )
    .unwrap();
    let bare = SpectrumOptions {
        regularization: 0.0,
        modes: 1,
        ..SpectrumOptions::default()
    };
    let found = spectrum(&Element::Triangles(&flat, &normals), &bare, Run::on(&Cpu));
    assert_eq!(found.err(), Some(Error::Flat { element: 0 }));
    let nothing = spectrum(
        &Element::Triangles(&TriMesh::default(), &normals),
        &bare,
        Run::on(&Cpu),
    );
    assert_eq!(nothing.err(), Some(Error::NoExtent));

    // More quads than there are tables for at a boundary vertex, and two at an inner one.
    assert!(matches!(
        Surface::new(fan(33)).err(),
        Some(Error::Valence {
            vertex: 0,
            quads: 33,
            ..
        })
    ));
    let ring: Vec<Point3> = (0..8)
        .map(|k| Point3::new((f64::from(k) * 0.7).cos(), (f64::from(k) * 0.7).sin(), 0.0))
        .collect();
    let pillow = QuadMesh::new(ring, vec![[0, 1, 2, 3], [3, 2, 1, 0]]).unwrap();
    assert!(matches!(
        Surface::new(pillow).err(),
        Some(Error::Valence { quads: 2, .. })
    ));

    let modes = spectrum(&element, &SpectrumOptions::default(), Run::on(&Cpu)).unwrap();
    let faces = Faces::from(&sphere);
    let one = SegmentOptions {
        groups: Groups::Count(1),
        ..SegmentOptions::default()
    };
    assert!(matches!(
        segment(&modes, &faces, &one, Run::on(&Cpu)).err(),
        Some(Error::Option(_))
    ));
    let larger = Faces::from(&shapes::icosphere(1.0, 2));
    assert!(matches!(
        segment(&modes, &larger, &SegmentOptions::default(), Run::on(&Cpu)).err(),
        Some(Error::Length { .. })
    ));
}

// ── segmentation

/// Two balls that overlap, as one surface: the distance from the origin along each direction.
fn dumbbell() -> TriMesh {
    let (positions, triangles) = shapes::icosphere(1.0, 4).into_parts();
    let pinch = |p: &Point3| {
        let waist = 1.0 - 0.75 * (-(p.x / 0.25).powi(2)).exp();
        Point3::new(2.0 * p.x, p.y * waist, p.z * waist)
    };
    TriMesh::new(positions.iter().map(pinch).collect(), triangles).unwrap()
}

/// On a convex body nothing is concave: the operator is the Laplace operator over ε². At a waist it conducts less.
#[test]
fn the_concave_operator_sees_concave_directions_only() {
    let sphere = shapes::icosphere(1.0, 4);
    let normals = Normals::default();
    let element = Element::Triangles(&sphere, &normals);
    let lbo = modes_of(element, Operator::Lbo, 8, 0.5).values;
    let concave = modes_of(element, Operator::Concave(Weight::One), 8, 0.5).values;
    for (a, b) in lbo.iter().zip(&concave) {
        assert!((b / a - 4.0).abs() < 1e-6, "{a} {b}");
    }
    let dumbbell = dumbbell();
    let element = Element::Triangles(&dumbbell, &normals);
    let lbo = modes_of(element, Operator::Lbo, 3, 0.5).values;
    let concave = modes_of(element, Operator::Concave(Weight::One), 3, 0.5).values;
    let gap = |values: &[f64]| values[1] / values[0];
    assert!(gap(&concave) > 1.5 * gap(&lbo), "{lbo:?} {concave:?}");
}

#[test]
fn parts_of_a_dumbbell_are_its_two_ends_whatever_the_seed() {
    let mesh = dumbbell();
    let normals = Normals::default();
    let (element, faces) = (Element::Triangles(&mesh, &normals), Faces::from(&mesh));
    let left: Vec<bool> = (0..mesh.triangles().len())
        .map(|t| mesh.corners(t).iter().map(|p| p.x).sum::<f64>() < 0.0)
        .collect();
    for seed in 1..4 {
        let options = PartOptions {
            seed,
            ..PartOptions::default()
        };
        let found = parts(&element, &faces, &options, Run::on(&Cpu)).unwrap();
        assert_eq!(
            (found.areas.len(), found.sought),
            (2, 2),
            "{:?}",
            found.choices
        );
        let overlap = best_overlap(&found.labels, faces.areas(), &left);
        assert!(overlap > 0.97, "{overlap}");
        assert_eq!(found.spectra.len(), options.operators.len());
    }
    let none = PartOptions {
        operators: Vec::new(),
        ..PartOptions::default()
    };
    assert!(none.check().is_err());
}

/// What most labelings say holds, names do not matter, and a labeling agrees with itself.
#[test]
fn a_consensus_differs_least_from_its_labelings() {
    let mesh = shapes::torus(3.0, 1.0, 24, 12);
    let faces = Faces::from(&mesh);
    let n = faces.len();
    let sector = |f: usize, parts: usize, shift: f64| {
        let [a, b, c] = mesh.corners(f);
        let p = (a.coords + b.coords + c.coords) / 3.0;
        let turn = p.y.atan2(p.x) / std::f64::consts::TAU + 1.0 + shift;
        (turn.fract() * parts as f64) as u32
    };
    let cut = |parts, shift| (0..n).map(|f| sector(f, parts, shift)).collect::<Vec<_>>();
    let one = cut(5, 0.0);
    let rand = |a: &[u32], b: &[u32]| difference(a, b, faces.areas()).unwrap().rand;
    let same = consensus(&faces, std::slice::from_ref(&one)).unwrap();
    assert_eq!(rand(&same, &one), 0.0);
    let all = [
        one.clone(),
        cut(5, 0.01),
        cut(5, -0.01),
        cut(4, 0.3),
        cut(6, 0.1),
    ];
    let common = consensus(&faces, &all).unwrap();
    let mean = |l: &[u32]| all.iter().map(|other| rand(l, other)).sum::<f64>();
    for each in &all {
        assert!(
            mean(&common) <= mean(each) + 1e-9,
            "{} {}",
            mean(&common),
            mean(each)
        );
    }
    let renamed = all
        .clone()
        .map(|l| l.iter().map(|x| 90 - 7 * x).collect::<Vec<_>>());
    assert_eq!(rand(&consensus(&faces, &renamed).unwrap(), &common), 0.0);
    assert!(consensus(&faces, &[]).is_err() && consensus(&faces, &[vec![0; 3]]).is_err());
}

/// Ragged borders become straight, those along creases stay where they are.
#[test]
fn borders_are_straight_unless_creases_hold_them() {
    let mesh = dumbbell();
    let normals = Normals::default();
    let modes = modes_of(
        Element::Triangles(&mesh, &normals),
        Operator::Concave(Weight::One),
        3,
        0.5,
    );
    let faces = Faces::from(&mesh);
    let length = |labels: &[u32]| cut_length(&mesh, labels);
    let cut = |smooth| {
        let options = SegmentOptions {
            groups: Groups::Count(5),
            smooth,
            ..SegmentOptions::default()
        };
        segment(&modes, &faces, &options, Run::on(&Cpu))
            .unwrap()
            .labels
    };
    let (raw, smooth) = (length(&cut(false)), length(&cut(true)));
    assert!(smooth < 0.95 * raw, "{smooth} of {raw}");
}

/// The length of the edges between different labels.
fn cut_length(mesh: &TriMesh, labels: &[u32]) -> f64 {
    let mut sides: Vec<([u32; 2], u32)> = mesh
        .triangles()
        .iter()
        .zip(labels)
        .flat_map(|(&[a, b, c], &l)| {
            [[a, b], [b, c], [c, a]].map(|[a, b]| ([a.min(b), a.max(b)], l))
        })
        .collect();
    sides.sort_unstable();
    let at = |v: u32| mesh.positions()[v as usize];
    sides
        .chunk_by(|a, b| a.0 == b.0)
        .filter(|edge| edge.iter().any(|s| s.1 != edge[0].1))
        .map(|edge| (at(edge[0].0[0]) - at(edge[0].0[1])).norm())
        .sum()
}

/// The diameter of a ball is nearly its diameter; its Laplacian without concave vertices has no small eigenvalue, and
/// a waist gives it one.
#[test]
fn rivals_see_what_they_are_made_for() {
    let ball = shapes::icosphere(2.0, 3);
    let diameters = shape_diameter(&ball).unwrap();
    // Rays up to 60° from the axis: chords of 4 cos.
    assert!(
        diameters.iter().all(|d| (2.8..4.01).contains(d)),
        "{:?}",
        &diameters[..4]
    );
    let gap = |mesh: &TriMesh| {
        let values = concavity_aware(mesh, 3, Run::on(&Cpu)).unwrap().values;
        values[1] / values[0]
    };
    assert!(
        gap(&ball) < 1.5 && gap(&dumbbell()) > 8.0,
        "{} {}",
        gap(&ball),
        gap(&dumbbell())
    );
    let mode = shape_diameter_mode(&dumbbell(), Run::on(&Cpu)).unwrap();
    assert_eq!(mode.modes.len(), 1);
    assert!(
        mode.modes[0]
            .iter()
            .all(|x| (-1e-9..=1.0 + 1e-9).contains(x))
    );
}

/// The segment that holds most of a set of faces, and the Jaccard index of both.
fn best_overlap(labels: &[u32], areas: &[f64], inside: &[bool]) -> f64 {
    let count = labels.iter().max().unwrap() + 1;
    (0..count)
        .map(|l| {
            let (mut both, mut either) = (0.0, 0.0);
            for f in 0..labels.len() {
                both += if labels[f] == l && inside[f] {
                    areas[f]
                } else {
                    0.0
                };
                either += if labels[f] == l || inside[f] {
                    areas[f]
                } else {
                    0.0
                };
            }
            both / either
        })
        .fold(0.0, f64::max)
}

#[test]
fn a_rounded_box_falls_into_its_six_faces() {
    let mesh = rounded_box([1.0, 0.8, 0.6], 0.12, 24).into_triangles();
    let normals = Normals::OfMesh { rounds: 0 };
    let element = Element::Triangles(&mesh, &normals);
    let faces = Faces::from(&mesh);
    let asked = SegmentOptions {
        groups: Groups::Count(6),
        ..SegmentOptions::default()
    };
    let worst_face = |operator| {
        let modes = modes_of(element, operator, 8, 0.5);
        let segments = segment(&modes, &faces, &asked, Run::on(&Cpu)).unwrap();
        let side = |axis: usize, sign: f64| {
            let flat: Vec<bool> = (0..mesh.triangles().len())
                .map(|t| mesh.doubled_area_normal(t).normalize()[axis] * sign > 0.8)
                .collect();
            best_overlap(&segments.labels, faces.areas(), &flat)
        };
        let worst = (0..6)
            .map(|k| side(k / 2, if k % 2 == 0 { 1.0 } else { -1.0 }))
            .fold(1.0, f64::min);
        (worst, modes)
    };
    let (slo, modes) = worst_face(Operator::Slo(Weight::One));
    let values = &modes.values;
    let (lbo, _) = worst_face(Operator::Lbo);
    println!("worst face: SLO {slo}, LBO {lbo}; {values:?}");
    assert!(slo > 0.9, "{slo}");
    assert!(lbo < 0.7, "{lbo}");
    assert!(values[5] / values[4] > 4.0, "{values:?}");

    // Six is what both indices find, too; that of Davies and Bouldin likes eight as well.
    for groups in [
        Groups::Silhouette { most: 8 },
        Groups::DaviesBouldin { most: 7 },
    ] {
        let sought = SegmentOptions {
            groups,
            modes: Modes::Count(6),
            ..SegmentOptions::default()
        };
        let found = segment(&modes, &faces, &sought, Run::on(&Cpu)).unwrap();
        assert_eq!(found.groups, 6, "{groups:?}: {:?}", found.choices);
    }
}

/// The faces of a rounded box are what both paths see, on its quads and on the triangles of these.
#[test]
fn triangles_and_quads_tell_the_same() {
    let quads = rounded_box([1.0, 0.8, 0.6], 0.12, 16);
    let surface = Surface::interpolating(&quads).unwrap();
    let triangles = quads.into_triangles();
    let normals = Normals::OfMesh { rounds: 0 };
    let values = |element| modes_of(element, Operator::Slo(Weight::One), 6, 0.5).values;
    let smooth = values(Element::CatmullClark(&surface));
    let flat = values(Element::Triangles(&triangles, &normals));
    println!("{smooth:.4?} {flat:.4?}");
    for (a, b) in smooth.iter().zip(&flat) {
        assert!((a / b - 1.0).abs() < 0.3, "{smooth:?} {flat:?}");
    }
    for values in [smooth, flat] {
        assert!(values[5] / values[4] > 4.0, "{values:?}");
    }
}

#[test]
fn dimples_are_segments_of_exp_minus_h() {
    let directions = [Vector3::x(), Vector3::y(), Vector3::new(-1.0, -1.0, 0.5)];
    let ball = dimpled_ball(4, &directions, 0.25, 0.4);
    let normals = Normals::OfMesh { rounds: 1 };
    let modes = modes_of(
        Element::Triangles(&ball, &normals),
        Operator::Slo(Weight::ExpMinusH),
        6,
        0.1,
    );
    let asked = SegmentOptions {
        groups: Groups::Count(16),
        modes: Modes::Count(6),
        ..SegmentOptions::default()
    };
    let faces = Faces::from(&ball);
    let segments = segment(&modes, &faces, &asked, Run::on(&Cpu)).unwrap();
    for d in directions {
        let inside: Vec<bool> = (0..ball.triangles().len())
            .map(|t| d.angle(&ball.corners(t)[0].coords) < 0.5)
            .collect();
        let jaccard = best_overlap(&segments.labels, faces.areas(), &inside);
        println!("dimple {jaccard}");
        assert!(jaccard >= 0.55, "{jaccard}");
    }
}

/// All distances of points on a line.
fn line(points: &[f32]) -> Vec<f32> {
    points
        .iter()
        .flat_map(|a| points.iter().map(move |b| (a - b).abs()))
        .collect()
}

#[test]
fn medoids_never_get_worse_and_are_mostly_the_best() {
    let mut random = SplitMix64::new(5);
    let mut best = 0;
    for trial in 0..60 {
        let n = 5 + trial % 8;
        let k = 2 + trial % 2;
        let points: Vec<f32> = (0..n).map(|_| random.unit() as f32).collect();
        let distances = line(&points);
        let loss_of = |set: &[usize]| -> f64 {
            (0..n)
                .map(|p| {
                    set.iter()
                        .map(|&m| f64::from(distances[m * n + p]))
                        .fold(f64::INFINITY, f64::min)
                })
                .sum()
        };
        let mut optimum = f64::INFINITY;
        for a in 0..n {
            for b in a + 1..n {
                if k == 2 {
                    optimum = optimum.min(loss_of(&[a, b]));
                } else {
                    (b + 1..n).for_each(|c| optimum = optimum.min(loss_of(&[a, b, c])));
                }
            }
        }
        let mut found = f64::INFINITY;
        for seed in 0..3 {
            let m = medoids(&distances, n, k, seed);
            assert!(m.history.windows(2).all(|w| w[1] < w[0]));
            found = found.min(m.loss);
        }
        best += usize::from(found <= optimum + 1e-6);
    }
    assert!(best >= 57, "{best} of 60");
}

#[test]
fn as_many_medoids_as_points_leave_nothing_and_equal_points_are_allowed() {
    let points = [0.0, 1.0, 1.0, 4.0];
    assert_eq!(medoids(&line(&points), 4, 4, 1).loss, 0.0);
    assert_eq!(medoids(&line(&points), 4, 3, 1).loss, 0.0);
    let one = medoids(&line(&points), 4, 1, 1);
    assert_eq!(one.loss, 4.0);
}

#[test]
fn measures_of_segmentations_are_what_they_should_be() {
    let areas = [1.0, 2.0, 1.0, 0.5, 1.5, 1.0];
    let (a, b) = ([0, 0, 1, 1, 2, 2], [5, 5, 5, 1, 1, 1]);
    let same = difference(&a, &a, &areas).unwrap();
    assert_eq!(
        [
            same.rand,
            same.hamming,
            same.global_consistency,
            same.local_consistency
        ],
        [0.0; 4]
    );
    let renamed = [7, 7, 3, 3, 0, 0];
    let (d, e) = (
        difference(&a, &b, &areas).unwrap(),
        difference(&renamed, &b, &areas).unwrap(),
    );
    assert_eq!(d, e);
    let back = difference(&b, &a, &areas).unwrap();
    assert_eq!(
        (d.rand, d.global_consistency),
        (back.rand, back.global_consistency)
    );
    assert!((d.hamming - back.hamming).abs() < 1e-15);
    assert!(d.local_consistency <= d.global_consistency);
    // Two groups in one place could not be worse apart.
    let alike = davies_bouldin(&[1.0, 1.0, 1.0, 1.0], 1, &[0, 0, 1, 1]);
    assert_eq!(alike, f64::INFINITY);
    // A refinement.
    let fine = [0, 1, 2, 2, 3, 3];
    assert_eq!(
        difference(&fine, &a, &areas).unwrap().global_consistency,
        0.0
    );
    assert!(difference(&a, &b[..5], &areas).is_err());
    let sphere = shapes::icosphere(1.0, 2);
    let half: Vec<u32> = (0..320)
        .map(|t| u32::from(sphere.corners(t)[0].z > 0.0))
        .collect();
    let quarter: Vec<u32> = (0..320)
        .map(|t| u32::from(sphere.corners(t)[0].z > 0.5))
        .collect();
    let there = cut_discrepancy(&sphere, &half, &quarter).unwrap().unwrap();
    let back = cut_discrepancy(&sphere, &quarter, &half).unwrap().unwrap();
    assert!(there > 0.0 && (there - back).abs() < 1e-12);
    assert_eq!(cut_discrepancy(&sphere, &half, &half).unwrap(), Some(0.0));
    assert_eq!(cut_discrepancy(&sphere, &half, &[0; 320]).unwrap(), None);
}

// ── flow

#[test]
fn a_sphere_moves_evenly_inwards_whichever_way_it_is_turned() {
    let sphere = shapes::icosphere(0.5, 4);
    let options = FlowOptions {
        iterations: 1,
        tangential: 0.0,
        ..FlowOptions::default()
    };
    let done = smooth(&sphere, 0, &options, Run::on(&Cpu)).unwrap();
    let moved: Vec<f64> = done
        .mesh
        .positions()
        .iter()
        .map(|p| 0.5 - p.coords.norm())
        .collect();
    let mean = moved.iter().sum::<f64>() / moved.len() as f64;
    assert!(mean > 0.0);
    for m in &moved {
        assert!((m / mean - 1.0).abs() < 0.25, "{m} {mean}");
    }
    // Turned inside out it moves in the same way.
    let flipped = TriMesh::new(
        sphere.positions().to_vec(),
        sphere
            .triangles()
            .iter()
            .map(|&[a, b, c]| [a, c, b])
            .collect(),
    )
    .unwrap();
    let other = smooth(&flipped, 0, &options, Run::on(&Cpu)).unwrap();
    for (p, q) in done.mesh.positions().iter().zip(other.mesh.positions()) {
        assert!((p - q).norm() < 1e-9);
    }
}

#[test]
fn a_plane_stays() {
    let n = 8u32;
    let positions = (0..=n)
        .flat_map(|j| (0..=n).map(move |i| Point3::new(f64::from(i), f64::from(j) * 0.9, 0.0)));
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let quads: Vec<[u32; 4]> = (0..n * n)
        .map(|q| (q % n, q / n))
        .map(|(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)])
        .collect();
    let mesh = QuadMesh::new(positions.collect(), quads).unwrap();
    let options = FlowOptions {
        keep_rims: false,
        tangential: 0.0,
        ..FlowOptions::default()
    };
    let done = smooth_quads(&mesh, &options, Run::on(&Cpu)).unwrap();
    assert!(done.report.max_displacement < 1e-9, "{:?}", done.report);
    // The limit surface of a flat net is the net's rectangle, and its parameters are the plane's.
    let surface = Surface::new(mesh).unwrap();
    let area: f64 = surface
        .jets(Quadrature::default())
        .unwrap()
        .iter()
        .map(|(j, w)| w * j.area_normal().norm())
        .sum();
    assert!((area - 64.0 * 0.9).abs() < 1e-10, "{area}");
    let refused = smooth_quads(
        surface.control(),
        &FlowOptions {
            keep_volume: true,
            ..options
        },
        Run::on(&Cpu),
    );
    assert!(matches!(refused, Err(Error::Open { .. })));
}

/// Sharp edges and round ones, of triangles and of quads: after fifty steps they lie at most 0.4 times as far from where they were as
/// after as many steps of mean curvature flow as move the whole surface as far.
#[test]
fn creases_outlast_mean_curvature_flow_and_volume_is_kept() {
    let half = [1.0, 0.8, 0.6];
    // Creases are looked for where those of this radius are.
    for (radius, near) in [(1e-3, 0.05), (0.08, 0.08)] {
        let quads = rounded_box(half, radius, 20);
        let clean = quads.clone().into_triangles();
        let (of_triangles, of_quads) = (shaken(&clean, 0.004, 9), shaken_quads(&quads, 0.004, 9));
        for is_triangles in [true, false] {
            // From a mesh on: the distance of creases, and how far the surface is from the first.
            let flown = |operator, iterations, from: &Shaken| {
                let options = FlowOptions {
                    operator,
                    iterations,
                    keep_volume: true,
                    ..FlowOptions::default()
                };
                let (now, report) = match from {
                    Shaken::Triangles(mesh) => {
                        let done = smooth(mesh, 1, &options, Run::on(&Cpu)).unwrap();
                        (Shaken::Triangles(done.mesh), done.report)
                    }
                    Shaken::Quads(mesh) => {
                        let done = smooth_quads(mesh, &options, Run::on(&Cpu)).unwrap();
                        (Shaken::Quads(done.mesh), done.report)
                    }
                };
                let [before, after] = report.volume;
                assert!((after / before - 1.0).abs() < 1e-3, "{report:?}");
                now
            };
            let start = match is_triangles {
                true => Shaken::Triangles(of_triangles.clone()),
                false => Shaken::Quads(of_quads.clone()),
            };
            let lost = |now: &Shaken| {
                let distance = box_errors(&clean, &now.triangles(), half, near).crease;
                assert!(distance.is_finite());
                (distance, rms(&start, now))
            };
            let ggho = lost(&flown(FlowOperator::Ggho, 50, &start));
            // As many steps as move the whole surface as far, and the rest of fifty, in which 95 % of the vertices move as far.
            let (mut now, mut as_far) = (start.clone(), None);
            for _ in 0..10 {
                now = flown(FlowOperator::Lbo, 5, &now);
                as_far = as_far.or(Some(lost(&now)).filter(|m| m.1 >= ggho.1));
            }
            let (mean, all) = (as_far.unwrap(), lost(&now));
            println!(
                "{radius} {is_triangles}: crease distance / edge and rms: GGHO {ggho:?}, mean curvature {mean:?} and {all:?}"
            );
            assert!(ggho.0 <= 0.3 * all.0, "{ggho:?} {all:?}");
            assert!(ggho.0 <= 0.4 * mean.0, "{ggho:?} {mean:?}");
        }
    }
}

/// A box with noise, of either kind of faces.
#[derive(Clone)]
enum Shaken {
    Triangles(TriMesh),
    Quads(QuadMesh),
}

impl Shaken {
    fn triangles(&self) -> TriMesh {
        match self {
            Self::Triangles(mesh) => mesh.clone(),
            Self::Quads(mesh) => mesh.clone().into_triangles(),
        }
    }
}

/// Root mean square of the ways of the vertices.
fn rms(a: &Shaken, b: &Shaken) -> f64 {
    let (a, b) = (a.triangles(), b.triangles());
    let squares = a.positions().iter().zip(b.positions());
    let sum: f64 = squares.map(|(p, q)| (p - q).norm_squared()).sum();
    (sum / a.positions().len() as f64).sqrt()
}

/// The matrix damps, the forces move: one that is some steps old brings the surface to the same place.
#[test]
fn one_matrix_serves_for_some_steps() {
    let box_of_quads = shaken_quads(&rounded_box([1.0, 0.8, 0.6], 0.08, 10), 0.004, 9);
    let triangles = shaken(&shapes::torus(1.0, 0.4, 36, 18), 0.02, 4);
    let apart = |a: &[Point3], b: &[Point3]| {
        let squares = a.iter().zip(b).map(|(p, q)| (p - q).norm_squared());
        (squares.sum::<f64>() / a.len() as f64).sqrt()
    };
    for operator in [FlowOperator::Ggho, FlowOperator::Lbo] {
        let options = |refresh| FlowOptions {
            operator,
            iterations: 20,
            refresh,
            ..FlowOptions::default()
        };
        let of_quads = |n| smooth_quads(&box_of_quads, &options(n), Run::on(&Cpu)).unwrap();
        let of_triangles = |n| smooth(&triangles, 1, &options(n), Run::on(&Cpu)).unwrap();
        let (new, old) = (of_quads(1), of_quads(5));
        let quads = apart(new.mesh.positions(), old.mesh.positions());
        let quads = quads / new.report.rms_displacement;
        let (new, old) = (of_triangles(1), of_triangles(5));
        let triangles = apart(new.mesh.positions(), old.mesh.positions());
        let triangles = triangles / new.report.rms_displacement;
        println!("{operator:?}: apart by {quads} and {triangles} of the way");
        for share in [quads, triangles] {
            assert!(share > 0.0 && share < 0.05, "{operator:?}: {share}");
        }
    }
}

#[test]
fn steps_commute_with_motions() {
    let mesh = shaken(&shapes::torus(1.0, 0.4, 24, 12), 0.02, 4);
    let turn = Rotation3::from_euler_angles(0.4, 1.1, -0.7);
    let shift = Vector3::new(3.0, -2.0, 5.0);
    let moved = |m: &TriMesh| {
        let p = m.positions().iter().map(|p| turn * p + shift).collect();
        TriMesh::new(p, m.triangles().to_vec()).unwrap()
    };
    let options = FlowOptions {
        iterations: 1,
        ..FlowOptions::default()
    };
    let there = moved(&smooth(&mesh, 1, &options, Run::on(&Cpu)).unwrap().mesh);
    let back = smooth(&moved(&mesh), 1, &options, Run::on(&Cpu))
        .unwrap()
        .mesh;
    // The unit of length is that of the axis-aligned box, so that δ is not quite the same.
    for (p, q) in there.positions().iter().zip(back.positions()) {
        assert!((p - q).norm() < 2e-4, "{}", (p - q).norm());
    }
}

/// What the two filters are made for: flat parts become flat and sharp edges stay where they are.
#[test]
fn filtered_normals_flatten_and_keep_sharp_edges() {
    let half = [1.0, 0.8, 0.6];
    let quads = rounded_box(half, 1e-3, 20);
    let (noisy, clean) = (
        shaken_quads(&quads, 0.012, 9),
        quads.clone().into_triangles(),
    );
    let noisy_triangles = shaken(&clean, 0.012, 9);
    let before = box_errors(&clean, &noisy_triangles, half, 0.05);
    for filter in [NormalFilter::BILATERAL, NormalFilter::TOTAL_VARIATION] {
        let options = FilterOptions {
            filter,
            ..FilterOptions::default()
        };
        let done = filter_normals(&noisy_triangles, &options, Run::on(&Cpu)).unwrap();
        let quads = filter_quad_normals(&noisy, &options, Run::on(&Cpu)).unwrap();
        for after in [done.mesh, quads.mesh.into_triangles()] {
            let after = box_errors(&clean, &after, half, 0.05);
            println!("{filter:?}: {before:?} {after:?}");
            assert!(after.flat < 0.05 * before.flat, "{after:?}");
            assert!(after.crease < 0.25 * before.crease, "{after:?}");
        }
    }
}

/// The smallest angle of a mesh, and the share of its angles below 20 degrees.
fn narrow(mesh: &TriMesh) -> (f64, f64) {
    let angles: Vec<f64> = (0..mesh.triangles().len())
        .flat_map(|t| {
            let p = mesh.corners(t);
            let angle = |k: usize| (p[(k + 1) % 3] - p[k]).angle(&(p[(k + 2) % 3] - p[k]));
            [0, 1, 2].map(|k| angle(k).to_degrees())
        })
        .collect();
    let below = angles.iter().filter(|a| **a < 20.0).count();
    let least = angles.iter().copied().fold(f64::INFINITY, f64::min);
    (least, below as f64 / angles.len() as f64)
}

/// Faces of a box are squeezed where the flow gathers them at its creases, unless it is told how narrow they may become.
#[test]
fn flows_squeeze_no_triangles() {
    let quads = rounded_box([1.0, 0.8, 0.6], 1e-3, 20);
    let noisy = shaken(&quads.into_triangles(), 0.012, 9);
    let flown = |least_angle| {
        let options = FlowOptions {
            iterations: 50,
            least_angle,
            ..FlowOptions::default()
        };
        smooth(&noisy, 1, &options, Run::on(&Cpu)).unwrap()
    };
    let (free, kept) = (flown(0.0), flown(FlowOptions::default().least_angle));
    let (before, squeezed, after) = (narrow(&noisy), narrow(&free.mesh), narrow(&kept.mesh));
    println!("{before:?}: {squeezed:?}, held {after:?}");
    assert!(before.0 > 10.0 && squeezed.0 < 5.0 && after.0 >= 10.0 - 1e-9);
    // It is for little that they are held back.
    let ways = [free, kept].map(|done| done.report.rms_displacement);
    assert!(ways[1] > 0.9 * ways[0], "{ways:?}");
    for least_angle in [-1.0, 60.0, f64::NAN] {
        let options = FlowOptions {
            least_angle,
            ..FlowOptions::default()
        };
        let refused = smooth(&noisy, 1, &options, Run::on(&Cpu));
        assert!(matches!(refused, Err(Error::Option(_))), "{refused:?}");
    }
}

/// A disc with fans of narrow triangles as its ends: a volume that is kept is kept there, too, and a vertex of no triangle stays
/// and has no say.
/// A vertex of no triangle has no part in the extent of the surface, in units of which curvature counts.
#[test]
fn unused_vertices_do_not_change_the_scale() {
    let torus = shapes::torus(3.0, 1.0, 30, 15);
    let positions = torus.positions().iter().copied();
    let more = positions.chain([Point3::new(1e4, 0.0, 0.0)]).collect();
    let with_unused = TriMesh::new(more, torus.triangles().to_vec()).unwrap();
    let options = SpectrumOptions {
        modes: 4,
        ..SpectrumOptions::default()
    };
    let [plain, with_unused] = [&torus, &with_unused].map(|mesh| {
        let normals = Normals::OfMesh { rounds: 1 };
        spectrum(&Element::Triangles(mesh, &normals), &options, Run::on(&Cpu)).unwrap()
    });
    assert_eq!(plain.scale, with_unused.scale);
    let varied = |values: &[f64]| -> Vec<f64> {
        values
            .iter()
            .copied()
            .filter(|v| *v > 1e-6)
            .take(3)
            .collect()
    };
    let pairs = varied(&plain.values)
        .into_iter()
        .zip(varied(&with_unused.values));
    for (a, b) in pairs {
        assert!((a / b - 1.0).abs() < 1e-6, "{a} {b}");
    }
}

#[test]
fn narrow_corners_do_not_cost_volume_nor_unused_vertices_a_say() {
    let disc = shapes::cylinder(1.0, 0.3, 96, 4);
    assert!(narrow(&disc).0 < 4.0);
    let far = Point3::new(9.0, 9.0, 9.0);
    let more = disc.positions().iter().copied().chain([far]).collect();
    let with_unused = TriMesh::new(more, disc.triangles().to_vec()).unwrap();
    for operator in [FlowOperator::Ggho, FlowOperator::Lbo] {
        let options = FlowOptions {
            operator,
            keep_volume: true,
            ..FlowOptions::default()
        };
        let done = smooth(&disc, 1, &options, Run::on(&Cpu)).unwrap();
        let [before, after] = done.report.volume;
        assert!((after / before - 1.0).abs() < 1e-4, "{:?}", done.report);
        assert!(done.report.rms_displacement > 1e-4, "{:?}", done.report);
        let same = smooth(&with_unused, 1, &options, Run::on(&Cpu)).unwrap();
        let (last, others) = same.mesh.positions().split_last().unwrap();
        assert!(*last == far && others == done.mesh.positions());
        assert_eq!(same.report, done.report);
    }
}

/// Through both filters goes a molecular surface, as it is and with noise: no triangle is squeezed.
#[test]
fn filters_squeeze_no_triangles() {
    let path = fixtures::path("1orc.pdb");
    let structure = read(&path, &ReadOptions::default()).unwrap().structure;
    let options = remesh::Options::default();
    let clean = remesh::remesh(molecular_surface(&structure), None, &options, Run::on(&Cpu));
    let clean = clean.unwrap().mesh;
    let side = (clean.area() / clean.triangles().len() as f64).sqrt();
    let noisy = shaken(&clean, 0.1 * side, 5);
    for filter in [NormalFilter::BILATERAL, NormalFilter::TOTAL_VARIATION] {
        for mesh in [&clean, &noisy] {
            let filtered = |tangential, least_angle| {
                let options = FilterOptions {
                    filter,
                    tangential,
                    least_angle,
                    // What would squeeze triangles often drives them through others, too.
                    keep_apart: false,
                    ..FilterOptions::default()
                };
                filter_normals(mesh, &options, Run::on(&Cpu)).unwrap()
            };
            let options = FilterOptions::default();
            let now = filtered(options.tangential, options.least_angle);
            let (before, plain) = (narrow(mesh), narrow(&filtered(0.0, 0.0).mesh));
            let (held, spread) = (narrow(&filtered(0.0, 10.0).mesh), narrow(&now.mesh));
            let [volume, kept] = now.report.volume;
            println!("{before:?}: {plain:?}, held {held:?}, spread {spread:?}");
            for after in [held, spread] {
                assert!(after.0 >= before.0.min(10.0) - 1e-9, "{after:?}");
            }
            assert!(spread.1 < 0.5 * plain.1, "{plain:?} {spread:?}");
            assert!((kept / volume - 1.0).abs() < 0.01, "{kept} {volume}");
        }
    }
}

/// How many vertices were held back on a molecular surface, whose thin walls a sharpening flow drives through each other
/// unless it keeps them apart.
fn held_back_where_walls_meet(sharpen: f64) -> [usize; 2] {
    let path = fixtures::path("1orc.pdb");
    let structure = read(&path, &ReadOptions::default()).unwrap().structure;
    let surface = molecular_surface(&structure);
    assert_eq!(crossing_pairs(&surface), [[0; 2]; 0]);
    let flown = |keep_apart| {
        let options = FlowOptions {
            // After 40 some surfaces do not cross themselves yet.
            iterations: 60,
            step: 0.25,
            sharpen,
            tangential: 1.0,
            // What would squeeze triangles often drives them through others, too.
            least_angle: 0.0,
            keep_apart,
            ..FlowOptions::default()
        };
        smooth(&surface, 1, &options, Run::on(&Cpu)).unwrap()
    };
    let (free, kept) = (flown(false), flown(true));
    assert!(!crossing_pairs(&free.mesh).is_empty());
    assert_eq!(crossing_pairs(&kept.mesh), [[0; 2]; 0]);
    [free.report.held_back, kept.report.held_back]
}

/// Sharpened by half, few fold in either flow.
#[test]
fn a_flow_that_sharpens_by_half_lets_nothing_come_through() {
    let [free, kept] = held_back_where_walls_meet(0.5);
    assert!(kept > free, "{kept} {free}");
}

/// Sharpened wholly, as Eq. 7.26 stands, thousands fold in either flow, and these numbers say nothing.
#[test]
fn a_flow_that_sharpens_wholly_lets_nothing_come_through() {
    held_back_where_walls_meet(1.0);
}

/// A filter that keeps the volume does, and one that need not does not.
#[test]
fn filters_keep_volumes() {
    let noisy = shaken(&shapes::icosphere(1.0, 4), 0.02, 5);
    for filter in [NormalFilter::BILATERAL, NormalFilter::TOTAL_VARIATION] {
        let filtered = |keep_volume| {
            let options = FilterOptions {
                filter,
                keep_volume,
                ..FilterOptions::default()
            };
            let done = filter_normals(&noisy, &options, Run::on(&Cpu)).unwrap();
            (done.mesh.volume() / noisy.volume() - 1.0).abs()
        };
        let (free, kept) = (filtered(false), filtered(true));
        assert!(free > 1e-5 && kept < 1e-6, "{filter:?}: {free} {kept}");
    }
}

/// Shaken discs keep their rims unless told otherwise, and what cannot be is refused.
#[test]
fn filters_keep_rims_and_refuse_what_cannot_be() {
    let (positions, triangles) = shapes::icosphere(1.0, 3).into_parts();
    let half = |t: &[u32; 3]| t.iter().all(|&v| positions[v as usize].z > -0.3);
    let open: Vec<[u32; 3]> = triangles.iter().copied().filter(half).collect();
    let cap = shaken(&TriMesh::new(positions.clone(), open).unwrap(), 0.02, 3);
    let edges = geom_core::mesh::Halfedges::<3>::of(&cap).unwrap();
    let rim = |v: usize| edges.on_boundary(geom_core::VertexId(v as u32));
    for filter in [NormalFilter::BILATERAL, NormalFilter::TOTAL_VARIATION] {
        for keep_rims in [true, false] {
            let options = FilterOptions {
                filter,
                keep_rims,
                ..FilterOptions::default()
            };
            let done = filter_normals(&cap, &options, Run::on(&Cpu)).unwrap();
            let moved = |v: &usize| done.mesh.positions()[*v] != cap.positions()[*v];
            let rims = (0..positions.len())
                .filter(|&v| rim(v))
                .filter(moved)
                .count();
            assert_eq!(rims == 0, keep_rims, "{rims}");
            assert!(done.report.rms_displacement > 1e-3);
        }
    }
    let with = |filter| FilterOptions {
        filter,
        ..FilterOptions::default()
    };
    let wrong = [
        NormalFilter::Bilateral {
            rounds: 1,
            range: 0.0,
        },
        NormalFilter::TotalVariation {
            rounds: 1,
            fidelity: f64::NAN,
        },
    ];
    for filter in wrong {
        let refused = filter_normals(&cap, &with(filter), Run::on(&Cpu));
        assert!(matches!(refused, Err(Error::Option(_))));
    }
    let closed = FilterOptions {
        keep_volume: true,
        ..FilterOptions::default()
    };
    let refused = filter_normals(&cap, &closed, Run::on(&Cpu)).err();
    assert!(matches!(refused, Some(Error::Open { .. })), "{refused:?}");
    let none = filter_normals(
        &TriMesh::default(),
        &FilterOptions::default(),
        Run::on(&Cpu),
    );
    assert_eq!(none.err(), Some(Error::NoExtent));
    // A face without area, and a stray vertex: neither stops a filter.
    let points = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [2.0, 0.0, 0.0],
        [5.0; 3],
    ];
    let points = points.map(Point3::from).to_vec();
    let flat = TriMesh::new(points, vec![[0, 1, 2], [1, 0, 3]]).unwrap();
    for filter in [NormalFilter::BILATERAL, NormalFilter::TOTAL_VARIATION] {
        let done = filter_normals(&flat, &with(filter), Run::on(&Cpu)).unwrap();
        assert!(
            done.mesh
                .positions()
                .iter()
                .all(|p| p.iter().all(|c| c.is_finite()))
        );
    }
}

//! What whole surfaces hide: knots beside T-junctions, concave curvature, distances one way, weights in files, options of
//! fits.

use std::collections::BTreeMap;

use geom_core::mesh::shapes;
use geom_core::{Cpu, Point3, QuadMesh, Run, TriMesh, Vector3};
use tspline::files::step;
use tspline::levels::Places;
use tspline::surface::adapt::adapt;
use tspline::surface::errors::{errors, measures};
use tspline::surface::fit::{FitOptions, MeshTarget, Target, fit};
use tspline::{Basis, Surface, TMesh, TMeshOptions, analysis};

fn cpu() -> Run<'static, Cpu> {
    Run::on(&Cpu)
}

fn surface(fine: &QuadMesh, basis: Basis, level: impl Fn(Vector3) -> u8) -> Surface {
    let of = |q: &[u32; 4]| {
        let corners = q.iter().map(|&v| fine.positions()[v as usize].coords);
        level(corners.sum::<Vector3>() / 4.0)
    };
    let levels: Vec<u8> = fine.quads().iter().map(of).collect();
    let mesh = TMesh::build(fine, &levels, &TMeshOptions::default()).expect("a T-mesh");
    Surface::new(mesh, basis, cpu()).expect("a surface")
}

/// Half a sphere is fine, along a line of quads: functions at T-junctions have knots within the coarse elements along that
/// line, and none has any across it, since the second knot of the fine ones is the coarse elements' far side.
#[test]
fn coarse_elements_beside_fine_ones_are_cut_one_way() {
    let fine = shapes::quad_sphere(1.0, 16);
    let surface = surface(&fine, Basis::Rational, |p| u8::from(p.x < 0.0));
    let mut cut = 0;
    for e in 0..surface.mesh().elements().len() {
        let patches = surface.extraction().of_element(e).len();
        assert!(patches <= 2, "element {e} falls into {patches}");
        cut += usize::from(patches == 2);
    }
    assert!(cut > 20, "{cut} elements are cut");
}

#[test]
fn curvature_counts_on_either_side() {
    let (fine, sphere) = (shapes::quad_sphere(2.0, 8), shapes::icosphere(2.0, 4));
    let turned = sphere.triangles().iter().map(|&[a, b, c]| [a, c, b]);
    let turned = TriMesh::new(sphere.positions().to_vec(), turned.collect()).unwrap();
    for surface in [&sphere, &turned] {
        let found = Places::of(surface, &fine).unwrap().curvatures();
        assert!(found.iter().all(|k| (k - 0.5).abs() < 0.05), "{found:?}");
    }
}

/// A sphere to which a small tetrahedron far away belongs: no sample of the surface sees it.
#[test]
fn what_lies_off_the_surface_counts() {
    let mut surface = surface(&shapes::quad_sphere(1.0, 8), Basis::Hierarchical, |_| 0);
    let sphere = shapes::icosphere(1.0, 4);
    let near = MeshTarget::new(&sphere).unwrap();
    fit(&mut surface, &near, &FitOptions::default(), cpu()).unwrap();
    let first = sphere.positions().len() as u32;
    let mut positions = sphere.positions().to_vec();
    let corners = [[0.0; 3], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]];
    positions.extend(corners.map(|c| Point3::from(c) + Vector3::new(3.0, 0.0, 0.0)));
    let mut triangles = sphere.triangles().to_vec();
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]];
    triangles.extend(faces.map(|f| f.map(|v| first + v)));
    let both = TriMesh::new(positions, triangles).unwrap();
    let (found, of_elements) = errors(&surface, &both, cpu()).unwrap();
    assert!(found.to_mesh < 0.05 && found.from_mesh > 1.9, "{found:?}");
    assert_eq!(found.hausdorff, found.from_mesh);
    let worst = of_elements.iter().copied().fold(0.0, f64::max);
    assert_eq!(worst, found.hausdorff);
}

/// A tolerance that the first fit misses by half.
#[test]
fn no_element_is_farther_away_than_a_tolerance_that_is_reached() {
    let target = shapes::ellipsoid(Vector3::new(1.0, 0.8, 1.3), 4);
    let adapted = |tolerance: f64| {
        let fine = shapes::quad_sphere(1.0, 16);
        let levels = vec![2; fine.quads().len()];
        let mesh = TMesh::build(&fine, &levels, &TMeshOptions::default()).unwrap();
        let options = FitOptions::default();
        adapt(
            mesh,
            Basis::Hierarchical,
            &target,
            tolerance,
            &options,
            cpu(),
        )
        .unwrap()
    };
    let worst = |of: &[f64]| of.iter().copied().fold(0.0, f64::max);
    let first = worst(&adapted(f64::INFINITY).of_elements);
    let tolerance = first / 1.5;
    let done = adapted(tolerance);
    assert!(done.rounds[0].too_far > 0);
    assert_eq!(done.reached, worst(&done.of_elements) <= tolerance);
    assert!(done.reached);
}

#[test]
fn smoothing_holds_a_fit_back() {
    let target = MeshTarget::new(&shapes::icosphere(1.0, 3)).unwrap();
    let area = |smoothing: f64| {
        let mut surface = surface(&shapes::quad_sphere(1.0, 4), Basis::Hierarchical, |_| 0);
        let options = FitOptions {
            smoothing,
            ..FitOptions::default()
        };
        fit(&mut surface, &target, &options, cpu()).unwrap();
        measures(&surface, cpu()).unwrap()[0]
    };
    let [free, held] = [1e-6, 1.0].map(area);
    assert!(held < 0.98 * free, "{held} of {free}");
}

/// Without samples of its own a target only draws what is near it.
struct Drawing(MeshTarget);
impl Target for Drawing {
    fn closest(&self, to: &Point3) -> Point3 {
        self.0.closest(to)
    }
}

#[test]
fn a_fit_grows_into_what_it_does_not_reach() {
    let long = shapes::ellipsoid(Vector3::new(1.0, 1.0, 3.0), 4);
    let target = MeshTarget::new(&long).unwrap();
    let drawing = Drawing(MeshTarget::new(&long).unwrap());
    let left = |target: &dyn Target| {
        let mut surface = surface(&shapes::quad_sphere(1.0, 8), Basis::Hierarchical, |_| 0);
        fit(&mut surface, target, &FitOptions::default(), cpu()).unwrap();
        errors(&surface, &long, cpu()).unwrap().0.from_mesh
    };
    let [reached, drawn] = [left(&target), left(&drawing)];
    assert!(reached < 0.7 * drawn, "{reached} of {drawn}");
}

/// Only a load of mean zero has a solution on a closed surface: the mean is left out.
#[test]
fn the_mean_of_a_load_does_not_matter() {
    let surface = surface(&shapes::quad_sphere(1.0, 4), Basis::Hierarchical, |_| 0);
    let matrices = analysis::matrices(&surface).unwrap();
    let solved = |mean: f64| {
        let load = move |p: &Point3| p.z + p.x * p.y + mean;
        analysis::poisson(&surface, &matrices, &load).unwrap()
    };
    for (a, b) in solved(0.0).iter().zip(solved(3.0)) {
        assert!((a - b).abs() < 1e-8, "{a} and {b}");
    }
}

/// Ends of edges lie on the surface, whatever the weights there.
#[test]
fn step_files_have_points_and_weights() {
    // A corner is fine, with steps of levels that do not run along the quads: there functions do not sum to one.
    let oblique = |p: Vector3| match p.x + p.y + 0.3 * p.z {
        height if height > 1.0 => 0,
        height if height > 0.3 => 1,
        _ => 2,
    };
    let mut surface = surface(&shapes::quad_sphere(1.0, 16), Basis::Rational, oblique);
    let ball = MeshTarget::new(&shapes::icosphere(1.0, 5)).unwrap();
    fit(&mut surface, &ball, &FitOptions::default(), cpu()).unwrap();
    let mut file = Vec::new();
    step::write(&mut file, &surface, "ball").unwrap();
    let file = String::from_utf8(file).unwrap();
    let entities: BTreeMap<&str, &str> = file.lines().filter_map(|l| l.split_once('=')).collect();
    let numbers = |text: &str| -> Vec<f64> {
        let number = |x: &str| x.parse().unwrap_or_else(|_| panic!("{x} is no number"));
        text.split(',').map(number).collect()
    };
    let (mut curves, mut heavy) = (0, 0);
    for entity in entities
        .values()
        .filter(|e| e.contains("RATIONAL_B_SPLINE_CURVE("))
    {
        let between = |start: &str, end: &str| {
            let (_, rest) = entity.split_once(start).expect(start);
            rest.split_once(end).expect(end).0
        };
        let points: Vec<&str> = between("B_SPLINE_CURVE(3,(", ")").split(',').collect();
        let weights = numbers(between("RATIONAL_B_SPLINE_CURVE((", ")"));
        for k in [0, 3] {
            let place = entities[points[k]];
            let (_, place) = place.split_once("CARTESIAN_POINT('',(").unwrap();
            let x = numbers(place.trim_end_matches([')', ';']));
            let radius = x.iter().map(|x| x * x).sum::<f64>().sqrt();
            assert!((radius - 1.0).abs() < 0.02, "{radius} with {}", weights[k]);
            heavy += usize::from((weights[k] - 1.0).abs() > 0.05);
        }
        curves += 1;
    }
    assert!(
        curves > 1000 && heavy > 20,
        "{heavy} heavy ends of {curves}"
    );
}

//! What single lines owe: each of these laws was written for a planted fault that the others did not see.

use geom_core::io::structure::{Format, ReadOptions, parse};
use geom_core::mesh::shapes;
use geom_core::{Cpu, Point3, QuadMesh, Run, TriMesh, Vector3};
use secondfund_ops::catmull::subdivide;
use secondfund_ops::flow::filter_normals;
use secondfund_ops::forms::Symmetric;
use secondfund_ops::options::{FilterOptions, FlowOperator, NormalFilter};
use secondfund_ops::pockets::find;
use secondfund_ops::segment::metrics::cut_discrepancy;
use secondfund_ops::testing::{rounded_box, shaken, shaken_quads};
use secondfund_ops::{
    Element, FlowOptions, Normals, PocketOptions, SpectrumOptions, smooth, smooth_quads, spectrum,
};

/// A cylinder of radius R in the skewed coordinates `(R cos(u + v), R sin(u + v), v)` is as curved as in others.
#[test]
fn curvatures_do_not_hang_on_the_coordinates() {
    let radius = 3.0;
    let first = Symmetric::new(radius * radius, radius * radius, radius * radius + 1.0);
    let second = Symmetric::new(radius, radius, radius);
    let forms = secondfund_ops::forms::Forms { first, second };
    assert!(
        (forms.mean() - 0.5 / radius).abs() < 1e-15,
        "{}",
        forms.mean()
    );
    assert!(forms.gaussian().abs() < 1e-15);
}

/// On a sphere of unit diameter, in which curvatures of vertices are given, they differ: H = 2, K = 4.
#[test]
fn vertices_have_the_curvatures_of_their_sphere() {
    let sphere = shapes::icosphere(7.0, 4);
    let normals = Normals::OfMesh { rounds: 0 };
    let options = SpectrumOptions {
        modes: 3,
        ..SpectrumOptions::default()
    };
    let element = Element::Triangles(&sphere, &normals);
    let found = spectrum(&element, &options, Run::on(&Cpu)).unwrap();
    assert_eq!(found.gauss.len(), sphere.positions().len());
    for (h, k) in found.mean.iter().zip(&found.gauss) {
        assert!(
            (h / 2.0 - 1.0).abs() < 0.1 && (k / 4.0 - 1.0).abs() < 0.15,
            "{h} {k}"
        );
    }
}

/// The rim of a subdivided net is that of the cubic B-spline of its rim (Catmull and Clark, 1978; DeRose, Kass and
/// Truong, 1998).
#[test]
fn rims_are_subdivided_as_cubic_curves() {
    let n = 5u32;
    let height = |i: u32, j: u32| f64::from((3 * i * i + 5 * j + i * j) % 7) * 0.2;
    let positions: Vec<Point3> = (0..=n)
        .flat_map(|j| (0..=n).map(move |i| Point3::new(i.into(), j.into(), height(i, j))))
        .collect();
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let quads = (0..n * n).map(|q| (q % n, q / n));
    let quads = quads.map(|(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
    let net = QuadMesh::new(positions.clone(), quads.collect()).unwrap();
    let fine = subdivide(&net).unwrap();
    let near = |x: Vector3| {
        fine.positions()
            .iter()
            .any(|p| (p.coords - x).norm() < 1e-12)
    };
    let rim = |i: u32| positions[at(i, 0) as usize].coords;
    for i in 1..n {
        let vertex = (rim(i - 1) + rim(i) * 6.0 + rim(i + 1)) / 8.0;
        assert!(near(vertex), "vertex {i}");
        assert!(near((rim(i - 1) + rim(i)) / 2.0), "edge {i}");
    }
    assert!(near(rim(0)) && near(rim(n)), "corners stay");
}

/// Cuts differ as much in whatever unit the surface is measured.
#[test]
fn measures_of_cuts_have_no_unit() {
    let sphere = shapes::icosphere(1.0, 3);
    let labels = |height: f64| -> Vec<u32> {
        let above = |t: usize| u32::from(sphere.corners(t)[0].z > height);
        (0..sphere.triangles().len()).map(above).collect()
    };
    let (equator, parallel) = (labels(0.0), labels(0.4));
    let measured = |scale: f64| {
        let positions = sphere.positions().iter().map(|p| p * scale).collect();
        let scaled = TriMesh::new(positions, sphere.triangles().to_vec()).unwrap();
        cut_discrepancy(&scaled, &equator, &parallel)
            .unwrap()
            .unwrap()
    };
    let one = measured(1.0);
    assert!(one > 0.1);
    assert!(
        (measured(7.0) / one - 1.0).abs() < 1e-9,
        "{} {one}",
        measured(7.0)
    );
}

/// Rims stay to the last bit where they are asked to, and only there.
#[test]
fn rims_stay_if_asked() {
    let n = 9u32;
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let flat = (0..=n).flat_map(|j| (0..=n).map(move |i| Point3::new(i.into(), j.into(), 0.0)));
    let squares = || (0..n * n).map(|q| (q % n, q / n));
    let quads = squares().map(|(i, j)| [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
    let net = shaken_quads(
        &QuadMesh::new(flat.collect(), quads.collect()).unwrap(),
        0.2,
        3,
    );
    let triangles = net
        .quads()
        .iter()
        .flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]);
    let mesh = TriMesh::new(net.positions().to_vec(), triangles.collect()).unwrap();
    let on_rim = |v: usize| {
        let (i, j) = (v as u32 % (n + 1), v as u32 / (n + 1));
        i == 0 || j == 0 || i == n || j == n
    };
    for keep_rims in [true, false] {
        let options = FlowOptions {
            keep_rims,
            iterations: 5,
            ..FlowOptions::default()
        };
        let run = Run::on(&Cpu);
        let smoothed = [
            smooth(&mesh, 0, &options, run)
                .unwrap()
                .mesh
                .positions()
                .to_vec(),
            smooth_quads(&net, &options, run)
                .unwrap()
                .mesh
                .positions()
                .to_vec(),
        ];
        for (kind, now) in smoothed.into_iter().enumerate() {
            let start = net.positions();
            let moved = |rim: bool| (0..now.len()).any(|v| on_rim(v) == rim && now[v] != start[v]);
            assert!(moved(false), "{kind}: what is inside moves");
            assert_eq!(moved(true), !keep_rims, "{kind}");
        }
    }
}

/// Faces that look elsewhere hardly count: edges of a clean box stay where they are, as those of a noisy one come back.
#[test]
fn the_bilateral_filter_keeps_edges() {
    let clean = rounded_box([1.0, 0.8, 0.6], 0.02, 16).into_triangles();
    // Ways along the surface would hide those across it.
    let options = FilterOptions {
        filter: NormalFilter::BILATERAL,
        tangential: 0.0,
        ..FilterOptions::default()
    };
    let run = Run::on(&Cpu);
    let side = (clean.area() / clean.triangles().len() as f64).sqrt();
    let done = filter_normals(&clean, &options, run).unwrap().mesh;
    let pairs = clean.positions().iter().zip(done.positions());
    let moved = pairs.map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
    assert!(moved < 0.25 * side, "{moved} of {side}");
    let noisy = shaken(&clean, 0.1 * side, 5);
    let done = filter_normals(&noisy, &options, run).unwrap().mesh;
    let away = |mesh: &TriMesh| {
        let pairs = clean.positions().iter().zip(mesh.positions());
        pairs
            .map(|(p, q)| (p - q).norm_squared())
            .sum::<f64>()
            .sqrt()
    };
    assert!(
        away(&done) < away(&noisy),
        "{} {}",
        away(&done),
        away(&noisy)
    );
}

/// Two chains far apart have the pockets that each has alone: what counts as deep is asked of each by itself.
#[test]
fn chains_far_apart_have_the_pockets_of_each() {
    let lines = |name: &str, chain: char, shift: f64| -> String {
        let text = std::fs::read_to_string(fixtures::path(name)).unwrap();
        let atoms = text.lines().filter(|l| l.starts_with("ATOM"));
        let first = |l: &&str| l.as_bytes()[21] == b'A';
        let moved = |l: &str| {
            let x: f64 = l[30..38].trim().parse().unwrap();
            format!(
                "{}{chain}{}{:8.3}{}\n",
                &l[..21],
                &l[22..30],
                x + shift,
                &l[38..]
            )
        };
        atoms.filter(first).map(moved).collect()
    };
    let (one, other) = (lines("1orc.pdb", 'A', 0.0), lines("1hvr.pdb", 'B', 500.0));
    let pockets = |text: String| {
        let read = parse(text.as_bytes(), Format::Pdb, &ReadOptions::default());
        let options = PocketOptions {
            most: 1000,
            ..PocketOptions::default()
        };
        let found = find(&read.unwrap().structure, &options).unwrap();
        let centres = found.pockets.iter().map(|p| p.center);
        centres.collect::<Vec<Point3>>()
    };
    let both = pockets(one.clone() + &other);
    // The best of each; of the last ones the lattice decides.
    for alone in [pockets(one), pockets(other)] {
        for centre in alone.iter().take(3) {
            let near = both.iter().any(|other| (centre - other).norm() < 1.5);
            assert!(
                near,
                "the pocket at {centre} is lost beside the other chain"
            );
        }
    }
}

/// Fifty steps of each flow on real meshes: all stays finite, and no face folds against those around it. (Ears and horns
/// shrink, so that some faces look elsewhere than they did.)
#[test]
fn fifty_steps_fold_no_face() {
    let folded = |mesh: &TriMesh| {
        let normals = mesh.vertex_normals();
        let around = |t: usize| -> Vector3 {
            let corners = mesh.triangles()[t].iter();
            corners.map(|&v| normals[v as usize]).sum()
        };
        let upright = |t: &usize| mesh.doubled_area_normal(*t).dot(&around(*t)) > 0.0;
        (0..mesh.triangles().len()).filter(|t| !upright(t)).count()
    };
    for name in ["bob_small.ply", "spot.ply"] {
        let mesh = geom_core::io::mesh::read(fixtures::path(name)).unwrap();
        let mesh = mesh.mesh.into_triangles();
        let flows = [
            (FlowOperator::Ggho, 0.5),
            (FlowOperator::Ggho, 0.0),
            (FlowOperator::Lbo, 0.0),
        ];
        for (operator, sharpen) in flows {
            let options = FlowOptions {
                operator,
                iterations: 50,
                sharpen,
                // It is narrow faces that fold.
                least_angle: 0.0,
                ..FlowOptions::default()
            };
            let done = smooth(&mesh, 1, &options, Run::on(&Cpu)).unwrap();
            assert_eq!(done.report.steps, 50);
            assert!(done.report.rms_displacement > 0.01, "{:?}", done.report);
            let finite = |p: &Point3| p.iter().all(|c| c.is_finite());
            assert!(done.mesh.positions().iter().all(finite));
            assert_eq!(folded(&done.mesh), 0, "{name}, {operator:?} {sharpen}");
        }
    }
}

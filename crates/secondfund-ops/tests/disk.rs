//! The disc with three posts of the notes' table: what each operator sees of a body whose parts are known.

#![expect(clippy::print_stdout, reason = "figures for people, with --nocapture")]

use geom_core::grid::ScalarGrid;
use geom_core::{Aabb, Cpu, Lattice, Point3, Run, TriMesh};
use secondfund_ops::testing::rounded_box;
use secondfund_ops::{
    Element, Faces, Groups, Normals, Operator, SegmentOptions, Spectrum, SpectrumOptions, Weight,
    segment, spectrum,
};

/// Half the height of the disc, of radius 1, and how high its posts, of this radius, stand.
const THICK: f64 = 0.15;
const HIGH: f64 = 0.6;
const POST: f64 = 0.2;

/// The axes of the posts.
fn posts() -> [[f64; 2]; 3] {
    [0.0, 1.0, 2.0].map(|k: f64| {
        let (sin, cos) = (k * std::f64::consts::TAU / 3.0 + 0.3).sin_cos();
        [0.55 * cos, 0.55 * sin]
    })
}

/// The signed distance of a rounded cylinder around z.
fn cylinder([x, y, z]: [f64; 3], radius: f64, half: f64) -> f64 {
    let round = 0.04;
    let (a, b) = (x.hypot(y) - radius + round, z.abs() - half + round);
    a.max(b).min(0.0) + a.max(0.0).hypot(b.max(0.0)) - round
}

/// The union with a fillet.
fn joined(a: f64, b: f64) -> f64 {
    let width = 0.1;
    let h = (0.5 + 0.5 * (b - a) / width).clamp(0.0, 1.0);
    b + (a - b) * h - width * h * (1.0 - h)
}

fn disc() -> TriMesh {
    let corner = Point3::new(1.2, 1.2, 0.8);
    let lattice = Lattice::covering(&Aabb::of_points(&[corner, -corner]), 0.04);
    let inside = |p: Point3| {
        let posts = posts().into_iter().map(|[x, y]| {
            let middle = (HIGH - THICK) / 2.0;
            cylinder([p.x - x, p.y - y, p.z - middle], POST, HIGH - middle)
        });
        1.0 - posts.fold(cylinder([p.x, p.y, p.z], 1.0, THICK), joined)
    };
    let points = (0..lattice.len()).map(|i| inside(lattice.point(lattice.coordinates(i))) as f32);
    let grid = ScalarGrid::new(lattice, points.collect()).unwrap();
    let options = dual_contour::Options::default();
    dual_contour::surface(&grid, None, &options, Run::on(&Cpu))
        .unwrap()
        .mesh
}

/// The adjusted Rand index of two labelings (Hubert and Arabie, 1985), by faces: 1 for equal ones, 0 for chance.
fn adjusted_rand(a: &[u32], b: &[u32]) -> f64 {
    let count = |keys: &mut dyn Iterator<Item = (u32, u32)>| {
        let mut sizes = std::collections::BTreeMap::new();
        keys.for_each(|k| *sizes.entry(k).or_insert(0.0) += 1.0);
        sizes
            .values()
            .map(|n: &f64| n * (n - 1.0) / 2.0)
            .sum::<f64>()
    };
    let both = count(&mut a.iter().zip(b).map(|(&a, &b)| (a, b)));
    let [of_a, of_b] = [a, b].map(|l| count(&mut l.iter().map(|&l| (l, 0))));
    let n = a.len() as f64;
    let chance = of_a * of_b / (n * (n - 1.0) / 2.0);
    (both - chance) / ((of_a + of_b) / 2.0 - chance)
}

/// The share of the variance of a mode that lies between the parts.
fn between(modes: &Spectrum, mode: usize, part: &[u32]) -> f64 {
    let parts = 1 + *part.iter().max().unwrap() as usize;
    let (mut sums, mut areas) = (vec![0.0; parts], vec![0.0; parts]);
    let mut squares = 0.0;
    for ((&x, &area), &p) in modes.modes[mode].iter().zip(&modes.areas).zip(part) {
        sums[p as usize] += area * x;
        areas[p as usize] += area;
        squares += area * x * x;
    }
    let mean = sums.iter().sum::<f64>() / areas.iter().sum::<f64>();
    let centred = |(s, a): (&f64, &f64)| a * (s / a - mean).powi(2);
    let total = squares - mean * mean * areas.iter().sum::<f64>();
    sums.iter().zip(&areas).map(centred).sum::<f64>() / total
}

fn modes_of(mesh: &TriMesh, operator: Operator) -> Spectrum {
    let normals = Normals::OfMesh { rounds: 1 };
    let options = SpectrumOptions {
        operator,
        modes: 8,
        ..SpectrumOptions::default()
    };
    spectrum(&Element::Triangles(mesh, &normals), &options, Run::on(&Cpu)).unwrap()
}

/// How well this many groups of the modes of an operator are the parts.
fn found(mesh: &TriMesh, modes: &Spectrum, parts: &[u32], groups: usize) -> f64 {
    let options = SegmentOptions {
        groups: Groups::Count(groups),
        ..SegmentOptions::default()
    };
    let segments = segment(modes, &Faces::from(mesh), &options, Run::on(&Cpu)).unwrap();
    adjusted_rand(&segments.labels, parts)
}

#[test]
fn posts_are_parts_and_their_tops_are_faces() {
    let mesh = disc();
    let part = |p: &Point3| {
        let near = |[x, y]: [f64; 2]| (p.x - x).hypot(p.y - y) < POST + 0.03;
        let post = posts().into_iter().position(near);
        post.filter(|_| p.z > THICK + 0.02)
            .map_or(0, |k| k as u32 + 1)
    };
    // Ends, top and sides of the disc, top and sides of each post.
    let side = |p: &Point3| match part(p) {
        0 if p.z > THICK - 0.02 => 0,
        0 if p.z < 0.02 - THICK => 1,
        0 => 2,
        k if p.z > HIGH - 0.02 => 2 * k + 1,
        k => 2 * k + 2,
    };
    let triangles = 0..mesh.triangles().len();
    let middle = |t| {
        Point3::from(
            mesh.corners(t)
                .iter()
                .map(|p| p.coords)
                .sum::<geom_core::Vector3>()
                / 3.0,
        )
    };
    let parts: Vec<u32> = triangles.map(|t| part(&middle(t))).collect();
    let of_vertices = |label: &dyn Fn(&Point3) -> u32| -> Vec<u32> {
        mesh.positions().iter().map(label).collect()
    };
    let (parts_of, sides_of) = (of_vertices(&part), of_vertices(&side));

    let bent = modes_of(&mesh, Operator::Slo(Weight::ExpK));
    let rows: Vec<f64> = (0..3).map(|k| between(&bent, k, &parts_of)).collect();
    let gap = bent.values[3] / bent.values[2];
    let plain = modes_of(&mesh, Operator::Lbo);
    let index = [&bent, &plain].map(|modes| found(&mesh, modes, &parts, 4));
    println!(
        "e^K: {rows:.3?}, gap {gap}, {:.3?}; adjusted Rand {index:.3?}",
        bent.values
    );
    assert!(rows.iter().all(|&r| r > 0.97), "{rows:?}");
    assert!(gap > 10.0, "{gap}");
    assert!(index[0] > 0.97 && index[1] < 0.5, "{index:?}");

    // With weight 1 modes are constant on faces.
    let faces = modes_of(&mesh, Operator::Slo(Weight::One));
    let seen =
        [&faces, &plain].map(|m| (0..4).map(|k| between(m, k, &sides_of)).collect::<Vec<_>>());
    println!("1: {seen:.3?}, {:.3?}", faces.values);
    assert!(seen[0].iter().all(|&r| r > 0.95), "{seen:?}");
}

/// The six faces of a rounded box.
#[test]
fn a_box_has_six_faces() {
    let mesh = rounded_box([1.0, 0.8, 0.6], 0.12, 24).into_triangles();
    let normal = |t: usize| mesh.doubled_area_normal(t).normalize();
    let face = |t: usize| {
        let n = normal(t);
        2 * n.iamax() as u32 + u32::from(n[n.iamax()] > 0.0)
    };
    let parts: Vec<u32> = (0..mesh.triangles().len()).map(face).collect();
    let slo = modes_of(&mesh, Operator::Slo(Weight::One));
    let index = [&slo, &modes_of(&mesh, Operator::Lbo)].map(|m| found(&mesh, m, &parts, 6));
    let gap = slo.values[5] / slo.values[4];
    println!("box: adjusted Rand {index:.3?}, gap {gap}");
    assert!(index[0] > 0.99 && index[1] < 0.5, "{index:?}");
    assert!(gap > 8.0, "{gap}");
}

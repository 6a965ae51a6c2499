//! Single steps: what turns a cross, what a pair costs, how narrow a quad may be.

use crossfield::anisotropy::{Anisotropy, Function};
use crossfield::field::Frames;
use crossfield::map::Spacing;
use crossfield::{FieldOptions, cross_field, testing};
use geom_core::compute::random::SplitMix64;
use geom_core::mesh::shapes;
use geom_core::nalgebra::{DMatrix, DVector};
use geom_core::search::bvh::TriangleTree;
use geom_core::surface::laplace::EdgeWeights;
use geom_core::testing::same_on_any_threads;
use geom_core::{Cpu, Point3, Run, Vector3, VertexId};

/// However far crosses turn, what they turn by around vertices adds up to the Euler characteristic.
#[test]
fn indices_of_turned_crosses_add_up() {
    for (mesh, total) in [
        (shapes::icosphere(1.0, 2), 8),
        (shapes::torus(2.0, 0.7, 16, 8), 0),
    ] {
        let frames = Frames::of(&mesh, EdgeWeights::One).unwrap();
        let options = FieldOptions::default();
        let mut field = cross_field(&mesh, &[], &options, Run::on(&Cpu)).unwrap();
        let before = field.index.clone();
        let jacobian = |f: usize| {
            let (sine, cosine) = (0.7 * f as f64).sin_cos();
            [[cosine, sine], [-sine, cosine]]
        };
        let jacobians = (0..frames.faces()).map(jacobian).collect();
        let free: Vec<usize> = (0..frames.faces()).step_by(3).collect();
        assert!(testing::turn(&frames, &mut field, &free, jacobians, 0.9));
        assert_eq!(field.index.iter().sum::<i32>(), total);
        assert_ne!(field.index, before);
        let twins = frames.edges().twins().iter().enumerate();
        for (h, &t) in twins.filter(|&(h, &t)| t != u32::MAX && t as usize > h) {
            assert_eq!(field.jump[h], -field.jump[t as usize]);
        }
    }
}

/// Whatever triangles are cut into four: the pieces fill the same surface, and the crosses in them are those of before, with
/// the same singular vertices.
#[test]
fn a_field_goes_on_in_the_pieces_of_its_triangles() {
    let mut random = SplitMix64::new(3);
    for mesh in [
        shapes::icosphere(1.0, 3),
        shapes::torus(2.0, 0.7, 24, 12),
        testing::plate(12, 0.2, |i, j| (5..7).contains(&i) && j == 6),
    ] {
        let frames = Frames::of(&mesh, EdgeWeights::One).unwrap();
        let options = FieldOptions::default();
        let field = cross_field(&mesh, &[], &options, Run::on(&Cpu)).unwrap();
        for share in [0.0, 0.05, 0.3, 1.0] {
            let is_cut: Vec<bool> = (0..frames.faces()).map(|_| random.unit() < share).collect();
            let (pieces, after, carried) =
                testing::in_pieces(&mesh, &frames, &field, &is_cut).unwrap();
            let euler = mesh.euler_characteristic();
            assert_eq!(pieces.euler_characteristic(), euler);
            assert!((pieces.area() - mesh.area()).abs() < 1e-12 * mesh.area());
            let (old, new) = carried.index.split_at(mesh.positions().len());
            let inside = |v: &usize| !after.edges().on_boundary(VertexId(*v as u32));
            for v in (0..old.len()).filter(inside) {
                assert_eq!(old[v], field.index[v]);
            }
            let made = (old.len()..old.len() + new.len()).filter(inside);
            assert!(made.into_iter().all(|v| carried.index[v] == 0));
            // Where nothing is cut, the triangle is the same, and so are its four arms.
            let tree = TriangleTree::new(&mesh).unwrap();
            for f in 0..after.faces() {
                let centre = pieces
                    .corners(f)
                    .iter()
                    .fold(Vector3::zeros(), |s, p| s + p.coords);
                let parent = tree.closest(&Point3::from(centre / 3.0)).triangle;
                let [one, other] = [
                    carried.arms(&after, f)[0],
                    field.arms(&frames, parent as usize)[0],
                ];
                assert!((one - other).norm() < 1e-9, "{f} of {parent}");
            }
        }
    }
}

/// A tenth of the way towards the gradient that is farther off.
#[test]
fn crosses_turn_towards_the_worse_gradient() {
    let (sine, cosine) = 0.3f64.sin_cos();
    let small = 0.1f64;
    let expected = (0.1 * sine).atan2(1.0 + 0.1 * (cosine - 1.0));
    // u is off by 0.3 to the left, v is right; then v is off by as much.
    let u_off = [[cosine, sine], [0.0, 2.0]];
    assert!((testing::turned_by(&u_off, small) - expected).abs() < 1e-15);
    let v_off = [[3.0, 0.0], [-sine, cosine]];
    assert!((testing::turned_by(&v_off, small) - expected).abs() < 1e-15);
    assert_eq!(testing::turned_by(&[[1.0, 0.0], [0.0, 1.0]], small), 0.0);
    assert_eq!(testing::turned_by(&[[0.0; 2], [0.0, 1.0]], small), 0.0);
    // With a rate of one it is there at once.
    assert!((testing::turned_by(&u_off, 1.0) - 0.3).abs() < 1e-15);
}

#[test]
fn spacings_have_their_closed_forms() {
    for ratio in [0.2, 0.5, 1.0] {
        assert!((testing::narrowed(ratio, 1.0) - ratio).abs() < 1e-15);
        assert!((testing::narrowed(ratio, -1.0) - ratio).abs() < 1e-15);
        assert_eq!(testing::narrowed(ratio, 0.0), 1.0);
        let diagonal = (2.0 / (1.0 + 1.0 / (ratio * ratio))).sqrt();
        assert!((testing::narrowed(ratio, 0.5f64.sqrt()) - diagonal).abs() < 1e-15);
        // The trace of the metric is the same in every frame.
        for degrees in [0.0f64, 10.0, 33.0, 45.0, 80.0] {
            let (sine, cosine) = degrees.to_radians().sin_cos();
            let trace: f64 = [sine, cosine]
                .map(|c| testing::narrowed(ratio, c).powi(-2))
                .iter()
                .sum();
            assert!((trace - 1.0 - 1.0 / (ratio * ratio)).abs() < 1e-12);
        }
    }
}

#[test]
fn ratios_fall_along_the_ramp_and_jump_at_a_step() {
    let mut options = Anisotropy::of(Function::Mode(1));
    let at = |steepness, options: &Anisotropy| testing::ratio_at(steepness, options);
    assert_eq!(at(0.3, &options), 1.0);
    assert_eq!(at(0.9, &options), 0.2);
    assert!((at(0.6, &options) - 0.2f64.sqrt()).abs() < 1e-15);
    options.ramp = [0.5, 0.5];
    assert_eq!([at(0.5, &options), at(0.501, &options)], [1.0, 0.2]);
    // Everywhere, but not where there is no gradient.
    options.ramp = [0.0, 0.0];
    assert_eq!([at(0.0, &options), at(1e-3, &options)], [1.0, 0.2]);
}

#[test]
fn values_on_other_triangles_are_those_of_the_same_places() {
    let mesh = shapes::icosphere(1.0, 3);
    let height: Vec<f64> = mesh.positions().iter().map(|p| p.z).collect();
    let tree = TriangleTree::new(&mesh).unwrap();
    let other = shapes::icosphere(1.0, 2);
    let there = testing::carried(&tree, &mesh, &height, &other).unwrap();
    for (p, z) in other.positions().iter().zip(there) {
        assert!((p.z - z).abs() < 1e-12);
    }
}

#[test]
fn near_pairs_cost_more() {
    let (far, near) = (0.25, testing::NEAR);
    assert_eq!(
        [100.0, near * 2.0, near, 0.5 * near].map(|d| testing::price(far, 2.0, d)),
        [0.25, 0.25, 1.0, 4.0]
    );
    // Where the side of a quad does not matter.
    assert_eq!(testing::price(far, 0.0, 1e-3), 0.25);
}

#[test]
fn modes_are_taken_up_to_the_widest_gap() {
    // An elongated body: its first mode stands alone.
    assert_eq!(
        testing::standing_apart(&[0.0, 1.0, 4.0, 4.4, 5.0, 5.5, 6.0, 6.5]),
        1
    );
    // A ball: three of one kind, then five of the next.
    assert_eq!(
        testing::standing_apart(&[0.0, 2.0, 2.0, 2.0, 6.0, 6.0, 6.0, 6.0, 6.0]),
        3
    );
    // Of equal gaps the first, and never more than six.
    assert_eq!(
        testing::standing_apart(&[0.0, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0]),
        1
    );
    assert_eq!(
        testing::standing_apart(&[0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.1, 99.0]),
        6
    );
    assert_eq!(testing::standing_apart(&[0.0, 1.0]), 1);
}

#[test]
fn spacings_turn_with_the_arms() {
    let of_faces = Spacing::PerFace(vec![[9.0; 2], [1.0, 2.0]]);
    let turned = [0, 1, 2, 3].map(|comb| testing::spacing_of_face(&of_faces, 1, comb));
    assert_eq!(turned, [[1.0, 2.0], [2.0, 1.0], [1.0, 2.0], [2.0, 1.0]]);
    assert_eq!(
        testing::spacing_of_face(&Spacing::Uniform(3.0), 7, 1),
        [3.0; 2]
    );
}

/// A quad of 4 by 1 wants to stay one, as far as it may be narrow.
#[test]
fn narrow_quads_keep_their_proportions() {
    let quad = [[0.0, 0.0], [4.0, 0.0], [4.0, 1.0], [0.0, 1.0]];
    let quad = quad.map(|[x, y]| Point3::new(x, y, 0.0));
    let near = |a: [f64; 2], b: [f64; 2]| (0..2).all(|k| (a[k] - b[k]).abs() < 1e-12);
    assert!(near(testing::lengths(&quad, 0.2), [4.0, 1.0]));
    assert!(near(testing::lengths(&quad, 0.5), [10.0 / 3.0, 5.0 / 3.0]));
    assert_eq!(testing::lengths(&quad, 1.0), [2.5; 2]);
    let turned = [quad[1], quad[2], quad[3], quad[0]];
    assert!(near(testing::lengths(&turned, 0.2), [1.0, 4.0]));
    // One without any side is no reason for NaN.
    assert_eq!(testing::lengths(&[Point3::origin(); 4], 0.2), [0.0; 2]);
}

/// A matrix whose eigenvalues are 1 or more, row after row.
fn positive_definite(n: usize) -> Vec<f64> {
    let mut random = SplitMix64::new(n as u64);
    let half: Vec<f64> = (0..n * n).map(|_| random.symmetric()).collect();
    let mut matrix = vec![0.0; n * n];
    for (i, j) in (0..n * n).map(|at| (at / n, at % n)) {
        let product = (0..n).map(|k| half[i * n + k] * half[j * n + k]);
        matrix[i * n + j] = product.sum::<f64>() + f64::from(u8::from(i == j));
    }
    matrix
}

/// Of sizes that fill the last eight columns and those that do not, and of several strips.
#[test]
fn inverses_are_inverse() {
    for n in [1, 7, 8, 9, 40, 64, 65, 300] {
        let matrix = positive_definite(n);
        let inverse = testing::inverse(&matrix, n).unwrap();
        for (i, j) in (0..n * n).map(|at| (at / n, at % n)) {
            let product = (0..n).map(|k| matrix[i * n + k] * inverse[k * n + j]);
            let off = product.sum::<f64>() - f64::from(u8::from(i == j));
            assert!(off.abs() < 1e-12, "{n}: {off}");
        }
    }
    assert!(testing::inverse(&[1.0, 2.0, 2.0, 1.0], 2).is_none());
    // A pivot that is not positive in the second strip.
    let mut matrix = positive_definite(100);
    matrix[99 * 100 + 99] = 0.0;
    assert!(testing::inverse(&matrix, 100).is_none());
}

/// What descent remembers of moves that turn a triangle over is what it would find if it asked again, over many moves that
/// make some allowed and others not.
#[test]
fn remembered_moves_are_still_forbidden() {
    let mut random = SplitMix64::new(5);
    let mut below = |n: usize| (random.unit() * n as f64) as usize;
    // Few enough that the same pairs come again while they are forbidden.
    let count = 8;
    let conditions: Vec<Vec<(u32, i64)>> = (0..6)
        .flat_map(|_| {
            let first = below(count);
            let three = [first, (first + 1) % count, (first + 3) % count];
            let sign = |k: usize| (k as u32, 2 * below(2) as i64 - 1);
            let sum = three.map(sign);
            // Neither more than 1 nor less than −1: the walk comes back.
            [sum.to_vec(), sum.map(|(k, c)| (k, -c)).to_vec()]
        })
        .collect();
    let moves: Vec<[usize; 2]> = (0..20_000)
        .map(|_| [below(2 * count), below(2 * count)])
        .collect();
    let found = testing::guarded(count, &conditions, &moves);
    let made = found.iter().filter(|[may, _]| *may).count();
    assert!((2_000..18_000).contains(&made), "{made}");
    assert!(found.iter().all(|[may, holds]| may == holds));
}

/// Singular vertices of 7TAA's map that rounding has laid onto each other: no triangle between them has an area before three of their
/// integers have moved, and every move of one or two leaves as much amiss.
#[test]
fn integers_of_a_point_move_together() {
    // Of sides p and q: px, py, qx, qy.
    const TRIANGLES: [&[(u32, [i64; 4])]; 4] = [
        &[
            (2, [1, 0, 1, 0]),
            (3, [0, 1, 0, 1]),
            (4, [1, 0, 1, -1]),
            (5, [0, 1, 1, 1]),
            (6, [-1, -1, -1, 0]),
            (7, [1, -1, 0, -1]),
        ],
        &[
            (0, [1, 0, 1, 0]),
            (1, [0, 1, 0, 1]),
            (2, [0, -1, -1, -1]),
            (3, [1, 0, 1, -1]),
            (4, [0, 0, -1, 0]),
            (5, [0, 0, 0, -1]),
            (6, [-1, 0, 0, 1]),
            (7, [0, -1, -1, 0]),
        ],
        &[
            (0, [-1, 0, -1, 0]),
            (1, [0, -1, 0, -1]),
            (2, [0, 1, 0, 1]),
            (3, [-1, 0, -1, 0]),
            (4, [1, 0, 0, 0]),
            (5, [0, 1, 0, 0]),
            (6, [0, 0, 1, 0]),
            (7, [0, 0, 0, 1]),
        ],
        &[
            (0, [1, 0, 1, -1]),
            (1, [0, 1, 1, 1]),
            (2, [0, -1, -1, 0]),
            (3, [1, 0, 0, -1]),
            (4, [-1, 0, -1, 1]),
            (5, [0, -1, -1, -1]),
            (6, [0, 0, 1, 0]),
            (7, [0, 0, 0, 1]),
        ],
    ];
    // Those of other vertices bound the steps alone.
    let mut start = [0.0; 40];
    start[..8].copy_from_slice(&[0.0, -1.0, -2.0, -2.0, -2.0, 1.0, -2.0, 1.0]);
    let area = |triangle: &[(u32, [i64; 4])], z: &[f64]| {
        let side = |slot: usize| {
            let terms = triangle
                .iter()
                .map(|(k, c)| c[slot] as f64 * z[*k as usize]);
            terms.sum::<f64>()
        };
        side(0) * side(3) - side(1) * side(2)
    };
    let short = |z: &[f64]| {
        let all = TRIANGLES
            .iter()
            .map(|triangle| (1.0 - area(triangle, z)).max(0.0));
        all.sum::<f64>()
    };
    for (i, j) in (0..64).map(|at| (at / 8, at % 8)) {
        for (d, e) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)] {
            let mut z = start;
            z[i] += d;
            z[j] += e;
            assert!(short(&z) >= short(&start));
        }
    }
    let side = |triangle: &[(u32, [i64; 4])], slot: usize| {
        let terms = triangle.iter().map(|&(k, c)| (k, c[slot]));
        terms.filter(|t| t.1 != 0).collect()
    };
    let sides = TRIANGLES.map(|t| [[side(t, 0), side(t, 1)], [side(t, 2), side(t, 3)]]);
    let found = same_on_any_threads(|| {
        let relaxed = [[[1.0, 0.0], [0.0, 1.0]]; 4];
        testing::mended(&sides, &relaxed, &start).unwrap()
    });
    assert_eq!(short(&found.unwrap()), 0.0);
}

/// Rounding holds the nearest variable, the others at the exact minimum of what is left: as solved anew each time.
#[test]
fn rounding_is_that_of_exact_minima() {
    for n in [1, 5, 150] {
        let matrix = positive_definite(n);
        let mut random = SplitMix64::new(7);
        // The minimum is far from integers, and not small.
        let wanted: Vec<f64> = (0..n).map(|_| 20.0 * random.symmetric()).collect();
        let row = |i: usize| (0..n).map(move |j| i * n + j);
        let right: Vec<f64> = (0..n)
            .map(|i| row(i).map(|at| matrix[at] * wanted[at % n]).sum())
            .collect();
        let found = same_on_any_threads(|| testing::rounded(&matrix, &right).unwrap());
        let mut held: Vec<Option<f64>> = vec![None; n];
        for _ in 0..n {
            let free: Vec<usize> = (0..n).filter(|&i| held[i].is_none()).collect();
            let part =
                DMatrix::from_fn(free.len(), free.len(), |i, j| matrix[free[i] * n + free[j]]);
            let side = DVector::from_fn(free.len(), |i, _| {
                let known = (0..n).map(|j| matrix[free[i] * n + j] * held[j].unwrap_or(0.0));
                right[free[i]] - known.sum::<f64>()
            });
            let z = part.cholesky().unwrap().solve(&side);
            let away = |i: usize| (z[i] - z[i].round()).abs();
            let nearest = (0..free.len()).min_by(|&a, &b| away(a).total_cmp(&away(b)));
            let nearest = nearest.unwrap();
            held[free[nearest]] = Some(z[nearest].round());
        }
        let exact: Vec<f64> = held.into_iter().flatten().collect();
        assert_eq!(found, exact, "{n}");
    }
}

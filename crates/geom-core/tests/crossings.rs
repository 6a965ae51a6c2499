//! Triangles that cross each other.

use geom_core::mesh::shapes;
use geom_core::search::crossing::{
    BoxedTriangle, CrossingWatch, crossing_pairs, crossing_pairs_among,
};
use geom_core::testing::cases;
use geom_core::{Point3, TriMesh};
use proptest::prelude::*;

fn by_hand(mesh: &TriMesh) -> Vec<[u32; 2]> {
    let at = |v: u32| mesh.positions()[v as usize];
    let triangles = mesh.triangles().iter();
    let boxed: Vec<_> = triangles.map(|&t| BoxedTriangle::new(t, &at)).collect();
    let all = (0..boxed.len()).flat_map(|i| (i + 1..boxed.len()).map(move |j| [i, j]));
    all.filter(|&[i, j]| boxed[i].crosses(&boxed[j]))
        .map(|pair| pair.map(|i| i as u32))
        .collect()
}

proptest! {
    #![proptest_config(cases(64))]

    #[test]
    fn the_tree_finds_what_all_pairs_find(
        x in prop::collection::vec(prop::array::uniform3(-1.0..1.0f64), 4..60),
        corners in prop::collection::vec(prop::array::uniform3(any::<prop::sample::Index>()), 0..80),
    ) {
        let distinct = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
        let triangles = corners.iter().map(|t| t.map(|i| i.index(x.len()) as u32));
        let triangles: Vec<_> = triangles.filter(distinct).collect();
        let mesh = TriMesh::new(x.into_iter().map(Point3::from).collect(), triangles).unwrap();
        let pairs = by_hand(&mesh);
        prop_assert_eq!(&crossing_pairs(&mesh), &pairs);
        for step in [1, 3, 50, 1000] {
            let among = |t: u32| t % step == 2 % step;
            let of_some = pairs.iter().filter(|p| p.iter().any(|&t| among(t)));
            let of_some: Vec<[u32; 2]> = of_some.copied().collect();
            prop_assert_eq!(crossing_pairs_among(&mesh, among), of_some);
        }
    }
}

/// Steps shorter and longer than the margin: a plate whose lower side is shaken ever more.
#[test]
fn a_watched_surface_crosses_where_it_does() {
    let ball = shapes::icosphere(1.0, 3);
    for step in [0.002, 0.06] {
        let mut watch = CrossingWatch::new(ball.triangles().to_vec(), 0.02);
        let mut found = 0;
        for round in 0..12 {
            let shaken = ball.positions().iter().enumerate().map(|(v, p)| {
                let up = 0.05 * p.z + step * f64::from(round) * f64::from(v % 5 == 0);
                Point3::new(p.x, p.y, up)
            });
            let shaken: Vec<Point3> = shaken.collect();
            let mesh = TriMesh::new(shaken.clone(), ball.triangles().to_vec()).unwrap();
            let pairs = watch.crossing_pairs(&shaken).unwrap();
            assert_eq!(pairs, crossing_pairs(&mesh), "round {round} of {step}");
            found += pairs.len();
        }
        assert!(found > 10, "{found}");
    }
    let mut nothing = CrossingWatch::new(Vec::new(), 0.1);
    assert_eq!(nothing.crossing_pairs(&[]), Ok(Vec::new()));
    let mut watch = CrossingWatch::new(ball.triangles().to_vec(), 0.02);
    let mut lost = ball.positions().to_vec();
    assert_eq!(watch.crossing_pairs(&lost), Ok(Vec::new()));
    lost[7].x = f64::NAN;
    assert!(watch.crossing_pairs(&lost).is_err() && watch.crossing_pairs(&[]).is_err());
}

#[test]
fn what_touches_does_not_cross() {
    let p = |x, y, z| Point3::new(x, y, z);
    let x = [
        p(0.0, 0.0, 0.0),
        p(4.0, 0.0, 0.0),
        p(0.0, 4.0, 0.0),
        // Through the first, from below to above.
        p(1.0, 1.0, -1.0),
        p(1.0, 1.0, 1.0),
        p(1.5, 1.0, 1.0),
        // On it with one corner.
        p(0.5, 0.5, 0.0),
        p(0.5, 0.5, 2.0),
        p(0.0, 0.5, 2.0),
    ];
    let pairs = |triangles: [[u32; 3]; 2]| {
        crossing_pairs(&TriMesh::new(x.to_vec(), triangles.to_vec()).unwrap())
    };
    assert_eq!(pairs([[0, 1, 2], [3, 4, 5]]), [[0, 1]]);
    assert_eq!(pairs([[0, 1, 2], [6, 7, 8]]), [[0; 2]; 0]);
    // A fold about a common edge is no crossing; one about a common corner may be.
    assert_eq!(pairs([[0, 1, 2], [1, 0, 4]]), [[0; 2]; 0]);
    assert_eq!(pairs([[0, 1, 2], [0, 3, 4]]), [[0, 1]]);
}

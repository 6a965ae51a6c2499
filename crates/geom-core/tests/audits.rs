//! Half-edges and audits: every fault of a mesh is found and named.

use geom_core::mesh::{
    BoundaryComparison, FACES, Halfedges, INTERIOR, SurfaceAudit, VolumeAudit, shapes,
};
use geom_core::testing::same_on_any_threads;
use geom_core::{MeshError, Point3, TetMesh, TriMesh, VertexId};

#[test]
fn a_sphere_and_a_torus_are_closed() {
    let sphere = SurfaceAudit::of(&shapes::icosphere(2.0, 3));
    assert!(sphere.is_closed_manifold(), "{sphere}");
    assert_eq!(sphere.components[0].genus(), Some(0));
    assert_eq!(sphere.edges, 3 * sphere.faces / 2);
    let torus = shapes::torus(3.0, 1.0, 30, 20);
    let audit = SurfaceAudit::of(&torus);
    assert_eq!(audit.components[0].genus(), Some(1));
    assert!((audit.area() - torus.area()).abs() < 1e-9 * torus.area());
    assert!((audit.volume() - torus.volume()).abs() < 1e-9 * torus.volume());
}

#[test]
fn each_fault_is_found_and_named() {
    let (positions, triangles) = shapes::icosphere(1.0, 1).into_parts();
    let audit =
        |t: &[[u32; 3]]| SurfaceAudit::of(&TriMesh::new(positions.clone(), t.to_vec()).unwrap());
    let open = audit(&triangles[1..]);
    assert_eq!(open.boundary_edges.count, 3);
    assert!(!open.is_closed_manifold() && open.is_manifold());
    assert_eq!(open.components[0].genus(), None);

    let mut turned = triangles.clone();
    turned[7].swap(0, 1);
    let turned = audit(&turned);
    assert_eq!(turned.orientation_conflicts.count, 3);
    assert!(!turned.is_manifold());

    let mut doubled = triangles.clone();
    doubled.push(triangles[4]);
    let doubled = audit(&doubled);
    assert_eq!(doubled.nonmanifold_edges.count, 3);
    assert_eq!(doubled.duplicate_faces.first, Some(triangles.len() as u32));

    assert!(!audit(&[]).is_closed_manifold());
}

#[test]
fn two_tetrahedra_that_touch_in_a_vertex_are_no_manifold() {
    let mut positions: Vec<Point3> = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.], [0., 0., 1.]]
        .map(Point3::from)
        .to_vec();
    positions.extend([[-1., 0., 0.], [0., -1., 0.], [0., 0., -1.]].map(Point3::from));
    let mut triangles = FACES.map(|f| f.map(|k| k as u32)).to_vec();
    let mirrored = [0, 4, 6, 5];
    triangles.extend(FACES.map(|f| f.map(|k| mirrored[k])));
    let audit = SurfaceAudit::of(&TriMesh::new(positions.clone(), triangles).unwrap());
    assert_eq!(audit.nonmanifold_vertices.first, Some(0));
    assert_eq!(audit.nonmanifold_vertices.count, 1);
    assert_eq!(audit.components.len(), 1);
    assert!(audit.nonmanifold_edges.none() && audit.boundary_edges.none());

    // As a volume it has two pieces, because they share no face.
    let volume = TetMesh::new(positions, vec![[0, 1, 2, 3], [0, 4, 6, 5]]).unwrap();
    let audit = VolumeAudit::of(&volume);
    assert_eq!((audit.components, audit.boundary_faces), (2, 8));
    assert!(audit.is_valid(), "{audit}");
}

#[test]
fn faults_of_tetrahedra_are_found_and_named() {
    let positions = [
        [0., 0., 0.],
        [1., 0., 0.],
        [0., 1., 0.],
        [0., 0., 1.],
        [0.3, 0.3, 2.0],
        [0.2, 0.2, -1.0],
        [1., 1., 0.],
    ]
    .map(Point3::from)
    .to_vec();
    let audit = |tets: &[[u32; 4]]| {
        VolumeAudit::of(&TetMesh::new(positions.clone(), tets.to_vec()).unwrap())
    };
    let good = audit(&[[0, 1, 2, 3], [0, 2, 1, 5]]);
    assert!(good.is_conforming() && good.is_positive());
    assert_eq!((good.faces, good.boundary_faces), (7, 6));
    assert_eq!(good.unused_vertices.count, 2);
    assert!(!good.is_valid(), "vertices 4 and 6 are unused");

    let inverted = audit(&[[0, 1, 2, 3], [0, 1, 2, 5]]);
    assert_eq!(inverted.inverted_tets.first, Some(1));
    let flat = audit(&[[0, 1, 2, 6]]);
    assert_eq!(flat.flat_tets.first, Some(0));
    let folded = audit(&[[0, 1, 2, 3], [0, 1, 2, 4]]);
    assert_eq!(folded.folded_faces.first, Some([0, 1, 2]));
    let overfull = audit(&[[0, 1, 2, 3], [0, 2, 1, 5], [0, 1, 2, 4]]);
    assert_eq!(overfull.overfull_faces.first, Some([0, 1, 2]));
}

#[test]
fn the_boundary_is_compared_by_position() {
    let ball = shapes::ball(2.0, 3);
    let surface = ball.region_surface(INTERIOR);
    let same = BoundaryComparison::of(&ball, INTERIOR, &surface);
    assert!(same.is_equal(), "{same:?}");
    let (positions, mut triangles) = surface.into_parts();
    triangles[5].swap(1, 2);
    triangles.pop();
    let other = TriMesh::new(positions, triangles).unwrap();
    let other = BoundaryComparison::of(&ball, INTERIOR, &other);
    assert_eq!((other.reversed, other.extra.count), (1, 1));
    assert!(other.missing.none());
}

#[test]
fn audits_do_not_depend_on_threads() {
    let ball = shapes::ball(2.0, 6);
    same_on_any_threads(|| {
        let surface = ball.region_surface(INTERIOR);
        (SurfaceAudit::of(&surface), VolumeAudit::of(&ball))
    });
}

#[test]
fn closed_meshes_have_twins_everywhere() {
    let torus = shapes::torus(3.0, 1.0, 12, 9);
    let edges = Halfedges::of(&torus).unwrap();
    for h in edges.iter() {
        let twin = edges.twin(h).expect("closed");
        assert_eq!(edges.twin(twin), Some(h));
        assert_eq!(
            (edges.from(h), edges.to(h)),
            (edges.to(twin), edges.from(twin))
        );
        assert_eq!(edges.next(edges.previous(h)), h);
        assert_eq!(edges.face(h), edges.face(edges.next(h)));
    }
    assert_eq!(edges.edges().count() * 2, edges.len());
    for v in 0..edges.vertices() {
        assert_eq!(edges.around(VertexId(v as u32)).count(), 6);
    }
    assert!(edges.boundary_loops().is_empty());
}

#[test]
fn boundaries_are_walked_with_the_surface_on_the_left() {
    // A 3 × 3 field of quads without the middle one: an outer loop of 12, an inner one of 4.
    let at = |i: u32, j: u32| 4 * j + i;
    let quads: Vec<[u32; 4]> = (0..9)
        .filter(|&q| q != 4)
        .map(|q| {
            let (i, j) = (q % 3, q / 3);
            [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]
        })
        .collect();
    let edges = Halfedges::<4>::new(16, &quads).unwrap();
    let loops = edges.boundary_loops();
    assert_eq!(loops.iter().map(Vec::len).collect::<Vec<_>>(), [12, 4]);
    assert_eq!(loops[0][..3], [0, 1, 2].map(VertexId));
    assert!(edges.on_boundary(VertexId(0)));
    assert_eq!(edges.around(VertexId(5)).count(), 3);
}

#[test]
fn what_is_not_manifold_is_named() {
    let fan = [[0, 1, 2], [0, 1, 3], [1, 0, 4]];
    assert_eq!(
        Halfedges::<3>::new(5, &fan[..2]),
        Err(MeshError::NonManifoldEdge {
            face: 1,
            from: 0,
            to: 1
        })
    );
    assert!(Halfedges::<3>::new(5, &fan).is_err());
    let bow = [[0, 1, 2], [0, 3, 4]];
    assert_eq!(
        Halfedges::<3>::new(5, &bow),
        Err(MeshError::NonManifoldVertex { vertex: 0 })
    );
    assert!(matches!(
        Halfedges::<3>::new(4, &bow),
        Err(MeshError::OutOfRange { .. })
    ));
}

//! Links of edges.

use geom_core::{Point3, TetMesh};

use crate::mesh::editable::EditableMesh;
use crate::mesh::link::{ContractedEdge, EdgeLink, INFINITY, VertexLink, common, keeps_topology};

pub fn a_tetrahedron_all_of_whose_faces_are_boundary_does_not_vanish() {
    // Two that share a corner: all that the ends of an edge of one have in common, vertices and edges,
    // lies opposite that edge, and yet contracting it would leave nothing of the tetrahedron but a
    // triangle. Only their common opposite triangle, with infinity, shows that.
    let x = [
        [0.0, 0.0, 0.0],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [-1.0, 0.0, 0.0],
        [0.0, -1.0, 0.0],
        [0.0, 0.0, -1.0],
    ];
    let tets = vec![[0, 1, 2, 3], [0, 4, 6, 5]];
    let mesh = TetMesh::new(x.map(Point3::from).to_vec(), tets).unwrap();
    let mesh = EditableMesh::new(mesh);
    for on_surface in [false, true] {
        let edge = ContractedEdge {
            from: 0,
            to: 1,
            on_surface,
        };
        let link = EdgeLink::new(&mesh, 0, 1).unwrap();
        let [from, to] = [0, 1].map(|v| VertexLink::of(&mesh, v));
        assert_eq!(common(&from.vertices, &to.vertices), [2, 3, INFINITY]);
        assert_eq!(common(&from.edges, &to.edges).len(), 3);
        assert!(!keeps_topology(&mesh, edge, &link));
    }
}

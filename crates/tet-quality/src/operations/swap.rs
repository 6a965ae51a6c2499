//! Operations that keep the vertices: removal of an edge, swap of a face, flip of a surface edge.
//!
//! The tetrahedra around an inner edge ab fill a double cone over the ring of their other vertices. Without ab, each
//! triangulation of the ring fills it too, every triangle joined to a and to b: n tetrahedra become 2 (n − 2). There are
//! Catalan numbers of triangulations, but the worst tetrahedron of the best one is found without trying them all: the best
//! triangulation of a part of the ring from vertex i to j is a triangle (i, k, j) with the best ones of i to k and of k to j,
//! O(n³) in all (Klincsek 1980; Shewchuk 2002). The swap of a face is the reverse of the case n = 3.
//!
//! An edge on a surface has no full ring. It flips within its two surface triangles, if these are plane or the field says that
//! the other diagonal is as near, and the tetrahedra of either side are rebuilt around it.

use geom_core::mesh::{FACES, Region};
use geom_core::{Point3, Vector3};

use crate::boundary::field::Isosurface;
use crate::measure::metrics::quality;
use crate::mesh::editable::{EditableMesh, Freedom};
use crate::mesh::link::EdgeLink;
use crate::mesh::proposal::{Floor, NewTet, Operation, Proposal};

/// Most tetrahedra around an edge that is removed.
/// Longer rings hardly ever have a good triangulation, and tables of fixed size need no memory.
const LONGEST_LINK: usize = 8;
/// Cosine between the normals of two surface triangles whose common edge may flip.
const FLAT_ENOUGH: f64 = 0.9;
/// Sine between normals that count as one plane.
const PLANE: f64 = 1e-9;

/// A triangulation of the polygon around an edge.
struct Triangulation {
    /// Counter-clockwise seen from the second end of the edge.
    triangles: Vec<[u32; 3]>,
    /// The worst objective of the triangles joined to either end.
    worst: f64,
}

/// The triangulation of the polygon `chain` whose worst tetrahedron with `a` or `b` is best, if it is
/// above `floor` (Klincsek's dynamic programme).
/// The diagonals are not checked here: see `clashes`.
fn triangulate(
    mesh: &EditableMesh,
    [a, b]: [u32; 2],
    chain: &[u32],
    floor: f64,
) -> Option<Triangulation> {
    let n = chain.len();
    let at = |v: u32| mesh.x[v as usize];
    let (pa, pb) = (at(a), at(b));
    let p: Vec<Point3> = chain.iter().map(|&v| at(v)).collect();
    // best[i][j]: the polygon i…j; split[i][j]: the third corner of the triangle at ij.
    let mut best = [[f64::INFINITY; LONGEST_LINK + 1]; LONGEST_LINK + 1];
    let mut split = [[0u8; LONGEST_LINK + 1]; LONGEST_LINK + 1];
    for width in 2..n {
        for i in 0..n - width {
            let k = i + width;
            best[i][k] = f64::NEG_INFINITY;
            for j in i + 1..k {
                // What is not above the bound already cannot be the best: no need to measure it.
                let rest = best[i][j].min(best[j][k]);
                let bound = best[i][k].max(floor);
                if rest <= bound {
                    continue;
                }
                let upper = quality([p[i], p[j], p[k], pb]);
                if upper <= bound {
                    continue;
                }
                let worst = upper.min(quality([p[i], p[k], p[j], pa])).min(rest);
                if worst > bound {
                    best[i][k] = worst;
                    split[i][k] = j as u8;
                }
            }
        }
    }
    let worst = best[0][n - 1];
    if worst <= floor {
        return None;
    }
    let mut triangles = Vec::with_capacity(n - 2);
    let mut open = vec![(0, n - 1)];
    while let Some((i, k)) = open.pop() {
        if k - i < 2 {
            continue;
        }
        let j = split[i][k] as usize;
        triangles.push([chain[i], chain[j], chain[k]]);
        open.extend([(i, j), (j, k)]);
    }
    Some(Triangulation { triangles, worst })
}

/// Does a triangulation use a diagonal that is already an edge, or a triangle that is already a face?
/// Either would be there twice, and the mesh no complex any more.
fn clashes(mesh: &EditableMesh, chain: &[u32], triangles: &[[u32; 3]]) -> bool {
    let n = chain.len();
    let slot = |v: u32| chain.iter().position(|&c| c == v).expect("a chain vertex");
    let side = |u: u32, v: u32| {
        let (i, j) = (slot(u), slot(v));
        let d = i.abs_diff(j);
        d == 1 || d == n - 1
    };
    triangles.iter().any(|&[u, v, w]| {
        let mut diagonal = false;
        for (s, t) in [(u, v), (v, w), (w, u)] {
            if !side(s, t) {
                diagonal = true;
                if mesh.edge_exists(s, t) {
                    return true;
                }
            }
        }
        !diagonal && mesh.face_exists(u, v, w)
    })
}

/// Each triangle joined to both ends of the edge.
fn both_sides([a, b]: [u32; 2], triangles: &[[u32; 3]], region: Region) -> Vec<NewTet> {
    triangles
        .iter()
        .flat_map(|&[u, v, w]| [[u, v, w, b], [u, w, v, a]])
        .map(|corners| NewTet { corners, region })
        .collect()
}

fn worst_of(mesh: &EditableMesh, tets: &[u32]) -> f64 {
    tets.iter()
        .map(|&t| mesh.q[t as usize])
        .fold(f64::INFINITY, f64::min)
}

/// Removal of the interior edge `ab`: the link is triangulated, and each triangle joined to `a` and
/// `b`. A link of 3 is the 3-2 swap, of 4 the 4-4 swap.
pub(crate) fn edge_removal(mesh: &EditableMesh, a: u32, b: u32, floor: Floor) -> Option<Proposal> {
    let link = EdgeLink::new(mesh, a, b)?;
    let n = link.tets.len();
    if !(3..=LONGEST_LINK).contains(&n) || !link.interior() {
        return None;
    }
    let old = worst_of(mesh, &link.tets);
    if old <= 0.0 {
        return None;
    }
    let chain = &link.vertices[..n];
    let found = triangulate(mesh, [a, b], chain, floor.above(old))?;
    if clashes(mesh, chain, &found.triangles) {
        return None;
    }
    let insert = both_sides([a, b], &found.triangles, link.regions[0]);
    let gain = found.worst - old;
    Some(Proposal::swap(
        Operation::EdgeRemoval,
        gain,
        link.tets,
        insert,
    ))
}

/// Swap of the face of `t` opposite its corner `k`: two tetrahedra become three around a new edge.
/// Only within one region. The new edge goes through the face if all three are positive, which needs no test of its
/// own.
pub(crate) fn face_swap(mesh: &EditableMesh, t: u32, k: usize, floor: Floor) -> Option<Proposal> {
    let o = mesh.beyond(t, k)?;
    let region = mesh.regions[t as usize];
    let old = mesh.q[t as usize].min(mesh.q[o as usize]);
    if mesh.regions[o as usize] != region || old <= 0.0 {
        return None;
    }
    let tet = mesh.tets[t as usize];
    let [u, v, w] = FACES[k].map(|i| tet[i]);
    let (p, r) = (tet[k], other_corner(mesh.tets[o as usize], [u, v, w])?);
    let new = [[p, u, v, r], [p, v, w, r], [p, w, u, r]];
    let mut worst = f64::INFINITY;
    for tet in new {
        worst = worst.min(mesh.quality_of(tet));
        if worst <= floor.above(old) {
            return None;
        }
    }
    if mesh.edge_exists(p, r) {
        return None;
    }
    let insert = new.map(|corners| NewTet { corners, region }).to_vec();
    Some(Proposal::swap(
        Operation::FaceSwap,
        worst - old,
        vec![t, o],
        insert,
    ))
}

/// The corner that a neighbour has beyond the common face.
fn other_corner(tet: [u32; 4], face: [u32; 3]) -> Option<u32> {
    tet.into_iter().find(|v| !face.contains(v))
}

/// Flip of the surface edge `ab` to the edge between the opposite corners of its two surface
/// triangles; the tetrahedra of each side are rebuilt. `allowed` is the distance from the isosurface
/// that the middle of the new edge may have; without a field only plane pairs flip.
pub(crate) fn surface_flip(
    mesh: &EditableMesh,
    a: u32,
    b: u32,
    field: Option<&Isosurface<'_>>,
    allowed: f64,
    floor: Floor,
) -> Option<Proposal> {
    if [a, b].map(|v| mesh.freedom[v as usize]) == [Freedom::Held; 2] {
        return None;
    }
    let at_interface = EdgeLink::new(mesh, a, b)?.at_interface()?;
    let (link, first) = (at_interface.link, at_interface.first);
    let n = link.tets.len();
    let old = worst_of(mesh, &link.tets);
    if old <= 0.0 {
        return None;
    }
    // Each side of the interface is a chain from one opposite corner to the other.
    let (w, z) = (link.vertices[0], link.vertices[first]);
    let sides = [0..first, first..n];
    let mut inner = sides.iter().filter(|side| !side.is_empty());
    if inner.any(|side| !(2..=LONGEST_LINK).contains(&side.len())) {
        return None;
    }
    let bend = bend(mesh, [a, b], [w, z])?;
    let field = match bend {
        Bend::Plane => None,
        Bend::Curved => Some(field?),
    };
    let mut worst = f64::INFINITY;
    let mut insert = Vec::new();
    for side in sides.iter().filter(|side| !side.is_empty()) {
        let chain = &link.vertices[side.start..=side.end];
        let found = triangulate(mesh, [a, b], chain, floor.above(old))?;
        if clashes(mesh, chain, &found.triangles) {
            return None;
        }
        worst = worst.min(found.worst);
        insert.extend(both_sides(
            [a, b],
            &found.triangles,
            link.regions[side.start],
        ));
    }
    // The new edge: `clashes` counts the ends of a chain as a side.
    if mesh.edge_exists(w, z) {
        return None;
    }
    // The field last: it costs most.
    let middle = geom_core::nalgebra::center(&mesh.x[w as usize], &mesh.x[z as usize]);
    if field.is_some_and(|field| field.distance(&middle) > allowed) {
        return None;
    }
    Some(Proposal::swap(
        Operation::SurfaceFlip,
        worst - old,
        link.tets,
        insert,
    ))
}

/// How two surface triangles lie to each other.
enum Bend {
    /// In one plane: any flip keeps the shape.
    Plane,
    /// On a curved surface, nearly in one plane before and after: the field says whether the flip keeps
    /// to it.
    Curved,
}

/// How the surface triangles at the edge `ab`, with the opposite corners `w` and `z`, lie to each other
/// and to those after the flip; `None` where the flip would fold the surface or change its shape.
fn bend(mesh: &EditableMesh, [a, b]: [u32; 2], [w, z]: [u32; 2]) -> Option<Bend> {
    let at = |v: u32| mesh.x[v as usize];
    let normal = |p: u32, q: u32, r: u32| -> Option<Vector3> {
        (at(q) - at(p)).cross(&(at(r) - at(p))).try_normalize(0.0)
    };
    // Counter-clockwise seen from the same side, before and after.
    let before = [normal(a, b, w)?, normal(b, a, z)?];
    let after = [normal(w, z, b)?, normal(z, w, a)?];
    if before[0].cross(&before[1]).norm() <= PLANE && before[0].dot(&before[1]) > 0.0 {
        return Some(Bend::Plane);
    }
    let on_field = |v: u32| mesh.freedom[v as usize] == Freedom::Field;
    let normals = [before[0], before[1], after[0], after[1]];
    let flat = (0..4).all(|i| (0..i).all(|j| normals[i].dot(&normals[j]) >= FLAT_ENOUGH));
    ([a, b, w, z].into_iter().any(on_field) && flat).then_some(Bend::Curved)
}

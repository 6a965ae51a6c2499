//! Operations that keep the vertices: removal of an edge, swap of a face, flip of a surface edge.

use geom_core::mesh::{FACES, Region};
use geom_core::{Point3, Vector3};

use crate::boundary::field::Isosurface;
use crate::measure::metrics::quality;
use crate::mesh::editable::Work;
use crate::mesh::link::EdgeRing;
use crate::mesh::proposal::{Floor, Operation, Proposal};

/// Most tetrahedra around an edge that is removed.
const LONGEST_RING: usize = 8;
/// Cosine between the normals of two surface triangles whose common edge may flip.
const FLAT_ENOUGH: f64 = 0.9;
/// Sine between normals that count as one plane.
const PLANE: f64 = 1e-9;

/// The triangulation of the polygon `chain` whose worst tetrahedron with `a` or `b` is best, if it is
/// above `floor` (Klincsek's dynamic programme). Triangles are counter-clockwise seen from `b`.
fn triangulate(
    work: &Work,
    a: u32,
    b: u32,
    chain: &[u32],
    floor: f64,
) -> Option<(f64, Vec<[u32; 3]>)> {
    let n = chain.len();
    let at = |v: u32| work.x[v as usize];
    let (pa, pb) = (at(a), at(b));
    let p: Vec<Point3> = chain.iter().map(|&v| at(v)).collect();
    // best[i][j]: the polygon i…j; split[i][j]: the third corner of the triangle at ij.
    let mut best = [[f64::INFINITY; LONGEST_RING + 1]; LONGEST_RING + 1];
    let mut split = [[0u8; LONGEST_RING + 1]; LONGEST_RING + 1];
    for width in 2..n {
        for i in 0..n - width {
            let k = i + width;
            best[i][k] = f64::NEG_INFINITY;
            for j in i + 1..k {
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
    Some((worst, triangles))
}

/// Does a triangulation use a diagonal that is already an edge, or a triangle that is already a face?
fn clashes(work: &Work, chain: &[u32], triangles: &[[u32; 3]]) -> bool {
    let n = chain.len();
    let place = |v: u32| chain.iter().position(|&c| c == v).expect("a chain vertex");
    let side = |u: u32, v: u32| {
        let (i, j) = (place(u), place(v));
        let d = i.abs_diff(j);
        d == 1 || d == n - 1
    };
    triangles.iter().any(|&[u, v, w]| {
        let mut diagonal = false;
        for (s, t) in [(u, v), (v, w), (w, u)] {
            if !side(s, t) {
                diagonal = true;
                if work.edge_exists(s, t) {
                    return true;
                }
            }
        }
        !diagonal && work.face_exists(u, v, w)
    })
}

fn both_sides(triangles: &[[u32; 3]], a: u32, b: u32, region: Region) -> Vec<([u32; 4], Region)> {
    triangles
        .iter()
        .flat_map(|&[u, v, w]| [([u, v, w, b], region), ([u, w, v, a], region)])
        .collect()
}

fn worst_of(work: &Work, tets: &[u32]) -> f64 {
    tets.iter()
        .map(|&t| work.q[t as usize])
        .fold(f64::INFINITY, f64::min)
}

/// Removal of the interior edge `ab`: the ring is triangulated, and each triangle joined to `a` and
/// `b`. A ring of 3 is the 3-2 swap, of 4 the 4-4 swap.
pub(crate) fn edge_removal(work: &Work, a: u32, b: u32, floor: Floor) -> Option<Proposal> {
    let ring = EdgeRing::new(work, a, b)?;
    let n = ring.tets.len();
    if !(3..=LONGEST_RING).contains(&n) || !ring.interior() {
        return None;
    }
    let old = worst_of(work, &ring.tets);
    if old <= 0.0 {
        return None;
    }
    let chain = &ring.vertices[..n];
    let (worst, triangles) = triangulate(work, a, b, chain, floor.above(old))?;
    if clashes(work, chain, &triangles) {
        return None;
    }
    let insert = both_sides(&triangles, a, b, ring.regions[0]);
    let gain = worst - old;
    Some(Proposal::swap(
        Operation::EdgeRemoval,
        gain,
        ring.tets,
        insert,
    ))
}

/// Swap of the face of `t` opposite its corner `k`: two tetrahedra become three around a new edge.
pub(crate) fn face_swap(work: &Work, t: u32, k: usize, floor: Floor) -> Option<Proposal> {
    let o = work.beyond(t, k)?;
    let region = work.regions[t as usize];
    let old = work.q[t as usize].min(work.q[o as usize]);
    if work.regions[o as usize] != region || old <= 0.0 {
        return None;
    }
    let tet = work.tets[t as usize];
    let [u, v, w] = FACES[k].map(|i| tet[i]);
    let (p, r) = (tet[k], other_corner(work.tets[o as usize], [u, v, w])?);
    let new = [[p, u, v, r], [p, v, w, r], [p, w, u, r]];
    let mut worst = f64::INFINITY;
    for tet in new {
        worst = worst.min(work.quality_of(tet));
        if worst <= floor.above(old) {
            return None;
        }
    }
    if work.edge_exists(p, r) {
        return None;
    }
    let insert = new.map(|n| (n, region)).to_vec();
    Some(Proposal::swap(
        Operation::FaceSwap,
        worst - old,
        vec![t, o],
        insert,
    ))
}

fn other_corner(tet: [u32; 4], face: [u32; 3]) -> Option<u32> {
    tet.into_iter().find(|v| !face.contains(v))
}

/// Flip of the surface edge `ab` to the edge between the opposite corners of its two surface
/// triangles; the tetrahedra of each side are rebuilt. `allowed` is the distance from the isosurface
/// that the middle of the new edge may have; without a field only plane pairs flip.
pub(crate) fn surface_flip(
    work: &Work,
    a: u32,
    b: u32,
    field: Option<&Isosurface<'_>>,
    allowed: f64,
    floor: Floor,
) -> Option<Proposal> {
    let (ring, first) = EdgeRing::new(work, a, b)?.at_interface()?;
    let n = ring.tets.len();
    let old = worst_of(work, &ring.tets);
    if old <= 0.0 {
        return None;
    }
    // Each side of the interface is a chain from one opposite corner to the other.
    let (w, z) = (ring.vertices[0], ring.vertices[first]);
    let sides = [(0, first), (first, n)];
    let inner = |&&(from, to): &&(usize, usize)| to > from;
    if sides
        .iter()
        .filter(inner)
        .any(|&(from, to)| !(2..=LONGEST_RING).contains(&(to - from)))
    {
        return None;
    }
    let at = |v: u32| work.x[v as usize];
    let normal = |p: u32, q: u32, r: u32| -> Option<Vector3> {
        (at(q) - at(p)).cross(&(at(r) - at(p))).try_normalize(0.0)
    };
    // Counter-clockwise seen from the same side, before and after.
    let before = [normal(a, b, w)?, normal(b, a, z)?];
    let after = [normal(w, z, b)?, normal(z, w, a)?];
    let mut bent = None;
    let plane = before[0].cross(&before[1]).norm() <= PLANE && before[0].dot(&before[1]) > 0.0;
    if !plane {
        let curved = [a, b, w, z]
            .iter()
            .any(|&v| work.freedom[v as usize] == crate::mesh::editable::Freedom::Field);
        let field = field.filter(|_| curved)?;
        let normals = [before[0], before[1], after[0], after[1]];
        if (0..4).any(|i| (0..i).any(|j| normals[i].dot(&normals[j]) < FLAT_ENOUGH)) {
            return None;
        }
        bent = Some(field);
    }
    let mut worst = f64::INFINITY;
    let mut insert = Vec::new();
    for &(from, to) in sides.iter().filter(inner) {
        let chain = &ring.vertices[from..=to];
        let (q, triangles) = triangulate(work, a, b, chain, floor.above(old))?;
        if clashes(work, chain, &triangles) {
            return None;
        }
        worst = worst.min(q);
        insert.extend(both_sides(&triangles, a, b, ring.regions[from]));
    }
    // The new edge: `clashes` counts the ends of a chain as a side.
    if work.edge_exists(w, z) {
        return None;
    }
    // The field last: it costs most.
    let middle = geom_core::nalgebra::center(&at(w), &at(z));
    if bent.is_some_and(|field| field.distance(&middle) > allowed) {
        return None;
    }
    Some(Proposal::swap(
        Operation::SurfaceFlip,
        worst - old,
        ring.tets,
        insert,
    ))
}

//! Contraction of an edge: one end moves onto the other, and the tetrahedra between them vanish.

use geom_core::mesh::VertexKind;
use geom_core::{Point3, Vector3};

use crate::metrics::quality;
use crate::proposal::{Floor, Operation, Proposal};
use crate::surface_field::Isosurface;
use crate::swap::EdgeRing;
use crate::work::{Freedom, NONE, Work};

/// The vertex at infinity, joined to every face of the boundary.
const INFINITY: u32 = NONE;
/// Cosine between the normals of a surface triangle before and after.
const TURN: f64 = 0.5;

/// What lies opposite a vertex in the simplices around it, all lists sorted.
#[derive(Default)]
struct Link {
    vertices: Vec<u32>,
    edges: Vec<[u32; 2]>,
    triangles: Vec<[u32; 3]>,
    /// The edges opposite the vertex in the interface triangles around it.
    surface: Vec<[u32; 2]>,
}

impl Link {
    fn of(work: &Work, v: u32) -> Self {
        let ring = work.rings.of(v);
        let mut link = Self::default();
        let mut sides = Vec::with_capacity(3 * ring.len());
        for &t in ring {
            let tet = work.tets[t as usize];
            let k = tet.iter().position(|&u| u == v).expect("a corner");
            let mut f = geom_core::mesh::FACES[k].map(|i| tet[i]);
            f.sort_unstable();
            let region = work.regions[t as usize];
            link.triangles.push(f);
            sides.extend([[f[0], f[1]], [f[0], f[2]], [f[1], f[2]]].map(|e| (e, region)));
        }
        sides.sort_unstable();
        for group in sides.chunk_by(|a, b| a.0 == b.0) {
            let edge = group[0].0;
            link.edges.push(edge);
            // One tetrahedron: a face of the boundary, which has one more beyond, with infinity.
            if group.len() == 1 {
                link.triangles.push([edge[0], edge[1], INFINITY]);
                link.edges.extend(edge.map(|u| [u, INFINITY]));
            }
            if group.len() == 1 || group[0].1 != group[1].1 {
                link.surface.push(edge);
            }
        }
        link.edges.sort_unstable();
        link.edges.dedup();
        link.triangles.sort_unstable();
        link.vertices = link.edges.iter().flatten().copied().collect();
        link.vertices.sort_unstable();
        link.vertices.dedup();
        link
    }

    fn surface_vertices(&self) -> Vec<u32> {
        let mut out: Vec<u32> = self.surface.iter().flatten().copied().collect();
        out.sort_unstable();
        out.dedup();
        out
    }
}

fn common<T: Ord + Copy>(a: &[T], b: &[T]) -> Vec<T> {
    a.iter()
        .copied()
        .filter(|v| b.binary_search(v).is_ok())
        .collect()
}

/// The link condition (Dey et al. 1999) with the boundary closed at infinity, and the same for the
/// interface: contraction then keeps the topology of all regions.
fn keeps_topology(work: &Work, a: u32, b: u32, ring: &EdgeRing, on_surface: bool) -> bool {
    let (la, lb) = (Link::of(work, a), Link::of(work, b));
    let mut vertices = ring.vertices.clone();
    let mut edges: Vec<[u32; 2]> = ring
        .vertices
        .windows(2)
        .map(|w| [w[0].min(w[1]), w[0].max(w[1])])
        .collect();
    if !ring.closed() {
        vertices.push(INFINITY);
        let last = ring.vertices.len() - 1;
        edges.extend([0, last].map(|i| [ring.vertices[i], INFINITY]));
    }
    if common(&la.vertices, &lb.vertices)
        .iter()
        .any(|v| !vertices.contains(v))
        || common(&la.edges, &lb.edges)
            .iter()
            .any(|e| !edges.contains(e))
        || !common(&la.triangles, &lb.triangles).is_empty()
    {
        return false;
    }
    if !on_surface {
        return true;
    }
    // On the surface the two wings are the only common neighbours, and close no triangle.
    let wings = common(&la.surface_vertices(), &lb.surface_vertices());
    let &[w, z] = wings.as_slice() else {
        return false;
    };
    [&la, &lb]
        .iter()
        .all(|l| l.surface.binary_search(&[w, z]).is_err())
}

/// Does the contraction of `a` into `b`, judged before, still keep the topology?
pub(crate) fn still_contracts(work: &Work, a: u32, b: u32, on_surface: bool) -> bool {
    EdgeRing::new(work, a, b).is_some_and(|ring| keeps_topology(work, a, b, &ring, on_surface))
}

/// May `a` vanish into `b` as far as the geometry of boundary and interfaces is concerned? Gives
/// whether the edge lies on the interface.
fn allowed(work: &Work, a: u32, b: u32, ring: &EdgeRing) -> Option<bool> {
    let freedom = work.freedom[a as usize];
    if freedom == Freedom::Free {
        return Some(false);
    }
    // The edge must lie on an interface; `a` lies on only one.
    if ring.interior() || freedom == Freedom::Fixed {
        return None;
    }
    let along = work.x[b as usize] - work.x[a as usize];
    let stays = match freedom {
        Freedom::Line(d) => along.cross(&d).norm() <= 1e-9 * along.norm(),
        Freedom::Plane(n) => along.dot(&n).abs() <= 1e-9 * along.norm(),
        _ => true,
    };
    // A vertex of a box edge goes only to another one of it, or to its end.
    let kinds_fit = match work.kinds[a as usize] {
        VertexKind::BoxEdge { .. } => matches!(
            work.kinds[b as usize],
            VertexKind::BoxEdge { .. } | VertexKind::Fixed
        ),
        _ => true,
    };
    (stays && kinds_fit).then_some(true)
}

/// Contraction of `a` into `b`. `tolerance`: largest distance of the middle of a new surface triangle
/// from the isosurface.
pub(crate) fn contraction(
    work: &Work,
    a: u32,
    b: u32,
    field: Option<&Isosurface<'_>>,
    tolerance: f64,
    floor: Floor,
) -> Option<Proposal> {
    if work.freedom[a as usize] == Freedom::Fixed {
        return None;
    }
    let star = work.rings.of(a);
    let old = star
        .iter()
        .map(|&t| work.q[t as usize])
        .fold(f64::INFINITY, f64::min);
    if old <= 0.0 {
        return None;
    }
    let target = work.x[b as usize];
    let mut worst = f64::INFINITY;
    let mut insert = Vec::new();
    for &t in star {
        let tet = work.tets[t as usize];
        if tet.contains(&b) {
            continue;
        }
        let corners = tet.map(|v| if v == a { target } else { work.x[v as usize] });
        worst = worst.min(quality(corners));
        if worst <= floor.above(old) {
            return None;
        }
        insert.push((
            tet.map(|v| if v == a { b } else { v }),
            work.regions[t as usize],
        ));
    }
    if insert.is_empty() {
        return None;
    }
    let ring = EdgeRing::new(work, a, b)?;
    let on_surface = allowed(work, a, b, &ring)?;
    if !keeps_topology(work, a, b, &ring, on_surface) {
        return None;
    }
    if on_surface && !surface_stays(work, a, b, field, tolerance) {
        return None;
    }
    let remove = star.to_vec();
    let mut proposal = Proposal::swap(Operation::Contraction, worst - old, remove, insert);
    proposal.edge = Some((a, b, on_surface));
    Some(proposal)
}

/// Do the surface triangles around `a` keep their direction, and stay near the isosurface?
fn surface_stays(
    work: &Work,
    a: u32,
    b: u32,
    field: Option<&Isosurface<'_>>,
    tolerance: f64,
) -> bool {
    let at = |v: u32| work.x[v as usize];
    let normal = |p: Point3, q: Point3, r: Point3| -> Option<Vector3> {
        (q - p).cross(&(r - p)).try_normalize(0.0)
    };
    let field = field.filter(|_| work.freedom[a as usize] == Freedom::Field);
    Link::of(work, a).surface.iter().all(|&[u, v]| {
        if u == b || v == b {
            return true;
        }
        let (Some(before), Some(after)) =
            (normal(at(a), at(u), at(v)), normal(at(b), at(u), at(v)))
        else {
            return false;
        };
        let middle = Point3::from((at(b).coords + at(u).coords + at(v).coords) / 3.0);
        before.dot(&after) >= TURN && field.is_none_or(|f| f.distance(&middle) <= tolerance)
    })
}
